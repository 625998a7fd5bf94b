"""Where each step of a ramp starts from, and whether its result still lies on the path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from dea_fenicsx.solver import AT_REST, Attempt, NewtonSolver
from dea_fenicsx.stability import Place

FASTER = 4.0
"""How much faster than in the step before the state may move with the load."""

WANDERING = 8
"""Newton iterations of a ramp's first step after which its result is looked into.

A state half-way that took more than that belongs as little to those on its two sides.
"""

ROUGH = 1e-3
"""Tolerance of the state half-way to such a result: it tells a path from a jump, no more."""


class Predictor:
    """Starts each step from an extrapolation of the states before it.

    Displacement and pressure are even in a voltage or charge, so for such a ramp they are
    extrapolated in its square; the potential is extrapolated in the voltage or charge itself.
    What lies between two states is interpolated alike.
    """

    def __init__(self, solver: NewtonSolver, names: tuple[str, ...]) -> None:
        self.solver = solver
        self.problem = solver.problem
        scene = self.problem.scene
        self.name = names[0]
        self.even = all(scene.is_electric(n) for n in names)
        self.known: list[tuple[float, np.ndarray]] = []
        self._factors: dict[str, float] = {}  # of the last one
        self._phi = np.zeros(self.problem.size, dtype=bool)
        if self.problem.potential is not None:
            self._phi[self.problem.potential.dofs] = True

    def add(self, factors: dict[str, float]) -> None:
        """Remember the problem's state as that of a ramp's factors."""
        self._factors, factor = factors, factors[self.name]
        # a ramp to the present value comes by the same factor twice: no polynomial takes both
        others = [known for known in self.known if known[0] != factor]
        self.known = [*others[-2:], (factor, self.problem.get_state())]

    def _moved(self, since: np.ndarray, now: np.ndarray) -> float:
        """Largest change of displacement between two states.  Collective."""
        dofs = self.problem.fields["u"]
        move = float(np.max(np.abs(now[dofs] - since[dofs]), initial=0.0))
        return self.problem.comm.allreduce(move, op=MPI.MAX)

    def _speed(self, factor: float, since: tuple[float, np.ndarray], now: np.ndarray) -> float:
        """Largest change of displacement since a state, per change of the load's coordinate."""
        span = abs(factor**2 - since[0] ** 2) if self.even else abs(factor - since[0])
        return self._moved(since[1], now) / span if span else 0.0

    def _judge(self, factors: dict[str, float], attempt: Attempt) -> Attempt:
        """Refuse a converged state that does not continue the path but lies on another branch.

        Towards a limit point the speed of a smooth path grows like an inverse square root, by a
        factor of at most 2.4 when a step lands right on it.  A device that is held everywhere does
        not move but for rounding, and that jumps as it likes.
        """
        if not attempt.converged:
            return attempt
        factor, now = factors[self.name], self.problem.get_state()
        if self._moved(self.known[-1][1], now) < AT_REST:
            return attempt
        if len(self.known) == 1:
            far = attempt.iterations > WANDERING and not self._led_to(factors, now)
        else:
            usual = self._speed(self.known[-1][0], self.known[-2], self.known[-1][1])
            far = self._speed(factor, self.known[-1], now) > FASTER * usual > 0
        return replace(attempt, reason="jumped") if far else attempt

    def _led_to(self, factors: dict[str, float], end: np.ndarray) -> bool:
        """Whether a state half-way shows that a path leads to `end` from the only known state.

        Newton, started between the two, must find it at once, and the second half may not be passed
        much faster than the first.  That costs less than what it spares: two steps of half the
        length.
        """
        problem, before = self.problem, self.known[-1]
        low, high = before[0], factors[self.name]
        middle = ((low**2 + high**2) / 2) ** 0.5 if self.even else (low + high) / 2
        share = (middle - low) / (high - low) if high != low else 0.5
        attempt = self.between(self._factors, factors, ROUGH, patient=True)(share)
        found = problem.get_state()
        problem.set_factors(factors)
        problem.set_state(end)
        if not attempt.converged or attempt.iterations > WANDERING:
            return False
        halves = self._speed(middle, before, found), self._speed(high, (middle, found), end)
        return halves[1] <= FASTER * halves[0]

    def between(
        self,
        low: dict[str, float],
        high: dict[str, float],
        tolerance: float | None = None,
        patient: bool = False,
    ) -> Place:
        """How to find equilibria between the last accepted state and the present one.

        Parameters
        ----------
        low, high
            Factors of the two.
        tolerance, patient
            As of `NewtonSolver.solve`.
        """
        problem = self.problem
        a, b = self.known[-1][1], problem.get_state()
        start, end = low[self.name], high[self.name]

        def place(share: float) -> Attempt:
            mixed = {n: (1 - share) * low[n] + share * high[n] for n in low}
            problem.set_factors(mixed)
            guess = (1 - share) * a + share * b
            if start != end:
                guess = self._through([(start, a), (end, b)], mixed[self.name])
            problem.set_state(guess)
            problem.insert_fixed()
            return self.solver.solve(lift=False, tolerance=tolerance, patient=patient)

        return place

    def restore(self) -> None:
        """Put the last accepted state back."""
        self.problem.set_state(self.known[-1][1])

    def solve(self, factors: dict[str, float]) -> Attempt:
        """Solve at new factors: from the extrapolation, else by a tangent step."""
        problem = self.problem
        problem.set_factors(factors)
        if len(self.known) > 1:
            problem.set_state(self._through(self.known, factors[self.name]))
            problem.insert_fixed()
            if problem.probe().admissible:
                attempt = self._judge(factors, self.solver.solve(lift=False))
                if attempt.converged:
                    return attempt
            self.restore()
        return self._judge(factors, self.solver.solve(lift=True))

    def _through(self, known: list[tuple[float, np.ndarray]], factor: float) -> np.ndarray:
        """The polynomial through states at different factors, at a factor."""
        at = np.array([f for f, _ in known])
        states = [s for _, s in known]
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
