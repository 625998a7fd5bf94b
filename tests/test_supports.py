"""Supports: free bodies, displacements that contradict each other, impossible volumes."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from test_input import one_sentence
from test_rigid import PLANE, ROUND, SPACE, check

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run import journal

pytestmark = pytest.mark.usefixtures("quick_compile")
RUBBER = dea.Material(dea.NeoHookean(5e4))
HARD = dea.Material(dea.NeoHookean(2e5))
FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
SLICE = dea.GeneralisedPlaneStrain(1e-3)
Fix, Clamp, Stretch, Move, Dead = dea.Fix, dea.Clamp, dea.Stretch, dea.Displacement, dea.DeadLoad


def scene(device, kinematics=PLANE, **given):
    materials = {"film": RUBBER, "soft": RUBBER, "hard": HARD, "active": FILM}
    return dea.Scene(
        device, {name: materials[name] for name in device.regions}, kinematics=kinematics, **given
    )


def stack(length, layers=("film",), width=None, cells=4, comm=MPI.COMM_SELF, **more):
    """A box of layers of half a millimetre."""
    parts = [Layer(name, 0.5e-3) for name in layers]
    divisions = (cells,) if width is None else (cells, 1)
    return dea.read_gmsh(BoxStack(length, width, parts, divisions=divisions, **more), comm)


# --------------------------------------------------------- what a free body keeps and what it bears


@pytest.mark.parametrize("kinematics, fixes, count", [
    (SPACE, [], 6),
    (SPACE, [("x_min", "x")], 3),
    (SPACE, [("x_min", "x"), ("y_min", "y")], 1),
    (SPACE, [("x_min", "x"), ("y_min", "y"), ("bottom", "z")], 0),
    (SPACE, [("x_min", "yz")], 3),
    (PLANE, [], 3),
    (PLANE, [("x_min", "x")], 1),
    (PLANE, [("x_min", "y")], 2),
    (SLICE, [], 3),
    (ROUND, [], 1),
    (ROUND, [("x_max", "r")], 1),
    (ROUND, [("bottom", "z")], 0),
])  # fmt: skip
def test_as_much_is_held_as_can_move(kinematics, fixes, count):
    device = block((2, 2, 2)[: kinematics.dim])
    supports = [Fix(where, axes) for where, axes in fixes]
    alone = 0
    if len(fixes) and count:
        with pytest.raises(dea.InputError, match="freely"):
            check(device, supports, kinematics)
    _, constraints, pins = check(device, [*supports, dea.FreeBody()], kinematics)
    assert len(pins) == count
    alone = np.count_nonzero(constraints.fixed)
    _, twice, _ = check(device, [dea.FreeBody(), *supports, dea.FreeBody()], kinematics)
    assert np.count_nonzero(twice.fixed) == alone


def bender(kinematics, length, supports, cells, comm=MPI.COMM_SELF, width=1e-3):
    device = stack(length, ("film", "active"), width if kinematics.dim == 3 else None, cells, comm)
    electrodes = [dea.Electrode("top", 5e3), dea.Ground("interface_1")]
    axis = "y" if kinematics.dim == 3 else "z"
    run = dea.solve(
        scene(device, kinematics, electrodes=electrodes, supports=supports), dea.Ramp(steps=2),
        {"a": dea.Rotation("x_min", axis), "b": dea.Rotation("x_max", axis)}, quiet=True,
    )  # fmt: skip
    return run["b_rad"] - run["a_rad"], run.problem


def held_forces(problem):
    """The largest reaction of a pin, over the largest nodal force of the pressure and the field."""
    residual = problem.residual()
    held = [problem.displacement[p.axis].dofs[problem.displacement[p.axis].on(0, p.vertices)]
            for p in problem.conditions.body.pins]  # fmt: skip
    keep = problem.state
    is_pressure = np.isin(np.arange(problem.size), problem.pressure.dofs)
    problem.commit(keep.with_values(np.where(is_pressure, 0.0, keep.values)))
    size = np.max(np.abs(problem.residual()))
    problem.commit(keep)
    return np.max(np.abs(residual[np.concatenate(held)])) / size


@pytest.mark.parametrize("kinematics, width", [
    (PLANE, 0), (SLICE, 0), (SPACE, 1e-3), (SPACE, 0.4e-3)
])  # fmt: skip
def test_half_a_bender_is_half_of_the_whole(kinematics, width):
    """By symmetry; in space also where it is thicker than wide.  Nothing is borne by the pins."""
    full, whole = bender(kinematics, 4e-3, [dea.FreeBody()], 4, width=width)
    half, part = bender(kinematics, 2e-3, [Fix("x_min", "x"), dea.FreeBody()], 2, width=width)
    assert abs(full) > 0.05
    assert half == pytest.approx(full / 2, abs=1e-9)
    assert held_forces(whole) < 1e-9
    assert held_forces(part) < 1e-9


def test_a_free_disc_is_one_that_stands():
    """A film between electrodes: V = T sqrt(mu/eps) sqrt(lam^2 - lam^-4)/lam^2."""
    run = dea.solve(
        scene(stack(2e-3, ("active",), cells=2), dea.Axisymmetric(), supports=[dea.FreeBody()],
              electrodes=[dea.Electrode("top", 12e3), dea.Ground("bottom")]),
        dea.Ramp(steps=3), {"h": dea.MeanStretch(("bottom", "top"), "z")}, quiet=True,
    )  # fmt: skip
    lam = run["h"] ** -0.5
    volts = 0.5e-3 * np.sqrt(5e4 / (3 * 8.8541878128e-12) * (lam**2 - lam**-4)) / lam**2
    assert lam > 1.02
    assert volts == pytest.approx(12e3, rel=1e-9)
    assert held_forces(run.problem) < 1e-9


# ------------------------------------------------------------------------- loads on a free body

UP = (Dead("top", (0.0, 1e3)), [Fix("x_min", "x"), dea.FreeBody()], "resultant force of 1e-06 N")


@pytest.mark.parametrize("kinematics, loads, supports, words", [
    (SPACE, [Dead("x_max", (2e3, 0, 0))], [], "translation along x free"),
    (SPACE, [Dead("x_max", (0, 1e3, 1e3))], [Fix("x_min", "x")], "(0, 0.71, 0.71) free"),
    (SPACE, [dea.FollowerPressure("top", 1e3)], [], "translation along z free"),
    (SPACE, [Dead("top", (1e3, 0, 0)), Dead("bottom", (-1e3, 0, 0))], [Fix("x_min", "yz")],
     "resultant moment that nothing bears"),
    (PLANE, [Dead("top", (0, 1e3))], [Fix("x_min", "x")], "resultant force of 1e-06 N"),
    (PLANE, [dea.DeadPressure("top", 1e3)], [], "translation along y free"),
    (PLANE, [Dead("x_max", (1e3, 0), ramp="a"), Dead("x_min", (-1e3, 0), ramp="b")], [],
     "ramp 'a'"),
    (SLICE, [Dead("x_max", (1e3, 0))], [], "translation along x free"),
    (ROUND, [dea.DeadPressure("top", 1e3)], [], "translation along z free"),
])  # fmt: skip
def test_a_resultant_that_nothing_bears_is_refused(kinematics, loads, supports, words):
    plane = dea.PlaneStrain(1e-6) if kinematics is PLANE else kinematics
    device = block((2, 2, 1)[: kinematics.dim])
    with pytest.raises(dea.InputError) as caught:
        Problem(scene(device, plane, loads=loads, supports=[*supports, dea.FreeBody()]))
    assert words in str(caught.value)
    one_sentence(str(caught.value))


@pytest.mark.parametrize("kinematics, loads, supports", [
    (ROUND, [dea.DeadPressure("top", 1e3), dea.DeadPressure("bottom", 1e3)], []),
    (PLANE, [Dead("x_max", (1e3, 0))], [Fix("x_min", "x")]),
    (PLANE, [dea.FollowerPressure(s, 1e3) for s in ("x_min", "x_max", "bottom", "top")], []),
])  # fmt: skip
def test_what_is_balanced_or_borne_is_not(kinematics, loads, supports):
    device = block((2, 2, 1)[: kinematics.dim])
    Problem(scene(device, kinematics, loads=loads, supports=[*supports, dea.FreeBody()]))


def pulled(kinematics, pascal, layers=("film",), length=2e-3, half=False, comm=MPI.COMM_SELF,
           path=None, **more):  # fmt: skip
    """A free strip under dead loads on its ends: its ends' distance over its length, rotation."""
    width = 0.5e-3 if kinematics.dim == 3 else None
    device = stack(length, layers, width, 1 if half else 2, comm)
    loads = [Dead("x_max", tuple(pascal))]
    supports = [Fix("x_min", "x"), dea.FreeBody()] if half else [dea.FreeBody()]
    if not half:
        loads.append(Dead("x_min", tuple(-p for p in pascal)))
    axes = kinematics.axes
    record = {f"{end}{a}": dea.MeanDisplacement(f"x_{end}", a) for end in ("min", "max")
              for a in axes}  # fmt: skip
    record["turn"] = dea.Rotation("x_max", "z" if len(axes) == 2 else "y")
    run = dea.solve(scene(device, kinematics, loads=loads, supports=supports),
                    path or dea.Ramp(steps=2), record, quiet=True, **more)  # fmt: skip
    ends = np.array([run[f"max{a}_m"] - run[f"min{a}_m"] for a in axes])
    ends[0] += length
    return ends / length, run["turn_rad"], run


