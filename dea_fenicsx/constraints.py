"""Supports, prescribed displacements and electrodes as fixed degrees of freedom.

Boundaries are found by their names alone.  A comparison of coordinates can come out differently
on two ranks that share a node.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx import compat
from dea_fenicsx.compat import dolfinx
from dea_fenicsx.conditions import (
    AxialStretch,
    ChargedElectrode,
    Clamp,
    Displacement,
    Electrode,
    Fix,
    FreeBody,
    PreStretch,
    Stretch,
    Twist,
)
from dea_fenicsx.errors import InputError
from dea_fenicsx.mesh import Device
from dea_fenicsx.potentials import driven_alike, given_volts, profile
from dea_fenicsx.scene import Scene


@dataclass(frozen=True)
class Component:
    """A scalar part of the mixed space: a displacement component, the pressure, the potential.

    Attributes
    ----------
    space
        The component's scalar space, standing alone.
    dofs
        Local number in the mixed space of each local degree of freedom of `space`.
    """

    space: Any
    dofs: np.ndarray

    @classmethod
    def of(cls, sub: Any) -> Component:
        return cls(*compat.collapse(sub))

    def on(self, dim: int, entities: np.ndarray) -> np.ndarray:
        """Local degrees of freedom of `space` on the closure of mesh entities.  Collective."""
        return np.asarray(dolfinx.fem.locate_dofs_topological(self.space, dim, entities))


class Constraints:
    """Which degrees of freedom are fixed, and at what value for given ramp factors.

    Parameters
    ----------
    size
        Number of local degrees of freedom of the mixed space, ghosts included.

    Attributes
    ----------
    fixed
        Mask of the fixed degrees of freedom.
    base
        For each ramp the values at ramp factor 1, dimensionless.
    """

    def __init__(self, size: int) -> None:
        self.fixed = np.zeros(size, dtype=bool)
        self.base: dict[str, np.ndarray] = {}

    def fix(self, dofs: np.ndarray, values: Any = 0.0, ramp: str | None = None) -> None:
        """Fix `dofs` at `values` times the factor of `ramp`; a later call overrides an earlier."""
        self.fixed[dofs] = True
        for base in self.base.values():
            base[dofs] = 0.0
        if ramp is not None:
            base = self.base.setdefault(ramp, np.zeros(len(self.fixed)))
            base[dofs] = values

    def values(self, factors: dict[str, float]) -> np.ndarray:
        """Value of every fixed degree of freedom (0 at the free ones)."""
        total = np.zeros(len(self.fixed))
        for ramp, base in self.base.items():
            total += factors[ramp] * base
        return total


def apply_supports(scene: Scene, parts: list[Component], constraints: Constraints) -> None:
    """Fix the displacement components that the scene's supports and stretches name.

    Prescribed displacements come first, so that a support wins where both meet.
    """
    device, axes = scene.device, scene.kinematics.axes
    fdim = device.dim - 1
    for item in [*scene.prescribed, *scene.supports]:
        if isinstance(item, FreeBody):
            if device.dim == 3:
                _hold_rigid_motions(device, parts, constraints)
            else:
                _hold_screw_motions(device, parts, constraints)
            continue
        if isinstance(item, AxialStretch | PreStretch | Twist):
            continue
        named = axes if isinstance(item, Clamp) else item.axes
        facets = device.facets_of(item.where)
        for axis in named:
            a = axes.index(axis)
            local = parts[a].on(fdim, facets)
            dofs = parts[a].dofs[local]
            if isinstance(item, Stretch):
                along = scene.kinematics.coordinates.index(axis)
                X = parts[a].space.tabulate_dof_coordinates()[local, along]
                constraints.fix(dofs, (item.stretch - 1) * X, item.ramp)
            elif isinstance(item, Displacement):
                constraints.fix(dofs, item.metres / device.length, item.ramp)
            elif isinstance(item, Fix | Clamp):
                constraints.fix(dofs)


def apply_overall(
    scene: Scene, parts: dict[str, Component], constraints: Constraints
) -> None:
    """Fix the overall unknowns that the scene prescribes: elongation, and twist in 1/length."""
    for item in scene.prescribed:
        if isinstance(item, AxialStretch):
            constraints.fix(parts["elongation"].dofs, item.stretch - 1, item.ramp)
        elif isinstance(item, Twist):
            turn = item.radians_per_metre * scene.device.length
            constraints.fix(parts["twist"].dofs, turn, item.ramp)


def apply_electrodes(
    scene: Scene, potential: Component, volt: float, constraints: Constraints
) -> dict[str, np.ndarray]:
    """Fix the potential on electrodes and wherever no field lives.

    Parameters
    ----------
    scene, potential, constraints
        The scene, its potential, and what is to be filled.
    volt
        The unit of potential in V.

    Returns
    -------
    dict
        For each electrode's label its degrees of freedom in the mixed space.

    Raises
    ------
    InputError
        If electrodes of different potentials touch.
    """
    device = scene.device
    dielectric = [device.cells_of(n) for n, m in scene.materials.items() if m.is_dielectric]
    alive = np.zeros(len(potential.dofs), dtype=bool)
    alive[potential.on(device.dim, np.concatenate(dielectric))] = True
    constraints.fix(potential.dofs[~alive])

    owner = np.full(len(potential.dofs), -1)
    values = np.zeros(len(potential.dofs))
    X = potential.space.tabulate_dof_coordinates() * device.length
    found: dict[str, np.ndarray] = {}
    for k, electrode in enumerate(scene.electrodes):
        on = np.zeros(len(potential.dofs), dtype=bool)
        for name in electrode.names:
            if name in device.regions:
                on[potential.on(device.dim, device.cells_of(name))] = True
            else:
                on[potential.on(device.dim - 1, device.facets_of(name))] = True
        mine = potential_at(scene, electrode, X)
        for j in range(k):
            other = scene.electrodes[j]
            shared = on & (owner == j)
            small = 1e-9 * max(abs(given_volts(electrode)), abs(given_volts(other)))
            touch = not _agree(electrode, other, mine[shared], values[shared], small)
            if device.comm.allreduce(touch, op=MPI.LOR):
                raise InputError(
                    f"Electrodes {other.label!r} and {electrode.label!r} touch, but have different "
                    "potentials; leave dielectric between them."
                )
        owner[on] = k
        values[on] = mine[on]
        dofs = potential.dofs[on]
        if isinstance(electrode, ChargedElectrode):
            constraints.fixed[dofs] = False
        else:
            ramp = electrode.ramp if electrode.volts else None
            constraints.fix(dofs, mine[on] / volt, ramp)
        found[electrode.label] = dofs
    return found


def _agree(
    a: Electrode | ChargedElectrode, b: Electrode | ChargedElectrode,
    here: np.ndarray, there: np.ndarray, small: float,
) -> bool:  # fmt: skip
    """Whether two electrodes give the nodes that they share the same potential at all times.

    They do where both give 0, whatever drives them.
    """
    if len(here) == 0:
        return True
    if isinstance(a, ChargedElectrode) or isinstance(b, ChargedElectrode):
        return False
    if not driven_alike(a, b) and np.max(np.abs([here, there])) > small:
        return False
    return bool(np.max(np.abs(here - there)) <= small)


def potential_at(
    scene: Scene, electrode: Electrode | ChargedElectrode, X: np.ndarray
) -> np.ndarray:
    """Given potential in V at undeformed positions X in m, shape (n, 3); 0 where it floats."""
    return given_volts(electrode) * profile(scene.kinematics, electrode, X)


def _hold_rigid_motions(device: Device, parts: list[Component], constraints: Constraints) -> None:
    """Fix six displacement components at three vertices, so that only rigid motions are removed.

    Where the mesh allows, b lies far from a along one axis and c along another, b is held across
    the first and c across both: so a strain along the axes turns nothing.  Held across an oblique
    line, a slender actuator of 20 turns that shortens by 2.3 % leans by 2.2 degrees, and at 13 %
    one of 14 turns by 3.5 degrees, which its height then feels.
    """
    X = _corners(device)
    na, a = _best_corner(device, -X.sum(axis=1))
    to = X - a
    cosines = np.abs(to) / np.maximum(np.linalg.norm(to, axis=1), 1e-300)[:, None]
    nb, b = _best_corner(device, np.linalg.norm(to, axis=1) * np.max(cosines, axis=1) ** 8)
    line = (b - a) / np.linalg.norm(b - a)
    k = int(np.argmax(np.abs(line)))
    across = np.max(np.delete(cosines, k, axis=1), axis=1) ** 8
    nc, c = _best_corner(device, np.linalg.norm(np.cross(to, line), axis=1) * across)
    m = int(np.argmax(np.where(np.arange(3) == k, -1.0, np.abs(c - a))))

    def row(point: np.ndarray, axis: int) -> np.ndarray:
        """How a displacement component depends on rigid translation and rotation about a."""
        e = np.eye(3)[axis]
        return np.concatenate([e, np.cross(point - a, e)])

    def quality(choice: tuple[tuple[int, int], int]) -> float:
        (b1, b2), c1 = choice
        rows = [row(a, i) for i in range(3)] + [row(b, b1), row(b, b2), row(c, c1)]
        return float(np.linalg.svd(np.array(rows), compute_uv=False)[-1])

    best = max(itertools.product(itertools.combinations(range(3), 2), range(3)), key=quality)
    aligned = (((k + 1) % 3, (k + 2) % 3), 3 - k - m)
    on_b, on_c = aligned if quality(aligned) > 0.2 * quality(best) else best
    held = [(na, axis) for axis in range(3)] + [(nb, axis) for axis in on_b] + [(nc, on_c)]
    for node, axis in held:
        vertices = _vertices_of_node(device.mesh, node)
        constraints.fix(parts[axis].dofs[parts[axis].on(0, vertices)])


def _hold_screw_motions(device: Device, parts: list[Component], constraints: Constraints) -> None:
    """Fix hoop and axial displacement of a helical cell at one vertex, the lowest along (1, 1)."""
    node, _ = _best_corner(device, -_corners(device).sum(axis=1))
    vertices = _vertices_of_node(device.mesh, node)
    for part in parts[1:]:
        constraints.fix(part.dofs[part.on(0, vertices)])


def _corners(device: Device) -> np.ndarray:
    """Coordinates of the corners of all local cells."""
    return device.mesh.geometry.x[np.unique(_vertex_nodes(device.mesh)[0])]


def _best_corner(device: Device, score: np.ndarray) -> tuple[int, np.ndarray]:
    """Number in the mesh file and coordinates of the corner with the highest score on any rank.

    `score` has an entry for each of `_corners`; the number makes all ranks agree where two tie.
    """
    corners = np.unique(_vertex_nodes(device.mesh)[0])
    mine = None
    if len(corners):
        ids = np.asarray([device.mesh.geometry.input_global_indices[n] for n in corners])
        k = np.lexsort((ids, -score))[0]
        mine = (float(score[k]), -int(ids[k]), _corners(device)[k])
    _, n, point = max((m for m in device.comm.allgather(mine) if m), key=lambda m: m[:2])
    return -n, point


def _vertex_nodes(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Geometry node and topological vertex of every corner of every local cell."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, 0)
    cells = mesh.topology.connectivity(tdim, 0)
    count = len(cells.links(0)) if cells.num_nodes else 0
    vertices = cells.array.reshape(-1, count) if count else np.empty((0, 0), dtype=np.int32)
    return compat.geometry_dofmap(mesh)[:, :count], vertices


def _vertices_of_node(mesh: Any, node: int) -> np.ndarray:
    """Local vertices (none or one) at the geometry node with a given number in the mesh file."""
    mesh.topology.create_connectivity(0, mesh.topology.dim)
    nodes, vertices = _vertex_nodes(mesh)
    number = np.asarray(mesh.geometry.input_global_indices)
    return np.unique(vertices[number[nodes] == node]).astype(np.int32)
