"""The problem of a scene in elements of one degree more, and states brought into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dea_fenicsx.gradients.reductions import raising
from dea_fenicsx.mesh.sheets import with_exact_shape
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State


class Enriched:
    """The same scene on the same cells, each field of one degree more.

    Its fields hold those of the problem exactly, so that a state of the problem is one of its own.
    Where the cells are curved ones of a mesh family, they are as curved as the family's surfaces.

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
        scene = base.scene
        self.problem = Problem(
            replace(scene, device=with_exact_shape(scene.device), elements=scene.elements.richer()),
            base.released,
        )
        self._raising = raising(base.space, self.problem.space)

    def lifted(self, values: np.ndarray) -> np.ndarray:
        """Values of the problem (local ones, ghosts included) as values of the richer one."""
        found = np.zeros(self.problem.size)
        local = values[self.base.W.dofmap.list] @ self._raising.T
        found[self.problem.W.dofmap.list.ravel()] = local.ravel()
        return found

    def state(self, state: State) -> State:
        """A state of the problem as a state of the richer one.  Collective."""
        rest: State = self.problem.rest
        return replace(rest, values=self.lifted(state.values), factors=state.factors)
