"""Waves: a load factor as a function of time, with its corners and jumps.

Values are factors of a ramp of the scene: 1 is the value written there.  A wave is continuous from
the right; `before` gives the limit from the left, which differs from it at a jump only.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.support.errors import DeaError, InputError
from dea_fenicsx.support.type_checks import is_number, raised, shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, positive

TIME_TOLERANCE = 1e-12
"""Largest relative error of a time, by which two times count as one."""


def called(function: Callable[[float], Any], t: float, what: str) -> Any:
    """What a function of a script, called `what` in a message, gives at a time in s.

    Raises
    ------
    InputError
        If the function fails.
    """
    try:
        return function(t)
    except DeaError:
        raise
    except Exception as error:  # a function of the user's may do anything
        raise InputError(
            f"{what} fails at {t:g} s ({raised(error)}), but must give a finite number."
        ) from error


class Wave(ABC):
    """A load factor as a function of time in s.

    Attributes
    ----------
    begin, end
        Times in s between which it is known; infinite for most waves.
    """

    begin: float = -math.inf
    end: float = math.inf

    @abstractmethod
    def __call__(self, t: float) -> float:
        """The factor at a time, and just after it at a jump."""

    def before(self, t: float) -> float:
        """The factor just before a time."""
        return self(t)

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        """Times strictly between two others at which the wave or its slope jumps."""
        return ()

    def number_of_corners(self, start: float, end: float) -> float:
        """How many corners there are between two times, about, without a list of them."""
        return len(self.corners(start, end))

    def finest(self) -> float:
        """Longest step of time in s that shows the wave's own course; infinite if any does."""
        return math.inf

    def check(self, what: str) -> None:  # noqa: B027  a wave of the user's may have nothing to check
        """Raise InputError unless its numbers make sense; `what` names it in the message."""


@dataclass(frozen=True)
@in_si(value="")
class Constant(Wave):
    """The same factor at all times.

    Parameters
    ----------
    value
        The factor.
    """

    value: float = 1.0

    def __call__(self, t: float) -> float:
        return self.value

    def check(self, what: str) -> None:
        finite(self.value, f"The factor of {what}")


@dataclass(frozen=True)
@in_si(to="", seconds="s", start="s", low="")
class Rise(Wave):
    """A factor that changes at a constant rate, from one value to another, and then stays.

    Parameters
    ----------
    to
        The factor at the end.
    seconds
        How long the change takes, in s.
    start
        When it begins, in s.
    low
        The factor before.
    """

    to: float = 1.0
    seconds: float = 1.0
    start: float = 0.0
    low: float = 0.0

    def __call__(self, t: float) -> float:
        share = min(max((t - self.start) / self.seconds, 0.0), 1.0)
        return (1 - share) * self.low + share * self.to

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        return _inside((self.start, self.start + self.seconds), start, end)

    def check(self, what: str) -> None:
        for value in (self.to, self.start, self.low):
            finite(value, f"A number of {what}")
        positive(self.seconds, f"The duration of {what}", "a time > 0 in s")


@dataclass(frozen=True)
@in_si(to="", at="s", low="")
class Step(Wave):
    """A factor that jumps from one value to another.

    Parameters
    ----------
    to
        The factor after the jump.
    at
        When it jumps, in s.
    low
        The factor before.
    """

    to: float = 1.0
    at: float = 0.0
    low: float = 0.0

    def __call__(self, t: float) -> float:
        return self.to if t >= self.at - TIME_TOLERANCE * abs(self.at) else self.low

    def before(self, t: float) -> float:
        return self.to if t > self.at + TIME_TOLERANCE * abs(self.at) else self.low

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        return _inside((self.at,), start, end)

    def check(self, what: str) -> None:
        for value in (self.to, self.at, self.low):
            finite(value, f"A number of {what}")


@dataclass(frozen=True)
@in_si(hertz="Hz", amplitude="", mean="", phase="rad")
class _Periodic(Wave):
    """A wave about a mean: ``mean + amplitude shape(f t + phase / (2 pi))``.

    Parameters
    ----------
    hertz
        Frequency in Hz.
    amplitude, mean
        Factors.
    phase
        Phase in rad.
    """

    hertz: float
    amplitude: float = 1.0
    mean: float = 0.0
    phase: float = 0.0

    corner_phases: ClassVar[tuple[float, ...]] = ()
    """Shares of a period at which the wave or its slope jumps."""

    def turns(self, t: float) -> float:
        """Periods since phase 0."""
        return self.hertz * t + self.phase / (2 * math.pi)

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        first, last = math.floor(self.turns(start)) - 1, math.ceil(self.turns(end)) + 1
        offset = self.phase / (2 * math.pi)
        times = [
            (number + share - offset) / self.hertz
            for number in range(first, last + 1) for share in self.corner_phases
        ]  # fmt: skip
        return _inside(times, start, end)

    def number_of_corners(self, start: float, end: float) -> float:
        return self.hertz * (end - start) * len(self.corner_phases)

    def finest(self) -> float:
        return 1 / (32 * self.hertz)

    def check(self, what: str) -> None:
        positive(self.hertz, f"The frequency of {what}", "a number > 0 in Hz")
        for value in (self.amplitude, self.mean, self.phase):
            finite(value, f"A number of {what}")


class Sine(_Periodic):
    """A sine: mean + amplitude sin(2 pi f t + phase)."""

    def __call__(self, t: float) -> float:
        return self.mean + self.amplitude * math.sin(2 * math.pi * self.turns(t))


