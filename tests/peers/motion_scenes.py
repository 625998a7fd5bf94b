"""Scenes in motion for the comparison: the bilayer beam, and a helix ribbon.

VHB 4910 with three branches and a density of 1000 kg/m^3.  The potential rises as
V (1 - exp(-t/rise)), and steps of time are equal ones.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry._structured import StructuredMesh, lattice
from dea_fenicsx.geometry.base import Geometry
from dea_fenicsx.geometry.grading import graded
from dea_fenicsx.support.compat import dolfinx

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import beam_in_motion as beam

DENSITY = 1000.0
DEGREE = 4
"""Of the quadrature of the plain script."""

SAME = dea.Discretisation(pressure="continuous", augmentation=0.0, quadrature_degree=DEGREE)
OWN = dea.Discretisation()


@dataclass(frozen=True)
class MotionCase:
    """One scene.

    Attributes
    ----------
    device : what makes the device on a communicator
    volts, rise : of the potential, in V and s
    driven, grounds, clamped : facet groups
    seen : a point in m, a node of the mesh
    axis : of the displacement there that is the value
    seconds, steps : how long the motion is followed, and in how many equal steps
    ranks : on which both codes run
    codes : those that take part
    like : the scene whose plain script the value is compared with
    plain_steps : on how many first steps the plain script is timed; 0 for all
    elements : of our own; those of the plain script, with its quadrature, unless said
    """

    device: Callable[[MPI.Comm], dea.Device]
    volts: float
    rise: float
    driven: str
    grounds: tuple[str, ...]
    clamped: str
    seen: tuple[float, float, float]
    axis: str
    seconds: float
    steps: int
    ranks: int = 1
    codes: tuple[str, ...] = ("ours", "plain")
    like: str | None = None
    plain_steps: int = 0
    elements: dea.Discretisation = SAME

    def small(self) -> MotionCase:
        """The same forms on the same cells over two steps."""
        return self.shortened(2)

    def shortened(self, steps: int) -> MotionCase:
        """The first steps alone, each as long as before."""
        steps = min(steps, self.steps)
        return replace(self, seconds=self.seconds * steps / self.steps, steps=steps)

    def drive(self, t: float) -> float:
        """Factor of the voltage."""
        return 1 - math.exp(-t / self.rise)


def beam_of_tetrahedra(comm: MPI.Comm) -> dea.Device:
    """The bilayer of demos/beam_in_motion.py as 20 x 1 x 6 boxes of tetrahedra."""
    size = np.array([beam.LENGTH, beam.SIDE, beam.SIDE])
    mesh = dolfinx.mesh.create_box(
        comm, [np.zeros(3), size], [20, 1, 6], dolfinx.mesh.CellType.tetrahedron,
        ghost_mode=dolfinx.mesh.GhostMode.shared_facet,
    )  # fmt: skip
    mesh.topology.create_connectivity(2, 3)
    heights = {"bottom": 0.0, "middle": beam.SIDE / 2, "top": beam.SIDE}
    places = {"x_min": (0, 0.0)} | {name: (2, z) for name, z in heights.items()}
    facets, tags = [], []
    for tag, (axis, at) in enumerate(places.values(), 1):
        found = dolfinx.mesh.locate_entities(
            mesh, 2, lambda x, axis=axis, at=at: np.isclose(x[axis], at, atol=1e-9)
        )
        facets.append(found)
        tags.append(np.full(len(found), tag, dtype=np.int32))
    joined, order = np.concatenate(facets), np.argsort(np.concatenate(facets))
    marks = dolfinx.mesh.meshtags(mesh, 2, joined[order], np.concatenate(tags)[order])
    surfaces = {name: tag for tag, name in enumerate(places, 1)}
    return dea.from_dolfinx(mesh, facet_tags=marks, regions="film", surfaces=surfaces)


def beam_of_hexahedra(mesh: str) -> Callable[[MPI.Comm], dea.Device]:
    """The bilayer on the hexahedra of the demo."""
    return lambda comm: beam.scene(mesh).device  # of the demo, on all ranks


@dataclass(frozen=True)
class HelixRibbon(Geometry):
    """A ribbon wound on a cylinder: three turns of 10 mm, 5 mm wide, 0.2 mm thick.

    Its cells are curved ones of degree 2.  The angle is measured from the clamped end.
    """

    along: int
    across: int
    through: int = 1
    inner: float = 4.9e-3
    outer: float = 5.1e-3
    width: float = 5e-3
    pitch: float = 10e-3
    turns: float = 3.0

    def measures(self) -> dict[str, float]:
        angle = 2 * math.pi * self.turns
        return {
            "film": (self.outer**2 - self.inner**2) / 2 * angle * self.width,
            "inner": self.inner * angle * self.width, "outer": self.outer * angle * self.width,
            "start": (self.outer - self.inner) * self.width,
        }  # fmt: skip

    def refine(self, factor: int) -> HelixRibbon:
        return replace(self, along=factor * self.along, across=factor * self.across,
                       through=factor * self.through)  # fmt: skip

    def place(self, along: Any, across: Any, through: Any) -> np.ndarray:
        """Positions at shares of the length, the width and the thickness, shape (n, 3)."""
        angle = 2 * math.pi * self.turns * along
        r = self.inner + (self.outer - self.inner) * through
        z = self.pitch * self.turns * along + self.width * across
        return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)

    def mesh(self) -> StructuredMesh:
        counts = (self.through, self.along, self.across)
        mesh, cell = lattice([graded(n) for n in counts], order=2)
        through, along, across = mesh.points.T
        mesh.points[:] = self.place(along, across, through)
        mesh.add_region("film", cell[0] >= 0)
        mesh.add_facets("inner", cell[0] == 0, axis=0, end=0)
        mesh.add_facets("outer", cell[0] == self.through - 1, axis=0, end=1)
        mesh.add_facets("start", cell[1] == 0, axis=1, end=0)
        return mesh


def bilayer(device: Any, middle: str, **options: Any) -> MotionCase:
    """The beam of demos/beam_in_motion.py on some mesh."""
    return MotionCase(
        device, beam.VOLTS, beam.RISE, "top", (middle, "bottom"), "x_min",
        (beam.LENGTH, beam.SIDE / 2, beam.SIDE / 2), "z", seconds=5.0, steps=250, **options,
    )  # fmt: skip


def helix(along: int, across: int) -> MotionCase:
    """The ribbon in motion, 625 steps in 2.5 s; the value is the tip's motion along its axis."""
    ribbon = HelixRibbon(along, across)
    seen = tuple(float(x) for x in ribbon.place(1.0, 0.5, 1.0))
    return MotionCase(
        lambda comm: dea.read_gmsh(ribbon, comm), 1000.0, 0.25, "outer", ("inner",), "start", seen,
        "z", seconds=2.5, steps=625, ranks=2, plain_steps=25,
    )  # fmt: skip


BEAM = "beam in motion"
CASES = {
    BEAM: bilayer(beam_of_tetrahedra, "middle"),
    "beam, coarse hexahedra": bilayer(
        beam_of_hexahedra("coarse"), "interface_1", codes=("ours",), like=BEAM, elements=OWN
    ),
    "beam, medium hexahedra": bilayer(
        beam_of_hexahedra("medium"), "interface_1", codes=("ours",), like=BEAM, elements=OWN
    ),
    "beam, fine hexahedra": bilayer(
        beam_of_hexahedra("fine"), "interface_1", codes=("ours",), like=BEAM, elements=OWN
    ),
    "helix in motion, coarse": helix(40, 3),
    "helix in motion": helix(80, 6),
}  # fmt: skip
"""By the name in the table.  80 x 6 boxes are 2880 tetrahedra, the size of the literature's."""
