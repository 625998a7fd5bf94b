"""What the demos of films, folding devices, fits and time must print; used by test_demos.py."""

from __future__ import annotations

import csv
import json
import re

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


def check_fringe(out, printed):
    """Love's equation at d/a = 2, and the parallel plates."""
    s = summary(out)
    assert s["closed_form"] == pytest.approx(5.55210894, abs=5e-9)
    assert s["capacitance_over_eps0_a"] == pytest.approx(5.55210894, rel=5e-3)
    assert s["parallel_plates_over_eps0_a"] == pytest.approx(np.pi / 2, rel=1e-12)
    assert abs(s["charge_balance"]) < 1e-6


def check_folding(out, printed):
    """The panels meet the rod; from there on the force is larger than without it."""
    s = summary(out)
    assert s["case"] == "storey" and s["pull_in_voltage_V"] is None
    assert 5e-3 < s["panels_meet_at_stroke_m"] < 6.5e-3  # own value, 2026-11
    assert s["stroke_reached_m"] == pytest.approx(7e-3, rel=1e-9)
    assert s["contact_changes_force_by"] > 0.03
    assert s["twist_at_stroke_deg"] < s["twist_without_contact_deg"]
    with_rod, free = (dea.read_history(folder) for folder in (out, out / "without_rod"))
    before = with_rod["pressure_Pa"] == 0
    assert np.allclose(with_rod["force_N"][before], free["force_N"][before], rtol=1e-6)


def check_panels(out, printed):
    """The valleys meet each other; from there on the force is larger than without that."""
    s = summary(out)
    assert s["case"] == "panels" and s["pull_in_voltage_V"] is None
    assert 5e-3 < s["panels_meet_at_stroke_m"] < 6e-3  # own value, 2026-11
    assert s["contact_changes_force_by"] > 0.05
    assert s["twist_at_stroke_deg"] < s["twist_without_contact_deg"]


def check_zipping(out, printed):
    """The charge of the zipped film beside a beam's; it lets go far below its pull-in."""
    s = summary(out)
    assert s["charge_when_zipped_C"] == pytest.approx(s["beam_charge_C"], rel=0.03)
    assert 0.98 < s["gap_closed"] < 1
    assert 0 < s["air_energy_share"] < 0.05
    assert 35 < s["release_voltage_V"] < 45 < 58 < s["pull_in_voltage_V"] < 62
    assert s["stable"] is True


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


def check_vhb_temperatures(out, printed):
    """Longer times when it is colder; a temperature left out is predicted nearly as well."""
    s = summary(out)
    shifts = [s["log10_shift"][f"{253.15 + 20 * k:g}"] for k in range(6)]
    assert shifts == sorted(shifts, reverse=True) and shifts[0] > 3.5
    assert len((out / "temperatures.csv").read_text().splitlines()) == 7
    (predicted,) = s["predicted_relative_rms_error"].values()
    assert predicted < 1.5 * s["relative_rms_error"]["313.15"] < 0.15
    assert abs(s["predicted_eps_r_relative_error"]["313.15"]) < 0.01
    assert s["at_50_degrees_relative_rms_error"] < 0.1
    assert (out / "temperatures.png").exists()


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


def check_cone(out, printed):
    """Four digits of the reference of a thin membrane; the film's thickness takes 0.1 % off."""
    s = summary(out)
    assert s["thin_membrane_deflection"] == pytest.approx(0.64420238, abs=1e-8)
    assert s["deflection"] == pytest.approx(0.64420238, rel=2e-3)
    assert s["pull_in_field"] is None and s["pull_in_deflection"] is None


def check_cone_of_a_membrane(out, printed):
    """The reference of a thin membrane itself."""
    s = summary(out)
    assert s["deflection"] == pytest.approx(0.64420238, rel=1e-6)
    assert s["deflection"] == pytest.approx(s["thin_membrane_deflection"], rel=1e-6)


