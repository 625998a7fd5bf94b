"""Short circuits: bare electrodes meet where the air between them closes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from dea_fenicsx.materials import Air
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_motions import joined_parts

LARGEST_CLOSED_VOLUME_RATIO = 0.01
"""A gap counts as closed if its air has this share of its undeformed volume, or less."""

CLOSED_BY_STIFFNESS = 3.0
"""The same share over the cube root of the stiffness of the air; the larger of the two counts."""

SAME_POTENTIAL = 1e-9
"""Potentials that differ by less than this share of the largest one are the same."""


def short_circuit(problem: Problem) -> str | None:
    """What is wrong if two electrodes of different potentials touch, else None.  Collective.

    They touch where cells of closed air lead from one to the other.
    """
    part = problem.potential
    if part is None or not problem.scene.solids or len(problem.conditions.electrode_dofs) < 2:
        return None
    device = problem.scene.device
    closed = _closed(problem)
    if not device.comm.allreduce(bool(closed.any()), op=MPI.LOR):
        return None
    labels, _ = joined_parts(device, closed)
    touched = _touched(problem, closed, labels)
    spans = _spans(problem)
    most = max((float(np.max(np.abs(span))) for span in spans.values()), default=0.0)
    names = list(touched)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            apart = float(np.max(np.abs(np.subtract(spans[one], spans[other]))))
            if touched[one] & touched[other] and apart > SAME_POTENTIAL * most:
                return (
                    f"electrodes {one!r} and {other!r} of different potentials touch, since the "
                    "air between them has closed, which is a short circuit (leave a solid "
                    "dielectric between them)"
                )
    return None


def _closed(problem: Problem) -> np.ndarray:
    """Mask of this rank's cells of closed air, without ghosts."""
    device, prober = problem.scene.device, problem.forms.prober
    imap = device.mesh.topology.index_map(device.dim)
    found = np.zeros(imap.size_local + imap.num_ghosts, dtype=bool)
    for name, material in problem.scene.materials.items():
        if isinstance(material, Air):
            by_stiffness = CLOSED_BY_STIFFNESS * material.stiffness ** (1 / 3)
            limit = max(LARGEST_CLOSED_VOLUME_RATIO, by_stiffness)
            cells = device.cells_of(name)
            cells = cells[cells < imap.size_local]
            found[cells] = prober.smallest_J(cells) < limit
    return found


def _touched(problem: Problem, closed: np.ndarray, labels: np.ndarray) -> dict[str, set[int]]:
    """For each electrode the parts of closed air that have one of its nodes.  Collective."""
    part = problem.potential
    assert part is not None
    table = part.dofs[part.space.dofmap.list[: len(closed)][closed]]
    found = {}
    for label, dofs in problem.conditions.electrode_dofs.items():
        on = np.isin(table, dofs).any(axis=1)
        mine = set(np.unique(labels[closed][on]).tolist())
        found[label] = set().union(*problem.comm.allgather(mine))
    return found


def _spans(problem: Problem) -> Mapping[str, tuple[float, float]]:
    """Smallest and largest potential of each electrode, dimensionless.  Collective."""
    found = {}
    for label, dofs in problem.conditions.electrode_dofs.items():
        here = problem.w.x.array[dofs]
        low = problem.comm.allreduce(float(np.min(here, initial=np.inf)), op=MPI.MIN)
        high = problem.comm.allreduce(float(np.max(here, initial=-np.inf)), op=MPI.MAX)
        found[label] = (low, high)
    return found
