"""The mixed function that holds all unknowns, and where each field lies in it."""

from __future__ import annotations

from typing import Any

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Field, Role, declared_fields
from dea_fenicsx.model.tied_unknowns import Rows
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx

NORM_ROLE = {Role.GLOBAL: Role.MOTION}
"""Roles whose residuals are included in the norm of another role."""


class Unknowns:
    """All unknowns of a problem, fixed values included, as one mixed function.

    Parameters
    ----------
    scene
        The scene.

    Attributes
    ----------
    fields
        The fields, in the order in which they lie in the mixed function.
    W, w
        The mixed space and function, dimensionless.
    parts
        For each field its scalar parts, by name; a scalar field has one, of its own name.
    owned, size
        Number of local degrees of freedom of `W` that this rank owns, and of all local ones.
    rows
        The owned ones by their number over all ranks.
    at_rest
        All local values in the undeformed body without loads.
    """

    def __init__(self, scene: Scene) -> None:
        self.fields: list[Field] = declared_fields(scene)
        self._global = scene.kinematics.global_unknowns
        mixed = basix.ufl.mixed_element([field.element for field in self.fields])
        self.W = dolfinx.fem.functionspace(scene.device.mesh, mixed)
        self.w = dolfinx.fem.Function(self.W, name="state")
        self.parts = {f.name: self._components(k, f) for k, f in enumerate(self.fields)}
        index_map = self.W.dofmap.index_map
        assert self.W.dofmap.index_map_bs == 1
        self.owned = index_map.size_local
        self.size = index_map.size_local + index_map.num_ghosts
        self.at_rest = np.zeros(self.size)
        for field in self.fields:
            for part in self.parts[field.name].values():
                self.at_rest[part.dofs] = field.at_rest
        self.rows = Rows(self.owned, index_map.local_range[0], scene.device.comm)

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

    def groups(self) -> dict[str, list[Field]]:
        """The fields whose residuals are taken together, by the name of the first of them."""
        leaders = {field.role: field.name for field in reversed(self.fields)}
        found: dict[str, list[Field]] = {}
        for field in self.fields:
            shared = NORM_ROLE.get(field.role)
            found.setdefault(leaders[shared] if shared else field.name, []).append(field)
        return found

    def owned_of(self, fields: list[Field]) -> np.ndarray:
        """Owned degrees of freedom of some fields, sorted."""
        parts = [p for f in fields for p in self.parts[f.name].values()]
        dofs = np.concatenate([part.dofs for part in parts])
        return np.sort(dofs[dofs < self.owned])

    def symbolic(self, role: Role, function: Any) -> Any:
        """The first field of a role in a mixed function or in its test function, symbolic."""
        name = next(field.name for field in self.fields if field.role is role)
        return self.split(function)[name]

    def split(self, function: Any) -> dict[str, Any]:
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
