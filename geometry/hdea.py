"""Helical dielectric elastomer actuator (HDEA): a double helix of bonded turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.errors import InputError
from dea_fenicsx.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, block, compact, joined_ends, lattice_points
from .base import Geometry
from .grading import graded
from .sectors import Sector, angular_ends, checked_sectors

Mask = np.ndarray


@dataclass(frozen=True)
@in_si(outer_radius="m", inner_radius="m", inset="m", elastomer="m", electrode="m")
class HDEA(Geometry):
    """Two electrodes wound as helicoids in an elastomer ring, every turn bonded to the next.

    In helical coordinates r, Theta in [0, 2 pi turns] and zeta in [0, pitch] the body is
    z = pitch Theta / (2 pi) + zeta.  One pitch holds, from below, elastomer, electrode a,
    elastomer, electrode b; the face zeta = pitch of a turn is the face zeta = 0 of the next.
    The electrodes fill inner_radius + inset < r < outer_radius - inset within their layer; the
    rims of that layer are elastomer.

    Parameters
    ----------
    outer_radius, inner_radius, inset
        In metres.
    elastomer, electrode
        Thicknesses in metres, measured along the axis.  ``electrode=0`` gives ideal surfaces.
    turns
        Whole number of turns.
    angular, radial, rim, through, through_electrode
        Cells per turn, over the electrode's width, over each rim, through each elastomer layer and
        through each electrode.
    grading, grading_through
        Largest over smallest cell over the electrode's width and through each elastomer layer; the
        small ones lie at the electrode's edges and faces.
    order
        Degree of the cells' geometry.  Straight cells (1) at 12 a turn lose 4.5 % of the volume.
    sectors
        Patterned electrodes: angles in degrees about the axis between which there is electrode, the
        same in every turn; the gaps, which there must be, are elastomer.  The helix begins at 0.
        ``((0, 180),)`` is a half.  Pairs together make one electrode a and one b; a mapping of
        names to pairs, as ``{"left": (10, 170), "right": (190, 350)}``, makes a pair of electrodes
        of each, to be driven by itself.

    Notes
    -----
    Volume groups: ``elastomer``, ``electrode_a``, ``electrode_b``.  Facet groups, disjoint:

    - ``electrode_a_active``, ``electrode_b_active``: broad faces towards an elastomer layer that
      has the other electrode on its far side;
    - ``electrode_a_rim``, ``electrode_b_rim``: all other faces between electrode and elastomer,
      with them the underside of electrode a in the first turn, below which no electrode lies;
    - ``bottom``, ``top``: helicoidal end faces, electrode b's free top face included;
    - ``inner``, ``outer``: cylinders; ``seam``: the radial walls at the two ends of the helix.

    With ``electrode=0`` the active groups are surfaces inside the elastomer, there are no rims, and
    the last turn's electrode b is the free surface ``electrode_b_top``, which ``top`` leaves out.
    A group without facets does not exist (``electrode_b_rim`` where ``inset=0``).

    The rims of a patterned electrode include its radial edges.  Those of named sectors have the
    name after the letter: ``electrode_a_left``, ``electrode_a_left_active``.

    Raises
    ------
    InputError
        A parameter is not usable.
    """

    outer_radius: float = 7e-3
    inner_radius: float = 2e-3
    inset: float = 0.3e-3
    elastomer: float = 0.5e-3
    electrode: float = 0.05e-3
    turns: int = 2
    angular: int = 12
    radial: int = 4
    rim: int = 1
    through: int = 1
    through_electrode: int = 1
    grading: float = 2.0
    grading_through: float = 1.0
    order: int = 2
    sectors: Sequence[tuple[float, float]] | Mapping[str, tuple[float, float]] = ()

    def __post_init__(self) -> None:
        for name in ("outer_radius", "inner_radius", "elastomer"):
            _check.length("HDEA", name, getattr(self, name))
        for name in ("inset", "electrode"):
            _check.length("HDEA", name, getattr(self, name), zero=True)
        if self.inner_radius >= self.outer_radius:
            raise InputError(
                f"HDEA: inner_radius {self.inner_radius:g} m is not below outer_radius "
                f"{self.outer_radius:g} m; make it smaller."
            )
        ring = self.outer_radius - self.inner_radius
        if 2 * self.inset >= ring:
            raise InputError(
                f"HDEA: inset {self.inset:g} m leaves no electrode on a ring {ring:g} m wide; it "
                f"must be below {ring / 2:g} m."
            )
        for name in ("turns", "radial", "rim", "through", "through_electrode"):
            _check.count("HDEA", name, getattr(self, name))
        _check.count("HDEA", "angular", self.angular, least=3)
        for name in ("grading", "grading_through"):
            _check.ratio("HDEA", name, getattr(self, name))
        _check.order("HDEA", self.order)
        object.__setattr__(self, "sectors", checked_sectors("HDEA", self.sectors))
        self._angles()

    # ---- closed forms -----------------------------------------------------------------------

    @property
    def pitch(self) -> float:
        """Axial advance per turn, 2 (elastomer + electrode), in metres."""
        return 2 * (self.elastomer + self.electrode)

    @property
    def height(self) -> float:
        """Total height (turns + 1) pitch in metres."""
        return (self.turns + 1) * self.pitch

    @property
    def volume(self) -> float:
        """pi (r_o^2 - r_i^2) turns pitch, in m^3: shearing along z keeps it."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2) * self.turns * self.pitch

    @property
    def electrode_radii(self) -> tuple[float, float]:
        """Inner and outer radius of the electrodes in metres."""
        return self.inner_radius + self.inset, self.outer_radius - self.inset

    @property
    def flat_area(self) -> float:
        """Plane projection of one turn of electrode, pi (r_2^2 - r_1^2), in m^2."""
        r1, r2 = self.electrode_radii
        return math.pi * (r2**2 - r1**2)

    def helicoid_area(self, r1: float, r2: float) -> float:
        """Area of one turn of helicoid between two radii, in m^2.

        The integral of 2 pi sqrt(r^2 + c^2) dr: pi [r sqrt(r^2 + c^2) + c^2 asinh(r / c)] from r1
        to r2, with c = pitch / (2 pi).
        """
        c = self.pitch / (2 * math.pi)

        def primitive(r: float) -> float:
            return math.pi * (r * math.hypot(r, c) + c * c * math.asinh(r / c))

        return primitive(r2) - primitive(r1)

    @property
    def electrode_area_per_turn(self) -> float:
        """Exact area of one turn of one electrode face, in m^2 (see ``helicoid_area``)."""
        return self.helicoid_area(*self.electrode_radii)

    @property
    def electrode_volume_per_turn(self) -> float:
        """Volume of one turn of one electrode, flat area times thickness, in m^3."""
        return self.flat_area * self.electrode

    def lead_angle(self, r: float) -> float:
        """Angle of the helix at radius ``r`` (m) to the plane across the axis, in radians."""
        return math.atan(self.pitch / (2 * math.pi * _check.length("HDEA.lead_angle", "r", r)))

    def measures(self) -> dict[str, float]:
        """Exact volume (m^3) or area (m^2) of every group."""
        n, pitch = self.turns, self.pitch
        face = self.helicoid_area(self.inner_radius, self.outer_radius)
        found = {
            "bottom": face,
            "top": face,
            "inner": 2 * math.pi * self.inner_radius * n * pitch,
            "outer": 2 * math.pi * self.outer_radius * n * pitch,
            "seam": 2 * (self.outer_radius - self.inner_radius) * pitch,
            "elastomer": self.volume,
        }

        def add(name: str, size: float) -> None:
            found[name] = found.get(name, 0.0) + size

        for sector in self._pattern:
            a, b = (f"electrode_{e}{sector.suffix}" for e in "ab")
            broad = sector.share * self.electrode_area_per_turn
            if self.electrode == 0:
                add(f"{a}_active", n * broad)
                add(f"{b}_active", (n - 1) * broad)
                add(f"{b}_top", broad)
                found["top"] -= broad if self.inset > 0 or not sector.whole else face
                continue
            metal = n * sector.share * self.electrode_volume_per_turn
            edges = self._edge_area(sector)
            for e in (a, b):
                add(e, metal)
                add(f"{e}_active", (2 * n - 1) * broad)
                add(f"{e}_rim", edges + (broad if e == a else 0.0))
            found["elastomer"] -= 2 * metal
        return {name: value for name, value in found.items() if value > 0}

    def _edge_area(self, sector: Sector) -> float:
        """Area in m^2 of an electrode's edges towards the elastomer: along cylinders and radii."""
        r1, r2 = self.electrode_radii
        arcs = 2 * math.pi * sector.share * (r1 + r2) * self.turns if self.inset > 0 else 0.0
        if sector.whole:
            return arcs * self.electrode
        # an edge at the angle 0 lies on the seam once: at the helix's beginning or its end
        ends = sum(self.turns - (angle == 0) for angle in (sector.start, sector.end % 360))
        return (arcs + ends * (r2 - r1)) * self.electrode

    # ---- mesh -------------------------------------------------------------------------------

    def refine(self, factor: int) -> HDEA:
        """The same device with all divisions multiplied by ``factor``."""
        k = _check.count("HDEA.refine", "factor", factor)
        names = ("angular", "radial", "rim", "through", "through_electrode")
        return replace(self, **{name: k * getattr(self, name) for name in names})

    def _radii(self) -> tuple[Floats, int, int]:
        """Cell ends in r, and the first electrode column and the first one beyond."""
        r1, r2 = self.electrode_radii
        middle = r1 + (r2 - r1) * graded(self.radial, self.grading)
        if self.inset == 0:
            return middle, 0, self.radial
        inner = np.linspace(self.inner_radius, r1, self.rim + 1)
        outer = np.linspace(r2, self.outer_radius, self.rim + 1)
        return joined_ends(inner, middle, outer), self.rim, self.rim + self.radial

    @property
    def _pattern(self) -> tuple[Sector, ...]:
        """Its sectors; a whole ring where there is no pattern."""
        return tuple(self.sectors) or (Sector(0.0, 360.0),)  # type: ignore[arg-type,return-value]

    def _angles(self) -> Floats:
        """Cell ends over one turn in degrees."""
        return angular_ends("HDEA", self._pattern, self.angular)

    def _layers(self) -> tuple[Floats, Ints]:
        """Cell ends in zeta, and the first row of each layer (and the row above the last)."""
        soft = self.elastomer * graded(self.through, self.grading_through)
        hard = np.linspace(0.0, self.electrode, self.through_electrode + 1)
        pieces = [soft, hard, soft, hard] if self.electrode > 0 else [soft, soft]
        starts = np.cumsum([0.0] + [piece[-1] for piece in pieces[:-1]])
        ends = joined_ends(*(a + piece for a, piece in zip(starts, pieces, strict=True)))
        rows = np.cumsum([0] + [len(piece) - 1 for piece in pieces])
        return ends, rows

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        radii, first, beyond = self._radii()
        ends, rows = self._layers()
        q, per_turn, steps = self.order, self.angular, self.turns * self.angular
        cell, (kr, kt, kz) = block((len(radii) - 1, steps, len(ends) - 1), q)

        # A node is known by r, its angle within the turn, and its height in node rows counted from
        # the first turn's underside: so the top of a turn and the underside of the next are one.
        lines = lattice_points(radii, q), lattice_points(ends, q)
        column, turn = kt % (q * per_turn), kt // (q * per_turn)
        row = turn * (len(lines[1]) - 1) + kz
        shape = (len(lines[0]), q * per_turn, (self.turns + 1) * (len(lines[1]) - 1) + 1)
        cells, used = compact(np.ravel_multi_index((kr, column, row), shape))
        kr, column, row = np.unravel_index(used, shape)
        turn, kz = np.divmod(row, len(lines[1]) - 1)
        around = lattice_points(self._angles() / 360, q)[column]
        angle = 2 * math.pi * around
        r = lines[0][kr]
        z = self.pitch * (turn + around) + lines[1][kz]
        mesh = StructuredMesh(np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), cells)

        wide, deep = len(radii) - 1, len(ends) - 1
        mesh.add_facets("bottom", (cell[2] == 0) & (cell[1] < per_turn), 2, 0)
        mesh.add_facets("inner", cell[0] == 0, 0, 0)
        mesh.add_facets("outer", cell[0] == wide - 1, 0, 1)
        mesh.add_facets("seam", cell[1] == 0, 1, 0)
        mesh.add_facets("seam", cell[1] == steps - 1, 1, 1)
        soft = np.ones(len(cells), dtype=bool)
        bare = (cell[2] == deep - 1) & (cell[1] >= steps - per_turn)
        middle = np.convolve(self._angles(), [0.5, 0.5], "valid")[cell[1] % per_turn]
        for sector in self._pattern:
            under = (cell[0] >= first) & (cell[0] < beyond) & sector.holds(middle)
            if self.electrode > 0:
                soft &= ~self._add_electrodes(mesh, sector, cell, rows, under)
            else:
                self._add_surfaces(mesh, sector, cell, rows, under)
                mesh.add_facets(f"electrode_b{sector.suffix}_top", bare & under, 2, 1)
                bare &= ~under
        mesh.regions = {"elastomer": np.flatnonzero(soft), **mesh.regions}
        mesh.add_facets("top", bare, 2, 1)
        return mesh

    def _add_surfaces(
        self, mesh: StructuredMesh, sector: Sector, cell: tuple[Ints, ...], rows: Ints, under: Mask
    ) -> None:
        """Ideal electrodes of a sector; ``under`` marks the cells between their edges."""
        _, step, row = cell
        last_turn = step >= (self.turns - 1) * self.angular
        a, b = (f"electrode_{e}{sector.suffix}_active" for e in "ab")
        mesh.add_facets(a, under & (row == rows[1] - 1), 2, 1)
        mesh.add_facets(b, under & (row == rows[2] - 1) & ~last_turn, 2, 1)

    def _add_electrodes(
        self, mesh: StructuredMesh, sector: Sector, cell: tuple[Ints, ...], rows: Ints, under: Mask
    ) -> Mask:
        """Finite electrodes of a sector, and their faces; a mask of their cells."""
        column, step, row = cell
        first_turn = step < self.angular
        last_turn = step >= (self.turns - 1) * self.angular
        a = under & (row >= rows[1]) & (row < rows[2])
        b = under & (row >= rows[3])
        name_a, name_b = (f"electrode_{e}{sector.suffix}" for e in "ab")
        mesh.add_region(name_a, a)
        mesh.add_region(name_b, b)
        # Between a and the next b above lies elastomer everywhere; between b and the a above it
        # only where a further turn follows, between a and the b below only where one came before.
        mesh.add_facets(f"{name_a}_active", a & (row == rows[2] - 1), 2, 1)
        mesh.add_facets(f"{name_a}_active", a & (row == rows[1]) & ~first_turn, 2, 0)
        mesh.add_facets(f"{name_b}_active", b & (row == rows[3]), 2, 0)
        mesh.add_facets(f"{name_b}_active", b & (row == rows[4] - 1) & ~last_turn, 2, 1)
        mesh.add_facets(f"{name_a}_rim", a & (row == rows[1]) & first_turn, 2, 0)
        steps = np.arange(self.turns * self.angular)
        middles = np.convolve(self._angles(), [0.5, 0.5], "valid")[steps % self.angular]
        held = sector.holds(middles)
        begins, ends = held & ~np.roll(held, 1), held & ~np.roll(held, -1)
        begins[0] = ends[-1] = False  # the seam
        for name, part in ((f"{name_a}_rim", a), (f"{name_b}_rim", b)):
            if self.inset > 0:
                mesh.add_facets(name, part & (column == np.min(column[under])), 0, 0)
                mesh.add_facets(name, part & (column == np.max(column[under])), 0, 1)
            mesh.add_facets(name, part & begins[step], 1, 0)
            mesh.add_facets(name, part & ends[step], 1, 1)
        return a | b


def main(arguments: list[str] | None = None) -> int:
    """``python -m dea_fenicsx.geometry.hdea``: write a .msh, print measures against closed form."""
    from ._cli import parameter_parser, run

    parser = parameter_parser(
        "dea_fenicsx.geometry.hdea",
        "Mesh of a helical dielectric elastomer actuator.",
        HDEA,
        {
            "outer_radius": "outer radius in m",
            "inner_radius": "inner radius in m",
            "inset": "distance of the electrodes from both cylinders in m",
            "elastomer": "thickness of an elastomer layer in m",
            "electrode": "thickness of an electrode in m; 0 for ideal surfaces",
            "turns": "whole number of turns",
            "angular": "cells per turn",
            "radial": "cells over the electrode's width",
            "rim": "cells over each rim",
            "through": "cells through each elastomer layer",
            "through_electrode": "cells through each electrode",
            "grading": "largest over smallest cell over the electrode's width",
            "grading_through": "largest over smallest cell through an elastomer layer",
            "order": "degree of the cells' geometry, 1 or 2",
        },
    )
    return run(parser, HDEA, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
