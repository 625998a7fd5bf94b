"""NSGA-II over any evaluator: pymoo makes the designs, the caller evaluates them.

Rank 0 alone runs the genetic algorithm and sends each generation to the others, so that all ranks
see the same designs whatever their machine's rounding.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict, Unpack

import numpy as np
from mpi4py import MPI

from dea_fenicsx.design.front import Front, first_front
from dea_fenicsx.design.variables import Limit, Range, signs, violations
from dea_fenicsx.support.errors import InputError, install_hook
from dea_fenicsx.support.validation import keywords, whole

Columns = dict[str, np.ndarray]
Evaluate = Callable[[np.ndarray], Columns]

PENALTY_OBJECTIVE = 1e12
"""Value of the objectives of a design that could not be evaluated; it is also infeasible."""


def require_pymoo() -> None:
    """Raise InputError, on every rank, where pymoo is missing."""
    try:
        import pymoo.algorithms.moo.nsga2  # noqa: F401
    except ImportError as error:
        raise InputError(
            'The design search needs pymoo, which is missing here; pip install "pymoo>=0.6.1".'
        ) from error


class _Needed(TypedDict):
    """The keywords of the genetic algorithm that cannot be left out."""

    population: int
    generations: int
    seed: int


class EvolutionOptions(_Needed, total=False):
    """Keywords of the genetic algorithm.

    Attributes
    ----------
    population, generations, seed
        Of NSGA-II, whole numbers of at least 4, 1 and 0.  The same seed gives the same front.
    start
        Designs for the first generation; each must satisfy the bounds.
    """

    start: Sequence[Mapping[str, float]]


def evolve(
    evaluate: Evaluate,
    variables: Mapping[str, Range],
    objectives: Mapping[str, str],
    bounds: Mapping[str, Limit],
    *,
    comm: Any = MPI.COMM_SELF,
    say: Callable[[str], None] = lambda line: None,
    **options: Unpack[EvolutionOptions],
) -> Front:
    """Search for the front.  Collective on `comm`.

    Parameters
    ----------
    evaluate
        Designs of shape (n, variables) to all their quantities by name, each of shape (n,), the
        same on all ranks; NaN where a design has failed.
    variables, objectives, bounds
        See `ranges`, `goals` and `limits`.
    comm
        Its rank 0 runs the algorithm.
    say
        Is told a line for each generation.
    options
        See `EvolutionOptions`.

    Raises
    ------
    InputError
        For a start outside the ranges or the bounds, and if no design satisfies the bounds.
    """
    install_hook()
    chosen = keywords("evolve", options, EvolutionOptions, {"start": ()})
    require_pymoo()
    population, generations, seed = (
        chosen[name] for name in ("population", "generations", "seed")
    )
    for name, value, least in (("population", population, 4), ("generations", generations, 1),
                               ("seed", seed, 0)):  # fmt: skip
        whole(value, f"The {name}", least)
    begun = time.perf_counter()
    names = list(variables)
    low, high = np.array(list(variables.values())).T
    first = _start(chosen["start"], names, low, high, population)
    herd = _Herd(low, high, len(objectives), population, seed, first) if comm.rank == 0 else None
    tally = _Tally(objectives, bounds)
    for generation in range(1, generations + 1):
        X = comm.bcast(herd.ask() if herd else None, root=0)
        if not len(X):
            break  # no new design is to be found
        columns = {name: X[:, i] for i, name in enumerate(names)} | evaluate(X)
        F, G = tally.add(columns, len(first) if generation == 1 else 0)
        if herd:
            told = [np.where(np.isfinite(A), A, PENALTY_OBJECTIVE) for A in (F, G)]
            herd.tell(*told)
        say(f"generation {generation:3d} of {generations}: {tally}")
    return tally.front(names, time.perf_counter() - begun)


@dataclass
class _Tally:
    """What a search has found so far.

    Attributes
    ----------
    objectives, bounds : see `goals` and `limits`
    kept : columns of the designs in the front
    tried, failed, feasible : numbers of designs
    nearest : the smallest violation of each bound
    """

    objectives: Mapping[str, str]
    bounds: Mapping[str, Limit]
    kept: Columns = field(default_factory=dict)
    tried: int = 0
    failed: int = 0
    feasible: int = 0
    nearest: dict[str, float] = field(default_factory=dict)

    def add(self, columns: Columns, given: int) -> tuple[np.ndarray, np.ndarray]:
        """Judge a generation and keep its best; its objectives and constraints, as in `_judge`.

        The first `given` designs are the user's own, which must be feasible.
        """
        F, G, missed = _judge(columns, self.objectives, self.bounds)
        good = np.isfinite(F).all(axis=1) & np.all(G <= 0, axis=1)
        _check_start(given, good, missed, F)
        self.tried += len(F)
        self.failed += int(np.isnan(F).any(axis=1).sum())
        self.feasible += int(good.sum())
        for what, miss in missed.items():
            least = float(np.nanmin(miss, initial=np.inf))
            self.nearest[what] = min(self.nearest.get(what, np.inf), least)
        if good.any():
            new = {name: np.asarray(values, dtype=float)[good] for name, values in columns.items()}
            if self.kept:
                new = {name: np.concatenate([self.kept[name], v]) for name, v in new.items()}
            best = first_front(_minimised(new, self.objectives))
            self.kept = {name: values[best] for name, values in new.items()}
        return F, G

    def __str__(self) -> str:
        size = len(next(iter(self.kept.values()))) if self.kept else 0
        return (f"{self.tried} designs, {self.feasible} feasible, {self.failed} failed, "
                f"front of {size}")  # fmt: skip

    def front(self, names: Sequence[str], seconds: float) -> Front:
        """The front, in the order of its first objective.

        Raises
        ------
        InputError
            If there is no feasible design.
        """
        if not self.kept:
            raise InputError(_nothing(self.tried, self.failed, self.nearest))
        first = next(iter(_minimised(self.kept, self.objectives).T))
        order = np.argsort(first, kind="stable")
        columns = {name: values[order] for name, values in self.kept.items()}
        return Front(tuple(names), dict(self.objectives), columns, self.tried, self.failed, {},
                     seconds)  # fmt: skip


def _minimised(columns: Mapping[str, np.ndarray], objectives: Mapping[str, str]) -> np.ndarray:
    pairs = zip(objectives, signs(objectives), strict=True)
    return np.column_stack([sign * np.asarray(columns[name], float) for name, sign in pairs])


def _judge(
    columns: Mapping[str, np.ndarray], objectives: Mapping[str, str], bounds: Mapping[str, Limit]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Objectives to minimise, constraints (<= 0), and the violation of each bound by name."""
    F = _minimised(columns, objectives)
    missed = violations(bounds, columns)
    lost = np.isnan(F).any(axis=1)
    for size in missed.values():
        lost |= np.isnan(size)
    F[lost] = np.nan
    return F, np.column_stack([*missed.values(), np.where(lost, PENALTY_OBJECTIVE, 0.0)]), missed


