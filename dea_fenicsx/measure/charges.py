"""Charges on electrodes, and the charges by a voltage while the deformation is frozen.

The charge of an electrode is the quantity that does work with its voltage,

    Q = -dPi/dV = int eps J^-1 (cof F Grad phi) . (cof F Grad N) dX,

where N is the profile of the electrode: the potential divided by its voltage at its own nodes, and
0 at all others.  On an ordinary electrode N is 1, so Q is the sum of the residual over its nodes,
which is the whole charge.

Where nodes belong to two electrodes, their charge is counted once:

- A thin film's charge comes from the film's own cells alone.
- Ordinary electrodes that touch share the charge of their common nodes alike.
- An ordinary electrode on a face of a thin film is one conductor with that face, and holds its
  charge, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.neighbours import regions_beside
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.tied_unknowns import columns, expansion
from dea_fenicsx.scene.electrode_places import joined_ends, with_far_ends
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.kinematics import cofactor
from dea_fenicsx.solvers.factors import AMF, Mumps
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import SolverError


class ElectrodeCharge:
    """The charge of one electrode in a given potential, at the problem's present deformation.

    Parameters
    ----------
    problem
        The problem.
    electrode
        One of its scene's electrodes.
    rate
        A coefficient in 1/s by which the displacement is multiplied; the result is then in A.
    """

    def __init__(self, problem: Problem, electrode: Conducting, rate: Any = 1) -> None:
        self.problem = problem
        assert problem.potential is not None
        self._phi = dolfinx.fem.Function(problem.potential.space)
        self._profile = shape = _profile_of(problem, electrode)
        self._cells = cells = _cells_of(problem, electrode, shape.x.array)
        self._form = compat.compile_form(_flux(problem, cells, self._phi, shape, rate))
        linear = all(k.electric is None or k.electric.is_linear for k in problem.kernels)
        self._whole = None if linear else compat.compile_form(self.form())
        late = _delayed_flux(problem, cells, shape) if rate == 1 else 0
        self._late = compat.compile_form(late) if late != 0 else None

    def of_state(self) -> float:
        """In C, in the present state, delayed polarisations included.  Collective."""
        assert self.problem.potential is not None
        if self._whole is None:
            found = self.of(self.problem.w.x.array[self.problem.potential.dofs])
        else:
            mine = float(np.real(dolfinx.fem.assemble_scalar(self._whole)))
            found = self.problem.comm.allreduce(mine, op=MPI.SUM) * self.problem.scales.charge
        if self._late is None:
            return found
        mine = float(np.real(dolfinx.fem.assemble_scalar(self._late)))
        return found + self.problem.comm.allreduce(mine, op=MPI.SUM) * self.problem.scales.charge

    def form(self) -> Any:
        """The form of the charge in the state's own potential, dimensionless, symbolic."""
        phi = self.problem.space.symbolic(Role.POTENTIAL, self.problem.w)
        return _flux(self.problem, self._cells, phi, self._profile, whole=True)

    def of(self, potential: np.ndarray) -> float:
        """In C, in a potential by its local values, ghosts included, dimensionless.  Collective."""
        self._phi.x.array[:] = potential
        mine = float(np.real(dolfinx.fem.assemble_scalar(self._form)))
        return self.problem.comm.allreduce(mine, op=MPI.SUM) * self.problem.scales.charge


def potential_of_unit_load(
    problem: Problem, electrode: Conducting
) -> np.ndarray:
    """The potential that the electrode's ramp adds at factor 1 if nothing moves.  Collective.

    Other ramps are at 0.  For a charged electrode whose given charge is 0, it is the potential of a
    unit of charge.  We solve K psi = source for the free unknowns of the potential, where psi has
    the given values on electrodes.

    Returns
    -------
    ndarray
        Local values of the potential's own space, ghosts included, dimensionless.

    Raises
    ------
    SolverError
        If MUMPS cannot factorise K.
    """
    part = problem.potential
    assert part is not None
    given = dolfinx.fem.Function(part.space)
    if electrode.floats and not electrode.given_coulombs:
        source = _unit_charge(problem, electrode)
    else:
        source = _charges_of_ramp(problem, electrode.ramp)
        given.x.array[:] = problem.conditions.fixed_values.base[electrode.ramp][part.dofs]
    owned = part.space.dofmap.index_map.size_local
    K = _stiffness(problem)
    P = _expansion_of_potential(problem, owned)
    few, rest = P.createVecs()
    rest.array[:] = given.x.array[:owned]
    product = rest.duplicate()
    K.mult(rest, product)
    P.multTranspose(product, few)
    few.array[:] = source - few.array_r
    if problem.roles.count(Role.POTENTIAL):
        _solve(problem, K.ptap(P), few)
        P.multAdd(few, rest, rest)
    given.x.array[:owned] = rest.array_r
    given.x.scatter_forward()
    for thing in (K, P, few, rest, product):
        thing.destroy()
    return given.x.array.copy()


