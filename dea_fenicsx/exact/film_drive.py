"""What drives a film in time: the field or charge and what acts on its sides, in smooth pieces."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import chebyshev

from dea_fenicsx.drives.trial import check_pace
from dea_fenicsx.drives.waves import Constant, Function, Wave
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown

DRIVE_DEGREE = 24
"""Where the rate of a drive is needed, a polynomial of this degree takes the place of the drive."""

COEFFICIENT_TOLERANCE = 3e-14
"""Such a polynomial is fine enough if its last coefficients, over the largest one, are smaller."""


def as_wave(value: Wave | Callable[[float], float] | float, what: str) -> Wave:
    """A wave from a wave, a number or a function of time.

    Raises
    ------
    InputError
        For anything else, and for a wave whose numbers make no sense.
    """
    if isinstance(value, Wave):
        wave = value
    elif is_number(value):
        wave = Constant(float(value))  # type: ignore[arg-type]
    elif callable(value):
        wave = Function(value)
    else:
        raise InputError(
            f"The {what} is {shown(value)}, but must be a number, a wave or a function of time."
        )
    wave.check(f"the {what}")
    return wave


class FilmLoads:
    """Three waves together: the field or charge, and what acts on the two sides.

    Parameters
    ----------
    waves
        The waves.
    seconds
        How long they are needed.
    """

    def __init__(self, waves: Sequence[Wave], seconds: float, names: Sequence[str]):
        self.waves, self.seconds = tuple(waves), seconds
        for wave, name in zip(waves, names, strict=True):
            if wave.begin > 0:
                raise InputError(
                    f"The wave of {name} begins at {wave.begin:g} s, but the march begins at 0; "
                    "give it values from there on."
                )
            if wave.end < seconds * (1 - 1e-12):
                raise InputError(
                    f"The wave of {name} ends at {wave.end:g} s, but the march lasts {seconds:g} "
                    "s; give it values up to there."
                )
            check_pace({f"the wave of {name}": wave}, seconds)

    def at(self, t: float) -> np.ndarray:
        """Values at a time, after a jump there, shape (3,)."""
        return np.array([wave(t) for wave in self.waves])

    def before(self, t: float) -> np.ndarray:
        """Values just before a time, shape (3,)."""
        return np.array([wave.before(t) for wave in self.waves])

    def corners(self) -> list[float]:
        """Start and end, and in between all times at which a wave or its slope jumps."""
        found = {t for wave in self.waves for t in wave.corners(0.0, self.seconds)}
        return [0.0, *sorted(found), self.seconds]

    def finest(self) -> float:
        return min(wave.finest() for wave in self.waves)

    def inside(self, t: float, low: float, high: float) -> np.ndarray:
        """Values within a smooth piece: at its ends the limits from inside."""
        return self.at(low) if t <= low else self.before(high) if t >= high else self.at(t)

    def several(self, t: np.ndarray, low: float, high: float) -> np.ndarray:
        """The same for several times, shape (3, N)."""
        return np.array([self.inside(float(s), low, high) for s in t]).reshape(-1, 3).T


class Window:
    """Loads on an interval without corners as polynomials, which have exact rates.

    Parameters
    ----------
    loads, low, high
        The loads and their smooth piece.
    start, end
        The interval, within the piece.  It is shortened until the polynomials are fine enough.
    """

    def __init__(self, loads: FilmLoads, piece: tuple[float, float], start: float, end: float):
        nodes = np.cos(np.pi * np.arange(DRIVE_DEGREE + 1) / DRIVE_DEGREE)
        for _ in range(60):
            t = start + (end - start) * (nodes + 1) / 2
            values = loads.several(t, *piece)
            c = chebyshev.chebfit(nodes, values.T, DRIVE_DEGREE)
            size = np.maximum(np.abs(c).max(axis=0), 1e-300)
            if np.all(np.abs(c[-4:]).max(axis=0) <= COEFFICIENT_TOLERANCE * size * 10):
                break
            end = (start + end) / 2
        c[np.abs(c) < COEFFICIENT_TOLERANCE * size] = 0.0
        self.start, self.end = start, end
        self._c, self._d = c, chebyshev.chebder(c, axis=0)

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Values at times (N,), shape (3, N)."""
        return chebyshev.chebval(self._local(t), self._c)

    def rates(self, t: np.ndarray) -> np.ndarray:
        """Derivatives at times (N,) in 1/s, shape (3, N)."""
        return chebyshev.chebval(self._local(t), self._d) * 2 / (self.end - self.start)

    def _local(self, t: np.ndarray) -> np.ndarray:
        return 2 * (t - self.start) / (self.end - self.start) - 1


class Jump:
    """Loads that pass from one value to another along a straight line, over a share 0 to 1."""

    start, end = 0.0, 1.0

    def __init__(self, before: np.ndarray, after: np.ndarray):
        self._before, self._change = before.reshape(3, 1), (after - before).reshape(3, 1)

    def __call__(self, share: np.ndarray) -> np.ndarray:
        return self._before + self._change * share

    def rates(self, share: np.ndarray) -> np.ndarray:
        return self._change + 0 * share


def checked_seconds(seconds: float) -> float:
    """A duration in s."""
    if not is_number(seconds) or not seconds > 0 or not math.isfinite(seconds):
        raise InputError(f"The march lasts {shown(seconds)} s, but must last a finite time > 0.")
    return float(seconds)
