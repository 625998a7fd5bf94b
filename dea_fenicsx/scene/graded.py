"""Constants of materials that vary with the place, from cell to cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.mesh.cell_middles import at_middles
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.scene.condition import InRegions, Setting, Support
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.support.errors import InputError


@dataclass(frozen=True, eq=False)
class GradedConstant(Declaration):
    """A constant of a region, and its factor in each local cell; see `Graded`."""

    region: str
    constant: str
    factor: np.ndarray


@dataclass(frozen=True)
class Graded(InRegions, Support):
    """A constant of a region's material that varies with the place.

    In each cell the constant is that of the material times a factor.  It is listed among the
    supports of a scene, since no ramp drives it.

    Parameters
    ----------
    where
        Name of a region, or several names.
    constant
        ``"elastic.mu"``, ``"electric.eps_r"`` or another constant of the elastic model or of the
        dielectric, as `Problem.parameters` names it without the region.
    factor
        The factor: from the positions of the cells' middles in m, shape (n, 3), to n numbers above
        0.  A permittivity may be as low as it likes: one of almost nothing stands for a film
        without an electrode there.
    """

    where: str | tuple[str, ...]
    constant: str
    factor: Callable[[np.ndarray], np.ndarray]

    def check(self, scene: Setting) -> None:
        self.check_named()
        super().check(scene)
        for name in self.names:
            self.factors(scene.device, name)

    def factors(self, device: Device, region: str) -> np.ndarray:
        """The factor in each local cell of a region.  Collective.

        Raises
        ------
        InputError
            If it cannot be found, or is not above 0.
        """
        what = f"The factor of '{region}.{self.constant}'"
        found = at_middles(device, device.cells_of(region), self.factor, what)
        least = device.comm.allreduce(float(found.min(initial=np.inf)), op=MPI.MIN)
        if least <= 0:
            raise InputError(f"{what} is {least:g} somewhere, but must be above 0.")
        return found

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [
            GradedConstant(name, self.constant, self.factors(scene.device, name))
            for name in self.names
        ]
