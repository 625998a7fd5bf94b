"""Quadrature functions of viscous branches, and the branches whose flow is solved at each point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.materials import Material, Maxwell
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class FlowingBranches:
    """The branches of a kernel whose flow is solved at each point, as the forms see them.

    Attributes
    ----------
    places
        Numbers of the branches in their materials.
    cells
        Owned cells of each region.
    stress
        The sum of 2 dW/dC of their springs in Pa at quadrature points, six numbers each.
    moduli
        The sum of 2 dS/dC in Pa, the flow included, between Mandel's vectors, 6 x 6.
    measures
        The energy of their springs in Pa, and their dissipation in Pa/s.
    slope
        Cell-wise sum of the springs' `spherical_slope` in Pa.
    """

    places: tuple[int, ...]
    cells: dict[str, np.ndarray]
    stress: Any
    moduli: Any
    measures: Any
    slope: Any

    @property
    def tensor(self) -> Any:
        """The stress, symbolic, symmetric 3 x 3."""
        return symmetric(self.stress)


def flowing_branches(
    scene: Scene, cellwise: Callable, cells: dict[str, np.ndarray], functions: Sequence[Any]
) -> FlowingBranches | None:
    """The branches of a kernel that are no `Maxwell` ones, or None.

    Parameters
    ----------
    scene
        The scene.
    cellwise
        Makes a cell-wise coefficient from the value of each region.
    cells
        Owned cells of each region of the kernel.
    functions
        Those of `flow_functions`.
    """
    branches = scene.materials[next(iter(cells))].viscous
    places = [k for k, branch in enumerate(branches) if not isinstance(branch, Maxwell)]
    if not places:
        return None

    def slope(region: str) -> float:
        return spherical_slope(scene.materials[region], places)

    stress, moduli, measures = functions
    return FlowingBranches(tuple(places), cells, stress, moduli, measures, cellwise(slope))


def spherical_slope(material: Material, places: Sequence[int]) -> float:
    """Sum of the `spherical_slope` of the springs of some viscous branches, in Pa."""
    springs = (material.viscous[k].spring for k in places)  # type: ignore[union-attr]
    return float(sum(spring.spherical_slope() for spring in springs))


def quadrature_functions(scene: Scene) -> dict[int, Any]:
    """For each number of a Maxwell branch a function of six numbers at each quadrature point."""
    places = sorted({
        k for material in scene.materials.values() for k, branch in enumerate(material.viscous)
        if isinstance(branch, Maxwell)
    })  # fmt: skip
    if not places:
        return {}
    space = quadrature_space(scene, (6,))
    return {k: dolfinx.fem.Function(space) for k in places}


def flow_functions(scene: Scene) -> list[Any]:
    """Functions for the stress, moduli and measures of `FlowingBranches`, if there are some."""
    branches = (branch for m in scene.materials.values() for branch in m.viscous)
    if all(isinstance(branch, Maxwell) for branch in branches):
        return []
    shapes: tuple[tuple[int, ...], ...] = ((6,), (6, 6), (2,))
    return [dolfinx.fem.Function(quadrature_space(scene, shape)) for shape in shapes]


def quadrature_space(scene: Scene, shape: tuple[int, ...]) -> Any:
    """Functions at the quadrature points of the scene's mesh."""
    mesh, degree = scene.device.mesh, scene.elements.quadrature_degree
    element = basix.ufl.quadrature_element(
        mesh.topology.cell_name(), value_shape=shape, degree=degree
    )
    return dolfinx.fem.functionspace(mesh, element)


def symmetric(six: Any) -> Any:
    """The symmetric tensor of six numbers xx, yy, zz, yz, xz, xy."""
    return ufl.as_matrix([
        [six[0], six[5], six[4]], [six[5], six[1], six[3]], [six[4], six[3], six[2]],
    ])  # fmt: skip
