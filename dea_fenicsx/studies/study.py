"""A study: one scene built and solved for many values of its parameters.

    study.json           what the study is about; a resumed one must be about the same
    runs/KEY/            the results folder of one run, KEY from the values of its parameters
    runs/KEY/row.json    its row of the table, once it has ended
    table.csv, study.png the table and its picture, at the end

A killed study loses nothing that is on disk: rows that are there are not solved again, and a run
that was under way goes on from its last step.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.items import Item, Ramp
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.summary import STATUS
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.studies.claims import Claims
from dea_fenicsx.studies.samples import Over, points
from dea_fenicsx.studies.table import draw, write_parquet, write_table
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import (
    DeaError,
    InputError,
    Interrupted,
    MachineError,
    PathError,
    install_hook,
)
from dea_fenicsx.support.file_lock import FolderLock
from dea_fenicsx.support.files import replace_file
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import keywords, whole

REFUSED = "refused"
"""Status of a point whose scene or path is not possible."""

OWN = ("status", "verdict", "stable", "steps", "seconds", "folder")
"""Columns of the table beside the parameters and what was recorded."""


class StudyOptions(TypedDict, total=False):
    """Keywords of `study`.

    Attributes
    ----------
    ranks_per_run
        Number of ranks that solve one run together.
    comm
        The ranks that share the study.
    quiet
        Print nothing.
    solve
        Keywords of `solve` for each run, such as ``{"stability": "every"}``.
    """

    ranks_per_run: int
    comm: Any
    quiet: bool
    solve: Mapping[str, Any]


@dataclass(frozen=True)
class Study:
    """The table of a study.

    Attributes
    ----------
    rows
        A row for each point: the parameters, what was recorded at the run's last step, and
        ``status``, ``verdict`` (why a run failed), ``stable``, ``steps``, ``seconds``, ``folder``.
    solved
        How many of them were solved by this call; the others were on disk.
    out
        The folder.
    """

    rows: list[dict[str, Any]]
    solved: int
    out: Path

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self.rows)

    def column(self, name: str) -> np.ndarray:
        """A column of the table: numbers, NaN where a row has none, or texts.

        Raises
        ------
        InputError
            If there is no such column.
        """
        values = [row.get(name) for row in self.rows]
        if all(value is None for value in values):
            names = dict.fromkeys(n for row in self.rows for n in row)
            raise InputError(f"The study has no column {name!r}; it has: {', '.join(names)}.")
        if any(isinstance(value, str) for value in values):
            return np.array(["" if value is None else str(value) for value in values])
        return np.array([np.nan if value is None else float(value) for value in values])

    def to_pandas(self) -> Any:
        """The table as a pandas DataFrame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise InputError(
                "The table as a DataFrame needs pandas; install it with pip install pandas, or "
                "read table.csv."
            ) from error
        return pandas.DataFrame(self.rows)

    def to_parquet(self, path: str | os.PathLike | None = None) -> Path:
        """Write the table as Parquet, a file of columns that most data tools read.

        Parameters
        ----------
        path
            The file; ``table.parquet`` in the study's folder by default.

        Returns
        -------
        Path
            The file.  Under mpirun call it on one rank.

        Raises
        ------
        InputError
            If pyarrow is not installed.
        """
        place = self.out / "table.parquet" if path is None else Path(path)
        write_parquet(place, self.rows)
        return place


