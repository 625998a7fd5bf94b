"""Root finders for places along a path: Brent's method, and a bracket of the Illinois rule."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.support.later import Later

optimize = Later("scipy.optimize")



def root(function: Callable[[float], float], low: float, high: float, **options: Any) -> float:
    """Root of a function between two places, by scipy's `brentq` with its options.

    scipy wraps the function in one that refers to itself.  So the function, with all that it holds,
    would stay until Python looks for cycles of references.  Here it is let go of at the end.
    """
    held = [function]
    try:
        return float(optimize.brentq(lambda place: held[0](place), low, high, **options))
    finally:
        held.clear()


@dataclass
class Bracket:
    """Two places on a path between which a quantity changes its sign.

    Attributes
    ----------
    low, high
        Each a place and the value of the quantity there; the values have different signs.
        `high` is the place that was tried last.
    """

    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def secant(self) -> float:
        """Where the straight line through both values is zero."""
        (a, fa), (b, fb) = self.low, self.high
        return (a * fb - b * fa) / (fb - fa)

    def narrow(self, place: float, value: float) -> None:
        """Narrow the bracket by the value at a place inside.

        If the new value has the sign of the last one, the same end of the bracket would stay again.
        Then we halve the value at this end (Illinois rule), so that both ends move to the root.
        """
        if value * self.high[1] < 0:
            self.low = self.high
        else:
            self.low = (self.low[0], self.low[1] / 2)
        self.high = (place, value)
