"""The accepted states of a run that stay in memory, so that one can go back to a step."""

from __future__ import annotations

from dea_fenicsx.model.state import State
from dea_fenicsx.support.errors import InputError

MOST_BYTES = 200_000_000
"""Memory of the states that are kept, on each rank.  The last one is always kept."""


class KeptStates:
    """The latest accepted states of a run, by the number of their row in the history.

    Parameters
    ----------
    most_bytes
        Memory that they may take; the earliest are let go.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most, self._states = most_bytes, dict[int, State]()

    def put(self, row: int, state: State) -> None:
        """Keep the state of a row, and let go of the earliest ones that are too many."""
        self._states[row] = state
        room = max(1, self._most // max(1, state.values.nbytes))
        for old in sorted(self._states)[:-room]:
            del self._states[old]

    def of(self, step: int, rows: int) -> State:
        """The state of a row of a history; negative numbers count from its end.

        Raises
        ------
        InputError
            If there is no such row, or its state is not in memory.
        """
        row = step + rows if step < 0 else step
        if not 0 <= row < rows:
            raise InputError(
                f"step={step} is no row of the history, which has {rows}; give one of 0 to "
                f"{rows - 1}, or -1 for the last."
            )
        if row not in self._states:
            kept = ", ".join(map(str, sorted(self._states)[:3]))
            raise InputError(
                f"The state of step={step} is not in memory: earlier steps of a large or resumed "
                f"run are not kept; the first that are kept are {kept}."
            )
        return self._states[row]
