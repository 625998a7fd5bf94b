"""Two equal coaxial discs without thickness in free space: Love's equation.

The discs have the radius a, the distance d and the charges +Q and -Q.  With k = d/a,

    f(x) - (1/pi) int_-1^1 k f(t)/(k^2 + (x - t)^2) dt = 1,    C = 2 eps0 a int_-1^1 f dx.

References
----------
E. R. Love, Q. J. Mech. Appl. Math. 2 (1949) 428.
"""

from __future__ import annotations

import numpy as np

from dea_fenicsx.support.validation import positive

POINTS_PER_GAP = 20
"""Points of the quadrature in a length of the distance; the error is then that of rounding."""

FEWEST_GAUSS_POINTS, MOST_GAUSS_POINTS = 64, 4000
"""Numbers of points of the quadrature."""


def disc_capacitance(distance: float) -> float:
    """Capacitance of two equal discs, over eps0 times their radius.

    The integral equation is solved at the points of a Gauss-Legendre rule (Nystrom's method).

    Parameters
    ----------
    distance
        Distance of the discs in units of their radius, > 0.

    Returns
    -------
    float
        C/(eps0 a), dimensionless.  Far below a distance of 0.01 it loses digits.

    Raises
    ------
    InputError
        The distance is no number > 0.
    """
    positive(distance, "The distance of the discs over their radius")
    n = int(np.clip(np.ceil(2 * POINTS_PER_GAP / distance), FEWEST_GAUSS_POINTS, MOST_GAUSS_POINTS))
    x, weights = np.polynomial.legendre.leggauss(n)
    kernel = distance / (distance**2 + (x[:, None] - x) ** 2) / np.pi
    f = np.linalg.solve(np.eye(n) - kernel * weights, np.ones(n))
    return float(2 * weights @ f)


def plate_capacitance(distance: float) -> float:
    """The same without fringes, pi a/d."""
    positive(distance, "The distance of the discs over their radius")
    return float(np.pi / distance)
