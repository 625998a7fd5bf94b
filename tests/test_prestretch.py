"""Pre-stretched regions: the exact film's curves, the derivative by the ramp, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import FREE, Film, Held, trace
from dea_fenicsx.geometry import StiffenedSection
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.tangent import Tangent

EPS_R, T = 4.7, 1e-3
pytestmark = pytest.mark.usefixtures("quick_compile")
RUBBER = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(EPS_R))


def membrane(stretches, nominal=(0.0, 0.0), volts=0.0, thickness=None, **more):
    """A film in its stretched state; `nominal` stresses are those of the unstretched one.

    The size is that of the mesh, which is stretched already.
    """
    l1, l2 = stretches
    thickness = thickness or T / (l1 * l2)
    # force over the stretched face: nominal stress times l of its own direction
    loads = [dea.DeadLoad("x_max", (nominal[0] * l1, 0.0, 0.0)),
             dea.DeadLoad("y_max", (0.0, nominal[1] * l2, 0.0))]  # fmt: skip
    more.setdefault("supports",
                    [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")])
    return dea.Scene(
        block((1, 1, 1), size=2e-3, thickness=thickness), {"film": RUBBER},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        prescribed=[dea.PreStretch("film", x=l1, y=l2)], loads=loads, **more,
    )  # fmt: skip


RECORD = {"x": dea.MeanStretch(("x_min", "x_max"), "x"),
          "y": dea.MeanStretch(("y_min", "y_max"), "y")}  # fmt: skip
FIRST = dea.Ramp(("prestretch", "load"), steps=4)


@pytest.mark.parametrize("sides", ["both loaded", "width held"])
def test_the_exact_film(sides):
    """From the stretched state on: strain over it, nominal stress, voltage, loss of tension."""
    film = Film(RUBBER, T, FREE, Held(2.125) if sides == "width held" else FREE)
    film = film.prestretched(2.75, 2.125)
    nominal = [getattr(side, "pascal", 0.0) for side in film.sides]
    supports = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    if sides == "width held":
        supports.append(dea.Fix("y_max", "y"))
    branch = trace(film)
    volts = branch.at_stretch(2.75 * 1.1)[0].voltage
    run = dea.solve(
        membrane((2.75, 2.125), nominal, volts, supports=supports),
        [FIRST, dea.Ramp("voltage", steps=6)], RECORD, quiet=True, stability="never",
        failures=[dea.LossOfTension("z"), dea.StretchLimit(3.0)],
    )  # fmt: skip
    at = next(row for row in run.history if row["prestretch_factor"] == 1)
    assert (at["x"], at["y"]) == pytest.approx((1, 1), abs=1e-9)
    assert at["largest_stretch"] == pytest.approx(2.75, rel=1e-8)  # the limit knows the pre-stretch
    assert at["tension_Pa"] == pytest.approx(branch.stress[:, 0].min(), rel=1e-8)
    state, _ = branch.states_at(volts)[0]
    found = (2.75 * run["x"], 2.125 * run["y"])
    assert found == pytest.approx(state.stretches[:2], rel=1e-8)
    assert run["max_field_V_per_m"] == pytest.approx(state.field, rel=1e-8)


def test_derivative_by_the_ramp():
    """Remainder of order 2 in the pre-stretch's factor, loads moving with it."""
    problem = Problem(membrane((2.0, 1.5), (5e4, 3e4), 1e3))
    rng = np.random.default_rng(3)
    load = {"prestretch": 0.6, "load": 0.6, "voltage": 1.0}
    problem.commit(problem.imposed(problem.under(problem.state, load)))
    problem.commit(problem.moved(problem.state, 1e-3 * rng.standard_normal(len(problem.free))))
    start = problem.unbalanced(problem.residual())
    tangent = Tangent(problem)
    slope = sum(tangent.by_load(r) for r in ("prestretch", "load"))
    errors = []
    for h in (1e-2, 5e-3):
        moved = load | {"prestretch": 0.6 + h, "load": 0.6 + h}
        problem.commit(problem.under(problem.state, moved))
        errors.append(
            np.linalg.norm(problem.unbalanced(problem.residual()) - start - h * slope)
        )
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] < 0.01 * h * np.linalg.norm(slope)


