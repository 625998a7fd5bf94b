"""Membranes: films without bending stiffness, whose thickness follows from incompressibility.

The mesh is the middle surface of a film of thickness H, and the displacement is the only unknown:

- F = F_s + cof(F_s) N x N / |cof(F_s) N|^2, with the surface gradient F_s = (1 + Grad u)(1 - N x N)
  and the undeformed normal N, so that det F = 1 and the thickness stretch is 1/|cof(F_s) N|.
- The pressure follows from the faces, which bear no stress, and is eliminated.
- An electrode is a region of the film: its voltage acts through the thickness, so that the nominal
  field is V/H along N.  The voltage is stored once in each cell, and is given or one number.
- All else (materials, ramps, failures, observables of regions, results) is that of solids.

See Adkins and Rivlin, Phil. Trans. A 244 (1952) 505, and Zhao and Suo, Phys. Rev. B 76 (2007)
134113.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import ufl
from ufl import as_matrix, as_vector, grad

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.scene.kinematics import OfRevolution, PlaneStrain, ThreeD
from dea_fenicsx.scene.kinematics_base import GlobalMotion, Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import is_finite, positive


@dataclass(frozen=True)
@in_si(thickness="m")
class _Film(Kinematics):
    """What the membranes share.

    Parameters
    ----------
    thickness
        Thickness in m of the undeformed film that the mesh shows, after a `PreStretch` if there is
        one.
    relaxed
        Whether the film wrinkles: its energy is then that of a tension field.
    slack
        Residual stiffness of a relaxed film, the share of the energy of a film without wrinkles
        that is added; it keeps a film in place where it is slack.
    """

    thickness: float
    relaxed: bool = False
    slack: float = 1e-4
    is_membrane: ClassVar[bool] = True
    surface: ClassVar[int] = 2

    def check(self, device: Device) -> None:
        name = type(self).__name__
        if device.mesh.geometry.dim != self.dim or device.dim != self.surface:
            cells = {1: "lines", 2: "surfaces"}[self.surface]
            raise InputError(
                f"{name} needs a mesh of {cells} in {self.dim} coordinates, but the mesh has cells "
                f"of dimension {device.dim} in {device.mesh.geometry.dim} coordinates."
            )
        positive(self.thickness, f"The thickness of {name}", "a length > 0 in m")
        if not isinstance(self.relaxed, bool | np.bool_):
            raise InputError(
                f"relaxed= of {name} is {shown(self.relaxed)}, but must be True or False."
            )
        if not (is_finite(self.slack) and 0 < self.slack < 1):
            raise InputError(
                f"slack= of {name} is {shown(self.slack)}, but must be a share between 0 and 1."
            )

    def depth_factor(self, length: float) -> float:
        return self.thickness / length

    def lead(self, length: float) -> float:
        """The thickness in units of `length`, which forms take as a constant."""
        return self.thickness / length

    def global_motion(self, parts: Any, lead: Any = 0) -> GlobalMotion:
        return GlobalMotion(thickness=lead)

    @property
    def film(self) -> _Film:
        return self

    @property
    def wrinkles(self) -> bool:
        return self.relaxed

    @property
    def residual_stiffness(self) -> float:
        return self.slack if self.relaxed else 1.0

    @abstractmethod
    def unit_normal(self, x: Any) -> Any:
        """Undeformed unit normal, a 3-vector in the components of F."""

    def frame(self, x: Any) -> Any:
        """Rotation from the axes of a pre-stretch to those of F, 3 x 3; None where they agree."""
        return None

    def gradient(self, phi: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        assert motion is not None
        return phi / motion.thickness * self.unit_normal(x)


@dataclass(frozen=True)
class Membrane(_Film):
    """A flat film that stays in its plane; the mesh lies in x and y.

    Forces, charges and volumes are those of the film.  A load on an edge is in Pa of the edge's
    undeformed area, which is its length times the thickness.

    Parameters
    ----------
    thickness
        Thickness in m of the film that the mesh shows, after a `PreStretch` if there is one.
    relaxed
        Whether the film may wrinkle: the relaxed energy is that of a tension field, which bears no
        pressure in its plane.
    slack
        Residual stiffness of a relaxed film: the share of the energy of a film without wrinkles
        that is added to the relaxed one.
    """

    dim = 2
    axes = "xy"
    title = "a flat membrane"
    rotations = 1

    @property
    def is_flat(self) -> bool:
        return True

    def unit_normal(self, x: Any) -> Any:
        return ufl.as_vector([0.0, 0.0, 1.0])

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        g = grad(u)
        area = (1 + g[0, 0]) * (1 + g[1, 1]) - g[0, 1] * g[1, 0]
        return as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, 1 / area - 1]])

    mirrored = 2

    def embed(self, v: Any) -> Any:
        return as_vector([v[0], v[1], 0])

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """The rotation in the plane and two translations."""
        return PlaneStrain().rigid_motions(x, axis, middle, half)


@dataclass(frozen=True)
class AxisymmetricMembrane(OfRevolution, _Film):
    """A film of revolution: the mesh is its meridian, a line in the coordinates (r, z).

    Components of F and of stresses are ordered (r, hoop, z).  Forces, charges and volumes are for
    the full circle.  A `PreStretch` is along the meridian, the hoop and the thickness.

    Parameters
    ----------
    thickness, relaxed, slack
        As in `Membrane`.
    """

    title = "an axisymmetric membrane"
    surface = 1

    def tangent(self, x: Any) -> Any:
        """Unit tangent of the undeformed meridian, (r, z)."""
        J = ufl.Jacobian(ufl.domain.extract_unique_domain(x))
        return as_vector([J[0, 0], J[1, 0]]) / ufl.sqrt(J[0, 0] ** 2 + J[1, 0] ** 2)

    def unit_normal(self, x: Any) -> Any:
        t = self.tangent(x)
        return as_vector([-t[1], 0, t[0]])

    def frame(self, x: Any) -> Any:
        t = self.tangent(x)
        return as_matrix([[t[0], 0, -t[1]], [0, 1, 0], [t[1], 0, t[0]]])

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        t = self.tangent(x)
        g = t + ufl.dot(grad(u), t)
        hoop = 1 + u[0] / x[0]
        # The deformed normal over the thickness' reciprocal, n/(hoop |g|).
        n = as_vector([-g[1], g[0]]) / (hoop * ufl.dot(g, g))
        N = (-t[1], t[0])
        F = [[g[a] * t[b] + n[a] * N[b] for b in range(2)] for a in range(2)]
        return as_matrix([
            [F[0][0] - 1, 0, F[0][1]], [0, hoop - 1, 0], [F[1][0], 0, F[1][1] - 1],
        ])  # fmt: skip


@dataclass(frozen=True)
class SurfaceMembrane(_Film):
    """A film in space: the mesh is a surface of triangles or quadrilaterals in x, y and z.

    Parameters
    ----------
    thickness, relaxed, slack
        As in `Membrane`.
    """

    dim = 3
    axes = "xyz"
    title = "a membrane in space"

    def unit_normal(self, x: Any) -> Any:
        J = ufl.Jacobian(ufl.domain.extract_unique_domain(x))
        n = ufl.cross(J[:, 0], J[:, 1])
        return n / ufl.sqrt(ufl.dot(n, n))

    def displacement_gradient(self, u: Any, x: Any, motion: GlobalMotion | None = None) -> Any:
        J, N = ufl.Jacobian(ufl.domain.extract_unique_domain(x)), self.unit_normal(x)
        slope = grad(u)
        before = ufl.cross(J[:, 0], J[:, 1])
        now = ufl.cross(*(J[:, k] + ufl.dot(slope, J[:, k]) for k in range(2)))
        # now/|before| is cof(F_s) N
        through = ufl.sqrt(ufl.dot(before, before)) / ufl.dot(now, now) * now
        return slope + ufl.outer(through - N, N)

    def rigid_motions(
        self, x: np.ndarray, axis: int, middle: np.ndarray, half: float
    ) -> np.ndarray:
        """Rotations about x, y, z and translations along them."""
        return ThreeD().rigid_motions(x, axis, middle, half)
