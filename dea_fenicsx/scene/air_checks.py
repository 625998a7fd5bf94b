"""Checks of a scene with air.  They tell each fault in one sentence before anything is solved."""

from __future__ import annotations

from typing import Any

from dea_fenicsx.mesh.neighbours import regions_beside
from dea_fenicsx.scene.declarations import InitialStretch
from dea_fenicsx.support.errors import InputError


def check_air(scene: Any) -> None:
    """Raise InputError unless the air of a scene makes sense.  Collective."""
    air = [name for name, material in scene.materials.items() if material.is_air]
    if not air:
        return
    if not scene.solids:
        _check_air_alone(scene, air)
        return
    for item in scene.declared.initial_stretches:
        _check_stretch(item, air)
    declared = scene.declared
    for told in (declared.surface_works, declared.contacts):
        for load, one in told:
            _check_surface(scene, type(load).__name__, one.surface, air)
    for part in declared.rigid_surfaces:
        _check_surface(scene, "Rigid", part.surface, air)


def _check_surface(scene: Any, what: str, surface: str, air: list[str]) -> None:
    """Raise InputError if a surface or a region has no solid.  Collective."""
    if surface in air:
        raise InputError(
            f"{what} on {surface!r} acts on air alone, since this region is air; name a region or "
            "a surface of a solid."
        )
    if surface in scene.materials:
        return
    beside = regions_beside(scene.device, [surface])
    if beside <= set(air):
        raise InputError(
            f"{what} on {surface!r} acts on air alone, beside {', '.join(sorted(beside))}; name a "
            "surface of a solid."
        )


def _check_stretch(item: InitialStretch, air: list[str]) -> None:
    for name in item.regions:
        if name in air:
            raise InputError(
                f"The pre-stretch of {name!r} has no effect, since this region is air; name solid "
                "regions only."
            )


def _check_air_alone(scene: Any, air: list[str]) -> None:
    """Where all is air, nothing moves: the field is all that can be asked for."""
    if not scene.electrodes:
        raise InputError(
            f"All regions ({', '.join(sorted(air))}) are air and there is no electrode, so there "
            "is nothing to solve; add electrodes, or give a region Material(...)."
        )
    for item in (*scene.prescribed, *scene.loads):
        raise InputError(
            f"{type(item).__name__} has no effect, since all regions ({', '.join(sorted(air))}) "
            "are air and nothing moves; leave it out, or give a region Material(...)."
        )
