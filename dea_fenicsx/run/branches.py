"""All branches that one trace meets, each as a run of its own.  Scripts call `branches`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dea_fenicsx.measure.observables import Observable
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import MOST_SHAPES, Item, Trace
from dea_fenicsx.results.columns import load_column
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.stable_parts import multiplicity, stability_intervals
from dea_fenicsx.results.stored_state import StoredStep
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
class DiagramBranch:
    """A branch of a diagram.

    Attributes
    ----------
    name
        ``"first"``, ``"branch_1"`` from its first bifurcation, ``"branch_1_back"`` to the other
        side of it, ``"branch_1_2"`` from the second bifurcation of branch_1.  Where several modes
        are neutral at once, ``"branch_1"`` has the first of their shapes,
        ``"branch_1_shape_2"`` the second one, and of two shapes ``"branch_1_shapes_1+2"`` and
        ``"branch_1_shapes_1-2"`` have the sum and the difference.  A `Trace` with ``along=`` goes
        along others.
    run
        The run that follows it.  It begins on the branch that is left, before the bifurcation.
    begins
        The row of the history with which the branch begins.
    intervals
        Its parts with one number of negative eigenvalues each: see `stability_intervals`.
    bifurcations
        Row and multiplicity of each bifurcation on it, the one with which it begins left out.
    end
        Why the branch could not be followed to the end of its trace, or empty.
    leaves
        Name of the branch that it leaves; empty of the first one.
    """

    name: str
    run: Run
    begins: int
    intervals: list[dict[str, Any]]
    bifurcations: list[tuple[int, int | None]]
    end: str = ""
    leaves: str = ""

    def column(self, name: str) -> Any:
        """A column of the history along this branch."""
        return self.run.column(name)[self.begins :]

    def state(self, row: int) -> State | StoredStep:
        """The state of a row of its history, with which ``solve(scene, ..., start=)`` begins.

        It is one in memory, or that of the step in the results folder.

        Raises
        ------
        InputError
            If there is no such row, or its state is neither in memory nor in a folder.
        """
        rows = len(self.run.history)
        at = row + rows if row < 0 else row
        if self.run.out is not None and 0 <= at < rows:
            return StoredStep(self.run.out, int(self.run.history[at]["step"]))
        return self.run._states.of(row, rows)


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
    lost
        For the name of each branch whose run ended before the bifurcation where it begins, why.
    """

    branches: tuple[DiagramBranch, ...]
    load: str
    out: Path | None
    lost: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> DiagramBranch:
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
        names = [branch.name for branch in self.branches]
        return pictures.diagram(self.out, x or self.load, y, names)


