"""The scene: materials, conditions, kinematics and elements, checked when it is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.cell_quality import check_cells
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.sheets import QUARTIC_ORDER, with_exact_shape
from dea_fenicsx.scene.air_checks import check_air
from dea_fenicsx.scene.condition import Condition, Load, Prescribed, Support
from dea_fenicsx.scene.declared import Declared, gathered
from dea_fenicsx.scene.electrode_checks import check_electrodes
from dea_fenicsx.scene.electrodes import ChargedElectrode, Electrode
from dea_fenicsx.scene.elements import SIMPLICES, Discretisation
from dea_fenicsx.scene.fibre_checks import check_fibres
from dea_fenicsx.scene.kinematics import Kinematics, ThreeD
from dea_fenicsx.scene.membrane_checks import check_films, check_loads_of_membrane
from dea_fenicsx.scene.sources import Source
from dea_fenicsx.scene.temperature_checks import check_temperatures, heated_regions
from dea_fenicsx.support.agreement import check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known

__all__ = ["SIMPLICES", "Scene", "finite", "known"]


@dataclass(frozen=True, eq=False)
@in_si(temperature="K")
class Scene:
    """A device with its materials and everything imposed on it.

    Parameters
    ----------
    device
        The mesh with its names, from `device`.  With elements of degree 3 or 4, the scene takes the
        curved cells of a mesh family of the same degree in place of quadratic ones.
    materials
        Material of each region; every region must have one.
    electrodes
        Electrodes (of given potential or charge, or with a source) and grounds.  May be empty: then
        no potential is modelled at all.
    supports
        `Fix`, `Clamp`, `FreeBody`, `Periodic` faces, and `Rigid` parts in the plane.
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
    temperature
        Temperature of all regions in K at first; None for the reference of each material.
        Materials without `thermal` do not notice it.  `Temperature` changes it.

    Raises
    ------
    InputError
        For an unknown name, a region without material, an electrode without facets, unphysical
        constants, folded cells and the like; one sentence says what is wrong, where, and what would
        be right.
    """

    device: Device
    materials: Mapping[str, Material]
    electrodes: Sequence[Electrode | ChargedElectrode | Source] = ()
    supports: Sequence[Support] = ()
    prescribed: Sequence[Prescribed] = ()
    loads: Sequence[Load] = ()
    kinematics: Kinematics = field(default_factory=ThreeD)
    elements: Discretisation = field(default_factory=Discretisation)
    temperature: float | None = None

    def __post_init__(self) -> None:
        check_declared(self)
        # before the first collective call: ranks with other names would wait for each other
        check_same(self.device.comm, {
            f.name: getattr(self, f.name) for f in fields(self) if f.name != "device"
        })  # fmt: skip
        if (degree := self.elements.degree) in self.elements.DEGREES and degree > 2:
            curved = with_exact_shape(self.device, min(degree, QUARTIC_ORDER))
            object.__setattr__(self, "device", curved)
        for item in (*self.electrodes, *self.prescribed, *self.loads):
            if not item.ramp:
                raise InputError(f"A ramp of {type(item).__name__} has an empty name; give it one.")
        _check_names(self)
        self.kinematics.check(self.device)
        _check_materials(self)
        check_fibres(self)
        check_films(self)
        check_electrodes(self)
        for condition in self.mechanics:
            condition.check(self)
        for condition in self.mechanics:
            condition.check_beside(self.declared.told)
        check_air(self)
        check_temperatures(self, self.declared.heated, self.leaks)
        check_loads_of_membrane(self)
        if not self.supports and self.solids:
            raise InputError(
                "The scene has no supports, so the device could drift away; add Clamp(...), "
                "Fix(...) or FreeBody()."
            )
        _check_global_unknowns(self)
        _check_added_fields(self)
        self.elements.check(self.device.mesh.topology.cell_name())
        check_cells(self.device, self.elements.quadrature_degree)

    @property
    def mechanics(self) -> tuple[Condition, ...]:
        """All conditions but the electrodes."""
        return (*self.supports, *self.prescribed, *self.loads)

    @cached_property
    def declared(self) -> Declared:
        """What all conditions declare.  They are asked once, after each has checked itself."""
        return gathered(self)

    @property
    def ramps(self) -> tuple[str, ...]:
        """Names of everything that can be ramped, in the order of appearance."""
        items = (*self.prescribed, *self.loads, *self.electrodes, *self.supports)
        return tuple(dict.fromkeys(ramp for item in items if (ramp := item.moved_by) is not None))

    @property
    def period(self) -> float:
        """Length in m along the global elongation, such as a helical cell's height.  Collective."""
        return self.kinematics.period(self.device)

    @property
    def solids(self) -> dict[str, Material]:
        """The materials of all regions but the air."""
        return {name: m for name, m in self.materials.items() if not m.is_air}

    @property
    def thermal_regions(self) -> tuple[str, ...]:
        """Regions whose temperature is not the reference of their material at all loads."""
        return heated_regions(self, self.declared.heated)

    @property
    def has_potential(self) -> bool:
        return bool(self.electrodes)

    @property
    def leaks(self) -> bool:
        """Whether a dielectric conducts or relaxes, or an electrode has a sheet resistance."""
        found = [m.dielectric for m in self.materials.values() if m.is_dielectric]
        late = any(d.conductivity_law() is not None or d.relaxation_terms() for d in found)
        sheets = any(getattr(e, "ohms_per_square", 0) for e in self.electrodes)
        return self.has_potential and (late or sheets)

    @property
    def leaks_alike(self) -> bool:
        """Whether charge leaks by one constant ratio g/eps in all dielectrics, and none relaxes."""
        found = set()
        for material in self.materials.values():
            if material.is_dielectric:
                law = material.dielectric.conductivity_law()
                late = material.dielectric.relaxation_terms()
                if late or (law is not None and law.field is not None):
                    return False
                siemens = 0.0 if law is None else law.siemens_per_metre
                found.add(siemens / material.dielectric.permittivity())
        return len(found) == 1

    def reference_voltage(self, ramp: str) -> float:
        """The potential in V, largest in size, of the electrodes on a ramp; 0 if there are none."""
        given = [e.given_volts for e in self.electrodes if e.ramp == ramp]
        return max(given, key=abs, default=0.0)

    @property
    def unit_volts(self) -> dict[str, float]:
        """`reference_voltage` of each ramp."""
        return {ramp: self.reference_voltage(ramp) for ramp in self.ramps}

    def is_electric(self, ramp: str) -> bool:
        """Whether a ramp drives potentials or charges and nothing else."""
        others = {item.moved_by for item in (*self.prescribed, *self.loads, *self.supports)}
        return ramp not in others and ramp in {e.ramp for e in self.electrodes}