def check_spring_cone(out, printed):
    """A bistable bias takes most of the film's stiffness away: about twice the stroke."""
    s = summary(out)
    assert s["bias"] == "bistable" and s["inertia"] == 0
    assert s["deflection_at_0V"] == pytest.approx(0.467, abs=2e-3)  # own value, 2026-11
    assert s["stroke"] == pytest.approx(0.054, abs=2e-3)  # 0.0280 with the linear spring alone
    assert s["blocked_force_N"] == pytest.approx(0.0219, rel=0.02)


def check_tube(out, printed):
    """The blocked force is exact; caps let the ends lengthen a little more."""
    s = summary(out)
    assert s["exact_blocked_force_N"] == pytest.approx(0.088275, rel=1e-4)
    assert s["blocked_force_N"] == pytest.approx(s["exact_blocked_force_N"], rel=1e-4)
    assert s["strain_of_a_long_tube"] < s["strain"] < 1.02 * s["strain_of_a_long_tube"]


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


def check_buckling(out, printed):
    """Euler's load of a clamped strip in plane strain, within 1 % at L/h = 50."""
    s = summary(out)
    assert s["critical_voltage_V"] == pytest.approx(s["closed_form_voltage_V"], rel=0.01)
    assert s["buckled_branch_is_stable"] and s["flat_branch_is_unstable"]
    assert f"{s['critical_voltage_V']:.4f} V" in printed


def check_ddea(out, printed):
    """Exact states of exact/film.py; 38.3 kV follow from them, 57 kV and 30 % are
    printed in the thesis (section 4.3.2).

    38.3 kV is the pull-in of a compressible layer that eps E^2 presses without pulling in its
    plane; the field's whole stress gives 37.4 kV.
    """
    s = summary(out)
    assert s["max_relative_error"] < 1e-8
    assert s["pull_in_voltage_V"] == pytest.approx(s["exact_pull_in_voltage_V"], rel=1e-9)
    assert s["pull_in_voltage_V"] == pytest.approx(37.4385e3, abs=0.1)
    assert s["pull_in_voltage_pressure_V"] == pytest.approx(
        s["exact_pull_in_voltage_pressure_V"], rel=1e-8
    )
    assert s["largest_voltage_pressure_V"] == pytest.approx(38.3e3, abs=50)
    assert s["contraction_live"] == pytest.approx(s["exact_contraction_live"], rel=1e-8)
    assert s["contraction_dead"] == pytest.approx(s["exact_contraction_dead"], rel=1e-8)
    assert 0.5 / 0.55 * s["contraction_live"] == pytest.approx(0.305, abs=5e-4)
    assert s["voltage_for_30_percent_V"] == pytest.approx(56.43e3, abs=10)
    assert "57 kV" in printed
    assert "10 kV" in printed


def check_sldea(out, printed):
    """Closed form of the layer: 41.0 % at 700 kPa, 11.0 % at 160 kPa, 677 kPa for 40 %."""
    s = summary(out)
    assert s["max_error"] < 1e-10
    assert s["contraction_700_kPa"] == pytest.approx(0.410, abs=5e-4)
    assert s["contraction_160_kPa"] == pytest.approx(0.110, abs=5e-4)
    assert s["exact_pressure_for_40_percent_Pa"] == pytest.approx(677e3, abs=500)
    assert "kN/m^2" in printed


def check_single_layer(out, printed):
    """Closed form of the ring: 17.9 % at 40 kPa for 73.7 kPa, and the shape factor's modulus.

    4 mu (1 + S^2) takes the ring as straight; at an inner radius of a fifth of the outer one that
    is 6 % low, and 2.5 % with its curvature (converged 21.2 mu against 20 and 20.63).
    """
    s = summary(out)
    assert s["contraction_free"] == pytest.approx(s["exact_contraction_free"], rel=1e-8)
    assert s["contraction_free"][-1] == pytest.approx(0.179, abs=5e-4)
    assert s["shape_factor"] == pytest.approx(2.0, rel=1e-12)
    assert s["plate_modulus_Pa"] == pytest.approx(s["ring_modulus_Pa"], rel=0.035)
    assert s["plate_modulus_Pa"] == pytest.approx(s["shape_factor_modulus_Pa"], rel=0.07)
    # a soft electrode lets the edges be squeezed: softer than a plate, far stiffer than free
    soft = np.array(s["contraction_bonded_soft"])
    plate = np.array([4e3, 10e3, 20e3, 30e3, 40e3]) / s["shape_factor_modulus_Pa"]
    assert np.all(soft > 1.3 * plate)
    assert np.all(soft < 0.3 * np.array(s["contraction_free"]))
    assert (out / "contraction_pressure.png").exists()


