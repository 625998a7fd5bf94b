"""A state of a problem: all unknowns, the load, and room for time, velocity and history."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

NO_HISTORY: Mapping[str, Any] = MappingProxyType({})


class Factors(Mapping[str, float]):
    """The load: the factor of each ramp of a scene.  It is immutable.

    Parameters
    ----------
    values
        Factor of each ramp; 1 is the value written in the scene.
    unit_volts
        For each ramp that drives potentials the voltage, in V, at factor 1.
    """

    __slots__ = ("_unit_volts", "_values")

    def __init__(
        self, values: Mapping[str, float], unit_volts: Mapping[str, float] = NO_HISTORY
    ) -> None:
        self._values = dict(values)
        self._unit_volts = unit_volts

    def __getitem__(self, ramp: str) -> float:
        return self._values[ramp]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __or__(self, changed: Mapping[str, float]) -> Factors:
        """The same load with some factors changed."""
        return Factors(self._values | dict(changed), self._unit_volts)

    def volts(self, ramp: str) -> float | None:
        """The voltage in V on a ramp, or None if the ramp drives no potential."""
        unit = self._unit_volts.get(ramp, 0.0)
        return self._values[ramp] * unit if unit else None

    def told(self, ramps: Iterable[str]) -> str:
        """The load of some ramps in words: volts where there are some, else the bare factor."""
        words = []
        for ramp in ramps:
            volts = self.volts(ramp)
            bare = f"{ramp} factor {self._values[ramp]:.6g}"
            words.append(bare if volts is None else f"{volts:.6g} V")
        return ", ".join(words)

    def mixed(self, share: float, other: Mapping[str, float]) -> Factors:
        """The load at a share of the way to another one."""
        return self | {n: (1 - share) * f + share * other[n] for n, f in self._values.items()}

    def __repr__(self) -> str:
        return f"Factors({self._values})"


@dataclass(frozen=True, eq=False)
class State:
    """A state of a problem.  It is immutable.

    Attributes
    ----------
    values
        All local values of the mixed function, ghosts included, dimensionless.
    factors
        The load.
    time
        Time in s; 0 on a path without time.
    velocity
        Rates of the values in 1/s, laid out like them, or None on a path without time.
    history
        The history variables of each term of the problem that has some, by the name of the term.
    """

    values: np.ndarray
    factors: Factors
    time: float = 0.0
    velocity: np.ndarray | None = None
    history: Mapping[str, Any] = field(default_factory=lambda: NO_HISTORY)

    def __post_init__(self) -> None:
        for array in (self.values, self.velocity):
            if array is not None:
                array.setflags(write=False)
        if not isinstance(self.history, MappingProxyType):
            object.__setattr__(self, "history", MappingProxyType(dict(self.history)))

    def with_values(self, values: np.ndarray) -> State:
        """The same state with other values of the unknowns."""
        return replace(self, values=values)

    def with_factors(self, factors: Mapping[str, float]) -> State:
        """The same unknowns under another load; see `Problem.under` for what follows from it."""
        return replace(self, factors=self.factors | factors)

    def __eq__(self, other: object) -> bool:
        """Whether unknowns, load, time and velocity are the same to the last bit on this rank."""
        if not isinstance(other, State):
            return NotImplemented
        pairs = ((self.values, other.values), (self.velocity, other.velocity))
        same = all(
            a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs
        )
        return same and self.factors == other.factors and self.time == other.time

    __hash__ = None  # type: ignore[assignment]
