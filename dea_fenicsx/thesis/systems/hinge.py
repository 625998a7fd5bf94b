"""Section 5.3: the stacked hinge; what its layers, its films and its printed angles imply."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.exact import Film, Laminate, Ply, trace
from dea_fenicsx.exact.states import Stress
from dea_fenicsx.geometry import DEAHinge
from dea_fenicsx.materials import Material, get
from dea_fenicsx.thesis.table import MISSING, REPRODUCED, WRONG, Row, answer, computed

SETS = {"G_K": "vhb-thesis-table-5-2-G-K", "C10_D1": "vhb-thesis-table-5-2-C10-D1"}
VOLTS = np.array([1e3, 2e3, 4e3])
THIN = 2e-3
"""Length of the thin region in m; the thesis gives none."""


def layers(film: Material, stress: Stress = "pressure") -> Laminate:
    """The thin region, electrodes as soft as the film, PETG of 1.9 GPa; plane strain."""
    shape = DEAHinge()
    soft, petg = Material(film.elastic, None, film.bulk_modulus), get("petg")
    passive = Material(petg.elastic, None, petg.bulk_modulus)
    plies = [Ply(passive, shape.sheet_thin), Ply(soft, shape.electrode)]
    for _ in range(shape.films):
        plies += [Ply(film, shape.film, driven=True), Ply(soft, shape.electrode)]
    return Laminate([*plies, Ply(soft, shape.cover)], stress=stress)


def rows() -> list[Row]:
    s, shape = "dea_hinge", DEAHinge()
    films = {key: get(name) for key, name in SETS.items()}
    pull_in = {}
    for key, film in films.items():
        for stress in ("pressure", "field"):
            event = trace(Film(film, shape.film, stress=stress)).event("pull-in")
            assert event
            pull_in[key, stress] = event.voltage
    angle = {
        key: np.degrees(layers(film).curvature(VOLTS) * THIN) for key, film in films.items()
    }  # fmt: skip
    powers = np.polyfit(np.log(VOLTS), np.log([4.0, 9.0, 23.0]), 1)[0]
    return [
        answer(s, "total_thickness", shape.height + shape.sheet_thick - shape.sheet_thin,
               REPRODUCED, "with four electrodes, where the sheet is thick; 215 um where thin"),
        answer(s, "angle_1_2_4kV", None, MISSING,
               "moduli of PETG and electrodes, the length of the thin region and its place are "
               f"missing; the printed changes go with V^{powers:.2f}, layers at small strain with "
               "V^2; see the rows bending_2mm"),
        answer(s, "voltage_control", [pull_in["G_K", "pressure"], pull_in["C10_D1", "pressure"]],
               WRONG, "4 kV: a free 50 um film pulls in before, by a pressure eps E^2 at these "
               f"voltages, with the field's whole stress at {pull_in['G_K', 'field']:.1f} and "
               f"{pull_in['C10_D1', 'field']:.1f} V; bonded to its sheet a film bears more (see "
               "demos/dea_hinge.py)"),
        *(computed(s, f"bending_2mm.{key}", a.tolist(), "deg",
                   "2 mm of layers in plane strain under eps (V/T)^2 at 1, 2, 4 kV, linear; PETG "
                   "1.9 GPa, electrodes as soft as the film") for key, a in angle.items()),
        computed(s, "length_for_23_deg_at_4kV", float(THIN * 23 / angle["C10_D1"][2]), "m",
                 "thin region that bends by the printed 23 deg at 4 kV, same layers, C10 and D1"),
    ]  # fmt: skip
