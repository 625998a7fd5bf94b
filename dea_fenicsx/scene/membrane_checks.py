"""Checks of what a membrane cannot be made of, and of what it cannot bear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from dea_fenicsx.materials import Material
from dea_fenicsx.scene.condition import Condition, Setting
from dea_fenicsx.support.errors import InputError


class _Loaded(Setting, Protocol):
    """The part of a scene whose conditions are checked."""

    @property
    def declared(self) -> Any: ...


def check_films(scene: Setting) -> None:
    """Raise InputError unless the materials of a membrane are such that it can be one."""
    if not scene.kinematics.is_membrane:
        return
    name = type(scene.kinematics).__name__
    for region, material in scene.materials.items():
        if material.is_air or material.bulk_modulus is not None:
            what = "is air" if material.is_air else "has a bulk modulus"
            raise InputError(
                f"Region {region!r} {what}, but the thickness of a {name} follows from "
                "incompressibility; give it an incompressible rubber, without bulk_modulus=."
            )
        if scene.kinematics.wrinkles:
            _check_relaxed(scene, region, material)


def _check_relaxed(scene: Setting, region: str, material: Material) -> None:
    """Raise InputError unless the relaxed energy of a region is known in closed form."""
    name, model = type(scene.kinematics).__name__, type(material.elastic).__name__
    electric = material.dielectric if material.is_dielectric else None
    late = electric is not None and (
        electric.conductivity_law() is not None or electric.relaxation_terms()
    )
    if material.viscous or late:
        raise InputError(
            f"Region {region!r} depends on time, but the relaxed energy of {name} is that of "
            "elastic rubbers and ideal dielectrics; leave relaxed=True or the branches out."
        )
    if electric is not None and not electric.is_ideal:
        raise InputError(
            f"Region {region!r} has a {type(electric).__name__}, but the relaxed energy of {name} "
            "is that of one permittivity; take IdealDielectric, or leave relaxed=True out."
        )
    charged = any(region in electrode.names for electrode in scene.electrodes)
    if charged and not hasattr(material.elastic, "width_margin"):
        raise InputError(
            f"Region {region!r}: the natural width of a wrinkled {model} film under voltage is not "
            "known in closed form; take NeoHookean there, or leave relaxed=True out."
        )


def check_loads_of_membrane(scene: _Loaded) -> None:
    """Raise InputError for conditions that act on the faces of a solid."""
    if not scene.kinematics.is_membrane:
        return
    told = scene.declared
    pressing = [] if scene.kinematics.is_flat else [
        load for load, work in told.surface_works if work.one_side
    ]  # fmt: skip
    refused: Sequence[Condition] = [*pressing, *(item for item, _ in told.contacts)]
    for item in refused:
        raise InputError(
            f"{type(item).__name__} acts on the faces of a solid, but the surfaces of a membrane's "
            "mesh are its edges; take MembranePressure for a pressure, or mesh the film as a solid."
        )
    if told.fillings:
        raise InputError(
            "Cavity needs the faces of a solid, which a membrane's mesh lacks; take "
            "MembranePressure, or mesh the film as a solid."
        )


def check_on_membrane(scene: Setting, name: str, tapers: Sequence[Any]) -> None:
    """Raise InputError unless an electrode's group is a region of a membrane, without tapers."""
    if name not in scene.device.regions:
        raise InputError(
            f"Electrode {name!r} is a facet group, but the voltage of a membrane acts through its "
            "thickness; name a region of the film."
        )
    if not scene.materials[name].is_dielectric:
        raise InputError(
            f"Electrode {name!r} is a region of a membrane, so it must be the dielectric itself; "
            "give it Material(..., electric=IdealDielectric(eps_r))."
        )
    if tapers:
        raise InputError(
            f"Electrode {name!r} has a taper, but the voltage of a membrane is one number in each "
            "region, without singular edges; leave taper= out."
        )
