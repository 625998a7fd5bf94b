"""How a scene changes with a variable of its design, found by building it for other values.

A scene is built for the design's values and for values a little larger and smaller.  The constants
of materials, voltages, pre-stretches and positions of the mesh's nodes are compared, and become
the variables of `Run.sensitivity` with their rates:

    dJ/dp = sum_k dJ/dq_k dq_k/dp + dJ/dX . dX/dp,

with what the scene is made of, q_k, and the nodes X.  The meshes must have the same cells.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from dea_fenicsx.gradients.variables import ShapeChange
from dea_fenicsx.model.parameters import Parameters
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.identity import described
from dea_fenicsx.scene.prescribed import PreStretch
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError

VARIABLE_STEP = 1e-4
"""Step of a variable, relative to its range: most geometries are linear in their sizes."""

VARIATION_TOLERANCE = 1e-9
"""Relative difference of two rates or of two positions that counts as rounding."""

Build = Callable[..., Scene]


@dataclass(frozen=True)
class Variation:
    """What changes in a scene with one variable.

    Attributes
    ----------
    name
        The variable.
    rates
        Rates of what `Run.sensitivity` knows by names: constants and pre-stretches.
    volts
        Rate in V of the reference voltage of each ramp that drives electrodes.
    shape
        The velocity of the nodes, or None where they stay.
    """

    name: str
    rates: Mapping[str, float]
    volts: Mapping[str, float]
    shape: ShapeChange | None

    def variables(self, without: str = "") -> list[str | ShapeChange]:
        """The variables to derive by, but for a ramp whose load is itself what is derived."""
        found: list[str | ShapeChange] = [*self.rates, *(r for r in self.volts if r != without)]
        return found if self.shape is None else [*found, self.shape]

    def total(self, slopes: Mapping[str, float], factors: Mapping[str, float]) -> float:
        """The derivative by the variable, from those by `variables`, at ramps' factors."""
        total = sum(rate * slopes[name] for name, rate in self.rates.items())
        for ramp, rate in self.volts.items():
            total += slopes.get(ramp, 0.0) * factors[ramp] * rate
        return float(total + (slopes[self.shape.name] if self.shape else 0.0))


def variation(
    build: Build, problem: Problem, design: Mapping[str, float], name: str,
    bounds: tuple[float, float], comm: Any,
) -> Variation:  # fmt: skip
    """How a scene changes with one variable of its design.  Collective.

    Parameters
    ----------
    build
        Makes the scene: ``build(comm, **design)``.
    problem, design
        The problem of the scene, and its design.
    name, bounds
        The variable, and its range; no scene is built for a value outside.
    comm
        The ranks that share the scene.

    Raises
    ------
    InputError
        If the mesh gets other cells, something without a derivative changes, or nothing does.
    """
    scene, (low, high) = problem.scene, bounds
    h, value = VARIABLE_STEP * (high - low), design[name]
    if value - h >= low and value + h <= high:
        weights = {value + h: 0.5 / h, value - h: -0.5 / h}
    else:  # a formula of second order with values on one side
        h = h if value - h < low else -h
        weights = {value: -1.5 / h, value + h: 2 / h, value + 2 * h: -0.5 / h}
    others = [
        (weight, scene if at == value else build(comm, **{**design, name: at}))
        for at, weight in weights.items()
    ]
    for _, other in others:
        _check_alike(problem, other, name)
    rates = _rates([(weight, _numbers(other, problem.parameters)) for weight, other in others])
    volts = _volts(scene, others, name)
    shape = _shape(scene, others, name)
    if not rates and not volts and shape is None:
        raise InputError(
            f"The variable {name!r} changes nothing in the scene that build returns; leave it out, "
            "or let build use it."
        )
    return Variation(name, rates, volts, shape)


def _rates(numbers: Sequence[tuple[float, Mapping[str, float]]]) -> dict[str, float]:
    """The rate of each number that changes, from weighted values."""
    found = {}
    for key in numbers[0][1]:
        terms = [weight * values[key] for weight, values in numbers]
        rate = sum(terms)
        if abs(rate) > VARIATION_TOLERANCE * sum(abs(term) for term in terms):
            found[key] = rate
    return found


