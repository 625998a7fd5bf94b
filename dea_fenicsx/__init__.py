"""Simulation of dielectric elastomer actuators on FEniCSx.

Everything a script needs is here: ``import dea_fenicsx as dea``.  Names are loaded when they are
first used, so that ``dea_fenicsx.geometry`` and ``dea_fenicsx.pictures`` start without DOLFINx.
Importing the package changes nothing of the process: see `errors.install_hook` for what ends all
ranks on an error, and when it is installed.
"""

# ruff: noqa: F401  (the imports below are for type checkers; names are loaded on demand)
from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
"""The only place of the version: pyproject.toml, the command and results read it from here."""

if TYPE_CHECKING:
    from dea_fenicsx import calibration, design, exact, materials, origami, pictures
    from dea_fenicsx.calibration.fitting import calibrate
    from dea_fenicsx.calibration.parameters import Parameter
    from dea_fenicsx.calibration.scatter import uncertainty
    from dea_fenicsx.drives.waves import (
        Chirp,
        Constant,
        Function,
        Rise,
        Sine,
        Square,
        Step,
        Table,
        Triangle,
    )
    from dea_fenicsx.gradients.discretisation import DiscretisationError
    from dea_fenicsx.gradients.gradient import Gradient
    from dea_fenicsx.gradients.variables import ConstantChange, ShapeChange
    from dea_fenicsx.materials import (
        WLF,
        Alexander,
        Along,
        Arrhenius,
        ArrudaBoyce,
        BlatzKo,
        Breakdown,
        CompositeDielectric,
        Conductor,
        Cylindrical,
        Electrostriction,
        Entropic,
        ExtendedTube,
        Gent,
        Helix,
        HolzapfelFibres,
        IdealDielectric,
        KumarLopezPamies,
        LangevinDielectric,
        LinearChange,
        LinearPermittivity,
        Material,
        Maxwell,
        MooneyRivlin,
        NeoHookean,
        Ogden,
        OgdenHill,
        OgdenRoxburgh,
        PolynomialPermittivity,
        Reinforced,
        SaturatingDielectric,
        SplineEnergy,
        StandardReinforcing,
        TabulatedChange,
        TabulatedPermittivity,
        Thermal,
        TransverselyIsotropic,
        VanDerWaals,
        ViscousBranch,
        WeibullBreakdown,
        Wound,
        Yeoh,
    )
    from dea_fenicsx.measure.axial import (
        OverallContraction,
        OverallForce,
        OverallStretch,
        OverallTorque,
        OverallTwist,
    )
    from dea_fenicsx.measure.cavity import CavityEnergy, CavityPressure, CavityVolume
    from dea_fenicsx.measure.contact import (
        ContactArea,
        ContactForce,
        ContactGap,
        ContactPressure,
        FrictionWork,
    )
    from dea_fenicsx.measure.currents import ChargeLoss, Current
    from dea_fenicsx.measure.energy import DamageLoss, Dissipation, Energy
    from dea_fenicsx.measure.failures import ElectricalBreakdown, LossOfTension, StretchLimit
    from dea_fenicsx.measure.in_motion import AngularMomentum, KineticEnergy, Momentum
    from dea_fenicsx.measure.line import AlongLine, Curvature
    from dea_fenicsx.measure.observables import (
        Area,
        Capacitance,
        Charge,
        Contraction,
        LargestDisplacement,
        MeanDisplacement,
        MeanStretch,
        Potential,
        Reaction,
    )
    from dea_fenicsx.measure.over_region import CentreOfMass, Expression, OverRegion
    from dea_fenicsx.measure.periodic_force import PeriodicForce
    from dea_fenicsx.measure.point import AtPoint
    from dea_fenicsx.measure.rigid_part import (
        PartDisplacement,
        PartForce,
        PartMoment,
        PartRotation,
    )
    from dea_fenicsx.measure.rotation import BendingAngle, Rotation
    from dea_fenicsx.measure.vibration import Frequency
    from dea_fenicsx.mesh.device import Device, device, read_gmsh
    from dea_fenicsx.mesh.from_dolfinx import from_dolfinx
    from dea_fenicsx.mesh.places import InBox, InCylinder, Interior, OnCylinder, OnPlane
    from dea_fenicsx.path.items import Close, Inertia, InMotion, March, Open, Ramp, Trace
    from dea_fenicsx.results.finished import Run
    from dea_fenicsx.results.per_turn import per_turn
    from dea_fenicsx.results.reading import read_history, read_summary
    from dea_fenicsx.results.stored_state import StoredStep
    from dea_fenicsx.run.branches import Diagram, branches
    from dea_fenicsx.run.deflating import Equilibrium, deflate
    from dea_fenicsx.run.fidelity_ladder import speed_vs_error
    from dea_fenicsx.run.frequency_response import FrequencyResponse, frequency_response
    from dea_fenicsx.run.imperfections import ModeShape, RandomShape, imperfect
    from dea_fenicsx.run.knocking_down import KnockDown, knock_down
    from dea_fenicsx.run.modes import Modes, modes
    from dea_fenicsx.run.parser import Parser
    from dea_fenicsx.run.planning import Plan, plan
    from dea_fenicsx.run.session import solve
    from dea_fenicsx.scene.body_forces import BodyForce, Centrifugal, Gravity
    from dea_fenicsx.scene.cavity import Cavity
    from dea_fenicsx.scene.electrodes import (
        ChargedElectrode,
        Electrode,
        Ground,
        ThinFilm,
    )
    from dea_fenicsx.scene.elements import Discretisation
    from dea_fenicsx.scene.graded import Graded
    from dea_fenicsx.scene.kinematics import (
        Axisymmetric,
        GeneralisedPlaneStrain,
        Helical,
        PlaneStrain,
        ThreeD,
    )
    from dea_fenicsx.scene.law_check import LawCheck, check_law
    from dea_fenicsx.scene.loads import (
        AxialForce,
        DeadLoad,
        DeadPressure,
        FollowerPressure,
        Torque,
    )
    from dea_fenicsx.scene.membrane_pressure import MembranePressure
    from dea_fenicsx.scene.membranes import AxisymmetricMembrane, Membrane, SurfaceMembrane
    from dea_fenicsx.scene.obstacles import Obstacle
    from dea_fenicsx.scene.periodic import MeanStrain, Periodic
    from dea_fenicsx.scene.prescribed import (
        AxialStretch,
        Displacement,
        PreStretch,
        Stretch,
        Twist,
    )
    from dea_fenicsx.scene.rigid import Force, Moment, Rigid, Turn
    from dea_fenicsx.scene.scene import Scene
    from dea_fenicsx.scene.shapes import Cylinder, Plane, Sphere
    from dea_fenicsx.scene.sources import Source
    from dea_fenicsx.scene.springs import BistableLaw, CubicLaw, ElasticFoundation, Spring
    from dea_fenicsx.scene.supports import Clamp, Fix, FreeBody
    from dea_fenicsx.scene.table_law import TableLaw
    from dea_fenicsx.scene.taper import Taper
    from dea_fenicsx.scene.temperature import Temperature
    from dea_fenicsx.scene.torsion import TorsionSpring
    from dea_fenicsx.solvers.options import NewtonOptions
    from dea_fenicsx.studies.samples import LatinHypercube
    from dea_fenicsx.studies.study import Study, study
    from dea_fenicsx.support.errors import (
        DeaError,
        EquilibriumLost,
        InputError,
        Interrupted,
        MachineError,
        NotReached,
        SolverError,
        StabilityLost,
    )

