"""Contact of surfaces with rigid obstacles; for friction see `friction`.

The contact pressure p, nominal, is a continuous field on the surface, linear in each facet.  With
the gap g to the obstacle it makes the augmented Lagrangian

    int [ max(0, p - r g)^2 - p^2 ] / (2 r) dA,    r > 0,

stationary.  The force on the surface is f = max(0, p - r g) along the growing gap, and p is the
projection of f on the field.  So the weighted gap is 0 wherever f > 0 around a vertex, whatever the
value of r: nothing of the size of a penalty is left.  At a single point the gap is (p - f)/r.

The pressure is an unknown as all others are.  So an equilibrium does not depend on how it was
reached, it can be traced by arc length, and its negative eigenvalues can be counted: each unknown
of the pressure gives one, whether the surface touches there or not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.materials import Material
from dea_fenicsx.model.carriers import seen_from
from dea_fenicsx.model.contact_points import QUADRATURE_OF_CONTACT, ContactPoints
from dea_fenicsx.model.friction import Friction, Frictions
from dea_fenicsx.model.rigid_parts import RigidPart
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.touching_surfaces import TouchingSurface, traction_of
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.kinematics import Kinematics, cofactor
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.compat import dolfinx

TOLERANCE_BY_WIDTH = 0.1
"""Default tolerance of a gap, as a share of the width of the facets on the surface."""

MODULI_AT_TOLERANCE = 2.0
"""Deviation of f from p, in shear moduli, at which a gap reaches its tolerance.

Such a deviation only belongs to a pressure that the mesh does not resolve.  A larger value would
leave larger rounding errors in the forces, which are those of the places times r."""

FLAT_CELLS = 25.0
"""Factor on the cube of a cell's slenderness, height over width, by which r falls if it is below 1.

