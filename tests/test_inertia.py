"""Bodies in motion against exact motions, and what they conserve."""

from __future__ import annotations

import numpy as np
import pytest
from motion_scenes import CLAMPED, rubber, sphere, strip
from mpi4py import MPI

import dea_fenicsx as dea

RADIUS = {"a": dea.AtPoint((1.0, 0.0), "displacement", "r")}


def switched_on(seconds, steps, comm=MPI.COMM_SELF, cells=(2, 3), record=RADIUS, **options):
    """The thick sphere under a pressure of 0.05, switched on at rest."""
    march = dea.March(seconds, {"load": 1.0}, steps=steps, inertia=True)
    return dea.solve(sphere(pressure=0.05, cells=cells, comm=comm), march, record, quiet=True,
                     stability="never", **options)  # fmt: skip


def largest(run):
    """The largest radius and its time, by a parabola through three steps."""
    t, a = run.column("time_s"), 1 + run.column("a_m")
    k = int(np.argmax(a))
    c = np.polyfit(t[k - 1 : k + 2] - t[k], a[k - 1 : k + 2], 2)
    return c[2] - c[1] ** 2 / (4 * c[0]), t[k] - c[1] / (2 * c[0])


def test_a_thick_sphere_in_motion():
    """The exact sphere's largest radius and its time, with steps by their estimated error."""
    march = dea.March(1.2, {"load": 1.0}, inertia=dea.Inertia(tolerance=1e-7))
    run = dea.solve(sphere(pressure=0.05, cells=(2, 6)), march, RADIUS, quiet=True)
    radius, time = largest(run)
    assert radius == pytest.approx(1.06723011, rel=2e-5)
    assert time == pytest.approx(1.08398770, rel=1e-4)
    assert run.summary["stable"] is None and run.summary["status"] == "completed"


def test_second_order_in_displacement_velocity_and_pressure():
    record = RADIUS | {
        "p": dea.AtPoint((1.1, 0.0), "pressure"), "energy": dea.KineticEnergy()
    }
    runs = [switched_on(0.8, n, record=record, cells=(1, 2)) for n in (10, 20, 40)]
    for column, least in (("a_m", 3.5), ("p_Pa", 3.3), ("energy_J", 3.5)):
        coarse, middle, fine = (run[column] for run in runs)
        assert least < (coarse - middle) / (middle - fine) < 4.7, column
    # the pressure does not oscillate from step to step
    p = runs[1].column("p_Pa")[1:]
    assert np.abs(np.diff(p, 3)).max() < 0.02 * np.ptp(p)


def test_second_order_after_a_jump_of_the_drive():
    """The pressure falls to half at once in the midst of the march."""
    drive = {"load": dea.Step(0.5, at=0.4, low=1.0)}
    record = RADIUS | {
        "p": dea.AtPoint((1.1, 0.0), "pressure"), "energy": dea.KineticEnergy()
    }
    runs = []
    for steps in (20, 40, 80):
        march = dea.March(0.8, drive, steps=steps, inertia=True)
        scene = sphere(pressure=0.05, cells=(1, 2))
        runs.append(dea.solve(scene, march, record, quiet=True, stability="never"))
    for column in ("a_m", "p_Pa", "energy_J"):
        coarse, middle, fine = (run[column] for run in runs)
        assert 3.3 < (coarse - middle) / (middle - fine) < 4.7, column
    after = runs[1].column("p_Pa")[runs[1].column("time_s") > 0.4 + 1e-9]
    assert np.abs(np.diff(after, 3)).max() < 0.02 * np.ptp(after)


def test_free_flight():
    """A free body that is thrown flies on without strain, at rest or spinning slowly."""
    record = {
        "x": dea.MeanDisplacement("x_max", "x"), "y": dea.MeanDisplacement("x_max", "y"),
        "px": dea.Momentum("x"), "py": dea.Momentum("y"), "energy": dea.KineticEnergy(),
    }  # fmt: skip
    thrown = dea.Inertia(velocity=(0.3, -0.2))
    run = dea.solve(strip(cells=(2, 1), length=4.0), dea.March(2.0, steps=5, inertia=thrown),
                    record, quiet=True)  # fmt: skip
    assert run["x_m"] == pytest.approx(0.6, abs=1e-9) and run["y_m"] == pytest.approx(-0.4)
    mass = 4.0
    assert run["px_Ns"] == pytest.approx(0.3 * mass) and run["py_Ns"] == pytest.approx(-0.2 * mass)
    assert run["energy_J"] == pytest.approx(mass * 0.13 / 2, rel=1e-9)


