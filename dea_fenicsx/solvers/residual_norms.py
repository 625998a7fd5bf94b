"""What a residual is measured against: the forces, charges and volumes that balance in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.problem import Problem

SMALL = 1e-2
"""Share of the softest dielectric's modulus that counts as a small stress."""

ROUNDING = 1e-3
"""The same for a region's own modulus, for the sake of rounding there."""


ROUND_OFF = 100 * np.finfo(float).eps
"""Share of the charges of a disordered potential that rounding may leave unbalanced.

A potential is a number of relative precision eps, and differences between neighbouring nodes of
one cell are what makes charges.  So no state can be nearer to balance than some eps times the
charges that the same potential would bring if it changed its sign from node to node.  Measured
where all electrodes are at one potential, in cells of side ratios from 1 to 5000: 0.1 to 20 eps.
"""


@dataclass(frozen=True)
class _Group:
    """Fields whose residuals are taken together: the first of them, and where they lie."""

    name: str
    field: Field
    owned: np.ndarray
    free: np.ndarray

    @property
    def role(self) -> Role:
        return self.field.role


class References:
    """References of each field's residual.

    For u the largest of: reactions; loads; the forces of pressure and field, which is what balances
    in a film that is free all around; and those of small stresses, since a small load is not
    resolved below what rounding leaves of stresses of the modulus's size.  For phi the charges, for
    p a volume.  Where all electrodes are at one potential no charges flow, and there is nothing to
    compare with: so what rounding leaves of the potential counts as 0.

    What accepted states held is remembered, so that a small step is not held to a stricter test
    than a large one; the huge reactions of a failed trial are not, which would loosen the test of
    all later steps.

    Parameters
    ----------
    problem
        The problem.

    Attributes
    ----------
    sizes
        For u and phi the largest reference of any accepted state so far, dimensionless.
    volume
        Reference of the p rows, which hold int q (J - 1) dX: the size of int |q| dX.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        multipliers = problem.roles.count(Role.MULTIPLIER)
        self.volume = problem.forms.volume / np.sqrt(max(multipliers, 1))
        self._groups = [
            _Group(name, fields[0], *problem.roles.of_group(name))
            for name, fields in problem.roles.groups.items()
        ]
        self.sizes = {g.name: self._moduli() for g in self._groups if g.role is Role.MOTION}
        self._disorder = self._charges_of_disorder()
        self._loads: tuple[dict[str, float], float] = ({}, 0.0)

    def norms(self, residual: np.ndarray) -> dict[str, float]:
        """2-norm of each field's unbalanced rows relative to its reference.  Collective."""
        out = {}
        for group, everything, mine in self._rows(residual):
            reference = max(self.sizes.get(group.name, 0.0), everything)
            if group.role is Role.MULTIPLIER:
                reference = self.volume
            elif group.role is Role.MOTION:
                reference = max(reference, self._load_size())
            elif group.role is Role.POTENTIAL:
                mine = max(mine - self._rounding(), 0.0)
            else:
                reference = group.field.residual_scale
            out[group.name] = mine / reference if reference > 0 else np.inf if mine else 0.0
        return out

    def remember(self, residual: np.ndarray) -> None:
        """Keep what balances in the present state, whose residual this is.  Collective."""
        forces = max(self._load_size(anew=True), self._pressing(residual))
        for group, everything, _ in self._rows(residual):
            if group.role in (Role.MOTION, Role.POTENTIAL):
                size = max(everything, forces) if group.role is Role.MOTION else everything
                self.sizes[group.name] = max(self.sizes.get(group.name, 0.0), size)
        self._disorder = self._charges_of_disorder()

    def _rounding(self) -> float:
        """Size of the charges that rounding of the present potential leaves.  Collective."""
        problem = self.problem
        assert problem.potential is not None
        size = float(np.max(np.abs(problem.w.x.array[problem.potential.dofs]), initial=0.0))
        return ROUND_OFF * self._disorder * problem.comm.allreduce(size, op=MPI.MAX)

    def _charges_of_disorder(self) -> float:
        """Size of the charges of a potential of size 1 without any order, as the body is now.

        It is a fast wave, which takes unlike values at neighbouring nodes.
        """
        problem = self.problem
        part = problem.potential
        if part is None:
            return 0.0
        here = problem.state
        values = here.values.copy()
        x = part.space.tabulate_dof_coordinates()
        values[part.dofs] = np.sin(1e6 * (x @ np.sqrt([1.0, 2.0, 3.0])))
        with problem.at(here.with_values(values)):
            residual = problem.residual()
        mine = float(np.sum(residual[problem.roles.owned(Role.POTENTIAL)] ** 2))
        return float(np.sqrt(problem.comm.allreduce(mine, op=MPI.SUM)))

    def _rows(self, residual: np.ndarray) -> list[tuple[_Group, float, float]]:
        """For each group of fields the size of all of its rows and of the unbalanced ones."""
        problem = self.problem
        free = problem.unbalanced(residual)
        sums = []
        for group in self._groups:
            sums += [np.sum(residual[group.owned] ** 2), np.sum(free[group.free] ** 2)]
        total = np.sqrt(problem.comm.allreduce(np.array(sums), op=MPI.SUM))
        return [
            (group, float(total[2 * k]), float(total[2 * k + 1]))
            for k, group in enumerate(self._groups)
        ]

    def _size_u(self, forces: np.ndarray) -> float:
        mine = float(np.sum(forces[self.problem.roles.owned(Role.MOTION)] ** 2))
        return float(np.sqrt(self.problem.comm.allreduce(mine, op=MPI.SUM)))

    def _load_size(self, anew: bool = False) -> float:
        """Forces of the loads, kept while the factors stay unless `anew` asks for this state's.

        A follower pressure's forces go with the state.
        """
        problem = self.problem
        now = {ramp: problem.factors[ramp] for ramp in problem.loads.factors}
        if not any(now.values()):
            return 0.0
        if anew or self._loads[0] != now:
            forces = problem.residual()
            with problem.at(problem.state.with_factors(dict.fromkeys(now, 0.0))):
                size = self._size_u(problem.residual() - forces)
            self._loads = (now, size if np.isfinite(size) else 0.0)
        return self._loads[1]

    def _pressing(self, residual: np.ndarray) -> float:
        """Forces of pressure and field in the present state."""
        problem = self.problem
        here = problem.state
        values = here.values.copy()
        for part in (problem.pressure, problem.potential):
            if part is not None:
                values[part.dofs] = 0.0
        with problem.at(here.with_values(values)):
            without = problem.residual()
        return self._size_u(residual - without)

    def _moduli(self) -> float:
        """Forces of small stresses: of pressures in the undeformed state."""
        problem = self.problem
        scene, part = problem.scene, problem.pressure
        moduli = np.zeros(len(part.dofs))
        for name, material in problem.parameters.materials.items():
            value = material.elastic.shear_modulus() / problem.scales.stress
            on = part.space.dofmap.list[scene.device.cells_of(name)].ravel()
            moduli[on] = np.maximum(moduli[on], value)
        here, sizes = problem.state, []
        for pressure in (np.full(len(moduli), SMALL), ROUNDING * moduli):
            values = problem.space.at_rest.copy()
            values[part.dofs] = pressure
            with problem.at(here.with_values(values)):
                problem.w.x.scatter_forward()
                sizes.append(self._size_u(problem.residual()))
        return max(sizes)
