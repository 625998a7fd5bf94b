"""Coulomb friction on obstacles: sticking, sliding, what is remembered, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from stopped_runs import StopAtState

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

MU, L, DEPTH = 5e4, 1e-3, 1e-2
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
SOFT = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0), bulk_modulus=2e5)
TIGHT = dea.NewtonOptions(tolerance=1e-12)
EXACT = {"quiet": True, "options": TIGHT}
FRICTION = 0.2
FLOOR = dea.Plane((0, 0), (0, 1))

MEASURED = {
    "n": dea.ContactForce("bottom", "y"), "t": dea.ContactForce("bottom", "x"),
    "r": dea.Reaction("top", "x"), "u": dea.MeanDisplacement("bottom", "x"),
    "w": dea.FrictionWork("bottom"), "e": dea.Energy("elastic"),
}  # fmt: skip


def layer(friction=FRICTION, comm=MPI.COMM_SELF, bottom=None):
    """A wide compressible layer, L thick, that is pressed on a floor and sheared along it.

    It is the same at all places along the floor, so that its strains are homogeneous.
    """
    device = dea.read_gmsh(BoxStack(2 * L, None, [Layer("film", L, divisions=2)], (2,)), comm)
    return dea.Scene(
        device, {"film": SOFT}, kinematics=dea.PlaneStrain(DEPTH),
        prescribed=[
            dea.Displacement("top", "y", -0.2 * L, ramp="press"),
            dea.Displacement("top", "x", 0.5 * L, ramp="shear"),
        ],
        supports=[
            dea.Periodic("x_min", "x_max", free=""),
            bottom or dea.Obstacle("bottom", FLOOR, friction=friction),
        ],
    )  # fmt: skip


PRESSED = dea.Ramp("press", steps=1)
THERE_AND_BACK = [PRESSED, dea.Ramp("shear", steps=5), dea.Ramp("shear", to=0, steps=5)]


def solved(scene, path, **more):
    return dea.solve(scene, path, MEASURED, **EXACT | more)


@pytest.fixture(scope="module")
def there_and_back():
    return solved(layer(), THERE_AND_BACK)


def test_sticking_and_sliding(there_and_back):
    """Below the limit the layer is sheared as if it were bonded; above it, it slides."""
    rows = list(there_and_back.history)
    ahead = rows[2:7]
    modulus = MU * 2 * L * DEPTH * 0.8 ** (-2 / 3)  # isochoric neo-Hookean, J = 0.8
    for row in ahead:
        bonded = modulus * 0.5 * row["shear_factor"]
        assert row["t_N"] == pytest.approx(-row["r_N"], rel=1e-9)
        if bonded < FRICTION * row["n_N"]:
            assert row["r_N"] == pytest.approx(bonded, rel=1e-9)
            assert abs(row["u_m"]) < 1e-12 * L
        else:
            assert row["r_N"] == pytest.approx(FRICTION * row["n_N"], rel=1e-9)
            sheared = row["r_N"] / modulus * L
            assert row["u_m"] == pytest.approx(0.5 * L * row["shear_factor"] - sheared, rel=1e-8)
    assert abs(ahead[0]["u_m"]) < 1e-12 * L and ahead[-1]["u_m"] > 0.1 * L
    # The traction does not change while the layer slides, so that the work is a product.
    last = ahead[-1]
    assert last["w_J"] == pytest.approx(FRICTION * last["n_N"] * last["u_m"], rel=1e-8)
    assert there_and_back.summary["inertia"] is None


def test_what_is_remembered(there_and_back):
    """On the way back the layer first sticks where it has slid to, then slides back."""
    rows = list(there_and_back.history)
    turn, back, end = rows[6], rows[7], rows[-1]
    assert back["u_m"] == pytest.approx(turn["u_m"], rel=1e-9)
    assert back["w_J"] == pytest.approx(turn["w_J"], rel=1e-9)
    assert abs(back["r_N"]) < 0.6 * turn["r_N"]
    assert end["r_N"] == pytest.approx(-FRICTION * end["n_N"], rel=1e-9)
    # The place at the end is that of a layer sheared to the other side by friction.
    assert end["u_m"] == pytest.approx(0.5 * L - turn["u_m"], rel=1e-8)
    way = turn["u_m"] + abs(end["u_m"] - turn["u_m"])
    assert end["w_J"] == pytest.approx(FRICTION * end["n_N"] * way, rel=1e-8)


def test_nothing_creeps(there_and_back):
    """A held load changes nothing, and neither does another number of steps."""
    held = [*THERE_AND_BACK[:2], dea.Ramp("press", to=1.0, steps=3)]
    row = solved(layer(), held).history[-1]
    assert row["t_N"] == pytest.approx(there_and_back.history[6]["t_N"], rel=1e-10)
    many = solved(layer(), [PRESSED, dea.Ramp("shear", steps=13)]).history[-1]
    for name in ("t_N", "u_m", "w_J"):
        assert many[name] == pytest.approx(there_and_back.history[6][name], rel=1e-8)


def test_along_an_arc(there_and_back):
    """A trace leads over the onset of sliding to the state of a ramp."""
    trace = dea.Trace("shear", first=0.2, until=("shear_factor", 1.0), steps=60)
    row = solved(layer(), [PRESSED, trace]).history[-1]
    for name in ("t_N", "u_m", "w_J"):
        assert row[name] == pytest.approx(there_and_back.history[6][name], rel=1e-6)


# -------------------------------------------------------------- a block that is not homogeneous

def pushed(comm=MPI.COMM_SELF):
    """A block with free sides, pressed on the floor and pushed along it until it slides."""
    device = dea.read_gmsh(BoxStack(2 * L, None, [Layer("film", L, divisions=2)], (4,)), comm)
    return dea.Scene(
        device, {"film": RUBBER}, kinematics=dea.PlaneStrain(DEPTH),
        prescribed=[
            dea.Displacement("top", "y", -0.1 * L, ramp="press"),
            dea.Displacement("top", "x", 0.8 * L, ramp="shear"),
        ],
        supports=[dea.Obstacle("bottom", FLOOR, friction=0.3)],
    )  # fmt: skip


def push(steps, comm=MPI.COMM_SELF, **more):
    path = [dea.Ramp("press", steps=steps), dea.Ramp("shear", steps=2 * steps)]
    return solved(pushed(comm), path, **more)


@pytest.fixture(scope="module")
def pushes():
    return {steps: push(steps) for steps in (2, 4, 8)}


def test_a_block_slides(pushes):
    """All of the block slides at the end, so that the forces obey Coulomb's law as a whole."""
    for run in pushes.values():
        last = run.history[-1]
        assert last["t_N"] == pytest.approx(-0.3 * last["n_N"], rel=1e-8)
        assert last["r_N"] == pytest.approx(-last["t_N"], rel=1e-9)


