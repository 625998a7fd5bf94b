"""Meshing a drawing, with curved cells where it is curved, and none of them inverted."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dea_fenicsx.mesh.foreign.arrays import check_known
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.subprocesses import environment

SMALLEST_SCALED_JACOBIAN = 0.02
"""Curved cells with a smaller scaled Jacobian are mended; gmsh's optimisation aims at 0.1."""

ABORT, ORDER_OPTION = "General.AbortOnError", "Mesh.ElementOrder"
"""The options of gmsh that say what it does on an error, and the order of cells."""

HIGHEST_ORDER = 2
"""Highest order of cells that gmsh knows of every shape."""

_METHODS = ("HighOrder", "HighOrderElastic", "HighOrder")
"""gmsh's optimisations of curved cells, in the order in which they are tried."""


def mesh_drawing(model: Any, path: Any, curved: bool = True, mend: bool = False) -> int:
    """Mesh the current model unless it has cells.

    Parameters
    ----------
    model
        The gmsh model, with all options set.
    path
        The file, for messages.
    curved
        Whether cells follow curved surfaces; else all edges are straight.
    mend
        Whether cells that the curved surfaces spoil are mended here, by gmsh's optimisation of
        cells of high order.  It can end the process, so it is for a process of its own.

    Returns
    -------
    int
        Number of spoilt cells that are left; 0 if `mend`.

    Raises
    ------
    InputError
        If there is nothing to mesh, gmsh cannot mesh it, or cells stay inverted.
    """
    dim = model.getDimension()
    if dim < 2:
        raise InputError(f"{path} holds no surface and no volume, so there is nothing to mesh.")
    if any(len(tags) for tags in model.mesh.getElements(dim)[1]):
        return 0
    shapes = {model.getType(*e) for d in (1, 2) for e in model.getEntities(d)}
    try:
        if not curved:
            with _option(ORDER_OPTION, 1):
                model.mesh.generate(dim)
            return 0
        _generate(model, dim, path)
        if not shapes - {"Line", "Plane"}:
            return 0
        model.mesh.setOrder(max(2, round(gmsh_option("Mesh.ElementOrder"))))
        # gmsh ends the process when it is asked for the quality of cells that it cannot describe
        check_known(model.mesh.getElements(dim)[0], str(path))
        left = len(_poor(model, dim, SMALLEST_SCALED_JACOBIAN))
        for method in _METHODS if mend and left else ():
            model.mesh.optimize(method)
            if not len(_poor(model, dim, SMALLEST_SCALED_JACOBIAN)):
                break
    except InputError:
        raise
    except Exception as error:
        told = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"gmsh cannot mesh {path} ({told}); look at it in gmsh, or give another size."
        ) from error
    bad = _poor(model, dim, 0.0) if mend else np.empty(0, dtype=int)
    if len(bad):
        raise InputError(
            f"{len(bad)} curved cells of {path} stay inverted{_beside(model, dim, bad)}; give a "
            "smaller size, or curved=False for straight cells."
        )
    return 0 if mend else left


def _generate(model: Any, dim: int, path: Any) -> None:
    """Mesh the current model with cells of the order that its options ask for.

    Where gmsh does not know cells of a high order, such as prisms of order 3, it would throw an
    error through code that lets none pass, which ends the process.  So these cells are made linear
    first, and raised without errors; `check_known` then finds what gmsh cannot describe.
    """
    order = round(gmsh_option(ORDER_OPTION))
    if order <= HIGHEST_ORDER:
        model.mesh.generate(dim)
        return
    with _option(ORDER_OPTION, 1):
        model.mesh.generate(dim)
    with _option(ABORT, 0):
        model.mesh.setOrder(order)
    check_known(model.mesh.getElements(dim)[0], str(path))


@contextmanager
def _option(name: str, value: float) -> Iterator[None]:
    """Give an option of gmsh another value within the block."""
    import gmsh

    before = gmsh_option(name)
    gmsh.option.setNumber(name, value)
    try:
        yield
    finally:
        gmsh.option.setNumber(name, before)


def gmsh_option(name: str) -> float:
    """Value of an option of gmsh."""
    import gmsh

    return float(gmsh.option.getNumber(name))


def _poor(model: Any, dim: int, least: float) -> np.ndarray:
    """Numbers of the cells whose least scaled Jacobian is not above some value."""
    parts = model.getEntities(dim)
    tags = np.concatenate([t for part in parts for t in model.mesh.getElements(*part)[1]])
    return tags[np.asarray(model.mesh.getElementQualities(tags, "minSJ")) <= least]


def _beside(model: Any, dim: int, bad: np.ndarray) -> str:
    """The named surfaces that hold nodes of some cells, in words."""
    nodes = {int(n) for tag in bad for n in model.mesh.getElement(tag)[1]}
    found = []
    for d, tag in model.getPhysicalGroups(dim - 1):
        on = model.mesh.getNodesForPhysicalGroup(d, tag)[0]
        shared = sum(int(n) in nodes for n in on)
        found.append((-shared, model.getPhysicalName(d, tag) or f"group_{d}_{tag}"))
    names = [name for shared, name in sorted(found) if shared < -2][:3]
    return f" beside {', '.join(map(repr, names))}" if names else ""


_MEND = """
import json, sys
from dea_fenicsx.mesh.cad import InputError, mend
try:
    mend(*json.loads(sys.argv[1]))
except InputError as error:
    print(error, file=sys.stderr)
    sys.exit(2)
"""


def mend_elsewhere(path: Any, size: float | None, names: Any, target: Any) -> None:
    """Mesh a drawing anew in a process of its own, with its spoilt cells mended.

    Parameters
    ----------
    path, size, names
        As in `cad.open_file`.
    target
        The .msh file that is written.

    Raises
    ------
    InputError
        If cells stay inverted, or gmsh ends itself over them.
    """
    plain = {k: v if isinstance(v, str) else list(v) for k, v in (names or {}).items()}
    given = json.dumps([str(path), size, plain, str(target)])
    done = subprocess.run(
        [sys.executable, "-P", "-c", _MEND, given], env=environment(), stdin=subprocess.DEVNULL,
        capture_output=True, check=False, text=True, errors="replace",
    )  # fmt: skip
    if done.returncode == 2 and done.stderr.strip():
        raise InputError(done.stderr.strip().splitlines()[-1])
    if done.returncode:
        raise InputError(
            f"gmsh ends itself over the curved cells of {path}; give another size, or curved=False "
            "for straight cells."
        )
