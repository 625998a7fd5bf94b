"""What the demos of folding devices, of fits and of time must print; used by test_demos.py."""

from __future__ import annotations

import json

import numpy as np
import pytest

import dea_fenicsx as dea


def summary(folder):
    return json.loads((folder / "summary.json").read_text("utf-8"))


def check_hinge(out, printed):
    """Closed forms: free film 3.83 kV by a pressure; eps E^2 x 150 um x 2.125 in, 2.16 N."""
    s = {k.removeprefix("C10_D1_"): v for k, v in dea.read_summary(out).items()}
    assert s["free_film_pull_in_pressure_V"] == pytest.approx(3826.0, abs=1)
    assert abs(s["curvature_relative_difference"]) < 0.01
    for kind in ("", "incompressible_"):
        exact = s[f"closed_form_blocked_{kind}force_1kV_N"]
        # between clamps a compressible film can't thicken near its ends
        assert s[f"blocked_{kind}force_1kV_N"] == pytest.approx(exact, rel=1e-6 if kind else 0.02)
    assert s["maxwell_force_4kV_N"] == pytest.approx(2.156, abs=1e-3)
    assert s["tip_force_100V_N"] == pytest.approx(s["closed_form_tip_force_100V_N"], rel=0.03)
    # own values, mesh 1, 2026-11
    assert s["fold_at_1_2_4_kV_deg"] == pytest.approx([4.531, 19.22, 101.5], rel=5e-3)
    assert s["fold_linear_pressure_at_1_2_4_kV_deg"] == pytest.approx([3.617, 14.469, 57.875],
                                                                      rel=1e-3)  # fmt: skip
    # two equal pressures on a curved film leave a resultant, under which the hinge buckles
    assert s["fold_given_pressure_at_1_2_4_kV_deg"][1] > 180
    assert "3826.0 V by a pressure" in printed
    assert (out / "fold_angle_voltage.png").exists()


def check_stiffened(out, printed):
    """Closed forms: exact curves, strains at loss of tension, bounds, bending."""
    s = dea.read_summary(out)
    assert s["max_relative_error"] < 1e-6
    slack = {"gent, 2.125": 0.136, "gent, 2.75": 0.091}
    assert s["loss_of_tension_strain"] == pytest.approx(slack, abs=5e-4)
    stiff, bare, mixed = (
        np.array(s[f"{k}_voltage_V"]) for k in ("stiffened", "bare", "mixture")
    )
    assert np.all(bare < stiff) and np.all(stiff < mixed)
    assert 0 < s["voltage_rise"] < 0.1
    assert s["mid_plane_bending_angle_deg"] < 1e-4
    assert abs(s["bending_angle_deg"]) > 1e3 * s["mid_plane_bending_angle_deg"]
    assert len(s["element_angle_deg"]) == 32
    assert sum(s["element_angle_deg"]) == pytest.approx(s["bending_angle_deg"], rel=0.02)
    assert s["bilayer_exact_angle_deg"][-1] == pytest.approx(90, abs=0.5)
    assert s["bilayer_largest_difference"] < 0.02
    for name in ("fields.xdmf", "voltage_strain.png", "element_angle.png", "section/fields.xdmf"):
        assert (out / name).exists()


def check_fit(out, printed):
    """Known of Treloar's data: three-term Ogden fits all three tests, neo-Hookean cannot."""
    s = summary(out)
    assert set(s) == {"NeoHookean", "MooneyRivlin", "Yeoh", "Gent", "ArrudaBoyce", "Ogden"}
    assert s["Ogden"]["r_squared"] > 0.995
    assert s["NeoHookean"]["r_squared"] < s["Gent"]["r_squared"] < s["Ogden"]["r_squared"]
    assert max(s["Ogden"]["relative_residual"].values()) < 0.06
    assert s["Ogden"]["stable"] is True
    assert (out / "fits.png").exists()
    assert "R^2" in printed


def check_viscous_fit(out, printed):
    """Fitted constants do better than the literature's, also in the test that was left out."""
    s = summary(out)
    errors = s["rms_error_Pa"]
    assert len(s["tests"]) == len(errors["Wang et al. 2016"]) == 9
    largest = [t["largest_stretch"] for t in s["tests"]]
    assert min(largest) == pytest.approx(1.49) and max(largest) == pytest.approx(2.98)
    # computed independently by the film's ordinary differential equation, own values 2026-11
    assert errors["Wang et al. 2016"][:3] == pytest.approx([2638.5, 3130.6, 3432.4], rel=1e-3)
    mean = {name: np.sqrt(np.mean(np.square(e))) for name, e in errors.items()}
    assert mean["fitted to all"] < 0.65 * mean["Wang et al. 2016"]
    (predicted,) = s["predicted_rms_error_Pa"]
    assert predicted < 0.5 * errors["Wang et al. 2016"][1]
    assert len(s["branches"]) == 2
    assert (out / "cycles.png").exists()
    assert "(predicted)" in printed


def check_viscous_film(out, printed):
    """The exact course in time, whose pull-in is that of the literature's constants."""
    s = summary(out)
    assert s["exact_pull_in_field"] == pytest.approx(1.508249, abs=1e-6)
    assert s["pull_in_field"] == pytest.approx(1.508249, rel=2e-4)
    assert s["stretch_at_pull_in"] == pytest.approx(1.282547, rel=1e-4)
    assert s["max_relative_error"] < 1e-4
    assert s["pull_in_time_s"] is None and s["stretch_at_0"] is None
    assert (out / "stretch_time.png").exists()


def check_creep(out, printed):
    """It grows all the time, from the instantaneous response to that without branches."""
    s = summary(out)
    ratios = [s["area_ratio_at_0"], *s["area_ratios"].values(), s["relaxed_area_ratio"]]
    assert np.all(np.diff(ratios) > 0)
    assert s["area_ratio_at_end"] == pytest.approx(s["relaxed_area_ratio"], rel=5e-3)
    assert (out / "area_time.png").exists()


def check_hysteresis(out, printed):
    """The exact film under the same cycles; the loss by the trapezoidal rule over the steps."""
    s = summary(out)
    assert s["max_contraction_error"] < 1e-4
    assert s["loss_of_last_cycle_J"] == pytest.approx(s["exact_loss_of_last_cycle_J"], rel=0.01)
    assert (out / "voltage_contraction.png").exists()


def check_harvest(out, printed):
    """The closed form of the energy, with what leaks during the release."""
    s = summary(out)
    assert s["energy_density_over_mu"] == pytest.approx(s["closed_form_over_mu"], rel=1e-8)
    assert s["charge_kept"] == pytest.approx(np.exp(-0.2), rel=1e-12)
    assert (out / "potential_charge.png").exists()
