"""One call that checks an elastic law of one's own: what an energy must keep to be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.materials.base import Elastic, is_compressible, is_isotropic
from dea_fenicsx.materials.stretches import taylor
from dea_fenicsx.scene.strain import StrainOf
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

CHECKED_POINT_M = (3e-3, 4e-3, 7e-3)
"""The point in m at which the law is checked; its directions may differ from point to point."""
LARGEST_ERROR = 1e-6
"""Largest error of a stress at rest and under rotations, over the shear modulus."""


@dataclass(frozen=True)
class LawCheck:
    """What `check_law` has measured; all of it has passed.

    Attributes
    ----------
    at_rest
        Largest energy and stress of the undeformed state over the shear modulus.
    objectivity
        Largest change of the energy under a rotation of the deformed body, over the shear modulus.
    modulus
        Smallest stiffness at small strain in Pa: of all shears, in a foam of all strains.
    stress_order, tangent_order
        Orders of the Taylor remainders of the energy and of the stress; 2 where they are right.
    numeric
        Largest difference of the energy in finite elements and in the exact theory of films, over
        the shear modulus; None where a law has fibres, or is written for finite elements alone.
    """

    at_rest: float
    objectivity: float
    modulus: float
    stress_order: float
    tangent_order: float
    numeric: float | None


def check_law(law: Elastic) -> LawCheck:
    """Check an elastic law, such as one written with UFL in a script.

    Its energy must be 0 and free of stress at rest, the same after a rotation, of positive
    stiffness at small strain, with the shear modulus that it states, and smooth.  The check
    compiles the energy for one cell, and takes seconds.  Each rank does it alone.

    Parameters
    ----------
    law
        An elastic model.  Its `energy` may take ``s.C`` and ``s.F`` of its strain, symbolic 3 x 3
        matrices, beside the invariants.

    Raises
    ------
    InputError
        For the first thing that a law does not keep, in one sentence.
    """
    name = type(law).__name__
    if not isinstance(law, Elastic):
        raise InputError(
            f"check_law is given {shown(law)}, but needs an elastic model with energy, "
            "shear_modulus, spherical_slope, chain_margin and faults."
        )
    if faults := law.faults():
        raise InputError(f"{name}: {faults[0]}.")
    values, mu = _evaluation(law), law.shear_modulus()
    at_rest = _rest(name, law, values, mu)
    modulus = _stiffness(name, law, values, mu)
    rng = np.random.default_rng(5)
    turned, numeric, orders = 0.0, [], []
    for _ in range(3):
        F = _deformation(rng)
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        Q *= np.sign(np.linalg.det(Q))
        W = values(F)[0]
        turned = max(turned, abs(values(Q @ F)[0] - W) / mu)
        orders.append(_orders(values, F, rng.uniform(-1, 1, (3, 3)), mu))
        if (found := _by_numbers(law, F)) is not None:
            numeric.append(abs(found - W) / mu)
    if not turned < LARGEST_ERROR:
        raise InputError(
            f"{name} is not objective: a rotation of the deformed body changes its energy by "
            f"{turned:.2g} shear moduli; write it in C = F^T F or in its invariants."
        )
    stress_order, tangent_order = np.min(orders, axis=0)
    if not min(stress_order, tangent_order) > 1.9:
        raise InputError(
            f"{name} is not smooth: the remainders of its stress and tangent are of order "
            f"{stress_order:.2f} and {tangent_order:.2f}, but must be of order 2."
        )
    if numeric and not max(numeric) < LARGEST_ERROR:
        raise InputError(
            f"{name} has another energy in numbers than in symbols, by {max(numeric):.2g} shear "
            "moduli; use the functions of the strain, such as s.ln, in both."
        )
    return LawCheck(
        at_rest, turned, modulus, float(stress_order), float(tangent_order),
        max(numeric) if numeric else None,
    )  # fmt: skip


Values = Callable[..., tuple[float, np.ndarray, np.ndarray]]


def _evaluation(law: Elastic) -> Values:
    """A function (F, G) -> energy, stress P, and change of P with F along G."""
    mesh = dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, 1)
    F, G = (dolfinx.fem.Constant(mesh, np.eye(3)) for _ in range(2))
    place, length = ufl.as_vector(CHECKED_POINT_M), dolfinx.fem.Constant(mesh, 1.0)
    V = ufl.variable(F)
    energy = law.energy(StrainOf(V, 1, place, length))  # type: ignore[arg-type]
    P = ufl.diff(energy, V)
    T = ufl.diff(ufl.inner(P, G), V)  # symmetric, as the second derivative of an energy
    parts = [energy, *(M[i, j] for M in (P, T) for i in range(3) for j in range(3))]
    evaluate = compat.expression(ufl.as_vector(parts), np.array([[0.5]]))
    cell = np.zeros(1, dtype=np.int32)

    def values(at: np.ndarray, along: np.ndarray | None = None) -> Any:
        F.value[:] = at
        G.value[:] = 0.0 if along is None else along
        found = np.asarray(evaluate(mesh, cell)).ravel()
        return float(found[0]), found[1:10].reshape(3, 3), found[10:].reshape(3, 3)

    return values


def _deformation(rng: np.random.Generator) -> np.ndarray:
    """A deformation gradient of determinant 1, with strains of some 20 %."""
    F = np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))
    return F / np.cbrt(np.linalg.det(F))


def _rest(name: str, law: Elastic, values: Values, mu: float) -> float:
    """The energy and the stress at rest over the shear modulus."""
    W, P, _ = values(np.eye(3))
    left = P - law.spherical_slope() * np.eye(3)
    worst = max(abs(W), np.abs(left).max()) / mu
    if not worst < LARGEST_ERROR:
        kind = "0" if is_compressible(law) else f"spherical_slope() = {law.spherical_slope():g} Pa"
        raise InputError(
            f"{name} is not at rest in the undeformed state: its energy there is {W:g} Pa and must "
            f"be 0, and its stress differs by {np.abs(left).max():g} Pa from {kind}."
        )
    return float(worst)


def _stiffness(name: str, law: Elastic, values: Values, mu: float) -> float:
    """The smallest stiffness of small strains in Pa."""
    basis, slope = [], law.spherical_slope()
    for i, j in ((0, 1), (0, 2), (1, 2)):
        D = np.zeros((3, 3))
        D[i, j] = D[j, i] = 1 / np.sqrt(2)
        basis.append(D)
    basis += [np.diag([1, -1, 0]) / np.sqrt(2), np.diag([1, 1, -2]) / np.sqrt(6)]
    if is_compressible(law):
        basis.append(np.eye(3) / np.sqrt(3))
    changes = [values(np.eye(3), D)[2] + slope * D for D in basis]
    K = np.array([[np.sum(D * change) for D in basis] for change in changes]) / 2
    found = np.linalg.eigvalsh((K + K.T) / 2)
    if not found[0] > 0:
        raise InputError(
            f"{name} has a negative stiffness at small strain, {found[0]:g} Pa, so that the "
            "undeformed state is unstable; its constants must give a positive one."
        )
    shears = K[:5, :5].diagonal()
    if is_isotropic(law) and not np.abs(shears / mu - 1).max() < 1e-5:
        raise InputError(
            f"{name} states the shear modulus {mu:g} Pa, but its energy has {shears[0]:g} Pa at "
            "small strain; correct shear_modulus()."
        )
    return float(found[0])


def _orders(values: Values, F: np.ndarray, G: np.ndarray, mu: float) -> tuple[float, float]:
    """Orders of the Taylor remainders of the energy and of the stress about F along G."""
    W, P, T = values(F, G)
    left = []
    for h in (2e-3, 1e-3):
        W1, P1, _ = values(F + h * G)
        left.append((abs(W1 - W - h * np.sum(P * G)), np.linalg.norm(P1 - P - h * T)))
    first, second = np.array(left)
    # A remainder of rounding is that of a function whose further derivatives vanish.
    tiny = np.array([1e-12, 1e-12]) * mu
    orders = np.log2(np.maximum(first, tiny) / np.maximum(second, tiny))
    return tuple(np.where(second <= tiny, 2.0, orders))  # type: ignore[return-value]


def _by_numbers(law: Elastic, F: np.ndarray) -> float | None:
    """The energy by numbers in principal stretches; None where a law has no such state."""
    if not is_isotropic(law):
        return None
    try:
        W, _, _ = taylor(law, np.log(np.linalg.svd(F, compute_uv=False)))
    except AttributeError:  # it takes C or F, which principal stretches do not give
        return None
    return float(W)
