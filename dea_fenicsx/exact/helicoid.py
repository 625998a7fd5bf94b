"""The helical actuator in closed form (thesis section 4.4.1, eq 34 to 46), mended.

An electrode is the helicoid z = c theta, c = pitch/(2 pi), between two radii.  Two of them, one a
distance T above the other along the axis, have the exact potential V (z - c theta)/T, a harmonic
function whose field is tangential to both cylinders.  So field and capacitance below are exact for
layers of any thickness, without the fringes of inset edges.  The stroke is that of free
homogeneous layers: no ends, electrodes without stiffness.

All lengths in m; every parameter may be an array, and they broadcast.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from dea_fenicsx.exact.activation import activation_voltage
from dea_fenicsx.exact.branch import trace
from dea_fenicsx.exact.film import Film
from dea_fenicsx.exact.states import elastic_stress
from dea_fenicsx.materials import EPSILON_0, Material
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown


@dataclass(frozen=True, eq=False)
class Helicoid:
    """Two electrodes wound as helicoids, with elastomer between their turns.

    Parameters
    ----------
    outer_radius, inner_radius
        Of the elastomer, in m.
    elastomer, electrode
        Thicknesses along the axis in m.
    inset
        Distance of the electrodes from both cylinders in m.
    turns
        Turns of each electrode; between two electrodes lie 2 turns - 1 layers.

    Raises
    ------
    InputError
        For lengths that make no ring.
    """

    outer_radius: Any
    inner_radius: Any
    elastomer: Any
    electrode: Any = 50e-6
    inset: Any = 0.0
    turns: Any = 1

    def __post_init__(self) -> None:
        for name in ("outer_radius", "inner_radius", "elastomer", "electrode", "inset", "turns"):
            try:
                value = np.asarray(getattr(self, name), dtype=float)
            except (TypeError, ValueError, OverflowError) as error:
                given = shown(getattr(self, name))
                raise InputError(f"Helicoid: {name} is {given}, but must be a number.") from error
            least = 0.0 if name in ("electrode", "inset") else np.nextafter(0, 1)
            if not np.all(np.isfinite(value) & (value >= least)):
                word = "not negative" if least == 0 else "positive"
                raise InputError(f"Helicoid: {name} must be finite and {word}.")
            object.__setattr__(self, name, value[()])
        r1, r2 = self.electrode_radii
        if not np.all(r1 < r2):
            raise InputError(
                "Helicoid: no electrode is left between inner_radius + inset and outer_radius - "
                "inset; widen the ring or make the inset smaller."
            )

    # ------------------------------------------------------------------ geometry

    @property
    def pitch(self) -> Any:
        """Axial advance of a turn, 2 (elastomer + electrode); the thesis's "2 z_o" (eq 34)."""
        return 2 * (self.elastomer + self.electrode)

    @property
    def c(self) -> Any:
        """Axial advance per radian."""
        return self.pitch / (2 * np.pi)

    @property
    def height(self) -> Any:
        """(turns + 1) pitch: the ends of the helix add one pitch."""
        return (self.turns + 1) * self.pitch

    def turns_within(self, height: Any) -> Any:
        """Largest whole number of turns whose height is not above `height`."""
        return np.maximum(np.floor(np.asarray(height) / self.pitch * (1 + 1e-12)) - 1, 0)

    @property
    def layers(self) -> Any:
        """Layers between two electrodes."""
        return 2 * self.turns - 1

    @property
    def electrode_radii(self) -> tuple[Any, Any]:
        return self.inner_radius + self.inset, self.outer_radius - self.inset

    def lead_angle(self, radius: Any) -> Any:
        """Angle of the helix to the plane across the axis in rad, tan beta = c/r."""
        return np.arctan2(self.c, radius)

    def edge_length(self, radius: Any) -> Any:
        """Length of one turn, 2 pi sqrt(r^2 + c^2) (eq 38; eq 39 with beta of this radius)."""
        return 2 * np.pi * np.hypot(radius, self.c)

    def area(self, inner: Any = None, outer: Any = None) -> Any:
        """Area in m^2 of one turn: pi [r sqrt(r^2 + c^2) + c^2 asinh(r/c)] between two radii.

        By default between the electrodes' edges.
        """
        r1, r2 = self.electrode_radii
        r1, r2 = (r1 if inner is None else inner), (r2 if outer is None else outer)

        def primitive(r: Any) -> Any:
            return np.pi * (r * np.hypot(r, self.c) + self.c**2 * np.arcsinh(r / self.c))

        return primitive(r2) - primitive(r1)

    @property
    def flat_area(self) -> Any:
        """Projection of one turn of electrode on the plane across the axis in m^2."""
        r1, r2 = self.electrode_radii
        return np.pi * (r2**2 - r1**2)

    # ------------------------------------------------------------------ field

    @property
    def pitch_correction(self) -> Any:
        """Mean of 1/cos^2 beta over the electrode, less 1.

        By this capacitance and mean pressure are above those of a flat ring:
        2 c^2 ln(r2/r1)/(r2^2 - r1^2).
        """
        r1, r2 = self.electrode_radii
        return 2 * self.c**2 * np.log(r2 / r1) / (r2**2 - r1**2)

    def capacitance(self, eps_r: Any, contraction: Any = 0.0) -> Any:
        """Of all layers in F; a layer thinned to 1 - k has its area grown by 1/(1 - k)."""
        gap = self.elastomer * (1 - np.asarray(contraction)) ** 2
        flat = eps_r * EPSILON_0 * self.flat_area / gap
        return self.layers * flat * (1 + self.pitch_correction)

    def field(self, voltage: Any, radius: Any = None, contraction: Any = 0.0) -> Any:
        """True field in V/m: V/(t cos beta), t = T (1 - k); of a flat ring without a radius."""
        flat = np.asarray(voltage) / (self.elastomer * (1 - np.asarray(contraction)))
        return flat if radius is None else flat / np.cos(self.lead_angle(radius))

    def pressure(self, eps_r: Any, voltage: Any, radius: Any = None, contraction: Any = 0.0) -> Any:
        """Maxwell pressure eps E^2 in Pa (eq 46)."""
        return eps_r * EPSILON_0 * self.field(voltage, radius, contraction) ** 2

    # ------------------------------------------------------------------ stroke

    def voltage(self, material: Material, contraction: Any) -> Any:
        """Voltage in V that thins every layer by the share k = `contraction` of its thickness."""
        _check_incompressible(material)
        return activation_voltage(material, self.elastomer, contraction)

    def contraction(self, material: Material, voltage: Any) -> Any:
        """Share k of its thickness that a layer loses at `voltage`; NaN beyond pull-in.

        The stable state that grows out of rest.
        """
        _check_incompressible(material)
        end, _ = stable_limit(material)
        volts = np.asarray(voltage, dtype=float)
        aim = np.broadcast_arrays(volts / self.elastomer, np.zeros(()))[0]
        low, high = np.zeros(aim.shape), np.full(aim.shape, end)
        beyond = activation_voltage(material, 1.0, high) < aim * (1 - 1e-12)
        for _ in range(60):  # bisection: the voltage rises with k up to pull-in
            middle = (low + high) / 2
            under = activation_voltage(material, 1.0, middle) < aim
            low, high = np.where(under, middle, low), np.where(under, high, middle)
        return np.where(beyond, np.nan, (low + high) / 2)[()]

    def stroke(self, material: Material, voltage: Any) -> Any:
        """Loss of height in m at a voltage: layers x T x contraction."""
        return self.layers * self.elastomer * self.contraction(material, voltage)

    def pull_in_voltage(self, material: Material) -> Any:
        """Voltage in V at which the free layer pulls in; inf where it never does."""
        _check_incompressible(material)
        return self.elastomer * stable_limit(material)[1]

    # ------------------------------------------------------------------ beside the thesis

    def rectified(self) -> dict[str, tuple[Any, Any]]:
        """The thesis's rectified helicoid: name to its value and the relative error of it.

        One lead angle, that of the outer radius, for all radii; the ring from edge to edge.
        ``area_literal`` is eq 40 as printed, whose radii are not squared: a length, in m.
        """
        r1, r2 = self.inner_radius, self.outer_radius
        sec = 1 / np.cos(self.lead_angle(r2))
        flat = np.pi * (r2**2 - r1**2)
        turned = Helicoid(r2, r1, self.elastomer, self.electrode)
        unit = turned.flat_area * (1 + turned.pitch_correction)
        found = {
            "inner_length": (2 * np.pi * r1 * sec, self.edge_length(r1)),
            "outer_length": (2 * np.pi * r2 * sec, self.edge_length(r2)),
            "area_one_angle": (flat * sec**2, turned.area()),
            "area_two_angles": (flat, turned.area()),
            "capacitance_one_angle": (flat * sec**2, unit),
            "capacitance_flat": (flat, unit),
        }
        errors = {name: (value, value / exact - 1) for name, (value, exact) in found.items()}
        return errors | {"area_literal": (np.pi * (r2 - r1) * sec**2, np.nan)}


def _check_incompressible(material: Material) -> None:
    if material.bulk_modulus is not None:
        raise InputError(
            "The analytic helicoid takes incompressible materials only, but this one has a bulk "
            "modulus; use Material(elastic, electric) without it, or trace(Film(...))."
        )


@lru_cache(maxsize=64)
def stable_limit(material: Material) -> tuple[float, float]:
    """Where the stable states of a free film end.

    Returns
    -------
    contraction
        Of the thickness at pull-in, or at the end of the branch if there is none.
    field
        Pull-in voltage over undeformed thickness in V/m, inf if there is none.
    """
    branch = trace(Film(material, 1.0))
    state = branch.event("pull-in")
    if state is None:
        return float(1 - branch.stretches[2].min()), float("inf")
    return float(1 - state.stretches[2]), float(state.voltage)


def elastic_pressure(material: Material, contraction: Any) -> Any:
    """Pressure in Pa that thins a free layer by the share `contraction` of its thickness."""
    lam = 1 / np.sqrt(1 - np.asarray(contraction, dtype=float))
    return elastic_stress(material, lam, lam)[0]
