"""The columns of a history, and a check of the names of recorded observables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from dea_fenicsx.measure.failures import ElectricalBreakdown, Gauge, LossOfTension, StretchLimit
from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import InMotion, March, Ramp
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, plain, shown

LEADING_COLUMNS = ("step", "time", "ramp", "event")
TIME = ("time_s",)
"""Columns of a path with time."""

FIELD_COLUMNS = ("max_field_V_per_m", "max_field_x_m", "max_field_y_m", "max_field_z_m")
WORK = (
    "min_J", "volume_error", "residual", "newton_iterations", "krylov_iterations",
    "factorisations", "retries", "inertia", "inertia_is_of_this_step", "negative_modes", "wall_s",
)  # fmt: skip

COUNTS = ("newton_iterations", "krylov_iterations", "factorisations")
"""Columns of work that hold a whole number in each row, and whose sums are in summary.json."""

SUMMARY = (
    "status", "message", "stable", "events", "failures", "count_changes", "start", "steps",
    "unknowns", "unknowns_by_field", "cells", "mesh_quality", "volume_m3", "ranks",
    "preconditioner", "peak_memory_GB", "assembly_s", "factor_s", "krylov_s", "settings",
    "versions", "origin", "command", "discretisation_error", "accuracy",
)  # fmt: skip
"""Entries of summary.json that are not the last values of columns."""

LONGEST_COLUMN = 100
"""Largest number of characters of a column's name."""


def column_of(name: str, observable: Any) -> str:
    """The column of an observable: its name, with the unit appended if it has one."""
    return f"{name}_{observable.unit}" if observable.unit else name


def load_column(scene: Scene, ramp: str) -> tuple[str, float]:
    """The column of a ramp and the unit of its factor: volts for electrodes, or bare."""
    volts = float(scene.reference_voltage(ramp))
    return (f"{ramp}_V", volts) if volts else (f"{ramp}_factor", 1.0)


def has_time(path: Iterable[Any]) -> bool:
    """Whether time passes on a path."""
    return any(
        isinstance(item, March) or (isinstance(item, Ramp) and isinstance(item.loss, InMotion))
        for item in path
    )


def names(
    scene: Scene,
    record: Mapping[str, Any],
    failures: Iterable[Any],
    potential: bool,
    timed: bool = False,
) -> list[str]:
    """Columns of a run's history."""
    return [
        *LEADING_COLUMNS,
        *(TIME if timed else ()),
        *(load_column(scene, ramp)[0] for ramp in scene.ramps),
        *(column_of(name, observable) for name, observable in record.items()),
        *(FIELD_COLUMNS if potential else ()),
        *(failure.column for failure in failures),
        *WORK,
    ]


def numeric(name: str, measure: Measurement) -> Measurement:
    """A measurement whose values are plain floats, whatever kind of number it gives.

    Raises
    ------
    InputError
        When it is called, if it gives no number.
    """

    def value() -> float:
        found = plain(measure())
        if not isinstance(found, bool) and not is_number(found):
            raise InputError(
                f"What is recorded as {name!r} measures {shown(found)}, but must measure a number "
                "(nan where it is not defined)."
            )
        return float(found)

    return value


def of_the_state(
    problem: Problem, gauges: Iterable[Gauge], measurements: Mapping[str, Measurement]
) -> dict[str, Measurement]:
    """Columns that the present state alone determines, which can end a trace: how to measure each.

    Parameters
    ----------
    problem, gauges
        The problem and what watches its failures.
    measurements
        How to measure what is recorded, by column.
    """
    known: dict[str, Measurement] = {}

    def load(name: str, unit: float) -> float:
        return float(problem.factors[name] * unit)

    def value(gauge: Gauge) -> float:
        return gauge.measure()[0].value

    for name in problem.scene.ramps:
        key, unit = load_column(problem.scene, name)
        known[key] = partial(load, name, unit)
    if problem.potential is not None:
        known["max_field_V_per_m"] = lambda: problem.probe().max_field * problem.scales.field
    known |= {gauge.failure.column: partial(value, gauge) for gauge in gauges}
    return known | dict(measurements)


def check_names(scene: Scene, record: Mapping[str, Any], failures: Iterable[Any]) -> None:
    """Raise InputError unless each recorded name is plain and its column is its own."""
    for ramp in scene.ramps:
        _check_plain(ramp, "The name of a ramp")
    watched = (*failures, ElectricalBreakdown, LossOfTension, StretchLimit)
    taken = dict.fromkeys((*LEADING_COLUMNS, *TIME, *FIELD_COLUMNS, *WORK), "the history")
    for failure in failures:
        _check_plain(failure.column, "The column of a failure")
    taken |= {failure.column: "the history" for failure in watched}
    for ramp in scene.ramps:
        column = load_column(scene, ramp)[0]
        if column in taken:
            raise InputError(
                f"The ramp {ramp!r} has the column {column!r}, which {taken[column]} has already; "
                "give it another name."
            )
        taken[column] = f"the ramp {ramp!r}"
    taken |= dict.fromkeys(SUMMARY, "the summary")
    for name, observable in record.items():
        _check_plain(name, "The name of an observable")
        if not isinstance(observable.unit, str):
            raise InputError(
                f"The unit of what is recorded as {name!r} is {shown(observable.unit)}, but must "
                'be text such as "m", or "" for a pure number.'
            )
        column = column_of(name, observable)
        if column in taken:
            raise InputError(
                f"What is recorded as {name!r} has the column {column!r}, which {taken[column]} "
                "has already; give it another name."
            )
        _check_plain(column, "A recorded column")
        taken[column] = f"the observable {name!r}"


def check_added(values: Mapping[str, Any]) -> None:
    """Raise InputError if a value that a script adds would replace one of the package."""
    for name in values:
        if name in (*SUMMARY, *WORK, *LEADING_COLUMNS):
            raise InputError(
                f"The summary has {name!r} of its own, which is not replaced; give what is added "
                "another name."
            )


def _check_plain(name: str, what: str) -> None:
    """Raise InputError unless a name can stand in CSV, XDMF and a file's name."""
    good = name.isprintable() and name == name.strip() and 0 < len(name) <= LONGEST_COLUMN
    if not good or any(c in name for c in '/\\,"') or name[0] in "=+-@.":
        raise InputError(
            f"{what} is {shown(name)}, but must be a plain word of 1 to {LONGEST_COLUMN} "
            'characters without / \\ , " and line breaks, and not begin with one of = + - @ and a '
            "dot."
        )
