"""The mixed function that holds all unknowns, and where each field lies in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Field, Role
from dea_fenicsx.model.tied_unknowns import Rows
from dea_fenicsx.scene.declarations import GlobalUnknown
from dea_fenicsx.support.compat import dolfinx


class Unknowns:
    """All unknowns of a problem, fixed values included, as one mixed function.

    Parameters
    ----------
    mesh
        The mesh.
    fields
        The fields, in the order in which they lie in the mixed function.
    global_unknowns
        The numbers that the field ``"global"`` holds.

    Attributes
    ----------
    fields
        The fields.
    W, w, test
        The mixed space, its function and its test function, dimensionless.
    present, virtual
        The fields of the function and of its test function by name, symbolic.
    parts
        For each field its scalar parts, by name; a scalar field has one, of its own name.
    owned, size
        Number of local degrees of freedom of `W` that this rank owns, and of all local ones.
    rows
        The owned ones by their number over all ranks.
    at_rest
        All local values in the undeformed body without loads; those that are fixed are 0 instead.
    """

    def __init__(
        self, mesh: Any, fields: Sequence[Field], global_unknowns: Sequence[GlobalUnknown] = ()
    ) -> None:
        self.fields, self._global = list(fields), global_unknowns
        mixed = basix.ufl.mixed_element([field.element for field in fields])
        self.W = dolfinx.fem.functionspace(mesh, mixed)
        self.w = dolfinx.fem.Function(self.W, name="state")
        self.test = ufl.TestFunction(self.W)
        self.present, self.virtual = self._split(self.w), self._split(self.test)
        self.parts = {f.name: self._components(k, f) for k, f in enumerate(self.fields)}
        index_map = self.W.dofmap.index_map
        assert self.W.dofmap.index_map_bs == 1
        self.owned = index_map.size_local
        self.size = index_map.size_local + index_map.num_ghosts
        self.at_rest = np.zeros(self.size)
        for field in self.fields:
            for part in self.parts[field.name].values():
                self.at_rest[part.dofs] = field.at_rest
        self.rows = Rows(self.owned, index_map.local_range[0], mesh.comm)

    def _components(self, number: int, field: Field) -> dict[str, Component]:
        whole = self.W.sub(number)
        if len(field.parts) < 2:
            return {(field.parts or (field.name,))[0]: Component.of(whole)}
        return {name: Component.of(whole.sub(a)) for a, name in enumerate(field.parts)}

    def of(self, role: Role) -> list[Component]:
        """The scalar parts of all fields of a role."""
        return [
            part for field in self.fields if field.role is role
            for part in self.parts[field.name].values()
        ]  # fmt: skip

    def single(self, role: Role) -> Component | None:
        """The one scalar part of a role, or None."""
        return next(iter(self.of(role)), None)

    @property
    def numbers(self) -> np.ndarray:
        """Number over all ranks of each local degree of freedom, ghosts included."""
        local = np.arange(self.size, dtype=np.int32)
        return np.asarray(self.W.dofmap.index_map.local_to_global(local))

    @property
    def continuous(self) -> list[Component]:
        """The scalar parts of all continuous fields, the displacement first."""
        others = [f for f in self.fields if f.role is not Role.MOTION and f.is_continuous]
        found = [part for field in others for part in self.parts[field.name].values()]
        return [*self.of(Role.MOTION), *found]

    def symbolic(self, role: Role, function: Any) -> Any:
        """The first field of a role in a mixed function or in its test function, symbolic."""
        name = next(field.name for field in self.fields if field.role is role)
        return self._split(function)[name]

    def _split(self, function: Any) -> dict[str, Any]:
        """The fields of a mixed function or of its test function, symbolic, by name."""
        parts = ufl.split(function)
        return {field.name: part for field, part in zip(self.fields, parts, strict=True)}

    def global_values(self, length: float) -> np.ndarray:
        """Present value of each global unknown, in SI units.  Collective.

        Parameters
        ----------
        length
            The unit of length in m.
        """
        comm, w = self.W.mesh.comm, self.w.x.array
        values = []
        for unknown, part in zip(self._global, self.parts.get("global", {}).values(), strict=True):
            # a rank without cells has none of these degrees of freedom
            value = next(v for v in comm.allgather(w[part.dofs[:1]]) if len(v))[0]
            values.append(value / length**unknown.per_length)
        return np.array(values)
