"""Frequencies that are put where a response changes fast: around its resonances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from dea_fenicsx.measure.vibration import vibrations
from dea_fenicsx.path.items import Response
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import InputError

SMALLEST_SPACING = 1e-4
"""Smallest distance of two frequencies over the higher one: half the width of a peak with Q =
1e4.
"""

NEGLIGIBLE_AMPLITUDE = 0.02
"""Changes are ignored below this share of the median amplitude at the frequencies asked for."""

MOST_FREQUENCIES = 1000
"""Largest number of frequencies in one response."""

MODE_COUNTS = (6, 12, 24, 48)
"""We ask for this many modes, one number after another, until they lie above all frequencies."""

Answer = Callable[[float], np.ndarray]
"""Gives the complex amplitudes of all observables at a frequency."""


def refined(
    answer: Answer, hertz: Sequence[float], resonances: Sequence[float], share: float
) -> tuple[dict[float, np.ndarray], str]:
    """Answers at the frequencies asked for and at further ones in between.  Collective.

    Two neighbours are close enough where no observable changes by more than `share` of the larger
    amplitude of both.  Otherwise the middle between them is added.

    Parameters
    ----------
    answer
        Gives the complex amplitudes at a frequency in Hz.
    hertz
        Frequencies that are asked for.
    resonances
        Frequencies in Hz near which the search begins.  They themselves are left out, since an
        undamped device has no answer there.
    share
        Largest change.

    Returns
    -------
    dict
        Amplitudes by frequency in ascending order.
    str
        What must be known of them, or empty.
    """
    found = {f: answer(f) for f in sorted(set(hertz))}
    if not next(iter(found.values())).size:
        return found, ""
    low = NEGLIGIBLE_AMPLITUDE * np.median(np.abs(list(found.values())), axis=0)
    for f in _beside(list(found), resonances):
        found[f] = answer(f)
    ends = sorted(found)
    waiting = list(itertools.pairwise(ends))[::-1]
    while waiting and len(found) < MOST_FREQUENCIES:
        start, end = waiting.pop()
        size = np.maximum(np.maximum(np.abs(found[start]), np.abs(found[end])), low)
        near = end - start <= 3 * SMALLEST_SPACING * end
        if near or np.all(np.abs(found[end] - found[start]) <= share * size):
            continue
        middle = (start + end) / 2
        found[middle] = answer(middle)
        waiting += [(middle, end), (start, middle)]
    note = ""
    if waiting:
        note = (
            f"There are {MOST_FREQUENCIES} frequencies, and up to {waiting[-1][0]:.9g} Hz "
            "neighbours differ as little as asked for; ask for fewer frequencies at once to see "
            "what lies above."
        )
    return dict(sorted(found.items())), note


def _beside(hertz: Sequence[float], resonances: Sequence[float]) -> list[float]:
    """Frequencies on both sides of each resonance within those asked for."""
    low, high = min(hertz), max(hertz)
    both = {f * (1 + side * SMALLEST_SPACING) for f in resonances for side in (-1, 1)}
    return sorted(f for f in both if low < f < high and f not in hertz)


def resonances(solver: NewtonSolver, highest: float) -> list[float]:
    """Frequencies in Hz of the undamped modes up to the highest of interest.  Collective.

    Viscous branches respond at once, or are relaxed.  There are none where the tangent is not
    symmetric; the search then begins at the frequencies asked for alone.
    """
    ways: tuple[Response, ...] = ("instantaneous",)
    if solver.problem.forms.memory:
        ways = ("instantaneous", "relaxed")
    found: set[float] = set()
    for way in ways:
        found |= set(_modes(solver, highest, way))
    return sorted(found)


def _modes(solver: NewtonSolver, highest: float, response: Response) -> list[float]:
    known: list[float] = []
    for count in MODE_COUNTS:
        try:
            squares = [mode.square for mode in vibrations(solver, count, response)]
        except InputError:  # there are fewer modes, or none that can be found
            break
        known = [math.sqrt(square) / (2 * math.pi) for square in squares if square > 0]
        if squares[-1] > (2 * math.pi * highest) ** 2:
            break
    return [f for f in known if f <= highest]
