"""The answer of a device to a small sinusoidal load about an equilibrium.

With the load factor f0 + Re(f exp(i omega t)) the unknowns are x0 + Re(x exp(i omega t)), where

    [K(omega) - omega^2 M] x = -f dR/df.

About a state in which Maxwell branches are relaxed, their viscous strains follow a small change of
the strain by 1/(1 + i omega tau) of it.  So K is the stiffness without them, plus what each has
when its viscous strains stay as they are, times i omega tau/(1 + i omega tau).  Each part is
assembled with the branches of one relaxation time instantaneous, and all others relaxed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.materials import Maxwell
from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.measure.vibration import carried_by_rigid, change_of_values, check_rest
from dea_fenicsx.model.memory import INFINITE_STEP
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_shapes import rigid_shapes
from dea_fenicsx.model.state import State
from dea_fenicsx.solvers.complex_systems import ComplexSystem
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import InputError

HARMONIC_COMPRESSIBILITY = 1e-10
"""Compressibility mu/kappa that determines a pressure which nothing else does."""

UNKNOWN_STEP = 1e-5
"""Largest change of an unknown by which an observable is differentiated, dimensionless."""


@dataclass(frozen=True)
class Answer:
    """The complex answer to a ramp at one frequency, for a factor of amplitude 1.

    Attributes
    ----------
    values
        The change of all local values of the mixed function.
    weights
        Complex weight of each configuration of the viscous branches in K.
    omega
        Angular frequency in 1/s.
    """

    values: np.ndarray
    weights: np.ndarray
    omega: float


class Harmonic:
    """The linearised device at the present state of a problem.

    Parameters
    ----------
    solver
        The solver, whose problem is in equilibrium.
    ramp
        The ramp whose factor oscillates.

    Raises
    ------
    InputError
        If a region has no density, or the device has what does not answer so simply.
    SolverError
        If the state is no equilibrium with relaxed branches.
    """

    def __init__(self, solver: NewtonSolver, ramp: str) -> None:
        self.solver, self.problem, self.ramp = solver, solver.problem, ramp
        check_linear(self.problem)
        self.mass = self.problem.massive()
        self.times = self._relaxation_times()
        self.state = self._relaxed()
        with self.problem.at(self.state):
            check_rest(solver)
            rigid = rigid_shapes(self.problem)
            self.rigid, self.carried = rigid, carried_by_rigid(self.problem, rigid)
        self.heavy = self.mass.reduced(self.problem.free, self.problem.expansion)
        self.stiff: list[Any] = []
        self.pushes: list[np.ndarray] = []
        for k in range(1 + len(self.times)):
            with self.configured(k):
                self.stiff.append(solver.tangent.matrix(HARMONIC_COMPRESSIBILITY).copy())
                self.pushes.append(solver.tangent.by_load(ramp))
        with self.configured(0):
            self.mass.stiffness = 1.0
            self.dragged = solver.tangent.by_load(ramp) - self.pushes[0]

    def destroy(self) -> None:
        """Let the matrices go.  Collective."""
        for matrix in (self.heavy, *self.stiff):
            matrix.destroy()
        self.solver.forget_factor()

    def _relaxation_times(self) -> list[float]:
        """The relaxation times in s of all Maxwell branches, each once."""
        materials = self.problem.parameters.materials.values()
        found = {b.tau for m in materials for b in m.viscous if isinstance(b, Maxwell)}
        return sorted(tau for tau in found if math.isfinite(tau))

    def _relaxed(self) -> State:
        """The present state, with branches that follow at once."""
        problem = self.problem
        state, memory = problem.state, problem.forms.memory
        if not memory:
            return state
        history = problem.histories[memory.NAME].ahead(math.inf)
        return replace(state, history={**state.history, memory.NAME: history})

    @contextmanager
    def configured(self, number: int, change: State | None = None) -> Iterator[None]:
        """The state, or one near it, with the branches of one relaxation time instantaneous.

        Number 0 has none of them so, number k those of the k-th relaxation time.
        """
        problem = self.problem
        with problem.at(change or self.state):
            for kernel in problem.kernels:
                for branch in kernel.branches:
                    tau = branch.tau.x.array
                    rates = np.where((tau > 0) & np.isfinite(tau), 1 / np.where(tau > 0, tau, 1), 0)
                    branch.step.x.array[:] = INFINITE_STEP * rates
                    if number:
                        branch.step.x.array[tau == self.times[number - 1]] = 0.0
            yield

    def weights(self, omega: float) -> np.ndarray:
        """Complex weight of each configuration in K."""
        shares = [1j * omega * tau / (1 + 1j * omega * tau) for tau in self.times]
        return np.array([1 - sum(shares), *shares], dtype=complex)

    def answer(self, hertz: float) -> Answer:
        """The answer at a frequency.  Collective."""
        omega = 2 * math.pi * hertz
        weights = self.weights(omega)
        system = self._system(omega, weights)
        push = sum(w * p for w, p in zip(weights, self.pushes, strict=True))
        force = -(push - omega**2 * self.dragged)
        found = system.solve(force)
        if self.carried is not None:
            found = self._unheld(system, found, omega)
        system.destroy()
        return Answer(self._values(found), weights, omega)

    def _system(self, omega: float, weights: np.ndarray) -> ComplexSystem:
        same = self.heavy.Structure.DIFFERENT_NONZERO_PATTERN
        real = self.heavy.copy()
        real.scale(-(omega**2))
        for weight, stiff in zip(weights, self.stiff, strict=True):
            real.axpy(float(weight.real), stiff, same)
        imaginary = None
        if self.times and omega:
            imaginary = self.stiff[0].copy()
            imaginary.scale(float(weights[0].imag))
            for weight, stiff in zip(weights[1:], self.stiff[1:], strict=True):
                imaginary.axpy(float(weight.imag), stiff, same)
        return ComplexSystem(real, imaginary)

    def _unheld(self, system: ComplexSystem, found: np.ndarray, omega: float) -> np.ndarray:
        """The solution where a free body takes its rigid motions along without force.

        The mass is lessened by U U^T, which changes the system by a few ranks (Woodbury).
        """
        rows, comm = self.carried, self.problem.comm
        assert rows is not None
        through = np.stack([system.solve(column.astype(complex)) for column in rows.T], axis=1)
        inner = comm.allreduce(np.column_stack([rows.T @ through, rows.T @ found]))
        matrix = np.eye(rows.shape[1]) + omega**2 * inner[:, :-1]
        return np.asarray(found - omega**2 * through @ np.linalg.solve(matrix, inner[:, -1]))

    def _values(self, found: np.ndarray) -> np.ndarray:
        """An answer of the free unknowns as a change of all local values.  Collective."""
        problem = self.problem
        with problem.at(self.state):
            values = change_of_values(problem, found.real) + 1j * change_of_values(
                problem, found.imag
            )
        base = problem.conditions.fixed_values.base[self.ramp]
        fixed = problem.conditions.fixed_values.fixed
        values[fixed] = base[fixed]
        if self.rigid.shape[1]:
            values = self._without_momentum(values)
        return np.asarray(values)

    def _without_momentum(self, values: np.ndarray) -> np.ndarray:
        """A change of a free body from which rigid motions have taken the momentum.  Collective."""
        problem, comm, mine = self.problem, self.problem.comm, self.rigid[: self.problem.owned]
        heavy = np.stack([self.mass.times(column) for column in mine.T], axis=1)
        both = comm.allreduce(np.column_stack([mine.T @ heavy, heavy.T @ values[: problem.owned]]))
        return np.asarray(values - self.rigid @ np.linalg.solve(both[:, :-1], both[:, -1]))

    def derivative(self, measure: Measurement, answer: Answer) -> complex:
        """Complex amplitude of what is measured, for a factor of amplitude 1.  Collective."""
        return sum(
            (w * self._slope(measure, answer, k) for k, w in enumerate(answer.weights) if w), 0j
        )

    def _slope(self, measure: Measurement, answer: Answer, number: int) -> complex:
        """The same in one configuration, by differences along the real and imaginary parts."""
        problem, total = self.problem, 0j
        largest = float(np.max(np.abs(answer.values), initial=0.0))
        largest = max(problem.comm.allgather(largest)) or 1.0
        for part, unit, moves in ((answer.values.real, 1.0, True), (answer.values.imag, 1j, False)):
            ends = []
            for step in (UNKNOWN_STEP / largest, -UNKNOWN_STEP / largest):
                factors = self.state.factors
                if moves:
                    factors = factors | {self.ramp: factors[self.ramp] + step}
                near = replace(
                    self.state, values=self.state.values + step * part, factors=factors
                )
                with self.configured(number, near):
                    self.mass.stiffness = -(answer.omega**2)
                    ends.append(measure())
            total += unit * (ends[0] - ends[1]) * largest / (2 * UNKNOWN_STEP)
        return total


def check_linear(problem: Problem) -> None:
    """Raise InputError if a device has what does not answer by the equations of this file."""
    scene = problem.scene
    branches = [b for m in problem.parameters.materials.values() for b in m.viscous]
    what = None
    if any(not isinstance(b, Maxwell) for b in branches):
        what = "viscous branches that are no Maxwell ones"
    elif scene.leaks:
        what = "dielectrics that conduct or relax"
    elif problem.circuits or problem.forms.sheets:
        what = "sources with a resistance, switches or electrodes with a sheet resistance"
    if what:
        raise InputError(
            f"The frequency response is not available with {what}; leave them out of this scene."
        )

