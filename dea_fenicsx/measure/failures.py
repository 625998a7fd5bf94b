"""Ways in which a device fails, watched along the path: breakdown, loss of tension, stretch limit.

Each failure is judged at the worst quadrature point.  Pull-in, a fourth one, is a limit point of
the path.  See Zhao and Suo, Phys. Rev. B 76 (2007) 134113; Moscardo et al., J. Appl. Phys. 104
(2008) 093503.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import ufl

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import EquilibriumLost, InputError
from dea_fenicsx.support.type_checks import plain_numbers
from dea_fenicsx.support.validation import is_finite, known, positive


@dataclass(frozen=True)
class Worst:
    """The worst point of a state.

    Attributes
    ----------
    value : in the failure's unit
    margin : dimensionless, of order 1; positive before the failure
    region : name of the region
    place : undeformed position, m, shape (3,)
    """

    value: float
    margin: float
    region: str
    place: np.ndarray


@dataclass(frozen=True)
class WorstPoint:
    """The quadrature point of least margin.

    Attributes
    ----------
    region : name of the region
    is_here : whether this rank owns its cell
    cell, point : the local cell on that rank, and the number of the point in it
    local : the fields at it on all ranks; arrays start with (1, 1)
    """

    region: str
    is_here: bool
    cell: int
    point: int
    local: Local


class FailureMode(Protocol):
    """A way to fail.

    Attributes
    ----------
    name : the event's name
    column : column of the history and name of the cell field, unit appended
    """

    name: ClassVar[str]
    column: ClassVar[str]
    needs_stress: ClassVar[bool]

    def check(self, scene: Scene) -> None:
        """Raise InputError if it does not fit the scene."""
        ...

    def regions_of(self, scene: Scene) -> tuple[str, ...]:
        """Names of the regions that it watches."""
        ...

    def values(self, problem: Problem, region: str, local: Local) -> tuple[Any, Any]:
        """Value and margin at each point."""
        ...


@dataclass(frozen=True)
class Local:
    """Fields at quadrature points; arrays start with (cells, points).

    Attributes
    ----------
    F : deformation gradient, pre-stretch included
    J : its determinant
    field : true electric field, V/m
    stress : Cauchy stress, electrostatic part included, Pa; None where nothing needs it
    """

    F: np.ndarray
    J: np.ndarray
    field: np.ndarray
    stress: np.ndarray | None

    def at(self, point: int) -> Local:
        """The fields at one point of each cell."""
        F, J, field = (a[:, point : point + 1] for a in (self.F, self.J, self.field))
        return Local(F, J, field, None if self.stress is None else self.stress[:, [point]])


@dataclass(frozen=True)
@plain_numbers
class ElectricalBreakdown:
    """The true field reaches the dielectric's breakdown field; watched wherever one is given.

    The column is the ratio of the two.  A breakdown field that grows with the stretch takes the
    square root of the area stretch normal to the field, J |e| / |F^T e|.

    Parameters
    ----------
    safety
        Safety factor on the breakdown field.
    """

    safety: float = 1.0

    name: ClassVar[str] = "electrical breakdown"
    column: ClassVar[str] = "breakdown_ratio"
    needs_stress: ClassVar[bool] = False

    def check(self, scene: Scene) -> None:
        positive(self.safety, "The safety factor")
        if not self.regions_of(scene):
            raise InputError(
                "No dielectric of the scene has a breakdown field; give one as "
                "IdealDielectric(eps_r, breakdown=...) in V/m."
            )

    def regions_of(self, scene: Scene) -> tuple[str, ...]:
        return tuple(
            name for name, m in scene.materials.items()
            if m.is_dielectric and m.dielectric.breakdown_law() is not None
        )  # fmt: skip

    def values(self, problem: Problem, region: str, local: Local) -> tuple[Any, Any]:
        size = np.linalg.norm(local.field, axis=-1)
        pulled = np.linalg.norm(np.einsum("...ji,...j->...i", local.F, local.field), axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            area = np.where(pulled > 0, local.J * size / pulled, 1.0)
        electric = problem.parameters.materials[region].dielectric
        ratio = self.safety * size / electric.breakdown_field(np.sqrt(area))
        return ratio, 1 - ratio


@dataclass(frozen=True)
@plain_numbers
class LossOfTension:
    """The smaller principal stress in the plane of a membrane turns negative: it wrinkles.

    The column is that stress in Pa: the Cauchy stress, electrostatic part included, in the deformed
    tangent plane.

    Parameters
    ----------
    normal
        Axis normal to the undeformed film; left out where the kinematics is a membrane.
    regions
        Names of the regions to watch; all that are dielectric if empty.
    """

    normal: str = ""
    regions: tuple[str, ...] = ()

    name: ClassVar[str] = "loss of tension"
    column: ClassVar[str] = "tension_Pa"
    needs_stress: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        if scene.kinematics.is_membrane:
            if self.normal:
                raise InputError(
                    f"LossOfTension is given the normal {self.normal!r}, but a membrane has its "
                    "own normal everywhere; leave normal= out."
                )
        elif self.normal not in tuple(scene.kinematics.axes):
            raise InputError(
                f"The membrane's normal is {self.normal!r}, but must be one of the axes "
                f"{', '.join(scene.kinematics.axes)}."
            )
        _check_solid(self, scene)

    def regions_of(self, scene: Scene) -> tuple[str, ...]:
        active = tuple(n for n, m in scene.solids.items() if m.is_dielectric)
        return self.regions or active or tuple(scene.solids)

    def values(self, problem: Problem, region: str, local: Local) -> tuple[Any, Any]:
        assert local.stress is not None
        mu = problem.parameters.materials[region].elastic.shear_modulus()
        if problem.scene.kinematics.is_membrane:
            smaller = _smaller_tension(local.stress)
            return smaller, smaller / mu + 1e-8
        # F's rows and columns are (x, y, z), or (r, hoop, z) in axisymmetry
        kept = [a for a in range(3) if a != {"x": 0, "r": 0, "y": 1, "z": 2}[self.normal]]
        t1, t2 = local.F[..., :, kept[0]], local.F[..., :, kept[1]]
        t1 = t1 / np.linalg.norm(t1, axis=-1, keepdims=True)
        t2 = t2 - np.sum(t1 * t2, axis=-1, keepdims=True) * t1
        t2 = t2 / np.linalg.norm(t2, axis=-1, keepdims=True)
        a, b, c = (
            np.einsum("...i,...ij,...j", x, local.stress, y)
            for x, y in ((t1, t1), (t2, t2), (t1, t2))
        )
        smaller = (a + b) / 2 - np.sqrt(((a - b) / 2) ** 2 + c**2)
        # A stress-free film is not slack, although rounding errors may make its stress negative.
        return smaller, smaller / mu + 1e-8


def _smaller_tension(stress: np.ndarray) -> np.ndarray:
    """The smaller principal stress in the surface of a membrane, whose faces bear none.

    The stress has the eigenvalues s1, s2 and 0, so that s1 s2 is its second invariant.
    """
    mean = np.trace(stress, axis1=-2, axis2=-1) / 2
    square = np.einsum("...ij,...ji->...", stress, stress)
    product = (4 * mean**2 - square) / 2
    return mean - np.sqrt(np.maximum(mean**2 - product, 0.0))


@dataclass(frozen=True)
@plain_numbers
class StretchLimit:
    """The largest principal stretch reaches what the material bears; the column is that stretch.

    Parameters
    ----------
    stretch
        The limit.
    regions
        Names of the regions to watch; all if empty.
    """

    stretch: float
    regions: tuple[str, ...] = ()

    name: ClassVar[str] = "stretch limit"
    column: ClassVar[str] = "largest_stretch"
    needs_stress: ClassVar[bool] = False

    def check(self, scene: Scene) -> None:
        if not (is_finite(self.stretch) and self.stretch > 1):
            raise InputError(f"The stretch limit is {self.stretch!r}, but must be a number > 1.")
        _check_solid(self, scene)

    def regions_of(self, scene: Scene) -> tuple[str, ...]:
        return self.regions or tuple(scene.solids)

    def values(self, problem: Problem, region: str, local: Local) -> tuple[Any, Any]:
        largest = np.linalg.svd(local.F, compute_uv=False)[..., 0]
        return largest, 1 - largest / self.stretch


def _check_solid(failure: LossOfTension | StretchLimit, scene: Scene) -> None:
    """Raise InputError unless the named regions exist and are solid."""
    for name in failure.regions:
        known(name, scene.device.regions, "region")
        if scene.materials[name].is_air:
            raise InputError(
                f"{type(failure).__name__} is asked for in {name!r}, but this region is air; name "
                "solid regions."
            )
    if not scene.solids:
        raise InputError(f"{type(failure).__name__} needs a solid region, but all is air.")


class Gauge:
    """A failure bound to a problem.

    Parameters
    ----------
    failure
        What is watched.
    problem
        The discrete problem; its present state is measured.
    """

    def __init__(self, failure: FailureMode, problem: Problem) -> None:
        failure.check(problem.scene)
        self.failure, self.problem = failure, problem
        watched = failure.regions_of(problem.scene)
        device = problem.scene.device
        self.parts: list[tuple[str, np.ndarray, Callable]] = []
        for k, kernel in enumerate(problem.kernels):
            names = [n for n in kernel.regions if n in watched]
            if not names:
                continue
            s = problem.states[k]
            entries = [s.total[i, j] for i in range(3) for j in range(3)]
            entries += [s.J, *(s.true_field[i] for i in range(3))]
            if failure.needs_stress:
                sigma = problem.states[k].cauchy_stress
                entries += [sigma[i, j] for i in range(3) for j in range(3)]
            evaluate = compat.expression(ufl.as_vector(entries), problem.forms.quadrature)
            for name in names:
                cells = np.intersect1d(device.cells_of(name), kernel.cells)
                self.parts.append((name, cells, evaluate))

    def _local(self, cells: np.ndarray, evaluate: Callable) -> Local:
        problem = self.problem
        values = evaluate(problem.mesh, cells)
        shape = values.shape[:2]
        stress = None
        if self.failure.needs_stress:
            stress = values[..., 13:].reshape(*shape, 3, 3) * problem.scales.stress
        return Local(
            values[..., :9].reshape(*shape, 3, 3), values[..., 9],
            values[..., 10:13] * problem.scales.field, stress,
        )  # fmt: skip

    def _all(self) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
        """Region, cells, values and margins of every part on this rank.  Collective."""
        what = f"The failure {self.failure.name!r}"
        return together(self.problem.comm, lambda: [
            (name, cells,
             *self.failure.values(self.problem, name, self._local(cells, evaluate)))
            for name, cells, evaluate in self.parts if len(cells)
        ], what)  # fmt: skip

    def measure(self) -> tuple[Worst, np.ndarray]:
        """The point of least margin, and the worst value in each cell that this rank owns.

        Collective.  The cells' values are NaN where nothing is watched.
        """
        parts = self._all()
        by_cell = np.full(self.problem.scene.device.owned_cells(), np.nan)
        for _, cells, values, margins in parts:
            k = np.argmin(margins, axis=1)
            by_cell[cells] = np.take_along_axis(values, k[:, None], axis=1)[:, 0]
        return self._worst(parts), by_cell

    def margin(self) -> float:
        """Margin of the worst point.  Collective."""
        return self._worst(self._all()).margin

    def worst_point(self) -> WorstPoint:
        """Where the margin is least, and the fields there.  Collective."""
        best: tuple[float, str, int, int] = (np.inf, "", -1, -1)
        for name, cells, _, margins in self._all():
            k, q = np.unravel_index(int(np.argmin(margins)), margins.shape)
            if margins[k, q] < best[0]:
                best = float(margins[k, q]), name, int(cells[k]), int(q)
        comm = self.problem.comm
        owner = int(np.argmin([found[0] for found in comm.allgather(best)]))
        fields, (_, name, cell, point) = None, best
        if owner == comm.rank:
            evaluate = next(e for n, _, e in self.parts if n == name)
            fields = self._local(np.array([cell], dtype=np.int32), evaluate).at(point)
        local, region = comm.bcast((fields, name), root=owner)
        return WorstPoint(region, owner == comm.rank, cell, point, local)

    def _worst(self, parts: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]) -> Worst:
        problem = self.problem
        best: tuple[float, float, str, np.ndarray] = (np.inf, np.nan, "", np.zeros(3))
        for name, cells, values, margins in parts:
            k, q = np.unravel_index(int(np.argmin(margins)), margins.shape)
            if margins[k, q] < best[0]:
                place = np.zeros(3)
                x = problem.forms.prober.place_of(int(cells[k]), int(q))
                place[: len(x)] = x * problem.scales.length
                best = (float(margins[k, q]), float(values[k, q]), name, place)
        margin, value, name, place = min(
            problem.comm.allgather(best), key=lambda b: (b[0], *b[3])
        )
        return Worst(value, margin, name, place)


def default_failures(scene: Scene) -> tuple[FailureMode, ...]:
    """What is watched without being asked for.

    That is breakdown, where a breakdown field is known, and loss of tension of a membrane, which
    bears pressure in its surface on paper only, unless it is relaxed.
    """
    breakdown = ElectricalBreakdown()
    found: list[FailureMode] = []
    if scene.has_potential and breakdown.regions_of(scene):
        found.append(breakdown)
    if scene.kinematics.is_membrane and not scene.kinematics.wrinkles:
        found.append(LossOfTension())
    return tuple(found)


def pull_in(scene: Scene, error: EquilibriumLost, last: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The voltages between which equilibrium was lost, if electric ramps alone were moved."""
    if not error.ramps or not all(scene.is_electric(name) for name in error.ramps):
        return []
    entry: dict[str, Any] = {"mode": "pull-in", "step": last["step"]}
    for name in error.ramps:
        volts = scene.reference_voltage(name) or 1.0
        entry[f"{name}_V"] = error.reached[name] * volts
        entry[f"{name}_above_V"] = error.failed[name] * volts
    return [entry]
