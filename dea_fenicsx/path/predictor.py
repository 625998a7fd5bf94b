"""The prediction of each step of a ramp: the polynomial through the states before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.state import State
from dea_fenicsx.path.interpolation import lagrange_weights
from dea_fenicsx.path.stability import Place
from dea_fenicsx.solvers.landing import landed
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Attempt

Judge = Callable[[Attempt, State | None], Attempt]
"""Accepts or refuses a solution, given the attempt that found it and the extrapolation to it.

The extrapolation is None where only one state is known.
"""


def trusting(attempt: Attempt, guess: State | None) -> Attempt:
    """A judge that accepts each solution that has converged."""
    return attempt


class Predictor:
    """Starts each step from an extrapolation of the states before it.

    Displacement and pressure do not change if a voltage or charge changes its sign.  So in a ramp
    of a voltage or charge they are extrapolated in its square.  Fields that change their sign, such
    as the potential, are extrapolated in the voltage or charge itself.  States between two known
    ones are interpolated in the same way.

    Parameters
    ----------
    solver
        The nonlinear solver with its problem.
    names
        The ramps that move.
    lead
        The one of them whose factor is the coordinate of the extrapolation: it must move.  The
        first one unless given.
    """

    def __init__(
        self, solver: NewtonSolver, names: tuple[str, ...], lead: str | None = None
    ) -> None:
        self.solver = solver
        self.problem = solver.problem
        scene = self.problem.scene
        self.name = names[0] if lead is None else lead
        self.even = all(scene.is_electric(n) for n in names)
        self.known: list[State] = []
        self._odd = np.zeros(self.problem.size, dtype=bool)
        space = self.problem.space
        for part in (p for f in space.fields if f.odd for p in space.parts[f.name].values()):
            self._odd[part.dofs] = True

    def add(self, state: State) -> None:
        """Remember an accepted state."""
        # A ramp to the present value has the same factor twice; a polynomial needs distinct ones.
        others = [s for s in self.known if s.factors[self.name] != state.factors[self.name]]
        self.known = [*others[-2:], state]

    def coordinate(self, factors: Mapping[str, float]) -> float:
        """The load coordinate in which displacements are smooth: the factor or its square."""
        factor = factors[self.name]
        return factor**2 if self.even else factor

    def moved(self, since: State, now: State) -> float:
        """Largest change of displacement between two states, dimensionless.  Collective."""
        dofs = self.problem.roles.owned(Role.MOTION)
        move = float(np.max(np.abs(now.values[dofs] - since.values[dofs]), initial=0.0))
        return self.problem.comm.allreduce(move, op=MPI.MAX)

    def speed(self, first: State, second: State) -> float:
        """Largest change of displacement between two states per change of the load coordinate."""
        span = abs(self.coordinate(second.factors) - self.coordinate(first.factors))
        return self.moved(first, second) / span if span else 0.0

    def middle(self, first: State, second: State) -> float:
        """Share of the way at which the load coordinate is half-way between two states."""
        low, high = first.factors[self.name], second.factors[self.name]
        between = ((low**2 + high**2) / 2) ** 0.5 if self.even else (low + high) / 2
        if self.even and low + high < 0:
            between = -between
        share = (between - low) / (high - low) if high != low else 0.5
        return share if 0 < share < 1 else 0.5  # The voltage may change its sign on the way.

    def between(
        self,
        low: State,
        high: State,
        tolerance: float | None = None,
        patient: bool = False,
    ) -> Place:
        """A function that finds the equilibrium at a share, 0 to 1, of the way between two.

        Parameters
        ----------
        low, high
            The two equilibria.
        tolerance, patient
            As of `NewtonSolver.solve`.
        """
        problem = self.problem
        start, end = low.factors[self.name], high.factors[self.name]

        def place(share: float) -> Attempt:
            guess = problem.under(low, low.factors.mixed(share, high.factors))
            if start != end:
                guess = self.through([low, high], guess)
            else:
                guess = guess.with_values((1 - share) * low.values + share * high.values)
            return self.solver.solve(problem.imposed(guess), None, tolerance, patient)

        return place

    def solve(self, factors: Mapping[str, float], judge: Judge = trusting) -> Attempt:
        """Solve at new factors, starting from the extrapolation; if this fails, by a tangent step.

        Parameters
        ----------
        factors
            The new factors.
        judge
            Accepts or refuses a solution; one that is refused from the extrapolation is tried
            again by a tangent step.
        """
        problem, last = self.problem, self.known[-1]
        guess = self.extrapolated(factors)
        if guess is not None:
            guess = landed(problem, last, guess)
            start = problem.imposed(guess)
            if self.solver.admits(start, last):
                attempt = judge(self.solver.solve(start), guess)
                if attempt.converged:
                    return attempt
        return judge(self.solver.solve(last, factors), guess)

    def extrapolated(self, factors: Mapping[str, float]) -> State | None:
        """The extrapolation of the known states to other factors; None if only one is known.

        The fixed values are extrapolated as well.
        """
        if len(self.known) < 2:
            return None
        return self.through(self.known, self.problem.under(self.known[-1], factors))

    def through(self, known: Sequence[State], target: State) -> State:
        """The polynomial through states at different factors, at the load of another state."""
        factor = target.factors[self.name]
        at = np.array([s.factors[self.name] for s in known])
        states = [s.values for s in known]
        by_factor = lagrange_weights(at, factor)
        guess = sum(c * s for c, s in zip(by_factor, states, strict=True))
        if self.even:
            squares = at**2
            if len(np.unique(squares)) == len(squares):
                by_square = lagrange_weights(squares, factor**2)
                even = sum(c * s for c, s in zip(by_square, states, strict=True))
                guess = np.where(self._odd, guess, even)
        return target.with_values(np.asarray(guess))
