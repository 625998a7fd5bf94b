"""Observables of a device as a whole: stretch and twist, axial force and torque.

A helical cell has all of them; generalised plane strain has stretch and force, along its depth.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.scene.condition import check_global
from dea_fenicsx.scene.declarations import ELONGATION, TWIST, GlobalUnknown


@dataclass(frozen=True)
class OverallStretch:
    """Axial stretch lam of a helical cell, or along the depth of a slice."""

    unit = ""

    def bind(self, problem: Problem) -> Measurement:
        _need(problem, self, ELONGATION)
        return lambda: 1 + problem.space.global_values(problem.scales.length)[0]


@dataclass(frozen=True)
class OverallContraction:
    """Axial contraction 1 - lam of a helical cell, or along the depth of a slice."""

    unit = ""

    def bind(self, problem: Problem) -> Measurement:
        _need(problem, self, ELONGATION)
        return lambda: 0.0 - problem.space.global_values(problem.scales.length)[0]


@dataclass(frozen=True)
class OverallTwist:
    """Twist k of a helical cell: rotation per undeformed axial length, in rad/m."""

    unit = "rad_per_m"

    def bind(self, problem: Problem) -> Measurement:
        _need(problem, self, TWIST)
        return lambda: problem.space.global_values(problem.scales.length)[1]


@dataclass(frozen=True)
class OverallForce:
    """Axial force through a helical cell or a slice in N, held by a prescribed stretch or applied.

    The derivative of the energy by the stretch, over the height of the period or the depth.
    """

    unit = "N"

    def bind(self, problem: Problem) -> Measurement:
        return _bind_action(problem, self, ELONGATION)


@dataclass(frozen=True)
class OverallTorque:
    """Torque through the helical cell in N m, held by a prescribed twist or applied."""

    unit = "N_m"

    def bind(self, problem: Problem) -> Measurement:
        action = _bind_action(problem, self, TWIST)
        return lambda: action() * problem.scales.length


def _bind_action(problem: Problem, observable: object, unknown: GlobalUnknown) -> Measurement:
    """The generalised force on a global unknown, from its residual.

    In N for an elongation; for a twist in N times the unit of length.
    """
    _need(problem, observable, unknown)
    dofs = problem.overall[unknown.name].dofs
    dofs = dofs[dofs < problem.owned]
    scene, scales = problem.scene, problem.scales
    unit = scales.force * scales.length / scene.period

    def value() -> float:
        total = float(problem.residual()[dofs].sum())
        return problem.comm.allreduce(total, op=MPI.SUM) * unit

    return value


def _need(problem: Problem, observable: object, unknown: GlobalUnknown) -> None:
    """Raise InputError in a problem without a global unknown."""
    check_global(problem.scene, unknown, observable)
