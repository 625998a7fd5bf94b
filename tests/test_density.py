"""Constants that vary with the place, and densities found by gradients."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.design import Analysis, Density, distribute
from dea_fenicsx.design.density import Layout
from dea_fenicsx.geometry import MembraneDisc

pytestmark = pytest.mark.usefixtures("quick_compile")
MU, EPS_R, R, VOLTS = 50e3, 3.0, 10e-3, 3.5e3
REGIONS = ("active", "passive")


# ------------------------------------------------------------------------- graded constants


def pulled(factor, constant="elastic.mu", law=None):
    """A block of two halves side by side, pulled along both: each in simple tension."""
    held = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    rubber = dea.Material(law or dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
    return dea.Scene(
        block((1, 2, 1)), {"film": rubber}, supports=[*held, dea.Graded("film", constant, factor)],
        prescribed=[dea.Stretch("x_max", "x", 1.3)],
    )  # fmt: skip


def test_halves_in_parallel():
    """mu A (lam - lam^-2), with the mean of the moduli 1 and 4 times mu."""
    scene = pulled(lambda X: np.where(X[:, 1] < 0.5e-3, 1.0, 4.0))
    record = {"force": dea.Reaction("x_max", "x")}
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
    due = 2.5 * MU * 1e-6 * (1.3 - 1.3**-2)
    assert run["force_N"] == pytest.approx(due, rel=1e-7)
    assert run.sensitivity("force", ["film.elastic.mu"])["film.elastic.mu"] * MU == pytest.approx(
        due, rel=1e-7
    )
    problem = run.problem
    problem.parameters["film.elastic.mu"] = 2 * MU  # the factor stays
    assert sorted(set(problem.parameters.coefficient("film.elastic.mu")[0].x.array / MU)) == [2, 8]


@pytest.mark.parametrize("factor, constant, words", [
    (lambda X: 0 * X[:, 0], "elastic.mu", "is 0 somewhere, but must be above 0"),
    (lambda X: X, "elastic.mu", "one finite number for each"),
    (lambda X: 1 / 0, "elastic.mu", "ZeroDivisionError"),
    (lambda X: 1 + X[:, 0], "elastic.my", "did you mean 'film.elastic.mu'"),
])  # fmt: skip
def test_factors_that_are_refused(factor, constant, words):
    with pytest.raises(dea.InputError) as caught:
        dea.solve(pulled(factor, constant), dea.Ramp(steps=1), quiet=True)
    assert words in str(caught.value) and len(str(caught.value)) <= 400


# --------------------------------------------------------------------------- a pre-stretched disc


def disc(comm, cells=8):
    """Half of a film on a frame, with electrodes all over; it cannot move then."""
    shape = MembraneDisc(R, R / 2, 0.25e-3, cells=(cells, 1, cells), grading=1.0)
    device = dea.device(shape, comm)
    rubber = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
    return dea.Scene(
        device, dict.fromkeys(REGIONS, rubber),
        [*(dea.Electrode(f"top_{name}", VOLTS) for name in REGIONS), dea.Ground("bottom")],
        [dea.Fix("bottom", "z"), dea.Fix("axis", "r"), dea.Fix("rim", "r")],
        prescribed=[dea.PreStretch(REGIONS, r=2.0)], kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def mark(at):
    """The motion of the film halfway to its frame."""
    t = (at.X[0] / R - 0.5) / 0.1
    return at.u[0] / (1 + t**2) ** 4


STROKE = Analysis(
    {"stroke": dea.Expression(mark, unit="m")},
    [dea.Ramp("prestretch", steps=1), dea.Ramp("voltage", steps=1)], {"stability": "never"},
)  # fmt: skip
ELECTRODE = Density(REGIONS, {"electric.eps_r": (1e-4, 1.0)}, 3e-3, "r", sharpness=(4.0, 64.0))


def rates(comm, p=0.0):
    """The stroke of a film of uneven constants, and its derivative by a change of them."""

    def even(X):
        return 1 + 0.3 * np.sin(3 * X[:, 0] / R)

    def rate(X):
        return np.cos(2 * X[:, 0] / R)

    graded = [
        dea.Graded(REGIONS, "elastic.mu", lambda X: even(X) + p * rate(X)),
        dea.Graded("active", "electric.eps_r", lambda X: even(X) ** 2 + p * rate(X) / 2),
    ]
    scene = disc(comm)
    scene = replace(scene, supports=[*scene.supports, *graded])
    run = dea.solve(scene, STROKE.items, STROKE.record, quiet=True, **STROKE.solve)
    change = dea.ConstantChange("p", {
        "active.elastic.mu": lambda X: MU * rate(X), "passive.elastic.mu": lambda X: MU * rate(X),
        "active.electric.eps_r": lambda X: EPS_R * rate(X) / 2,
    })  # fmt: skip
    found = run.sensitivity("stroke", [change])
    layout = Layout(ELECTRODE, scene)
    return [run["stroke_m"], found["p"], *layout.share, *layout.places.ravel()]


def test_a_change_that_varies_with_the_place():
    """Central differences of solved neighbours are off by a term in the square of the step."""
    slope = rates(MPI.COMM_SELF)[1]
    errors = [
        (rates(MPI.COMM_SELF, h)[0] - rates(MPI.COMM_SELF, -h)[0]) / (2 * h) / slope - 1
        for h in (2e-2, 1e-2)
    ]
    assert abs(errors[0]) < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.01)


@pytest.mark.mpi
def test_three_ranks_find_what_one_finds(on_ranks):
    found = on_ranks("test_density", "rates", 3)
    assert np.array(found) == pytest.approx(np.array(rates(MPI.COMM_SELF)), rel=1e-8)


def test_what_is_filled_is_as_wide_as_is_said():
    layout = Layout(ELECTRODE, disc(MPI.COMM_SELF, 50))
    h, x = R / 100, np.zeros(100)
    x[40] = 1.0
    rho = layout.filled(x, 1e6)
    assert rho[rho > 0.5].size == pytest.approx(ELECTRODE.length / h, abs=2)
    x = np.random.default_rng(1).random(100)
    step = 1e-6 * np.eye(100)[30]
    slope = (layout.filled(x + step, 4.0) - layout.filled(x - step, 4.0)) / 2e-6
    assert layout.slopes(x, 4.0).toarray()[:, 30] == pytest.approx(slope, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("method", ["SLSQP", "MMA"])
def test_an_electrode_finds_its_edge(method, tmp_path):
    """From an electrode all over to the round one whose edge moves the mark most."""
    if method == "MMA":
        pytest.importorskip("nlopt")
    scene = disc(MPI.COMM_SELF)

    def stroke(edge):
        one = dea.Graded(REGIONS, "electric.eps_r", lambda X: np.where(X[:, 0] < edge, 1.0, 1e-4))
        told = replace(scene, supports=[*scene.supports, one])
        return dea.solve(told, STROKE.items, STROKE.record, quiet=True, **STROKE.solve)["stroke_m"]

    best = max(stroke(k * R / 16) for k in range(7, 11))

    def search(**more):
        return distribute(
            disc, ELECTRODE, {"stroke": "max"}, STROKE, {"filled": (None, 0.5)}, method=method,
            most=20, tolerance=1e-5, out=tmp_path, quiet=True, comm=MPI.COMM_SELF, **more,
        )  # fmt: skip

    found = search()
    assert found.feasible and found.greyness < 0.1 and found.quantities["filled"] <= 0.5
    assert abs(found.before["stroke"]) < 1e-6 * best < found.quantities["stroke"]
    assert found.quantities["stroke"] > 0.97 * best
    full = found.places[found.density > 0.5, 0]
    assert full.max() < 0.65 * R and len(full) == np.sum(found.places[:, 0] <= full.max())
    again = search(resume=True)
    assert again.solved == 0 and np.array_equal(again.density, found.density)


@pytest.mark.parametrize("changes, words", [
    ({"density": replace(ELECTRODE, length=1e-4)}, "at most the distance of two cells"),
    ({"density": replace(ELECTRODE, axes="x")}, "must do so along some of r, z"),
    ({"density": replace(ELECTRODE, constants={"electric.eps_r": (0.0, 1.0)})}, "numbers above 0"),
    ({"density": replace(ELECTRODE, where="activ")}, "did you mean 'active'"),
    ({"density": replace(ELECTRODE, start=2.0)}, "must be 0 to 1"),
    ({"density": replace(ELECTRODE, sharpness=())}, "one or more numbers > 0"),
    ({"density": replace(ELECTRODE, constants={"elastic.m": (1.0, 2.0)})}, "has no constant"),
    ({"objective": {"strok": "max"}}, "did you mean 'stroke'"),
    ({"method": "MMB"}, "no method 'MMB'"),
    ({"method": "MMA"}, "pip install nlopt"),
])  # fmt: skip
def test_what_is_wrong_is_told(changes, words, monkeypatch):
    monkeypatch.setitem(sys.modules, "nlopt", None)
    given = {
        "build": lambda comm: disc(comm, 4), "density": ELECTRODE, "objective": {"stroke": "max"},
        "analyses": STROKE, "quiet": True, "comm": MPI.COMM_SELF,
    }  # fmt: skip
    with pytest.raises(dea.InputError) as caught:
        distribute(**(given | changes))
    told = str(caught.value)
    assert words in told and len(told) <= 400 and told.endswith(".")