def _check_names(scene: Scene) -> None:
    """If the mesh lacks several of the names that a scene needs, name all of them at once.

    A single one is left to the checks below, which say what it is for.
    """
    device = scene.device
    regions, surfaces = set(scene.materials), set[str]()
    for electrode in scene.electrodes:
        surfaces |= set(electrode.names) - set(device.regions)
    for condition in scene.mechanics:
        surfaces |= set(condition.surface_names)
        regions |= set(condition.region_names)
    # A rigid part may be a region, and what moves it names this region.
    places = {*device.surfaces, *device.regions}
    lacking = [*sorted(regions - set(device.regions)), *sorted(surfaces - places)]
    if len(lacking) > 1:
        raise InputError(
            f"The scene needs {', '.join(map(repr, lacking))}, which the mesh lacks; "
            f"{device.source or 'it'} has the regions {', '.join(sorted(device.regions))} and the "
            f"surfaces {', '.join(sorted(device.surfaces)) or 'none'}."
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
        if material.damage is not None and scene.kinematics.is_membrane:
            raise InputError(
                f"Region {name!r} softens, but a membrane takes no damage; leave it out, or take a "
                "mesh in space."
            )
        if faults:
            model = type(material.elastic).__name__
            raise InputError(f"Region {name!r}, {model}: {faults[0]}.")


def _check_global_unknowns(scene: Scene) -> None:
    """Check that no global unknown is prescribed twice, or both prescribed and loaded."""
    given = set()
    for item, value in scene.declared.fixed_globals:
        if value.unknown in given:
            raise InputError(f"{type(item).__name__} is prescribed twice; give it once.")
        given.add(value.unknown)
    for load, force in scene.declared.global_forces:
        if force.unknown in given:
            raise InputError(
                f"{type(load).__name__} has no effect on a cell whose motion along it is "
                "prescribed; leave one of the two out."
            )


def _check_added_fields(scene: Scene) -> None:
    """Check that the regions in which conditions place fields of their own exist."""
    for added in scene.declared.added:
        for new in added.fields:
            for name in new.regions or ():
                known(name, scene.device.regions, f"region of the field {new.name!r}")
