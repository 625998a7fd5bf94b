"""Forces of a step that do exactly the work by which the energy of a body changes.

From the state 0 to the state 1, with C = F^T F, the stress of a step is the mean of the derivative
of the energy along the straight way from C_0 to C_1:

    S = 2 int_0^1 (d psi/dC)(C_s) ds,    C_s = (1 - s) C_0 + s C_1,
    psi(C) = W(C) + p (J(C) - 1) - 1/2 eps J(C) E_0 . C^-1 E_1,

and the internal forces are int F_m S : Grad v dX with the mean F_m = (F_0 + F_1)/2.  Since
F_m^T (F_1 - F_0) has the symmetric part (C_1 - C_0)/2, the work of the step is that by which psi
changes.  S is symmetric, so that the moment of the forces about the mean places vanishes.

Of the electric energy the two fields E_0 and E_1 are kept.  As both potentials obey Gauss's law in
their own state, its change is that of -1/2 eps J E . C^-1 E at constant voltage or charge.  The
pressure p is that of the step in incompressible regions, where the volume at both ends is that of
rest, so that it does no work.  In a region with a bulk modulus it is (p_0 + p_1)/2.

Loads on surfaces and body forces are the means along the straight way of the displacement.  The
mean is a sum over Gauss points, which is exact for the volume enclosed by a surface, and as exact
as rounding for other energies, unless a step strains the body by more than a tenth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import State
from dea_fenicsx.model.terms.dielectric import DielectricEnergy
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.scene.strain import Spectrum, StrainOf
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import InputError

GAUSS_POINTS_OF_STEP = 4
"""Number of Gauss points between the two states of a step, at which forces are averaged."""


class StrainOfC(StrainOf):
    """Invariants of a given C, see `StrainOf`."""

    def __init__(self, C: Any, scale: Any = 1) -> None:
        self.C = scale * C
        self._roots = Spectrum(self.C, scale**3 * ufl.det(C))

    def power_sum(self, alpha: Any) -> Any:
        return self._roots.power_sum(alpha / 2)


class _WayPoint:
    """A point of the material on the way of a step; what `EnergyTerm.density` asks of it.

    Parameters
    ----------
    at
        The material point at the end of the step.
    before
        Gives an expression in the state in which the step begins.
    s
        The place on the way.
    mixed
        Whether some region of the body has a bulk modulus.
    """

    def __init__(
        self, at: MaterialPoint, before: Callable[[Any], Any], s: Any, mixed: bool
    ) -> None:
        self.kernel = at.kernel
        self.per_stress, self.constant = at.per_stress, at.constant
        self.p = (before(at.p) + at.p) / 2 if mixed else at.p
        F_1 = at.F.ufl_operands[0]  # without the label of the variable
        F_0 = before(F_1)
        self.mean = (F_0 + F_1) / 2
        C = (1 - s) * ufl.dot(F_0.T, F_0) + s * ufl.dot(F_1.T, F_1)
        self.C = ufl.variable(C)
        self.J = ufl.sqrt(ufl.det(self.C))
        if self.kernel.is_incompressible:
            U = at.prestretch
            self.strain = StrainOfC(ufl.dot(U, ufl.dot(self.C, U)))
        else:
            self.strain = StrainOfC(self.C, self.J ** (-2 / 3))
        self.heated, self.swelling, self.elastic_J = at.heated, at.swelling, self.J
        self._fields = None
        if self.kernel.eps is not None:
            self._fields = before(at.nominal_field), at.nominal_field

    def stress(self, terms: Sequence[Any]) -> Any:
        """2 d psi/dC."""
        psi: Any = 0
        for term in terms:
            if term.lives_on(self.kernel):
                electric = isinstance(term, DielectricEnergy)
                psi += self._electric() if electric else term.density(self)
        return 2 * ufl.sym(ufl.diff(psi, self.C))

    def _electric(self) -> Any:
        assert self._fields is not None and self.kernel.eps is not None
        first, second = self._fields
        return -self.kernel.eps / 2 * self.J * ufl.dot(first, ufl.dot(ufl.inv(self.C), second))


class MeanForces:
    """The mean forces of a step and their derivative by its end.

    Parameters
    ----------
    problem
        The problem, whose present state is the end of the step.

    Attributes
    ----------
    rows
        Mask of the owned degrees of freedom on which these forces act.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        space, forms, w = problem.space, problem.forms, problem.w
        self.rows = np.zeros(problem.owned, dtype=bool)
        for part in problem.displacement:
            self.rows[part.dofs[part.dofs < problem.owned]] = True
        self._old = dolfinx.fem.Function(problem.W)
        self._factors: Mapping[str, float] = {}
        self._place = s = dolfinx.fem.Constant(problem.mesh, 0.0)
        mixed = any(not kernel.is_incompressible for kernel in forms.kernels)

        def before(expression: Any) -> Any:
            return ufl.replace(expression, {w: self._old})

        work: Any = 0
        for k, at in enumerate(forms.points):
            point = _WayPoint(at, before, s, mixed)
            rate = at.gradient_of_change(space.virtual["u"])
            force = ufl.dot(point.mean, point.stress(forms.terms))
            work += forms.integral(k, ufl.inner(force, rate))
        for outer in (forms.loads.work, forms.loads.standing):
            if not isinstance(outer, int):
                work -= ufl.replace(outer, {w: (1 - s) * self._old + s * w})
        self._form = compat.compile_form(work)
        slope = ufl.derivative(work, w, ufl.TrialFunction(problem.W))
        self._slope = compat.compile_form(slope)
        points, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS_OF_STEP)
        self._gauss = list(zip((1 + points) / 2, weights / 2, strict=True))

    def begin(self, old: State) -> None:
        """Take the state in which a step begins."""
        self._old.x.array[:] = old.values
        self._factors = old.factors

    def forces(self) -> np.ndarray:
        """The mean forces at all owned degrees of freedom, 0 outside of `rows`.  Collective."""
        found = np.zeros(self.problem.owned)
        for weight in self._ways():
            vector = dolfinx.fem.assemble_vector(self._form)
            vector.scatter_reverse(dolfinx.la.InsertMode.add)
            found += weight * vector.array[: self.problem.owned]
        return found

    def slope(self) -> Any:
        """Their derivative as a PETSc matrix, which the caller destroys.  Collective."""
        total = None
        for weight in self._ways():
            matrix = dolfinx.fem.petsc.assemble_matrix(self._slope)
            matrix.assemble()
            matrix.scale(weight)
            if total is None:
                total = matrix
            else:
                total.axpy(1.0, matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
                matrix.destroy()
        return total

    def _ways(self) -> Iterator[float]:
        """Go to each Gauss point, with the mean load, and yield its weight."""
        constants, now = self.problem.loads.constants, self.problem.factors
        for ramp, constant in constants:
            constant.value = (self._factors[ramp] + now[ramp]) / 2
        for place, weight in self._gauss:
            self._place.value = place
            yield weight
        for ramp, constant in constants:
            constant.value = now[ramp]


def check_conserving(scene: Scene) -> None:
    """Raise InputError if something of a scene has no forces of this kind."""
    declared, what = scene.declared, ""
    if any(m.viscous for m in scene.materials.values()):
        what = "viscous branches, which take energy"
    elif any(m.is_dielectric and not m.dielectric.is_ideal for m in scene.materials.values()):
        what = "a permittivity that changes with strain or field"
    elif any(m.is_air for m in scene.materials.values()):
        what = "air"
    elif any(m.damage is not None for m in scene.materials.values()):
        what = "a rubber that softens"
    elif scene.thermal_regions:
        what = "a temperature"
    elif declared.rigid_moments:
        what = "moments on rigid parts, whose work depends on the path"
    elif declared.contacts:
        what = "obstacles"
    elif declared.fillings:
        what = "cavities"
    elif declared.added:
        what = "energies and forces of your own"
    if what:
        raise InputError(
            f"The energy-conserving scheme is not available with {what}; leave them out, or take "
            'Inertia(scheme="generalised-alpha").'
        )
