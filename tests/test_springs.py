"""Springs on rigid parts and elastic foundations, against bars whose stiffness is known."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from stopped_runs import refused

import dea_fenicsx as dea
from dea_fenicsx.model.problem import Problem

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, DEPTH = 5e4, 1e-3, 2e-3
FILM = {"film": dea.Material(dea.NeoHookean(MU))}
TIGHT = dea.NewtonOptions(tolerance=1e-12)
A = H * DEPTH


def bar(*springs, loads=(), prescribed=(), cells=(1, 1), device=None):
    """A bar in plane strain that is held at x_min, with what acts on x_max."""
    return dea.Scene(
        device or block(cells), FILM, kinematics=dea.PlaneStrain(DEPTH), loads=loads,
        supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y"), *springs],
        prescribed=prescribed,
    )  # fmt: skip


def pulled(*springs, force=0.05, **more):
    """The bar with a rigid end, a force on it and springs."""
    rigid = dea.Rigid("x_max", turns="")
    return bar(rigid, *springs, loads=[dea.Force("x_max", (force, 0.0))], **more)


RECORD = {"u": dea.PartDisplacement("x_max", "x"), "E": dea.Energy("springs"),
          "R": dea.Reaction("x_min", "x")}  # fmt: skip


def solve(scene, **options):
    return dea.solve(scene, dea.Ramp(steps=2), RECORD, quiet=True, options=TIGHT, **options)


@pytest.mark.parametrize("law, force, energy", [
    (30.0, lambda d: 30 * d, lambda d: 15 * d**2),
    (dea.CubicLaw(30.0, 4e8), lambda d: 30 * d + 4e8 * d**3, lambda d: 15 * d**2 + 1e8 * d**4),
    (lambda d: 0.02 * d / H / (1 + d / H), lambda d: 0.02 * d / (H + d),
     lambda d: 0.02 * (d - H * np.log(1 + d / H))),
])  # fmt: skip
def test_the_bar_bears_what_the_spring_leaves(law, force, energy):
    """To 1e-10, and the energy of the spring is the integral of its force."""
    run = solve(pulled(dea.Spring("x_max", law, "x")))
    d = float(run["u_m"])
    assert d > 0.02 * H
    assert run["R_N"] == pytest.approx(force(d) - 0.05, rel=1e-10)
    assert run["E_J"] == pytest.approx(energy(d), rel=1e-8)
    assert run["inertia"] == 0


def test_rest_and_another_part():
    """Without load a spring that is short pulls; between two parts only the difference counts."""
    path = [dea.Ramp("spring", steps=1), dea.Ramp("load", steps=1)]
    scene = pulled(dea.Spring("x_max", 50.0, "x", rest=0.5 * H), force=0.01)
    run = dea.solve(scene, path, RECORD, quiet=True, options=TIGHT)
    d = run.column("u_m")
    assert d[1] > 0
    assert run.column("R_N")[1:] == pytest.approx(50 * (d[1:] - 0.5 * H) - [0, 0.01], rel=1e-10)
    device = block((2, 1))
    both = dea.Scene(
        device, FILM, kinematics=dea.PlaneStrain(DEPTH), loads=[dea.Force("x_max", (0.05, 0.0))],
        supports=[dea.Fix("bottom", "y"), dea.Rigid("x_min", "x", turns=""),
                  dea.Rigid("x_max", turns=""), dea.Spring("x_max", 30.0, "x", to="x_min")],
    )  # fmt: skip
    record = {"u": dea.PartDisplacement("x_max", "x"), "F": dea.PartForce("x_min", "x")}
    run = dea.solve(both, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    assert run["F_N"] == pytest.approx(-0.05, rel=1e-10)  # spring and bar together


def test_between_two_points():
    """A spring that stands across the bar gets longer as the part moves: a geometric stiffness."""
    k, L = 200.0, 0.5 * H
    scene = pulled(dea.Spring("x_max", k, anchor=(H, 3 * H), length=L))
    path = [dea.Ramp("spring", steps=2), dea.Ramp("load", steps=1)]
    run = dea.solve(scene, path, RECORD, quiet=True, options=TIGHT)
    part = run.problem.rigid.parts[0]
    c = part.split(part.values(run.problem.w.x.array))[0] * H
    arm = part.centre * H + c - np.array([H, 3 * H])
    tension = k * (np.linalg.norm(arm) - L)
    assert run["R_N"] == pytest.approx(tension * arm[0] / np.linalg.norm(arm) - 0.05, rel=1e-9)


def test_a_bistable_spring_is_traced_through_both_limits():
    """Force over displacement of bar and spring: a maximum and a minimum, between them unstable.

    At both limits the stiffness of the bar is minus that of the spring.
    """
    law = dea.BistableLaw(0.15, 0.6 * H)
    scene = pulled(dea.Spring("x_max", law, "x"), force=0.4)
    trace = dea.Trace("load", first=0.05, until=("u_m", 0.7 * H))
    run = dea.solve(scene, trace, RECORD, quiet=True, stability="every")
    events = [(row["event"], row["u_m"]) for row in run.history if row["event"]]
    assert [name for name, _ in events if name in ("maximum", "minimum")] == ["maximum", "minimum"]
    u, f, n = (run.column(name) for name in ("u_m", "load_factor", "inertia"))
    bar_force = -run.column("R_N")
    assert 0.4 * f == pytest.approx(bar_force + law(u), abs=1e-7)
    top, low = (u for name, u in events if name in ("maximum", "minimum"))
    inside = (u > top * 1.02) & (u < low * 0.98)
    assert inside.any() and np.all(n[inside] == 1)
    assert np.all(n[(u < 0.98 * top) | (u > 1.02 * low)] == 0)


def test_a_foundation():
    """A block held between rollers on a bed: -k u per area, in series with nothing else."""
    k = 1e8
    device = block((1, 1))
    scene = dea.Scene(
        device, FILM, kinematics=dea.PlaneStrain(DEPTH),
        supports=[dea.Clamp("bottom"), dea.ElasticFoundation("top", k, "x")],
        loads=[dea.DeadLoad("top", (2e3, 0.0))],
    )  # fmt: skip
    record = {"R": dea.Reaction("bottom", "x"), "u": dea.MeanDisplacement("top", "x"),
              "A": dea.Energy("loads")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True, options=TIGHT)
    assert run["R_N"] == pytest.approx((k * run["u_m"] - 2e3) * A, rel=1e-10)
    assert run["A_J"] == pytest.approx(2e3 * A * run["u_m"], rel=1e-10)
    assert 0 < run["u_m"] < 2e3 / k


RIGID = dea.Rigid("x_max", turns="")
WRONG = {
    "no facet group or region": (RIGID, dea.Spring("x_mx", 1.0, "x")),
    "ElasticFoundation('top'": (RIGID, dea.Spring("top", 1.0, "x")),
    "one of axis= and anchor=": (RIGID, dea.Spring("x_max", 1.0)),
    "must act along": (RIGID, dea.Spring("x_max", 1.0, "z")),
    "length 0 at the start": (RIGID, dea.Spring("x_max", 1.0, anchor=(H, H / 2))),
    "fails at the elongation 0": (RIGID, dea.Spring("x_max", lambda d: 1 / d, "x")),
    "fails for a UFL scalar": (RIGID, dea.Spring("x_max", lambda d: np.sin(d), "x")),
    "ends there, too": (RIGID, dea.Spring("x_max", 1.0, "x", to="x_max")),
    "stands for length=": (RIGID, dea.Spring("x_max", 1.0, "x", length=1e-3)),
    "share the ramp": (RIGID, dea.Spring("x_max", 1.0, "x", rest=1e-4, ramp="load")),
    "below 0": (RIGID, dea.ElasticFoundation("top", -1.0)),
    "one or more of": (RIGID, dea.ElasticFoundation("top", 1.0, "z")),
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_what_is_refused(words):
    refused(lambda: Problem(bar(*WRONG[words], loads=[dea.Force("x_max", (1.0, 0.0))])), words)


def on_these_ranks(comm):
    from dea_fenicsx.geometry import BoxStack, Layer

    flat = BoxStack(2 * H, None, [Layer("film", H)], divisions=(2,))
    run = solve(pulled(dea.Spring("x_max", dea.BistableLaw(0.1, H), "x"),
                       device=dea.read_gmsh(flat, comm)))  # fmt: skip
    return [run["u_m"], run["E_J"] * 1e6, run["newton_iterations"], run["inertia"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks(on_ranks, ranks):
    alone = on_these_ranks(MPI.COMM_SELF)
    assert on_ranks("test_springs", "on_these_ranks", ranks) == pytest.approx(alone, rel=1e-7)