@pytest.mark.parametrize("kinematics", [PLANE, SLICE, SPACE])
def test_dead_loads_turn_a_free_body(kinematics):
    """A couple, or forces aslant: the body turns into them and stretches as if pulled along."""
    along, none, _ = pulled(kinematics, (3e4, 0, 0)[: kinematics.dim])
    assert along[0] > 1.15 and none == pytest.approx(0, abs=1e-9)
    flat = ((0, 1, 0), (-0.8, 0.6, 0))
    for direction in flat if kinematics is PLANE else ((0.48, 0.6, 0.64),):
        unit = np.array(direction)[: kinematics.dim] / np.linalg.norm(direction[: kinematics.dim])
        ends, _, run = pulled(kinematics, 3e4 * unit)
        assert ends == pytest.approx(along[0] * unit, abs=1e-9)
        assert held_forces(run.problem) < 1e-9


@pytest.mark.parametrize("kinematics", [PLANE, SPACE])
def test_an_uneven_strip_lies_in_the_line_of_its_loads(kinematics):
    """Two layers, pulled: each half bends away, and the ends stay in line.  Half of it by symmetry.

    Held in its first orientation at one end, the strip would bear a moment there.
    """
    pascal = (3e4, 0, 0)[: kinematics.dim]
    ends, turn, run = pulled(kinematics, pascal, ("soft", "hard"))
    part, half, _ = pulled(kinematics, pascal, ("soft", "hard"), 1e-3, half=True)
    assert ends[1:] == pytest.approx(np.zeros(kinematics.dim - 1), abs=1e-9)
    assert abs(half) > 0.05
    assert turn == pytest.approx(half, abs=1e-9)
    assert ends[0] == pytest.approx(part[0], abs=1e-9)
    assert held_forces(run.problem) < 1e-9


