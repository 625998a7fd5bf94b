"""A run's steps as a film: the pictures of `fields`, in one view and one colour scale.

Only `dea_fenicsx.pictures movie` comes here, in a process of its own.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.drawn_body import DrawnBody
from dea_fenicsx.pictures.fields import View, Words, limits_of, render
from dea_fenicsx.results.reading import frame_times
from dea_fenicsx.support.errors import InputError

ENDINGS = (".gif", ".mp4")
_DPI, _SECONDS, _HOLD_S = 120, 5.0, 1.0


def ffmpeg() -> str | None:
    """The program ffmpeg: that of the package imageio-ffmpeg, else the system's."""
    try:
        import imageio_ffmpeg  # type: ignore[import-not-found]
    except ImportError:
        return shutil.which("ffmpeg")
    return str(imageio_ffmpeg.get_ffmpeg_exe())


def check_target(path: Path) -> None:
    """Raise InputError unless a film can be written under that name here."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"A film is written as .gif or .mp4, not as {path.name!r}.")
    if path.suffix.lower() == ".mp4" and ffmpeg() is None:
        raise InputError(
            "An MP4 needs ffmpeg, which is not here; pip install imageio-ffmpeg, or write a .gif."
        )


def film(
    folder: Path, field: str, warp: float, path: Path, ending: str, words: Words
) -> None:
    """Draw every step of a run on disk and join them, as `ending` says; else as `render`."""
    from PIL import Image

    count = len(frame_times(folder))
    view = _view_of_all(folder, field, warp, count, words.axes)
    images = []
    with tempfile.TemporaryDirectory() as scratch:
        for step in range(count):
            file = Path(scratch) / f"{step}.png"
            render(folder, field, step, warp, file, words, view)
            with Image.open(file) as image:
                images.append(image.convert("RGB"))
    rate = float(np.clip(count / _SECONDS, 2, 25))
    (_gif if ending.lower() == ".gif" else _mp4)(images, rate, path)


def _view_of_all(
    folder: Path, field: str, warp: float, count: int, axes: tuple[str, str, str]
) -> View:
    low, high = np.inf, -np.inf
    outside: list[np.ndarray] = []
    section: list[np.ndarray] = []
    for step in range(count):
        body = DrawnBody(folder, field, step, axes)
        if np.nanmax(np.abs(body.values), initial=0.0) > 0:
            a, b = limits_of(body.values, body.name)
            low, high = min(low, a), max(high, b)
        for found, seen in zip((outside, section), body.seen(warp), strict=True):
            found.append(seen)
    if not low < high:
        low, high = 0.0, 1.0
    return View((low, high), np.vstack(outside), np.vstack(section), _DPI)


def _gif(images: list[Any], rate: float, path: Path) -> None:
    from PIL.Image import Quantize

    # One palette, that of the last step, lest colours flicker; spread evenly over its colours,
    # since by their number white and the largest cell would take all of it.
    palette = images[-1].quantize(255, Quantize.MAXCOVERAGE)
    frames = [image.quantize(palette=palette, dither=0) for image in images]
    each = round(1000 / rate)
    durations = [each] * (len(frames) - 1) + [each + round(1000 * _HOLD_S)]
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0
    )


def _mp4(images: list[Any], rate: float, path: Path) -> None:
    width, height = (n // 2 * 2 for n in images[0].size)  # what the codec asks for
    images = images + [images[-1]] * round(_HOLD_S * rate)
    command = [
        ffmpeg() or "ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
        "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-", "-pix_fmt", "yuv420p",
        "-f", "mp4", str(path),
    ]  # fmt: skip
    pixels = b"".join(image.crop((0, 0, width, height)).tobytes() for image in images)
    done = subprocess.run(command, input=pixels, capture_output=True, check=False)
    if done.returncode:
        told = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
        raise InputError(f"ffmpeg could not write {path} ({told[-1]}).")
