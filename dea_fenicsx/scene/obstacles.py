"""Rigid obstacles that a surface of the device may touch, with friction or without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from mpi4py import MPI
from ufl.corealg.traversal import unique_pre_traversal
from ufl.variable import Label

from dea_fenicsx.scene.condition import OnSurface, Setting, Support, Told, of_kind
from dea_fenicsx.scene.contact_declarations import UnilateralContact
from dea_fenicsx.scene.declarations import Declaration, HeldRigidMotions
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.own_functions import scalar_of, unknown_number
from dea_fenicsx.scene.part_declarations import RigidSurface
from dea_fenicsx.scene.shapes import Cylinder, Plane, Shape, Sphere
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, positive


@dataclass(frozen=True)
@in_si(displacement="m", tolerance="m")
class Obstacle(OnSurface, Support):
    """A rigid body that pushes a facet group away, and does not pull it.

    The gap g >= 0, the contact pressure p >= 0 and p g = 0 are part of the equilibrium: p is an
    unknown on the surface.  Only the named surface is kept out of the obstacle.

    With friction the tangential traction is at most the coefficient times p, and opposes the slip
    from one accepted state to the next.  Then a state depends on the path, its tangent is not
    symmetric, and its negative eigenvalues are not counted.

    Parameters
    ----------
    where
        Name of a facet group on the outside of the device.
    shape
        `Plane`, `Sphere`, `Cylinder`, or a function that takes the place of a point in m, a UFL
        vector with one component for each axis of the kinematics, and returns the gap in m, a UFL
        expression: positive outside of the obstacle, and near its surface the distance from it.
    displacement
        Displacement of the obstacle in m at ramp factor 1, one component for each axis; None for
        an obstacle that stays in its place.
    ramp
        Name of the ramp that moves it.
    tolerance
        Largest gap or penetration in m at a point that is pressed; None for a tenth of the width
        of the facets on the surface.  A state with a larger one is not accepted.  In the mean
        around each vertex the gap is closed to Newton's tolerance, whatever this value is.
    friction
        Coefficient of Coulomb friction; 0 for an obstacle without friction.
    carried_by
        Name of a rigid part with which the obstacle moves and turns, and which bears its force;
        `shape` is where it is in the undeformed device.
    """

    where: str
    shape: Shape
    displacement: tuple[float, ...] | None = None
    ramp: str = "obstacle"
    tolerance: float | None = None
    friction: float = 0.0
    carried_by: str | None = None

    @property
    def moves(self) -> bool:
        """Whether a ramp moves it."""
        return self.displacement is not None

    def check(self, scene: Setting) -> None:
        super().check(scene)
        axes = tuple(scene.kinematics.axes)
        if self.displacement is not None:
            if len(self.displacement) != len(axes):
                raise InputError(
                    f"The displacement of the obstacle at {self.where!r} has "
                    f"{len(self.displacement)} components, but must have {len(axes)}: one for each "
                    f"of {', '.join(axes)}."
                )
            for value in self.displacement:
                finite(value, f"The displacement of the obstacle at {self.where!r}")
            if not self.ramp:
                raise InputError("A ramp of Obstacle has an empty name; give it one.")
        if self.tolerance is not None:
            positive(
                self.tolerance, f"The tolerance of the obstacle at {self.where!r}",
                "a length > 0 in m",
            )  # fmt: skip
        finite(self.friction, f"The friction of the obstacle at {self.where!r}")
        if self.friction < 0:
            raise InputError(
                f"The friction of the obstacle at {self.where!r} is {self.friction:g}, but must be "
                "a coefficient of 0 or more."
            )
        if (self.friction or self.carried_by is not None) and scene.kinematics.overall:
            what = "friction=" if self.friction else "carried_by="
            raise InputError(
                f"{what} of the obstacle at {self.where!r} is not available in "
                f"{scene.kinematics.title}; take ThreeD(), PlaneStrain() or Axisymmetric()."
            )
        _check_outside(scene, self.where)
        _check_shape(self, scene.kinematics)

    def check_beside(self, told: Told) -> None:
        if self.carried_by is not None:
            _check_carrier(self, told)
        if of_kind(told, HeldRigidMotions):
            raise InputError(
                f"Obstacle at {self.where!r} and FreeBody() do not go together; hold the device by "
                "Fix or Clamp."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        ramp = self.ramp if self.moves else None
        kinematics, shape = scene.kinematics, self.shape
        if isinstance(shape, Plane | Sphere | Cylinder):
            shape = shape.in_space(kinematics.axis_of_rotation)
        along = (0, 2) if kinematics.axes == "rz" else tuple(range(len(kinematics.axes)))
        travel = np.zeros(3)
        travel[list(along)] = self.displacement or 0.0
        moved = tuple(travel.tolist())
        return [
            UnilateralContact(
                self.where, shape, along, moved, ramp, self.tolerance, float(self.friction),
                self.carried_by,
            )
        ]  # fmt: skip

    @property
    def moved_by(self) -> str | None:
        return self.ramp if self.moves else None


def _check_carrier(item: Obstacle, told: Told) -> None:
    """Raise InputError unless a rigid part can carry an obstacle."""
    what = f"The obstacle at {item.where!r} is carried by {item.carried_by!r}"
    parts = [one for _, one in of_kind(told, RigidSurface) if one.surface == item.carried_by]
    if not parts:
        raise InputError(
            f"{what}, which is no rigid part; add Rigid({item.carried_by!r}) to the supports."
        )
    if item.carried_by == item.where:
        raise InputError(
            f"{what}, so that it never moves against its surface; name another rigid part."
        )
    if len(parts[0].turns) > 1:
        raise InputError(
            f"{what}, which turns about several axes; give turns= of "
            f"Rigid({item.carried_by!r}) one axis, or none."
        )


def _check_outside(scene: Setting, surface: str) -> None:
    """Raise InputError unless a facet group lies on the outside of the device.  Collective."""
    device = scene.device
    topology, dim = device.mesh.topology, device.dim
    owned = topology.index_map(dim - 1).size_local
    outer = np.zeros(owned, dtype=bool)
    outer[dolfinx.mesh.exterior_facet_indices(topology)] = True
    mine = device.facets_by_surface[surface]
    inside = ~outer[mine[mine < owned]]
    if device.comm.allreduce(int(np.sum(inside)), op=MPI.SUM) > 0:
        raise InputError(
            f"The obstacle is at {surface!r}, which lies inside the device; name a surface on its "
            "outside."
        )


def _check_shape(item: Obstacle, kinematics: Kinematics) -> None:
    """Raise InputError unless the shape is one in these kinematics."""
    shape, axes = item.shape, kinematics.axes
    if isinstance(shape, Plane | Sphere | Cylinder):
        shape.check()
        rotational = kinematics.axis_of_rotation
        size = 2 if kinematics.dim == 2 else 3
        if len(shape.point) != size:
            raise InputError(
                f"The {type(shape).__name__} at {item.where!r} is given by {len(shape.point)} "
                f"coordinates, but must be given by {size} with this kinematics."
            )
        why = shape.misfit(rotational) if size == 2 else None
        if axes == "rtz" and not isinstance(shape, Cylinder):
            why = "the obstacle of a helical cell is a Cylinder about its axis"
        if why is not None:
            raise InputError(f"The obstacle at {item.where!r} does not fit: {why}.")
        if kinematics.axis_of_rotation and item.displacement and any(item.displacement[:-1]):
            raise InputError(
                f"The obstacle at {item.where!r} moves off the axis, which is not axisymmetric; "
                "give it a displacement along z alone."
            )
        return
    if not callable(shape):
        raise InputError(
            f"The shape of the obstacle at {item.where!r} is {shown(shape)}, but must be a Plane, "
            "a Sphere, a Cylinder or a function of the place."
        )
    if axes == "rtz":
        raise InputError(
            f"The obstacle at {item.where!r} does not fit: the obstacle of a helical cell is a "
            "Cylinder about its axis."
        )
    _check_function(item, len(axes))


def _check_function(item: Obstacle, dim: int) -> None:
    """Raise InputError unless a function returns a scalar of the place."""
    assert callable(item.shape)
    place = ufl.as_vector([unknown_number() for _ in range(dim)])
    name = f"The shape of the obstacle at {item.where!r} is a function that"
    found = scalar_of(item.shape, place, name, "the gap in m")
    if not any(isinstance(part, Label) for part in unique_pre_traversal(found)):
        raise InputError(
            f"{name} is the same at all places, but must be the gap in m, which depends on the "
            "place."
        )
