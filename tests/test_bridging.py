"""Sharp bends, narrow folds and limit points: what lies behind the last state of a ramp is told."""

from __future__ import annotations

import math

import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.path.bridging import bridge
from dea_fenicsx.path.events import Sentinel
from dea_fenicsx.solvers.newton import NewtonSolver

MU, EPS_R, T = 5e4, 3.0, 1e-3
UNIT = T * math.sqrt(MU / (EPS_R * EPSILON_0))
PULL_IN = math.sqrt(3.0) * 2 ** (-4 / 3) * UNIT
RUBBER = dea.NeoHookean(MU)
FILM = dea.Material(RUBBER, dea.IdealDielectric(EPS_R))


def box(*layers, length=1e-3, width=None, divisions=(1,)):
    stack = BoxStack(length, width, [Layer(*layer) for layer in layers], divisions)
    return dea.read_gmsh(stack, MPI.COMM_SELF)


def solved(scene, path, record=None, **options):
    """The run, and the error that ended it or None."""
    try:
        return dea.solve(scene, path, record or {}, quiet=True, **options), None
    except (dea.EquilibriumLost, dea.SolverError, dea.NotReached) as error:
        return error.run, error


# ------------------------------------------------------------------------------- a sharp bend


def strip(load):
    """A strip between two clamps, 24 times as long as thick, pressed past buckling."""
    return dea.Scene(
        box(("film", 1e-3), length=24e-3, divisions=(24,)), {"film": dea.Material(RUBBER)},
        supports=[dea.Clamp("x_min"), dea.Fix("x_max", "y")],
        prescribed=[dea.Displacement("x_max", "x", -1.2e-3)],
        loads=[dea.DeadLoad("bottom", (0.0, load), ramp="q")],
        kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip


def buckled(load, steps):
    path = [dea.Ramp("q", steps=1), dea.Ramp("stretch", steps=steps)]
    return solved(strip(load), path, {"v": dea.MeanDisplacement("top", "y")})


@pytest.mark.parametrize("load", [1e-4, -1e-4])
def test_a_bend_at_a_buckling_load_is_no_loss(load):
    """A side load of a ten-thousandth of a pascal bends the path within 1e-4 of the ramp.

    Behind the bend a hundred times the load gives the same state, but for 2e-5 of it.
    """
    right, _ = buckled(math.copysign(1e-2, load), 20)
    for steps in (2, 3):
        run, error = buckled(load, steps)
        assert error is None, str(error)
        assert run["v_m"] == pytest.approx(right["v_m"], rel=5e-5)
        assert run.summary["stable"] is True


# ---------------------------------------------------------------------------- a true limit point


@pytest.mark.parametrize("steps", [1, 3, 20])
def test_the_range_of_a_loss_holds_the_limit_point(steps):
    """A free film: V = 0.68736 T sqrt(mu / eps) at a stretch of 2^(1/3)."""
    scene = dea.Scene(
        box(("film", T)), {"film": FILM},
        electrodes=[dea.Electrode("top", 1.1 * PULL_IN), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    run, error = solved(scene, dea.Ramp(steps=steps))
    assert isinstance(error, dea.EquilibriumLost)
    reached, failed = error.reached["voltage"], error.failed["voltage"]
    assert reached <= 1 / 1.1 * (1 + 1e-9) and failed >= 1 / 1.1 * (1 - 1e-9)
    assert failed - reached < 2e-3


# --------------------------------------------------------------------------------- a narrow fold


def layered_disc():
    """Two dielectric layers of Arruda-Boyce rubber on one ground; each has its own potential."""
    return dea.Scene(
        box(("low", 0.202e-3), ("high", 0.366e-3), length=0.578e-3, divisions=(2,)),
        {"low": dea.Material(dea.ArrudaBoyce(21400.0, 1.61), dea.IdealDielectric(2.0)),
         "high": dea.Material(dea.ArrudaBoyce(15200.0, 1.82), dea.IdealDielectric(2.0))},
        electrodes=[dea.Ground("interface_1"), dea.Electrode("bottom", 12800.0),
                    dea.Electrode("top", -11520.0)],
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        loads=[dea.DeadLoad("top", (-15760.0, 0.0), ramp="voltage"),
               dea.DeadPressure("x_max", -800.0, ramp="voltage")],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


MAXIMUM, MINIMUM = 0.591400876, 0.591398395
"""Loads of its fold, from a trace in arcs of 0.01; between them it moves by half a hundredth."""


@pytest.mark.parametrize("steps", [2, 5])
def test_a_narrow_fold_is_a_limit_point(steps):
    run, error = solved(layered_disc(), dea.Ramp(steps=steps))
    assert isinstance(error, dea.EquilibriumLost) and "limit point" in str(error)
    assert error.reached["voltage"] <= MAXIMUM + 1e-8
    assert error.failed["voltage"] >= MAXIMUM - 1e-8
    problem = run.problem
    solver = NewtonSolver(problem, dea.NewtonOptions())
    sentinel = Sentinel(solver, counting=True)
    sentinel.start()
    assert sentinel.excess == 0
    reached = problem.factors["voltage"]
    found = bridge(solver, sentinel, {"voltage": 1.0}, 1 / steps, reached, 0.6)
    assert found.limit == pytest.approx(MAXIMUM, abs=1e-8)
    # behind the limit point the branch has no state at a larger load, and the bridge finds none
    assert not found.at(0.6).converged


@pytest.mark.parametrize("longest", [0.05])
def test_a_trace_in_short_steps_sees_a_narrow_fold(longest):
    """The first step is no longer than the longest one: an arc of 1 would pass over the fold."""
    trace = dea.Trace("voltage", first=0.02, steps=60, longest=longest)
    run, _ = solved(layered_disc(), [dea.Ramp(to=0.5913), trace], stability="every")
    turns = {row["event"]: row["voltage_V"] / 12800.0 for row in run.history if row["event"]}
    assert list(turns) == ["maximum", "minimum"]
    assert turns["maximum"] == pytest.approx(MAXIMUM, abs=1e-8)
    assert turns["minimum"] == pytest.approx(MINIMUM, abs=1e-8)


# ------------------------------------------------------------------- several events in one step


def test_a_trace_that_meets_several_events_in_one_step_takes_them_one_by_one():
    """A film that stands clamped buckles just below its largest voltage.

    The right values are those of steps of a sixteenth: there the number of negative eigenvalues
    grows by one in the bifurcation, and by one in the maximum.  A step of 1 comes from 0 to 2
    without a limit point: it lands on a branch that ends far above.
    """
    yeoh = dea.Yeoh(C10=55e3, C20=2750.0, C30=220.0)
    scene = dea.Scene(
        box(("low", 0.612e-3, 1), ("high", 0.458e-3, 2), length=2.69e-3, width=2.77e-3,
            divisions=(1, 1)),
        {"low": dea.Material(yeoh, dea.IdealDielectric(9.0)),
         "high": dea.Material(yeoh, dea.IdealDielectric(2.0))},
        electrodes=[dea.ThinFilm("high", 37200.0, start=0.612e-3, end=1.07e-3, along="z")],
        supports=[dea.Clamp("bottom")],
    )  # fmt: skip
    trace = dea.Trace("voltage", first=0.02, steps=16, longest=1.0)
    run, _ = solved(scene, [dea.Ramp(to=0.75, steps=2), trace], stability="every")
    events = [(row["event"], row["voltage_V"] / 37200.0) for row in run.history if row["event"]]
    assert [name for name, _ in events[:2]] == ["bifurcation", "maximum"]
    assert events[0][1] == pytest.approx(0.84265795, abs=1e-7)
    assert events[1][1] == pytest.approx(0.84554792, abs=1e-7)
