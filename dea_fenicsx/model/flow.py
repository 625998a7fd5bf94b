"""The viscous branches of a problem whose flow is solved at each quadrature point.

Their stress, moduli, energy and dissipation in the present state are coefficients of the forms.
They are found anew whenever the problem goes to another state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.viscous import ViscousBranch
from dea_fenicsx.model.flowing_branches import FlowingBranches
from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.local_flow import LocalState, flowed, rates

MOST_STATES_KEPT = 3
"""Number of states whose flow is kept: Newton's method returns to the state that it left."""


@dataclass(frozen=True, eq=False)
class _Kept:
    """The flow in a state, with what it follows from."""

    span: float
    branches: tuple[ViscousBranch, ...]
    C: np.ndarray
    H: np.ndarray
    found: dict[tuple[int, str], LocalState]

    def is_for(
        self, span: float, branches: tuple[ViscousBranch, ...], C: np.ndarray, H: np.ndarray
    ) -> bool:
        """Whether it belongs to a state; a NaN is equal to nothing."""
        same = self.span == span and self.branches == branches
        return same and np.array_equal(self.C, C) and np.array_equal(self.H, H)


class Flow:
    """The branches of all kernels that have such.

    Parameters
    ----------
    kernels
        The kernels of the problem.

    Attributes
    ----------
    materials
        The present material of each region, from `update`.
    least_margin
        Smallest distance of a spring's chains to their lock-up on this rank.
    """

    materials: Mapping[str, Material]

    def __init__(self, kernels: Sequence[Kernel]) -> None:
        self._parts = [k.flowing for k in kernels if k.flowing is not None]
        self._kept: list[_Kept] = []
        self._shown: dict[tuple[int, str], LocalState] | None = None
        self.least_margin = np.inf

    def __bool__(self) -> bool:
        return bool(self._parts)

    def _branches(self) -> Iterator[tuple[FlowingBranches, int, str, ViscousBranch]]:
        """Each branch of each region, with its part and its number."""
        for part in self._parts:
            for region in part.cells:
                for place in part.places:
                    branch = self.materials[region].viscous[place]
                    assert isinstance(branch, ViscousBranch)
                    yield part, place, region, branch

    def update(
        self, span: float, C: np.ndarray, H: np.ndarray, materials: Mapping[str, Material]
    ) -> None:
        """Put the flow of a state into the coefficients of the forms.

        Parameters
        ----------
        span
            Length of the step of time that ends in the state, in s.
        C
            Cauchy-Green tensors, of shape (cells, points, 6).
        H
            The history of the step's rule, of shape (branches, cells, points, 6).
        materials
            The present materials.
        """
        self.materials = materials
        found = self._found(span, C, H)
        if found is self._shown:
            return
        self._shown = found
        per_cell = C.shape[1]
        for part in self._parts:
            for function in (part.stress, part.moduli, part.measures):
                function.x.array[:] = 0.0
        self.least_margin = np.inf
        for part, place, region, _ in self._branches():
            cells, local = part.cells[region], found[place, region]
            measures = np.stack([local.energy, local.power], axis=-1)
            for function, values in (
                (part.stress, local.stress), (part.moduli, local.moduli),
                (part.measures, measures),
            ):  # fmt: skip
                numbers = per_cell * math.prod(values.shape[1:])
                table = function.x.array.reshape(-1, numbers)
                table[cells] += values.reshape(len(cells), numbers)
            margin = np.where(np.isnan(local.margin), -np.inf, local.margin)
            self.least_margin = min(self.least_margin, float(np.min(margin, initial=np.inf)))

    def _found(
        self, span: float, C: np.ndarray, H: np.ndarray
    ) -> dict[tuple[int, str], LocalState]:
        """The flow of each branch of each region, as kept or anew."""
        branches = tuple(branch for _, _, _, branch in self._branches())
        for kept in self._kept:
            if kept.is_for(span, branches, C, H):
                return kept.found
        found = {
            (place, region): flowed(
                branch, span, C[part.cells[region]].reshape(-1, 6),
                H[place, part.cells[region]].reshape(-1, 6),
            )
            for part, place, region, branch in self._branches()
        }  # fmt: skip
        self._kept = [_Kept(span, branches, C, H, found), *self._kept][:MOST_STATES_KEPT]
        return found

    def put_strains(self, into: np.ndarray, span: float, C: np.ndarray, H: np.ndarray) -> None:
        """Put the viscous strains at the end of a step into an array laid out like `H`."""
        found = self._found(span, C, H)
        for part, place, region, _ in self._branches():
            cells = part.cells[region]
            into[place, cells] = found[place, region].strain.reshape(len(cells), C.shape[1], 6)

    def put_rates(
        self, into: np.ndarray, second: np.ndarray, C: np.ndarray, strains: np.ndarray
    ) -> None:
        """Put dC_v/dt in 1/s and its rate of change in 1/s^2 into arrays laid out like strains."""
        for part, place, region, branch in self._branches():
            cells = part.cells[region]
            if len(cells):
                first, rate = rates(
                    branch, C[cells].reshape(-1, 6), strains[place, cells].reshape(-1, 6)
                )
                shape = (len(cells), -1, 6)
                into[place, cells] = first.reshape(shape)
                second[place, cells] = (rate[:, None] * first).reshape(shape)

    def relaxation_times(self) -> list[tuple[float, float]]:
        """The shortest and the longest relaxation time of each branch in s."""
        return [branch.relaxation_times() for *_, branch in self._branches()]
