"""Extremes over all quadrature points: det F, the chains' margin, and the electric field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.support import compat


@dataclass(frozen=True)
class Probe:
    """Extreme values over all quadrature points.

    Attributes
    ----------
    min_J : smallest det F
    solid_J : smallest det F outside of the air
    min_margin : smallest distance to chain lock-up (1 where there is none)
    max_field : largest true electric field, dimensionless; in the solids, if a field lives there
    place : undeformed position of the largest field, dimensionless, shape (3,)
    min_relaxable : positive if a membrane that wrinkles has a relaxed energy everywhere
    """

    min_J: float
    min_margin: float
    max_field: float
    place: np.ndarray
    solid_J: float = np.inf
    min_relaxable: float = np.inf

    @property
    def admissible(self) -> bool:
        """Whether every energy is defined; False for NaN as well."""
        return self.min_J > 0 and self.min_margin > 0 and self.min_relaxable > 0


class Prober:
    """Evaluates a problem's present state at its quadrature points.

    Parameters
    ----------
    mesh
        The mesh.
    kernels, states
        The kernels, and the symbolic fields of each.
    points
        Quadrature points of the reference cell.
    """

    def __init__(
        self,
        mesh: Any,
        kernels: Sequence[Kernel],
        states: Sequence[MaterialPoint],
        points: np.ndarray,
    ) -> None:
        self._mesh = mesh
        self._evaluated = [
            (kernel, compat.expression(ufl.as_vector(_watched(s)), points))
            for kernel, s in zip(kernels, states, strict=True)
        ]  # fmt: skip
        solid = [kernel for kernel in kernels if kernel.air is None]
        self._has_solids = bool(solid)
        self._in_solids = any(kernel.eps is not None for kernel in solid)
        self._shapes = compat.coordinate_element(mesh).tabulate(0, points)[0, :, :, 0]
        self._nodes = compat.geometry_dofmap(mesh)

    def extremes(self, margin: float = np.inf) -> Probe:
        """Extremes of J, lock-up margin and field over the quadrature points.  Collective.

        `margin` is the smallest distance to lock-up of other chains on this rank.
        """
        low = np.array([np.inf, margin, np.inf, np.inf])
        best = (-1.0, -1, -1)
        for kernel, evaluate in self._evaluated:
            if len(kernel.cells) == 0:
                continue
            values = evaluate(self._mesh, kernel.cells)
            least = values.reshape(-1, values.shape[2]).min(axis=0)
            low[:2] = np.minimum(low[:2], least[:2])
            if kernel.air is None:
                low[2] = np.minimum(low[2], least[0])
            if len(least) > 3:
                low[3] = np.minimum(low[3], least[3:].min())
            if kernel.air is not None and self._in_solids:
                continue
            field = values[:, :, 2]
            k, q = divmod(int(np.argmax(field)), field.shape[1])
            if field[k, q] > best[0]:
                best = (float(field[k, q]), int(kernel.cells[k]), int(q))
        place = np.zeros(3)
        if best[1] >= 0:
            x = self.place_of(best[1], best[2])
            place[: len(x)] = x
        # A NaN on one rank must reach all ranks, but MPI's MIN may ignore it.
        low = np.where(np.isnan(low), -np.inf, low)
        winner: tuple[Any, ...] = low, best[0], place
        if self._mesh.comm.size > 1:
            everyone = self._mesh.comm.allgather(winner)
            low = np.min([e[0] for e in everyone], axis=0)
            winner = max(everyone, key=lambda e: (e[1], *e[2]))
        solid = float(low[2]) if self._has_solids else float(low[0])
        largest, relaxable = max(winner[1], 0.0), float(low[3])
        return Probe(float(low[0]), float(low[1]), largest, winner[2], solid, relaxable)

    def smallest_J(self, cells: np.ndarray) -> np.ndarray:
        """Smallest det F of each of some owned cells over its quadrature points."""
        found = np.full(len(cells), np.inf)
        for kernel, evaluate in self._evaluated:
            inside = np.isin(cells, kernel.cells)
            if inside.any():
                found[inside] = evaluate(self._mesh, cells[inside])[:, :, 0].min(axis=1)
        return found

    def place_of(self, cell: int, point: int) -> np.ndarray:
        """Undeformed position of a quadrature point of a local cell, dimensionless."""
        geometry = self._mesh.geometry
        return np.asarray(self._shapes[point] @ geometry.x[self._nodes[cell], : geometry.dim])


def _watched(at: MaterialPoint) -> list[Any]:
    """J, the chains' margin and the size of the field; of a film that wrinkles `relaxable`, too."""
    found = [at.J, at.chain_margin, ufl.sqrt(ufl.dot(at.true_field, at.true_field))]
    return found if at.relaxable is None else [*found, at.relaxable]
