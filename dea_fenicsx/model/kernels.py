"""Regions that share one integral, with their constants as cell-wise coefficients.

Regions whose energies have the same shape (same elastic model, same fields, incompressible or not)
share one integral.  Their constants are coefficients that are constant in each cell, so that a
change of a material constant never recompiles anything.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.materials import EPSILON_0, Dielectric, Elastic, Material, Maxwell
from dea_fenicsx.materials.base import constants, is_compressible, parts, shape
from dea_fenicsx.materials.damage import OgdenRoxburgh
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.air import BoundAir, bound_air
from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.flowing_branches import (
    FlowingBranches,
    flow_functions,
    flowing_branches,
    quadrature_functions,
    quadrature_space,
    symmetric,
)
from dea_fenicsx.model.heat import BoundHeat, bound_heat
from dea_fenicsx.model.late_charges import (
    BoundDebye,
    BoundLeak,
    debye_terms,
    delayed_polarisations,
    leak_functions,
    polarisation_functions,
)
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class BoundBranch:
    """A Maxwell branch of a kernel, with what the forms take of the history.

    Attributes
    ----------
    mu, tau
        Cell-wise modulus of the spring in Pa, and relaxation time in s; 0 outside of the kernel.
    step
        Cell-wise length of the present step of time over the relaxation time.
    function
        The history H at quadrature points, six numbers each; it is shared by all kernels.
    place
        Number of the branch in its materials.
    """

    mu: Any
    tau: Any
    step: Any
    function: Any
    place: int

    @property
    def tensor(self) -> Any:
        """The history H, symbolic, symmetric 3 x 3."""
        return symmetric(self.function)


@dataclass(frozen=True)
class BoundDamage:
    """The softening of a kernel.

    Attributes
    ----------
    law
        The law with cell-wise constants.
    peak
        The largest energy before this step in Pa, at quadrature points; shared by all kernels.
    """

    law: OgdenRoxburgh
    peak: Any


@dataclass(frozen=True)
class Kernel:
    """Regions that share one integral.

    Attributes
    ----------
    elastic
        The elastic model with cell-wise coefficients in place of its constants.
    eps, kappa
        Cell-wise permittivity of the undeformed dielectric at small fields, and bulk modulus,
        dimensionless, or None.
    electric
        The dielectric with dimensionless cell-wise coefficients in place of its constants, or None.
    vacuum
        The permittivity of vacuum, dimensionless.
    prestretch
        For each ramp of a `PreStretch` its factor, a constant, and the cell-wise logarithms of the
        three stretches; empty for regions without one.
    regions
        Names of the regions.
    cells
        Their cells that this rank owns.
    fields
        Names of the fields that live there.
    branches, flowing
        Maxwell branches, and other viscous branches or None.
    leak
        The history of the charge that has leaked; None where no dielectric of the scene conducts
        or relaxes.
    relaxation
        The polarisations that follow the field with a delay.
    air
        What shapes the cells of the air; None in a solid.
    is_membrane
        Whether the regions are films, whose pressure is eliminated.
    length
        The unit of length in m.
    heat
        Its temperature; None where this is the reference of the material at all loads.
    damage
        Its softening; None where it does not soften.
    """

    elastic: Elastic
    eps: Any | None
    electric: Dielectric | None
    vacuum: float
    kappa: Any | None
    prestretch: dict[str, tuple[Any, list[Any]]]
    regions: tuple[str, ...]
    cells: np.ndarray
    fields: tuple[str, ...] = ()
    branches: tuple[BoundBranch, ...] = ()
    flowing: FlowingBranches | None = None
    leak: BoundLeak | None = None
    relaxation: tuple[BoundDebye, ...] = ()
    air: BoundAir | None = None
    is_membrane: bool = False
    length: float = 1.0
    heat: BoundHeat | None = None
    damage: BoundDamage | None = None

    @property
    def strain_factors(self) -> dict[str, Any]:
        """The factor of each ramp that strains or heats it by itself."""
        found = {ramp: factor for ramp, (factor, _) in self.prestretch.items()}
        if self.heat is not None and self.heat.ramp is not None:
            found[self.heat.ramp] = self.heat.factor
        return found

    @property
    def is_foam(self) -> bool:
        """Whether the energy states how the volume changes, so that there is no pressure."""
        return is_compressible(self.elastic)

    @property
    def is_viscous(self) -> bool:
        """Whether it has viscous branches of any kind."""
        return self.viscous_branches > 0

    @property
    def has_history(self) -> bool:
        """Whether its stress depends on what is kept at the quadrature points."""
        return self.is_viscous or self.damage is not None

    @property
    def viscous_branches(self) -> int:
        """Number of viscous branches of each of its materials."""
        return len(self.branches) + (len(self.flowing.places) if self.flowing else 0)

    @property
    def is_incompressible(self) -> bool:
        """Whether the regions are exactly incompressible."""
        return self.kappa is None and self.air is None


def kernels(scene: Scene, scales: Scales, fields_of_problem: Sequence[Field]) -> list[Kernel]:
    """Group the regions of a scene by the shape of their energy."""
    device = scene.device
    groups = _groups(scene, fields_of_problem)
    prestretches = scene.declared.initial_stretches
    factors = {item.ramp: dolfinx.fem.Constant(device.mesh, 0.0) for item in prestretches}
    constant = dolfinx.fem.functionspace(device.mesh, ("DG", 0))
    owned = device.owned_cells()

    def bulk_modulus(name: str) -> float:
        return scene.materials[name].bulk_modulus / scales.stress  # type: ignore[operator]

    histories, flows = quadrature_functions(scene), flow_functions(scene)
    leak, delayed = leak_functions(scene), polarisation_functions(scene)
    heats, worn = _heats(scene), _worn(scene)
    made = []
    charged = {field.name for field in fields_of_problem if field.role is Role.POTENTIAL}

    for (_, alive, stiff, stretched), names in groups.items():
        cells = {n: device.cells_of(n) for n in names}
        has_field = bool(charged & set(alive))

        def cellwise(value: Callable[[str], float], cells: Any = cells) -> Any:
            f = dolfinx.fem.Function(constant)
            for n, c in cells.items():
                f.x.array[c] = value(n)
            return f

        ramps = sorted(factors) if stretched else []
        electric, eps = _dielectric(scene, scales, names, cellwise) if has_field else (None, None)
        together = np.sort(np.concatenate(list(cells.values())))
        made.append(
            Kernel(
                elastic=_bind({n: scene.materials[n].elastic for n in names}, cellwise),
                eps=eps,
                electric=electric,
                vacuum=EPSILON_0 / scales.permittivity,
                kappa=cellwise(bulk_modulus) if stiff else None,
                prestretch={r: (factors[r], _log_stretches(scene, r, cellwise)) for r in ramps},
                regions=tuple(names),
                cells=together[together < owned],
                fields=alive,
                branches=_branches(scene, cellwise, constant, names[0], histories),
                flowing=flowing_branches(
                    scene, cellwise, {n: c[c < owned] for n, c in cells.items()}, flows
                ),
                leak=leak if has_field else None,
                relaxation=delayed_polarisations(scene, scales, cellwise, names[0], delayed),
                air=bound_air(scene, scales, cellwise, names),
                is_membrane=scene.kinematics.is_membrane, length=scales.length,
                damage=_damage(scene, names, cellwise, worn),
                heat=bound_heat(scene, names[0], scales.length, heats),
            )
        )
    return made


def _groups(scene: Scene, fields_of_problem: Sequence[Field]) -> dict[tuple, list[str]]:
    """The regions whose energies have the same shape, by this shape."""
    found: dict[tuple, list[str]] = {}
    charged = {field.name for field in fields_of_problem if field.role is Role.POTENTIAL}
    for name in sorted(scene.materials, key=lambda n: scene.device.regions[n]):
        m = scene.materials[name]
        alive = tuple(field.name for field in fields_of_problem if field.lives_in(name))
        stretched = any(name in item.regions for item in scene.declared.initial_stretches)
        kind = (*_kind(m), len(debye_terms(scene, name)))
        if name in scene.thermal_regions:
            heated = (one for one in scene.declared.heated if name in one.regions)
            kind = (*kind, m.thermal, *heated)
        if charged & set(alive):
            kind = (*kind, type(m.electric), m.dielectric.form())
        found.setdefault((kind, alive, m.bulk_modulus is not None, stretched), []).append(name)
    return found


def _branches(
    scene: Scene, cellwise: Callable, constant: Any, region: str, histories: Mapping[int, Any]
) -> tuple[BoundBranch, ...]:
    """The Maxwell branches of a kernel with a region, each with a function for its history."""

    def value(constant: str, branch: int, region: str) -> float:
        return float(getattr(scene.materials[region].viscous[branch], constant))

    return tuple(
        BoundBranch(
            mu=cellwise(partial(value, "mu", k)),
            tau=cellwise(partial(value, "tau", k)),
            step=dolfinx.fem.Function(constant),
            function=histories[k],
            place=k,
        )
        for k, branch in enumerate(scene.materials[region].viscous)
        if isinstance(branch, Maxwell)
    )


def _kind(material: Material) -> tuple:
    """What materials must have in common to share a kernel, without fields and dielectrics."""
    closed = tuple(isinstance(branch, Maxwell) for branch in material.viscous)
    return type(material.elastic), shape(material.elastic), closed, material.damage is None


def _log_stretches(scene: Scene, ramp: str, cellwise: Callable) -> list[Any]:
    """Cell-wise logarithms of the three stretches of a ramp's pre-stretches."""

    def value(axis: int, name: str) -> float:
        return sum(
            float(np.log(item.stretches[axis])) for item in scene.declared.initial_stretches
            if item.ramp == ramp and name in item.regions
        )  # fmt: skip

    return [cellwise(partial(value, axis)) for axis in range(3)]


