"""Helical dielectric elastomer actuator (HDEA): a double helix of bonded turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si

from . import _check
from ._helix import helix_mesh, helix_part, helix_samples
from ._quality import least_and_aspect
from ._structured import Floats, Ints, StructuredMesh, joined_ends
from .base import InParts
from .grading import graded
from .sectors import ANGLE_TOLERANCE_DEG, Sector, angular_ends, checked_sectors

END_KINDS = ("ramp", "flat")


@dataclass(frozen=True)
@in_si(
    outer_radius="m", inner_radius="m", inset="m", elastomer="m", electrode="m", cap="m"
)
class HDEA(InParts):
    """Two electrodes wound as helicoids in an elastomer ring, every turn bonded to the next.

    In helical coordinates r, Theta in [0, 2 pi turns] and zeta in [0, pitch] the body is
    z = pitch Theta / (2 pi) + zeta.  One pitch holds, from below, elastomer, electrode a,
    elastomer, electrode b, once for each strand; the face zeta = pitch of a turn is the face
    zeta = 0 of the next.  The electrodes fill inner_radius + inset < r < outer_radius - inset
    within their layer; the rims of that layer are elastomer.

    Parameters
    ----------
    outer_radius, inner_radius, inset
        In metres.
    elastomer, electrode
        Thicknesses in metres, measured along the axis.  ``electrode=0`` gives ideal surfaces.
    turns, strands
        Whole number of turns, and of actuators wound into one another: two strands have twice the
        pitch.
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
    ends
        ``"ramp"``: the helix ends in two helicoidal faces with a step of one pitch.  ``"flat"``:
        wedges of passive material fill them up to planes.  The thin end of a wedge is left open
        over the first or last cell around, a notch that shrinks as ``angular`` grows.
    cap, through_cap
        With flat ends: thickness in metres of a passive disc on each, and cells through it.

    Notes
    -----
    Volume groups: ``elastomer``, ``electrode_a``, ``electrode_b``.  Facet groups, disjoint:

    - ``electrode_a_active``, ``electrode_b_active``: broad faces towards an elastomer layer that
      has the other electrode on its far side;
    - ``electrode_a_rim``, ``electrode_b_rim``: all other faces between electrode and elastomer,
      with them the underside of electrode a in the first turn, below which no electrode lies;
    - ``bottom``, ``top``: helicoidal end faces, electrode b's free top face included;
    - ``inner``, ``outer``: cylinders; ``seam``: the radial walls at the two ends of the helix.

    With flat ends the wedges and discs are the region ``caps``, ``bottom`` and ``top`` are plane,
    ``notch`` is the surface of the two notches, the seam is bonded, and electrode faces on the caps
    belong to the rims.  The lower end of the helix lies at z = 0, the lower disc below.

    With ``electrode=0`` the active groups are surfaces inside the elastomer, there are no rims, and
    the last turn's electrode b is the free surface ``electrode_b_top``, which ``top`` leaves out
    (with flat ends a surface below the upper cap, which ends at the notch).
    A group without facets does not exist (``electrode_b_rim`` where ``inset=0``).

    On several ranks each makes its own part of the mesh, whatever the parameters.

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
    strands: int = 1
    ends: str = "ramp"
    cap: float = 0.0
    through_cap: int = 1

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
        for name in (
            "turns", "radial", "rim", "through", "through_electrode", "strands", "through_cap"
        ):  # fmt: skip
            _check.count("HDEA", name, getattr(self, name))
        _check.length("HDEA", "cap", self.cap, zero=True)
        if self.ends not in END_KINDS:
            raise InputError(
                f"HDEA: ends is {shown(self.ends)}; it must be one of {', '.join(END_KINDS)}."
            )
        if self.cap > 0 and self.ends == "ramp":
            raise InputError(
                f'HDEA: a cap of {self.cap:g} m needs a plane to lie on; give ends="flat" with it.'
            )
        _check.count("HDEA", "angular", self.angular, least=3)
        for name in ("grading", "grading_through"):
            _check.ratio("HDEA", name, getattr(self, name))
        _check.order("HDEA", self.order)
        object.__setattr__(self, "sectors", checked_sectors("HDEA", self.sectors))
        self.angular_ends()

    # ---- closed forms -----------------------------------------------------------------------

    @property
    def pitch(self) -> float:
        """Axial advance per turn, strands times 2 (elastomer + electrode), in metres."""
        return self.strands * 2 * (self.elastomer + self.electrode)

    @property
    def height(self) -> float:
        """Total height (turns + 1) pitch + 2 cap in metres."""
        return (self.turns + 1) * self.pitch + 2 * self.cap

    @property
    def volume(self) -> float:
        """In m^3: pi (r_o^2 - r_i^2) turns pitch, as shearing along z keeps it, and the caps."""
        return self._ring * self.turns * self.pitch + self.cap_volume

    @property
    def _ring(self) -> float:
        """Area across the axis in m^2."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def _notches(self) -> tuple[float, float]:
        """Angle of the notches below and above, as shares of a turn."""
        around = self.angular_ends() / 360
        return float(around[1]), float(1 - around[-2])

    @property
    def cap_volume(self) -> float:
        """Volume of wedges and discs in m^3; 0 where the ends are ramps."""
        if self.ends == "ramp":
            return 0.0
        return self._ring * sum(self.cap + self.pitch * (1 - s * s) / 2 for s in self._notches)

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
        n, pitch, flat = self.turns, self.pitch, self.ends == "flat"
        layers = n * self.strands
        face = self.helicoid_area(self.inner_radius, self.outer_radius)
        wall = n * pitch + self.cap_volume / self._ring
        found = {
            "bottom": face,
            "top": face,
            "inner": 2 * math.pi * self.inner_radius * wall,
            "outer": 2 * math.pi * self.outer_radius * wall,
            "seam": 2 * (self.outer_radius - self.inner_radius) * pitch,
            "elastomer": self.volume - self.cap_volume,
        }
        free = face  # of the helicoid's upper face, but for ideal electrodes on it
        if flat:
            below, above = self._notches
            disc = self.cap > 0
            open_wall = (self.outer_radius - self.inner_radius) * pitch
            found |= {
                "bottom": self._ring * (1 if disc else 1 - below),
                "top": self._ring * (1 if disc else 1 - above),
                "seam": 0.0,
                "notch": (below + above) * (open_wall + disc * self._ring) + below * face,
                "caps": self.cap_volume,
            }
            free = above * face

        def add(name: str, size: float) -> None:
            found[name] = found.get(name, 0.0) + size

        for sector in self.pattern:
            a, b = (f"electrode_{e}{sector.suffix}" for e in "ab")
            broad = sector.share * self.electrode_area_per_turn
            bare = broad  # of b's uppermost face: over the notch, or over all of the ramp
            if flat:
                over = bool(sector.holds(np.array(360 * (1 - above / 2))))
                bare = over * above * self.electrode_area_per_turn
            if self.electrode == 0:
                add(f"{a}_active", layers * broad)
                add(f"{b}_active", (layers - 1) * broad)
                add(f"{b}_top", broad - bare if flat else broad)
                if not flat:
                    free -= broad if self.inset > 0 or not sector.whole else face
                continue
            metal = layers * sector.share * self.electrode_volume_per_turn
            edges = self.strands * self._edge_area(sector)
            for e in (a, b):
                add(e, metal)
                add(f"{e}_active", (2 * layers - 1) * broad)
                add(f"{e}_rim", edges + (broad if e == a else broad - bare))
            found["elastomer"] -= 2 * metal
        add("notch" if flat else "top", free - (0.0 if flat else face))
        return {name: value for name, value in found.items() if value > 0}

    def _edge_area(self, sector: Sector) -> float:
        """Area in m^2 of a strand's edges towards the elastomer: along cylinders and radii."""
        r1, r2 = self.electrode_radii
        arcs = 2 * math.pi * sector.share * (r1 + r2) * self.turns if self.inset > 0 else 0.0
        # The two ends of the helix are radial edges only if a cap lies against them.
        capped = sector.whole or sector.end > 360 + ANGLE_TOLERANCE_DEG
        cut = 2 * capped if self.ends == "flat" else 0
        if sector.whole:
            return (arcs + cut * (r2 - r1)) * self.electrode
        # an edge at the angle 0 lies on the seam once: at the helix's beginning or its end
        seam = self.ends == "ramp"
        ends = sum(self.turns - (seam and a == 0) for a in (sector.start, sector.end % 360))
        return (arcs + (ends + cut) * (r2 - r1)) * self.electrode

    # ---- mesh -------------------------------------------------------------------------------

    def refine(self, factor: int) -> HDEA:
        """The same device with all divisions multiplied by ``factor``."""
        k = _check.count("HDEA.refine", "factor", factor)
        names = ("angular", "radial", "rim", "through", "through_electrode", "through_cap")
        return replace(self, **{name: k * getattr(self, name) for name in names})

    def radial_ends(self) -> tuple[Floats, int, int]:
        """Cell ends in r, and the first electrode column and the first one beyond."""
        r1, r2 = self.electrode_radii
        middle = r1 + (r2 - r1) * graded(self.radial, self.grading)
        if self.inset == 0:
            return middle, 0, self.radial
        inner = np.linspace(self.inner_radius, r1, self.rim + 1)
        outer = np.linspace(r2, self.outer_radius, self.rim + 1)
        return joined_ends(inner, middle, outer), self.rim, self.rim + self.radial

    @property
    def pattern(self) -> tuple[Sector, ...]:
        """Its sectors; a whole ring where there is no pattern."""
        return tuple(self.sectors) or (Sector(0.0, 360.0),)  # type: ignore[arg-type,return-value]

    def angular_ends(self) -> Floats:
        """Cell ends over one turn in degrees."""
        return angular_ends("HDEA", self.pattern, self.angular)

    def layer_ends(self) -> tuple[Floats, Ints]:
        """Cell ends in zeta over the pitch; first row of each layer of a period, and the end."""
        soft = self.elastomer * graded(self.through, self.grading_through)
        hard = np.linspace(0.0, self.electrode, self.through_electrode + 1)
        period = [soft, hard, soft, hard] if self.electrode > 0 else [soft, soft]
        pieces = self.strands * period
        starts = np.cumsum([0.0] + [piece[-1] for piece in pieces[:-1]])
        ends = joined_ends(*(a + piece for a, piece in zip(starts, pieces, strict=True)))
        return ends, np.cumsum([0] + [len(piece) - 1 for piece in period])

    def mesh(self) -> StructuredMesh:
        """Nodes, cells and named parts as plain arrays."""
        return helix_mesh(self)

    def mesh_part(self, part: int, parts: int) -> StructuredMesh:
        """See `InParts.mesh_part`."""
        return helix_part(self, part, parts)

    def groups_of_parts(self) -> dict[str, int]:
        """See `InParts.groups_of_parts`; a device of few cells has the same groups."""
        few = replace(self, radial=1, rim=1, through=1, through_electrode=1, through_cap=1, order=1)
        return replace(few, turns=min(self.turns, 2)).groups()

    def cell_shape(self, part: int = 0, parts: int = 1) -> tuple[float, float]:
        """See `InParts.cell_shape`; here of one cell of each shape in the device, for any part."""
        samples = helix_samples(self)
        return least_and_aspect(samples.points[samples.cells])


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
            "strands": "whole number of actuators wound into one another",
            "ends": "ramp (helicoidal faces) or flat (wedges up to a plane)",
            "cap": "thickness in m of a passive disc on each flat end",
            "through_cap": "cells through each of these discs",
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
