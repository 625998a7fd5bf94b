"""Constants of a built problem, to be read and set by name.

A constant of a material is a coefficient of the forms.  So another value needs no compilation, no
mesh and no memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import constants
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite, known


@dataclass(frozen=True)
class _Handle:
    """Where a constant is kept: the part of the material, its name, and its place in a tuple."""

    region: str
    part: str
    name: str
    place: int | None = None

    def read(self, material: Material) -> float:
        if self.part == "viscous":
            return float(getattr(material.viscous[self.place or 0], self.name))
        owner = getattr(material, self.part) if self.part else material
        value = getattr(owner, self.name)
        return float(value if self.place is None else value[self.place])

    def changed(self, material: Material, value: float) -> Material:
        """The material with another value of the constant."""
        if self.part == "viscous":
            branches = list(material.viscous)
            branches[self.place or 0] = replace(
                branches[self.place or 0], **{self.name: value}
            )
            return replace(material, viscous=tuple(branches))
        owner = getattr(material, self.part) if self.part else material
        new: Any = value
        if self.place is not None:
            new = list(getattr(owner, self.name))
            new[self.place] = value
            new = tuple(new)
        changes: dict[str, Any] = {self.name: new}
        if self.part:
            changes = {self.part: replace(owner, **changes)}
        return replace(material, **changes)


class Parameters(MutableMapping[str, float]):
    """The constants of a problem's materials in SI units, by name.

    ``"film.elastic.mu"`` is the constant `mu` of the elastic model of the region ``film``,
    ``"film.elastic.mu[1]"`` the second of several, ``"film.electric.eps_r"`` its relative
    permittivity, and ``"film.bulk_modulus"`` its bulk modulus where it has one.
    ``"film.viscous[0].mu"`` and ``"film.viscous[0].tau"`` are those of its first viscous branch.

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

    def _all(self) -> Iterator[tuple[str, _Handle]]:
        for region, material in self.materials.items():
            for constant in constants(material.elastic):
                value = getattr(material.elastic, constant)
                label = f"{region}.elastic.{constant}"
                if isinstance(value, tuple):
                    for k in range(len(value)):
                        yield f"{label}[{k}]", _Handle(region, "elastic", constant, k)
                else:
                    yield label, _Handle(region, "elastic", constant)
            for k in range(len(material.viscous)):
                for name in ("mu", "tau"):
                    yield f"{region}.viscous[{k}].{name}", _Handle(region, "viscous", name, k)
            if self._kernels[region].eps is not None and hasattr(material.electric, "eps_r"):
                yield f"{region}.electric.eps_r", _Handle(region, "electric", "eps_r")
            if material.bulk_modulus is not None:
                yield f"{region}.bulk_modulus", _Handle(region, "", "bulk_modulus")

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
        self._store(handle, material)
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
        for handle in self._handles.values():
            self._store(handle, materials[handle.region])
        self.materials = dict(materials)

    def _handle(self, name: str) -> _Handle:
        known(name, self._handles, "constant", "the problem")
        return self._handles[name]

    def _store(self, handle: _Handle, material: Material) -> None:
        """Put a constant into the coefficient that holds it, in the cells of its region."""
        kernel, scales = self._kernels[handle.region], self._scales
        if handle.part == "electric":
            coefficient, value = kernel.eps, material.dielectric.permittivity()
            value /= scales.permittivity
        elif handle.part == "viscous":
            branch = kernel.branches[handle.place or 0]
            coefficient, value = getattr(branch, handle.name), handle.read(material)
        elif handle.part == "":
            coefficient, value = kernel.kappa, handle.read(material) / scales.stress
        else:
            coefficient, value = getattr(kernel.elastic, handle.name), handle.read(material)
            if handle.place is not None:
                coefficient = coefficient[handle.place]
        cells: np.ndarray = self._device.cells_of(handle.region)
        assert coefficient is not None
        coefficient.x.array[cells] = value
