"""The answer to a small sinusoidal load against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from motion_scenes import CLAMPED, at_rest, rubber, sphere, strip
from mpi4py import MPI

import dea_fenicsx as dea

BRANCH = dea.Maxwell(1.5, 0.5)
RADIUS = {"a": dea.AtPoint((1.0, 0.0), "displacement", "r")}


def balloon(comm=MPI.COMM_SELF, cells=(3, 6), omegas=(1.0, 3.2, 0.0)):
    """da/dP of a thick sphere with a branch about rest, complex."""
    scene = sphere(pressure=1.0, viscous=[BRANCH], comm=comm, cells=cells)
    run = dea.solve(scene, dea.Ramp("load", 0.0, 1, response="relaxed"), quiet=True)
    hertz = np.array(omegas) / (2 * np.pi)
    return dea.frequency_response(run, hertz, "load", RADIUS)


def test_balloon_with_a_branch(tmp_path):
    """Known: da/dP = 1/(K mu* - M omega^2), with the complex modulus of the branch."""
    found = balloon()
    assert found.modulus("a_m")[:2] == pytest.approx([0.44197534, 0.47050731], rel=1e-4)
    assert found.phase_deg("a_m")[:2] == pytest.approx([-26.544, -32.312], abs=0.01)
    assert found["a_m"][2] == pytest.approx(54 / 91, rel=1e-4)
    assert found.note == ""
    found.write(tmp_path / "table.csv")
    table = np.genfromtxt(tmp_path / "table.csv", delimiter=",", names=True)
    assert table["a_m"] == pytest.approx(found.modulus("a_m"))


def test_slow_answer_is_the_derivative_along_a_ramp():
    """Under voltage, with the charge and the impedance of what is then a capacitor."""
    scene, record = sphere(0.05), {"a": RADIUS["a"], "q": dea.Charge("inner")}
    step = 1e-4
    run = dea.solve(scene, dea.Ramp("voltage", at=(1 - step, 1 + step), to=1 + step), record,
                    quiet=True)  # fmt: skip
    slopes = {
        name: np.diff(run.column(name)[-2:])[0] / (2 * step) for name in ("a_m", "q_C")
    }
    run = dea.solve(scene, dea.Ramp("voltage", steps=3), record, quiet=True)
    found = dea.frequency_response(run, [0.0, 1e-3], record=record)
    for name, slope in slopes.items():
        assert found[name][0] == pytest.approx(slope, rel=1e-6)
    assert found.impedance_ohm("q_C")[1] == pytest.approx(
        0.05 / (2j * np.pi * 1e-3 * slopes["q_C"]), rel=1e-4
    )
    with pytest.raises(dea.InputError, match="no charge"):
        found.impedance_ohm("a_m")
    # it grows without limit towards the breathing frequency, and turns its sign there
    near = np.array([0.99, 1.01]) * 3.03716946 / (2 * np.pi)
    below, above = dea.frequency_response(run, near, record=RADIUS)["a_m"]
    assert below.real > 10 * slopes["a_m"] and above.real < -10 * slopes["a_m"]


def test_a_shaken_strip():
    """A base that moves as a whole: far below resonance the strip follows, and its tip leads."""
    base = dea.Displacement("x_min", "y", 1.0)
    scene = strip(supports=[dea.Fix("x_min", "x")], prescribed=[base], cells=(6, 1))
    run = at_rest(scene)
    first = dea.modes(run, 1).frequencies[0]
    tip = {"tip": dea.AtPoint((10.0, 0.5), "displacement", "y")}
    found = dea.frequency_response(run, first * np.array([1e-3, 0.5]), record=tip)["tip_m"]
    assert found[0] == pytest.approx(1.0, rel=1e-5)
    # of a beam the first mode has all but 2 % of the tip's answer: 1 + 1.566 (w/w1)^2/(1 - ...)
    assert found[1] == pytest.approx(1 + 1.566 * 0.25 / 0.75, rel=0.02)


def test_a_free_body():
    """Its ends are drawn apart by dead loads: a bar that is free has the answer of its half."""
    pull = [dea.DeadPressure(side, -1.0) for side in ("x_min", "x_max")]
    end = {"end": dea.AtPoint((10.0, 0.5), "displacement", "x")}
    start = {"end": dea.AtPoint((0.0, 0.5), "displacement", "x")}
    free = at_rest(strip(loads=pull, cells=(8, 2)))
    answers = [dea.frequency_response(free, [0.05], record=r)["end_m"][0] for r in (end, start)]
    half = strip(
        loads=pull[1:], cells=(4, 2), length=5.0,
        supports=[dea.Fix("x_min", "x"), dea.FreeBody()],
    )  # fmt: skip
    end = {"end": dea.AtPoint((5.0, 0.5), "displacement", "x")}
    known = dea.frequency_response(at_rest(half), [0.05], record=end)["end_m"][0]
    assert answers == pytest.approx([known, -known], rel=1e-7)


def test_frequencies_are_put_around_resonances():
    """A shaken strip without damping: the bare list sees nothing of its resonances."""
    base = dea.Displacement("x_min", "y", 1.0)
    scene = strip(supports=[dea.Fix("x_min", "x")], prescribed=[base], cells=(6, 1))
    run, tip = at_rest(scene), {"tip": dea.AtPoint((10.0, 0.5), "displacement", "y")}
    modes = dea.modes(run, 3).frequencies
    hertz = [0.9 * modes[2], 0.1 * modes[0]]
    found = dea.frequency_response(run, hertz, record=tip, adaptive=0.3)
    f, y = found.hertz, found["tip_m"]
    assert np.all(np.diff(f) > 0) and set(hertz) <= set(f) and len(f) < 250
    for mode in modes[:2]:
        # the sign turns there, from a large amplitude to a large one
        k = np.searchsorted(f, mode)
        assert y[k - 1].real * y[k].real < 0 and min(abs(y[k - 1]), abs(y[k])) > 1e3
        assert f[k] - f[k - 1] < 3.1e-4 * mode
    change = np.abs(np.diff(y)) / np.maximum(np.abs(y[1:]), np.abs(y[:-1]))
    wide = np.diff(f) > 3e-4 * f[1:]
    large = np.abs(y[1:]) > 0.1
    assert np.all(change[wide & large] < 0.3 + 1e-9)
    again = dea.frequency_response(run, hertz[::-1], record=tip, adaptive=0.3)
    assert again["tip_m"] == pytest.approx(y, rel=1e-9)


def test_a_damped_resonance_is_resolved():
    """The answer of a balloon with a branch, between the frequencies of a list of two."""
    scene = sphere(pressure=1.0, viscous=[dea.Maxwell(0.05, 0.3)], cells=(2, 6))
    run = dea.solve(scene, dea.Ramp("load", 0.0, 1, response="relaxed"), quiet=True)
    found = dea.frequency_response(run, [0.1, 0.9], "load", RADIUS, adaptive=0.2)

    def compliance(hertz):
        omega = 2 * np.pi * hertz
        mu = 1 + 0.05j * omega * 0.3 / (1 + 0.3j * omega)
        return 1 / (91 / 54 * mu - omega**2 / 6)

    assert found["a_m"] == pytest.approx(compliance(found.hertz), rel=2e-3)
    fine = np.linspace(0.1, 0.9, 2000)
    peak = np.abs(compliance(fine)).max()
    assert np.abs(found["a_m"]).max() == pytest.approx(peak, rel=5e-3)
    # so close that straight lines between them are the curve
    between = np.interp(fine, found.hertz, np.abs(found["a_m"]))
    assert between == pytest.approx(np.abs(compliance(fine)), rel=0.02)


def test_what_is_told_and_refused():
    run = at_rest(strip(0.1, CLAMPED, cells=(2, 1)))
    record = {"tip": dea.LargestDisplacement("top", "y")}
    found = dea.frequency_response(run, [1.0], record=record)
    assert "twice the frequency" in found.note and abs(found["tip_m"][0]) < 1e-9
    for hertz, words in (([-1.0], ">= 0"), ("fast", "list of numbers"), ([], "at least 1")):
        with pytest.raises(dea.InputError, match=words):
            dea.frequency_response(run, hertz)
    for share in (0, 1.5, "fine"):
        with pytest.raises(dea.InputError, match="adaptive is"):
            dea.frequency_response(run, [1.0], adaptive=share)
    with pytest.raises(dea.InputError, match="no ramp in the scene named 'load'"):
        dea.frequency_response(run, [1.0], "load")
    with pytest.raises(dea.InputError, match="no column"):
        found.modulus("top")
    flowing = [dea.ViscousBranch(dea.NeoHookean(1.0), 1.0)]
    scene = strip(0.1, CLAMPED, cells=(2, 1), materials={"film": rubber(viscous=flowing)})
    with pytest.raises(dea.InputError, match="no Maxwell ones"):
        dea.frequency_response(at_rest(scene), [1.0])


def on_some(comm):
    found = balloon(comm, cells=(1, 2))["a_m"]
    base = dea.Displacement("x_min", "y", 1.0)
    held = [dea.Fix("x_min", "x")]
    run = at_rest(strip(supports=held, prescribed=[base], cells=(6, 1), comm=comm))
    tip = {"tip": dea.AtPoint((10.0, 0.5), "displacement", "y")}
    shaken = dea.frequency_response(run, [0.004, 0.02], record=tip, adaptive=0.8)
    first = int(np.searchsorted(shaken.hertz, 0.02))
    return [*found.real, *found.imag, len(shaken.hertz), first, shaken.hertz[first // 2]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_on_several_ranks(ranks, on_ranks):
    assert on_ranks("test_frequency_response", "on_some", ranks) == pytest.approx(
        on_some(MPI.COMM_SELF), rel=1e-8
    )
