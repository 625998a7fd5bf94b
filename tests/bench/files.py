"""The JSON file of a benchmark: read with all that can be wrong with it, and written."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

COUNTS = ("unknowns", "newton_iterations", "krylov_iterations", "factorisations", "steps")
"""Whole numbers of each scene, compared exactly."""


class BadFile(Exception):
    """A file that cannot be compared; the message is one sentence."""


def read(path: str | Path) -> dict[str, Any]:
    """Read and check a file that `write` wrote.

    Returns
    -------
    dict
        ``versions`` (of DOLFINx, as ``dolfinx``, and of others), ``machine`` (a sentence), and
        ``scenes``: for each name the `COUNTS`, ``status``, ``value`` and ``seconds``.

    Raises
    ------
    BadFile
        If the file is missing, is no JSON, or has not this form.
    """
    try:
        found = json.loads(Path(path).read_text("utf-8"))
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise BadFile(f"{path} cannot be read ({reason}); `make bench` writes one.") from None
    except (ValueError, RecursionError) as error:
        told = str(error).split("\n")[0]
        raise BadFile(f"{path} is not a JSON file ({told}); `make bench` writes one.") from None
    wrong = _fault(found)
    if wrong:
        raise BadFile(f"{path} is not the file of a benchmark: {wrong}; `make bench` writes one.")
    return found


def write(path: str | Path, found: dict[str, Any]) -> None:
    """Write a file, and the folder that it lies in."""
    file = Path(path)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", "utf-8")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise BadFile(f"{path} cannot be written ({reason}).") from None


def _fault(found: Any) -> str:
    """What is wrong with the content of a file, or ""."""
    if not isinstance(found, dict):
        return "it holds no object"
    for part in ("versions", "scenes"):
        if not isinstance(found.get(part), dict):
            return f'it has no object "{part}"'
    if not isinstance(found["versions"].get("dolfinx"), str):
        return "its versions do not name that of dolfinx"
    for name, scene in found["scenes"].items():
        if not isinstance(scene, dict):
            return f'the scene "{name}" is no object'
        for key in COUNTS:
            if type(scene.get(key)) is not int:
                return f'"{key}" of the scene "{name}" is no whole number'
        for key in ("value", "seconds"):
            number = scene.get(key)
            if type(number) not in (int, float) or not math.isfinite(number):
                return f'"{key}" of the scene "{name}" is no finite number'
        if not isinstance(scene.get("status"), str):
            return f'"status" of the scene "{name}" is no text'
    return ""
