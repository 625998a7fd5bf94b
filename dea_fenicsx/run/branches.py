"""All branches that one trace meets, each as a run of its own.  Scripts call `branches`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Unpack

from dea_fenicsx.measure.observables import Observable
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import Item, Trace
from dea_fenicsx.results.columns import load_column
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.stable_parts import multiplicity, stability_intervals
from dea_fenicsx.run.arguments import SolveOptions
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError, Interrupted, MachineError, PathError
from dea_fenicsx.support.files import replace_file
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.validation import known, whole

FIRST = "first"
"""Name of the branch on which the trace begins."""


@dataclass(frozen=True)
class Branch:
    """A branch of a diagram.

    Attributes
    ----------
    name
        ``"first"``, ``"branch_1"`` from its first bifurcation, ``"branch_1_back"`` to the other
        side of it, and so on.
    run
        The run that follows it.  A run of another branch than the first follows this one up to
        the bifurcation.
    begins
        The row of the history with which the branch begins.
    intervals
        Its parts with one number of negative eigenvalues each: see `stability_intervals`.
    bifurcations
        Row and multiplicity of each bifurcation on it, the one with which it begins left out.
    end
        Why the branch could not be followed to the end of its trace, or empty.
    """

    name: str
    run: Run
    begins: int
    intervals: list[dict[str, Any]]
    bifurcations: list[tuple[int, int | None]]
    end: str = ""

    def column(self, name: str) -> Any:
        """A column of the history along this branch."""
        return self.run.column(name)[self.begins :]

    def state(self, row: int) -> State:
        """The state of a row of its history, with which ``solve(scene, ..., start=)`` begins.

        Raises
        ------
        InputError
            If there is no such row, or its state is not in memory.
        """
        return self.run._states.of(row, len(self.run.history))


@dataclass(frozen=True)
class Diagram:
    """Branches of equilibria of one scene.

    Attributes
    ----------
    branches
        The first one, and those that leave it.
    load
        The column of the load.
    out
        The folder, with a results folder for each branch, or None.
    """

    branches: tuple[Branch, ...]
    load: str
    out: Path | None

    def __getitem__(self, name: str) -> Branch:
        """A branch by its name."""
        found = {branch.name: branch for branch in self.branches}
        known(name, found, "branch", "the diagram")
        return found[name]

    def draw(self, y: str, x: str | None = None) -> list[Path]:
        """Draw it: stable parts solid, unstable ones dashed, events marked (one rank).

        Parameters
        ----------
        y, x
            Columns of the histories; x is the load by default.

        Returns
        -------
        list of Path
            PNG and SVG.

        Raises
        ------
        InputError
            If the diagram has no folder, or there is no such column.
        """
        if self.out is None:
            raise InputError("This diagram has no folder, so it is not drawn; give branches out=.")
        # The pictures come after the runs in the order of rooms; they are loaded on demand.
        pictures = import_module("dea_fenicsx.pictures.diagram")
        return pictures.diagram(self.out, x or self.load, y)


def branches(
    scene: Scene,
    path: Item | Sequence[Item],
    record: Mapping[str, Observable] | None = None,
    out: str | Path | None = None,
    most: int = 3,
    aside: float = 0.05,
    both: bool = False,
    **options: Unpack[SolveOptions],
) -> Diagram:
    """Trace a branch, and each branch that leaves it at one of its first bifurcations.  Collective.

    Each branch is a run of its own, with a results folder in `out` that can be opened, resumed and
    used as a start.  A branch that cannot be followed to the end says so; the others go on.

    Parameters
    ----------
    scene
        What is solved.
    path
        The items of the path, of which the last is a `Trace` without `switch`.
    record
        Observables by name, as of `solve`.
    out
        Folder for the diagram: ``first``, ``branch_1``, ... and ``diagram.json``; None writes
        nothing.
    most
        From how many bifurcations of the first branch others are followed.
    aside
        Length of the first step along the null vector, in units of arc.
    both
        Whether each of them is followed to both sides.
    options
        As of `solve`; ``stability`` is ``"every"``.

    Returns
    -------
    Diagram

    Raises
    ------
    InputError
        Before anything is solved.
    Interrupted, MachineError
        As of `solve`; with ``resume=True`` the same call carries on.
    """
    items = _checked(path, most, aside, options)
    options["stability"] = "every"
    trace = items[-1]
    folder = None if out is None else Path(out)
    load = load_column(scene, trace.what)[0] if trace.what in scene.ramps else ""

    def follow(name: str, item: Trace) -> tuple[Run, str]:
        where = None if folder is None else folder / name
        try:
            return solve(scene, [*items[:-1], item], record, where, **options), ""
        except (Interrupted, MachineError):
            raise
        except PathError as error:
            if getattr(error, "run", None) is None:
                raise
            return error.run, str(error)

    run, end = follow(FIRST, trace)
    met = _bifurcations(run, len(items))
    found = [_branch(FIRST, run, 0, met, load, end)]
    for k in range(1, min(most, len(met)) + 1):
        for side, ending in ((1, ""), (-1, "_back"))[: 2 if both else 1]:
            name = f"branch_{k}{ending}"
            run, end = follow(name, replace(trace, switch=side * aside, leave=k))
            rows = _bifurcations(run, len(items))
            if len(rows) >= k:
                found.append(_branch(name, run, rows[k - 1], rows[k:], load, end))
    diagram = Diagram(tuple(found), load, folder)
    _write(diagram, scene.device.comm.rank)
    return diagram


def _checked(
    path: Item | Sequence[Item], most: int, aside: float, options: Mapping[str, Any]
) -> list[Any]:
    """The items of the path, if they and the numbers are usable."""
    items = list(path) if isinstance(path, Sequence) else [path]
    last = items[-1] if items else None
    if not isinstance(last, Trace) or last.switch:
        raise InputError(
            f"The path of a diagram must end by a Trace without switch=, not by {shown(last)}; "
            "`branches` changes the branch by itself."
        )
    whole(most, "The number most= of bifurcations", 0)
    if not is_number(aside) or not 0 < aside < 1e6:
        raise InputError(
            f"aside={shown(aside)} must be a length of arc above 0, such as 0.05; both=True goes "
            "to both sides."
        )
    if options.get("stability", "every") != "every":
        raise InputError('A diagram needs stability="every"; leave stability= out.')
    return items


def _bifurcations(run: Run, items: int) -> list[int]:
    """Rows of the bifurcations that the last item of a path has met."""
    return [
        k for k, row in enumerate(run.history)
        if row["event"] == "bifurcation" and row["time"] > items - 1
    ]  # fmt: skip


def _branch(
    name: str, run: Run, begins: int, rows: Sequence[int], load: str, end: str
) -> Branch:
    intervals = stability_intervals(run.history, load, begins)
    run.add(branch_begins_at_step=begins, stability_intervals=intervals)
    met = [(row, multiplicity(run.history, row)) for row in rows]
    return Branch(name, run, begins, intervals, met, end)


def _write(diagram: Diagram, rank: int) -> None:
    """Write what the diagram holds, by rank 0."""
    if diagram.out is None or rank != 0:
        return
    told = {
        "load": diagram.load,
        "branches": [
            {
                "name": b.name, "begins_at_step": b.begins, "end": b.end,
                "stability_intervals": b.intervals,
                "bifurcations": [
                    {"step": row, diagram.load: float(b.run.history[row][diagram.load]),
                     "multiplicity": count}
                    for row, count in b.bifurcations
                ],
            }
            for b in diagram.branches
        ],
    }  # fmt: skip
    text = json.dumps(told, indent=1, allow_nan=False) + "\n"
    replace_file(diagram.out / "diagram.json", lambda file: file.write_text(text, "utf-8"))
