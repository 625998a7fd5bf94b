"""An input file of Abaqus: nodes, elements, and sets and surfaces by their names.

Elements have nodes at corners and at the middles of edges: C3D20 for a hexahedron of 27 nodes.  The
nodes in its faces and in its middle are left out.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from dea_fenicsx.mesh.named_mesh import NamedMesh, serendipity
from dea_fenicsx.support.cell_types import CORNERS, HEX, QUAD, TET, TRIANGLE
from dea_fenicsx.support.files import clean

SOLIDS = {HEX: ("C3D8", "C3D20"), TET: ("C3D4", "C3D10")}
PLANE_CELL_NODES = {QUAD: ("4", "8"), TRIANGLE: ("3", "6")}
FAMILIES = {"Axisymmetric": "CAX", "PlaneStress": "CPS"}
"""Beginning of the name of a flat element; CPE, plane strain, for all other kinematics."""

ABAQUS_FACES = {
    HEX: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    TET: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    QUAD: ((0, 1), (1, 2), (2, 3), (3, 0)), TRIANGLE: ((0, 1), (1, 2), (2, 0)),
}  # fmt: skip
"""Corners of the faces of each cell, in Abaqus' order."""

MOST_SIGNS_OF_NAME = 80
"""Most signs of a name in Abaqus."""


def element(kind: str, nodes: int, kinematics: str, hybrid: bool) -> str:
    """Abaqus' name of an element.

    Parameters
    ----------
    kind, nodes
        DOLFINx's name of the cell, and its number of nodes without those within faces and cells.
    kinematics
        Name of the kinematics of a flat device.
    hybrid
        Whether the pressure is an unknown of its own, as an incompressible material needs.
    """
    second = nodes > CORNERS[kind][1]
    if kind in SOLIDS:
        return SOLIDS[kind][second] + "H" * hybrid
    family = FAMILIES.get(kinematics, "CPE")
    # in plane stress the thickness takes up the change of volume
    return family + PLANE_CELL_NODES[kind][second] + "H" * (hybrid and family != "CPS")


def input_file(
    mesh: NamedMesh, compressible: Collection[str] = (), kinematics: str = "", title: str = ""
) -> str:
    """The text of the input file.

    Parameters
    ----------
    mesh
        The mesh.
    compressible
        Names of the regions that need no hybrid elements.
    kinematics
        Name of the kinematics of a flat device.
    title
        What the heading says.
    """
    cells = serendipity(mesh)
    used = np.unique(cells)
    known = names_for([*mesh.regions, *mesh.surfaces])
    lines = ["*HEADING", f"Mesh: {_text(title)}", "** Lengths are in m."]
    lines += [f"** {known[n]} is {_text(n)}" for n in known if known[n] != n]
    lines.append("*NODE")
    lines += [
        f"{k + 1}, {x:.15g}, {y:.15g}, {z:.15g}"
        for k, (x, y, z) in zip(used, mesh.points[used], strict=True)
    ]
    for name, rows in mesh.regions.items():
        kind = element(mesh.kind, cells.shape[1], kinematics, name not in compressible)
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={known[name]}")
        for row in rows:
            lines += _wrapped([row + 1, *(cells[row] + 1)])
    kept = np.zeros(len(mesh.points), dtype=bool)
    kept[used] = True
    for name in mesh.surfaces:
        nodes = mesh.surface_nodes[name]
        lines.append(f"*NSET, NSET={known[name]}")
        lines += _wrapped(nodes[kept[nodes]] + 1)
    sides = _sides(mesh, cells)
    for name, (rows, faces) in sides.items():
        lines.append(f"*SURFACE, NAME={known[name]}, TYPE=ELEMENT")
        lines += [f"{row + 1}, S{face + 1}" for row, face in zip(rows, faces, strict=True)]
    return "\n".join(lines) + "\n"


def names_for(names: Iterable[str]) -> dict[str, str]:
    """A name for each set that Abaqus takes, different from all others without regard to case."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in dict.fromkeys(names):
        base = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        base = (base if base[:1].isalpha() else f"N{base}")[: MOST_SIGNS_OF_NAME - 6]
        made, number = base, 1
        while made.upper() in taken:
            number += 1
            made = f"{base}_{number}"
        taken.add(made.upper())
        found[name] = made
    return found


def _sides(mesh: NamedMesh, cells: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of each surface the rows of the cells behind its facets, and the numbers of their faces.

    Of two cells it is the first one.
    """
    table = np.array(ABAQUS_FACES[mesh.kind])
    faces = np.sort(cells[:, table], axis=2).reshape(-1, table.shape[1])
    wanted = [np.sort(facets, axis=1) for facets in mesh.surfaces.values()]
    if not wanted:
        return {}
    _, numbers = np.unique(np.vstack([faces, *wanted]), axis=0, return_inverse=True)
    numbers = numbers.ravel()
    first = np.full(numbers.max() + 1, -1)
    first[numbers[: len(faces)][::-1]] = np.arange(len(faces))[::-1]
    found, begin = {}, len(faces)
    for name, facets in zip(mesh.surfaces, wanted, strict=True):
        place = first[numbers[begin : begin + len(facets)]]
        begin += len(facets)
        rows, sides = np.divmod(place[place >= 0], len(table))
        found[name] = (rows, sides)
    return found


def _wrapped(numbers: Sequence[Any] | np.ndarray) -> list[str]:
    """Numbers in lines of at most sixteen; all lines but the last one end in a comma."""
    texts = [str(int(n)) for n in numbers]
    lines = [", ".join(texts[k : k + 16]) for k in range(0, len(texts), 16)]
    return [f"{line}," for line in lines[:-1]] + lines[-1:]


def _text(words: str) -> str:
    """A text in one line of ASCII."""
    return clean(words, 200).encode("ascii", "replace").decode()
