"""Virtual work of a spring on rigid parts, whose unknowns are constants of the whole device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.terms.base import Variation, WorkTerm
from dea_fenicsx.scene.springs import SpringForce
from dea_fenicsx.scene.table_law import TableLaw
from dea_fenicsx.scene.torsion import TorsionMoment
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

GAUSS_PLACES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss points on [-1, 1] for the energy of a force law; exact up to the degree 15."""


class SpringWork(WorkTerm):
    """f(d) virtual(d), d the elongation, spread evenly over the volume of the device.

    The force is a function of one elongation, so that its tangent is symmetric.

    Parameters
    ----------
    told
        The spring.
    parts
        The rigid parts by name.
    axes
        Names of the displacement components.
    scales
        The units.
    factor
        The factor of the ramp that strains it, a constant of the forms; None without one.

    Attributes
    ----------
    ramp, factor
        That ramp and its factor, or None.

    Raises
    ------
    InputError
        If a spring between two points has no length at the start, so that it has no direction.
    """

    name = "springs"
    stored_as = "springs"
    symmetric = True
    symmetric_at_once = True

    def __init__(
        self, told: SpringForce, parts: Mapping[str, RigidPart], axes: str, scales: Scales,
        factor: Any,
    ) -> None:  # fmt: skip
        self.ramp, self.factor = told.ramp, factor
        self._told, self._parts, self._axes, self._scales = told, parts, axes, scales
        self._per_volume: list[Any] = []
        self._start = np.zeros(0)
        if told.anchor is not None:
            self._start = parts[told.surface].centre - np.array(told.anchor) / scales.length
            if np.linalg.norm(self._start) < 1e-9:
                raise InputError(
                    f"The spring on {told.surface!r} has the length 0 at the start, so it has no "
                    "direction; move its anchor away from the centre of the part."
                )

    def settle(self, volume: float) -> None:
        for constant in self._per_volume:
            constant.value = 1 / volume

    def _share(self, at: MaterialPoint) -> Any:
        constant = at.constant(1.0)
        self._per_volume.append(constant)
        return constant

    def _moved(self, name: str, at: MaterialPoint) -> list[Any]:
        """Displacement of a part's centre, dimensionless, by axis."""
        part = self._parts[name]
        q, n = at.fields[f"rigid {name}"], len(part.shifts)
        given = [q] if not q.ufl_shape else [q[k] for k in range(n)]
        return [
            sum(float(s) * x for s, x in zip(part.shifts[:, a], given, strict=True) if s)
            for a in range(len(self._axes))
        ]  # fmt: skip

    def _elongation(self, at: MaterialPoint) -> Any:
        """In m."""
        told, length = self._told, self._scales.length
        moved = self._moved(told.surface, at)
        if told.axis is not None:
            a = self._axes.index(told.axis)
            along = moved[a] - (self._moved(told.to, at)[a] if told.to is not None else 0)
            return length * along - self._strained
        arms = [float(x) + u for x, u in zip(self._start, moved, strict=True)]
        start = float(np.linalg.norm(self._start)) * length
        return length * ufl.sqrt(sum(x * x for x in arms)) - start - self._strained

    @property
    def _shift(self) -> float:
        """By how much, in m, its length without force has grown at ramp factor 1."""
        told = self._told
        if told.length is None:
            return 0.0
        start = float(np.linalg.norm(self._start)) * self._scales.length if told.anchor else 0.0
        return told.length - start

    @property
    def _strained(self) -> Any:
        return 0.0 if self.factor is None else self.factor * self._shift

    def rate(self, at: MaterialPoint, virtual: Variation) -> Any:
        """Minus the derivative of its work by the factor of its ramp."""
        d = ufl.variable(self._elongation(at))
        slope = ufl.diff(self._told.law(d), d)
        unit = self._scales.force * self._scales.length
        return self._share(at) * slope * self._shift * virtual(self._elongation(at)) / unit

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        d = self._elongation(at)
        unit = self._scales.force * self._scales.length
        force = ufl.as_ufl(self._told.law(d))
        return self._share(at) * force * virtual(d) / unit

    def stored(self, at: MaterialPoint) -> Any:
        """The integral of the force from 0 to the elongation."""
        d, law = self._elongation(at), self._told.law
        unit = self._scales.force * self._scales.length
        if isinstance(law, TableLaw):
            work = law.energy(d)
        else:
            places = zip(GAUSS_PLACES, GAUSS_WEIGHTS, strict=True)
            work = sum(float(w / 2) * law(float((1 + x) / 2) * d) for x, w in places) * d
        constant = self._share(at)
        constant.value = self._per_volume[0].value
        return constant * work / unit


class TorsionWork(SpringWork):
    """The same of a torsional spring: m(d) virtual(d), with the moment m at the angle d."""

    def _elongation(self, at: MaterialPoint) -> Any:
        """The angle in rad."""
        told = self._told
        turned = self._turned(told.surface, at)
        return turned - (0 if told.to is None else self._turned(told.to, at)) - self._strained

    def _turned(self, name: str, at: MaterialPoint) -> Any:
        """The angle by which a part has turned about the axis of the spring."""
        part = self._parts[name]
        q, n = at.fields[f"rigid {name}"], len(part.shifts)
        assert self._told.axis is not None
        return q[n + ("xyz".index(self._told.axis) if part.turning.count == 3 else 0)]


def spring_terms(
    springs: Sequence[SpringForce], parts: Sequence[RigidPart], axes: str, scales: Scales,
    mesh: Any,
) -> list[SpringWork]:  # fmt: skip
    """The term of each spring on rigid parts.  Springs on one ramp share its factor."""
    named = {part.name: part for part in parts}
    ramps = dict.fromkeys(told.ramp for told in springs if told.ramp)
    factors = {ramp: dolfinx.fem.Constant(mesh, 0.0) for ramp in ramps}
    return [
        (TorsionWork if isinstance(told, TorsionMoment) else SpringWork)(
            told, named, axes, scales, factors[told.ramp] if told.ramp else None
        )
        for told in springs
    ]
