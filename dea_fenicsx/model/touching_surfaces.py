"""The surfaces that may touch an obstacle, and the fields that live on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import basix.ufl
import numpy as np
import ufl

from dea_fenicsx.mesh.device import Device, one_sided
from dea_fenicsx.model.fields import Field, Role, softness
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.scene.contact_declarations import UnilateralContact
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx


@dataclass(frozen=True)
class TouchingSurface:
    """A surface that may touch one obstacle; all sizes are dimensionless.

    Attributes
    ----------
    name
        Name of the pressure's field.
    told
        What the obstacle declares.
    facets
        Its facets, each with the cell from which it is seen, see `one_sided`; shape (n, 2).
    widths, areas
        Mean width and area of the facets of each owned cell; 0 for a cell without facets.
    slenderness
        Height of each owned cell above these facets over their width, at most 1; 1 for a cell
        without facets.
    """

    name: str
    told: UnilateralContact
    facets: np.ndarray
    widths: np.ndarray
    areas: np.ndarray
    slenderness: np.ndarray


def touching_surfaces(scene: Scene) -> list[TouchingSurface]:
    """One surface for each obstacle of a scene, in their order.  Collective."""
    found: dict[str, TouchingSurface] = {}
    for _, told in scene.declared.contacts:
        name, number = f"contact {told.surface}", 2
        while name in found:
            name, number = f"contact {told.surface} {number}", number + 1
        facets = one_sided(scene.device, told.surface)
        found[name] = TouchingSurface(name, told, facets, *_facet_sizes(scene.device, facets))
    return list(found.values())


def contact_fields(
    surfaces: Iterable[TouchingSurface], device: Device, axes: str
) -> Iterator[Field]:
    """The pressures on surfaces, and with friction the tangential tractions.  Collective.

    Parameters
    ----------
    surfaces, device
        The surfaces, and the device that they belong to.
    axes
        The axes of the displacement, one letter for each component.
    """
    cell = device.mesh.topology.cell_name()
    for surface in surfaces:
        told, cells = surface.told, surface.facets[:, 0]
        # A row of the residual of p is a gap times the area that belongs to a vertex.  In a mesh
        # that is graded towards a contact, most facets are small and near it, and so the median
        # is theirs.  All ranks get 8 bytes for each facet, which are few: their number grows with
        # that of the cells to the power 2/3.
        mine = surface.widths[cells] * surface.areas[cells]
        every = np.concatenate(device.comm.allgather(mine))
        scale = float(np.median(every) * np.sqrt(len(every)))
        yield Field(
            surface.name, basix.ufl.element("Lagrange", cell, 1), Role.INTERNAL, negative=True,
            residual_scale=scale, mass=softness, surface=told.surface,
        )  # fmt: skip
        if told.friction:
            yield Field(
                traction_of(surface.name),
                basix.ufl.element("Lagrange", cell, 1, shape=(len(axes),)),
                Role.INTERNAL, tuple(axes), negative=True, residual_scale=scale, mass=softness,
                surface=told.surface,
            )  # fmt: skip


def traction_of(name: str) -> str:
    """The name of the field of tangential tractions that belongs to a contact."""
    return f"friction{name.removeprefix('contact')}"


def _facet_sizes(
    device: Device, facets: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The widths, the areas and the slenderness of `TouchingSurface`.  Collective."""
    mesh, dim = device.mesh, device.dim
    each = ufl.TestFunction(dolfinx.fem.functionspace(mesh, ("DG", 0)))
    ds = measure(device, [facets], 2, "ds")(0)
    owned = device.owned_cells()
    areas, volumes = (
        dolfinx.fem.assemble_vector(compat.compile_form(each * over)).array[:owned].copy()
        for over in (ds, ufl.dx(mesh))
    )
    cells, counts = np.unique(facets[:, 0], return_counts=True)
    areas[cells] /= counts
    widths, slenderness = areas ** (1 / (dim - 1)), np.ones(owned)
    tapers = dim if mesh.topology.cell_name() in ("triangle", "tetrahedron") else 1
    heights = tapers * volumes[cells] / areas[cells]
    slenderness[cells] = np.minimum(heights / widths[cells], 1.0)
    return widths, areas, slenderness
