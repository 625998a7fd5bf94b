"""The root finder for places along a path: a bracket, narrowed by the Illinois rule."""

from __future__ import annotations

from dataclasses import dataclass


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
