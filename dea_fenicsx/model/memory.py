"""What a problem remembers of earlier times, and how it enters and leaves the forms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.materials import Material
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.viscous_history import (
    PAIRS,
    ViscousHistory,
    combined,
    unimodular,
)
from dea_fenicsx.support import compat

RELAXED = 1e30
"""Length of a step in s that stands for an infinite one: each branch with a tau relaxes in it."""


class Memory:
    """The viscous strains of a problem.

    Parameters
    ----------
    materials
        Material of each region, for the relaxation times.
    kernels, points
        Regions that share one integral, and for each the fields at a point, symbolic.
    quadrature
        Quadrature points of the reference cell.
    cells_of
        Gives the local cells of a region.

    Attributes
    ----------
    branches
        Largest number of branches of a region.
    """

    NAME = "viscous"

    def __init__(
        self,
        mesh: Any,
        materials: dict[str, Material],
        kernels: Sequence[Kernel],
        points: Sequence[MaterialPoint],
        quadrature: np.ndarray,
        cells_of: Any,
    ) -> None:
        self._mesh, self._kernels = mesh, [k for k in kernels if k.branches]
        self.branches = max((len(k.branches) for k in kernels), default=0)
        self._functions: list[Any] = []
        for kernel in self._kernels:
            if len(kernel.branches) > len(self._functions):
                self._functions = [b.function for b in kernel.branches]
        imap = mesh.topology.index_map(mesh.topology.dim)
        self._cells = imap.size_local + imap.num_ghosts
        self._per_cell = len(quadrature)
        # One over the relaxation time, of each branch in each local cell; 0 where there is none.
        self._rates = np.zeros((self.branches, self._cells))
        for region, material in materials.items():
            for k, branch in enumerate(material.viscous):
                self._rates[k, cells_of(region)] = 1 / branch.tau
        self._strain = [
            (kernel, compat.expression(
                ufl.as_vector([point.strain.C[i, j] for i, j in PAIRS]), quadrature
            ))
            for kernel, point in zip(kernels, points, strict=True) if kernel.branches
        ]  # fmt: skip

    def __bool__(self) -> bool:
        return self.branches > 0

    def at_rest(self) -> ViscousHistory:
        """The history of a body that has never been strained."""
        one = np.zeros((self.branches, self._cells, self._per_cell, 6))
        one[..., :3] = 1.0
        return ViscousHistory((one,), (0.0,))

    def show(self, history: ViscousHistory) -> None:
        """Put the history of a state into the coefficients of the forms."""
        tensor = combined(history)
        span = min(history.span, RELAXED)
        for k, function in enumerate(self._functions):
            function.x.array[:] = tensor[k].ravel()
        for kernel in self._kernels:
            for k, branch in enumerate(kernel.branches):
                branch.step.x.array[:] = span * self._rates[k]

    def strains(self) -> np.ndarray:
        """C at the quadrature points of each local cell, of shape (cells, points, 6)."""
        found = np.zeros((self._cells, self._per_cell, 6))
        found[..., :3] = 1.0
        for kernel, evaluate in self._strain:
            if len(kernel.cells):
                values = evaluate(self._mesh, kernel.cells)
                found[kernel.cells] = values.reshape(len(kernel.cells), self._per_cell, 6)
        return found

    def settled(self, history: ViscousHistory, time: float) -> ViscousHistory:
        """The history after the step of the problem's present state has been accepted.

        Its span is 0: the state is in equilibrium with the viscous strains that it has now.
        """
        if history.span == 0:
            return history
        tensor = combined(history)
        share = min(history.span, RELAXED) * self._rates
        new = unimodular(share[..., None, None] * self.strains() + tensor)
        kept = (new, *history.strains[:2]) if np.isfinite(history.span) else (new,)
        times = (time, *history.times[:2])[: len(kept)]
        return ViscousHistory(kept, times, 0.0)
