"""Helical dielectric elastomer actuator (HDEA): a double helix of bonded turns."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.errors import InputError
from dea_fenicsx.units import in_si

from . import _check
from ._structured import Floats, Ints, StructuredMesh, block, compact, joined_ends, lattice_points
from .base import Geometry
from .grading import graded


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
        r1, r2 = self.electrode_radii
        broad = self.electrode_area_per_turn
        face = self.helicoid_area(self.inner_radius, self.outer_radius)
        metal = n * self.electrode_volume_per_turn
        found = {"elastomer": self.volume - 2 * metal}
        if self.electrode > 0:
            edges = 2 * math.pi * (r1 + r2) * n * self.electrode if self.inset > 0 else 0.0
            found |= {
                "electrode_a": metal,
                "electrode_b": metal,
                "electrode_a_active": (2 * n - 1) * broad,
                "electrode_b_active": (2 * n - 1) * broad,
                "electrode_a_rim": broad + edges,
                "electrode_b_rim": edges,
                "top": face,
            }
        else:
            found |= {
                "electrode_a_active": n * broad,
                "electrode_b_active": (n - 1) * broad,
                "electrode_b_top": broad,
                "top": face - broad if self.inset > 0 else 0.0,
            }
        found |= {
            "bottom": face,
            "inner": 2 * math.pi * self.inner_radius * n * pitch,
            "outer": 2 * math.pi * self.outer_radius * n * pitch,
            "seam": 2 * (self.outer_radius - self.inner_radius) * pitch,
        }
        return {name: value for name, value in found.items() if value > 0}

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
        angle = 2 * math.pi * column / (q * per_turn)
        r = lines[0][kr]
        z = self.pitch * (turn + column / (q * per_turn)) + lines[1][kz]
        mesh = StructuredMesh(np.column_stack([r * np.cos(angle), r * np.sin(angle), z]), cells)

        self._name_parts(mesh, cell, rows, (cell[0] >= first) & (cell[0] < beyond))
        wide, deep = len(radii) - 1, len(ends) - 1
        mesh.add_facets("bottom", (cell[2] == 0) & (cell[1] < per_turn), 2, 0)
        mesh.add_facets("inner", cell[0] == 0, 0, 0)
        mesh.add_facets("outer", cell[0] == wide - 1, 0, 1)
        mesh.add_facets("seam", cell[1] == 0, 1, 0)
        mesh.add_facets("seam", cell[1] == steps - 1, 1, 1)
        end = (cell[2] == deep - 1) & (cell[1] >= steps - per_turn)
        if self.electrode > 0:
            mesh.add_facets("top", end, 2, 1)
        else:
            under = (cell[0] >= first) & (cell[0] < beyond)
            mesh.add_facets("electrode_b_top", end & under, 2, 1)
            mesh.add_facets("top", end & ~under, 2, 1)
        return mesh

    def _name_parts(
        self, mesh: StructuredMesh, cell: tuple[Ints, ...], rows: Ints, under: np.ndarray
    ) -> None:
        """Regions and electrode faces; ``under`` marks the cells between the electrodes' edges."""
        _, step, row = cell
        first_turn = step < self.angular
        last_turn = step >= (self.turns - 1) * self.angular
        if self.electrode == 0:
            mesh.add_region("elastomer", np.ones(len(row), dtype=bool))
            mesh.add_facets("electrode_a_active", under & (row == rows[1] - 1), 2, 1)
            mesh.add_facets("electrode_b_active", under & (row == rows[2] - 1) & ~last_turn, 2, 1)
            return

        a = under & (row >= rows[1]) & (row < rows[2])
        b = under & (row >= rows[3])
        mesh.add_region("elastomer", ~(a | b))
        mesh.add_region("electrode_a", a)
        mesh.add_region("electrode_b", b)
        # Between a and the next b above lies elastomer everywhere; between b and the a above it
        # only where a further turn follows, between a and the b below only where one came before.
        mesh.add_facets("electrode_a_active", a & (row == rows[2] - 1), 2, 1)
        mesh.add_facets("electrode_a_active", a & (row == rows[1]) & ~first_turn, 2, 0)
        mesh.add_facets("electrode_b_active", b & (row == rows[3]), 2, 0)
        mesh.add_facets("electrode_b_active", b & (row == rows[4] - 1) & ~last_turn, 2, 1)
        mesh.add_facets("electrode_a_rim", a & (row == rows[1]) & first_turn, 2, 0)
        if self.inset > 0:
            inmost = cell[0] == np.min(cell[0][under])
            outmost = cell[0] == np.max(cell[0][under])
            for name, part in (("electrode_a_rim", a), ("electrode_b_rim", b)):
                mesh.add_facets(name, part & inmost, 0, 0)
                mesh.add_facets(name, part & outmost, 0, 1)


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
