"""What the demos of rolls, stacks with tabs and bimorphs must print; used by test_demos.py."""

from __future__ import annotations

import json

import pytest


def summary(folder):
    return json.loads((folder / "summary.json").read_text("utf-8"))


def check_roll(out, printed):
    """An exact roll of many layers; the difference halves when turns and layers are doubled."""
    s = summary(out)
    assert s["axial_strain"] == pytest.approx(s["axial_strain_of_many_layers"], rel=1.5e-3)
    assert s["axial_strain_of_many_layers"] == pytest.approx(0.0521534, abs=1e-6)  # own, 2026-11
    assert s["inertia"] == 0
    assert "a roll of many thin layers" in printed


def check_tabbed_stack(out, printed):
    """Betti's theorem and plates; fields at the edges add to both."""
    s = summary(out)
    assert s["active_share_of_volume"] == pytest.approx(4 / 6 * 10 * 6 / (12 * 8), rel=1e-12)
    assert 1 < s["contraction"] / s["linear_contraction"] < 1.08
    assert 1 < s["capacitance_at_rest_F"] / s["plates_capacitance_F"] < 1.15


def check_bimorph(out, printed):
    """Igreja and Dias' half space, which the mesh overrates; both faces are alike."""
    s = summary(out)
    assert s["capacitance_at_rest_F"] == pytest.approx(s["half_space_capacitance_F"], rel=0.05)
    assert s["tip_m"] > 1e-5
    assert s["tip_of_lower_face_m"] == pytest.approx(-s["tip_m"], rel=1e-6)
    assert abs(s["tip_of_both_faces_m"]) < 1e-6 * s["tip_m"]


DEVICE_CHECKS = {
    "bimorph.py": (check_bimorph, []),
    "roll.py": (check_roll, []),
    "tabbed_stack.py": (check_tabbed_stack, ["--steps", 1]),
}
