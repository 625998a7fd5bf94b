"""The volume that a surface encloses, from the surface alone.

By the divergence theorem the volume behind walls with the unit normal n, which points into it, is

    V = - sum over a of s_a int (x_a - c_a) n_a dA,

with the shares s_a of the coordinates, which add up to 1; in space they are 1/3 each.  In
axisymmetry it is the radius that is taken, with half of n_r r for 2 pi r dl, or the height alone.

A part of the boundary that is not meshed adds nothing to this sum, and so closes the volume,

- on a plane of symmetry x_a = c_a,
- on a plane normal to an axis a that has no share,
- where it is made of straight lines from the rim to an axis through the rim's middle: the openings
  normal to a then have s_a = 0, and lines normal to that axis have no part in the sum.

The force on the walls at a pressure P is P dV/du.  Since this is the derivative of a number, its
own derivative is symmetric, whatever closes the volume.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.mesh.rims import Rim, on_surface, outer_facets, rim_of
from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.scene.declarations import FixedDisplacement
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.strain import cofactor
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

QUADRATURE_OF_RIM = 6
"""Degree of a quadrature that integrates the volume behind quadratic facets exactly."""

COPLANAR_TOLERANCE = 1e-9
"""Two coordinates lie on one plane if they differ by less than this share of the device's size."""

LARGEST_GAP = 1e-7
"""Walls close a volume if the sum of their area vectors is below this share of their area."""


@dataclass(frozen=True, eq=False)
class Enclosed:
    """A volume behind walls, all dimensionless.

    Attributes
    ----------
    label
        The walls, for messages and names.
    facets
        Pairs (owned cell, facet), each facet once over all ranks.
    shares, origin
        s_a and c_a for each coordinate of the mesh.
    volume, area
        The undeformed volume, and the area of the walls.
    has_openings
        Whether openings are closed by what carries the pressure to their rims.
    """

    label: str
    facets: np.ndarray
    shares: tuple[float, ...]
    origin: tuple[float, ...]
    volume: float
    area: float
    has_openings: bool = False

    @property
    def unit(self) -> float:
        """A volume of the size of its changes: its own, or that of a thin layer on its walls."""
        return max(self.volume, 0.01 * self.area)

    def change(self, kinematics: Kinematics, mesh: Any, u: Any, motion: Any = None) -> Any:
        """Change of volume by a displacement, per undeformed area of the mesh; symbolic.

        Parameters
        ----------
        kinematics, mesh
            The kinematics and the mesh.
        u
            The displacement, symbolic.
        motion
            What the deformation has beside it, or None.
        """
        x, n = ufl.SpatialCoordinate(mesh), kinematics.embed(ufl.FacetNormal(mesh))
        F = ufl.Identity(3) + kinematics.displacement_gradient(u, x, motion)
        arm = [s * (x[a] - c) for a, (s, c) in enumerate(self._constants(mesh))]
        moved = [arm[a] + s * u[a] for a, (s, _) in enumerate(self._constants(mesh))]
        before = ufl.dot(kinematics.embed(ufl.as_vector(arm)), n)
        now = ufl.dot(kinematics.embed(ufl.as_vector(moved)), ufl.dot(cofactor(F)[0], n))
        return (before - now) * kinematics.weight(x)

    def _constants(self, mesh: Any) -> list[tuple[Any, Any]]:
        """Shares and origin as constants of a form, so that other values compile nothing."""
        number = dolfinx.fem.Constant
        return [
            (number(mesh, s), number(mesh, c))
            for s, c in zip(self.shares, self.origin, strict=True)
        ]


def enclosed(
    scene: Setting, names: Sequence[str], symmetry: str = "", openings: str = ""
) -> Enclosed:
    """The volume behind facet groups.  Collective.

    Parameters
    ----------
    scene
        The scene, whose supports say which edges stay in a plane.
    names
        The facet groups.
    symmetry
        Axes normal to planes of symmetry, beside those that follow from the supports.
    openings
        Axes along which openings are seen whose rim may move.

    Raises
    ------
    InputError
        If the groups and planes enclose no volume, naming an open edge.
    """
    device, label = scene.device, "+".join(names)
    facets = outer_facets(device, names)
    rim = rim_of(device, facets)
    planes, loose = _planes(scene, rim, symmetry)
    if len(loose) and not openings:
        count = f"{len(loose)} of its edges are" if len(loose) > 1 else "one of its edges is"
        raise InputError(
            f"The surface {label!r} of a cavity is not closed: {count} open, such as "
            f"{loose.place(device.length)}; add the surfaces that close it, hold the rim in a "
            f"plane with Fix(...), or name the axis along which the opening is seen, as in "
            f"openings={scene.kinematics.coordinates[-1]!r}."
        )
    shares = _shares(scene.kinematics, planes, openings, label)
    known = [len(planes.get(name, ())) == 1 for name in scene.kinematics.coordinates]
    origin = _origin(scene.kinematics, planes, loose if len(loose) else rim)
    volume, area, flux = _measures(device, scene.kinematics, facets, shares, origin)
    if not openings:
        _check_closed(label, flux / area, shares, known, scene.kinematics)
    return Enclosed(label, facets, shares, origin, volume, area, bool(openings))


def is_flat(scene: Setting, names: Sequence[str]) -> bool:
    """Whether facet groups lie in one plane, so that they enclose nothing.  Collective."""
    facets = outer_facets(scene.device, names)
    none = (0.0,) * len(scene.kinematics.coordinates)
    _, area, flux = _measures(scene.device, scene.kinematics, facets, none, none)
    if scene.kinematics.axis_of_rotation:  # a radial normal turns about the axis
        flux = flux[1:]
    return float(np.linalg.norm(flux)) > (1 - LARGEST_GAP) * area


