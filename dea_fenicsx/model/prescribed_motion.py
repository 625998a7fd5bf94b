"""The displacements that a scene prescribes at its nodes, and a check that they agree.

Supports, stretches and displacements become lists of nodes with one value each.  If two of them
prescribe the same component of the same node, both values must be equal at every load.  Otherwise
one of them would silently override the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.cell_quality import point
from dea_fenicsx.mesh.neighbours import extent
from dea_fenicsx.model.components import Component
from dea_fenicsx.scene.condition import Condition
from dea_fenicsx.scene.declarations import FixedDisplacement
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError

PLANE_TOLERANCE = 1e-8
"""A surface is plane if its coordinate varies by less than this share of the device's size."""

DISPLACEMENT_TOLERANCE = 1e-9
"""Two displacements whose relative difference is below this are equal but for rounding errors."""


@dataclass(frozen=True)
class Prescription:
    """The displacement along one axis that one condition of a scene gives to a facet group.

    Attributes
    ----------
    what
        The condition in words.
    axis
        Number of the displacement component.
    local
        Local degrees of freedom of the component's own space.
    values
        Their displacement at ramp factor 1, dimensionless; the same shape.
    ramp
        Name of the ramp, or None for a displacement that is 0 at every load.
    rounding
        Error of the values that comes from rounding of the nodes' coordinates.
    """

    what: str
    axis: int
    local: np.ndarray
    values: np.ndarray
    ramp: str | None
    rounding: float = 0.0


@dataclass(frozen=True)
class _Surface:
    """The nodes on which a condition acts along one axis, and the range of their coordinate."""

    item: Condition
    told: FixedDisplacement
    local: np.ndarray
    low: float
    high: float

    @property
    def axis(self) -> str:
        return self.told.axis


def prescriptions(scene: Scene, parts: list[Component]) -> list[Prescription]:
    """All displacements that a scene's conditions give to facet groups.  Collective.

    Parameters
    ----------
    scene
        The scene.
    parts
        Its displacement components.

    Raises
    ------
    InputError
        If the centre of a stretch is not clear, or if a stretch moves a plane surface although no
        other displacement along its axis is prescribed.
    """
    axes = scene.kinematics.axes
    surfaces = _surfaces(scene, parts)
    found = []
    for s in surfaces:
        a = axes.index(s.axis)
        what = f"{type(s.item).__name__} on {s.told.surface!r}"
        X = parts[a].space.tabulate_dof_coordinates()[s.local]
        metres, length = s.told.metres, scene.device.length
        rounding = 0.0
        if callable(metres):
            values = np.array(metres(X * length), dtype=float) / length
            shifts = PLANE_TOLERANCE * np.eye(3)
            moved = [metres((X + shift) * length) / length - values for shift in shifts]
            largest = float(np.abs(moved).max(initial=0.0))
            rounding = scene.device.comm.allreduce(largest, op=MPI.MAX)
        else:
            values = np.full(len(s.local), metres / length)
        if s.told.growth is not None:
            along = X[:, scene.kinematics.coordinates.index(s.axis)]
            values += s.told.growth * (along - _centre(scene, s, surfaces))
            rounding = PLANE_TOLERANCE * abs(s.told.growth)
        found.append(Prescription(what, a, s.local, values, s.told.ramp, rounding))
    return found


def _surfaces(scene: Scene, parts: list[Component]) -> list[_Surface]:
    """Each condition's surface along each of its axes; prescribed displacements come first."""
    device, axes = scene.device, scene.kinematics.axes
    found = []
    for item, told in scene.declared.displacements:
        part = parts[axes.index(told.axis)]
        local = part.on(device.dim - 1, device.facets_of(told.surface))
        low, high = -np.inf, np.inf
        if told.axis in scene.kinematics.coordinates:
            X = part.space.tabulate_dof_coordinates()[
                local, scene.kinematics.coordinates.index(told.axis)
            ]
            low, high = extent(device, X)
        found.append(_Surface(item, told, local, low, high))
    return found


# ------------------------------------------------------------------- what a stretch is about


