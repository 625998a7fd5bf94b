"""How much an imperfection lowers the load that a device bears.  Scripts call `knock_down`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.moved import Shape
from dea_fenicsx.path.items import Item, Trace
from dea_fenicsx.results.columns import load_column
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.summary import LIMITS
from dea_fenicsx.run.arguments import SolveOptions
from dea_fenicsx.run.imperfections import ModeShape, imperfect
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError, Interrupted, MachineError, PathError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import finite

PERFECT = "perfect"
"""Name of the run of the perfect device."""

NONE_ON_PATH = "The path has no limit point and no bifurcation."
"""Why an imperfect device that was traced to the end has no load."""

MOST_LETTERS = 400
"""Length of a message."""


@dataclass(frozen=True)
class KnockDown:
    """Loads that imperfect devices bear, beside that of the perfect one.

    Attributes
    ----------
    column
        The column of the load.
    perfect
        The load of the first limit point or bifurcation of the perfect device.
    sizes
        Sizes of the imperfections in m.
    loads
        The load of the first limit point or bifurcation with each of them; None where the path has
        none, as behind a bifurcation from which the load grows.
    runs
        The run of the perfect device, and those of the others.
    reasons
        For each size why no load is known, in words; empty where one is.
    """

    column: str
    perfect: float
    sizes: tuple[float, ...]
    loads: tuple[float | None, ...]
    runs: tuple[Run, ...]
    reasons: tuple[str, ...] = ()

    @property
    def ratios(self) -> tuple[float | None, ...]:
        """Each load over that of the perfect device."""
        return tuple(None if load is None else load / self.perfect for load in self.loads)

    @property
    def exponent(self) -> float | None:
        """The power of the size with which the loss of load grows, from the two smallest sizes.

        With 1 - ratio = c size^p, p tends to 2/3 where the perfect branch falls to both sides
        alike, and to 1/2 where it falls to one side (W. T. Koiter, 1945).  None if there are less
        than two loads.
        """
        known = sorted(
            (abs(size), 1 - ratio)
            for size, ratio in zip(self.sizes, self.ratios, strict=True)
            if ratio is not None and ratio < 1
        )
        if len(known) < 2 or known[0][0] == known[1][0]:
            return None
        (a, x), (b, y) = known[:2]
        return float(np.log(y / x) / np.log(b / a))


def knock_down(
    scene: Scene,
    path: Item | Sequence[Item],
    sizes: Sequence[float],
    shape: Shape | None = None,
    out: str | Path | None = None,
    **options: Unpack[SolveOptions],
) -> KnockDown:
    """The load that a device bears with imperfections of several sizes.  Collective.

    The perfect device and each imperfect one is traced along the same path.  The summary of the
    first one holds the result: ``knock_down_sizes_m``, ``knock_down_ratios``,
    ``knock_down_exponent`` and ``knock_down_reasons``.

    Parameters
    ----------
    scene
        The perfect device.
    path
        The items of the path, of which the last is a `Trace` without ``switch``.  It should go over
        the limit points of the imperfect devices, so give it an end by ``until`` or ``steps``.
    sizes
        Largest displacements of the undeformed nodes in m, see `imperfect`.
    shape
        Their shape: `ModeShape`, `RandomShape`, or a function of positions.  None takes the null
        vector of the first bifurcation of the perfect device, and needs `out`.
    out
        Folder for the runs: ``perfect``, ``size_1``, ``size_2``, ...; None writes nothing.
    options
        As of `solve`; ``stability`` is ``"every"``.

    Returns
    -------
    KnockDown

    Raises
    ------
    InputError
        For sizes that are no numbers, and if the perfect device has no limit point and no
        bifurcation on the path.
    """
    items = _checked(path, sizes, shape, out, options)
    options["stability"] = "every"
    column = load_column(scene, items[-1].what)[0]
    folder = None if out is None else Path(out)

    def traced(name: str, device: Device | None) -> tuple[Run, str]:
        where = None if folder is None else folder / name
        told = scene if device is None else replace(scene, device=device)
        try:
            return solve(told, items, None, where, **options), ""
        except (Interrupted, MachineError):
            raise
        except PathError as error:
            if getattr(error, "run", None) is None:
                raise
            return error.run, str(error)

    def devices(shape: Shape) -> list[Device]:
        return [imperfect(scene.device, shape, float(size)) for size in sizes]

    moved = None if shape is None else devices(shape)
    perfect, end = traced(PERFECT, None)
    load = first_critical(perfect.history, column, len(items))
    if load is None:
        raise InputError(
            "The perfect device has no limit point and no bifurcation on this path, so nothing can "
            f"be knocked down; {end or 'let the trace go farther.'}"[:MOST_LETTERS]
        )
    if moved is None:
        assert folder is not None
        moved = devices(ModeShape(folder / PERFECT))
    others = [traced(f"size_{k}", device) for k, device in enumerate(moved, 1)]
    runs = [run for run, _ in others]
    loads = tuple(first_critical(run.history, column, len(items)) for run in runs)
    reasons = tuple(
        "" if critical is not None else end or NONE_ON_PATH
        for critical, (_, end) in zip(loads, others, strict=True)
    )
    told_sizes = tuple(map(float, sizes))
    found = KnockDown(column, load, told_sizes, loads, (perfect, *runs), reasons)
    perfect.add(
        knock_down_sizes_m=list(found.sizes), knock_down_ratios=list(found.ratios),
        knock_down_exponent=found.exponent, knock_down_reasons=list(found.reasons),
    )  # fmt: skip
    return found


def first_critical(
    history: Sequence[Mapping[str, Any]], column: str, items: int
) -> float | None:
    """The load of the first limit point or bifurcation of the last item of a path, or None."""
    return next(
        (
            float(row[column])
            for row in history
            if row["event"] in (*LIMITS, "bifurcation") and row["time"] > items - 1
        ),
        None,
    )


def _checked(
    path: Item | Sequence[Item], sizes: Any, shape: Any, out: str | Path | None,
    options: Mapping[str, Any],
) -> list[Any]:
    """The items of the path, if they and what else is given are usable."""
    items = list(path) if isinstance(path, Sequence) else [path]
    last = items[-1] if items else None
    if not isinstance(last, Trace) or last.switch:
        raise InputError(
            f"The path of knock_down must end by a Trace without switch=, not by {shown(last)}."
        )
    if isinstance(sizes, str) or not isinstance(sizes, Sequence | np.ndarray) or not len(sizes):
        raise InputError(
            f"knock_down is given the sizes {shown(sizes)}, but needs a list of lengths in m."
        )
    for size in sizes:
        finite(size, "The size of an imperfection in m")
        if size == 0:
            raise InputError("The size of an imperfection is 0 m; leave the perfect device out.")
    if shape is None and out is None:
        raise InputError(
            "knock_down takes the mode of the perfect device from its results folder; give it "
            "out=, or a shape."
        )
    if options.get("stability", "every") != "every":
        raise InputError('knock_down needs stability="every"; leave stability= out.')
    return items
