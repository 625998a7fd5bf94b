"""The wires that feed electrodes: ideal sources, sources behind a resistor, open switches.

The potential of a fed electrode is one unknown.  Its row says that the flux of the displacement
through the electrode is the charge q that has come through the wire:

    open switch        q stays as it is
    ideal source       the potential is that of the source; q is what follows from it
    with a resistor    q = H + h (V_source - V)/R, the rule of the step, see `model.charge_history`
    at its limit       q = H + h I, with the largest current I of the source

In no time a resistor lets no charge pass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.model.charge_history import ChargeHistory
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.tied_unknowns import TiedGroup
from dea_fenicsx.scene.declarations import Feed
from dea_fenicsx.scene.scene import Scene


@dataclass(frozen=True)
class Wire:
    """The wire of one fed electrode on this rank.

    Attributes
    ----------
    number
        Place of the electrode among those of the scene.
    label, ramp
        Its name, and the ramp of its source.
    feed
        The source.
    dofs
        Local degrees of freedom of the electrode, ghosts included.
    row
        Place of its potential among the free unknowns of this rank, -1 where it has none.
    """

    number: int
    label: str
    ramp: str
    feed: Feed
    dofs: np.ndarray
    row: int

    @property
    def is_ideal(self) -> bool:
        """Whether its source has no resistance."""
        return self.feed.ohms == 0


class Circuits:
    """The wires of a problem, in the present state.

    Parameters
    ----------
    scene, scales
        The scene and its units.
    groups
        The groups of electrodes whose potential floats, in the order of the scene.
    electrode_dofs
        Degrees of freedom of each electrode, by its label.
    free
        Owned local degrees of freedom that are unknowns, sorted.

    Attributes
    ----------
    wires
        The wires of fed electrodes.
    """

    def __init__(
        self, scene: Scene, scales: Scales, groups: Sequence[TiedGroup],
        electrode_dofs: Mapping[str, np.ndarray], free: np.ndarray,
    ) -> None:  # fmt: skip
        self._volt, self._charge = scales.potential, scales.charge
        self.names = tuple(electrode.label for electrode in scene.electrodes)
        self.wires: list[Wire] = []
        self._history: ChargeHistory | None = None
        self._share = 1.0
        for (electrode, told), group in zip(scene.declared.floating, groups, strict=False):
            if told.feed is None:
                continue
            row = int(np.searchsorted(free, group.master)) if group.master >= 0 else -1
            self.wires.append(Wire(
                self.names.index(electrode.label), electrode.label, told.ramp, told.feed,
                electrode_dofs[electrode.label], row,
            ))  # fmt: skip

    def __bool__(self) -> bool:
        return bool(self.wires)

    @property
    def closed_at_first(self) -> tuple[bool, ...]:
        """Whether the switch of each electrode of the scene is closed before a path begins."""
        opened = {wire.number for wire in self.wires if not wire.feed.closed}
        return tuple(k not in opened for k in range(len(self.names)))

    def show(self, history: ChargeHistory, share: float) -> None:
        """Take the history of the present state.

        Parameters
        ----------
        history
            The history.
        share
            What the rows of the potential are multiplied by.
        """
        self._history, self._share = history, share

    # ------------------------------------------------------------- ideal sources

    def ideal(self, history: ChargeHistory | None = None) -> list[Wire]:
        """The wires whose source gives the potential in a state, the present one unless given."""
        at = history or self._history
        if at is None:
            return []
        return [wire for wire in self.wires if wire.is_ideal and at.closed[wire.number]]

    def given_rows(self) -> np.ndarray:
        """Rows of potentials that ideal sources give, on this rank."""
        return np.array([w.row for w in self.ideal() if w.row >= 0], dtype=np.int32)

    def impose(
        self, values: np.ndarray, factors: Mapping[str, float], history: ChargeHistory | None
    ) -> None:
        """Set the potentials that ideal sources give at a load, ghosts included."""
        for wire in self.ideal(history):
            values[wire.dofs] = factors[wire.ramp] * wire.feed.volts / self._volt

    def lift(self, into: np.ndarray, change: np.ndarray) -> None:
        """Copy the given potentials from one local vector into another."""
        for wire in self.ideal():
            into[wire.dofs] = change[wire.dofs]

    def per_factor(self, ramp: str, into: np.ndarray) -> None:
        """Set the change of given potentials by the factor of a ramp in a local vector."""
        for wire in self.ideal():
            if wire.ramp == ramp:
                into[wire.dofs] = wire.feed.volts / self._volt

    # ------------------------------------------------------------- charges

    def _passing(self, wire: Wire, volts: float, factor: float) -> tuple[float, float]:
        """Current in A at a potential, and its derivative by the potential in A/V."""
        history, feed = self._history, wire.feed
        assert history is not None
        if wire.is_ideal or not history.closed[wire.number]:
            return 0.0, 0.0
        current = (factor * feed.volts - volts) / feed.ohms
        most = np.inf if feed.amperes is None else feed.amperes
        return (current, -1 / feed.ohms) if abs(current) < most else (np.copysign(most, current), 0)

    def current(self, wire: Wire, volts: float, factor: float) -> float:
        """Current in A from a source into its electrode of a potential; 0 for an ideal one."""
        return float(self._passing(wire, volts, factor)[0])

    def _volts(self, wire: Wire, values: np.ndarray) -> float:
        return float(values[wire.dofs[0]]) * self._volt

    def add_charges(
        self, rows: np.ndarray, values: np.ndarray, factors: Mapping[str, float]
    ) -> None:
        """Add the charges that came through the wires to the free rows.

        The rows of potentials that are given become 0.
        """
        history = self._history
        if history is None:
            return
        before, span = history.combined(history.wires), history.rule_length
        for wire in self.wires:
            if wire.row < 0:
                continue
            current, _ = self._passing(wire, self._volts(wire, values), factors[wire.ramp])
            charge = (before[wire.number] + span * current) / self._charge
            rows[wire.row] += charge * self._share
        rows[self.given_rows()] = 0.0

    def charges(self, values: np.ndarray, factors: Mapping[str, float]) -> dict[int, float]:
        """The charge in C of each wire that is open or has a resistor, where its row is known.

        By the number of its electrode, on the rank that has the row.
        """
        history = self._history
        assert history is not None
        before, span = history.combined(history.wires), history.rule_length
        found = {}
        for wire in self.wires:
            if wire.row < 0 or (wire.is_ideal and history.closed[wire.number]):
                continue
            current, _ = self._passing(wire, self._volts(wire, values), factors[wire.ramp])
            found[wire.number] = float(before[wire.number] + span * current)
        return found

    def by_source(
        self, ramp: str, values: np.ndarray, factors: Mapping[str, float]
    ) -> list[tuple[int, float]]:
        """Rows, and the derivative of their charge by the factor of a ramp, on this rank."""
        volts = {wire.row: wire.feed.volts for wire in self.wires if wire.ramp == ramp}
        return [
            (row, -value * volts[row] / self._volt)
            for row, value in self.stiffness(values, factors) if row in volts
        ]  # fmt: skip

    def stiffness(
        self, values: np.ndarray, factors: Mapping[str, float]
    ) -> list[tuple[int, float]]:
        """Rows, and what resistors add to the tangent there, on this rank."""
        history = self._history
        if history is None or not history.passes_time:
            return []
        span = history.rule_length
        unit = self._share * self._volt / self._charge
        found = []
        for wire in self.wires:
            if wire.row < 0:
                continue
            _, slope = self._passing(wire, self._volts(wire, values), factors[wire.ramp])
            if slope:
                found.append((wire.row, span * slope * unit))
        return found