def _centre(scene: Scene, stretched: _Surface, surfaces: list[_Surface]) -> float:
    """The coordinate, dimensionless, of the points that a stretch leaves in place along its axis.

    If the user gives no centre, that of a radial stretch is the axis of rotation.  That of any
    other stretch is the origin if every surface that is held along the axis reaches across the
    origin; otherwise it is the one plane in which all held surfaces lie.  Conditions on exactly the
    nodes of the stretched surface do not count.  Collective.
    """
    told, axis, length = stretched.told, stretched.axis, scene.device.length
    given = told.about
    if told.growth == 0 and given is None:
        return 0.0  # nothing moves, whatever the centre is
    if axis == "r" and scene.kinematics.axis_of_rotation:
        return (given or 0.0) / length
    others = [s for s in surfaces if s.axis == axis]
    span = max(s.high for s in others) - min(s.low for s in others)
    if span <= PLANE_TOLERANCE:
        raise InputError(
            f"The stretch on {told.surface!r} along {axis} moves a plane surface, but no other "
            f"surface is held or stretched along {axis}, so it would only shift the device; add "
            f'Fix(..., "{axis}") on a surface opposite, or a Stretch there.'
        )
    if given is not None:
        return given / length
    # A condition on the stretched nodes prescribes how they move, so they do not stay in place.
    held = [
        s for s in others
        if s.told.growth is None and not _same_nodes(scene.device.comm, s, stretched)
    ]  # fmt: skip
    low = max((s.low for s in held), default=0.0)
    high = min((s.high for s in held), default=0.0)
    if low <= PLANE_TOLERANCE and high >= -PLANE_TOLERANCE:
        return 0.0
    if abs(high - low) <= PLANE_TOLERANCE:
        return (low + high) / 2
    names = ", ".join(dict.fromkeys(repr(s.told.surface) for s in held))
    raise InputError(
        f"The stretch on {told.surface!r} along {axis} is about a surface that is held along "
        f"{axis}, but {names} {'reach' if high < low else 'spread'} over several "
        f"coordinates {axis}; give Stretch(..., about=...), the coordinate {axis} in m that "
        "stays in place."
    )


def _same_nodes(comm: MPI.Comm, a: _Surface, b: _Surface) -> bool:
    """Whether two conditions act on the same nodes.  Collective."""
    same = np.array_equal(np.unique(a.local), np.unique(b.local))
    return comm.allreduce(same, op=MPI.LAND)


# ---------------------------------------------------------------------------- do they agree?


def check_agreement(scene: Scene, parts: list[Component], given: list[Prescription]) -> None:
    """Raise InputError if two conditions give one node different displacements.  Collective.

    Displacements agree if they are equal at every load: both 0, or equal on the same ramp.

    Parameters
    ----------
    scene
        The scene.
    parts
        Its displacement components.
    given
        What is to be compared.
    """
    first: tuple | None = None
    for axis, part in enumerate(parts):
        size = len(part.dofs)
        owner, values, rounding = np.full(size, -1), np.zeros(size), np.zeros(size)
        ramps = np.array([p.ramp or "" for p in given] or [""], dtype=object)
        for k, new in enumerate(given):
            if new.axis != axis or not len(new.local):
                continue
            old = owner[new.local]
            a, b = values[new.local], new.values
            size_ = np.maximum(np.abs(a), np.abs(b))
            tolerance = DISPLACEMENT_TOLERANCE * size_
            tolerance += np.maximum(rounding[new.local], new.rounding)
            elsewhere = ramps[old] != ramps[k]
            apart = np.where(elsewhere, size_ > tolerance, np.abs(a - b) > tolerance)
            for i in np.flatnonzero((old >= 0) & apart):
                X = np.round(part.space.tabulate_dof_coordinates()[new.local[i]], 9) + 0.0
                found = (int(old[i]), k, tuple(X.tolist()), float(a[i]), float(b[i]))
                first = found if first is None else min(first, found)
            owner[new.local], values[new.local] = k, new.values
            rounding[new.local] = new.rounding
    everyone = [f for f in scene.device.comm.allgather(first) if f is not None]
    if everyone:
        _refuse(scene, given, min(everyone))


def _refuse(scene: Scene, given: list[Prescription], fault: tuple) -> None:
    """Raise the error that names both conditions, the axis, and the first node."""
    old, new, X, a, b = fault
    device, axis = scene.device, scene.kinematics.axes[given[new].axis]

    def moved(item: Prescription, value: float) -> str:
        return f"{value * device.length:.6g} m on ramp {item.ramp!r}" if value else "0"

    where = point(np.array(X) * device.length, device.dim)
    raise InputError(
        f"{given[new].what} and {given[old].what} give the same nodes different displacements "
        f"along {axis}, the first at {where}: {moved(given[new], b)} and {moved(given[old], a)}; "
        f"leave one of the two out, or let one of them act along other axes than {axis}."
    )
