"""Rigid parts: nodes that move as one body, and what moves, turns and loads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.mesh.device import group_size
from dea_fenicsx.scene.attached import Attached, check_attached
from dea_fenicsx.scene.condition import (
    Load,
    Prescribed,
    Setting,
    Support,
    Told,
    of_kind,
)
from dea_fenicsx.scene.declarations import Declaration, FixedDisplacement
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.part_declarations import (
    RigidAngle,
    RigidForce,
    RigidMoment,
    RigidShift,
    RigidSurface,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known

AXES_OF_TURNS = {3: "xyz", 1: "z", 0: ""}
"""Axes about which a part may turn, by the number of rotations that a kinematics has."""


@dataclass(frozen=True)
@in_si(centre="m", kilograms="kg", moments="kg*m**2")
class Rigid(Support):
    """A facet group or a region whose nodes move as one body, by rotations of any size.

    The displacement of its centre and its rotation are unknowns: six in space, three in the plane,
    and one, the axial displacement, in an axisymmetric section.  `Displacement` and `Turn` on the
    same name prescribe them, and `Force`, `Moment` and any load on its surface act on them.

    A plane of symmetry may cut it: where `Fix` holds a plane surface along its normal, the centre
    stays in that plane, and the part turns about the normal alone.

    Parameters
    ----------
    where
        Name of a facet group or a region, no node of which is moved by anything else.
    held
        Axes along which its centre does not move, such as ``"xy"``.
    turns
        Axes about which it may turn: ``""`` for none, one axis, or None for all that there are.
        With one axis, that axis is fixed in space.
    along
        A direction along which alone its centre moves: a slanted guide.
    across
        The normal of a plane in which its centre moves: a slanted roller.
    centre
        The centre in m, undeformed; by default the mean of its nodes.
    kilograms
        Mass in kg of a body that is attached to the part, with its centre of mass at the centre.
        It counts in vibration and motion, beside what the density of the regions gives, and for
        `Gravity`.  In plane strain it is that on the kinematics' depth, in axisymmetry that of the
        full circle.
    moments
        Moments of inertia of the attached body about axes through its centre of mass, in kg m^2:
        those about x, y and z in space, one number in plane strain.  None for a point mass.
    """

    where: str
    held: str = ""
    turns: str | None = None
    along: tuple[float, ...] | None = None
    across: tuple[float, ...] | None = None
    centre: tuple[float, ...] | None = None
    kilograms: float = 0.0
    moments: tuple[float, ...] | float | None = None

    @property
    def rigid_part(self) -> str:
        return self.where

    def check(self, scene: Setting) -> None:
        check_part_name(self, scene)
        axes = tuple(scene.kinematics.axes)
        if scene.kinematics.periodic_ends is not None:
            raise InputError(
                f"Rigid on {self.where!r} is not available in a helical cell; take ThreeD(), "
                "PlaneStrain(depth), GeneralisedPlaneStrain(depth) or Axisymmetric()."
            )
        if any(axis not in axes for axis in self.held):
            raise InputError(
                f"Rigid on {self.where!r} is held along {self.held!r}, but must be held along "
                f"none or some of {', '.join(axes)}."
            )
        all_turns = _turns(scene.kinematics)
        if self.turns is not None and (
            len(self.turns) not in (0, 1, len(all_turns)) or set(self.turns) - set(all_turns)
        ):
            choices = f"about none, one or all of {', '.join(all_turns)}" if all_turns else "not"
            raise InputError(
                f"Rigid on {self.where!r} turns about {self.turns!r}, but must turn {choices}."
            )
        self._check_guides(scene.kinematics)
        check_attached(self.where, self.kilograms, self.moments, scene.kinematics)

    def _check_guides(self, kinematics: Kinematics) -> None:
        dim = len(kinematics.axes)
        told = [(n, v) for n in ("along", "across", "centre") if (v := getattr(self, n))
                is not None]  # fmt: skip
        for name, vector in told:
            if len(vector) != dim:
                raise InputError(
                    f"{name}= of Rigid on {self.where!r} has {len(vector)} components, but must "
                    f"have {dim}: one for each of {', '.join(kinematics.axes)}."
                )
            for value in vector:
                finite(value, f"{name}= of Rigid on {self.where!r}")
        guides = [name for name, _ in told if name != "centre"]
        for name in guides:
            if not kinematics.cartesian:
                raise InputError(
                    f"{name}= of Rigid on {self.where!r} is for three dimensions and plane strain "
                    "only; leave it out."
                )
            if not np.linalg.norm(getattr(self, name)) > 0:
                raise InputError(
                    f"{name}= of Rigid on {self.where!r} is 0 along all axes, but must be a "
                    "direction."
                )
        if len(guides) + bool(self.held) > 1:
            raise InputError(
                f"Rigid on {self.where!r} is guided by more than one of held=, along= and "
                "across=; give one of them."
            )

    def check_beside(self, told: Told) -> None:
        if len(_on(self.where, told, RigidSurface)) > 1:
            raise InputError(f"{self.where!r} is rigid twice; name it once.")
        for item, one in of_kind(told, FixedDisplacement):
            if one.surface == self.where:
                raise InputError(
                    f"{self.where!r} is rigid, and {type(item).__name__} acts on it, too; hold the "
                    f"part by Rigid({self.where!r}, held=...), or move it by Displacement."
                )
        shifts = _on(self.where, told, RigidShift)
        for axis in {one.axis for one in shifts}:
            if axis in self.held or self.along or self.across:
                raise InputError(
                    f"The rigid part {self.where!r} is guided, and Displacement moves it along "
                    f"{axis!r}, too; leave one of the two out."
                )
            if sum(one.axis == axis for one in shifts) > 1:
                raise InputError(
                    f"The rigid part {self.where!r} is moved twice along {axis!r}; give one "
                    "displacement."
                )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        turns = _turns(scene.kinematics) if self.turns is None else self.turns
        return [
            RigidSurface(
                self.where, self.held, turns, self.along, self.across, self.centre,
                Attached.of(self.kilograms, self.moments),
            )
        ]  # fmt: skip


@dataclass(frozen=True)
@in_si(radians="rad", about="")
class Turn(Prescribed):
    """Angle of a rigid part in rad at ramp factor 1, counter-clockwise; several turns count.

    In space the whole rotation is prescribed: by this angle about an axis through the centre.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    radians
        The angle.
    about
        The axis: ``"x"``, ``"y"``, ``"z"`` or a direction.
    """

    where: str
    radians: float
    ramp: str = "turn"
    about: str | tuple[float, float, float] = "z"

    def check(self, scene: Setting) -> None:
        check_part_name(self, scene)
        finite(self.radians, f"The angle of {self.where!r}")
        check_axis(self, scene.kinematics)

    def check_beside(self, told: Told) -> None:
        part = _check_part(self, self.where, told)
        if len(_on(self.where, told, RigidAngle)) > 1:
            raise InputError(f"{self.where!r} is turned twice; give one angle.")
        _check_may_turn(self, part, wholly=True)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [RigidAngle(self.where, self.radians, self.ramp, unit_vector(self.about))]


@dataclass(frozen=True)
@in_si(newton_metres="N*m", about="")
class Moment(Load):
    """Moment on a rigid part in N m at ramp factor 1, counter-clockwise.

    Its axis is fixed in space, so that a part that turns freely in space has no potential energy
    under it: there the work depends on the path, and the inertia counts for the symmetric part of
    the tangent.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    newton_metres
        The moment.
    about
        The axis: ``"x"``, ``"y"``, ``"z"`` or a direction.
    """

    where: str
    newton_metres: float
    ramp: str = "load"
    about: str | tuple[float, float, float] = "z"

    def check(self, scene: Setting) -> None:
        check_part_name(self, scene)
        finite(self.newton_metres, f"The moment on {self.where!r}")
        check_axis(self, scene.kinematics)

    def check_beside(self, told: Told) -> None:
        part = _check_part(self, self.where, told)
        if _on(self.where, told, RigidAngle):
            raise InputError(
                f"The moment on {self.where!r} has no effect, since its angle is prescribed; "
                "leave one of the two out."
            )
        _check_may_turn(self, part, wholly=False)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        about = unit_vector(self.about)
        return [RigidMoment(self.where, self.newton_metres, self.ramp, about)]


@dataclass(frozen=True)
@in_si(newtons="N")
class Force(Load):
    """Force in N on the centre of a rigid part, such as a weight; fixed in direction.

    In plane strain it acts on the kinematics' depth, in axisymmetry on the full circle.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    newtons
        Components at ramp factor 1, one for each axis.
    """

    where: str
    newtons: tuple[float, ...]
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        check_part_name(self, scene)
        axes = scene.kinematics.axes
        if len(self.newtons) != len(axes):
            raise InputError(
                f"The force on {self.where!r} has {len(self.newtons)} components, but must have "
                f"{len(axes)}: one for each of {', '.join(axes)}."
            )
        for value in self.newtons:
            finite(value, f"The force on {self.where!r}")
        if not scene.kinematics.cartesian and self.newtons[0]:
            raise InputError(
                f"The force on {self.where!r} has a radial component, which adds up to 0 around "
                "the axis; give 0 for it."
            )

    def check_beside(self, told: Told) -> None:
        _check_part(self, self.where, told)

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [RigidForce(self.where, tuple(map(float, self.newtons)), self.ramp)]


def check_part_name(item: Rigid | Turn | Moment | Force, scene: Setting) -> None:
    """Raise InputError unless an item names a facet group with facets, or a region.  Collective."""
    device = scene.device
    known(item.where, [*device.surfaces, *device.regions], "facet group or region")
    if item.where in device.surfaces and group_size(device, item.where) == 0:
        raise InputError(
            f"{type(item).__name__} on {item.where!r} finds no facets in the mesh."
        )


def unit_vector(about: str | tuple[float, ...]) -> tuple[float, ...]:
    """The unit vector of an axis that is named or given as a direction."""
    if isinstance(about, str):
        return tuple(float(axis == about) for axis in "xyz")
    vector = np.array(about, dtype=float)
    return tuple((vector / np.linalg.norm(vector)).tolist())


def _turns(kinematics: Kinematics) -> str:
    """Axes about which a part may turn."""
    return AXES_OF_TURNS[kinematics.rotations]


def check_axis(item: Any, kinematics: Kinematics) -> None:
    """Raise InputError unless an item names an axis about which parts may turn.

    An item is a condition or an observable with the attributes `where` and `about`.
    """
    about, what = item.about, f"{type(item).__name__} on {item.where!r}"
    turns = _turns(kinematics)
    if not turns:
        raise InputError(f"{what} is for three dimensions and plane strain only; leave it out.")
    if isinstance(about, str) or not isinstance(about, Sequence | np.ndarray):
        if about not in ("x", "y", "z"):
            raise InputError(
                f"{what} is about {shown(about)}, but must be about x, y, z or a direction."
            )
    else:
        if len(about) != 3:
            raise InputError(
                f"The axis of {what} has {len(about)} components, but must have three."
            )
        for value in about:
            finite(value, f"The axis of {what}")
        if not np.linalg.norm(about) > 0:
            raise InputError(f"The axis of {what} is 0 along x, y and z; give a direction.")
    if turns == "z" and not np.allclose(unit_vector(about)[:2], 0.0):
        raise InputError(
            f"{what} is about {shown(about)}, but in a plane parts turn about 'z' alone."
        )


def _check_may_turn(item: Turn | Moment, part: RigidSurface, wholly: bool) -> None:
    """Raise InputError if an item acts about an axis about which its part does not turn.

    With `wholly` every component of its axis must be free, else one of them at least.
    """
    may = np.array([axis in part.turns for axis in "xyz"])
    about = np.array(unit_vector(item.about)) != 0
    if np.any(about & ~may) if wholly else not np.any(about & may):
        raise InputError(
            f"{type(item).__name__} on {item.where!r} is about {item.about!r}, but Rigid lets the "
            f"part turn about {part.turns or 'no axis'} alone; change turns= of Rigid."
        )


def _on[T: RigidSurface | RigidAngle | RigidShift](
    where: str, told: Told, kind: type[T]
) -> list[T]:
    """The declarations of a kind that are about one rigid part."""
    return [one for _, one in of_kind(told, kind) if one.surface == where]


def _check_part(item: Turn | Moment | Force, where: str, told: Told) -> RigidSurface:
    """The rigid part on which an item acts; raises InputError where there is none."""
    found = _on(where, told, RigidSurface)
    if not found:
        raise InputError(
            f"{type(item).__name__} on {where!r} needs a rigid part; add Rigid({where!r}) to the "
            "supports."
        )
    return found[0]
