"""Cavities: closed spaces in or beside a device that hold gas, liquid or a given pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.scene.condition import Load, OnGroups, Setting, Told, of_kind
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.scene.enclosure import Enclosed, enclosed, is_flat
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, positive

ATMOSPHERE = 101325.0
"""Standard pressure of the atmosphere in Pa."""

CONTENTS = ("gas", "liquid", "pressure")
"""What a cavity may hold, by the names of the fields that say how much of it."""


@dataclass(frozen=True, eq=False)
class Filling(Declaration):
    """A closed space and what it holds; see `Cavity`.

    Attributes
    ----------
    space
        The volume and its walls.
    kind
        One of `CONTENTS`.
    amount
        What is added at ramp factor 1, in SI units.
    ramp
        Name of the ramp.
    outside, exponent, reference_volume, reservoir
        As of `Cavity`.
    """

    space: Enclosed
    kind: str
    amount: float
    ramp: str
    outside: float
    exponent: float
    reference_volume: float | None
    reservoir: float

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        quantity = {"gas": "joules of gas", "liquid": "cubic metres of liquid"}
        return {quantity.get(self.kind, "pascal in a cavity"): (self.amount,)}

    def held_at_rest(self, length: float, kinematics: Kinematics) -> float:
        """What is in it at ramp factor 0: gas in Pa m^3, or liquid in m^3.

        Parameters
        ----------
        length
            The unit of length in m.
        kinematics
            The kinematics, which know the depth of a plane problem.
        """
        unit = length**3 * kinematics.depth_factor(length)
        volume = self.space.volume * unit + self.reservoir
        if self.kind == "liquid":
            return volume
        reference = self.reference_volume or volume
        return self.outside * volume * (volume / reference) ** (self.exponent - 1)

    @property
    def pressure_field(self) -> str:
        """Name of the field of its pressure above that outside."""
        return f"pressure in {self.space.label}"

    @property
    def volume_field(self) -> str:
        """Name of the field of its change of volume; a given pressure has none."""
        return f"volume of {self.space.label}"

    @property
    def knows_volume(self) -> bool:
        """Whether its volume is an unknown of its own, or given."""
        return self.kind != "pressure"

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of its fields."""
        names = (self.pressure_field, self.volume_field)
        return names if self.knows_volume else names[:1]

    @property
    def given_field(self) -> str | None:
        """Name of the field that its ramp gives, or None."""
        given = {"liquid": self.volume_field, "pressure": self.pressure_field}
        return given.get(self.kind)


