"""A mesh with cells of a higher degree and the topology of another one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


def mesh_of_degree(mesh: Any, degree: int, places: Callable[[np.ndarray], np.ndarray]) -> Any:
    """A mesh with the topology of another one and cells of another degree.  Collective.

    Parameters
    ----------
    mesh
        The mesh.
    degree
        Degree of the new cells.
    places
        Takes points of the reference cell, shape (n, dim), and gives their positions in each local
        cell, ghosts included, shape (cells, n, gdim).
    """
    name, space = mesh.topology.cell_name(), mesh.geometry.dim
    variant = basix.LagrangeVariant.gll_warped
    element = basix.ufl.element("Lagrange", name, degree, variant, shape=(space,))
    scalar = basix.create_element(
        basix.ElementFamily.P, getattr(basix.CellType, name), degree, variant
    )
    dofmap = dolfinx.fem.functionspace(mesh, element).dofmap
    nodes = np.array(dofmap.list, dtype=np.int32)
    size = dofmap.index_map.size_local + dofmap.index_map.num_ghosts
    x = np.zeros((size, space))
    x[nodes] = places(scalar.points)
    kind = getattr(dolfinx.mesh.CellType, name)
    cmap = dolfinx.fem.coordinate_element(kind, degree, int(variant))
    numbers = np.array(dofmap.index_map.local_to_global(np.arange(size, dtype=np.int32)))
    # corners keep their numbers, by which ranks know them; those of other nodes come after them
    given = np.asarray(mesh.geometry.input_global_indices)
    corners = len(basix.topology(scalar.cell_type)[0])
    numbers += 1 + mesh.comm.allreduce(int(given.max(initial=-1)), op=MPI.MAX)
    numbers[nodes[:, :corners]] = given[compat.geometry_dofmap(mesh)[:, :corners]]
    made = dolfinx.cpp.mesh.Geometry_float64(
        dofmap.index_map, nodes, cmap._cpp_object, x, numbers.astype(np.int64)
    )
    new = dolfinx.cpp.mesh.Mesh_float64(mesh.comm, mesh._cpp_object.topology, made)
    return dolfinx.mesh.Mesh(new, ufl.Mesh(element))
