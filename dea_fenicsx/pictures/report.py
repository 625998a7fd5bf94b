"""A run as one HTML file: the device to turn, its steps, fields, curves, events and settings.

The file holds all that it needs and asks no other host for anything; its browser is told to refuse
such requests.  All names and texts of a run stand in it as data, never as code.  Needs plotly.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import axis_label, write_whole
from dea_fenicsx.pictures.page import PAGE
from dea_fenicsx.results.axes import FIXED, axes_told
from dea_fenicsx.results.first_columns import load_column, ordinate
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.reading import (
    check_field,
    field_names,
    load_columns,
    read_history,
    read_summary,
)
from dea_fenicsx.results.reading_surfaces import read_surfaces
from dea_fenicsx.support.errors import InputError

REPORT_FIELDS = (
    "field_strength_MV_per_m", "displacement_m", "cauchy_stress_Pa", "J", "potential_V",
)  # fmt: skip
"""Fields that a report shows unless others are named, as far as a run has them."""


def report(
    folder: str | os.PathLike,
    path: str | os.PathLike | None = None,
    fields: Sequence[str] | None = None,
) -> Path:
    """Write a run as one HTML file that any browser shows.

    It shows the device in three dimensions, turned and zoomed with the mouse, with its steps on a
    slider and a field on its surface, the electrodes, obstacles, the curves of the history, events,
    failures, settings, versions and cost.  The surface is thinned to 20 000 points, in single
    precision; of very many steps some are left out evenly.

    Parameters
    ----------
    folder
        The run's folder; the run may still be going on.
    path
        The HTML file; by default ``report.html`` in the folder.
    fields
        Names of the fields to choose from, or of components such as "cauchy_stress_xx_Pa".

    Raises
    ------
    InputError
        If there is no history, no such field, or plotly is not installed.
    """
    target = Path(folder) / "report.html" if path is None else Path(path)
    text = page(folder, fields)
    return write_whole(target, lambda file: file.write_text(text, "utf-8"))


class Shown:
    """A report that a notebook shows in a frame of its own."""

    def __init__(self, text: str, height: int = 900) -> None:
        self.text, self.height = text, height

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.text)}" sandbox="allow-scripts" width="100%" '
            f'height="{self.height}" style="border: 0"></iframe>'
        )


def page(folder: str | os.PathLike, fields: Sequence[str] | None = None) -> str:
    """The text of the HTML file that `report` writes."""
    library = _plotly()
    place = Path(folder)
    history = read_history(place)
    if not history:
        raise InputError(f"The history in {place} has no steps yet.")
    summary: dict[str, Any] = {}
    with suppress(InputError):
        summary = read_summary(place)
    axes = FIXED if not summary else axes_told(summary)
    told: dict[str, Any] = {
        "title": str(place.resolve().name), "status": str(summary.get("status", "no summary yet")),
        "message": str(summary.get("message") or ""), "axes": list(axes),
        "events": [[str(e.get("event")), str(e.get("step"))] for e in _listed(summary, "events")],
        "failures": [_flat(one) for one in _listed(summary, "failures")],
        "about": _about(summary), "curves": _curves(history, summary),
    }  # fmt: skip
    arrays: dict[str, np.ndarray] = {}
    if (place / "fields.xdmf").is_file():
        told["device"] = _device(place, _chosen(place, fields), axes, history, arrays)
    told["arrays"] = [[name, values.dtype.kind, values.size] for name, values in arrays.items()]
    raw = b"".join(values.tobytes() for values in arrays.values())
    packed = base64.b64encode(gzip.compress(raw, 5, mtime=0)).decode()
    return _filled({"TITLE": escape(told["title"]), "DATA": _json(told), "NUMBERS": packed,
                    "LIBRARY": library.replace("</script", "<\\/script")})  # fmt: skip


def _filled(parts: Mapping[str, str]) -> str:
    """The page with its parts; a part that holds the mark of another one stays as it is."""
    text = PAGE
    pieces = []
    for name in ("TITLE", "LIBRARY", "DATA", "NUMBERS"):
        before, text = text.split(f"@{name}@", 1)
        pieces += [before, parts[name]]
    return "".join([*pieces, text])


def _plotly() -> str:
    """The library that draws in the browser, as text."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise InputError("A report needs plotly; pip install plotly.") from error
    return str(get_plotlyjs())


