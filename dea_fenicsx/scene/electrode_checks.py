"""Checks of the electrodes of a scene: names, places, thin films and tapers.

Each fault is told in one sentence before anything is solved.  All functions are collective.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dea_fenicsx.materials import IdealDielectric, Material
from dea_fenicsx.mesh.device import Device, group_size
from dea_fenicsx.mesh.neighbours import (
    extent,
    places,
    region_extent,
    regions_beside,
    share_off_planes,
)
from dea_fenicsx.scene.conditions import ChargedElectrode, Electrode, Taper, ThinFilm
from dea_fenicsx.scene.electrode_profiles import coordinate, profile
from dea_fenicsx.scene.kinematics import Helical, Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import finite, known

SPAN = 1e-6
"""By what share of its thickness a thin film's start and end may lie off its faces."""

GRID = 1e-9
"""The same as a share of the device's size: what writing and reading a mesh leaves of a place."""

ASKEW = 0.01
"""Share of a thin film's faces, seen along its axis, that may lie elsewhere than start and end.

A mesh of triangles on a round rim leaves a little.
"""


def check_electrodes(
    device: Device,
    materials: Mapping[str, Material],
    electrodes: Sequence[Electrode | ChargedElectrode],
    kinematics: Kinematics,
) -> None:
    """Raise InputError unless the electrodes make sense on this device.  Collective."""
    seen: set[str] = set()
    for electrode in electrodes:
        if not electrode.names:
            raise InputError("An electrode names no group; give where= at least one name.")
        _check_values(electrode, kinematics)
        for name in electrode.names:
            known(name, [*device.surfaces, *device.regions], "facet group or region")
            if name in seen:
                raise InputError(f"{name!r} is an electrode twice; name each group once.")
            seen.add(name)
            _check_group(device, materials, electrode, name)
    for name, material in materials.items():
        if electrodes and material.is_conductor and name not in seen:
            raise InputError(
                f"Region {name!r} conducts, but is no electrode; add it to an Electrode or Ground."
            )
    if electrodes and all(isinstance(e, ChargedElectrode) for e in electrodes):
        raise InputError(
            "All electrodes have given charges, so no potential is defined; add a Ground(...)."
        )
    if electrodes and not any(m.is_dielectric for m in materials.values()):
        raise InputError(
            "There are electrodes but no dielectric; give at least one region "
            "Material(..., electric=IdealDielectric(eps_r))."
        )
    for electrode in electrodes:
        if isinstance(electrode, ThinFilm):
            _check_span(device, materials, electrode, kinematics)
        else:
            _check_touch(device, materials, electrode, kinematics)
        if isinstance(electrode, Electrode) and electrode.tapers:
            _check_reach(device, electrode, kinematics)
    _check_floating(device, materials, electrodes, kinematics)


def without_field(electrodes: Sequence[Electrode | ChargedElectrode]) -> bool:
    """Whether electrodes with a voltage are all at one potential at all times, so no field arises.

    Electrodes on one ramp at one voltage, or one alone, without a ground.
    """
    if any(isinstance(e, ThinFilm) for e in electrodes):
        return False
    given = [e for e in electrodes if isinstance(e, Electrode)]
    if any(isinstance(e, ChargedElectrode) and e.coulombs for e in electrodes):
        return False
    potentials = {(e.ramp, e.volts) for e in given}
    return len(potentials) == 1 and all(e.volts and not e.tapers for e in given)


def _check_values(electrode: Electrode | ChargedElectrode, kinematics: Kinematics) -> None:
    """Numbers and axes of an electrode, whatever the mesh."""
    label = electrode.label
    if isinstance(electrode, ChargedElectrode):
        finite(electrode.coulombs, f"The charge of electrode {label!r}")
        return
    finite(electrode.volts, f"The voltage of electrode {label!r}")
    for taper in electrode.tapers:
        _check_taper(taper, label, kinematics)


def _check_taper(taper: Taper, label: str, kinematics: Kinematics) -> None:
    axes = set(kinematics.coordinates) | ({"r"} if kinematics.dim == 3 else set())
    finite(taper.start, f"The start of the taper of electrode {label!r}")
    finite(taper.end, f"The end of the taper of electrode {label!r}")
    if taper.start == taper.end or taper.along not in axes:
        raise InputError(
            f"The taper of electrode {label!r} runs along {taper.along!r} from {taper.start:g} m "
            f"to {taper.end:g} m; give two different coordinates along one of "
            f"{', '.join(sorted(axes))}."
        )


def _check_group(
    device: Device,
    materials: Mapping[str, Material],
    electrode: Electrode | ChargedElectrode,
    name: str,
) -> None:
    """What a single group must be in order to be this electrode."""
    is_region = name in device.regions
    if isinstance(electrode, ThinFilm):
        if not is_region or not materials[name].is_dielectric:
            raise InputError(
                f"ThinFilm {name!r} must be a dielectric region; name one with "
                "Material(..., electric=IdealDielectric(eps_r))."
            )
    elif is_region and not materials[name].is_conductor:
        raise InputError(
            f"Region {name!r} is an electrode, but its material does not conduct; give it "
            "Material(..., electric=Conductor())."
        )
    if group_size(device, name) == 0:
        kind = "cells" if is_region else "facets"
        raise InputError(
            f"Electrode {name!r} has no {kind} in the mesh; check the physical group."
        )


