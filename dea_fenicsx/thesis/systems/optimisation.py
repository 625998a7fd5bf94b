"""Sections 4.4.3 to 4.4.5: the genetic algorithm, and what is printed of its optimum.

What follows from the activation model alone stands in `activation.py`; finite elements of the
optimum are in ``demos/design_search.py --fem``.
"""

from __future__ import annotations

import numpy as np

from dea_fenicsx.design.helical import EFFECTIVE_MU, ENVELOPE, TABLE_4_2, HelicalModel
from dea_fenicsx.exact import bonded_modulus
from dea_fenicsx.materials import IdealDielectric, Material, NeoHookean
from dea_fenicsx.thesis.table import MISSING, REPRODUCED, WRONG, Row, answer, computed

PRINTED, FE = 20.2e-6, 24.9e-6


def rows() -> list[Row]:
    n, o = "nsga2", "hdea_optimised"
    model = HelicalModel(Material(NeoHookean(EFFECTIVE_MU), IdealDielectric(1.0)))
    optimum = model(**TABLE_4_2)
    k = TABLE_4_2["contraction"]
    best = model.front()
    at_k = float(np.interp(k, best["strain"], best["voltage"]))
    ro, ri, T = (TABLE_4_2[name] for name in ("outer_radius", "inner_radius", "elastomer"))
    stiffer = [bonded_modulus(1.0, ro, ri, T, faces) / 3 for faces in (1, 2)]
    tied = (2 * (ENVELOPE["elastomer"][0] + 50e-6)) / (2 * np.pi * np.tan(np.radians(1.0)))
    return [
        answer(n, "fitness", "(N-rank+1)/sum", REPRODUCED,
               "a definition; the fitness values add to one"),
        answer(n, "pareto_front", None, MISSING,
               "plot only; Yeoh constants, settings of the algorithm and seed are missing"),
        answer(n, "method", "non-dominated sorting with crowding distance", WRONG,
               "three schemes are described as one; eq 62 adds volts to a pure number"),
        computed(n, "analytic_front.voltage_at_14p5_percent", at_k, "V",
                 "neo-Hookean 784.4 kPa (assumed), eps_r = 10, T = 100 um"),
        computed(n, "analytic_front.largest_r_o_at_100um", tied, "m",
                 "beyond it a pitch angle of 1 deg makes the layer thicker"),
        answer(o, "eps_r", ENVELOPE["eps_r"][1], WRONG,
               "V goes as eps_r^-1/2 and nothing speaks against the upper bound, 10; 6.9 in the "
               "text"),
        answer(o, "R_o_text", TABLE_4_2["outer_radius"], WRONG,
               "3.450 mm in Table 4.2; 345 um lie outside Table 4.1"),
        answer(o, "R_i_text", TABLE_4_2["inner_radius"], WRONG,
               "2.210 mm in Table 4.2; 221 um lie outside Table 4.1"),
        answer(o, "fe_displacement", None, MISSING,
               "Yeoh constants and electrode stiffness are missing; a free layer gives 20.2 um, "
               f"and flat plates bonded to one face or to both make it {stiffer[0]:.1f} or "
               f"{stiffer[1]:.1f} times stiffer, so neither contracts more"),
        answer(o, "fe_error", [FE / PRINTED - 1, 1 - PRINTED / FE], WRONG,
               "24.9 um against 20.2 um: of the analytic and of the finite-element value"),
        computed(o, "geometry.pitch_angle_deg_derived", float(optimum["pitch_angle_deg"]), "deg"),
        computed(o, "reference.pull_in_margin", float(optimum["pull_in_margin"]), "-",
                 "pull-in voltage of the free layer over 8.90 kV"),
    ]  # fmt: skip