def _json(told: Any) -> str:
    """JSON that can stand within a script element: no sign in it ends the element."""
    text = json.dumps(_finite(told), ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _finite(value: Any) -> Any:
    """A value for JSON: none in place of what is no finite number, and texts of all else."""
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _listed(summary: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """A list of objects in a summary, or nothing if it holds something else."""
    found = summary.get(key)
    return [e for e in found if isinstance(e, Mapping)] if isinstance(found, list) else []


def _flat(one: Mapping[str, Any]) -> str:
    """An object in one line."""
    return ", ".join(f"{key.replace('_', ' ')}: {value}" for key, value in one.items())


def _about(summary: Mapping[str, Any]) -> list[list[str]]:
    """Settings, versions and cost: what the summary says but for events and failures."""
    return [
        [str(key), json.dumps(_finite(value), indent=1, ensure_ascii=False)
         if isinstance(value, dict | list) else str(value)]
        for key, value in summary.items() if key not in ("events", "failures", "message")
    ]  # fmt: skip


def _curves(history: Mapping[str, np.ndarray], summary: dict[str, Any]) -> dict[str, Any]:
    """Columns of the history that are numbers, with their labels, and which to show first."""
    columns = {}
    for name, values in history.items():
        if values.dtype.kind == "f" and np.isfinite(values).any():
            label, unit = axis_label(name, float(np.nanmax(np.abs(values))))
            columns[name] = [label, [float(v) / unit for v in values]]
    x, y = load_column(history, summary), ordinate(history, summary)
    events = history.get("event")
    if events is None or events.dtype.kind == "f":  # a column without any text
        events = np.full(len(next(iter(history.values()))), "")
    return {"columns": columns, "x": x if x in columns else next(iter(columns), ""),
            "y": y if y in columns else next(iter(columns), ""),
            "events": [str(e) for e in events],
            "loads": [n for n in load_columns(history, summary) if n in columns]}  # fmt: skip


def _chosen(place: Path, fields: Sequence[str] | None) -> list[str]:
    """The fields to show, each of which is there."""
    if fields is None:
        names = field_names(place)
        return [name for name in REPORT_FIELDS if name in names]
    chosen = [fields] if isinstance(fields, str) else list(dict.fromkeys(fields))
    for name in chosen:
        check_field(place, name)
    return chosen


def _device(
    place: Path, fields: Sequence[str], axes: tuple[str, str, str],
    history: Mapping[str, np.ndarray], arrays: dict[str, np.ndarray],
) -> dict[str, Any]:  # fmt: skip
    """What the page says of the device; its numbers go to `arrays`."""
    from dea_fenicsx.pictures.obstacle_nets import nets_of
    from dea_fenicsx.pictures.skin import outline, skin_of

    surfaces = {n: f for n, f in read_surfaces(place).items() if f.is_electrode}
    nodes, lines = outline(surfaces)
    try:
        skin = skin_of(place, fields, axes, nodes)
    except ImportError as error:
        raise InputError("A report needs pyvista; pip install pyvista.") from error

    def put(name: str, values: np.ndarray, kind: str = "<f4") -> None:
        arrays[name] = np.ascontiguousarray(values, dtype=kind).ravel()

    put("triangles", skin.triangles, "<i4")
    put("points", skin.points.T * 1e3)
    put("lines", skin.lines.T * 1e3)
    for name, pairs in lines.items():
        put(f"line/{name}", pairs, "<i4")
    shown = []
    for name, steps in skin.fields.items():
        found = np.array(steps)
        finite = found[np.isfinite(found)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
        label, unit = axis_label(name, float(max(abs(low), abs(high))))
        low = min(low, 0.0) if name.endswith("V_per_m") else low
        high = high if high > low else low + 1.0
        shown.append([name, label, float(low / unit), float(high / unit)])
        for k, values in enumerate(steps):
            put(f"{name}/{k}", values / unit)
    places = np.vstack([skin.points + moved for moved in skin.moved])
    obstacles, nets, around = nets_of(place, skin.steps, places, skin.flat)
    for k, ends in enumerate(nets):
        put(f"obstacle/{k}", ends.T * 1e3)
    reach = 1e3 * np.stack([around.min(axis=0), around.max(axis=0)], axis=1)
    for k, (moved, line_moved) in enumerate(zip(skin.moved, skin.line_moved, strict=True)):
        put(f"moved/{k}", moved.T * 1e3)
        put(f"line_moved/{k}", line_moved.T * 1e3)
    rows = np.array(field_times(history))
    return {"flat": skin.flat, "steps": [int(np.abs(rows - t).argmin()) for t in skin.times],
            "fields": shown, "electrodes": list(lines), "points": len(skin.points),
            "obstacles": obstacles, "reach": reach.tolist()}  # fmt: skip
