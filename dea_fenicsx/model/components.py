"""The scalar parts of the mixed space: displacement components, pressure, potential."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


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
