"""Invariants of a deformation gradient in symbolic form, for the energies of `materials`."""

from __future__ import annotations

import math
from typing import Any

import ufl
from ufl import as_matrix, as_vector, dot

from dea_fenicsx.support.errors import InputError


class StrainOf:
    """Invariants of F for the energies of `materials`, in symbolic form.

    Parameters
    ----------
    F
        Deformation gradient, 3 x 3.
    scale
        Factor on C, for the volume-preserving part: J^(-2/3).
    place, length
        Position in the undeformed body, in the components of F, and the unit of length in m.  None
        where an energy with fibres cannot be taken.

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

    def __init__(self, F: Any, scale: Any = 1, place: Any = None, length: Any = 1.0):
        self.C = scale * dot(F.T, F)
        self._F, self._scale = F, scale
        self._place, self._length = place, length
        self._parts: Spectrum | None = None

    @property
    def I1(self) -> Any:
        return ufl.tr(self.C)

    @property
    def I2(self) -> Any:
        return (self.I1**2 - ufl.inner(self.C, self.C)) / 2

    @property
    def F(self) -> Any:
        """The deformation gradient of which C is taken."""
        return ufl.sqrt(self._scale) * self._F if self._is_scaled else self._F

    @property
    def _is_scaled(self) -> bool:
        return not (isinstance(self._scale, int) and self._scale == 1)

    @property
    def J(self) -> Any:
        return 1.0 if self._is_scaled else cofactor(self._F)[1]

    @staticmethod
    def ln(x: Any) -> Any:
        return ufl.ln(x)

    @staticmethod
    def exp(x: Any) -> Any:
        return ufl.exp(x)

    @staticmethod
    def positive(x: Any) -> Any:
        return ufl.conditional(ufl.gt(x, 0), x, 0)

    @staticmethod
    def erf_integral(x: Any) -> Any:
        return x * ufl.erf(x) + ufl.exp(-x * x) / math.sqrt(math.pi)

    def I4(self, direction: Any) -> Any:
        """a . C a with the unit vector a of a direction."""
        a = self._along(direction)
        return dot(a, dot(self.C, a)) / dot(a, a)

    def I5(self, direction: Any) -> Any:
        """a . C^2 a with the unit vector a of a direction."""
        a = self._along(direction)
        image = dot(self.C, a)
        return dot(image, image) / dot(a, a)

    def _along(self, direction: Any) -> Any:
        """The vector of a direction at this place."""
        if self._place is None:
            raise InputError(
                "A membrane that wrinkles takes an isotropic rubber, but this one has fibres; take "
                "the membrane without wrinkles, or a mesh in space."
            )
        place = [self._length * self._place[i] for i in range(3)]
        return as_vector(list(direction.at(place)))

    def power_sum(self, alpha: Any) -> Any:
        """lam1^alpha + lam2^alpha + lam3^alpha, exact at equal stretches too."""
        if self._parts is None:
            self._parts = Spectrum(self.C, self._scale**3 * cofactor(self._F)[1] ** 2)
        return self._parts.power_sum(alpha / 2)


class Spectrum:
    """Sums of powers of the eigenvalues of C, by isolation of the farthest eigenvalue.

    Parameters
    ----------
    C
        Symmetric positive definite 3 x 3 matrix.
    det
        Its determinant, which saves the digits of a small eigenvalue beside large ones.
    """

    # Below these limits series are used.  On either side second derivatives are exact to 1e-13.
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
        # The branch that is not taken must stay finite, so it gets the spread of 3/2, 1, 1/2.
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
        # A large eigenvalue has a small relative error.  A small one is computed from the product
        # of the other two.
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


def change_of_cofactor(F: Any, G: Any) -> Any:
    """The derivative of the cofactor of F in the direction G; both are 3 x 3."""
    a, b, c = (as_vector([F[i, j] for i in range(3)]) for j in range(3))
    d, e, f = (as_vector([G[i, j] for i in range(3)]) for j in range(3))
    bc, ca, ab = (_cross(b, f) + _cross(e, c), _cross(c, d) + _cross(f, a),
                  _cross(a, e) + _cross(d, b))  # fmt: skip
    return as_matrix([[bc[i], ca[i], ab[i]] for i in range(3)])


def _cross(a: Any, b: Any) -> Any:
    return as_vector(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
