"""The time of a stored state, and the viscous strains that belong to it, as tables by cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dea_fenicsx.model.memory import LEVELS
from dea_fenicsx.model.state import State
from dea_fenicsx.model.viscous_history import Rule, ViscousHistory
from dea_fenicsx.support.type_checks import is_number


@dataclass(frozen=True)
class Moment:
    """What must be known of the time of a state beside its tables.

    Attributes
    ----------
    now
        Time of the state in s.
    times
        Times in s to which the viscous strains belong, the newest first; none without a history.
    span, rule
        As of `ViscousHistory`; the rule by its name.
    """

    now: float = 0.0
    times: tuple[float, ...] = ()
    span: float = 0.0
    rule: str = Rule.BDF2.name

    @property
    def told(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return asdict(self)


NO_MOMENT = Moment()
"""That of a state without time and without history."""


def moment_of(state: State, history: ViscousHistory | None) -> Moment:
    """The moment of a state with its history, if it has one."""
    if history is None:
        return Moment(state.time)
    return Moment(state.time, history.times, history.span, history.rule.name)


def moment_told(found: Any) -> Moment | None:
    """The moment that a checkpoint tells, or None if that cannot be one.

    A checkpoint of before there was time tells none.
    """
    if found is None:
        return NO_MOMENT
    if not isinstance(found, Mapping) or set(found) != set(NO_MOMENT.told):
        return None
    now, times, span, rule = (found[key] for key in ("now", "times", "span", "rule"))
    good = (
        is_number(now) and math.isfinite(now) and isinstance(times, list | tuple)
        and len(times) <= LEVELS and all(is_number(t) and math.isfinite(t) for t in times)
        and all(a > b for a, b in pairwise(times))
        and is_number(span) and span >= 0 and rule in Rule.__members__
    )  # fmt: skip
    return Moment(float(now), tuple(map(float, times)), float(span), rule) if good else None


def stacked(history: ViscousHistory, cells: int) -> np.ndarray:
    """The viscous strains of the first cells, of shape (cells, times x branches x points x 6)."""
    width = len(history.strains[0]) * int(np.prod(history.strains[0].shape[2:]))
    tables = [np.moveaxis(s[:, :cells], 1, 0).reshape(cells, width) for s in history.strains]
    return np.hstack(tables)


def unstacked(table: np.ndarray, moment: Moment, rest: ViscousHistory) -> ViscousHistory:
    """The history that `stacked` gave.

    Parameters
    ----------
    table
        What it gave, of the owned cells.
    moment
        The times.
    rest
        The history of the undeformed body, which gives the shape, and the values in ghost cells.
    """
    if not moment.times:
        return rest
    branches, _, points, numbers = rest.strains[0].shape
    strains = []
    for part in np.split(table, len(moment.times), axis=1):
        values = rest.strains[0].copy()
        mine = part.reshape(len(table), branches, points, numbers)
        values[:, : len(table)] = np.moveaxis(mine, 0, 1)
        strains.append(values)
    return ViscousHistory(tuple(strains), moment.times, moment.span, Rule[moment.rule])
