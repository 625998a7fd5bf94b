"""Facet groups that observables name, and means over them."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device, one_sided
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known, one_of

type _Mean = tuple[np.ndarray, float]
"""Weights of the owned unknowns whose sum is the mean of u_a, and the mean of X_a."""

_means: weakref.WeakKeyDictionary[Problem, dict[Any, _Mean]] = weakref.WeakKeyDictionary()
"""Those that were found before.  They depend on the undeformed device and the kinematics alone,
which a problem keeps for as long as it lives."""


def group_names(where: str | tuple[str, ...]) -> tuple[str, ...]:
    """The names of one group or several, each once."""
    names = (where,) if isinstance(where, str) else tuple(dict.fromkeys(where))
    if not names:
        raise InputError("An observable names no group; give it at least one name.")
    return names


def label_of(where: str | tuple[str, ...]) -> str:
    """One group or several, for messages."""
    return "+".join(group_names(where))


def facets_once(device: Device, where: str | tuple[str, ...]) -> np.ndarray:
    """Each facet of one group or several once over all ranks, as `one_sided` shows them."""
    for name in group_names(where):
        known(name, device.surfaces, "facet group")
    pairs = [one_sided(device, name) for name in group_names(where)]
    return np.unique(np.concatenate(pairs), axis=0)


def _axis(problem: Problem, axis: str) -> int:
    axes = problem.scene.kinematics.axes
    one_of(axis, tuple(axes), "The axis")
    return axes.index(axis)


def displacement_dofs(
    problem: Problem, where: str | tuple[str, ...], axis: str
) -> np.ndarray:
    """Local degrees of freedom of a displacement component on facet groups, each once.

    Collective.
    """
    device = problem.scene.device
    part = problem.displacement[_axis(problem, axis)]
    found = []
    for name in group_names(where):
        known(name, device.surfaces, "facet group")
        found.append(part.on(device.dim - 1, device.facets_by_surface[name]))
    return part.dofs[np.unique(np.concatenate(found))]


def surface_mean(
    problem: Problem, where: str | tuple[str, ...], axis: str, projected: bool
) -> Callable[[], tuple[float, float]]:
    """Means of u_a and X_a over a facet group; weighted by the normal's component if projected.

    The mean of u is a scalar product with a vector assembled once.  Collective.
    """
    _axis(problem, axis)
    found = _means.setdefault(problem, {})
    key = (group_names(where), axis, projected)
    if key not in found:
        found[key] = _mean(problem, where, axis, projected)
    weights, position = found[key]

    def mean() -> tuple[float, float]:
        mine = float(weights @ problem.w.x.array[: problem.owned])
        return problem.comm.allreduce(mine, op=MPI.SUM), position

    return mean


def _mean(
    problem: Problem, where: str | tuple[str, ...], axis: str, projected: bool
) -> _Mean:
    """The weights of the mean of u_a over a facet group, and the mean of X_a.  Collective."""
    a = _axis(problem, axis)
    device = problem.scene.device
    degree = problem.scene.elements.quadrature_of_surfaces
    ds = measure(device, [facets_once(device, where)], degree, "ds")(0)
    x = ufl.SpatialCoordinate(problem.mesh)
    weight = problem.scene.kinematics.weight(x)
    kinematics = problem.scene.kinematics
    if projected:
        one_of(axis, tuple(kinematics.coordinates), "The axis")
    along = kinematics.coordinates.find(axis)  # -1 where the mesh does not go
    if projected:
        weight = weight * ufl.FacetNormal(problem.mesh)[along]
    v = problem.space.symbolic(Role.MOTION, ufl.TestFunction(problem.W))

    def total(integrand: Any) -> float:
        mine = dolfinx.fem.assemble_scalar(compat.compile_form(integrand * ds))
        return float(np.real(problem.comm.allreduce(mine, op=MPI.SUM)))

    vector = dolfinx.fem.assemble_vector(compat.compile_form(v[a] * weight * ds))
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    weights = vector.array[: problem.owned]
    # The shape functions add up to 1.
    area = problem.comm.allreduce(float(weights.sum()), op=MPI.SUM)
    if abs(area) < 1e-14:
        raise InputError(
            f"Facet group {label_of(where)!r} has no area facing {axis}; name a group that faces "
            "that axis."
        )
    position = total(x[along] * weight) / area if projected else 0.0
    return weights / area, position
