"""Declarations: a small vocabulary in which conditions of a scene are described to the model.

A condition of the scene (a support, a prescribed motion, a load, an electrode) returns a list of
these declarations; the model reads them and knows no condition:

=====================  =========================================================================
`FixedDisplacement`    displacement of a facet group along one axis
`HeldRigidMotions`     the rigid motions that all else leaves free are held
`InitialStretch`       regions that were stretched before they became part of the device
`HeatedRegions`        regions that are brought to a temperature
`FixedGlobal`          value of an unknown that is one number for the whole device
`GlobalForce`          what does work on such an unknown
`SurfaceWork`          virtual work of a load on a facet group: `DeadTraction`, `DeadNormalPressure`
                       and `FollowingPressure`
`RigidSurface`         nodes that move as one body; what turns and loads it, see
                       `scene.part_declarations`
`FixedPotential`       potential of an electrode
`SheetResistance`      resistance along an electrode
`FloatingPotential`    one unknown potential for an electrode of given charge or with a `Feed`
`GradedConstant`       a constant of a material that varies with the place, see `scene.graded`
`AddedPhysics`         fields and terms beyond those that every problem has
=====================  =========================================================================

A ramp's factor multiplies each value; where the ramp is None, the value is 0 at every load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import ufl


class Declaration:
    """Base of all declarations."""

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        """How much is driven at ramp factor 1: the numbers of each quantity, in SI units.

        A run that starts from a state of another one finds by them at which factor a ramp drives
        as much as it did there.  Nothing where the amount is no number.
        """
        return {}


@dataclass(frozen=True)
class FixedDisplacement(Declaration):
    """Displacement along one axis on a facet group: u_a = factor (metres + growth (X_a - C)).

    Attributes
    ----------
    surface
        Name of the facet group.
    axis
        Name of the displacement component.
    metres
        Rigid part in m at ramp factor 1: a number, or a function of the undeformed positions in m,
        shape (n, 3), that returns n numbers.
    growth
        Stretch - 1 at ramp factor 1, or None for a surface that is not stretched.
    about
        C in m; None if it follows from the surfaces that are held along the same axis.
    ramp
        Name of the ramp, or None for a displacement that is 0 at every load.
    """

    surface: str
    axis: str
    metres: float | Callable[[np.ndarray], np.ndarray] = 0.0
    growth: float | None = None
    about: float | None = None
    ramp: str | None = None

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        if self.growth is not None:
            return {"stretch beyond 1": (self.growth,)}
        return {} if callable(self.metres) else {"metres": (self.metres,)}


@dataclass(frozen=True)
class HeldRigidMotions(Declaration):
    """The rigid motions that all other supports leave to a device are held, and no strain is."""


@dataclass(frozen=True)
class InitialStretch(Declaration):
    """Stretches along x, y and z that regions had undergone, at ramp factor 1.

    Their product is 1.
    """

    regions: tuple[str, ...]
    stretches: tuple[float, float, float]
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        """Logarithms, since the ramp's factor is the power of each stretch."""
        return {"logarithms of stretches": tuple(float(np.log(s)) for s in self.stretches)}


@dataclass(frozen=True)
class HeatedRegions(Declaration):
    """The temperature of regions in K at ramp factor 1: a number, or a function of the place.

    That of each region at factor 0 is in `starts`.
    """

    regions: tuple[str, ...]
    kelvin: float | Callable[[Any], Any]
    starts: tuple[float, ...]
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        kelvin = self.kelvin
        return {} if callable(kelvin) else {"K": tuple(kelvin - first for first in self.starts)}


class GlobalUnknown(NamedTuple):
    """An unknown that is one number for the whole device.

    Attributes
    ----------
    name
        Its name.
    per_length
        1 where its value is per m of the device's length, 0 for a pure number.
    kinematics, used_in
        The kinematics that have it, and what they are called, for messages.
    """

    name: str
    per_length: int
    kinematics: str
    used_in: str


ELONGATION = GlobalUnknown(
    "elongation", 0, "Helical(pitch) or GeneralisedPlaneStrain(depth)",
    "helical cells and generalised plane strain",
)  # fmt: skip
"""Stretch along the axis or the depth, minus 1."""

TWIST = GlobalUnknown("twist", 1, "Helical(pitch)", "helical cells")
"""Rotation about the axis per undeformed length, in rad/m."""


@dataclass(frozen=True)
class FixedGlobal(Declaration):
    """Value of a global unknown at ramp factor 1, in SI units."""

    unknown: GlobalUnknown
    value: float
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {self.unknown.name: (self.value,)}


@dataclass(frozen=True)
class GlobalForce(Declaration):
    """Generalised force on a global unknown at ramp factor 1: N (elongation) or N m (twist)."""

    unknown: GlobalUnknown
    amount: float
    ramp: str

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {f"force on the {self.unknown.name}": (self.amount,)}


# ---------------------------------------------------------------- fields and terms


