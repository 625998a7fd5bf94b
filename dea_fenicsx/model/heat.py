"""The temperature of regions in the forms, and at the quadrature points.

A region with a temperature of its own has the factors of `materials.thermal.Thermal` on its
energies, and strains that count from its unloaded state at that temperature.  The factor of a ramp
that heats it is a coefficient of the forms, so that the energy knows its derivative.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.materials.thermal import Thermal
from dea_fenicsx.scene.kinematics_base import place_of
from dea_fenicsx.scene.own_functions import scalar_of
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


class SymbolicNumbers:
    """The functions that a law of temperature needs, for UFL."""

    exp = staticmethod(ufl.exp)

    @staticmethod
    def choose(x: Any, edge: float, below: Any, above: Any) -> Any:
        return ufl.conditional(ufl.lt(x, edge), below, above)


@dataclass(frozen=True, eq=False)
class BoundHeat:
    """The temperature of a kernel.

    Attributes
    ----------
    thermal
        How its material changes, with numbers.
    bound
        The same with constants of the form in place of its numbers.
    start
        Temperature at first in K, a constant of the form.
    ramp, factor, rise
        The ramp that heats it, its factor, a constant, and the rise in K at factor 1, symbolic;
        ramp is None and rise is 0 where nothing heats it.
    """

    thermal: Thermal
    bound: Thermal
    start: Any
    ramp: str | None
    factor: Any
    rise: Any

    def kelvin(self, factor: Any) -> Any:
        """The temperature at a factor, symbolic."""
        return self.start if self.ramp is None else self.start + factor * self.rise


class Heated:
    """What the temperature is and does at a point of the material, symbolic.

    Parameters
    ----------
    heat
        The temperature of the kernel; None where it is the reference at all loads.

    Attributes
    ----------
    factor
        The factor of the ramp that heats it, as a variable, or None.
    modulus, permittivity
        Factors on the elastic and on the electric energy.
    rate
        One over the factor on relaxation times.
    stretch
        Stretch of the unloaded material.
    """

    def __init__(self, heat: BoundHeat | None) -> None:
        self.factor: Any = None
        self.modulus: Any = 1.0
        self.permittivity: Any = 1.0
        self.rate: Any = 1.0
        self.stretch: Any = 1.0
        self.swells = heat is not None and heat.thermal.expansion != 0
        if heat is None:
            return
        if heat.ramp is not None:
            self.factor = ufl.variable(heat.factor)
        kelvin, law = heat.kelvin(self.factor), heat.bound
        self.modulus = law.modulus_factor(kelvin, SymbolicNumbers)
        self.permittivity = law.permittivity_factor(kelvin, SymbolicNumbers)
        self.rate = 1 / law.time_factor(kelvin, SymbolicNumbers)
        if self.swells:
            self.stretch = law.stretch(kelvin) / law.stretch(heat.start)


def bound_heat(
    scene: Scene, region: str, length: float, factors: Mapping[str, Any]
) -> BoundHeat | None:
    """The temperature of a kernel with a region, whose others have the same; None for none.

    Parameters
    ----------
    scene, region
        The scene and the region.
    length
        The unit of length in m.
    factors
        The factor of each ramp that heats something.
    """
    if region not in scene.thermal_regions:
        return None
    mesh, thermal = scene.device.mesh, scene.materials[region].thermal
    assert thermal is not None

    def constant(value: float) -> Any:
        return dolfinx.fem.Constant(mesh, float(value))

    first = thermal.reference if scene.temperature is None else scene.temperature
    start, ramp, rise = constant(first), None, ufl.as_ufl(0.0)
    for one in scene.declared.heated:
        if region in one.regions:
            ramp, kelvin = one.ramp, one.kelvin
            if not callable(kelvin):
                rise = constant(kelvin - first)
                continue
            place = place_of(scene.kinematics, ufl.SpatialCoordinate(mesh))
            x = constant(length) * place
            what = f"The temperature of {region!r}"
            rise = scalar_of(kelvin, x, what, "the temperature in K") - start
    return BoundHeat(
        thermal, _bound(thermal, constant), start, ramp,
        factors[ramp] if ramp is not None else constant(0.0), rise,
    )  # fmt: skip


def _bound(law: Any, constant: Any) -> Any:
    """A copy of a law with constants of the form in place of its numbers; tables stay."""
    found = copy.copy(law)
    for field in fields(law):
        value = getattr(law, field.name)
        if is_dataclass(value):
            object.__setattr__(found, field.name, _bound(value, constant))
        elif isinstance(value, float | int):
            object.__setattr__(found, field.name, constant(value))
    return found


class Temperatures:
    """The temperature at the quadrature points of regions that have one, as numbers.

    Parameters
    ----------
    mesh, kernels, quadrature
        The mesh, its kernels, and the quadrature points of the reference cell.

    Attributes
    ----------
    kernels
        The kernels that have a temperature.
    """

    def __init__(self, mesh: Any, kernels: Any, quadrature: np.ndarray) -> None:
        self._comm = mesh.comm
        self.kernels = [kernel for kernel in kernels if kernel.heat is not None]
        self._points = len(quadrature)
        self._rises: dict[int, np.ndarray] = {}
        for kernel in self.kernels:
            found = np.zeros((len(kernel.cells), self._points))
            if kernel.heat.ramp is not None:
                rise = kernel.heat.rise
                if isinstance(rise, dolfinx.fem.Constant):
                    found[:] = float(rise.value)
                else:
                    evaluate = compat.expression(ufl.as_vector([rise]), quadrature)
                    found[:] = evaluate(mesh, kernel.cells).reshape(found.shape)
            self._rises[id(kernel)] = found

    def __bool__(self) -> bool:
        return bool(self.kernels)

    def of(self, kernel: Any) -> np.ndarray:
        """Temperatures in K of a kernel's own cells at the present load, of (cells, points)."""
        heat = kernel.heat
        return np.asarray(float(heat.start.value) + float(heat.factor.value) * self._rises[
            id(kernel)
        ])  # fmt: skip

    @cached_property
    def _extremes(self) -> list[tuple[Any, float, float]]:
        """Each kernel with its smallest and its largest rise on all ranks.  Collective at first."""
        found = []
        for kernel in self.kernels:
            rises = self._rises[id(kernel)]
            low = self._comm.allreduce(float(np.min(rises, initial=np.inf)), op=MPI.MIN)
            high = self._comm.allreduce(float(np.max(rises, initial=-np.inf)), op=MPI.MAX)
            found.append((kernel, low, high))
        return found

    def check(self) -> None:
        """Raise InputError if a temperature lies outside of its data at the present load."""
        for kernel, low, high in self._extremes:
            heat = kernel.heat
            start, factor = float(heat.start.value), float(heat.factor.value)
            for rise in (low, high):
                what = f"The temperature of {kernel.regions[0]!r}"
                if heat.ramp is not None:
                    what += f" at factor {factor:.6g} of {heat.ramp!r}"
                heat.thermal.check(start + factor * rise, what)