_HOME = {
    "scene.body_forces": ("BodyForce", "Centrifugal", "Gravity"),
    "scene.cavity": ("Cavity",),
    "measure.cavity": ("CavityEnergy", "CavityPressure", "CavityVolume"),
    "scene.electrodes": ("ChargedElectrode", "Electrode", "Ground", "ThinFilm"),
    "scene.taper": ("Taper",),
    "scene.elements": ("Discretisation",),
    "scene.graded": ("Graded",),
    "scene.loads": ("AxialForce", "DeadLoad", "DeadPressure", "FollowerPressure", "Torque"),
    "scene.periodic": ("MeanStrain", "Periodic"),
    "scene.prescribed": ("AxialStretch", "Displacement", "PreStretch", "Stretch", "Twist"),
    "scene.membrane_pressure": ("MembranePressure",),
    "scene.membranes": ("AxisymmetricMembrane", "Membrane", "SurfaceMembrane"),
    "scene.obstacles": ("Obstacle",),
    "scene.shapes": ("Cylinder", "Plane", "Sphere"),
    "scene.rigid": ("Force", "Moment", "Rigid", "Turn"),
    "scene.sources": ("Source",),
    "scene.springs": ("BistableLaw", "CubicLaw", "ElasticFoundation", "Spring"),
    "scene.table_law": ("TableLaw",),
    "scene.temperature": ("Temperature",),
    "scene.torsion": ("TorsionSpring",),
    "scene.supports": ("Clamp", "Fix", "FreeBody"),
    "calibration.fitting": ("calibrate",),
    "calibration.parameters": ("Parameter",),
    "calibration.scatter": ("uncertainty",),
    "studies.samples": ("LatinHypercube",),
    "studies.study": ("Study", "study"),
    "support.errors": (
        "DeaError", "EquilibriumLost", "InputError", "Interrupted", "MachineError", "NotReached",
        "SolverError", "StabilityLost",
    ),
    "gradients.discretisation": ("DiscretisationError",),
    "gradients.gradient": ("Gradient",),
    "gradients.variables": ("ConstantChange", "ShapeChange"),
    "measure.failures": ("ElectricalBreakdown", "LossOfTension", "StretchLimit"),
    "scene.law_check": ("LawCheck", "check_law"),
    "scene.kinematics": (
        "Axisymmetric", "GeneralisedPlaneStrain", "Helical", "PlaneStrain", "ThreeD",
    ),
    "run.fidelity_ladder": ("speed_vs_error",),
    "materials": (
        "Air", "ArrudaBoyce", "Breakdown", "CompositeDielectric", "Conductivity", "Conductor",
        "Debye", "Electrostriction", "Gent", "IdealDielectric", "KumarLopezPamies",
        "LangevinDielectric", "LinearPermittivity", "Material", "Maxwell", "MooneyRivlin",
        "NeoHookean", "Ogden", "PolynomialPermittivity", "SaturatingDielectric",
        "TabulatedPermittivity", "ViscousBranch", "WeibullBreakdown", "Yeoh",
        "Air", "Along", "ArrudaBoyce", "BlatzKo", "Breakdown", "Conductivity", "Conductor",
        "Cylindrical", "Debye", "ExtendedTube", "Gent", "Helix", "HolzapfelFibres",
        "IdealDielectric", "KumarLopezPamies", "Material", "Maxwell", "MooneyRivlin", "NeoHookean",
        "Ogden", "OgdenHill", "Reinforced", "SplineEnergy", "StandardReinforcing",
        "TransverselyIsotropic", "ViscousBranch", "Wound", "Yeoh",
        "Alexander", "Arrhenius", "Entropic", "LinearChange", "OgdenRoxburgh", "TabulatedChange",
        "Thermal", "VanDerWaals", "WLF",
    ),
    "mesh.device": ("Device", "device", "read_gmsh"),
    "mesh.from_dolfinx": ("from_dolfinx",),
    "mesh.places": ("InBox", "InCylinder", "Interior", "OnCylinder", "OnPlane"),
    "measure.observables": (
        "Area", "Capacitance", "Charge", "Contraction", "LargestDisplacement", "MeanDisplacement",
        "MeanStretch", "Potential", "Reaction",
    ),
    "measure.axial": (
        "OverallContraction", "OverallForce", "OverallStretch", "OverallTorque", "OverallTwist",
    ),
    "results.reading": ("read_history", "read_summary"),
    "measure.contact": (
        "ContactArea", "ContactForce", "ContactGap", "ContactPressure", "FrictionWork",
    ),
    "measure.currents": ("ChargeLoss", "Current"),
    "measure.energy": ("DamageLoss", "Dissipation", "Energy"),
    "measure.line": ("AlongLine", "Curvature"),
    "measure.over_region": ("CentreOfMass", "Expression", "OverRegion"),
    "measure.periodic_force": ("PeriodicForce",),
    "measure.point": ("AtPoint",),
    "measure.rigid_part": ("PartDisplacement", "PartForce", "PartMoment", "PartRotation"),
    "measure.rotation": ("BendingAngle", "Rotation"),
    "measure.vibration": ("Frequency",),
    "measure.in_motion": ("AngularMomentum", "KineticEnergy", "Momentum"),
    "results.finished": ("Run",),
    "results.stored_state": ("StoredStep",),
    "run.session": ("solve",),
    "run.branches": ("Diagram", "branches"),
    "run.deflating": ("Equilibrium", "deflate"),
    "run.imperfections": ("ModeShape", "RandomShape", "imperfect"),
    "run.knocking_down": ("KnockDown", "knock_down"),
    "run.planning": ("Plan", "plan"),
    "run.modes": ("Modes", "modes"),
    "run.frequency_response": ("FrequencyResponse", "frequency_response"),
    "scene.scene": ("Scene",),
    "run.parser": ("Parser",),
    "solvers.options": ("NewtonOptions",),
    "drives.waves": (
        "Chirp", "Constant", "Function", "Rise", "Sine", "Square", "Step", "Table", "Triangle",
    ),
    "path.items": ("Close", "Inertia", "InMotion", "March", "Open", "Ramp", "Trace"),
    "results.per_turn": ("per_turn",),
}  # fmt: skip
_WHERE = {name: module for module, names in _HOME.items() for name in names}
_MODULES = ("calibration", "design", "exact", "geometry", "materials", "origami", "pictures")
__all__ = sorted([*_WHERE, *_MODULES])


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f"dea_fenicsx.{_WHERE[name]}"), name)
    if name in _MODULES:
        return import_module(f"dea_fenicsx.{name}")
    raise AttributeError(f"dea_fenicsx has no {name!r}")


def __dir__() -> list[str]:
    return __all__
