"""A film in time under any drive, exact to about ten digits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dea_fenicsx.drives.scaled import ScaledWave
from dea_fenicsx.drives.waves import Constant, Wave
from dea_fenicsx.exact.course import Course
from dea_fenicsx.exact.equilibrium import Equations
from dea_fenicsx.exact.film import FREE, Film, Held, Side
from dea_fenicsx.exact.film_drive import FilmLoads, as_wave, checked_seconds
from dea_fenicsx.exact.flowing_film import equations_of
from dea_fenicsx.exact.integration import INTEGRATION_TOLERANCE, FilmInTime, Integrator
from dea_fenicsx.exact.limits import relaxed
from dea_fenicsx.exact.viscous_film import ViscousFilm
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si

Drive = Wave | Callable[[float], float] | float
"""A wave of `dea_fenicsx.drives.waves`, a function of time in s, or a number that stays."""


def march(
    film: Film,
    seconds: float,
    *,
    voltage: Drive | None = None,
    field: Drive | None = None,
    charge: Drive | None = None,
    sides: tuple[Drive | None, Drive | None] = (None, None),
    start: Course | Literal["undeformed", "relaxed"] = "undeformed",
    tolerance: float = INTEGRATION_TOLERANCE,
) -> Course:
    """The course of a film in time, from an ordinary differential equation.

    The film responds at once where the drive jumps, at frozen branches; a drive that is not 0 at
    the start jumps there.  The course ends at `seconds`, or where equilibrium is lost (pull-in).

    Parameters
    ----------
    film
        The film, with any number of viscous branches (none is a film that follows its drive).
    seconds
        How long, in s.
    voltage, field, charge
        At most one of: the voltage in V, the nominal field V/T in V/m, or the charge per
        undeformed area in C/m^2 (of a film that is not connected).  Without any there is no field.
    sides
        For each direction what replaces the value in `film.first` and `film.second` over time: a
        stretch for `Held`, a stress in Pa for `Dead` and `TrueStress`.
    start
        ``"undeformed"``: never loaded before, so that all loads jump at the start.
        ``"relaxed"``: rested for ever under the loads that the sides have just before the start,
        without field.  A `Course`: goes on from its end (times count from 0 again).
    tolerance
        Relative error of a step.

    Raises
    ------
    InputError
        For a drive that ends too early, constants without sense, or a film that cannot be followed
        (its chains lock up).

    Notes
    -----
    With two equal sides the film stays equal in both directions; whether it would rather part
    (a bifurcation) is not asked.
    """
    seconds = checked_seconds(si(seconds, "s", "The duration"))
    return Drives.of(film, seconds, (voltage, field, charge), sides).march(start, tolerance)


@dataclass(frozen=True, eq=False)
class Drives:
    """A film with all its drives, checked.

    Attributes
    ----------
    film
        The film, its sides with the values just before the start.
    control
        ``"voltage"`` or ``"charge"``.
    loads
        The waves.
    """

    film: Film
    control: Literal["voltage", "charge"]
    loads: FilmLoads

    @staticmethod
    def of(
        film: Film,
        seconds: float,
        electric: tuple[Drive | None, Drive | None, Drive | None],
        sides: tuple[Drive | None, Drive | None],
    ) -> Drives:
        """Check and collect what `march` is given: voltage, field and charge, and the sides."""
        control, drive = _electric(film, *electric)
        waves = [drive, *(_side(film, k, sides[k]) for k in range(2))]
        first, second = (
            _with_value(side, wave.before(0.0))
            for side, wave in zip(film.sides, waves[1:], strict=True)
        )
        film = replace(film, first=first, second=second)
        loads = FilmLoads(waves, seconds, (f"the {control}", "the first side", "the second side"))
        for t in loads.corners():
            for k, side in enumerate(film.sides):
                if isinstance(side, Held) and not loads.before(t)[1 + k] > 0:
                    raise InputError(
                        f"The drive holds a stretch of {loads.before(t)[1 + k]:g} at {t:g} s, but "
                        "a stretch is > 0 (1 + strain)."
                    )
        return Drives(film, control, loads)

    def state(self, start: Course | str) -> ViscousFilm:
        """The equations; directions that are equal in all stay equal."""
        film, waves = self.film, self.loads.waves
        equal = film.first == film.second and waves[1] == waves[2]
        if isinstance(start, Course):
            equal = equal and start.is_equal
        return equations_of(film, self.control, equal and not isinstance(film.first, Held))

    def march(self, start: Course | str, tolerance: float) -> Course:
        """The course from a start, see the function `march`."""
        state = self.state(start)
        place, before = _beginning(self.film, state, self.loads, start)
        return self.march_from(state, place, before, tolerance)

    def march_from(
        self, state: ViscousFilm, place: FilmInTime, before: np.ndarray, tolerance: float
    ) -> Course:
        """The course from a place, with the loads before it."""
        loads = self.loads
        integrator = Integrator(state, loads, tolerance)
        corners, lost = loads.corners(), False
        for k, low in enumerate(corners):
            place, lost = integrator.jump(place, before, loads.at(low))
            if not lost and k + 1 < len(corners):
                place, lost = integrator.piece(place, low, corners[k + 1])
                before = loads.before(corners[k + 1])
            if lost:
                break
        return Course.of(self.film, state, integrator.parts, place, lost)


def _electric(
    film: Film, voltage: Drive | None, field: Drive | None, charge: Drive | None
) -> tuple[Literal["voltage", "charge"], Wave]:
    """The control, and its wave in V/m or C/m^2."""
    given = {"voltage": voltage, "field": field, "charge": charge}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"The march is given {' and '.join(named)}, but takes one of them.")
    if not named:
        return "voltage", Constant(0.0)
    unit = {"voltage": "V", "field": "V/m", "charge": ""}[named[0]]
    wave = as_wave(si(given[named[0]], unit, f"The {named[0]}"), named[0])
    if named[0] == "voltage":
        wave = ScaledWave(wave, 1 / film.thickness)
    return ("charge" if named[0] == "charge" else "voltage"), wave


def _side(film: Film, k: int, given: Drive | None) -> Wave:
    side = film.sides[k]
    name = ("first", "second")[k]
    if given is None:
        return Constant(side.stretch if isinstance(side, Held) else side.pascal)
    return as_wave(given, f"{'stretch' if isinstance(side, Held) else 'stress'} of the {name} side")


def _with_value(side: Side, value: float) -> Side:
    return Held(value) if isinstance(side, Held) else type(side)(value)


def _beginning(
    film: Film, state: ViscousFilm, loads: FilmLoads, start: Course | str
) -> tuple[FilmInTime, np.ndarray]:
    """Where the film is before the start, and its loads there."""
    K, n = state.count, state.n
    if isinstance(start, Course):
        return start.end_for(state)
    if start == "undeformed":
        free = [1.0 if isinstance(side, Held) else FREE.pascal for side in film.sides]
        return FilmInTime(0.0, np.zeros((K, 2)), 0.0, np.zeros(n)), np.array([0.0, *free])
    if start != "relaxed":
        raise InputError(
            f'The start is {start!r}, but must be "undeformed", "relaxed" or a course.'
        )
    before = np.array([0.0, *loads.before(0.0)[1:]])
    y = np.zeros(n)
    if n:
        rest = Equations(relaxed(film))
        e = rest.e(rest.rest()[0])
        y = np.linalg.lstsq(state.B, e - state.stretches(y[:, None], before[:, None])[:, 0])[0]
    e = state.stretches(y[:, None], before[:, None])[:, 0]
    a = np.broadcast_to(2 * (e - e.mean())[:2], (K, 2))
    return FilmInTime(0.0, a.copy(), 0.0, y), before
