"""Meshes on all ranks, from gmsh or from parts that each rank has; DOLFINx 0.9 and 0.11 differ."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.support.compat import VERSION, dolfinx


def model_to_mesh(model: Any, comm: MPI.Comm, gdim: int) -> tuple[Any, Any, Any]:
    """Distribute the gmsh model of rank 0: mesh, cell tags, facet tags (None if there are none).

    Cells behind shared facets are ghosted, so that an interior surface is seen from both sides.
    """
    partitioner, _ = _partitioner()
    io = gmsh_io()
    data = io.model_to_mesh(model, comm, 0, gdim=gdim, partitioner=partitioner)
    return data if VERSION < (0, 10) else (data.mesh, data.cell_tags, data.facet_tags)


def _partitioner() -> tuple[Any, dict[str, int]]:
    """What divides cells between ranks, and an option that `create_mesh` takes beside it."""
    ghosts = dolfinx.mesh.GhostMode.shared_facet
    if VERSION >= (0, 11):
        return dolfinx.mesh.create_cell_partitioner(ghosts, 2), {"max_facet_to_cell_links": 2}
    return dolfinx.mesh.create_cell_partitioner(ghosts), {}


def gmsh_io() -> Any:
    """DOLFINx's module for meshes of gmsh."""
    return importlib.import_module(f"dolfinx.io.{'gmsh' if VERSION >= (0, 10) else 'gmshio'}")


def create_mesh(comm: MPI.Comm, cells: np.ndarray, points: np.ndarray, domain: Any) -> Any:
    """A mesh of cells and points of which each rank gives a part.  Collective.

    Cells behind shared facets are ghosted, as by `model_to_mesh`.
    """
    partitioner, options = _partitioner()
    what = (domain, points) if VERSION >= (0, 10) else (points, domain)
    return dolfinx.mesh.create_mesh(comm, cells, *what, partitioner, **options)
