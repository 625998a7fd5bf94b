"""Other equilibria at one load: the arches of a buckled strip, and the states of a film."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from test_branches import DEFLECTION, EULER, H, strip

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

MU, JM, EPS_R, T = 5e4, 40.0, 3.0, 1e-3


def test_the_arches_and_the_straight_strip():
    """A fifth above Euler's voltage: straight, unstable in one mode, and two stable arches."""
    run = dea.solve(strip(), dea.Ramp("voltage", to=1.2, steps=3), DEFLECTION, quiet=True)
    found = dea.deflate(run, DEFLECTION, most=2)
    assert [one.negative_modes for one in found] == [1, 0, 0]
    assert [one.stable for one in found] == [False, True, True]
    straight, one, other = (e.values["middle_m"] for e in found)
    assert abs(straight) < 1e-6 * H
    assert one == pytest.approx(-other, rel=1e-6) and abs(one) > H / 2
    # the same arch as that of a trace that leaves the straight strip at the bifurcation
    path = dea.Trace("voltage", first=0.5, switch=0.05, until=("voltage_V", 1.3 * EULER), steps=60,
                     at=(1.2,))  # fmt: skip
    traced = dea.solve(strip(), path, DEFLECTION, stability="every", quiet=True)
    arch = next(row["middle_m"] for row in traced.history if row["event"] == "landed")
    assert abs(one) == pytest.approx(abs(arch), rel=1e-6)
    # each is the start of a run
    again = dea.solve(strip(), dea.Ramp("voltage", to=1.2, steps=1), DEFLECTION, quiet=True,
                      start=found[1].state)  # fmt: skip
    assert again["middle_m"] == pytest.approx(one, rel=1e-6)


def film():
    mesh = BoxStack(T, None, [Layer("film", T)], divisions=1)
    return dea.Scene(
        dea.read_gmsh(mesh),
        {"film": dea.Material(dea.Gent(MU, JM), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("top", 1000.0), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
        kinematics=dea.Axisymmetric(),
    )


def volts(stretch):
    """Voltage that holds a free Gent disc at a stretch in the plane."""
    stiff = MU * JM / (JM - 2 * stretch**2 - stretch**-4 + 3)
    return T * math.sqrt(stiff * (stretch**2 - stretch**-4) / (EPS_R * EPSILON_0)) / stretch**2


FILM = {
    "z": dea.MeanStretch(("bottom", "top"), "z"),
    "upper": dea.AtPoint((T, T), "displacement", "r"),
    "lower": dea.AtPoint((T, 0), "displacement", "r"),
}


def test_the_film_between_its_limit_points():
    """Three stretches have one voltage; the middle one is unstable.

    The stiff state is far from the others.  It is found from one at a higher voltage, to which the
    film has snapped.  A free film has states that are not homogeneous beside these.
    """
    peak = max(np.linspace(1.05, 2.0, 2000), key=volts)
    low = min(np.linspace(2.0, 4.3, 2000), key=volts)
    level = 0.9 * volts(peak) + 0.1 * volts(low)
    locked = brentq(lambda x: 2 * x**2 + x**-4 - 3 - JM, 3, 9) * (1 - 1e-9)
    edges = [1.0 + 1e-9, peak, low, locked]
    exact = [brentq(lambda x: volts(x) - level, *edges[k : k + 2], xtol=1e-13) for k in range(3)]
    snapped = dea.Ramp("voltage", to=1.1 * volts(peak) / 1e3, steps=4, at_loss="snap")
    stiff = dea.solve(film(), snapped, FILM, quiet=True)
    run = dea.solve(film(), dea.Ramp("voltage", to=level / 1e3, steps=4), FILM, quiet=True)
    found = dea.deflate(run, FILM, most=2, starts=[stiff.problem.state])
    assert [one.values["z"] ** -0.5 for one in found] == pytest.approx(exact, rel=1e-6)
    assert [one.stable for one in found] == [True, False, True]
    for one in found:
        assert one.values["upper_m"] == pytest.approx(one.values["lower_m"], rel=1e-6)


def test_wrong_calls_are_refused():
    run = dea.solve(film(), dea.Ramp("voltage", to=0.1, steps=1), quiet=True)
    for options, words in (
        ({"most": 0}, "most="), ({"aside": -1.0}, "aside="), ({"modes": 1.5}, "modes="),
        ({"step": 99}, "no row of the history"), ({"starts": [1]}, "a state of the run's scene"),
        ({"starts": run.problem.state}, "needs a list of states"),
        ({"record": {"u": dea.MeanDisplacement("nowhere", "r")}}, "nowhere"),
    ):  # fmt: skip
        with pytest.raises(dea.InputError, match=words):
            dea.deflate(run, **options)
    with pytest.raises(dea.InputError, match="needs a Run"):
        dea.deflate("run")
