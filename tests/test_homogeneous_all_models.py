"""Finite elements against the exact homogeneous state to 1e-8: every model, kinematics, cell.

A mesh of randomly displaced interior nodes must reproduce a homogeneous state exactly.  One kernel
serves all models: their sum, each with a weight that is a constant of the material; weights of 0
and 1 single one out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from dea_fenicsx.exact import Dead, Film, Held, trace
from dea_fenicsx.materials import (
    ArrudaBoyce,
    Gent,
    IdealDielectric,
    Material,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
)
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import Ramp
from dea_fenicsx.path.walk import Walk
from dea_fenicsx.scene.conditions import DeadLoad, Electrode, Fix, Ground, Stretch
from dea_fenicsx.scene.kinematics import Axisymmetric, PlaneStrain, ThreeD
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.solvers.tangent import Tangent
from dea_fenicsx.support import compat  # noqa: F401  (first, for the wheel's libraries)

import dolfinx  # isort: skip
from mpi4py import MPI  # isort: skip

pytestmark = pytest.mark.usefixtures("quick_compile")

MODELS = {
    "neo-Hookean": NeoHookean(5e4),
    "Mooney-Rivlin": MooneyRivlin(2e4, 3e3),
    "Yeoh": Yeoh(3e4, -200.0, 3.0),
    "Ogden": Ogden.from_eq76(9e4, 1.13),
    "Gent": Gent(5e4, 60.0),
    "Arruda-Boyce": ArrudaBoyce(4e4, 5.0),
}


@dataclass(frozen=True)
class Weighted:
    """Sum of all models of this test, each times its weight, with their constants as fields."""

    weights: tuple[float, ...]
    neo: tuple[float, ...] = (5e4,)
    mooney: tuple[float, ...] = (2e4, 3e3)
    yeoh: tuple[float, ...] = (3e4, -200.0, 3.0)
    ogden_mu: tuple[float, ...] = (9e4,)
    ogden_alpha: tuple[float, ...] = (1.13,)
    gent: tuple[float, ...] = (5e4, 60.0)
    boyce: tuple[float, ...] = (4e4, 5.0)

    def _models(self) -> list[Any]:
        return [
            NeoHookean(*self.neo),
            MooneyRivlin(*self.mooney),
            Yeoh(*self.yeoh),
            Ogden(self.ogden_mu, self.ogden_alpha),
            Gent(*self.gent),
            ArrudaBoyce(*self.boyce),
        ]

    def _sum(self, values: list[Any]) -> Any:
        return sum(w * v for w, v in zip(self.weights, values, strict=True))

    def energy(self, s: Any) -> Any:
        return self._sum([m.energy(s) for m in self._models()])

    def shear_modulus(self) -> float:
        return self._sum([m.shear_modulus() for m in self._models()])

    def spherical_slope(self) -> float:
        return self._sum([m.spherical_slope() for m in self._models()])

    def chain_margin(self, s: Any) -> Any:
        return self._models()[4].chain_margin(s)

    def faults(self) -> list[str]:
        return []


def single(name: str) -> Weighted:
    return Weighted(tuple(float(name == n) for n in MODELS))


def device(cell: str) -> Device:
    """A unit cube or square of 2 cells a side with displaced inner nodes; the field is along the
    last axis."""
    kind = getattr(dolfinx.mesh.CellType, cell)
    if cell in ("hexahedron", "tetrahedron"):
        mesh, names = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 2, 2, 2, kind), "xyz"
    else:
        mesh, names = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 2, 2, kind), "xy"
    d = len(names)
    x = mesh.geometry.x
    facets, values, surfaces = [], [], {}
    for a, axis in enumerate(names):
        for end in (0, 1):
            found = dolfinx.mesh.locate_entities_boundary(
                mesh, d - 1, lambda p, a=a, end=end: np.isclose(p[a], end)
            )
            surfaces[f"{axis}_{('min', 'max')[end]}"] = len(surfaces) + 1
            facets.append(found)
            values.append(np.full(len(found), len(surfaces)))
    order = np.argsort(np.concatenate(facets))
    facet_tags = dolfinx.mesh.meshtags(
        mesh, d - 1, np.concatenate(facets)[order].astype(np.int32),
        np.concatenate(values)[order].astype(np.int32),
    )  # fmt: skip
    shift = np.random.default_rng(3).uniform(-0.12, 0.12, x[:, :d].shape)
    inner = (x[:, :d] > 1e-12) & (x[:, :d] < 1 - 1e-12)
    x[:, :d] += np.where(inner, shift, 0.0)
    mesh.topology.create_connectivity(d, d)
    n = mesh.topology.index_map(d).size_local
    cells = dolfinx.mesh.meshtags(mesh, d, np.arange(n, dtype=np.int32), np.ones(n, np.int32))
    for dim in (d - 1, d):
        mesh.topology.create_connectivity(dim, d)
    mesh.topology.create_connectivity(d, d - 1)
    return Device(mesh, cells, facet_tags, {"film": 1}, surfaces, length=1e-3)


LOADS = {"dead loads and voltage": (2e4, 1e4, 5e3), "voltage alone": (0.0, 0.0, 15e3)}


def run(kinematics, cell, elastic, first, second, volts, held=None, bulk_modulus=None):
    """Load, then voltage; returns stretches along the axes, charge and the largest shear."""
    three = isinstance(kinematics, ThreeD)
    axes = kinematics.axes
    last = {"x": "y", "r": "y"}[axes[0]] if not three else "z"
    # loads of zero too, so that all cases share one kernel
    loads = [DeadLoad("x_max", (first, 0.0, 0.0) if three else (first, 0.0))]
    if three:
        loads.append(DeadLoad("y_max", (0.0, second, 0.0)))
    supports = [Fix("x_min", axes[0]), Fix(f"{last}_min", axes[-1])]
    if three:
        supports.append(Fix("y_min", "y"))
    scene = Scene(
        device(cell),
        {"film": Material(elastic, IdealDielectric(4.7), bulk_modulus)},
        electrodes=[Electrode(f"{last}_max", volts), Ground(f"{last}_min")],
        supports=supports,
        loads=loads,
        prescribed=[Stretch("x_max", "x", held)] if held else [],
        kinematics=kinematics,
    )
    problem = Problem(scene)
    solver = NewtonSolver(problem, NewtonOptions(tolerance=1e-11))
    before = [r for r, used in (("load", loads), ("stretch", held)) if used]
    path = [Ramp(what, steps=3) for what in [*before, "voltage"]]
    for _ in Walk(solver, path).follow():
        pass
    w = problem.w.x.array
    stretches = []
    for a, part in enumerate(problem.displacement):
        X = part.space.tabulate_dof_coordinates()
        u = w[part.dofs]
        slope, residual = np.linalg.lstsq(X[:, : len(axes)], u, rcond=None)[:2]
        assert np.abs(X[:, : len(axes)] @ slope - u).max() < 1e-8
        assert np.abs(np.delete(slope, a)).max() < 1e-8
        stretches.append(1 + slope[a])
    dofs = problem.conditions.electrode_dofs[f"{last}_max"]
    charge = -problem.residual()[dofs].sum() * problem.scales.charge
    return np.array(stretches), charge, problem


KERNELS = [
    pytest.param(ThreeD(), "hexahedron", id="3-D hexahedra"),
    pytest.param(ThreeD(), "tetrahedron", id="3-D tetrahedra"),
    pytest.param(PlaneStrain(depth=1e-3), "quadrilateral", id="plane strain quadrilaterals"),
    pytest.param(Axisymmetric(), "triangle", id="axisymmetric triangles"),
]


@pytest.mark.slow
@pytest.mark.parametrize("kinematics, cell", KERNELS)
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("name", MODELS)
def test_homogeneous_state(name, load, kinematics, cell):
    first, second, volts = LOADS[load]
    if not isinstance(kinematics, ThreeD):
        second = first
    stretches, charge, problem = run(kinematics, cell, single(name), first, second, volts)
    film = Film(
        Material(MODELS[name], IdealDielectric(4.7)), 1e-3, first=Dead(first), second=Dead(second)
    )
    if isinstance(kinematics, PlaneStrain):
        film = replace(film, second=Held(1.0))
    states = [s for s, stable in trace(film).states_at(volts) if stable]
    exact = states[0]
    if isinstance(kinematics, ThreeD):
        expected = exact.stretches
    elif isinstance(kinematics, PlaneStrain):
        assert exact.stretches[1] == 1.0
        expected = exact.stretches[[0, 2]]
    else:
        assert exact.stretches[0] == pytest.approx(exact.stretches[1], rel=1e-14)
        expected = exact.stretches[[0, 2]]
    assert abs(expected[0] - 1) > 0.02
    assert np.abs(stretches - expected).max() < 1e-8
    # undeformed electrode: 1 mm x 1 mm, or a disc of radius 1 mm
    area = np.pi * 1e-6 if isinstance(kinematics, Axisymmetric) else 1e-6
    assert charge == pytest.approx(exact.charge * area, rel=1e-8)
    cells = problem.forms.incompressible_cells
    change = np.abs(problem.forms.swelling()[cells]) / problem.forms.cell_volumes[cells]
    assert np.max(change, initial=0.0) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_held_stretch_and_its_force(name):
    """One side held at 1.3, the other under a dead load: stretches, charge and the force."""
    stretches, charge, problem = run(
        ThreeD(), "hexahedron", single(name), 0.0, 1e4, 4e3, held=1.3
    )
    film = Film(
        Material(MODELS[name], IdealDielectric(4.7)), 1e-3, first=Held(1.3), second=Dead(1e4)
    )
    exact = next(s for s, stable in trace(film).states_at(4e3) if stable)
    assert np.abs(stretches - exact.stretches).max() < 1e-8
    assert charge == pytest.approx(exact.charge * 1e-6, rel=1e-8)
    part, device = problem.displacement[0], problem.scene.device
    dofs = part.dofs[part.on(2, device.facets_of("x_max"))]
    force = problem.residual()[dofs].sum() * problem.scales.force
    assert force == pytest.approx(exact.stress[0] / 1.3 * 1e-6, rel=1e-8)


@pytest.mark.slow
def test_compressible_film():
    """C10 and D1 of the thesis's Table 5.2: energy of the isochoric part and kappa/2 (J - 1)^2."""
    kappa = 2.5e6
    stretches, charge, problem = run(
        ThreeD(), "hexahedron", NeoHookean(5e5), 1e5, 5e4, 2e4, bulk_modulus=kappa
    )
    material = Material(NeoHookean(5e5), IdealDielectric(4.7), kappa)
    exact = next(
        s for s, ok in trace(Film(material, 1e-3, Dead(1e5), Dead(5e4))).states_at(2e4) if ok
    )
    assert abs(np.prod(exact.stretches) - 1) > 5e-3
    assert np.abs(stretches - exact.stretches).max() < 1e-8
    assert charge == pytest.approx(exact.charge * 1e-6, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_assembled_tangent_is_the_derivative_of_the_residual(name):
    """Taylor remainder of order 2 about a stretched, charged state."""
    *_, problem = run(ThreeD(), "hexahedron", single(name), 2e4, 1e4, 5e3)
    state = problem.state
    d = np.random.default_rng(7).uniform(-0.02, 0.02, len(problem.free))
    linear = Tangent(problem)
    tangent = linear.matrix()
    x, y = tangent.createVecs()
    x.array[:] = d
    tangent.mult(x, y)
    residual, linear = problem.residual()[problem.free], y.array_r.copy()
    remainders = []
    for h in (0.125, 0.0625, 0.03125):
        problem.commit(state)
        problem.commit(problem.moved(problem.state, h * d))
        remainders.append(
            np.linalg.norm(problem.residual()[problem.free] - residual - h * linear)
        )
    assert np.log2(remainders[-2] / remainders[-1]) == pytest.approx(2, abs=0.1)
    assert remainders[-1] < 0.0125 * np.linalg.norm(h * linear)