def _planes(
    scene: Setting, rim: Rim, symmetry: str
) -> tuple[dict[str, list[float]], Rim]:
    """The planes in which edges of a rim stay, by the axes normal to them, and all other edges.

    An edge stays in a plane if both ends have one coordinate and a support holds it there.  An edge
    in a corner may stay in several planes; so those planes are taken first that hold most edges.
    """
    kinematics = scene.kinematics
    # The axis of rotation itself closes a section.
    left = np.ones(len(rim), dtype=bool)
    if kinematics.axis_of_rotation:
        left &= np.abs(rim.ends[:, :, 0]).max(axis=1, initial=0) > COPLANAR_TOLERANCE
    stays = {
        name: name in symmetry or _held(scene, rim, name) for name in kinematics.coordinates
    }
    found: dict[str, list[float]] = {}
    while left.any():
        best: tuple[int, str, float, np.ndarray] | None = None
        for a, name in reversed(list(enumerate(kinematics.coordinates))):
            at = rim.ends[:, :, a]
            usable = left & stays[name] & (np.ptp(at, axis=1) < COPLANAR_TOLERANCE)
            for value in np.unique(np.round(at[usable, 0], 9)):
                chosen = usable & (np.abs(at[:, 0] - value) < 2 * COPLANAR_TOLERANCE)
                if best is None or chosen.sum() > best[0]:
                    best = int(chosen.sum()), name, float(value), chosen
            # A radius is the cylinder around two rims as well; discs at the rims come first.
            if best is not None and kinematics.axis_of_rotation:
                break
        if best is None or not best[0]:
            break
        _, name, value, chosen = best
        found.setdefault(name, []).append(value)
        left &= ~chosen
    return found, rim.part(left)


def _held(scene: Setting, rim: Rim, axis: str) -> np.ndarray:
    """Mask of the edges of a rim that supports hold along an axis at every load.  Collective."""
    held = np.zeros(len(rim), dtype=bool)
    for item in scene.supports:
        for told in item.declarations(scene):
            if isinstance(told, FixedDisplacement) and told.axis == axis and told.ramp is None:
                held |= on_surface(scene.device, rim, told.surface)
    return held


def _shares(
    kinematics: Kinematics, planes: Mapping[str, Sequence[float]], openings: str, label: str
) -> tuple[float, ...]:
    """The share of each coordinate; 0 where caps are seen along it or two planes are normal to it.

    Raises
    ------
    InputError
        If none is left.
    """
    names = tuple(kinematics.coordinates)
    usable = [n for n in names if n not in openings and len(planes.get(n, ())) < 2]
    if kinematics.axis_of_rotation:
        if "r" in usable and not planes.get("r"):
            return (0.5, 0.0)
        usable = [n for n in usable if n == "z"]
    if not usable:
        raise InputError(
            f"The cavity behind {label!r} has openings along each of {', '.join(names)}, so that "
            "its volume does not follow from its walls; mesh one of the walls more."
        )
    return tuple(1 / len(usable) if n in usable else 0.0 for n in names)


def _origin(
    kinematics: Kinematics, planes: Mapping[str, Sequence[float]], rim: Rim
) -> tuple[float, ...]:
    """c_a of each coordinate: on the one plane normal to it, or in the middle of a rim.

    A radius is counted from the axis of rotation.
    """
    middle = rim.ends.reshape(-1, 3).mean(axis=0) if len(rim) else np.zeros(3)
    return tuple(
        0.0 if kinematics.axis_of_rotation and name == "r"
        else float(planes[name][0]) if len(planes.get(name, ())) == 1
        else float(middle[a])
        for a, name in enumerate(kinematics.coordinates)
    )  # fmt: skip


def _measures(
    device: Device, kinematics: Kinematics, facets: np.ndarray, shares: Sequence[float],
    origin: Sequence[float],
) -> tuple[float, float, np.ndarray]:  # fmt: skip
    """Volume, area, and int n_a dA of each coordinate, all undeformed.  Collective."""
    mesh = device.mesh
    ds = ufl.Measure(
        "ds", domain=mesh, subdomain_data=[(0, facets.ravel())],
        metadata={"quadrature_degree": QUADRATURE_OF_RIM},
    )(0)  # fmt: skip
    x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
    weight = kinematics.weight(x)
    number = dolfinx.fem.Constant
    volume = -sum(number(mesh, s) * (x[a] - number(mesh, c)) * n[a] * weight
                  for a, (s, c) in enumerate(zip(shares, origin, strict=True)))  # fmt: skip
    forms = [volume, weight * number(mesh, 1.0), *(n[a] * weight for a in range(len(shares)))]
    mine = [dolfinx.fem.assemble_scalar(compat.compile_form(f * ds)) for f in forms]
    total = device.comm.allreduce(np.real(np.array(mine, dtype=float)), op=MPI.SUM)
    return float(total[0]), float(total[1]), total[2:]


def _check_closed(
    label: str, flux: np.ndarray, shares: Sequence[float], known: Sequence[bool],
    kinematics: Kinematics,
) -> None:  # fmt: skip
    """Raise InputError if the sum depends on an origin that no plane gives."""
    for a, name in enumerate(kinematics.coordinates):
        is_radius = kinematics.axis_of_rotation and name == "r"
        if shares[a] and not known[a] and not is_radius and abs(flux[a]) > LARGEST_GAP:
            raise InputError(
                f"The surface {label!r} of a cavity is not closed along {name}: its walls and the "
                "planes at its rim leave an opening; add the surface that closes it."
            )
