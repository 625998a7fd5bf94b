"""What a run will take before it is started: unknowns, preconditioner, memory and time.

The entries of the factor and the operations that it takes are counted on the mesh, see
`dea_fenicsx.solvers.dissection`.  All other constants here were measured; docs/developers/solver.md
tells on which devices, under "Performance model".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import Item
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.dissection import FactorSize, dissection_of
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.split_factor import LOW_RANK_FROM_UNKNOWNS
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import whole

MOST_RANKS = 100_000
"""Largest number of ranks of a plan."""

BYTES_OF_RANK = 250e6
"""Memory of a rank without a device: Python, DOLFINx, PETSc and their libraries."""

BYTES_OF_UNKNOWN = {1: 0.8e3, 2: 1.25e3, 3: 3.6e3}
"""Memory for each unknown beside the factor, by dimension: mesh, forms, an assembled tangent."""

BYTES_OF_ENTRY = {"single": 6.0, "double": 12.0}
"""Memory for each entry of a factor, by its precision, with the workspace of MUMPS."""

MORE_MEMORY_FOR_RANKS = 0.15
"""Share by which the memory of a factor grows where several ranks share it."""

OPERATIONS_PER_S = {"single": 60e9, "double": 25e9}
"""Operations of a large factorisation per second of one core, by precision."""

SECONDS_OF_ENTRY = {"single": 25e-9, "double": 30e-9}
"""Time of a factorisation for each entry, beside that of its operations."""

SECONDS_OF_SOLVE = {"single": 1.0e-9, "double": 1.6e-9}
"""Time of a Krylov iteration for each entry, by precision: the factor is read twice."""

SECONDS_OF_PRODUCT = {1: 1e-7, 2: 1e-7, 3: 2e-7}
"""Time of a product with the tangent for each unknown, by dimension."""

SECONDS_OF_ASSEMBLY = {1: 2e-6, 2: 2e-6, 3: 1e-5}
"""Time to assemble the tangent for each unknown, by dimension."""

SECONDS_OF_SETTING_UP = {1: 1e-5, 2: 1e-5, 3: 3e-5}
"""Time to read the device and to number the unknowns for each of them, by dimension."""

LOW_RANK_FROM_ENTRIES, LOW_RANK_POWER_OF_ENTRIES = 1e8, 0.32
"""Entries from which blocks of low rank save some, and the power with which the saving grows."""

LOW_RANK_FROM_OPERATIONS, LOW_RANK_POWER_OF_OPERATIONS = 2.5e11, 0.58
"""The same of operations."""

NEWTON_OF_STEP = 2.5
"""Newton iterations of a step, about the mean of ten scenes of `make bench`."""

KRYLOV_OF_NEWTON = 6.5
"""Krylov iterations of a Newton iteration, about the mean of the same scenes."""

FACTORS_OF_STEP = {"whole": 1.0, "split": 0.15, "single": 0.5, "multigrid": 0.15}
"""Factorisations of a step, by preconditioner.  A factor of the whole also counts at each step."""

BYTES_OF_UNKNOWN_IN_LEVELS = 2.7e3
"""Memory of multigrid for each unknown, with all that `BYTES_OF_UNKNOWN` stands for."""

SECONDS_OF_LEVELS = 2e-5
"""Time to set up the levels of multigrid for each unknown."""

SECONDS_OF_CYCLE = 6e-7
"""Time of a Krylov iteration with multigrid for each unknown."""

MORE_KRYLOV_IN_LEVELS = 1.5
"""Krylov iterations with multigrid over those with a factor."""

STEPS_OF_MARCH = 100
"""Steps that a march in adapted steps is taken to need."""

GAIN_OF_SECOND_RANK = 1.5
"""How many times faster two ranks are than one."""

Precision = Literal["single", "double"]


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
        return "\n".join(lines)


def plan(
    scene: Scene,
    path: Item | Sequence[Item] | None = None,
    ranks: int = 1,
    options: NewtonOptions | None = None,
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

    Raises
    ------
    InputError
        If the scene is on several ranks, or if the number of ranks is none.
    """
    check_ranks(ranks)
    if scene.device.comm.size != 1:
        raise InputError(
            f"A plan is made on one rank, but the device is on {scene.device.comm.size}; start it "
            "without mpirun, and give ranks= the number of ranks of the run."
        )
    problem = Problem(scene)
    factor = NewtonSolver(problem, options).factor_kind
    n, dim = problem.unknowns, problem.mesh.topology.dim
    cost = _in_levels(n, ranks) if factor == "multigrid" else _with_factor(problem, factor, ranks)
    faster = GAIN_OF_SECOND_RANK ** math.log2(ranks)
    factorise = cost.factorise / faster
    newton = KRYLOV_OF_NEWTON * cost.krylov / faster
    step = NEWTON_OF_STEP * newton + FACTORS_OF_STEP[factor] * factorise
    steps = None if path is None else _steps(path)
    begin = n * SECONDS_OF_SETTING_UP[dim] / faster + factorise
    return Plan(
        n, problem.mesh.topology.index_map(dim).size_global, ranks, factor, cost.size.entries,
        cost.size.operations, cost.memory, cost.counting, factorise, step, steps,
        None if steps is None else begin + steps * step,
    )  # fmt: skip


