"""The size of a residual, relative to the forces, charges and volumes that balance in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI

from dea_fenicsx.materials.base import is_compressible
from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.problem import Problem

STRESS_BY_SOFTEST_MODULUS = 1e-2
"""Reference stress everywhere, in units of the shear modulus of the softest dielectric.

A stress of this size gives the smallest force with which a displacement residual is compared.
"""

REFERENCE_SWELLING = 1e-3
"""In foams the residual is compared with the forces that this volumetric strain would cause."""

STRESS_BY_OWN_MODULUS = 1e-3
"""Reference stress in each region, in units of its own shear modulus.

Rounding errors of stresses grow with the modulus of the region.
"""

CHARGE_ROUNDING = 100 * np.finfo(float).eps
"""Unbalanced charge that rounding may leave, as a share of the charges of a disordered potential.

A potential is stored with the relative precision eps, and charges come from differences of
potential between neighbouring nodes of a cell.  The largest charges belong to a potential that
changes its sign from node to node, so rounding leaves a few eps times these charges.  The measured
values are in docs/developers/solver.md, "Measured constants".
"""

POSITION_ROUNDING = 4 * np.finfo(float).eps
"""Rounding of a displacement, relative to itself, in steps of Newton's method that rest.

Displacements are stored with the relative precision eps, and each of the last increments is rounded
as well.
"""

FED_SHARE = 0.1
"""Share of the rows of a first step in time with a sheet resistance that counts as charges."""


@dataclass(frozen=True)
class _Group:
    """Fields whose residuals form one norm: the first of them, and their degrees of freedom."""

    name: str
    field: Field
    owned: np.ndarray
    free: np.ndarray

    @property
    def role(self) -> Role:
        return self.field.role


class References:
    """The reference with which the residual of each field is compared.

    The displacement residual is compared with the largest of four forces: the reactions, the
    applied loads, the forces of pressure and electric field (these balance one another in a film
    that is free all around), and the forces of a small reference stress.  The last keeps the test
    reachable when the loads are smaller than rounding errors.  The residual of phi is compared
    with the charges, that of p with a volume.  If all electrodes have the same potential, there are
    no charges to compare with, and the charges that rounding of the potential leaves count as 0.

    The references are the largest of all accepted states, so a small step has no stricter test
    than a large one.  The huge reactions of a failed trial are not kept, because they would loosen
    the test of all later steps.

    Parameters
    ----------
    problem
        The problem.

    Attributes
    ----------
    sizes
        For u and phi the largest reference of any accepted state so far, dimensionless.
    by_reactions
        References of the latest residual for fields that have them by their reactions.
    volume
        Reference of the rows of p, which hold int q (J - 1) dX.  It is the size of int |q| dX.
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
        self.by_reactions: dict[str, float] = {}
        self._charge_of_sheets = 0.0  # of a disordered potential, per s
        self._along: np.ndarray | None = None  # places of these nodes among the free unknowns
        if problem.forms.sheets:
            self._along = np.searchsorted(problem.free, problem.conditions.sheet_nodes)
        self._disorder = self._charges_of_disorder()
        self._loads: tuple[dict[str, float], float] = ({}, 0.0)

    def norms(self, residual: np.ndarray, anew: bool = False) -> dict[str, float]:
        """2-norm of each field's unbalanced rows relative to its reference.  Collective.

        With `anew` the forces of loads that depend on the state are those of this very state.
        """
        anew = anew and bool(self.problem.loads.changing)
        out = {}
        self.by_reactions = {}
        for group, everything, mine in self._rows(residual):
            reference = max(self.sizes.get(group.name, 0.0), everything)
            if group.role is Role.MULTIPLIER:
                reference = self.volume
            elif group.role is Role.MOTION:
                reference = max(reference, self._load_size(anew))
            elif group.role is Role.POTENTIAL:
                mine = max(mine - self._rounding(), self._along_sheets(residual), 0.0)
                if self._along is not None and self.problem.forms.sheets.seconds:
                    # The rows of a feeding place hold the current through it as well.
                    reference = self.sizes.get(group.name) or FED_SHARE * everything
            else:
                reference = group.field.residual_scale
                if group.field.by_reactions:
                    reference = max(reference, everything)
                    self.by_reactions[group.name] = reference
            out[group.name] = mine / reference if reference > 0 else np.inf if mine else 0.0
        return out

    def weights(self) -> np.ndarray | None:
        """Weights that make the free rows of the tangent comparable (owned); None for all 1.

        Rows of a field whose forces may be many times those of the motion count relative to these.
        """
        known = {name: size for name, size in self.by_reactions.items() if 0 < size < np.inf}
        if not known:
            return None
        found = np.ones(len(self.problem.free))
        for name, size in known.items():
            found[self.problem.roles.of_group(name)[1]] = max(self.sizes.values()) / size
        return found

    def remember(self, residual: np.ndarray) -> None:
        """Enlarge the references to the forces and charges of the present, accepted state.

        `residual` is the residual of this state.  Collective.
        """
        forces = max(self._load_size(anew=True), self._pressing(residual))
        for group, everything, _ in self._rows(residual):
            if group.role in (Role.MOTION, Role.POTENTIAL):
                size = max(everything, forces) if group.role is Role.MOTION else everything
                self.sizes[group.name] = max(self.sizes.get(group.name, 0.0), size)
        self._disorder = self._charges_of_disorder()

    def allow_for_rounding(self, residual: np.ndarray, tolerance: float) -> None:
        """Enlarge the reference of the motion if rounding alone leaves more than the tolerance.

        Where cells are thin or chains nearly stretched out, the displacements that can be stored
        next to an equilibrium have unbalanced forces of their own.  Collective.

        Parameters
        ----------
        residual
            The residual of the present state.
        tolerance
            Newton's tolerance.
        """
        problem, here = self.problem, self.problem.state
        values = here.values.copy()
        for axis, part in enumerate(problem.displacement):
            x = part.space.tabulate_dof_coordinates()
            # A wave so short that neighbouring nodes have unrelated values.
            wave = np.sin(1e6 * (x @ np.sqrt([1.0, 2.0, 3.0])) + axis)
            values[part.dofs] *= 1 + POSITION_ROUNDING * wave
        with problem.at(here.with_values(values)):
            change = problem.restrict(problem.residual() - residual)
        for group in self._groups:
            if group.role is Role.MOTION:
                size = self._norm(change[group.free]) / tolerance
                self.sizes[group.name] = max(self.sizes.get(group.name, 0.0), size)

    def _rounding(self) -> float:
        """Unbalanced charge that rounding of the present potential may leave.  Collective."""
        problem = self.problem
        assert problem.potential is not None
        size = float(np.max(np.abs(problem.w.x.array[problem.potential.dofs]), initial=0.0))
        return CHARGE_ROUNDING * self._disorder * problem.comm.allreduce(size, op=MPI.MAX)

    def _along_sheets(self, residual: np.ndarray) -> float:
        """Unbalanced charge of electrodes with a sheet resistance, beyond rounding.  Collective.

        Along a good conductor the smallest difference of potential that can be stored moves much
        charge, so that its rows have a test of their own.
        """
        if self._along is None:
            return 0.0
        sheets, psi = self.problem.forms.sheets, self.problem.forms.leaks.psi
        mine = psi * self._norm(self.problem.unbalanced(residual)[self._along])
        charge = sheets.seconds * self._charge_of_sheets / self._disorder if self._disorder else 0.0
        return mine - self._rounding() * (1 + psi * charge)

    def _charges_of_disorder(self) -> float:
        """Charges of a disordered potential of size 1 in the present state of the body.

        The potential is a wave so short that neighbouring nodes have unrelated values.
        """
        problem = self.problem
        part = problem.potential
        if part is None:
            return 0.0
        rows = problem.roles.owned(Role.POTENTIAL)
        here = problem.state
        values = here.values.copy()
        values[part.dofs] = self._wave
        with problem.at(here.with_values(values)):
            residual = problem.residual()[rows]
            if problem.forms.sheets:
                with problem.forms.sheets.longer(1.0):
                    more = problem.residual()[rows] - residual
                self._charge_of_sheets = self._norm(more)
        return self._norm(residual)

    @cached_property
    def _wave(self) -> np.ndarray:
        """The disordered potential at its nodes."""
        part = self.problem.potential
        assert part is not None
        x = part.space.tabulate_dof_coordinates()
        return np.asarray(np.sin(1e6 * (x @ np.sqrt([1.0, 2.0, 3.0]))))

    def _norm(self, mine: np.ndarray) -> float:
        """The 2-norm of a vector over all ranks.  Collective."""
        return float(np.sqrt(self.problem.comm.allreduce(float(mine @ mine), op=MPI.SUM)))

    def _rows(self, residual: np.ndarray) -> list[tuple[_Group, float, float]]:
        """For each group of fields the size of all of its rows and of the unbalanced ones."""
        problem = self.problem
        free = problem.unbalanced(residual)
        sums = []
        for group in self._groups:
            rows = free[group.free]
            if group.role is Role.POTENTIAL and self._along is not None:
                rows = free[np.setdiff1d(group.free, self._along)]
            everything = residual[group.owned]
            sums += [everything @ everything, rows @ rows]
        squares = np.array(sums)
        if problem.comm.size > 1:
            squares = problem.comm.allreduce(squares, op=MPI.SUM)
        total = np.sqrt(squares)
        found = []
        for k, group in enumerate(self._groups):
            # Where charge leaks, the rows of the potential are charges over psi.
            unit = problem.forms.leaks.psi if group.role is Role.POTENTIAL else 1.0
            found.append((group, unit * float(total[2 * k]), unit * float(total[2 * k + 1])))
        return found

    def _size_u(self, forces: np.ndarray) -> float:
        return self._norm(forces[self.problem.roles.owned(Role.MOTION)])

    def _load_size(self, anew: bool = False) -> float:
        """Norm of the forces of the loads, dimensionless.

        It is computed again if the load factors have changed, or if `anew` is true: the forces of
        a follower pressure depend on the state as well.
        """
        problem = self.problem
        # Without its factor an obstacle would lie elsewhere, and its force would be no load.
        moving = {ramp for ramp, _ in problem.loads.travels}
        now = {r: problem.factors[r] for r in problem.loads.factors if r not in moving}
        if not any(now.values()):
            return 0.0
        if anew or self._loads[0] != now:
            forces = problem.residual()
            with problem.at(problem.state.with_factors(dict.fromkeys(now, 0.0))):
                size = self._size_u(problem.residual() - forces)
            self._loads = (now, size if np.isfinite(size) else 0.0)
        return self._loads[1]

    def _pressing(self, residual: np.ndarray) -> float:
        """Forces of pressure, field and contact in the present state."""
        problem = self.problem
        here = problem.state
        values = here.values.copy()
        fields = [name for contact in problem.forms.contacts for name in contact.fields]
        parts = [problem.space.parts[name] for name in fields]
        pressing = [part for found in parts for part in found.values()]
        for part in (problem.pressure, problem.potential, *pressing):
            if part is not None:
                values[part.dofs] = 0.0
        with problem.at(here.with_values(values)):
            without = problem.residual()
        return self._size_u(residual - without)

    def _moduli(self) -> float:
        """Norm of the forces of the reference stresses, as pressures in the undeformed state."""
        problem = self.problem
        scene, part = problem.scene, problem.pressure
        moduli = np.zeros(len(part.dofs))
        for name in scene.solids:
            material = problem.parameters.materials[name]
            value = material.elastic.shear_modulus() / problem.scales.stress
            on = part.space.dofmap.list[scene.device.cells_of(name)].ravel()
            moduli[on] = np.maximum(moduli[on], value)
        here, sizes = problem.state, []
        everywhere = np.full(len(moduli), STRESS_BY_SOFTEST_MODULUS)
        for pressure in (everywhere, STRESS_BY_OWN_MODULUS * moduli):
            values = problem.rest.values.copy()
            values[part.dofs] = pressure
            with problem.at(here.with_values(values)):
                problem.w.x.scatter_forward()
                sizes.append(self._size_u(problem.residual()))
        if any(is_compressible(m.elastic) for m in scene.solids.values()):
            sizes.append(self._swollen())
        return max(sizes)

    def _swollen(self) -> float:
        """Norm of the forces of a small swelling; a foam has no pressure that would tell them."""
        problem, kinematics = self.problem, self.problem.scene.kinematics
        values = problem.rest.values.copy()
        for name, part in zip(kinematics.axes, problem.displacement, strict=True):
            column = kinematics.coordinates.find(name)
            if column >= 0:
                x = part.space.tabulate_dof_coordinates()
                values[part.dofs] = REFERENCE_SWELLING * x[:, column]
        with problem.at(problem.state.with_values(values)):
            problem.w.x.scatter_forward()
            return self._size_u(problem.residual())