def test_a_turned_body_comes_back_unstrained():
    """After the loads have gone it stays as it lies; a trace turns it as a ramp does."""
    there = [dea.Ramp("load", steps=2), dea.Ramp("load", to=0.0, steps=2)]
    ends, _, run = pulled(PLANE, (0.0, 3e4), path=there)
    assert ends == pytest.approx([0, 1], abs=1e-9)
    traced, _, run = pulled(PLANE, (0.0, 3e4), path=dea.Trace("load", first=0.3, steps=3))
    factor = run.history[-1]["load_factor"]
    assert traced == pytest.approx(
        pulled(PLANE, (3e4 * factor, 0.0))[0][::-1], abs=1e-8
    )


def test_a_run_is_resumed_after_a_turn(tmp_path, monkeypatch):
    """It ends where no load acts any more, and the body lies as it has been turned."""
    path = [dea.Ramp("load", steps=1), dea.Ramp("load", to=0.0, steps=1),
            dea.Ramp("load", to=0.5, steps=1)]  # fmt: skip
    whole, _, _ = pulled(PLANE, (0.0, 3e4), path=path)

    check = journal.check_step

    def broken(solver, step, *others):
        if step == 3:
            raise dea.SolverError("the power is off")
        return check(solver, step, *others)

    with monkeypatch.context() as patch, pytest.raises(dea.SolverError):
        patch.setattr(journal, "check_step", broken)
        pulled(PLANE, (0.0, 3e4), path=path, out=tmp_path)
    ends, _, run = pulled(PLANE, (0.0, 3e4), path=path, out=tmp_path, resume=True)
    assert [row["step"] for row in run.history] == [0, 1, 2, 3]
    assert ends == pytest.approx(whole, abs=1e-9)


