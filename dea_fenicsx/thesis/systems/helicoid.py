"""Section 4.4.1: geometry, capacitance and pressure of the helicoid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.exact import Helicoid
from dea_fenicsx.thesis.table import REPRODUCED, WRONG, Row, answer, computed

ELECTRODE = 0.05e-3
RINGS = {  # outer and inner radius, elastomer thickness (m)
    "7_2_pitch_1p1": (7e-3, 2e-3, 0.5e-3),
    "6p7_2p3_pitch_1p1": (6.7e-3, 2.3e-3, 0.5e-3),
    "table_4_2": (3.45e-3, 2.21e-3, 139.3e-6),
    "5_1_10deg": (5e-3, 1e-3, np.pi * 5e-3 * np.tan(np.radians(10.0)) - ELECTRODE),
}


def ring(name: str) -> Helicoid:
    return Helicoid(*RINGS[name], ELECTRODE)


def rows() -> list[Row]:
    s = "helicoid_model"
    flat, steep, best = (ring(n) for n in ("7_2_pitch_1p1", "5_1_10deg", "table_4_2"))
    beta = np.degrees(flat.lead_angle(np.array([7e-3, 2e-3])))
    literal = flat.rectified()["area_literal"][0]
    excess = [h.area() / h.flat_area - 1 for h in (flat, steep)]
    inner = flat.rectified()["inner_length"][1]
    found = [
        answer(s, "lead_angle", "tan(beta)=P/(2 pi r_o)", REPRODUCED,
               f"true at r_o only: {beta[0]:.2f} deg there, {beta[1]:.2f} deg at r_i = 2 mm"),
        answer(s, "pitch", "2*(t_elastomer+t_electrode)", WRONG,
               f"1.1 mm = 2 (0.5 + 0.05) mm; with it Table 4.2 has a pitch angle of "
               f"{np.degrees(best.lead_angle(3.45e-3)):.4f} deg, the lower bound of Table 4.1"),
        answer(s, "length", "2 pi sqrt(r^2 + (P/2 pi)^2)", WRONG,
               "eq 39 holds with the angle of each radius; with the one of r_o the inner edge is "
               f"{-100 * inner:.2f} % short at 7/2/1.1 mm, "
               f"{-100 * steep.rectified()['inner_length'][1]:.0f} % at 5/1 mm and 10 deg"),
        answer(s, "area", "pi [r sqrt(r^2+c^2) + c^2 asinh(r/c)] from r_i to r_o", WRONG,
               f"the radii of eq 40 are not squared: {1e3 * literal:.1f} mm for "
               f"{1e6 * flat.area():.1f} mm^2; squared, it is the flat ring, too small by "
               f"{100 * excess[0]:.3f} % (7/2/1.1 mm) to {100 * excess[1]:.1f} % (5/1 mm, 10 deg)"),
        answer(s, "pressure", "eps V^2/t^2", REPRODUCED,
               "over cos^2 of the local lead angle, for thicknesses along the axis: "
               f"{100 * (1 / np.cos(np.radians(beta[1])) ** 2 - 1):.1f} % more at r_i, "
               f"{100 * flat.pitch_correction:.2f} % in the mean (7/2/1.1 mm)"),
        answer(s, "area_cancels", "-", WRONG,
               "the pressure contains neither radii nor pitch angle: three of the five design "
               "variables change neither voltage nor strain (up to the lead angle squared)"),
    ]  # fmt: skip
    for name in RINGS:
        h = ring(name)
        angles = np.degrees(h.lead_angle(np.array([h.outer_radius, h.inner_radius])))
        lengths = h.edge_length(np.array([h.outer_radius, h.inner_radius]))
        found += [
            computed(s, f"{name}.lead_angles", angles.tolist(), "deg", "outer, inner"),
            computed(s, f"{name}.lengths", lengths.tolist(), "m", "outer, inner"),
            computed(s, f"{name}.area", h.area(), "m^2"),
            computed(s, f"{name}.area_over_flat", h.area() / h.flat_area - 1, "-"),
            computed(s, f"{name}.capacitance_over_flat", h.pitch_correction, "-",
                     "2 c^2 ln(r_o/r_i)/(r_o^2 - r_i^2), exact"),
        ]  # fmt: skip
    return found


def draw(out: Path) -> None:
    """Errors of the rectified helicoid over the pitch angle."""
    import matplotlib.pyplot as plt

    beta = np.linspace(0.5, 10, 100)
    fig, ax = plt.subplots()
    for ro, ri, line in ((7e-3, 2e-3, "-"), (5e-3, 1e-3, "--")):
        layer = np.pi * ro * np.tan(np.radians(beta)) - ELECTRODE
        kept = layer > 0
        errors = Helicoid(ro, ri, layer[kept], ELECTRODE).rectified()
        for name, colour in (("inner_length", "C0"), ("area_two_angles", "C1"),
                             ("area_one_angle", "C2"), ("capacitance_flat", "C3")):  # fmt: skip
            label = f"{name.replace('_', ' ')}, {1e3 * ro:.0f}/{1e3 * ri:.0f} mm"
            ax.plot(beta[kept], -100 * errors[name][1], line, color=colour, label=label)
    ax.set_yscale("log")
    ax.set_ylim(1e-3, 50)
    ax.set_xlabel("pitch angle at the outer radius in degrees")
    ax.set_ylabel("short of the exact value by %")
    ax.legend(fontsize=8)
    fig.savefig(out / "helicoid_model.png", dpi=150)
    plt.close(fig)
