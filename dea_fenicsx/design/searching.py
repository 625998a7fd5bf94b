"""The two searches: on the analytic helical actuator, and on any Python function."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from mpi4py import MPI

from dea_fenicsx.design.evaluation import Evaluator
from dea_fenicsx.design.evolution import Columns, evolve, require_pymoo
from dea_fenicsx.design.front import Front
from dea_fenicsx.design.helical import (
    ENVELOPE,
    OBJECTIVES,
    HelicalModel,
    material_of,
)
from dea_fenicsx.design.variables import Range, check_resumable, goals, limits, one_of, ranges
from dea_fenicsx.materials import Material
from dea_fenicsx.support.errors import DeaError, InputError
from dea_fenicsx.support.validation import keywords


class SearchOptions(TypedDict, total=False):
    """Keywords of `search`: those of the genetic algorithm, see `EvolutionOptions`, and one more.

    Attributes
    ----------
    quiet
        Whether to print nothing; else a line for each tenth of the generations, from rank 0.
    """

    population: int
    generations: int
    seed: int
    start: Sequence[Mapping[str, float]]
    quiet: bool


class OptimiseOptions(SearchOptions, total=False):
    """Keywords of `optimise` beside those of `search`.

    Attributes
    ----------
    comm
        The communicator whose ranks share the work.
    failures
        Exceptions that make a design infeasible; they are logged.  Others end the search.
    """

    comm: Any
    failures: tuple[type[Exception], ...]


def search(
    material: Material | str,
    envelope: Mapping[str, Any] | None = None,
    objectives: Sequence[str] = ("voltage", "strain"),
    constraints: Mapping[str, float] | None = None,
    *,
    electrode: float = 50e-6,
    inset: float = 0.0,
    turns: int = 1,
    **options: Unpack[SearchOptions],
) -> Front:
    """Search the analytic helical actuator for the best designs (thesis 4.4.3 to 4.4.5).

    Parameters
    ----------
    material
        A material or the name of a preset.
    envelope
        Ranges, or single numbers, that replace those of `ENVELOPE`.  With a single pitch angle the
        thickness follows from it and the outer radius, and its range becomes a constraint.
    objectives
        Names out of `OBJECTIVES`.
    constraints
        Names out of `CONSTRAINTS`, each with its number.
    electrode, inset, turns
        See `HelicalModel`.
    options
        ``population``, ``generations`` (100 each) and ``seed`` (1) of NSGA-II, ``start``, designs
        that the first generation is to contain, and ``quiet`` (True); see `SearchOptions`.

    Returns
    -------
    Front

    Raises
    ------
    InputError
        For wrong input, and if no design satisfies the constraints.
    """
    chosen = keywords(
        "search", options, SearchOptions,
        {"population": 100, "generations": 100, "seed": 1, "start": (), "quiet": True},
    )  # fmt: skip
    quiet = chosen.pop("quiet")
    require_pymoo()
    model = HelicalModel(material_of(material), electrode, inset, turns)
    free, fixed = _within(envelope or {})
    wanted = {}
    for name in [objectives] if isinstance(objectives, str) else objectives:
        name = one_of(name, OBJECTIVES, "objective")
        wanted[name] = OBJECTIVES[name]
    goals(wanted)
    # The pitch angle follows from the thickness, or, where the angle is fixed, the other way round.
    angle = fixed.pop("pitch_angle_deg", None)
    bounds = model.bounds(constraints or {}, free.pop("pitch_angle_deg", None))
    if angle is not None:
        low, high = free.pop("elastomer") if "elastomer" in free else (fixed.pop("elastomer"),) * 2
        printable, _ = bounds.get("elastomer", (None, None))
        bounds["elastomer"] = (max(low, printable or 0.0), high)
    if not free:
        raise InputError("All variables are fixed; give at least one a range (lower, upper).")

    def evaluate(X: np.ndarray) -> Columns:
        design = {name: np.full(len(X), value) for name, value in fixed.items()}
        design |= {name: X[:, i] for i, name in enumerate(free)}
        if angle is not None:
            design["elastomer"] = model.thickness_at(design["outer_radius"], angle)
        return design | model(**design)

    generations = chosen["generations"]
    every = max(generations // 10, 1) if isinstance(generations, int) else 1
    say = _Progress(MPI.COMM_WORLD, quiet, every)
    return evolve(evaluate, free, wanted, bounds, say=say, **chosen)


def _within(envelope: Mapping[str, Any]) -> tuple[dict[str, Range], dict[str, float]]:
    """Ranges and fixed values of the helical actuator's variables, checked."""
    given = dict(ENVELOPE)
    for name, value in envelope.items():
        given[one_of(name, ENVELOPE, "design variable")] = value
    free, fixed = ranges(given)
    _positive({**{n: low for n, (low, _) in free.items()}, **fixed}, free)
    return free, fixed