@dataclass(frozen=True)
@in_si(
    gas="Pa*m**3", liquid="m**3", pressure="Pa", outside="Pa", exponent="",
    reference_volume="m**3", reservoir="m**3",
)  # fmt: skip
class Cavity(OnGroups, Load):
    """A closed space that holds gas, liquid or a given pressure.

    Exactly one of `gas`, `liquid` and `pressure` is given.  The ramp's factor f multiplies it, so
    that at f = 0 the cavity is as it is in the undeformed body: as large as it is there, and with
    the pressure of the outside.  Once a ramp has filled the cavity it is closed: the amount of gas
    or liquid stays while other ramps, such as a voltage, move.

    The pressure P above that outside is an unknown of its own, and so is the volume V of a gas:

        gas          P + p0 = (n/V_r) (V_r/V)^k,    n = p0 V_0 (V_0/V_r)^(k - 1) + f gas
        liquid       V = V_0 + f liquid
        pressure     P = f pressure

    V is the deformed volume with the reservoir's, V_0 the undeformed one.

    Parameters
    ----------
    where
        Names of the facet groups that are its walls, one or several.
    gas
        Gas that is added, as n R T in Pa m^3: its pressure times its volume.  To fill the cavity
        from V_0 at p0 up to the pressure P at the volume V takes (p0 + P) V - p0 V_0.  A negative
        amount is let out.
    liquid
        Volume of liquid that is added, in m^3; it is incompressible.
    pressure
        Pressure in Pa above that outside.
    outside
        Pressure p0 outside in Pa, with which the volume of a gas does work; that of the standard
        atmosphere unless given.
    exponent
        k: 1 for an isothermal gas, 1.4 for air that changes its volume without taking heat.
    reference_volume
        Volume V_r in m^3, reservoir included, at which an adiabatic gas has the temperature T for
        which its amount is given; V_0 unless given.
    reservoir
        Volume in m^3 of rigid spaces that the cavity is joined to, such as a tube.
    symmetry
        Axes normal to planes of symmetry that close the cavity, such as ``"xyz"``.  Planes in which
        a support holds the rim need not be named.
    openings
        Axes along which openings are seen whose rim may move, such as ``"z"``: each is closed by
        straight lines from its rim to an axis through the middle of the rim, which carry the
        pressure to the rim.
    ramp
        Name of the ramp.

    Raises
    ------
    InputError
        When a scene is made: if the walls are not closed, naming an open edge, or enclose the
        material instead of a cavity.

    Notes
    -----
    A part of the boundary that is not meshed must have its rim in a plane normal to an axis, held
    there by a `Fix` or `Clamp` (a plane of symmetry, or a rigid wall), or be named in `openings`.
    In axisymmetry each opening is a disc, and the axis closes by itself.  In plane strain volumes
    are for the kinematics' depth.

    The pressure is one multiplier: it gives the tangent one negative eigenvalue, which is expected,
    so that the count of all others tells of the device with its gas.
    """

    where: str | tuple[str, ...]
    gas: float | None = None
    liquid: float | None = None
    pressure: float | None = None
    outside: float = ATMOSPHERE
    exponent: float = 1.0
    reference_volume: float | None = None
    reservoir: float = 0.0
    symmetry: str = ""
    openings: str = ""
    ramp: str = "load"

    @property
    def names(self) -> tuple[str, ...]:
        """The walls, each once."""
        return tuple(dict.fromkeys(super().names))

    @property
    def surface_names(self) -> tuple[str, ...]:
        return self.names

    @property
    def kind(self) -> str:
        """Which of `CONTENTS` it holds."""
        return next(name for name in CONTENTS if getattr(self, name) is not None)

    def check(self, scene: Setting) -> None:
        if not self.names:
            raise InputError("A Cavity names no surface; name its walls.")
        super().check(scene)
        given = [name for name in CONTENTS if getattr(self, name) is not None]
        if len(given) != 1:
            told = " and ".join(f"{name}=" for name in given) or "neither"
            raise InputError(
                f"The cavity behind {self.label!r} is given {told}, but must hold exactly one of "
                "gas=, liquid= and pressure=."
            )
        finite(getattr(self, given[0]), f"The {given[0]} in {self.label!r}")
        if scene.kinematics.periodic_ends is not None:
            raise InputError(
                f"Cavity on {self.label!r} is not available in {scene.kinematics.title}."
            )
        for name in ("symmetry", "openings"):
            self._check_axes(name, scene)
        self._check_numbers()

    def _check_axes(self, name: str, scene: Setting) -> None:
        axes = tuple(scene.kinematics.coordinates)
        if any(axis not in axes for axis in getattr(self, name)):
            raise InputError(
                f"{name}={getattr(self, name)!r} of the cavity behind {self.label!r} must hold "
                f"none or some of {', '.join(axes)}."
            )

    def _check_numbers(self) -> None:
        what = f"of the cavity behind {self.label!r}"
        for name, value in (("outside", self.outside), ("reservoir", self.reservoir)):
            if not (_is_number(value) and value >= 0):
                raise InputError(f"{name} {what} is {value!r}, but must be a number >= 0.")
        positive(self.exponent, f"exponent {what}", "a number >= 1")
        if self.exponent < 1:
            raise InputError(f"exponent {what} is {self.exponent!r}, but must be a number >= 1.")
        if self.reference_volume is not None:
            positive(self.reference_volume, f"reference_volume {what}", "a volume > 0 in m^3")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        # A flat wall holds no gas, however its rim is closed; so that is told before its rim is.
        if self.kind == "gas" and not self.reservoir and is_flat(scene, self.names):
            raise self._empty()
        space = enclosed(scene, self.names, self.symmetry, self.openings)
        size = space.area
        if space.volume < -1e-9 * size:
            raise InputError(
                f"The surface {self.label!r} of a cavity encloses the material and no cavity: its "
                "facets look outwards; name the walls that look into the cavity."
            )
        if self.kind == "gas" and space.volume <= 1e-12 * size and not self.reservoir:
            raise self._empty()
        return [Filling(
            space, self.kind, getattr(self, self.kind), self.ramp, self.outside, self.exponent,
            self.reference_volume, self.reservoir,
        )]  # fmt: skip

    def _empty(self) -> InputError:
        """The error of a gas in a cavity without a volume."""
        return InputError(
            f"The cavity behind {self.label!r} has no volume in the undeformed body, so it "
            "cannot hold gas there; give the volume that it is joined to, reservoir=, or take "
            "liquid= or pressure=."
        )

    def check_beside(self, told: Told) -> None:
        for item, filling in of_kind(told, Filling):
            if item is not self and set(filling.space.label.split("+")) & set(self.names):
                shared = sorted(set(filling.space.label.split("+")) & set(self.names))[0]
                raise InputError(
                    f"{shared!r} is a wall of two cavities; name it once, or join the two in one "
                    "Cavity."
                )


def _is_number(value: Any) -> bool:
    try:
        finite(value, "")
    except InputError:
        return False
    return True
