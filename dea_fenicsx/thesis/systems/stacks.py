"""Sections 4.3.2 and 4.3.3: the disk stack, the single layer, one layer of the helix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.exact import Branch, Film, bonded_ring_modulus, trace
from dea_fenicsx.materials import EPSILON_0, IdealDielectric, Material, NeoHookean, get
from dea_fenicsx.thesis.table import ASSUMED, MISSING, REPRODUCED, WRONG, Row, answer, computed

ELASTOMER, ELECTRODE = 0.5e-3, 0.05e-3
PRESSURES = (4e3, 10e3, 20e3, 30e3, 40e3)


def table_5_2() -> Branch:
    """A free layer of 0.5 mm with C10 and D1 of Table 5.2 under a pressure on its electrodes."""
    return trace(Film(get("vhb-thesis-table-5-2-C10-D1"), ELASTOMER, stress="pressure"))


def incompressible(mu: float) -> Branch:
    return trace(Film(Material(NeoHookean(mu), IdealDielectric(4.7)), ELASTOMER))


def contraction(branch: Branch, load: float, control: str) -> float:
    """Contraction of the thickness in the first state at a load."""
    state, _ = branch.states_at(load, control)[0]
    return float(1 - state.stretches[2])


def rows() -> list[Row]:
    layer = table_5_2()
    share = ELASTOMER / (ELASTOMER + ELECTRODE)
    (at30,) = layer.at_stretch(1 - 0.30 / share, axis=2)
    undeformed = float(layer.film.load("undeformed", np.log(at30.stretches), at30.maxwell))
    at57 = contraction(layer, 57e3, "undeformed") * share
    (at40,) = layer.at_stretch(0.6, axis=2)
    pull_in = layer.event("pull-in")
    assert pull_in
    eps = 4.7 * EPSILON_0
    d, s, h = "ddea", "sldea", "hdea_single_layer"
    found = [
        answer(d, "contraction_kovacs", 0.021 / 0.070, REPRODUCED, "21 mm of 70 mm"),
        answer(d, "contraction_length", 0.3 * 0.070, REPRODUCED),
        answer(d, "voltage_kovacs", None, MISSING,
               "quoted; film thickness and pre-stretch of the cited actuator are missing"),
        answer(d, "voltage_abaqus_30pct", undeformed, ASSUMED,
               f"for 30 % ({100 * at57:.1f} % at 57 kV), assuming layers of 0.5 mm elastomer and "
               "0.05 mm soft electrode that does not contract, C10 and D1 of Table 5.2, eps_r 4.7 "
               "and the undeformed thickness in eq 33; with the true field there is no "
               f"equilibrium at 57 kV (pull-in {pull_in.voltage / 1e3:.1f} kV)"),
        answer(d, "voltage_ratio", 57e3 / 10e3, ASSUMED,
               f"as a ratio of film thickness: an equi-biaxial pre-stretch {5.7**0.5:.2f} at equal "
               "true field"),
        answer(d, "free_layer_contraction_kovacs", None, MISSING, "quoted from the literature"),
        computed(d, "reference.pull_in_C10D1.contraction", 1 - pull_in.stretches[2], "-"),
        computed(d, "reference.pull_in_C10D1.V_0p5mm", pull_in.voltage, "V"),
        answer(s, "pressure_for_40pct", at40.maxwell, WRONG,
               "the unit must be kN/m^2: C10 and D1 of Table 5.2 under a live pressure contract by "
               f"{100 * contraction(layer, 700e3, 'pressure'):.1f} % at 700 kPa"),
        answer(s, "contraction_at_160", contraction(layer, 160e3, "pressure"), WRONG,
               "at 160 kPa; 160 Pa as printed gives "
               f"{100 * contraction(layer, 160.0, 'pressure'):.2f} %"),
        answer(s, "pressure_kovacs", 160e3, WRONG, "160 kPa (0.16 N/mm^2) is meant"),
        answer(s, "voltage", 50e-6 * np.sqrt(160e3 / eps), WRONG,
               "160 kPa over 50 um at eps_r 4.7; 700 kPa needs "
               f"{1e6 * 3e3 / np.sqrt(700e3 / eps):.0f} um; the thickness is missing"),
        computed(s, "reference.contraction_C10D1",
                 [contraction(layer, p, "pressure") for p in (160e3, 700e3)], "-",
                 "at 160 and 700 kPa"),
        computed(s, "reference.contraction_incompressible_mu500k",
                 [contraction(incompressible(5e5), p, "pressure") for p in (160e3, 700e3)], "-",
                 "at 160 and 700 kPa"),
        answer(h, "displacement_vs_pressure", None, MISSING,
               "plot only; inner radius, pitch, material and support are missing; the free "
               "homogeneous layer is in hdea_single_layer.png"),
        computed(h, "reference.bonded_stiffness",
                 [float(bonded_ring_modulus(1.0, 5e-3, 0.0, ELASTOMER, n)) / 3 for n in (1, 2)],
                 "-", "times that of a free layer, full disk of 5 mm radius with a flat plate "
                 "bonded to one face or to both: 1 + 2 S^2, at small strain"),
    ]  # fmt: skip
    for label, branch in (
        ("mu50k", incompressible(50e3)), ("mu73p7k", incompressible(73.7e3)), ("C10D1", layer)
    ):  # fmt: skip
        values = [contraction(branch, p, "pressure") for p in PRESSURES]
        found.append(computed(h, f"reference.contraction_{label}", values, "-",
                              "at 4, 10, 20, 30 and 40 kPa"))  # fmt: skip
    return found


def draw(out: Path) -> None:
    """Contraction over voltage and over pressure."""
    import matplotlib.pyplot as plt

    layer = table_5_2()
    fig, ax = plt.subplots()
    shrink = 100 * (1 - layer.stretches[2])
    keep = shrink < 60
    ax.plot(layer.load("undeformed")[keep] / 1e3, shrink[keep], label="undeformed thickness")
    ax.plot(layer.voltage[keep] / 1e3, shrink[keep], label="true field")
    ax.set_xlabel("voltage in kV")
    ax.set_ylabel("contraction of the elastomer in %")
    ax.legend()
    fig.savefig(out / "ddea.png", dpi=150)
    plt.close(fig)
    fig, ax = plt.subplots()
    for label, branch in (
        ("mu 50 kPa", incompressible(50e3)),
        ("mu 73.7 kPa", incompressible(73.7e3)),
        ("C10, D1 of Table 5.2", layer),
    ):
        keep = branch.M <= 40e3
        ax.plot(branch.M[keep] / 1e3, 100 * (1 - branch.stretches[2][keep]), label=label)
    ax.set_xlabel("pressure in kPa")
    ax.set_ylabel("contraction in %")
    ax.legend()
    fig.savefig(out / "hdea_single_layer.png", dpi=150)
    plt.close(fig)
