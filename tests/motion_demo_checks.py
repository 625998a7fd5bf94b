"""What the demos of vibration and motion must print; used by test_demos.py."""

from __future__ import annotations

import numpy as np
import pytest

import dea_fenicsx as dea


def check_balloon_motion(out, printed):
    """The exact sphere's largest radius, its equilibrium and its breathing."""
    s = dea.read_summary(out)
    for key in ("largest_radius", "time_of_largest", "equilibrium_radius", "breathing_omega"):
        assert s[key] == pytest.approx(s[f"exact_{key}"], rel=1e-4), key
    assert (out / "radius_time.png").exists()


def check_balloon_branches(out, printed):
    """The exact limits of the round branch, and the exact place where eggs leave it."""
    s = dea.read_summary(out)
    assert s["exact_maximum"] == pytest.approx(0.137950222, abs=1e-9)
    assert s["exact_minimum"] == pytest.approx(0.076271810, abs=1e-9)
    assert s["maximum_voltage"] == pytest.approx(s["exact_maximum"], rel=1e-5)
    assert s["minimum_voltage"] == pytest.approx(s["exact_minimum"], rel=1e-5)
    assert s["first_bifurcation_mode"] == s["exact_bifurcation_mode"] == 2
    assert s["first_bifurcation_radius"] == pytest.approx(s["exact_bifurcation_radius"], rel=1e-4)


def check_balloon_response(out, printed):
    """The closed form of a sphere with one Maxwell branch."""
    s = dea.read_summary(out)
    assert s["modulus"] == pytest.approx(0.47050731, rel=1e-4)
    assert s["phase_deg"] == pytest.approx(-32.312, abs=0.01)
    assert (out / "response.csv").exists()


def check_membrane_modes(out, printed):
    """Zeros of Bessel functions; a film of this thickness lies 0.4 % above, and the mesh more."""
    s = dea.read_summary(out)
    found, known = (
        np.array([s[f"{what}_{k}"] for k in range(10)]) for what in ("frequency", "closed_form")
    )
    assert s["closed_form_0"] == pytest.approx(0.312139, abs=1e-6)
    assert np.all(found > 1.003 * known) and np.all(found < 1.013 * known)
    assert found[1] == pytest.approx(found[2], rel=1e-6)
    assert s["growing_modes"] == 0 and s["extrapolated_0"] is None
    assert (out / "modes.xdmf").exists()


def check_thin_membrane(out, printed):
    """Continued to no thickness they are those of a membrane to 0.1 %."""
    s = dea.read_summary(out)
    found, known = (
        np.array([s[f"{what}_{k}"] for k in range(10)]) for what in ("extrapolated", "closed_form")
    )
    assert found == pytest.approx(known, rel=1e-3)


def check_strip_frequency(out, printed):
    """The first frequency vanishes where the static path has its bifurcation."""
    s = dea.read_summary(out)
    assert s["frequency_zero_voltage_V"] == pytest.approx(s["buckling_voltage_V"], rel=1e-6)
    assert s["buckling_voltage_V"] == pytest.approx(s["euler_voltage_V"], rel=0.02)
    history = dea.read_history(out)
    assert np.all(np.diff(history["first_Hz"]) < 0) and history["first_Hz"][-1] < 0


def check_snap_in_motion(out, printed):
    """The static landing and the exact one."""
    s = dea.read_summary(out)
    assert s["pull_in_field"] == pytest.approx(s["exact_pull_in_field"], rel=1e-8)
    assert s["landed_stretch_in_motion"] == pytest.approx(s["exact_landed_stretch"], rel=1e-6)
    assert abs(s["difference"]) < 1e-6 and s["seconds_to_rest"] > 1
    assert (out / "stretch_time.png").exists()


def check_beam_in_motion(out, printed):
    """It bends down, and is at rest at first."""
    s, history = dea.read_summary(out), dea.read_history(out)
    assert history["time_s"][-1] == pytest.approx(0.2) and history["tip_m"][0] == 0
    assert s["tip_at_0.2_s_m"] == history["tip_m"][-1]
    assert s["tip_at_0.2_s_m"] < s["tip_at_0.1_s_m"] < 0


def check_loudspeaker(out, printed):
    """The flat membrane without field has its first resonance at 194 Hz; bias lowers it."""
    s = dea.read_summary(out)
    assert 150 < s["resonance_Hz"] < 194
    assert s["centre_at_resonance_m"] > 2 * s["centre_at_lowest_m"] > 0
    sound = np.genfromtxt(out / "sound.csv", delimiter=",", names=True)
    # a capacitor: the current is ahead of the voltage by a quarter of a period
    assert sound["impedance_phase_deg"] == pytest.approx(-90, abs=0.1)
