"""Random scenes as plain descriptions, which are printed, stored and replayed.

A `Sketch` names classes of the package and their arguments.  It becomes a scene by `build`, a line
of JSON by `Sketch.text`, and the lines of a script by `script`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer


@dataclass(frozen=True)
class Call:
    """A class of the package by name, and its arguments by name."""

    name: str
    args: dict[str, Any] = field(default_factory=dict)

    def make(self) -> Any:
        return getattr(dea, self.name)(**{k: _made(v) for k, v in self.args.items()})

    def script(self) -> str:
        return f"dea.{self.name}({', '.join(f'{k}={_words(v)}' for k, v in self.args.items())})"

    @property
    def ramp(self) -> str:
        return self.args.get("ramp", "")


def call(name: str, **args: Any) -> Call:
    """A `Call`; arguments that are None are left out."""
    return Call(name, {k: v for k, v in args.items() if v is not None})


def _made(value: Any) -> Any:
    if isinstance(value, Call):
        return value.make()
    return tuple(_made(v) for v in value) if isinstance(value, list | tuple) else value


def _words(value: Any) -> str:
    if isinstance(value, Call):
        return value.script()
    if isinstance(value, list | tuple):
        return f"({' '.join(f'{_words(v)},' for v in value)})"
    return repr(value)


@dataclass(frozen=True)
class Part:
    """A layer of the box: thickness in m, cells through it, and its material."""

    thickness: float
    cells: int
    elastic: Call
    eps_r: float | None = None
    bulk: float | None = None


@dataclass(frozen=True)
class Sketch:
    """A scene and a path as plain data.

    Attributes
    ----------
    kinematics, electrodes, supports, prescribed, loads
        Classes of the package with their arguments.
    length, width, x0, divisions
        The box in m; width None is a flat strip.
    parts
        Layers from the bottom up.
    path
        Ramps, one after another: names, factor at the end, number of steps.
    kind
        What sort of device this is, for the report.
    """

    kinematics: Call
    length: float
    width: float | None
    x0: float
    divisions: tuple[int, ...]
    parts: tuple[Part, ...]
    electrodes: tuple[Call, ...]
    supports: tuple[Call, ...]
    prescribed: tuple[Call, ...]
    loads: tuple[Call, ...]
    path: tuple[tuple[tuple[str, ...], float, int], ...]
    kind: str

    @property
    def text(self) -> str:
        """One line of JSON, from which `read` makes the same sketch."""
        return json.dumps(asdict(self))

    @property
    def form(self) -> tuple:
        """What decides about the compiled forms; sketches of one form share them."""
        return (
            self.kinematics.name,
            tuple((p.elastic.name, len(p.elastic.args.get("mu", ())) if p.elastic.name == "Ogden"
                   else 0, p.eps_r is None, p.bulk is None) for p in self.parts),
            tuple(c.name for c in (*self.prescribed, *self.loads)),
        )  # fmt: skip


def read(text: str) -> Sketch:
    """The sketch of a line of JSON."""
    raw = json.loads(text)

    def calls(items: list) -> tuple[Call, ...]:
        return tuple(Call(i["name"], _args(i["args"])) for i in items)

    parts = tuple(
        Part(**{**p, "elastic": Call(p["elastic"]["name"], _args(p["elastic"]["args"]))})
        for p in raw["parts"]
    )
    return Sketch(
        **{
            **raw,
            "kinematics": Call(raw["kinematics"]["name"], _args(raw["kinematics"]["args"])),
            "divisions": tuple(raw["divisions"]), "parts": parts,
            "electrodes": calls(raw["electrodes"]), "supports": calls(raw["supports"]),
            "prescribed": calls(raw["prescribed"]), "loads": calls(raw["loads"]),
            "path": tuple((tuple(what), to, steps) for what, to, steps in raw["path"]),
        }
    )  # fmt: skip


def _args(args: dict[str, Any]) -> dict[str, Any]:
    """Arguments from JSON: lists are tuples, and dictionaries are nested calls."""
    return {
        k: tuple(v) if isinstance(v, list)
        else Call(v["name"], _args(v["args"])) if isinstance(v, dict) else v
        for k, v in args.items()
    }  # fmt: skip


def device_of(sketch: Sketch, comm: Any) -> Any:
    layers = [Layer(f"part{k}", p.thickness, divisions=p.cells)
              for k, p in enumerate(sketch.parts)]  # fmt: skip
    stack = BoxStack(sketch.length, sketch.width, layers, divisions=sketch.divisions, x0=sketch.x0)
    return dea.read_gmsh(stack, comm)


def build(sketch: Sketch, comm: Any, device: Any = None) -> dea.Scene:
    """The scene of a sketch."""
    materials = {
        f"part{k}": dea.Material(
            p.elastic.make(), None if p.eps_r is None else dea.IdealDielectric(p.eps_r), p.bulk
        )
        for k, p in enumerate(sketch.parts)
    }
    groups = {
        name: [item.make() for item in getattr(sketch, name)]
        for name in ("electrodes", "supports", "prescribed", "loads")
    }
    return dea.Scene(
        device or device_of(sketch, comm), materials, kinematics=sketch.kinematics.make(), **groups
    )


def script(sketch: Sketch) -> str:
    """The lines of a script that solves the sketch, to be tried alone."""
    layers = ", ".join(f"Layer('part{k}', {p.thickness!r}, divisions={p.cells})"
                       for k, p in enumerate(sketch.parts))  # fmt: skip
    materials = ", ".join(
        f"'part{k}': dea.Material({p.elastic.script()}, "
        f"{'None' if p.eps_r is None else f'dea.IdealDielectric({p.eps_r!r})'}, {p.bulk!r})"
        for k, p in enumerate(sketch.parts)
    )
    groups = "\n".join(
        f"    {name}=[{', '.join(c.script() for c in getattr(sketch, name))}],"
        for name in ("electrodes", "supports", "prescribed", "loads") if getattr(sketch, name)
    )  # fmt: skip
    path = ", ".join(f"dea.Ramp({what!r}, {to!r}, steps={n})" for what, to, n in sketch.path)
    return f"""import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
box = BoxStack({sketch.length!r}, {sketch.width!r}, [{layers}],
               divisions={sketch.divisions!r}, x0={sketch.x0!r})
scene = dea.Scene(dea.read_gmsh(box), {{{materials}}},
    kinematics={sketch.kinematics.script()},
{groups})
run = dea.solve(scene, [{path}])
"""
