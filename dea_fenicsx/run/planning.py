"""What a run will take before it is started: unknowns, preconditioner, memory and time.

The constants were measured; docs/developers/solver.md tells on which devices, under "Performance
model".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import Item
from dea_fenicsx.run.arguments import STABILITY
from dea_fenicsx.run.choosing import Demands, choose
from dea_fenicsx.run.costs import in_levels, with_factor
from dea_fenicsx.run.solver_notes import UNCOUNTED
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of, whole

MOST_RANKS = 100_000
"""Largest number of ranks of a plan."""

SECONDS_OF_SETTING_UP = {1: 1e-5, 2: 1e-5, 3: 3e-5}
"""Time to read the device and to number the unknowns for each of them, by dimension."""

NEWTON_OF_STEP = 2.5
"""Newton iterations of a step, about the mean of ten scenes of `make bench`."""

KRYLOV_OF_NEWTON = 6.5
"""Krylov iterations of a Newton iteration, about the mean of the same scenes."""

FACTORS_OF_STEP = {"whole": 1.0, "split": 0.15, "single": 0.5, "multigrid": 0.15}
"""Factorisations of a step, by preconditioner.  A factor of the whole also counts at each step."""

STEPS_OF_MARCH = 100
"""Steps that a march in adapted steps is taken to need."""

GAIN_OF_SECOND_RANK = 1.5
"""How many times faster two ranks are than one."""


@dataclass(frozen=True)
class Plan:
    """What a run will take.

    Attributes
    ----------
    unknowns
        Number of unknowns.
    cells
        Number of cells.
    ranks
        Number of ranks for which the plan is made.
    factor
        The preconditioner, by its name in `NewtonOptions`.
    entries
        Entries of the factor that it keeps; 0 of multigrid.
    operations
        Floating-point operations of a factorisation; 0 of multigrid.
    memory_bytes
        Memory of all ranks together while the path is followed.
    counting_bytes
        The same while negative eigenvalues are counted, if the whole tangent must be factorised.
        Often a cheaper proof is found; ``stability="never"`` leaves the count out.
    factorisation_s, step_s
        Time of one factorisation and of one step of a path.
    steps
        Steps of the path; None if no path was given.
    seconds
        Time of the run; None if no path was given.
    note
        What is to be said of the choice of the preconditioner; empty where the factor fits into the
        memory that is free on this machine.
    """

    unknowns: int
    cells: int
    ranks: int
    factor: str
    entries: float
    operations: float
    memory_bytes: float
    counting_bytes: float
    factorisation_s: float
    step_s: float
    steps: int | None
    seconds: float | None
    note: str = ""

    def __str__(self) -> str:
        many = f"{self.ranks} rank{'s' * (self.ranks > 1)}"
        each = f" ({self.memory_bytes / self.ranks / 1e9:.2g} GB a rank)" if self.ranks > 1 else ""
        size = f", {self.entries:.2g} entries, {self.operations:.2g} operations"
        size = size if self.entries else ""
        lines = [
            f"{self.unknowns} unknowns, {self.cells} cells, {many}",
            f"preconditioner: {self.factor}{size}",
            f"memory: {self.memory_bytes / 1e9:.2g} GB{each}",
        ]
        if self.counting_bytes > self.memory_bytes:
            lines.append(
                f"memory to count negative eigenvalues: up to {self.counting_bytes / 1e9:.2g} GB "
                '(stability="never" leaves the count out)'
            )
        lines.append(
            f"time: {_duration(self.factorisation_s)} a factorisation, "
            f"{_duration(self.step_s)} a step"
        )
        if self.seconds is not None:
            lines.append(f"time of {self.steps} steps: {_duration(self.seconds)}")
        if self.note:
            lines.append(f"note: {self.note}")
        return "\n".join(lines)


def plan(
    scene: Scene,
    path: Item | Sequence[Item] | None = None,
    ranks: int = 1,
    options: NewtonOptions | None = None,
    stability: str = "last",
) -> Plan:
    """What a run of a scene will take, before it is started.

    The problem is set up, but nothing is solved.  The memory is right within about 30 %, the time
    within a factor of two on a machine like that on which the constants were measured; steps that
    are refused and halved are not foreseen.

    Parameters
    ----------
    scene
        The scene, on one rank.
    path
        Ramps, traces and marches; None if the time of the whole run is not wanted.
    ranks
        Number of ranks on which it will run.
    options
        Settings of the nonlinear solver.
    stability
        When negative eigenvalues will be counted, see `solve`.

    Raises
    ------
    InputError
        If the scene is on several ranks, or if the number of ranks or `stability` is none.
    """
    check_ranks(ranks)
    one_of(stability, STABILITY, "stability")
    if scene.device.comm.size != 1:
        raise InputError(
            f"A plan is made on one rank, but the device is on {scene.device.comm.size}; start it "
            "without mpirun, and give ranks= the number of ranks of the run."
        )
    problem, note = Problem(scene), ""
    solver = NewtonSolver(problem, options)
    factor, n, dim = solver.factor_kind, problem.unknowns, problem.mesh.topology.dim
    if factor == "multigrid":
        cost = in_levels(n, ranks)
    else:
        cost = with_factor(problem, factor, ranks)
        items = [path] if isinstance(path, Item) else path or []
        choice = choose(solver, Demands(items, stability), ranks, cost.memory)
        note = choice.told
        if choice.multigrid:
            factor, cost, note = "multigrid", in_levels(n, ranks), f"{note}  {UNCOUNTED}"
    faster = GAIN_OF_SECOND_RANK ** math.log2(ranks)
    factorise = cost.factorise / faster
    newton = KRYLOV_OF_NEWTON * cost.krylov / faster
    step = NEWTON_OF_STEP * newton + FACTORS_OF_STEP[factor] * factorise
    steps = None if path is None else _steps(path)
    begin = n * SECONDS_OF_SETTING_UP[dim] / faster + factorise
    return Plan(
        n, problem.mesh.topology.index_map(dim).size_global, ranks, factor, cost.size.entries,
        cost.size.operations, cost.memory, cost.counting, factorise, step, steps,
        None if steps is None else begin + steps * step, note,
    )  # fmt: skip


def check_ranks(ranks: int) -> None:
    """Raise InputError for a number of ranks that no run has."""
    whole(ranks, "The number of ranks of a plan", 1)
    if ranks > MOST_RANKS:
        raise InputError(f"A plan is for at most {MOST_RANKS} ranks, not for {ranks}.")


def _steps(path: Item | Sequence[Item]) -> int:
    """Steps of a path.  A switch that is moved takes none."""
    found = 0
    for item in [path] if isinstance(path, Item) else path:
        steps, landings = getattr(item, "steps", 0), getattr(item, "at", None) or ()
        found += STEPS_OF_MARCH if steps is None else max(steps, len(landings))
    return found


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.2g} min" if seconds < 6000 else f"{seconds / 3600:.2g} h"

