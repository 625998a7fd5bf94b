"""The force law of a spring as a table of measured points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si

interpolate = Later("scipy.interpolate")

MOST_POINTS_OF_TABLE = 200
"""Largest number of points, each of which makes the compiled forms longer."""


@dataclass(frozen=True)
@in_si(elongations="m", forces="N")
class TableLaw:
    """Force of a spring through measured points, by monotone cubic interpolation.

    Between two points the force is monotone, so that it has no peaks of its own, and its slope is
    continuous.  Beyond the first and the last point it goes on straight.  The energy of the spring
    is the integral of the force from the elongation 0.

    Parameters
    ----------
    elongations
        Elongations in m (for a `TorsionSpring` angles in rad), which rise.
    forces
        Force in N at each of them (for a `TorsionSpring` moments in N m).
    """

    elongations: Sequence[float]
    forces: Sequence[float]

    def __post_init__(self) -> None:
        for name in ("elongations", "forces"):
            values = getattr(self, name)
            if isinstance(values, str) or not np.iterable(values):
                raise InputError(
                    f"{name}= of TableLaw is {shown(values)}, but must be a list of numbers."
                )
            values = tuple(v.item() if isinstance(v, np.generic) else v for v in values)
            for value in values:
                if not is_number(value) or not np.isfinite(float(value)):
                    raise InputError(
                        f"{name}= of TableLaw holds {shown(value)}, but must hold finite numbers."
                    )
            object.__setattr__(self, name, tuple(map(float, values)))
        x, f = self.elongations, self.forces
        if len(x) != len(f) or not 2 <= len(x) <= MOST_POINTS_OF_TABLE:
            raise InputError(
                f"TableLaw has {len(x)} elongations and {len(f)} forces, but must have as many "
                f"of both, from 2 to {MOST_POINTS_OF_TABLE}."
            )
        if any(b <= a for a, b in pairwise(x)):
            raise InputError("elongations= of TableLaw must rise from each point to the next.")

    @cached_property
    def _pieces(self) -> tuple[np.ndarray, np.ndarray]:
        """Where each piece begins, and its coefficients, the highest power first; (pieces, 4)."""
        x, f = np.array(self.elongations), np.array(self.forces)
        slopes = interpolate.PchipInterpolator(x, f).derivative()
        first, last = float(slopes(x[0])), float(slopes(x[-1]))
        inner = interpolate.PchipInterpolator(x, f).c.T
        starts = np.array([x[0], *x[:-1], x[-1]])
        return starts, np.array([[0, 0, first, f[0]], *inner, [0, 0, last, f[-1]]])

    @cached_property
    def _works(self) -> np.ndarray:
        """Coefficients of the integral of each piece, of shape (pieces, 5), 0 at elongation 0."""
        starts, c = self._pieces
        works = np.column_stack([c / [4.0, 3.0, 2.0, 1.0], np.zeros(len(c))])
        for k in range(2, len(c)):
            works[k, -1] = np.polyval(works[k - 1], starts[k] - starts[k - 1])
        works[:, -1] -= self._at(works, 0.0)
        return works

    def _at(self, pieces: np.ndarray, d: Any) -> Any:
        """The value of the piece in which an elongation lies, a number or an expression."""
        starts = self._pieces[0]

        def polynomial(k: int) -> Any:
            value: Any = 0.0
            for c in pieces[k]:
                value = value * (d - float(starts[k])) + float(c)
            return value

        if is_number(d):
            return float(polynomial(int(np.searchsorted(self.elongations, float(d), "right"))))

        def chosen(low: int, high: int) -> Any:
            """By halving, so that few comparisons are made."""
            if high - low == 1:
                return polynomial(low)
            middle = (low + high) // 2
            edge = self.elongations[middle - 1]
            return ufl.conditional(ufl.lt(d, edge), chosen(low, middle), chosen(middle, high))

        return chosen(0, len(starts))

    def __call__(self, d: Any) -> Any:
        """The force, a number or an expression."""
        return self._at(self._pieces[1], d)

    def energy(self, d: Any) -> Any:
        """The integral of the force from 0 to d, a number or an expression."""
        return self._at(self._works, d)
