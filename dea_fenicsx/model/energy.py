"""The total potential energy of a scene and what is derived from it.

Stationary point of

    Pi = int W(F) + p (J - 1) - p^2/(2 kappa) dX - 1/2 int eps J |F^-T E|^2 dX - work of loads

with E = -Grad phi, all dimensionless: lengths in L, stresses in mu, potentials in
L sqrt(mu/eps), where mu and eps are the scales of `Scales`.  In incompressible regions the
augmentation gamma/2 s(F) (J - 1)^2 is added, s the stress of `_stress_of_strain`; it vanishes in
the exact state.

Regions whose kernels have the same shape (same elastic model, dielectric or not, incompressible or
not) share one integral; their constants are cell-wise coefficients, so that a change of a material
constant never recompiles anything.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.materials import Elastic
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.scene.condition import declared
from dea_fenicsx.scene.declarations import InitialStretch
from dea_fenicsx.scene.kinematics import Helix, StrainOf, cofactor
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class Scales:
    """SI value of each dimensionless unit.

    Attributes
    ----------
    length : m
    stress : Pa, the shear modulus of the softest dielectric
    permittivity : F/m
    depth : third dimension of a plane problem in units of `length`, 1 otherwise
    """

    length: float
    stress: float
    permittivity: float
    depth: float

    @property
    def field(self) -> float:
        """Electric field in V/m."""
        return float(np.sqrt(self.stress / self.permittivity))

    @property
    def potential(self) -> float:
        """Potential in V."""
        return self.length * self.field

    @property
    def force(self) -> float:
        """Force in N."""
        return self.stress * self.length**2 * self.depth

    @property
    def charge(self) -> float:
        """Charge in C."""
        return self.permittivity * self.field * self.length**2 * self.depth

    @property
    def volume(self) -> float:
        """Volume in m^3."""
        return self.length**3 * self.depth

    @classmethod
    def of(cls, scene: Scene) -> Scales:
        """Scales of a scene: its size, its softest dielectric and its largest permittivity."""
        active = [m for m in scene.materials.values() if m.is_dielectric]
        moduli = [m.elastic.shear_modulus() for m in active or scene.materials.values()]
        return cls(
            length=scene.device.length,
            stress=min(moduli),
            permittivity=max((m.dielectric.permittivity() for m in active), default=1.0),
            depth=scene.kinematics.depth_factor(scene.device.length),
        )


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
    """

    elastic: Elastic
    eps: Any | None
    kappa: Any | None
    prestretch: dict[str, tuple[Any, list[Any]]]
    regions: tuple[str, ...]
    cells: np.ndarray


def kernels(scene: Scene, scales: Scales) -> list[Kernel]:
    """Group the regions of a scene by the shape of their energy."""
    device = scene.device
    groups: dict[tuple, list[str]] = {}
    prestretches = [told for _, told in declared(scene.prescribed, scene, InitialStretch)]
    factors = {item.ramp: dolfinx.fem.Constant(device.mesh, 0.0) for item in prestretches}
    for name in sorted(scene.materials, key=lambda n: device.regions[n]):
        m = scene.materials[name]
        field_lives = m.is_dielectric and scene.has_potential
        stretched = any(name in item.regions for item in prestretches)
        groups.setdefault(
            (type(m.elastic), _shape(m.elastic), field_lives, m.bulk_modulus is None, stretched), []
        ).append(name)
    constant = dolfinx.fem.functionspace(device.mesh, ("DG", 0))
    owned = device.owned_cells()

    def permittivity(name: str) -> float:
        return scene.materials[name].dielectric.permittivity() / scales.permittivity

    def bulk_modulus(name: str) -> float:
        return scene.materials[name].bulk_modulus / scales.stress  # type: ignore[operator]

    made = []
    def log_stretch(ramp: str, axis: int, name: str) -> float:
        return sum(
            float(np.log(item.stretches[axis])) for item in prestretches
            if item.ramp == ramp and name in item.regions
        )  # fmt: skip

    for (_, _, field_lives, incompressible, stretched), names in groups.items():
        cells = {n: device.cells_of(n) for n in names}

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
                eps=cellwise(permittivity) if field_lives else None,
                kappa=None if incompressible else cellwise(bulk_modulus),
                prestretch={
                    ramp: (factors[ramp],
                           [cellwise(partial(log_stretch, ramp, axis)) for axis in range(3)])
                    for ramp in ramps
                },
                regions=tuple(names),
                cells=together[together < owned],
            )
        )
    return made


def _shape(elastic: Elastic) -> tuple:
    """Number of entries of each constant: models with equal shapes share a kernel."""
    return tuple(np.size(getattr(elastic, f.name)) for f in fields(elastic))  # type: ignore[arg-type]