def check_disc(out, printed):
    """Values of the demo's own study (mesh 4, taper 3 mm: 6763.4, 8063.5, 10744.7 V)."""
    s = summary(out)
    assert s["area_ratio"] >= 3
    assert s["voltage_at_area_1.5_V"] == pytest.approx(6763.4, rel=1e-3)
    assert s["voltage_at_area_2_V"] == pytest.approx(8063.5, rel=5e-4)
    assert s["voltage_at_area_3_V"] == pytest.approx(10744.7, rel=1e-2)
    assert s["failures"][0]["mode"] == "loss of tension"


def check_wrinkles(out, printed):
    """Loss of tension at eps E^2 = mu (lam^2 - lam^-4), and the first wrinkle just behind it."""
    s = summary(out)
    assert s["slack_voltage_V"] == pytest.approx(s["exact_slack_voltage_V"], rel=1e-7)
    assert 1.002 < s["wrinkling_voltage_V"] / s["exact_slack_voltage_V"] < 1.008
    assert (out / "first_wrinkle.png").exists()


def check_prestretch(out, printed):
    """Closed forms in the demo's head."""
    s = summary(out)
    assert s["slack_voltage_V"] == pytest.approx(s["exact_slack_voltage_V"], rel=1e-7)
    assert s["stretch_on_weights"] == pytest.approx(s["exact_stretch_on_weights"], rel=1e-9)
    assert s["exact_slack_voltage_V"] == pytest.approx(8963.35, abs=0.01)
    assert "+39.7%" in printed


def check_pull_in(out, printed):
    """Zhao and Suo, Phys. Rev. B 76 (2007) 134113: 2^(-2/3), and 3^(1/2) 2^(-4/3) sqrt(mu/eps)."""
    s = summary(out)
    exact = 0.5e-3 * 3**0.5 * 2 ** (-4 / 3) * (50e3 / (2.8 * 8.8541878128e-12)) ** 0.5
    assert s["pull_in_voltage_V"] == pytest.approx(exact, rel=1e-9)
    assert s["exact_pull_in_voltage_V"] == pytest.approx(exact, rel=1e-9)
    assert s["pull_in_thickness_stretch"] == pytest.approx(2 ** (-2 / 3), rel=1e-5)
    ends = re.match(r"Equilibrium was lost between (\S+) V and (\S+) V", s["ramp_ended_with"])
    low, high = map(float, ends.groups())  # printed with six digits
    assert low == pytest.approx(exact, abs=0.1) and exact < high + 0.05 and high < 1.001 * exact
    assert s["last_voltage_under_charge_V"] < 0.92 * exact
    assert 1 < s["bifurcation_charge_over_that_of_pull_in"] < 1.1
    assert (out / "voltage_thickness_stretch.png").exists()


def check_first_actuator(out, printed):
    """Beam theory of two equal layers; the clamp and the free end make the strip 2 % stiffer."""
    s = summary(out)
    assert s["small_tip_m"] == pytest.approx(s["beam_tip_m"], rel=0.025)
    assert s["beam_tip_m"] == pytest.approx(-14.875e-6, rel=1e-4)  # 3/8 eps V^2 L^2/(4 mu h^3)
    assert s["tip_m"] == pytest.approx(-6.061e-3, rel=1e-3)  # own value, 2026-11
    assert s["stable"] is True
    assert (out / "tip_voltage.png").exists()


def check_own_geometry(out, printed):
    """A free film is in the exact state whatever its outline."""
    s = summary(out)
    assert s["stretch_geo"] == pytest.approx(s["exact_stretch"], rel=1e-8)
    assert s["stretch_step"] == pytest.approx(s["exact_stretch"], rel=1e-8)
    assert 1.0127 < s["exact_stretch"] < 1.0128