def study(
    build: Callable[..., Scene],
    over: Over,
    record: Mapping[str, Any],
    path: Item | Sequence[Item] | None = None,
    out: str | os.PathLike = "results/study",
    **options: Any,
) -> Study:
    """Solve a scene for many values of its parameters; every rank works.  Collective.

    Parameters
    ----------
    build
        Called as ``build(comm, thickness=..., prestretch=...)`` with the values of a point; returns
        the scene on the ranks of `comm`, which it hands on to `device`.
    over
        The points: a grid as lists of values by the names of the parameters, a list of points, or
        a `LatinHypercube`.
    record
        Observables by name, as in `solve`.
    path
        The path of each run; all ramps at once by default.
    out
        The study's folder.  A row that is there is taken as it is; a run that was killed is
        resumed.
    options
        ``ranks_per_run`` (1), ``comm`` (all ranks), ``quiet`` and ``solve``; see `StudyOptions`.

    Returns
    -------
    Study
        The same table on every rank.

    Raises
    ------
    InputError
        For bad arguments, and if the folder holds a study of something else.  A point whose own
        scene is refused is a row with the status ``"refused"``.
    Interrupted, MachineError
        If a run is interrupted, or the machine fails; called again, the study goes on.
    """
    install_hook()
    given = keywords("study", options, StudyOptions, {
        "ranks_per_run": 1, "comm": MPI.COMM_WORLD, "quiet": False, "solve": {},
    })  # fmt: skip
    comm, size = given["comm"], given["ranks_per_run"]
    whole(size, "ranks_per_run", 1)
    if not callable(build):
        raise InputError(f"build is {shown(build)}, but must be a function that returns a scene.")
    found = points(over)
    steps = Ramp() if path is None else path
    items = [steps] if not isinstance(steps, Sequence) else list(steps)
    folder = Path(out)
    lock = _opened(folder, comm, _facts(build, found, record, items))
    group = comm.Split(comm.rank // size, comm.rank)
    worker = _Worker(build, found, record, items, folder, group, given["solve"])
    try:
        claims = Claims(folder, len(found), comm, group)
        started = time.perf_counter()
        mine = []
        for k in claims:
            row, new = worker.row(k)
            mine.append((k, row, new))
            if new and group.rank == 0 and not given["quiet"]:
                print(f"run {k + 1} of {len(found)}: {_told(row, list(found[0]))}", flush=True)
        claims.close()
        rows = _gathered(comm, mine if group.rank == 0 else [])
        solved = sum(new for _, _, new in rows)
        table = [row for _, row, _ in sorted(rows, key=lambda one: one[0])]
        finishes = comm.rank == 0
        together(comm, lambda: _finish(folder, table, found, finishes), "The table of a study")
    finally:
        group.Free()
        if lock:
            lock.release()
    if comm.rank == 0 and not given["quiet"]:
        failed = sum(not row["status"].startswith("completed") for row in table)
        print(
            f"study: {len(table)} runs, {solved} of them solved now in "
            f"{time.perf_counter() - started:.1f} s, {failed} not completed; {folder}/table.csv"
        )
    return Study(table, solved, folder)


def _told(row: Mapping[str, Any], names: Sequence[str]) -> str:
    """A run that has ended: its parameters, its status and its seconds."""
    values = (row[name] for name in names)
    told = (f"{v:.6g}" if isinstance(v, float) else str(v) for v in values)
    point = ", ".join(f"{name} {value}" for name, value in zip(names, told, strict=True))
    return f"{point}: {row['status']}, {row['seconds']:.1f} s"


def _gathered(comm: Any, mine: list[Any]) -> list[Any]:
    return [one for part in comm.allgather(mine) for one in part]


def _facts(
    build: Any, found: Sequence[Mapping[str, Any]], record: Mapping[str, Any], path: Sequence[Any]
) -> dict[str, Any]:
    """What a study is about, as far as it can be told."""
    try:
        source = hashlib.sha256(inspect.getsource(build).encode()).hexdigest()[:16]
    except (OSError, TypeError):  # typed at a prompt, or no plain function
        source = ""
    return {
        "parameters": list(found[0]), "record": {n: repr(o) for n, o in record.items()},
        "path": [repr(item) for item in path], "build": source,
    }  # fmt: skip


def _opened(folder: Path, comm: Any, facts: Mapping[str, Any]) -> FolderLock | None:
    """Make the folder ready and lock it, on rank 0.  Collective."""

    def action() -> FolderLock | None:
        if comm.rank:
            return None
        try:
            (folder / "runs").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"The folder of the study {folder} cannot be made: {error}.") from None
        lock = FolderLock(folder)
        lock.take()
        place = folder / "study.json"
        kept = _json(place)
        other = [name for name in facts if kept is not None and kept.get(name) != facts[name]]
        if other:
            lock.release()
            raise InputError(
                f"The folder {folder} holds a study with another {other[0]}; give another "
                "folder out=, or the same study."
            )
        replace_file(place, lambda p: p.write_text(json.dumps(facts, indent=1), "utf-8"))
        return lock

    return together(comm, action, "The folder of a study")


