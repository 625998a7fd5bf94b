"""Scenes in time for the comparison: a viscous block under a rising voltage, and the blister.

VHB 4910 with three branches; structured hexahedra.  The film of the blister is that of
demos/blister.py, with the same mesh, groups and imperfection.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dea_fenicsx.geometry import BoxStack, Layer

sys.path.append(str(Path(__file__).parents[2] / "demos"))
import blister

G, LIMIT, EPS = blister.G, blister.LIMIT, 4.8 * blister.EPSILON_0
BRANCHES = blister.BRANCHES


@dataclass(frozen=True)
class TimeCase:
    """One scene.

    Attributes
    ----------
    geometry : with facet groups
    thickness : in m; the nominal field is the voltage over it
    driven : facet group of the electrode; the ground is "bottom"
    clamped, slides : facet groups without displacement, and those that do not move along an axis
    seen : a point in m whose displacement along z is the value
    field : nominal field in units of sqrt(G/eps) at the end
    rate : of the field, per s
    steps : number of fixed steps of the plain script up to that field
    tolerance : of our march
    precise : up to which field, and in how many equal steps, our march goes first
    """

    geometry: Any
    thickness: float
    driven: str
    clamped: tuple[str, ...]
    slides: dict[str, int]
    seen: tuple[float, float, float]
    field: float
    rate: float
    steps: int
    tolerance: float
    precise: tuple[float, int] | None = None

    def small(self) -> TimeCase:
        """The same forms on the same cells over a step or two."""
        share = 2 / self.steps
        return replace(self, field=share * self.field, steps=2, precise=None, tolerance=1e-2)

    @property
    def unit(self) -> float:
        """The voltage in V at which the nominal field is 1."""
        return self.thickness * float((G / EPS) ** 0.5)


def block(n: int, through: int) -> TimeCase:
    """A block of 20 x 20 x 4 mm, clamped at one end, with electrodes on its top and bottom."""
    return TimeCase(
        BoxStack(20e-3, 20e-3, [Layer("film", 4e-3, through)], n), 4e-3, "top", ("x_min",), {},
        (20e-3, 10e-3, 4e-3), field=0.6, rate=0.06, steps=40, tolerance=1e-4,
    )  # fmt: skip


def film(mesh: str, rate: float, steps: int) -> TimeCase:
    """The blister."""
    offset = 0.02 * blister.THICKNESS
    return TimeCase(
        blister.film(mesh, 0.02), blister.THICKNESS, "electrode", ("x_max", "y_max"),
        {"x_min": 0, "y_min": 1}, (0.0, 0.0, offset), field=1.5, rate=rate, steps=steps,
        tolerance=1e-4, precise=(blister.EARLY, 100),
    )  # fmt: skip


CASES = {
    "block of 50 000 unknowns": block(18, 4),
    "blister, coarse": film("coarse", 1e-2, 600),
    "blister": film("medium", 1e-2, 600),
}
"""By the name in peers_in_time.csv.  600 steps up to 1.5 are those of the literature's blister."""
