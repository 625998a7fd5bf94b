"""The position of a run on its path, and the steps that it has accepted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.trace_memory import TraceMemory


@dataclass(frozen=True)
class Cursor:
    """The position of a run on its path.  Together with the state it is enough to carry on.

    Attributes
    ----------
    step : number of the accepted step
    ramp : number of the ramp in the path
    position : travelled share of that ramp, 0 to 1
    size : size of the next step, as a share of the ramp
    start : factors at the start of the current ramp
    direction : in a trace, sign of the load's change
    switched : whether a trace has left its first branch
    passed : number of bifurcations that a trace has met
    began : time in s at the start of the current item
    memory : what a trace knows of the points behind it, or None
    """

    step: int = 0
    ramp: int = 0
    position: float = 0.0
    size: float = 0.0
    start: dict[str, float] = field(default_factory=dict)
    direction: float = 0.0
    switched: bool = False
    began: float = 0.0
    passed: int = 0
    memory: TraceMemory | None = None


@dataclass(frozen=True)
class AcceptedStep:
    """An accepted step; its state is the problem's while it is yielded.

    `event` is empty for the path's own steps.  A step with an event lies between two of them, and a
    run is not resumed from it: ``"maximum"`` or ``"minimum"`` where the load is stationary,
    ``"snap"`` where a device has landed behind a limit point, ``"motion"`` on its way there,
    ``"bifurcation"``, ``"landed"`` on a requested load of a trace, or an alarm's name.  `mode` is
    the null vector of a critical point.  `note` is what the summary tells of the event.  `held` is
    the scaled residual of a state with guiding forces (see `guiding`), and else 0.  `earlier` has
    the states before it from which the next step is predicted and judged, see the walk of its item.
    """

    cursor: Cursor
    label: str
    state: State
    retries: int = 0
    last: bool = False
    event: str = ""
    mode: np.ndarray | None = None
    note: Mapping[str, Any] = field(default_factory=dict)
    held: float = 0.0
    earlier: tuple[State, ...] = ()
