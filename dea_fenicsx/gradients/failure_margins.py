"""The margins of failures at one point of the material, as functions that can be derived.

A principal value is stationary in its direction.  So its derivative is that of

    s = c . (F^T sigma F) c / |F c|^2,     or of     |F c|,

where the direction c of the undeformed material stays as it is at the state.  Where two principal
values are equal, a change may part them, and the smaller one has no derivative.  Then the margins
of three directions are given, which change alike only if the two values stay equal.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.gradients.functionals import Functional
from dea_fenicsx.measure.failures import (
    ElectricalBreakdown,
    Gauge,
    LossOfTension,
    StretchLimit,
    WorstPoint,
)
from dea_fenicsx.model.flowing_branches import quadrature_space
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

DOUBLE_VALUE_TOLERANCE = 1e-6
"""Two principal values count as one double value if their difference, in their unit, is smaller."""


class PointMargin:
    """The margin of a failure at the point where it is least, as functions of integrals.

    Parameters
    ----------
    gauge
        The failure, bound to a problem in its present state.  Collective.

    Attributes
    ----------
    region
        Name of the region in which the point lies.
    functionals
        The margin, and those that must change as it does.
    """

    def __init__(self, gauge: Gauge) -> None:
        problem, worst = gauge.problem, gauge.worst_point()
        self.region = worst.region
        k = next(k for k, one in enumerate(problem.kernels) if worst.region in one.regions)
        chosen = dolfinx.fem.Function(quadrature_space(problem.scene, ()))
        if worst.is_here:
            chosen.x.array[worst.cell * len(problem.forms.quadrature) + worst.point] = 1.0
        whole = problem.forms.integral(k, chosen)
        self.functionals = [
            Functional(
                [problem.forms.integral(k, margin * chosen), whole], lambda i, _: i[0] / i[1]
            )
            for margin in margins(gauge.failure, problem, k, worst)
        ]


@singledispatch
def margins(failure: Any, problem: Problem, k: int, worst: WorstPoint) -> list[Any]:
    """Margins of a failure near a point, symbolic, of which the first is that of the failure.

    Parameters
    ----------
    failure
        The failure.
    problem, k
        The problem, and the number of the kernel in which the point lies.
    worst
        The point.
    """
    raise InputError(f"The load of the failure {failure.name!r} has no derivatives.")


@margins.register
def _(failure: ElectricalBreakdown, problem: Problem, k: int, worst: WorstPoint) -> list[Any]:
    at = problem.states[k]
    field = at.constant(problem.scales.field) * at.true_field
    size = ufl.sqrt(ufl.dot(field, field))
    pulled = ufl.dot(ufl.transpose(at.total), field)
    area = at.J * size / ufl.sqrt(ufl.dot(pulled, pulled))
    law = problem.parameters.materials[worst.region].dielectric.breakdown_law()
    assert law is not None  # else the region is not watched
    strength = at.constant(law.field)
    if law.exponent:
        strength = strength * ufl.sqrt(area) ** at.constant(law.exponent)
    return [1 - at.constant(failure.safety) * size / strength]


@margins.register
def _(failure: LossOfTension, problem: Problem, k: int, worst: WorstPoint) -> list[Any]:
    at, F, stress = problem.states[k], worst.local.F[0, 0], worst.local.stress
    assert stress is not None
    sigma = stress[0, 0]
    if problem.scene.kinematics.is_membrane:
        basis = _across(worst.local.field[0, 0])
    else:
        axes = [a for a in range(3) if a != {"x": 0, "r": 0, "y": 1, "z": 2}[failure.normal]]
        basis = np.linalg.qr(F[:, axes])[0]
    values, turned = np.linalg.eigh(basis.T @ sigma @ basis)
    mu = problem.parameters.materials[worst.region].elastic.shear_modulus()
    unit = at.constant(problem.scales.stress / mu)
    directions = np.linalg.solve(F, basis @ turned).T

    def tension(c: np.ndarray) -> Any:
        along = ufl.dot(at.total, _vector(at, c))
        return unit * ufl.dot(along, ufl.dot(at.cauchy_stress, along)) / ufl.dot(along, along)

    return [tension(c) for c in _tied(directions, (values[1] - values[0]) / mu)]


@margins.register
def _(failure: StretchLimit, problem: Problem, k: int, worst: WorstPoint) -> list[Any]:
    at = problem.states[k]
    _, sizes, directions = np.linalg.svd(worst.local.F[0, 0])

    def rest(c: np.ndarray) -> Any:
        along = ufl.dot(at.total, _vector(at, c / np.linalg.norm(c)))
        return 1 - ufl.sqrt(ufl.dot(along, along)) / at.constant(failure.stretch)

    return [rest(c) for c in _tied(directions, sizes[0] - sizes[1])]


def _across(field: np.ndarray) -> np.ndarray:
    """Two directions in the deformed surface of a membrane, through which the field passes."""
    if not field.any():
        raise InputError(
            "The load of the loss of tension has no derivative here, because there is no field "
            "through the membrane at that load; derive at a voltage, however small."
        )
    return np.asarray(np.linalg.svd(field[None, :])[2][1:].T)


def _tied(directions: np.ndarray, apart: float) -> list[np.ndarray]:
    """The first direction; where the second has the same value, also that one and between them."""
    one, two = directions[:2]
    return [one] if apart > DOUBLE_VALUE_TOLERANCE else [one, two, one + two]


def _vector(at: Any, c: np.ndarray) -> Any:
    return ufl.as_vector([at.constant(float(x)) for x in c])
