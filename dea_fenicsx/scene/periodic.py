"""Periodic faces: a body that repeats along an axis, with a mean strain that is free or given.

The second face of a pair is the first one, one period further along an axis.  The displacement of
the two differs by one vector d, the same at all of their nodes, and the potential is the same.  The
mean displacement gradient along the period is d over the length of the period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import Prescribed, Setting, Support, Told, of_kind
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


@dataclass(frozen=True)
class PeriodicFaces(Declaration):
    """Two facet groups that are the same place one period apart.

    Attributes
    ----------
    first, second
        Names of the groups.
    free
        Axes along which the difference of their displacements is unknown; None for the axis of the
        period alone.  Along the others it is 0, or given by a `MeanGradient`.
    """

    first: str
    second: str
    free: str | None = None

    @property
    def field(self) -> str:
        """Name of the field of the difference of their displacements."""
        return f"periodic {self.first} {self.second}"


@dataclass(frozen=True)
class MeanGradient(Declaration):
    """Difference of the displacements of periodic faces along an axis, over the period's length.

    `strain` is reached at ramp factor 1.
    """

    first: str
    second: str
    axis: str
    strain: float
    ramp: str

    def amounts(self) -> dict[str, tuple[float, ...]]:
        return {"mean strain": (self.strain,)}


@dataclass(frozen=True)
class Periodic(Support):
    """Two faces that are the same place, one period apart along an axis.

    Displacements of the faces differ by a vector that is the same at all of their nodes, potentials
    are equal.  The body is one period of one that repeats without end.  By default the mean strain
    along the period is free, so that the body has no mean force there, and the mean shear is 0.

    Parameters
    ----------
    first, second
        Names of two facet groups; the second is the first one moved along an axis of the mesh.
        Their nodes must lie at the same places, one period apart.
    free
        Axes along which the second face may move against the first one; by default the axis of the
        period.  ``""`` holds the mean strain at 0, ``"xy"`` frees a mean shear, too.  `MeanStrain`
        prescribes what is named by it, free or not.
    """

    first: str
    second: str
    free: str | None = None

    @property
    def surface_names(self) -> tuple[str, ...]:
        return (self.first, self.second)

    @property
    def joined_surfaces(self) -> tuple[str, str] | None:
        return (self.first, self.second)

    def check(self, scene: Setting) -> None:
        super().check(scene)
        kinematics = scene.kinematics
        if self.first == self.second:
            raise InputError(
                f"Periodic names {self.first!r} twice; it needs two faces one period apart."
            )
        if kinematics.periodic_ends is not None:
            raise InputError(
                "Periodic is for other kinematics: a helical cell is periodic by itself, along its "
                "axis."
            )
        axes = _axes(scene)
        if any(axis not in axes for axis in self.free or ""):
            raise InputError(
                f"Periodic({self.first!r}, {self.second!r}): free is {shown(self.free)}, but must "
                f"name none or some of {', '.join(axes)}."
            )

    def check_beside(self, told: Told) -> None:
        mine = {self.first, self.second}
        pairs = [one for _, one in of_kind(told, PeriodicFaces)]
        if sum(bool(mine & {one.first, one.second}) for one in pairs) > 1:
            raise InputError(
                f"Periodic({self.first!r}, {self.second!r}) shares a face with another Periodic; "
                "each face has one partner."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [PeriodicFaces(self.first, self.second, self.free)]


@dataclass(frozen=True)
@in_si(strain="")
class MeanStrain(Prescribed):
    """Mean displacement gradient between periodic faces, reached at ramp factor 1.

    Parameters
    ----------
    between
        The two faces of a `Periodic`, in the same order.
    axis
        The axis of the displacement: that of the period for a mean stretch of 1 + strain, another
        one for a mean shear.
    strain
        Difference of the faces' displacements along the axis over the length of the period.
    ramp
        Name of the ramp.
    """

    between: tuple[str, str]
    axis: str
    strain: float
    ramp: str = "stretch"

    @property
    def surface_names(self) -> tuple[str, ...]:
        return tuple(self.between)

    def check(self, scene: Setting) -> None:
        super().check(scene)
        axes = _axes(scene)
        if self.axis not in tuple(axes):
            raise InputError(
                f"The axis of MeanStrain is {shown(self.axis)}, but must be one of "
                f"{', '.join(axes)}."
            )
        finite(self.strain, f"The strain between {self.between[0]!r} and {self.between[1]!r}")

    def check_beside(self, told: Told) -> None:
        between = tuple(self.between)
        pairs = [(one.first, one.second) for _, one in of_kind(told, PeriodicFaces)]
        if between not in pairs:
            raise InputError(
                f"MeanStrain is between {self.between[0]!r} and {self.between[1]!r}, which are no "
                f"periodic faces; add Periodic({self.between[0]!r}, {self.between[1]!r}) to the "
                "supports."
            )
        given = [
            one for _, one in of_kind(told, MeanGradient)
            if (one.first, one.second) == between and one.axis == self.axis
        ]  # fmt: skip
        if len(given) > 1:
            raise InputError(
                f"The mean strain between {self.between[0]!r} and {self.between[1]!r} along "
                f"{self.axis} is prescribed twice; give it once."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [MeanGradient(*self.between, self.axis, self.strain, self.ramp)]


def _axes(scene: Setting) -> str:
    """Axes along which periodic faces may move against each other."""
    kinematics = scene.kinematics
    return kinematics.axes if kinematics.cartesian else "z"
