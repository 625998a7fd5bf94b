"""Section 4.3.3: one half of the electrodes driven, so that the helix bends."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.exact import Helicoid, bending_curvature
from dea_fenicsx.materials import EPSILON_0, get
from dea_fenicsx.thesis.table import MISSING, REPRODUCED, WRONG, Row, answer, computed

SHAPE = (7e-3, 2e-3, 0.3e-3, 0.5e-3, 0.05e-3)
HEIGHT, EPS_R = 3.3e-3, 4.7


def rows() -> list[Row]:
    s = "hdea_bending"
    outer, inner, _, layer, electrode = SHAPE
    kappa = float(bending_curvature(*SHAPE))
    share = np.radians(4.2) / (kappa * HEIGHT)  # p/E
    material = get("vhb-thesis-table-5-2-C10-D1")
    mu, bulk = material.elastic.shear_modulus(), material.bulk_modulus
    assert bulk is not None
    young, confined = 9 * bulk * mu / (3 * bulk + mu), bulk + 4 / 3 * mu

    def volts(modulus: float) -> float:
        return float(layer * np.sqrt(share * modulus / (EPS_R * EPSILON_0)))

    pressure = EPS_R * EPSILON_0 * (117e3 / layer) ** 2
    angles = [np.degrees(kappa * HEIGHT * pressure / m) for m in (confined, young)]
    beta = np.degrees(Helicoid(outer, inner, layer, electrode).lead_angle(outer))
    return [
        answer(s, "bending_angle", None, MISSING,
               "the voltage printed contradicts the material; split line, load and support are "
               "missing"),
        answer(s, "contraction", np.radians(4.2) * 2 * outer, REPRODUCED,
               "4.2 deg over the diameter of 14 mm; 1 mm over it is "
               f"{np.degrees(np.arctan(1 / 14)):.2f} deg"),
        answer(s, "voltage", [volts(young), volts(confined)], WRONG,
               "linear theory, C10 and D1 of Table 5.2, eps_r 4.7: with electrodes as soft as the "
               "elastomer, and with its confined modulus K + 4G/3 (stiff electrodes); 117 kV is "
               f"{117e3 / layer / 1e6:.0f} MV/m, {pressure / 1e6:.2f} MPa and would bend by "
               f"{angles[0]:.1f} to {angles[1]:.1f} deg"),
        answer(s, "pitch_angle_claim", float(beta), WRONG,
               "with the pitch of 1.1 mm; 2.86 deg belong to 2.2 mm, and nothing makes the bending "
               "equal to the pitch angle"),
        computed(s, "reference.curvature_per_p_over_E_1_per_m", kappa, "1/m"),
        computed(s, "reference.angle_rad_per_p_over_E", kappa * HEIGHT, "rad"),
        computed(s, "reference.p_over_E_for_4p2deg", float(share), "-"),
    ]  # fmt: skip
