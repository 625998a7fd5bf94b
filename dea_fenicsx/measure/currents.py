"""Currents in the wires of electrodes, and the power that leakage and resistors take."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import ufl

from dea_fenicsx.measure.charges import ElectrodeCharge
from dea_fenicsx.measure.energy import integral, over_regions
from dea_fenicsx.measure.observables import Measurement, electrode_named
from dea_fenicsx.model.charge_history import RATE, ChargeHistory
from dea_fenicsx.model.circuits import Wire
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms.relaxation import relaxation_power
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of

Loss = Literal["all", "leak", "relaxation", "resistors"]


def _history(problem: Problem) -> ChargeHistory:
    found = problem.histories[problem.charges.NAME]
    assert isinstance(found, ChargeHistory)
    return found


def _through(problem: Problem, wire: Wire) -> float:
    """Current in A of a wire with a resistor or an open switch.  Collective."""
    own = math.nan
    if wire.row >= 0 and len(wire.dofs):
        volts = float(problem.w.x.array[wire.dofs[0]]) * problem.scales.potential
        own = problem.circuits.current(wire, volts, problem.factors[wire.ramp])
    return next(float(v) for v in problem.comm.allgather(own) if not math.isnan(v))


@dataclass(frozen=True)
class Current:
    """Current in A that flows through the wire into an electrode.

    Behind a resistor it is that of the resistor, and with an open switch 0.  Else it is the rate
    of the charge that has come through the wire: the slope of the parabola through its values at
    the last three times, which is exact to the second order in the steps.  Where no time has passed
    since a jump or a ramp, it is the current that replaces what leaks; charge that comes in no time
    is no finite current, and is not counted.

    Parameters
    ----------
    electrode
        A name used in the scene's electrodes.

    Raises
    ------
    InputError
        When it is bound: for an unknown name, and for a scene in which no charge depends on time.
    """

    electrode: str
    unit = "A"

    def bind(self, problem: Problem) -> Measurement:
        electrode = electrode_named(problem, self.electrode)
        _check_keeps(problem, "Current")
        number = [e.label for e in problem.scene.electrodes].index(electrode.label)
        wires = [w for w in problem.circuits.wires if w.number == number]
        leak = _leak_current(problem, electrode)

        def value() -> float:
            history = _history(problem)
            if wires and (not wires[0].is_ideal or not history.closed[number]):
                return _through(problem, wires[0])
            if history.levels < 2:
                return leak()
            return _slope(history.times[:3], [q[number] for q in history.wires[:3]])

        return value


def _slope(times: tuple[float, ...], values: list[Any]) -> float:
    """Slope, at the first place, of the polynomial through two or three values."""
    first = (values[0] - values[1]) / (times[0] - times[1])
    if len(times) < 3:
        return float(first)
    second = (values[1] - values[2]) / (times[1] - times[2])
    return float(first + (first - second) * (times[0] - times[1]) / (times[0] - times[2]))


@dataclass(frozen=True)
class ChargeLoss:
    """The power in W that leakage and resistors turn into heat; never negative.

    It is int g |E|^2 dv over the dielectrics, with the true field E and the conductivity g; what
    delayed polarisations lose, int |F (X - P)|^2/(eps tau J) dX, with X that of the present field;
    R I^2 in each wire with a resistor; and the heat of electrodes with a sheet resistance.

    Parameters
    ----------
    what
        ``"leak"``, ``"relaxation"``, ``"resistors"`` or ``"all"``.
    """

    what: Loss = "all"
    unit = "W"

    def bind(self, problem: Problem) -> Measurement:
        one_of(self.what, get_args(Loss), "what= of ChargeLoss")
        _check_keeps(problem, "ChargeLoss")
        everything = self.what == "all"
        parts: list[Measurement] = []
        if everything or self.what == "leak":
            parts.append(_leak_power(problem))
        if everything or self.what == "relaxation":
            parts.append(_delay_power(problem))
        if everything or self.what == "resistors":
            parts += [_resistor_power(problem), problem.forms.sheets.power]

        def value() -> float:
            return sum(part() for part in parts)

        return value


def _rate(problem: Problem) -> tuple[Any, Callable[[], None]]:
    """The coefficient omega = g/eps at quadrature points, and what brings it up to date.

    The coefficient is None where no dielectric conducts.
    """
    bound = next((k.leak for k in problem.kernels if k.leak is not None), None)
    if bound is None:
        return None, lambda: None
    rate = dolfinx.fem.Function(bound.excess.function_space)

    def renew() -> None:
        rate.x.array[:] = np.ascontiguousarray(problem.forms.leaks.now()[..., RATE]).ravel()

    return rate, renew


def _leak_current(problem: Problem, electrode: Conducting) -> Measurement:
    """The current in A that leaks from an electrode into the dielectrics."""
    rate, renew = _rate(problem)
    if rate is None:
        return lambda: 0.0
    flux = ElectrodeCharge(problem, electrode, rate)

    def value() -> float:
        renew()
        return flux.of_state()

    return value


def _leak_power(problem: Problem) -> Measurement:
    """The power of leakage in W."""
    rate, renew = _rate(problem)
    if rate is None:
        return lambda: 0.0

    def density(k: int, point: MaterialPoint) -> list[Any]:
        if problem.kernels[k].leak is None:
            return []
        return [rate * ufl.dot(point.displacement_field, point.nominal_field)]

    measured = integral(problem, over_regions(problem, None, density))

    def value() -> float:
        renew()
        return measured()

    return value


def _delay_power(problem: Problem) -> Measurement:
    """The power of delayed polarisations in W."""

    def density(k: int, point: MaterialPoint) -> list[Any]:
        return [relaxation_power(point)] if problem.kernels[k].relaxation else []

    return integral(problem, over_regions(problem, None, density))


def _resistor_power(problem: Problem) -> Measurement:
    """The power of resistors in W."""
    wires = [wire for wire in problem.circuits.wires if not wire.is_ideal]
    return lambda: sum(w.feed.ohms * _through(problem, w) ** 2 for w in wires)


def _check_keeps(problem: Problem, what: str) -> None:
    if not problem.charges:
        raise InputError(
            f"{what} needs a dielectric with a conductivity, or a Source; in this scene no charge "
            "depends on time."
        )
