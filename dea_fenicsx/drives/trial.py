"""Drives are tried before a march: that they give numbers, and how many steps they ask for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dea_fenicsx.drives.waves import Wave, called
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite

MOST_STEPS_OF_MARCH = 1_000_000
"""Most steps of a march, whether they are asked for by number or by its drives."""

MANY_LANDINGS = 10_000
"""Landings of a march from which on their number is told."""

SHORTEST_TIME = 1e-300
"""A time in s that is shorter than each step of any march."""

TRIED_TIMES = np.linspace(0, 1, 33)
"""Shares of a march at which a drive is tried."""


def check_numbers(wave: Wave, what: str, seconds: float) -> None:
    """Raise InputError unless a wave gives a finite number at some times from 0 to `seconds`."""
    name = f"{what[:1].upper()}{what[1:]}"
    for time in map(float, TRIED_TIMES * seconds):
        finite(called(wave, time, name), f"{name} at {time:g} s")


def check_pace(waves: Mapping[str, Wave], seconds: float, follows: bool = True) -> None:
    """Raise InputError if a wave asks for more than `MOST_STEPS_OF_MARCH` steps within a time in s.

    A step ends at each corner of a wave, and is not longer than what shows the wave's own course.

    Parameters
    ----------
    waves, seconds
        The waves, with the names by which a message calls them, and how long they are needed.
    follows
        Whether the length of steps follows the course of the waves; else only corners count.
    """
    for what, wave in waves.items():
        corners = wave.number_of_corners(0.0, seconds)
        steps = max(corners, seconds / max(wave.finest(), SHORTEST_TIME) if follows else 0.0)
        if not steps <= MOST_STEPS_OF_MARCH:
            raise InputError(
                f"{what[:1].upper()}{what[1:]} needs at least {steps:.3g} steps for {seconds:g} s, "
                f"of which {corners:.3g} end at its corners, but a march has at most "
                f"{MOST_STEPS_OF_MARCH:.0e}; give a lower frequency (in Hz), fewer rows, or a "
                "shorter time (in s)."
            )
