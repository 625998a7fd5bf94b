"""Speed against error: one quantity on a ladder of meshes and fidelities.

For each fidelity the quantity is extrapolated from its finest meshes (Richardson).  So every rung
has two errors: the error of its mesh, relative to the limit of its own fidelity, and the whole
error, relative to the exact value.  If no exact value is given, the limit of the last fidelity
takes its place, which must be the most complete one.
"""

from __future__ import annotations

import csv
import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

from dea_fenicsx.measure.observables import Observable
from dea_fenicsx.path.items import Ramp
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.cell_types import SIMPLICES
from dea_fenicsx.support.errors import InputError

Make = Callable[[int], Scene]
"""Makes a scene on the mesh of a level; twice the level halves its cells."""

ERROR_TARGETS = (1e-2, 1e-3, 1e-4)
"""Errors for which the cheapest rung is named."""


@dataclass(frozen=True)
class Rung:
    """One choice of fidelity and mesh, and what it costs and gives.

    Attributes
    ----------
    scene : name of the ladder
    fidelity : name of the fidelity
    element : displacement and pressure, such as ``"Q2-P1disc"``, or ``"formula"``
    level : level of the mesh; 0 for a formula
    unknowns : number of unknowns
    wall_s : wall time of the whole solve, compiled forms excepted
    value : the quantity, SI
    mesh_error : relative to the fidelity's own limit; NaN with fewer than three levels
    error : relative to the ladder's reference
    """

    scene: str
    fidelity: str
    element: str
    level: int
    unknowns: int
    wall_s: float
    value: float
    mesh_error: float = float("nan")
    error: float = float("nan")


@dataclass(frozen=True)
class Ladder:
    """All rungs, in the order of the fidelities.

    Attributes
    ----------
    rungs : the rungs
    reference : what `Rung.error` is measured against
    orders : observed order of convergence of each fidelity with three levels or more
    """

    rungs: tuple[Rung, ...]
    reference: float
    orders: Mapping[str, float]

    def cheapest(self, error: float) -> Rung | None:
        """The rung that reaches an error in the shortest time, or None."""
        good = [rung for rung in self.rungs if rung.error <= error]
        return min(good, key=lambda rung: rung.wall_s, default=None)

    def choices(self) -> dict[float, Rung | None]:
        """The cheapest rung for each error of `ERROR_TARGETS`."""
        return {wanted: self.cheapest(wanted) for wanted in ERROR_TARGETS}

    def table(self) -> str:
        """The rungs as text, and the cheapest choice for each error of `ERROR_TARGETS`."""
        lines = [f"{'fidelity':28}{'element':12}{'level':>5}{'unknowns':>10}{'wall':>10}"
                 f"{'value':>15}{'mesh error':>12}{'error':>11}"]  # fmt: skip
        lines += [
            f"{r.fidelity:28}{r.element:12}{r.level:5d}{r.unknowns:10d}{r.wall_s:8.3f} s"
            f"{r.value:15.7g}{r.mesh_error:12.1e}{r.error:11.1e}"
            for r in self.rungs
        ]
        for wanted, best in self.choices().items():
            lines.append(
                f"to {wanted:.2%}: " + (f"{best.fidelity}, {best.element}, level {best.level}, "
                                        f"{best.wall_s:.3g} s" if best else "none of these")
            )  # fmt: skip
        return "\n".join(lines)

    def write(self, path: str | Path) -> None:
        """Write the rungs as CSV; on one rank."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [f.name for f in fields(Rung)])
            writer.writeheader()
            writer.writerows(asdict(rung) for rung in self.rungs)


def speed_vs_error(
    scene: Make | Mapping[str, Make | Callable[[], float]],
    quantity: Observable | Callable[[Scene], Observable],
    levels: Sequence[int] = (1, 2, 4),
    *,
    path: Ramp | Sequence[Ramp] | None = None,
    exact: float | None = None,
    name: str = "scene",
    options: NewtonOptions | None = None,
    say: Callable[[str], object] = lambda line: None,
) -> Ladder:
    """Run a ladder of meshes and fidelities and tell what each costs and gives.  Collective.

    Parameters
    ----------
    scene
        A function from the level of a mesh to a scene; or several by the name of their fidelity,
        the most complete last.  A function without argument stands for a formula and gives the
        quantity itself.
    quantity
        What the user came for, at the path's end; or a function that names it for each scene.
    levels
        Levels of the meshes, coarse to fine.
    path
        How the loads are brought up; by default all ramps of the scene, in one step.
    exact
        The exact value, where there is one.  Without it errors are measured against the last
        fidelity's limit, so it must have three levels at least.
    name
        Name of the ladder, the column ``scene``.
    options
        Settings of Newton's method.
    say
        Called on all ranks with a line for each rung.

    Raises
    ------
    InputError
        For levels that do not grow, or too few of them to extrapolate from.
    """
    makers = dict(scene) if isinstance(scene, Mapping) else {"finite elements": scene}
    levels = list(levels)
    if not makers or not levels or levels[0] < 1 or np.any(np.diff(levels) <= 0):
        raise InputError(
            f"The levels of a ladder are {levels!r}, but must be whole numbers that grow from 1 or "
            "more, and there must be a scene."
        )
    if exact is None and len(levels) < 3:
        raise InputError(
            "A ladder without an exact value needs at least three levels to extrapolate from; give "
            "levels=(1, 2, 4), or exact=..."
        )
    rungs: list[Rung] = []
    limits: dict[str, float] = {}
    orders: dict[str, float] = {}
    for fidelity, make in makers.items():
        climbed: list[Rung] = []
        for level in levels if inspect.signature(make).parameters else [0]:
            climbed.append(
                _solved(name, fidelity, make, level, quantity, path, options, first=not climbed)
                if level else _evaluated(name, fidelity, make)
            )  # fmt: skip
            say(f"{fidelity}, level {level}: {climbed[-1].value:.7g}, {climbed[-1].wall_s:.3g} s")
        values = [rung.value for rung in climbed]
        limits[fidelity] = values[-1]
        if len(values) > 2:
            limits[fidelity], orders[fidelity] = extrapolated(levels, values)
        limit = limits[fidelity]
        rungs += [
            replace(r, mesh_error=_relative(r.value, limit) if len(values) > 2 else np.nan)
            for r in climbed
        ]
    reference = limits[list(makers)[-1]] if exact is None else exact
    rungs = [replace(r, error=_relative(r.value, reference)) for r in rungs]
    return Ladder(tuple(rungs), reference, orders)


def extrapolated(levels: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Limit and order of a sequence c + a h^n with h = 1/level, through its last three values.

    If the values do not change monotonically, or do not change any more, the order is unknown.
    Then the limit is the last value and the order is NaN.
    """
    h = 1 / np.asarray(levels[-3:], dtype=float)
    a, b, c = values[-3:]
    if (b - a) * (c - b) <= 0 or abs(c - b) >= abs(b - a):
        return c, float("nan")
    ratio = (b - a) / (c - b)

    def miss(n: float) -> float:
        return float((h[1] ** n - h[0] ** n) / (h[2] ** n - h[1] ** n) - ratio)

    if miss(0.05) * miss(20.0) > 0:
        return c, float("nan")
    order = brentq(miss, 0.05, 20.0)
    return c + (c - b) * h[2] ** order / (h[1] ** order - h[2] ** order), order


