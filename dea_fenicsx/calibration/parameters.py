"""What is fitted: parameters with bounds and priors, and the coordinates of a fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.calibration.constants import constants_of, with_constants
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers, shown
from dea_fenicsx.support.validation import did_you_mean, finite, known, positive


@dataclass(frozen=True)
@plain_numbers
class Parameter:
    """A number that is to be found from tests.

    Parameters
    ----------
    name
        A constant of the material, such as ``"elastic.mu"`` or ``"viscous[0].tau"``; or a name of
        your own, such as ``"thickness"``, that a test reads.
    start
        Where the fit begins, in SI units.
    low, high
        Bounds, or None.
    prior
        What is known beforehand: a value and its standard deviation, which of a positive parameter
        is that of the logarithm (0.1 is about 10 %).
    positive
        Whether it is > 0 and fitted by its logarithm.  Then scale and unit do not matter, and a
        deviation is a relative one.
    """

    name: str
    start: float
    low: float | None = None
    high: float | None = None
    prior: tuple[float, float] | None = None
    positive: bool = True

    def check(self) -> None:
        """Raise InputError for a parameter without sense."""
        check_declared(self)
        what = f"The parameter {self.name!r}"
        for value, told in (
            (self.start, "starts at"), (self.low, "is bounded below by"),
            (self.high, "is bounded above by"), (self.prior and self.prior[0], "has the prior"),
        ):  # fmt: skip
            if value is None:
                continue
            finite(value, f"{what} {told} a number that")
            if self.positive and value <= 0:
                raise InputError(
                    f"{what} {told} {value:g}, but must be > 0; give positive=False if it may have "
                    "any sign."
                )
        if self.prior is not None:
            positive(self.prior[1], f"The standard deviation in the prior of {self.name!r}")
        low, high = self.low, self.high
        if low is not None and high is not None and low >= high:
            raise InputError(f"{what} has the bounds {low:g} and {high:g}; give the smaller first.")
        if not (low is None or self.start >= low) or not (high is None or self.start <= high):
            raise InputError(f"{what} starts at {self.start:g}, which is out of its bounds.")

    @property
    def size(self) -> float:
        """What a coordinate of a parameter of any sign is in units of."""
        return abs(self.start) or 1.0

    def coordinate(self, value: float) -> float:
        """The coordinate of a value: its logarithm, or its value over `size`."""
        return math.log(value) if self.positive else value / self.size

    def value(self, coordinate: float) -> float:
        """The value of a coordinate."""
        return math.exp(min(coordinate, 700.0)) if self.positive else coordinate * self.size

    def slope(self, value: float) -> float:
        """Derivative of the value by its coordinate."""
        return value if self.positive else self.size

    def bounds(self) -> tuple[float, float]:
        """The bounds of the coordinate."""
        low = -math.inf if self.low is None else self.coordinate(self.low)
        return low, math.inf if self.high is None else self.coordinate(self.high)


class Trial(Mapping[str, float]):
    """Values of all parameters at one trial of a fit, as a test reads them.

    ``trial["thickness"]`` is a value, and ``trial.material`` the material with the trial's
    constants.

    Attributes
    ----------
    template
        The material, or several by their names, before the constants are put in.
    read
        Names of the parameters that have been read.
    """

    def __init__(self, values: Mapping[str, float], template: Any) -> None:
        self._values, self.template = dict(values), template
        self.read: set[str] = set()
        self._made: Any = None

    def __getitem__(self, name: str) -> float:
        if name not in self._values:
            hint = did_you_mean(name, self._values) or f"there are {', '.join(self._values)}."
            raise InputError(f"A test reads the parameter {name!r}, which there is not; {hint}")
        self.read.add(name)
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def get(self, name: str, default: Any = None) -> Any:
        """The value of a parameter, or `default` where it is not fitted."""
        if name not in self:
            return default
        return self[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def material(self) -> Any:
        """The material with the constants of this trial; several are a dictionary.

        Raises
        ------
        InputError
            If the fit has no material, or the constants make no sense.
        """
        if self.template is None:
            raise InputError(
                "A test asks for the material, but none is given; give material= a Material with "
                "the constants that are not fitted."
            )
        self.check()
        self.read |= set(constants_of(self.template)) & set(self._values)
        return self._made

    def check(self) -> None:
        """Raise InputError if the constants of this trial make no sense."""
        if self._made is not None or self.template is None:
            return
        made = with_constants(self.template, self._values)
        several = made if isinstance(made, Mapping) else {"": made}
        for one in several.values():
            if faults := one.faults():
                raise InputError(f"The material of a trial makes no sense: {faults[0]}.")
        self._made = made


class Coordinates:
    """The coordinates of all parameters, in their order.

    Raises
    ------
    InputError
        For no parameters, one twice, and a name that looks like a constant which there is not.
    """

    def __init__(self, parameters: Sequence[Parameter], template: Any) -> None:
        if isinstance(parameters, Parameter):
            parameters = [parameters]
        self.all, self.template = tuple(parameters), template
        for one in self.all:
            if not isinstance(one, Parameter):
                raise InputError(f"parameters holds {shown(one)}, but must hold Parameter(...).")
            one.check()
        self.names = [p.name for p in self.all]
        if not self.names:
            raise InputError("There are no parameters to fit; give at least one Parameter.")
        if twice := [n for n in self.names if self.names.count(n) > 1]:
            raise InputError(f"The parameter {twice[0]!r} is given twice; give it once.")
        names = constants_of(template) if template is not None else {}
        for name in self.names:
            if ("." in name or "[" in name) and name not in names:
                known(name, names, "constant", "the material")

    def __len__(self) -> int:
        return len(self.all)

    def trial(self, z: np.ndarray) -> Trial:
        """The trial at coordinates z, shape (p,)."""
        return Trial(self.values(z), self.template)

    def values(self, z: np.ndarray) -> dict[str, float]:
        """The values at coordinates z."""
        return {p.name: p.value(float(c)) for p, c in zip(self.all, z, strict=True)}

    def of(self, values: Mapping[str, float]) -> np.ndarray:
        """The coordinates of values, shape (p,)."""
        for name in self.names:
            known(name, values, "value", "what is given")
        return np.array([p.coordinate(float(values[p.name])) for p in self.all])

    @property
    def start(self) -> np.ndarray:
        return np.array([p.coordinate(p.start) for p in self.all])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = zip(*(p.bounds() for p in self.all), strict=True)
        return np.array(low), np.array(high)

    def priors(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the priors: their residuals are rows @ z - due.  Shapes (m, p) and (m,)."""
        rows, due = np.zeros((0, len(self))), np.zeros(0)
        for k, p in enumerate(self.all):
            if p.prior is not None:
                spread = p.prior[1] if p.positive else p.prior[1] / p.size
                row = np.zeros((1, len(self)))
                row[0, k] = 1 / spread
                rows = np.concatenate([rows, row])
                due = np.append(due, p.coordinate(p.prior[0]) / spread)
        return rows, due
