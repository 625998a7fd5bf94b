"""Graded divisions of an interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown

from . import _check

GRADED_ENDS = ("both", "start", "end", "none")


def check_ends(owner: str, name: str, value: object) -> str:
    """One of "both", "start", "end", "none"."""
    if not isinstance(value, str) or value not in GRADED_ENDS:
        raise InputError(
            f"{owner}: {name} is {shown(value)}; it must be one of {', '.join(GRADED_ENDS)}."
        )
    return value


def graded(n: int, ratio: float = 1.0, ends: str = "both") -> NDArray[np.float64]:
    """Positions of the ends of ``n`` cells in [0, 1], geometrically graded.

    Parameters
    ----------
    n
        Number of cells.
    ratio
        Largest over smallest cell; above 1 the small cells lie at ``ends``.  As the ratio is that
        of the extremes, not of neighbours, refining keeps the distribution.
    ends
        Where the small cells lie: "both", "start", "end", or "none" for equal cells.

    Returns
    -------
    ndarray, shape (n + 1,)
        Increasing, from exactly 0 to exactly 1.

    Raises
    ------
    InputError
        ``n`` below 1, ``ratio`` not positive, ``ends`` unknown.

    Notes
    -----
    Sizes are proportional to ``ratio ** (e_i / max(e))`` where ``e_i`` counts the cells between
    cell i and the nearest graded end.
    """
    n = _check.count("graded", "n", n)
    ratio = _check.ratio("graded", "ratio", ratio)
    check_ends("graded", "ends", ends)
    i = np.arange(n)
    if ends == "none":
        steps = np.zeros(n, dtype=int)
    elif ends == "start":
        steps = i
    elif ends == "end":
        steps = i[::-1]
    else:
        steps = np.minimum(i, i[::-1])
    sizes = ratio ** (steps / max(int(steps.max()), 1))
    points = np.concatenate([[0.0], np.cumsum(sizes)])
    points /= points[-1]
    return points
