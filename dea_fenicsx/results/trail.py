"""The states that a checkpoint holds: the last accepted one, and those before it that matter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dea_fenicsx.model.state import State
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.moment import moment_of
from dea_fenicsx.results.spread import Table

Gathered = tuple[Table | None, dict[str, Any]]
"""Values of a state in each cell, and what is told of its load and time."""


class Trail:
    """Makes tables of states, of each of them once.

    A state belongs to the checkpoints of several steps: first as the last accepted one, then as an
    earlier one.  So what was gathered is kept as long as the next checkpoint holds it.

    Parameters
    ----------
    writer
        Gathers the present state of its problem.
    """

    def __init__(self, writer: FieldWriter) -> None:
        self.writer = writer
        self._known: list[tuple[State, Gathered]] = []

    def gathered(self, state: State, earlier: Sequence[State] = ()) -> list[Gathered]:
        """A state, which is the problem's present one, and earlier ones.  Collective."""
        found = [self._present(), *map(self._before, earlier)]
        self._known = list(zip((state, *earlier), found, strict=True))
        return found

    def _present(self) -> Gathered:
        problem = self.writer.problem
        told = {"factors": dict(problem.factors), "moment": moment_of(problem).told}
        return self.writer.gather_state(), told

    def _before(self, state: State) -> Gathered:
        # All ranks hold the same states in the same order, so that they agree on what is known.
        for known, found in self._known:
            if known is state:
                return found
        with self.writer.problem.at(state):
            return self._present()
