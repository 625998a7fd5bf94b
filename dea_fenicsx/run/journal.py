"""The journal of a run: it measures, writes and reports each accepted step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from dea_fenicsx.measure.failures import Gauge, Worst
from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.motion import MOTION
from dea_fenicsx.path.cursor import AcceptedStep, Cursor
from dea_fenicsx.path.items import Item, Trace
from dea_fenicsx.path.marching import LOST
from dea_fenicsx.results import columns
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.history import History
from dea_fenicsx.results.kept_states import KeptStates
from dea_fenicsx.results.stored_state import about, keep_state
from dea_fenicsx.results.trail import Trail
from dea_fenicsx.run.step_checks import CheckedStep, check_step
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import NegativePivots
from dea_fenicsx.support.errors import MachineError
from dea_fenicsx.support.progress import Progress, step_line


@dataclass
class Journal:
    """The accepted steps of a run, one after another.

    Attributes
    ----------
    solver
        The nonlinear solver; its problem holds the state of the step that is accepted.
    path
        The ramps, traces and marches.
    stability
        When negative eigenvalues are counted, see `solve`.
    measurements
        How each recorded observable is measured, by the name of its column.
    gauges
        The failures that are watched.
    progress
        Prints a line for each step.
    folder, writer
        Where steps are written, or None.
    identity
        Returns the fingerprint of this run for its checkpoint.  Collective at its first call.
    history
        One row for each step.
    found
        The first occurrence of each failure.
    states
        The latest states, in memory.
    notes
        What is told of an event beside its loads, by the number of its step.
    earlier_s
        Wall time in s of the earlier run that this one continues.
    start
        Where the path begins, as the summary tells it; None in the undeformed state.
    keeps
        Whether the states of all steps are kept in the folder.
    """

    solver: NewtonSolver
    path: Sequence[Item]
    stability: str
    measurements: Mapping[str, Measurement]
    gauges: Sequence[Gauge]
    progress: Progress
    folder: Folder | None
    writer: FieldWriter | None
    identity: Callable[[], dict[str, Any]]
    history: History = field(default_factory=History)
    found: list[dict[str, Any]] = field(default_factory=list)
    states: KeptStates = field(default_factory=KeptStates)
    notes: dict[str, dict[str, Any]] = field(default_factory=dict)
    earlier_s: float = 0.0
    start: dict[str, Any] | None = None
    started: float = field(default_factory=time.perf_counter)
    keeps: bool = False
    _counts: tuple[int, int, int] = (0, 0, 0)
    _step_started: float = 0.0
    _way_from: tuple[int, Any] | None = None

    @property
    def scene(self) -> Any:
        return self.solver.problem.scene

    @property
    def seconds(self) -> float:
        """Wall time of the run in s, including that of the earlier run that it continues."""
        return self.earlier_s + time.perf_counter() - self.started

    @cached_property
    def fingerprint(self) -> dict[str, Any]:
        """The fingerprint of this run, by which it is recognised.  Collective at its first use."""
        return self.identity()

    @cached_property
    def trail(self) -> Trail:
        """The states of this run that its checkpoint holds."""
        assert self.writer
        return Trail(self.writer)

    @cached_property
    def about(self) -> dict[str, Any]:
        """What another run must know of this one's state, to start from it."""
        return about(self.solver.problem)

    def begin(self, cursor: Cursor | None) -> None:
        """Tell that the path begins here."""
        self._step_started = time.perf_counter()
        self.progress.begin(self.share(cursor) if cursor else 0.0)

    def accept(self, step: AcceptedStep) -> None:
        """Measure, write and tell of an accepted step.  Collective."""
        solver, cursor = self.solver, step.cursor
        known = solver.inertia.is_of(step.state)
        wanted = self.stability == "every" or (self.stability == "last" and step.last)
        counting = time.perf_counter()
        moves = MOTION in step.state.history
        if moves:  # a count tells nothing of a body in motion
            solver.inertia = NegativePivots()
        elif wanted and not known:
            self.progress.stage("counting negative modes")
            solver.refresh_inertia(last=step.last)
        counting = time.perf_counter() - counting
        spent = self._spent()
        now = time.perf_counter()
        measured = {name: measure() for name, measure in self.measurements.items()}
        checked = check_step(solver, cursor.step, measured, step.held)
        read = [(g.failure, *g.measure()) for g in self.gauges]
        row = self._place(step) | measured | self._extremes(checked)
        row |= {failure.column: found.value for failure, found, _ in read}
        row |= self._effort(step, checked, spent) | {
            "wall_s": self.earlier_s + now - self.started
        }
        self.history.append(row)
        if step.note:
            self.notes[str(cursor.step)] = dict(step.note)
        worst = {failure.name: found for failure, found, _ in read}
        if step.event in worst:
            self._note_failure(step.event, row, worst[step.event])
        elif step.event == LOST:
            electric = any(f and self.scene.is_electric(n) for n, f in step.state.factors.items())
            self._note_failure("pull-in" if electric else LOST, row, None)
        elif self._is_pull_in(step):
            self._note_failure("pull-in", row, None)
        if self.folder and self.writer:
            self._write(step, row, {f.column: values for f, _, values in read})
        item = self.path[min(cursor.ramp, len(self.path) - 1)]
        self.states.put(len(self.history) - 1, step.state, item, cursor.began)
        self._report(row, now - self._step_started, self.share(cursor), counting)
        self._step_started = time.perf_counter()

    # ------------------------------------------------------------------ a row's columns

    def _spent(self) -> list[int]:
        """Newton and Krylov iterations and factorisations since the last step."""
        counters, before = self.solver.counters, self._counts
        self._counts = (counters.newton, counters.krylov, counters.factorisations)
        return [now - then for now, then in zip(self._counts, before, strict=True)]

    def _place(self, step: AcceptedStep) -> dict[str, Any]:
        """Where on the path a step lies, and its loads."""
        cursor = step.cursor
        row: dict[str, Any] = {
            "step": cursor.step,
            "time": cursor.ramp + cursor.position,
            "ramp": step.label,
            "event": step.event,
        }
        if columns.has_time(self.path):
            row["time_s"] = step.state.time
        for name in self.scene.ramps:
            key, unit = columns.load_column(self.scene, name)
            row[key] = step.state.factors[name] * unit
        return row

    def _extremes(self, checked: CheckedStep) -> dict[str, Any]:
        """The largest electric field, and where it is."""
        problem, probe = self.solver.problem, checked.probe
        if problem.potential is None:
            return {}
        places = zip("xyz", probe.place, strict=True)
        return {
            "max_field_V_per_m": probe.max_field * problem.scales.field,
            **{f"max_field_{axis}_m": float(x) * problem.scales.length for axis, x in places},
        }

    def _effort(
        self, step: AcceptedStep, checked: CheckedStep, spent: Sequence[int]
    ) -> dict[str, Any]:
        """The errors of a step, and the work that it took."""
        inertia = self.solver.inertia
        return {
            "min_J": checked.probe.solid_J,
            "volume_error": checked.volume_error,
            "residual": checked.residual,
            "newton_iterations": spent[0],
            "krylov_iterations": spent[1],
            "factorisations": spent[2],
            "retries": step.retries,
            "inertia": inertia.excess,
            "inertia_is_of_this_step": int(inertia.is_of(step.state)),
            "negative_modes": inertia.excess,
        }

    # ------------------------------------------------------------------ writing and telling

    def _write(
        self, step: AcceptedStep, row: dict[str, Any], by_cell: Mapping[str, np.ndarray]
    ) -> None:
        """Write an accepted step.  A run can be resumed from it unless it is an event."""
        assert self.folder and self.writer
        now, *earlier = self.trail.gathered(step.state, () if step.event else step.earlier)
        place = {
            "cursor": asdict(step.cursor),
            **now[1],
            "fingerprint": self.fingerprint,
            "about": self.about,
        }
        told = None if step.event else {
            **place,
            "history": self.history,
            "earlier": [facts for _, facts in earlier],
            "start": self.start,
            "references": self.solver.references.sizes,
            "failures": self.found,
            "notes": self.notes,
            "wall_s": row["wall_s"],
        }  # fmt: skip
        evaluated = self.writer.evaluate()
        cells = self.writer.cell_fields(evaluated)
        for column, mine in by_cell.items():
            values = self.writer.gather(mine)
            if cells is not None and values is not None:
                cells[column] = values
        nodes, state = self.writer.node_fields(), now[0]
        states = [state, *(values for values, _ in earlier)]
        shape = self.writer.vector(step.mode) if step.mode is not None else None
        folder, grid = self.folder, self.writer.grid
        surfaces = self.writer.surface_fields(nodes, cells)
        nodal = self.writer.nodal_fields(evaluated)

        def write() -> None:
            folder.write_step(
                step.cursor.step, told, self.history, nodes, cells, states, surfaces, nodal
            )
            if shape is not None:
                folder.write_mode(step.cursor.step, grid, nodes, shape)
            if self.keeps and state is not None:
                keep_state(folder.path, state, place)

        try:
            folder.write(write)
        except MachineError:
            self.history.pop()  # The step is not on disk, so it is no step of this run.
            raise

    def loads(self, row: Mapping[str, Any]) -> dict[str, float]:
        """Columns of a row that hold the loads."""
        names = (columns.load_column(self.scene, ramp)[0] for ramp in self.scene.ramps)
        return {name: row[name] for name in names if name in row}

    def _note_failure(self, mode: str, row: Mapping[str, Any], worst: Worst | None) -> None:
        """Keep where and at which load a failure first occurred."""
        entry: dict[str, Any] = {"mode": mode, "step": row["step"], **self.loads(row)}
        if "time_s" in row:
            entry["time_s"] = row["time_s"]
        if worst is not None:
            entry |= {"region": worst.region, "place_m": [float(x) for x in worst.place]}
        self.found.append(entry)

    def _is_pull_in(self, step: AcceptedStep) -> bool:
        """Whether a step is a maximum of voltages or charges alone, at either polarity."""
        item = self.path[step.cursor.ramp]
        reverse = isinstance(item, Trace) and step.state.factors[item.what] < 0
        electric = all(self.scene.is_electric(name) for name in item.names(self.scene))
        return electric and step.event == ("minimum" if reverse else "maximum")

    def _report(
        self, row: dict[str, Any], seconds: float, share: float, counting: float
    ) -> None:
        """Tell of an accepted step."""
        before = self.loads(self.history[-2]) if len(self.history) > 1 else {}
        seen = list(self.measurements)[:3]
        line = step_line(row, self.loads(row), before, seen, seconds, counting)
        self.progress.step(line, share)

    def share(self, cursor: Cursor) -> float:
        """Share of the path that is done; each item of the path counts alike.

        A trace that ends at a value of a column counts by the way of this column to the value, or
        by its steps if more of them are done.
        """
        return (cursor.ramp + max(cursor.position, self._way(cursor))) / len(self.path)

    def _way(self, cursor: Cursor) -> float:
        """Share of a column's way to the value at which the present trace ends; 0 if unknown."""
        item = self.path[cursor.ramp] if cursor.ramp < len(self.path) else None
        if not isinstance(item, Trace) or item.until is None or not self.history:
            return 0.0
        column, goal = item.until
        if self._way_from is None or self._way_from[0] != cursor.ramp:
            before = self.history[-2 if len(self.history) > 1 else -1]
            self._way_from = (cursor.ramp, before.get(column))
        start, here = self._way_from[1], self.history[-1].get(column)
        if start is None or here is None or start == goal:
            return 0.0
        share = (here - start) / (goal - start)
        return float(min(share, 1.0)) if share > 0 else 0.0  # also of a value that is no number

    def kept(self) -> str:
        """What an interrupted run leaves behind, in words."""
        if self.folder is None:
            return "nothing is on disk, for the run has no results folder"
        if not self.history:
            return f"no step was completed, and {self.folder.path} holds none"
        return (
            f"the steps up to {self.history[-1]['step']} are kept in {self.folder.path}, and the "
            "run can be resumed from there"
        )
