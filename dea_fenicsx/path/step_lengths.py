"""The lengths of steps in time, and the estimated error of a step.

Sizes are taken from a fixed ladder, so that rounding on another number of ranks does not choose
others.

The local error of a step of BDF2 is estimated from the difference between what was found, such as
viscous strains, and the parabola through the three values before.  With the third derivative y'''
and steps h, h1, h2 (the newest first) BDF2 is wrong by E y''' and the parabola by -P y''',

    E = h^2 (h + h1)^2 / (6 (2 h + h1)),    P = h (h + h1)(h + h1 + h2) / 6,

so that the error of BDF2 is E/(E + P) of the difference.  The error of BDF3 is found in the same
way from the fourth derivative and the cubic through the four values before.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.drives.trial import MANY_LANDINGS
from dea_fenicsx.model.viscous_history import STAGE_SHARE
from dea_fenicsx.path.interpolation import lagrange_weights

RUNG = math.sqrt(2.0)
"""Ratio of neighbouring sizes on the ladder.

BDF2 is stable if each step is at most 2.41 times as long as the last one, BDF3 up to 1.53 times.
"""

MOST_GROWTH_OF_BDF3 = 1.5
"""Largest growth of a step of BDF3, which is just above `RUNG`."""

SAFETY = 0.8
"""Share of the step that the error estimate allows."""

GROWTH_MARGIN = 1.2
"""The step grows by a rung only if the estimate allows this many times the larger size."""

LONGEST_LAST_STEP = 1.25
"""Largest remainder before a landing, in units of the present step, that is gone in one step."""

CLOCK_STEP = 2.0**-44
"""Shortest step in units of the time of the problem, which is rounded to 2^-53 of itself."""


def landings(
    corners: Iterable[float], asked: Iterable[float], end: float, room: float
) -> list[float]:
    """Times at which a step of a march ends: corners of the drive, asked times, and the end.

    Of times that lie closer together than `room`, only the first counts.  Times are in s since the
    beginning of the march.
    """
    found: list[float] = []
    for t in sorted([*corners, *(t for t in asked if t < end - room)]):
        if not found or t > found[-1] + room:
            found.append(t)
    return [*found, end]


def next_after(times: Sequence[float], now: float, room: float) -> float:
    """The first of some sorted times that lies later than `now` by more than `room`."""
    return times[bisect_right(times, now + room)]


def is_among(times: Sequence[float], now: float, room: float) -> bool:
    """Whether one of some sorted times lies within `room` of `now`."""
    k = bisect_left(times, now - room)
    return k < len(times) and times[k] <= now + room


def tell_landings(stops: Sequence[float], longest: float, log: Callable[[str], None]) -> None:
    """Log how many steps a march has at least, in view of its landings, if these are many."""
    steps = max(len(stops), stops[-1] / longest)
    if steps >= MANY_LANDINGS:
        log(
            f"march: it takes at least {steps:.0f} steps for {stops[-1]:g} s, of which "
            f"{len(stops)} end at corners of the drive or at asked times"
        )


@dataclass(frozen=True)
class StepSizes:
    """The sizes of steps: the longest one over powers of sqrt(2).

    Attributes
    ----------
    longest
        In s.
    """

    longest: float

    def size(self, rung: int) -> float:
        """Size in s of a rung; rung 0 is the longest."""
        return self.longest * RUNG**-rung

    def at_most(self, seconds: float) -> int:
        """The rung of the longest size that is not longer than this."""
        return max(0, math.ceil(math.log(self.longest / seconds) / math.log(RUNG) - 1e-9))

    def portion(self, rung: int, left: float) -> float:
        """Length of the next step, where so much time is left before a landing.

        A remainder of up to two steps is halved, so that no step is much shorter than the last.
        """
        size = self.size(rung)
        if left < LONGEST_LAST_STEP * size:
            return left
        return left / 2 if left < 2 * size else size

    def next_rung(self, rung: int, allowed: float, most: int = 2) -> int:
        """The rung after a step whose error allows a size, at most so many rungs up."""
        wanted = SAFETY * allowed
        if wanted < self.size(rung):
            return self.at_most(wanted)
        for up in range(most, 0, -1):
            if rung >= up and wanted > GROWTH_MARGIN * self.size(rung - up):
                return rung - up
        return rung


def estimate(
    times: Sequence[float], values: Sequence[np.ndarray], order: int = 2, corner: bool = False
) -> np.ndarray | None:
    """Estimated error of the newest values; None with too short a history.

    A step of BDF2 is compared with the parabola, one of backward Euler (`order` 1) with the
    straight line through the two values before, whose error is -h (h + h1)/2 y'' against h^2/2 y''.
    In a step that begins at a `corner` of the drive, y'' jumps, and BDF2 is wrong by as much as the
    parabola; the whole difference is then the estimate.

    Parameters
    ----------
    times, values
        Times in s, the newest first, and what was found at each.
    """
    if len(times) < order + 2:
        return None
    h, h1 = times[0] - times[1], times[1] - times[2]
    if order == 3:
        return _estimate_of_cubic(np.array(times[:5]), values)
    if order == 1:
        line = values[1] + h / h1 * (values[1] - values[2])
        return np.asarray((values[0] - line) * h / (2 * h + h1))
    h2 = times[2] - times[3]
    weights = lagrange_weights(np.array(times[1:4]), times[0])
    parabola = sum(w * s for w, s in zip(weights, values[1:4], strict=True))
    if corner:
        return np.asarray(values[0] - parabola)
    wrong = h**2 * (h + h1) ** 2 / (6 * (2 * h + h1))
    off = h * (h + h1) * (h + h1 + h2) / 6
    return np.asarray((values[0] - parabola) * wrong / (wrong + off))


def _estimate_of_cubic(times: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
    """Estimated error of the newest value of BDF3.

    Both the rule and the cubic are tried on the fourth power of the time since the newest value,
    which is 0 there: what they give is their error, in units of the fourth derivative over 24.
    """
    back = (times[0] - times[1:]) / (times[0] - times[1])
    cubic = lagrange_weights(-back, 0.0)
    off = float(cubic @ back**4)
    # The derivative of the cubic through the newest value and three before: a_0 y_0 + sum a_k y_k.
    b = back[:3]
    others = ((0, 1, 2), (1, 0, 2), (2, 0, 1))
    a = np.array([-b[j] * b[k] / (b[i] * (b[j] - b[i]) * (b[k] - b[i])) for i, j, k in others])
    wrong = -float(a @ b**4) / float(np.sum(1 / b))
    guess = sum(w * s for w, s in zip(cubic, values[1:5], strict=True))
    return np.asarray((values[0] - guess) * wrong / (wrong - off))


def stage_estimate(new: np.ndarray, old: np.ndarray, stage: np.ndarray) -> np.ndarray:
    """Estimated error of a step of SDIRK2 from its beginning and the end of its first stage.

    It is compared with backward Euler's rule over the first stage, continued to the end of the
    step, which has order 1.
    """
    return np.asarray(new - old - (stage - old) / STAGE_SHARE)


def growth(iterations: int) -> float:
    """How much longer the next step is after one with some iterations of Newton's method."""
    return 1.5 if iterations <= 3 else 1.0 if iterations <= 6 else 0.7


def just_beyond(arc: float, was: float | None, left: float | None) -> float:
    """An arc that reaches a little beyond the end of the trace.

    It is extrapolated from the part of the gap that the last arc has closed.
    """
    if was is None or left is None or left * (was - left) <= 0:
        return np.inf
    return arc * max(1.1 * left / (was - left), 0.05)
