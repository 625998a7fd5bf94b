"""The mesh of a helix of bonded turns: nodes, cells and named parts as plain arrays.

A node is known by its radius, its column (its angle within the turn) and its row, counted from the
first turn's underside: so the top of a turn and the underside of the next are one.  Flat ends carry
on this numbering below and above.  A wedge fills the room between the helicoidal face and a plane;
it has the rows of a turn, which meet those of the wall at the seam.  Its thin end is left open over
one cell, as rows that run into an edge would be no hexahedra.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ._structured import Floats, Ints, StructuredMesh, block, compact, lattice_points
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
    return _Builder(device).build()


class _Builder:
    """Logical indices of all cells, and the names of their parts.

    Attributes
    ----------
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
        self.wide, self.deep = len(self.radii) - 1, len(self.ends) - 1
        self.per_turn, self.steps = device.angular, device.angular * device.turns
        self.levels = device.through_cap if device.cap > 0 else 0

    def build(self) -> StructuredMesh:
        pieces = [self._helix()]
        if self.device.ends == "flat":
            pieces += [self._wedge(above) for above in (False, True)]
            if self.levels:
                pieces += [self._disc(above) for above in (False, True)]
        self.part, self.column, self.step, self.row = (
            np.concatenate([np.broadcast_to(p[0][k], p[0][1].shape) for p in pieces])
            for k in range(4)
        )
        kr, column, row = (np.concatenate([piece[1][k] for piece in pieces]) for k in range(3))
        least = int(row.min())
        lines = lattice_points(self.radii, self.q), lattice_points(self.ends, self.q)
        shape = (len(lines[0]), self.q * self.per_turn, int(row.max()) - least + 1)
        cells, used = compact(np.ravel_multi_index((kr, column, row - least), shape))
        kr, column, row = np.unravel_index(used, shape)
        around = lattice_points(self.angles / 360, self.q)[column]
        angle, r = 2 * math.pi * around, lines[0][kr]
        z = self._heights(around, row + least, lines[1])
        mesh = StructuredMesh(np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), cells)
        self._name(mesh)
        return mesh

    # ---- nodes ------------------------------------------------------------------------------

    def _helix(self) -> tuple[tuple, tuple]:
        cell, (kr, kt, kz) = block((self.wide, self.steps, self.deep), self.q)
        turn, column = np.divmod(kt, self.q * self.per_turn)
        return (HELIX, *cell), (kr, column, turn * self.q * self.deep + kz)

    def _wedge(self, above: bool) -> tuple[tuple, tuple]:
        """Between a helicoidal end face and its plane, but for the cell at the thin end."""
        (i, j, k), (kr, kt, kz) = block((self.wide, self.per_turn - 1, self.deep), self.q)
        turn_rows = self.q * self.deep
        if above:
            row = self.device.turns * turn_rows + kz
            return (WEDGE_ABOVE, i, j + self.steps - self.per_turn, k), (kr, kt, row)
        turn, column = np.divmod(kt + self.q, self.q * self.per_turn)
        return (WEDGE_BELOW, i, j + 1, k), (kr, column, (turn - 1) * turn_rows + kz)

    def _disc(self, above: bool) -> tuple[tuple, tuple]:
        """Between two planes; the open cell's thin end is where helix, wedge and disc meet."""
        (i, j, k), (kr, kt, kz) = block((self.wide, self.per_turn, self.levels), self.q)
        column, turn_rows = kt % (self.q * self.per_turn), self.q * self.deep
        if above:
            row = (self.device.turns + 1) * turn_rows + kz
            return (DISC_ABOVE, i, j + self.steps - self.per_turn, k), (kr, column, row)
        top = self.q * self.levels
        row = np.where((kz == top) & (column == 0), 0, kz - top - turn_rows)
        return (DISC_BELOW, i, j, k), (kr, column, row)

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
        middle = np.convolve(self.angles, [0.5, 0.5], "valid")[step % self.per_turn]
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
        a = held & (row >= rows[1]) & (row < rows[2])
        b = held & (row >= rows[3])
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
        steps = np.arange(self.steps)
        middles = np.convolve(self.angles, [0.5, 0.5], "valid")[steps % self.per_turn]
        inside = sector.holds(middles)
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