def _finish(
    folder: Path, table: Sequence[Mapping[str, Any]], found: Sequence[Mapping[str, Any]],
    writes: bool,
) -> None:  # fmt: skip
    """Write the table and the picture, on the rank that writes."""
    if not writes:
        return
    names = list(found[0])
    known = {*names, *OWN}
    columns = list(dict.fromkeys(n for row in table for n in row if n not in known))
    ordered = [
        {n: row[n] for n in (*names, *columns, *OWN) if n in row} for row in table
    ]  # fmt: skip
    write_table(folder / "table.csv", ordered)
    draw(folder / "study.png", table, names, columns)


@dataclass
class _Worker:
    """Solves points of a study on the ranks of a group."""

    build: Callable[..., Scene]
    points: Sequence[Mapping[str, Any]]
    record: Mapping[str, Any]
    path: Sequence[Item]
    folder: Path
    group: Any
    options: Mapping[str, Any]

    def row(self, number: int) -> tuple[dict[str, Any], bool]:
        """The row of a point, and whether it was solved now.  Collective over the group."""
        point = dict(self.points[number])
        key = hashlib.sha256(json.dumps(point).encode()).hexdigest()[:12]
        place = self.folder / "runs" / key
        kept = self.group.bcast(_read(place / "row.json", point), root=0)
        if kept is not None:
            return kept, False
        started = time.perf_counter()
        row = point | self._solved(point, place)
        row |= {"seconds": time.perf_counter() - started, "folder": f"runs/{key}"}

        def write() -> None:
            if self.group.rank == 0:
                place.mkdir(parents=True, exist_ok=True)
                text = json.dumps(row, indent=1)
                replace_file(place / "row.json", lambda p: p.write_text(text, "utf-8"))

        together(self.group, write, "A row of a study")
        return row, True

    def _solved(self, point: Mapping[str, Any], place: Path) -> dict[str, Any]:
        """What a run has found, or why it failed.  Collective over the group."""
        run: Run | None = None
        status, verdict = "completed", ""
        try:
            scene = self.build(self.group, **point)
            if not isinstance(scene, Scene):
                raise InputError(f"build returned {shown(scene)}, but must return a Scene.")
            given = {"quiet": True, "resume": True, **self.options}
            run = solve(scene, self.path, self.record, place, **given)
            status, verdict = str(run.summary["status"]), str(run.summary["message"])
        except (Interrupted, MachineError):
            raise
        except PathError as error:
            run, status, verdict = error.run, STATUS[type(error)], str(error)
        except DeaError as error:
            status, verdict = REFUSED, str(error)
        found: dict[str, Any] = {"status": status, "verdict": verdict}
        if run is None or not run.history:
            return found
        last = run.history[-1]
        wanted = [column_of(name, observable) for name, observable in self.record.items()]
        found |= {name: float(last[name]) for name in wanted if name in last}
        return found | {"stable": run.summary.get("stable"), "steps": run.summary.get("steps")}


def _json(place: Path) -> dict[str, Any] | None:
    """What a file holds, or None if it is not there or not whole."""
    with suppress(OSError, ValueError):
        found = json.loads(place.read_text("utf-8"))
        if isinstance(found, dict):
            return found
    return None


def _read(place: Path, point: Mapping[str, Any]) -> dict[str, Any] | None:
    """A row on disk, if it is that of a point."""
    row = _json(place)
    return row if row and all(row.get(name) == point[name] for name in point) else None
