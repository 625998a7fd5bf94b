"""What the load of a branch means for a problem: the factors of some ramps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from dea_fenicsx.model.state import State
from dea_fenicsx.path.stability import load_derivative
from dea_fenicsx.solvers.newton import NewtonSolver


class BranchLoad(Protocol):
    """What the load f of a branch means for a problem."""

    def loaded(self, state: State, factor: float) -> State:
        """A state with the load f and the fixed values of this load.  Its free unknowns stay."""

    def factor_of(self, state: State) -> float:
        """The load f of a state."""

    def derivative(self) -> np.ndarray:
        """dR/df in the free rows at the problem's present state."""


class LoadCourse:
    """The load of some ramps.

    Parameters
    ----------
    solver
        The nonlinear solver.
    rates
        Change of each ramp's factor with the load f.
    factor
        The present f.
    """

    def __init__(
        self, solver: NewtonSolver, rates: Mapping[str, float], factor: float
    ) -> None:
        self.solver, self.problem, self.rates = solver, solver.problem, rates
        self._lead = max(rates, key=lambda name: abs(rates[name]))
        now = self.problem.factors
        self._origin = now | {name: now[name] - rate * factor for name, rate in rates.items()}

    def loaded(self, state: State, factor: float) -> State:
        """A state with the load f and the fixed values of this load.  Its free unknowns stay."""
        moved = {name: self._origin[name] + rate * factor for name, rate in self.rates.items()}
        return self.problem.imposed(self.problem.under(state, self._origin | moved))

    def factor_of(self, state: State) -> float:
        """The load f of a state."""
        name = self._lead
        return (state.factors[name] - self._origin[name]) / self.rates[name]

    def derivative(self) -> np.ndarray:
        """dR/df in the free rows at the problem's present state."""
        return load_derivative(self.solver.tangent, self.rates)
