"""Meshes in gmsh's old format 2: each element keeps the one group that the file gives it.

In format 2 an element names its physical group and its elementary entity.  gmsh gives all elements
of an entity to all groups that occur in it.  Files of other programs often have one entity for
everything, and then each group would hold everything.  So here each pair of entity and group
becomes an entity of its own, before gmsh reads the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.support.cell_types import GMSH


def one_group_each(path: Path) -> None:
    """Rewrite a file of format 2 in place, if elements of one entity lie in several groups.

    Anything else, and what cannot be understood, stays as it is for gmsh to judge.
    """
    with open(path, "rb") as file:
        head = file.read(64).split()
        if head[:1] != [b"$MeshFormat"] or head[1:2] == [] or not head[1].startswith(b"2"):
            return
        file.seek(0)
        whole = file.read()
    begin, end = whole.find(b"$Elements"), whole.find(b"$EndElements")
    if begin < 0 or end < begin:
        return
    begin = whole.find(b"\n", begin) + 1
    section = whole[begin:end]
    try:
        new = _binary(section) if head[2:3] == [b"1"] else _text(section)
    except (ValueError, IndexError):
        return
    if new is not None:
        path.write_bytes(whole[:begin] + new + whole[end:])


class _Entities:
    """A number for each pair of entity and group; the entities of each dimension are gmsh's own."""

    def __init__(self) -> None:
        self.known: dict[tuple[int, int, int], int] = {}
        self.entities: set[tuple[int, int]] = set()

    def number(self, dim: int, group: int, entity: int) -> int:
        self.entities.add((dim, entity))
        return self.known.setdefault((dim, group, entity), len(self.known) + 1)

    @property
    def mixed(self) -> bool:
        """Whether some entity lies in several groups."""
        return len(self.known) > len(self.entities)


def _dim_of(kind: int) -> int:
    """Dimension of one of gmsh's types of cells; what is not in the table counts as a solid."""
    return GMSH[kind].dim if kind in GMSH else 3


def _text(section: bytes) -> bytes | None:
    """The elements with new entities, or None if they can stay."""
    lines = section.split(b"\n")
    count, entities, found = int(lines[0]), _Entities(), [lines[0]]
    for line in lines[1 : count + 1]:
        words = line.split()
        if int(words[2]) >= 2:
            words[4] = b"%d" % entities.number(_dim_of(int(words[1])), int(words[3]), int(words[4]))
        found.append(b" ".join(words))
    return b"\n".join([*found, *lines[count + 1 :]]) if entities.mixed else None


def _binary(section: bytes) -> bytes | None:
    """The same for binary files: blocks of (type, elements, tags), then a row for each element."""
    line = section.index(b"\n") + 1
    total, entities, at = int(section[:line]), _Entities(), line
    data = bytearray(section)
    while total > 0:
        kind, count, tags = (int(v) for v in np.frombuffer(data, "<i4", 3, at))
        if count <= 0 or kind not in GMSH or not 0 <= tags < 16:
            return None
        at, width = at + 12, 1 + tags + GMSH[kind].nodes
        rows = np.frombuffer(data, "<i4", count * width, at).reshape(count, width)
        if tags >= 2:
            pairs, inverse = np.unique(rows[:, 1:3], axis=0, return_inverse=True)
            new = [entities.number(_dim_of(kind), int(g), int(e)) for g, e in pairs]
            changed = rows.copy()
            changed[:, 2] = np.array(new, dtype=np.int32)[inverse.reshape(-1)]
            data[at : at + 4 * count * width] = changed.tobytes()
        at, total = at + 4 * count * width, total - count
    return bytes(data) if entities.mixed else None
