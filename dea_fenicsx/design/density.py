"""A density on a film: where a stiffener or an electrode lies, cell by cell.

A variable x_k between 0 and 1 belongs to each place k on the film, which is a cell or a column of
cells.  The density is what a disc of the radius r around each filled place covers, in a smooth form
(Guest, Prevost and Belytschko, Int. J. Numer. Methods Eng. 61 (2004) 238):

    m_e = sum_k w_ek x_k / sum_k w_ek,     w_ek = A_k max(0, 1 - |X_e - X_k|/r),
    rho_e = 1 - exp(-b m_e) + m_e exp(-b),

with the sizes A_k of the places and the sharpness b.  For large b the density is 1 within r of each
place with x_k > 0, and 0 elsewhere.  So what is filled is nowhere narrower than 2 r.  A constant q
of a material then is

    q_e = q (low + (high - low) rho_e^p).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI
from scipy import sparse
from scipy.spatial import cKDTree

from dea_fenicsx.gradients.variables import ConstantChange
from dea_fenicsx.mesh.cell_middles import middles
from dea_fenicsx.scene.graded import Graded
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known, positive

SAME_PLACE = 1e-6
"""Distance, relative to the size of the regions, within which cells lie above one another."""

BISECTIONS = 50
"""Halvings of an interval of length 1, down to rounding."""


@dataclass(frozen=True)
@in_si(length="m")
class Density:
    """What a density stands for, and how it may vary.

    Parameters
    ----------
    where
        Name of a region, or several names.
    constants
        Factors on constants where nothing is filled and where all is: an electrode on a film that
        lies between two surfaces is ``{"electric.eps_r": (1e-4, 1.0)}``, a stiffener in a layer
        that is twenty times as stiff ``{"elastic.mu": (1.0, 20.0)}``.
    length
        Least width of what is filled, in m.
    axes
        The coordinates along which it varies, such as ``"xy"`` on a film in space; all by default.
        Cells that differ along others only are filled alike.
    penalty
        The exponent p, at least 1.  With a larger one half-filled places pay less.
    start
        The density of the first design, from 0 to 1, the same everywhere.
    sharpness
        The sharpness b in searches one after another; each begins where the one before has ended.
    """

    where: str | tuple[str, ...]
    constants: Mapping[str, tuple[float, float]]
    length: float
    axes: str = ""
    penalty: float = 1.0
    start: float = 0.5
    sharpness: tuple[float, ...] = (1.0, 4.0, 16.0, 64.0)

    @property
    def names(self) -> tuple[str, ...]:
        """The regions."""
        return (self.where,) if isinstance(self.where, str) else tuple(self.where)

    def check(self, scene: Scene) -> None:
        """Raise InputError unless it makes sense in a scene."""
        check_declared(self)
        for name in self.names:
            known(name, scene.device.regions, "region")
        positive(self.length, "The length of a Density", "a length > 0 in m")
        if not self.names or not self.constants:
            raise InputError("A Density names no region or no constant; give it at least one each.")
        if not 1 <= self.penalty <= 10:
            raise InputError(f"The penalty of a Density is {self.penalty:g}, but must be 1 to 10.")
        finite(self.start, "The start of a Density")
        if not 0 <= self.start <= 1:
            raise InputError(f"The start of a Density is {self.start:g}, but must be 0 to 1.")
        for sharpness in self.sharpness or (0.0,):
            positive(sharpness, "The sharpness of a Density", "one or more numbers > 0")
        for name, pair in self.constants.items():
            if min(pair) <= 0 or pair[0] == pair[1] or not np.isfinite(pair).all():
                raise InputError(
                    f"The factors of {name!r} in a Density are {pair}, but must be two different "
                    "numbers above 0: those where nothing and where all is filled."
                )
        axes = scene.kinematics.coordinates
        if any(axis not in axes for axis in self.axes):
            raise InputError(
                f"A Density varies along {self.axes!r}, but must do so along some of "
                f"{', '.join(axes)}."
            )


class Layout:
    """The places of a density in a scene, and what follows from its variables.  Collective.

    Parameters
    ----------
    density
        The density.
    scene
        The scene.

    Attributes
    ----------
    places
        Positions in m along the axes of the density, in the order of the variables.
    share
        Share of each place in the volume of the regions.
    """

    def __init__(self, density: Density, scene: Scene) -> None:
        density.check(scene)
        self.density, device = density, scene.device
        self._full = {
            (region, name): (high - low) * _value(scene, region, name)
            for name, (low, high) in density.constants.items() for region in density.names
        }  # fmt: skip
        names = scene.kinematics.coordinates
        self._columns = [names.index(axis) for axis in (density.axes or names)]
        cells = np.concatenate([device.cells_of(name) for name in density.names])
        cells = np.sort(cells[cells < device.owned_cells()])
        at, sizes = middles(device, cells), _sizes(scene)[cells]
        mine = at[:, self._columns]
        ends = np.max(np.hstack([mine, -mine]), axis=0, initial=-np.inf)
        device.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        extent = float(np.max(ends.reshape(2, -1).sum(axis=0)))
        apart = SAME_PLACE * (extent or 1.0)
        # The places are known on all ranks, as the variables are; a rank gives each place once.
        parts = device.comm.allgather(_merged(mine, sizes, apart))
        at, sizes = (np.concatenate([part[k] for part in parts]) for k in range(2))
        self.places, volumes = _merged(at, sizes, apart)
        self.share = volumes / volumes.sum()
        self._tree = cKDTree(self.places)
        self._filter = self._weights()
        self._known: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def names(self) -> list[str]:
        """The names of the variables."""
        return [f"place_{k}" for k in range(len(self.places))]

    def _weights(self) -> Any:
        """The matrix of w_ek, with rows that add up to 1."""
        radius = self.density.length / 2
        distances = self._tree.sparse_distance_matrix(
            self._tree, radius, output_type="coo_matrix"
        )
        row, column = distances.coords
        if len(row) <= len(self.places) and len(self.places) > 1:
            raise InputError(
                f"The length {self.density.length:g} m of a Density is at most the distance of two "
                "cells, so that no width is held; give a larger one, or a finer mesh."
            )
        weights = self.share[column] * (1 - distances.data / radius)
        matrix = sparse.csr_matrix((weights, (row, column)), shape=2 * (len(self.places),))
        sums = np.asarray(matrix.sum(axis=1)).ravel()
        return sparse.diags(1 / sums) @ matrix

    def filled(self, x: np.ndarray, sharpness: float) -> np.ndarray:
        """The density in each place."""
        return _sharpened(self._filter @ x, sharpness)

    def first(self, sharpness: float) -> np.ndarray:
        """The variables of the first design."""
        return _blunted(np.full(len(self.places), float(self.density.start)), sharpness)

    def resharpened(self, x: np.ndarray, old: float, new: float) -> np.ndarray:
        """Variables with which a sharper density is about as it was.

        With the same variables it would be larger, and where it comes near to 1 its derivatives
        vanish.
        """
        return _blunted(_sharpened(x, old), new)

    def slopes(self, x: np.ndarray, sharpness: float) -> Any:
        """Its derivatives by the variables, a sparse matrix."""
        m = self._filter @ x
        return sparse.diags(sharpness * np.exp(-sharpness * m) + np.exp(-sharpness)) @ self._filter

    def supports(self, rho: np.ndarray) -> list[Graded]:
        """What a scene with a density in each place has beside its other supports."""
        p, found = self.density.penalty, []
        for name, (low, high) in self.density.constants.items():
            factor = low + (high - low) * rho**p
            found.append(Graded(self.density.where, name, _Looked(self, factor)))
        return found

    def changes(self, x: np.ndarray, sharpness: float) -> list[ConstantChange]:
        """The variables of `Run.sensitivity` that belong to those of the density."""
        p, rho = self.density.penalty, self.filled(x, sharpness)
        by_x = (sparse.diags(p * rho ** (p - 1)) @ self.slopes(x, sharpness)).tocsc()
        found = []
        for k, variable in enumerate(self.names):
            column = by_x[:, [k]].toarray().ravel()
            found.append(ConstantChange(variable, {
                f"{region}.{name}": _Looked(self, value * column)
                for (region, name), value in self._full.items()
            }))  # fmt: skip
        return found

    def of(self, X: np.ndarray) -> np.ndarray:
        """The number of the place in which each position lies."""
        if self._known is None or not np.array_equal(self._known[0], X):
            found = self._tree.query(X[:, self._columns])[1] if len(X) else np.zeros(0, dtype=int)
            self._known = X.copy(), np.asarray(found)
        return self._known[1]


def _merged(
    at: np.ndarray, sizes: np.ndarray, apart: float
) -> tuple[np.ndarray, np.ndarray]:
    """Places in order, each once, and the sum of the sizes at each.

    Parameters
    ----------
    at, sizes
        Positions, shape (n, axes), and a size at each, shape (n,).
    apart
        Distance within which positions are one place.
    """
    grid = np.round(at / apart).astype(np.int64)
    _, first, of = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return at[first], np.bincount(of.ravel(), weights=sizes, minlength=len(first))


def _sharpened(m: np.ndarray, sharpness: float) -> np.ndarray:
    """1 - exp(-b m) + m exp(-b)"""
    return np.asarray(1 - np.exp(-sharpness * m) + m * np.exp(-sharpness))


def _blunted(rho: np.ndarray, sharpness: float) -> np.ndarray:
    """m in [0, 1] with a density of `_sharpened`, which grows with m, by bisection."""
    low, high = np.zeros_like(rho), np.ones_like(rho)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        below = _sharpened(middle, sharpness) < rho
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(rho >= 1, 1.0, low)


@dataclass(frozen=True, eq=False)
class _Looked:
    """A function of the position with one value in each place."""

    layout: Layout
    values: np.ndarray

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return np.asarray(self.values[self.layout.of(X)])


def _value(scene: Scene, region: str, name: str) -> float:
    """A constant of a region's material, in SI units."""
    owner: Any = scene.materials[region]
    for part in name.split("."):
        if not hasattr(owner, part):
            raise InputError(
                f"The material of {region!r} has no constant {name!r} that a Density can change; "
                "such names are 'elastic.mu' and 'electric.eps_r'."
            )
        owner = getattr(owner, part)
    return float(owner)


def _sizes(scene: Scene) -> np.ndarray:
    """The undeformed volume of each local cell, in units that do not matter.  Collective."""
    mesh = scene.device.mesh
    test = ufl.TestFunction(dolfinx.fem.functionspace(mesh, ("DG", 0)))
    around = ufl.SpatialCoordinate(mesh)[0] if "r" in scene.kinematics.coordinates[:1] else 1.0
    vector = dolfinx.fem.assemble_vector(compat.compile_form(around * test * ufl.dx(mesh)))
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    return np.asarray(vector.array.copy())
