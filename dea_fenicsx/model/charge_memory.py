"""What a problem remembers of leaked charge and of wires, and how the forms know of it."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.electric import Conductivity
from dea_fenicsx.model.charge_history import (
    FIELD,
    NUMBERS,
    RATE,
    TOTAL,
    ChargeHistory,
    bend_weight,
    delay_weights,
    polarised,
    swell,
)
from dea_fenicsx.model.kernels import BoundDebye, Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.memory import KEPT_TIMES
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.viscous_history import Rule
from dea_fenicsx.support import compat
from dea_fenicsx.support.errors import InputError

SMALLEST_DISPLACEMENT = 1e-9
"""Root mean square of T, dimensionless, below which errors of T are not compared with T."""


class LeakMemory:
    """The charge that has leaked through the dielectrics of a problem, at quadrature points.

    Parameters
    ----------
    kernels, points
        Regions that share one integral, and for each the fields at a point, symbolic.
    quadrature
        Quadrature points of the reference cell.
    scales
        The units.

    Attributes
    ----------
    delayed
        Largest number of delayed polarisations of a region.
    alike
        Whether all dielectrics have one constant omega = g/eps.  Then the rows of the potential
        are divided by psi, so that the tangent stays symmetric.
    psi
        What these rows are divided by in the present state; 1 unless `alike`.
    """

    def __init__(
        self, mesh: Any, kernels: Sequence[Kernel], points: Sequence[MaterialPoint],
        quadrature: np.ndarray, scales: Scales,
    ) -> None:  # fmt: skip
        pairs = [(k, p) for k, p in zip(kernels, points, strict=True) if k.leak is not None]
        self._bound = pairs[0][0].leak if pairs else None
        imap = mesh.topology.index_map(mesh.topology.dim)
        self._mesh, self._field = mesh, scales.field
        self._cells = imap.size_local + imap.num_ghosts
        self.points = len(quadrature) if pairs else 0
        self._relaxing = [kernel for kernel in kernels if kernel.relaxation]
        self.delayed = max((len(k.relaxation) for k in self._relaxing), default=0)
        self.alike, self.psi = True, 1.0
        self._materials: Callable[[], Mapping[str, Material]] = dict
        self._cells_of: Callable[[str], np.ndarray] = lambda region: np.empty(0, np.int32)
        self._evaluated = [
            (kernel, compat.expression(
                ufl.as_vector([
                    *(point.displacement_field[i] for i in range(3)),
                    ufl.sqrt(ufl.dot(point.true_field, point.true_field)),
                ]), quadrature,
            ))
            for kernel, point in pairs
        ]  # fmt: skip

    def __bool__(self) -> bool:
        return self._bound is not None

    @property
    def numbers(self) -> int:
        """Numbers at a quadrature point."""
        return NUMBERS + 3 * self.delayed

    def take(
        self, materials: Callable[[], Mapping[str, Material]],
        cells_of: Callable[[str], np.ndarray], alike: bool,
    ) -> None:  # fmt: skip
        """Take what gives the materials with their present constants, and the cells of a region."""
        self._materials, self._cells_of, self.alike = materials, cells_of, alike

    def _laws(self) -> Iterator[tuple[str, Conductivity, float]]:
        """The conductivity and the permittivity in F/m of each dielectric region."""
        for region, material in self._materials().items():
            if material.is_dielectric:
                law = material.dielectric.conductivity_law() or Conductivity(0.0)
                yield region, law, material.dielectric.permittivity()

    def at_rest(self) -> np.ndarray:
        """The numbers at quadrature points in the body without field; see `ChargeHistory`."""
        found = np.zeros((self._cells, self.points, self.numbers))
        if self:
            found[..., RATE] = self._rates(np.zeros((self._cells, self.points)))
        return found

    def _rates(self, strength: np.ndarray) -> np.ndarray:
        """omega in 1/s for the strength of the true field, dimensionless."""
        found = np.zeros_like(strength)
        for region, law, eps in self._laws():
            cells = self._cells_of(region)
            found[cells] = law.at(strength[cells] * self._field) / eps
        return found

    def show(self, history: ChargeHistory) -> None:
        """Put the history of a state into the coefficients of the forms."""
        self.psi = 1.0
        if self._bound is None:
            return
        begin = history.leaks[history.begin]
        z = history.rate() * history.whole_span
        if self.alike:
            z = np.full_like(z, self._one_rate() * history.whole_span)
        psi = swell(z)
        H = self._without_delay(begin) - (np.exp(-z) * psi)[..., None] * begin[..., FIELD]
        if self.alike:
            one = swell(np.array(self._one_rate() * history.whole_span))
            self.psi = float(one)
            H, psi = H / self.psi, np.ones_like(psi)
        self._bound.history.x.array[:] = H.ravel()
        self._bound.excess.x.array[:] = (psi - 1).ravel()
        for kernel in self._relaxing:
            for k, term in enumerate(kernel.relaxation):
                self._show_delay(k, term, begin, history.whole_span)

    def _without_delay(self, numbers: np.ndarray) -> np.ndarray:
        """T without the delayed polarisations."""
        total = numbers[..., TOTAL]
        return total - sum((numbers[..., polarised(k)] for k in range(self.delayed)), 0 * total)

    def _show_delay(self, k: int, term: BoundDebye, begin: np.ndarray, span: float) -> None:
        """Put the history of a delayed polarisation of a kernel into its coefficients."""
        tau = term.tau.x.array
        here = tau > 0
        old, field, new = delay_weights(span / tau[here])
        term.share.x.array[here] = new
        ratio = self._ratio(term)[here]
        H = term.history.x.array.reshape(self._cells, self.points, 3)
        H[here] = (
            old[:, None, None] * begin[here][..., polarised(k)]
            + (field * ratio)[:, None, None] * begin[here][..., FIELD]
        )

    def _ratio(self, term: BoundDebye) -> np.ndarray:
        """The permittivity of a term over the one at once, in each cell."""
        eps = np.ones(self._cells)
        for kernel, _ in self._evaluated:
            if term in kernel.relaxation and kernel.eps is not None:
                eps = np.where(kernel.eps.x.array > 0, kernel.eps.x.array, 1.0)
        return np.asarray(term.eps.x.array / eps)

    def delay_error(self, span: float, bend: np.ndarray) -> np.ndarray:
        """What the delayed polarisations miss over a step.

        Parameters
        ----------
        span
            Length of the step in s.
        bend
            Second time derivative of D.
        """
        missed = np.zeros((self._cells, self.points, 3))
        for kernel in self._relaxing:
            for term in kernel.relaxation:
                tau = term.tau.x.array
                here = tau > 0
                weight = span**2 * bend_weight(span / tau[here]) * self._ratio(term)[here]
                missed[here] += weight[:, None, None] * np.abs(bend[here])
        return missed

    def _one_rate(self) -> float:
        """The constant omega that all dielectrics have."""
        rates = {float(law.at(0.0) / eps) for _, law, eps in self._laws()}
        if len(rates) > 1:
            raise InputError(
                "The dielectrics had one ratio of conductivity to permittivity when the problem "
                "was built, and now have several; build the scene anew with these constants."
            )
        return rates.pop()

    def now(self) -> np.ndarray:
        """The numbers at quadrature points in the present state, whose history is shown."""
        found = np.zeros((self._cells, self.points, self.numbers))
        if self._bound is None:
            return found
        strength = np.zeros((self._cells, self.points))
        for kernel, evaluate in self._evaluated:
            if len(kernel.cells):
                values = evaluate(self._mesh, kernel.cells)
                values = values.reshape(len(kernel.cells), self.points, 4)
                found[kernel.cells, :, FIELD] = values[..., :3]
                strength[kernel.cells] = values[..., 3]
        H = self._bound.history.x.array.reshape(self._cells, self.points, 3)
        psi = 1 + self._bound.excess.x.array.reshape(self._cells, self.points)
        found[..., TOTAL] = self.psi * (psi[..., None] * found[..., FIELD] + H)
        found[..., RATE] = self._rates(strength)
        for kernel in self._relaxing:
            for k, term in enumerate(kernel.relaxation):
                here = term.tau.x.array > 0
                weight = (term.share.x.array * self._ratio(term))[here]
                late = term.history.x.array.reshape(self._cells, self.points, 3)[here]
                late = late + weight[:, None, None] * found[here][..., FIELD]
                found[here, :, polarised(k)] = late
                found[here, :, TOTAL] += late
        return found


class ChargeMemory:
    """The charges of a problem that depend on the past: leaked ones, and those in wires.

    Parameters
    ----------
    problem
        The problem, whose forms are compiled.  Its scene keeps charges.
    """

    NAME = "charge"

    def __init__(self, problem: Any) -> None:
        # A problem must go without waiting for a collector of cycles, on all ranks at once.
        self._of = weakref.ref(problem)
        self.leaks: LeakMemory = problem.forms.leaks
        self.circuits = problem.conditions.circuits
        self._profiles: list[tuple[np.ndarray, np.ndarray]] | None = None

    @property
    def _problem(self) -> Any:
        problem = self._of()
        assert problem is not None
        return problem

    def __bool__(self) -> bool:
        return bool(self.leaks) or bool(self.circuits)

    @property
    def columns(self) -> int:
        """Numbers in each cell at each time."""
        return self.leaks.points * self.leaks.numbers

    def at_rest(self) -> ChargeHistory:
        """The history of a body that has never been charged."""
        return ChargeHistory(
            (self.leaks.at_rest(),), (np.zeros(len(self.circuits.names)),), (0.0,),
            self.circuits.closed_at_first,
        )  # fmt: skip

    def show(self, history: ChargeHistory) -> None:
        """Put the history of a state into the forms and the circuits."""
        self.leaks.show(history)
        self._problem.forms.sheets.show(history, self.leaks.psi)
        self.circuits.show(history, 1 / self.leaks.psi)

    def wires(self) -> np.ndarray:
        """The charge in C that has come through each electrode's wire.  Collective.

        It is minus the derivative of the energy by the electrode's potential.
        """
        problem = self._problem
        if self._profiles is None:
            self._profiles = self._profiles_of_electrodes()
        residual = problem.residual()
        unit = problem.scales.charge * self.leaks.psi
        mine = np.zeros((3, len(self._profiles)))
        mine[0] = [-unit * (residual[dofs] @ share) for dofs, share in self._profiles]
        for k, charge in self.circuits.charges(problem.w.x.array, problem.factors).items():
            mine[1:, k] = 1.0, charge
        found, known, charges = problem.comm.allreduce(mine, op=MPI.SUM)
        return np.asarray(np.where(known > 0, charges, found))

    def _profiles_of_electrodes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Owned degrees of freedom of each electrode, and its profile there."""
        problem = self._problem
        part, scene = problem.potential, problem.scene
        X = part.space.tabulate_dof_coordinates() * scene.device.length
        place = np.full(problem.size, -1)
        place[part.dofs] = np.arange(len(part.dofs))
        found = []
        for electrode in scene.electrodes:
            dofs = problem.conditions.electrode_dofs[electrode.label]
            dofs = dofs[dofs < problem.owned]
            found.append((dofs, electrode.profile(scene.kinematics, X[place[dofs]])))
        return found

    def settled(self, history: ChargeHistory, time: float) -> ChargeHistory:
        """The history after the problem's present state has been accepted at a time in s.

        Collective.
        """
        if history.span == 0:
            return history
        new, past = self.leaks.now(), history.begin
        wires = self.wires()
        if not history.passes_time:
            return self._one_level(history, new, wires, time)
        return replace(
            history, leaks=(new, *history.leaks[past:])[:KEPT_TIMES],
            wires=(wires, *history.wires[past:])[:KEPT_TIMES],
            times=(time, *history.times[past:])[:KEPT_TIMES], span=0.0, rule=Rule.BDF2,
        )  # fmt: skip

    def refreshed(self, history: ChargeHistory, time: float) -> ChargeHistory:
        """The history after changes in no time, without earlier values.  Collective.

        The problem is in the state that belongs to it.
        """
        new = self.leaks.now()
        return self._one_level(history, new, self.wires(), time)

    @staticmethod
    def _one_level(
        history: ChargeHistory, leaks: np.ndarray, wires: np.ndarray, time: float
    ) -> ChargeHistory:
        return replace(
            history, leaks=(leaks,), wires=(wires,), times=(time,), span=0.0, rule=Rule.BDF2
        )

    def staged(self, history: ChargeHistory, time: float) -> ChargeHistory:
        """The history with the end of the first stage of SDIRK2 as its newest level.  Collective.

        The problem is in the state at that end.
        """
        new = self.leaks.now()
        return replace(
            history, leaks=(new, *history.leaks), wires=(self.wires(), *history.wires),
            times=(time, *history.times), rule=Rule.STAGE,
        )  # fmt: skip

    # ------------------------------------------------------------- errors

    def leak_error(
        self, times: Sequence[float], leaks: Sequence[np.ndarray], span: float
    ) -> float:
        """Error of D over the newest step over the root mean square of T.  Collective.

        Parameters
        ----------
        times, leaks
            Three times in s, the newest first, with the numbers at quadrature points.
        span
            Length of the step in s.
        """
        if not self.leaks or len(times) < 3:
            return 0.0
        bend = span**2 * _bend(times, [level[..., TOTAL] for level in leaks])
        missed = np.abs(bend_weight(leaks[0][..., RATE] * span)[..., None] * bend)
        missed += self.leaks.delay_error(span, _bend(times, [lv[..., FIELD] for lv in leaks]))
        return self._size(missed) / max(self._size(leaks[0][..., TOTAL]), SMALLEST_DISPLACEMENT)

    def _size(self, vectors: np.ndarray) -> float:
        """Root mean square over the body, weighted by the volumes of cells.  Collective."""
        forms = self._problem.forms
        squares = (vectors[: len(forms.cell_volumes)] ** 2).sum(axis=-1).mean(axis=-1)
        mine = float((forms.cell_volumes * squares).sum())
        return float(np.sqrt(self._problem.comm.allreduce(mine, op=MPI.SUM) / forms.volume))

    @property
    def has_sheets(self) -> bool:
        """Whether charge flows along electrodes."""
        return bool(self._problem.forms.sheets)

    def sheet_error(self, wrong: np.ndarray, total: np.ndarray) -> float:
        """An error of T by charge that flows along electrodes, over T.  Collective."""
        return self._size(wrong) / max(self._size(total), SMALLEST_DISPLACEMENT)

    def wire_error(self, wrong: np.ndarray, wires: np.ndarray) -> float:
        """The largest error of a charge in a wire with a resistor, over that charge."""
        resisted = [w for w in self.circuits.wires if not w.is_ideal]
        sizes = [abs(wrong[w.number]) / abs(wires[w.number]) for w in resisted
                 if wires[w.number] != 0]  # fmt: skip
        return float(max(sizes, default=0.0))


def _bend(times: Sequence[float], values: Sequence[np.ndarray]) -> np.ndarray:
    """Second time derivative of the parabola through three values."""
    h, h1 = times[0] - times[1], times[1] - times[2]
    first, second = (values[0] - values[1]) / h, (values[1] - values[2]) / h1
    return np.asarray(2 * (first - second) / (h + h1))
