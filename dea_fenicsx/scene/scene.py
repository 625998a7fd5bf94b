"""The scene: which material where, what is imposed, at which fidelity.  Checked at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from mpi4py import MPI

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.device import Device, group_size
from dea_fenicsx.scene.conditions import (
    AxialForce,
    AxialStretch,
    ChargedElectrode,
    Clamp,
    DeadLoad,
    DeadPressure,
    Discretisation,
    Displacement,
    Electrode,
    Fix,
    FollowerPressure,
    FreeBody,
    Load,
    Prescribed,
    PreStretch,
    Stretch,
    Support,
    Torque,
    Twist,
)
from dea_fenicsx.scene.electrode_checks import check_electrodes
from dea_fenicsx.scene.kinematics import GeneralisedPlaneStrain, Helical, Kinematics, ThreeD
from dea_fenicsx.support.agreement import check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.validation import finite, known

__all__ = ["SIMPLICES", "Scene", "finite", "known", "period"]


@dataclass(frozen=True, eq=False)
class Scene:
    """A device with its materials and everything imposed on it.

    Parameters
    ----------
    device
        The mesh with its names, from `read_gmsh`.
    materials
        Material of each region; every region must have one.
    electrodes
        Electrodes (of given potential or charge) and grounds.  May be empty: then no potential is
        modelled at all.
    supports
        `Fix`, `Clamp` or `FreeBody`.
    prescribed
        Prescribed stretches and displacements, and `PreStretch`; of a helical cell also
        `AxialStretch` and `Twist`,
        in generalised plane strain `AxialStretch`.
    loads
        Dead loads; on a helical cell also `AxialForce` and `Torque`, in generalised plane strain
        `AxialForce`.
    kinematics
        `ThreeD()`, `PlaneStrain()`, `GeneralisedPlaneStrain()`, `Axisymmetric()` or
        `Helical(pitch)`.
    elements
        The finite elements, see `Discretisation`.

    Raises
    ------
    InputError
        For an unknown name, a region without material, an electrode without facets, unphysical
        constants and the like; one sentence says what is wrong, where, and what would be right.
    """

    device: Device
    materials: Mapping[str, Material]
    electrodes: Sequence[Electrode | ChargedElectrode] = ()
    supports: Sequence[Support] = ()
    prescribed: Sequence[Prescribed] = ()
    loads: Sequence[Load] = ()
    kinematics: Kinematics = field(default_factory=ThreeD)
    elements: Discretisation = field(default_factory=Discretisation)

    def __post_init__(self) -> None:
        check_declared(self)
        # before the first collective call: ranks with other names would wait for each other
        check_same(self.device.comm, {
            f.name: getattr(self, f.name) for f in fields(self) if f.name != "device"
        })  # fmt: skip
        for item in (*self.electrodes, *self.prescribed, *self.loads):
            if not item.ramp:
                raise InputError(f"A ramp of {type(item).__name__} has an empty name; give it one.")
        _check_names(self)
        _check_kinematics(self)
        _check_materials(self)
        check_electrodes(self.device, self.materials, self.electrodes, self.kinematics)
        _check_mechanics(self)
        _check_overall(self)
        _check_elements(self)

    @property
    def ramps(self) -> tuple[str, ...]:
        """Names of everything that can be ramped, in the order of appearance."""
        live = [e for e in self.electrodes if isinstance(e, ChargedElectrode) or e.volts]
        driven = [*self.prescribed, *self.loads, *live]
        return tuple(dict.fromkeys(item.ramp for item in driven))

    @property
    def has_potential(self) -> bool:
        return bool(self.electrodes)

    def reference_voltage(self, ramp: str) -> float:
        """The potential in V, largest in size, of the electrodes on a ramp; 0 if there are none."""
        given = [e for e in self.electrodes if isinstance(e, Electrode) and e.ramp == ramp]
        return max((e.volts for e in given), key=abs, default=0.0)

    def is_electric(self, ramp: str) -> bool:
        """Whether a ramp drives potentials or charges and nothing else."""
        others = {item.ramp for item in (*self.prescribed, *self.loads)}
        return ramp not in others and ramp in {e.ramp for e in self.electrodes}


def _check_names(scene: Scene) -> None:
    """Where the mesh lacks several of the names that a scene needs, say all of them at once.

    A single one is left to the checks below, which say what it is for.
    """
    device = scene.device
    regions, surfaces = set(scene.materials), set()
    for item in [*scene.electrodes, *scene.supports, *scene.prescribed, *scene.loads]:
        if isinstance(item, Electrode | ChargedElectrode):
            surfaces |= set(item.names) - set(device.regions)
        elif isinstance(where := getattr(item, "where", None), str):
            surfaces.add(where)
    lacking = [*sorted(regions - set(device.regions)), *sorted(surfaces - set(device.surfaces))]
    if len(lacking) > 1:
        raise InputError(
            f"The scene needs {', '.join(map(repr, lacking))}, which the mesh lacks; "
            f"{device.source or 'it'} has the regions {', '.join(sorted(device.regions))} and the "
            f"surfaces {', '.join(sorted(device.surfaces)) or 'none'}."
        )


def _check_kinematics(scene: Scene) -> None:
    device, kinematics = scene.device, scene.kinematics
    kind = type(kinematics).__name__
    if device.mesh.geometry.dim != kinematics.dim or device.dim != kinematics.dim:
        raise InputError(
            f"{kind} needs a mesh in {kinematics.dim} dimensions, but the mesh has cells of "
            f"dimension {device.dim} in {device.mesh.geometry.dim} coordinates."
        )
    depth = getattr(kinematics, "depth", 1.0)
    if not (math.isfinite(depth) and depth > 0):
        raise InputError(f"The depth of {kind} is {depth!r}, but must be a length > 0 in m.")
    if kind in ("Axisymmetric", "Helical"):
        low = _extent(device, 0)[0]
        if low < -1e-12:
            raise InputError(
                f"An axisymmetric mesh lies at radii r >= 0, but this one reaches r = "
                f"{low * device.length:g} m; shift it so that the axis is at r = 0."
            )
    if isinstance(kinematics, Helical):
        _check_helix(scene, kinematics, low)


def _extent(device: Device, a: int) -> tuple[float, float]:
    """Least and largest coordinate `a` of the mesh, over all ranks."""
    x = device.mesh.geometry.x[:, a]
    low = device.comm.allreduce(float(x.min(initial=np.inf)), op=MPI.MIN)
    return low, device.comm.allreduce(float(x.max(initial=-np.inf)), op=MPI.MAX)


def period(scene: Scene) -> float:
    """Length in m along the overall stretch: height of a helical cell, depth of a slice."""
    if isinstance(scene.kinematics, GeneralisedPlaneStrain):
        return scene.kinematics.depth
    low, high = _extent(scene.device, 1)
    return (high - low) * scene.device.length


def _check_helix(scene: Scene, kinematics: Helical, inner: float) -> None:
    """Refuse a helical cell that has an axis, no two ends, or a height that does not fit."""
    device = scene.device
    if inner < 1e-9:
        raise InputError("A helical cell needs a hole: its mesh must lie at radii r > 0.")
    finite(kinematics.pitch, "The pitch of Helical")
    for name in kinematics.between:
        known(name, device.surfaces, "facet group")
        if group_size(device, name) == 0:
            raise InputError(f"The end {name!r} of the helical cell has no facets in the mesh.")
    strands = abs(kinematics.pitch) / period(scene)
    if abs(strands - round(strands)) > 1e-6:
        raise InputError(
            f"The pitch {kinematics.pitch:g} m of Helical is {strands:g} times the height of the "
            "cell, but must be a whole multiple of it, the number of strands; or 0 for rings."
        )


def _check_materials(scene: Scene) -> None:
    regions = scene.device.regions
    for name in scene.materials:
        known(name, regions, "region")
    missing = [name for name in regions if name not in scene.materials]
    if missing:
        raise InputError(
            f"Region {missing[0]!r} has no material; give one in materials={{...}} for each of: "
            f"{', '.join(sorted(regions))}."
        )
    for name, material in scene.materials.items():
        if not isinstance(material, Material):
            raise InputError(
                f"Region {name!r} is given {type(material).__name__}, but needs a Material."
            )
        faults = material.faults()
        if faults:
            model = type(material.elastic).__name__
            raise InputError(f"Region {name!r}, {model}: {faults[0]}.")


def _check_mechanics(scene: Scene) -> None:
    device, axes = scene.device, scene.kinematics.axes
    for item in [*scene.supports, *scene.prescribed, *scene.loads]:
        what = type(item).__name__
        if isinstance(item, FreeBody):
            continue
        if isinstance(item, AxialStretch | Twist | AxialForce | Torque):
            continue  # they act on the cell as a whole
        if isinstance(item, PreStretch):
            _check_prestretch(scene, item)
            continue
        known(item.where, device.surfaces, "facet group")
        if group_size(device, item.where) == 0:
            raise InputError(f"{what} on {item.where!r} finds no facets in the mesh.")
        named = getattr(item, "axes", "")
        if isinstance(item, Fix | Stretch | Displacement) and (
            not named or any(a not in axes for a in named)
        ):
            raise InputError(
                f"{what} on {item.where!r} names the axes {named!r}, but must name one or more of "
                f"{', '.join(axes)}."
            )
        if isinstance(item, Stretch):
            if any(a not in scene.kinematics.coordinates for a in named):
                raise InputError(
                    f"The stretch on {item.where!r} is along {named!r}, but the mesh only has the "
                    f"coordinates {', '.join(scene.kinematics.coordinates)}."
                )
            finite(item.stretch, f"The stretch on {item.where!r}")
            if item.stretch <= 0:
                raise InputError(f"The stretch on {item.where!r} is {item.stretch}, must be > 0.")
            for value in item.centres:
                finite(0.0 if value is None else value, f"about= of the stretch on {item.where!r}")
            if len(item.centres) != len(named):
                raise InputError(
                    f"The stretch on {item.where!r} is about {len(item.centres)} coordinates, but "
                    f"must be about one, or one for each of the axes {named!r}."
                )
        elif isinstance(item, Displacement):
            finite(item.metres, f"The displacement on {item.where!r}")
        elif isinstance(item, DeadLoad):
            if len(item.pascal) != len(axes):
                raise InputError(
                    f"The dead load on {item.where!r} has {len(item.pascal)} components, but must "
                    f"have {len(axes)}: one for each of {', '.join(axes)}."
                )
            for value in item.pascal:
                finite(value, f"The dead load on {item.where!r}")
        elif isinstance(item, DeadPressure | FollowerPressure):
            finite(item.pascal, f"The pressure on {item.where!r}")
            if item.on is not None:
                known(item.on, device.regions, "region")
    if not any(isinstance(s, Clamp | Fix | FreeBody) for s in scene.supports):
        raise InputError(
            "The scene has no supports, so the device could drift away; add Clamp(...), Fix(...) "
            "or FreeBody()."
        )


def _check_prestretch(scene: Scene, item: PreStretch) -> None:
    if scene.kinematics.axes not in ("xyz", "xy"):
        raise InputError(
            "PreStretch is for three dimensions and plane strain only; in this scene bring the "
            "device to its stretch with Stretch(...)."
        )
    for name in item.names:
        known(name, scene.device.regions, "region")
        if scene.materials[name].bulk_modulus is not None:
            raise InputError(
                f"The pre-stretch of {name!r} needs an incompressible material, but that region "
                "has a bulk modulus; leave it out."
            )
    label = "+".join(item.names)
    if any(item.ramp == load.ramp for load in scene.loads):
        raise InputError(
            f"The pre-stretch of {label!r} and a load share the ramp {item.ramp!r}; give them two, "
            'and move both in one Ramp(("prestretch", "load")).'
        )
    given = [s for s in (item.x, item.y, item.z) if s is not None]
    for value in given:
        finite(value, f"A pre-stretch of {label!r}")
        if value <= 0:
            raise InputError(f"A pre-stretch of {label!r} is {value}, but must be > 0.")
    if len(given) < 2 or abs(math.prod(item.stretches) - 1) > 1e-9:
        raise InputError(
            f"The pre-stretch of {label!r} is x = {item.x}, y = {item.y}, z = {item.z}; give two "
            "stretches, or three whose product is 1."
        )


def _check_overall(scene: Scene) -> None:
    """Stretch, twist, force and torque of a device as a whole."""
    seen: set[str] = set()
    kinematics = scene.kinematics
    for item in [*scene.prescribed, *scene.loads]:
        what = type(item).__name__
        if isinstance(item, FollowerPressure) and kinematics.overall:
            where = "a helical cell" if isinstance(kinematics, Helical) else (
                "generalised plane strain"
            )
            raise InputError(
                f"FollowerPressure on {item.where!r} is not available in {where}; use "
                "DeadPressure."
            )
        if not isinstance(item, AxialStretch | Twist | AxialForce | Torque):
            continue
        needed = "twist" if isinstance(item, Twist | Torque) else "elongation"
        if needed not in kinematics.overall:
            also = " or GeneralisedPlaneStrain(depth)" if needed == "elongation" else ""
            raise InputError(
                f"{what} is for helical cells; take kinematics=Helical(pitch){also}."
            )
        if isinstance(item, AxialStretch):
            finite(item.stretch, "The axial stretch")
            if item.stretch <= 0:
                raise InputError(f"The axial stretch is {item.stretch}, but must be > 0.")
        elif isinstance(item, Twist):
            finite(item.radians_per_metre, "The twist")
        elif isinstance(item, AxialForce):
            finite(item.newtons, "The axial force")
        else:
            finite(item.newton_metres, "The torque")
        if isinstance(item, AxialStretch | Twist):
            if what in seen:
                raise InputError(f"{what} is prescribed twice; give it once.")
            seen.add(what)
        elif {"AxialForce": "AxialStretch", "Torque": "Twist"}[what] in seen:
            raise InputError(f"{what} has no effect on a cell whose motion along it is prescribed; "
                             "leave one of the two out.")  # fmt: skip


def _check_elements(scene: Scene) -> None:
    e = scene.elements
    if e.pressure not in Discretisation.PRESSURES:
        raise InputError(
            f"The pressure element is {e.pressure!r}, but must be one of "
            f"{', '.join(Discretisation.PRESSURES)}."
        )
    simplex = "simplex" if scene.device.mesh.topology.cell_name() in SIMPLICES else ""
    if e.pressure == "discontinuous" and simplex:
        raise InputError(
            "A discontinuous linear pressure is unstable on triangles and tetrahedra; use "
            'pressure="continuous".'
        )
    if e.potential_degree not in (1, 2):
        raise InputError(
            f"The degree of the potential is {e.potential_degree!r}, but must be 1 or 2."
        )
    if not (math.isfinite(e.augmentation) and 0 <= e.augmentation <= 1e4):
        raise InputError(
            f"The augmentation is {e.augmentation!r}, but must lie between 0 and 10000 (times the "
            "shear modulus)."
        )
    if not 2 <= e.quadrature_degree <= 12:
        raise InputError(
            f"The quadrature degree is {e.quadrature_degree!r}, but must lie between 2 and 12."
        )


SIMPLICES = ("triangle", "tetrahedron")
