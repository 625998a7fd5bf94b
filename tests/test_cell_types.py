"""The one table of cell types against gmsh."""

from __future__ import annotations

import pytest

from dea_fenicsx.support.cell_types import (
    CORNERS,
    GMSH,
    QUADRATIC,
    SHAPES,
    gmsh_number,
    lagrange_nodes,
)

gmsh = pytest.importorskip("gmsh")


@pytest.fixture(scope="module")
def properties():
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    yield gmsh.model.mesh.getElementProperties
    gmsh.finalize()


@pytest.mark.parametrize("number", GMSH)
def test_gmsh_agrees(properties, number):
    cell = GMSH[number]
    name, dim, order, nodes, _, corners = properties(number)
    assert name.lower().startswith(cell.shape)
    assert (dim, nodes, (dim, corners)) == (cell.dim, cell.nodes, CORNERS[cell.shape])
    assert order == cell.order
    assert cell.complete == (nodes == lagrange_nodes(cell.shape, order))


def test_every_complete_cell_is_found_by_shape_and_order():
    for number, cell in GMSH.items():
        if cell.complete and cell.order:
            assert gmsh_number(cell.shape, cell.order) == number
    assert SHAPES[2, 3] == "triangle" and SHAPES[3, 8] == "hexahedron"


@pytest.mark.parametrize("shape", QUADRATIC)
def test_vtk_orders_are_permutations(shape):
    cell = QUADRATIC[shape]
    count = lagrange_nodes(shape, 2)
    assert sorted(cell.vtk_order) == list(range(count)) and cell.nodes == count
    assert cell.xdmf == f"{shape.capitalize()}_{count}"
    assert cell.flat == (CORNERS[shape][0] == 2)
    # corners come first in both orders
    assert set(cell.vtk_order[: CORNERS[shape][1]]) == set(range(CORNERS[shape][1]))
