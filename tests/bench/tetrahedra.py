"""A box of tetrahedra with named faces, written as a .msh file.

No mesh generator is involved, so the mesh is the same on every machine.
"""

from __future__ import annotations

from itertools import permutations, product
from pathlib import Path

TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers of the elements with straight edges


def write_box(file: Path, size: tuple[float, ...], cells: tuple[int, ...]) -> None:
    """Write a box from the origin, each of its bricks divided into six tetrahedra.

    Parameters
    ----------
    file
        The .msh file (format 2.2) that is written.  Its region is ``film``; its facet groups are
        ``x_min``, ``x_max``, ``y_min``, ``y_max``, ``bottom`` and ``top``.
    size
        Lengths of the edges along x, y and z in m.
    cells
        Bricks along x, y and z.
    """
    numbers = {place: k for k, place in enumerate(product(*(range(n + 1) for n in cells)), 1)}
    tetrahedra = [
        corners for brick in product(*(range(n) for n in cells)) for corners in _divided(brick)
    ]
    names = ("film", "x_min", "x_max", "y_min", "y_max", "bottom", "top")
    elements = [(TETRAHEDRON, 1, corners) for corners in tetrahedra]
    for axis, value, group in _sides(cells):
        for corners in tetrahedra:
            face = [corner for corner in corners if corner[axis] == value]
            if len(face) == 3:
                elements.append((TRIANGLE, group, face))
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    lines += [f'{3 if k == 1 else 2} {k} "{name}"' for k, name in enumerate(names, 1)]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(numbers))]
    for place, number in numbers.items():
        point = (length * i / n for length, i, n in zip(size, place, cells, strict=True))
        lines.append(f"{number} " + " ".join(f"{x:.17g}" for x in point))
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    for number, (kind, group, corners) in enumerate(elements, 1):
        nodes = " ".join(str(numbers[tuple(corner)]) for corner in corners)
        lines.append(f"{number} {kind} 2 {group} {group} {nodes}")
    file.write_text("\n".join([*lines, "$EndElements", ""]), "utf-8")


def _divided(brick: tuple[int, ...]) -> list[list[tuple[int, ...]]]:
    """Corners of the six tetrahedra of a brick; all share the brick's diagonal."""
    found = []
    for order in permutations(range(3)):
        corner, corners = list(brick), [tuple(brick)]
        for axis in order:
            corner[axis] += 1
            corners.append(tuple(corner))
        found.append(corners)
    return found


def _sides(cells: tuple[int, ...]) -> list[tuple[int, int, int]]:
    """Axis, place along it and number of the physical group of each of the six sides."""
    return [(axis, end * cells[axis], 2 + 2 * axis + end) for axis in range(3) for end in (0, 1)]
