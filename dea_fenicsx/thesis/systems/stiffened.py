"""Sections 5.5 and 5.6: the stiffened film, its bending, and what its missing data could be."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from dea_fenicsx.exact import Ply, bend
from dea_fenicsx.materials import IdealDielectric, Material, NeoHookean, get
from dea_fenicsx.thesis.systems.kresling import SIDE
from dea_fenicsx.thesis.table import MISSING, REPRODUCED, Row, answer, computed

ANGLE, VOLTS, ELEMENTS = np.radians(39.2), 6e3, 32
STRETCHES = (2.125, 2.75)
FILM = 1e-3 / (STRETCHES[0] * STRETCHES[1])
"""Thickness in m of a stretched film that was 1 mm, as for the curves of section 5.4."""


def bending(stiffener: float, eps_r: float = 4.7) -> float:
    """Angle in degrees by which the whole width bends at 6 kV, stiffened all over.

    Three films as one rectangle, as in the thesis, with the voltage across it; Ogden rubber; Mylar
    as an incompressible layer of the same plane modulus E/(1 - nu^2).
    """
    rubber = Material(get("vhb-thesis-ogden-2p125").elastic, IdealDielectric(eps_r))
    mylar = get("mylar-thesis")
    alike = Ply(Material(mylar.elastic, None, mylar.bulk_modulus), stiffener).plane_modulus / 4
    layers = [Ply(rubber, 3 * FILM, driven=True), Ply(Material(NeoHookean(alike)), stiffener)]
    return -float(np.degrees(bend(layers, VOLTS)[0].angle_per_length * SIDE))


def rows() -> list[Row]:
    s, plain = "kresling_stiffened_bending", "kresling_dea_stiffened"
    thin = {t: bending(t) for t in (25e-6, 50e-6, 100e-6)}
    fitting = brentq(lambda t: bending(t) - np.degrees(ANGLE), 40e-6, 70e-6, xtol=1e-10)
    curvature = ANGLE / SIDE
    note = (
        "exact finite bending at 6 kV across three films of 0.171 mm as one, free of tension, "
        "Mylar all over one face, Ogden column 2.125, eps_r 4.7"
    )
    return [
        answer(plain, "voltage_increase", None, MISSING,
               "plots only; the strip's thickness and side are missing.  A strip can only raise "
               "the voltage, at most to the rule of mixtures: see demos/stiffened_membrane.py"),
        answer(s, "bending_angle_6kV", None, MISSING,
               "thickness of film and stiffener, its side, the pre-stretch, eps_r and the support "
               "are missing; a stiffener in the middle plane would not bend the film at all"),
        answer(s, "mean_angle_per_element", float(np.degrees(ANGLE)) / ELEMENTS, REPRODUCED,
               "39.2 deg over 32 elements"),
        computed(s, "curvature_of_the_whole_width", float(curvature), "1/m"),
        computed(s, "tip_displacement_of_an_arc", float((1 - np.cos(ANGLE)) / curvature), "m"),
        *(computed(s, f"full_width_bending.mylar_{1e6 * t:.0f}um", a, "deg", note)
          for t, a in thin.items()),
        computed(s, "mylar_thickness_for_39p2_deg", float(fitting), "m",
                 note + "; one of many sets of data that would give 39.2 deg"),
    ]  # fmt: skip
