"""The error that ends a path which cannot be followed any further, and its words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.path.crushing import NEARBY_IN_STEPS, Crush
from dea_fenicsx.path.predictor import Predictor
from dea_fenicsx.path.stability import path_slope
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.outcome import Attempt, Outcome
from dea_fenicsx.support.errors import (
    EquilibriumLost,
    NotReached,
    PathError,
    SolverError,
    StabilityLost,
)

LIMIT_SPEED_RATIO = 3.0
"""Speed at the last state, over the mean speed from an earlier state, that shows a limit point.

Towards a limit point the speed (displacement per load) grows like an inverse square root.  A ramp
ends when its steps have been halved to a thousandth of the first one.  So close to a limit point
the speed is more than ten times the mean speed.
"""

LIMIT_SPEED_RATIO_NEARBY = 1.1
"""The same ratio for an earlier state that is at most `NEARBY_IN_STEPS` of the last trial away.

Over such a short way the speed of a smooth path changes by a thousandth.  If a limit point lies
ahead at the same distance, the ratio is 1.2.
"""

INCONCLUSIVE_OUTCOMES = (Outcome.SLOW, Outcome.DIVERGED, Outcome.JUMPED)
"""Outcomes of the last trial that may mean a lost equilibrium or a failure of Newton's method.