def _check_touch(
    device: Device,
    materials: Mapping[str, Material],
    electrode: Electrode | ChargedElectrode,
    kinematics: Kinematics,
) -> None:
    """An electrode makes a field only in a dielectric that shares a facet with it."""
    beside = regions_beside(device, with_far_ends(device, electrode.names, kinematics))
    if any(materials[name].is_dielectric for name in beside):
        return
    dielectrics = sorted(n for n, m in materials.items() if m.is_dielectric)
    around = ", ".join(map(repr, sorted(beside - set(electrode.names)))) or "nothing"
    raise InputError(
        f"Electrode {electrode.label!r} touches no dielectric, so it makes no field: beside it "
        f"lies {around}; name a group on a dielectric ({', '.join(dielectrics)}), or give its "
        "neighbour Material(..., electric=IdealDielectric(eps_r))."
    )


def _check_floating(
    device: Device,
    materials: Mapping[str, Material],
    electrodes: Sequence[Electrode | ChargedElectrode],
    kinematics: Kinematics,
) -> None:
    """A floating potential is one against an electrode of given potential on the same dielectrics.

    Dielectrics belong together where they have a facet or an electrode in common.
    """
    floating = [e for e in electrodes if isinstance(e, ChargedElectrode)]
    if not floating:
        return

    def dielectrics_beside(names: Sequence[str]) -> set[str]:
        beside = regions_beside(device, with_far_ends(device, names, kinematics))
        return {name for name in beside if materials[name].is_dielectric}

    links = [dielectrics_beside(e.names) for e in electrodes]
    links += [
        {name} | dielectrics_beside([name]) for name, m in materials.items() if m.is_dielectric
    ]
    reached = set().union(*(
        set(e.names) if isinstance(e, ThinFilm) else link
        for e, link in zip(electrodes, links, strict=False) if isinstance(e, Electrode)
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


def with_far_ends(
    device: Device, names: Sequence[str], kinematics: Kinematics
) -> tuple[str, ...]:
    """Names of groups, and in a helical cell both ends where the groups reach one of them.

    The two ends are the same place, one period apart.
    """
    if not isinstance(kinematics, Helical):
        return tuple(names)
    ends = kinematics.between
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


def _check_span(
    device: Device,
    materials: Mapping[str, Material],
    film: ThinFilm,
    kinematics: Kinematics,
) -> None:
    """The field V/T is right only between the two faces of one flat film."""
    label = film.label
    finite(film.start, f"The start of ThinFilm {label!r}")
    finite(film.end, f"The end of ThinFilm {label!r}")
    if film.start == film.end or film.along not in tuple(kinematics.coordinates):
        raise InputError(
            f"ThinFilm {label!r} lies between {film.along!r} = {film.start:g} m and {film.end:g} "
            "m; give two different coordinates along one of the axes "
            f"{', '.join(kinematics.coordinates)}."
        )
    axis = kinematics.coordinates.index(film.along)
    low, high = region_extent(device, film.names, axis)
    room = SPAN * (high - low) + GRID * device.length
    planes = np.array(sorted((film.start, film.end)))
    if np.max(np.abs(planes - [low, high])) > room:
        raise InputError(
            f"ThinFilm {label!r} spans {film.along} = {film.start:g} m to {film.end:g} m, but the "
            f"region lies between {low:.9g} m and {high:.9g} m, so that the field would not be its "
            "voltage over its thickness; give start and end as its two faces, in metres."
        )

    def on_plane(heights: np.ndarray) -> np.ndarray:
        return np.any([np.max(np.abs(heights - p), axis=1) < room for p in planes], axis=0)

    kinds = {name: _permittivity(materials[name]) for name in film.names}
    off = share_off_planes(device, kinds, axis, on_plane)
    if off > ASKEW:
        raise InputError(
            f"ThinFilm {label!r} is not one flat film of one permittivity between {film.along} = "
            f"{planes[0]:g} m and {planes[1]:g} m: {100 * off:.0f} % of its faces lie elsewhere; "
            "give each flat layer a ThinFilm of its own, and any other an Electrode and a Ground."
        )


def _permittivity(material: Material) -> float:
    assert isinstance(material.electric, IdealDielectric)
    return material.electric.permittivity()


def _check_reach(device: Device, electrode: Electrode, kinematics: Kinematics) -> None:
    """Each taper must fall somewhere on its electrode, and together they must leave something."""
    X = places(device, electrode.names)
    label = electrode.label
    for taper in electrode.tapers:
        low, high = extent(device, coordinate(kinematics, taper.along, X))
        first, last = sorted((taper.start, taper.end))
        room = SPAN * (last - first)
        if low < last - room and high > first + room:
            continue
        before = high <= first + room if taper.start < taper.end else low >= last - room
        effect = "has no effect" if before else "leaves it at 0 V everywhere"
        raise InputError(
            f"The taper of electrode {label!r} falls from {taper.along} = {taper.start:g} m to "
            f"{taper.end:g} m, but the electrode lies between {low:.6g} m and {high:.6g} m, so "
            f"that it {effect}; give start and end on the electrode, in metres, or leave it out."
        )
    if extent(device, profile(kinematics, electrode, X))[1] < 1e-9:
        raise InputError(
            f"The tapers of electrode {label!r} leave it at 0 V everywhere; let each fall from the "
            "electrode's middle towards its edge."
        )
