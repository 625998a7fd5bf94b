"""The energy of viscous branches over one step of time, with the history at quadrature points."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import BoundBranch, Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm, Variation
from dea_fenicsx.scene.strain import cofactor

SMALLEST_SHARE_OF_TIME = 1e-13
"""Smallest step of time in units of a relaxation time.

A step of length 0, or a branch that never relaxes, keeps C_v.  The energy then is a quotient 0/0,
whose limit this share gives to 13 digits.
"""


class Viscous(EnergyTerm):
    """The incremental energy of Maxwell branches, whose stress is that at the end of a step.

    A step of length dt from the history H (C_n for backward Euler, a combination of C_n and
    C_(n-1) for BDF2) ends at C_v = unimodular part of (r C + H), with r = dt/tau, where

        W = 3 mu/(2 r) det(r C + H)^(1/3)

    is stationary.  So the stress is mu C_v^-1, and the tangent is symmetric.  In exactly
    incompressible regions mu ln J is taken off, so that the stress is 0 in the undeformed state.
    """

    name = "viscous"
    stored_as = "viscous"
    history = ("viscous",)

    def lives_on(self, kernel: Kernel) -> bool:
        return bool(kernel.branches)

    def density(self, at: MaterialPoint) -> Any:
        total: Any = 0
        for branch in at.kernel.branches:
            share = _share(at, branch)
            _, det = cofactor(share * at.strain.C + branch.tensor)
            total += branch.mu * (3 / (2 * share) * det ** (1 / 3))
            if at.kernel.is_incompressible:
                total -= branch.mu * ufl.ln(at.elastic_J)
        return _stiffness(at) * total

    def work(self, at: MaterialPoint, virtual: Variation) -> Any:
        """F S : virtual(F), S = sum of mu C_v^-1: a third of the work of the density's variation.

        It is the same but for rounding.
        """
        branches = at.kernel.branches
        stress: Any = ufl.zero(3, 3)
        for branch in branches:
            stress += branch.mu * _inverse_strain(at, branch)
        if not at.kernel.is_incompressible:  # there C is without the change of volume
            return _stiffness(at) * ufl.inner(stress, virtual(at.strain.C)) / 2
        own = ufl.inner(ufl.dot(at.elastic_F, stress), virtual(at.elastic_F))
        J = at.elastic_J
        return _stiffness(at) * (own - sum(b.mu for b in branches) * virtual(J) / J)

    def stored(self, at: MaterialPoint) -> Any:
        """The energy of the springs, mu/2 [tr(C C_v^-1) - 3], with C_v at the end of the step."""
        branches = at.kernel.branches
        return _stiffness(at) * sum(b.mu / 2 * (ufl.tr(_relative(at, b)) - 3) for b in branches)


def _share(at: MaterialPoint, branch: BoundBranch) -> Any:
    """Length of the step over the relaxation time at its temperature."""
    return branch.step * at.heated.rate + SMALLEST_SHARE_OF_TIME


def _factor(at: MaterialPoint) -> Any:
    """Factor of the temperature on the energy of a spring per volume of the mesh."""
    return at.heated.modulus * at.swelling


def _stiffness(at: MaterialPoint) -> Any:
    """The same with the factor from Pa to the unit of stress."""
    return at.per_stress * _factor(at)


def _inverse_strain(at: MaterialPoint, branch: BoundBranch) -> Any:
    """C_v^-1 of a branch at the end of a step: det(M)^(1/3) M^-1 with M = r C + H, symmetric."""
    M = _share(at, branch) * at.strain.C + branch.tensor
    a, b, c, d, e, f = (M[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    first = (b * c - f * f, e * f - d * c, d * f - e * b)
    power = (a * first[0] + d * first[1] + e * first[2]) ** (-2 / 3)
    x, y, z = (power * entry for entry in first)
    mixed = power * (d * e - a * f)
    return ufl.as_matrix([
        [x, y, z],
        [y, power * (a * c - e * e), mixed],
        [z, mixed, power * (a * b - d * d)],
    ])  # fmt: skip


def _relative(at: MaterialPoint, branch: BoundBranch) -> Any:
    """C C_v^-1 of a branch at the end of a step."""
    return ufl.dot(at.strain.C, _inverse_strain(at, branch))


def dissipation(at: MaterialPoint) -> Any:
    """Power that the dashpots take, per undeformed volume in units of stress per s, symbolic."""
    flowing = at.kernel.flowing
    total: Any = 0 if flowing is None else flowing.measures[1]
    for branch in at.kernel.branches:
        A = _relative(at, branch)
        square = ufl.tr(ufl.dot(A, A)) - ufl.tr(A) ** 2 / 3
        total += _factor(at) * branch.mu / (2 * branch.tau) * at.heated.rate * square
    return at.per_stress * total
