"""Resuming a run from its checkpoint, if this is undamaged and belongs to the same run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cursor import Cursor
from dea_fenicsx.results.checkpoint_contents import Unusable, cursor_of, earlier_told
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.identity import difference
from dea_fenicsx.results.moment import NO_MOMENT, moment_told
from dea_fenicsx.run.step_checks import check_step
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import InputError, SolverError

FIXED_VALUE_TOLERANCE = 1e-9
"""Largest error of a fixed value of a resumed state, dimensionless."""

COLUMN_TOLERANCE = 1e-6
"""Largest difference between a measured value and that of the earlier run.

It is relative to the largest value in the column.
"""

COLUMN_ROUNDING = 1e-9
"""Values below this share of the natural size of their quantity may be rounding errors."""


def carry_on(
    folder: Folder,
    writer: FieldWriter,
    solver: NewtonSolver,
    path: Sequence[Any],
    fingerprint: Mapping[str, Any],
    columns: Sequence[str],
    record: Mapping[str, Any],
    measurements: Mapping[str, Measurement],
) -> tuple[Cursor, dict[str, Any], list[State]] | None:
    """Restore the last accepted step of an earlier run.  Collective; nothing is written.

    Parameters
    ----------
    folder, writer, solver, path
        Those of this run.
    fingerprint, columns
        What this run is, and the columns of its history.
    record, measurements
        Observables by column, and how each is measured.

    Returns
    -------
    cursor, what the checkpoint tells, earlier states; or None if there is no checkpoint

    Raises
    ------
    InputError
        If the checkpoint is damaged or made up, or belongs to another run.
    """
    found = folder.load_checkpoint()
    if found is None:
        return None
    told, states = found
    add_present_names(told)
    problem = solver.problem

    def agree(why: str | None) -> None:
        """Raise InputError on all ranks if rank 0 has a reason."""
        why = problem.comm.bcast(why, root=0)
        if why:
            raise InputError(
                f"The run in {folder.path} cannot be resumed: {why}; start anew without resume, or "
                "in another folder."
            )

    agree(difference(fingerprint, told.get("fingerprint")))
    cursor, before, why = Cursor(), list[dict[str, Any]](), None
    try:
        cursor = cursor_of(
            told, problem.scene, path, columns, [field.name for field in problem.space.fields]
        )
        before = earlier_told(told)
        if problem.comm.rank == 0 and len(states) != 1 + len(before):
            raise Unusable("it does not hold the earlier states that it tells of")
    except Unusable as error:
        why = f"its checkpoint is damaged, for {error}"
    agree(why)
    kept = []
    for k, one in enumerate((told, *before)):
        values, moment = states[k] if states else None, moment_told(one.get("moment")) or NO_MOMENT
        fits = writer.fits(values, moment)
        agree(None if fits else "its checkpoint is damaged, for its state does not fit")
        kept.append(writer.scattered(values, problem.factors | one["factors"], moment))
    if not _restored(solver, kept[0], cursor, told["references"]):
        agree("its last state is no equilibrium of this scene")
    agree(None if told["digest_agrees"] else "its checkpoint was changed after it was written")
    agree(_other_value(problem.scales, told["history"], record, measurements))
    return cursor, told, kept[1:]


def add_present_names(told: dict[str, Any]) -> None:
    """Give the rows of an earlier version the columns that have got another name since.

    What is no history is left as it is; it is refused later.
    """
    rows = told.get("history")
    if not isinstance(rows, list):
        return
    for k, row in enumerate(rows):
        if not isinstance(row, dict) or "negative_modes" in row or "inertia" not in row:
            continue
        items = [(name, value) for name, value in row.items() if name != "wall_s"]
        items.append(("negative_modes", row["inertia"]))
        if "wall_s" in row:
            items.append(("wall_s", row["wall_s"]))
        rows[k] = dict(items)


def _restored(
    solver: NewtonSolver,
    state: State,
    cursor: Cursor,
    references: Mapping[str, float],
) -> bool:
    """Put a state back; whether it is an equilibrium at the cursor's loads.  Collective."""
    problem = solver.problem
    solver.references.sizes |= references
    problem.commit(problem.anchored(problem.imposed(state)))
    change = problem.state.values[problem.fixed] - state.values[problem.fixed]
    moved = problem.comm.allreduce(float(np.max(np.abs(change), initial=0.0)), op=MPI.MAX)
    try:
        check_step(solver, cursor.step, {})
    except SolverError:
        return False
    return bool(moved <= FIXED_VALUE_TOLERANCE)


def _other_value(
    scales: Scales,
    history: Sequence[Mapping[str, Any]],
    record: Mapping[str, Any],
    measurements: Mapping[str, Measurement],
) -> str | None:
    """Why the run cannot be resumed: a column has a different value on the last state now.

    So an observable that was redefined under its old name is found.  An observable that the state
    alone does not determine, such as a clock, has the attribute ``of_the_state = False``.  None if
    all values agree.  Collective.
    """
    why = None
    for column, measure in measurements.items():
        if not getattr(record[column], "of_the_state", True):
            continue
        value = float(measure())
        known = [math.nan if row[column] is None else float(row[column]) for row in history]
        if math.isnan(known[-1]) and math.isnan(value):
            continue
        largest = max((abs(v) for v in known if math.isfinite(v)), default=0.0)
        rounding = COLUMN_ROUNDING * _size(scales, record[column].unit)
        allowed = max(COLUMN_TOLERANCE * max(largest, abs(value)), rounding)
        if why is None and not abs(known[-1] - value) <= allowed:
            why = (
                f"its column {column!r} is another observable, or one that the state alone does "
                "not determine"
            )
    return why


def _size(scales: Scales, unit: str) -> float:
    """The natural size of a quantity in a unit of SI."""
    length = scales.length
    return {
        "": 1.0, "rad": 1.0, "m": length, "m2": length**2, "m3": length**3,
        "rad_per_m": 1 / length, "per_m": 1 / length, "V": scales.potential, "C": scales.charge,
        "N": scales.force, "Pa": scales.stress, "V_per_m": scales.field,
        "F": scales.charge / scales.potential,
    }.get(unit, 1.0)  # fmt: skip
