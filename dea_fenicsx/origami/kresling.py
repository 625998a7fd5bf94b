"""Kinematics of one storey of the Kresling spiral box (thesis section 5.2.1, eq 63 to 72), mended.

Two regular polygons of side a, one above the other at height h and turned by the twist phi, are
joined by edges of length b, from each corner to its own partner above, and by diagonals of length
c, to the next partner.  On the circle of the corners, of radius R = a/(2 sin(pi/n)):

    b^2 = h^2 + s(phi)^2,   c^2 = h^2 + s(phi + 2 pi/n)^2,   s(x) = 2 R sin(x/2)

The thesis prints s(x) = R sin(x) (eq 65 and 66) and theta = phi + pi/4.  Sides and edges are rigid
panels; the diagonal is a spring k of rest length c0, and everything below is the energy
U = k (c - c0)^2/2 (eq 69) of one diagonal.  Lengths in m, angles in rad, forces in N.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from inspect import signature
from typing import Any, ClassVar, Literal, get_args
from warnings import warn

import numpy as np
from scipy.optimize import minimize_scalar

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import one_of, positive

EndTwist = Literal["free", "held"]
TWISTS: tuple[EndTwist, ...] = get_args(EndTwist)
Chords = Literal["right", "printed"]
CHORDS: tuple[Chords, ...] = get_args(Chords)


@dataclass(frozen=True, eq=False)
class StoreyState:
    """A storey at one height, or at an array of heights.

    Attributes
    ----------
    height, edge, diagonal : h, b and c in m
    twist : phi in rad
    strain : (c - c0)/c0 of the diagonal (eq 67)
    energy_density : strain^2/2, over the modulus (eq 68; of a unit volume, not length)
    energy : k (c - c0)^2/2 in J (eq 69)
    force : dU/d(-h) along the path in N, positive if it must be pushed down
    torque : in N m, that holds the twist, against it; 0 where the twist is free
    partial_force : eq 72a in N, k h (c0/c - 1): dU/d(-h) at fixed twist
    partial_torque : eq 72b mended in N m, dU/d(-phi) at fixed height
    panel_angle : gamma in rad, from the base up to the panel that stands on it; NaN if the
        storey is no solid
    """

    height: Any
    twist: Any
    edge: Any
    diagonal: Any
    strain: Any
    energy_density: Any
    energy: Any
    force: Any
    torque: Any
    partial_force: Any
    partial_torque: Any
    panel_angle: Any


@in_si(side="m", edge="m", stiffness="N/m", height="m")
@dataclass(frozen=True, eq=False)
class Kresling:
    """One storey of a Kresling box.

    Parameters
    ----------
    side
        Side a of the polygon in m: the width of a cell.
    edge
        Length b of the edges at rest in m: the height of a cell before it is folded.
    stiffness
        k of a diagonal in N/m.
    height
        At rest in m.  By default that of the folded box of flat rectangular cells a x b, whose
        diagonal sqrt(a^2 + b^2) is without strain there and at height b.
    sides
        Of the polygon.
    twist
        ``"free"``: edges keep their length and the storey turns as it is pressed.  ``"held"``: the
        twist at rest is kept, and edges change length without force.
    chords
        ``"right"``.  Deprecated: ``"printed"`` makes a `PrintedKresling` of
        `dea_fenicsx.thesis.errata`, with the chords that the thesis prints.

    Raises
    ------
    InputError
        For lengths that do not close.
    """

    side: float
    edge: float
    stiffness: float = 1.0
    height: float | None = None
    sides: int = 4
    twist: EndTwist = "free"
    chords: Chords = "right"

    is_solid: ClassVar[bool] = True
    """Whether the corners lie on a circle, so that the storey is a solid."""

    def __new__(cls, *values: Any, **named: Any) -> Kresling:
        """A storey; with the deprecated ``chords="printed"`` one of the thesis's errata."""
        if cls is Kresling and "printed" in (named.get("chords"), *values[6:7]):
            errata = "dea_fenicsx.thesis.errata"
            words = f'Kresling(chords="printed") is PrintedKresling of {errata} now.'
            warn(words, DeprecationWarning, stacklevel=2)
            return object.__new__(import_module(errata).PrintedKresling)
        return object.__new__(cls)

    def __post_init__(self) -> None:
        check_declared(self)
        for name in ("side", "edge", "stiffness"):
            positive(getattr(self, name), f"Kresling: {name}", "finite and positive")
        if self.sides < 3:
            raise InputError(f"Kresling: sides is {self.sides}, but a box has 3 or more.")
        for name, known in (("twist", TWISTS), ("chords", CHORDS)):
            one_of(getattr(self, name), known, f"Kresling: {name}", f"one of {known}")
        if self.height is None:
            least = self.side / np.tan(np.pi / self.sides)
            if self.edge < least * (1 - 1e-12):
                raise InputError(
                    f"Kresling: the pattern cannot close: cells {self.side:g} m wide must be at "
                    f"least {least:g} m high, but edge is {self.edge:g} m."
                )
            object.__setattr__(self, "height", float(np.sqrt(max(self.edge**2 - least**2, 0.0))))
        elif not (0 < self.height <= self.edge):
            raise InputError(
                f"Kresling: height is {self.height:g} m, but must be above 0 and at most the edge, "
                f"{self.edge:g} m."
            )
        elif self.height < self._leaning:
            raise InputError(
                f"Kresling: an edge of {self.edge:g} m does not lean down to {self.height:g} m; "
                f"the least height is {self._leaning:g} m."
            )

    # ------------------------------------------------------------------ geometry

    @property
    def step(self) -> float:
        """Angle of a side seen from the axis, 2 pi/n."""
        return 2 * np.pi / self.sides

    @property
    def radius(self) -> float:
        """R of the circle through the corners in m."""
        return self.side / (2 * np.sin(self.step / 2))

    @property
    def longest_chord(self) -> float:
        """Diameter of the circle through the corners in m."""
        return 2 * self.radius

    @property
    def contact_twist(self) -> float:
        """pi - 2 pi/n: all diagonals meet on the axis and neighbouring panels lie on each other.

        A solid box stops here.  At larger twists its panels would have gone through each other;
        a box of flat cells is at rest exactly here, so what the thesis computes from its rest down
        is the energy of the linkage only.
        """
        return np.pi - self.step

    @property
    def lowest(self) -> float:
        """Least height in m; 0 if the edges are short enough to lie down, or not rigid."""
        return self._leaning if self.twist == "free" else 0.0

    @property
    def _leaning(self) -> float:
        return float(np.sqrt(max(self.edge**2 - self.longest_chord**2, 0.0)))

    @cached_property
    def rest_twist(self) -> float:
        """phi at rest; pi - 2 pi/n for flat cells."""
        flat = self.contact_twist
        phi = float(self.twist_at(self.height))
        return flat if abs(phi - flat) < 1e-12 else phi

    @cached_property
    def rest_diagonal(self) -> float:
        """c0 in m."""
        return float(np.sqrt(self.height**2 + self._chord2(self.rest_twist + self.step)))  # type: ignore[operator]

    def twist_at(self, height: Any) -> Any:
        """The smallest twist phi >= 0, in rad, of a storey with rigid edges at a height."""
        return 2 * np.arcsin(self._chord_share(height))

    def _chord_share(self, height: Any) -> Any:
        """Chord under an edge at a height, as a share of the longest chord."""
        h = np.asarray(height, dtype=float)
        share = np.sqrt((self.edge - h) * (self.edge + h)) / self.longest_chord
        return np.minimum(share, 1.0)

    def _chord2(self, x: Any) -> Any:
        """Square of the chord of a central angle x, in m^2."""
        return 4 * self.radius**2 * np.sin(x / 2) ** 2

    def _slope(self, x: Any) -> Any:
        """Derivative of `_chord2`."""
        return 2 * self.radius**2 * np.sin(x)

    # ------------------------------------------------------------------ states

    def at(self, height: Any) -> StoreyState:
        """The state at a height, or at an array of heights.

        Raises
        ------
        InputError
            For a height that the storey cannot have.
        """
        h = np.asarray(si(height, "m", "Kresling: height"), dtype=float)
        low, high = self.lowest, self.edge if self.twist == "free" else np.inf
        if not np.all((h >= low * (1 - 1e-12)) & (h <= high * (1 + 1e-12))):
            raise InputError(f"Kresling: heights must lie between {low:g} and {high:g} m.")
        h = np.clip(h, low, high)
        phi = self.twist_at(h) if self.twist == "free" else np.full(h.shape, self.rest_twist)
        return self._state(h, phi)

    def at_twist(self, twist: Any) -> StoreyState:
        """The state at a twist phi in rad of a storey of free twist.

        Raises
        ------
        InputError
            If the twist is held, or the edges are too short for this one.
        """
        if self.twist == "held":
            raise InputError("Kresling: the twist is held; give heights instead, with at().")
        phi = np.asarray(si(twist, "rad", "Kresling: twist"), dtype=float)
        left = self.edge**2 - self._chord2(phi)
        if not np.all(left >= -1e-12 * self.edge**2):
            raise InputError(
                f"Kresling: the edge of {self.edge:g} m is too short for a twist of "
                f"{np.degrees(np.abs(phi).max()):g} degrees."
            )
        return self._state(np.sqrt(np.maximum(left, 0.0)), phi)

    def _state(self, h: Any, phi: Any) -> StoreyState:
        psi, k, c0 = phi + self.step, self.stiffness, self.rest_diagonal
        c = np.sqrt(h**2 + self._chord2(psi))
        change = self._square_change(h, phi) / (c + c0)  # c - c0, without cancellation
        partial_force = -k * h * change / c
        partial_torque = -k * self._slope(psi) * change / (2 * c)
        free = self.twist == "free"
        force = self._path_force(h, phi, c) if free else partial_force
        strain = change / c0
        values = (h, phi, np.sqrt(h**2 + self._chord2(phi)), c, strain, strain**2 / 2,
                  k * change**2 / 2, force, np.zeros(np.shape(phi)) if free else partial_torque,
                  partial_force, partial_torque, self._panel_angle(h, phi))  # fmt: skip
        return StoreyState(*(np.asarray(v)[()] for v in values))

    def _panel_angle(self, h: Any, phi: Any) -> Any:
        """Angle gamma in rad between the base and the panel that stands on it."""
        inward = self.radius * (np.cos(self.step / 2) - np.cos(phi + self.step / 2))
        return np.arctan2(h, inward)

    def _square_change(self, h: Any, phi: Any) -> Any:
        """c^2 - c0^2 in m^2; of rigid edges 2 a R [sin(phi + pi/n) - sin(phi0 + pi/n)]."""
        phi0 = self.rest_twist
        if self.twist == "held":
            return (h - self.height) * (h + self.height)
        middle = np.cos((phi + phi0 + self.step) / 2)
        return 4 * self.side * self.radius * middle * np.sin((phi - phi0) / 2)

    def _path_force(self, h: Any, phi: Any, c: Any) -> Any:
        """dU/d(-h) with rigid edges: k h (1 - c0/c) [s2'(phi + 2 pi/n)/s2'(phi) - 1], s2 = s^2."""
        change = self._square_change(h, phi)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = change / self._slope(phi)
        # The ratio is 0/0 if a state with vertical edges has no strain; half angles avoid this.
        share = self.side / (self.radius * np.cos(phi / 2))
        if self.rest_twist == self.contact_twist:
            ratio = -share * np.sin((phi - self.rest_twist) / 2)
        elif self.rest_twist == 0:
            ratio = share * np.cos((phi + self.step) / 2)
        turn = self._slope(phi + self.step) - self._slope(phi)
        return self.stiffness * h * ratio * turn / (c * (c + self.rest_diagonal))

    # ------------------------------------------------------------------ what happens on the path

    @property
    def strain_free(self) -> list[tuple[float, float]]:
        """Twist and height of all states without strain, deployed first.

        With rigid edges the diagonal, c^2 = b^2 + 2 a R sin(phi + pi/n), has its rest length at
        phi0 and at pi - 2 pi/n - phi0.  A negative twist is a box that leans the other way.
        """
        rest = (float(self.rest_twist), float(self.height))  # type: ignore[arg-type]
        if self.twist == "held":
            return [rest]
        other = np.pi - self.step - self.rest_twist
        left = self.edge**2 - self._chord2(other)
        if left < 0 or other == self.rest_twist:
            return [rest]
        return sorted([rest, (float(other), float(np.sqrt(left)))])

    def barrier(self) -> StoreyState:
        """The state of largest strain between the two without, at phi = pi/2 - pi/n."""
        self._need_two("a barrier")
        return self.at_twist((np.pi - self.step) / 2)

    def snap_forces(self) -> tuple[float, float]:
        """Forces in N that take the storey over its barrier: pushed from deployed, and pulled back.

        The first is largest, the second most negative, on the way from the state without strain
        to the barrier; inf where the deployed state leans the other way and the storey must pass
        the vertical.
        """
        self._need_two("a snap force")
        (deployed, _), (folded, _) = self.strain_free
        top = (np.pi - self.step) / 2
        push = np.inf if deployed < 0 else self._extreme("force", deployed, top)[1]
        return push, -self._extreme("force", top, folded, sign=-1)[1]

    def peak(self, quantity: str = "force") -> tuple[float, float]:
        """Height in m at which a quantity is largest between rest and the least height; its value.

        Parameters
        ----------
        quantity
            An attribute of `StoreyState`: ``"force"``, or ``"partial_force"`` as in eq 72a.
        """
        if self.twist == "held":
            heights = np.linspace(self.height, 0.0, 401)  # type: ignore[arg-type]
            return self._refine(lambda h: float(getattr(self.at(h), quantity)), heights)
        start, end = self.rest_twist, float(self.twist_at(self.lowest))
        twist, value = self._extreme(quantity, start, end)
        return float(self.at_twist(twist).height), value

    def _extreme(self, name: str, low: float, high: float, sign: int = 1) -> tuple[float, float]:
        return self._refine(
            lambda phi: sign * float(getattr(self.at_twist(phi), name)), np.linspace(low, high, 401)
        )

    @staticmethod
    def _refine(f: Any, grid: np.ndarray) -> tuple[float, float]:
        values = np.array([f(x) for x in grid])
        best = int(np.nanargmax(values))
        ends = sorted((grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]))
        found = minimize_scalar(lambda x: -f(x), bounds=ends, method="bounded",
                                options={"xatol": 1e-12 * abs(ends[1])})  # fmt: skip
        if -found.fun > values[best]:
            return float(found.x), float(-found.fun)
        return float(grid[best]), float(values[best])

    def _need_two(self, what: str) -> None:
        if len(self.strain_free) < 2:
            raise InputError(
                f"Kresling: {what} lies between two states without strain, but this storey has one."
            )


# `__new__` takes anything, so that the old option is seen; the fields are those of `__init__`.
Kresling.__signature__ = signature(Kresling.__init__).replace(  # type: ignore[attr-defined]
    parameters=list(signature(Kresling.__init__).parameters.values())[1:]
)


def strokes(start: Any, end: Any, collapsed: Any) -> dict[str, Any]:
    """A stroke from one height to another as a share of three lengths.

    ``of_start`` is a contraction, at most 1.  ``of_end`` is that of the way back, an extension.
    ``of_collapsed`` is over the height of the folded layers, by which the thesis's 400 % and 700 %
    are meant (section 5.3).
    """
    loss = np.asarray(start) - np.asarray(end)
    return {"of_start": loss / start, "of_end": loss / end, "of_collapsed": loss / collapsed}
