"""Where each step of a ramp starts from: the polynomial through the states before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.path.stability import Place
from dea_fenicsx.solvers.newton import Attempt, NewtonSolver


@dataclass(frozen=True)
class Known:
    """An equilibrium: the factors of all ramps, and all local values of the mixed function."""

    factors: dict[str, float]
    state: np.ndarray


Judge = Callable[[dict[str, float], Attempt, np.ndarray | None], Attempt]
"""Accepts or refuses a solution, given its factors, the attempt, and the extrapolation to it.

The extrapolation is None where only one state is known.
"""


def trusting(factors: dict[str, float], attempt: Attempt, guess: np.ndarray | None) -> Attempt:
    """A judge that accepts everything that has converged."""
    return attempt


class Predictor:
    """Starts each step from an extrapolation of the states before it.

    Displacement and pressure are even in a voltage or charge, so for such a ramp they are
    extrapolated in its square; the potential is extrapolated in the voltage or charge itself.
    What lies between two states is interpolated alike.

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
        self.known: list[Known] = []
        self._phi = np.zeros(self.problem.size, dtype=bool)
        if self.problem.potential is not None:
            self._phi[self.problem.potential.dofs] = True

    def add(self, factors: dict[str, float]) -> None:
        """Remember the problem's state as that of the ramps' factors."""
        new = Known(dict(factors), self.problem.get_state())
        # A ramp to the present value meets the same factor twice, which no polynomial can.
        others = [old for old in self.known if old.factors[self.name] != factors[self.name]]
        self.known = [*others[-2:], new]

    def coordinate(self, factors: dict[str, float]) -> float:
        """The load coordinate in which displacements are smooth: the factor or its square."""
        factor = factors[self.name]
        return factor**2 if self.even else factor

    def moved(self, since: np.ndarray, now: np.ndarray) -> float:
        """Largest change of displacement between two states, dimensionless.  Collective."""
        dofs = self.problem.fields["u"]
        move = float(np.max(np.abs(now[dofs] - since[dofs]), initial=0.0))
        return self.problem.comm.allreduce(move, op=MPI.MAX)

    def speed(self, first: Known, second: Known) -> float:
        """Largest change of displacement between two states per change of the load coordinate."""
        span = abs(self.coordinate(second.factors) - self.coordinate(first.factors))
        return self.moved(first.state, second.state) / span if span else 0.0

    def middle(self, first: Known, second: Known) -> float:
        """Share of the way at which the load coordinate is half-way between two states."""
        low, high = first.factors[self.name], second.factors[self.name]
        between = ((low**2 + high**2) / 2) ** 0.5 if self.even else (low + high) / 2
        if self.even and low + high < 0:
            between = -between
        share = (between - low) / (high - low) if high != low else 0.5
        return share if 0 < share < 1 else 0.5  # a voltage may pass through zero on the way

    def between(
        self,
        low: Known,
        high: Known,
        tolerance: float | None = None,
        patient: bool = False,
    ) -> Place:
        """How to find equilibria between two known ones.

        Parameters
        ----------
        low, high
            The two.
        tolerance, patient
            As of `NewtonSolver.solve`.
        """
        problem = self.problem
        start, end = low.factors[self.name], high.factors[self.name]

        def place(share: float) -> Attempt:
            mixed = {n: (1 - share) * f + share * high.factors[n] for n, f in low.factors.items()}
            problem.set_factors(mixed)
            guess = (1 - share) * low.state + share * high.state
            if start != end:
                guess = self.through([low, high], mixed)
            problem.set_state(guess)
            problem.insert_fixed()
            return self.solver.solve(lift=False, tolerance=tolerance, patient=patient)

        return place

    def restore(self) -> None:
        """Put the last accepted state back."""
        self.problem.set_state(self.known[-1].state)

    def solve(self, factors: dict[str, float], judge: Judge = trusting) -> Attempt:
        """Solve at new factors: from the extrapolation, else by a tangent step.

        Parameters
        ----------
        factors
            The new factors.
        judge
            Accepts or refuses a solution; one that is refused from the extrapolation is tried
            again by a tangent step.
        """
        problem = self.problem
        problem.set_factors(factors)
        guess = self.extrapolated(factors)
        if guess is not None:
            problem.set_state(guess)
            problem.insert_fixed()
            if problem.probe().admissible:
                attempt = judge(factors, self.solver.solve(lift=False), guess)
                if attempt.converged:
                    return attempt
            problem.set_factors(factors)
            self.restore()
        return judge(factors, self.solver.solve(lift=True), guess)

    def extrapolated(self, factors: dict[str, float]) -> np.ndarray | None:
        """The states before extrapolated to other factors; None where there is one state only."""
        if len(self.known) < 2:
            return None
        return self.through(self.known, factors)

    def through(self, known: list[Known], factors: dict[str, float]) -> np.ndarray:
        """The polynomial through states at different factors, at other factors."""
        factor = factors[self.name]
        at = np.array([k.factors[self.name] for k in known])
        states = [k.state for k in known]
        by_factor = _lagrange(at, factor)
        guess = sum(c * s for c, s in zip(by_factor, states, strict=True))
        if self.even:
            squares = at**2
            if len(np.unique(squares)) == len(squares):
                by_square = _lagrange(squares, factor**2)
                even = sum(c * s for c, s in zip(by_square, states, strict=True))
                guess = np.where(self._phi, guess, even)
        return np.asarray(guess)


def _lagrange(nodes: np.ndarray, x: float) -> np.ndarray:
    """Weights of the polynomial through values at `nodes`, at x."""
    others = [np.delete(nodes, k) for k in range(len(nodes))]
    return np.array([np.prod((x - o) / (n - o)) for n, o in zip(nodes, others, strict=True)])
