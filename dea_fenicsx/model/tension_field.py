"""The relaxed energy of a membrane that wrinkles: a tension field.

With the principal stretches a >= b of the surface, the energy w(a, b) of a film under the nominal
field E is that of the material plus - eps E^2 a^2 b^2/2.  Wrinkles replace it by

    w*(a, b) = w(a, b)       where the film is taut: b >= n(a), the natural width
               w(a, n(a))    where it is wrinkled: it bears no stress across
               w(s, s)       where it is slack: a <= s, with n(s) = s

so that no stress in the surface is negative.  For any isotropic rubber n = a^(-1/2) without a
field; in a neo-Hookean film n^4 = 1/(a^2 (1 - e^2 a^2)) with e^2 = eps E^2/mu, and s is the lesser
root of s^6 (1 - e^2 s^2) = 1.  Where e a >= 1, or e^2 > (27/256)^(1/3) in a slack place, no width
is in equilibrium, and no relaxed energy exists.

References
----------
Pipkin, IMA J. Appl. Math. 36 (1986) 85.  De Tommasi, Puglisi, Zurlo, Appl. Phys. Lett. 98 (2011)
123507 for films under voltage.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import ufl

from dea_fenicsx.scene.kinematics import StrainOf

LARGEST_SLACK_FIELD = (27 / 256) ** (1 / 3)
"""Largest e^2 at which a slack film has a natural width: the pull-in of a free film."""

TAUT_TOLERANCE = 1e-9
"""Share by which a film may be narrower than its natural width, and still count as taut.

An undeformed film is taut, slack and wrinkled at once; so it is taut.
"""

LEAST_SQUARED_DIFFERENCE = 1e-24
"""Smallest square of a difference, so that derivatives stay finite where they are multiplied by 0.
"""

NEWTON_OF_SLACK_STRETCH = 6
"""Newton iterations for the natural stretch of a slack film."""


class TensionField:
    """The relaxed state at a point of a membrane, symbolic.

    Parameters
    ----------
    at
        The point, see `MaterialPoint`.

    Attributes
    ----------
    ahead
        a^2 as the film is.
    margin
        1 - e^2 a^2 at the present a; 1 without a field.
    taut
        The condition that it is taut.
    """

    def __init__(self, at: Any) -> None:
        elastic, through = at.kernel.elastic, ufl.dot(at.total, at.normal)
        thin = ufl.dot(through, through)
        area = 1 / thin  # a^2 b^2
        total = ufl.tr(ufl.dot(ufl.transpose(at.total), at.total)) - thin  # a^2 + b^2
        apart = ufl.sqrt(ufl.max_value(total**2 - 4 * area, LEAST_SQUARED_DIFFERENCE))
        self.ahead = (total + apart) / 2
        across = area / self.ahead
        self._one: Any = ufl.as_ufl(1.0)
        self._pull: Any = None
        if at.kernel.eps is not None:
            before = ufl.dot(at.prestretch, at.normal)
            square = ufl.dot(at.nominal_field, at.nominal_field) * ufl.dot(before, before)
            self._pull = at.kernel.eps * square / at.per_stress
        self._elastic = elastic
        self.margin = self._margin(self.ahead)
        self.taut = ufl.ge(area * across * self.margin, 1 - TAUT_TOLERANCE)

    def _margin(self, ahead: Any) -> Any:
        """1 - e^2 a^2, positive where there is a natural width."""
        if self._pull is None:
            return self._one
        return self._elastic.width_margin(ahead, self._pull)

    @cached_property
    def _width(self) -> Any:
        """The square of the natural width, n(a)^2."""
        return 1 / ufl.sqrt(self.ahead * ufl.max_value(self.margin, LEAST_SQUARED_DIFFERENCE))

    @cached_property
    def slack(self) -> Any:
        """The condition that it bears no stress ahead either, if it is not taut."""
        ahead, width = self.ahead, self._width
        return ufl.le(ahead - 1 / (ahead * width) - (1 - self.margin) * width, 0)

    @cached_property
    def _loose(self) -> Any:
        """The square of the natural stretch of a slack film, s^2."""
        if self._pull is None:
            return self._one
        # A trial state, and the test of residuals, may have a larger field.
        e2 = ufl.min_value(1 - self._margin(self._one), LARGEST_SLACK_FIELD)
        x = self._one
        for _ in range(NEWTON_OF_SLACK_STRETCH):
            x = x - (x**3 * (1 - e2 * x) - 1) / (x**2 * (3 - 4 * e2 * x))
        return x

    @cached_property
    def squares(self) -> tuple[Any, Any]:
        """Squares of the stretches ahead and across of the relaxed film, where it is not taut."""
        loose = self._loose
        return (
            ufl.conditional(self.slack, loose, self.ahead),
            ufl.conditional(self.slack, loose, self._width),
        )

    @cached_property
    def strain(self) -> StrainOf:
        """The strain of the relaxed film, where it is not taut."""
        ahead, across = self.squares
        stretches = [ufl.sqrt(ahead), ufl.sqrt(across), 1 / ufl.sqrt(ahead * across)]
        return StrainOf(ufl.diag(ufl.as_vector(stretches)))

    @property
    def relaxable(self) -> Any:
        """Positive where a relaxed energy exists."""
        if self._pull is None:
            return self._one
        room = LARGEST_SLACK_FIELD - (1 - self._margin(self._one))
        return ufl.conditional(
            self.taut, 1.0, ufl.conditional(self.slack, room, self.margin)
        )
