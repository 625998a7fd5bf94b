"""The mesh of a helix of bonded turns: nodes, cells and named parts as plain arrays.

A node is known by its radius, its column (its angle within the turn) and its row, counted from the
first turn's underside: so the top of a turn and the underside of the next are one.  Flat ends carry
on this numbering below and above.  A wedge fills the room between the helicoidal face and a plane;
it has the rows of a turn, which meet those of the wall at the seam.  Its thin end is left open over
one cell, as rows that run into an edge would be no hexahedra.

Nodes are numbered by radius, then by column, then by row.  The rows of a column are known in closed
form, and so are the number of a node from its place and its place from its number.  Each rank can
make its part of the mesh so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ._structured import Floats, Ints, StructuredMesh, compact, lattice_points
from .sectors import Sector

Mask = np.ndarray
HELIX, WEDGE_BELOW, WEDGE_ABOVE, DISC_BELOW, DISC_ABOVE = range(5)


class HelixShape(Protocol):
    """What a mesh of a helix needs to know of its device, `HDEA`; lengths in metres."""

    @property
    def order(self) -> int: ...

    @property
    def turns(self) -> int: ...

    @property
    def angular(self) -> int: ...

    @property
    def strands(self) -> int: ...

    @property
    def ends(self) -> str: ...

    @property
    def inset(self) -> float: ...

    @property
    def electrode(self) -> float: ...

    @property
    def cap(self) -> float: ...

    @property
    def through_cap(self) -> int: ...

    @property
    def pitch(self) -> float: ...

    @property
    def pattern(self) -> Sequence[Sector]: ...

    def radial_ends(self) -> tuple[Floats, int, int]: ...

    def layer_ends(self) -> tuple[Floats, Ints]: ...

    def angular_ends(self) -> Floats: ...


def helix_mesh(device: HelixShape) -> StructuredMesh:
    """Nodes, cells and named parts of a helical actuator."""
    builder = _Builder(device)
    everywhere = [(p, np.indices(shape).reshape(3, -1)) for p, shape in builder.shapes.items()]
    return builder.build(everywhere, np.arange(builder.nodes))


def helix_part(device: HelixShape, part: int, parts: int) -> StructuredMesh:
    """One of several equal parts of the cells and of the nodes; see `InParts.mesh_part`."""
    builder = _Builder(device)
    size = math.prod(builder.shapes[HELIX]) + sum(builder.in_caps)
    mine = builder.in_order_of_regions(size * part // parts, size * (part + 1) // parts)
    return builder.build(mine, np.arange(*(builder.nodes * k // parts for k in (part, part + 1))))


def helix_samples(device: HelixShape) -> StructuredMesh:
    """Cells of all shapes that a helical actuator has, and of the best and worst of its wedges.

    A cell of the helix and of a disc has the shape of the next one around of the same angle, in
    every turn.  In a wedge only the height changes around: the first and the last cell of each
    angle have the longest and the shortest edge.
    """
    builder = _Builder(device)
    sizes = np.round(np.diff(builder.angles), 9)
    some = []
    for piece, (wide, around, deep) in builder.shapes.items():
        begin = 1 if piece == WEDGE_BELOW else 0  # behind the open cell
        found = sizes[begin : begin + around]
        steps = {int(k) for s in np.unique(found) for k in np.flatnonzero(found == s)[[0, -1]]}
        i, j, k = np.indices((wide, len(steps), deep)).reshape(3, -1)
        some.append((piece, np.stack([i, np.array(sorted(steps))[j], k])))
    mesh = builder.build(some, np.empty(0, dtype=np.int64))
    cells, used = compact(mesh.cells)
    return StructuredMesh(builder.points(used), cells, {"sample": np.arange(len(cells))})


class _Builder:
    """Logical indices of cells, their nodes, and the names of their parts.

    Attributes
    ----------
    shapes : dict
        The pieces of the device, and how many cells each has in r, around and upwards.
    nodes : int
        How many there are in all.
    column, step, row : ndarray of int, each (M,)
        Place of every cell in r, around (counted over all turns), and in its own part's rows.
    part : ndarray of int, shape (M,)
        ``HELIX``, or which piece of the end caps.
    """

    def __init__(self, device: HelixShape) -> None:
        self.device, self.q = device, device.order
        self.radii, self.first, self.beyond = device.radial_ends()
        self.ends, self.rows = device.layer_ends()
        self.angles = device.angular_ends()
        self.middles = np.convolve(self.angles, [0.5, 0.5], "valid")
        self.wide, self.deep = len(self.radii) - 1, len(self.ends) - 1
        self.per_turn, self.steps = device.angular, device.angular * device.turns
        self.levels = device.through_cap if device.cap > 0 else 0
        self.shapes = {HELIX: (self.wide, self.steps, self.deep)}
        if device.ends == "flat":
            wedge = self.wide, self.per_turn - 1, self.deep
            self.shapes |= {WEDGE_BELOW: wedge, WEDGE_ABOVE: wedge}
            if self.levels:
                disc = self.wide, self.per_turn, self.levels
                self.shapes |= {DISC_BELOW: disc, DISC_ABOVE: disc}
        self.in_caps = [math.prod(s) for piece, s in self.shapes.items() if piece != HELIX]
        self._number_sheet()

    def build(self, pieces: Sequence[tuple[int, Ints]], mine: Ints) -> StructuredMesh:
        """A mesh of cells of pieces, given by their indices (3, m), and of some of all nodes."""
        self.part, self.column, self.step, self.row = (
            np.concatenate([of[k] for of in (self._places(*piece) for piece in pieces)])
            for k in range(4)
        )
        cells = np.concatenate([self._nodes_of(*piece) for piece in pieces])
        mesh = StructuredMesh(self.points(mine), cells)
        self._name(mesh)
        return mesh

    # ---- cells ------------------------------------------------------------------------------

    def _places(self, piece: int, cell: Ints) -> tuple[Ints, Ints, Ints, Ints]:
        """Piece, column, step and row of cells of a piece."""
        i, j, k = cell
        if piece in (WEDGE_ABOVE, DISC_ABOVE):
            j = j + self.steps - self.per_turn
        elif piece == WEDGE_BELOW:
            j = j + 1
        return np.full(len(i), piece), i, j, k

    def _nodes_of(self, piece: int, cell: Ints) -> Ints:
        """Numbers of the nodes of cells of a piece, shape (m, q + 1, q + 1, q + 1)."""
        local = np.arange(self.q + 1)
        kr, kt, kz = (self.q * index[:, None] + local for index in cell)
        around, turn_rows = self.q * self.per_turn, self.q * self.deep
        if piece == WEDGE_BELOW:  # but for the cell at the thin end
            kt = kt + self.q
        turn, column = (index[:, :, None] for index in np.divmod(kt, around))
        row = turn * turn_rows + kz[:, None]
        if piece == WEDGE_BELOW:
            row = row - turn_rows
        elif piece == WEDGE_ABOVE:
            row = row + self.device.turns * turn_rows
        elif piece == DISC_BELOW:
            # the open cell's thin end is where helix, wedge and disc meet
            top, kz = self.q * self.levels, kz[:, None]
            row = np.where((kz == top) & (column == 0), 0, kz - top - turn_rows)
        elif piece == DISC_ABOVE:
            row = 0 * column + (self.device.turns + 1) * turn_rows + kz[:, None]
        return self.sheet * kr[:, :, None, None] + self._in_sheet(column, row)[:, None]

    def in_order_of_regions(self, first: int, beyond: int) -> list[tuple[int, Ints]]:
        """Pieces and indices of the cells with some numbers, counted through all regions."""
        found, start = [], 0
        for inner, outer in self._regions():
            for column in range(self.wide):
                here = inner if self.first <= column < self.beyond else outer
                count = self.device.turns * int(np.count_nonzero(here))
                mine = np.arange(max(first - start, 0), min(beyond - start, count))
                start += count
                if len(mine):
                    steps, rows = np.nonzero(here)
                    turn, k = np.divmod(mine, len(steps))
                    step = turn * self.per_turn + steps[k]
                    found.append((HELIX, np.stack([np.full(len(k), column), step, rows[k]])))
        for piece, shape in list(self.shapes.items())[1:]:
            count = math.prod(shape)
            mine = np.arange(max(first - start, 0), min(beyond - start, count))
            start += count
            found.append((piece, np.stack(np.unravel_index(mine, shape))))
        return found or [(HELIX, np.empty((3, 0), dtype=np.int64))]

    def _regions(self) -> list[tuple[Mask, Mask]]:
        """Cells of each region of the helix in one turn of a column, shape (per_turn, deep).

        The first mask is for a column between the edges of the electrodes, the second for a rim.
        """
        soft = np.ones((self.per_turn, self.deep), dtype=bool)
        if self.device.electrode == 0:
            return [(soft, soft)]
        named: dict[str, list[Mask]] = {}
        row = np.arange(self.deep) % self.rows[-1]
        for sector in self.device.pattern:
            for e in "ab":
                metal = np.outer(sector.holds(self.middles), self._in_layer(e, row))
                named.setdefault(f"{e}{sector.suffix}", []).append(metal)
        metals = [mask for of in named.values() for mask in of]
        nothing = np.zeros_like(soft)
        return [(~np.any(metals, axis=0), soft), *((mask, nothing) for mask in metals)]

    # ---- nodes ------------------------------------------------------------------------------

    def _number_sheet(self) -> None:
        """Number the nodes of one radius: up through the rows of an angle, then on around.

        With discs some angles have no nodes between a disc and the helix, beside the open cell of a
        wedge: the rows from `_hole` below, and those after the last of the helix above.
        """
        around, turn_rows = self.q * self.per_turn, self.q * self.deep
        last, column = self.device.turns * turn_rows, np.arange(around)
        low, high = np.zeros(around, dtype=np.int64), np.full(around, last)
        self._hole, below, above = np.where(column > 0, 1, 0) - turn_rows, 0 * low, 0 * low
        if self.device.ends == "flat":
            low[self.q :] -= turn_rows
            high[: around - self.q + 1] += turn_rows
            if self.levels:
                below[: self.q] = -self._hole[: self.q]
                above[around - self.q + 1 :] = turn_rows - 1
                low[:] = -turn_rows - self.q * self.levels
                high[:] = last + turn_rows + self.q * self.levels
        else:
            high[0] += turn_rows
        count = high - low + 1 - below - above
        self._first = np.cumsum(count) - count
        self._low, self._below, self._above = low, below, above
        self.sheet = int(count.sum())
        self.nodes = self.sheet * (self.q * self.wide + 1)

    def _in_sheet(self, column: Ints, row: Ints) -> Ints:
        """Numbers, among those of one radius, of nodes by their angle and row."""
        upper = row >= self.q * self.deep * (self.device.turns + 1)
        number = self._first[column] + row - self._low[column]
        return np.asarray(number - self._below[column] * (row >= 0) - self._above[column] * upper)

    def points(self, numbers: Ints) -> Floats:
        """Places of nodes, shape (n, 3)."""
        kr, left = np.divmod(numbers, self.sheet)
        column = np.searchsorted(self._first, left, "right") - 1
        row = left - self._first[column] + self._low[column]
        row += self._below[column] * (row >= self._hole[column])
        row += self._above[column] * (row > self.q * self.deep * self.device.turns)
        around = lattice_points(self.angles / 360, self.q)[column]
        angle, r = 2 * math.pi * around, lattice_points(self.radii, self.q)[kr]
        z = self._heights(around, row, lattice_points(self.ends, self.q))
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])

    def _heights(self, around: Floats, row: Ints, line: Floats) -> Floats:
        """z of nodes from their angle (in turns, below 1) and row."""
        device, turn_rows = self.device, self.q * self.deep
        pitch, last = device.pitch, device.turns * turn_rows
        turn, k = np.divmod(row, turn_rows)
        z = pitch * (turn + around) + line[k]
        below, above = (row < 0) & (row >= -turn_rows), (row > last) & (row <= last + turn_rows)
        z[below] = (around * line[k])[below]
        upper = np.minimum(np.maximum(row - last, 0), turn_rows)
        z[above] = (pitch * (device.turns + around) + (1 - around) * line[upper])[above]
        if self.levels:
            level = device.cap / (self.q * self.levels)
            under, over = row < -turn_rows, row > last + turn_rows
            z[under] = level * (row + turn_rows)[under]
            z[over] = pitch * (device.turns + 1) + level * (row - last - turn_rows)[over]
        return z

    # ---- names ------------------------------------------------------------------------------

    def _name(self, mesh: StructuredMesh) -> None:
        part, column, step, row = self.part, self.column, self.step, self.row
        helix, flat = part == HELIX, self.device.ends == "flat"
        last_turn = step >= self.steps - self.per_turn
        under = helix & (row == 0) & (step < self.per_turn)
        over = helix & (row == self.deep - 1) & last_turn
        mesh.add_facets("inner", column == 0, 0, 0)
        mesh.add_facets("outer", column == self.wide - 1, 0, 1)
        if flat:
            ends = (DISC_BELOW, DISC_ABOVE) if self.levels else (WEDGE_BELOW, WEDGE_ABOVE)
            top_row = self.levels - 1 if self.levels else self.deep - 1
            mesh.add_facets("bottom", (part == ends[0]) & (row == 0), 2, 0)
            mesh.add_facets("top", (part == ends[1]) & (row == top_row), 2, 1)
            mesh.add_facets("notch", under & (step == 0), 2, 0)
            mesh.add_facets("notch", (part == WEDGE_BELOW) & (step == 1), 1, 0)
            mesh.add_facets("notch", (part == WEDGE_ABOVE) & (step == self.steps - 2), 1, 1)
            level = self.levels - 1
            mesh.add_facets("notch", (part == DISC_BELOW) & (step == 0) & (row == level), 2, 1)
            mesh.add_facets(
                "notch", (part == DISC_ABOVE) & (step == self.steps - 1) & (row == 0), 2, 0
            )
            open_above = over & (step == self.steps - 1)
        else:
            mesh.add_facets("bottom", under, 2, 0)
            mesh.add_facets("seam", helix & (step == 0), 1, 0)
            mesh.add_facets("seam", helix & (step == self.steps - 1), 1, 1)
            open_above = over
        soft, bare = helix.copy(), open_above
        middle = self.middles[step % self.per_turn]
        for sector in self.device.pattern:
            held = helix & (column >= self.first) & (column < self.beyond) & sector.holds(middle)
            if self.device.electrode > 0:
                soft &= ~self._add_electrodes(mesh, sector, held, over & ~open_above)
            else:
                self._add_surfaces(mesh, sector, held)
                free = over & ~open_above if flat else bare
                mesh.add_facets(f"electrode_b{sector.suffix}_top", free & held, 2, 1)
                bare = bare if flat else bare & ~held
        mesh.regions = {"elastomer": np.flatnonzero(soft), **mesh.regions}
        if flat:
            mesh.add_region("caps", ~helix)
        mesh.add_facets("notch" if flat else "top", bare, 2, 1)

    def _place(self) -> tuple[Ints, Ints]:
        """Which period of layers a cell is in, from 0 at the bottom, and its row in the period."""
        strand, row = np.divmod(self.row, self.rows[-1])
        return self.step // self.per_turn * self.device.strands + strand, row

    def _in_layer(self, electrode: str, row: Ints) -> Mask:
        """Whether rows of a period lie in the layer of electrode ``"a"`` or ``"b"``."""
        k = 1 if electrode == "a" else 3
        return (row >= self.rows[k]) & (row < self.rows[k + 1])

    def _add_surfaces(self, mesh: StructuredMesh, sector: Sector, held: Mask) -> None:
        """Ideal electrodes of a sector; ``held`` marks the cells between their edges."""
        period, row = self._place()
        last = period == self.device.strands * self.device.turns - 1
        a, b = (f"electrode_{e}{sector.suffix}_active" for e in "ab")
        mesh.add_facets(a, held & (row == self.rows[1] - 1), 2, 1)
        mesh.add_facets(b, held & (row == self.rows[2] - 1) & ~last, 2, 1)

    def _add_electrodes(
        self, mesh: StructuredMesh, sector: Sector, held: Mask, covered: Mask
    ) -> Mask:
        """Finite electrodes of a sector, and their faces; a mask of their cells.

        ``covered`` marks the cells below a cap.
        """
        period, row = self._place()
        rows = self.rows
        first, last = period == 0, period == self.device.strands * self.device.turns - 1
        a, b = (held & self._in_layer(e, row) for e in "ab")
        name_a, name_b = (f"electrode_{e}{sector.suffix}" for e in "ab")
        mesh.add_region(name_a, a)
        mesh.add_region(name_b, b)
        # Between a and the next b above lies elastomer everywhere; between b and the a above it
        # only where a further period follows, between a and the b below only where one came before.
        mesh.add_facets(f"{name_a}_active", a & (row == rows[2] - 1), 2, 1)
        mesh.add_facets(f"{name_a}_active", a & (row == rows[1]) & ~first, 2, 0)
        mesh.add_facets(f"{name_b}_active", b & (row == rows[3]), 2, 0)
        mesh.add_facets(f"{name_b}_active", b & (row == rows[4] - 1) & ~last, 2, 1)
        mesh.add_facets(f"{name_a}_rim", a & (row == rows[1]) & first, 2, 0)
        mesh.add_facets(f"{name_b}_rim", b & covered, 2, 1)
        inside = np.tile(sector.holds(self.middles), self.device.turns)
        begins, ends = inside & ~np.roll(inside, 1), inside & ~np.roll(inside, -1)
        # at the two ends of the helix: on the seam, or against a cap
        flat = self.device.ends == "flat"
        begins[0], ends[-1] = flat and inside[0], flat and inside[-1]
        for name, cells in ((f"{name_a}_rim", a), (f"{name_b}_rim", b)):
            if self.device.inset > 0:
                mesh.add_facets(name, cells & (self.column == self.first), 0, 0)
                mesh.add_facets(name, cells & (self.column == self.beyond - 1), 0, 1)
            mesh.add_facets(name, cells & begins[self.step], 1, 0)
            mesh.add_facets(name, cells & ends[self.step], 1, 1)
        return a | b