The other outcomes, a chain beyond its lock-up and an inverted cell, are limits of the material.
"""


def is_near_limit(predictor: Predictor, origin: State, failed: Mapping[str, float]) -> bool:
    """Whether the last accepted state shows a limit point ahead.  Collective.

    Parameters
    ----------
    predictor
        Holds the last accepted states.
    origin
        The state at the start of the ramp.
    failed
        Factors of the last trial.

    Returns
    -------
    bool
        True if the speed (displacement per load) at the last state is much larger than the mean
        speed on the way there (see `LIMIT_SPEED_RATIO` and `LIMIT_SPEED_RATIO_NEARBY`).  Only a
        limit point explains that.  True as well if the tangent of the path cannot be computed.
    """
    problem, last = predictor.problem, predictor.known[-1]
    now = last.factors[predictor.name]
    step = failed[predictor.name] - now
    rates = {name: (failed[name] - factor) / step for name, factor in last.factors.items()}
    slope = path_slope(predictor.solver, last, rates)
    if slope is None:
        return True
    mine = float(np.max(np.abs(slope[problem.roles.free(Role.MOTION)]), initial=0.0))
    speed = problem.comm.allreduce(mine, op=MPI.MAX)
    zero = dict.fromkeys(last.factors, 0.0)
    rest = last.with_factors(zero).with_values(np.zeros_like(last.values))
    for earlier in (origin, *predictor.known[:-1], rest):
        way = abs(now - earlier.factors[predictor.name])
        if way == 0:
            continue
        short = earlier is not rest and way <= NEARBY_IN_STEPS * abs(step)
        mean = predictor.moved(earlier, last) / way
        if speed > (LIMIT_SPEED_RATIO_NEARBY if short else LIMIT_SPEED_RATIO) * mean > 0:
            return True
    return False


def ramp_lost(
    names: Sequence[str],
    label: str,
    reached: Factors,
    failed: Factors,
    attempt: Attempt,
    near_limit: bool,
    crush: Crush | None = None,
) -> PathError:
    """The error that ends a ramp that cannot be followed any further.

    Parameters
    ----------
    names, label
        The ramps that move, and their common label in messages.
    reached, failed
        Factors of the last accepted state and of the last trial.
    attempt
        The last trial.
    near_limit
        Whether the last accepted state shows a limit point ahead.
    crush
        What is pressed to zero thickness.  Then the last trial tells nothing, for it depends on the
        last step how Newton's method fails.
    """
    low, high, last = reached.told(names), failed.told(names), attempt.outcome.value
    if crush is not None:
        error = EquilibriumLost(
            f"Equilibrium was lost between {low} and {high} of the {label} ramp: {crush.words}; "
            "all steps before it are kept."
        )
        error.reached, error.failed, error.ramps = dict(reached), dict(failed), ()
        return error
    if attempt.outcome.is_linear_failure:
        return SolverError(
            f"The linear solver failed between {low} and {high} of the {label} ramp "
            f"({last}); check supports and material constants."
        )
    if attempt.outcome is Outcome.ROUNDING:
        return SolverError(
            f"Newton's residual came to rest at {attempt.residual:.2g} between {low} and {high} of "
            f"the {label} ramp, just above its tolerance; it is rounding, so loosen "
            "NewtonOptions(tolerance=...) or use cells that are less thin."
        )
    if not near_limit and attempt.outcome in INCONCLUSIVE_OUTCOMES:
        return SolverError(
            f"No step from {low} towards {high} of the {label} ramp could be made, however short "
            f"(last trial: {last}), and the state at {low} shows no limit point ahead; this is a "
            "failure of the method and no pull-in; all steps before it are kept."
        )
    cause = "a pull-in or another limit point lies there" if near_limit else (
        "the state before shows no limit point, so that an end of the material's range lies there"
    )
    error = EquilibriumLost(
        f"Equilibrium was lost between {low} and {high} of the {label} ramp "
        f"(last trial: {last}); {cause}, and all steps before it are kept."
        f"{_advice(names) if near_limit else ''}"
    )
    error.reached, error.failed, error.ramps = dict(reached), dict(failed), tuple(names)
    return error


def _advice(names: Sequence[str]) -> str:
    """What to do about a ramp that has come to a limit point."""
    trace = f'dea.Trace("{names[0]}")' if len(names) == 1 else "dea.Trace of one of its ramps"
    return (
        f"  Follow the branch with {trace}, or let the device snap with Ramp(snap=True) or "
        'Ramp(at_loss="motion").'
    )


def stability_lost(names: Sequence[str], label: str, reached: Factors) -> StabilityLost:
    """The error that ends a ramp where its branch becomes unstable.

    Parameters
    ----------
    names, label, reached
        As of `ramp_lost`.
    """
    error = StabilityLost(
        f"Stability was lost at {reached.told(names)} of the {label} ramp: the branch goes on, but "
        "no device rests on it from there on; all steps before are kept.  A dea.Trace with "
        'switch= follows what leaves there, and at_loss="end" the unstable branch.'
    )
    error.reached, error.failed, error.ramps = dict(reached), dict(reached), ()
    return error


def never_at_rest(lost: Callable[[], PathError], trouble: str) -> PathError:
    """The error that ends a ramp whose body goes on in motion and does not come to rest.

    Parameters
    ----------
    lost
        Makes the error of the ramp itself.
    trouble
        How the motion ended, in words.
    """
    error = lost()
    told = str(error).split("  To see how")[0]
    error.args = (f"{told}  From there the body moved on, but it has not come to rest: {trouble}",)
    return error


def trace_lost(what: str, factors: Factors, outcome: Outcome) -> PathError:
    """The error that ends a trace whose steps have become too short."""
    place = factors.told((what,))
    if outcome.is_linear_failure:
        return SolverError(
            f"The linear solver failed at {place} of the {what} trace ({outcome.value}); check "
            "supports and material constants."
        )
    error = EquilibriumLost(
        f"The branch could not be followed beyond {place} of the {what} trace, however short the "
        f"arc (last trial: {outcome.value}); all steps before it are kept."
    )
    error.reached, error.failed, error.ramps = dict(factors), dict(factors), ()
    return error


def trace_turned(what: str, factors: Factors, begin: float, tried: bool) -> PathError:
    """The error that ends a trace where its branch turns aside.

    Parameters
    ----------
    what
        The ramp of the trace.
    factors
        Where the trace has come to.
    begin
        The factor of the ramp at which the turn begins.
    tried
        Whether no way straight on was found.
    """
    other = (
        "no way straight on was found; take a finer mesh or longer steps" if tried
        else 'at_turn="pass" goes straight on, "follow" follows the turn'
    )  # fmt: skip
    start, now = ((factors | {what: f}).told((what,)) for f in (begin, factors[what]))
    error = EquilibriumLost(
        f"The branch of the {what} trace turns aside between {start} and {now}, because another "
        "branch almost crosses it: the structure or the mesh is not quite symmetric; "
        f"{other}."
    )
    error.reached, error.failed, error.ramps = dict(factors), dict(factors), ()
    return error


def trace_short(what: str, column: str, value: float, gap: float, steps: int) -> NotReached:
    """The error that ends a trace whose steps were used up before its end.

    Parameters
    ----------
    what
        The ramp of the trace.
    column, value
        The column of the history and the value at which the trace was to end.
    gap
        The column's last value less that value.
    steps
        The number of steps that the trace was given.
    """
    return NotReached(
        f"The trace in {what} used up its {steps} steps at {column} = {value + gap:.6g}, before "
        f"{column} = {value:.6g}; give it more steps, or a longer first one."
    )


def march_lost(
    scene: Scene, state: State, seconds: float, driven: Sequence[str]
) -> EquilibriumLost:
    """The error that ends a march at a time beyond which there is no equilibrium.

    Parameters
    ----------
    scene, state
        The scene, and the state at that time.
    seconds
        The time since the beginning of the march.
    driven
        The ramps that the march drives.
    """
    names = [name for name, factor in state.factors.items() if factor or name in driven]
    at = f" at {state.factors.told(names)}" if names else ""
    electric = any(scene.is_electric(name) and state.factors[name] for name in names)
    error = EquilibriumLost(
        f"Equilibrium was lost {seconds:.9g} s after the beginning of the march{at}: "
        f"{'a pull-in' if electric else 'a limit point'} in time.  The state there is the last one "
        "that is kept."
    )
    error.reached = error.failed = dict(state.factors)
    error.ramps = tuple(names)
    return error


def march_stuck(now: float, seconds: float, attempt: Attempt) -> PathError:
    """The error that ends a march whose steps have become too short."""
    if attempt.outcome.is_linear_failure:
        return SolverError(
            f"The linear solver failed {now:.9g} s after the beginning of the march "
            f"({attempt.outcome.value}); check supports and material constants."
        )
    return SolverError(
        f"No step from {now:.9g} s of the march could be made, however short (last trial: "
        f"{seconds:.3g} s, {attempt.outcome.value}), and no limit point was found ahead; this is "
        "a failure of the method and no pull-in; all steps before it are kept."
    )


def march_too_exact(now: float, tolerance: float, error: float) -> SolverError:
    """The error that ends a march whose tolerance is below what rounding leaves."""
    return SolverError(
        f"The estimated error of a step at {now:.9g} s of the march stays at {error:.2g}, above "
        f"its tolerance {tolerance:g}, however short the step; give March a larger tolerance, or a "
        "smaller NewtonOptions(tolerance=...)."
    )
