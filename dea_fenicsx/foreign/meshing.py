"""Meshing a drawing, with curved cells where it is curved, and none of them inverted."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.errors import InputError

GOOD = 0.05
"""Least scaled Jacobian that a curved cell should have; gmsh optimises until it has more."""

_METHODS = ("HighOrder", "HighOrderElastic", "HighOrder")
"""gmsh's optimisations of curved cells, in the order in which they are tried."""


def mesh_drawing(model: Any, path: Any, curved: bool = True) -> None:
    """Mesh the current model unless it has cells.

    Parameters
    ----------
    model
        The gmsh model, with all options set.
    path
        The file, for messages.
    curved
        Whether cells follow curved surfaces; else all edges are straight.

    Raises
    ------
    InputError
        If there is nothing to mesh, gmsh cannot mesh it, or curved cells stay inverted.
    """
    dim = model.getDimension()
    if dim < 2:
        raise InputError(f"{path} holds no surface and no volume, so there is nothing to mesh.")
    if any(len(tags) for tags in model.mesh.getElements(dim)[1]):
        return
    shapes = {model.getType(*e) for d in (1, 2) for e in model.getEntities(d)}
    try:
        model.mesh.generate(dim)
        if not curved:
            model.mesh.setOrder(1)
        elif shapes - {"Line", "Plane"}:
            _curve(model, dim)
    except InputError:
        raise
    except Exception as error:
        told = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"gmsh cannot mesh {path} ({told}); look at it in gmsh, or give another size."
        ) from error
    bad = _inverted(model, dim)
    if len(bad):
        raise InputError(
            f"{len(bad)} curved cells of {path} stay inverted{_beside(model, dim, bad)}; give a "
            "smaller size, or curved=False for straight cells."
        )


def _curve(model: Any, dim: int) -> None:
    """Move the nodes of second order onto the surfaces, and mend the cells that this inverts."""
    import gmsh

    model.mesh.setOrder(max(2, round(gmsh.option.getNumber("Mesh.ElementOrder"))))
    for method in _METHODS:
        if not len(_inverted(model, dim, GOOD)):
            return
        model.mesh.optimize(method)


def _inverted(model: Any, dim: int, least: float = 0.0) -> np.ndarray:
    """Numbers of the cells whose scaled Jacobian falls to some value."""
    tags = np.concatenate([t for e in model.getEntities(dim) for t in model.mesh.getElements(*e)[1]])
    return tags[np.asarray(model.mesh.getElementQualities(tags, "minSJ")) <= least]


def _beside(model: Any, dim: int, bad: np.ndarray) -> str:
    """The named surfaces that hold nodes of some cells, in words."""
    nodes = {int(n) for tag in bad for n in model.mesh.getElement(tag)[1]}
    names = []
    for d, tag in model.getPhysicalGroups(dim - 1):
        on = model.mesh.getNodesForPhysicalGroup(d, tag)[0]
        shared = sum(int(n) in nodes for n in on)
        names.append((-shared, model.getPhysicalName(d, tag) or f"group_{d}_{tag}"))
    names = [name for shared, name in sorted(names) if shared < -2][:3]
    return f" beside {', '.join(map(repr, names))}" if names else ""
