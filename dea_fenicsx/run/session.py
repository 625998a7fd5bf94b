"""One run of a scene along a path: solve, measure, write, report.  Scripts call `solve`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from dea_fenicsx.measure.failures import FailureMode, Gauge, default_failures
from dea_fenicsx.measure.observables import Measurement, Observable
from dea_fenicsx.model.state import State
from dea_fenicsx.path.cursor import Cursor
from dea_fenicsx.path.events import Alarm, Sentinel
from dea_fenicsx.path.items import Item, March, Trace
from dea_fenicsx.path.path_checks import check_path
from dea_fenicsx.path.walk import Walk
from dea_fenicsx.results import columns
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.history import History
from dea_fenicsx.results.identity import fingerprint
from dea_fenicsx.results.summary import (
    STATUS,
    ending,
    unlocated,
    unstable_from,
)  # fmt: skip
from dea_fenicsx.results.surface_blocks import Blocks, electrode_surfaces
from dea_fenicsx.run.accuracy import AccuracySearch
from dea_fenicsx.run.arguments import DEFAULTS, Arguments, SolveOptions, check_arguments
from dea_fenicsx.run.choosing import decide
from dea_fenicsx.run.closing import Closing
from dea_fenicsx.run.enclosed_volume import check_volume
from dea_fenicsx.run.estimating import estimate, names_to_estimate, recorded_name
from dea_fenicsx.run.journal import Journal
from dea_fenicsx.run.pushing_out import pushed_out
from dea_fenicsx.run.resuming import carry_on
from dea_fenicsx.run.reuse import keep, lend, solver_for
from dea_fenicsx.run.size_field import SIZES, write_sizes
from dea_fenicsx.run.solver_notes import advice, notes_on, uncounted
from dea_fenicsx.run.starting import Beginning, balanced, beginning
from dea_fenicsx.scene.electrode_checks import without_field
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.linear import silent
from dea_fenicsx.solvers.newton import LINEARISING
from dea_fenicsx.support.agreement import bind_alike, check_same
from dea_fenicsx.support.errors import (
    InputError,
    Interrupted,
    PathError,
    install_hook,
)  # fmt: skip
from dea_fenicsx.support.form_cache import telling
from dea_fenicsx.support.interruption import Interruption
from dea_fenicsx.support.progress import Progress
from dea_fenicsx.support.validation import keywords


def solve(
    scene: Scene,
    path: Item | Sequence[Item],
    record: Mapping[str, Observable] | None = None,
    out: str | Path | None = None,
    **options: Unpack[SolveOptions],
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
    options
        ``resume``, ``start``, ``quiet``, ``verbose``, ``stability``, ``failures``, ``options``,
        ``settings``, ``keep_states``, ``estimate`` and ``accuracy``: see `SolveOptions`.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        Before anything is solved or written.
    SolverError
        If a state of another run, given as `start`, leads to no equilibrium of this scene.
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
    given = Arguments(
        scene, path, record, out, **keywords("solve", options, SolveOptions, DEFAULTS)
    )
    check_arguments(given)
    check_same(scene.device.comm, given.compared())
    if given.accuracy is None:
        return _solved(given)
    return _solved_to(given, given.accuracy)


def _solved(given: Arguments) -> Run:
    """Solve a scene in the discretisation that it has, and estimate the errors asked for."""
    scene, record = given.scene, dict(given.record or {})
    failures = given.failures
    watched = default_failures(scene) if failures is None else tuple(failures)
    columns.check_names(scene, record, watched)
    run = _Session(given, scene, given.items, record, watched).run()
    estimate(run, names_to_estimate(given.estimate, record))
    return run


def _solved_to(given: Arguments, accuracy: tuple[str, float]) -> Run:
    """Solve a scene in the discretisation with which an observable is as exact as asked."""
    name = recorded_name(accuracy[0], given.record, "The observable of accuracy=")
    observable = given.record[name]
    progress = Progress(given.scene.device.comm.rank == 0, given.quiet, given.verbose)
    counts = "every" if given.stability == "every" else "never"  # a path may need it
    coarse = replace(
        given, out=None, quiet=True, stability=counts, keep_states=False, estimate=False
    )
    search = AccuracySearch(
        name, observable, float(accuracy[1]),
        lambda scene: _solved(replace(coarse, scene=scene)), progress.say,
    )  # fmt: skip
    scene = search.find(given.scene)
    run = _solved(replace(given, scene=scene))
    if search.wants_sizes and run.out is not None:
        assert search.found
        write_sizes(run.out / SIZES, scene.device, search.found, search.asked)
    run.tell({"accuracy": search.told()})
    progress.say(search.sentence())
    return run


@dataclass
class _Session:
    """The state of one call of `solve`."""

    given: Arguments
    scene: Scene
    path: list[Item]
    record: dict[str, Observable]
    failures: Sequence[FailureMode]
    earlier: Sequence[State] = ()  # of a resumed run, see `AcceptedStep`

    @property
    def released(self) -> bool:
        """Whether a free body is held by its inertia alone on all of the path."""
        return self.scene.declared.holds_rigid_motions and all(
            isinstance(item, March) and item.moving for item in self.path
        )

    def run(self) -> Run:
        """Lock the results folder while the run lasts."""
        self.started = time.perf_counter()
        self.comm = self.scene.device.comm
        self.progress = Progress(self.comm.rank == 0, self.given.quiet, self.given.verbose)
        folder = Folder(self.given.out, self.comm) if self.given.out is not None else None
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
        with telling(self.progress.compiling):
            return self._told(folder)

    def _told(self, folder: Folder | None) -> Run:
        journal = self._prepare(folder)
        cursor = self._load(journal) if self.given.resume and folder else None
        begin = self._begin(journal) if cursor is None else None
        self._open(journal, cursor, begin)
        problem, states = journal.solver.problem, journal.states
        result = Run(
            journal.history, {}, problem, folder, states, self.record, self.failures
        )
        closing = Closing(journal, result, self.given.settings or {})
        closing.summarise("running")
        try:
            self._follow(journal, cursor, begin)
        except PathError as error:
            error.run = result
            if isinstance(error, Interrupted):
                error.args = (f"{error}; {journal.kept()}.",)
            elif notes := self._notes(journal):
                error.args = (" ".join([str(error), *notes]),)
            closing.finish(STATUS[type(error)], str(error), error)
            raise
        except BaseException as error:
            closing.note_crash(error)
            raise
        status, message = ending(self.scene, journal.history, self.path)
        message = f"{message} {uncounted(journal.solver, self.given.stability)}".strip()
        closing.finish(status, message)
        lend(result, journal.solver)
        keep(result, journal.solver, [*self.record.values(), *self.failures])
        return result

    def _prepare(self, folder: Folder | None) -> Journal:
        """Build the discrete problem, and all that measures and writes its states.  Collective."""
        solver = solver_for(self.scene, self.given.options, self.released)
        self.choice, problem = decide(solver, self.given, folder), solver.problem
        if self.given.start is None:
            check_volume(problem, self.path)
        measurements: dict[str, Measurement] = {
            columns.column_of(name, o): columns.numeric(name, bind_alike(problem, name, o))
            for name, o in self.record.items()
        }
        gauges = [Gauge(failure, problem) for failure in self.failures]
        self.ends = ends_of(self.path, columns.of_the_state(problem, gauges, measurements))
        gathers = folder is not None or self.given.start is not None
        writer = FieldWriter(problem) if gathers else None

        def identity() -> dict[str, Any]:
            assert writer
            return fingerprint(problem, self.path, self.record, self.failures, writer.grid)

        return Journal(
            solver, self.path, self.given.stability, measurements, gauges,
            self.progress, folder, writer, identity, started=self.started,
            keeps=self.given.keep_states,
        )  # fmt: skip

    def _begin(self, journal: Journal) -> Beginning | None:
        """The state of another run in which the path begins, if one is given.  Collective."""
        start, problem = self.given.start, journal.solver.problem
        if start is None:
            return None
        assert journal.writer
        begin = beginning(problem, journal.writer, start)
        check_path(self.scene, self.path, begin.state.factors)
        check_volume(problem, self.path, begin.state.factors)
        journal.start = begin.told
        return begin

    def _open(
        self, journal: Journal, cursor: Cursor | None, begin: Beginning | None
    ) -> None:
        """Make the results folder ready, and tell what is solved.  Collective."""
        folder, writer = journal.folder, journal.writer
        if folder and writer:
            if cursor is None:
                folder.start()
            folder.keep_origin()
            self.progress.log = folder.path / "run.log"
            blocks = Blocks(writer.named_facets(), electrode_surfaces(self.scene))
            nodal = writer.split()
            folder.write(
                lambda: folder.write_grid(writer.grid, writer.surface_grids, blocks, nodal)
            )
        self.progress.say(
            f"{self.scene.device.source or 'device'}: {journal.solver.problem.unknowns} unknowns, "
            f"{self.comm.size} rank{'s' * (self.comm.size > 1)}"
            + (f", resumed after step {cursor.step}" if cursor else "")
        )
        for note in notes_on(journal.solver, self.choice, self.given.stability):
            self.progress.say(note)
        if begin:
            self.progress.say(f"The path begins in {begin.place}.")
        if not self.scene.kinematics.is_membrane and without_field(self.scene.electrodes):
            self.progress.say("All electrodes are at one potential, so there is no field.")

    def _follow(
        self, journal: Journal, cursor: Cursor | None, begin: Beginning | None
    ) -> None:
        """Follow the path to its end, and keep each accepted step.  Collective."""
        solver = journal.solver
        sentinel = Sentinel(
            solver,
            [Alarm(gauge.failure.name, gauge.margin) for gauge in journal.gauges],
            stability=self.given.stability == "every" and not self.released,
            fired=[row["event"] for row in journal.history],
            counting=(
                self.given.stability != "never" and solver.counts_cheaply and not self.released
            ),
        )
        journal.begin(cursor)
        interruption = Interruption(self.comm, self.progress.say)

        def notify(stage: str) -> None:
            if stage == LINEARISING:
                interruption.check()
            self.progress.stage(stage)

        try:
            solver.notify = notify
            with interruption:
                origin = balanced(solver, begin) if begin else None
                if begin is None and cursor is None:
                    origin = pushed_out(solver, self.progress.say)
                walk = Walk(
                    solver, self.path, sentinel, self.progress.say, self._gap, origin, self.earlier
                )
                for step in walk.follow(cursor):
                    journal.accept(step)
        finally:
            solver.notify = silent  # it holds this session, which holds the solver

    def _notes(self, journal: Journal) -> list[str]:
        """What an error that ends the path says of its solver, and of the stability before it."""
        found = [unlocated(journal.history), advice(journal.solver)]
        if not any(isinstance(item, Trace) for item in self.path):
            found.append(unstable_from(self.scene, journal.history, self.path, found[0]))
        return [note for note in found if note]

    def _gap(self, item: int) -> float | None:
        """Difference between the present value and that at which an item of the path ends."""
        if item not in self.ends:
            return None
        measure, value = self.ends[item]
        return self.comm.bcast(measure() - value, root=0)

    def _load(self, journal: Journal) -> Cursor | None:
        """Restore the last accepted step of an earlier run, or None if there is none."""
        assert journal.folder and journal.writer
        potential = journal.solver.problem.potential is not None
        known = columns.names(
            self.scene, self.record, self.failures, potential, columns.has_time(self.path)
        )
        found = carry_on(
            journal.folder, journal.writer, journal.solver, self.path, journal.fingerprint, known,
            {columns.column_of(name, o): o for name, o in self.record.items()},
            journal.measurements,
        )  # fmt: skip
        if found is None:
            self.progress.say("There is no earlier run to resume; starting anew.")
            return None
        cursor, told, self.earlier = found
        if (told.get("start") is None) != (self.given.start is None):
            begun = "in the undeformed state" if told.get("start") is None else "in another run"
            raise InputError(
                f"The run in {journal.folder.path} cannot be resumed: it began {begun}, but this "
                "one does not; start anew without resume, or in another folder."
            )
        journal.history, journal.found = History(told["history"]), told["failures"]
        journal.notes = dict(told.get("notes", {}))
        journal.earlier_s, journal.start = float(told["wall_s"]), told.get("start")
        return cursor


def ends_of(
    path: Sequence[Item], known: Mapping[str, Measurement]
) -> dict[int, tuple[Measurement, float]]:
    """For each trace of a path that ends at a value: how to measure it, and the value.

    Raises
    ------
    InputError
        If a trace is to end by a column that is not known.
    """
    found = {}
    for k, item in enumerate(path):
        column, value = getattr(item, "until", None) or ("", 0.0)
        if column and column not in known:
            raise InputError(
                f"The trace is to end by {column!r}, but there is no such column that could "
                f"end it; there are: {', '.join(known)}."
            )
        if column:
            found[k] = known[column], value
    return found
