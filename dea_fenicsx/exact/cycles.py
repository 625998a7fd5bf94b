"""Steady cycles of a film under a periodic drive: the state at the start of a cycle repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dea_fenicsx.exact.course import Course
from dea_fenicsx.exact.film import Film
from dea_fenicsx.exact.film_drive import checked_seconds
from dea_fenicsx.exact.integration import INTEGRATION_TOLERANCE
from dea_fenicsx.exact.marching import Drive, Drives
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si

CYCLE_TOLERANCE = 1e-11
"""Largest change of a branch's logarithm over a cycle that counts as none."""

MOST_CYCLES = 200


def steady_cycle(
    film: Film,
    period: float,
    *,
    voltage: Drive | None = None,
    field: Drive | None = None,
    charge: Drive | None = None,
    sides: tuple[Drive | None, Drive | None] = (None, None),
    tolerance: float = INTEGRATION_TOLERANCE,
) -> Course:
    """The cycle that a film repeats under a periodic drive, after all transients.

    Its state at the start is found by a quasi-Newton method (Broyden's) on the change over a cycle,
    so that relaxation times much longer than the period cost no more cycles.  `Course.balance`
    tells what a cycle dissipates, `Course.draw` draws its hysteresis loops.

    Parameters
    ----------
    period
        Period in s.  What the drives do from time 0 to there is repeated.
    film, voltage, field, charge, sides, tolerance
        As in `march`.

    Raises
    ------
    InputError
        If the film pulls in on the way.

    Notes
    -----
    A branch of infinite relaxation time never changes: it stays as in an undeformed film.
    """
    period = checked_seconds(si(period, "s", "The period"))
    drives = Drives.of(film, period, (voltage, field, charge), sides)
    cycle = drives.march("undeformed", tolerance)
    state = cycle._state
    tau = np.broadcast_to(state.tau, (state.count, 2, 1)).ravel()
    moves = np.isfinite(tau)
    # at first each branch is taken to forget its start as exp(-t/tau)
    inverse = np.diag(-1 / np.expm1(-period / tau[moves]))
    a = np.zeros(len(tau))
    step = last = np.zeros(0)
    for number in range(MOST_CYCLES):
        if cycle.pull_in is not None:
            raise InputError(
                f"The film has no steady cycle: it loses its equilibrium at "
                f"{cycle.pull_in.time:g} s of a cycle."
            )
        place, loads = cycle.end_for(state)
        change = (place.a.ravel() - a)[moves]
        if np.abs(change).max(initial=0.0) < CYCLE_TOLERANCE:
            return cycle
        if number:
            moved = inverse @ (last - change)
            if step @ moved:
                inverse = inverse + np.outer(step - moved, step @ inverse) / (step @ moved)
        step, last = inverse @ change, change
        step = step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-300))
        a[moves] += step
        free = a.reshape(state.count, 2)
        y, _ = state.equilibrium(place.y[:, None], free[..., None], loads[:, None])
        if np.isnan(y).any():
            a[moves] += change - step  # too far: go on with the plain next cycle
            step, free, y = change, a.reshape(state.count, 2), place.y[:, None]
        cycle = drives.march_from(state, replace(place, a=free.copy(), y=y[:, 0]), loads, tolerance)
    raise InputError(f"No steady cycle was found within {MOST_CYCLES} cycles.")
