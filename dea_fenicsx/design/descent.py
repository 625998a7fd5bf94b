"""A search with gradients by SciPy's SLSQP or NLopt's MMA, over designs that are kept.

Both are deterministic.  So a search that was killed is simply run again: designs that are on disk
cost nothing, and it goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from dea_fenicsx.design.kept_designs import KeptDesigns
from dea_fenicsx.design.variables import Limit, Range
from dea_fenicsx.support.errors import InputError

SATISFIED = 1e-6
"""By so much, relative to its bound, a constraint may be missed."""

NOTHING = 1e-6
"""An objective is nothing below this share of what the sizes of its derivatives add up to."""

WORSE = 1.0
"""What a design that cannot be solved is worse than the one before, in units of the objective."""


SLSQP, MMA = METHODS = ("SLSQP", "MMA")
"""What searches: SciPy's sequence of quadratic problems, or moving asymptotes by NLopt."""

Function = Callable[[np.ndarray], Any]
"""Of a scaled design."""

Room = tuple[Function, Function]
"""What a constraint leaves of its bound, relative to the bound, and the derivatives of this."""


def mma_library() -> Any:
    """The library NLopt.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import nlopt
    except ImportError as error:
        raise InputError(
            'A search with method="MMA" needs NLopt; install it with pip install nlopt, or take '
            f'method="{SLSQP}".'
        ) from error
    return nlopt


@dataclass(frozen=True)
class Sample:
    """Quantities of a design, and the derivative of each by each variable.

    Attributes
    ----------
    values, slopes
        The quantities, and their derivatives by the names of the variables.
    failed
        Why the design could not be solved; empty if it was.
    """

    values: Mapping[str, float]
    slopes: Mapping[str, Mapping[str, float]]
    failed: str = ""


class _Enough(Exception):
    """The designs that may be solved are used up."""


class Descent:
    """Minimises or maximises one quantity.

    Variables are scaled by their ranges, quantities by their size at the start.

    Parameters
    ----------
    sample
        Solves a design.
    kept
        The designs that are known.
    free
        The variables with their ranges.
    objective, bounds
        One quantity with ``"min"`` or ``"max"``, and the constraints.
    chosen
        The options of `improve`.
    """

    def __init__(
        self,
        sample: Callable[[Mapping[str, float]], Sample],
        kept: KeptDesigns,
        free: Mapping[str, Range],
        objective: Mapping[str, str],
        bounds: Mapping[str, Limit],
        chosen: Mapping[str, Any],
    ) -> None:
        self.sample, self.kept, self.free = sample, kept, free
        self.low, high = np.array(list(free.values())).T
        self.span = high - self.low
        ((self.goal, kind),) = objective.items()
        self.sign = -1.0 if kind == "max" else 1.0
        self.bounds, self.chosen = bounds, chosen
        self.asked: dict[tuple[float, ...], Sample] = {}
        self.solved = 0
        self._size, self._good = 1.0, Sample({}, {})

    def run(self, start: Mapping[str, float]) -> dict[str, Any]:
        """Search from a design; what `Improved` holds.  Collective."""
        x = (np.array(list(start.values())) - self.low) / self.span
        first = self._at(x)
        if first.failed:
            raise InputError(f"The first design could not be solved: {first.failed}")
        self._size = self._size_of(first)
        rooms = [
            (self._room(name, bound, side), self._room_slope(name, bound, side))
            for name, pair in self.bounds.items()
            for bound, side in zip(pair, (1.0, -1.0), strict=True)
            if bound is not None
        ]
        by = {SLSQP: self._by_slsqp, MMA: self._by_mma}[self.chosen["method"]]
        try:
            converged, message = by(x, rooms)
        except _Enough:
            converged, message = False, f"{self.chosen['most']} designs were solved"
        return self._told(converged, message)

    def _size_of(self, first: Sample) -> float:
        """The size of the objective; by symmetry the first design may have nothing of it."""
        value = abs(first.values[self.goal])
        slope = float(np.abs(self._scaled(first, self.goal, 1.0)).sum())
        return (value if value > NOTHING * slope else slope) or 1.0

    def _by_slsqp(self, x: np.ndarray, rooms: list[Room]) -> tuple[bool, str]:
        """Search by a sequence of quadratic problems: whether it has ended by itself, and how."""
        found = minimize(
            self._value, x, jac=self._slope, method="SLSQP",
            constraints=[{"type": "ineq", "fun": room, "jac": slope} for room, slope in rooms],
            bounds=[(0.0, 1.0)] * len(x),
            options={"ftol": self.chosen["tolerance"], "maxiter": self.chosen["most"]},
        )  # fmt: skip
        return bool(found.success), str(found.message)

    def _by_mma(self, x: np.ndarray, rooms: list[Room]) -> tuple[bool, str]:
        """The same by the method of moving asymptotes."""
        nlopt = mma_library()
        search = nlopt.opt(nlopt.LD_MMA, len(x))

        def told(function: Function, slope: Function, sign: float) -> Callable[..., float]:
            def value(at: np.ndarray, by: np.ndarray) -> float:
                if by.size:
                    by[:] = sign * slope(at)
                return sign * float(function(at))

            return value

        search.set_lower_bounds(np.zeros(len(x)))
        search.set_upper_bounds(np.ones(len(x)))
        search.set_min_objective(told(self._value, self._slope, 1.0))
        for room, slope in rooms:  # NLopt holds functions below 0
            search.add_inequality_constraint(told(room, slope, -1.0), 0.1 * SATISFIED)
        search.set_ftol_abs(self.chosen["tolerance"])
        search.optimize(x)
        code = search.last_optimize_result()
        return code > 0, f"MMA of NLopt ended with the code {code}"

    def _told(self, converged: bool, message: str) -> dict[str, Any]:
        good = {key: one for key, one in self.asked.items() if not one.failed}
        allowed = {key: one for key, one in good.items() if self._misses(one) <= SATISFIED}
        pool = allowed or dict([next(iter(good.items()))])
        best = min(pool, key=lambda key: self.sign * pool[key].values[self.goal])
        names = list(self.free)
        return {
            "design": dict(zip(names, best, strict=True)),
            "quantities": dict(good[best].values),
            "before": dict(next(iter(good.values())).values),
            "evaluations": len(self.asked), "solved": self.solved,
            "converged": converged, "feasible": bool(allowed), "message": message,
            "history": [
                {**dict(zip(names, key, strict=True)), **one.values}
                for key, one in self.asked.items()
            ],
        }  # fmt: skip

    def _misses(self, one: Sample) -> float:
        """By how much a design misses a constraint at most, relative to its bound."""
        return max(
            (
                side * (bound - one.values[name]) / (abs(bound) or 1.0)
                for name, pair in self.bounds.items()
                for bound, side in zip(pair, (1.0, -1.0), strict=True)
                if bound is not None
            ),
            default=0.0,
        )

    def _at(self, x: np.ndarray) -> Sample:
        """What is known of a design, which is solved if it is new.  Collective."""
        inside = self.low + np.clip(x, 0.0, 1.0) * self.span
        key = tuple(float(value) for value in inside)
        if key not in self.asked:
            if len(self.asked) >= self.chosen["most"]:
                raise _Enough
            record = self.kept.known.get(key)
            if record is None:
                record = self._solve(key)
            self.asked[key] = Sample(
                record.get("quantities", {}), record.get("slopes", {}), record.get("failed", "")
            )
            self._say(key)
        found = self.asked[key]
        if not found.failed:
            self._good = found
        return found

    def _solve(self, key: tuple[float, ...]) -> dict[str, Any]:
        design = dict(zip(self.free, key, strict=True))
        found = self.sample(design)
        self.solved += 1
        record: dict[str, Any] = {"design": design}
        if found.failed:
            record["failed"] = found.failed
        else:
            record |= {"quantities": dict(found.values), "slopes": dict(found.slopes)}
        self.kept.known[key] = record
        if self.kept.comm.rank == 0:
            self.kept.append(record)
        return record

    def _say(self, key: tuple[float, ...]) -> None:
        if self.kept.comm.rank or self.chosen["quiet"]:
            return
        one = self.asked[key]
        told = one.failed or ", ".join(f"{n} {v:.6g}" for n, v in one.values.items())
        design = ", ".join(f"{n} {v:.6g}" for n, v in zip(self.free, key, strict=True))
        print(f"design {len(self.asked)}: {design}: {told}", flush=True)

    def _scaled(self, one: Sample, name: str, size: float) -> np.ndarray:
        """The derivatives of a quantity in units of its size by the scaled variables."""
        slopes = np.array([one.slopes[name][variable] for variable in self.free])
        return slopes * self.span / size

    def _value(self, x: np.ndarray) -> float:
        one = self._at(x)
        if one.failed:  # worse than the last good one, so that the step is shortened
            return self.sign * self._good.values[self.goal] / self._size + WORSE
        return self.sign * one.values[self.goal] / self._size

    def _slope(self, x: np.ndarray) -> np.ndarray:
        one = self._at(x)
        return self.sign * self._scaled(self._good if one.failed else one, self.goal, self._size)

    def _room(self, name: str, bound: float, side: float) -> Callable[[np.ndarray], float]:
        def room(x: np.ndarray) -> float:
            one = self._at(x)
            values = self._good.values if one.failed else one.values
            return side * (values[name] - bound) / (abs(bound) or 1.0)

        return room

    def _room_slope(
        self, name: str, bound: float, side: float
    ) -> Callable[[np.ndarray], np.ndarray]:
        def slope(x: np.ndarray) -> np.ndarray:
            one = self._at(x)
            return side * self._scaled(self._good if one.failed else one, name, abs(bound) or 1.0)

        return slope
