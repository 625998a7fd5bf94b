"""Checks of the arguments of `solve`, before anything is computed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np

from dea_fenicsx.path.items import Ramp, Trace, check_path
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, shown
from dea_fenicsx.support.validation import one_of

Stability = Literal["last", "every", "never"]
STABILITY: tuple[Stability, ...] = get_args(Stability)


def check_arguments(
    scene: Any, path: Any, record: Any, out: Any, resume: Any, quiet: Any, stability: Any,
    failures: Any, options: Any, settings: Any,
) -> None:  # fmt: skip
    """Raise InputError, with one sentence, for an argument that `solve` cannot use."""
    for value, kind, what in (
        (scene, Scene, "a Scene"),
        (path, Ramp | Trace | list | tuple, "a Ramp, a Trace or a list of them"),
        (record, Mapping | None, "a dictionary of observables by name"),
        (out, str | os.PathLike | None, "a path, or None to write nothing"),
        (resume, bool | np.bool_, "resume=True or False"),
        (quiet, bool | np.bool_, "quiet=True or False"),
        (failures, list | tuple | None, "a list of failures to watch"),
        (options, NewtonOptions | None, "NewtonOptions(...)"),
        (settings, Mapping | None, "a dictionary"),
    ):
        if not isinstance(value, kind):
            raise InputError(f"solve is given {shown(value)}, but needs {what}.")
    if out == "":
        raise InputError("The results folder has an empty name; give a path, or None for none.")
    items = [path] if isinstance(path, Ramp | Trace) else path
    check_path(scene, items)
    one_of(stability, STABILITY, "stability")
    if any(getattr(item, "switch", 0.0) for item in items) and stability != "every":
        raise InputError(
            f'A trace with switch=... needs stability="every", but stability is {stability!r}.'
        )
    if options is not None:
        options.check()
    for failure in failures or ():
        if isinstance(failure, type) or not hasattr(failure, "check"):
            raise InputError(
                f"A failure to watch is {shown(failure)}, but must be one such as LossOfTension()."
            )
        check_declared(failure)
        failure.check(scene)
    for name, observable in (record or {}).items():
        if not isinstance(name, str) or not name:
            raise InputError(f"The name of an observable is {shown(name)}, but must be text.")
        if isinstance(observable, type) or not hasattr(observable, "bind"):
            raise InputError(
                f"What is recorded as {name!r} is {shown(observable)}, but must be an observable "
                "such as Charge(...)."
            )
        check_declared(observable)
