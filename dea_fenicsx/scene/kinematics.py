"""Kinematics: how displacement and potential of a scene become 3 x 3 F and a 3-vector E.

Materials are written once, in three dimensions.  Plane strain, axisymmetry and helical symmetry
differ from 3-D only in the embedding here, and in the weight of a volume or surface element.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import ufl
from ufl import as_matrix, as_vector, dot, grad

from dea_fenicsx.support.units import in_si


class Helix(NamedTuple):
    """What a helical deformation has beside its fields, symbolic and dimensionless.

    In generalised plane strain the elongation alone counts.

    Attributes
    ----------
    lead : pitch/(2 pi)
    elongation : axial stretch - 1
    twist : rotation per undeformed axial length
    """

    lead: Any
    elongation: Any
    twist: Any


class _Flat:
    """What all kinematics without overall unknowns share.

    Attributes
    ----------
    dim
        Dimension of the mesh.
    axes
        Names of the displacement components.
    coordinates
        Names of the mesh's coordinates.
    overall
        Names of unknowns that are one number for the whole device.
    """

    axes = "xyz"
    overall: tuple[str, ...] = ()

    @property
    def coordinates(self) -> str:
        return self.axes

    def normal(self, n: Any, x: Any, helix: Helix | None = None) -> Any:
        """Undeformed normal times the area per area of the mesh, in the components of u."""
        return n

    def motion(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        """Displacement on which a dead load does work, in the components of u."""
        return u


@dataclass(frozen=True)
class ThreeD(_Flat):
    """All three dimensions."""

    dim = 3
    axes = "xyz"

    def displacement_gradient(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        return grad(u)

    def gradient(self, phi: Any, x: Any, helix: Helix | None = None) -> Any:
        return grad(phi)

    def embed(self, v: Any) -> Any:
        """A vector of the mesh's dimension as a 3-vector."""
        return v

    def weight(self, x: Any) -> Any:
        return 1

    def depth_factor(self, length: float) -> float:
        """What an integral over the mesh must be multiplied by, in units of `length`^(3 - dim)."""
        return 1.0


@dataclass(frozen=True)
@in_si(depth="m")
class PlaneStrain(_Flat):
    """No displacement and no field along the third axis.

    Parameters
    ----------
    depth
        Depth in metres along the third axis; forces, charges and volumes are for this depth.
    """

    depth: float = 1.0
    dim = 2
    axes = "xy"

    def displacement_gradient(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        g = grad(u)
        return as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, 0]])

    def gradient(self, phi: Any, x: Any, helix: Helix | None = None) -> Any:
        g = grad(phi)
        return as_vector([g[0], g[1], 0])

    def embed(self, v: Any) -> Any:
        return as_vector([v[0], v[1], 0])

    def weight(self, x: Any) -> Any:
        return 1

    def depth_factor(self, length: float) -> float:
        return self.depth / length


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

    overall = ("elongation",)

    def displacement_gradient(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        assert helix is not None
        g = grad(u)
        return as_matrix([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, helix.elongation]])


