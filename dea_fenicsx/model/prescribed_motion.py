"""The displacements that a scene prescribes at its nodes, and a check that they agree.

Supports, stretches and displacements become lists of nodes with one value each.  If two of them
prescribe the same component of the same node, both values must be equal at every load.  Otherwise
one of them would silently override the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.cell_quality import point
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.neighbours import extent
from dea_fenicsx.model.components import Component
from dea_fenicsx.scene.condition import Condition
from dea_fenicsx.scene.declarations import FixedDisplacement
from dea_fenicsx.scene.kinematics_base import Kinematics
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
    """The nodes on which a condition acts along one axis.

    `X` are their dimensionless positions, and `along` their coordinate along the axis; None for an
    axis that is no coordinate of the mesh.
    """

    item: Condition
    told: FixedDisplacement
    device: Device
    local: np.ndarray
    X: np.ndarray
    along: np.ndarray | None

    @property
    def axis(self) -> str:
        return self.told.axis

    @cached_property
    def span(self) -> tuple[float, float]:
        """Least and largest coordinate along the axis over all ranks.  Collective."""
        return (-np.inf, np.inf) if self.along is None else extent(self.device, self.along)


def prescriptions(
    declared: Iterable[tuple[Condition, FixedDisplacement]], device: Device,
    kinematics: Kinematics, motion: Sequence[Component],
) -> list[Prescription]:  # fmt: skip
    """All displacements that conditions give to facet groups.  Collective.

    Parameters
    ----------
    declared
        The displacements, each with its condition; prescribed ones come first.
    device, kinematics
        The device and the kinematics.
    motion
        The displacement components.

    Raises
    ------
    InputError
        If the centre of a stretch is not clear, if a stretch moves a plane surface although no
        other displacement along its axis is prescribed, or if two conditions give one node
        different displacements.
    """
    axes, coordinates = kinematics.axes, kinematics.coordinates
    surfaces = []
    for item, told in declared:
        part = motion[axes.index(told.axis)]
        local = part.on(device.dim - 1, device.facets_by_surface[told.surface])
        X = part.space.tabulate_dof_coordinates()[local]
        along = X[:, coordinates.index(told.axis)] if told.axis in coordinates else None
        surfaces.append(_Surface(item, told, device, local, X, along))
    found = []
    for s in surfaces:
        what = f"{type(s.item).__name__} on {s.told.surface!r}"
        X, metres, length = s.X, s.told.metres, device.length
        rounding = 0.0
        if callable(metres):
            values = np.array(metres(X * length), dtype=float) / length
            shifts = PLANE_TOLERANCE * np.eye(3)
            moved = [metres((X + shift) * length) / length - values for shift in shifts]
            largest = float(np.abs(moved).max(initial=0.0))
            rounding = device.comm.allreduce(largest, op=MPI.MAX)
        else:
            values = np.full(len(s.local), metres / length)
        if s.told.growth is not None:
            assert s.along is not None
            values += s.told.growth * (s.along - _centre(s, surfaces, kinematics))
            rounding = PLANE_TOLERANCE * abs(s.told.growth)
        a = axes.index(s.axis)
        found.append(Prescription(what, a, s.local, values, s.told.ramp, rounding))
    _check_agreement(found, device, kinematics, motion)
    return found


# ------------------------------------------------------------------- what a stretch is about


def _centre(stretched: _Surface, surfaces: list[_Surface], kinematics: Kinematics) -> float:
    """The coordinate, dimensionless, of the points that a stretch leaves in place along its axis.

    If the user gives no centre, that of a radial stretch is the axis of rotation.  That of any
    other stretch is the origin if every surface that is held along the axis reaches across the
    origin; otherwise it is the one plane in which all held surfaces lie.  Conditions on exactly the
    nodes of the stretched surface do not count.  Collective.
    """
    told, axis, device = stretched.told, stretched.axis, stretched.device
    given = told.about
    if told.growth == 0 and given is None:
        return 0.0  # nothing moves, whatever the centre is
    if axis == "r" and kinematics.axis_of_rotation:
        return (given or 0.0) / device.length
    others = [s for s in surfaces if s.axis == axis]
    span = max(s.span[1] for s in others) - min(s.span[0] for s in others)
    if span <= PLANE_TOLERANCE:
        raise InputError(
            f"The stretch on {told.surface!r} along {axis} moves a plane surface, but no other "
            f"surface is held or stretched along {axis}, so it would only shift the device; add "
            f'Fix(..., "{axis}") on a surface opposite, or a Stretch there.'
        )
    if given is not None:
        return given / device.length
    # A condition on the stretched nodes prescribes how they move, so they do not stay in place.
    held = [
        s for s in others
        if s.told.growth is None and not _same_nodes(s, stretched)
    ]  # fmt: skip
    low = max((s.span[0] for s in held), default=0.0)
    high = min((s.span[1] for s in held), default=0.0)
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


def _same_nodes(a: _Surface, b: _Surface) -> bool:
    """Whether two conditions act on the same nodes.  Collective."""
    same = np.array_equal(np.unique(a.local), np.unique(b.local))
    return a.device.comm.allreduce(same, op=MPI.LAND)


# ---------------------------------------------------------------------------- do they agree?


def _check_agreement(
    given: list[Prescription], device: Device, kinematics: Kinematics,
    motion: Sequence[Component],
) -> None:  # fmt: skip
    """Raise InputError if two conditions give one node different displacements.  Collective.

    Displacements agree if they are equal at every load: both 0, or equal on the same ramp.
    """
    first: tuple | None = None
    for axis, part in enumerate(motion):
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
    everyone = [f for f in device.comm.allgather(first) if f is not None]
    if everyone:
        _refuse(given, device, kinematics.axes, min(everyone))


def _refuse(given: list[Prescription], device: Device, axes: str, fault: tuple) -> None:
    """Raise the error that names both conditions, the axis, and the first node."""
    old, new, X, a, b = fault
    axis = axes[given[new].axis]

    def moved(item: Prescription, value: float) -> str:
        return f"{value * device.length:.6g} m on ramp {item.ramp!r}" if value else "0"

    where = point(np.array(X) * device.length, device.dim)
    raise InputError(
        f"{given[new].what} and {given[old].what} give the same nodes different displacements "
        f"along {axis}, the first at {where}: {moved(given[new], b)} and {moved(given[old], a)}; "
        f"leave one of the two out, or let one of them act along other axes than {axis}."
    )
