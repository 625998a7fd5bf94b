"""Electrodes: equipotentials of given potential or charge, and films with a given field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dea_fenicsx.mesh.device import group_size
from dea_fenicsx.mesh.neighbours import extent, places, region_extent, share_off_planes
from dea_fenicsx.scene.condition import Driven, OnGroups, Setting
from dea_fenicsx.scene.declarations import (
    Declaration,
    FixedPotential,
    FloatingPotential,
    SheetResistance,
)
from dea_fenicsx.scene.electrode_places import check_touch, joined_ends
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.membrane_checks import check_on_membrane
from dea_fenicsx.scene.taper import FACE_TOLERANCE, Taper
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known

FACE_TOLERANCE_OF_DEVICE = 1e-9
"""Largest distance of a thin film's start and end from its faces by rounding in a mesh file, as a
share of the device's size.
"""

MOST_FACES_ELSEWHERE = 0.01
"""Largest share of a thin film's faces, seen along its axis, that lies off its start and end.

A mesh of triangles on a round rim leaves a little.
"""


@dataclass(frozen=True)
class Conducting(OnGroups, Driven):
    """What electrodes of given potential and of given charge share: where they are.

    Attributes
    ----------
    floats
        Whether its potential is an unknown.
    fills_region
        Whether the potential is given throughout dielectric regions, which then have no unknowns.
    """

    where: str | tuple[str, ...]
    floats: ClassVar[bool] = False
    fills_region: ClassVar[bool] = False

    @property
    def given_volts(self) -> float:
        """The voltage at ramp factor 1; 0 of an electrode whose potential floats."""
        return 0.0

    @property
    def given_coulombs(self) -> float:
        """The charge at ramp factor 1; 0 of an electrode whose potential is given."""
        return 0.0

    @property
    def moved_by(self) -> str | None:
        return self.ramp if self.given_volts else None

    @property
    def all_tapers(self) -> tuple[Taper, ...]:
        """The tapers of its potential, if there are any."""
        return ()

    def profile(self, kinematics: Kinematics, X: np.ndarray) -> np.ndarray:
        """Potential over its voltage at undeformed positions X in m, shape (n, 3).

        It is 1 throughout an ordinary electrode, and a taper lets it fall from 1 to 0.
        """
        return np.ones(len(X))

    def check(self, scene: Setting) -> None:
        """Check names and numbers.  The place of the electrode is checked by `check_place`."""
        if not self.names:
            raise InputError("An electrode names no group; give where= at least one name.")
        self._check_values(scene)
        device = scene.device
        for name in self.names:
            known(name, [*device.surfaces, *device.regions], "facet group or region")
            self._check_group(scene, name)
            if group_size(device, name) == 0:
                kind = "cells" if name in device.regions else "facets"
                raise InputError(
                    f"Electrode {name!r} has no {kind} in the mesh; check the physical group."
                )

    def _check_values(self, scene: Setting) -> None:
        """Check numbers and axes, which do not depend on the mesh."""

    def _check_group(self, scene: Setting, name: str) -> None:
        """What a single group must be in order to be this electrode."""
        if scene.kinematics.is_membrane:
            check_on_membrane(scene, name, self.all_tapers)
        elif name in scene.device.regions and not scene.materials[name].is_conductor:
            raise InputError(
                f"Region {name!r} is an electrode, but its material does not conduct; give it "
                "Material(..., electric=Conductor())."
            )

    def check_place(self, scene: Setting) -> None:
        """Raise InputError unless the electrode lies where it makes a field.  Collective."""
        if scene.kinematics.is_membrane:  # each region of the film lies between two faces
            return
        check_touch(scene.device, scene.materials, self.names, joined_ends(scene))


@dataclass(frozen=True)
@in_si(volts="V", ohms_per_square="ohm")
class Electrode(Conducting):
    """An equipotential: a surface (ideal electrode) or a conducting region of finite thickness.

    Parameters
    ----------
    where
        Name of a facet group or of a region whose material is a conductor, or several names.  A
        part of it must lie on a dielectric.
    volts
        Potential in V at ramp factor 1.
    ramp
        Name of the ramp that drives it.
    taper
        Lets the potential fall off over a ring or strip at the electrode's edge, as a
        field-grading layer does.  At the sharp edge of an ideal electrode the field is singular: on
        a fine mesh the edge fails by itself, at a voltage that goes to zero with the cell.  A taper
        gives the edge a length, and results that converge.  Several are multiplied.
    ohms_per_square
        Sheet resistance in ohm of a square of the undeformed surface; 0 for an ideal electrode.
        While time passes, in a `March`, charge flows along the surface from where it is fed; a
        ramp takes no time, and moves none.
    fed_at
        Names of facet groups that touch a resistive electrode, where the potential is given.
    """

    volts: float
    ramp: str = "voltage"
    taper: Taper | tuple[Taper, ...] = ()
    ohms_per_square: float = field(default=0.0, kw_only=True)
    fed_at: str | tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def tapers(self) -> tuple[Taper, ...]:
        return (self.taper,) if isinstance(self.taper, Taper) else tuple(self.taper)

    @property
    def all_tapers(self) -> tuple[Taper, ...]:
        return self.tapers

    @property
    def given_volts(self) -> float:
        return self.volts

    def profile(self, kinematics: Kinematics, X: np.ndarray) -> np.ndarray:
        share = super().profile(kinematics, X)
        for taper in self.tapers:
            t = (kinematics.coordinate(taper.along, X) - taper.start) / (taper.end - taper.start)
            share = share * (1 + np.cos(np.pi * np.clip(t, 0, 1))) / 2
        return share

    @property
    def feeding(self) -> tuple[str, ...]:
        """Names of the groups at which a resistive electrode is fed."""
        return (self.fed_at,) if isinstance(self.fed_at, str) else tuple(self.fed_at)

    @property
    def is_resistive(self) -> bool:
        """Whether its potential may vary along it."""
        return bool(self.ohms_per_square)

    def _check_values(self, scene: Setting) -> None:
        finite(self.volts, f"The voltage of electrode {self.label!r}")
        self._check_sheet(scene)
        for taper in self.tapers:
            taper.check(self.label, scene.kinematics)

    def _check_sheet(self, scene: Setting) -> None:
        """Check the sheet resistance, and where it is fed."""
        finite(self.ohms_per_square, f"The sheet resistance of electrode {self.label!r}")
        if not self.is_resistive:
            if self.feeding:
                raise InputError(
                    f"Electrode {self.label!r} is fed at {', '.join(self.feeding)}, but is ideal; "
                    "give it ohms_per_square=..., or leave fed_at= out."
                )
            return
        if self.ohms_per_square < 0:
            raise InputError(
                f"The sheet resistance of electrode {self.label!r} is {self.ohms_per_square:g} "
                "ohm, but must be >= 0."
            )
        if self.tapers or any(name in scene.device.regions for name in self.names):
            raise InputError(
                f"Electrode {self.label!r} has a sheet resistance, so it must be facet groups "
                "without a taper."
            )
        if not self.feeding:
            raise InputError(
                f"Electrode {self.label!r} has a sheet resistance; say where it is fed by "
                "fed_at=..., a facet group that touches it."
            )
        for name in self.feeding:
            known(name, scene.device.surfaces, "facet group")

    def check_place(self, scene: Setting) -> None:
        super().check_place(scene)
        self._check_reach(scene)

    def _check_reach(self, scene: Setting) -> None:
        """Each taper must fall somewhere on the electrode, and together leave something."""
        if not self.tapers:
            return
        device, kinematics = scene.device, scene.kinematics
        X = places(device, self.names)
        for taper in self.tapers:
            taper.check_reach(self.label, *extent(device, kinematics.coordinate(taper.along, X)))
        if extent(device, self.profile(kinematics, X))[1] < 1e-9:
            raise InputError(
                f"The tapers of electrode {self.label!r} leave it at 0 V everywhere; let each fall "
                "from the electrode's middle towards its edge."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        kinematics = scene.kinematics  # the scene keeps this function, which must not keep it

        def volts(X: np.ndarray) -> np.ndarray:
            return self.volts * self.profile(kinematics, X)

        given = FixedPotential(
            self.names, volts, self.ramp if self.volts else None, self.feeding
        )
        if not self.is_resistive:
            return [given]
        return [given, SheetResistance(self.names, self.ohms_per_square)]


@dataclass(frozen=True)
@in_si(start="m", end="m")
class ThinFilm(Electrode):
    """The field of a film that is thin against all else: V/T through a dielectric region.

    The potential in the region is linear along one axis; it is no unknown, and there is no fringe.
    Regions beside it should be no dielectrics.  The film is flat and of one permittivity.

    Parameters
    ----------
    where
        Name of a dielectric region, or several names.
    volts
        Potential in V at ramp factor 1, at `end`.
    start, end
        Undeformed coordinates in m of the faces at zero and at full potential: those at which the
        region begins and ends.
    along
        The axis through the film.
    """

    start: float = 0.0
    end: float = 0.0
    along: str = "z"
    fills_region = True

    def profile(self, kinematics: Kinematics, X: np.ndarray) -> np.ndarray:
        """Potential over voltage: it rises from 0 to 1 across the film; tapers multiply it."""
        rise = kinematics.coordinate(self.along, X) - self.start
        return rise / (self.end - self.start) * super().profile(kinematics, X)

    def _check_group(self, scene: Setting, name: str) -> None:
        if scene.kinematics.is_membrane:
            raise InputError(
                f"ThinFilm {self.label!r} is for solids; on a membrane take Electrode({name!r}, "
                "volts), whose voltage acts through the thickness."
            )
        if name not in scene.device.regions or not scene.materials[name].is_dielectric:
            raise InputError(
                f"ThinFilm {name!r} must be a dielectric region; name one with "
                "Material(..., electric=IdealDielectric(eps_r))."
            )

    def _check_sheet(self, scene: Setting) -> None:
        if self.ohms_per_square or self.feeding:
            raise InputError(
                f"ThinFilm {self.label!r} has a given field, so it has no sheet resistance; leave "
                "ohms_per_square= and fed_at= out."
            )

    def check_place(self, scene: Setting) -> None:
        self._check_span(scene)
        self._check_reach(scene)

    def _check_span(self, scene: Setting) -> None:
        """Check that the region is one plane film between start and end; else V/T is wrong."""
        device, kinematics, label = scene.device, scene.kinematics, self.label
        finite(self.start, f"The start of ThinFilm {label!r}")
        finite(self.end, f"The end of ThinFilm {label!r}")
        if self.start == self.end or self.along not in tuple(kinematics.coordinates):
            raise InputError(
                f"ThinFilm {label!r} lies between {self.along!r} = {self.start:g} m and "
                f"{self.end:g} m; give two different coordinates along one of the axes "
                f"{', '.join(kinematics.coordinates)}."
            )
        axis = kinematics.coordinates.index(self.along)
        low, high = region_extent(device, self.names, axis)
        room = FACE_TOLERANCE * (high - low) + FACE_TOLERANCE_OF_DEVICE * device.length
        planes = np.array(sorted((self.start, self.end)))
        if np.max(np.abs(planes - [low, high])) > room:
            raise InputError(
                f"ThinFilm {label!r} spans {self.along} = {self.start:g} m to {self.end:g} m, but "
                f"the region lies between {low:.9g} m and {high:.9g} m, so that the field would "
                "not be its voltage over its thickness; give start and end as its two faces, in "
                "metres."
            )

        def on_plane(heights: np.ndarray) -> np.ndarray:
            return np.any([np.max(np.abs(heights - p), axis=1) < room for p in planes], axis=0)

        kinds = {name: scene.materials[name].dielectric.permittivity() for name in self.names}
        off = share_off_planes(device, kinds, axis, on_plane)
        if off > MOST_FACES_ELSEWHERE:
            raise InputError(
                f"ThinFilm {label!r} is not one flat film of one permittivity between "
                f"{self.along} = {planes[0]:g} m and {planes[1]:g} m: {100 * off:.0f} % of its "
                "faces lie elsewhere; give each flat layer a ThinFilm of its own, and any other an "
                "Electrode and a Ground."
            )


@dataclass(frozen=True)
@in_si(coulombs="C")
class ChargedElectrode(Conducting):
    """An equipotential of given charge, whose potential floats: one unknown for all of it.

    Charged and then disconnected, it stands for an open circuit: ramp the charge first, and the
    loads after it.

    Parameters
    ----------
    where
        Name of a facet group or of a conducting region, or several names.
    coulombs
        Charge in C at ramp factor 1; in plane strain for the kinematics' depth.
    ramp
        Name of the ramp that drives it.
    """

    coulombs: float
    ramp: str = "charge"
    floats = True

    @property
    def given_coulombs(self) -> float:
        return self.coulombs

    @property
    def moved_by(self) -> str | None:
        return self.ramp

    def _check_values(self, scene: Setting) -> None:
        finite(self.coulombs, f"The charge of electrode {self.label!r}")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [FloatingPotential(self.names, self.coulombs, self.ramp)]


def Ground(where: str | tuple[str, ...]) -> Electrode:
    """An electrode at zero potential."""
    return Electrode(where, volts=0.0)
