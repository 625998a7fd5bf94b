"""Degrees of freedom that share a value: charged electrodes, periodic ends, global unknowns.

Ties are found by names, and by numbers that are the same on all ranks.  Only the nodes of periodic
ends are matched by their positions, which the rank that owns a node provides.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fixed_values import FixedValues
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.condition import Condition
from dea_fenicsx.scene.declarations import FloatingPotential, GlobalForce, GlobalUnknown
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True)
class Rows:
    """The degrees of freedom of the mixed space that this rank owns: their count and first number.

    Numbers count over all ranks, as PETSc's do.
    """

    owned: int
    start: int
    comm: MPI.Comm

    def fetch(self, values: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Values of owned degrees of freedom, by numbers that are the same on all ranks."""
        found = np.zeros(len(numbers), dtype=values.dtype)
        here, local = self.mine(numbers)
        found[here] = values[local]
        self.comm.Allreduce(MPI.IN_PLACE, found, MPI.LOR if found.dtype == bool else MPI.SUM)
        return found

    def mine(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of the numbers this rank owns, and where they lie on it."""
        here = (numbers >= self.start) & (numbers < self.start + self.owned)
        return here, numbers[here] - self.start


@dataclass(frozen=True)
class TiedGroup:
    """Degrees of freedom that all have the value of their master, and the sources that act on them.

    Attributes
    ----------
    dofs
        Owned local degrees of freedom in the mixed space, without the master.
    master
        Local number of the master on the rank that owns it, -1 on the others.
    sources
        Ramps, each with what it adds to the residual of the whole group at factor 1: a charge, or
        minus a generalised force.  Dimensionless.
    electric
        Whether the sources are charges.
    """

    dofs: np.ndarray
    master: int
    sources: tuple[tuple[str, float], ...]
    electric: bool = False

    @classmethod
    def of(
        cls, dofs: np.ndarray, rows: Rows, sources: tuple[tuple[str, float], ...],
        electric: bool = False,
    ) -> TiedGroup:  # fmt: skip
        """Gather a group; the lowest global number is the master."""
        mine = np.sort(dofs[dofs < rows.owned])
        lowest = int(mine[0]) + rows.start if len(mine) else np.iinfo(np.int64).max
        first = rows.comm.allreduce(lowest, op=MPI.MIN)
        here = len(mine) > 0 and lowest == first
        return cls(
            dofs=mine[1:] if here else mine,
            master=int(mine[0]) if here else -1,
            sources=sources,
            electric=electric,
        )


def floating_groups(
    declared: Iterable[tuple[Conducting, FloatingPotential]], charge: float,
    electrode_dofs: Mapping[str, np.ndarray], rows: Rows,
) -> list[TiedGroup]:  # fmt: skip
    """One group for each electrode whose potential floats, with its charge.  Collective.

    Parameters
    ----------
    declared
        The electrodes whose potential floats, each with its declaration.
    charge
        The unit of charge in C.
    electrode_dofs
        Degrees of freedom of each electrode, by its label.
    rows
        The degrees of freedom that this rank owns.
    """
    return [
        TiedGroup.of(
            electrode_dofs[e.label], rows,
            () if told.feed else ((told.ramp, told.coulombs / charge),), electric=True,
        )
        for e, told in declared
    ]


def global_groups(
    unknowns: Sequence[GlobalUnknown], forces: Sequence[tuple[Condition, GlobalForce]],
    period: float, scales: Scales, parts: Mapping[str, Component], fixed: np.ndarray, rows: Rows,
) -> list[TiedGroup]:  # fmt: skip
    """One group for each global unknown that is not fixed, with what works on it.  Collective.

    Parameters
    ----------
    unknowns
        The global unknowns.
    forces
        The forces on them, each with its condition.
    period
        Length in m along the global elongation.
    scales
        The units.
    parts
        The global unknowns by name.
    fixed
        Mask of the fixed local degrees of freedom.
    rows
        The degrees of freedom that this rank owns.
    """
    found = []
    for unknown in unknowns:
        part = parts[unknown.name]
        # A rank without cells has none of these degrees of freedom, but must join the reduction.
        if rows.comm.allreduce(bool(np.all(fixed[part.dofs])), op=MPI.LAND):
            continue
        height = period / scales.length
        unit = scales.length**unknown.per_length
        sources = [
            (told.ramp, -told.amount / scales.force / unit * height)
            for _, told in forces if told.unknown == unknown
        ]  # fmt: skip
        found.append(TiedGroup.of(part.dofs, rows, tuple(sources)))
    return found


@dataclass(frozen=True)
class Pairs:
    """Pairs of degrees of freedom with equal values, by number, the same on all ranks.

    `ends` are the names of the two facet groups, `counts` the pairs of each component.
    """

    slaves: np.ndarray
    masters: np.ndarray
    rows: Rows
    ends: tuple[str, str]
    counts: tuple[int, ...]

    @classmethod
    def between(
        cls, device: Device, ends: tuple[str, str], parts: list[Component], rows: Rows
    ) -> Pairs:
        """Match the nodes of two facet groups by their first coordinate, for each component.

        Raises
        ------
        InputError
            If the nodes of the two groups do not lie at the same places.
        """
        slaves, masters = [], []
        for part in parts:
            x = part.space.tabulate_dof_coordinates()
            lines = []
            for name in ends:
                local = part.on(device.dim - 1, device.facets_by_surface[name])
                local = local[part.dofs[local] < rows.owned]
                mine = (x[local, 0], part.dofs[local].astype(np.int64) + rows.start)
                everyone = rows.comm.allgather(mine)
                place = np.concatenate([e[0] for e in everyone])
                number = np.concatenate([e[1] for e in everyone])
                order = np.argsort(place)
                lines.append((place[order], number[order]))
            (low, bottom), (high, top) = lines
            if len(low) != len(high) or np.max(np.abs(low - high), initial=0.0) > 1e-6:
                raise InputError(
                    f"The nodes of {ends[0]!r} and {ends[1]!r} do not lie at the same radii, so "
                    "the cell cannot be periodic; mesh both ends alike."
                )
            masters.append(bottom)
            slaves.append(top)
        counts = tuple(len(numbers) for numbers in slaves)
        return cls(np.concatenate(slaves), np.concatenate(masters), rows, ends, counts)

    def widen(self, dofs: np.ndarray) -> np.ndarray:
        """Some local degrees of freedom and the owned partners of those that are owned, sorted."""
        member = np.zeros(self.rows.owned, dtype=bool)
        member[dofs[dofs < self.rows.owned]] = True
        return np.union1d(dofs, np.flatnonzero(self.join(member)))

    def join(self, member: np.ndarray) -> np.ndarray:
        """A mask over owned degrees of freedom, widened to the partners of its members."""
        both = [self.rows.fetch(member, n) for n in (self.slaves, self.masters)]
        wide = member.copy()
        for numbers in (self.slaves, self.masters):
            here, local = self.rows.mine(numbers)
            wide[local] = (both[0] | both[1])[here]
        return wide

    def share_fixed(self, constraints: FixedValues, space: Any) -> None:
        """Fix the partner of every fixed degree of freedom, at the same value.

        Parameters
        ----------
        constraints
            What is fixed.
        space
            The mixed function space.

        Raises
        ------
        InputError
            If both are fixed at different values.
        """
        rows, sides = self.rows, (self.slaves, self.masters)
        fixed = [rows.fetch(constraints.fixed[: rows.owned], n) for n in sides]
        carry = dolfinx.fem.Function(space)
        for base in constraints.base.values():
            values = [rows.fetch(base[: rows.owned], n) for n in sides]
            apart = fixed[0] & fixed[1] & (np.abs(values[0] - values[1]) > 1e-9)
            if np.any(apart):
                k = np.searchsorted(np.cumsum(self.counts), np.argmax(apart), side="right")
                along = f" along {'rtz'[k]}" if k < 3 else ""
                raise InputError(
                    f"The ends {self.ends[0]!r} and {self.ends[1]!r} of the helical cell are held "
                    f"at different values{along}, but they are the same place one period apart; "
                    "give them the same condition."
                )
            common = np.where(fixed[0], values[0], values[1])
            _set(base, common, sides, rows, carry)
        _set(constraints.fixed, fixed[0] | fixed[1], sides, rows, carry)


def _set(
    target: np.ndarray, values: np.ndarray, sides: tuple, rows: Rows, carry: dolfinx.fem.Function
) -> None:
    """Set values by number in an array over local degrees of freedom, ghosts included."""
    carry.x.array[:] = target
    for numbers in sides:
        here, local = rows.mine(numbers)
        carry.x.array[local] = values[here]
    carry.x.scatter_forward()
    target[:] = carry.x.array.astype(target.dtype)


def followers(groups: list[TiedGroup], pairs: Pairs | None, fixed: np.ndarray) -> np.ndarray:
    """Mask of the owned degrees of freedom that follow another; `fixed` masks the fixed ones."""
    found = np.zeros(len(fixed), dtype=bool)
    for group in groups:
        found[group.dofs] = True
    if pairs is not None:
        grouped = found.copy()
        grouped[[g.master for g in groups if g.master >= 0]] = True
        _, local = pairs.rows.mine(pairs.slaves)
        found[local[~grouped[local] & ~fixed[local]]] = True
    return found


def columns(
    free: np.ndarray, groups: list[TiedGroup], pairs: Pairs | None, rows: Rows
) -> np.ndarray:
    """Number over all ranks of the free unknown that each owned one follows; -1 for fixed ones."""
    offset = rows.comm.exscan(len(free)) or 0
    column = np.full(rows.owned, -1, dtype=np.int64)
    column[free] = offset + np.arange(len(free))
    for group in groups:
        mine = int(column[group.master]) if group.master >= 0 else -1
        column[group.dofs] = rows.comm.allreduce(mine, op=MPI.MAX)
    if pairs is not None:
        theirs = rows.fetch(column, pairs.masters)
        here, local = rows.mine(pairs.slaves)
        open_ = column[local] < 0
        column[local[open_]] = theirs[here][open_]
    return column


def expansion(column: np.ndarray, free: int, rows: Rows, room: int = 2) -> PETSc.Mat:
    """Matrix from the free unknowns to all owned degrees of freedom; rows of fixed ones are 0.

    It is not assembled yet, and has room for `room` numbers in each row.  Collective.

    Parameters
    ----------
    column
        Number of the free unknown that each owned one follows, from `columns`.
    free
        Number of free unknowns of this rank.
    rows
        The degrees of freedom that this rank owns.
    room
        Most numbers in a row.
    """
    sizes = ((rows.owned, None), (free, None))
    P = PETSc.Mat().createAIJ(sizes, nnz=(room, room), comm=rows.comm)
    first = P.getOwnershipRange()[0]
    for row in np.flatnonzero(column >= 0):
        P.setValue(first + int(row), int(column[row]), 1.0)
    return P
