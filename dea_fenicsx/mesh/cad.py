"""From a file to a meshed gmsh model with named groups: .msh, .geo and STEP.

For one rank alone, and without DOLFINx.  A .msh file holds mesh and names; nothing in it is run.
A .geo script is a program of gmsh.  It holds the names (its physical groups), and is meshed here if
it does not do so itself.  A STEP file holds solids, some with a name, and no named surfaces.  What
has no name is numbered, as in ``surface_5``, and can be given a name of its own.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dea_fenicsx.geometry._gmsh import group_name, measure, start
from dea_fenicsx.mesh.foreign.arrays import check_known
from dea_fenicsx.mesh.foreign.formats import GEO, STEP, check_program, is_drawing, kind_of, merge
from dea_fenicsx.mesh.foreign.meshing import mend_elsewhere, mesh_drawing
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import si
from dea_fenicsx.support.validation import did_you_mean

STEP_UNIT = 1e-3
"""Coordinates of a STEP file in m: gmsh reads it, whatever its own unit, in mm."""

BODY = "body"
"""The region of all cells of a mesh that names none."""

Names = Mapping[str, str | Iterable[str]]
_NO_NAME = "Open CASCADE STEP translator"  # what OpenCASCADE writes for a part without a name
_KINDS = ("point", "curve", "surface", "volume")


class NamedGroup(NamedTuple):
    """A named group of a mesh.

    Attributes
    ----------
    name, dim : its name and dimension
    elements : number of elements
    measure : volume, area or length, in powers of the mesh's unit
    low, high : corners of the box around it, shape (3,), in the mesh's unit
    """

    name: str
    dim: int
    elements: int
    measure: float
    low: np.ndarray
    high: np.ndarray


def lengths(path: str | os.PathLike, unit: Any, size: Any) -> tuple[float, float | None]:
    """A file's unit of length and the largest element size in m; None where not given.

    Raises
    ------
    InputError
        If one of them is no length > 0, or `unit` is given for a STEP file.
    """
    unit, size = si(unit, "m", "The mesh unit"), si(size, "m", "The element size")
    if Path(path).suffix.lower() in STEP:
        if unit is not None:
            raise InputError(f"{path} states its own unit of length; leave unit= out.")
        unit = STEP_UNIT
    unit = 1.0 if unit is None else unit
    for value, what in ((unit, "mesh unit"), (1.0 if size is None else size, "element size")):
        if not is_number(value) or not 0 < value < np.inf:
            raise InputError(
                f"The {what} is {shown(value)}, but must be a length in metres > 0."
            )
    return unit, size


def open_file(
    path: Path, size: float | None = None, names: Names | None = None, *, curved: bool = True,
    programs: bool | None = None,
) -> Any:
    """Make a new current gmsh model of a file, mesh it where it is not, and return it.

    Parameters
    ----------
    path
        A .msh or .geo file, a STEP file (.step, .stp), or a mesh in another format that gmsh has a
        reader for.
    size
        Largest size of an element, in the file's unit; of a STEP file in mm.
    names
        New names for the parts of a STEP file, each with the name or names it has without.
    curved
        Whether the cells of a drawing follow its curved surfaces.
    programs
        Whether a .geo file, which is a program, may run; by default, unless the environment
        variable DEA_FENICSX_NO_PROGRAMS is set.

    Raises
    ------
    InputError
        If there is no such file, gmsh cannot read or mesh it, it is a program that may not run, or
        a name is not usable.
    """
    import gmsh

    kind = kind_of(path)
    check_program(path, programs)
    if size is not None and not is_drawing(path):
        raise InputError(f"{path} is meshed already, so size= has no effect; leave it out.")
    if names and kind not in STEP:
        raise InputError(
            f"names= is for STEP files; in {path} each part and surface is named by a physical "
            "group."
        )
    start()
    with _options({"Mesh.MeshSizeMax": None, "General.Terminal": 0}):
        with _new_model(path.stem):
            spoilt = _meshed(path, kind, size, names, curved)
        if not spoilt:
            return gmsh.model
        gmsh.model.remove()
        with _new_model(path.stem), tempfile.TemporaryDirectory(prefix="dea_mesh_") as folder:
            target = Path(folder) / "mended.msh"
            mend_elsewhere(path, size, names, target)
            gmsh.merge(str(target))
    return gmsh.model


def mend(path: str, size: float | None, names: Names, target: str) -> None:
    """Mesh a drawing with curved cells, mend those that are spoilt, and write it to a .msh file.

    For a process of its own.  The parameters are those of `open_file`, and the file to write.
    """
    import gmsh

    start()
    with _options({"General.Terminal": 0}), _new_model(Path(path).stem):
        _meshed(Path(path), kind_of(Path(path)), size, names, True, mend=True)
        for key, value in {"MshFileVersion": 4.1, "Binary": 1, "SaveAll": 1}.items():
            gmsh.option.setNumber(f"Mesh.{key}", value)
        gmsh.write(target)


def _meshed(
    path: Path, kind: str, size: float | None, names: Names | None, curved: bool, mend: bool = False
) -> int:
    """Read a file into the current model and mesh it; the number of cells that are to be mended."""
    import gmsh

    try:
        _read(path, kind)
    except Exception as error:
        raise InputError(
            f"gmsh cannot read {path} ({_told(error)}); {_expected(kind)}."
        ) from error
    if kind in STEP:
        _name_parts(path, names or {})
    if not is_drawing(path):
        return 0
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    return mesh_drawing(gmsh.model, path, curved, mend)


@contextmanager
def _new_model(name: str) -> Iterator[None]:
    """Add a model and make it the current one; an error takes it away again."""
    import gmsh

    gmsh.model.add(name)
    try:
        yield
    except BaseException:
        gmsh.model.remove()
        raise


@contextmanager
def _options(values: Mapping[str, float | None]) -> Iterator[None]:
    """Set options of gmsh (None: leave as they are) and put them back at the end."""
    import gmsh

    before = {key: gmsh.option.getNumber(key) for key in values}
    try:
        for key, value in values.items():
            if value is not None:
                gmsh.option.setNumber(key, value)
        yield
    finally:
        for key, value in before.items():
            gmsh.option.setNumber(key, value)


def _expected(kind: str) -> str:
    """What a file must be that gmsh cannot read, by what `kind_of` says of it."""
    if kind in GEO:
        return "look at the script at the place that gmsh names"
    if kind in STEP:
        return "write it anew as STEP (AP203, AP214 or AP242)"
    return "the file is damaged or of another kind; write it anew"


def _told(error: Exception | str) -> str:
    """gmsh's message on one line."""
    return " ".join(str(error).split()).rstrip(".")


