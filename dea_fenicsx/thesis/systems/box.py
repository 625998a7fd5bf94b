"""Section 5.3 and chapter 6: the box moved by its hinges, Table 5.3."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.origami import (
    INCH,
    POUND_FORCE,
    Box,
    blocked_force,
    strokes,
    table_of_angles,
    voltage_to_block,
)
from dea_fenicsx.thesis.systems.kresling import EDGE, FLAT, HEIGHT, SIDE
from dea_fenicsx.thesis.table import ASSUMED, REPRODUCED, WRONG, Row, answer, computed

VOLTS = np.array([0.0, 1e3, 2e3, 4e3])
ANGLES = np.radians([54.0, 50.0, 45.0, 31.0])
FORCES = np.array([0.35, 1.26, 4.175]) * POUND_FORCE
FILM = {"eps_r": 4.7, "thickness": 50e-6, "width": SIDE, "layers": 3}
LAW = table_of_angles(VOLTS, ANGLES)


def rows() -> list[Row]:
    s = "kresling_box_actuation"
    as_printed, rigid = Box(LAW, HEIGHT, "proportional"), Box(LAW, HEIGHT)
    lost = float(as_printed.stroke(4e3))
    collapsed = lost / 4
    shares = strokes(HEIGHT, HEIGHT - lost, HEIGHT / 8)
    wide = blocked_force(4e3, **FILM | {"width": EDGE})
    narrow = blocked_force(4e3, **FILM)
    power = float(np.polyfit(np.log(VOLTS[1:]), np.log(FORCES), 1)[0])
    need = FLAT.peak("partial_force")[1]
    gamma = np.degrees([float(np.arcsin(HEIGHT / EDGE)), float(FLAT.at(FLAT.height).panel_angle)])
    share_note = (
        f"{lost / INCH:.4f} in are {shares['of_start']:.3f} of the height and "
        f"{shares['of_end']:.3f} of what is left"
    )
    return [
        answer(s, "deformation", as_printed.stroke(VOLTS).tolist(), ASSUMED,
               "exactly h0 (1 - gamma/54 deg), so no result of its own; rigid panels go with the "
               "sine of gamma"),
        computed(s, "deformation_rigid_panel", rigid.stroke(VOLTS).tolist(), "m",
                 "h = h0 sin(gamma)/sin(54 deg)"),
        answer(s, "deformation_percent_4kV",
               [float(shares[n]) for n in ("of_start", "of_end", "of_collapsed")], WRONG,
               f"{share_note}; 400 % needs a collapsed height of {collapsed / INCH:.4f} in, 700 % "
               "(section 5.2.1) one of 0.2063 in: not one definition"),
        answer(s, "angle_0kV", gamma.tolist(), WRONG,
               "asin(1.65/2.75); flat cells at rest, 1.7455 in; neither is 54 deg"),
        answer(s, "enough_force", float(voltage_to_block(need, **FILM)), WRONG,
               f"voltage at which three films 2.125 in wide reach the {need:.2f} N of eq 72a; at "
               f"4 kV they reach {narrow:.2f} N"),
        answer("dea_hinge", "block_force_1_2_4kV", blocked_force(VOLTS[1:], **FILM).tolist(), WRONG,
               f"eps E^2 x 150 um x 2.125 in ({wide:.2f} N at 2.75 in and 4 kV); the printed ones "
               f"go with V^{power:.2f}, a blocked film with V^2"),
        answer("dea_hinge", "block_force_N", FORCES[-1], REPRODUCED, "4.175 lbf"),
        answer("dea_hinge", "kofod_single_layer", FORCES[-1] / 3, REPRODUCED,
               "a third of 4.175 lbf; of another film, so no confirmation"),
        computed("dea_hinge", "block_force_width", float(FORCES[-1] / (narrow / SIDE)), "m",
                 "width of three films that would give 4.175 lbf at 4 kV"),
        answer("spiral_box_full", "actuation_max", [1.0, 1 - 0.2 / 1.65], WRONG,
               "of the initial height: the most there can be, and down to ten panels of 0.02 in"),
        answer("spiral_box_full", "actuation_4kV", float(rigid.stroke(4e3)) / HEIGHT, WRONG,
               "of the initial height, rigid panels with the angles of Table 5.3"),
    ]  # fmt: skip
