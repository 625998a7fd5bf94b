"""What `solve` gives back: the history, the summary and the folder of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.gradients.adjoint import Gradients
from dea_fenicsx.gradients.changes import Recorded
from dea_fenicsx.gradients.critical import critical_load, limit_row
from dea_fenicsx.gradients.discretisation import DiscretisationError, ErrorEstimates
from dea_fenicsx.gradients.events import EVENTS, Asked, event_load, event_row
from dea_fenicsx.gradients.gradient import Gradient
from dea_fenicsx.gradients.hessian import hessian_product
from dea_fenicsx.gradients.past_checks import has_past
from dea_fenicsx.gradients.through_time import at_step
from dea_fenicsx.gradients.variables import Told
from dea_fenicsx.measure.failures import FailureMode
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.columns import check_added, column_of
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.history import History
from dea_fenicsx.results.kept_states import KeptStates
from dea_fenicsx.results.tables import run_html
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known


class Run:
    """A finished or ended run.

    Attributes
    ----------
    history
        A row for each accepted step, and by its name each column as an array; see `History`.
    summary
        What summary.json holds.
    folder
        The results folder's writer, or None.
    lent
        The solver of the run, until another run begins; its factor serves for derivatives.
    """

    def __init__(
        self,
        history: History,
        summary: dict[str, Any],
        problem: Problem,
        folder: Folder | None = None,
        states: KeptStates | None = None,
        recorded: Mapping[str, Any] | None = None,
        failures: Sequence[FailureMode] = (),
    ) -> None:
        self.history, self.summary, self.folder = history, summary, folder
        self._problem, self._recorded = problem, dict(recorded or {})
        self._failures = tuple(failures)
        self._states = KeptStates() if states is None else states
        self.lent: NewtonSolver | None = None

    @property
    def problem(self) -> Problem:
        """The discrete problem in its last accepted state."""
        self._problem.handed_out = True
        return self._problem

    def __repr__(self) -> str:
        steps = f"{len(self.history)} accepted steps"
        return f"Run({self.summary.get('status', 'running')}, {steps}, out={self.out})"

    def _repr_html_(self) -> str:
        """The run in a notebook: how it ended, its last values and its events."""
        return run_html(self)

    def show(self, fields: Sequence[str] | None = None) -> Any:
        """The run in a notebook, to turn with the mouse: what `dea report` writes, in a frame.

        Parameters
        ----------
        fields
            Names of the fields to choose from; by default the electric field, the displacement,
            the stress, J and the potential.

        Raises
        ------
        InputError
            If the run has no folder, or plotly is not installed.
        """
        if self.out is None:
            raise InputError("This run has no folder, so nothing can be shown; give solve out=.")
        # The pictures come after the results in the order of rooms; they are loaded on demand.
        report = import_module("dea_fenicsx.pictures.report")
        return report.Shown(report.page(self.out, fields))

    @property
    def out(self) -> Path | None:
        """The results folder."""
        return self.folder.path if self.folder else None

    def add(self, **values: Any) -> None:
        """Add a script's own findings to the summary, in memory and on disk (by rank 0).

        A key ends in its unit (``height_m``) unless it is a pure number.

        Raises
        ------
        InputError
            If it would replace what the package says of the run, or the folder holds another run
            by now.
        """
        check_added(values)
        self.summary |= values
        folder = self.folder
        if folder:  # a script may well call this on rank 0 alone
            folder.write(lambda: folder.add_to_summary(self.summary), together=False)

    @cached_property
    def _gradients(self) -> Gradients:
        # A rank that has solved something alone since then has let its part of the solver go.
        everywhere = self._problem.comm.allreduce(self.lent is not None, op=MPI.LAND)
        return Gradients(self._problem, self.lent if everywhere else None)

    def sensitivity(self, name: str, to: Iterable[Told], step: int = -1) -> Gradient:
        """The derivatives of what was recorded at a step, or of a critical load.  Collective.

        Parameters
        ----------
        name
            A name in ``record=``, or what a critical load is called, at its first event:
            ``"pull-in"`` for the load at a limit point of a trace, ``"buckling"`` for that of a
            bifurcation (``stability="every"`` locates it), ``"breakdown"``, ``"loss of tension"``
            and ``"stretch limit"`` for those at which a failure that is watched begins.
        to
            What is derived by, each by its name:

            ``"film.elastic.mu"``
                A constant of a material, as in `Problem.parameters`.
            ``"voltage"``
                A ramp: per V where it drives voltages, else by its factor.
            ``"prestretch:film:x"``
                The stretch of a `PreStretch`; the one that is not given follows, or that along z.
            ``"thickness:film"``
                The thickness of a layer in m: all between its lowest and its highest plane is
                stretched alike, and what lies above is shifted.  The axis is that along which the
                layer is thinnest; ``"thickness:film:x"`` names another one.
            a `ShapeChange`
                Any other change of the undeformed shape, by the velocity of its points.
            a `ConstantChange`
                A change of constants that varies with the place.
        step
            The row of the history; the last one by default.  At a step of a march the lengths of
            all steps are held, and a load is derived by its value at factor 1, so that the whole
            drive grows in proportion.

        Returns
        -------
        Gradient
            The derivative by each variable, in SI units.

        Raises
        ------
        InputError
            For names that there are not, an observable without a derivative, and a march whose
            steps are not derived.
        SolverError
            If a linear system is singular, as that of an observable is at a limit point.
        """
        if name in ("pull-in", "pull_in") and name not in self._recorded:
            row = limit_row(self.history, step)
            return critical_load(
                self._gradients, self._states.of(row, len(self.history)), self.history[row], to
            )
        if name in EVENTS and name not in self._recorded:
            row = event_row(self.history, name, step)
            state, failures = self._states.of(row, len(self.history)), self._failures
            return event_load(
                self._gradients, state, self.history[row], Asked(name, to, failures)
            )
        known(name, self._recorded, "recorded observable", "the run")
        rows = len(self.history)
        state = self._states.of(step, rows)
        if has_past(state):
            row = step + rows if step < 0 else step
            return at_step(
                self._gradients, name, self._recorded[name], to, row, self._recorded_step
            )
        return self._gradients.of_observable(state, name, self._recorded[name], to)

    @cached_property
    def _errors(self) -> ErrorEstimates:
        return ErrorEstimates(self._problem)

    def discretisation_error(self, name: str, step: int = -1) -> DiscretisationError:
        """The estimated discretisation error of what was recorded at a step.  Collective.

        The estimate is a dual weighted residual; see docs/theory.md, "The discretisation error".
        It takes one linear solve in elements of one degree more, and no second run.  That of the
        last step is added to the summary.

        Parameters
        ----------
        name
            A name in ``record=``.
        step
            The row of the history; the last one by default.

        Raises
        ------
        InputError
            For a name that there is not, an observable without a derivative, and a step of a march.
        SolverError
            If the linear system is singular, as at a limit point.
        """
        known(name, self._recorded, "recorded observable", "the run")
        rows = len(self.history)
        state = self._states.of(step, rows)
        found = self._errors.of(state, {name: self._recorded[name]})[name]
        if step in (-1, rows - 1):
            column = column_of(name, self._recorded[name])
            told = self.summary.get("discretisation_error", {})
            self.tell({"discretisation_error": {**told, column: found.told()}})
        return found

    def tell(self, values: Mapping[str, Any]) -> None:
        """Put what the package itself has found into the summary.  Collective."""
        self.summary |= values
        if folder := self.folder:
            folder.write(lambda: folder.add_to_summary(self.summary))

    def hessian_product(
        self, name: str, to: Iterable[Told], along: Mapping[str, float],
        step: int = -1,
    ) -> Gradient:  # fmt: skip
        """The second derivatives of what was recorded, along a direction.  Collective.

        Parameters
        ----------
        name, to, step
            As of `sensitivity`.
        along
            Name of a variable to its part in the direction, in its unit: with
            ``{"voltage": 1.0}`` the result is the derivative of ``d tip/d voltage`` by each of
            `to`.  A `ShapeChange` in `to` is named here by its own name.

        Returns
        -------
        Gradient
            The derivative by each variable of the slope along the direction.  Its ``value`` is this
            slope.

        Raises
        ------
        InputError
            As of `sensitivity`, for an observable that is no function of integrals, for a
            frequency, and at a step of a march.
        SolverError
            If a linear system is singular.
        """
        known(name, self._recorded, "recorded observable", "the run")
        state = self._states.of(step, len(self.history))
        measured = name, self._recorded[name]
        return hessian_product(self._gradients, state, measured, to, along)

    def _recorded_step(self, row: int) -> Recorded:
        """The state of a row, and where on the path it lies."""
        state = self._states.of(row, len(self.history))
        return Recorded(state, *self._states.item_of(row), str(self.history[row]["event"] or ""))

    def column(self, name: str) -> np.ndarray:
        """A column of the history as an array: numbers, NaN where there is none, or texts."""
        return self.history.column(name)

    def __getitem__(self, name: str) -> Any:
        """Value of a column at the last step: a number, or a text such as that of ``event``."""
        last = self.column(name)[-1]
        return str(last) if isinstance(last, str) else float(last)