def test_a_stiff_region_keeps_its_own_zero():
    """Two layers, one of them stretched before they were joined; released, the other holds it.

    Small: the pair shortens by the stretched layer's share, mu_1 t_1/(mu_1 t_1 + mu_2 t_2).
    """
    from mpi4py import MPI

    from dea_fenicsx.geometry import BoxStack, Layer

    a, b = 1.0 + 1e-6, 4.0
    stack = BoxStack(1e-3, 1e-3, [Layer("film", 1e-4), Layer("back", 1e-4), Layer("film", 1e-4)])
    scene = dea.Scene(
        dea.read_gmsh(stack, MPI.COMM_SELF),
        {"film": dea.Material(dea.NeoHookean(5e4)), "back": dea.Material(dea.NeoHookean(b * 5e4))},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.PreStretch("film", x=a, y=a)],
    )
    run = dea.solve(scene, dea.Ramp(steps=1), RECORD, quiet=True)
    # in the middle: the edges' layers shear; the mean over the faces lies within a few percent
    assert 1 - run["x"] == pytest.approx(1e-6 * 2 / (2 + b), rel=0.1)


@pytest.mark.parametrize("item, words", [
    (dea.PreStretch("film", x=2.0), "two stretches"),
    (dea.PreStretch("film", x=2.0, y=2.0, z=0.5), "product is 1"),
    (dea.PreStretch("film", x=-2.0, y=2.0), "must be > 0"),
    (dea.PreStretch("film", x=float("nan"), y=2.0), "finite"),
    (dea.PreStretch("skin", x=2.0, y=2.0), "no region named 'skin'"),
])  # fmt: skip
def test_refuses(item, words):
    with pytest.raises(dea.InputError, match=words) as caught:
        dea.Scene(block((1, 1, 1)), {"film": RUBBER}, supports=[dea.Clamp("bottom")],
                  prescribed=[item])  # fmt: skip
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


def test_refuses_other_scenes():
    item = dea.PreStretch("film", x=2.0, y=2.0)
    soft = dea.Material(dea.NeoHookean(5e4), None, 1e7)
    with pytest.raises(dea.InputError, match="incompressible"):
        dea.Scene(block((1, 1, 1)), {"film": soft}, supports=[dea.Clamp("bottom")],
                  prescribed=[item])  # fmt: skip
    with pytest.raises(dea.InputError, match="plane strain only"):
        dea.Scene(block((1, 1)), {"film": RUBBER}, supports=[dea.Clamp("bottom")],
                  prescribed=[item], kinematics=dea.Axisymmetric())  # fmt: skip
    for item in (dea.PreStretch("film", r=1.5, z=0.5), dea.PreStretch("film", r=-1.0)):
        with pytest.raises(dea.InputError, match=r"one of r and z|must be > 0"):
            dea.Scene(block((1, 1)), {"film": RUBBER}, supports=[dea.Clamp("bottom")],
                      prescribed=[item], kinematics=dea.Axisymmetric())  # fmt: skip
    with pytest.raises(dea.InputError, match="for an axisymmetric section"):
        dea.Scene(block((1, 1, 1)), {"film": RUBBER}, supports=[dea.Clamp("bottom")],
                  prescribed=[dea.PreStretch("film", r=1.5)])  # fmt: skip


def test_a_film_that_cannot_move_is_ramped_without_retries():
    """All of its motion is rounding, of which no step may be taken for a jump to another branch."""
    section = StiffenedSection(length=20e-3, strip=(8e-3, 12e-3))
    scene = dea.Scene(
        dea.read_gmsh(section, MPI.COMM_SELF),
        {"film": RUBBER, "stiffener": dea.Material(dea.NeoHookean(1e6))},
        [dea.Electrode("top", 1e3), dea.Ground("bottom")],
        [dea.Clamp("x_min"), dea.Clamp("x_max")],
        [dea.PreStretch("film", x=2.0, z=1.0)],
        kinematics=dea.PlaneStrain(),
    )
    path = [dea.Ramp("prestretch", steps=4), dea.Ramp("voltage", steps=4)]
    run = dea.solve(scene, path, {"up": dea.LargestDisplacement("top", "y")}, quiet=True)
    assert len(run.history) == 9
    assert run.column("retries").sum() == 0
    assert abs(run.column("up_m")).max() < 1e-8 * 20e-3  # what a residual of 1e-10 leaves
