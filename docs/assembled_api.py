"""Pages of all public names: one for each room of the package, made from docstrings by autodoc."""

from __future__ import annotations

import inspect
import re
import sys
from importlib import import_module
from pathlib import Path

from dea_fenicsx.docs.api import ROOMS

TITLES = {
    "scene": "Scene: electrodes, supports, loads, kinematics",
    "materials": "Materials",
    "geometry": "Geometry families",
    "mesh": "Meshes",
    "path": "Paths: ramps, traces, marches",
    "drives": "Drives over time",
    "measure": "Observables and failures",
    "gradients": "Derivatives",
    "run": "Running",
    "results": "Reading results",
    "solvers": "Options of the solver",
    "studies": "Studies over parameters",
    "calibration": "Calibration and uncertainty",
    "exact": "Exact states",
    "origami": "Spiral box",
    "design": "Design search",
    "pictures": "Pictures",
    "support": "Errors",
}
"""Titles of the pages; a room without one has its own name as a title."""


def room_of(module: str, name: str, thing: object) -> str:
    """The page on which a public name stands: that of the room in which it is made."""
    if module != "dea_fenicsx":
        return module.removeprefix("dea_fenicsx.").split(".")[0]
    parts = str(getattr(thing, "__module__", module)).split(".")
    return parts[1] if len(parts) > 1 and parts[0] == "dea_fenicsx" else "other"


def public_names() -> dict[str, dict[str, tuple[str, object]]]:
    """For each room: its public names, with the module from which each is taken, and the thing."""
    found: dict[str, dict[str, tuple[str, object]]] = {}
    seen: set[int] = set()
    for suffix in ROOMS:
        module = f"dea_fenicsx{suffix}"
        for name in import_module(module).__all__:
            thing = getattr(import_module(module), name)
            if inspect.ismodule(thing) or name.startswith("__"):
                continue
            if (inspect.isclass(thing) or inspect.isroutine(thing)) and id(thing) in seen:
                continue
            seen.add(id(thing))
            found.setdefault(room_of(module, name, thing), {})[name] = (module, thing)
    return found


def home_of(name: str, module: str, thing: object) -> str:
    """The module that assigns a constant: there it has its docstring."""
    for place, loaded in sorted(sys.modules.items()):
        if place.startswith("dea_fenicsx.") and vars(loaded).get(name) is thing:
            source = inspect.getsource(loaded)
            if re.search(rf"^{name}\b.*=", source, re.M):
                return place
    return module


def directive(name: str, module: str, thing: object) -> list[str]:
    """The lines that let autodoc write about a public name."""
    if inspect.isclass(thing):
        return [f".. autoclass:: {module}.{name}", "   :members:", ""]
    kind = "autofunction" if callable(thing) else "autodata"
    if kind == "autodata":
        module = home_of(name, module, thing)
    lines = [f".. {kind}:: {module}.{name}"]
    return [*lines, "   :no-value:", ""] if kind == "autodata" else [*lines, ""]


def write(folder: Path) -> None:
    """Write the pages and their list into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    rooms = public_names()
    order = [*(room for room in TITLES if room in rooms), *(r for r in rooms if r not in TITLES)]
    for room in order:
        title = TITLES.get(room, room)
        lines = [title, "=" * len(title), ""]
        for name, (module, thing) in rooms[room].items():
            lines += directive(name, module, thing)
        (folder / f"{room}.rst").write_text("\n".join(lines), "utf-8")
    head = "Public names"
    lines = [head, "=" * len(head), "",
             "Everything that a script may use, from the docstrings.  All numbers are in SI units.",
             "The name in front of the last dot tells from where a name is imported.",
             "", ".. toctree::", "   :maxdepth: 1", ""]  # fmt: skip
    lines += [f"   {room}" for room in order]
    (folder / "index.rst").write_text("\n".join(lines) + "\n", "utf-8")
