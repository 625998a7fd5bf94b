"""Changes of the undeformed shape: velocities of the nodes of the mesh.

A change of shape moves each point X of the undeformed device to X + s V(X), where the unknowns keep
their values at the nodes.  The derivative of a form by s is then exact, see `ufl.derivative` by the
coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.prescribed_motion import prescriptions
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known, one_of

THICKNESS = "thickness"
"""The word before the colon in ``"thickness:film"``."""

ON_PLANE = 1e-9
"""Distance from a plane that counts as rounding, in units of the device's size."""

ALIKE = 1e-6
"""Relative difference of two extents that counts as none."""

MOVED = 1e-4
"""Part of a unit of length by which nodes are moved to see how prescribed displacements change.

Those of a stretch are linear in the position, so that the step does not matter.
"""

Velocity = Callable[[np.ndarray], np.ndarray]
"""Velocity of points, shape (n, 3), per metre of the variable, from their positions in units of the
device's size, shape (n, 3)."""


def thickness(problem: Problem, region: str, axis: str | None) -> Velocity:
    """The velocity by which a layer grows thicker, in units of its own growth.  Collective.

    All that lies between the lowest and the highest plane of the region is stretched alike.  What
    lies below stays, and what lies above is shifted.

    Parameters
    ----------
    problem
        The problem.
    region
        The layer.
    axis
        The axis across the layer; None takes that along which it is thinnest.

    Raises
    ------
    InputError
        For an unknown region or axis, or if another region reaches across one of the planes.
    """
    device, kinematics = problem.scene.device, problem.scene.kinematics
    known(region, problem.scene.materials, "region", "the scene")
    spans = {name: _span(problem, name) for name in device.regions}
    low, high = spans[region]
    if axis is None:
        extents = (high - low)[: device.dim]
        a = int(np.argmin(extents))
        if np.sum(extents < (1 + ALIKE) * extents[a]) > 1:
            raise InputError(
                f"The region {region!r} is as thin along several axes, so that its thickness is "
                f"not clear; name the axis, as in '{THICKNESS}:{region}:"
                f"{kinematics.coordinates[-1]}'."
            )
    else:
        one_of(axis, tuple(kinematics.coordinates), f"The axis of the thickness of {region!r}")
        a = kinematics.coordinates.index(axis)
    below, above = float(low[a]), float(high[a])
    for name, (first, last) in spans.items():
        for plane in (below, above):
            if first[a] < plane - ON_PLANE and last[a] > plane + ON_PLANE:
                raise InputError(
                    f"The thickness of {region!r} along {kinematics.coordinates[a]} is no "
                    f"variable, because the region {name!r} reaches across its plane "
                    f"{kinematics.coordinates[a]} = {plane * device.length:.6g} m; name the "
                    f"axis across the layer, as in 'thickness:{region}:z', or a layer "
                    "between two planes."
                )

    def velocity(X: np.ndarray) -> np.ndarray:
        found = np.zeros_like(X)
        found[:, a] = np.clip((X[:, a] - below) / (above - below), 0.0, 1.0)
        return found

    return velocity


