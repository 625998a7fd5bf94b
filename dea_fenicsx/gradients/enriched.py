"""The problem of a scene in elements of one degree more, and states brought into it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.support.compat import dolfinx


class Enriched:
    """The same scene on the same mesh, each field of one degree more.

    Its fields hold those of the problem exactly, so that a state of the problem is one of its own.

    Parameters
    ----------
    base
        The problem.

    Attributes
    ----------
    base, problem
        The problem, and that of one degree more.
    """

    def __init__(self, base: Problem) -> None:
        self.base = base
        scene = replace(base.scene, elements=base.scene.elements.richer())
        self.problem = Problem(scene, base.released)
        self._pairs = [
            (old, new, dolfinx.fem.Function(old.space), dolfinx.fem.Function(new.space))
            for name, parts in base.space.parts.items()
            for old, new in zip(
                parts.values(), self.problem.space.parts[name].values(), strict=True
            )
        ]

    def lifted(self, values: np.ndarray) -> np.ndarray:
        """Values of the problem (local ones, ghosts included) as values of the richer one."""
        found = np.zeros(self.problem.size)
        for old, new, source, target in self._pairs:
            source.x.array[:] = values[old.dofs]
            target.interpolate(source)
            target.x.scatter_forward()
            found[new.dofs] = target.x.array
        return found

    def state(self, state: State) -> State:
        """A state of the problem as a state of the richer one.  Collective."""
        rest: Any = self.problem.rest
        return replace(
            rest, values=self.lifted(state.values), factors=state.factors
        )
