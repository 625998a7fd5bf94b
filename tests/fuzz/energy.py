"""The potential energy of accepted states, and its explicit derivatives by the ramps' factors.

Along a path of equilibria w(s), with the factors f_r(s) of the ramps,

    dPi/ds = sum_r (dPi/df_r) f_r'(s) + R_follower . w'(s),

for the derivative by all free unknowns vanishes.  dPi/df_r is, for a voltage, minus the charge
that it drives times its value at factor 1; for a prescribed displacement the reaction times its
value; for a dead load minus the displacement that it works on; for a charge the potential; for a
pre-stretch the derivative of the energy itself.  A follower pressure has no potential in general,
so that its power is taken instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.kernels import measure
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class Record:
    """An accepted state: all numbers dimensionless, as in the problem.

    Attributes
    ----------
    factors : of each ramp
    energy : the potential Pi, without follower pressures
    rates : dPi/df of each ramp
    state : the owned values of the mixed function
    force : the follower forces at the present factors, owned; None if there are none
    """

    factors: dict[str, float]
    energy: float
    rates: dict[str, float]
    state: np.ndarray
    force: np.ndarray | None


@dataclass
class Watch:
    """An observable that is the potential energy in J, and keeps a `Record` of each step."""

    unit = "J"
    records: list[Record] = field(default_factory=list)
    problem: Any = None

    def bind(self, problem: Any) -> Callable[[], float]:
        self.problem = problem
        scene, loads = problem.scene, problem.loads
        dx = measure(scene.device, [k.cells for k in problem.kernels],
                     scene.elements.quadrature_degree)  # fmt: skip
        weight = scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))

        def compiled(densities: list[Any]) -> Any:
            return compat.compile_form(
                sum(density * weight * dx(k) for k, density in enumerate(densities))
            )

        self._energy = compiled([s.energy for s in problem.states])
        strained = {ramp for s in problem.states for ramp in s.rates}
        self._strain = {
            ramp: compiled([s.rates.get(ramp, ufl.as_ufl(0.0)) for s in problem.states])
            for ramp in strained
        }
        steady = [r for r in loads.unit_work if r not in loads.changing]
        self._dead = {r: problem.forms.load_vector(r) for r in steady}
        self._following = {r: compat.compile_form(loads.unit_work[r]) for r in loads.following}
        self._unit = problem.scales.force * problem.scales.length
        return self.measure

    def measure(self) -> float:
        problem = self.problem
        owned = slice(0, problem.owned)
        w, factors = problem.w.x.array[owned].copy(), dict(problem.factors)
        residual = problem.residual()
        fixed = problem.fixed
        rates = dict.fromkeys(factors, 0.0)
        work = 0.0
        for ramp, base in problem.conditions.fixed_values.base.items():
            rates[ramp] += float(residual[fixed] @ base[fixed])
        for ramp, vector in self._dead.items():
            mine = float(vector @ w)
            rates[ramp] += mine
            work += factors[ramp] * mine
        for group in problem.conditions.groups:
            for ramp, amount in group.sources if group.master >= 0 else ():
                mine = amount * float(w[group.master])
                rates[ramp] += mine
                work += factors[ramp] * mine
        for ramp, form in self._strain.items():
            rates[ramp] += float(np.real(dolfinx.fem.assemble_scalar(form)))
        inner = float(np.real(dolfinx.fem.assemble_scalar(self._energy)))
        names = sorted(rates)
        sums = problem.comm.allreduce(
            np.array([inner + work, *(rates[n] for n in names)]), op=MPI.SUM
        )
        force = None
        for ramp, form in self._following.items():
            vector = dolfinx.fem.assemble_vector(form)
            vector.scatter_reverse(dolfinx.la.InsertMode.add)
            more = factors[ramp] * vector.array[owned]
            force = more if force is None else force + more
        self.records.append(
            Record(factors, float(sums[0]), dict(zip(names, map(float, sums[1:]), strict=True)),
                   w, force)
        )  # fmt: skip
        return float(sums[0]) * self._unit


# Gauss-Lobatto rule of five points on [0, 1]: exact for polynomials of degree 7, and its ends are
# states of the path as well.
_ROOT = np.sqrt(3 / 7) / 2
NODES = np.array([0.0, 0.5 - _ROOT, 0.5, 0.5 + _ROOT, 1.0])
WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180


def _derivative(nodes: np.ndarray) -> np.ndarray:
    """Matrix that differentiates the interpolation polynomial through values at the nodes."""
    n = len(nodes)
    gaps = nodes[:, None] - nodes[None, :] + np.eye(n)
    c = np.prod(gaps, axis=1)
    matrix = c[:, None] / c[None, :] / gaps
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


SLOPE = _derivative(NODES)


def stops(panels: list[tuple[float, float]]) -> list[float]:
    """Positions on a ramp, without its start, at which the rule needs states; the last is 1."""
    inner = {float(a + x * (b - a)) for a, b in panels for x in NODES[1:-1]}
    return sorted(inner | {b for _, b in panels})


def balance(records: list[Record], moved: dict[str, float], width: float) -> tuple[float, float]:
    """The miss between change of energy and work over a panel, and the size of both.

    Parameters
    ----------
    records
        The states at the five nodes.
    moved
        Change of each ramp's factor over the whole ramp.
    width
        The panel's share of the ramp.
    """
    power = np.array([sum(r.rates[n] * m for n, m in moved.items()) * width for r in records])
    if records[0].force is not None:
        velocity = SLOPE @ np.array([r.state for r in records])
        power += np.array([r.force @ v for r, v in zip(records, velocity, strict=True)])
    work, change = float(WEIGHTS @ power), records[-1].energy - records[0].energy
    return abs(work - change), abs(change) + float(WEIGHTS @ np.abs(power))