def _read(path: Path, kind: str) -> None:
    """Merge a file into the current model; solids of a STEP file that touch share their face."""
    import gmsh

    if kind not in STEP:
        merge(path, kind)
        return
    occ = gmsh.model.occ
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    parts = occ.importShapes(str(path), format="step")
    if len(parts) > 1:
        pieces, _ = occ.fragment(parts, [])
        if len([p for p in pieces if p[0] == parts[0][0]]) != len(parts):
            raise InputError("two of its solids overlap")
    occ.synchronize()


def _name_parts(path: Path, names: Names) -> None:
    """Make a physical group of every solid and every face, or of every face and curve if flat."""
    import gmsh

    model = gmsh.model
    dim = model.getDimension()
    parts: dict[str, list[tuple[int, int]]] = {}
    for d in (dim, dim - 1):
        for _, tag in model.getEntities(d):
            name = model.getEntityName(d, tag).split("/")[-1].strip()
            taken = any(other != d for other, _ in parts.get(name, []))
            if not name or name.startswith(_NO_NAME) or taken:
                name = f"{_KINDS[d]}_{tag}"
            parts.setdefault(name, []).append((d, tag))
    known = list(parts)
    for new, old in names.items():
        chosen: list[tuple[int, int]] = []
        for name in (old,) if isinstance(old, str) else tuple(old):
            if name not in known:
                raise InputError(
                    f"{path} has no part named {name!r}; {did_you_mean(name, known)} it has: "
                    f"{', '.join(known)}."
                )
            if name not in parts:
                raise InputError(f"names= uses {name!r} of {path} twice; use it once.")
            chosen += parts.pop(name)
        if len({d for d, _ in chosen}) != 1 or new in parts:
            raise InputError(
                f"names= makes {new!r} of {old!r} in {path}; give a name that is not taken, to "
                "one or more solids, or to one or more surfaces."
            )
        parts[new] = chosen
    for name, members in parts.items():
        model.addPhysicalGroup(members[0][0], [tag for _, tag in members], name=name)


def read_names(
    model: Any, label: str, lines: bool = False
) -> tuple[dict[str, tuple[int, int]], int]:
    """Names of the groups of regions and of facets, and the dimension of the cells.

    Groups of lower dimension are no part of a scene, so their names are free.

    Parameters
    ----------
    model, label
        The gmsh model, and its name in messages.
    lines
        Whether the cells may be lines.

    Returns
    -------
    dict, int
        Dimension and tag of each physical group by name; dimension of the cells.

    Raises
    ------
    InputError
        If there are no elements or no named region, or a name stands for two groups.
    """
    groups = model.getPhysicalGroups()
    types, tags, _ = model.mesh.getElements()
    if not len(types) or not sum(len(t) for t in tags):
        raise InputError(f"{label} holds no mesh elements; mesh it with gmsh before saving it.")
    check_known(types, label)
    cell_dim = max(model.mesh.getElementProperties(t)[1] for t in types)
    if cell_dim < (1 if lines else 2):
        raise InputError(f"{label} holds points and lines only; mesh its surfaces or volumes, too.")
    if not any(d == cell_dim for d, _ in groups):
        raise InputError(
            f"{label} names no region; add a physical group of dimension {cell_dim} to each part."
        )
    names: dict[str, tuple[int, int]] = {}
    for d, tag in groups:
        if d < cell_dim - 1:
            continue
        name = group_name(model, d, tag)
        if name in names:
            raise InputError(
                f"{label} uses the name {name!r} for two physical groups of regions or facets; "
                "their names must be unique."
            )
        names[name] = (d, tag)
    return names, cell_dim


def name_the_body(model: Any) -> None:
    """Make all cells of a model the region ``"body"`` if no group of cells is named."""
    types, _, _ = model.mesh.getElements()
    dim = max((model.mesh.getElementProperties(t)[1] for t in types), default=0)
    if dim >= 2 and not any(d == dim for d, _ in model.getPhysicalGroups()):
        tag = model.addPhysicalGroup(dim, [tag for _, tag in model.getEntities(dim)])
        model.setPhysicalName(dim, tag, BODY)


def groups_of(model: Any, label: str) -> list[NamedGroup]:
    """The named groups of regions and of facets in the current model, regions first."""
    names, _ = read_names(model, label)
    measures = measure(model)
    found = []
    for name, (dim, tag) in names.items():
        _, x = model.mesh.getNodesForPhysicalGroup(dim, tag)
        x = np.reshape(x, (-1, 3)) if len(x) else np.full((1, 3), np.nan)
        _, number, total = measures.get(name, (dim, 0, 0.0))
        found.append(NamedGroup(name, dim, number, total, x.min(axis=0), x.max(axis=0)))
    return sorted(found, key=lambda g: -g.dim)
