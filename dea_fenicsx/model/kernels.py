"""Regions that share one integral, with their constants as cell-wise coefficients.

Regions whose energies have the same shape (same elastic model, same fields, incompressible or not)
share one integral.  Their constants are coefficients that are constant in each cell, so that a
change of a material constant never recompiles anything.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.materials import Elastic
from dea_fenicsx.materials.base import choices, constants
from dea_fenicsx.materials.electric import Debye
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class BoundBranch:
    """A viscous branch of a kernel, with what the forms take of the history.

    Attributes
    ----------
    mu, tau
        Cell-wise modulus of the spring in Pa, and relaxation time in s; 0 outside of the kernel.
    step
        Cell-wise length of the present step of time over the relaxation time.
    function
        The history H at quadrature points, six numbers each; it is shared by all kernels.
    """

    mu: Any
    tau: Any
    step: Any
    function: Any

    @property
    def tensor(self) -> Any:
        """The history H, symbolic, symmetric 3 x 3."""
        return _symmetric(self.function)


@dataclass(frozen=True)
class BoundLeak:
    """What the forms take of the charge that has leaked, at quadrature points.

    Attributes
    ----------
    history
        What the total displacement has beside the multiple of D, see `model.charge_history`.
    excess
        That multiple minus 1, psi - 1; 0 where the rows of the potential are divided by psi.
    """

    history: Any
    excess: Any


@dataclass(frozen=True)
class BoundDebye:
    """A term of dielectric relaxation of a kernel: P = history + share (eps/eps_now) D.

    Attributes
    ----------
    eps, tau
        Cell-wise permittivity, dimensionless, and relaxation time in s; 0 outside of the kernel.
    share
        Cell-wise weight of the present field, see `model.charge_history`.
    history
        What the polarisation has beside it, at quadrature points; it is shared by all kernels.
    """

    eps: Any
    tau: Any
    share: Any
    history: Any


@dataclass(frozen=True)
class Kernel:
    """Regions that share one integral.

    Attributes
    ----------
    elastic
        The elastic model with cell-wise coefficients in place of its constants.
    eps, kappa
        Cell-wise permittivity and bulk modulus, dimensionless, or None.
    prestretch
        For each ramp of a `PreStretch` its factor, a constant, and the cell-wise logarithms of the
        three stretches; empty for regions without one.
    regions
        Names of the regions.
    cells
        Their cells that this rank owns.
    fields
        Names of the fields that live there.
    branches
        The viscous branches.
    leak
        The history of the charge that has leaked; None where no dielectric of the scene conducts
        or relaxes.
    relaxation
        The polarisations that follow the field with a delay.
    """

    elastic: Elastic
    eps: Any | None
    kappa: Any | None
    prestretch: dict[str, tuple[Any, list[Any]]]
    regions: tuple[str, ...]
    cells: np.ndarray
    fields: tuple[str, ...] = ()
    branches: tuple[BoundBranch, ...] = ()
    leak: BoundLeak | None = None
    relaxation: tuple[BoundDebye, ...] = ()

    @property
    def is_incompressible(self) -> bool:
        """Whether the regions are exactly incompressible."""
        return self.kappa is None


def kernels(scene: Scene, scales: Scales, fields_of_problem: Sequence[Field]) -> list[Kernel]:
    """Group the regions of a scene by the shape of their energy."""
    device = scene.device
    groups = _groups(scene, fields_of_problem)
    prestretches = scene.declared.initial_stretches
    factors = {item.ramp: dolfinx.fem.Constant(device.mesh, 0.0) for item in prestretches}
    constant = dolfinx.fem.functionspace(device.mesh, ("DG", 0))
    owned = device.owned_cells()

    def permittivity(name: str) -> float:
        return scene.materials[name].dielectric.permittivity() / scales.permittivity

    def bulk_modulus(name: str) -> float:
        return scene.materials[name].bulk_modulus / scales.stress  # type: ignore[operator]

    histories = quadrature_functions(scene)
    leak, delayed = _leak(scene), _polarisations(scene)
    made = []
    charged = {field.name for field in fields_of_problem if field.role is Role.POTENTIAL}

    def log_stretch(ramp: str, axis: int, name: str) -> float:
        return sum(
            float(np.log(item.stretches[axis])) for item in prestretches
            if item.ramp == ramp and name in item.regions
        )  # fmt: skip

    for (_, _, alive, incompressible, stretched, branches, late), names in groups.items():
        cells = {n: device.cells_of(n) for n in names}
        has_field = bool(charged & set(alive))

        def cellwise(value: Callable[[str], float], cells: Any = cells) -> Any:
            f = dolfinx.fem.Function(constant)
            for n, c in cells.items():
                f.x.array[c] = value(n)
            return f

        ramps = sorted(factors) if stretched else []
        together = np.sort(np.concatenate(list(cells.values())))
        made.append(
            Kernel(
                elastic=_bind({n: scene.materials[n].elastic for n in names}, cellwise),
                eps=cellwise(permittivity) if has_field else None,
                kappa=None if incompressible else cellwise(bulk_modulus),
                prestretch={
                    ramp: (factors[ramp],
                           [cellwise(partial(log_stretch, ramp, axis)) for axis in range(3)])
                    for ramp in ramps
                },
                regions=tuple(names),
                cells=together[together < owned],
                fields=alive,
                branches=_branches(scene, cellwise, constant, histories[:branches]),
                leak=leak if has_field else None,
                relaxation=_relaxation(scene, scales, cellwise, constant, delayed[:late]),
            )
        )
    return made


def _groups(scene: Scene, fields_of_problem: Sequence[Field]) -> dict[tuple, list[str]]:
    """The regions whose energies have the same shape, by this shape."""
    found: dict[tuple, list[str]] = {}
    for name in sorted(scene.materials, key=lambda n: scene.device.regions[n]):
        m = scene.materials[name]
        alive = tuple(field.name for field in fields_of_problem if field.lives_in(name))
        stretched = any(name in item.regions for item in scene.declared.initial_stretches)
        found.setdefault(
            (type(m.elastic), _shape(m.elastic), alive, m.bulk_modulus is None, stretched,
             len(m.viscous), len(_debye_terms(scene, name))), []
        ).append(name)  # fmt: skip
    return found


def _debye_terms(scene: Scene, region: str) -> tuple[Debye, ...]:
    """The terms of dielectric relaxation of a region in which a field lives."""
    material = scene.materials[region]
    live = scene.has_potential and material.is_dielectric
    return material.dielectric.relaxation_terms() if live else ()


def _polarisations(scene: Scene) -> list[Any]:
    """Functions of three numbers at each quadrature point, as many as a region has Debye terms."""
    count = max(len(_debye_terms(scene, name)) for name in scene.materials)
    if not count:
        return []
    space = _quadrature_space(scene, (3,))
    return [dolfinx.fem.Function(space) for _ in range(count)]


def _relaxation(
    scene: Scene, scales: Scales, cellwise: Callable, constant: Any, histories: Sequence[Any]
) -> tuple[BoundDebye, ...]:
    """The terms of dielectric relaxation of a kernel, each with a function for its history."""

    def eps(term: int, region: str) -> float:
        return _debye_terms(scene, region)[term].permittivity() / scales.permittivity

    def tau(term: int, region: str) -> float:
        return _debye_terms(scene, region)[term].tau

    return tuple(
        BoundDebye(
            cellwise(partial(eps, k)), cellwise(partial(tau, k)), dolfinx.fem.Function(constant),
            function,
        )
        for k, function in enumerate(histories)
    )


def _branches(
    scene: Scene, cellwise: Callable, constant: Any, histories: Sequence[Any]
) -> tuple[BoundBranch, ...]:
    """The viscous branches of a kernel, each with a function for its history."""

    def value(constant: str, branch: int, region: str) -> float:
        return float(getattr(scene.materials[region].viscous[branch], constant))

    return tuple(
        BoundBranch(
            mu=cellwise(partial(value, "mu", k)),
            tau=cellwise(partial(value, "tau", k)),
            step=dolfinx.fem.Function(constant),
            function=function,
        )
        for k, function in enumerate(histories)
    )


def quadrature_functions(scene: Scene) -> list[Any]:
    """Functions of six numbers at each quadrature point, as many as a region has branches."""
    count = max(len(material.viscous) for material in scene.materials.values())
    if not count:
        return []
    space = _quadrature_space(scene, (6,))
    return [dolfinx.fem.Function(space) for _ in range(count)]


def _leak(scene: Scene) -> BoundLeak | None:
    """The functions for leaked charge, if a dielectric of the scene conducts."""
    if not scene.leaks:
        return None
    return BoundLeak(
        history=dolfinx.fem.Function(_quadrature_space(scene, (3,))),
        excess=dolfinx.fem.Function(_quadrature_space(scene, ())),
    )


def _quadrature_space(scene: Scene, shape: tuple[int, ...]) -> Any:
    mesh, degree = scene.device.mesh, scene.elements.quadrature_degree
    element = basix.ufl.quadrature_element(
        mesh.topology.cell_name(), value_shape=shape, degree=degree
    )
    return dolfinx.fem.functionspace(mesh, element)


def _symmetric(six: Any) -> Any:
    """The symmetric tensor of six numbers xx, yy, zz, yz, xz, xy."""
    return ufl.as_matrix([
        [six[0], six[5], six[4]], [six[5], six[1], six[3]], [six[4], six[3], six[2]],
    ])  # fmt: skip


def _shape(elastic: Elastic) -> tuple:
    """Sizes of the constants, and choices of a form: models with equal shapes share a kernel."""
    sizes = tuple(np.size(getattr(elastic, name)) for name in constants(elastic))
    return (*sizes, *choices(elastic))


def _bind(elastics: dict[str, Elastic], cellwise: Callable) -> Elastic:
    """One elastic model whose constants are cell-wise coefficients over several regions."""
    model = copy.copy(next(iter(elastics.values())))
    for name in constants(model):
        value = getattr(model, name)
        if isinstance(value, tuple):
            bound: Any = tuple(
                cellwise(lambda n, i=i, k=name: getattr(elastics[n], k)[i])
                for i in range(len(value))
            )
        else:
            bound = cellwise(lambda n, k=name: getattr(elastics[n], k))
        object.__setattr__(model, name, bound)
    return model


def measure(device: Device, parts: list[np.ndarray], degree: int, kind: str = "dx") -> Any:
    """A measure over lists of entities: part k is subdomain k."""
    return ufl.Measure(
        kind,
        domain=device.mesh,
        subdomain_data=[(k, np.asarray(p, dtype=np.int32).ravel()) for k, p in enumerate(parts)],
        metadata={"quadrature_degree": degree},
    )
