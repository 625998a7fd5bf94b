"""What lies beside an electrode.  All functions are collective."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.neighbours import regions_beside
from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.support.errors import InputError

Ends = Sequence[tuple[str, str]]
"""Pairs of facet groups that are one place, one period apart."""


def check_touch(
    device: Device,
    materials: Mapping[str, Material],
    names: Sequence[str],
    ends: Ends,
) -> None:
    """An electrode makes a field only in a dielectric that shares a facet with it."""
    beside = regions_beside(device, with_far_ends(device, names, ends))
    if any(materials[name].is_dielectric for name in beside):
        return
    dielectrics = sorted(n for n, m in materials.items() if m.is_dielectric)
    around = ", ".join(map(repr, sorted(beside - set(names)))) or "nothing"
    raise InputError(
        f"Electrode {'+'.join(names)!r} touches no dielectric, so it makes no field: beside it "
        f"lies {around}; name a group on a dielectric ({', '.join(dielectrics)}), or give its "
        "neighbour Material(..., electric=IdealDielectric(eps_r))."
    )


def joined_ends(scene: Setting) -> list[tuple[str, str]]:
    """Pairs of facet groups that are one place, one period apart."""
    ends = scene.kinematics.periodic_ends
    pairs = [item.joined_surfaces for item in scene.supports]
    # a name that is not in the mesh is refused by the condition that has it
    known = [p for p in pairs if p and all(name in scene.device.surfaces for name in p)]
    return [*([ends] if ends else []), *known]


def with_far_ends(device: Device, names: Sequence[str], ends: Ends) -> tuple[str, ...]:
    """Names of groups, and both ends of a period where the groups reach one of them.

    The two ends are the same place, one period apart.
    """
    found = dict.fromkeys(names)
    for pair in ends:
        if any(_reaches(device, name, pair) for name in names):
            found |= dict.fromkeys(pair)
    return tuple(found)


def _reaches(device: Device, name: str, pair: tuple[str, str]) -> bool:
    if name in device.regions:
        return any([_is_beside(device, end, device.regions[name]) for end in pair])
    return name in pair


def _is_beside(device: Device, surface: str, tag: int) -> bool:
    return tag in {device.regions[name] for name in regions_beside(device, [surface])}
