"""Coulomb friction of a surface on a rigid obstacle.

Let y be the place of a point as seen from the obstacle, n the normal of the obstacle there, and
P = 1 - n n.  The tangential traction has a continuous field tau on the surface, linear in each
facet, as the contact pressure has one.  With the slip s = P (y - a) since the last accepted state,
the traction at a point is

    t = b,              b = tau - r s,      where |b| <= mu f    (the point sticks),
    t = mu f b/|b|                          where |b| >  mu f    (the point slides),

f being the contact force.  Its virtual work is

    int [ -t . virtual(y) + (t - tau) . virtual(tau)/r ] dA.

So the mean slip around a vertex is 0 where all points stick, whatever the value of r, and the
traction of a sliding point is exactly mu f.

The anchor a belongs to the history.  Once a state is accepted it becomes

    a = y - (tau - t)/r

at each point of integration.  Without a further change of the load the tractions then stay as they
are.  So a surface that sticks does not creep from one step to the next, and states do not depend on
the number of steps where nothing changes the direction in which it slides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.model.contact_points import facet_points
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

DEGREES = {"triangle": 4, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 3}
"""Degree of the functions that hold anchors.

On a facet they take any values at its points of integration.  In a cell of which several facets
may touch they are fitted by least squares, if they cannot take all values.
"""


@dataclass(frozen=True, eq=False)
class FrictionHistory:
    """What surfaces with friction remember of the last accepted state.

    Attributes
    ----------
    anchors
        For each surface the coefficients of a - X, dimensionless, of shape (cells, numbers), in
        the cells of this rank that have facets on it, sorted.
    spent
        For each surface the work that friction has taken in each of these cells, in units of
        energy.
    """

    anchors: tuple[np.ndarray, ...]
    spent: tuple[np.ndarray, ...]


class Friction:
    """Friction of one surface, symbolic and dimensionless.

    Parameters
    ----------
    contact
        Its `Contact`.
    mesh, kinematics
        The mesh and the kinematics.
    traction
        tau, symbolic, in the components of the displacement.

    Attributes
    ----------
    coefficient
        mu, as a constant of the form.
    traction
        t, a 3-vector, per undeformed area.
    cells
        The cells of this rank that have facets on the surface, sorted; from `compile`.
    """

    cells: np.ndarray

    def __init__(self, contact: Any, mesh: Any, kinematics: Any, traction: Any) -> None:
        self._contact, self._mesh, self._kinematics = contact, mesh, kinematics
        self._along = contact.told.along
        cell = mesh.topology.cell_name()
        self._shape = basix.ufl.element("Lagrange", cell, DEGREES[cell], discontinuous=True)
        size = (len(self._along),)
        space = dolfinx.fem.functionspace(
            mesh, basix.ufl.element(
                "Lagrange", cell, DEGREES[cell], discontinuous=True, shape=size)
        )  # fmt: skip
        self._anchor, self._next = dolfinx.fem.Function(space), dolfinx.fem.Function(space)
        self.coefficient = dolfinx.fem.Constant(mesh, float(contact.told.friction))
        self._tau = kinematics.embed(traction)
        slope = ufl.sqrt(ufl.dot(contact.direction, contact.direction))
        self._normal, r = contact.direction / slope, contact.stiffness
        slip = self._tangential(contact.place - contact.place_at_rest - self._held(self._anchor))
        trial = self._tangential(self._tau) - r * slip
        limit = self.coefficient * contact.force * slope
        square = ufl.dot(trial, trial)
        self._beyond = square - limit**2
        sliding = ufl.conditional(ufl.le(square, limit**2), 1, limit / ufl.sqrt(square))
        self.traction = ufl.conditional(contact.touches, sliding, 0) * trial

    def _held(self, anchor: Any) -> Any:
        """An anchor's components as a 3-vector."""
        return self._kinematics.embed(ufl.as_vector([anchor[k] for k in range(len(self._along))]))

    def _tangential(self, vector: Any) -> Any:
        return vector - ufl.dot(vector, self._normal) * self._normal

    def virtual_work(self, w: Any, test: Any) -> Any:
        """The virtual work, as an integral."""
        contact, t = self._contact, self.traction
        moved = ufl.derivative(contact.place, w, test)
        changed = ufl.derivative(self._tau, w, test)
        lag = ufl.dot(t - self._tau, changed) / contact.stiffness
        return contact.integral(lag - ufl.dot(t, moved))

    def rate(self, share: Any, w: Any, test: Any) -> Any:
        """Minus the derivative of the virtual work by a variable, as an integral."""
        contact, change = self._contact, ufl.diff(self.traction, share)
        moved = ufl.derivative(contact.place, w, test)
        changed = ufl.derivative(self._tau, w, test)
        density = ufl.dot(change, moved) - ufl.dot(change, changed) / contact.stiffness
        return contact.integral(density)

    def compile(self) -> None:
        """Prepare what `settle` evaluates.  Collective."""
        contact, cell = self._contact, getattr(basix.CellType, self._mesh.topology.cell_name())
        self.cells = np.unique(contact.facets[:, 0])
        self._places = self._dofs(self.cells).reshape(len(self.cells), self.numbers)
        number = len(basix.cell.facet_outward_normals(cell))
        points = [facet_points(cell, k) for k in range(number)]
        elastic = (self._tangential(self._tau) - self.traction) / contact.stiffness
        new = contact.place - contact.place_at_rest - elastic
        self._points = len(points[0])
        entries = [*(new[i] for i in self._along), self._beyond]
        self._evaluate = compat.expression(ufl.as_vector(entries), np.vstack(points))
        values = self._shape.tabulate(0, np.vstack(points))[0]
        self._at_points = values.reshape(number, self._points, -1)
        self._fits = list(self._cells_by_facets())
        slipped = self._held(self._next) - self._held(self._anchor)
        each = ufl.TestFunction(dolfinx.fem.functionspace(self._mesh, ("DG", 0)))
        work = -ufl.dot(self.traction, slipped) * each
        self._work = compat.compile_form(contact.integral(work))

    def _cells_by_facets(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Cells of which the same facets may touch, with these facets and what fits values there.

        Yields
        ------
        rows : ndarray of int, shape (cells, facets)
            Where the facets of each cell stand among those of the contact.
        places : ndarray of int
            Where the cells stand among `cells`.
        fit : ndarray, shape (numbers, points)
            Matrix from values at all of these points to coefficients.
        """
        facets = self._contact.facets
        order = np.lexsort((facets[:, 1], facets[:, 0]))
        groups: dict[tuple[int, ...], list[np.ndarray]] = {}
        for rows in np.split(order, np.flatnonzero(np.diff(facets[order, 0])) + 1):
            if len(rows):
                groups.setdefault(tuple(int(k) for k in facets[rows, 1]), []).append(rows)
        for sides, found in groups.items():
            rows = np.array(found)
            fit = np.linalg.pinv(np.vstack([self._at_points[k] for k in sides]))
            yield rows, np.searchsorted(self.cells, facets[rows[:, 0], 0]), fit

    @property
    def numbers(self) -> int:
        """Numbers in each cell that hold the anchors."""
        return int(self._anchor.function_space.dofmap.list.shape[1]) * len(self._along)

    def _dofs(self, cells: Any) -> np.ndarray:
        """Places of the numbers of some cells, of shape (cells, shape functions, components)."""
        table = self._anchor.function_space.dofmap.list[cells]
        return np.asarray(table[..., None] * len(self._along) + np.arange(len(self._along)))

    def show(self, anchors: np.ndarray) -> None:
        """Put the anchors of a state into the form."""
        self._anchor.x.array[self._places] = anchors

    def _at_facets(self) -> np.ndarray:
        """Values in the present state, of shape (facets, points, entries).

        The entries are the next anchor, and what is positive where a pressed point slides.
        """
        facets = self._contact.facets
        cells, place = facets[:, 0].astype(np.int32), facets[:, 1]
        found = self._evaluate(self._mesh, cells)
        shape = len(cells), len(self._at_points), self._points, found.shape[-1]
        return np.asarray(found.reshape(shape)[np.arange(len(cells)), place])

    def slides(self) -> np.ndarray:
        """Whether a point slides in the present state if it is pressed, shape (facets, points)."""
        return np.asarray(self._at_facets()[..., -1] > 0)

    def settled(self, anchors: np.ndarray, spent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The history after the present state has been accepted.  Collective.

        Parameters
        ----------
        anchors, spent
            The history of the present state, which is shown.
        """
        found, n = self._at_facets()[..., :-1], len(self._along)
        new = anchors.copy()
        for rows, here, fit in self._fits:
            values = found[rows].reshape(len(rows), -1, n)
            new[here] = np.einsum("dp,cpn->cdn", fit, values).reshape(len(rows), -1)
        self._next.x.array[self._places] = new
        work = dolfinx.fem.assemble_vector(self._work).array
        return new, spent + work[self.cells]


class Frictions(list[Friction]):
    """All surfaces of a problem that rub on an obstacle."""

    NAME = "friction"

    def compile(self) -> None:
        """Prepare what `settled` evaluates.  Collective."""
        for friction in self:
            friction.compile()

    def at_rest(self) -> FrictionHistory:
        """The history of the undeformed body."""
        anchors = tuple(np.zeros((len(friction.cells), friction.numbers)) for friction in self)
        return FrictionHistory(anchors, tuple(np.zeros(len(friction.cells)) for friction in self))

    def show(self, history: FrictionHistory) -> None:
        """Put the history of a state into the forms."""
        for friction, anchors in zip(self, history.anchors, strict=True):
            friction.show(anchors)

    def settled(self, history: FrictionHistory) -> FrictionHistory:
        """The history after the present state, which has this one, was accepted.  Collective."""
        found = [
            friction.settled(*both)
            for friction, *both in zip(self, history.anchors, history.spent, strict=True)
        ]
        return FrictionHistory(tuple(a for a, _ in found), tuple(s for _, s in found))

    @property
    def columns(self) -> int:
        """Numbers in each cell."""
        return sum(friction.numbers + 1 for friction in self)

    def table(self, history: FrictionHistory, cells: int) -> np.ndarray:
        """A history by cell, of shape (cells, `columns`), 0 in all but those on the surfaces."""
        found, start = np.zeros((cells, self.columns)), 0
        for friction, *both in zip(self, history.anchors, history.spent, strict=True):
            end = start + friction.numbers + 1
            found[friction.cells, start:end] = np.column_stack(both)
            start = end
        return found

    def untabled(self, table: np.ndarray) -> FrictionHistory:
        """The history that `table` gave."""
        anchors, spent, start = [], [], 0
        for friction in self:
            end = start + friction.numbers
            anchors.append(table[friction.cells, start:end])
            spent.append(table[friction.cells, end])
            start = end + 1
        return FrictionHistory(tuple(anchors), tuple(spent))
