"""The time of a stored state, and the history that belongs to it, as tables by cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dea_fenicsx.model.charge_history import ChargeHistory
from dea_fenicsx.model.memory import MOST_LEVELS
from dea_fenicsx.model.motion import MOTION, Motion
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.viscous_history import Rule, ViscousHistory
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.type_checks import is_number

MOVING = ("velocity", "acceleration", "auxiliary", "constant")
"""What of a motion stands in the table by cell."""


@dataclass(frozen=True)
class ChargeMoment:
    """What must be known of the charges of a state beside their tables.

    Attributes
    ----------
    times
        Times in s to which they belong, the newest first.
    wires
        The charge in C that has come through the wire of each electrode, at each of these times.
    closed
        Whether the switch in each of these wires is closed.
    """

    times: tuple[float, ...]
    wires: tuple[tuple[float, ...], ...]
    closed: tuple[bool, ...]


@dataclass(frozen=True)
class MomentInTime:
    """What must be known of the time of a state beside its tables.

    Attributes
    ----------
    now
        Time of the state in s.
    times
        Times in s to which the viscous strains belong, the newest first; none without a history.
    span, rule
        As of `ViscousHistory`; the rule by its name.
    charge
        The same of charges that depend on the past, None without such.
    step
        Length in s of the last step of a body in motion, 0 at a start; None where nothing moves.
    """

    now: float = 0.0
    times: tuple[float, ...] = ()
    span: float = 0.0
    rule: str = Rule.BDF2.name
    charge: ChargeMoment | None = None
    step: float | None = None

    @property
    def told(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return asdict(self)


NO_MOMENT = MomentInTime()
"""That of a state without time and without history."""


def moment_of(problem: Problem) -> MomentInTime:
    """The moment of a problem's present state."""
    histories, charge = problem.histories, None
    if problem.charges:
        found = histories[problem.charges.NAME]
        assert isinstance(found, ChargeHistory)
        wires = tuple(tuple(float(q) for q in level) for level in found.wires)
        charge = ChargeMoment(found.times, wires, found.closed)
    history = problem.history
    step = None if problem.motion is None else problem.motion.length
    if history is None:
        return MomentInTime(problem.time, charge=charge, step=step)
    return MomentInTime(problem.time, history.times, history.span, history.rule.name, charge, step)


def moment_told(found: Any) -> MomentInTime | None:
    """The moment that a checkpoint tells, or None if that cannot be one.

    A checkpoint of before there was time tells none, and an old one nothing of charges.
    """
    if found is None:
        return NO_MOMENT
    if not isinstance(found, Mapping) or {*found, "charge", "step"} != set(NO_MOMENT.told):
        return None
    now, times, span, rule = (found[key] for key in ("now", "times", "span", "rule"))
    charge, step = found.get("charge"), found.get("step")
    good = (
        is_number(now) and math.isfinite(now) and _are_times(times)
        and is_number(span) and span >= 0 and isinstance(rule, str) and rule in Rule.__members__
        and (charge is None or _tells_charges(charge))
        and (step is None or (is_number(step) and math.isfinite(step) and step >= 0))
    )  # fmt: skip
    if not good:
        return None
    if charge is not None:
        wires = tuple(tuple(float(q) for q in level) for level in charge["wires"])
        charge = ChargeMoment(tuple(map(float, charge["times"])), wires, tuple(charge["closed"]))
    step = None if step is None else float(step)
    return MomentInTime(float(now), tuple(map(float, times)), float(span), rule, charge, step)


def _are_times(found: Any) -> bool:
    """Whether something is a row of falling times, not too many."""
    return (
        isinstance(found, list | tuple) and len(found) <= MOST_LEVELS
        and all(is_number(t) and math.isfinite(t) for t in found)
        and all(a > b for a, b in pairwise(found))
    )  # fmt: skip


def _tells_charges(found: Any) -> bool:
    """Whether something tells the moment of charges."""
    if not isinstance(found, Mapping) or set(found) != {"times", "wires", "closed"}:
        return False
    times, wires, closed = found["times"], found["wires"], found["closed"]
    return (
        _are_times(times) and len(times) > 0
        and isinstance(closed, list | tuple) and all(isinstance(c, bool) for c in closed)
        and isinstance(wires, list | tuple) and len(wires) == len(times)
        and all(
            isinstance(level, list | tuple) and len(level) == len(closed)
            and all(is_number(q) and math.isfinite(q) for q in level)
            for level in wires
        )
    )  # fmt: skip


