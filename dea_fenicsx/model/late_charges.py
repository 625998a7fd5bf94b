"""What the forms take of leaked charge and of delayed polarisations, at quadrature points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from dea_fenicsx.materials.electric import Debye
from dea_fenicsx.model.flowing_branches import quadrature_space
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx


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


def leak_functions(scene: Scene) -> BoundLeak | None:
    """The functions for leaked charge, if a dielectric of the scene conducts or relaxes."""
    if not scene.leaks:
        return None
    return BoundLeak(
        history=dolfinx.fem.Function(quadrature_space(scene, (3,))),
        excess=dolfinx.fem.Function(quadrature_space(scene, ())),
    )


def debye_terms(scene: Scene, region: str) -> tuple[Debye, ...]:
    """The terms of dielectric relaxation of a region in which a field lives."""
    material = scene.materials[region]
    live = scene.has_potential and material.is_dielectric
    return material.dielectric.relaxation_terms() if live else ()


def polarisation_functions(scene: Scene) -> list[Any]:
    """Functions of three numbers at each quadrature point, as many as a region has Debye terms."""
    count = max(len(debye_terms(scene, name)) for name in scene.materials)
    if not count:
        return []
    space = quadrature_space(scene, (3,))
    return [dolfinx.fem.Function(space) for _ in range(count)]


def delayed_polarisations(
    scene: Scene, scales: Scales, cellwise: Callable, region: str, histories: Sequence[Any]
) -> tuple[BoundDebye, ...]:
    """The terms of dielectric relaxation of a kernel with a region, each with its history."""

    def eps(term: int, region: str) -> float:
        return debye_terms(scene, region)[term].permittivity() / scales.permittivity

    def tau(term: int, region: str) -> float:
        return debye_terms(scene, region)[term].tau

    return tuple(
        BoundDebye(
            cellwise(partial(eps, k)), cellwise(partial(tau, k)), cellwise(lambda name: 0.0),
            function,
        )
        for k, function in enumerate(histories[: len(debye_terms(scene, region))])
    )


