"""What is derived by: constants of materials, loads, pre-stretches, and changes of shape."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.gradients.shapes import (
    THICKNESS,
    Velocity,
    check_shape,
    moved_nodes,
    thickness,
)
from dea_fenicsx.mesh.cell_middles import at_middles
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.scene.prescribed import PreStretch
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, shown
from dea_fenicsx.support.validation import known

PRESTRETCH = "prestretch"
"""The word before the first colon in ``"prestretch:film:x"``."""


@dataclass(frozen=True)
class ShapeChange:
    """A change of the undeformed shape: each point X moves to X + p velocity(X).

    Parameters
    ----------
    name
        What the derivative is called, such as ``"radius"``.
    velocity
        The change of the position for p = 1: from the positions in m, shape (n, 3), to as many
        vectors.  It is evaluated at the nodes of the mesh.  With p in m, the vectors are pure
        numbers.
    """

    name: str
    velocity: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ConstantChange:
    """A change of constants of materials that varies with the place.

    Parameters
    ----------
    name
        What the derivative is called.
    rates
        For each constant, such as ``"film.elastic.mu"``, its change for p = 1: from the positions
        of the cells' middles in m, shape (n, 3), to n numbers in the unit of the constant.
    """

    name: str
    rates: Mapping[str, Callable[[np.ndarray], np.ndarray]]


Told = str | ShapeChange | ConstantChange
"""How a user names a variable."""


@dataclass(frozen=True)
class Coefficients:
    """A variable that the forms hold in cell-wise coefficients.

    Attributes
    ----------
    name
        Its name.
    changes
        For each coefficient the local cells where it changes, and its change for a unit of the
        variable: a number, or one for each of these cells.
    value
        Its present value, in SI units.
    """

    name: str
    changes: tuple[tuple[Any, np.ndarray, Any], ...]
    value: float


@dataclass(frozen=True)
class LoadVariable:
    """The factor of a ramp, or the voltage in V that it drives.

    Attributes
    ----------
    name
        Its name.
    ramp
        The ramp.
    unit
        Value of the variable at factor 1: V, or 1.
    """

    name: str
    ramp: str
    unit: float


@dataclass(frozen=True)
class Shape:
    """A change of shape.

    Attributes
    ----------
    name
        Its name.
    velocity
        Velocity of the nodes, in units of the device's size for a unit of the variable.
    """

    name: str
    velocity: Velocity


Variable = Coefficients | LoadVariable | Shape


@contextmanager
def larger(problem: Problem, one: Variable, step: float) -> Iterator[None]:
    """Let a constant of a material, or the shape, be larger by a step.  Collective.

    A load is no part of the problem, but of a state.
    """
    if isinstance(one, Shape):
        with moved_nodes(problem, one.velocity, step):
            yield
        return
    changes = one.changes if isinstance(one, Coefficients) else ()
    kept = [c.x.array.copy() for c, _, _ in changes]
    try:
        for coefficient, cells, rate in changes:
            coefficient.x.array[cells] += step * rate
        yield
    finally:
        for (coefficient, _, _), values in zip(changes, kept, strict=True):
            coefficient.x.array[:] = values


def variables(
    problem: Problem, to: Iterable[Told], replayed: bool = False
) -> list[Variable]:
    """The variables of some names.  Collective.

    Where a march is `replayed`, constants count that no form holds.

    Raises
    ------
    InputError
        For a name that there is not, and for a variable without a derivative in this scene.
    """
    if isinstance(to, Told):
        to = [to]
    found = [_variable(problem, one, replayed) for one in to]
    names = [one.name for one in found]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"to= names {twice[0]!r} more than once; name each variable once.")
    if not found:
        raise InputError("to= names no variable; name at least one, such as 'voltage'.")
    return found


def names_of(problem: Problem) -> list[str]:
    """All names that `variables` knows, but for a choice of axes."""
    return [
        *problem.parameters,
        *problem.scene.ramps,
        *(f"{THICKNESS}:{region}" for region in problem.scene.device.regions),
        *(f"{PRESTRETCH}:{region}:{axis}" for region, axis in _stretched(problem)),
    ]


def _variable(problem: Problem, told: Told, replayed: bool) -> Variable:
    if isinstance(told, ShapeChange):
        check_declared(told)
        check_shape(problem, told.name)
        return Shape(told.name, _in_units(problem, told))
    if isinstance(told, ConstantChange):
        check_declared(told)
        return _varying(problem, told)
    if not isinstance(told, str):
        raise InputError(
            f"to= holds {shown(told)}, but must hold names of variables, such as 'voltage'."
        )
    first, _, rest = told.partition(":")
    if first == THICKNESS and rest:
        check_shape(problem, told)
        region, _, axis = rest.partition(":")
        inner, length = thickness(problem, region, axis or None), problem.scales.length
        return Shape(told, lambda X: inner(X) / length)
    if told in problem.scene.ramps:
        return LoadVariable(told, told, problem.scene.unit_volts.get(told, 0.0) or 1.0)
    known(told, names_of(problem), "variable", "the run")
    if first == PRESTRETCH:
        return _prestretch(problem, told, *rest.split(":"))
    coefficient = problem.parameters.coefficient(told)
    if coefficient is None and replayed:
        return Coefficients(told, (), problem.parameters[told])
    if coefficient is None:
        raise InputError(
            f"{told!r} has no derivative here, because the branch is solved for at each quadrature "
            "point; only Maxwell branches have their constants in the forms."
        )
    changes = (coefficient, *_of_contacts(problem, told))
    return Coefficients(told, changes, problem.parameters[told])


def _of_contacts(problem: Problem, name: str) -> list[tuple[Any, np.ndarray, Any]]:
    """How the stiffness of contacts, which follows the shear modulus, changes with a constant."""
    contacts = list(problem.forms.contacts)
    rate = problem.parameters.modulus_rate(name) if contacts else 0.0
    if not rate:
        return []
    each = [contact.by_modulus(name.split(".")[0]) for contact in contacts]
    return [(r, cells, rate * slopes) for r, cells, slopes in each]


def _varying(problem: Problem, told: ConstantChange) -> Coefficients:
    """A change of constants that varies with the place.  Collective."""
    device, changes, least = problem.scene.device, [], np.inf
    for name, rate in told.rates.items():
        known(name, problem.parameters, "constant", "the problem")
        found = problem.parameters.coefficient(name)
        if found is None:
            raise InputError(f"{name!r} has no derivative by {told.name!r}; only Maxwell branches "
                             "have their constants in the forms.")  # fmt: skip
        coefficient, cells, _ = found
        what = f"The rate of {name!r} in the change {told.name!r}"
        rates = problem.parameters.unit(name) * at_middles(device, cells, rate, what)
        moved = rates != 0
        changes.append((coefficient, cells[moved], rates[moved]))
        sizes = np.abs(coefficient.x.array[cells[moved]] / rates[moved])
        least = min(least, float(sizes.min(initial=np.inf)))
    least = problem.comm.allreduce(least, op=MPI.MIN)
    return Coefficients(told.name, tuple(changes), least if np.isfinite(least) else 1.0)


def _in_units(problem: Problem, told: ShapeChange) -> Velocity:
    """The velocity of a user's change of shape, checked, in units of the device's size."""
    length, what = problem.scales.length, f"The velocity of the change of shape {told.name!r}"

    def checked(X: np.ndarray) -> np.ndarray:
        try:
            found = np.asarray(told.velocity(X * length), dtype=float)
        except Exception as error:  # the function is the user's own
            why = " ".join(str(error).split()).rstrip(".")
            raise InputError(f"{what} cannot be found ({type(error).__name__}: {why}).") from error
        if found.shape != X.shape or not np.isfinite(found).all():
            raise InputError(
                f"{what} gives an array of shape {found.shape} for {len(X)} points, but must give "
                f"finite numbers of shape {X.shape}."
            )
        return found / length

    def velocity(X: np.ndarray) -> np.ndarray:
        return together(problem.comm, lambda: checked(X), what)

    return velocity


def _stretched(problem: Problem) -> list[tuple[str, str]]:
    """Regions with a pre-stretch, each with the axes along which it is given."""
    return [
        (region, axis)
        for item in problem.scene.declared.initial_stretches
        for region in item.regions
        for axis in _given_axes(_prestretch_of(problem, region))
    ]


def _prestretch_of(problem: Problem, region: str) -> PreStretch:
    return next(
        item for item in problem.scene.prescribed
        if isinstance(item, PreStretch) and region in item.names
    )  # fmt: skip


def _given_axes(item: PreStretch) -> list[str]:
    """The axes whose stretch may change.  Of three that are given, that along z follows."""
    given = [axis for axis in "xyzr" if getattr(item, axis) is not None]
    return given[:2] if len(given) == 3 else given


def _prestretch(problem: Problem, name: str, region: str, axis: str) -> Coefficients:
    """A pre-stretch along an axis; the stretch that is not given follows by constant volume."""
    item = _prestretch_of(problem, region)
    value = float(getattr(item, axis))
    # Slopes of the logarithms of the three stretches by the logarithm of this one.
    if problem.scene.kinematics.cartesian:
        a = "xyz".index(axis)
        follows = next(k for k in range(3) if "xyz"[k] not in _given_axes(item))
        slopes = np.zeros(3)
        slopes[[a, follows]] = 1.0, -1.0
    else:
        slopes = np.array([1.0, 1.0, -2.0] if axis == "r" else [-0.5, -0.5, 1.0])
    kernel = next(k for k in problem.kernels if region in k.regions)
    _, logarithms = kernel.prestretch[item.ramp]
    cells = problem.scene.device.cells_of(region)
    changes = [
        (logarithm, cells, slope / value)
        for logarithm, slope in zip(logarithms, slopes, strict=True)
        if slope
    ]
    return Coefficients(name, tuple(changes), value)
