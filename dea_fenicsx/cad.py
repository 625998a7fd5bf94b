"""From a file to a meshed gmsh model with named groups: .msh, .geo and STEP.

For one rank alone, and without DOLFINx.  A .msh file holds mesh and names.  A .geo script holds the
names (its physical groups) and is meshed here if it does not do so itself.  A STEP file holds
solids, some with a name, and no named surfaces: what has no name is numbered, as in ``surface_5``,
and can be given a name of its own.
"""

from __future__ import annotations

import difflib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dea_fenicsx.errors import InputError
from dea_fenicsx.geometry._gmsh import measure, start
from dea_fenicsx.launch import environment
from dea_fenicsx.units import si

GEO = (".geo", ".geo_unrolled")
STEP = (".step", ".stp")
STEP_UNIT = 1e-3
"""Coordinates of a STEP file in m: gmsh reads it, whatever its own unit, in mm."""

Names = Mapping[str, str | Iterable[str]]
_NO_NAME = "Open CASCADE STEP translator"  # what OpenCASCADE writes for a part without a name
_KINDS = ("point", "curve", "surface", "volume")


class Group(NamedTuple):
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


def is_drawing(path: str | os.PathLike) -> bool:
    """Whether a file holds a shape that is still to be meshed."""
    return Path(path).suffix.lower() in (*GEO, *STEP)


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
        try:
            good = np.isfinite(value) and value > 0
        except TypeError:
            good = False
        if not good:
            raise InputError(f"The {what} is {value!r}, but must be a length in metres > 0.")
    return unit, size


def open_file(path: Path, size: float | None = None, names: Names | None = None) -> Any:
    """Make a new current gmsh model of a file, mesh it where it is not, and return it.

    Parameters
    ----------
    path
        A .msh or .geo file, a STEP file (.step, .stp), or another file that gmsh can merge.
    size
        Largest size of an element, in the file's unit; of a STEP file in mm.
    names
        New names for the parts of a STEP file, each with the name or names it has without.

    Raises
    ------
    InputError
        If there is no such file, gmsh cannot read or mesh it, or a name is not usable.
    """
    import gmsh

    if not path.is_file():
        raise InputError(f"There is no mesh file {path}; give a gmsh .msh or .geo, or a STEP file.")
    kind = path.suffix.lower()
    if size is not None and not is_drawing(path):
        raise InputError(f"{path} is meshed already, so size= has no effect; leave it out.")
    if names and kind not in STEP:
        raise InputError(
            f"names= is for STEP files; in {path} each part and surface is named by a physical "
            "group."
        )
    start()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add(path.stem)
    try:
        with _options({"Mesh.MeshSizeMax": None}):
            try:
                _read(path, kind in STEP)
            except Exception as error:
                raise InputError(
                    f"gmsh cannot read {path} ({_told(error)}); it must be a .msh, .geo or STEP "
                    "file."
                ) from error
            if kind in STEP:
                _name_parts(path, names or {})
            if is_drawing(path):
                _mesh(path, size)
    except BaseException:
        gmsh.model.remove()
        raise
    return gmsh.model


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


def _told(error: Exception | str) -> str:
    """gmsh's message on one line."""
    return " ".join(str(error).split()).rstrip(".")


def _read(path: Path, is_step: bool) -> None:
    """Merge a file into the current model; solids of a STEP file that touch share their face."""
    import gmsh

    if not is_step:
        if _is_binary(path):
            _merge_binary(path)
        else:
            gmsh.merge(str(path))
        return
    occ = gmsh.model.occ
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    parts = occ.importShapes(str(path))
    if len(parts) > 1:
        pieces, _ = occ.fragment(parts, [])
        if len([p for p in pieces if p[0] == parts[0][0]]) != len(parts):
            raise InputError("two of its solids overlap")
    occ.synchronize()


def _is_binary(path: Path) -> bool:
    """Whether a file is a mesh in gmsh's binary format: its second line says so."""
    with open(path, "rb") as file:
        head = file.read(64).split()
    return head[:1] == [b"$MeshFormat"] and head[2:3] == [b"1"]