def test_a_rigid_spin():
    """A square that spins slowly turns by the angle; it is hardly strained."""
    rate = 0.05

    def spin(x):
        return np.stack([-rate * (x[1] - 0.5), rate * (x[0] - 0.5)])

    scene = strip(cells=(1, 1), length=1.0)
    march = dea.March(4.0, steps=40, inertia=dea.Inertia(velocity=spin))
    record = {"x": dea.AtPoint((1.0, 0.5), "displacement", "x"), "px": dea.Momentum("x"),
              "y": dea.AtPoint((1.0, 0.5), "displacement", "y")}  # fmt: skip
    run = dea.solve(scene, march, record, quiet=True)
    assert run["y_m"] == pytest.approx(0.5 * np.sin(0.2), rel=3e-3)
    assert run["x_m"] == pytest.approx(0.5 * (np.cos(0.2) - 1), rel=0.03)
    assert np.abs(run.column("px_Ns")).max() < 1e-9


def test_a_strip_swings_about_its_equilibrium():
    """From a static ramp, a small step of the load: it swings at its first frequency."""
    load = [dea.DeadPressure("top", 1e-4)]
    scene = strip(supports=CLAMPED, loads=load, cells=(4, 1))
    record = {"tip": dea.AtPoint((5.0, 0.0), "displacement", "y")}
    path = [dea.Ramp("load", 1.0, 1), dea.March(60.0, {"load": 0.5}, 120, inertia=True)]
    run = dea.solve(scene, path, record, quiet=True)
    period = 1 / dea.modes(dea.solve(scene, dea.Ramp("load", 0.5, 1), quiet=True), 1).frequencies[0]
    swing, t = run.column("tip_m")[2:], run.column("time_s")[2:]
    ends = t[1:-1][np.diff(np.sign(np.diff(swing))) != 0]
    assert np.mean(np.diff(ends)) == pytest.approx(period / 2, rel=0.03)


def test_drag_brings_it_to_rest():
    """A body at rest is where the static ramp leads, and can go on without inertia."""
    load = [dea.DeadPressure("top", 1e-4)]
    scene = strip(supports=CLAMPED, loads=load, cells=(2, 1))
    record = {"tip": dea.AtPoint((5.0, 0.0), "displacement", "y")}
    drag = dea.Inertia(drag=0.5, spectral_radius=0.0)
    path = [dea.March(400.0, {"load": 1.0}, 60, inertia=drag), dea.Ramp("load", 0.0, 1)]
    run = dea.solve(scene, path, record, quiet=True)
    static = dea.solve(scene, dea.Ramp("load", steps=1), record, quiet=True)
    assert run.column("tip_m")[-2] == pytest.approx(static["tip_m"], rel=1e-6)
    assert run["tip_m"] == pytest.approx(0.0, abs=1e-9)


def test_carried_on_and_started_from(tmp_path):
    """A march that goes on from another run is the march that was never stopped."""
    whole = switched_on(0.4, 8, cells=(1, 2))
    first = switched_on(0.2, 4, cells=(1, 2), out=tmp_path)
    assert first["a_m"] == pytest.approx(whole.column("a_m")[4], rel=1e-9)
    march = dea.March(0.2, {"load": 1.0}, steps=4, inertia=True)
    scene = sphere(pressure=0.05, cells=(1, 2))
    for start in (str(tmp_path), first):
        more = dea.solve(scene, march, RADIUS, quiet=True, start=start)
        assert more["a_m"] == pytest.approx(whole["a_m"], rel=1e-7)
        assert more.column("time_s")[-1] == pytest.approx(0.4)


def test_what_is_refused():
    march = dea.March(1.0, {"voltage": 1.0}, 2, inertia=True)
    light = strip(0.1, CLAMPED, materials={"film": rubber(density=None)})
    with pytest.raises(dea.InputError, match="'film' has no density"):
        dea.solve(light, march, quiet=True)
    scene = strip(0.1, CLAMPED, cells=(2, 1))
    for wrong, words in (
        (dea.Inertia(spectral_radius=1.0), "below 1"), (dea.Inertia(drag=-1.0), "at least 0"),
        (dea.Inertia(tolerance=0.0), "tolerance"), (dea.Inertia(velocity=(1.0,) * 3), "velocity"),
    ):  # fmt: skip
        with pytest.raises(dea.InputError, match=words):
            dea.solve(scene, dea.March(1.0, inertia=wrong), quiet=True)
    free = strip(0.1, cells=(2, 1))
    with pytest.raises(dea.InputError, match="FreeBody"):
        dea.solve(free, [dea.Ramp(), march], quiet=True)
    pushed = strip(supports=CLAMPED[:1], prescribed=[dea.Displacement("x_max", "x", 0.1)],
                   cells=(2, 1))  # fmt: skip
    with pytest.raises(dea.InputError, match="jump"):
        dea.solve(pushed, dea.March(1.0, {"stretch": 1.0}, 2, inertia=True), quiet=True)


def on_some(comm):
    run = switched_on(0.3, 4, comm, cells=(1, 2))
    return list(run.column("a_m"))


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_on_several_ranks(ranks, on_ranks):
    found = on_ranks("test_inertia", "on_some", ranks)
    assert found == pytest.approx(on_some(MPI.COMM_SELF), rel=1e-7, abs=1e-12)
