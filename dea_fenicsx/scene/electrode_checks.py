"""Checks of all electrodes of a scene together.

Each fault is told in one sentence before anything is solved.  All functions are collective.
"""

from __future__ import annotations

from collections.abc import Sequence

from dea_fenicsx.mesh.neighbours import regions_beside
from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.scene.electrode_places import joined_ends, with_far_ends
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.support.errors import InputError


def check_electrodes(scene: Setting) -> None:
    """Raise InputError unless the electrodes make sense in a scene."""
    electrodes, materials = scene.electrodes, scene.materials
    seen: set[str] = set()
    for electrode in electrodes:
        electrode.check(scene)
        for name in electrode.names:
            if name in seen:
                raise InputError(f"{name!r} is an electrode twice; name each group once.")
            seen.add(name)
    for name, material in materials.items():
        if electrodes and material.is_conductor and name not in seen:
            raise InputError(
                f"Region {name!r} conducts, but is no electrode; add it to an Electrode or Ground."
            )
    membrane = scene.kinematics.is_membrane
    if electrodes and not membrane and all(e.floats for e in electrodes):
        raise InputError(
            "All electrodes have given charges, so no potential is defined; add a Ground(...)."
        )
    if electrodes and not any(m.is_dielectric for m in materials.values()):
        raise InputError(
            "There are electrodes but no dielectric; give at least one region "
            "Material(..., electric=IdealDielectric(eps_r))."
        )
    for electrode in electrodes:
        electrode.check_place(scene)
    if not membrane:
        _check_floating(scene)


def without_field(electrodes: Sequence[Conducting]) -> bool:
    """Whether electrodes with a voltage are all at one potential at all times, so no field arises.

    Electrodes on one ramp at one voltage, or one alone, without a ground.
    """
    if any(e.fills_region or e.given_coulombs for e in electrodes):
        return False
    given = [e for e in electrodes if not e.floats]
    potentials = {(e.ramp, e.given_volts) for e in given}
    return len(potentials) == 1 and all(e.given_volts and not e.all_tapers for e in given)


def _check_floating(scene: Setting) -> None:
    """A floating potential is one against an electrode of given potential on the same dielectrics.

    Dielectrics belong together where they have a facet or an electrode in common.
    """
    device, materials, ends = scene.device, scene.materials, joined_ends(scene)
    electrodes = scene.electrodes
    floating = [e for e in electrodes if e.floats]
    if not floating:
        return

    def dielectrics_beside(names: Sequence[str]) -> set[str]:
        beside = regions_beside(device, with_far_ends(device, names, ends))
        return {name for name in beside if materials[name].is_dielectric}

    links = [dielectrics_beside(e.names) for e in electrodes]
    links += [
        {name} | dielectrics_beside([name]) for name, m in materials.items() if m.is_dielectric
    ]
    reached = set().union(*(
        set(e.names) if e.fills_region else link
        for e, link in zip(electrodes, links, strict=False) if not e.floats
    ))  # fmt: skip
    while more := set().union(*(link for link in links if link & reached)) - reached:
        reached |= more
    for electrode in floating:
        if not dielectrics_beside(electrode.names) & reached:
            raise InputError(
                f"ChargedElectrode {electrode.label!r} lies on dielectrics that no electrode of "
                "given potential touches, so that its potential is not defined; add a Ground(...) "
                "there."
            )