A pressure that varies from one facet of the width w to the next bends a wall of the height t.  For
this the wall is (pi t/w)^3/6 = 5 (t/w)^3 times as stiff as a thick body, incompressible.  With an r
that is much stiffer than the wall, a Newton step that closes one point opens its neighbours, and
the points that touch never settle.  The factor is larger than 5, since gaps at single points grow
with a smaller r: cells of which the width is less than three times the height keep all of r.
"""

LEAST_SLENDERNESS = 0.01
"""Slenderness of a cell below which r does not fall further."""


def _place(kinematics: Kinematics, u: Any, x: Any) -> Any:
    """The deformed place of a point, a 3-vector of the frame in which u has its components."""
    known = tuple(kinematics.coordinates)
    parts = [
        u[a] + x[known.index(axis)] if axis in known else u[a]
        for a, axis in enumerate(kinematics.axes)
    ]
    return kinematics.embed(ufl.as_vector(parts))


class Contact:
    """One surface and one obstacle, symbolic and dimensionless.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    surface
        The surface, and what the obstacle declares.
    parts
        The rigid parts.

    Attributes
    ----------
    told, name, facets
        Those of the surface.
    place, place_at_rest
        The place of a point as seen from the obstacle, and the same in the undeformed device,
        dimensionless 3-vectors.
    factor
        The ramp's factor, as a constant of the form.
    touches
        The condition f > 0.
    softening
        Factor on r, as a constant of the form.  It is 1, except while Newton's method looks for a
        state from which it converges.
    stiffness
        r.
    offset
        Length that is added to the gap, as a constant of the form.  It is 0, except while a device
        is pushed out of an obstacle.
    gap
        The gap g.
    direction
        The derivative of g by the place, a 3-vector.
    pressure, pushed, force
        p, p - r g and f, per undeformed area.
    points
        What evaluates them at the points of integration.
    friction
        Its friction, or None.
    """

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns, surface: TouchingSurface,
        parts: Sequence[RigidPart] = (),
    ) -> None:  # fmt: skip
        self._scene, self._scales = scene, scales
        mesh = self._mesh = scene.device.mesh
        told, name = self.told, self.name = surface.told, surface.name
        self.facets = surface.facets
        x, u = ufl.SpatialCoordinate(mesh), space.present["u"]
        self.factor = dolfinx.fem.Constant(mesh, 0.0)
        self.offset = dolfinx.fem.Constant(mesh, 0.0)
        self._share = ufl.variable(self.factor)
        unit = dolfinx.fem.Constant(mesh, scales.length)
        self.place_at_rest = _place(scene.kinematics, 0 * u, x)
        place = _place(scene.kinematics, u, x)
        if told.carrier is not None:
            place = self._seen_from_carrier(space, parts, place)
        self._place = ufl.variable(ufl.as_vector([
            unit * place[i] - (self._share * self._number(moved) if moved else 0)
            for i, moved in enumerate(told.travel)
        ]))  # fmt: skip
        self.place = self._place / unit
        metres = told.gap(self._place, self._number)
        self.direction = ufl.diff(metres, self._place)
        self.gap = metres / unit + self.offset
        self.pressure = space.present[name]
        self.softening = dolfinx.fem.Constant(mesh, 1.0)
        self.stiffness = self.softening * self._stiffness(surface)
        self.pushed = self.pressure - self.stiffness * self.gap
        self.touches = ufl.gt(self.pushed, 0)
        self.force = ufl.conditional(self.touches, self.pushed, 0)
        kinematics = scene.kinematics
        motion = kinematics.global_motion(
            space.present.get("global"), self._number(kinematics.lead(scales.length))
        )
        F = ufl.Identity(3) + kinematics.displacement_gradient(u, x, motion)
        self._cofactor = cofactor(F)[0]
        self.points = ContactPoints(mesh, self)
        self.friction = None
        if told.friction:
            self.friction = Friction(self, mesh, kinematics, space.present[traction_of(name)])

    def _seen_from_carrier(self, space: Unknowns, parts: Sequence[RigidPart], place: Any) -> Any:
        """A place as seen from the rigid part that carries the obstacle."""
        name = self.told.carrier
        part = next(part for part in parts if part.name == name)
        declared = self._scene.declared.rigid_surfaces
        surface = next(one for one in declared if one.surface == name)
        q = space.present[surface.field]
        return seen_from(part, surface.turns, q, place, self.told.along)

    def _number(self, value: float) -> Any:
        """A number as a constant of the form, so that another value needs no compilation."""
        return dolfinx.fem.Constant(self._mesh, float(value))

    def _stiffness(self, surface: TouchingSurface) -> Any:
        """r: moduli over the tolerance of the gap, constant in each cell.  Collective."""
        widths = surface.widths
        slender = np.maximum(surface.slenderness, LEAST_SLENDERNESS)
        self._yielding = np.minimum(FLAT_CELLS * slender**3, 1.0)
        self._tolerances = np.zeros(len(widths))
        given, cells = self.told.tolerance, self.facets[:, 0]
        self._tolerances[cells] = (
            TOLERANCE_BY_WIDTH * widths[cells] if given is None else given / self._scales.length
        )
        self._r = dolfinx.fem.Function(dolfinx.fem.functionspace(self._mesh, ("DG", 0)))
        self.take(self._scene.materials)
        return self._r

    def take(self, materials: Mapping[str, Material]) -> None:
        """Let r be that of some materials.  Collective."""
        for name, material in materials.items():
            cells = np.intersect1d(self._scene.device.cells_of(name), self.facets[:, 0])
            modulus = material.elastic.shear_modulus() / self._scales.stress
            stiff = MODULI_AT_TOLERANCE * modulus / self._tolerances[cells]
            self._r.x.array[cells] = self._yielding[cells] * stiff
        self._r.x.scatter_forward()

    def by_modulus(self, region: str) -> tuple[Any, np.ndarray, np.ndarray]:
        """The coefficient r, the local cells of a region where it is used, and dr/dmu in 1/Pa."""
        cells = np.intersect1d(self._scene.device.cells_of(region), self.facets[:, 0])
        by = MODULI_AT_TOLERANCE / self._tolerances[cells] / self._scales.stress
        return self._r, cells, self._yielding[cells] * by

    @property
    def fields(self) -> list[str]:
        """Names of its fields: the pressure, and with friction the tangential traction."""
        return [self.name, *([traction_of(self.name)] if self.friction else [])]

    @property
    def energy(self) -> Any:
        """The augmented Lagrangian per undeformed area."""
        return (self.force**2 - self.pressure**2) / (2 * self.stiffness)

    @property
    def traction(self) -> Any:
        """The force on the surface per undeformed area with that of friction, a 3-vector."""
        found = self.force * self.direction
        return found if self.friction is None else found + self.friction.traction

    def excess(self) -> tuple[float, float]:
        """The gap of a pressed point that exceeds its tolerance most, with this tolerance.

        In units of the device's length, for the present state; both are 0 where none does.
        Collective.
        """
        values = self.points.values()
        allowed = self.allowed(values.gap)
        gaps = np.where(values.pushed > 0, np.abs(values.gap), 0.0)
        over = gaps / allowed
        mine = (0.0, 0.0, 0.0)
        if over.size:
            k = int(np.argmax(over))
            mine = float(over.flat[k]), float(gaps.flat[k]), float(allowed.flat[k])
        worst = max(self._mesh.comm.allgather(mine))
        return worst[1:] if worst[0] > 1 else (0.0, 0.0)

    def allowed(self, gaps: np.ndarray) -> np.ndarray:
        """The tolerance of each gap at a point, of shape (facets, points)."""
        return np.broadcast_to(self._tolerances[self.facets[:, 0]][:, None], gaps.shape)

    def virtual_work(self, space: Unknowns) -> Any:
        """The variation of the augmented Lagrangian, and the virtual work of friction."""
        found = ufl.derivative(self.integral(self.energy), space.w, space.test)
        if self.friction is not None:
            found += self.friction.virtual_work(space.w, space.test)
        return found

    def work_of_travel(self, space: Unknowns) -> Any:
        """Minus the derivative of the virtual work by the factor of the obstacle's ramp."""
        rate = ufl.diff(self.energy, self._share)
        found = -ufl.derivative(self.integral(rate), space.w, space.test)
        if self.friction is not None:
            found += self.friction.rate(self._share, space.w, space.test)
        return found

    def area(self, normal: Any) -> Any:
        """Deformed area per undeformed area of a surface with a normal, in components of x."""
        vector = ufl.dot(self._cofactor, self._scene.kinematics.embed(normal))
        return ufl.sqrt(ufl.dot(vector, vector))

    def integral(self, density: Any) -> Any:
        """The integral of a density over the undeformed surface."""
        x = ufl.SpatialCoordinate(self._mesh)
        return density * self._scene.kinematics.weight(x) * self._ds

    def integrate_by(self, ds: Any, number: int) -> None:
        """Take the measure of the surface: a subdomain of that of a whole form."""
        self._ds = ds(number, metadata={"quadrature_degree": QUADRATURE_OF_CONTACT})


