"""A film in a homogeneous state: what holds it in its plane, and its equilibrium equations.

Everything is written in the logarithms e of the principal stretches (1 and 2 in the plane, 3 along
the field): incompressibility is then linear, e1 + e2 + e3 = 0, and true stresses are first
derivatives of the energy.  With the Maxwell pressure M = eps E^2 (E the true field) equilibrium is

    dW/de - tau(e) - M J v = 0,

tau the Kirchhoff stresses of the mechanical loads, v = (1/2, 1/2, -1/2) for the stress of the
field, or (0, 0, -1) for a pressure on the electrodes alone.  In an incompressible film both say
the same.  Suo, Theory of dielectric elastomers, Acta Mech. Solida Sin. 23 (2010) 549.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.states import STRESSES, Stress
from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import is_compressible, is_isotropic
from dea_fenicsx.materials.stretches import margin, taylor
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import one_of, positive


@dataclass(frozen=True)
@in_si(stretch="")
class Held:
    """The stretch along this direction is kept."""

    stretch: float

    def widened(self, wider: float) -> Held:
        """The same of a film whose unloaded size is larger by a factor in all directions."""
        return Held(self.stretch / wider)


@dataclass(frozen=True)
@in_si(pascal="Pa")
class Dead:
    """A constant force: nominal stress in Pa, per undeformed area.  `Dead(0)` is a free side."""

    pascal: float

    def widened(self, wider: float) -> Dead:
        """The same of a film whose unloaded size is larger by a factor in all directions."""
        return Dead(self.pascal / wider**2)


@dataclass(frozen=True)
@in_si(pascal="Pa")
class TrueStress:
    """A constant true stress in Pa."""

    pascal: float

    def widened(self, wider: float) -> TrueStress:
        """The same of a film whose unloaded size is larger by a factor in all directions."""
        return self


Side = Held | Dead | TrueStress
FREE = Dead(0.0)

CONTROLS = {
    "voltage": np.array([1.0, 1.0, -1.0]),
    "charge": np.array([-1.0, -1.0, 1.0]),
    "pressure": np.array([1.0, 1.0, 1.0]),
    "undeformed": np.array([1.0, 1.0, 1.0]),
}
"""What is kept while a state is tested for stability, with d ln(M J)/de of an ideal dielectric.

``"voltage"`` or ``"charge"`` between the electrodes (an open circuit keeps its charge), a live
Maxwell ``"pressure"``, or a live pressure eps (V/T)^2 with the ``"undeformed"`` thickness T, as in
the thesis's chapter 4."""


