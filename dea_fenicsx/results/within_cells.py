"""Values within cells: J, the electric field and the stress, at the middles and at the nodes.

The elements know these quantities best at the Gauss points of the rule that is exact for degree 2
(Barlow's points).  The polynomial of degree 1 through the values there is continued to the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
import ufl

from dea_fenicsx.model.cell_values import evaluated_within, linear_terms
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.cell_types import SIMPLICES

VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Order of the stress in a column of values."""

SIZE = 4 + len(VOIGT)
"""Numbers at a point: J, the electric field, the stress."""

ROWS_AT_A_TIME = 20_000
"""Rows of which `named_short` makes fields in double precision at a time."""

Fields = dict[str, np.ndarray]
"""Values by the name of the field."""


@dataclass(frozen=True)
class Evaluated:
    """Values in the owned cells of a rank, dimensionless.

    Attributes
    ----------
    middle : at the middle of each cell, shape (cells, SIZE)
    inner : at the Gauss points of each cell, shape (cells, points, SIZE)
    live : 1 where a cell's region has an electric field, else 0, shape (cells,)
    """

    middle: np.ndarray
    inner: np.ndarray
    live: np.ndarray


class WithinCells:
    """Evaluates J, the electric field and the stress of a problem in its cells.

    Parameters
    ----------
    problem
        The problem.
    cells
        Number of owned cells.
    """

    def __init__(self, problem: Problem, cells: int) -> None:
        self.problem = problem
        self.cells = cells
        self.kind = problem.mesh.topology.cell_name()
        cell = getattr(basix.CellType, self.kind)
        middle = basix.cell.geometry(cell).mean(axis=0)
        self.points, _ = basix.make_quadrature(cell, 2)
        self._expressions: list[Callable[[Any, np.ndarray], np.ndarray]] = []
        for kernel, s in zip(problem.kernels, problem.states, strict=True):
            sigma = s.cauchy_stress
            entries = [s.J, *(s.true_field[i] for i in range(3)), *(sigma[i, j] for i, j in VOIGT)]
            self._expressions.append(
                evaluated_within(
                    ufl.as_vector(entries), kernel, middle, self.points, problem.forms.quadrature
                )
            )

    def evaluate(self) -> Evaluated:
        """The values of the present state.  No other rank is asked."""
        values = np.zeros((self.cells, 1 + len(self.points), SIZE))
        live = np.zeros(self.cells)
        for kernel, expression in zip(self.problem.kernels, self._expressions, strict=True):
            values[kernel.cells] = expression(self.problem.mesh, kernel.cells)
            live[kernel.cells] = kernel.eps is not None
        return Evaluated(values[:, 0], values[:, 1:], live)

    def to_nodes(self, degree: int) -> np.ndarray:
        """Matrix from the values at the Gauss points of a cell to those at its nodes.

        Parameters
        ----------
        degree
            Degree of the cell that has the nodes, in basix's order.

        Returns
        -------
        ndarray of shape (nodes, points)
        """
        cell = getattr(basix.CellType, self.kind)
        variant = basix.LagrangeVariant.gll_warped
        nodes = basix.create_element(basix.ElementFamily.P, cell, degree, variant).points
        tensor = self.kind not in SIMPLICES
        return linear_terms(nodes, tensor) @ np.linalg.pinv(linear_terms(self.points, tensor))

    def named_short(self, values: np.ndarray, live: np.ndarray) -> Fields:
        """What `named` gives, in single precision and with little memory beside it."""
        found: Fields = {}
        for start in range(0, max(len(values), 1), ROWS_AT_A_TIME):
            rows = slice(start, start + ROWS_AT_A_TIME)
            for name, part in self.named(values[rows], live[rows]).items():
                if name not in found:
                    found[name] = np.empty((len(values), *part.shape[1:]), dtype=np.float32)
                found[name][rows] = part
        return found

    def named(self, values: np.ndarray, live: np.ndarray) -> Fields:
        """Fields in SI units by their names, from rows of values.

        Parameters
        ----------
        values, live
            As in `Evaluated`, shapes (n, SIZE) and (n,).
        """
        problem = self.problem
        stress: np.ndarray = np.zeros((len(values), 3, 3))
        for k, (i, j) in enumerate(VOIGT):
            stress[:, i, j] = stress[:, j, i] = values[:, 4 + k]
        field = values[:, 1:4]
        if problem.scene.kinematics.axis_of_rotation:
            # the picture's plane is (r, z); the hoop direction comes last there
            turn = [0, 2, 1]
            stress, field = stress[:, turn][:, :, turn], field[:, turn]
        stress *= problem.scales.stress
        fields = {
            "J": values[:, 0],
            "cauchy_stress_Pa": stress.reshape(-1, 9),
            "pressure_Pa": -np.trace(stress, axis1=1, axis2=2) / 3,
        }
        if problem.potential is not None:
            fields["electric_field_V_per_m"] = field * problem.scales.field
            strength = np.linalg.norm(field, axis=1) * problem.scales.field
            fields["field_strength_V_per_m"] = strength
            fields["field_strength_MV_per_m"] = np.where(live > 0, strength / 1e6, np.nan)
        return fields
