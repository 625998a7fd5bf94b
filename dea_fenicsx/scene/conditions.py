"""What a user may impose on a device: potentials, supports, stretches and loads.

Each condition is one noun that names where it acts.  What can be ramped carries the name of its
ramp (``"voltage"``, ``"stretch"``, ``"load"`` unless told otherwise); its value is reached at ramp
factor 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from dea_fenicsx.support.type_checks import plain_numbers
from dea_fenicsx.support.units import in_si


@dataclass(frozen=True)
class _Conducting:
    """What electrodes of given potential and of given charge share: where they are."""

    where: str | tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return (self.where,) if isinstance(self.where, str) else tuple(self.where)

    @property
    def label(self) -> str:
        return "+".join(self.names)


@dataclass(frozen=True)
@in_si(start="m", end="m")
class Taper:
    """A smooth fall from 1 to 0 along a coordinate: (1 + cos(pi t))/2, t from 0 to 1.

    Parameters
    ----------
    start, end
        Undeformed coordinates in m between which it falls; it is 1 before and 0 behind.  Some of
        the electrode must lie between them.
    along
        ``"x"``, ``"y"``, ``"z"``, or ``"r"``, the distance from the z axis (in an axisymmetric
        section its first coordinate).
    """

    start: float
    end: float
    along: str = "r"


@dataclass(frozen=True)
@in_si(volts="V")
class Electrode(_Conducting):
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
    """

    volts: float
    ramp: str = "voltage"
    taper: Taper | tuple[Taper, ...] = ()

    @property
    def tapers(self) -> tuple[Taper, ...]:
        return (self.taper,) if isinstance(self.taper, Taper) else tuple(self.taper)


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


@dataclass(frozen=True)
@in_si(coulombs="C")
class ChargedElectrode(_Conducting):
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


def Ground(where: str | tuple[str, ...]) -> Electrode:
    """An electrode at zero potential."""
    return Electrode(where, volts=0.0)


@dataclass(frozen=True)
class Fix:
    """No displacement along the named axes (``"x"``, ``"yz"``, ``"rz"``) on a facet group.

    A symmetry plane is a `Fix` along its normal.
    """

    where: str
    axes: str


@dataclass(frozen=True)
class Clamp:
    """No displacement at all on a facet group."""

    where: str


@dataclass(frozen=True)
class FreeBody:
    """Removes the rigid motions that the other supports leave to a device, and no more.

    As many displacements of single vertices are held as there are rigid motions left: six of a
    device that nothing else holds in space, three in the plane, one (along the axis) in
    axisymmetry, two (along the axis, and rotation about it) in a helical cell.  Half a device with
    `Fix` on its plane of symmetry keeps two translations and one rotation.

    Under loads that balance one another the reactions vanish and the device deforms as if free.
    Loads whose resultant force lies along a translation that only `FreeBody` prevents are refused.
    """


@dataclass(frozen=True)
@in_si(stretch="", about="m")
class Stretch:
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


@dataclass(frozen=True)
@in_si(metres="m")
class Displacement:
    """Prescribed displacement of a facet group along one axis, in metres at ramp factor 1."""

    where: str
    axes: str
    metres: float
    ramp: str = "stretch"


