"""Section 4.4.2, the activation model with its equations mended, and the optimum of Table 4.2."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.exact import activation_voltage, elastic_stress
from dea_fenicsx.materials import EPSILON_0, IdealDielectric, Material, NeoHookean, Yeoh, get
from dea_fenicsx.thesis.table import ASSUMED, REPRODUCED, WRONG, Row, answer, computed

VOLTS, THICKNESS, STROKE, EPS_R = 8902.528, 139.3e-6, 20.2e-6, 6.954


def yeoh_h(model: Yeoh, lam: float, power: int) -> float:
    """2 lam^power [C10 + 2 C20 (I1 - 3) + 3 C30 (I1 - 3)^2] in an equi-biaxial state."""
    x = 2 * lam**2 + lam**-4 - 3
    return 2 * lam**power * (model.C10 + 2 * model.C20 * x + 3 * model.C30 * x * x)


def mended_h(model: Yeoh, lam: float) -> tuple[float, float]:
    """lam1 dW/dlam1 from the energy over 2 lam^2 [...] and over the printed 2 lam [...].

    From the true stress H1 - H3, in which H3 takes the same bracket with lam3.
    """
    stress = float(elastic_stress(Material(model), lam, lam)[0])
    bracket = yeoh_h(model, lam, 0) / 2
    right = 2 * bracket * (lam**2 - lam**-4)
    printed = 2 * bracket * (lam - lam**-2)
    return stress / right, stress / printed


def effective_modulus() -> float:
    """Neo-Hookean modulus in Pa that gives Table 4.2's stroke at its voltage."""
    k = STROKE / THICKNESS
    unit = Material(NeoHookean(1.0), IdealDielectric(EPS_R))
    return (VOLTS / float(activation_voltage(unit, THICKNESS, k))) ** 2


def rows() -> list[Row]:
    y, o = "yeoh_activation", "hdea_optimised"
    model = Yeoh(180.7e3, -16.7e3, 6.6e3)
    right, printed = mended_h(model, 1.2)
    k = STROKE / THICKNESS
    mu = effective_modulus()
    material = Material(NeoHookean(784.4e3), IdealDielectric(EPS_R))
    field = VOLTS / (THICKNESS - STROKE)
    fixed = Material(NeoHookean(mu), IdealDielectric(10.0))
    same_strain = float(activation_voltage(fixed, 100e-6, k))
    same_stroke = float(activation_voltage(fixed, 100e-6, STROKE / 100e-6))
    return [
        answer(y, "t1_pre", "lam1 dW/dlam1 - lam3 dW/dlam3", REPRODUCED,
               "the true stress that the energy gives; used for all exact states here"),
        answer(y, "H_k", "2 lam_k^2 [C10+2C20(I1-3)+3C30(I1-3)^2]", WRONG,
               "differentiation of the energy gives lam_k^2; at stretch 1.2 the stress from the "
               f"energy is {right:.6f} times that with lam^2, {printed:.3f} times that with lam"),
        answer(y, "maxwell", "eps V^2/t^2", WRONG, "eq 59 lacks the square: not a pressure"),
        answer(y, "in_plane_stress", "true stress held", ASSUMED,
               "eq 57 keeps the true stress, a dead load the nominal one; the same without "
               "pre-stretch"),
        answer(o, "voltage", float(activation_voltage(material, THICKNESS, k)), ASSUMED,
               f"with an effective neo-Hookean modulus of 784.4 kPa (this row needs {mu / 1e3:.2f} "
               "kPa), the squared eq 59 and the deformed thickness; the Yeoh constants are "
               "missing"),
        answer(o, "displacement", k * THICKNESS, REPRODUCED, "one layer"),
        answer(o, "strain", k, REPRODUCED, "20.2 um of 139.3 um"),
        answer(o, "true_field", field, REPRODUCED, "8902.528 V over 119.1 um"),
        answer(o, "maxwell_pressure", EPS_R * EPSILON_0 * field**2, REPRODUCED, ""),
        answer(o, "dominated", [same_strain, same_stroke], WRONG,
               "V for the same strain and for the same 20.2 um with T = 100 um, eps_r = 10: both "
               "in the search space, so Table 4.2 is not Pareto-optimal"),
        computed(o, "materials.implied_neo_hookean_mu", mu, "Pa"),
    ]  # fmt: skip


def draw(out: Path) -> None:
    """Voltage over contraction of a Yeoh silicone and of the effective neo-Hookean film."""
    import matplotlib.pyplot as plt

    k = np.linspace(0, 0.5, 200)
    fig, ax = plt.subplots()
    for label, material in (
        ("neo-Hookean, effective", Material(NeoHookean(784.4e3), IdealDielectric(EPS_R))),
        ("Yeoh, Elastosil 2030", get("elastosil-2030")),
    ):
        ax.plot(100 * k, activation_voltage(material, THICKNESS, k) / 1e3, label=label)
    ax.plot(100 * STROKE / THICKNESS, VOLTS / 1e3, "o", label="Table 4.2")
    ax.set_xlabel("contraction k in %")
    ax.set_ylabel("voltage in kV")
    ax.legend()
    fig.savefig(out / "yeoh_activation.png", dpi=150)
    plt.close(fig)