# ----------------------------------------------------------------------- do displacements agree?

CONFLICTS = {
    "clamped and moved": (
        [Clamp("x_min"), Clamp("x_max")], [Move("x_max", "x", 1e-4)], ("'x_max'", "along x")),
    "two ramps": (
        [Clamp("x_min")], [Move("x_max", "x", 1e-4, ramp="a"), Move("x_max", "x", 3e-4, ramp="b")],
        ("'x_max'", "ramp 'a'", "ramp 'b'")),
    "same value, two ramps": (
        [Clamp("x_min")], [Move("x_max", "x", 1e-4, ramp="a"), Move("x_max", "x", 1e-4, ramp="b")],
        ("'x_max'",)),
    "two values": (
        [Clamp("x_min")], [Move("x_max", "y", 1e-4), Move("x_max", "y", 2e-4)], ("along y",)),
    "stretched and moved": (
        [Fix("x_min", "xy")], [Stretch("x_max", "x", 1.2), Move("x_max", "x", 1e-4)],
        ("'x_max'",)),
    "fixed and moved": (
        [Clamp("x_min"), Fix("x_max", "x")], [Move("x_max", "x", 1e-9)], ("Fix on", "along x")),
    "an edge in common": (
        [Clamp("x_min")], [Move("top", "y", 1e-4)], ("'x_min'", "'top'", "along y")),
    "stretches of two ratios": (
        [Fix("x_min", "x"), Fix("bottom", "y")],
        [Stretch("x_max", "xy", 1.2), Stretch("top", "y", 1.3)], ("'x_max'", "'top'", "along y")),
}  # fmt: skip


@pytest.mark.parametrize("case", CONFLICTS)
@pytest.mark.parametrize("kinematics", [PLANE, SPACE])
def test_contradictions_are_refused(case, kinematics):
    supports, prescribed, words = CONFLICTS[case]
    if kinematics is SPACE:
        # "top" lies across z in space
        prescribed = [
            Move(p.where, p.axes.replace("y", "z"), p.metres, p.ramp) if isinstance(p, Move) else
            Stretch(p.where, p.axes.replace("y", "z"), p.stretch) for p in prescribed
        ]  # fmt: skip
        supports = [Fix(s.where, s.axes.replace("y", "z")) if isinstance(s, Fix) else s
                    for s in supports]  # fmt: skip
        words = tuple(w.replace("along y", "along z") for w in words)
    with pytest.raises(dea.InputError) as caught:
        check(block((2, 2, 2)[: kinematics.dim]), supports, kinematics, prescribed)
    for word in words:
        assert word in str(caught.value)
    one_sentence(str(caught.value))


@pytest.mark.parametrize("kinematics", [ROUND, SLICE])
def test_contradictions_in_other_sections(kinematics):
    a, b = kinematics.axes[0], kinematics.axes[-1]
    with pytest.raises(dea.InputError, match=f"along {b}, the first at"):
        check(block((2, 2)), [Clamp("bottom")], kinematics, [Move("x_max", b, 1e-4)])
    with pytest.raises(dea.InputError, match=f"along {a}, the first at"):
        check(block((2, 2)), [Clamp("x_min"), Fix("bottom", b)], kinematics,
              [Stretch("x_max", a, 1.2), Move("top", a, 1e-4)])  # fmt: skip


