"""The parts of a branch that are stable, and those that are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dea_fenicsx.results.summary import CRITICAL


def stability_intervals(
    history: Sequence[Mapping[str, Any]], column: str, first: int = 0
) -> list[dict[str, Any]]:
    """Parts of a branch with one number of negative eigenvalues each, in the order of travel.

    Parts meet at the limit point or bifurcation between them.  Where none was located, a part
    begins with the first state that has its number.

    Parameters
    ----------
    history
        The accepted steps.
    column
        The column of the load.
    first
        The row with which the branch begins.

    Returns
    -------
    list of dict
        ``negative_modes``; ``from_step`` and ``to_step``, the two ends; ``from`` and ``to``, the
        load there in the unit of its column.
    """
    parts: list[dict[str, Any]] = []
    critical: list[int] = []
    for k in range(first, len(history)):
        row = history[k]
        if row["event"] in CRITICAL:  # the tangent is singular there
            critical.append(k)
            continue
        if not row["inertia_is_of_this_step"] or row["inertia"] is None:
            continue
        if not parts:
            parts.append({"negative_modes": row["inertia"], "from_step": first})
        for count, at in _passed(parts[-1]["negative_modes"], row["inertia"], critical, k):
            parts[-1]["to_step"] = at
            parts.append({"negative_modes": count, "from_step": at})
        parts[-1]["to_step"], critical = k, []
    if parts and critical:
        parts[-1]["to_step"] = critical[0]
    for part in parts:
        part["from"], part["to"] = (
            float(history[part[end]][column]) for end in ("from_step", "to_step")
        )
    return parts


def _passed(
    before: int, after: int, critical: Sequence[int], row: int
) -> list[tuple[int, int]]:
    """The numbers of negative eigenvalues that follow each other in a step, and where.

    Each of its critical points changes the number by one, and the last one by the rest.  Where this
    does not fit, as if one goes up and another one down, the last one is given all of the change.
    """
    change = after - before
    if change == 0:
        return []
    if not critical:
        return [(after, row)]
    fits = len(critical) <= abs(change)
    towards = 1 if change > 0 else -1
    earlier = critical[:-1] if fits else []
    found = [(before + towards * (k + 1), at) for k, at in enumerate(earlier)]
    return [*found, (after, critical[-1])]


def multiplicity(history: Sequence[Mapping[str, Any]], row: int) -> int | None:
    """How many eigenvalues pass zero at a bifurcation; None if that was not counted.

    Where several bifurcations lie between two steps, what the others do not explain by one each is
    the last one's.

    Parameters
    ----------
    history
        The accepted steps.
    row
        The row of the bifurcation.
    """

    def counted(rows: range) -> tuple[int, list[int]] | None:
        passed = []
        for k in rows:
            if history[k]["event"] in CRITICAL:
                passed.append(k)
            elif history[k]["inertia_is_of_this_step"] and history[k]["inertia"] is not None:
                return history[k]["inertia"], passed
        return None

    before = counted(range(row - 1, -1, -1))
    after = counted(range(row + 1, len(history)))
    if before is None or after is None:
        return None
    if after[1]:
        return 1
    return max(1, abs(after[0] - before[0]) - len(before[1]))