def _charges_of_ramp(problem: Problem, ramp: str) -> np.ndarray:
    """Charges of a ramp at factor 1, in the free rows of the potential."""
    rows = np.zeros(len(problem.free))
    problem.add_sources(rows, ramp, 1.0)
    return rows[problem.roles.free(Role.POTENTIAL)]


def _unit_charge(problem: Problem, electrode: Conducting) -> np.ndarray:
    """A unit of charge on a floating electrode, in the free rows of the potential."""
    rows = np.zeros(len(problem.free))
    floating: list[Conducting] = [e for e in problem.scene.electrodes if e.floats]
    master = problem.conditions.groups[floating.index(electrode)].master
    if master >= 0:
        rows[np.searchsorted(problem.free, master)] = 1.0
    return rows[problem.roles.free(Role.POTENTIAL)]


def _solve(problem: Problem, matrix: Any, vector: Any) -> None:
    """Solve in place, and destroy the matrix.

    The potential of a dielectric that no electrode touches is not determined.  MUMPS detects the
    null pivots and sets these unknowns to 0, which changes no charge.
    """
    factor = Mumps(matrix, {24: 1, 7: AMF}, {})
    if not factor.make():
        raise SolverError(
            "MUMPS could not factorise the potential's stiffness for the capacitance at 0 V."
        )
    solution = vector.duplicate()
    factor.pc.apply(vector, solution)
    vector.array[:] = solution.array_r
    solution.destroy()
    factor.release()


def _expansion_of_potential(problem: Problem, owned: int) -> Any:
    """Matrix from the potential's free unknowns to all of its owned degrees of freedom."""
    part, whole = problem.potential, problem.expansion
    assert part is not None
    own = whole is None
    if own:
        rows = problem.space.rows
        whole = expansion(columns(problem.free, [], None, rows), len(problem.free), rows)
        whole.assemble()
    first = problem.comm.exscan(len(problem.free)) or 0
    mine = part.dofs[:owned].astype(PETSc.IntType) + problem.space.rows.start
    unknowns = problem.roles.free(Role.POTENTIAL).astype(PETSc.IntType) + first
    sets = [PETSc.IS().createGeneral(n, comm=problem.comm) for n in (mine, unknowns)]
    made = whole.createSubMatrix(*sets)
    for thing in (*sets, *([whole] if own else [])):
        thing.destroy()
    return made


def _stiffness(problem: Problem) -> Any:
    """The matrix K of the potential, all of its nodes included."""
    part = problem.potential
    assert part is not None
    everywhere = [k.cells for k in problem.kernels if k.eps is not None]
    a, b = ufl.TrialFunction(part.space), ufl.TestFunction(part.space)
    form = compat.compile_form(_flux(problem, everywhere, a, b))
    matrix = dolfinx.fem.petsc.create_matrix(form)
    dolfinx.fem.petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    return matrix


