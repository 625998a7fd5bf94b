"""The energy of air, and what lets its cells follow the body."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.fields import SHAPE_OF_AIR
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm, Variation
from dea_fenicsx.scene.strain import change_of_cofactor

INITIAL_MODULUS = 1 + 3 * 3**0.5
"""Shear modulus of |F|^2/2 + |cof F|^3/J^2 + J^-2/2 in the undeformed state."""


def energy_of_shape(at: MaterialPoint) -> Any:
    """M without its second derivatives, see `ThirdMedium`; its initial shear modulus is 1."""
    F, A, J = at.F, at.cofactor, at.J
    size = ufl.inner(A, A)
    found = ufl.inner(F, F) / 2 + size**1.5 / J**2 + 1 / (2 * J**2)
    return (found - (2 + 3 * 3**0.5)) / INITIAL_MODULUS


def stress_of_shape(at: MaterialPoint) -> Any:
    """The derivative of `energy_of_shape` by F."""
    F, A, J = at.F, at.cofactor, at.J
    size = ufl.inner(A, A)
    turned = ufl.dot(ufl.dot(A, ufl.transpose(A)), A)
    squeezed = (size**1.5 - 1) * A - 3 * ufl.sqrt(size) * turned
    return (F + squeezed / J**3) / INITIAL_MODULUS


def change_of_stress(at: MaterialPoint, G: Any) -> Any:
    """The derivative of `stress_of_shape` in the direction G, a change of F; 3 x 3.

    It is the derivative of dM(F)[G] by F, too, since second derivatives of M are symmetric.
    """
    F, A, J = at.F, at.cofactor, at.J
    size, root = ufl.inner(A, A), ufl.sqrt(ufl.inner(A, A))
    squares, mixed = ufl.dot(A, ufl.transpose(A)), ufl.dot(A, ufl.transpose(G))
    turned = ufl.dot(squares, A)
    along = ufl.inner(A, G)
    both = ufl.dot(mixed, A) + ufl.dot(ufl.transpose(mixed), A) + ufl.dot(squares, G)
    share = 3 * (root * along - ufl.inner(turned, G) / root)
    by_A = share * A + (size * root - 1) * G - 3 * root * both
    by_J = 3 * ((size * root - 1) * along - 3 * root * ufl.inner(turned, G)) / J
    return (G + (change_of_cofactor(F, by_A) - by_J * A) / J**3) / INITIAL_MODULUS


class AirElasticity(EnergyTerm):
    """The modulus of the air times M, the energy of its shape.

    With smoothing s and the size h of a cell, M also has s h^2/2 |Grad Grad u|^2.
    """

    name = "air"
    stored_as = "elastic"

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.air is not None

    def density(self, at: MaterialPoint) -> Any:
        air = at.kernel.air
        assert air is not None
        shape = energy_of_shape(at)
        if air.smoothing is not None:
            bent = _second(at.fields["u"])
            shape = shape + air.smoothing / 2 * ufl.inner(bent, bent)
        return air.modulus * shape

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        air = at.kernel.air
        assert air is not None
        work = ufl.inner(stress_of_shape(at), virtual(at.F))
        if air.smoothing is not None:
            bent = _second(at.fields["u"])
            work = work + air.smoothing * ufl.inner(bent, virtual(bent))
        return air.modulus * work


class ShapeOfAir(EnergyTerm):
    """The variation of M by the multiplier eta, dM(u)[eta]; see `model.air`."""

    name = "shape of air"
    fields = (SHAPE_OF_AIR,)

    def density(self, at: MaterialPoint) -> Any:
        air, eta = at.kernel.air, at.fields[SHAPE_OF_AIR]
        assert air is not None
        work = ufl.inner(stress_of_shape(at), at.gradient_of_change(eta))
        if air.smoothing is not None:
            work = work + air.smoothing * ufl.inner(_second(at.fields["u"]), _second(eta))
        return work

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        air, eta = at.kernel.air, at.fields[SHAPE_OF_AIR]
        assert air is not None
        G = at.gradient_of_change(eta)
        work = ufl.inner(stress_of_shape(at), virtual(G))
        work = work + ufl.inner(change_of_stress(at, G), virtual(at.F))
        if air.smoothing is not None:
            smooth = ufl.inner(_second(at.fields["u"]), _second(eta))
            work = work + air.smoothing * virtual(smooth)
        return work

    def stored(self, at: MaterialPoint) -> None:
        """Nothing: it vanishes where the cells of the air follow the body."""


def _second(u: Any) -> Any:
    """The second derivatives of a displacement."""
    return ufl.grad(ufl.grad(u))
