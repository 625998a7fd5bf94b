"""What a preconditioner costs: its memory, and the time to make it and to use it.

The entries of the factor and the operations that it takes are counted on the mesh, see
`dea_fenicsx.solvers.dissection`.  All other constants here were measured; docs/developers/solver.md
tells on which devices, under "Performance model".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.dissection import FactorSize, size_of_factor
from dea_fenicsx.solvers.split_factor import LOW_RANK_FROM_UNKNOWNS
from dea_fenicsx.support import compat

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

LOW_RANK_FROM_ENTRIES, LOW_RANK_POWER_OF_ENTRIES = 1e8, 0.32
"""Entries from which blocks of low rank save some, and the power with which the saving grows."""

LOW_RANK_FROM_OPERATIONS, LOW_RANK_POWER_OF_OPERATIONS = 2.5e11, 0.58
"""The same of operations."""

BYTES_OF_UNKNOWN_IN_LEVELS = 2.75e3
"""Memory of multigrid for each unknown, with all that `BYTES_OF_UNKNOWN` stands for."""

MORE_LEVELS_FOR_RANKS = 0.25
"""Share by which this memory grows where several ranks share it.

On two ranks a cube and a stack take 3.3 and 3.6 kB for each further unknown, on one 2.74 and 2.80.
"""

SECONDS_OF_LEVELS = 2e-5
"""Time to set up the levels of multigrid for each unknown."""

SECONDS_OF_CYCLE = 6e-7
"""Time of a Krylov iteration with multigrid for each unknown."""

MORE_KRYLOV_IN_LEVELS = 1.5
"""Krylov iterations with multigrid over those with a factor."""

Precision = Literal["single", "double"]


@dataclass(frozen=True)
class Cost:
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


def in_levels(unknowns: int, ranks: int) -> Cost:
    """The cost of multigrid, which does not count."""
    shared = 1 + MORE_LEVELS_FOR_RANKS * (ranks > 1)
    memory = ranks * BYTES_OF_RANK + shared * unknowns * BYTES_OF_UNKNOWN_IN_LEVELS
    return Cost(
        FactorSize(unknowns, 0.0, 0.0), memory, memory, unknowns * SECONDS_OF_LEVELS,
        unknowns * SECONDS_OF_CYCLE * MORE_KRYLOV_IN_LEVELS,
    )  # fmt: skip


def with_factor(problem: Problem, factor: str, ranks: int) -> Cost:
    """The cost of a factor on a number of ranks.  Collective on those that the problem is on."""
    n, dim = problem.unknowns, problem.mesh.topology.dim
    precision, kept = precision_of(factor), size_kept(problem, factor)
    whole_tangent = kept if factor != "split" else size_of_factor(problem, problem.space.fields)
    return Cost(
        kept, memory_with(problem, kept.entries, precision, ranks),
        memory_with(problem, whole_tangent.entries, "double", ranks),
        kept.operations / OPERATIONS_PER_S[precision]
        + kept.entries * SECONDS_OF_ENTRY[precision] + n * SECONDS_OF_ASSEMBLY[dim],
        kept.entries * SECONDS_OF_SOLVE[precision] + n * SECONDS_OF_PRODUCT[dim],
    )  # fmt: skip


def precision_of(factor: str) -> Precision:
    """The precision in which a factor is kept."""
    return "single" if factor in ("single", "split") and compat.keeps_single() else "double"


def size_kept(problem: Problem, factor: str) -> FactorSize:
    """The size of the factor that is kept.  Collective."""
    fields = problem.space.fields
    if factor != "split":
        return size_of_factor(problem, fields)
    parts = [
        _in_low_rank(size_of_factor(problem, [field]))
        for field in fields if field.role in (Role.MOTION, Role.POTENTIAL)
    ]  # fmt: skip
    return FactorSize(
        sum(part.unknowns for part in parts), sum(part.entries for part in parts),
        sum(part.operations for part in parts),
    )  # fmt: skip


def _in_low_rank(exact: FactorSize) -> FactorSize:
    """The size of a factor whose blocks are approximated by blocks of low rank, if it is large."""
    if exact.unknowns < LOW_RANK_FROM_UNKNOWNS:
        return exact
    fewer = min(1.0, (LOW_RANK_FROM_ENTRIES / exact.entries) ** LOW_RANK_POWER_OF_ENTRIES)
    less = min(1.0, (LOW_RANK_FROM_OPERATIONS / exact.operations) ** LOW_RANK_POWER_OF_OPERATIONS)
    return FactorSize(exact.unknowns, exact.entries * fewer, exact.operations * less)


def memory_with(problem: Problem, entries: float, precision: Precision, ranks: int) -> float:
    """Memory of all ranks in bytes, with a factor of so many entries."""
    shared = 1 + MORE_MEMORY_FOR_RANKS * (ranks > 1)
    return (
        ranks * BYTES_OF_RANK + problem.unknowns * BYTES_OF_UNKNOWN[problem.mesh.topology.dim]
        + shared * entries * BYTES_OF_ENTRY[precision]
    )  # fmt: skip