class Contacts(list[Contact]):
    """All surfaces of a problem that may touch an obstacle.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    surfaces
        The surfaces, each with what its obstacle declares.
    parts
        The rigid parts.
    """

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns,
        surfaces: Iterable[TouchingSurface] = (), parts: Sequence[RigidPart] = (),
    ) -> None:  # fmt: skip
        super().__init__(Contact(scene, scales, space, surface, parts) for surface in surfaces)
        self.frictions = Frictions(c.friction for c in self if c.friction is not None)

    def touching(self) -> np.ndarray:
        """Whether each point of integration of this rank is pressed in the present state.

        With friction there is a second value for each point: whether it is pressed and slides.
        """
        found = [np.empty(0, dtype=bool)]
        for contact in self:
            pressed = contact.points.values().pushed > 0
            found.append(pressed.ravel())
            if contact.friction is not None:
                found.append((pressed & contact.friction.slides()).ravel())
        return np.concatenate(found)

    @contextmanager
    def softened(self, factor: float) -> Iterator[None]:
        """Within the block r is multiplied by a factor.

        Equilibria hardly depend on r, but Newton's method converges from farther away with a
        smaller one where a slender device bends around an obstacle.
        """
        for contact in self:
            contact.softening.value = factor
        try:
            yield
        finally:
            for contact in self:
                contact.softening.value = 1.0