_COPY = """
import sys, gmsh
gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
model = gmsh.model
try:
    gmsh.merge(sys.argv[1])
    model.mesh.getNodes()
    for group in model.getPhysicalGroups():
        model.getPhysicalName(*group)
        model.mesh.getNodesForPhysicalGroup(*group)
    for entity in model.getEntities():
        for tags in model.mesh.getElements(*entity)[1]:
            model.mesh.getElementQualities(tags, "minSJ")
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    gmsh.write(sys.argv[2])
except Exception as error:
    print(error, file=sys.stderr)
    sys.exit(1)
"""


def _merge_binary(path: Path) -> None:
    """Merge a binary mesh by way of a copy that gmsh writes of it in a process of its own.

    gmsh believes what a binary file says of its sizes: of damaged ones it dies at once, or it
    reports an error and has spoilt the memory of the process, which then dies anywhere.
    """
    import gmsh

    with tempfile.TemporaryDirectory(prefix="dea_mesh_") as folder:
        copy = Path(folder) / "copy.msh"
        done = subprocess.run(
            [sys.executable, "-c", _COPY, str(path), str(copy)], env=environment(),
            stdin=subprocess.DEVNULL, capture_output=True, check=False, text=True, errors="replace",
        )  # fmt: skip
        if done.returncode < 0:
            raise InputError("it ends gmsh itself, so its binary data must be damaged")
        if done.returncode:
            raise InputError(_told(done.stderr) or "its binary data must be damaged")
        gmsh.merge(str(copy))


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
                near = difflib.get_close_matches(str(name), known, n=1)
                hint = f"did you mean {near[0]!r}?" if near else ""
                raise InputError(
                    f"{path} has no part named {name!r}; {hint} it has: {', '.join(known)}."
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


def _mesh(path: Path, size: float | None) -> None:
    """Mesh the current model unless it has cells; with curved cells where anything is curved."""
    import gmsh

    model = gmsh.model
    dim = model.getDimension()
    if dim < 2:
        raise InputError(f"{path} holds no surface and no volume, so there is nothing to mesh.")
    if any(len(tags) for tags in model.mesh.getElements(dim)[1]):
        return
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    shapes = {model.getType(*e) for d in (1, 2) for e in model.getEntities(d)}
    try:
        model.mesh.generate(dim)
        if shapes - {"Line", "Plane"}:
            model.mesh.setOrder(2)
    except Exception as error:
        raise InputError(
            f"gmsh cannot mesh {path} ({_told(error)}); look at it in gmsh, or give another size."
        ) from error


def read_names(model: Any, label: str) -> tuple[dict[str, tuple[int, int]], int]:
    """Names of the physical groups with (dimension, tag), and the dimension of the cells.

    Raises
    ------
    InputError
        If there are no elements or no named region, or a name stands for two groups.
    """
    groups = model.getPhysicalGroups()
    types, tags, _ = model.mesh.getElements()
    if not len(types) or not sum(len(t) for t in tags):
        raise InputError(f"{label} holds no mesh elements; mesh it with gmsh before saving it.")
    cell_dim = max(model.mesh.getElementProperties(t)[1] for t in types)
    if not any(d == cell_dim for d, _ in groups):
        raise InputError(
            f"{label} names no region; add a physical group of dimension {cell_dim} to each part."
        )
    names: dict[str, tuple[int, int]] = {}
    for d, tag in groups:
        name = model.getPhysicalName(d, tag) or f"group_{d}_{tag}"
        if name in names:
            raise InputError(
                f"{label} uses the name {name!r} for two physical groups; names must be unique."
            )
        names[name] = (d, tag)
    return names, cell_dim


def groups_of(model: Any, label: str) -> list[Group]:
    """The named groups of regions and of facets in the current model, regions first."""
    names, cell_dim = read_names(model, label)
    measures = measure(model)
    found = []
    for name, (dim, tag) in names.items():
        if dim < cell_dim - 1:
            continue
        _, x = model.mesh.getNodesForPhysicalGroup(dim, tag)
        x = np.reshape(x, (-1, 3)) if len(x) else np.full((1, 3), np.nan)
        _, number, total = measures.get(name, (dim, 0, 0.0))
        found.append(Group(name, dim, number, total, x.min(axis=0), x.max(axis=0)))
    return sorted(found, key=lambda g: -g.dim)