AGREEING = {
    "zero by ramp and by support": ([Clamp("x_min")], [Move("x_min", "x", 0.0)]),
    "twice the same": ([Clamp("x_min")], [Move("x_max", "x", 1e-4), Move("x_max", "x", 1e-4)]),
    "stretches that share an edge": (
        [Fix("x_min", "x"), Fix("bottom", "y")], [Stretch("x_max", "xy", 1.3),
                                                  Stretch("top", "xy", 1.3)]),
    "held at the origin, stretched beside it": (
        [Clamp("x_min")], [Stretch("x_max", "x", 1.3), Stretch("top", "x", 1.3)]),
}  # fmt: skip


@pytest.mark.parametrize("case", AGREEING)
def test_what_agrees_is_accepted(case):
    supports, prescribed = AGREEING[case]
    check(block((2, 2)), supports, PLANE, prescribed)


# ---------------------------------------------------------------------- what a stretch is about


def far(comm=MPI.COMM_SELF):
    """A strip of 1 mm that begins at x = 5 mm."""
    return stack(1e-3, cells=2, comm=comm, x0=5e-3)


@pytest.mark.parametrize("supports, prescribed, wanted", [
    ([Fix("x_min", "x")], [Stretch("x_max", "x", 1.5)], 1.5),
    ([Fix("x_max", "x")], [Stretch("x_min", "x", 1.5)], 1.5),
    ([Clamp("x_min")], [Stretch("x_max", "x", 1.5)], 1.5),
    ([], [Stretch("x_min", "x", 1.5), Stretch("x_max", "x", 1.5)], 1.5),
    ([Fix("x_min", "x")], [Stretch("x_max", "x", 1.5, about=5.2e-3)], 1.4),
    ([Move("x_min", "x", -1e-4)], [Stretch("x_max", "x", 1.5)], 1.6),
    # the stretched surface is held or moved, too, and both agree
    ([Fix("x_min", "x"), Move("x_max", "x", 5e-4)], [Stretch("x_max", "x", 1.5)], 1.5),
    ([Fix("x_min", "x"), Fix("x_max", "x")], [Stretch("x_max", "x", 1.0)], 1.0),
    ([Fix("x_max", "x")], [Stretch("x_max", "x", 1.0)], 1.0),
])  # fmt: skip
def test_a_stretch_is_about_what_is_held(supports, prescribed, wanted):
    moved = [s for s in supports if isinstance(s, Move)]
    supports = [Fix("bottom", "y"), *(s for s in supports if not isinstance(s, Move))]
    if Clamp("x_min") in supports:
        supports.remove(Fix("bottom", "y"))
    run = dea.solve(
        scene(far(), supports=supports, prescribed=[*moved, *prescribed]),
        dea.Ramp(steps=2), {"l": dea.MeanStretch(("x_min", "x_max"), "x")}, quiet=True,
    )  # fmt: skip
    assert run["l"] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("supports, words", [
    ([Clamp("bottom")], "'bottom' spread over several coordinates x; give Stretch(..., about=...)"),
    ([Clamp("bottom"), Fix("x_max", "x")], "'bottom' spread over several"),
    ([Fix("x_min", "x"), Fix("x_max", "x")], "give the same nodes different displacements"),
    ([Fix("bottom", "y")], "no other surface is held or stretched along x"),
])  # fmt: skip
def test_a_stretch_about_nowhere_is_told(supports, words):
    with pytest.raises(dea.InputError) as caught:
        check(far(), supports, PLANE, [Stretch("x_max", "x", 1.5)])
    assert words in str(caught.value)
    one_sentence(str(caught.value))


def test_each_axis_may_have_its_centre():
    parts, constraints, _ = check(
        block((1, 1)), [Fix("x_min", "x"), Fix("bottom", "y")], PLANE,
        [Stretch("top", "xy", 2.0, about=(0.0, 0.5e-3))],
    )  # fmt: skip
    for axis, centre in ((0, 0.0), (1, 0.5)):
        x = parts[axis].space.tabulate_dof_coordinates()
        top = np.abs(x[:, 1] - 1) < 1e-12
        found = constraints.base["stretch"][parts[axis].dofs]
        assert found[top] == pytest.approx(x[top, axis] - centre, abs=1e-12)


# --------------------------------------------------------------------------- impossible volumes

