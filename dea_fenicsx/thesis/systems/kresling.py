"""Sections 5.2.1 and 5.4.3: crease pattern, smooth fold and kinematics of the spiral box."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.origami import (
    INCH,
    POUND_FORCE,
    CreasePattern,
    Kresling,
    SmoothFold,
    least_fold_width,
    strokes,
)
from dea_fenicsx.thesis.errata import PrintedKresling
from dea_fenicsx.thesis.table import ASSUMED, MISSING, REPRODUCED, WRONG, Row, answer, computed

SIDE, EDGE, HEIGHT, PANEL = 2.125 * INCH, 2.75 * INCH, 1.65 * INCH, 0.02 * INCH  # Table 5.1
K = 17 * POUND_FORCE / INCH  # k = 17, unit assumed
READINGS = {
    "printed_chord_no_twist": PrintedKresling(SIDE, HEIGHT, K, HEIGHT, twist="held"),
    "corrected_chord_no_twist": Kresling(SIDE, HEIGHT, K, HEIGHT, twist="held"),
    "printed_chord_rigid_b_1p65": PrintedKresling(SIDE, HEIGHT, K, HEIGHT),
    "corrected_rigid_b_1p65": Kresling(SIDE, HEIGHT, K, HEIGHT),
    "corrected_rigid_b_2p75_h0_1p65": Kresling(SIDE, EDGE, K, HEIGHT),
    "corrected_rigid_b_2p75_h0_1p7455": Kresling(SIDE, EDGE, K),
}
"""Ways to read section 5.2.1: name to storey."""
FLAT = READINGS["corrected_rigid_b_2p75_h0_1p7455"]


def turn(storey: Kresling, height: float | None = None) -> float:
    """Twist in degrees from rest down to a height, by default the least."""
    found = storey.at(storey.lowest if height is None else height).twist - storey.rest_twist
    return float(np.degrees(found))


def rows() -> list[Row]:
    return [*_pattern(), *_fold(), *_kinematics(), *_readings()]


def _pattern() -> list[Row]:
    s, sheet = "kresling_crease_pattern", CreasePattern(SIDE, EDGE)
    sides = np.array([sheet.side, sheet.height, sheet.diagonal])
    units = ", ".join(f"{u:.4g}" for u in sides / INCH / [3, 4, 5])
    return [
        answer(s, "ratio", (sides / sides[0]).tolist(), WRONG,
               f"{SIDE / EDGE:.4f}, not 0.75; a unit would be {units} in"),
        answer(s, "diagonal", sheet.diagonal, REPRODUCED,
               f"{sheet.diagonal / INCH:.4f} in, rounded"),
        answer(s, "sheet", list(sheet.size), REPRODUCED, "8.5 x 11 in, folded in 4 x 4"),
        computed(s, "stress_free_states", [FLAT.strain_free[0][1], FLAT.strain_free[1][1]], "m",
                 "heights without strain, 2.75 in at no twist and 1.7455 in at 90 deg"),
        computed(s, "barrier", FLAT.barrier().strain, "-", "strain of the diagonal at 45 deg"),
        computed(s, "snap_forces", list(FLAT.snap_forces()), "N",
                 "over the barrier, pushed down and pulled up, one diagonal of 17 lbf/in"),
        computed(s, "contact_twist", np.degrees(FLAT.contact_twist), "deg",
                 "here all diagonals meet on the axis; further, panels go through each other"),
    ]  # fmt: skip


def _fold() -> list[Row]:
    s, fold = "smooth_fold", SmoothFold((0.0, 0.0), (3.0, 4.0), 0.05, (0.6, 0.6))
    width = 0.05 * float(np.hypot(SIDE, EDGE)) / 5
    actual = np.degrees(np.arctan2(EDGE, SIDE))
    found = [
        answer(s, "m_hat", [*fold.along.tolist(), 0.0], REPRODUCED,
               f"of a 3:4 cell; the actual 2.125 x 2.75 in lies at {actual:.2f} deg, not 53.13"),
        answer(s, "e3_x_m_hat", [*fold.across.tolist(), 0.0], REPRODUCED),
        answer(s, "w_unit", width, WRONG,
               f"a share of sides of 3 and 4, so {1e3 * width:.3f} mm in the actual cell; a panel "
               f"of 0.508 mm needs {1e3 * float(least_fold_width(PANEL)):.3f} mm to fold flat, "
               f"with 0.05 mm it may be {1e3 * 0.05e-3 * 2 / np.pi:.3f} mm thick"),
        computed(s, "length_p1p2", fold.length, "-", "long side, in units of the 3:4:5 cell"),
    ]  # fmt: skip
    for i, corner in enumerate(fold.corners):
        found.append(computed(s, f"p{i + 1}", corner.tolist(), "-", "in units of the 3:4:5 cell"))
    return found


def _kinematics() -> list[Row]:
    s = "kresling_kinematics"
    turns, held = READINGS["corrected_rigid_b_2p75_h0_1p65"], READINGS["corrected_chord_no_twist"]
    peaks = [r.peak("partial_force")[1] for r in (turns, FLAT, held)]
    energy = [r.peak()[1] / POUND_FORCE for r in (turns, FLAT)]
    printed = READINGS["printed_chord_no_twist"].peak()[1] / POUND_FORCE
    at = {dh: turn(turns, HEIGHT - dh * INCH) for dh in (0.7, 1.0, 1.4)}
    layered = strokes(1.65, 0.2, 0.2)["of_collapsed"]
    return [
        answer(s, "chords", "2 R sin((theta -+ pi/4)/2)", WRONG,
               "R sin is no chord of the circle; with it and b = 1.65 in rigid the storey stops at "
               f"{READINGS['printed_chord_rigid_b_1p65'].lowest / INCH:.3f} in"),
        answer(s, "torque", "-k R^2 sin(theta0 - dtheta + pi/4)(1 - c0/c)", WRONG,
               "right chords; the sine is lost and two signs are turned"),
        answer(s, "initial_height", FLAT.height, WRONG,
               f"flat cells close without strain at {FLAT.height / INCH:.4f} in; from 1.65 in they "  # type: ignore[operator]
               "would be strained by "
               f"{100 * float(FLAT.at(HEIGHT).strain):.2f} %"),
        answer(s, "initial_angle", np.degrees(FLAT.rest_twist + np.pi / 4), WRONG,
               "theta0 = 45 deg makes the edge vertical, 1.65 in long in a cell of 2.75 in; as the "
               "half of the twist of 90 deg it would fit"),
        answer(s, "collapse_deformation",
               [strokes(1.65, 1.65 / 8, 1.65 / 8)["of_collapsed"], layered], ASSUMED,
               "loss of height over the collapsed height, if that is 0.206 in, or 0.20 in (ten "
               "panels); over the initial height it is at most 1"),
        answer(s, "collapse_rotation", turn(turns), ASSUMED,
               "right chords, edges of 2.75 in, from 1.65 in to nothing; "
               + ", ".join(f"{v:.1f} deg after {dh:g} in" for dh, v in at.items())
               + f"; from the state without strain {turn(FLAT):.1f} deg.  Of the linkage: panels "
               "would go through each other all the way"),
        answer(s, "collapse_force", peaks, ASSUMED,
               "eq 72a with right chords and k in lbf/in: rigid edges from 1.65 in, from 1.7455 "
               f"in, no twist; by the energy of rigid edges {energy[0]:.2f} and {energy[1]:.2f} "
               f"lbf, by the printed chords {printed:.2f} lbf"),
        answer(s, "fig_5_2", None, MISSING, "ours in kresling_kinematics.png, each way to read it"),
    ]  # fmt: skip


def _readings() -> list[Row]:
    s, found = "kresling_kinematics", []
    for name, storey in READINGS.items():
        if not storey.is_solid and storey.twist == "free":
            found.append(computed(s, f"{name}.lowest", storey.lowest, "m", "stops at this height"))
            continue
        found.append(computed(s, f"{name}.F_energy_peak", storey.peak()[1], "N", "dU/dh"))
        if storey.twist == "free":
            partial = storey.peak("partial_force")[1] + 0.0
            note = "" if partial > 0 else "negative all the way from rest"
            found.append(computed(s, f"{name}.F_eq72a_peak", partial, "N", note))
            found.append(computed(s, f"{name}.collapse_twist", turn(storey), "deg"))
    return found


def draw(out: Path) -> None:
    """Figure 5.2: strain, twist and force over the loss of height, each way to read it."""
    from dea_fenicsx.origami.picture import draw_readings

    names = {
        "printed chords, no twist": "printed_chord_no_twist",
        "right chords, no twist": "corrected_chord_no_twist",
        "rigid edges, from 1.65 in": "corrected_rigid_b_2p75_h0_1p65",
        "rigid edges, from 1.7455 in": "corrected_rigid_b_2p75_h0_1p7455",
    }
    draw_readings({k: READINGS[n] for k, n in names.items()}, out / "kresling_kinematics.png")