def _flux(
    problem: Problem, cells: list[np.ndarray], a: Any, b: Any, rate: Any = 1, whole: bool = False
) -> Any:
    """The form int eps J^-1 (cof F Grad a) . (cof F Grad b) dX over cells of each dielectric.

    In a dielectric whose permittivity changes with strain or field it is - int D(a) . Grad b dX;
    where D is not proportional to the field, D is the change of the displacement with a, or with
    `whole` the displacement itself, and a is the present potential.  The integrand is multiplied
    by `rate`.
    """
    scene, helix = problem.scene, problem.forms.motion
    kinematics = scene.kinematics
    x = ufl.SpatialCoordinate(problem.mesh)
    u = problem.space.symbolic(Role.MOTION, problem.w)
    cof, J = cofactor(ufl.Identity(3) + kinematics.displacement_gradient(u, x, helix))
    first, second = (ufl.dot(cof, kinematics.gradient(f, x, helix)) for f in (a, b))
    density = rate * ufl.dot(first, second) / J * kinematics.weight(x)
    dx = measure(scene.device, cells, scene.elements.quadrature_degree)
    points = [p for p in problem.forms.points if p.kernel.eps is not None]
    if kinematics.wrinkles:
        return sum(p.kernel.eps * p.widening * density * dx(i) for i, p in enumerate(points))

    def integrand(p: Any) -> Any:
        if p.kernel.electric.is_ideal:
            return p.heated.permittivity * p.kernel.eps * density
        displaced = p.displacement_field if whole else p.displacement_of(a)
        gradient = kinematics.gradient(b, x, helix)
        return -rate * ufl.dot(displaced, gradient) * kinematics.weight(x)

    return sum(integrand(p) * dx(i) for i, p in enumerate(points))


def _delayed_flux(problem: Problem, cells: list[np.ndarray], shape: Any) -> Any:
    """The flux - int P . Grad N dX of the delayed polarisations, over cells of each dielectric."""
    scene, x = problem.scene, ufl.SpatialCoordinate(problem.mesh)
    gradient = scene.kinematics.gradient(shape, x, problem.forms.motion)
    weight = scene.kinematics.weight(x)
    dx = measure(scene.device, cells, scene.elements.quadrature_degree)
    points = [p for p in problem.forms.points if p.kernel.eps is not None]
    return sum(
        -ufl.dot(p.polarisation(term), gradient) * weight * dx(i)
        for i, p in enumerate(points) for term in p.kernel.relaxation
    )  # fmt: skip


def _profile_of(problem: Problem, electrode: Conducting) -> Any:
    """The profile N of an electrode as a function.

    At a node of several ordinary electrodes, each of them gets an equal share.
    """
    scene, part = problem.scene, problem.potential
    assert part is not None
    here = _nodes_of(problem, electrode)
    X = part.space.tabulate_dof_coordinates() * scene.device.length
    values = np.where(here, electrode.profile(scene.kinematics, X), 0.0)
    if not electrode.fills_region:
        ordinary = [e for e in scene.electrodes if not e.fills_region]
        count = sum(_nodes_of(problem, e).astype(int) for e in ordinary)
        values /= np.maximum(count, 1)
    shape = dolfinx.fem.Function(part.space)
    shape.x.array[:] = values
    shape.x.scatter_forward()
    return shape


def _nodes_of(problem: Problem, electrode: Conducting) -> np.ndarray:
    """Mask of an electrode's nodes over the local degrees of freedom of the potential."""
    part = problem.potential
    assert part is not None
    on = np.zeros(problem.size, dtype=bool)
    on[problem.conditions.electrode_dofs[electrode.label]] = True
    return on[part.dofs]


def _cells_of(
    problem: Problem, electrode: Conducting, values: np.ndarray
) -> list[np.ndarray]:
    """Owned cells of each dielectric kernel whose field counts for an electrode, by its profile."""
    scene, part = problem.scene, problem.potential
    assert part is not None
    device = scene.device
    films = [e for e in scene.electrodes if e.fills_region]
    if electrode.fills_region:
        counted = set(electrode.names)
    else:
        names = with_far_ends(device, electrode.names, joined_ends(scene))
        beside = regions_beside(device, names) if films else set()
        elsewhere = {name for film in films for name in film.names} - beside
        counted = set(device.regions) - elsewhere
    mine = np.concatenate([device.cells_of(name) for name in sorted(counted)])
    table = part.space.dofmap.list
    found = []
    for kernel in problem.kernels:
        if kernel.eps is None:
            continue
        cells = np.intersect1d(kernel.cells, mine)
        found.append(cells[np.any(values[table[cells]] != 0, axis=1)])
    return found