CHAMBERS = {
    "plane": (PLANE, [Fix("x_min", "x"), Fix("bottom", "y")],
              [Stretch("x_max", "x", 1.5), Stretch("top", "y", 1.5)], "2.25 times"),
    "only half-way": (PLANE, [Fix("x_min", "x"), Fix("bottom", "y")],
                      [Stretch("x_max", "x", 2.0), Stretch("top", "y", 0.5)], "1.125 times"),
    "slice": (SLICE, [Fix(s, a) for s, a in (("x_min", "x"), ("x_max", "x"), ("bottom", "y"),
                                             ("top", "y"))], [dea.AxialStretch(1.2)], "1.2 times"),
    "round": (ROUND, [Fix("bottom", "z")],
              [Stretch("x_max", "r", 1.5), Stretch("top", "z", 1.5)], "3.375 times"),
    "space": (SPACE, [Fix("x_min", "x"), Fix("y_min", "y"), Fix("bottom", "z")],
              [Stretch("x_max", "x", 1.5), Stretch("y_max", "y", 1.5), Move("top", "z", 1e-3)],
              "4.5 times"),
}  # fmt: skip


def chamber(case, comm=MPI.COMM_SELF):
    """What is told of a scene whose walls are all prescribed."""
    kinematics, supports, prescribed, _ = CHAMBERS[case]
    width = 1e-3 if kinematics.dim == 3 else None
    film = [Layer("film", 1e-3, divisions=2)]
    device = dea.read_gmsh(
        BoxStack(1e-3, width, film, divisions=(2, 1)[: kinematics.dim - 1]), comm
    )
    try:
        dea.solve(scene(device, kinematics, supports=supports, prescribed=prescribed),
                  dea.Ramp("stretch", steps=1), quiet=True)  # fmt: skip
    except dea.DeaError as error:
        return f"{type(error).__name__}: {error}"
    return "completed"


@pytest.mark.parametrize("case", CHAMBERS)
def test_an_impossible_volume_is_told(case):
    told = chamber(case)
    assert told.startswith("InputError") and CHAMBERS[case][3] in told
    assert "region film" in told
    one_sentence(told)


@pytest.mark.parametrize("kinematics, prescribed", [
    (PLANE, [Stretch("x_max", "x", 1.5)]),
    (SLICE, [Stretch("x_max", "x", 1.2), Stretch("top", "y", 1.2)]),
])  # fmt: skip
def test_a_volume_that_can_give_way_is_not(kinematics, prescribed):
    run = dea.solve(
        scene(block((2, 2)), kinematics, prescribed=prescribed,
              supports=[Fix("x_min", "x"), Fix("bottom", "y")]),
        dea.Ramp("stretch", steps=1), quiet=True,
    )  # fmt: skip
    assert run.summary["status"] == "completed"


# -------------------------------------------------------------------------------- several ranks


def on_several_ranks(comm):
    """What every rank must find alike; two cells leave ranks empty."""
    told = []
    for make in (
        lambda: check(far(comm), [Clamp("x_min"), Clamp("x_max")], PLANE,
                      [Move("x_max", "x", 1e-4)]),
        lambda: check(far(comm), [Clamp("bottom")], PLANE, [Stretch("x_max", "x", 1.5)]),
        lambda: Problem(scene(far(comm), supports=[dea.FreeBody()],
                              loads=[Dead("x_max", (1e3, 0))])),
    ):  # fmt: skip
        try:
            make()
            told.append("accepted")
        except dea.InputError as error:
            told.append(str(error))
    _, _, held = check(far(comm), [dea.FreeBody()], PLANE)
    pins = [[pin.axis, *np.round(pin.place, 12).tolist()] for pin in held]
    told += [chamber("plane", comm), repr(pins)]
    assert len({tuple(t) for t in comm.allgather(told)}) == 1
    angle, _ = bender(PLANE, 2e-3, [Fix("x_min", "x"), dea.FreeBody()], 2, comm)
    ends, _, _ = pulled(PLANE, (0.0, 3e4), comm=comm)
    return told, [float(angle), *map(float, ends)]


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_the_same_on_several_ranks(on_ranks, ranks):
    told, numbers = on_ranks("test_supports", "on_several_ranks", ranks)
    words, alone = on_several_ranks(MPI.COMM_SELF)
    assert told == words
    assert "accepted" not in told
    assert numbers == pytest.approx(alone, abs=1e-10)
