"""The largest energy so far at quadrature points, by which rubbers soften."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.support import compat


class Damages:
    """What a problem remembers of the largest energies; falsy where nothing softens.

    A history has the largest energy density in Pa, of shape (cells, points), 0 in an undamaged
    body.  It is counted from one accepted state to the next, whether time passes or not.

    Parameters
    ----------
    mesh, kernels, points
        The mesh, regions that share one integral, and for each the fields at a point, symbolic.
    quadrature
        Quadrature points of the reference cell.
    """

    NAME = "damage"

    def __init__(
        self, mesh: Any, kernels: Sequence[Kernel], points: Sequence[MaterialPoint],
        quadrature: np.ndarray,
    ) -> None:  # fmt: skip
        self._mesh, self._per_cell = mesh, len(quadrature)
        imap = mesh.topology.index_map(mesh.topology.dim)
        self._cells = imap.size_local + imap.num_ghosts
        self._energy = [
            (kernel, compat.expression(
                ufl.as_vector([kernel.elastic.energy(point.strain)]), quadrature
            ))
            for kernel, point in zip(kernels, points, strict=True) if kernel.damage is not None
        ]  # fmt: skip

    def __bool__(self) -> bool:
        return bool(self._energy)

    @property
    def columns(self) -> int:
        """Numbers in each cell."""
        return self._per_cell if self else 0

    def at_rest(self) -> np.ndarray:
        """The history of the undamaged body."""
        return np.zeros((self._cells, self._per_cell))

    def show(self, history: np.ndarray) -> None:
        """Put the history of a state into the forms."""
        for kernel, _ in self._energy:
            assert kernel.damage is not None
            kernel.damage.peak.x.array[:] = history.ravel()

    def settled(self, history: np.ndarray) -> np.ndarray:
        """The history after the present state, which has this one, was accepted."""
        found = history.copy()
        for kernel, evaluate in self._energy:
            if len(kernel.cells):
                energy = evaluate(self._mesh, kernel.cells).reshape(len(kernel.cells), -1)
                found[kernel.cells] = np.maximum(found[kernel.cells], energy)
        return found

    def table(self, history: np.ndarray, cells: int) -> np.ndarray:
        """A history by cell, of shape (cells, `columns`)."""
        return history[:cells]

    def untabled(self, table: np.ndarray) -> np.ndarray:
        """The history that `table` gave."""
        found = self.at_rest()
        found[: len(table)] = table
        return found
