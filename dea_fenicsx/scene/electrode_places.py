"""What lies beside an electrode.  All functions are collective."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.neighbours import regions_beside
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError


def check_touch(
    device: Device,
    materials: Mapping[str, Material],
    names: Sequence[str],
    kinematics: Kinematics,
) -> None:
    """An electrode makes a field only in a dielectric that shares a facet with it."""
    beside = regions_beside(device, with_far_ends(device, names, kinematics))
    if any(materials[name].is_dielectric for name in beside):
        return
    dielectrics = sorted(n for n, m in materials.items() if m.is_dielectric)
    around = ", ".join(map(repr, sorted(beside - set(names)))) or "nothing"
    raise InputError(
        f"Electrode {'+'.join(names)!r} touches no dielectric, so it makes no field: beside it "
        f"lies {around}; name a group on a dielectric ({', '.join(dielectrics)}), or give its "
        "neighbour Material(..., electric=IdealDielectric(eps_r))."
    )


def with_far_ends(
    device: Device, names: Sequence[str], kinematics: Kinematics
) -> tuple[str, ...]:
    """Names of groups, and in a helical cell both ends where the groups reach one of them.

    The two ends are the same place, one period apart.
    """
    ends = kinematics.periodic_ends
    if ends is None:
        return tuple(names)
    reached = set()
    for name in names:
        if name in device.regions:
            region = device.regions[name]
            reached |= {end for end in ends if _is_beside(device, end, region)}
        elif name in ends:
            reached.add(name)
    return tuple(dict.fromkeys([*names, *(ends if reached else ())]))


def _is_beside(device: Device, surface: str, tag: int) -> bool:
    return tag in {device.regions[name] for name in regions_beside(device, [surface])}
