"""Obstacles: patch tests, closing and opening, starts that penetrate, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from conftest import block
from mpi4py import MPI
from stopped_runs import StopAtState

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model import contact
from dea_fenicsx.results.fields import FieldWriter

MU, L = 5e4, 1e-3
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
TIGHT = dea.NewtonOptions(tolerance=1e-12)


def strip(length=4 * L, cells=(8, 2), comm=MPI.COMM_SELF):
    """A film in the plane, L thick."""
    return dea.read_gmsh(
        BoxStack(length, None, [Layer("film", L, divisions=cells[1])], cells[:1]), comm
    )


def nominal(stretch, kind):
    """Nominal stress in Pa of incompressible rubber: uniaxial, or in plane strain."""
    return MU * (stretch - stretch ** (-2 if kind == "uniaxial" else -3))


SQUARE = [dea.Fix("x_min", "x"), dea.Fix("top", "y")]
CUBE = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("top", "z")]
PATCHES = {
    "space": (
        lambda: block((2, 2, 2)), dea.ThreeD(), CUBE,
        dea.Plane((0, 0, 0), (0, 0, 2)), (0, 0, 0.2 * L), "z", "uniaxial", L**2),
    "plane strain": (
        lambda: strip(L, (3, 2)), dea.PlaneStrain(2 * L), SQUARE,
        dea.Plane((7.0, 0), (0, 1)), (0, 0.2 * L), "y", "plane", 2 * L**2),
    "axisymmetric": (
        lambda: strip(L, (3, 2)), dea.Axisymmetric(), [dea.Fix("x_min", "r"), dea.Fix("top", "z")],
        dea.Plane((0, 0), (0, 1)), (0, 0.2 * L), "z", "uniaxial", np.pi * L**2),
    "by a function": (
        lambda: strip(L, (3, 2)), dea.PlaneStrain(2 * L), SQUARE,
        lambda x: x[1], (0, 0.2 * L), "y", "plane", 2 * L**2),
}  # fmt: skip


@pytest.mark.parametrize("case", PATCHES)
def test_patch(case):
    """A block pressed by a flat plane is in a homogeneous state, whose stress is exact."""
    device, kinematics, supports, shape, way, axis, kind, area = PATCHES[case]
    scene = dea.Scene(
        device(), {"film": RUBBER}, kinematics=kinematics,
        supports=[*supports, dea.Obstacle("bottom", shape, displacement=way)],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("obstacle", steps=3), {
        "f": dea.ContactForce("bottom", axis), "p": dea.ContactPressure("bottom"),
        "a": dea.ContactArea("bottom"), "g": dea.ContactGap("bottom"),
        "r": dea.Reaction("top", axis),
    }, quiet=True, options=TIGHT)  # fmt: skip
    last = run.history[-1]
    stress = nominal(0.8, kind)
    # Incompressible rubber: the area on which the plane presses grows as the height falls.
    assert last["f_N"] == pytest.approx(-stress * area, rel=1e-10)
    assert last["r_N"] == pytest.approx(stress * area, rel=1e-10)
    assert last["a_m2"] == pytest.approx(area / 0.8, rel=1e-10)
    assert last["p_Pa"] == pytest.approx(-stress * 0.8, rel=1e-10)
    assert abs(last["g_m"]) < 1e-12 * L
    assert run.summary["inertia"] == 0
    assert run.summary["unknowns_by_field"]["contact bottom"] > 0
    for point in run.problem.forms.contacts[0].points.values().pushed.ravel():
        assert point * run.problem.scales.stress == pytest.approx(-stress, rel=1e-10)


# ----------------------------------------------------------------------- closing and opening

ROUND = dea.Cylinder((2 * L, 4 * L), None, 2.8 * L)


def dented(shape=ROUND, way=(0.0, -0.3 * L), comm=MPI.COMM_SELF, **more):
    """A bonded layer, L thick, under a cylinder that begins 0.2 L above it."""
    return dea.Scene(
        strip(comm=comm), {"film": RUBBER}, kinematics=dea.PlaneStrain(1e-2),
        supports=[
            dea.Clamp("bottom"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x"),
            dea.Obstacle("top", shape, displacement=way, **more),
        ],
    )  # fmt: skip


DENT = {
    "f": dea.ContactForce("top", "y"), "side": dea.ContactForce("top", "x"),
    "e": dea.Energy("elastic"), "c": dea.Energy("contact"), "r": dea.Reaction("bottom", "y"),
}  # fmt: skip


def run_of(scene, path=None, **more):
    path = path or dea.Ramp("obstacle", steps=3)
    return dea.solve(scene, path, DENT, **{"quiet": True, "options": TIGHT} | more)


def test_closing_and_opening():
    """The work of the obstacle is what is stored, nearly all in the rubber, and it comes back."""
    at = [0.3, 0.5, 0.799, 0.8, 0.801]
    there = run_of(dented(), [dea.Ramp("obstacle", at=at), dea.Ramp("obstacle", to=0, at=at)])
    names = "obstacle_factor", "f_N", "e_J", "c_J"
    factor, force, elastic, at_points = (np.array(there.history[name]) for name in names)
    energy = elastic + at_points
    # Eight facets are a coarse mesh for this dent.
    assert at_points.max() < 5e-3 * elastic.max()
    top = int(np.argmax(factor))
    for value in at:
        down, up = np.flatnonzero(np.isclose(factor, value, rtol=0, atol=1e-12))
        assert down < top < up
        assert force[up] == pytest.approx(force[down], rel=1e-9, abs=1e-15)
        assert energy[up] == pytest.approx(energy[down], rel=1e-9, abs=1e-14 * energy[top])
    near = [int(np.flatnonzero(np.isclose(factor, v, rtol=0, atol=1e-12))[0]) for v in at[-3:]]
    f, e = force[near], energy[near]
    work = -(f[0] + 4 * f[1] + f[2]) / 6 * 0.002 * 0.3 * L  # Simpson's rule
    assert e[2] - e[0] == pytest.approx(work, rel=1e-6)
    assert force[0] == force[-1] == 0
    assert energy[-1] < 1e-14 * energy.max()
    assert np.allclose(there.history["side_N"], 0, atol=1e-9 * np.abs(force).max())
    assert np.allclose(there.history["r_N"], -force, rtol=1e-8, atol=1e-12)


def test_any_way_of_closing():
    """One step or many, a shape or a function, moved from afar or there at the start."""
    right = run_of(dented(), dea.Ramp("obstacle", steps=12)).history[-1]
    ways = {
        "one step": run_of(dented(), dea.Ramp("obstacle", steps=1)),
        "a function": run_of(dented(
            lambda x: ufl.sqrt((x[0] - 2 * L) ** 2 + (x[1] - 4 * L) ** 2) - 2.8 * L)),
        "pushed out": run_of(dented(dea.Cylinder((2 * L, 3.7 * L), None, 2.8 * L), (0.0, 0.0))),
    }  # fmt: skip
    for run in ways.values():
        last = run.history[-1]
        assert last["f_N"] == pytest.approx(right["f_N"], rel=1e-9)
        assert last["e_J"] == pytest.approx(right["e_J"], rel=1e-9)
    pushed = ways["pushed out"].history[0]
    assert pushed["f_N"] == pytest.approx(right["f_N"], rel=1e-9)


def test_the_tolerance_bounds_the_gap():
    """A smaller tolerance leaves a smaller gap at single points, and hardly another force."""
    found = {}
    for tolerance in (1e-5, 3e-6, 1e-6):
        scene = dented(tolerance=tolerance)
        run = dea.solve(scene, dea.Ramp("obstacle", steps=3), {
            "f": dea.ContactForce("top", "y"), "g": dea.ContactGap("top"),
        }, quiet=True)  # fmt: skip
        found[tolerance] = run.history[-1]
        assert -tolerance < found[tolerance]["g_m"] < 0
    forces = [row["f_N"] for row in found.values()]
    assert forces == pytest.approx([forces[-1]] * 3, rel=0.01)


def test_a_gap_that_is_not_closed(monkeypatch):
    """With a stiffness that is too small for its tolerance no step with contact is accepted."""
    monkeypatch.setattr(contact, "MODULI_AT_TOLERANCE", 1e-3)
    with pytest.raises(dea.SolverError, match=r"a pressed point of 'top' is .* m away"):
        run_of(dented(tolerance=3e-6))


def test_a_stiff_foil_that_bends_around_a_cylinder():
    """Its material is stiff and its bending is not; the steps do not get short after contact."""
    layers = [Layer("foil", 25e-6), Layer("film", 100e-6)]
    film = dea.Material(dea.NeoHookean(2e5), dea.IdealDielectric(2.8))
    told = dea.Scene(
        dea.read_gmsh(BoxStack(30e-3, None, layers, divisions=15), MPI.COMM_SELF),
        {"film": film, "foil": dea.Material(dea.NeoHookean(7e8))},
        electrodes=[dea.Electrode("top", 3e3), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min"),
                  dea.Obstacle("bottom", dea.Cylinder((20e-3, -8e-3), None, 6e-3))],
        kinematics=dea.PlaneStrain(10e-3),
    )  # fmt: skip
    record = {"f": dea.ContactForce("bottom", "y"), "g": dea.ContactGap("bottom")}
    few, many = (
        dea.solve(told, dea.Ramp("voltage", steps=n), record, quiet=True) for n in (3, 6)
    )
    assert len(few.history) < 25
    assert few["f_N"] > 0 and abs(few["g_m"]) < 1e-5
    assert few["f_N"] == pytest.approx(many["f_N"], rel=1e-6)


def test_along_an_arc():
    """A trace goes through contact to the state of a ramp."""
    wanted = run_of(dented()).history[-1]
    trace = dea.Trace("obstacle", first=0.2, steps=40, until=("obstacle_factor", 1.0))
    run = run_of(dented(), trace)
    assert run.history[-1]["obstacle_factor"] == pytest.approx(1, abs=1e-6)
    assert run.history[-1]["f_N"] == pytest.approx(wanted["f_N"], rel=1e-5)
    assert run.summary["inertia"] == 0


# ------------------------------------------------------------------------------ what is refused

REFUSED = {
    "no facet group": dict(where="tp"),
    "deep in it; move the obstacle away, or turn": dict(
        shape=dea.Plane((0, 0.9 * L), (0, 1)), where="top"),
    "lies inside the device, which holds": dict(shape=dea.Cylinder((0.6 * L, 0.4 * L), None, 1e-6)),
    "is not on 'top'": dict(shape=dea.Cylinder((2 * L, 0.5 * L), None, 0.2 * L)),
    "take a Cylinder": dict(shape=dea.Sphere((0, 2 * L), L)),
    "must be given by 2": dict(shape=dea.Plane((0, 0, 0), (0, 0, 1))),
    "3 and 2 components": dict(shape=dea.Plane((0, 0, 0), (0, 1))),
    "must have a direction": dict(shape=dea.Plane((0, 2 * L), (0, 0))),
    "a length > 0 in m": dict(shape=dea.Cylinder((0, 3 * L), None, 0.0)),
    "is that of the third direction": dict(shape=dea.Cylinder((0, 3 * L), (1, 0, 0), L)),
    "must have 2: one for each": dict(displacement=(0, 0, 1e-4)),
    "tolerance of the obstacle": dict(tolerance=-1e-6),
    "rounding allows no less than": dict(tolerance=1e-9),
    "an empty name": dict(displacement=(0, 1e-4), ramp=""),
    "must return one number": dict(shape=lambda x: x),
    "fails for a UFL vector": dict(shape=lambda x: x[2]),
    "a number that is not finite": dict(shape=lambda x: x[1] - float("nan")),
    "the same at all places": dict(shape=lambda x: 1.0),
    "shape of the obstacle at 'top' is 3": dict(shape=3),
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_refused(words):
    given = dict(where="top", shape=ROUND) | REFUSED[words]
    with pytest.raises(dea.InputError, match=words) as told:
        scene = dea.Scene(
            strip(), {"film": RUBBER}, kinematics=dea.PlaneStrain(1e-2),
            supports=[dea.Clamp("bottom"), dea.Obstacle(**given)],
            loads=[dea.DeadLoad("x_max", (1.0, 0.0))],
        )  # fmt: skip
        dea.solve(scene, dea.Ramp("load", steps=1), {}, quiet=True)
    assert str(told.value).count(".\n") == 0


def test_no_free_body_and_no_inner_surface():
    stack = BoxStack(L, None, [Layer("a", L), Layer("b", L)], (1,))
    device = dea.read_gmsh(stack, MPI.COMM_SELF)
    outer = {"x_min", "x_max", "bottom", "top"}
    inner = next(name for name in device.surfaces if name not in outer)
    for item, words in ((dea.FreeBody(), "do not go together"),
                        (dea.Obstacle(inner, ROUND), "lies inside the device; name")):  # fmt: skip
        with pytest.raises(dea.InputError, match=words):
            dea.Scene(device, {"a": RUBBER, "b": RUBBER}, kinematics=dea.PlaneStrain(),
                      supports=[dea.Obstacle("top", ROUND), item])  # fmt: skip


def test_observables_need_an_obstacle():
    with pytest.raises(dea.InputError, match="There is no obstacle at 'bottom'"):
        force = dea.ContactForce("bottom", "y")
        dea.solve(dented(), dea.Ramp("obstacle"), {"f": force}, quiet=True)


# ---------------------------------------------------------------------------- ranks and resuming

WHOLE = dea.Ramp("obstacle", steps=4)


def _dent(comm):
    row = run_of(dented(comm=comm)).history[-1]
    return [row["f_N"], row["e_J"]]


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_any_number_of_ranks(ranks, on_ranks):
    assert on_ranks("test_obstacles", "_dent", ranks) == pytest.approx(
        _dent(MPI.COMM_SELF), rel=1e-8
    )


def test_resuming(tmp_path):
    """A run that was stopped under contact goes on to the same end."""

    def record(calls):
        return DENT | {"stop": StopAtState(calls)}

    wanted = run_of(dented(), WHOLE).history[-1]
    with pytest.raises(dea.Interrupted):
        dea.solve(dented(), WHOLE, record(5), tmp_path, quiet=True, options=TIGHT)
    assert len(dea.read_history(tmp_path)["step"]) == 4
    again = dea.solve(dented(), WHOLE, record(-1), tmp_path, resume=True, quiet=True, options=TIGHT)
    assert again.history[-1]["f_N"] == pytest.approx(wanted["f_N"], rel=1e-9)


def test_the_pressure_is_a_field():
    """In a homogeneous block it is minus the true stress in each cell at the plane, 0 elsewhere."""
    device, kinematics, supports, shape, way, *_ = PATCHES["plane strain"]
    obstacle = dea.Obstacle("bottom", shape, displacement=way)
    scene = dea.Scene(
        device(), {"film": RUBBER}, kinematics=kinematics, supports=[*supports, obstacle]
    )
    run = dea.solve(scene, dea.Ramp("obstacle", steps=1), {}, quiet=True, options=TIGHT)
    writer = FieldWriter(run.problem)
    low = writer.grid.points[writer.grid.cells][..., 1].min(axis=1) < 1e-9
    pressure = writer.cell_fields()["contact_pressure_Pa"]
    assert pressure[low] == pytest.approx(-nominal(0.8, "plane") * 0.8, rel=1e-9)
    assert low.any() and not pressure[~low].any()


def test_a_plane_between_parts():
    """Without `between`, the part of the device behind the plane is refused; with it, it is not.

    The far end of a strip that is pushed sideways comes to rest at the plane.
    """

    def scene(**more):
        return dea.Scene(
            strip(), {"film": RUBBER}, kinematics=dea.PlaneStrain(),
            supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y"),
                      dea.Obstacle("x_max", dea.Plane((3.8 * L, 0.0), (1.0, 0.0), **more))],
            loads=[dea.DeadLoad("x_max", (-MU, 0.0))],
        )  # fmt: skip

    with pytest.raises(dea.InputError, match="lies inside the device"):
        dea.solve(scene(), dea.Ramp("load"), quiet=True)
    run = dea.solve(scene(between=True), dea.Ramp("load", steps=2), {
        "x": dea.MeanDisplacement("x_max", "x"), "f": dea.ContactForce("x_max", "x"),
    }, quiet=True, options=TIGHT)  # fmt: skip
    assert run["x_m"] == pytest.approx(-0.2 * L, rel=1e-10)
    carried = MU * L + nominal(0.95, "plane") * L
    assert run["f_N"] == pytest.approx(carried, rel=1e-9)


def test_landing():
    """A plate that closes on a plane takes hardly more Newton iterations than a free one.

    The first plane is met in the first step, the second one in the middle of a later step.
    """
    geometry = BoxStack(8 * L, 4 * L, [Layer("film", L / 2)], divisions=(8, 4))
    plate = dea.read_gmsh(geometry, MPI.COMM_SELF)
    ends = [dea.Clamp("x_min"), dea.Clamp("x_max")]

    def run(*more):
        return dea.solve(
            dea.Scene(plate, {"film": RUBBER}, supports=[*ends, *more],
                      loads=[dea.FollowerPressure("top", 2e3)]),
            dea.Ramp(steps=8), {"gap": dea.LargestDisplacement("bottom", "z")}, quiet=True,
        )  # fmt: skip

    free = run()
    assert free["gap_m"] < -0.8 * L
    for gap in (0.4 * L, 0.7 * L):
        closed = run(dea.Obstacle("bottom", dea.Plane((0, 0, -gap), (0, 0, 1))))
        assert closed["gap_m"] == pytest.approx(-gap, rel=1e-2)
        counts = [one.summary["newton_iterations"] for one in (free, closed)]
        assert counts[1] <= 1.3 * counts[0]