def test_steps_of_a_path(pushes):
    """The state depends on the path, and hardly on the number of steps along the same path."""
    def forces(run):
        partly = [row for row in run.history if row["shear_factor"] == 0.25]
        return np.array([partly[0]["t_N"], partly[0]["n_N"]])

    coarse, middle, fine = (forces(run) for run in pushes.values())
    assert np.all(np.abs(middle / fine - 1) < 0.02)
    # Where all forces agree but for rounding, nothing is left to converge.
    rounding = 1e-10 * np.abs(fine).max()
    assert np.abs(middle - fine).max() < max(np.abs(coarse - fine).max(), rounding)


@pytest.mark.parametrize("viscous", [False, True])
def test_a_block_slides_down_an_incline(viscous):
    """On a plane that leans, friction is the coefficient times the force along its normal.

    So it is at each instant of a march, whatever the viscous stresses are.
    """
    angle, friction = 0.1, 0.3
    up = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-up[1], up[0]])
    x, y = -0.6 * L * up - 0.15 * L * normal
    branches = [dea.Maxwell(2 * MU, 0.5)] if viscous else []
    device = dea.read_gmsh(BoxStack(L, None, [Layer("film", L, divisions=2)], (2,)), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"film": dea.Material(dea.NeoHookean(MU), viscous=branches)},
        kinematics=dea.PlaneStrain(DEPTH),
        prescribed=[
            dea.Displacement("top", "x", x), dea.Displacement("top", "y", y),
        ],
        supports=[dea.Obstacle("bottom", dea.Plane((L, 0.0), tuple(normal)), friction=friction)],
    )  # fmt: skip
    path = dea.March(1.0, {"stretch": dea.Rise(seconds=1.0)}) if viscous else dea.Ramp(steps=4)
    run = solved(scene, path)
    force = np.column_stack([run.column("t_N"), run.column("n_N")])[-3:]
    assert np.all(force @ normal > 0)
    assert force @ up == pytest.approx(friction * (force @ normal), rel=1e-7)