def width(problem: Problem, moment: MomentInTime) -> int | None:
    """Columns of the history's table for a problem; None if the moment is none of this problem."""
    if bool(moment.times) != bool(problem.forms.memory):
        return None
    columns = problem.forms.memory.columns * len(moment.times)
    charge = moment.charge
    if (charge is not None) != bool(problem.charges):
        return None
    if charge is not None:
        if len(charge.closed) != len(problem.scene.electrodes):
            return None
        columns += problem.charges.columns * len(charge.times)
    columns += sum(one.columns for one in problem.counted)
    if moment.step is not None:
        columns += len(MOVING) * problem.W.dofmap.list.shape[1]
    return columns


def table_of(problem: Problem, cells: int) -> np.ndarray:
    """The history of the present state in the first cells, of shape (cells, `width`)."""
    tables = [np.empty((cells, 0))]
    if history := problem.history:
        tables.append(stacked(history, cells))
    if problem.charges:
        charge = problem.histories[problem.charges.NAME]
        assert isinstance(charge, ChargeHistory)
        wide = problem.charges.columns
        tables += [level[:cells].reshape(cells, wide) for level in charge.leaks]
    for one in problem.counted:
        tables.append(one.table(problem.state.history[one.NAME], cells))
    if (motion := problem.motion) is not None:
        places = problem.W.dofmap.list[:cells]
        tables += [getattr(motion, name)[places] for name in MOVING]
    return np.hstack(tables)


def history_of(problem: Problem, table: np.ndarray, moment: MomentInTime) -> dict[str, Any]:
    """The histories that `table_of` gave, of the owned cells, by the names of their memories."""
    memory, charges, found = problem.forms.memory, problem.charges, {}
    end = strains = memory.columns * len(moment.times)
    if memory:
        found[memory.NAME] = unstacked(table[:, :strains], moment, memory.at_rest())
    if charges and moment.charge is not None:
        rest, told = charges.at_rest(), moment.charge
        leaks = []
        end = strains + charges.columns * len(told.times)
        for part in np.split(table[:, strains:end], len(told.times), axis=1):
            values = rest.leaks[0].copy()
            values[: len(table)] = part.reshape(len(table), *values.shape[1:])
            leaks.append(values)
        found[charges.NAME] = ChargeHistory(
            tuple(leaks), tuple(np.array(q) for q in told.wires), told.times, told.closed
        )  # type: ignore[assignment]
    for one in problem.counted:
        columns = table[:, end : end + one.columns]
        found[one.NAME] = one.untabled(columns)  # type: ignore[assignment]
        end += one.columns
    if moment.step is not None:
        found[MOTION] = _motion_of(problem, table, moment.step)  # type: ignore[assignment]
    return found


def _motion_of(problem: Problem, table: np.ndarray, step: float) -> Motion:
    """The motion in the last columns of a table of the owned cells.  Collective."""
    places = problem.W.dofmap.list[: len(table)]
    wide, arrays = places.shape[1], []
    for k in range(len(MOVING)):
        first = table.shape[1] - (len(MOVING) - k) * wide
        carry = dolfinx.fem.Function(problem.W)
        carry.x.array[places.ravel()] = table[:, first : first + wide].ravel()
        carry.x.scatter_forward()
        arrays.append(carry.x.array.copy())
    # What acts is the acceleration with the drag, which are kept in one.
    velocity, acceleration, auxiliary, acting = arrays
    return Motion(velocity, acceleration, auxiliary, step, 0.0, acting)


def stacked(history: ViscousHistory, cells: int) -> np.ndarray:
    """The viscous strains of the first cells, of shape (cells, times x branches x points x 6)."""
    branches, _, points, numbers = history.strains[0].shape
    width = branches * points * numbers  # stated, since a rank may have no cell
    tables = [np.moveaxis(s[:, :cells], 1, 0).reshape(cells, width) for s in history.strains]
    return np.hstack(tables)


def unstacked(table: np.ndarray, moment: MomentInTime, rest: ViscousHistory) -> ViscousHistory:
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
