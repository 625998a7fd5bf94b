"""Constants of a built problem, to be read and set by name.

A constant of a material is a coefficient of the forms.  So another value needs no compilation, no
mesh and no memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import constants, is_compressible, parts
from dea_fenicsx.materials.viscous import Branch, Maxwell
from dea_fenicsx.model.flowing_branches import spherical_slope
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite, known

RATE_STEP = 1e-5
"""Relative step of a constant for the derivative of the shear modulus, mostly linear in it."""


@dataclass(frozen=True)
class _Handle:
    """Where a constant is kept.

    Attributes
    ----------
    region
        The region.
    parts
        The way from the material to the owner: names of attributes, and numbers of branches.
    name
        Its name there.
    place
        Its place in a tuple, or None.
    """

    region: str
    parts: tuple[str | int, ...]
    name: str
    place: int | None = None

    @property
    def part(self) -> str:
        """The first part of the way; empty for a constant of the material itself."""
        return str(self.parts[0]) if self.parts else ""

    def read(self, material: Material) -> float:
        value = getattr(_end_of(self.parts, material), self.name)
        return float(value if self.place is None else value[self.place])

    def changed(self, material: Material, value: float) -> Material:
        """The material with another value of the constant."""
        found: Material = _changed(material, self.parts, self.name, self.place, value)
        if is_compressible(found.elastic):  # its bulk modulus follows from the constants
            found = replace(found, bulk_modulus=None)
        return found


def _end_of(parts: tuple[str | int, ...], owner: Any) -> Any:
    """The object that is found if one follows `parts` from an owner."""
    for part in parts:
        owner = owner[part] if isinstance(part, int) else getattr(owner, part)
    return owner


def _changed(
    owner: Any, parts: tuple[str | int, ...], name: str, place: int | None, value: float
) -> Any:
    """A copy of an owner with another value of the constant at the end of `parts`."""
    if not parts:
        new: Any = value
        if place is not None:
            new = _put(getattr(owner, name), place, value)
        return replace(owner, **{name: new})
    first, rest = parts[0], parts[1:]
    if isinstance(first, int):
        return _put(owner, first, _changed(owner[first], rest, name, place, value))
    return replace(owner, **{first: _changed(getattr(owner, first), rest, name, place, value)})


def _put(values: tuple[Any, ...], place: int, value: Any) -> tuple[Any, ...]:
    """A tuple with another entry at a place."""
    return (*values[:place], value, *values[place + 1 :])


def _of_model(
    region: str, part: str, model: Any, above: tuple[str | int, ...] = (), label: str = ""
) -> Iterator[tuple[str, _Handle]]:
    """The labels and handles of the constants of a model, which is a part of what is above it."""
    return _of_part(region, model, (*above, part), f"{label or region}.{part}")


def _of_part(
    region: str, model: Any, way: tuple[str | int, ...], label: str
) -> Iterator[tuple[str, _Handle]]:
    """The labels and handles of the constants of a model at the end of a way, and inside of it."""
    for constant in constants(model):
        value, name = getattr(model, constant), f"{label}.{constant}"
        if isinstance(value, tuple):
            for k in range(len(value)):
                yield f"{name}[{k}]", _Handle(region, way, constant, k)
        else:
            yield name, _Handle(region, way, constant)
    for inner in parts(model):
        value, name = getattr(model, inner), f"{label}.{inner}"
        if isinstance(value, tuple):
            for k, one in enumerate(value):
                yield from _of_part(region, one, (*way, inner, k), f"{name}[{k}]")
        else:
            yield from _of_part(region, value, (*way, inner), name)


def _of_branch(region: str, k: int, branch: Branch) -> Iterator[tuple[str, _Handle]]:
    """The labels and handles of the constants of a viscous branch."""
    above, label = ("viscous", k), f"{region}.viscous[{k}]"
    if isinstance(branch, Maxwell):
        yield f"{label}.mu", _Handle(region, above, "mu")
    else:
        yield from _of_model(region, "spring", branch.spring, above, label)
        if branch.flow is not None:
            yield from _of_model(region, "flow", branch.flow, above, label)
    if branch.tau is not None:
        yield f"{label}.tau", _Handle(region, above, "tau")


class Parameters(MutableMapping[str, float]):
    """The constants of a problem's materials in SI units, by name.

    ``"film.elastic.mu"`` is the constant `mu` of the elastic model of the region ``film``,
    ``"film.elastic.mu[1]"`` the second of several, ``"film.electric.eps_r"`` its relative
    permittivity, and ``"film.bulk_modulus"`` its bulk modulus where it has one.
    ``"film.viscous[0].mu"`` and ``"film.viscous[0].tau"`` are those of its first viscous branch,
    ``"film.viscous[0].spring.Jm"`` or ``"film.viscous[0].flow.eta_0"`` those of a `ViscousBranch`.

    A solver scales residuals by the moduli; after a large change of them call its `renew`.

    Parameters
    ----------
    scene, scales, kernels
        The scene, its units, and its kernels, which hold the constants.

    Attributes
    ----------
    materials
        Material of each region, with the present constants.

    Raises
    ------
    InputError
        For an unknown name, or a value that the material does not allow.
    """

    def __init__(self, scene: Scene, scales: Scales, kernels: Sequence[Kernel]) -> None:
        self.materials: dict[str, Material] = dict(scene.materials)
        self._device, self._scales = scene.device, scales
        self._kernels = {name: kernel for kernel in kernels for name in kernel.regions}
        self._handles = dict(self._all())
        self._factors: dict[str, np.ndarray] = {}
        for graded in scene.declared.graded:
            self._grade(f"{graded.region}.{graded.constant}", graded.factor)

    def _grade(self, name: str, factor: np.ndarray) -> None:
        """Let a constant vary with the place: its factor in each local cell."""
        handle = self._handle(name)
        material = self.materials[handle.region]
        if handle.part not in ("elastic", "electric") or is_compressible(material.elastic):
            raise InputError(
                f"The constant {name!r} cannot vary with the place; those of the dielectric can, "
                "and those of the elastic model, unless it is one of a foam."
            )
        self._factors[name] = self._factors.get(name, 1.0) * factor
        self._store(name, material)

    def _all(self) -> Iterator[tuple[str, _Handle]]:
        for region, material in self.materials.items():
            yield from _of_model(region, "elastic", material.elastic)
            for k, branch in enumerate(material.viscous):
                yield from _of_branch(region, k, branch)
            if self._kernels[region].electric is not None:
                own = {field.name for field in fields(material.dielectric)}  # type: ignore[arg-type]
                for name in sorted(own & set(material.dielectric.constants)):
                    yield f"{region}.electric.{name}", _Handle(region, ("electric",), name)
            if material.bulk_modulus is not None and not is_compressible(material.elastic):
                yield f"{region}.bulk_modulus", _Handle(region, (), "bulk_modulus")

    def __getitem__(self, name: str) -> float:
        handle = self._handle(name)
        return handle.read(self.materials[handle.region])

    def __setitem__(self, name: str, value: float) -> None:
        handle = self._handle(name)
        finite(value, f"The constant {name!r}")
        material = handle.changed(self.materials[handle.region], float(value))
        if faults := material.faults():
            model = type(material.elastic).__name__
            raise InputError(f"Region {handle.region!r}, {model}: {faults[0]}.")
        self._store(name, material)
        self.materials[handle.region] = material

    def __delitem__(self, name: str) -> None:
        raise InputError(f"The constant {name!r} cannot be taken away; give it another value.")

    def __iter__(self) -> Iterator[str]:
        return iter(self._handles)

    def __len__(self) -> int:
        return len(self._handles)

    def take(self, materials: Mapping[str, Material]) -> None:
        """Set all constants to those of materials of the same kinds, which a scene has checked.

        They are set together, as some of them make sense only together.
        """
        for name, handle in self._handles.items():
            self._store(name, materials[handle.region])
        self.materials = dict(materials)

    def values_in(self, materials: Mapping[str, Material]) -> dict[str, float]:
        """The constants of materials of the same kinds, by name."""
        return {name: h.read(materials[h.region]) for name, h in self._handles.items()}

    def put_into(self, materials: Mapping[str, Material]) -> dict[str, Material]:
        """Materials of the same kinds with the present constants, and with all else as it was."""
        found = dict(materials)
        for name, handle in self._handles.items():
            found[handle.region] = handle.changed(found[handle.region], self[name])
        return found

    def _handle(self, name: str) -> _Handle:
        known(name, self._handles, "constant", "the problem")
        return self._handles[name]

    def coefficient(self, name: str) -> tuple[Any, np.ndarray, Any] | None:
        """The coefficient of the forms that holds a constant, its cells, and its unit.

        In these local cells the coefficient is the constant, in SI units, times the unit, which
        differs between cells where the constant varies with the place.  None for
        a constant of a branch that is solved for at each quadrature point.
        """
        handle = self._handle(name)
        material, kernel = self.materials[handle.region], self._kernels[handle.region]
        cells = self._device.cells_of(handle.region)
        if handle.part != "viscous":
            coefficient, _ = self._held(handle, material)
            return coefficient, cells, self.unit(name) * self._factors.get(name, 1.0)
        for branch in kernel.branches:
            if branch.place == handle.parts[1]:
                return getattr(branch, handle.name), cells, 1.0
        return None

    def modulus_rate(self, name: str) -> float:
        """The derivative of the region's shear modulus by a constant; 0 if it is no elastic one."""
        handle = self._handle(name)
        if handle.part != "elastic":
            return 0.0
        material, value = self.materials[handle.region], self[name]
        step = RATE_STEP * (abs(value) or 1.0)
        ends = [handle.changed(material, value + s).elastic.shear_modulus() for s in (step, -step)]
        return float(ends[0] - ends[1]) / (2 * step)

    def _held(self, handle: _Handle, material: Material) -> tuple[Any, float]:
        """The coefficient that holds a constant, and what it is to hold, dimensionless.

        Not for constants of viscous branches.
        """
        kernel, scales = self._kernels[handle.region], self._scales
        if handle.part == "electric":
            kind = material.dielectric.constants[handle.name]
            value = scales.of_dielectric(handle.read(material), kind)
            return getattr(kernel.electric, handle.name), value
        if handle.part == "":
            return kernel.kappa, handle.read(material) / scales.stress
        coefficient = getattr(_end_of(handle.parts[1:], kernel.elastic), handle.name)
        if handle.place is not None:
            coefficient = coefficient[handle.place]
        return coefficient, handle.read(material)

    def unit(self, name: str) -> float:
        """What a constant in SI units is multiplied by in the coefficient of the forms."""
        handle = self._handle(name)
        if handle.part == "electric":
            kind = self.materials[handle.region].dielectric.constants[handle.name]
            return float(self._scales.of_dielectric(1.0, kind))
        return 1.0 if handle.part else 1 / self._scales.stress

    def _store(self, name: str, material: Material) -> None:
        """Put a constant into the coefficient that holds it, in the cells of its region."""
        handle = self._handles[name]
        if handle.part == "viscous":
            self._store_viscous(handle, material)
            return
        coefficient, value = self._held(handle, material)
        cells: np.ndarray = self._device.cells_of(handle.region)
        assert coefficient is not None
        coefficient.x.array[cells] = value * self._factors.get(name, 1.0)

    def _store_viscous(self, handle: _Handle, material: Material) -> None:
        """Put a constant of a viscous branch where it is needed.

        What is solved at each quadrature point takes the constants from the materials themselves.
        """
        kernel, cells = self._kernels[handle.region], self._device.cells_of(handle.region)
        for branch in kernel.branches:
            if branch.place == handle.parts[1]:
                getattr(branch, handle.name).x.array[cells] = handle.read(material)
        if kernel.flowing:
            slope = spherical_slope(material, kernel.flowing.places)
            kernel.flowing.slope.x.array[cells] = slope
