"""The choice between a direct factor and multigrid, where the user leaves it open.

With ``NewtonOptions(factor="auto")`` a run keeps a direct factor, unless that would hardly fit into
the memory that is free.  Then multigrid is taken if it can do all that the run asks for.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import Item, March, Ramp, Trace
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.reading import read_summary
from dea_fenicsx.run.arguments import Arguments
from dea_fenicsx.run.costs import BYTES_OF_RANK, in_levels, memory_with, precision_of, size_kept
from dea_fenicsx.solvers.multigrid import caution, missing
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.free_memory import free_bytes

MOST_SHARE_OF_FREE_MEMORY = 0.8
"""Share of the free memory that a direct factor may be estimated to need.

The estimate is right within 30 % (docs/developers/solver.md, "Performance model").  With 0.8, a
factor that needs a quarter more than estimated still fits.
"""

MOST_ENTRIES = 60.0
"""Bound of the entries of a factor, over the 4/3rd power of the unknowns.

In cubes of 407 to 513 887 unknowns there are 15 to 25, and all other bodies have fewer.  Where so
many fit, the entries are not counted, which takes some seconds on large meshes.
"""

BYTES_NOT_ASKED_FOR = 2e8
"""What a factor may need at most where nobody asks how much is free: as much as one more process.

To ask takes a millisecond, which a small run would notice.
"""


@dataclass(frozen=True)
class Choice:
    """What is chosen.

    Attributes
    ----------
    multigrid
        Whether multigrid is taken in place of a factor.
    told
        Why, in words; empty where the factor fits.
    """

    multigrid: bool = False
    told: str = ""


@dataclass(frozen=True)
class Demands:
    """What is asked of a run, as far as not every preconditioner can do it.

    Attributes
    ----------
    path
        Items of the path.
    stability
        When negative eigenvalues are counted, see `solve`.
    estimates
        Whether errors are estimated.
    """

    path: Sequence[Item] = ()
    stability: str = "last"
    estimates: bool = False


def decide(solver: NewtonSolver, given: Arguments, folder: Folder | None) -> str:
    """Make a solver that is new take multigrid where it shall; why, in words.  Collective.

    A run that is resumed keeps what it has chosen before.
    """
    estimates = bool(given.estimate) or given.accuracy is not None
    asked = Demands(given.items, given.stability, estimates)
    before = earlier(folder) if folder and given.resume else None
    choice = choose(solver, asked, before=before)
    if choice.multigrid:
        solver.take_multigrid()
    return choice.told


def earlier(folder: Folder) -> str | None:
    """The preconditioner that an earlier run in a folder has chosen itself, or None.  Collective.

    What a user has named there is no choice: this run leaves it open, perhaps because it failed.
    """
    found: Any = None
    if folder.comm.rank == 0:
        with suppress(InputError, KeyError, TypeError):
            summary = read_summary(folder.path)
            if summary["settings"]["newton"]["factor"] == "auto":
                found = summary["preconditioner"]
    found = folder.comm.bcast(found if isinstance(found, str) else None, root=0)
    return str(found) if found else None


def choose(
    solver: NewtonSolver, asked: Demands, ranks: int | None = None, needed: float | None = None,
    before: str | None = None,
) -> Choice:  # fmt: skip
    """Whether multigrid is to be taken, for a solver that has a factor so far.  Collective.

    Parameters
    ----------
    solver
        The solver; only ``factor="auto"`` leaves a choice.
    asked
        What the run shall do.
    ranks
        Ranks of the run; None for those that the problem is on.
    needed
        Bytes of the whole run with its factor, if they are known.
    before
        What the run has chosen that this one resumes, or None.
    """
    problem = solver.problem
    if solver.options.factor != "auto":
        return Choice()
    found = _chosen(solver, asked, ranks or problem.comm.size, needed, before)
    return problem.comm.bcast(found, root=0)


def _chosen(
    solver: NewtonSolver, asked: Demands, ranks: int, needed: float | None, before: str | None
) -> Choice:
    problem = solver.problem
    obstacle = _obstacle(problem, asked)
    if before == "multigrid" and not obstacle:
        return Choice(True, "Multigrid is taken, as in the run that is resumed.")
    if before is not None and before != "multigrid":
        return Choice()
    own = ranks * BYTES_OF_RANK  # processes that run have this already
    precision = precision_of(solver.factor_kind)
    bound = memory_with(problem, MOST_ENTRIES * problem.unknowns ** (4 / 3), precision, ranks) - own
    if needed is None and bound <= BYTES_NOT_ASKED_FOR:
        return Choice()
    if (free := free_memory(problem.comm)) is None:
        return Choice()
    most = MOST_SHARE_OF_FREE_MEMORY * free
    if needed is None:
        if bound <= most:
            return Choice()
        entries = size_kept(problem, solver.factor_kind).entries
        needed = memory_with(problem, entries, precision, ranks)
    needed -= own
    # the ranks differ in what they find free, and must not differ in what follows
    if not problem.comm.bcast(needed > most, root=0):
        return Choice()
    levels = in_levels(problem.unknowns, ranks).memory - own
    why = f"A direct factor needs about {_gb(needed)}, but {_gb(free)} of memory are free"
    if not obstacle and levels >= needed:
        obstacle = "it needs no less"
    if obstacle:
        return Choice(
            told=f"{why}, so that it may not fit.  Multigrid is not taken, because {obstacle}."
        )
    fits = "" if levels <= most else ", which may not fit either"
    return Choice(True, (
        f"{why}, so that multigrid is taken, with about {_gb(levels)}{fits}.  "
        f'NewtonOptions(factor="{solver.factor_kind}") keeps the factor.'
    ))  # fmt: skip


def _obstacle(problem: Problem, asked: Demands) -> str:
    """Why multigrid is not to be taken, in words; empty if it may be."""
    if asked.stability == "every":
        return 'stability="every" counts negative eigenvalues'
    if any(isinstance(item, Trace) for item in asked.path):
        return "a trace counts negative eigenvalues"
    if any(isinstance(item, March) and item.moving for item in asked.path):
        return "it cannot solve for a motion with inertia"
    if any(isinstance(item, Ramp) and item.loss != "end" for item in asked.path):
        return "a ramp that goes on at a limit point counts negative eigenvalues"
    if asked.estimates:
        return "an estimate of errors makes a factor all the same"
    if lacks := missing(problem):
        return f"it needs {lacks}"
    return "cells are too slender for it" if caution(problem) else ""


def free_memory(comm: MPI.Comm) -> float | None:
    """Bytes of free memory on all nodes of the ranks; None if it is unknown.  Collective."""
    found = free_bytes()
    mine = np.inf if found is None else found
    if comm.size > 1:
        node = comm.Split_type(MPI.COMM_TYPE_SHARED)
        least = node.allreduce(mine, op=MPI.MIN)
        mine = comm.allreduce(least if node.rank == 0 else 0.0, op=MPI.SUM)
        node.Free()
    return None if np.isinf(mine) else float(mine)


def _gb(count: float) -> str:
    """Bytes in words."""
    return f"{count / 1e9:.2g} GB"
