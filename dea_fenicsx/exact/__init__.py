"""Homogeneous ("0-D") theory of dielectric elastomer films, exact to rounding.

    film = Film(material, thickness=1e-3, first=Held(1.0)).prestretched(1.0, 2.125)
    branch = trace(film)
    branch.voltage, branch.stretches          # the whole curve
    branch.event("pull-in").voltage           # what happens on it, and where
    branch.states_at(3e3)                     # every equilibrium at 3 kV, each with its stability

A film with viscous branches moves in time:

    course = march(film, seconds=60, voltage=Rise(3e3, seconds=10))
    course.stretch(30.0), course.pull_in, course.balance().dissipated

NumPy and SciPy only; nothing here needs a mesh.
"""

from typing import Any
from warnings import warn

from dea_fenicsx.exact.activation import activation_voltage
from dea_fenicsx.exact.balloon import Balloon
from dea_fenicsx.exact.bending import Bent, bend
from dea_fenicsx.exact.branch import Branch, Event, HomogeneousState, trace
from dea_fenicsx.exact.circuits import Harvest, charging_voltage, harvesting_cycle, leaked_charge
from dea_fenicsx.exact.cone import Cone
from dea_fenicsx.exact.course import Balance, Course, Moments, PullIn
from dea_fenicsx.exact.cycles import steady_cycle
from dea_fenicsx.exact.disc_capacitor import disc_capacitance, plate_capacitance
from dea_fenicsx.exact.failure import MODES, Failure, FailureMap, failure_map, first_failure, limits
from dea_fenicsx.exact.film import CONTROLS, FREE, Dead, Film, Held, TrueStress
from dea_fenicsx.exact.helicoid import Helicoid, elastic_pressure, stable_limit
from dea_fenicsx.exact.laminate import Laminate, Ply, stoney_curvature, timoshenko_curvature
from dea_fenicsx.exact.limits import instantaneous, relaxed
from dea_fenicsx.exact.linear import (
    bending_curvature,
    bonded_modulus,
    bonded_ring_modulus,
    stack_share,
)
from dea_fenicsx.exact.marching import march
from dea_fenicsx.exact.pull_in_map import PullInMap, pull_in_map
from dea_fenicsx.exact.round_balloon import RoundBalloon, RoundnessChange, RoundState
from dea_fenicsx.exact.states import (
    elastic_stress,
    maxwell_pressure,
    nominal_stress,
    open_circuit_voltage,
    second_variation,
    true_stress,
)

__all__ = [
    "Film",
    "Held",
    "Dead",
    "TrueStress",
    "FREE",
    "CONTROLS",
    "trace",
    "Branch",
    "Event",
    "HomogeneousState",
    "elastic_stress",
    "true_stress",
    "nominal_stress",
    "maxwell_pressure",
    "open_circuit_voltage",
    "second_variation",
    "activation_voltage",
    "Helicoid",
    "stable_limit",
    "elastic_pressure",
    "bonded_modulus",
    "bonded_ring_modulus",
    "stack_share",
    "bending_curvature",
    "bend",
    "Bent",
    "Laminate",
    "Ply",
    "timoshenko_curvature",
    "stoney_curvature",
    "FailureMap",
    "failure_map",
    "Failure",
    "first_failure",
    "limits",
    "march",
    "Cone",
    "Course",
    "Moments",
    "PullIn",
    "Balance",
    "relaxed",
    "instantaneous",
    "steady_cycle",
    "pull_in_map",
    "PullInMap",
    "leaked_charge",
    "charging_voltage",
    "harvesting_cycle",
    "Harvest",
    "MODES",
    "Balloon",
    "RoundBalloon",
    "RoundState",
    "RoundnessChange",
    "disc_capacitance",
    "plate_capacitance",
]

_RENAMED = {"State": HomogeneousState, "ShapeChange": RoundnessChange}


def __getattr__(name: str) -> Any:
    """A class by its earlier name, with a DeprecationWarning."""
    if name in _RENAMED:
        now = _RENAMED[name]
        warn(f"exact.{name} is called {now.__name__} now.", DeprecationWarning, stacklevel=2)
        return now
    raise AttributeError(f"dea_fenicsx.exact has no {name!r}")