def _relative(value: float, reference: float) -> float:
    return abs(value - reference) / abs(reference) if reference else abs(value)


def _evaluated(name: str, fidelity: str, make: Callable[..., Any]) -> Rung:
    """The rung of a formula."""
    start = time.perf_counter()
    value = float(make())
    return Rung(name, fidelity, "formula", 0, 0, time.perf_counter() - start, value)


def _solved(
    name: str,
    fidelity: str,
    make: Callable[..., Any],
    level: int,
    quantity: Observable | Callable[[Scene], Observable],
    path: Ramp | Sequence[Ramp] | None,
    options: NewtonOptions | None,
    first: bool,
) -> Rung:
    """A rung by finite elements.

    The first of each fidelity is solved twice, so that its time does not include compilation.
    """
    for _ in range(1 + first):
        start = time.perf_counter()
        scene = make(level)
        seen = quantity(scene) if callable(quantity) else quantity
        run = solve(
            scene, path or Ramp(steps=1), {"quantity": seen}, quiet=True, stability="never",
            options=options,
        )  # fmt: skip
        wall = scene.device.comm.allreduce(time.perf_counter() - start, op=MPI.MAX)
    degree, cell = scene.elements.degree, scene.device.mesh.topology.cell_name()
    jumps = "disc" if run.problem.pressure_kind == "discontinuous" else ""
    element = f"{'P' if cell in SIMPLICES else 'Q'}{degree}-P{degree - 1}{jumps}"
    value = run[f"quantity_{seen.unit}" if seen.unit else "quantity"]
    return Rung(name, fidelity, element, level, run.summary["unknowns"], wall, value)
