"""Checks of the arguments of `solve`, before anything is computed."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict, get_args

import numpy as np

from dea_fenicsx.measure.failures import FailureMode
from dea_fenicsx.model.contact import MODULI_AT_TOLERANCE
from dea_fenicsx.model.state import State
from dea_fenicsx.path.items import Close, Item, March, Open, Ramp, Trace
from dea_fenicsx.path.path_checks import check_path
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.stored_state import StoredStep
from dea_fenicsx.run.estimating import check_estimated
from dea_fenicsx.run.starting import Start
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, shown
from dea_fenicsx.support.validation import one_of

Stability = Literal["last", "every", "never"]
STABILITY: tuple[Stability, ...] = get_args(Stability)


class SolveOptions(TypedDict, total=False):
    """Keywords of `solve`.

    Attributes
    ----------
    resume
        Carry on from the last step in `out`, if there is one.
    start
        Begin in a state of another run with the same mesh and the same fields, instead of in the
        undeformed one: a run's results folder, whose last accepted state is taken (none of an
        event); a `StoredStep` of a run that has kept its states; a `Run`; or a `State` of this very
        scene.  Its path, loads, supports and material constants may be others.
        A ramp that both have begins where it drives as much as it did there (volts stay volts); a
        new one begins at 0; one that the scene lacks must be at 0 there.  With other constants,
        loads or supports the state is first brought to equilibrium at that load.  The first step
        of the history is this state.  With `resume`, what `out` holds goes first.
    quiet
        Print nothing; ``run.log`` in `out` is written all the same.
    verbose
        Print each Newton iteration, too; None does as the command line's ``--verbose`` says.
    stability
        The steps at which the negative eigenvalues of the tangent are counted, which needs a
        factorisation: the ``"last"`` one (in small models all steps, where this costs little),
        ``"every"`` step, or ``"never"``.  With ``"every"`` a change of the count between two steps
        is located: a bifurcation gets a step of its own, and its null vector a file in ``modes/``.
    failures
        The failures to watch: `ElectricalBreakdown`, `LossOfTension`, `StretchLimit`.  The first
        state at which one occurs gets a step of its own and an entry in the summary; the path goes
        on.  With None, breakdown is watched in each dielectric that has a breakdown field.
    options
        Settings of Newton's method.
    settings
        The script's own settings, to be kept in summary.json.
    keep_states
        Keep the states of all steps in the folder ``states`` of `out`, from which other runs can
        start (`StoredStep`).  Else the last one is kept.
    estimate
        Names in `record` whose discretisation errors at the end of the path are estimated and told
        in the summary, or True for all.  See `Run.discretisation_error`.
    accuracy
        A name in `record` and the largest error that it may have at the end of the path, relative
        to its value: ``("tip_m", 1e-3)``.  Mesh and degree of the elements are then chosen so that
        the estimated error is below that, beginning with those of the scene; a mesh that is no
        family of `dea_fenicsx.geometry` stays, and the degree is chosen.  The answer is the run
        with the last choice; ``summary["accuracy"]`` tells its error and what was tried.  If a mesh
        from elsewhere is too coarse, ``sizes.pos`` in `out` has the sizes in m that its cells need,
        as a view that gmsh takes as a background field.
    """

    resume: bool
    start: Start | None
    quiet: bool
    verbose: bool | None
    stability: str
    failures: Sequence[FailureMode] | None
    options: NewtonOptions | None
    settings: Mapping[str, Any] | None
    keep_states: bool
    estimate: Sequence[str] | bool
    accuracy: tuple[str, float] | None


DEFAULTS: SolveOptions = {
    "resume": False, "start": None, "quiet": False, "verbose": None, "stability": "last",
    "failures": None, "options": None, "settings": None, "keep_states": False,
    "estimate": False, "accuracy": None,
}  # fmt: skip
"""What holds for the keywords that are left out."""


@dataclass(frozen=True)
class Arguments:
    """All that `solve` is given; see there."""

    scene: Scene
    path: Any
    record: Any
    out: str | os.PathLike | None
    resume: bool
    start: Start | None
    quiet: bool
    verbose: bool | None
    stability: str
    failures: Sequence[FailureMode] | None
    options: NewtonOptions | None
    settings: Mapping[str, Any] | None
    keep_states: bool
    estimate: Sequence[str] | bool = False
    accuracy: tuple[str, float] | None = None

    @property
    def items(self) -> list[Item]:
        """The items of the path."""
        return [self.path] if isinstance(self.path, Item) else list(self.path)

    def compared(self) -> dict[str, Any]:
        """What all ranks must be given alike."""
        start = self.start
        if isinstance(start, Run | State):
            start = type(start).__name__
        return {
            "path": self.items, "record": self.record, "out": self.out, "resume": self.resume,
            "start": start, "stability": self.stability, "failures": self.failures,
            "options": self.options, "keep_states": self.keep_states,
            "estimate": self.estimate, "accuracy": self.accuracy,
        }  # fmt: skip


def check_arguments(given: Arguments) -> None:
    """Raise InputError, with one sentence, for an argument that `solve` cannot use."""
    for value, kind, what in (
        (given.scene, Scene, "a Scene"),
        (given.path, Ramp | Trace | March | Open | Close | list | tuple,
         "a Ramp, a Trace, a March or a list of them"),
        (given.record, Mapping | None, "a dictionary of observables by name"),
        (given.out, str | os.PathLike | None, "a path, or None to write nothing"),
        (given.resume, bool | np.bool_, "resume=True or False"),
        (given.start, str | os.PathLike | StoredStep | Run | State | None,
         "start= the folder of a run, a StoredStep, a Run or a State"),
        (given.quiet, bool | np.bool_, "quiet=True or False"),
        (given.failures, list | tuple | None, "a list of failures to watch"),
        (given.options, NewtonOptions | None, "NewtonOptions(...)"),
        (given.settings, Mapping | None, "a dictionary"),
        (given.keep_states, bool | np.bool_, "keep_states=True or False"),
        (given.estimate, bool | np.bool_ | list | tuple, "estimate= a list of recorded names"),
        (given.accuracy, list | tuple | None, "accuracy= a recorded name and an error"),
    ):  # fmt: skip
        if not isinstance(value, kind):
            raise InputError(f"solve is given {shown(value)}, but needs {what}.")
    for name, where in (("The results folder", given.out), ("The folder to start from",
                                                            given.start)):  # fmt: skip
        if isinstance(where, str) and not where:
            raise InputError(f"{name} has an empty name; give a path, or None for none.")
    # where a run begins that starts from another one is known when that one has been read
    begun = None if given.start is None else dict.fromkeys(given.scene.ramps)
    items = given.items
    check_path(given.scene, items, begun)
    one_of(given.stability, STABILITY, "stability")
    if any(getattr(item, "switch", 0.0) for item in items) and given.stability != "every":
        raise InputError(
            'A trace with switch=... needs stability="every", but stability is '
            f"{given.stability!r}."
        )
    ends = any(getattr(item, "at_loss", "") == "unstable" for item in items)
    if ends and given.stability != "every":
        raise InputError(
            'A ramp with at_loss="unstable" needs stability="every", but stability is '
            f"{given.stability!r}."
        )
    if given.options is not None:
        given.options.check()
        _check_multigrid(given)
    _check_contacts(given)
    _check_watched(given)
    _check_recorded(given.record or {})
    check_estimated(given)


def _check_multigrid(given: Arguments) -> None:
    """Raise InputError for what multigrid cannot tell or solve."""
    if given.options is None or given.options.factor != "multigrid":
        return
    if given.stability == "every":
        raise InputError(
            'stability="every" needs counts of negative eigenvalues, and '
            'NewtonOptions(factor="multigrid") makes none; take stability="never" or factor="auto".'
        )
    if any(getattr(item, "moving", None) is not None for item in given.items):
        raise InputError(
            'NewtonOptions(factor="multigrid") cannot solve for a motion with inertia; take '
            'factor="auto".'
        )


def _check_contacts(given: Arguments) -> None:
    """Raise InputError for a tolerance of an obstacle that rounding of places does not allow."""
    newton = (given.options or NewtonOptions()).tolerance
    least = MODULI_AT_TOLERANCE * np.finfo(float).eps / newton * given.scene.device.length
    for _, told in given.scene.declared.contacts:
        if told.tolerance is not None and told.tolerance < least:
            raise InputError(
                f"The tolerance of the obstacle at {told.surface!r} is {told.tolerance:.3g} m, "
                f"but with Newton's tolerance of {newton:g} rounding allows no less than "
                f"{least:.2g} m; give a larger one, or leave it out."
            )


def _check_watched(given: Arguments) -> None:
    for failure in given.failures or ():
        if isinstance(failure, type) or not hasattr(failure, "check"):
            raise InputError(
                f"A failure to watch is {shown(failure)}, but must be one such as LossOfTension()."
            )
        check_declared(failure)
        failure.check(given.scene)


def _check_recorded(record: Mapping[Any, Any]) -> None:
    for name, observable in record.items():
        if not isinstance(name, str) or not name:
            raise InputError(f"The name of an observable is {shown(name)}, but must be text.")
        if isinstance(observable, type) or not hasattr(observable, "bind"):
            raise InputError(
                f"What is recorded as {name!r} is {shown(observable)}, but must be an observable "
                "such as Charge(...)."
            )
        check_declared(observable)
