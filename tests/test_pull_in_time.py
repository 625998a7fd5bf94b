"""The instant of a pull-in by creep, against the film's ordinary differential equation."""

import math

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, march
from dea_fenicsx.model.viscous_history import Rule, ViscousHistory, combined
from dea_fenicsx.path.step_lengths import estimate
from dea_fenicsx.support.errors import EquilibriumLost, InputError

G, SIDE, FIELD = 15.36e3, 1e-3, 1.2
VHB = dea.Material(
    dea.ArrudaBoyce(G, 5.99, form="pade"), dea.IdealDielectric(4.8),
    viscous=[dea.Maxwell(26.06e3, 0.6074), dea.Maxwell(26.53e3, 6.56), dea.Maxwell(10.83e3, 61.25)],
)  # fmt: skip
UNIT = SIDE * math.sqrt(G / (4.8 * 8.8541878188e-12))
"""Voltage in V of the nominal field 1, in units of sqrt(G/eps)."""


@pytest.fixture(scope="module")
def exact():
    """Field 1.2 from t = 0; the reference gives 6.4930 s and the stretch 1.456628."""
    course = march(Film(VHB, SIDE), 100.0, voltage=FIELD * UNIT)
    assert course.pull_in_time == pytest.approx(6.4930, abs=5e-5)
    assert course.pull_in_stretch == pytest.approx(1.456628, abs=5e-7)
    return course


def film(cells):
    """The free film, in space or as a disc, on cells whose inner nodes are moved at random."""
    device = block(cells, order=1)
    solid, x = device.dim == 3, device.mesh.geometry.x[:, : device.dim]
    inside = (x > x.min(axis=0) + 1e-9) & (x < x.max(axis=0) - 1e-9)
    x[:] += np.where(inside, np.random.default_rng(1).uniform(-0.1, 0.1, x.shape), 0.0)
    return dea.Scene(
        device, {"film": VHB}, [dea.Electrode("top", UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "x" if solid else "r")]
        + [dea.Fix("y_min", "y")] * solid,
        kinematics=dea.ThreeD() if solid else dea.Axisymmetric(),
    )  # fmt: skip


@pytest.mark.parametrize("cells", [(1, 1), (3, 2), (2, 1, 1)])
def test_creep_pulls_in_at_the_exact_time(exact, cells):
    """Time to 1e-6 and stretch to 1e-5; the march lasts far beyond, which must not matter."""
    path = dea.March(6e5, {"voltage": FIELD}, tolerance=1e-8, order=3)
    with pytest.raises(EquilibriumLost) as lost:
        dea.solve(
            film(cells), path, {"thickness": dea.MeanStretch(("bottom", "top"), "z")},
            quiet=True, stability="never", options=dea.NewtonOptions(tolerance=1e-12),
        )  # fmt: skip
    run = lost.value.run
    assert run["time_s"] == pytest.approx(exact.pull_in_time, rel=1e-6)
    assert run["thickness"] ** -0.5 == pytest.approx(exact.pull_in_stretch, rel=1e-5)
    assert len(run.history) < 450
    time = run.column("time_s")
    here = (time > 0) & (time <= 0.9 * exact.pull_in_time)
    stretch = run.column("thickness")[here] ** -0.5
    assert stretch == pytest.approx(exact.stretch(time[here]), rel=2e-7)


def test_bdf3_is_exact_for_a_cubic_and_its_estimate_for_the_fourth_power():
    times = (1.0, 0.9, 0.75, 0.7, 0.4)
    end, span = times[0], times[0] - times[1]

    def tensors(value):
        return np.array([value, value, value, 0.0, 0.0, 0.0])

    def missed(power):
        """y(1) - [H + h y'(1)] of BDF3 for y = 1 + t^power, and h over the step."""
        history = ViscousHistory(
            tuple(tensors(1 + t**power) for t in times[1:]), times[1:], span, Rule.BDF3
        )
        shares = combined(ViscousHistory((tensors(1.0),) * 3, times[1:4], span, Rule.BDF3))[0]
        return (1 + end**power) - (combined(history)[0] + span * power * end**power) / shares

    for power in (1, 2, 3):
        assert missed(power) == pytest.approx(0.0, abs=1e-13)
    values = [np.array(1 + t**4) for t in times]
    values[0] = values[0] - missed(4)  # what the rule finds
    assert float(estimate(times, values, 3)) == pytest.approx(-missed(4), rel=1e-9)


@pytest.mark.parametrize("more", [{"steps": 10}, {"inertia": True}])
def test_order_3_is_for_adapted_steps_without_inertia(more):
    with pytest.raises(InputError, match="order=3"):
        dea.solve(film((1, 1)), dea.March(1.0, {"voltage": 0.1}, order=3, **more), quiet=True)
