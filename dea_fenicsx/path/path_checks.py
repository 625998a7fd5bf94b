"""Checks of a path against the scene in which it is followed, before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import singledispatch

from dea_fenicsx.drives.trial import MOST_STEPS_OF_MARCH, check_numbers, check_pace
from dea_fenicsx.drives.waves import TIME_TOLERANCE, Wave
from dea_fenicsx.model.mass import check_mass
from dea_fenicsx.model.mean_forces import check_conserving
from dea_fenicsx.path.cavity_amounts import check_amounts
from dea_fenicsx.path.items import (
    CONSERVING,
    INERTIAL_SCHEMES,
    LOSSES,
    MOST_SHAPES,
    RESPONSES,
    TURNS,
    Close,
    Inertia,
    InMotion,
    Item,
    March,
    Open,
    Ramp,
    Trace,
    fed,
)
from dea_fenicsx.scene.electrodes import Electrode
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.scene.sources import Source
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, is_number, shown
from dea_fenicsx.support.validation import finite, known, one_of, positive


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
                f"The path holds {shown(item)}, but needs Ramp(...), Trace(...), March(...), "
                "Open(...) or Close(...)."
            )
        check_declared(item)
    if not path:
        raise InputError("The path is empty; give at least one Ramp(...).")
    if not scene.ramps and not all(isinstance(item, March | Open) for item in path):
        raise InputError(
            "Nothing in the scene can be ramped; give an Electrode a voltage, or add a Stretch or "
            "a load."
        )
    reached = dict.fromkeys(scene.ramps, 0.0) | dict(start or {})
    for item in path:
        for name in item.names(scene):
            known(name, scene.ramps, "ramp in the scene", "it")
        reached |= _checked(item, scene, path, reached)


type _Factors = dict[str, float | None]


@singledispatch
def _checked(item: Item, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    """Check an item of a path that is at `reached`; returns the factors at its end.

    A factor that is not known before the run is None.
    """
    raise TypeError(f"no check of {type(item).__name__}")


@_checked.register(March)
def _(item: March, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    _check_march(item)
    check_amounts(scene, item)
    _check_inertia(item, scene, path)
    return {name: wave(item.seconds) for name, wave in item.waves.items()}


@_checked.register(Ramp)
def _(item: Ramp, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    _check_response(item, scene)
    _check_passes(item, scene)
    _check_ramp(item, scene, reached)
    _check_loss(item, scene)
    check_amounts(scene, item)
    return dict.fromkeys(item.names(scene), float(item.to))


@_checked.register(Trace)
def _(item: Trace, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    _check_response(item, scene)
    _check_passes(item, scene)
    _check_trace(item)
    _check_leave(item)
    return {item.what: None}


@_checked.register(Open)
def _(item: Open, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    fed(scene, item.where)
    return {}


@_checked.register(Close)
def _(item: Close, scene: Scene, path: Sequence[Item], reached: _Factors) -> _Factors:
    _check_close(item, scene)
    return dict.fromkeys(item.names(scene), float(item.to))


def _check_response(item: Ramp | Trace | Close, scene: Scene) -> None:
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


def _check_close(item: Close, scene: Scene) -> None:
    source = fed(scene, item.where)
    if not 1 <= item.steps <= MOST_STEPS_OF_MARCH:
        raise InputError(
            f"Close({item.where!r}) has {item.steps} steps, but needs a whole number from 1 to "
            f"{MOST_STEPS_OF_MARCH}."
        )
    finite(item.to, f"The factor of the source of {item.where!r}")
    if source.ohms:
        return
    _check_response(item, scene)
    others = [
        one for one in (*scene.electrodes, *scene.prescribed, *scene.loads)
        if one.moved_by == source.ramp and one is not source
    ]  # fmt: skip
    if others:
        raise InputError(
            f"Close({item.where!r}) ramps {source.ramp!r} from the electrode's potential, but this "
            "ramp drives something else as well; give the source a ramp of its own."
        )


def _check_passes(item: Ramp | Trace, scene: Scene) -> None:
    """Raise InputError if a ramp drives nothing but sources behind resistors."""
    for name in item.names(scene):
        driven = [
            one for one in (*scene.electrodes, *scene.prescribed, *scene.loads)
            if one.moved_by == name
        ]  # fmt: skip
        if driven and all(_is_resisted(one) for one in driven):
            raise InputError(
                f"The {type(item).__name__.lower()} of {name!r} takes no time, in which no charge "
                "passes the resistance of its source or of its electrode; let time pass by "
                f"March(seconds, drive={{{name!r}: ...}}), or leave the resistance out."
            )


def _is_resisted(driven: object) -> bool:
    """Whether charge needs time to come to an electrode."""
    return (isinstance(driven, Source) and driven.ohms != 0) or (
        isinstance(driven, Electrode) and driven.is_resistive
    )


def _check_march(march: March) -> None:
    """Check the numbers and the waves of a march."""
    positive(march.seconds, "The length of the march", "a time > 0 in s")
    positive(march.tolerance, "The tolerance of the march")
    if march.steps is not None and not 1 <= march.steps <= MOST_STEPS_OF_MARCH:
        raise InputError(
            f"The march has {march.steps} steps, but needs a whole number from 1 to "
            f"{MOST_STEPS_OF_MARCH}, or None."
        )
    if march.order not in (1, 2, 3):
        raise InputError(f"The order of the march is {march.order}, but must be 1, 2 or 3.")
    if march.order == 3 and (march.steps is not None or march.moving):
        raise InputError(
            "The march has order=3, which is for steps whose length is adapted (steps=None), "
            "without inertia."
        )
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
        if wave.end < march.seconds * (1 - TIME_TOLERANCE):
            raise InputError(
                f"The drive of {name!r} ends at {wave.end:g} s, but the march lasts "
                f"{march.seconds:g} s; add a row to the table, or shorten the march."
            )
        if wave.begin > 0:
            raise InputError(
                f"The drive of {name!r} begins at {wave.begin:g} s, but the march begins at 0 s; "
                "add a row for it."
            )
        check_numbers(wave, what, march.seconds)
        check_pace({what: wave}, march.seconds, follows=march.steps is None)


def _check_inertia(march: March, scene: Scene, path: Sequence[Item]) -> None:
    """Check what a march with inertia needs of its numbers, its scene and its path."""
    if march.moving is None:
        return
    _check_moving(march.moving, scene)
    still = [item for item in path if not (isinstance(item, March) and item.moving)]
    if scene.declared.holds_rigid_motions and still:
        raise InputError(
            "FreeBody holds a body at rest, but with inertia it moves freely: solve the "
            f"{type(still[0]).__name__} in a run of its own, and give this run as start= to one "
            "of the marches with inertia alone."
        )


def _check_moving(inertia: Inertia, scene: Scene) -> None:
    """Check what inertia needs of its numbers and its scene."""
    check_declared(inertia)
    finite(inertia.spectral_radius, "The spectral radius of Inertia")
    if not 0 <= inertia.spectral_radius < 1:
        raise InputError(
            f"The spectral radius of Inertia is {inertia.spectral_radius:g}, but must be at least "
            "0 and below 1: at 1 an oscillation of the pressure would never decay."
        )
    positive(inertia.tolerance, "The tolerance of Inertia")
    finite(inertia.drag, "The drag of Inertia")
    if inertia.drag < 0:
        raise InputError(f"The drag of Inertia is {inertia.drag:g} 1/s, but must be at least 0.")
    one_of(inertia.scheme, INERTIAL_SCHEMES, "The scheme of Inertia")
    check_mass(scene.materials, scene)
    if inertia.scheme == CONSERVING:
        check_conserving(scene)
    what = ""
    if any(isinstance(e, Source) for e in scene.electrodes):
        what = "sources"
    elif any(isinstance(e, Electrode) and e.is_resistive for e in scene.electrodes):
        what = "electrodes with a sheet resistance"
    elif scene.leaks:
        what = "dielectrics that conduct or relax"
    if what:
        raise InputError(
            f"A march with inertia is not available with {what}; leave them out, or take the "
            "inertia out of the march."
        )


def _check_loss(ramp: Ramp, scene: Scene) -> None:
    """Check what a ramp does where equilibrium is lost."""
    label = ramp.label(scene)
    if not isinstance(ramp.at_loss, InMotion):
        one_of(ramp.at_loss, LOSSES, f"at_loss of the ramp of {label}")
    if ramp.snap and ramp.at_loss not in ("end", "snap"):
        raise InputError(
            f"The ramp of {label} has snap=True, which is at_loss=\"snap\", and another at_loss; "
            "give one of them."
        )
    how = ramp.loss
    if not isinstance(how, InMotion):
        return
    _check_moving(how.inertia, scene)
    if how.seconds is not None:
        positive(how.seconds, "The time of InMotion", "a time > 0 in s")
    positive(how.rest, "The share of the speed at which InMotion is at rest")
    if how.rest >= 1:
        raise InputError(f"The share rest of InMotion is {how.rest:g}, but must be below 1.")
    if how.inertia.velocity is not None:
        raise InputError(
            "A ramp that goes on in motion starts from rest; take the velocity out of its Inertia."
        )
    if not how.inertia.drag and not any(m.is_viscous for m in scene.materials.values()):
        raise InputError(
            f"The ramp of {label} goes on in motion where equilibrium is lost, but nothing brings "
            "the body to rest; give a material viscous branches, or a drag in 1/s by "
            "at_loss=dea.InMotion(dea.Inertia(drag=...))."
        )
    if scene.declared.holds_rigid_motions:
        raise InputError(
            "FreeBody holds a body at rest, but in motion it moves freely; support the body, or "
            f"take at_loss=\"snap\" for the ramp of {label}."
        )


def _check_trace(trace: Trace) -> None:
    finite(trace.first, f"The first step of the trace in {trace.what}")
    for value in (*trace.at, *(trace.until[1:] if trace.until else ())):
        finite(value, f"A value at which the trace in {trace.what} is to land or end")
    if not 0 < abs(trace.first) <= 1e6 or trace.steps < 1 or not trace.longest > 0:
        raise InputError(
            f"The trace in {trace.what} needs a first step other than 0 (at most a million "
            "times the load), at least one step and a longest step > 0."
        )
    if trace.at_turn is not None:
        one_of(trace.at_turn, TURNS, f"at_turn of the trace in {trace.what}")


def _check_leave(trace: Trace) -> None:
    numbers = trace.leave if isinstance(trace.leave, tuple) else (trace.leave,)
    if not numbers or min(numbers) < 1:
        raise InputError(
            f"The trace in {trace.what} is to leave its branch at bifurcation "
            f"{shown(trace.leave)}, but leave= is a whole number of at least 1, or several."
        )
    if trace.along is None:
        return
    if not trace.switch:
        raise InputError(
            f"The trace in {trace.what} is given along=, but stays on its branch; give it a step "
            "switch= as well, such as 0.05."
        )
    if callable(trace.along):
        return
    for share in trace.along if isinstance(trace.along, tuple) else (trace.along,):
        finite(share, f"A share in along= of the trace in {trace.what}")
    if not 1 <= len(trace.along) <= MOST_SHAPES or not any(trace.along):
        raise InputError(
            f"along= of the trace in {trace.what} has {len(trace.along)} numbers, but needs 1 to "
            f"{MOST_SHAPES} shares of shapes, not all 0."
        )


def _check_ramp(ramp: Ramp, scene: Scene, reached: dict[str, float | None]) -> None:
    """Check a ramp; `reached` holds the factors where it starts, None where they are not known."""
    label = ramp.label(scene)
    if not 1 <= ramp.steps <= MOST_STEPS_OF_MARCH:
        raise InputError(
            f"The ramp of {label} has {ramp.steps} steps, but needs a whole number from 1 to "
            f"{MOST_STEPS_OF_MARCH}."
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
