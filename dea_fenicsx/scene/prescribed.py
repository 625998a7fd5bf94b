"""Prescribed motions: stretches and displacements that a ramp drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import (
    InRegions,
    OnSurface,
    Prescribed,
    Setting,
    check_axes,
    check_global,
)
from dea_fenicsx.scene.declarations import (
    ELONGATION,
    TWIST,
    Declaration,
    FixedDisplacement,
    FixedGlobal,
    InitialStretch,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known


@dataclass(frozen=True)
@in_si(stretch="", about="m")
class Stretch(OnSurface, Prescribed):
    """Prescribed affine stretch of a facet group: u_a = (stretch - 1) (X_a - C_a).

    C is the plane that stays in place.  It is the one in which the surfaces lie that `Fix`, `Clamp`
    or `Displacement` hold along the same axis, the stretched one itself left out; 0 where none is
    held, or where each of them reaches X_a = 0, and always along the radius of an axisymmetric
    section.  Where held surfaces lie at different coordinates, it must be given.

    Parameters
    ----------
    where
        Name of a facet group.
    axes
        Axes that are prescribed, such as ``"x"`` or ``"xy"``; the others stay free.
    stretch
        Stretch at ramp factor 1.
    about
        The coordinate C in m that stays in place, or one for each of the axes.
    """

    where: str
    axes: str
    stretch: float
    ramp: str = "stretch"
    about: float | tuple[float, ...] | None = None

    @property
    def centres(self) -> tuple[float | None, ...]:
        """What is given as `about`, for each of the axes; None where nothing is."""
        if self.about is None or not hasattr(self.about, "__len__"):
            return (self.about,) * len(self.axes)  # type: ignore[return-value]
        return tuple(self.about)  # type: ignore[arg-type]

    def check(self, scene: Setting) -> None:
        super().check(scene)
        check_axes(self, self.axes, scene)
        coordinates = scene.kinematics.coordinates
        if any(a not in coordinates for a in self.axes):
            raise InputError(
                f"The stretch on {self.where!r} is along {self.axes!r}, but the mesh only has the "
                f"coordinates {', '.join(coordinates)}."
            )
        finite(self.stretch, f"The stretch on {self.where!r}")
        if self.stretch <= 0:
            raise InputError(f"The stretch on {self.where!r} is {self.stretch}, must be > 0.")
        for value in self.centres:
            finite(0.0 if value is None else value, f"about= of the stretch on {self.where!r}")
        if len(self.centres) != len(self.axes):
            raise InputError(
                f"The stretch on {self.where!r} is about {len(self.centres)} coordinates, but "
                f"must be about one, or one for each of the axes {self.axes!r}."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [
            FixedDisplacement(
                self.where, axis, growth=self.stretch - 1,
                about=self.centres[self.axes.index(axis)], ramp=self.ramp,
            )
            for axis in self.axes
        ]  # fmt: skip


@dataclass(frozen=True)
@in_si(metres="m")
class Displacement(OnSurface, Prescribed):
    """Prescribed displacement of a facet group along one axis, in metres at ramp factor 1.

    It also moves a region that is `Rigid`.
    """

    where: str
    axes: str
    metres: float
    ramp: str = "stretch"

    def check(self, scene: Setting) -> None:
        if self.where not in {item.rigid_part for item in scene.supports}:
            super().check(scene)
        check_axes(self, self.axes, scene)
        finite(self.metres, f"The displacement on {self.where!r}")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [
            FixedDisplacement(self.where, axis, metres=self.metres, ramp=self.ramp)
            for axis in self.axes
        ]


@dataclass(frozen=True)
@in_si(x="", y="", z="", r="")
class PreStretch(InRegions, Prescribed):
    """Stretches that a region had undergone before it became part of the device.

    The mesh shows the stretched region: a film, pulled over a frame, to which a stiffener is then
    bonded.  At ramp factor t the region's elements are strained by the stretches to the power t
    where they have not moved; ramp it up first, with the supports or dead loads that bear the
    tension.  Displacements, strains and nominal stresses all count from the stretched state.

    Parameters
    ----------
    where
        Name of an incompressible region, or several names.
    x, y, z
        Stretches along the axes.  One may be left out: it follows from constant volume.
    r
        In an axisymmetric section or a helical cell in place of x and y: the stretch along the
        radius and around the axis, which are alike.  One of r and z is given, the other follows.
    """

    where: str | tuple[str, ...]
    x: float | None = None
    y: float | None = None
    z: float | None = None
    ramp: str = "prestretch"
    r: float | None = None

    @property
    def stretches(self) -> tuple[float, float, float]:
        """Along x, y and z, or along the radius, around and along the axis; all three."""
        if self.r is not None:
            return self.r, self.r, self.r**-2
        given = [s for s in (self.x, self.y, self.z) if s is not None]
        rest = 1 / math.prod(given)
        a, b, c = (rest if s is None else s for s in (self.x, self.y, self.z))
        return a, b, c

    def check(self, scene: Setting) -> None:
        for name in self.names:
            known(name, scene.device.regions, "region")
            if scene.materials[name].bulk_modulus is not None:
                raise InputError(
                    f"The pre-stretch of {name!r} needs an incompressible material, but that "
                    "region has a bulk modulus; leave it out."
                )
        label = "+".join(self.names)
        if any(self.ramp == load.ramp for load in scene.loads):
            raise InputError(
                f"The pre-stretch of {label!r} and a load share the ramp {self.ramp!r}; give them "
                'two, and move both in one Ramp(("prestretch", "load")).'
            )
        round_section = not scene.kinematics.cartesian
        self._check_axes(label, round_section)
        given = [s for s in (self.x, self.y, self.z, self.r) if s is not None]
        for value in given:
            finite(value, f"A pre-stretch of {label!r}")
            if value <= 0:
                raise InputError(f"A pre-stretch of {label!r} is {value}, but must be > 0.")
        if round_section:
            return
        if len(given) < 2 or abs(math.prod(self.stretches) - 1) > 1e-9:
            raise InputError(
                f"The pre-stretch of {label!r} is x = {self.x}, y = {self.y}, z = {self.z}; give "
                "two stretches, or three whose product is 1."
            )

    def _check_axes(self, label: str, round_section: bool) -> None:
        """Raise InputError unless the stretches are along axes that the kinematics has."""
        if not round_section and self.r is not None:
            raise InputError(
                f"The pre-stretch of {label!r} is along r, which is for an axisymmetric section or "
                "a helical cell; give x, y and z, of which one may be left out."
            )
        if round_section and (
            (self.x, self.y) != (None, None) or (self.r is None) == (self.z is None)
        ):
            raise InputError(
                f"The pre-stretch of {label!r} needs one of r and z, because the device is round; "
                "x and y are for three dimensions and plane strain only."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        stretches = self.stretches
        if not scene.kinematics.cartesian and self.r is None:
            assert self.z is not None
            around = self.z**-0.5
            stretches = (around, around, self.z)
        return [InitialStretch(self.names, stretches, self.ramp)]


@dataclass(frozen=True)
@in_si(stretch="")
class AxialStretch(Prescribed):
    """Prescribed axial stretch of a helical cell as a whole, reached at ramp factor 1."""

    stretch: float
    ramp: str = "stretch"

    def check(self, scene: Setting) -> None:
        check_global(scene, ELONGATION, self)
        finite(self.stretch, "The axial stretch")
        if self.stretch <= 0:
            raise InputError(f"The axial stretch is {self.stretch}, but must be > 0.")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FixedGlobal(ELONGATION, self.stretch - 1, self.ramp)]


@dataclass(frozen=True)
@in_si(radians_per_metre="rad/m")
class Twist(Prescribed):
    """Prescribed twist of a helical cell: rotation per undeformed axial length, in rad/m."""

    radians_per_metre: float
    ramp: str = "stretch"

    def check(self, scene: Setting) -> None:
        check_global(scene, TWIST, self)
        finite(self.radians_per_metre, "The twist")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FixedGlobal(TWIST, self.radians_per_metre, self.ramp)]
