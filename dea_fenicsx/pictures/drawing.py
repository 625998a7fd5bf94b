"""The deformed device in colours, drawn by a process of its own.

A picture of a large device needs memory that a run shall not keep, and a fault of a library must
not end a run.  So each picture is made by a child process, free of MPI.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from dea_fenicsx.pictures.curves import file_stem
from dea_fenicsx.results.reading import check_field, frame_times
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.subprocesses import environment

_MPI = ("PMI", "OMPI_", "PRTE_", "PRRTE_", "MPI", "HYDRA_", "HYDI_")
NO_MATPLOTLIB = 5
"""Exit status of the drawing process where matplotlib is not installed."""

_TIMEOUT_S = 180.0

ELECTRIC_FIELD = "field_strength_V_per_m"
"""The field that is drawn unless another one is named."""


def deformed(
    folder: str | os.PathLike,
    field: str = ELECTRIC_FIELD,
    step: int = -1,
    warp: float = 1.0,
    path: str | os.PathLike | None = None,
    say: Callable[[str], object] | None = None,
) -> Path | None:
    """Draw the deformed device, coloured by a field: from outside and in section.

    The undeformed outline is drawn in red.  The drawing is done in a process of its own, free of
    MPI; it needs matplotlib, and neither a screen nor OpenGL.  On a run with several ranks call it
    on rank 0 alone.

    Parameters
    ----------
    folder
        The run's folder.
    field
        Name of a field in fields.xdmf; vectors are shown by magnitude, stress by von Mises'.
        Components are named by their axes: "cauchy_stress_xx_Pa", "displacement_z_m", and of a
        body of revolution "cauchy_stress_hoop_Pa".  Fields are drawn by their values at the
        nodes, if the run has written them in nodal.xdmf, else one colour a cell.  A run without
        an electric field shows the displacement instead of this default.
    step
        Which step on disk, from 0; negative ones count from the last.
    warp
        Scale of the drawn displacement; stated in the picture.
    path
        The PNG file; by default ``FIELD.png`` (less the unit) beside fields.xdmf.
    say
        Called with one sentence if no picture could be made, for example for want of matplotlib.

    Returns
    -------
    Path or None
        The picture; None if it could not be made, and `say` was told why.

    Raises
    ------
    InputError
        If there are no fields, no such field or no such step.
    """
    place = Path(folder)
    field = _drawn_field(place, field, step)
    target = Path(path) if path is not None else place / f"{file_stem(field)}.png"
    options = [f"--field={field}", f"--step={step}", f"--warp={warp!r}", f"--out={target}"]
    return target if _drawn("render", place, options, _TIMEOUT_S, say) else None


def animated(
    folder: str | os.PathLike,
    path: str | os.PathLike,
    field: str = ELECTRIC_FIELD,
    warp: float = 1.0,
    say: Callable[[str], object] | None = None,
) -> Path | None:
    """Draw all steps of a run as a film, each like `deformed`, in one view and colour scale.

    Parameters
    ----------
    folder, field, warp, say
        As in `deformed`.
    path
        The file: .gif, or .mp4 where ffmpeg is there.

    Returns
    -------
    Path or None
        The film; None if it could not be made, and `say` was told why.

    Raises
    ------
    InputError
        If there are no fields or no such field, or the film cannot be written under that name.
    """
    from dea_fenicsx.pictures.movie import check_target

    place, target = Path(folder), Path(path)
    check_target(target)
    field = _drawn_field(place, field)
    seconds = _TIMEOUT_S + 10.0 * len(frame_times(place))
    options = [f"--field={field}", f"--warp={warp!r}", f"--out={target}"]
    return target if _drawn("movie", place, options, seconds, say) else None


def _drawn(
    what: str,
    place: Path,
    options: list[str],
    seconds: float,
    say: Callable[[str], object] | None,
) -> bool:
    """Whether a child process could draw; if not, `say` is told why."""
    command = [
        sys.executable, "-m", "dea_fenicsx.pictures", what, str(place), "--here", *options,
    ]  # fmt: skip
    status, reason = _child(command, environment(without=_MPI), seconds)
    if status == 0:
        return True
    if status == InputError.exit_status and reason.startswith("Error: "):
        raise InputError(reason.removeprefix("Error: "))
    if say:
        say(f"No picture of {place}: {reason}")
    return False


def _child(command: list[str], environment: dict[str, str], seconds: float) -> tuple[int, str]:
    """Exit status of a process and the last line it wrote, or why it ended without one."""
    process = subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True,
    )  # fmt: skip
    try:
        _, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return -1, f"drawing took more than {seconds:g} s and was stopped."
    status = process.returncode
    if status < 0 or status > 128:
        number = -status if status < 0 else status - 128
        return status, f"drawing was ended by signal {number}; is there memory enough?"
    lines = errors.strip().splitlines()
    return status, lines[-1] if lines else f"drawing ended with status {status}."


def _drawn_field(place: Path, field: str, step: int = -1) -> str:
    """The field to draw: the one asked for, or the displacement where there is no electric field.

    Raises
    ------
    InputError
        If there are no fields, no such field or no such step.
    """
    try:
        check_field(place, field, step)
    except InputError:
        if field != ELECTRIC_FIELD:
            raise
        check_field(place, "displacement_m", step)
        return "displacement_m"
    return field