def check_own_material(out, printed):
    """The exact branch of the same energy, and the neo-Hookean limit of the model."""
    s = summary(out)
    assert s["max_relative_error"] < 1e-9
    assert s["pull_in_voltage_at_a_1_V"] == pytest.approx(
        s["pull_in_voltage_neo_hookean_V"], rel=1e-12
    )
    assert s["pull_in_voltage_V"] > 1.04 * s["pull_in_voltage_neo_hookean_V"]


def check_blister(out, printed):
    """Plate theory of a viscous film with the same imperfection, without the electrode's fringe."""
    s = summary(out)
    assert s["plate_buckling_field_relaxed"] == pytest.approx(0.02413, abs=1e-5)
    assert s["plate_buckling_field_instantaneous"] == pytest.approx(0.05423, abs=1e-5)
    assert s["onset_field"] == pytest.approx(s["plate_onset_field"], rel=0.01)
    assert s["last_field"] == pytest.approx(0.06, rel=1e-12)
    assert s["last_deflection_over_thickness"] > 1
    assert (out / "deflection_field.png").exists()


def check_crease(out, printed):
    """The crease outlives the largest voltage, does not go through its plane, and opens again."""
    s = summary(out)
    assert s["end"] == "unloaded" and s["last_field"] == pytest.approx(0, abs=1e-12)
    assert s["largest_depth_m"] > 5 * abs(s["last_depth_m"])
    assert 0 < s["depth_when_loaded_m"] == s["depth_when_held_m"] <= s["largest_depth_m"]
    assert s["notch_depth_m"] == pytest.approx(0.16e-3) and s["overlap_m"] < 1e-6
    assert (out / "corner_voltage.png").exists()


def check_minimum_energy(out, printed):
    """The least energy of frame and film; by the film's force at small strain 26.96 1/m."""
    s = summary(out)
    assert s["closed_form_curvature_per_m"] == pytest.approx(26.89604, abs=1e-4)
    assert abs(s["relative_difference"]) < 2e-4
    assert abs(s["opened_relative_difference"]) < 2e-4
    assert abs(s["released_energy_relative_difference"]) < 1e-4
    assert s["opened_curvature_per_m"] < 0.8 * s["released_curvature_per_m"]
    # an arc of 30 mm
    turned = np.degrees(s["released_curvature_per_m"] * 30e-3)
    assert s["released_bend_deg"] == pytest.approx(turned, rel=5e-3)
    assert s["released_energy_J"] < s["flat_energy_J"]
    assert "released it bends by" in printed


def check_balloon(out, printed):
    """The closed form of an isothermal gas in a thick sphere with a vacuum outside."""
    s = summary(out)
    assert s["closed_form_ratio"] == pytest.approx(1.47705704, rel=1e-8)
    assert s["inner_radius_ratio"] == pytest.approx(1.47705704, rel=1e-6)
    assert s["negative_eigenvalues"] == 0 and s["ended_with"] is None
    assert s["limit_voltage_of_gas"] is None


def check_pump(out, printed):
    """What the liquid gains is what the voltage gives; the stroke is the liquid that is moved."""
    s = summary(out)
    assert s["stroke_volume_m3"] == pytest.approx(0.2e-6, rel=1e-8)
    assert s["pressure_low_Pa"] < s["pressure_before_cycle_Pa"] < s["pressure_high_Pa"]
    assert s["work_on_liquid_J"] > 1e-5 and s["energy_error"] < 1e-4
    assert s["closed_within"] < 1e-6 and s["gas_law_error"] is None
    assert (out / "pressure_chamber.png").exists()


