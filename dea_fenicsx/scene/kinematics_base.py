"""The base of all kinematics: fields in 3-D, global unknowns, measures and rigid motions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from ufl import as_vector

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.neighbours import extent
from dea_fenicsx.scene.declarations import GlobalUnknown
from dea_fenicsx.support.errors import InputError


class GlobalMotion(NamedTuple):
    """The part of a deformation that is the same everywhere, symbolic and dimensionless.

    Attributes
    ----------
    lead : pitch/(2 pi)
    elongation : stretch along the axis or the depth, minus 1
    twist : rotation per undeformed axial length
    thickness : thickness of a membrane in units of the device's length
    """

    lead: Any = 0
    elongation: Any = 0
    twist: Any = 0
    thickness: Any = 1


Helix = GlobalMotion


class Kinematics(ABC):
    """Base of all kinematics.

    Attributes
    ----------
    dim
        Dimension of the mesh.
    axes
        Names of the displacement components.
    title
        The kinematics in words, with its article where it has one.
    global_unknowns
        Unknowns that are one number for the whole device.
    cartesian
        Whether the components are along axes fixed in space, so that a free body can turn by any
        angle.
    rotations
        How many of the columns of `rigid_motions` are rotations; they come first.
    axis_of_rotation
        Whether the first coordinate is the distance from an axis of rotation.
    is_membrane
        Whether the mesh is the middle surface of a film, whose thickness stretch is part of F; see
        `scene.membranes`.
    mirrored
        Number of the component of F whose reflection must leave a material as it is, since the
        displacement has no component along it; None in space.
    """

    dim: ClassVar[int] = 3
    axes: ClassVar[str] = "xyz"
    title: ClassVar[str] = ""
    global_unknowns: ClassVar[tuple[GlobalUnknown, ...]] = ()
    cartesian: ClassVar[bool] = True
    rotations: ClassVar[int] = 3
    axis_of_rotation: ClassVar[bool] = False
    is_membrane: ClassVar[bool] = False
    mirrored: ClassVar[int | None] = None

    @property
    def overall(self) -> tuple[str, ...]:
        """Names of the global unknowns."""
        return tuple(unknown.name for unknown in self.global_unknowns)

    @property
    def is_flat(self) -> bool:
        """Whether a membrane stays in its plane."""
        return False

    @property
    def wrinkles(self) -> bool:
        """Whether a membrane wrinkles instead of bearing pressure in its surface."""
        return False

    @property
    def residual_stiffness(self) -> float:
        """Share of the energy without wrinkles that a membrane keeps where it wrinkles."""
        return 1.0

    @property
    def film(self) -> Any:
        """Itself, where it is a membrane with `unit_normal` and `frame`; None elsewhere."""
        return None

    @property
    def coordinates(self) -> str:
        """Names of the mesh's coordinates."""
        return self.axes

    @property
    def periodic_ends(self) -> tuple[str, str] | None:
        """Facet groups that are the same place one period apart, or None."""
        return None

    # ------------------------------------------------------------------ checks

    def check(self, device: Device) -> None:
        """Raise InputError unless a device fits.  Collective."""
        if device.mesh.geometry.dim != self.dim or device.dim != self.dim:
            raise InputError(
                f"{type(self).__name__} needs a mesh in {self.dim} dimensions, but the mesh has "
                f"cells of dimension {device.dim} in {device.mesh.geometry.dim} coordinates."
            )

    # ------------------------------------------------------------------ fields

    @abstractmethod
    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        """F - 1, 3 x 3."""

    @abstractmethod
    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        """Gradient of a scalar, a 3-vector."""

    def embed(self, v: Any) -> Any:
        """A vector of the mesh's dimension as a 3-vector."""
        return v

    def normal(self, n: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        """Undeformed normal times the area per area of the mesh, in the components of u."""
        return n

    def motion(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        """Displacement on which a dead load does work, in the components of u."""
        return u

    # ---------------------------------------------------------------- measures

    def weight(self, x: Any) -> Any:
        """Volume per volume of the mesh."""
        return 1

    def depth_factor(self, length: float) -> float:
        """Factor of an integral over the mesh, in units of `length`^(3 - dim)."""
        return 1.0

    def period(self, device: Device) -> float:
        """Length in m along the global elongation."""
        low, high = extent(device, device.mesh.geometry.x[:, 1])
        return (high - low) * device.length

    def coordinate(self, name: str, X: np.ndarray) -> np.ndarray:
        """A coordinate of positions X, shape (n, 3): ``"r"`` in space is the distance from z."""
        if name in tuple(self.coordinates):
            return X[:, self.coordinates.index(name)]
        return np.hypot(X[:, 0], X[:, 1])

    def section(self, x: np.ndarray, u: np.ndarray, overall: np.ndarray) -> np.ndarray:
        """Displacement of the section that a picture shows; that of the mesh as a rule.

        Parameters
        ----------
        x
            Positions of the nodes, shape (n, 2 or more).
        u
            Displacement of the mesh, in the same unit of length.
        overall
            Values of the global unknowns.
        """
        return u

    # ---------------------------------------------------------- global motions

    def lead(self, length: float) -> float:
        """Rise of a helix per rad of turn, pitch/(2 pi), in units of `length`; 0 without one."""
        return 0.0

    def global_motion(self, parts: Any, lead: Any = 0) -> GlobalMotion | None:
        """The global motion, which the gradients need in addition to the fields.

        Parameters
        ----------
        parts
            The global unknowns, symbolic, in the order of `global_unknowns`: a scalar where there
            is one, a vector where there are several.  Not looked at where there are none.
        lead
            `lead` as a constant of the form.

        Returns
        -------
        GlobalMotion or None
            None where there are no global unknowns.
        """
        return None

    # ----------------------------------------------------------- rigid motions

    @abstractmethod
    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """Component `axis` of each rigid motion at points, per unit of its coefficient.

        Parameters
        ----------
        x
            Dimensionless coordinates, shape (n, 3).
        axis
            Number of the displacement component.
        middle, half
            Middle, shape (3,), and half the size of the part that moves; rotations are about the
            middle and in units of half the size.

        Returns
        -------
        ndarray of shape (n, number of rigid motions)
            Rotations first.
        """

    def motion_in_words(self, motion: np.ndarray) -> str | None:
        """The name of a rigid motion, given by its coefficients; None in Cartesian kinematics."""
        return None


def place_of(kinematics: Kinematics, x: Any) -> Any:
    """The coordinates x of a mesh as a 3-vector in the components of F: (r, 0, z) in a section."""
    return as_vector([x[0], 0, x[1]]) if kinematics.axis_of_rotation else kinematics.embed(x)
