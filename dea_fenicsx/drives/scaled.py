"""A wave times a number."""

from __future__ import annotations

from dea_fenicsx.drives.waves import Wave


class ScaledWave(Wave):
    """A wave times a number.

    Parameters
    ----------
    wave
        The wave.
    factor
        The number.
    """

    def __init__(self, wave: Wave, factor: float) -> None:
        self.wave, self.factor = wave, factor
        self.begin, self.end = wave.begin, wave.end

    def __call__(self, t: float) -> float:
        return self.factor * self.wave(t)

    def before(self, t: float) -> float:
        return self.factor * self.wave.before(t)

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        return self.wave.corners(start, end)

    def number_of_corners(self, start: float, end: float) -> float:
        return self.wave.number_of_corners(start, end)

    def finest(self) -> float:
        return self.wave.finest()