def test_in_space():
    """A cube is pushed askew; friction acts against the slip, mu times the pressing force."""
    way = np.array([0.3, 0.4]) * L
    scene = dea.Scene(
        block((1, 1, 1)), {"film": RUBBER},
        prescribed=[
            dea.Displacement("top", "z", -0.05 * L, ramp="push"),
            dea.Displacement("top", "x", way[0], ramp="push"),
            dea.Displacement("top", "y", way[1], ramp="push"),
        ],
        supports=[dea.Obstacle("bottom", dea.Plane((0, 0, 0), (0, 0, 1)), friction=0.1)],
    )  # fmt: skip
    forces = {axis: dea.ContactForce("bottom", axis) for axis in "xyz"}
    last = dea.solve(scene, dea.Ramp("push", steps=3), forces, **EXACT).history[-1]
    along, across = -(3 * last["x_N"] + 4 * last["y_N"]) / 5, 4 * last["x_N"] - 3 * last["y_N"]
    assert along == pytest.approx(0.1 * last["z_N"], rel=0.02)
    assert abs(across) < 0.2 * along


def test_a_disc_between_plates():
    """A disc that is pressed slides outwards; work goes into the rubber and into friction."""
    device = dea.read_gmsh(BoxStack(2 * L, None, [Layer("film", L, divisions=2)], (4,)))
    scene = dea.Scene(
        device, {"film": RUBBER}, kinematics=dea.Axisymmetric(),
        supports=[
            dea.Fix("x_min", "r"), dea.Fix("top", "z"),
            dea.Obstacle("bottom", FLOOR, displacement=(0, 0.2 * L), friction=0.1),
        ],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("obstacle", steps=16), {
        "n": dea.ContactForce("bottom", "z"), "w": dea.FrictionWork("bottom"),
        "e": dea.Energy("elastic"), "c": dea.Energy("contact"),
    }, quiet=True)  # fmt: skip
    force, work, elastic = (np.array(run.history[name]) for name in ("n_N", "w_J", "e_J"))
    done = np.trapezoid(force, dx=0.2 * L / 16)
    assert work[-1] + elastic[-1] == pytest.approx(done, rel=5e-3)
    assert work[-1] > 0.05 * elastic[-1]


# ------------------------------------------------------------------------ ranks and resuming


def _pushed(comm):
    return [push(1, comm).history[-1][name] for name in ("t_N", "n_N", "w_J")]


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_any_number_of_ranks(ranks, on_ranks):
    assert on_ranks("test_friction", "_pushed", ranks) == pytest.approx(
        _pushed(MPI.COMM_SELF), rel=1e-8
    )


@pytest.mark.parametrize("calls", [6, 9])
def test_resuming(calls, tmp_path, there_and_back):
    """A run that was stopped while it slid, or after it had turned, goes on to the same end."""
    with pytest.raises(dea.Interrupted):
        dea.solve(layer(), THERE_AND_BACK, MEASURED | {"stop": StopAtState(calls)}, tmp_path,
                  **EXACT)  # fmt: skip
    again = dea.solve(layer(), THERE_AND_BACK, MEASURED | {"stop": StopAtState(-1)}, tmp_path,
                      resume=True, **EXACT)  # fmt: skip
    last, wanted = again.history[-1], there_and_back.history[-1]
    for name in ("t_N", "u_m", "w_J"):
        assert last[name] == pytest.approx(wanted[name], rel=1e-9)


def test_a_second_run_of_the_same_scene(there_and_back):
    """A problem that is used again has forgotten the slip of the run before."""
    first = list(there_and_back.history)[-1]
    for _ in range(2):
        last = solved(layer(), THERE_AND_BACK).history[-1]
        assert last["w_J"] == pytest.approx(first["w_J"], rel=1e-10)


# ------------------------------------------------------------------------------ what is refused


@pytest.mark.parametrize("given, words", [
    (dict(friction=-0.1), "coefficient of 0 or more"),
    (dict(friction=float("nan")), "friction of the obstacle"),
])  # fmt: skip
def test_what_is_refused(given, words):
    with pytest.raises(dea.InputError, match=words):
        layer(bottom=dea.Obstacle("bottom", FLOOR, **given))


def test_the_work_needs_friction():
    with pytest.raises(dea.InputError, match="has no friction"):
        solved(layer(friction=0.0), PRESSED)