def _positive(lowest: Mapping[str, float], free: Mapping[str, Any]) -> None:
    for name, value in lowest.items():
        if value <= 0:
            raise InputError(f"The range of {name!r} begins at {value:g}, but must be above 0.")
    high = free["contraction"][1] if "contraction" in free else lowest["contraction"]
    if high >= 1:
        raise InputError(f"The contraction reaches {high:g}, but must stay below 1.")


def optimise(
    function: Callable[..., Mapping[str, float]],
    variables: Mapping[str, Any],
    objectives: Mapping[str, str],
    constraints: Mapping[str, Any] | None = None,
    *,
    out: str | os.PathLike | None = None,
    resume: bool = False,
    settings: Mapping[str, Any] | None = None,
    **options: Unpack[OptimiseOptions],
) -> Front:
    """Search with any Python function as the evaluator, finite elements included.

    Each rank evaluates its share of a generation, alone: the function must build its device on
    ``MPI.COMM_SELF``.  So no design waits for another within a generation, every rank
    computes (an executor would spare one to hand out work), nothing need be pickled, and a design
    has the same result on any number of ranks.

    Parameters
    ----------
    function
        Called with each variable by name; returns quantities by name (numbers in SI units).
    variables
        Name to range (lower, upper), or to a fixed number.
    objectives
        Name of a quantity to ``"min"`` or ``"max"``.
    constraints
        Name of a quantity to (lower, upper), None for an open end.
    out
        Folder for the designs evaluated, each on disk as soon as it is known.
    resume
        Take from `out` what an earlier search has evaluated; else its files move to ``previous/``.
    settings
        What else the function depends on; a search with other settings is not resumed.
    options
        ``population`` (16), ``generations`` (10), ``seed`` (1) and ``start`` as in `search`; more
        generations than an earlier search had carry it on.  ``comm``, whose ranks share the work
        (MPI.COMM_WORLD).  ``quiet``: print nothing (False).  ``failures``, exceptions that make a
        design infeasible (`DeaError`).  See `OptimiseOptions`.

    Returns
    -------
    Front
        The same on all ranks.

    Raises
    ------
    InputError
        For wrong input, and if no design satisfies the constraints.
    """
    chosen = keywords(
        "optimise", options, OptimiseOptions,
        {"population": 16, "generations": 10, "seed": 1, "start": (), "comm": MPI.COMM_WORLD,
         "quiet": False, "failures": (DeaError,)},
    )  # fmt: skip
    require_pymoo()
    comm, quiet, failures = chosen["comm"], chosen.pop("quiet"), chosen.pop("failures")
    free, fixed = ranges(variables)
    wanted, bounds = goals(objectives), limits(constraints or {})
    check_resumable(resume, out)
    facts = {
        "function": getattr(function, "__qualname__", type(function).__name__),
        "variables": {**free, **fixed},
        "settings": dict(settings or {}),
    }
    evaluator = Evaluator(function, list(free), fixed, out, facts, resume, failures, comm)
    evaluator.needed = [*wanted, *bounds]
    say = _Progress(comm, quiet, 1)
    try:
        if evaluator.cached:
            say(f"{evaluator.cached} designs are known from {out}")
        front = evolve(evaluator, free, wanted, bounds, say=say, **chosen)
        return evaluator.explained(front)
    finally:
        evaluator.close()


class _Progress:
    """Prints on rank 0, one line in so many, and always the first."""

    def __init__(self, comm: Any, quiet: bool, every: int) -> None:
        self.on, self.every, self.count = comm.rank == 0 and not quiet, every, 0

    def __call__(self, line: str) -> None:
        self.count += 1
        if self.on and (self.count == 1 or self.count % self.every == 0):
            print(line, flush=True)