def check_gripper(out, printed):
    """The forces on the finger balance, and the gap is closed to a hundredth of the facets."""
    s = dea.read_summary(out)
    assert s["force_balance_error"] < 1e-8
    assert abs(s["contact_gap_m"]) < 0.01 * 15e-3 / 40
    assert s["last_open_voltage_V"] < s["first_closed_voltage_V"] < 18e3
    # own values, mesh 1, 2026-11
    assert s["grip_force_N"] == pytest.approx(4.442e-3, rel=5e-3)
    assert 0 < s["contact_area_m2"] < 5e-6
    assert "each finger pushes" in printed


def check_sensitivity(out, printed):
    s = summary(out)
    errors = {name: value for name, value in s.items() if name.startswith("tip_by_") and
              name.endswith("_error")}  # fmt: skip
    assert len(errors) == 6
    assert max(errors.values()) < 1e-5  # that of a difference with a step of 0.1 %
    assert s["pull_in_error"] < 1e-8
    assert s["adjoint_residual"] < 1e-9
    assert "differences agree" in printed
    assert (out / "sensitivity.png").exists()


def check_calibrate_vhb(out, printed):
    """Misfits are the model's; the test under voltage is predicted better than without it."""
    s = summary(out)
    assert s["model"] == "ogden, 2 branches"
    assert max(s["relative_rms"].values()) < 0.2
    assert len(s["rms"]) == 12
    # own values, 2026-11
    assert s["refit_rms_Pa"] == pytest.approx(740, rel=0.05)
    assert s["predicted_rms_Pa"] == pytest.approx(3081, rel=0.05)
    assert s["without_voltage_rms_Pa"] > 2 * s["predicted_rms_Pa"]
    assert (out / "calibration.png").exists() and (out / "coupled.png").exists()
    assert "root mean square error" in printed


def check_calibrate_actuator(out, printed):
    """The constants of the device that was measured come back; the tip alone fixes less.

    A mesh of four cells puts the moduli wrong by -3 % and +11 % without any noise (12 cells: -0.5 %
    and +1.6 %).  So the region, which knows of noise alone, is not asked to hold the constants.
    """
    s = summary(out)
    assert s["loose_from_tip_alone"] >= 1 and s["loose"] == 0
    assert abs(s["active_eps_r_error"]) < 0.03 and abs(s["active_mu_error"]) < 0.1
    assert abs(s["passive_mu_error"]) < 0.2
    assert s["stroke_sampled_deviation_m"] == pytest.approx(s["stroke_deviation_m"], rel=0.5)
    assert "the data do not fix" in printed
    assert (out / "calibration.png").exists()


def check_optimise_electrode(out, printed):
    s = summary(out)
    assert s["converged"] and s["evaluations"] <= 10
    # own values, mesh 1, 2026-11; mesh 3 gives 2.3959e-5, 4.2820e-5 and 5.440e-3
    assert s["stroke_before_m"] == pytest.approx(2.4111e-5, rel=1e-3)
    assert s["stroke_after_m"] == pytest.approx(4.2787e-5, rel=1e-3)
    assert s["edge_after_m"] == pytest.approx(5.434e-3, rel=1e-3)
    # --margin takes ten seconds more; it gives 5.859e-5, 5.888e-5 and 5.905e-5 on the meshes 1 to 3
    assert s["margin"] is None and s["stroke_at_margin_m"] is None
    assert "the mark moves by" in printed
    assert (out / "designs.png").exists()


def check_study(out, printed):
    s = summary(out)
    assert s["runs"] == 4 and s["completed"] + s["failed"] == 4
    with (out / "table.csv").open() as f:
        rows = list(csv.DictReader(f))
    table = {n: np.array([float(row[n]) for row in rows])
             for n in ("stretch", "thickness", "area_m2")}  # fmt: skip
    assert sorted(set(table["stretch"])) == [1.0, 4.0]
    # A film that is stretched 4 times is 16 times thinner: its gain of area at a voltage is larger.
    gain = table["area_m2"] / (np.pi * (4e-3 * table["stretch"]) ** 2) - 1
    thick = table["thickness"] == 1e-3
    (little,), (much,) = (gain[thick & (table["stretch"] == stretch)] for stretch in (1.0, 4.0))
    assert much > 10 * little > 0
    assert "largest gain of area" in printed
    assert (out / "study.png").exists()
