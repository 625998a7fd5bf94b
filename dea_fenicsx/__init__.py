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

if TYPE_CHECKING:
    from dea_fenicsx import design, exact, materials, origami, pictures
    from dea_fenicsx.conditions import (
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
        Ground,
        PreStretch,
        Stretch,
        Taper,
        ThinFilm,
        Torque,
        Twist,
    )
    from dea_fenicsx.errors import (
        DeaError,
        EquilibriumLost,
        InputError,
        Interrupted,
        MachineError,
        NotReached,
        SolverError,
    )
    from dea_fenicsx.failures import ElectricalBreakdown, LossOfTension, StretchLimit
    from dea_fenicsx.kinematics import (
        Axisymmetric,
        GeneralisedPlaneStrain,
        Helical,
        PlaneStrain,
        ThreeD,
    )
    from dea_fenicsx.ladder import speed_vs_error
    from dea_fenicsx.materials import (
        ArrudaBoyce,
        Breakdown,
        Conductor,
        Gent,
        IdealDielectric,
        Material,
        MooneyRivlin,
        NeoHookean,
        Ogden,
        Yeoh,
    )
    from dea_fenicsx.mesh import Device, read_gmsh
    from dea_fenicsx.observables import (
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
    from dea_fenicsx.overall import (
        OverallContraction,
        OverallForce,
        OverallStretch,
        OverallTorque,
        OverallTwist,
    )
    from dea_fenicsx.reading import read_history, read_summary
    from dea_fenicsx.results import Run
    from dea_fenicsx.rotation import BendingAngle, Rotation
    from dea_fenicsx.run import solve
    from dea_fenicsx.scene import Scene
    from dea_fenicsx.script import Parser
    from dea_fenicsx.solver import NewtonOptions
    from dea_fenicsx.stepping import Ramp
    from dea_fenicsx.tracing import Trace
    from dea_fenicsx.turns import per_turn

_HOME = {
    "conditions": (
        "AxialForce", "AxialStretch", "ChargedElectrode", "Clamp", "DeadLoad", "DeadPressure",
        "Discretisation", "Displacement", "Electrode", "Fix", "FollowerPressure", "FreeBody",
        "Ground", "PreStretch", "Stretch", "Taper", "ThinFilm", "Torque", "Twist",
    ),
    "errors": (
        "DeaError", "EquilibriumLost", "InputError", "Interrupted", "MachineError", "NotReached",
        "SolverError",
    ),
    "failures": ("ElectricalBreakdown", "LossOfTension", "StretchLimit"),
    "kinematics": (
        "Axisymmetric", "GeneralisedPlaneStrain", "Helical", "PlaneStrain", "ThreeD",
    ),
    "ladder": ("speed_vs_error",),
    "materials": (
        "ArrudaBoyce", "Breakdown", "Conductor", "Gent", "IdealDielectric", "Material",
        "MooneyRivlin", "NeoHookean", "Ogden", "Yeoh",
    ),
    "mesh": ("Device", "read_gmsh"),
    "observables": (
        "Area", "Capacitance", "Charge", "Contraction", "LargestDisplacement", "MeanDisplacement",
        "MeanStretch", "Potential", "Reaction",
    ),
    "overall": (
        "OverallContraction", "OverallForce", "OverallStretch", "OverallTorque", "OverallTwist",
    ),
    "reading": ("read_history", "read_summary"),
    "rotation": ("BendingAngle", "Rotation"),
    "results": ("Run",),
    "run": ("solve",),
    "scene": ("Scene",),
    "script": ("Parser",),
    "solver": ("NewtonOptions",),
    "stepping": ("Ramp",),
    "tracing": ("Trace",),
    "turns": ("per_turn",),
}  # fmt: skip
_WHERE = {name: module for module, names in _HOME.items() for name in names}
_MODULES = ("design", "exact", "geometry", "materials", "origami", "pictures")
__all__ = sorted([*_WHERE, *_MODULES])


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f"dea_fenicsx.{_WHERE[name]}"), name)
    if name in _MODULES:
        return import_module(f"dea_fenicsx.{name}")
    raise AttributeError(f"dea_fenicsx has no {name!r}")


def __dir__() -> list[str]:
    return __all__