@dataclass(frozen=True)
class AddedPhysics(Declaration):
    """Fields and terms that a problem has in addition to those that follow from its materials.

    Attributes
    ----------
    fields
        The new unknowns, each a `model.fields.Field` whose name no other field has.
    terms
        The new terms of the energy or of the virtual work, each a `model.terms.Term`.
    """

    fields: tuple[Any, ...] = ()
    terms: tuple[Any, ...] = ()


# --------------------------------------------------------------------- loads on surfaces


class SurfaceFields(Protocol):
    """The symbolic fields on a surface, in which the virtual work of a load is written.

    Attributes
    ----------
    virtual
        Virtual displacement, in the components of u.
    virtual_in_space
        The same as a 3-vector.
    displacement
        Displacement in units of the device's length, in the components of u.
    normal
        Undeformed unit normal, in the components of u.
    deformed_area
        The deformed unit of area times its normal, J F^-T N, as a 3-vector.
    """

    @property
    def virtual(self) -> Any: ...
    @property
    def virtual_in_space(self) -> Any: ...
    @property
    def displacement(self) -> Any: ...
    @property
    def normal(self) -> Any: ...
    @property
    def deformed_area(self) -> Any: ...

    def stress(self, pascal: float | tuple[float, ...]) -> Any:
        """A stress in Pa, or several, as a dimensionless constant of the form."""
        ...


@dataclass(frozen=True)
class SurfaceWork(Declaration):
    """Virtual work of a load on a facet group.

    Attributes
    ----------
    surface
        Name of the facet group.
    ramp
        Name of the ramp.
    one_side
        Whether it matters from which side the surface is seen, see `on`.
    follows
        Whether the work depends on the deformation.
    symmetric
        Whether its tangent is symmetric, or may be taken as such in a factor.
    """

    surface: str
    ramp: str
    one_side: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    symmetric: ClassVar[bool] = True

    def density(self, at: SurfaceFields) -> Any:
        """Virtual work per undeformed area at ramp factor 1, dimensionless."""
        # The class is no abstract one, for `declared` asks for it as a kind, as mypy sees it.
        raise NotImplementedError(f"{type(self).__name__} must say its density.")

    @property
    def pressed_region(self) -> str | None:
        """The region from which the surface is seen; None where it is to be found."""
        return None

    @property
    def direction(self) -> tuple[float, ...] | None:
        """Direction fixed in space along which the load acts, or None.

        A free body turns until loads of fixed directions have no moment.
        """
        return None


@dataclass(frozen=True)
class DeadTraction(SurfaceWork):
    """Nominal traction of fixed direction; its components in Pa."""

    pascal: tuple[float, ...]

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"pascal": self.pascal}

    def density(self, at: SurfaceFields) -> Any:
        return ufl.dot(at.stress(self.pascal), at.virtual)

    @property
    def direction(self) -> tuple[float, ...] | None:
        return self.pascal if any(self.pascal) else None


@dataclass(frozen=True)
class _Pressure(SurfaceWork):
    """What both pressures share: a number of Pa, and the region on which it presses."""

    pascal: float
    on: str | None = None
    one_side = True

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"pascal": (self.pascal,)}

    @property
    def pressed_region(self) -> str | None:
        return self.on


@dataclass(frozen=True)
class DeadNormalPressure(_Pressure):
    """Nominal pressure along the undeformed normal, in Pa.

    It stands for a Maxwell pressure, which follows the body: a free body is not turned by it.
    """

    def density(self, at: SurfaceFields) -> Any:
        return -at.stress(self.pascal) * ufl.dot(at.normal, at.virtual)


@dataclass(frozen=True)
class FollowingPressure(_Pressure):
    """True pressure along the deformed normal, in Pa: the force on dA is -p cof(F) N dA."""

    follows = True

    def density(self, at: SurfaceFields) -> Any:
        return -at.stress(self.pascal) * ufl.dot(at.deformed_area, at.virtual_in_space)


# ------------------------------------------------------------------------- electrodes


@dataclass(frozen=True)
class FixedPotential(Declaration):
    """Potential on groups: `volts` at undeformed positions in m, shape (n, 3), at ramp factor 1.

    With `fed_at` it is given only where the groups touch these other ones.
    """

    groups: tuple[str, ...]
    volts: Callable[[np.ndarray], np.ndarray]
    ramp: str | None
    fed_at: tuple[str, ...] = ()


@dataclass(frozen=True)
class SheetResistance(Declaration):
    """Resistance in ohm of a square of the undeformed surface of an electrode's groups."""

    groups: tuple[str, ...]
    ohms: float


class Feed(NamedTuple):
    """A source that feeds an electrode through a wire with a switch.

    Attributes
    ----------
    volts
        Voltage of the source in V at ramp factor 1.
    ohms
        Resistance of the wire in ohm; 0 for an ideal source.
    amperes
        Largest current in A that the source gives or takes; None for no limit.
    closed
        Whether the switch is closed before the path begins.
    """

    volts: float
    ohms: float
    amperes: float | None
    closed: bool


@dataclass(frozen=True)
class FloatingPotential(Declaration):
    """One unknown potential on groups.

    Its charge in C at ramp factor 1 is given, or comes from a source.
    """

    groups: tuple[str, ...]
    coulombs: float
    ramp: str
    feed: Feed | None = None
