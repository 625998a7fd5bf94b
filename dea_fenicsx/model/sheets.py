"""Electrodes with a sheet resistance: charge that flows along a surface while time passes.

At each node i of such an electrode the charge q_i obeys

    dq_i/dt = - int 1/R grad_s phi . grad_s N_i dA,

with the resistance R of a square and the gradient along the undeformed surface.  It follows the
rules of the wires, q_i = H_i + h dq_i/dt.  Both q_i and H_i are fluxes of the total displacement T,
now and of the past; see `model.charge_history`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.model.charge_history import TOTAL, ChargeHistory
from dea_fenicsx.model.flowing_branches import quadrature_space
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


class Sheets:
    """The electrodes of a problem that have a sheet resistance.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    motion
        What the deformation has beside its fields, symbolic, or None.

    Attributes
    ----------
    names
        The groups of each of these electrodes.
    """

    def __init__(self, scene: Scene, scales: Scales, space: Unknowns, motion: Any) -> None:
        self._scene, self._scales, self._space, self._motion = scene, scales, space, motion
        self.names = [told.groups for _, told in scene.declared.sheets]
        self._seconds = dolfinx.fem.Constant(scene.device.mesh, 0.0)
        self._past: Any = None
        self._flux: Any = None
        self._rows = np.empty(0)
        if self.names:
            self._past = dolfinx.fem.Function(quadrature_space(scene, (3,)))

    def __bool__(self) -> bool:
        return bool(self.names)

    def _along(self, f: Any) -> Any:
        """The gradient of a potential along the undeformed surface."""
        kinematics, mesh = self._scene.kinematics, self._scene.device.mesh
        g = kinematics.gradient(f, ufl.SpatialCoordinate(mesh), self._motion)
        n = kinematics.embed(ufl.FacetNormal(mesh))
        return g - ufl.dot(g, n) * n

    def _heat(self, f: Any, weight: Any, ds: Any, first: int) -> Any:
        """The sum over the sheets of int 1/R grad_s phi . grad_s f dA, in units of charge per s."""
        phi = self._space.present["phi"]
        unit = self._scales.potential * self._scales.depth / self._scales.charge
        return sum(
            unit / told.ohms * ufl.dot(self._along(phi), self._along(f)) * weight * ds(first + k)
            for k, (_, told) in enumerate(self._scene.declared.sheets)
        )

    def work(self, weight: Any, ds: Any, first: int) -> Any:
        """What the sheets add to the residual, symbolic.

        Parameters
        ----------
        weight
            Area per area of the mesh.
        ds
            A measure, of which subdomain `first` + k is the surface of sheet k.
        """
        self._dissipated = self._heat(self._space.present["phi"], weight, ds, first)
        return -self._seconds * self._heat(self._space.virtual["phi"], weight, ds, first)

    def compile(self, flux: Callable[[Any], Any]) -> None:
        """Compile the flux of the past through the nodes.

        Parameters
        ----------
        flux
            From a nominal displacement to the linear form of its flux, int T . Grad N dX.
        """
        if self:
            self._flux = compat.compile_form(-flux(self._past))
            self._power = compat.compile_form(self._dissipated)

    def show(self, history: ChargeHistory, psi: float) -> None:
        """Take the history of the present state; rows of the potential are divided by `psi`."""
        if not self:
            return
        totals = [level[..., TOTAL] for level in history.leaks]
        self._past.x.array[:] = history.combined(totals).ravel() / psi
        self._seconds.value = history.rule_length / psi
        vector = dolfinx.fem.assemble_vector(self._flux)
        vector.scatter_reverse(dolfinx.la.InsertMode.add)
        self._rows = np.asarray(vector.array[: self._space.owned]).copy()

    @property
    def seconds(self) -> float:
        """h of the present state in s, over psi."""
        return float(self._seconds.value)

    @contextmanager
    def longer(self, seconds: float) -> Iterator[None]:
        """Let charge flow for a longer h within the block."""
        before = self.seconds
        self._seconds.value = before + seconds
        try:
            yield
        finally:
            self._seconds.value = before

    def past(self, nodes: np.ndarray) -> np.ndarray:
        """The charge of the past over psi in rows of some nodes (owned), dimensionless; else 0."""
        found = np.zeros(self._space.owned)
        found[nodes] = self._rows[nodes]
        return found

    def power(self) -> float:
        """The power in W that the sheets turn into heat.  Collective."""
        if not self:
            return 0.0
        mine = float(np.real(dolfinx.fem.assemble_scalar(self._power)))
        total = float(self._scene.device.comm.allreduce(mine, op=MPI.SUM))
        return total * self._scales.charge * self._scales.potential