def _numbers(scene: Scene, parameters: Parameters) -> dict[str, float]:
    """Constants of the materials and pre-stretches, by the names that derivatives have."""
    found = parameters.values_in(scene.materials)
    for item in scene.prescribed:
        if isinstance(item, PreStretch):
            given = {a: getattr(item, a) for a in "xyzr" if getattr(item, a) is not None}
            found |= {
                f"prestretch:{region}:{axis}": float(stretch)
                for region in item.names
                for axis, stretch in given.items()
            }
    return found


def _volts(scene: Scene, others: Sequence[tuple[float, Scene]], name: str) -> dict[str, float]:
    """The rate of each ramp's reference voltage, to which its electrodes keep their ratios."""
    found = {}
    for ramp, unit in scene.unit_volts.items():
        rate = sum(weight * other.unit_volts[ramp] for weight, other in others)
        for k, electrode in enumerate(scene.electrodes):
            if electrode.ramp != ramp or not unit:
                continue
            own = sum(weight * other.electrodes[k].given_volts for weight, other in others)
            if abs(own - rate * electrode.given_volts / unit) > 1e-6 * max(abs(own), abs(rate)):
                raise InputError(
                    f"The variable {name!r} changes the voltages of the ramp {ramp!r} in another "
                    "ratio; let each voltage that changes by itself have a ramp of its own."
                )
        size = sum(abs(weight * other.unit_volts[ramp]) for weight, other in others)
        if abs(rate) > VARIATION_TOLERANCE * size:
            found[ramp] = rate
    return found


def _check_alike(problem: Problem, other: Scene, name: str) -> None:
    """Raise InputError if something changes that has no derivative."""
    scene = problem.scene
    for what in ("electrodes", "supports", "prescribed", "loads", "kinematics", "elements"):
        if _neutral(getattr(scene, what)) != _neutral(getattr(other, what)):
            raise InputError(
                f"The variable {name!r} changes the {what} of the scene, which has no derivative; "
                "constants, voltages, pre-stretches and the positions of nodes may change."
            )
    kinds = [
        {region: (type(m.elastic), type(m.electric)) for region, m in one.materials.items()}
        for one in (scene, other)
    ]
    alike = kinds[0] == kinds[1]
    if not alike or problem.parameters.put_into(other.materials) != dict(scene.materials):
        raise InputError(
            f"The variable {name!r} changes more of a material than the constants that have "
            f"derivatives, which are {', '.join(problem.parameters)}."
        )


def _neutral(thing: Any) -> Any:
    """What a part of a scene is, without the numbers that have derivatives."""
    if not isinstance(thing, tuple | list):
        return described(thing)
    found = []
    for item in thing:
        if isinstance(item, PreStretch):
            given: Any = {a: 1.0 for a in "xyzr" if getattr(item, a) is not None}
            item = replace(item, **given)
        told = described(item)
        if isinstance(told, dict) and "volts" in told:
            told = told | {"volts": 0.0}
        found.append(told)
    return found


def _shape(scene: Scene, others: Sequence[tuple[float, Scene]], name: str) -> ShapeChange | None:
    """The velocity of the nodes, or None where they stay.  Collective."""
    device = scene.device
    cells = compat.geometry_dofmap(device.mesh)
    here = device.mesh.geometry.x * device.length
    alike = all(
        np.array_equal(compat.geometry_dofmap(other.device.mesh), cells) for _, other in others
    )
    if not device.comm.allreduce(alike, op=MPI.LAND):
        raise InputError(
            f"The variable {name!r} gives the mesh other cells, so that its nodes have no "
            "velocity; let build keep the number of cells, as a structured mesh does."
        )
    # the base is taken off first, so that nodes that stay have no velocity to the last bit
    velocity = sum(
        weight * (other.device.mesh.geometry.x * other.device.length - here)
        for weight, other in others
    )
    fastest = device.comm.allreduce(float(np.abs(velocity).max(initial=0.0)), op=MPI.MAX)
    step = 1 / max(abs(weight) for weight, _ in others)
    if fastest * step < VARIATION_TOLERANCE * device.length:
        return None
    nodes = cKDTree(here)

    def at(X: np.ndarray) -> np.ndarray:
        return np.asarray(velocity[nodes.query(X)[1]]) if len(X) else np.zeros_like(X)

    return ShapeChange(name, at)
