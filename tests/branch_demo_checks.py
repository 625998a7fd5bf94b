"""What the demos of branches must print; used by test_demos.py."""

from __future__ import annotations

import pytest

import dea_fenicsx as dea


def check_growing_wrinkles(out, printed):
    """A thin plate's onset, number and wavelength; a pitchfork's amplitude grows as a root."""
    s = dea.read_summary(out)
    assert s["onset_compression_Pa"] == pytest.approx(s["theory_onset_compression_Pa"], rel=0.05)
    assert s["wavelength_m"] == pytest.approx(s["theory_wavelength_m"], rel=0.02)
    assert s["number"] == s["theory_number"] == 7
    assert s["growth_exponent"] == pytest.approx(0.5, abs=0.01)
    assert s["last_amplitude_m"] > 20e-6  # a quarter of the film's thickness
    assert s["stable"] is True
    assert (out / "amplitude_wavelength.png").exists()


def check_bonded_film(out, printed):
    """The eigenvalue problem of waves on a film and its base, and the known soft limit."""
    s = dea.read_summary(out)
    assert s["kind"] == "buckle"
    assert s["neutral_field"] ** 2 == pytest.approx(0.15 ** (2 / 3), rel=0.05)
    assert s["neutral_wave_number"] == pytest.approx(0.15 ** (1 / 3), rel=0.02)
    assert s["bifurcation_field"] == pytest.approx(s["neutral_field"], rel=2e-3)
    assert s["stable"] is True
