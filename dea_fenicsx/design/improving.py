"""Optimisation with gradients: a scene, its sizes, and what is to become as large as possible.

SciPy's SLSQP, a sequence of quadratic problems, asks for values and derivatives at few designs.
Each design is solved once, and the derivatives cost a few triangular solves.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict, Unpack

from mpi4py import MPI

from dea_fenicsx.design.descent import METHODS, MMA, SLSQP, Descent, Sample, mma_library
from dea_fenicsx.design.kept_designs import KeptDesigns
from dea_fenicsx.design.variables import check_resumable, goals, limits, one_of, ranges
from dea_fenicsx.design.variations import Build, Variation, variation
from dea_fenicsx.gradients.critical import limit_row
from dea_fenicsx.path.items import Item, Ramp, Trace
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.identity import described
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import DeaError, InputError, Interrupted, MachineError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import finite, keywords, positive, whole

PULL_IN = "pull-in"
"""The name of the load at the limit point of an analysis that ends with a trace."""

PULL_IN_MARGIN = "pull-in margin"
"""The name of this load over what the scene gives at factor 1, such as the voltage in use."""


@dataclass(frozen=True)
class Analysis:
    """One run of a scene, and what is taken from it.

    Attributes
    ----------
    record
        Observables by name, measured at the last step of a ramp.
    path
        The path.  With a `Trace` at its end the analysis gives ``"pull-in"``, the load at the
        first limit point in V, and ``"pull-in margin"``, this load over that at factor 1, which is
        the design's own voltage.  Its record only serves the trace.
    solve
        Keywords of `solve`.
    """

    record: Mapping[str, Any]
    path: Item | Sequence[Item] = field(default_factory=Ramp)
    solve: Mapping[str, Any] = field(default_factory=dict)

    @property
    def items(self) -> list[Item]:
        return list(self.path) if isinstance(self.path, Sequence) else [self.path]

    @property
    def traced(self) -> str:
        """The ramp of the trace at the end, or an empty name."""
        last = self.items[-1]
        return last.what if isinstance(last, Trace) else ""

    @property
    def names(self) -> list[str]:
        """What it gives."""
        return [PULL_IN, PULL_IN_MARGIN] if self.traced else list(self.record)


class ImproveOptions(TypedDict, total=False):
    """Keywords of `improve`.

    Attributes
    ----------
    most
        Most designs that are solved.
    tolerance
        The search ends where the objective changes by less than this share of its first size.
    method
        ``"SLSQP"`` of SciPy, a sequence of quadratic problems, or ``"MMA"``, the method of moving
        asymptotes of NLopt (``pip install nlopt``), for some hundred variables and more.
    comm
        The ranks that share each run.
    quiet
        Print nothing.
    """

    most: int
    tolerance: float
    method: str
    comm: Any
    quiet: bool


@dataclass(frozen=True)
class Improved:
    """What a search with gradients has found.

    Attributes
    ----------
    design
        The best design that satisfies the constraints; the start if none does.
    quantities, before
        What was asked for, at this design and at the start.
    evaluations
        Designs that were solved, also those that an earlier search had solved.
    solved
        Those that this call has solved.
    converged
        Whether the search has ended by itself at an optimum.
    feasible
        Whether the design satisfies the constraints.
    message
        How the search ended, in words.
    history
        All designs with their quantities, in the order in which they were asked for.
    """

    design: Mapping[str, float]
    quantities: Mapping[str, float]
    before: Mapping[str, float]
    evaluations: int
    solved: int
    converged: bool
    feasible: bool
    message: str
    history: Sequence[Mapping[str, float]]


def improve(
    build: Build,
    variables: Mapping[str, Any],
    objective: Mapping[str, str],
    analyses: Analysis | Sequence[Analysis],
    constraints: Mapping[str, Any] | None = None,
    out: str | os.PathLike | None = None,
    resume: bool = False,
    **options: Unpack[ImproveOptions],
) -> Improved:
    """Improve a design by gradients.  Collective.

    Parameters
    ----------
    build
        Called as ``build(comm, thickness=..., edge=...)`` with the values of a design; returns the
        scene on the ranks of `comm`.  With the variables there may change constants of materials,
        voltages, pre-stretches, and the positions of the mesh's nodes, whose number must stay.
    variables
        Name to (lower, upper, start), or (lower, upper) to start from the middle; or to a fixed
        number.
    objective
        Name of one quantity to ``"min"`` or ``"max"``.
    analyses
        The runs that give the quantities, see `Analysis`.
    constraints
        Name of a quantity to (lower, upper), None for an open end.
    out
        Folder in which each design is kept as soon as it is solved.
    resume
        Take from `out` what a search that was killed has solved, and go on from there.
    options
        ``most`` (50), ``tolerance`` (1e-9), ``method`` (``"SLSQP"``), ``comm`` (all ranks) and
        ``quiet`` (False); see `ImproveOptions`.

    Returns
    -------
    Improved
        The same on every rank.

    Raises
    ------
    InputError
        For wrong input, a quantity without a derivative, and if the start cannot be solved.
    """
    chosen = checked_options("improve", options)
    if not callable(build):
        raise InputError(f"build is {shown(build)}, but must be a function that returns a scene.")
    free, fixed, start = _given(variables)
    runs = listed(analyses)
    wanted, bounds = goals(objective), limits(constraints or {})
    check_quantities(runs, wanted, bounds)
    check_resumable(resume, out)
    facts = {
        "function": getattr(build, "__qualname__", type(build).__name__),
        "variables": {**free, **fixed},
        "analyses": [[described(item) for item in run.items] for run in runs],
        "quantities": [*wanted, *bounds],
    }
    comm = chosen["comm"]
    kept = KeptDesigns(out, list(free), facts, resume, comm)
    try:
        sampler = _Sampler(build, runs, [*wanted, *bounds], free, fixed, comm)
        descent = Descent(sampler, kept, free, wanted, bounds, chosen)
        found = descent.run(start)
    finally:
        kept.close()
    return Improved(**found)


def checked_options(what: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a search by gradients with their defaults.

    Raises
    ------
    InputError
        For a wrong one, and for MMA without NLopt.
    """
    chosen = keywords(what, options, ImproveOptions, {
        "most": 50, "tolerance": 1e-9, "method": SLSQP, "comm": MPI.COMM_WORLD, "quiet": False,
    })  # fmt: skip
    whole(chosen["most"], "most", 1)
    positive(chosen["tolerance"], f"The tolerance of {what}", "a number > 0")
    if one_of(chosen["method"], METHODS, "method") == MMA:
        mma_library()
    return dict(chosen)


