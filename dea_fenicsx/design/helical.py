"""The analytic helical actuator as a function of its design, for the search of thesis 4.4.

Mended: pitch = 2 (elastomer + electrode) ties the thickness to outer radius and pitch angle, so the
pitch angle is no free variable here; its range is a constraint.  The operating point is a variable
instead: the contraction k that the voltage is to bring about (thesis eq 54).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.design.variables import Limit, Range, one_of
from dea_fenicsx.exact import Helicoid, stable_limit
from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.materials import Breakdown, IdealDielectric, Material, get
from dea_fenicsx.materials.base import EPSILON_0, is_isotropic
from dea_fenicsx.materials.stretches import taylor
from dea_fenicsx.support.errors import InputError

ENVELOPE: dict[str, Range] = {
    "outer_radius": (2e-3, 5e-3),
    "inner_radius": (1e-3, 4e-3),
    "pitch_angle_deg": (1.0, 10.0),
    "elastomer": (100e-6, 500e-6),
    "eps_r": (2.0, 10.0),
    "contraction": (1e-3, 0.6),
}
"""Thesis Table 4.1 (m, degrees, pure numbers), and the range of the contraction."""

OBJECTIVES = {
    "voltage": "min",
    "strain": "max",
    "displacement": "max",
    "blocked_force": "max",
    "energy_density": "max",
}
"""What may be sought, and in which direction."""

CONSTRAINTS: dict[str, tuple[str, str]] = {
    "breakdown": ("breakdown_margin", "least"),
    "pull_in": ("pull_in_margin", "least"),
    "thickness": ("elastomer", "least"),
    "height": ("height", "largest"),
}
"""Constraints by name: the quantity, and which value of it the number given is.

``breakdown`` and ``pull_in`` are safety factors on field and voltage, ``thickness`` the least
printable thickness of elastomer in m, ``height`` the largest height of the actuator in m.
"""

UNITS = {
    "outer_radius": "m", "inner_radius": "m", "elastomer": "m", "voltage": "V",
    "displacement": "m", "blocked_force": "N", "energy_density": "J_per_m3", "pitch": "m",
    "height": "m", "electrode_width": "m", "true_field": "V_per_m", "capacitance": "F",
}  # fmt: skip
"""Unit of each quantity that is no pure number; angles carry theirs in the name."""

TABLE_4_2 = {
    "outer_radius": 3.450e-3, "inner_radius": 2.210e-3, "elastomer": 139.3e-6, "eps_r": 6.954,
    "contraction": 20.2 / 139.3,
}  # fmt: skip
"""The thesis's optimum.  Printed with it: 8902.528 V, 20.2 um."""

EFFECTIVE_MU = 784.4e3
"""Shear modulus in Pa with which a neo-Hookean film takes Table 4.2's 8.90 kV for its 14.5 %.

An assumption: the Yeoh constants of the thesis are not printed.
"""