def _span(problem: Problem, region: str) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates of a region over all ranks.  Collective."""
    mesh, cells = problem.mesh, problem.scene.device.cells_of(region)
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)[cells].ravel()]
    everywhere = problem.comm.allgather(
        (x.min(axis=0), x.max(axis=0)) if len(x) else (np.full(3, np.inf), np.full(3, -np.inf))
    )
    return (
        np.min([low for low, _ in everywhere], axis=0),
        np.max([high for _, high in everywhere], axis=0),
    )


def check_shape(problem: Problem, name: str) -> None:
    """Raise InputError where a derivative by shape would miss a part of the scene."""
    scene, declared = problem.scene, problem.scene.declared
    parts = {
        "rigid parts": bool(problem.rigid),
        "a cavity": bool(problem.cavities),
        "obstacles": bool(problem.forms.contacts),
        "springs": bool(declared.springs),
        "a periodic cell whose mean strain is given": bool(declared.mean_gradients),
        "an electrode whose potential depends on the place": any(
            getattr(e, "taper", None) or e.fills_region for e in scene.electrodes
        ),
        "electrodes with a sheet resistance": bool(problem.forms.sheets),
        "forces on the two ends of a periodic cell, which count per height": (
            bool(declared.global_forces) and not name.endswith(":r")
        ),
        "the two ends of a helical period, whose distance the change would alter": (
            scene.kinematics.periodic_ends is not None
            and bool(scene.kinematics.lead(1.0))
            and not name.endswith(":r")
        ),
    }
    for what, there in parts.items():
        if there:
            raise InputError(
                f"{name!r} has no derivative here, because the scene has {what}; compare two "
                "runs on two meshes instead."
            )


def nodal_values(space: Any, velocity: Velocity) -> np.ndarray:
    """A velocity at the nodes of the space of coordinates, as its local values."""
    dim = space.mesh.geometry.dim
    return np.asarray(velocity(space.tabulate_dof_coordinates())[:, :dim].ravel())


def fixed_change(problem: Problem, velocity: Velocity) -> np.ndarray:
    """Change of the fixed values with the shape, over all local values.  Collective.

    Displacements that a stretch gives depend on where the nodes are.
    """
    if not _depend_on_place(problem):
        return np.zeros(problem.size)
    x = problem.mesh.geometry.x
    rest, step = x.copy(), MOVED * velocity(x)
    found = []
    try:
        for sign in (1.0, -1.0):
            x[:] = rest + sign * step
            found.append(_given(problem).values(problem.factors))
    finally:
        x[:] = rest
    return (found[0] - found[1]) / (2 * MOVED)


@contextmanager
def of_moved_nodes(problem: Problem, rest: np.ndarray) -> Iterator[None]:
    """Let displacements that are given as functions of the place be those of the mesh as it is.

    Collective.

    Parameters
    ----------
    problem
        The problem, the nodes of whose mesh have moved.
    rest
        The nodes' coordinates before.
    """
    if not _depend_on_place(problem):
        yield
        return
    base, x = problem.conditions.fixed_values.base, problem.mesh.geometry.x
    kept, moved = {name: values.copy() for name, values in base.items()}, x.copy()
    there = _given(problem).base
    x[:] = rest
    before = _given(problem).base
    x[:] = moved
    try:
        for name, values in base.items():
            values += there[name] - before[name]
        yield
    finally:
        for name, values in base.items():
            values[:] = kept[name]


@contextmanager
def moved_nodes(problem: Problem, velocity: Velocity, step: float) -> Iterator[None]:
    """Let all nodes of the mesh be moved by a velocity times a step.  Collective.

    The mass, and the displacements that depend on the place, are those of the moved mesh.  Whoever
    goes on with the problem must show a state again.
    """
    x, mass = problem.mesh.geometry.x, problem.mass
    rest = x.copy()
    x += step * velocity(rest)
    problem.mass = None
    try:
        with of_moved_nodes(problem, rest):
            yield
    finally:
        x[:], problem.mass = rest, mass


def distortion(problem: Problem, velocity: Velocity) -> float:
    """How fast a change of shape distorts the cells or moves the nodes.  Collective.

    It is the largest difference of velocities of two nodes of a cell over their distance, or the
    largest velocity in units of the device's size, whichever is more.
    """
    x = problem.mesh.geometry.x
    v, cells = velocity(x), compat.geometry_dofmap(problem.mesh)
    largest = float(np.max(np.abs(v), initial=0.0))
    for k in range(1, cells.shape[1]):
        one, other = cells, np.roll(cells, k, axis=1)
        apart = np.linalg.norm(x[one] - x[other], axis=-1)
        faster = np.linalg.norm(v[one] - v[other], axis=-1)
        largest = max(largest, float(np.max(faster / apart, initial=0.0)))
    return most(problem, np.array([largest]))


def _depend_on_place(problem: Problem) -> bool:
    """Whether the scene gives displacements as functions of the place."""
    declared = problem.scene.declared.displacements
    return any(told.growth is not None or callable(told.metres) for _, told in declared)


def _given(problem: Problem) -> FixedValues:
    """The displacements that the scene gives on the mesh as it is."""
    scene = problem.scene
    motion = problem.displacement
    values = FixedValues(problem.size, scene.ramps)
    for item in prescriptions(scene.declared.displacements, scene.device, scene.kinematics, motion):
        values.fix(motion[item.axis].dofs[item.local], item.values, item.ramp)
    return values


def most(problem: Problem, values: np.ndarray) -> float:
    """Largest size of local values over all ranks.  Collective."""
    mine = float(np.max(np.abs(values), initial=0.0))
    return float(problem.comm.allreduce(mine, op=MPI.MAX))
