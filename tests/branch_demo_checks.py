"""What the demos of branches must print; used by test_demos.py."""

from __future__ import annotations

import json

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


def check_two_modes(out, printed):
    """Onsets of an eigenvalue problem; the second branch becomes stable, as its equations say.

    With half the detuning the ratio of the distances is 6.60, with twice of it 6.26 (own values,
    2026-11).
    """
    s = dea.read_summary(out)
    assert s["first_q"] == pytest.approx(s["neutral_first_q"], rel=5e-3)
    assert s["second_q"] == pytest.approx(s["neutral_second_q"], rel=5e-3)
    assert s["distance_ratio"] == pytest.approx(6.48, abs=0.05)
    assert s["both_stable_at_end"] is True
    assert s["mixed_negative_modes"] == 1
    told = json.loads((out / "diagram.json").read_text("utf-8"))
    parts = [[p["negative_modes"] for p in b["stability_intervals"]] for b in told["branches"]]
    assert parts[:3] == [[0, 1, 2], [0], [1, 0]]
    assert [b["leaves"] for b in told["branches"]] == ["", "first", "first", "branch_2"]
    assert (out / "left_voltage.png").exists()
