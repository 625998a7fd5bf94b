"""Run a scene along a path: solve, measure, write, report.  What a user's script calls."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.measure.failures import Failure, Gauge, Worst, default_failures, pull_in
from dea_fenicsx.measure.observables import Measurement, Observable
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.events import Alarm, Sentinel
from dea_fenicsx.path.ramping import Cursor, Ramp, Step, follow
from dea_fenicsx.path.tracing import Trace
from dea_fenicsx.results import columns
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.folder import Folder, Run
from dea_fenicsx.results.identity import fingerprint
from dea_fenicsx.results.summary import (
    STATUS,
    count_changes,
    ending,
    settings,
    unlocated,
    versions,
    work,
)  # fmt: skip
from dea_fenicsx.run.arguments import check_arguments
from dea_fenicsx.run.enclosed_volume import check_volume
from dea_fenicsx.run.resuming import carry_on
from dea_fenicsx.run.step_checks import check_step
from dea_fenicsx.scene.electrode_checks import without_field
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import LINEARISING, NewtonOptions, NewtonSolver, silent
from dea_fenicsx.support.agreement import bind_alike, check_same
from dea_fenicsx.support.errors import (
    EquilibriumLost,
    InputError,
    Interrupted,
    MachineError,
    PathError,
    install_hook,
)  # fmt: skip
from dea_fenicsx.support.interruption import Interruption
from dea_fenicsx.support.progress import Progress, step_line


def solve(
    scene: Scene,
    path: Ramp | Trace | Sequence[Ramp | Trace],
    record: Mapping[str, Observable] | None = None,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    quiet: bool = False,
    verbose: bool | None = None,
    stability: str = "last",
    failures: Sequence[Failure] | None = None,
    options: NewtonOptions | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Run:
    """Bring a scene to equilibrium along a path.

    Parameters
    ----------
    scene
        What is solved.
    path
        One ramp, or several in sequence.
    record
        Observables by name; the column in history.csv is the name with the unit appended.
    out
        Results folder; None writes nothing.  An earlier run's files in it move to ``previous/``,
        ``previous_2/`` and so on; none is ever deleted.
    resume
        Carry on from the last step in `out`, if there is one.
    quiet
        Print nothing; ``run.log`` in `out` is written all the same.
    verbose
        Print each Newton iteration, too; None does as the command line's ``--verbose`` says.
    stability
        When to factorise the tangent of an accepted state to count its negative eigenvalues:
        at the ``"last"`` step (in small models at all steps, which costs little), at ``"every"``
        step, or ``"never"`` on purpose.  With ``"every"`` a change between two steps is located:
        a bifurcation gets a step of its own, and its null vector a file in ``modes/``.
    failures
        What to watch: `ElectricalBreakdown`, `LossOfTension`, `StretchLimit`.  The first state at
        which one occurs gets a step of its own and an entry in the summary; the path goes on.
        None watches breakdown where a dielectric has a breakdown field.
    options
        Settings of Newton's method.
    settings
        The script's own settings, to be kept in summary.json.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        Before anything is solved or written.
    EquilibriumLost, SolverError
        If the path cannot be followed to its end.
    NotReached
        If a trace uses up its steps before the value at which it was to end.
    Interrupted
        By Ctrl-C or SIGTERM, before the next Newton iteration; a second signal ends at once.
    MachineError
        If the results cannot be written any more, because the disk is full, say.

        In all these cases everything up to the last accepted step is on disk, and the error's
        attribute `run` holds it.
    """
    install_hook()
    check_arguments(
        scene, path, record, out, resume, quiet, stability, failures, options, settings
    )
    path = [path] if isinstance(path, Ramp | Trace) else list(path)
    check_same(scene.device.comm, {
        "path": path, "record": record, "out": out, "resume": resume, "stability": stability,
        "failures": failures, "options": options,
    })  # fmt: skip
    watched = default_failures(scene) if failures is None else tuple(failures)
    columns.check_names(scene, record or {}, watched)
    return _Session(scene, path, dict(record or {}), out, resume, quiet, verbose, stability,
                    watched, options, settings).run()  # fmt: skip


@dataclass
class _Session:
    """The state of one call of `solve`."""

    scene: Scene
    path: list[Ramp | Trace]
    record: dict[str, Observable]
    out: str | Path | None
    resume: bool
    quiet: bool
    verbose: bool | None
    stability: str
    failures: Sequence[Failure]
    options: NewtonOptions | None
    settings: Mapping[str, Any] | None
    history: list[dict[str, Any]] = field(default_factory=list)
    earlier_s: float = 0.0
    ends: dict[int, tuple[Measurement, float]] = field(default_factory=dict)
    counts: tuple[int, int, int] = (0, 0, 0)
    found: list[dict[str, Any]] = field(default_factory=list)
    lost: PathError | None = None

    def run(self) -> Run:
        """Take the results folder for the length of the run."""
        self.started = time.perf_counter()
        self.comm = self.scene.device.comm
        self.progress = Progress(self.comm.rank == 0, self.quiet, self.verbose)
        folder = Folder(self.out, self.comm) if self.out is not None else None
        if folder is None:
            return self._run(None)
        kept = folder.take()
        try:
            if not kept:
                self.progress.say(
                    f"The file system of {folder.path} keeps no locks: see to it that no other run "
                    "writes there."
                )
            return self._run(folder)
        finally:
            folder.release()

    def _run(self, folder: Folder | None) -> Run:
        self.progress.stage("compiling the forms")  # a while for a new kind of scene, else nothing
        self.problem = Problem(self.scene)
        check_volume(self.problem, self.path)
        self.measurements: dict[str, Measurement] = {
            columns.column_of(name, o): columns.numeric(name, bind_alike(self.problem, name, o))
            for name, o in self.record.items()
        }
        self.solver = NewtonSolver(self.problem, self.options)
        self.gauges = [Gauge(failure, self.problem) for failure in self.failures]
        self.ends = self._ends()
        self.folder = folder
        self.writer = FieldWriter(self.problem) if folder else None
        cursor = self._load() if self.resume and folder else None
        if folder and self.writer and cursor is None:
            folder.start()
        if folder and self.writer:
            folder.keep_origin()
            self.progress.log = folder.path / "run.log"
            folder.write(lambda: folder.write_grid(self.writer.grid))  # type: ignore[union-attr]
        self.progress.say(
            f"{self.scene.device.source or 'device'}: {self.problem.unknowns} unknowns, "
            f"{self.comm.size} rank{'s' * (self.comm.size > 1)}"
            + (f", resumed after step {cursor.step}" if cursor else "")
        )
        if without_field(self.scene.electrodes):
            self.progress.say("All electrodes are at one potential, so there is no field.")
        result = Run(self.history, {}, self.problem, folder)
        self._summarise(result, "running")
        self._step_started = time.perf_counter()
        sentinel = Sentinel(
            self.solver,
            [Alarm(gauge.failure.name, gauge.margin) for gauge in self.gauges],
            stability=self.stability == "every",
            fired=[row["event"] for row in self.history],
            counting=self.stability != "never" and self.solver.counts_cheaply,
        )
        self.progress.begin(self._share(cursor) if cursor else 0.0)
        interruption = Interruption(self.comm, self.progress.say)

        def notify(stage: str) -> None:
            if stage == LINEARISING:
                interruption.check()
            self.progress.stage(stage)

        try:
            self.solver.notify = notify
            with interruption:
                for step in follow(
                    self.solver, self.path, cursor, self.progress.say, self._gap, sentinel
                ):
                    self._accept(step)
        except PathError as error:
            error.run, self.lost = result, error
            if isinstance(error, Interrupted):
                error.args = (f"{error}; {self._kept()}.",)
            elif note := unlocated(self.history):
                error.args = (f"{error} {note}",)
            self._finish(result, STATUS[type(error)], str(error))
            raise
        except BaseException as error:
            self._note_crash(result, error)
            raise
        finally:
            self.solver.notify = silent  # it holds this session, which holds the solver
        self._finish(result, *ending(self.scene, self.history, self.path))
        return result

    def _is_pull_in(self, step: Step) -> bool:
        """Whether a step is a maximum of voltages or charges alone, at either polarity."""
        item = self.path[step.cursor.ramp]
        reverse = isinstance(item, Trace) and step.cursor.factors[item.what] < 0
        electric = all(self.scene.is_electric(name) for name in item.names(self.scene))
        return electric and step.event == ("minimum" if reverse else "maximum")

    def _share(self, cursor: Cursor) -> float:
        """Share of the path that is behind, each of its items taken alike."""
        return (cursor.ramp + cursor.position) / len(self.path)

    def _kept(self) -> str:
        """What an interrupted run leaves behind, in words."""
        if self.folder is None:
            return "nothing is on disk, for the run has no results folder"
        if not self.history:
            return f"no step was completed, and {self.folder.path} holds none"
        return (
            f"the steps up to {self.history[-1]['step']} are kept in {self.folder.path}, and the "
            "run can be resumed from there"
        )

    def _ends(self) -> dict[int, tuple[Measurement, float]]:
        """For each trace of the path that ends at a value: how to measure it, and the value."""
        known = columns.of_the_state(self.problem, self.gauges, self.measurements)
        found = {}
        for k, item in enumerate(self.path):
            column, value = getattr(item, "until", None) or ("", 0.0)
            if column and column not in known:
                raise InputError(
                    f"The trace is to end by {column!r}, but there is no such column that could "
                    f"end it; there are: {', '.join(known)}."
                )
            if column:
                found[k] = known[column], value
        return found

    def _gap(self, item: int) -> float | None:
        """How far the state is from the value at which an item of the path ends."""
        if item not in self.ends:
            return None
        measure, value = self.ends[item]
        return self.comm.bcast(measure() - value, root=0)

    # ------------------------------------------------------------------- steps

    def _accept(self, step: Step) -> None:
        """Measure and write an accepted step."""
        problem, solver, before = self.problem, self.solver, self.counts
        known = solver.inertia.settled and solver.inertia.factors == step.cursor.factors
        wanted = self.stability == "every" or (self.stability == "last" and step.last)
        if wanted and not known:
            solver.refresh_inertia(last=step.last)
        counters = solver.counters
        self.counts = (counters.newton, counters.krylov, counters.factorisations)
        spent = [now - then for now, then in zip(self.counts, before, strict=True)]
        now = time.perf_counter()
        length, scales = problem.scales.length, problem.scales
        cursor = step.cursor
        row: dict[str, Any] = {
            "step": cursor.step,
            "time": cursor.ramp + cursor.position,
            "ramp": step.label,
            "event": step.event,
        }
        for name in self.scene.ramps:
            key, unit = columns.load_column(self.scene, name)
            row[key] = cursor.factors[name] * unit
        measured = {name: measure() for name, measure in self.measurements.items()}
        row |= measured
        checked = check_step(solver, cursor.step, measured)
        probe = checked.probe
        if problem.potential is not None:
            row["max_field_V_per_m"] = probe.max_field * scales.field
            for axis, x in zip("xyz", probe.place, strict=True):
                row[f"max_field_{axis}_m"] = float(x) * length
        read = [(g.failure, *g.measure()) for g in self.gauges]
        worst = {failure.name: found for failure, found, _ in read}
        row |= {failure.column: found.value for failure, found, _ in read}
        row |= {
            "min_J": probe.min_J,
            "volume_error": checked.volume_error,
            "residual": checked.residual,
            "newton_iterations": spent[0],
            "krylov_iterations": spent[1],
            "factorisations": spent[2],
            "retries": step.retries,
            "inertia": solver.inertia.excess,
            "inertia_is_of_this_step": int(
                solver.inertia.settled and solver.inertia.factors == cursor.factors
            ),
            "wall_s": self.earlier_s + now - self.started,
        }
        self.history.append(row)
        if step.event in worst:
            self._note_failure(step.event, row, worst[step.event])
        elif self._is_pull_in(step):
            self._note_failure("pull-in", row, None)
        if self.folder and self.writer:
            self._write(step, row, {f.column: values for f, _, values in read})
        self._report(row, now - self._step_started, self._share(cursor))
        self._step_started = time.perf_counter()

    def _write(
        self, step: Step, row: dict[str, Any], by_cell: Mapping[str, np.ndarray]
    ) -> None:
        """Write an accepted step; the run can be resumed from it unless it is an event's."""
        assert self.folder and self.writer
        told = None if step.event else {
            "cursor": asdict(step.cursor),
            "history": self.history,
            "fingerprint": self._fingerprint,
            "references": self.solver.references.sizes,
            "failures": self.found,
            "wall_s": row["wall_s"],
        }  # fmt: skip
        cells = self.writer.cell_fields()
        for column, mine in by_cell.items():
            values = self.writer.gather(mine)
            if cells is not None and values is not None:
                cells[column] = values
        nodes, state = self.writer.node_fields(), self.writer.gather_state()
        shape = self.writer.vector(step.mode) if step.mode is not None else None
        folder, grid = self.folder, self.writer.grid

        def write() -> None:
            folder.write_step(step.cursor.step, told, self.history, nodes, cells, state)
            if shape is not None:
                folder.write_mode(step.cursor.step, grid, nodes, shape)

        try:
            folder.write(write)
        except MachineError:
            self.history.pop()  # not on disk, and so no step of this run
            raise

    def _loads(self, row: dict[str, Any]) -> dict[str, float]:
        """Columns of a row that hold the loads."""
        names = (columns.load_column(self.scene, ramp)[0] for ramp in self.scene.ramps)
        return {name: row[name] for name in names if name in row}

    def _note_failure(self, mode: str, row: dict[str, Any], worst: Worst | None) -> None:
        """Keep where and at which load a failure first occurred."""
        entry: dict[str, Any] = {"mode": mode, "step": row["step"], **self._loads(row)}
        if worst is not None:
            entry |= {"region": worst.region, "place_m": [float(x) for x in worst.place]}
        self.found.append(entry)

    def _report(self, row: dict[str, Any], seconds: float, share: float) -> None:
        """Tell of an accepted step."""
        before = self._loads(self.history[-2]) if len(self.history) > 1 else {}
        seen = list(self.measurements)[:3]
        self.progress.step(step_line(row, self._loads(row), before, seen, seconds), share)

    # ------------------------------------------------------------------ resume

    @cached_property
    def _fingerprint(self) -> dict[str, Any]:
        """What this run is.  Collective at its first use."""
        assert self.writer
        return fingerprint(self.problem, self.path, self.record, self.failures, self.writer.grid)

    def _load(self) -> Cursor | None:
        """Restore the last accepted step of an earlier run, or None if there is none."""
        assert self.folder and self.writer
        known = columns.names(
            self.scene, self.record, self.failures, self.problem.potential is not None
        )
        found = carry_on(
            self.folder, self.writer, self.solver, self.path, self._fingerprint, known,
            {columns.column_of(name, o): o for name, o in self.record.items()}, self.measurements,
        )  # fmt: skip
        if found is None:
            self.progress.say("There is no earlier run to resume; starting anew.")
            return None
        cursor, told = found
        self.history, self.found = told["history"], told["failures"]
        self.earlier_s = float(told["wall_s"])
        return cursor

    # ----------------------------------------------------------------- summary

    def _note_crash(self, result: Run, error: BaseException) -> None:
        """Let the summary say that a fault of the script has ended the run, on rank 0 alone.

        Nothing here is collective: this rank may be the only one that fails.
        """
        folder = self.folder
        if folder is None or not result.summary:
            return
        told = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        result.summary |= {"status": "script failed", "message": told}
        with suppress(MachineError):
            folder.write(lambda: folder.write_summary(result.summary), together=False)

    def _finish(self, result: Run, status: str, message: str = "") -> None:
        """Bring the files into their final form, as far as the machine allows."""
        folder = self.folder
        if folder:
            try:
                folder.write(lambda: folder.consolidate(self.history))
            except MachineError:
                where = folder.path / "parts"
                self.progress.say(f"There is no room for one fields.h5: the steps stay in {where}.")
        try:
            self._summarise(result, status, message)
        except MachineError as error:
            if self.lost is None:
                error.run = result
                raise
        steps = len(self.history) - 1
        told = f"; {message}" if message and self.lost is None else ""
        wall_s = result.summary["wall_s"]
        self.progress.end(f"{status}: {max(steps, 0)} steps, {wall_s:.1f} s{told}")

    def _summarise(self, result: Run, status: str, message: str = "") -> None:
        """Fill the run's summary and write it.  Collective."""
        solver = self.solver
        last = self.history[-1] if self.history else {}
        stable: bool | None = None
        if last.get("inertia_is_of_this_step"):
            stable = last["inertia"] == 0
        summary: dict[str, Any] = {
            "status": status,
            "message": message,
            **{k: v for k, v in last.items() if k in self._kept_keys()},
            "stable": stable,
            "events": [
                {"event": row["event"], "step": row["step"], **self._loads(row)}
                for row in self.history if row["event"]
            ],
            "failures": self.found + self._lost_by_pull_in(),
            "count_changes": count_changes(self.history),
            "steps": len(self.history) - 1 if self.history else 0,
            **work(solver, self.history),
            "wall_s": self.earlier_s + time.perf_counter() - self.started,
            "settings": settings(solver, self.path, self.settings or {}),
            "versions": versions(),
            "origin": self.folder.origin if self.folder else {},
            "command": " ".join(sys.argv),
        }
        result.summary.clear()
        result.summary.update(summary)
        if self.folder:
            folder = self.folder
            folder.write(lambda: folder.write_summary(summary))

    def _lost_by_pull_in(self) -> list[dict[str, Any]]:
        known = any(entry["mode"] == "pull-in" for entry in self.found)
        if known or not isinstance(self.lost, EquilibriumLost):
            return []
        return pull_in(self.scene, self.lost, self.history[-1])

    def _kept_keys(self) -> set[str]:
        """Columns whose last value belongs into the summary."""
        drop = {"step", "time", "ramp", "event", "newton_iterations", "krylov_iterations",
                "factorisations", "retries", "wall_s", "inertia_is_of_this_step"}  # fmt: skip
        return set(self.history[-1]) - drop if self.history else set()
