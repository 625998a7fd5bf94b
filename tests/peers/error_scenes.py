"""The scenes of `to_error`: their meshes, their known answers, and the fastest choices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from dea_fenicsx.geometry import BoxStack, HollowSphere
from tests.peers.scenes import EPSILON_0, VHB, Case, bilayer, layers

GRADED = 30.0
"""Largest over smallest cell along a strip: the field is singular at its ends."""

INNER, OUTER, VOLTS = 1e-3, 2e-3, 15e3
"""Radii of the sphere in m, and the voltage between them."""

Mesh = tuple[int, ...]


class Choice(NamedTuple):
    """How a scene is solved: degree of the displacement, cells, and steps of the ramp."""

    degree: int
    mesh: Mesh
    steps: int

    def told(self) -> str:
        """As on the command line: "3,10x1,2"."""
        return f"{self.degree},{'x'.join(map(str, self.mesh))},{self.steps}"

    @classmethod
    def read(cls, text: str) -> Choice:
        """The choice that `told` tells."""
        degree, mesh, steps = text.split(",")
        return cls(int(degree), tuple(map(int, mesh.split("x"))), int(steps))


@dataclass(frozen=True)
class Sphere(Case):
    """The upper half of a thick sphere, as a section: its poles lie on the axis."""

    @property
    def slides(self) -> dict[str, int]:
        return {"axis": 0, "equator": 1}

    def small(self) -> Case:
        return replace(self, geometry=replace(self.geometry, layers=1, cells=1))


def strip(mesh: Mesh, steps: int) -> Case:
    """20 x 5 x 1 mm, 6 kV."""
    box = BoxStack(20e-3, 5e-3, layers(mesh[2]), mesh[:2], order=1, grading=(GRADED, 1.0))
    return bilayer(box, 6e3, 2, steps)


def beam(mesh: Mesh, steps: int) -> Case:
    """20 x 2 x 1 mm, 8 kV."""
    box = BoxStack(20e-3, 2e-3, layers(mesh[2]), mesh[:2], order=1, grading=(GRADED, 1.0))
    return bilayer(box, 8e3, 2, steps)


def bender(mesh: Mesh, steps: int) -> Case:
    """20 x 1 mm in plane strain, 8 kV."""
    box = BoxStack(20e-3, None, layers(mesh[1]), mesh[0], order=1, grading=GRADED)
    return bilayer(box, 8e3, 1, steps)


def disc(mesh: Mesh, steps: int) -> Case:
    """A disc, radius 20 mm, held along its axis, 8 kV."""
    return replace(bender(mesh, steps), axisymmetric=True)


def sphere(mesh: Mesh, steps: int) -> Case:
    """A thick sphere between two electrodes, as an axisymmetric section."""
    wall = HollowSphere(INNER, OUTER, layers=mesh[0], cells=mesh[1], order=2)
    return Sphere(
        wall, {"wall": VHB}, {"inner": VOLTS, "outer": 0.0}, None, "outer", 1, steps,
        axisymmetric=True,
    )  # fmt: skip


def sphere_value() -> float:
    """Mean displacement of the sphere's outer face along the axis in m, exact.

    r^3 = R^3 + c, and the pressure of the wall, int 2 (s_hoop - s_r)/r dr, is 0; the mean over half
    a sphere of a displacement along the radius is half of it.
    """
    from scipy.optimize import brentq

    def radius(R: Any, c: float) -> Any:
        return np.cbrt(R**3 + c)

    def pressure(c: float) -> float:
        a, b = radius(INNER, c), radius(OUTER, c)
        nodes, weights = np.polynomial.legendre.leggauss(40)
        r = (a + b) / 2 + (b - a) / 2 * nodes
        hoop = r / np.cbrt(r**3 - c)
        field = VOLTS / (1 / a - 1 / b) / r**2
        eps = (VHB.eps_r or 0.0) * EPSILON_0
        stress = VHB.mu * (hoop**2 - hoop**-4) - eps * field**2
        return float(weights @ (2 * stress / r) * (b - a) / 2)

    c = brentq(pressure, 0.0, OUTER**3, xtol=1e-25, rtol=1e-14)
    return float(radius(OUTER, c) - OUTER) / 2


def unrolled(case: Case) -> tuple[np.ndarray, Callable[[], Any]]:
    """For NGSolve: the sphere's nodes in the plane of radius and angle, and what curves this plane.

    The radius is relative to the outer one; the functions give the change of place.
    """
    low = case.geometry.mesh().points
    rho, angle = np.hypot(low[:, 0], low[:, 1]) / OUTER, np.arctan2(low[:, 1], low[:, 0])

    def change() -> Any:
        import ngsolve as ng

        return ng.CF((ng.x * ng.cos(ng.y) - ng.x, ng.x * ng.sin(ng.y) - ng.y))

    return np.column_stack([rho, angle, 0 * rho]), change


@dataclass(frozen=True)
class Scene:
    """A scene of the comparison.

    Attributes
    ----------
    build
        Its case for a mesh and a number of steps.
    value
        The converged displacement in m.
    meshes
        Meshes by the degree, coarse to fine, for either code.
    """

    build: Callable[[Mesh, int], Case]
    value: float
    meshes: dict[int, tuple[Mesh, ...]]


FLAT: dict[int, tuple[Mesh, ...]] = {
    2: ((10, 1), (14, 1), (20, 1), (28, 1), (40, 2), (56, 2), (80, 4)),
    3: ((5, 1), (7, 1), (10, 1), (14, 1), (20, 1), (28, 2), (40, 2)),
    4: ((3, 1), (5, 1), (7, 1), (10, 1), (14, 1), (20, 1), (28, 2)),
    5: ((2, 1), (3, 1), (5, 1), (7, 1), (10, 1), (14, 1)),
}
ROUND: dict[int, tuple[Mesh, ...]] = {
    2: ((1, 2), (2, 2), (2, 4), (3, 4), (4, 4), (4, 8), (8, 8)),
    3: ((1, 1), (1, 2), (2, 2), (2, 4), (3, 4), (4, 8)),
    4: ((1, 1), (1, 2), (2, 2), (2, 4), (3, 4)),
    5: ((1, 1), (1, 2), (2, 2), (2, 3)),
}
SOLID: dict[int, tuple[Mesh, ...]] = {
    2: ((10, 3, 1), (15, 4, 1), (20, 5, 1), (30, 6, 1), (30, 8, 2), (40, 10, 2)),
    3: ((6, 2, 1), (8, 3, 1), (12, 3, 1), (12, 4, 1), (16, 5, 1), (20, 6, 1), (30, 8, 1)),
    4: ((4, 1, 1), (6, 2, 1), (8, 3, 1), (12, 4, 1), (16, 5, 1)),
    5: ((3, 1, 1), (4, 2, 1), (6, 2, 1), (8, 3, 1)),
}

SCENES: dict[str, Scene] = {
    "strip": Scene(strip, -2.30203e-3, SOLID),
    "beam": Scene(beam, -4.00902e-3, SOLID),
    "bender": Scene(bender, -5.71269e-3, FLAT),
    "disc": Scene(disc, -2.00260e-3, FLAT),
    "sphere": Scene(sphere, sphere_value(), ROUND),
}


def unrolled_for(scene: str) -> Callable[[Case], Any] | None:
    """What curves the cells of a scene in NGSolve; None where they are straight."""
    return unrolled if scene == "sphere" else None


def _read(text: str) -> tuple[Choice, ...]:
    return tuple(map(Choice.read, text.split()))


QUICK: dict[str, dict[str, tuple[Choice, ...]]] = {
    "strip": {
        "ours": _read("2,11x3x1,1 2,12x3x1,1 3,4x2x1,1 3,5x2x1,1 3,12x3x1,1 3,12x4x1,1"),
        "ngsolve": _read("2,12x3x1,1 2,14x3x1,1 3,4x2x1,1 3,5x2x1,1 4,6x3x1,1 4,8x3x1,1"),
    },
    "beam": {
        "ours": _read("2,22x1x1,2 2,20x2x1,2 3,5x1x1,2 3,6x1x1,2 3,8x2x1,2 3,10x2x1,2 3,12x2x1,2"),
        "ngsolve": _read("2,22x1x1,1 3,4x1x1,1 3,5x1x1,1 3,6x1x1,1 4,4x1x1,1 4,6x2x1,1 3,12x2x1,1"),
    },
    "bender": {
        "ours": _read("2,24x1,2 3,3x1,2 3,4x1,2 4,8x1,2 3,12x2,2 3,14x2,2"),
        "ngsolve": _read("3,3x1,2 3,4x1,2 4,3x1,1 5,14x2,2 4,20x2,2 5,10x2,2 5,20x1,2"),
    },
    "disc": {
        "ours": _read("2,11x1,1 2,12x1,1 3,7x1,1 3,9x1,1 3,10x1,4 4,7x1,4 4,7x1,1"),
        "ngsolve": _read("2,8x1,1 2,10x1,1 3,6x1,1 4,3x1,1 4,6x1,1 4,7x1,1 4,9x1,1"),
    },
    "sphere": {
        "ours": _read("2,2x4,1 2,4x4,1 3,2x2,1 4,1x2,1 3,1x4,1 3,2x4,1 4,1x4,1"),
        "ngsolve": _read("3,1x1,1 4,1x1,1 4,1x2,1 5,1x1,1 5,1x2,1 4,2x2,1"),
    },
}
"""Choices that were among the fastest to 0.1 % or to 0.01 %, and their neighbours."""
