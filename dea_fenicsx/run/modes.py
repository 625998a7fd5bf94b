"""Modes of vibration about the last state of a run.  Scripts call `modes`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Observable
from dea_fenicsx.measure.vibration import (
    Vibration,
    kept_charges,
    signed_hertz,
    vibration_solver,
    vibrations,
)
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_shapes import rigid_shapes
from dea_fenicsx.path.items import Response
from dea_fenicsx.results import hdf5, xdmf
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.spread import serving
from dea_fenicsx.support.agreement import check_same
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file
from dea_fenicsx.support.later import Later
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import is_whole, one_of

h5py = Later("h5py")

SHAPE_STEP = 1e-5
"""Largest displacement by which an observable is differentiated along a shape, over L."""


@dataclass(frozen=True)
class Modes:
    """Modes of vibration about an equilibrium, the lowest first; those that grow come first.

    Attributes
    ----------
    squares
        omega^2 of each in 1/s^2, negative for a motion that grows.
    errors
        Error of each omega^2 in 1/s^2, from the residual of K v - omega^2 M v.
    rigid_motions
        Number of rigid motions of a free body, whose frequency is 0.  They are not listed.
    shapes
        Shape of each as local values of the mixed function; the largest displacement is 1.
    masses
        Modal mass of each in kg, v . M v of its shape: with an amplitude A in m of the largest
        displacement its kinetic energy is M (omega A)^2/2.
    note
        What must be known of these modes, or empty.
    """

    squares: np.ndarray
    errors: np.ndarray
    rigid_motions: int
    shapes: Sequence[np.ndarray]
    masses: np.ndarray
    _problem: Problem
    note: str = ""

    def __len__(self) -> int:
        return len(self.squares)

    @property
    def frequencies(self) -> np.ndarray:
        """Frequencies in Hz; NaN for a motion that grows."""
        stable = np.where(self.squares >= 0, self.squares, np.nan)
        return np.asarray(np.sqrt(stable) / (2 * math.pi))

    @property
    def signed_frequencies(self) -> np.ndarray:
        """Frequencies in Hz; minus the growth rate over 2 pi for a motion that grows."""
        return np.array([signed_hertz(square) for square in self.squares])

    @property
    def growing(self) -> int:
        """How many of them grow, because the equilibrium is not stable."""
        return int(np.count_nonzero(self.squares < 0))

    @property
    def growth_rates(self) -> np.ndarray:
        """Rates in 1/s at which those motions grow that do, the fastest first."""
        return np.asarray(np.sqrt(-self.squares[self.squares < 0]))

    @property
    def stable(self) -> bool:
        """Whether none of them grows."""
        return self.growing == 0

    def __str__(self) -> str:
        rows = [
            f"{k:3}  {abs(f):.8g} " + ("Hz" if f >= 0 else "Hz of growth (not stable)")
            for k, f in enumerate(self.signed_frequencies)
        ]
        if self.rigid_motions:
            rows.append(f"{self.rigid_motions} rigid motions of a free body are not listed")
        if self.note:
            rows.append(self.note)
        return "\n".join(rows)

    def derivative(self, observable: Observable, number: int) -> float:
        """Derivative of an observable by the amplitude of a mode.  Collective.

        The amplitude is the largest displacement in m.  So the derivative of a displacement is a
        number of at most 1, which tells modes of different kinds apart.

        Raises
        ------
        InputError
            If there is no mode of this number.
        """
        self._check(number)
        problem = self._problem
        measure, state, found = observable.bind(problem), problem.state, []
        for step in (SHAPE_STEP, -SHAPE_STEP):
            with problem.at(state.with_values(state.values + step * self.shapes[number])):
                found.append(measure())
        return (found[0] - found[1]) / (2 * SHAPE_STEP * problem.scales.length)

    def share(self, axis: str, number: int) -> float:
        """Share of a mode's kinetic energy that is due to the motion along an axis.  Collective.

        Raises
        ------
        InputError
            If there is no such axis, or no mode of this number.
        """
        problem = self._problem
        axes = tuple(problem.scene.kinematics.axes)
        one_of(axis, axes, "The axis")
        self._check(number)
        shape, mass = self.shapes[number], problem.massive()
        along = np.zeros_like(shape)
        part = problem.displacement[axes.index(axis)]
        along[part.dofs] = shape[part.dofs]
        mine = [values[: problem.owned] for values in (along, shape)]
        works = np.array([values @ mass.times(values) for values in mine])
        total = problem.comm.allreduce(works, op=MPI.SUM)
        return float(total[0] / total[1])

    def _check(self, number: int) -> None:
        """Raise InputError if there is no mode of a number."""
        if not is_whole(number, 0) or number >= len(self):
            raise InputError(
                f"There is no mode of the number {number!r}; there are {len(self)}, counted from 0."
            )

    def write(self, folder: str | Path) -> Path:
        """Write the shapes for ParaView into a folder: modes.xdmf and modes.h5.  Collective.

        Each mode is one time of the series, with its number as the time.  It has the displacement
        of the equilibrium, and the shape, whose largest displacement is 1.
        """
        writer, problem = FieldWriter(self._problem), self._problem
        nodes = writer.node_fields()
        shapes = [writer.vector(shape) for shape in self.shapes]
        place = Path(folder)

        def put() -> None:
            place.mkdir(parents=True, exist_ok=True)
            self._put(place, writer.grid, nodes or {}, shapes)

        serving(problem.comm, put)
        problem.comm.barrier()
        return place / "modes.xdmf"

    def _put(self, folder: Path, grid: Any, nodes: dict[str, np.ndarray], shapes: Any) -> None:
        """Write the files on rank 0."""

        def fill(h5: Any) -> None:
            hdf5.put_grid(h5.create_group("grid"), grid)
            for k, shape in enumerate(shapes):
                fields = {**nodes, "mode": shape, "frequency_Hz": np.full(
                    len(grid.points), self.signed_frequencies[k]
                )}  # fmt: skip
                hdf5.put_fields(h5.create_group(f"mode_{k:03}"), fields, {})

        def make(target: Path) -> None:
            with h5py.File(target, "w") as h5:
                fill(h5)

        file = folder / "modes.h5"
        replace_file(file, make)
        grids = "".join(
            xdmf.grid_xml(
                f"mode {k}: {f:.6g} Hz", float(k), (file, "grid/"), (file, f"mode_{k:03}/"), folder
            )
            for k, f in enumerate(self.signed_frequencies)
        )
        text = xdmf.document(grids, "modes")
        replace_file(folder / "modes.xdmf", lambda target: target.write_text(text, "utf-8"))


def modes(
    run: Run,
    count: int = 10,
    response: Response = "instantaneous",
    out: str | Path | None = None,
) -> Modes:
    """Modes of vibration about the last accepted state of a run, the lowest first.  Collective.

    Voltages are given, and so is the charge of an electrode that floats.  Charge that has leaked,
    delayed polarisation and charge behind a resistance stay as they are, which `Modes.note` then
    says: vibrations are undamped ones, much faster than what depends on the past.  Each region
    needs a density.  Modes are found about any equilibrium: where it is not stable, those that grow
    come first and have a negative omega^2.  Their linear systems are solved to 1e-11, and vectors
    keep the volume of the cells and the electric equations to the same precision.

    Parameters
    ----------
    run
        The run, whose last state is an equilibrium.
    count
        How many modes are wanted.
    response
        How viscous branches take part: ``"instantaneous"`` (their viscous strains stay as they are,
        so that the stiffness is the largest), or ``"relaxed"`` (they carry no stress; the state
        must be a relaxed one).
    out
        A folder for modes.xdmf with the shapes; None writes nothing.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        If a region has no density, there are fewer modes, the tangent is not symmetric, or charges
        would have to relax.
    SolverError
        If the run has not ended in equilibrium, or a linear system cannot be solved.
    """
    problem = checked_problem(run, "modes")
    check_same(problem.comm, {"count": count, "response": response})
    solver = vibration_solver(problem)
    found = vibrations(solver, count, response)
    scaled = [_scaled(problem, vibration) for vibration in found]
    modes = Modes(
        np.array([v.square for v in found]),
        np.array([v.residual for v in found]),
        rigid_shapes(problem).shape[1],
        [shape for shape, _ in scaled],
        np.array([mass for _, mass in scaled]),
        problem,
        kept_charges(problem),
    )
    if out is not None:
        modes.write(out)
    return modes


def checked_problem(run: Run, what: str) -> Problem:
    """The problem of a run in its last accepted state."""
    if not isinstance(run, Run):
        raise InputError(f"{what} needs a Run, as dea.solve gives it, but got {shown(run)}.")
    if not run.history:
        raise InputError(f"{what} needs a run with an accepted step, but this one has none.")
    return run.problem


def _scaled(problem: Problem, vibration: Vibration) -> tuple[np.ndarray, float]:
    """A shape whose largest displacement is 1, and its modal mass in kg.  Collective.

    The sign is such that the component of largest size along the shape is the same on any number
    of ranks.
    """
    shape = vibration.shape
    largest, compass = 0.0, 0.0
    squares: Any = 0.0
    for part in problem.displacement:
        x = part.space.tabulate_dof_coordinates()
        squares = squares + shape[part.dofs] ** 2
        mine = part.dofs < problem.owned
        compass += float(shape[part.dofs[mine]] @ (1 + x[mine] @ (0.37, 0.61, 0.83)))
    largest = problem.comm.allreduce(float(np.max(squares, initial=0.0)), op=MPI.MAX) ** 0.5
    if problem.comm.allreduce(compass, op=MPI.SUM) < 0:
        largest = -largest
    scales = problem.scales
    unit = scales.stress * scales.length * scales.depth  # N/m, times s^2 is kg
    return shape / largest, unit / largest**2
