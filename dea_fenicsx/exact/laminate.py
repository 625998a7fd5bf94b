"""Layers bonded on one another at small strain: curvature, strain and blocked force under voltage.

Classical laminate theory.  In each layer the stress along and across is

    s_x = Q (e_x + nu e_y) - p,   Q = E/(1 - nu^2),   e = e_0 + kappa z,

and the field's push p in the plane is eps E^2/2 (1 + nu/(1 - nu)): half from the field's own
stress and, since the faces are free, half (nu = 1/2) from its squeezing the film.  A
permittivity that changes with strain adds d ln eps/de_x to the first 1, and takes d ln eps/de_z off
the second.  Without loads
the resultants N and M vanish.  Two layers that are narrow give Timoshenko's bimetal (J. Opt. Soc.
Am. 11 (1925) 233), a thin layer on a thick one Stoney's formula (Proc. R. Soc. A 82 (1909) 172).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.states import STRESSES, Stress, without_time
from dea_fenicsx.materials import Material
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import one_of, positive

Across = Literal["held", "uniform", "free"]
ACROSS: tuple[Across, ...] = get_args(Across)
"""Across the bending direction: no strain (plane strain), one free strain for the whole section
(generalised plane strain), or free to bend too (a plate)."""


@dataclass(frozen=True)
@in_si(thickness="m")
class Ply:
    """One layer.

    Parameters
    ----------
    material
        Its material.
    thickness
        In m.
    driven
        Whether the whole voltage lies across it.
    """

    material: Material
    thickness: float
    driven: bool = False

    def __post_init__(self) -> None:
        positive(self.thickness, "Ply: thickness", "positive, in m")
        if self.driven and not self.material.is_dielectric:
            raise InputError("Ply: a driven layer must be dielectric; give it an IdealDielectric.")
        if self.driven:
            field = FilmField(self.material.dielectric)
            if self.material.bulk_modulus is not None and not field.law.is_linear:
                raise InputError(
                    f"Ply: {type(field.law).__name__} in a layer with a bulk modulus is not known "
                    "in closed form; leave bulk_modulus out, or take finite elements."
                )
        faults = self.material.faults()
        if faults:
            raise InputError(f"Ply: {faults[0]}.")
        without_time(self.material, "A ply")

    @property
    def poisson(self) -> float:
        """Poisson's ratio."""
        mu, kappa = self.material.elastic.shear_modulus(), self.material.bulk_modulus
        return 0.5 if kappa is None else (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))

    @property
    def plane_modulus(self) -> float:
        """E/(1 - nu^2) = 2 mu/(1 - nu) in Pa."""
        return 2 * self.material.elastic.shear_modulus() / (1 - self.poisson)

    def push(self, volts: Any, stress: Stress = "field") -> Any:
        """p in Pa; with stress ``"pressure"`` eps E^2 presses on the faces and nothing pulls."""
        if not self.driven:
            return np.zeros_like(np.asarray(volts, dtype=float))
        law, E = self.material.dielectric, np.abs(np.asarray(volts, dtype=float)) / self.thickness
        side = self.poisson / (1 - self.poisson)
        if stress == "pressure":
            if not law.is_ideal:
                raise InputError(
                    f"A laminate: the stress is 'pressure', but that of {type(law).__name__} is no "
                    'pressure on the electrodes; take stress="field".'
                )
            return law.permittivity() * E**2 * side
        field, at_rest = FilmField(law), np.zeros((3, 1))
        _, g, _ = field.strain_part(at_rest)
        pull, squeeze = (1 + g[0, 0]) / 2, (1 - g[2, 0]) / 2
        return field.maxwell(at_rest, E.reshape(1, -1)).reshape(E.shape) * (pull + side * squeeze)