def _heats(scene: Scene) -> dict[str, Any]:
    """The factor of each ramp that heats something, as a constant of the forms."""
    mesh = scene.device.mesh
    return {one.ramp: dolfinx.fem.Constant(mesh, 0.0) for one in scene.declared.heated}


def _worn(scene: Scene) -> Any:
    """The function of the largest energies at quadrature points; None where nothing softens."""
    softens = any(m.damage is not None for m in scene.materials.values())
    return dolfinx.fem.Function(quadrature_space(scene, ())) if softens else None


def _damage(
    scene: Scene, regions: Sequence[str], cellwise: Callable, worn: Any
) -> BoundDamage | None:
    """The softening of a kernel.  All of its regions soften, or none does."""
    laws = {name: scene.materials[name].damage for name in regions}
    if laws[regions[0]] is None:
        return None
    return BoundDamage(_bind(laws, cellwise), worn)  # type: ignore[arg-type]


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
    for name in parts(model):
        value = getattr(model, name)
        if isinstance(value, tuple):
            inner: Any = tuple(
                _bind({n: getattr(e, name)[i] for n, e in elastics.items()}, cellwise)
                for i in range(len(value))
            )
        else:
            inner = _bind({n: getattr(e, name) for n, e in elastics.items()}, cellwise)
        object.__setattr__(model, name, inner)
    return model


def _dielectric(
    scene: Scene, scales: Scales, regions: Sequence[str], cellwise: Callable
) -> tuple[Dielectric, Any]:
    """One dielectric with cell-wise, dimensionless constants over several regions.

    And its permittivity in the undeformed body at small fields, which may be one of them.
    """

    def convert(name: str, kind: str) -> Any:
        return cellwise(
            lambda region: scales.of_dielectric(
                getattr(scene.materials[region].dielectric, name), kind
            )
        )

    law = scene.materials[regions[0]].dielectric.in_units(convert)
    if "eps_r" in law.constants:
        return law, law.eps_r  # type: ignore[attr-defined]
    return law, cellwise(
        lambda region: scene.materials[region].dielectric.permittivity() / scales.permittivity
    )


def measure(device: Device, parts: list[np.ndarray], degree: int, kind: str = "dx") -> Any:
    """A measure over lists of entities: part k is subdomain k."""
    return ufl.Measure(
        kind,
        domain=device.mesh,
        subdomain_data=[(k, np.asarray(p, dtype=np.int32).ravel()) for k, p in enumerate(parts)],
        metadata={"quadrature_degree": degree},
    )
