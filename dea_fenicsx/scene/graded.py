"""Constants of materials that vary with the place, from cell to cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dea_fenicsx.scene.condition import InRegions, Setting, Support
from dea_fenicsx.scene.declarations import Declaration


@dataclass(frozen=True)
class GradedConstant(Declaration):
    """A constant of regions, times a factor of the place; see `Graded`."""

    regions: tuple[str, ...]
    constant: str
    factor: Callable[[np.ndarray], np.ndarray]


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

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        return [GradedConstant(self.names, self.constant, self.factor)]
