"""The items of a path, as a user writes them: ramps of the load, and traces of a branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers, shown
from dea_fenicsx.support.validation import finite, known

MOST_STEPS = 1_000_000
"""Most steps of a ramp."""


@dataclass(frozen=True)
@plain_numbers
class Ramp:
    """Bring one or more ramps of the scene to a factor, in steps.

    Parameters
    ----------
    what
        Name or names of the ramps (``"voltage"``, ``"stretch"``, ``"load"`` or your own); empty
        for all of the scene.  Ramps that are not named keep their present factor.
    to
        Factor at the end; 1 is the value written in the scene.
    steps
        Number of equal steps; each of their ends is landed on exactly.
    at
        Factors to land on instead, in the order of travel.  Between them the step size is adapted;
        the first step is a `steps`-th of the ramp.
    snap
        What happens at a limit point.  If False, the ramp ends there with `EquilibriumLost`.  If
        True, the load stays constant, as the voltage of a battery does, and the device snaps to the
        next stable state of the branch at this load.  Then the ramp goes on.
    """

    what: str | tuple[str, ...] = ()
    to: float = 1.0
    steps: int = 10
    at: tuple[float, ...] | None = None
    snap: bool = False

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that this one moves."""
        if not self.what:
            return scene.ramps
        return (self.what,) if isinstance(self.what, str) else tuple(self.what)

    def label(self, scene: Scene) -> str:
        return "+".join(self.names(scene))


@dataclass(frozen=True)
@plain_numbers
class Trace:
    """Follow the branch in one ramp of the scene by arc length, through limit points.

    Parameters
    ----------
    what
        Name of the ramp, such as ``"voltage"``.
    first
        Load factor of the first step; negative to start backwards.
    steps
        Most steps that are taken, events included.
    until
        A column of the history and a value.  The trace ends where the column has this value.
    longest
        Longest step in units of arc, of 5 % stretch each.
    at
        Load factors to land on exactly, each time that the branch passes one.
    switch
        Length of a step, in units of arc, along the null vector of the first bifurcation: the
        trace goes on along the branch that lies there, and the sign chooses the side.  0 stays on
        the branch.  Needs ``stability="every"``.
    """

    what: str
    first: float = 0.05
    steps: int = 200
    until: tuple[str, float] | None = None
    longest: float = 4.0
    at: tuple[float, ...] = ()
    switch: float = 0.0

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (self.what,)

    def label(self, scene: Scene) -> str:
        return self.what


def check_path(
    scene: Scene,
    path: Sequence[Ramp | Trace],
    start: Mapping[str, float | None] | None = None,
) -> None:
    """Raise InputError if the path does not fit the scene.

    Parameters
    ----------
    scene, path
        The scene, and the items of the path.
    start
        Factor of each ramp where the path begins, None where it is not known; all are 0 unless
        given.
    """
    for item in path:
        if not isinstance(item, Ramp | Trace):
            raise InputError(f"The path holds {shown(item)}, but needs Ramp(...) or Trace(...).")
        check_declared(item)
    if not path:
        raise InputError("The path is empty; give at least one Ramp(...).")
    if not scene.ramps:
        raise InputError(
            "Nothing in the scene can be ramped; give an Electrode a voltage, or add a Stretch or "
            "a load."
        )
    reached = dict.fromkeys(scene.ramps, 0.0) | dict(start or {})
    for item in path:
        for name in item.names(scene):
            known(name, scene.ramps, "ramp in the scene")
        if isinstance(item, Trace):
            _check_trace(item)
            reached[item.what] = None  # where a trace ends is not known before
        else:
            _check_ramp(item, scene, reached)
            reached |= dict.fromkeys(item.names(scene), float(item.to))


def _check_trace(trace: Trace) -> None:
    finite(trace.first, f"The first step of the trace in {trace.what}")
    for value in (*trace.at, *(trace.until[1:] if trace.until else ())):
        finite(value, f"A value at which the trace in {trace.what} is to land or end")
    if not 0 < abs(trace.first) <= 1e6 or trace.steps < 1 or not trace.longest > 0:
        raise InputError(
            f"The trace in {trace.what} needs a first step other than 0 (at most a million "
            "times the load), at least one step and a longest step > 0."
        )


def _check_ramp(ramp: Ramp, scene: Scene, reached: dict[str, float | None]) -> None:
    """Check a ramp; `reached` holds the factors where it starts, None where they are not known."""
    label = ramp.label(scene)
    if not 1 <= ramp.steps <= MOST_STEPS:
        raise InputError(
            f"The ramp of {label} has {ramp.steps} steps, but needs a whole number from 1 to "
            f"{MOST_STEPS}."
        )
    landings = () if ramp.at is None else ramp.at
    for value in (ramp.to, *landings):
        finite(value, f"A target of the ramp of {label}")
    start = reached[ramp.names(scene)[0]]
    for value in landings:
        if start is not None and not min(start, ramp.to) <= value <= max(start, ramp.to):
            raise InputError(
                f"The ramp of {label} is to land on {value:g}, but it goes from {start:g} to "
                f"{ramp.to:g}; name values between the two in at=, or change to=."
            )