def _start(
    start: Sequence[Mapping[str, float]],
    names: list[str],
    low: np.ndarray,
    high: np.ndarray,
    population: int,
) -> np.ndarray:
    """The starting designs as an array, checked against the ranges."""
    start = [start] if isinstance(start, Mapping) else list(start)
    if len(start) > population:
        raise InputError(
            f"There are {len(start)} starting designs for a population of {population}; enlarge "
            "the population."
        )
    found = np.empty((len(start), len(names)))
    for i, design in enumerate(start):
        for j, name in enumerate(names):
            if name not in design:
                raise InputError(f"Starting design {i + 1} gives no value of {name!r}.")
            found[i, j] = design[name]
            if not low[j] <= found[i, j] <= high[j]:
                raise InputError(
                    f"Starting design {i + 1} has {name} = {found[i, j]:g}, outside its range "
                    f"{low[j]:g} to {high[j]:g}."
                )
    return found


def _check_start(
    count: int, good: np.ndarray, missed: Mapping[str, np.ndarray], F: np.ndarray
) -> None:
    for i in range(count):
        if good[i]:
            continue
        broken = [what for what, size in missed.items() if size[i] > 0]
        if broken:
            raise InputError(f"Starting design {i + 1} is infeasible: it violates {broken[0]}.")
        raise InputError(f"Starting design {i + 1} is infeasible: it could not be evaluated.")


def _nothing(tried: int, failed: int, nearest: Mapping[str, float]) -> str:
    """Why a search has found nothing."""
    if failed == tried:
        return f"None of the {tried} designs could be evaluated; look at the reasons in the log."
    never = {what: size for what, size in nearest.items() if size > 0}
    if never:
        what = max(never, key=lambda w: never[w])
        return (
            f"None of the {tried} designs satisfies {what} (the nearest misses it by "
            f"{100 * never[what]:.3g} %); relax it or widen the ranges."
        )
    return (
        f"None of the {tried} designs satisfies all constraints at once, though each is satisfied "
        f"by some; relax one of: {', '.join(nearest)}."
    )


class _Herd:
    """pymoo's NSGA-II, asked for designs and told what they are worth.

    It sees every variable on the range 0 to 1.  One constraint tells it how far a design is from
    feasible: the sum of the relative violations.
    """

    def __init__(
        self,
        low: np.ndarray,
        high: np.ndarray,
        objectives: int,
        population: int,
        seed: int,
        first: np.ndarray,
    ) -> None:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.termination.max_gen import MaximumGenerationTermination
        from scipy.stats.qmc import LatinHypercube

        self.low, self.high = low, high
        self.problem = Problem(n_var=len(low), n_obj=objectives, n_ieq_constr=1, xl=0.0, xu=1.0)
        sample = LatinHypercube(len(low), rng=seed).random(population)
        sample[: len(first)] = (first - low) / (high - low)
        self.algorithm = NSGA2(pop_size=population, sampling=sample)
        never = MaximumGenerationTermination(10**9)  # the caller counts the generations
        self.algorithm.setup(self.problem, termination=never, seed=seed, verbose=False)

    def ask(self) -> np.ndarray:
        self.asked = self.algorithm.ask()
        if self.asked is None:
            return np.empty((0, len(self.low)))
        unit = np.asarray(self.asked.get("X"), dtype=float)
        return np.clip(self.low + unit * (self.high - self.low), self.low, self.high)

    def tell(self, F: np.ndarray, G: np.ndarray) -> None:
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        total = np.maximum(G, 0).sum(axis=1, keepdims=True)
        Evaluator().eval(StaticProblem(self.problem, F=F, G=total), self.asked)
        self.algorithm.tell(infills=self.asked)
