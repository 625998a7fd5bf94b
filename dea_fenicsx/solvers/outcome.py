"""How a nonlinear solve has ended, and the work that it took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from dea_fenicsx.model.probe import Probe
from dea_fenicsx.model.state import State


class Outcome(Enum):
    """How a solve or a step has ended; the value says it in words, for a message."""

    CONVERGED = "converged"
    DIVERGED = "Newton's residual grew"
    SLOW = "Newton did not converge within its iterations"
    INVERTED = "every trial state turned a cell inside out"
    LOCKED = "every trial state lay past a chain's lock-up"
    UNRELAXED = "every trial state had wrinkles whose width no equilibrium limits"
    FACTORISATION = "MUMPS could not factorise the tangent"
    STAGNATION = "GMRES did not converge even on a new factor"
    ROUNDING = "the residual came to rest a little above the tolerance"
    JUMPED = "the state found lies on another branch"
    OTHER_BRANCH = "on another branch"
    SHARP_TURN = "turned too sharply"
    MIXED_EVENTS = "a limit point and a bifurcation in one step"

    @property
    def is_linear_failure(self) -> bool:
        """Whether the linear solver failed, so that nothing is known of the equilibrium."""
        return self in (Outcome.FACTORISATION, Outcome.STAGNATION)


def fault_of(probe: Probe) -> Outcome:
    """What makes a state inadmissible; `Outcome.CONVERGED` if nothing does."""
    if not probe.min_J > 0:
        return Outcome.INVERTED
    if not probe.min_margin > 0:
        return Outcome.LOCKED
    return Outcome.CONVERGED if probe.min_relaxable > 0 else Outcome.UNRELAXED


@dataclass(frozen=True)
class Attempt:
    """How a nonlinear solve ended.

    Attributes
    ----------
    outcome
        `Outcome.CONVERGED`, or why it failed.
    iterations
        Newton iterations.
    residual
        Largest scaled residual of a field at the end.
    state
        The equilibrium, or None if it failed.
    """

    outcome: Outcome
    iterations: int
    residual: float
    state: State | None = None

    @property
    def converged(self) -> bool:
        return self.outcome is Outcome.CONVERGED

    @property
    def found(self) -> State:
        """The equilibrium of an attempt that has converged."""
        assert self.state is not None
        return self.state

    def refused(self, outcome: Outcome) -> Attempt:
        """The same attempt, whose state is not accepted for a reason."""
        return replace(self, outcome=outcome, state=None)


@dataclass
class Counters:
    """Work done since the start of the run."""

    newton: int = 0
    krylov: int = 0
    factorisations: int = 0
    assembly_s: float = 0.0
    factor_s: float = 0.0
    krylov_s: float = 0.0


@dataclass
class NegativePivots:
    """Negative pivots of the latest factor beyond those of a stable state.

    Zero on a stable path.  It belongs to the tangent that was factorised, at the ramp factors
    and the time [s] given; `None` before the first factorisation.  `settled` tells the tangent of
    an equilibrium, factorised on purpose, from that of one of Newton's iterates on the way to it.
    """

    excess: int | None = None
    factors: Mapping[str, float] = field(default_factory=dict)
    settled: bool = False
    time: float = 0.0

    def is_of(self, state: State) -> bool:
        """Whether it belongs to an accepted state."""
        return self.settled and self.factors == state.factors and self.time == state.time
