"""Actuation of the spiral box by its hinges (thesis section 5.3, Table 5.3, chapter 6).

A hinge law, any function that gives the panel angle gamma at a voltage, is put into the height of
the box.  Panels that tilt without turning give h = L sin(gamma); those of a Kresling storey turn as
it sinks; the thesis's Table 5.3 is h = h0 gamma/gamma0.
Lengths in m, angles in rad, voltages in V.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.origami.kresling import Kresling, strokes
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si, si
from dea_fenicsx.support.validation import one_of, positive

AngleMap = Literal["panel", "proportional", "storey"]
MAPS: tuple[AngleMap, ...] = get_args(AngleMap)


def table_of_angles(voltages: Any, angles: Any) -> Callable[[Any], Any]:
    """A hinge law through measured or computed points, monotone between them.

    Parameters
    ----------
    voltages
        Rising, in V.
    angles
        gamma at each in rad.

    Raises
    ------
    InputError
        If the points make no table, or the law is asked beyond them.
    """
    volts = np.asarray(si(voltages, "V", "table_of_angles: voltages"), dtype=float)
    gamma = np.asarray(si(angles, "rad", "table_of_angles: angles"), dtype=float)
    if volts.ndim != 1 or volts.shape != gamma.shape or len(volts) < 2:
        raise InputError("table_of_angles: give as many angles as voltages, two or more.")
    if not np.all(np.diff(volts) > 0):
        raise InputError("table_of_angles: voltages must rise.")
    through = PchipInterpolator(volts, gamma)

    def law(voltage: Any) -> Any:
        v = np.asarray(voltage, dtype=float)
        if not np.all((v >= volts[0]) & (v <= volts[-1])):
            raise InputError(
                f"table_of_angles: the law is known from {volts[0]:g} to {volts[-1]:g} V only."
            )
        return through(v)[()]

    return law


@in_si(height="m", panel="m")
@dataclass(frozen=True, eq=False)
class Box:
    """A box whose panels are tilted by hinges.

    Parameters
    ----------
    angle
        The hinge law: gamma in rad, from the base up to the panel, of a voltage in V.
    height
        h0 of one storey without voltage in m.
    map
        ``"panel"`` for rigid panels that only tilt, ``"storey"`` for those of a Kresling storey of
        free twist, ``"proportional"`` as in the thesis.
    panel
        Length L of a panel along its slope in m.  By default the one that makes height and angle
        fit, h0/sin(gamma0).  If it is given, the angle at rest is asin(h0/L) and the law's changes
        of angle count.
    storey
        For its own map: the storey, with right chords; height and angle at rest are its own, and
        the law's changes of angle count.
    cells
        Hinged cells of a storey; their forces add up.
    storeys
        One on the other; their strokes add up.

    Raises
    ------
    InputError
        For lengths and angles that make no box.
    """

    angle: Callable[[Any], Any]
    height: float
    map: AngleMap = "panel"
    panel: float | None = None
    storey: Kresling | None = None
    cells: int = 4
    storeys: int = 1

    def __post_init__(self) -> None:
        positive(self.height, "Box: height", "finite and positive")
        one_of(self.map, MAPS, "Box: map", f"one of {MAPS}")
        for name in ("cells", "storeys"):
            if getattr(self, name) != int(getattr(self, name)) or getattr(self, name) < 1:
                raise InputError(f"Box: {name} is {getattr(self, name)}, but must be 1 or more.")
        rest = float(self.angle(0.0))
        if not 0 < rest <= np.pi / 2:
            raise InputError(
                f"Box: the angle without voltage is {np.degrees(rest):g} degrees, but must lie "
                "above 0 and at most at 90."
            )
        if (self.storey is None) != (self.map != "storey"):
            raise InputError("Box: a storey and its map go together; give both or neither.")
        if self.storey is not None:
            self._check_storey(self.storey)
        elif self.panel is None:
            object.__setattr__(self, "panel", self.height / np.sin(rest))
        elif self.map == "proportional":
            raise InputError("Box: the proportional map knows no panel; leave panel out.")
        elif self.panel < self.height:
            raise InputError(
                f"Box: panels of {self.panel:g} m do not reach up to {self.height:g} m."
            )

    def _check_storey(self, storey: Kresling) -> None:
        if storey.twist != "free" or not storey.is_solid or self.panel is not None:
            raise InputError(
                "Box: the map of a storey needs one of free twist and right chords, and no panel."
            )
        if abs(self.height - storey.height) > 1e-9 * self.height:  # type: ignore[operator]
            raise InputError(
                f"Box: height is {self.height:g} m, but that of the storey is {storey.height:g} m."
            )

    @property
    def _slope_length(self) -> float:
        assert self.panel is not None  # set by __post_init__
        return self.panel

    @property
    def _rest_angle(self) -> float:
        """gamma at rest of rigid panels in rad."""
        if self.storey is not None:
            return float(self.storey.at_twist(self.storey.rest_twist).panel_angle)
        return float(np.arcsin(self.height / self._slope_length))

    def gamma(self, voltage: Any) -> Any:
        """Angle of the panels at a voltage in rad.

        Raises
        ------
        InputError
            If the hinge would fold a panel through its base or over the vertical.
        """
        found = np.asarray(self.angle(np.asarray(voltage, dtype=float)), dtype=float)
        if self.map != "proportional":
            found = found - float(self.angle(0.0)) + self._rest_angle
        if not np.all((found >= -1e-12) & (found <= np.pi / 2 + 1e-12)):
            raise InputError("Box: the hinge turns the panels beyond 0 to 90 degrees.")
        return found[()]

    def storey_height(self, voltage: Any) -> Any:
        """Height of one storey at a voltage in m."""
        gamma = self.gamma(voltage)
        if self.map == "proportional":
            return self.height * gamma / float(self.angle(0.0))
        if self.storey is not None:
            return self.storey.at_twist(self.turn(voltage)).height
        return self._slope_length * np.sin(gamma)

    def turn(self, voltage: Any) -> Any:
        """Twist phi of a Kresling storey at a voltage in rad.

        Raises
        ------
        InputError
            Without a storey, or for an angle that its panels reach only after they have met.
        """
        storey = self.storey
        if storey is None:
            raise InputError("Box: only a storey turns; give one, and its map.")
        # from upright panels down to where they meet, or lie flat
        ends = [0.0, min(storey.contact_twist, float(storey.twist_at(storey.lowest)))]
        high, low = (float(storey.at_twist(phi).panel_angle) for phi in ends)

        def twist(gamma: float) -> float:
            if not low - 1e-9 <= gamma <= high + 1e-9:
                raise InputError(
                    f"Box: the hinge turns panels to {np.degrees(gamma):g} degrees, but those of "
                    f"this storey stand between {np.degrees(low):g} and {np.degrees(high):g}."
                )
            inside = float(np.clip(gamma, low, high))
            return float(
                brentq(lambda phi: storey.at_twist(phi).panel_angle - inside, *ends, xtol=1e-14)
            )

        return np.vectorize(twist, otypes=[float])(self.gamma(voltage))[()]

    def total_height(self, voltage: Any) -> Any:
        """Height of all storeys in m."""
        return self.storeys * self.storey_height(voltage)

    def stroke(self, voltage: Any) -> Any:
        """Loss of height of all storeys in m."""
        return self.storeys * (self.height - self.storey_height(voltage))

    def strokes(self, voltage: Any, collapsed: Any) -> dict[str, Any]:
        """The stroke over three lengths, see `strokes`; `collapsed` is of one storey in m."""
        return strokes(self.height, self.storey_height(voltage), collapsed)

    def force(self, moment: Any, voltage: Any = 0.0) -> Any:
        """Axial force in N of hinges that each exert a moment in N m, at the height of a voltage.

        Virtual work of rigid panels: force x dh = cells x moment x dgamma, dh = L cos(gamma)
        dgamma; by the thesis's map dh = h0/gamma0 dgamma; in a storey both follow the twist.
        """
        if self.storey is not None:
            return self.cells * np.asarray(moment) / self._rise(self.turn(voltage))
        if self.map == "proportional":
            return self.cells * np.asarray(moment) * float(self.angle(0.0)) / self.height
        return self.cells * np.asarray(moment) / (self._slope_length * np.cos(self.gamma(voltage)))

    def _rise(self, phi: Any) -> Any:
        """dh/dgamma of a storey: dh/dphi = -R^2 sin(phi)/h, tan(gamma) = h/q."""
        assert self.storey is not None
        state, R, half = self.storey.at_twist(phi), self.storey.radius, self.storey.step / 2
        h, q = state.height, R * (np.cos(half) - np.cos(phi + half))
        sink, inward = -(R**2) * np.sin(phi) / h, R * np.sin(phi + half)
        return sink * (h**2 + q**2) / (q * sink - h * inward)


def blocked_force(
    voltage: Any, eps_r: float, thickness: Any, width: Any, layers: Any = 1, cells: Any = 1
) -> Any:
    """Force in N along films that may not stretch: eps (V/t)^2 x layers x t x width.

    An ideal film held at its undeformed size stays as thick as it is, so this holds at any voltage
    below breakdown and goes with V^2.

    Parameters
    ----------
    voltage
        In V.
    eps_r
        Relative permittivity.
    thickness, width
        Of one film, and across the force, in m.
    layers
        Films on each other.
    cells
        Such hinges side by side.
    """
    volts = np.asarray(si(voltage, "V", "blocked_force: voltage"), dtype=float)
    t = np.asarray(si(thickness, "m", "blocked_force: thickness"), dtype=float)
    w = np.asarray(si(width, "m", "blocked_force: width"), dtype=float)
    if not (np.all(t > 0) and np.all(w > 0) and eps_r > 0):
        raise InputError("blocked_force: thickness, width and eps_r must be positive.")
    if np.any(np.asarray(layers) < 1) or np.any(np.asarray(cells) < 1):
        raise InputError("blocked_force: layers and cells must be 1 or more.")
    return (eps_r * EPSILON_0 * volts**2 / t * w * layers * cells)[()]


def voltage_to_block(
    force: Any, eps_r: float, thickness: Any, width: Any, layers: Any = 1, cells: Any = 1
) -> Any:
    """Voltage in V at which `blocked_force` reaches a force in N."""
    wanted = np.asarray(si(force, "N", "voltage_to_block: force"), dtype=float)
    if np.any(wanted < 0):
        raise InputError("voltage_to_block: force must not be negative.")
    return np.sqrt(wanted / blocked_force(1.0, eps_r, thickness, width, layers, cells))[()]
