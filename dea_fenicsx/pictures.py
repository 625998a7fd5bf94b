"""Pictures of finished or running runs, made from their results files alone.

`curve` draws columns of history.csv against each other, `deformed` the device in colours.  By hand:

    python -m dea_fenicsx.pictures curve FOLDER --x voltage_V --y contraction
    python -m dea_fenicsx.pictures render FOLDER --field field_strength_V_per_m --warp 5

Needs matplotlib, and pyvista for `deformed`: the extra "plots".
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from dea_fenicsx.errors import InputError, install_hook
from dea_fenicsx.files import clean
from dea_fenicsx.launch import environment
from dea_fenicsx.pictures_curves import (
    axis_label,
    bare,
    curve,
    file_stem,
    lettering,
    spoken,
    write_whole,
)
from dea_fenicsx.pictures_ladder import ladder
from dea_fenicsx.reading import check_field, frame_times, read_history, read_summary

__all__ = ["animated", "axis_label", "bare", "curve", "deformed", "ladder", "main", "spoken"]

_MPI = ("PMI", "OMPI_", "PRTE_", "PRRTE_", "MPI", "HYDRA_", "HYDI_")
_NO_PYVISTA, _TIMEOUT_S = 5, 180.0


def deformed(
    folder: str | os.PathLike,
    field: str = "field_strength_V_per_m",
    step: int = -1,
    warp: float = 1.0,
    path: str | os.PathLike | None = None,
    say: Callable[[str], object] | None = None,
) -> Path | None:
    """Draw the deformed device, coloured by a field: from outside and in section.

    The undeformed outline is drawn in red.  The drawing is done in a process of its own, free of
    MPI: where OpenGL is missing VTK ends its process, and inside an MPI one it may hang.  On a run
    with several ranks call it on rank 0 alone.

    Parameters
    ----------
    folder
        The run's folder.
    field
        Name of a field in fields.xdmf; vectors are shown by magnitude, stress by von Mises'.
    step
        Which step on disk, from 0; negative ones count from the last.
    warp
        Scale of the drawn displacement; stated in the picture.
    path
        The PNG file; by default ``FIELD.png`` (less the unit) beside fields.xdmf.
    say
        Called with one sentence if no picture could be made for want of pyvista or OpenGL.

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
    target = Path(path) if path is not None else place / f"{file_stem(field)}.png"
    check_field(place, field, step)
    options = [f"--field={field}", f"--step={step}", f"--warp={warp!r}", f"--out={target}"]
    return target if _drawn("render", place, options, _TIMEOUT_S, say) else None


def animated(
    folder: str | os.PathLike,
    path: str | os.PathLike,
    field: str = "field_strength_V_per_m",
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
    from dea_fenicsx.pictures_movie import check_target

    place, target = Path(folder), Path(path)
    check_target(target)
    check_field(place, field)
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
    variables = environment(without=_MPI)
    trials = [command]
    if not variables.get("DISPLAY") and shutil.which("xvfb-run"):
        # VTK before 9.4 can do nothing without a display
        trials.append(["xvfb-run", "-a", *command])
    reason = ""
    for trial in trials:
        status, told = _child(trial, variables, seconds)
        if status == 0:
            return True
        if status == InputError.exit_status and told.startswith("Error: "):
            raise InputError(told.removeprefix("Error: "))
        reason = told
        if status == _NO_PYVISTA:
            break
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
        return status, (
            "VTK found no OpenGL and ended; install libegl1, libgl1 and libxrender1 or, for VTK "
            "before 9.4, xvfb."
        )
    lines = errors.strip().splitlines()
    return status, lines[-1] if lines else f"drawing ended with status {status}."


def _title(folder: Path, warp: float, time: float) -> str:
    """Load and step of a picture, from the row of the history that belongs to its time."""
    parts = []
    with suppress(InputError, KeyError, IndexError, TypeError, ValueError, OverflowError):
        history = read_history(folder)
        row = int(np.argmin(np.abs(history["time"] - time)))
        with suppress(InputError):
            ramps = [r["what"] for r in read_summary(folder)["settings"]["path"]]
            for name in dict.fromkeys(ramps):
                if (key := f"{name}_V") in history:
                    parts.append(" ".join(spoken(key, float(history[key][row]))))
                elif (key := f"{name}_factor") in history:
                    parts.append(f"{clean(name, 60).replace('_', ' ')} × {history[key][row]:.4g}")
        parts.append(f"step {int(history['step'][row])}")
    parts.append(f"displacements × {warp:g}, undeformed in red" if warp else "undeformed shape")
    return lettering(", ".join(parts))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m dea_fenicsx.pictures", description="Pictures of runs."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="the deformed device, coloured by a field")
    render.add_argument("--step", type=int, default=-1, help="step on disk; -1 is the last")
    movie = commands.add_parser("movie", help="all steps as a film")
    for drawn, what in ((render, "the PNG file"), (movie, "the .gif or .mp4 file")):
        drawn.add_argument("folder", type=Path, help="a run's folder")
        drawn.add_argument("--field", default="field_strength_V_per_m", help="name of a field")
        drawn.add_argument("--warp", type=float, default=1.0, help="scale of the displacement (-)")
        drawn.add_argument("--out", type=Path, required=drawn is movie, help=what)
        drawn.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    plot = commands.add_parser("curve", help="columns of history.csv against each other")
    plot.add_argument("folders", nargs="+", type=Path, help="folders of runs")
    plot.add_argument("--x", default="voltage_V", help="column of the abscissa")
    plot.add_argument("--y", default="contraction", help="column of the ordinate")
    plot.add_argument("--labels", nargs="+", help="a name for each run")
    plot.add_argument("--out", type=Path, help="the picture, without its ending")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``python -m dea_fenicsx.pictures``; returns the exit status."""
    given = _parser().parse_args(arguments)
    if given.command == "curve":
        for path in curve(given.folders, given.x, given.y, given.out, given.labels):
            print(path)
        return 0
    if not given.here:

        def say(reason: str) -> None:
            print(reason, file=sys.stderr)

        if given.command == "movie":
            made = animated(given.folder, given.out, given.field, given.warp, say)
        else:
            made = deformed(given.folder, given.field, given.step, given.warp, given.out, say)
        if made:
            print(made)
        return 0 if made else 1
    for module in ("pyvista", "matplotlib"):
        if find_spec(module) is None:
            print(f"{module} is not installed; pip install {module}.", file=sys.stderr)
            return _NO_PYVISTA
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def title(time: float) -> str:
        return _title(given.folder, given.warp, time)

    def draw(file: Path) -> None:
        if given.command == "movie":
            from dea_fenicsx.pictures_movie import film

            kind = given.out.suffix
            film(given.folder, given.field, given.warp, file, kind, title, axis_label)
        else:
            from dea_fenicsx.pictures_fields import render

            render(given.folder, given.field, given.step, given.warp, file, title, axis_label)

    write_whole(given.out, draw)
    return 0


if __name__ == "__main__":
    install_hook()
    sys.exit(main())
