"""From plain arrays to a gmsh model, to a .msh file, and back to measures.

gmsh is imported inside the functions: parameters can be checked on every rank of a parallel run
while only one of them loads gmsh.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.support.cell_types import HEX, LINE, QUAD, gmsh_number
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file

from ._structured import Ints, StructuredMesh

ELEMENT = {
    (dim, order): gmsh_number(shape, order)
    for dim, shape in ((1, LINE), (2, QUAD), (3, HEX)) for order in (1, 2)
}  # fmt: skip
"""gmsh's numbers of the cells of structured meshes, by dimension and order."""
ELEMENT |= {(0, order): 15 for order in (1, 2)}


def start() -> bool:
    """Initialise gmsh quietly unless it is running; True if this call did it."""
    import gmsh

    if gmsh.isInitialized():
        return False
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 2)
    return True


def local_numbers(dim: int, order: int) -> Ints:
    """Lattice position (flat, last direction fastest) of each of gmsh's nodes in a cell.

    gmsh is asked for the reference positions, so that its numbering is written down nowhere else.
    """
    import gmsh

    if dim == 0:
        return np.zeros(1, dtype=np.int64)
    reference = gmsh.model.mesh.getElementProperties(ELEMENT[dim, order])[4]
    index = np.rint((np.reshape(reference, (-1, dim)) + 1) * order / 2).astype(np.int64)
    return np.asarray(np.ravel_multi_index(tuple(index.T), (order + 1,) * dim))


def add_model(mesh: StructuredMesh, name: str) -> Any:
    """Make a new current gmsh model of discrete entities; returns ``gmsh.model``.

    One entity and one physical group for each region and each facet group, the same tag in both;
    tags count from 1, regions first.  Nodes are numbered from 1 without gaps.
    """
    import gmsh

    mesh.check()
    start()
    model = gmsh.model
    taken, unique = set(model.list()), name
    while unique in taken:
        unique = f"{name}_{len(taken)}" if unique == name else f"{unique}_"
    model.add(unique)

    dim, order = mesh.dimension, mesh.order
    tags = {part: i + 1 for i, part in enumerate([*mesh.regions, *mesh.facets])}
    free = np.ones(len(mesh.points), dtype=bool)
    for part, cells in mesh.regions.items():
        nodes = np.unique(mesh.cells[cells])
        nodes = nodes[free[nodes]]  # a node on an interface belongs to the first region there
        free[nodes] = False
        model.addDiscreteEntity(dim, tags[part])
        model.mesh.addNodes(dim, tags[part], nodes + 1, mesh.points[nodes].ravel())
    first = 1
    parts = [(dim, part, mesh.cells[cells]) for part, cells in mesh.regions.items()]
    parts += [(dim - 1, part, lattice) for part, lattice in mesh.facets.items()]
    for d, part, lattice in parts:
        if d < dim:
            model.addDiscreteEntity(d, tags[part])
        numbers = lattice.reshape(len(lattice), -1)[:, local_numbers(d, order)] + 1
        elements = np.arange(first, first + len(lattice))
        first += len(lattice)
        model.mesh.addElementsByType(tags[part], ELEMENT[d, order], elements, numbers.ravel())
        model.addPhysicalGroup(d, [tags[part]], tag=tags[part], name=part)
    return model


@contextmanager
def temporary_model(mesh: StructuredMesh, name: str) -> Iterator[Any]:
    """``add_model`` for the length of a block; leaves gmsh as it was."""
    import gmsh

    mine = start()
    before = None if mine else gmsh.model.getCurrent()
    try:
        yield add_model(mesh, name)
    finally:
        if mine:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            if before in gmsh.model.list():
                gmsh.model.setCurrent(before)


def checked_path(path: str | os.PathLike[str]) -> Path:
    """The .msh file to write; InputError where it can't be written."""
    target = Path(path)
    if target.suffix != ".msh":
        raise InputError(f"Mesh file {target}: the name must end in .msh.")
    if target.is_dir():
        raise InputError(f"Mesh file {target}: this is a folder; give the name of a file.")
    if not target.parent.is_dir():
        raise InputError(f"Mesh file {target}: there is no folder {target.parent}; make it first.")
    return target


def write_current(path: Path) -> None:
    """Write the current model as .msh 4.1; the file appears whole or not at all."""
    import gmsh

    settings = {"Mesh.MshFileVersion": 4.1, "Mesh.Binary": 1, "Mesh.SaveAll": 0}
    before = {key: gmsh.option.getNumber(key) for key in settings}
    try:
        for key, value in settings.items():
            gmsh.option.setNumber(key, value)
        # gmsh goes by the ending; the number keeps processes that write the same file apart
        replace_file(path, lambda part: gmsh.write(str(part)), ending=f".{os.getpid()}.msh")
    except Exception as error:  # OSError, or the plain Exception that gmsh raises
        raise InputError(
            f"Mesh file {path}: it can't be written ({error}); give a path in a folder that you "
            "may write to."
        ) from error
    finally:
        for key, value in before.items():
            gmsh.option.setNumber(key, value)


def group_name(model: Any, dim: int, tag: int) -> str:
    """Name of a physical group without padding and control characters; numbered if it has none."""
    given = "".join(c for c in model.getPhysicalName(dim, tag) if c.isprintable())
    return given.strip() or f"group_{dim}_{tag}"


def measure(model: Any, rule: str = "Gauss6") -> dict[str, tuple[int, int, float]]:
    """Dimension, number of elements, and volume, area or length of every physical group.

    Where groups of several dimensions share a name, the one of highest dimension is meant.
    """
    found = {}
    for dim, tag in sorted(model.getPhysicalGroups()):
        number, total = 0, 0.0
        for entity in model.getEntitiesForPhysicalGroup(dim, tag):
            kinds, elements, _ = model.mesh.getElements(dim, entity)
            for kind, members in zip(kinds, elements, strict=True):
                points, weights = model.mesh.getIntegrationPoints(kind, rule)
                _, determinants, _ = model.mesh.getJacobians(kind, points, entity)
                total += float(np.sum(determinants.reshape(-1, len(weights)) @ weights))
                number += len(members)
        found[group_name(model, dim, tag)] = (int(dim), number, total)
    return found


def quality(model: Any) -> dict[str, float]:
    """How good the cells of highest dimension are, by gmsh's measures.

    ``least_scaled_jacobian`` is 1 in a cell with right angles, and must be above 0;
    ``largest_aspect`` is the longest over the shortest edge of a cell, large in thin layers.
    """
    dim = max(d for d, tag in model.getEntities() if len(model.mesh.getElementTypes(d, tag)))
    tags = np.concatenate([t for part in model.getEntities(dim)
                           for t in model.mesh.getElements(*part)[1]])  # fmt: skip
    least, shortest, longest = (
        model.mesh.getElementQualities(tags, name) for name in ("minSJ", "minEdge", "maxEdge")
    )
    # two corners of a cell in one place make it infinitely long
    with np.errstate(divide="ignore", invalid="ignore"):
        aspect = np.where(np.equal(shortest, 0), np.inf, np.asarray(longest) / shortest)
    return {
        "least_scaled_jacobian": float(np.min(least)),
        "largest_aspect": float(np.max(aspect)),
    }