def _given(
    variables: Mapping[str, Any],
) -> tuple[dict[str, tuple[float, float]], dict[str, float], dict[str, float]]:
    """Ranges, fixed values and the start, checked."""
    starts, pairs = {}, {}
    for name, value in variables.items():
        if isinstance(value, tuple | list) and len(value) == 3:
            pairs[name], starts[name] = tuple(value[:2]), value[2]
        else:
            pairs[name] = value
    free, fixed = ranges(pairs)
    start = {}
    for name, (low, high) in free.items():
        at = starts.get(name, (low + high) / 2)
        finite(at, f"The start of {name!r}")
        if not low <= at <= high:
            raise InputError(
                f"The start of {name!r} is {at:g}, but must lie in its range {low:g} to {high:g}."
            )
        start[name] = float(at)
    return free, fixed, start


def listed(analyses: Analysis | Sequence[Analysis]) -> list[Analysis]:
    """The analyses of a search, of which one may stand alone."""
    return [analyses] if isinstance(analyses, Analysis) else list(analyses)


def check_quantities(
    runs: Sequence[Analysis], wanted: Mapping[str, str], bounds: Mapping[str, Any],
    others: Sequence[str] = (),
) -> None:  # fmt: skip
    """Raise InputError for a quantity that no analysis gives, or that two give."""
    if len(wanted) != 1:
        raise InputError(
            f"There are {len(wanted)} objectives, but gradients lead to one optimum; name one "
            "objective and bound the others, or take dea.design.optimise for a front."
        )
    names = [*others, *(name for run in runs for name in run.names)]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"Two analyses give {twice[0]!r}; give one of them another name.")
    for name in (*wanted, *bounds):
        one_of(name, names, "quantity")


class _Sampler:
    """Solves a design, and derives what is asked for by each variable."""

    def __init__(
        self, build: Build, runs: Sequence[Analysis], names: Sequence[str],
        free: Mapping[str, tuple[float, float]], fixed: Mapping[str, float], comm: Any,
    ) -> None:  # fmt: skip
        self.build, self.runs, self.names = build, runs, list(dict.fromkeys(names))
        self.free, self.fixed, self.comm = free, fixed, comm

    def __call__(self, design: Mapping[str, float]) -> Sample:
        """The quantities of a design and their derivatives, or why there are none.  Collective."""
        whole_design = {**design, **self.fixed}
        values: dict[str, float] = {}
        slopes: dict[str, dict[str, float]] = {}
        try:
            scene = self.build(self.comm, **whole_design)
            if not isinstance(scene, Scene):
                raise InputError(f"build returned {shown(scene)}, but must return a Scene.")
            solved = [self._solved(scene, one) for one in self.runs]
            for one, run in zip(self.runs, solved, strict=True):
                if one.traced:
                    limit_row(run.history, -1)  # which refuses a trace without a limit point
        except (Interrupted, MachineError):
            raise
        except DeaError as error:
            return Sample({}, {}, f"{type(error).__name__}: {error}")
        changes = {
            name: variation(
                self.build, solved[0].problem, whole_design, name, bounds, self.comm
            )
            for name, bounds in self.free.items()
        }
        for one, run in zip(self.runs, solved, strict=True):
            to: dict[str, Any] = {}
            for change in changes.values():
                to |= {v if isinstance(v, str) else v.name: v
                       for v in change.variables(one.traced)}  # fmt: skip
            for name in one.names:
                if name in self.names:
                    values[name], slopes[name] = _quantity(run, one, name, to, changes)
        return Sample(*self.comm.bcast((values, slopes), root=0))

    def _solved(self, scene: Scene, one: Analysis) -> Run:
        return solve(scene, one.items, one.record, **{"quiet": True, **one.solve})


def _quantity(
    run: Run, one: Analysis, name: str, to: Mapping[str, Any], changes: Mapping[str, Variation]
) -> tuple[float, dict[str, float]]:
    """A quantity of a run, and its derivatives by the variables of the design.  Collective."""
    ramp, factors = one.traced, run.problem.factors
    volts = run.problem.scene.unit_volts.get(ramp, 0.0)
    slopes: Mapping[str, float] = {}
    if to:
        found = run.sensitivity(PULL_IN if ramp else name, list(to.values()))
        value, slopes = found.value, found.derivatives
    elif ramp:
        row = run.history[limit_row(run.history, -1)]
        value = float(row[f"{ramp}_V" if volts else f"{ramp}_factor"])
    else:
        value = float(run[name])
    by = {v: change.total(slopes, factors) for v, change in changes.items()}
    if name == PULL_IN_MARGIN:
        unit = volts or 1.0
        value /= unit  # the load at factor 1 may be a variable itself
        by = {v: (by[v] - value * changes[v].volts.get(ramp, 0.0)) / unit for v in by}
    return value, by
