"""Unknowns by the role of their fields."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.unknowns import Unknowns

NORM_ROLE = {Role.GLOBAL: Role.MOTION}
"""Roles whose residuals are included in the norm of another role."""


class Roles:
    """Where the unknowns of each role are, and how many.

    Fields whose residuals are taken together make one group; global unknowns belong to the group of
    the motion.

    Parameters
    ----------
    space
        The unknowns.
    free
        Owned local degrees of freedom that are unknowns, sorted.
    comm
        The communicator.

    Attributes
    ----------
    groups
        The fields of each group, by the name of the first of them.
    counts
        Number of free unknowns of each group over all ranks.
    """

    def __init__(self, space: Unknowns, free: np.ndarray, comm: MPI.Comm) -> None:
        leaders = {field.role: field.name for field in reversed(space.fields)}
        self.groups: dict[str, list[Field]] = {}
        for field in space.fields:
            shared = NORM_ROLE.get(field.role)
            self.groups.setdefault(leaders[shared] if shared else field.name, []).append(field)
        self._owned = {}
        for name, fields in self.groups.items():
            dofs = np.concatenate([p.dofs for f in fields for p in space.parts[f.name].values()])
            self._owned[name] = np.sort(dofs[dofs < space.owned])
        self._free = {
            name: np.searchsorted(free, np.intersect1d(dofs, free))
            for name, dofs in self._owned.items()
        }
        self.counts: dict[str, int] = {
            name: comm.allreduce(len(places), op=MPI.SUM) for name, places in self._free.items()
        }

    def _names(self, role: Role) -> list[str]:
        return [name for name, fields in self.groups.items() if fields[0].role is role]

    def owned(self, role: Role) -> np.ndarray:
        """Owned degrees of freedom of a role, sorted."""
        return _joined([self._owned[name] for name in self._names(role)])

    def free(self, role: Role) -> np.ndarray:
        """Places of a role's unknowns among the free ones of this rank, sorted."""
        return _joined([self._free[name] for name in self._names(role)])

    def count(self, role: Role) -> int:
        """Number of a role's free unknowns over all ranks."""
        return sum(self.counts[name] for name in self._names(role))

    def of_group(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Owned degrees of freedom of a group, and its places among the free ones."""
        return self._owned[name], self._free[name]

    def by_reactions(self) -> list[np.ndarray]:
        """Places among the free unknowns of each field that is compared with its reactions."""
        groups = self.groups.items()
        return [self._free[name] for name, fields in groups if fields[0].by_reactions]

    @property
    def has(self) -> set[Role]:
        """Roles of the groups."""
        return {fields[0].role for fields in self.groups.values()}

    @property
    def expected_negative_pivots(self) -> int:
        """Number of negative eigenvalues of the tangent on a stable path.

        Each unknown pressure and each unknown potential causes one.
        """
        groups = self.groups.items()
        return sum(self.counts[name] for name, fields in groups if fields[0].negative)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    if len(parts) == 1:
        return parts[0]
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *parts]))
