"""What a trace yields: its points, with the events between two of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.cubic import Point
from dea_fenicsx.path.guiding import Guide
from dea_fenicsx.path.trace_memory import TraceMemory
from dea_fenicsx.solvers.outcome import Attempt


@dataclass(frozen=True)
class Traced:
    """An accepted point of a trace.

    Attributes
    ----------
    state
        The equilibrium.
    arc
        Length of the next step.
    direction
        Sign of the load's change along the branch.
    retries
        How often the step was halved.
    event, mode, held, last
        As of an `AcceptedStep`; `last` where the trace has come to its end.
    earlier, memory
        The states of the points before it that the next steps need, and what belongs to them.
    """

    state: State
    arc: float
    direction: float
    retries: int = 0
    event: str = ""
    mode: np.ndarray | None = None
    held: float = 0.0
    last: bool = False
    earlier: tuple[State, ...] = ()
    memory: TraceMemory | None = None


@dataclass(frozen=True)
class Spot:
    """An event, a requested load or the end, between two points of a branch.

    `arc` is its distance from the first of the two points.
    """

    arc: float
    traced: Traced


@dataclass(frozen=True)
class Reached:
    """A step that was accepted, from one point of the branch to another.

    Attributes
    ----------
    attempt
        How Newton's method ended.
    start, there, arc
        The two points, and the distance between them in units of arc.
    count
        Number of negative eigenvalues at its end, if it is counted.
    retries
        How often it was halved.
    done
        Distance from its start up to which events are known already.
    guide
        Holds soft shapes where the step passes other branches, or None.
    """

    attempt: Attempt
    start: Point
    there: Point
    arc: float
    count: int | None
    retries: int
    done: float = 0.0
    guide: Guide | None = None