@dataclass(frozen=True)
@in_si(thickness="m")
class Film:
    """A film between compliant electrodes, uniformly deformed.

    Parameters
    ----------
    material
        Its material, with a dielectric; compressible if it has a bulk modulus.
    thickness
        Undeformed thickness T in m.
    first, second
        What acts along the two directions of the plane: `Held`, `Dead` or `TrueStress`.
    stress
        ``"field"``: the full stress of the electric field.  ``"pressure"``: a pressure eps E^2 on
        the electrodes alone.  They differ only in a compressible film.

    Raises
    ------
    InputError
        For unphysical constants.
    """

    material: Material
    thickness: float
    first: Side = FREE
    second: Side = FREE
    stress: Stress = "field"

    def __post_init__(self) -> None:
        check_declared(self)
        faults = self.material.faults()
        if faults:
            raise InputError(f"{type(self.material.elastic).__name__}: {faults[0]}.")
        if not is_isotropic(self.material.elastic):
            self.material.elastic.check_axes()  # type: ignore[attr-defined]
        FilmField(self.material.dielectric_of("film's material"))
        positive(self.thickness, "The thickness", "a length > 0 in m")
        one_of(self.stress, STRESSES, "The stress", '"field" or "pressure"')
        law = self.material.dielectric
        if not law.is_ideal and self.stress == "pressure":
            raise InputError(
                f"The stress is 'pressure', but that of {type(law).__name__} is no pressure on the "
                'electrodes; take stress="field".'
            )
        if not law.is_linear and not self.incompressible:
            raise InputError(
                f"The film has a bulk modulus, but {type(law).__name__} is known exactly in "
                "incompressible films; leave bulk_modulus out, or take finite elements."
            )
        for name, side in (("first", self.first), ("second", self.second)):
            if not isinstance(side, Side):
                raise InputError(
                    f"The {name} direction is given {side!r}, but needs Held, Dead or TrueStress."
                )
            value = side.stretch if isinstance(side, Held) else side.pascal
            if not math.isfinite(value) or (isinstance(side, Held) and value <= 0):
                raise InputError(
                    f"The {name} direction is given {side!r}, but needs a finite stress or a "
                    "stretch > 0."
                )

    @property
    def permittivity(self) -> float:
        """Absolute permittivity in F/m, if that is one number; InputError otherwise."""
        return self.material.dielectric.constant_permittivity("This theory of films")

    @property
    def electric(self) -> FilmField:
        """Field and displacement of its dielectric."""
        return FilmField(self.material.dielectric)

    @property
    def sides(self) -> tuple[Side, Side]:
        return self.first, self.second

    @property
    def incompressible(self) -> bool:
        return self.material.bulk_modulus is None

    @property
    def v(self) -> tuple[float, float, float]:
        """Kirchhoff stress of the field over -M J, without that of a changing permittivity."""
        return (0.5, 0.5, -0.5) if self.stress == "field" else (0.0, 0.0, -1.0)

    def push(self, e: np.ndarray) -> np.ndarray:
        """Kirchhoff stress of the field over -M J, shape (3, ...)."""
        return self.electric.push(e, self.v)

    def freedoms(self, symmetric: bool) -> tuple[np.ndarray, np.ndarray]:
        """Offset e0 and basis B of e = e0 + B y; with `symmetric`, equal sides stay equal.

        Not so with fibres, which may lie along one side alone.
        """
        e0 = np.zeros(3)
        columns = []
        for k, side in enumerate(self.sides):
            if isinstance(side, Held):
                e0[k] = math.log(side.stretch)
            else:
                columns.append(np.eye(3)[k])
        alike = self.first == self.second and is_isotropic(self.material.elastic)
        if len(columns) == 2 and symmetric and alike:
            columns = [columns[0] + columns[1]]
        if self.incompressible:
            e0[2] = -e0[0] - e0[1]
            for c in columns:
                c[2] = -c[0] - c[1]
        else:
            columns.append(np.eye(3)[2])
        if not columns:
            raise InputError(
                "Both directions of an incompressible film are held, so nothing can move; leave at "
                "least one to a dead load or a true stress."
            )
        return e0, np.array(columns).T

    # ------------------------------------------------------------------ equilibrium

    def elastic(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, gradient and Hessian in e, the volumetric part included."""
        kappa, elastic = self.material.bulk_modulus, self.material.elastic
        if kappa is None or is_compressible(elastic):
            return taylor(elastic, e, along_axes=True)
        volume = e.sum(axis=0)
        J = np.exp(volume)
        W, R, H = taylor(elastic, e - volume / 3, along_axes=True)
        P = np.eye(3) - 1 / 3
        R = np.tensordot(P, R, 1)
        H = np.einsum("ij,jk...,kl->il...", P, H, P)
        W = W + kappa / 2 * (J - 1) ** 2
        return W, R + kappa * (J - 1) * J, H + kappa * (2 * J - 1) * J

    def applied(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Kirchhoff stresses of the mechanical loads, shape (3, ...), and their derivative."""
        J = np.exp(e.sum(axis=0))
        tau = np.zeros_like(e)
        slope = np.zeros((3, *e.shape))
        for k, side in enumerate(self.sides):
            if isinstance(side, Dead):
                tau[k] = side.pascal * np.exp(e[k])
                slope[k, k] = tau[k]
            elif isinstance(side, TrueStress):
                tau[k] = side.pascal * J
                slope[k, :] = tau[k]
        return tau, slope

    def tangent(self, e: np.ndarray, M: Any, control: str) -> np.ndarray:
        """Derivative of the equilibrium equations in e while the control is kept, (3, 3, ...)."""
        _, _, H = self.elastic(e)
        _, slope = self.applied(e)
        kept = self.electric.controls(e, M, known_control(control))
        outer = self.push(e)[:, None] * kept[None, :] + self.electric.strain_part(e)[2] / 2
        return H - slope - outer * (M * np.exp(e.sum(axis=0)))

    def true_stress(self, e: np.ndarray, M: Any) -> np.ndarray:
        """True in-plane stresses in Pa, field included, shape (2, ...)."""
        _, R, _ = self.elastic(e)
        if self.incompressible:
            push = self.push(e)
            return R[:2] - R[2] - (push[:2] - push[2]) * M
        return R[:2] / np.exp(e.sum(axis=0)) - self.push(e)[:2] * M

    # ------------------------------------------------------------------ loads and states

    def at(self, kelvin: float, start: float | None = None) -> Film:
        """The film at a temperature in K; its stretches then count from those without load there.

        The thickness and the sides of this film are those of the unloaded film at the temperature
        `start` in K, the reference of its material if None.  Kept sides and dead loads stay as they
        are while the film expands by s = `Material.thermal`'s stretch: a `Held(l)` becomes
        ``Held(l/s)``, a `Dead(p)` a ``Dead(p/s^2)``, and the thickness is s times as large.  So the
        stretch of this film is s times that of the new one.

        Raises
        ------
        InputError
            If the material has no `thermal`, or its data do not reach that far.
        """
        material = self.material.at(kelvin)
        thermal = self.material.thermal
        assert thermal is not None
        start = thermal.reference if start is None else si(start, "K", "The first temperature")
        thermal.check(start, "The first temperature")
        kelvin = si(kelvin, "K", "The temperature")
        wider = thermal.stretch(kelvin) / thermal.stretch(start)
        first, second = (side.widened(wider) for side in self.sides)
        return replace(
            self, material=material, thickness=wider * self.thickness, first=first, second=second
        )

    def prestretched(self, first: float, second: float) -> Film:
        """The same film with the sides not held under dead loads that give these stretches.

        Without voltage the film then rests at the two stretches; a viscous one does so after an
        infinite time, and from the start in a march with ``start="relaxed"``.
        """
        e = np.log([first, second, 1 / (first * second)])
        if not self.incompressible:
            e[2] = self._thickness_without_load(e)
        _, R, _ = self.elastic(e)
        tau = R[:2] - R[2] if self.incompressible else R[:2]
        made = [
            Held(s) if isinstance(side, Held) else Dead(float(t / s))
            for side, s, t in zip(self.sides, (first, second), tau, strict=True)
        ]
        return replace(self, first=made[0], second=made[1])

    def _thickness_without_load(self, e: np.ndarray) -> float:
        """Logarithm of the thickness stretch that leaves no stress along 3 (compressible)."""
        e = e.copy()
        for _ in range(50):
            _, R, H = self.elastic(e)
            step = R[2] / H[2, 2]
            e[2] -= step
            if abs(step) < 1e-15:
                break
        return float(e[2])

    def voltage(self, e: Any, M: Any) -> Any:
        """Voltage in V: V = E t = T lam3 E, with M = D E."""
        return self.thickness * np.exp(e[2]) * self.electric.field(e, M)

    def charge(self, e: Any, M: Any) -> Any:
        """Charge per undeformed area in C/m^2: D lam1 lam2, with M = D E."""
        return np.exp(e[0] + e[1]) * self.electric.displacement(e, M)

    def load(self, control: str, e: Any, M: Any) -> Any:
        """What a control imposes: V, C/m^2, Pa, or for ``"undeformed"`` V with p = eps (V/T)^2."""
        known_control(control)
        if control == "voltage":
            return self.voltage(e, M)
        if control == "charge":
            return self.charge(e, M)
        if control == "pressure":
            return M
        return self.thickness * self.electric.field(e, M)

    def margin(self, e: np.ndarray) -> np.ndarray:
        """Distance to chain lock-up, inf where the model has no limit."""
        if not self.incompressible and not is_compressible(self.material.elastic):
            e = e - e.sum(axis=0) / 3
        return margin(self.material.elastic, e)


def known_control(control: str) -> str:
    if control not in CONTROLS:
        raise InputError(f"There is no control {control!r}; choose one of {', '.join(CONTROLS)}.")
    return control