@dataclass(frozen=True)
class Axisymmetric(_Flat):
    """Rotationally symmetric about the second axis: mesh coordinates are (r, z).

    Components are ordered (r, hoop, z); forces, charges and volumes are for the full circle.
    """

    dim = 2
    axes = "rz"

    def displacement_gradient(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        g = grad(u)
        return as_matrix([[g[0, 0], 0, g[0, 1]], [0, u[0] / x[0], 0], [g[1, 0], 0, g[1, 1]]])

    def gradient(self, phi: Any, x: Any, helix: Helix | None = None) -> Any:
        g = grad(phi)
        return as_vector([g[0], 0, g[1]])

    def embed(self, v: Any) -> Any:
        return as_vector([v[0], 0, v[1]])

    def weight(self, x: Any) -> Any:
        return 2 * ufl.pi * x[0]

    def depth_factor(self, length: float) -> float:
        return 1.0


@dataclass(frozen=True)
@in_si(pitch="m")
class Helical(_Flat):
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
    overall = ("elongation", "twist")

    @property
    def coordinates(self) -> str:
        return "rz"

    def lead(self, length: float) -> float:
        """c = pitch/(2 pi) in units of `length`."""
        return self.pitch / (2 * math.pi * length)

    def displacement_gradient(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        assert helix is not None
        c, e, k = helix
        g, R = grad(u), x[0]
        return as_matrix([
            [g[0, 0], (-u[1] - c * g[0, 1]) / R, g[0, 1] - k * u[1]],
            [g[1, 0], (u[0] - c * g[1, 1]) / R, g[1, 1] + k * (R + u[0])],
            [g[2, 0], -c * g[2, 1] / R, e + g[2, 1]],
        ])  # fmt: skip

    def gradient(self, phi: Any, x: Any, helix: Helix | None = None) -> Any:
        return self.normal(grad(phi), x, helix)

    def normal(self, n: Any, x: Any, helix: Helix | None = None) -> Any:
        assert helix is not None
        return as_vector([n[0], -helix.lead * n[1] / x[0], n[1]])

    def motion(self, u: Any, x: Any, helix: Helix | None = None) -> Any:
        assert helix is not None
        return as_vector([u[0], u[1] + x[1] * helix.twist * x[0], u[2] + x[1] * helix.elongation])

    def embed(self, v: Any) -> Any:
        return v

    def weight(self, x: Any) -> Any:
        return 2 * ufl.pi * x[0]

    def depth_factor(self, length: float) -> float:
        return 1.0

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


Kinematics = ThreeD | PlaneStrain | GeneralisedPlaneStrain | Axisymmetric | Helical


class StrainOf:
    """Invariants of F for the energies of `materials`, in symbolic form.

    Parameters
    ----------
    F
        Deformation gradient, 3 x 3.
    scale
        Factor on C, for the volume-preserving part: J^(-2/3).

    Notes
    -----
    Powers of the principal stretches are smooth functions of C, but a formula in the eigenvalues
    is singular where two or three of them meet, which is where every actuator starts.  So
    `power_sum` needs no eigenvalue near such a point: it isolates the eigenvalue of C farthest
    from the other two, a simple root of the characteristic polynomial; takes the other two
    together, in a short series in the square of half their difference where they nearly meet;
    and where all three nearly meet takes a short series in the invariants of the deviator.
    Derivatives of any order follow from the same expressions.  Measured against 60-digit
    arithmetic, stress and tangent are good to 1e-12 at and near equal stretches.
    """

    def __init__(self, F: Any, scale: Any = 1):
        self.C = scale * dot(F.T, F)
        self._F, self._scale = F, scale
        self._parts: _Spectrum | None = None

    @property
    def I1(self) -> Any:
        return ufl.tr(self.C)

    @property
    def I2(self) -> Any:
        return (self.I1**2 - ufl.inner(self.C, self.C)) / 2

    @staticmethod
    def ln(x: Any) -> Any:
        return ufl.ln(x)

    def power_sum(self, alpha: Any) -> Any:
        """lam1^alpha + lam2^alpha + lam3^alpha, exact at equal stretches too."""
        if self._parts is None:
            self._parts = _Spectrum(self.C, self._scale**3 * cofactor(self._F)[1] ** 2)
        return self._parts.power_sum(alpha / 2)


class _Spectrum:
    """Sums of powers of the eigenvalues of C, by isolation of the farthest eigenvalue.

    Parameters
    ----------
    C
        Symmetric positive definite 3 x 3 matrix.
    det
        Its determinant, which saves the digits of a small eigenvalue beside large ones.
    """

    # Below these, series; both are good to 1e-13 in second derivatives on either side.
    SPREAD = 1e-6  # J2/m^2: squared spread of all three eigenvalues about their mean m
    GAP = 1e-5  # squared half gap of the pair, over its squared mean

    def __init__(self, C: Any, det: Any):
        # products rather than integer powers: their derivatives compile to fewer operations
        m = ufl.tr(C) / 3
        dev = C - m * ufl.Identity(3)
        self.m = m
        self.k2 = ufl.inner(dev, dev) / (2 * m * m)
        self.k3 = cofactor(dev)[1] / (m * m * m)
        self.apart = ufl.gt(self.k2, self.SPREAD)
        # the branch not taken must stay finite: the spread of 3/2, 1, 1/2 stands in
        k2 = ufl.conditional(self.apart, self.k2, 0.25)
        high = ufl.ge(self.k3, 0.0)  # is the largest eigenvalue the one apart, or the smallest?
        sign = ufl.conditional(high, 1.0, -1.0)
        # farthest deviation 2 sign q c with 4c^3 - 3c = r: Newton in c on [sqrt(3)/2, 1]
        q = ufl.sqrt(k2 / 3)
        r = sign * 1.5 * self.k3 / (q * k2)
        c = _GUESS[-1]
        for a in reversed(_GUESS[:-1]):
            c = a + r * c
        for _ in range(2):
            cc = c * c
            c = (8 * cc * c + r) / (12 * cc - 3)
        x = 2 * sign * q * c
        self.mean = 1 - x / 2  # of the pair
        square = self.mean * self.mean
        unit = det / (m * m * m)
        # a large eigenvalue is known well by itself; a small one by the product of the other two
        pair = ufl.conditional(high, unit / (1 + x), square + 0.75 * x * x - k2)
        self.far = unit / pair
        self.gap = 1 - pair / square
        self.split = ufl.gt(self.gap, self.GAP)
        safe = ufl.conditional(self.split, self.gap, 0.25)
        self.upper = 1 + ufl.sqrt(safe)
        self.lower = (1 - safe) / self.upper

    def power_sum(self, p: Any) -> Any:
        """Sum of the eigenvalues' powers p."""
        k2, k3, t = self.k2, self.k3, self.gap
        # binomial coefficients of p
        b2 = p * (p - 1) / 2
        b3 = b2 * (p - 2) / 3
        b4 = b3 * (p - 3) / 4
        b5 = b4 * (p - 4) / 5
        b6 = b5 * (p - 5) / 6
        together = 3 + k2 * (2 * b2 + k2 * (2 * b4 + k2 * 2 * b6))
        together += k3 * (3 * b3 + 5 * b5 * k2 + 3 * b6 * k3)
        close = 2 + t * (2 * b2 + t * (2 * b4 + t * 2 * b6))
        pair = ufl.conditional(self.split, self.upper**p + self.lower**p, close)
        apart = self.far**p + self.mean**p * pair
        return self.m**p * ufl.conditional(self.apart, apart, together)


# cos(acos(r)/3) on [0, 1], a polynomial to start Newton's method from; good to 4e-06
_GUESS = (0.866030, 0.166429, -0.046005, 0.017642, -0.004099)


def cofactor(F: Any) -> tuple[Any, Any]:
    """Cofactor J F^-T of a 3 x 3 matrix by cross products of its columns, and J = det F.

    Written so, the field energy J |F^-T E|^2 = |cof(F) E|^2 / J compiles three times faster than
    through the inverse.
    """
    a, b, c = (as_vector([F[i, j] for i in range(3)]) for j in range(3))
    bc, ca, ab = _cross(b, c), _cross(c, a), _cross(a, b)
    return as_matrix([[bc[i], ca[i], ab[i]] for i in range(3)]), dot(a, bc)


def _cross(a: Any, b: Any) -> Any:
    return as_vector(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