def _bind(elastics: dict[str, Elastic], cellwise: Callable) -> Elastic:
    """One elastic model whose constants are cell-wise coefficients over several regions."""
    model = copy.copy(next(iter(elastics.values())))
    for f in fields(model):  # type: ignore[arg-type]
        value = getattr(model, f.name)
        if isinstance(value, tuple):
            bound: Any = tuple(
                cellwise(lambda n, i=i, k=f.name: getattr(elastics[n], k)[i])
                for i in range(len(value))
            )
        else:
            bound = cellwise(lambda n, k=f.name: getattr(elastics[n], k))
        object.__setattr__(model, f.name, bound)
    return model


@dataclass(frozen=True)
class MaterialPoint:
    """Symbolic fields of a kernel: F, J, true electric field, and the energy.

    `total` is F times the pre-stretch: what the material has undergone.  `rates` are the energy's
    derivatives by the factors of pre-stretches.
    """

    F: Any
    total: Any
    J: Any
    true_field: Any
    energy: Any
    chain_margin: Any
    rates: dict[str, Any]


def material_point(
    scene: Scene, kernel: Kernel, scales: Scales, u: Any, p: Any, phi: Any | None,
    helix: Helix | None = None,
) -> MaterialPoint:  # fmt: skip
    """Energy density of a kernel, dimensionless, and the measures of deformation and field."""
    x = ufl.SpatialCoordinate(scene.device.mesh)
    kin = scene.kinematics
    F = ufl.variable(ufl.Identity(3) + kin.displacement_gradient(u, x, helix))
    cof, J = cofactor(F)
    total, factors = F, {r: ufl.variable(t) for r, (t, _) in kernel.prestretch.items()}
    if factors:
        powers = [
            sum(factors[ramp] * logs[i] for ramp, (_, logs) in kernel.prestretch.items())
            for i in range(3)
        ]
        # its determinant is 1, so that volumes and J are those of the mesh
        total = ufl.dot(F, ufl.diag(ufl.as_vector([ufl.exp(power) for power in powers])))
    per_mu = 1 / scales.stress
    # the scale enters as a constant of the form, not of the code
    unit = dolfinx.fem.Constant(scene.device.mesh, per_mu)
    if kernel.kappa is None:
        strain = StrainOf(total)
        energy = unit * (
            kernel.elastic.energy(strain) - kernel.elastic.spherical_slope() * ufl.ln(J)
        )
        # zero where J = 1: it takes nothing from the exact state, see Discretisation
        extra = dolfinx.fem.Constant(scene.device.mesh, float(scene.elements.augmentation))
        stiffness = unit * extra * _stress_of_strain(kernel.elastic, strain, J)
        energy += p * (J - 1) + stiffness / 2 * (J - 1) ** 2
    else:
        strain = StrainOf(F, scale=J ** (-2 / 3))
        energy = unit * kernel.elastic.energy(strain) + p * (J - 1) - p**2 / (2 * kernel.kappa)
    true_field = ufl.zero(3)
    if kernel.eps is not None:
        pulled = -ufl.dot(cof, kin.gradient(phi, x, helix))
        energy -= kernel.eps / 2 * ufl.dot(pulled, pulled) / J
        true_field = pulled / J
    margin = kernel.elastic.chain_margin(strain)
    rates = {ramp: ufl.diff(energy, t) for ramp, t in factors.items()}
    margin = ufl.as_ufl(1.0) if margin is None else margin
    return MaterialPoint(F, total, J, true_field, energy, margin, rates)


def _stress_of_strain(elastic: Elastic, strain: StrainOf, J: Any) -> Any:
    """A stress that keeps in step with the material's own, for the augmentation.

    It is 0 at rest and nowhere negative, and grows without limit towards J = 0.  A model may bring
    its own, `stress_size`; for any other it is mu (I1 - 3 - 2 ln J) over the chain margin, with the
    initial shear modulus mu, which is positive however the constants are written.
    """
    if hasattr(elastic, "stress_size"):
        return elastic.stress_size(strain, ufl.ln(J))
    stress = elastic.shear_modulus() * (strain.I1 - 3 - 2 * ufl.ln(J))
    margin = elastic.chain_margin(strain)
    return stress if margin is None else stress / margin


def measure(device: Device, parts: list[np.ndarray], degree: int, kind: str = "dx") -> Any:
    """A measure over lists of entities: part k is subdomain k."""
    return ufl.Measure(
        kind,
        domain=device.mesh,
        subdomain_data=[(k, np.asarray(p, dtype=np.int32).ravel()) for k, p in enumerate(parts)],
        metadata={"quadrature_degree": degree},
    )


def cauchy_stress(s: MaterialPoint) -> Any:
    """True stress J^-1 (dPi/dF) F^T, electrostatic part included, dimensionless."""
    return ufl.dot(ufl.diff(s.energy, s.F), ufl.transpose(s.F)) / s.J