def branches(
    scene: Scene,
    path: Item | Sequence[Item],
    record: Mapping[str, Observable] | None = None,
    out: str | Path | None = None,
    most: int | Sequence[int] = 3,
    aside: float = 0.05,
    both: bool = False,
    **options: Unpack[SolveOptions],
) -> Diagram:
    """Trace a branch, and each branch that leaves it at one of its first bifurcations.  Collective.

    Each branch is a run of its own, with a results folder in `out` that can be opened and resumed.
    The folder keeps the states of all steps, so that any point can be the start of another run.
    A branch that cannot be followed to the end says so, and `Diagram.lost` names those that could
    not even be begun; the others go on.

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
        From how many bifurcations of the first branch others are followed.  Of several numbers the
        second one holds for each branch that leaves the first one (secondary bifurcations), and so
        on.
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
    levels = list(most) if isinstance(most, Sequence) and not isinstance(most, str) else [most]
    items = _checked(path, levels, aside, both, options)
    options["stability"], options["keep_states"] = "every", out is not None
    trace = items[-1]
    folder = None if out is None else Path(out)
    load = load_column(scene, trace.what)[0] if trace.what in scene.ramps else ""
    lost: dict[str, str] = {}

    def follow(
        name: str, path: list[Any], start: Any, leave: int, leaves: str
    ) -> DiagramBranch | None:
        where = None if folder is None else folder / name
        given = options if start is None else options | {"start": start}
        end = ""
        try:
            run = solve(scene, path, record, where, **given)
        except (Interrupted, MachineError):
            raise
        except PathError as error:
            if getattr(error, "run", None) is None:
                raise
            run, end = error.run, str(error)
        rows = _bifurcations(run, len(path))
        if len(rows) < leave:
            lost[name] = end or "Its run met fewer bifurcations than that of the branch it leaves."
            return None
        begins = rows[leave - 1] if leave else 0
        return _branch(name, run, begins, rows[leave:], load, end, leaves)

    first = follow(FIRST, items, None, 0, "")
    assert first is not None
    found, left = [first], [first]
    for many in levels:
        left, parents = [], left
        for parent in parents:
            for k in range(1, min(many, len(parent.bifurcations)) + 1):
                path, start, leave = _way(parent, k, items, load)
                for ending, side, along in _directions(parent.bifurcations[k - 1][1], both):
                    base = "branch" if parent is first else parent.name
                    item = replace(path[-1], switch=side * aside, leave=leave, along=along)
                    branch = follow(
                        f"{base}_{k}{ending}", [*path[:-1], item], start, leave, parent.name
                    )
                    left += [branch] if branch else []
        found += left
    diagram = Diagram(tuple(found), load, folder, lost)
    _write(diagram, scene.device.comm.rank)
    return diagram


def _way(
    parent: DiagramBranch, number: int, items: Sequence[Any], load: str
) -> tuple[list[Any], Any, int]:
    """How to come to a bifurcation of a branch and leave it there.

    Returns
    -------
    path : list
        The items, of which the last is the trace.
    start
        The state in which the path begins; None is the undeformed one.
    leave : int
        At which bifurcation of the path the branch is left.
    """
    if not parent.leaves:
        return list(items), None, number
    rows = [row for row, _ in parent.bifurcations[:number]]
    history = parent.run.history
    begins = max(k for k in range(parent.begins + 1, rows[-1]) if not history[k]["event"])
    change = history[begins][load] - history[begins - 1][load]
    trace = items[-1]
    first = abs(trace.first) if change >= 0 else -abs(trace.first)
    leave = sum(row > begins for row in rows)
    return [replace(trace, first=first)], parent.state(begins), leave


def _directions(
    multiplicity: int | None, both: bool
) -> list[tuple[str, int, tuple[float, ...] | None]]:
    """Endings of the names, sides and shares of shapes with which a bifurcation is left."""
    many = min(multiplicity or 1, MOST_SHAPES)
    ways: list[tuple[str, tuple[float, ...] | None]] = [("", None)]
    if many > 1:
        unit = np.eye(many)
        ways = [("" if k == 0 else f"_shape_{k + 1}", tuple(unit[k])) for k in range(many)]
    if many == 2:
        ways += [("_shapes_1+2", (1.0, 1.0)), ("_shapes_1-2", (1.0, -1.0))]
    sides = ((1, ""), (-1, "_back"))[: 2 if both else 1]
    return [(name + back, side, along) for name, along in ways for side, back in sides]


def _checked(
    path: Item | Sequence[Item], most: Sequence[int], aside: float, both: bool,
    options: Mapping[str, Any],
) -> list[Any]:
    """The items of the path, if they and the numbers are usable."""
    items = list(path) if isinstance(path, Sequence) else [path]
    last = items[-1] if items else None
    if not isinstance(last, Trace) or last.switch:
        raise InputError(
            f"The path of a diagram must end by a Trace without switch=, not by {shown(last)}; "
            "`branches` changes the branch by itself."
        )
    for many in most:
        whole(many, "The number most= of bifurcations", 0)
    if not is_number(aside) or not 0 < aside < 1e6:
        raise InputError(
            f"aside={shown(aside)} must be a length of arc above 0, such as 0.05; both=True goes "
            "to both sides."
        )
    if not isinstance(both, bool | np.bool_):
        raise InputError(f"both={shown(both)} of branches must be True or False.")
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
    name: str, run: Run, begins: int, rows: Sequence[int], load: str, end: str, leaves: str
) -> DiagramBranch:
    intervals = stability_intervals(run.history, load, begins)
    run.add(branch_begins_at_step=begins, stability_intervals=intervals)
    met = [(row, multiplicity(run.history, row)) for row in rows]
    return DiagramBranch(name, run, begins, intervals, met, end, leaves)


def _write(diagram: Diagram, rank: int) -> None:
    """Write what the diagram holds, by rank 0."""
    if diagram.out is None or rank != 0:
        return
    told = {
        "load": diagram.load,
        "lost": dict(diagram.lost),
        "branches": [
            {
                "name": b.name, "leaves": b.leaves, "begins_at_step": b.begins, "end": b.end,
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
