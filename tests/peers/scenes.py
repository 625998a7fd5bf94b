"""The scenes of the comparison, as plain data that every code reads alike.

Straight hexahedra or quadrilaterals from `dea_fenicsx.geometry`; displacement and potential of
degree 2, pressure continuous of degree 1, no augmentation, so that all codes solve one and the same
discrete problem and their answers can agree to eight digits.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from dea_fenicsx.geometry import HDEA, BoxStack, Layer

EPSILON_0 = 8.8541878128e-12


@dataclass(frozen=True)
class Rubber:
    """Constants of a material.

    mu in Pa, Jm of Gent's model or None for neo-Hookean, eps_r of a dielectric or None, and the
    bulk modulus in Pa or None for incompressible rubber.
    """

    mu: float
    Jm: float | None = None
    eps_r: float | None = None
    conducts: bool = False
    bulk: float | None = None


@dataclass(frozen=True)
class Case:
    """One scene.

    Attributes
    ----------
    geometry : from dea_fenicsx.geometry, of order 1
    materials : Rubber of each region
    electrodes : potential in V of each facet group or conducting region, grounds included
    clamped : facet group without displacement
    seen, axis : facet group and axis of the mean displacement that is compared
    steps : equal steps of the voltage ramp
    alone : compared with no peer, which would take too long or too much memory
    axisymmetric : a flat mesh in (r, z) instead of plane strain; the axis is x_min
    sliding : axis along which a facet group does not move, besides the clamp
    pressed : facet group that a rigid plate moves, with its axis and the displacement in m
    peers : codes beside this package that can solve it
    reach : for a branch that is followed through its limit points, displacement in m beyond them;
        the value is that of the last state on the way there that bears the voltages given
    """

    geometry: Any
    materials: dict[str, Rubber]
    electrodes: dict[str, float]
    clamped: str | None
    seen: str
    axis: int
    steps: int = 1
    alone: bool = False
    axisymmetric: bool = False
    sliding: dict[str, int] = field(default_factory=dict)
    pressed: tuple[str, int, float] | None = None
    peers: tuple[str, ...] = ("ngsolve", "plain")
    reach: float | None = None

    def held(self) -> list[tuple[float | None, float | None]]:
        """What a code without arc length holds, step by step: load factor, or displacement in m.

        Displacement takes it over limit points; at rest no voltage moves anything, to first order.
        """
        n = self.steps
        if self.reach is None:
            return [(k / n, None) for k in range(1, n + 1)]
        return [(0.3, None), *((None, k / n * self.reach) for k in range(1, n + 1)), (1.0, None)]

    @property
    def slides(self) -> dict[str, int]:
        """Axes along which facet groups do not move, the axis of symmetry's among them."""
        return {"x_min": 0} | self.sliding if self.axisymmetric else self.sliding

    @property
    def flat(self) -> bool:
        """On quadrilaterals."""
        return bool(self.geometry.dimension == 2)

    def small(self) -> Case:
        """The same forms on a few cells."""
        coarse: dict[str, Any] = {"turns": 1, "angular": 4, "radial": 1, "rim": 1, "through": 1}
        if isinstance(self.geometry, BoxStack):
            layers = tuple(replace(layer, divisions=1) for layer in self.geometry.layers)
            coarse = {"divisions": 2 if self.flat else (2, 1), "layers": layers}
        steps = 1 if self.reach is None else self.steps
        return replace(self, geometry=replace(self.geometry, **coarse), steps=steps)

    @property
    def dielectrics(self) -> list[str]:
        return [name for name, m in self.materials.items() if m.eps_r]


SILICONE = Rubber(80e3, Jm=90.0, eps_r=2.8)
VHB = Rubber(73.7e3, eps_r=4.7)
PLATE = Rubber(73.7e3, conducts=True)


def layers(through: int, thickness: float = 0.5e-3) -> list[Layer]:
    """A passive and an active layer, with cells through each."""
    return [Layer(name, thickness, through) for name in ("passive", "active")]


def bilayer(geometry: Any, volts: float, axis: int, steps: int) -> Case:
    return Case(
        geometry,
        {"passive": Rubber(200e3), "active": SILICONE},
        {"top": volts, "interface_1": 0.0},
        "x_min", "x_max", axis, steps,
    )  # fmt: skip


def helix(turns: int, mesh: dict[str, int], alone: bool = False) -> Case:
    return Case(
        HDEA(turns=turns, order=1, **mesh),
        {"elastomer": VHB, "electrode_a": PLATE, "electrode_b": PLATE},
        {"electrode_a": 6e3, "electrode_b": 0.0},
        "bottom", "top", 2, steps=12, alone=alone,
    )  # fmt: skip


BENDER = bilayer(BoxStack(20e-3, None, layers(8), 120, order=1), 8e3, 1, 8)
FILM = Case(  # a quarter of a free film, 20 mm wide
    BoxStack(10e-3, 10e-3, [Layer("film", 1e-3, 1)], (16, 16), order=1),
    {"film": SILICONE},
    {"top": 20e3, "bottom": 0.0},
    None, "x_max", 0, steps=40, sliding={"x_min": 0, "y_min": 1, "bottom": 2}, reach=51e-3,
)  # fmt: skip
BLOCK = Case(  # a quarter of a block between plates that hold it, pressed to 0.85 of its height
    BoxStack(10e-3, 10e-3, [Layer("block", 10e-3, 6)], (3, 3)),
    {"block": Rubber(80e3, bulk=80e6)},
    {}, "bottom", "x_max", 0, steps=2, sliding={"x_min": 0, "y_min": 1},
    pressed=("top", 2, -1.5e-3), peers=("felupe",),
)  # fmt: skip
MIDDLE = {"angular": 16, "radial": 8, "rim": 2, "through": 2}

CASES = {
    "strip in one step": bilayer(BoxStack(20e-3, 5e-3, layers(2), (40, 10), order=1), 6e3, 2, 1),
    "plane-strain bender": BENDER,
    "pressed block": BLOCK,
    "axisymmetric membrane": replace(BENDER, axisymmetric=True),  # a disc, held along its axis
    "Gent snap-through": FILM,
    "helix, one turn": helix(1, MIDDLE),
    "helix, two turns": helix(2, MIDDLE),
    "helix, ten turns": helix(10, MIDDLE, alone=True),
}
"""By the name in peers.csv."""