@dataclass(frozen=True)
class _Cost:
    """What a preconditioner costs: its size, bytes of all ranks, and seconds on one rank.

    Attributes
    ----------
    size : its entries and operations
    memory, counting : bytes while the path is followed, and while negative eigenvalues are counted
    factorise, krylov : seconds to make it, and of one Krylov iteration
    """

    size: FactorSize
    memory: float
    counting: float
    factorise: float
    krylov: float


def _in_levels(unknowns: int, ranks: int) -> _Cost:
    """The cost of multigrid, which does not count."""
    memory = ranks * BYTES_OF_RANK + unknowns * BYTES_OF_UNKNOWN_IN_LEVELS
    return _Cost(
        FactorSize(unknowns, 0.0, 0.0), memory, memory, unknowns * SECONDS_OF_LEVELS,
        unknowns * SECONDS_OF_CYCLE * MORE_KRYLOV_IN_LEVELS,
    )  # fmt: skip


def _with_factor(problem: Problem, factor: str, ranks: int) -> _Cost:
    """The cost of a factor."""
    n, dim = problem.unknowns, problem.mesh.topology.dim
    precision: Precision = "double"
    if factor in ("single", "split") and compat.keeps_single():
        precision = "single"
    kept, whole_tangent = _sizes(problem, factor)
    return _Cost(
        kept, _memory(n, dim, kept, precision, ranks),
        _memory(n, dim, whole_tangent, "double", ranks),
        kept.operations / OPERATIONS_PER_S[precision]
        + kept.entries * SECONDS_OF_ENTRY[precision] + n * SECONDS_OF_ASSEMBLY[dim],
        kept.entries * SECONDS_OF_SOLVE[precision] + n * SECONDS_OF_PRODUCT[dim],
    )  # fmt: skip


def check_ranks(ranks: int) -> None:
    """Raise InputError for a number of ranks that no run has."""
    whole(ranks, "The number of ranks of a plan", 1)
    if ranks > MOST_RANKS:
        raise InputError(f"A plan is for at most {MOST_RANKS} ranks, not for {ranks}.")


def _sizes(problem: Problem, factor: str) -> tuple[FactorSize, FactorSize]:
    """The sizes of the factor that is kept, and of that of the whole tangent."""
    fields = problem.space.fields
    every = dissection_of(problem, fields).size()
    if factor != "split":
        return every, every
    parts = [
        _in_low_rank(dissection_of(problem, [field]).size())
        for field in fields if field.role in (Role.MOTION, Role.POTENTIAL)
    ]  # fmt: skip
    kept = FactorSize(
        sum(part.unknowns for part in parts), sum(part.entries for part in parts),
        sum(part.operations for part in parts),
    )  # fmt: skip
    return kept, every


def _in_low_rank(exact: FactorSize) -> FactorSize:
    """The size of a factor whose blocks are approximated by blocks of low rank, if it is large."""
    if exact.unknowns < LOW_RANK_FROM_UNKNOWNS:
        return exact
    fewer = min(1.0, (LOW_RANK_FROM_ENTRIES / exact.entries) ** LOW_RANK_POWER_OF_ENTRIES)
    less = min(1.0, (LOW_RANK_FROM_OPERATIONS / exact.operations) ** LOW_RANK_POWER_OF_OPERATIONS)
    return FactorSize(exact.unknowns, exact.entries * fewer, exact.operations * less)


def _memory(
    unknowns: int, dim: int, factor: FactorSize, precision: Precision, ranks: int
) -> float:
    """Memory of all ranks in bytes."""
    shared = 1 + MORE_MEMORY_FOR_RANKS * (ranks > 1)
    return (
        ranks * BYTES_OF_RANK + unknowns * BYTES_OF_UNKNOWN[dim]
        + shared * factor.entries * BYTES_OF_ENTRY[precision]
    )  # fmt: skip


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

