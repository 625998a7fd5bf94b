"""The items of a path, as a user writes them: ramps of the load, traces of a branch, marches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from dea_fenicsx.drives.waves import ROUNDING, Constant, Function, Wave
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, is_number, plain_numbers, shown
from dea_fenicsx.support.validation import finite, known, one_of, positive

MOST_STEPS = 1_000_000
"""Most steps of a ramp or a march."""

Response = Literal["instantaneous", "relaxed"]
RESPONSES: tuple[Response, ...] = get_args(Response)


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
    response
        How viscous branches take part, which must be said where there are some: with
        ``"instantaneous"`` their viscous strains stay as they are, as in a ramp that takes no
        time; with ``"relaxed"`` they carry no stress, as in a ramp that takes forever.
    """

    what: str | tuple[str, ...] = ()
    to: float = 1.0
    steps: int = 10
    at: tuple[float, ...] | None = None
    snap: bool = False
    response: Response | None = None

    def goals(self, scene: Scene) -> dict[str, float]:
        """Factor at the end of each ramp of the scene that this one moves."""
        return dict.fromkeys(self.names(scene), float(self.to))

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
    response
        How viscous branches take part, as of a `Ramp`.
    """

    what: str
    first: float = 0.05
    steps: int = 200
    until: tuple[str, float] | None = None
    longest: float = 4.0
    at: tuple[float, ...] = ()
    switch: float = 0.0
    response: Response | None = None

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (self.what,)

    def label(self, scene: Scene) -> str:
        return self.what


@dataclass(frozen=True)
@plain_numbers
class March:
    """Let time pass, with loads that may change in it.

    Each instant is in equilibrium (there is no inertia), and viscous branches flow.  A jump of a
    drive meets the instantaneous response; it is a ramp of its own, in no time.

    Parameters
    ----------
    seconds
        How long the march lasts, in s.
    drive
        Factor of ramps of the scene over time since the beginning of the march: a wave such as
        ``dea.Sine(hertz=2)``, a number, or any function of the time in s.  A ramp that is not named
        keeps its factor.
    steps
        Number of equal steps; None chooses their length by the estimated error.
    tolerance
        Largest estimated error of a step in the viscous strains C_v: root mean square over the
        viscous regions and their branches, weighted by the moduli of the branches over the sum of
        all moduli.
    at
        Times in s since the beginning of the march at which a step ends.
    order
        2 for BDF2, whose first steps are of SDIRK2; 1 for backward Euler.
    """

    seconds: float
    drive: Mapping[str, Wave | float | Callable[[float], float]] = field(default_factory=dict)
    steps: int | None = None
    tolerance: float = 1e-5
    at: tuple[float, ...] = ()
    order: int = 2

    @property
    def waves(self) -> dict[str, Wave]:
        """The drive as waves."""
        return {name: _as_wave(value) for name, value in self.drive.items()}

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that may move."""
        return tuple(self.drive)

    def label(self, scene: Scene) -> str:
        return "march"


Item = Ramp | Trace | March
"""An item of a path."""


def _as_wave(value: Wave | float | Callable[[float], float]) -> Wave:
    if isinstance(value, Wave):
        return value
    return Constant(float(value)) if is_number(value) else Function(value)  # type: ignore[arg-type]


def check_path(
    scene: Scene,
    path: Sequence[Item],
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
        if not isinstance(item, Item):
            raise InputError(
                f"The path holds {shown(item)}, but needs Ramp(...), Trace(...) or March(...)."
            )
        check_declared(item)
    if not path:
        raise InputError("The path is empty; give at least one Ramp(...).")
    if not scene.ramps and not all(isinstance(item, March) for item in path):
        raise InputError(
            "Nothing in the scene can be ramped; give an Electrode a voltage, or add a Stretch or "
            "a load."
        )
    reached = dict.fromkeys(scene.ramps, 0.0) | dict(start or {})
    for item in path:
        for name in item.names(scene):
            known(name, scene.ramps, "ramp in the scene")
        if isinstance(item, March):
            _check_march(item)
            reached |= {name: wave(item.seconds) for name, wave in item.waves.items()}
            continue
        _check_response(item, scene)
        if isinstance(item, Trace):
            _check_trace(item)
            reached[item.what] = None  # where a trace ends is not known before
        else:
            _check_ramp(item, scene, reached)
            reached |= dict.fromkeys(item.names(scene), float(item.to))


def _check_response(item: Ramp | Trace, scene: Scene) -> None:
    """Whether a ramp or a trace says how the viscous branches of a scene take part."""
    kind, label = type(item).__name__, item.label(scene)
    if item.response is not None:
        one_of(item.response, RESPONSES, f"The response of the {kind.lower()} of {label}")
    elif any(material.is_viscous for material in scene.materials.values()):
        raise InputError(
            f"The scene has viscous branches, and the {kind.lower()} of {label} does not say how "
            f'they take part: give {kind}(response="instantaneous") for a load in no time, '
            'response="relaxed" for one that takes forever, or a March(seconds, drive={...}).'
        )


def _check_march(march: March) -> None:
    """Check the numbers and the waves of a march."""
    positive(march.seconds, "The length of the march", "a time > 0 in s")
    positive(march.tolerance, "The tolerance of the march")
    if march.steps is not None and not 1 <= march.steps <= MOST_STEPS:
        raise InputError(
            f"The march has {march.steps} steps, but needs a whole number from 1 to {MOST_STEPS}, "
            "or None."
        )
    if march.order not in (1, 2):
        raise InputError(f"The order of the march is {march.order}, but must be 1 or 2.")
    for time in march.at:
        finite(time, "A time at which the march is to land")
        if not 0 < time <= march.seconds:
            raise InputError(
                f"The march is to land on {time:g} s, but it goes from 0 to {march.seconds:g} s; "
                "times count from its beginning."
            )
    for name, value in march.drive.items():
        if not (isinstance(value, Wave) or is_number(value) or callable(value)):
            raise InputError(
                f"The drive of {name!r} is {shown(value)}, but must be a wave such as "
                "Sine(hertz=1), a number, or a function of the time in s."
            )
    for name, wave in march.waves.items():
        what = f"the drive of {name!r}"
        check_declared(wave)
        wave.check(what)
        if wave.end < march.seconds * (1 - ROUNDING):
            raise InputError(
                f"The drive of {name!r} ends at {wave.end:g} s, but the march lasts "
                f"{march.seconds:g} s; add a row to the table, or shorten the march."
            )
        if wave.begin > 0:
            raise InputError(
                f"The drive of {name!r} begins at {wave.begin:g} s, but the march begins at 0 s; "
                "add a row for it."
            )
        for time in (0.0, march.seconds):
            finite(wave(time), f"The drive of {name!r} at {time:g} s")


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