@dataclass(frozen=True)
class HelicalModel:
    """All quantities of a helical actuator, for arrays of designs at once.

    Parameters
    ----------
    material
        Elastic model and, for the breakdown constraint, breakdown field.  Its permittivity gives
        way to the design variable ``eps_r``; how it changes with stretch is kept.
    electrode, inset
        Thickness of the electrodes and their distance from the rims, in m.
    turns
        Turns; 2 turns - 1 layers are driven.  One turn has the one layer of thesis Table 4.2.

    Raises
    ------
    InputError
        For a compressible or unphysical material.
    """

    material: Material
    electrode: float = 50e-6
    inset: float = 0.0
    turns: int = 1

    def __post_init__(self) -> None:
        faults = self.material.faults()
        if faults:
            raise InputError(f"{type(self.material.elastic).__name__}: {faults[0]}.")
        if self.material.bulk_modulus is not None:
            raise InputError(
                "The analytic model takes incompressible materials only, but this one has a bulk "
                "modulus; use Material(elastic, electric) without it."
            )
        if not is_isotropic(self.material.elastic):
            raise InputError(
                "The analytic model takes isotropic rubbers only, but this material has fibres; "
                "take finite elements for it."
            )
        if self.material.is_dielectric:
            FilmField(self.material.dielectric)
            if not self.material.dielectric.is_linear:
                raise InputError(
                    "The analytic model scales voltages by the design variable eps_r, but the "
                    f"permittivity of {type(self.material.dielectric).__name__} changes with the "
                    "field; take one that changes with the stretch alone, or exact.Helicoid."
                )
        if not (math.isfinite(self.electrode) and self.electrode >= 0 <= self.inset):
            raise InputError("Electrode thickness and inset must be finite and not negative.")
        if not isinstance(self.turns, int) or self.turns < 1:
            raise InputError(f"turns is {self.turns!r}; it must be a whole number of at least 1.")

    @property
    def _unit(self) -> Material:
        """The material with permittivity 1, or with its own one if that changes with stretch.

        Voltages go as the inverse square root of the permittivity.
        """
        if self.material.is_dielectric and not self.material.dielectric.is_ideal:
            return self.material
        return replace(self.material, electric=IdealDielectric(1.0), name="")

    @property
    def pull_in_contraction(self) -> float:
        """Contraction at which the free layer pulls in, whatever its size and permittivity."""
        return stable_limit(self._unit)[0]

    def __call__(
        self,
        outer_radius: Any,
        inner_radius: Any,
        elastomer: Any,
        eps_r: Any,
        contraction: Any = None,
        voltage: Any = None,
    ) -> dict[str, Any]:
        """All quantities at a contraction, or at a voltage, by name; see `UNITS`.

        ``strain`` is that of the elastomer, ``displacement`` is the stroke of all driven layers.
        ``blocked_force`` is the axial force when the height is held.  It is eps (V/T)^2 times the
        electrode's area, and times 1 + (d ln eps/de_1 - d ln eps/de_3)/2, with the logarithmic
        stretches e, where the permittivity changes.  ``energy_density`` is the elastic energy that
        the field has stored, per volume of elastomer.  Values are NaN where there is no such state
        (beyond pull-in or lock-up).
        """
        if (contraction is None) == (voltage is None):
            raise InputError("The model needs either a contraction or a voltage.")
        given = (outer_radius, inner_radius, elastomer, eps_r)
        ro, ri, T, eps = (np.asarray(v, dtype=float) for v in given)
        # Rings without width are judged by their constraint; here they need only be computable.
        widest = np.maximum(ro - 2 * self.inset, 1e-9) * (1 - 1e-6)
        shape = Helicoid(ro, np.minimum(ri, widest), T, self.electrode, self.inset, self.turns)
        unit = self._unit
        root = np.sqrt(eps * EPSILON_0 / unit.dielectric.permittivity())
        if contraction is None:
            contraction = shape.contraction(unit, np.asarray(voltage) * root)
        k = np.asarray(contraction, dtype=float)
        volts = shape.voltage(unit, np.where(np.isnan(k), 0.0, k)) / root + 0 * k
        r1, _ = shape.electrode_radii
        field = shape.field(volts, r1, k)
        lam = 1 / np.sqrt(1 - k)
        law = _breakdown(self.material)
        e = np.log(np.stack([lam, lam, 1 - k]))
        energy, _, _ = taylor(self.material.elastic, e)
        electric = FilmField(unit.dielectric)
        growth = electric.strain_part(e)[0] / unit.dielectric.permittivity()
        held = electric.push(np.zeros((3, 1)))[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = {
                "voltage": volts,
                "strain": k,
                "displacement": shape.layers * k * T,
                "blocked_force": shape.pressure(eps, volts) * (held[0] - held[2]) * shape.flat_area,
                "energy_density": energy,
                "contraction": k,
                "pitch_angle_deg": np.degrees(shape.lead_angle(ro)),
                "pitch": shape.pitch,
                "height": shape.height,
                "electrode_width": ro - ri - 2 * self.inset,
                "true_field": field,
                "capacitance": shape.capacitance(eps * growth, k),
                "pull_in_margin": shape.pull_in_voltage(unit) / root / volts,
                "contraction_over_pull_in": k / self.pull_in_contraction,
            }
            if law is not None:
                found["breakdown_margin"] = law.at(lam) / field
        shapes = np.broadcast_shapes(*(np.shape(v) for v in found.values()))
        return {name: np.broadcast_to(v, shapes)[()] for name, v in found.items()}

    def thickness_at(self, outer_radius: Any, pitch_angle_deg: Any) -> Any:
        """Thickness of elastomer in m that a pitch angle demands: pi r_o tan beta - t_e.

        Not less than 1 um, which every envelope refuses, so that the rest can be computed.
        """
        slope = np.tan(np.radians(pitch_angle_deg))
        return np.maximum(np.pi * np.asarray(outer_radius) * slope - self.electrode, 1e-6)

    def bounds(
        self, constraints: Mapping[str, float], pitch_angle_deg: Range | None
    ) -> dict[str, Limit]:
        """Constraints by name as bounds on quantities, with those that every design must keep.

        These are: the state is stable, the electrode is at least 50 um wide, and the pitch angle
        lies in its range.
        """
        found: dict[str, Limit] = {
            "contraction_over_pull_in": (None, 1.0),
            "electrode_width": (50e-6, None),
        }
        if pitch_angle_deg is not None:
            found["pitch_angle_deg"] = pitch_angle_deg
        for name, value in constraints.items():
            quantity, kind = CONSTRAINTS[one_of(name, CONSTRAINTS, "constraint")]
            if not (isinstance(value, int | float | np.number) and math.isfinite(value)
                    and value > 0):  # fmt: skip
                raise InputError(f"The constraint {name!r} is {value!r}, but must be a number > 0.")
            if name == "breakdown" and _breakdown(self.material) is None:
                raise InputError(
                    "The constraint 'breakdown' needs the material's breakdown field; give it "
                    "electric=IdealDielectric(eps_r, breakdown=...) in V/m."
                )
            found[quantity] = (float(value), None) if kind == "least" else (None, float(value))
        return found

    def front(
        self, envelope: Mapping[str, Range] = ENVELOPE, points: int = 2001
    ) -> dict[str, np.ndarray]:
        """The exact front of least voltage against most strain, without named constraints.

        Permittivity at its upper bound, the thickness at max(T_min, pi r_o tan beta_min - t_e) for
        the smallest ring, any contraction up to pull-in.
        """
        ro, eps = envelope["outer_radius"][0], envelope["eps_r"][1]
        tied = self.thickness_at(ro, envelope["pitch_angle_deg"][0])
        T = max(envelope["elastomer"][0], tied)
        low, high = envelope["contraction"]
        k = np.linspace(low, min(high, self.pull_in_contraction), points)
        inner = min(envelope["inner_radius"][0], 0.9 * ro)
        found = self(ro, inner, T, eps, contraction=k)
        return {name: found[name] for name in ("voltage", "strain")}


def exact_hypervolume(front: Mapping[str, np.ndarray], reference: Mapping[str, float]) -> float:
    """Measure of what an exact front of voltage against strain dominates (a quadrature)."""
    V, k = front["voltage"], front["strain"]
    below = (k[0] - reference["strain"]) * (reference["voltage"] - V[0])
    return float(below + np.trapezoid(reference["voltage"] - V, k))


def material_of(given: Material | str) -> Material:
    """A material, or the preset of a name."""
    return get(given) if isinstance(given, str) else given


def _breakdown(material: Material) -> Breakdown | None:
    return material.dielectric.breakdown_law() if material.is_dielectric else None