@dataclass(frozen=True)
class Laminate:
    """Layers from the bottom up, bonded, flat without voltage.

    Parameters
    ----------
    plies
        The layers.
    across
        One of `ACROSS`.
    stress
        ``"field"`` or ``"pressure"``, see `Ply.push`.

    Raises
    ------
    InputError
        For no layers, an unknown choice, or unphysical constants.
    """

    plies: Sequence[Ply]
    across: Across = "held"
    stress: Stress = "field"
    _free: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.plies:
            raise InputError("Laminate: there are no plies; give at least one, from the bottom up.")
        one_of(self.across, ACROSS, "Laminate: across", f"in {ACROSS}")
        one_of(self.stress, STRESSES, "Laminate: stress", '"field" or "pressure"')
        # unknowns in the order e_x, kappa_x, e_y, kappa_y
        free = {"held": (0, 1), "uniform": (0, 1, 2), "free": (0, 1, 2, 3)}[self.across]
        object.__setattr__(self, "_free", free)

    @property
    def faces(self) -> np.ndarray:
        """Heights of the faces in m from the bottom, one more than layers."""
        return np.concatenate([[0.0], np.cumsum([p.thickness for p in self.plies])])

    def _stiffness(self) -> np.ndarray:
        """Resultants (N_x, M_x, N_y, M_y) by (e_x, kappa_x, e_y, kappa_y), moments about z = 0."""
        z, K = self.faces, np.zeros((4, 4))
        for k, ply in enumerate(self.plies):
            moments = [(z[k + 1] ** n - z[k] ** n) / n for n in (1, 2, 3)]
            part = np.array([moments[:2], moments[1:]])
            K += ply.plane_modulus * np.kron([[1, ply.poisson], [ply.poisson, 1]], part)
        return K

    def _push(self, volts: Any) -> np.ndarray:
        """The field's resultants, shape (4, ...)."""
        z = self.faces
        p = [ply.push(volts, self.stress) for ply in self.plies]
        N = sum(q * (z[k + 1] - z[k]) for k, q in enumerate(p))
        M = sum(q * (z[k + 1] ** 2 - z[k] ** 2) / 2 for k, q in enumerate(p))
        return np.array([N, M, N, M])

    def strains(self, volts: Any) -> np.ndarray:
        """Strain of the bottom face and curvature (1/m), along and then across; shape (4, ...).

        A positive curvature stretches the top.
        """
        push, free = self._push(si(volts, "V", "Laminate: volts")), list(self._free)
        found = np.zeros_like(push)
        stiffness = self._stiffness()[np.ix_(free, free)]
        found[free] = np.linalg.solve(stiffness, push[free].reshape(len(free), -1)).reshape(
            push[free].shape
        )
        return found

    def curvature(self, volts: Any) -> Any:
        """Curvature along in 1/m, positive where the top is the longer."""
        return self.strains(volts)[1][()]

    @property
    def bending_stiffness(self) -> float:
        """Moment per width and curvature in N, while nothing else is held."""
        free = list(self._free)
        compliance = np.linalg.inv(self._stiffness()[np.ix_(free, free)])
        return float(1 / compliance[1, 1])

    def blocked(self, volts: Any) -> tuple[Any, Any]:
        """Force (N) and moment about the bottom face (N m) per metre of width, strain and curvature
        along being held at 0; the film pushes, so both are positive."""
        push = self._push(si(volts, "V", "Laminate: volts"))
        rest = [i for i in self._free if i > 1]
        if not rest:
            return push[0][()], push[1][()]
        K = self._stiffness()
        across = np.linalg.solve(K[np.ix_(rest, rest)], push[rest].reshape(len(rest), -1))
        held = push[:2] - (K[np.ix_([0, 1], rest)] @ across).reshape(push[:2].shape)
        return held[0][()], held[1][()]


def timoshenko_curvature(strain: Any, thickness: Any, young: Any) -> Any:
    """Curvature in 1/m of two narrow layers that would differ in length by `strain`.

    6 strain (1 + m)^2/(h [3 (1 + m)^2 + (1 + m n)(m^2 + 1/(m n))]), m = t_1/t_2, n = E_1/E_2,
    h = t_1 + t_2.

    Parameters
    ----------
    strain
        Free strain of layer 2 less that of layer 1.
    thickness, young
        Thicknesses in m and Young's moduli in Pa of the two layers.
    """
    t1, t2 = thickness
    m, n = t1 / t2, young[0] / young[1]
    square = (1 + m) ** 2
    return 6 * strain * square / ((t1 + t2) * (3 * square + (1 + m * n) * (m * m + 1 / (m * n))))


def stoney_curvature(force: Any, thickness: Any, modulus: Any) -> Any:
    """Curvature in 1/m of a thick layer under a thin one that pushes along its face.

    6 force/(modulus thickness^2): force per width in N/m, the thick layer's modulus E (narrow),
    E/(1 - nu^2) (held across) or E/(1 - nu) (plate).
    """
    return 6 * force / (modulus * thickness**2)