class Triangle(_Periodic):
    """A triangle: like a sine it begins at the mean, and rises."""

    corner_phases: ClassVar[tuple[float, ...]] = (0.25, 0.75)

    def __call__(self, t: float) -> float:
        turn = (self.turns(t) + 0.25) % 1.0
        return self.mean + self.amplitude * (1 - 4 * abs(turn - 0.5))


class Square(_Periodic):
    """A square wave: mean + amplitude in the first half of each period, then mean - amplitude."""

    corner_phases: ClassVar[tuple[float, ...]] = (0.0, 0.5)

    def __call__(self, t: float) -> float:
        return self._value(self.turns(t) + TIME_TOLERANCE * max(1.0, abs(self.turns(t))))

    def before(self, t: float) -> float:
        return self._value(self.turns(t) - TIME_TOLERANCE * max(1.0, abs(self.turns(t))))

    def _value(self, turns: float) -> float:
        return self.mean + (self.amplitude if turns % 1.0 < 0.5 else -self.amplitude)


@dataclass(frozen=True)
@in_si(low="Hz", high="Hz", seconds="s", amplitude="", mean="")
class Chirp(Wave):
    """A sine whose frequency changes evenly with time, and then stays.

    Parameters
    ----------
    low, high
        Frequencies at the start and at the end, in Hz.
    seconds
        How long the change takes.
    amplitude, mean
        Factors.
    """

    low: float
    high: float
    seconds: float
    amplitude: float = 1.0
    mean: float = 0.0

    def __call__(self, t: float) -> float:
        swept = min(max(t, 0.0), self.seconds)
        turns = self.low * t + (self.high - self.low) / 2 * swept**2 / self.seconds
        turns += (self.high - self.low) * max(t - self.seconds, 0.0)
        return self.mean + self.amplitude * math.sin(2 * math.pi * turns)

    def finest(self) -> float:
        return 1 / (32 * max(self.low, self.high))

    def check(self, what: str) -> None:
        for value in (self.low, self.high):
            positive(value, f"A frequency of {what}", "a number > 0 in Hz")
        positive(self.seconds, f"The duration of {what}", "a time > 0 in s")
        for value in (self.amplitude, self.mean):
            finite(value, f"A number of {what}")


@dataclass(frozen=True)
@in_si(times="s", values="")
class Table(Wave):
    """Values at times, with straight lines between them; a time that stands twice is a jump.

    Parameters
    ----------
    times
        Times in s, not falling, at least two.
    values
        The factor at each of them.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            try:
                given = np.asarray(getattr(self, name), dtype=float).ravel()
            except (TypeError, ValueError, OverflowError):
                raise InputError(
                    f"The {name} of a Table are {shown(getattr(self, name))}, but must be numbers."
                ) from None
            object.__setattr__(self, name, tuple(float(x) for x in given))

    @property
    def begin(self) -> float:  # type: ignore[override]
        return self.times[0] if self.times else math.inf

    @property
    def end(self) -> float:  # type: ignore[override]
        return self.times[-1] if self.times else -math.inf

    def __call__(self, t: float) -> float:
        k = bisect_right(self.times, t)
        if k == len(self.times):
            return self.values[-1]
        return self._line(max(k, 1), t)

    def before(self, t: float) -> float:
        k = min(bisect_left(self.times, t), len(self.times) - 1)
        return self._line(k, t) if k else self.values[0]

    def _line(self, k: int, t: float) -> float:
        (a, b), (x, y) = self.times[k - 1 : k + 1], self.values[k - 1 : k + 1]
        share = (t - a) / (b - a) if b > a else 1.0
        return (1 - share) * x + share * y

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        return _inside(self.times, start, end)

    def check(self, what: str) -> None:
        if len(self.times) != len(self.values) or len(self.times) < 2:
            raise InputError(
                f"The table of {what} has {len(self.times)} times and {len(self.values)} values, "
                "but needs the same number of both, two at least."
            )
        if not np.all(np.isfinite([*self.times, *self.values])):
            raise InputError(f"The table of {what} holds what is no finite number.")
        for k, (a, b) in enumerate(zip(self.times, self.times[1:], strict=False)):
            if b < a:
                raise InputError(
                    f"The times of the table of {what} run backwards, from {a:g} s to {b:g} s at "
                    f"row {k + 1}; sort its rows."
                )


@dataclass(frozen=True)
@in_si(at="s")
class Function(Wave):
    """Any function of time in s.

    Parameters
    ----------
    function
        Gives the factor at a time in s.  It must give the same at every call and on every rank.
    at
        Times in s at which its slope jumps.
    """

    function: Callable[[float], float]
    at: tuple[float, ...] = ()

    def __call__(self, t: float) -> float:
        value = called(self.function, t, "The function of a drive")
        if not is_number(value) or not math.isfinite(value):
            raise InputError(
                f"The function of a drive gives {shown(value)} at {t:g} s, but must give a finite "
                "number."
            )
        return float(value)

    def corners(self, start: float, end: float) -> tuple[float, ...]:
        return _inside(self.at, start, end)

    def check(self, what: str) -> None:
        if not callable(self.function) or isinstance(self.function, type):
            raise InputError(
                f"The function of {what} is {shown(self.function)}, but must be a function of the "
                "time in s."
            )
        for time in self.at:
            finite(time, f"A time of {what} at which its slope jumps")


def _inside(times: Sequence[float], start: float, end: float) -> tuple[float, ...]:
    """Those of some times that lie strictly between two others, sorted, each once."""
    room = TIME_TOLERANCE * max(abs(start), abs(end))
    return tuple(sorted({t for t in times if start + room < t < end - room}))
