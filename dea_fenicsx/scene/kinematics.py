"""Kinematics: how displacement and potential of a scene become 3 x 3 F and a 3-vector E.

Materials are written once, in three dimensions.  Plane strain, axisymmetry and helical symmetry
differ from 3-D only in the embedding here, and in the weight of a volume or surface element.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import ufl
from ufl import as_matrix, as_vector, grad

from dea_fenicsx.mesh.device import Device, group_size
from dea_fenicsx.mesh.neighbours import extent
from dea_fenicsx.scene.declarations import ELONGATION, TWIST
from dea_fenicsx.scene.kinematics_base import GlobalMotion, Helix, Kinematics
from dea_fenicsx.scene.strain import StrainOf, cofactor
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known, positive

__all__ = ["Axisymmetric", "GeneralisedPlaneStrain", "GlobalMotion", "Helical", "Helix",
           "Kinematics", "PlaneStrain", "StrainOf", "ThreeD", "cofactor"]  # fmt: skip


@dataclass(frozen=True)
class ThreeD(Kinematics):
    """All three dimensions."""

    dim = 3
    axes = "xyz"

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        return grad(u)

    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        return grad(phi)

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """Rotations about x, y, z and translations along them."""
        turns, shifts = _rigid(x, axis, middle, half)
        return np.column_stack([turns, shifts])


@dataclass(frozen=True)
@in_si(depth="m")
class PlaneStrain(Kinematics):
    """No displacement and no field along the third axis.

    Parameters
    ----------
    depth
        Depth in metres along the third axis; forces, charges and volumes are for this depth.
    """

    depth: float = 1.0
    dim = 2
    axes = "xy"
    rotations = 1
    mirrored = 2

    def check(self, device: Device) -> None:
        super().check(device)
        positive(self.depth, f"The depth of {type(self).__name__}", "a length > 0 in m")

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        g = grad(u)
        return as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, 0]])

    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        g = grad(phi)
        return as_vector([g[0], g[1], 0])

    def embed(self, v: Any) -> Any:
        return as_vector([v[0], v[1], 0])

    def depth_factor(self, length: float) -> float:
        return self.depth / length

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """The rotation in the plane and two translations."""
        turns, shifts = _rigid(x, axis, middle, half)
        return np.column_stack([turns[:, 2], shifts[:, :2]])


@dataclass(frozen=True)
@in_si(depth="m")
class GeneralisedPlaneStrain(PlaneStrain):
    """A slice of a body that stretches evenly along the third axis, and stays straight along it.

    The stretch along z is one unknown: free, loaded (`AxialForce`) or prescribed (`AxialStretch`).
    `PlaneStrain` is the same with this stretch held at 1.

    Parameters
    ----------
    depth
        Depth in metres along the third axis; forces, charges and volumes are for this depth.
    """

    title = "generalised plane strain"
    global_unknowns = (ELONGATION,)

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        assert motion is not None
        g = grad(u)
        return as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, motion.elongation]])

    def global_motion(self, parts: Any, lead: Any = 0) -> GlobalMotion:
        return GlobalMotion(elongation=parts)

    def period(self, device: Device) -> float:
        return self.depth


class OfRevolution:
    """What bodies and films of revolution share: coordinates (r, z), components (r, hoop, z)."""

    dim = 2
    axes = "rz"
    cartesian = False
    rotations = 0
    axis_of_rotation = True
    mirrored: ClassVar[int | None] = 1

    def check(self, device: Device) -> None:
        super().check(device)  # type: ignore[misc]  # that of the kinematics beside it
        least_radius(device)

    def embed(self, v: Any) -> Any:
        return as_vector([v[0], 0, v[1]])

    def weight(self, x: Any) -> Any:
        return 2 * ufl.pi * x[0]

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """The axial translation alone: all other motions stretch hoops."""
        return np.full((len(x), 1), float(axis == 1))

    def motion_in_words(self, motion: np.ndarray) -> str:
        return "translation along z"


@dataclass(frozen=True)
class Axisymmetric(OfRevolution, Kinematics):
    """Rotationally symmetric about the second axis: mesh coordinates are (r, z).

    Components of F and of stresses are ordered (r, hoop, z) in energies and failures.  Files of
    fields order them (r, z, hoop) instead, the axes of the picture first, and name them so.
    Forces, charges and volumes are for the full circle.
    """

    title = "an axisymmetric section"

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        g = grad(u)
        return as_matrix([[g[0, 0], 0, g[0, 1]], [0, u[0] / x[0], 0], [g[1, 0], 0, g[1, 1]]])

    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        g = grad(phi)
        return as_vector([g[0], 0, g[1]])


@dataclass(frozen=True)
@in_si(pitch="m")
class Helical(Kinematics):
    """One period of a body with helical symmetry, standing for any number of turns.

    With (R, Theta, Z) undeformed, zeta = Z - c Theta and c = pitch/(2 pi), all fields depend on R
    and zeta alone and repeat with the height of the mesh in zeta.  Mesh coordinates are (R, zeta).
    The deformation is

        x = Q(Theta + k Z) (R + u_r, u_theta, 0) + (lam Z + u_z) e_z,

    Q(a) a rotation about the axis by a; axial stretch lam and twist k, rotation per undeformed
    length, are one unknown each.  Components are ordered (r, hoop, z) in the frame turned by
    Theta + k Z.  Forces, charges and volumes are for one period over one full turn.

    Parameters
    ----------
    pitch
        Rise of the helix per turn in metres, a whole multiple of the mesh's height (the number of
        strands); negative for a left-handed helix.  0 makes it a stack of rings that can twist.
    between
        Names of the facet groups of the two ends of the period, lower and upper.  Their nodes lie
        at the same radii.

    Notes
    -----
    At lam = 1 + e the columns of F, for d/dR, (1/R) d/dTheta at fixed Z, and d/dZ, are

        (1 + u_r,R ; u_t,R ; u_z,R)
        ((-u_t - c u_r,z)/R ; (R + u_r - c u_t,z)/R ; -c u_z,z/R)
        (u_r,z - k u_t ; u_t,z + k (R + u_r) ; lam + u_z,z)

    with ,z = d/dzeta; Grad phi = (phi,R ; -c phi,z/R ; phi,z); dX = 2 pi R dR dzeta.

    A dead load does work on u + Z (0, k R, lam - 1), and turns with the frame.
    """

    pitch: float
    between: tuple[str, str] = ("bottom", "top")
    dim = 2
    axes = "rtz"
    title = "a helical cell"
    axis_of_rotation = True
    global_unknowns = (ELONGATION, TWIST)
    cartesian = False
    rotations = 1

    def check(self, device: Device) -> None:
        super().check(device)
        if least_radius(device) < 1e-9:
            raise InputError("A helical cell needs a hole: its mesh must lie at radii r > 0.")
        finite(self.pitch, "The pitch of Helical")
        for name in self.between:
            known(name, device.surfaces, "facet group")
            if group_size(device, name) == 0:
                raise InputError(f"The end {name!r} of the helical cell has no facets in the mesh.")
        strands = abs(self.pitch) / self.period(device)
        if abs(strands - round(strands)) > 1e-6:
            raise InputError(
                f"The pitch {self.pitch:g} m of Helical is {strands:g} times the height of the "
                "cell, but must be a whole multiple of it, the number of strands; or 0 for rings."
            )

    @property
    def periodic_ends(self) -> tuple[str, str]:
        return self.between

    @property
    def coordinates(self) -> str:
        return "rz"

    def lead(self, length: float) -> float:
        """c = pitch/(2 pi) in units of `length`."""
        return self.pitch / (2 * math.pi * length)

    def global_motion(self, parts: Any, lead: Any = 0) -> GlobalMotion:
        return GlobalMotion(lead, parts[0], parts[1])

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """The rotation about the axis and the axial translation."""
        return np.column_stack([x[:, 0] / half * (axis == 1), np.full(len(x), float(axis == 2))])

    def motion_in_words(self, motion: np.ndarray) -> str:
        return "rotation about the axis" if abs(motion[0]) > 1e-6 else "translation along z"

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        assert motion is not None
        c, e, k = motion.lead, motion.elongation, motion.twist
        g, R = grad(u), x[0]
        return as_matrix([
            [g[0, 0], (-u[1] - c * g[0, 1]) / R, g[0, 1] - k * u[1]],
            [g[1, 0], (u[0] - c * g[1, 1]) / R, g[1, 1] + k * (R + u[0])],
            [g[2, 0], -c * g[2, 1] / R, e + g[2, 1]],
        ])  # fmt: skip

    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        return self.normal(grad(phi), x, motion)

    def normal(self, n: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        assert motion is not None
        return as_vector([n[0], -motion.lead * n[1] / x[0], n[1]])

    def motion(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        assert motion is not None
        return as_vector([u[0], u[1] + x[1] * motion.twist * x[0], u[2] + x[1] * motion.elongation])

    def weight(self, x: Any) -> Any:
        return 2 * ufl.pi * x[0]

    def section(self, x: np.ndarray, u: np.ndarray, overall: np.ndarray) -> np.ndarray:
        """Displacement of the section Theta = 0, shape (n, 3): along R, along Z, out of the plane.

        Parameters
        ----------
        x
            (R, zeta) of the nodes, shape (n, 2 or more).
        u
            Components (r, hoop, z), shape (n, 3), in the same unit of length.
        overall
            Elongation, and twist in rad per unit of length.
        """
        R, Z = x[:, 0], x[:, 1]
        c, s = np.cos(overall[1] * Z), np.sin(overall[1] * Z)
        r, t = R + u[:, 0], u[:, 1]
        return np.column_stack([c * r - s * t - R, u[:, 2] + overall[0] * Z, s * r + c * t])


def least_radius(device: Device) -> float:
    """The least first coordinate of a mesh, which must be a radius.  Collective."""
    low = extent(device, device.mesh.geometry.x[:, 0])[0]
    if low < -1e-12:
        raise InputError(
            f"An axisymmetric mesh lies at radii r >= 0, but this one reaches r = "
            f"{low * device.length:g} m; shift it so that the axis is at r = 0."
        )
    return low


def _rigid(
    x: np.ndarray, axis: int, middle: np.ndarray, half: float
) -> tuple[np.ndarray, np.ndarray]:
    """Component `axis` of the rotations about x, y, z and of the translations along them."""
    unit, y = np.eye(3), (x - middle) / half
    turns = np.cross(unit[None, :, :], y[:, None, :])[:, :, axis]
    return turns, np.tile(unit[:, axis], (len(x), 1))
