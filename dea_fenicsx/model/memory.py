"""What a problem remembers of earlier times, and how it enters and leaves the forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.materials import Material
from dea_fenicsx.model.flow import Flow
from dea_fenicsx.model.heat import Temperatures
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.viscous_history import (
    PAIRS,
    Rule,
    ViscousHistory,
    combined,
    contracted,
    inverse,
    unimodular,
)
from dea_fenicsx.support import compat

KEPT_TIMES = 4
"""Number of accepted times whose strains are kept: three for a parabola, and one more."""

MOST_LEVELS = 5
"""The same of viscous strains after a step of BDF3: a cubic and one more."""

INFINITE_STEP = 1e30
"""A step of this length in s represents an infinite one, in which each branch with a tau
relaxes.
"""


class Memory:
    """The viscous strains of a problem.

    Parameters
    ----------
    kernels, points
        Regions that share one integral, and for each the fields at a point, symbolic.
    quadrature
        Quadrature points of the reference cell.
    temperatures
        Temperatures there.

    Attributes
    ----------
    branches
        Largest number of branches of a region.
    """

    NAME = "viscous"

    def __init__(
        self,
        mesh: Any,
        kernels: Sequence[Kernel],
        points: Sequence[MaterialPoint],
        quadrature: np.ndarray,
        temperatures: Temperatures,
    ) -> None:
        self._mesh, self._temperatures = mesh, temperatures
        self._kernels = [k for k in kernels if k.branches]
        self.branches = max((k.viscous_branches for k in kernels), default=0)
        self._shown: ViscousHistory | None = None
        self._functions = {b.place: b.function for k in self._kernels for b in k.branches}
        self._flow = Flow(kernels)
        imap = mesh.topology.index_map(mesh.topology.dim)
        self._cells = imap.size_local + imap.num_ghosts
        self._per_cell = len(quadrature)
        self._strain = [
            (kernel, compat.expression(
                ufl.as_vector([point.strain.C[i, j] for i, j in PAIRS]), quadrature
            ))
            for kernel, point in zip(kernels, points, strict=True) if kernel.is_viscous
        ]  # fmt: skip

    @property
    def _cold_rates(self) -> np.ndarray:
        """One over the relaxation time of each Maxwell branch in each local cell, 0 elsewhere.

        It is that at the reference temperature.
        """
        found = np.zeros((self.branches, self._cells))
        for kernel in self._kernels:
            for branch in kernel.branches:
                tau = branch.tau.x.array
                found[branch.place, tau > 0] = 1 / tau[tau > 0]
        return found

    @property
    def _rates(self) -> np.ndarray:
        """The same at the quadrature points at their temperatures, of (branches, cells, points).

        Without temperatures the last axis has length 1.
        """
        found = self._cold_rates[..., None]
        kernels = [k for k in self._temperatures.kernels if k.heat.thermal.shift is not None]
        if kernels:
            found = np.repeat(found, self._per_cell, axis=-1)
        for kernel in kernels:
            slower = kernel.heat.thermal.time_factor(self._temperatures.of(kernel))
            found[:, kernel.cells] /= slower
        return found

    def __bool__(self) -> bool:
        return self.branches > 0

    @property
    def columns(self) -> int:
        """Numbers in each cell at each time."""
        return self.branches * self._per_cell * 6

    def at_rest(self) -> ViscousHistory:
        """The history of a body that has never been strained."""
        one = np.zeros((self.branches, self._cells, self._per_cell, 6))
        one[..., :3] = 1.0
        return ViscousHistory((one,), (0.0,))

    def show(self, history: ViscousHistory) -> None:
        """Put the history of a state into the coefficients of the forms."""
        if history is not self._shown:
            tensors = combined(history)
            for place, function in self._functions.items():
                function.x.array[:] = tensors[place].ravel()
            self._shown = history
        span, rates = min(history.span, INFINITE_STEP), self._cold_rates
        for kernel in self._kernels:
            for branch in kernel.branches:
                branch.step.x.array[:] = span * rates[branch.place]

    def let_flow(self, history: ViscousHistory, materials: Mapping[str, Material]) -> None:
        """Put the stress of branches that are solved at each point into the forms, if there are.

        The problem must be in the state that belongs to the history.
        """
        if self._flow:
            span = min(history.span, INFINITE_STEP)
            self._flow.update(span, self.strains(), combined(history), materials)

    @property
    def least_margin(self) -> float:
        """Smallest distance of these branches' chains to their lock-up on this rank."""
        return self._flow.least_margin

    def strains(self) -> np.ndarray:
        """C at the quadrature points of each local cell, of shape (cells, points, 6)."""
        found = np.zeros((self._cells, self._per_cell, 6))
        found[..., :3] = 1.0
        for kernel, evaluate in self._strain:
            if len(kernel.cells):
                values = evaluate(self._mesh, kernel.cells)
                found[kernel.cells] = values.reshape(len(kernel.cells), self._per_cell, 6)
        return found

    def strained(self, history: ViscousHistory) -> np.ndarray:
        """The viscous strains of the present state, which belongs to this history."""
        if history.span == 0:
            return history.strains[0]
        span, C, H = min(history.span, INFINITE_STEP), self.strains(), combined(history)
        found = unimodular((span * self._rates)[..., None] * C + H)
        self._flow.put_strains(found, span, C, H)
        return found

    def refreshed(self, history: ViscousHistory, time: float) -> ViscousHistory:
        """The history after changes in no time, without earlier values."""
        return history.restarted()

    def staged(self, history: ViscousHistory, time: float) -> ViscousHistory:
        """The history with the end of the first stage of SDIRK2 as its newest level.

        The problem is in the state at that end.
        """
        return replace(
            history, strains=(self.strained(history), *history.strains),
            times=(time, *history.times), rule=Rule.STAGE,
        )  # fmt: skip

    def settled(self, history: ViscousHistory, time: float) -> ViscousHistory:
        """The history after the problem's present state has been accepted at a time in s.

        Its span is 0: the state is in equilibrium with the viscous strains that it has now.
        """
        if history.span == 0:
            return history
        new, past = self.strained(history), int(history.rule is Rule.STAGE)
        if np.isinf(history.span):
            return ViscousHistory((new,), (time,))
        kept = MOST_LEVELS if history.rule is Rule.BDF3 else KEPT_TIMES
        strains = (new, *history.strains[past:])[:kept]
        return ViscousHistory(strains, (time, *history.times[past:])[:kept])

    def weigh(self, volumes: np.ndarray, materials: Mapping[str, Material], cells_of: Any) -> None:
        """Take the volumes of the owned cells and the moduli, by which errors are weighted."""
        self._weights = np.zeros((self.branches, len(volumes)))
        for region, material in materials.items():
            cells = cells_of(region)
            cells = cells[cells < len(volumes)]
            moduli = [branch.mu for branch in material.viscous]
            total = material.elastic.shear_modulus() + sum(moduli)
            for k, mu in enumerate(moduli):
                self._weights[k, cells] = volumes[cells] * mu / total
        inside = np.any(self._weights > 0, axis=0)
        comm = self._mesh.comm
        self._volume = comm.allreduce(float(volumes[inside].sum()), op=MPI.SUM)

    def size(self, strains: np.ndarray) -> float:
        """Root mean square of a change of the viscous strains, as of `March`.  Collective."""
        owned = self._weights.shape[1]
        squares = contracted(strains[:, :owned], strains[:, :owned]).mean(axis=-1)
        total = self._mesh.comm.allreduce(float((self._weights * squares).sum()), op=MPI.SUM)
        return float(np.sqrt(total / self._volume))

    def relaxation_times(self) -> tuple[float, float] | None:
        """The shortest and the longest finite relaxation time in s; None if all are infinite.

        Collective.
        """
        rates = self._rates
        own = np.array(self._flow.relaxation_times()).ravel()
        mine = np.concatenate([rates[rates > 0], 1 / own[np.isfinite(own)]])
        comm = self._mesh.comm
        high = comm.allreduce(float(np.max(mine, initial=0.0)), op=MPI.MAX)
        low = comm.allreduce(float(np.min(mine, initial=np.inf)), op=MPI.MIN)
        return (1 / high, 1 / low) if high > 0 else None

    def second_rates(self, strains: np.ndarray) -> np.ndarray:
        """The size of the second time derivative of C_v in 1/s^2, at held strain.

        The viscous strains are those of the present state.
        """
        first, second = np.zeros_like(strains), np.zeros_like(strains)
        C = self.strains()
        for k, rate in enumerate(self._rates):
            inside = np.flatnonzero(rate[:, 0])
            v = strains[k, inside]
            share = contracted(C[inside], inverse(v)) / 3
            first[k, inside] = rate[inside, :, None] * (C[inside] - share[..., None] * v)
            second[k, inside] = rate[inside, :, None] * first[k, inside]
        self._flow.put_rates(first, second, C, strains)
        return second