@dataclass(frozen=True)
@in_si(x="", y="", z="")
class PreStretch:
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
    """

    where: str | tuple[str, ...]
    x: float | None = None
    y: float | None = None
    z: float | None = None
    ramp: str = "prestretch"

    @property
    def names(self) -> tuple[str, ...]:
        return (self.where,) if isinstance(self.where, str) else tuple(self.where)

    @property
    def stretches(self) -> tuple[float, float, float]:
        """Along x, y and z, all three."""
        given = [s for s in (self.x, self.y, self.z) if s is not None]
        rest = 1 / math.prod(given)
        a, b, c = (rest if s is None else s for s in (self.x, self.y, self.z))
        return a, b, c


@dataclass(frozen=True)
@in_si(stretch="")
class AxialStretch:
    """Prescribed axial stretch of a helical cell as a whole, reached at ramp factor 1."""

    stretch: float
    ramp: str = "stretch"


@dataclass(frozen=True)
@in_si(radians_per_metre="rad/m")
class Twist:
    """Prescribed twist of a helical cell: rotation per undeformed axial length, in rad/m."""

    radians_per_metre: float
    ramp: str = "stretch"


@dataclass(frozen=True)
@in_si(newtons="N")
class AxialForce:
    """Force along the axis on a device of which a helical cell is a part, in N; tension is > 0.

    The same force goes through every turn.
    """

    newtons: float
    ramp: str = "load"


@dataclass(frozen=True)
@in_si(newton_metres="N*m")
class Torque:
    """Torque about the axis on a device of which a helical cell is a part, in N m."""

    newton_metres: float
    ramp: str = "load"


@dataclass(frozen=True)
@in_si(pascal="Pa")
class DeadLoad:
    """Nominal traction on a facet group: force per undeformed area, fixed in direction.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Components of the traction in Pa at ramp factor 1, one for each axis.
    """

    where: str
    pascal: tuple[float, ...]
    ramp: str = "load"


@dataclass(frozen=True)
@in_si(pascal="Pa")
class DeadPressure:
    """Nominal pressure along the undeformed normal, pressing on the material it acts on.

    On a surface inside the device, between an electrode layer and a dielectric, it presses on the
    dielectric: this is how a given Maxwell pressure is applied without solving for the field.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Pressure in Pa at ramp factor 1.
    on
        Name of the region it presses on, needed for a surface inside the device unless one side
        of it alone is dielectric.
    """

    where: str
    pascal: float
    on: str | None = None
    ramp: str = "load"


@dataclass(frozen=True)
@in_si(pascal="Pa")
class FollowerPressure:
    """True pressure: force per deformed area, along the deformed normal, pressing on the body.

    Negative values pull, so that on the side of a homogeneous film it is a true stress.  Its
    stiffness is part of the tangent, which is not symmetric unless the surface is closed or held at
    its edge; the inertia then counts for the symmetric part only.

    Parameters
    ----------
    where
        Name of a facet group.
    pascal
        Pressure in Pa at ramp factor 1.
    on
        Name of the region it presses on, needed for a surface inside the device unless one side
        of it alone is dielectric.
    """

    where: str
    pascal: float
    on: str | None = None
    ramp: str = "load"


Support = Fix | Clamp | FreeBody
Prescribed = Stretch | Displacement | PreStretch | AxialStretch | Twist
Load = DeadLoad | DeadPressure | FollowerPressure | AxialForce | Torque


@dataclass(frozen=True)
@plain_numbers
class Discretisation:
    """The finite elements.

    Parameters
    ----------
    pressure
        ``"discontinuous"``: linear in each cell, so that it may jump at electrodes as it must.
        ``"continuous"``: Taylor-Hood.  ``"auto"`` takes discontinuous on hexahedra and
        quadrilaterals, continuous on tetrahedra and triangles (where linear discontinuous pressure
        is not stable).
    potential_degree
        Polynomial degree of the potential, 1 or 2.
    quadrature_degree
        Degree of exactness of the quadrature.
    augmentation
        gamma, a pure number: incompressible regions get gamma/2 s (J - 1)^2 on top of p (J - 1),
        with a stress s >= 0 in step with the material's, such as mu (I1 - 3 - 2 ln J) in
        neo-Hookean rubber (theory.md lists them). It vanishes in the exact state. Without it mixed
        elements show instabilities that the rubber does not have: at gamma = 0 the stretched branch
        of a Gent film (Jm = 90, stretch 5) has 59 negative eigenvalues too many on 4 x 4 cells and
        460 on 12 x 12 x 2, a block pressed to 0.6 of its height in plane strain 26. From gamma = 2
        there are none of them, whatever the stretch. Since s is small where strains are, a bender
        loses nothing of its accuracy and the kept factor nothing of its use: with gamma = 10 and s
        = mu I1/3 the error of its tip was three times as large.
    """

    pressure: str = "auto"
    potential_degree: int = 2
    quadrature_degree: int = 4
    augmentation: float = 5.0

    PRESSURES: ClassVar[tuple[str, ...]] = ("auto", "discontinuous", "continuous")
