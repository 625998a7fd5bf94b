"""Which observables of a run get an estimate of their discretisation error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dea_fenicsx.path.items import March
from dea_fenicsx.results.columns import column_of
from dea_fenicsx.results.finished import Run
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import is_positive, known

LEAST_ACCURACY = 1e-9
"""Smallest relative error that can be asked for: Newton's tolerance and rounding lie below it."""


def recorded_name(name: Any, record: Mapping[str, Any], what: str) -> str:
    """The name in `record` of an observable that is given by its name or by its column.

    Raises
    ------
    InputError
        If there is none.
    """
    if not isinstance(name, str):
        raise InputError(f"{what} is {shown(name)}, but must be a name in record=.")
    columns = {column_of(own, observable): own for own, observable in record.items()}
    if name in columns or name in record:
        return columns.get(name, name)
    known(name, (*record, *columns), "recorded observable", "the run")
    raise AssertionError("a name that is not known has been refused")


def names_to_estimate(estimate: Any, record: Mapping[str, Any]) -> list[str]:
    """The names in `record` whose errors are to be estimated."""
    if estimate is True:
        return list(record)
    return [recorded_name(one, record, "A name in estimate=") for one in estimate or ()]


def check_estimated(given: Any) -> None:
    """Raise InputError for names or an accuracy of `solve` that cannot be used.

    Parameters
    ----------
    given
        The `Arguments` of `solve`.
    """
    record = given.record or {}
    wanted = names_to_estimate(given.estimate, record)
    if given.accuracy is not None:
        if len(given.accuracy) != 2:
            raise InputError(
                f"accuracy is {shown(given.accuracy)}, but must be a recorded name and the largest "
                'relative error, such as ("tip_m", 1e-3).'
            )
        name, error = given.accuracy
        wanted.append(recorded_name(name, record, "The observable of accuracy="))
        if not is_positive(error) or not LEAST_ACCURACY <= error < 1:
            raise InputError(
                f"The accuracy of {name!r} is {shown(error)}, but must be an error relative to its "
                f"value, a number from {LEAST_ACCURACY:g} to below 1."
            )
        if given.resume or given.start is not None:
            raise InputError(
                "A run with accuracy= is solved on several meshes, so that it can neither be "
                "resumed nor start from another run; leave resume= and start= out."
            )
    if wanted and any(isinstance(item, March) for item in given.items):
        raise InputError(
            f"The discretisation error of {wanted[0]!r} is estimated in equilibria without a past, "
            "but the path has a March; compare two meshes instead."
        )


def estimate(run: Run, names: list[str]) -> None:
    """Estimate the errors of some observables at a run's end; the summary tells them.  Collective.

    Raises
    ------
    InputError, SolverError
        As of `Run.discretisation_error`.
    """
    for name in names:
        run.discretisation_error(name)
