"""What `solve` gives back: the history, the summary and the folder of a run."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.columns import check_added
from dea_fenicsx.results.folder import Folder
from dea_fenicsx.results.history import History
from dea_fenicsx.results.tables import run_html
from dea_fenicsx.support.errors import InputError


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
    """

    def __init__(
        self,
        history: History,
        summary: dict[str, Any],
        problem: Problem,
        folder: Folder | None = None,
    ) -> None:
        self.history, self.summary, self.folder = history, summary, folder
        self._problem = problem

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

    def column(self, name: str) -> np.ndarray:
        """A column of the history as an array: numbers, NaN where there is none, or texts."""
        return self.history.column(name)

    def __getitem__(self, name: str) -> Any:
        """Value of a column at the last step: a number, or a text such as that of ``event``."""
        last = self.column(name)[-1]
        return str(last) if isinstance(last, str) else float(last)
