"""Frequency response about the last state of a run.  Scripts call `frequency_response`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dea_fenicsx.drives.trial import MOST_STEPS_OF_MARCH
from dea_fenicsx.measure.harmonic import Harmonic, check_linear
from dea_fenicsx.measure.observables import Charge, Observable, electrode_named
from dea_fenicsx.measure.vibration import vibration_solver
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.run.adaptive_frequencies import refined, resonances
from dea_fenicsx.run.modes import checked_problem
from dea_fenicsx.support.agreement import bind_alike, check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.validation import finite, known


@dataclass(frozen=True)
class FrequencyResponse:
    """The answer to a small sinusoidal load, as complex amplitudes.

    A value x means Re(x exp(i omega t)) beside that of the equilibrium, while the factor of the
    ramp is its own plus `amplitude` cos(omega t).

    Attributes
    ----------
    hertz
        The frequencies in Hz.
    values
        Complex amplitude of each observable at each frequency, by its column's name.
    ramp
        The ramp that oscillates.
    amplitude
        Amplitude of its factor.
    volts
        Amplitude of each recorded charge's electrode in V, by the column's name.
    note
        What must be known of this answer, or empty.
    """

    hertz: np.ndarray
    values: Mapping[str, np.ndarray]
    ramp: str
    amplitude: float
    volts: Mapping[str, float]
    note: str = ""

    def __getitem__(self, name: str) -> np.ndarray:
        known(name, self.values, "column", "the response")
        return self.values[name]

    def modulus(self, name: str) -> np.ndarray:
        """Amplitude of an observable at each frequency, in its unit."""
        return np.abs(self[name])

    def phase_deg(self, name: str) -> np.ndarray:
        """Phase by which an observable is ahead of the load at each frequency, in degrees."""
        return np.degrees(np.angle(self[name]))

    def impedance_ohm(self, name: str) -> np.ndarray:
        """Complex electric impedance V/(i omega Q) in ohm, of the electrode of a recorded charge.

        Raises
        ------
        InputError
            If the column is no charge of an electrode that this ramp drives.
        """
        if not self.volts.get(name):
            raise InputError(
                f"{name!r} is no charge of an electrode that {self.ramp!r} drives, so it has no "
                "impedance; record dea.Charge of a driven electrode."
            )
        current = 2j * math.pi * self.hertz * self[name]
        none = current == 0  # at 0 Hz no current flows
        return np.where(none, np.inf, self.volts[name] / np.where(none, 1.0, current))

    def write(self, file: str | Path) -> None:
        """Write a table: the frequency, and modulus and phase of each observable (one rank)."""
        head = ["frequency_Hz"]
        for name in self.values:
            head += [name, f"{name}_phase_deg"]
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(head)
        for k, f in enumerate(self.hertz):
            row = [f]
            for name in self.values:
                row += [self.modulus(name)[k], self.phase_deg(name)[k]]
            table.writerow([repr(float(v)) for v in row])
        file = Path(file)
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, lambda target: target.write_text(text.getvalue(), "utf-8"))


def frequency_response(
    run: Run,
    hertz: Sequence[float],
    ramp: str | None = None,
    record: Mapping[str, Observable] | None = None,
    amplitude: float = 1.0,
    adaptive: float | None = None,
) -> FrequencyResponse:
    """The linearised answer to a small sinusoidal load about the last state of a run.  Collective.

    Viscous branches (`Maxwell`) answer with their complex modulus.  At zero voltage forces go with
    its square, so that a small voltage moves nothing at its own frequency; `note` then says so.

    Parameters
    ----------
    run
        The run, whose last state is an equilibrium in which viscous branches are relaxed: at rest,
        or after a ramp with ``response="relaxed"``.
    hertz
        Frequencies in Hz; 0 is the static answer of the relaxed device.
    ramp
        Name of the ramp whose factor oscillates; may be left out where the scene has one only.
    record
        Observables by name, as of `solve`.
    amplitude
        Amplitude of the ramp's factor, by which the answer is multiplied.
    adaptive
        Largest change of a recorded amplitude between neighbouring frequencies, as a share of the
        larger one; 0.2 gives smooth curves.  Where it is more, further frequencies are put between
        those in `hertz`, down to a distance of 1e-4 of the frequency.  The search begins on both
        sides of each mode of vibration within them, so that no narrow resonance is missed.  None
        takes those in `hertz` alone.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        If a name is not known, a region has no density, or a frequency is no number >= 0, or
        `adaptive` is no number above 0 and below 1.
    SolverError
        If the state is no equilibrium, or a frequency is a resonance without damping.
    """
    problem = checked_problem(run, "frequency_response")
    record = dict(record or {})
    ramp = _ramp_of(problem, ramp)
    frequencies = _checked(hertz)
    finite(amplitude, "The amplitude of the ramp's factor")
    share = 0.0 if adaptive is None else _checked_share(adaptive)
    check_same(
        problem.comm,
        {"hertz": frequencies, "ramp": ramp, "amplitude": amplitude, "adaptive": adaptive},
    )
    measures = {
        column_of(name, o): bind_alike(problem, name, o) for name, o in record.items()
    }
    solver = vibration_solver(problem)
    check_linear(problem)
    near = resonances(solver, max(frequencies)) if share else []
    harmonic = Harmonic(solver, ramp)

    def answer(f: float) -> np.ndarray:
        found = harmonic.answer(f)
        return np.array(
            [amplitude * harmonic.derivative(m, found) for m in measures.values()], dtype=complex
        )

    note = _note(problem, ramp)
    try:
        if share:
            found, further = refined(answer, frequencies, near, share)
            frequencies, rows = list(found), list(found.values())
            note = " ".join(words for words in (note, further) if words)
        else:
            rows = [answer(f) for f in frequencies]
    finally:
        harmonic.destroy()
    volts = {
        column_of(name, o): amplitude * _volts(problem, o, ramp) for name, o in record.items()
    }
    values = {name: np.array([row[k] for row in rows]) for k, name in enumerate(measures)}
    return FrequencyResponse(
        np.array(frequencies), values, ramp, float(amplitude), volts, note
    )


def _ramp_of(problem: Problem, ramp: str | None) -> str:
    """The ramp that oscillates."""
    ramps = problem.scene.ramps
    if ramp is None:
        if len(ramps) != 1:
            raise InputError(
                f"frequency_response needs ramp=, since the scene has {len(ramps)}: "
                f"{', '.join(ramps) or 'none'}."
            )
        return str(ramps[0])
    known(ramp, ramps, "ramp in the scene", "it")
    return ramp


def _checked_share(adaptive: float) -> float:
    if not is_number(adaptive) or not 0 < adaptive < 1:
        raise InputError(
            f"adaptive is {shown(adaptive)}, but must be None, or a number above 0 and below 1: "
            "the largest change between neighbouring frequencies."
        )
    return float(adaptive)


def _checked(hertz: Sequence[float]) -> list[float]:
    if is_number(hertz):
        hertz = [hertz]  # type: ignore[list-item]
    if not isinstance(hertz, list | tuple | np.ndarray | range):
        raise InputError(
            f"The frequencies are {shown(hertz)}, but must be a list of numbers in Hz."
        )
    found = []
    for f in hertz:
        if not is_number(f) or not 0 <= f < math.inf:
            raise InputError(f"A frequency is {shown(f)}, but must be a number >= 0 in Hz.")
        found.append(float(f))
    if not 1 <= len(found) <= MOST_STEPS_OF_MARCH:
        raise InputError(f"There are {len(found)} frequencies, but must be at least 1.")
    return found


def _volts(problem: Problem, observable: Observable, ramp: str) -> float:
    """Voltage in V of the electrode whose charge is measured, at factor 1 of a ramp; or 0."""
    if not isinstance(observable, Charge) or not isinstance(observable.electrode, str):
        return 0.0
    electrode = electrode_named(problem, observable.electrode)
    driven = not electrode.floats and electrode.ramp == ramp
    return float(electrode.given_volts) if driven else 0.0


def _note(problem: Problem, ramp: str) -> str:
    scene = problem.scene
    if not scene.is_electric(ramp):
        return ""
    biased = any(f for name, f in problem.factors.items() if scene.is_electric(name))
    if biased:
        return ""
    return (
        "The device has no bias: electric forces go with the square of the voltage, so that it "
        "moves at twice the frequency, and not at the frequency itself."
    )
