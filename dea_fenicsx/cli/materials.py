"""The library of materials: constants with their source."""

from __future__ import annotations

import argparse
import json
import textwrap
from pathlib import Path
from typing import Any

from dea_fenicsx.support.errors import InputError

HELP = "the library of materials"

PICTURES = (".png", ".svg", ".pdf")
"""Kinds of pictures that can be drawn."""

_UNITS = {"mu": "Pa", "C10": "Pa", "C01": "Pa", "C20": "Pa", "C30": "Pa"}


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="one material; without it all are listed")
    parser.add_argument("--plot", metavar="FILE", help="draw the curves of NAME, with data (.png)")
    parser.add_argument("--json", action="store_true", help="for programs: SI units")


def told(name: str) -> dict[str, Any]:
    """A preset as JSON can hold it, in SI units."""
    from dea_fenicsx.materials import preset
    from dea_fenicsx.materials.presets import MARKS

    found = preset(name)
    material = found.material
    electric = material.dielectric if material.is_dielectric else None
    told: dict[str, Any] = {
        "name": found.name,
        "model": type(material.elastic).__name__,
        "constants": material.parameters(),
        "viscous": [{"mu": b.mu, "tau": b.tau} for b in material.viscous],
        "shear_modulus_Pa": material.elastic.shear_modulus(),
        "bulk_modulus_Pa": material.bulk_modulus,
        "conductor": material.is_conductor,
        "eps_r": getattr(electric, "eps_r", None),
        "breakdown_V_per_m": None,
        "mark": found.mark,
        "marked": MARKS[found.mark],
        "source": found.source,
        "year": found.year,
        "stretches": found.stretches,
        "note": found.note,
        "use": found.use,
    }
    if electric is not None and electric.breakdown_law() is not None:
        told["breakdown_V_per_m"] = float(electric.breakdown_field(1.0))
    return told


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx.materials import names
    from dea_fenicsx.materials.presets import MARKS

    if options.plot is not None:
        _draw(options.name, options.plot)
        return 0
    if options.name is not None:
        one = told(options.name)
        print(json.dumps(one, indent=2, ensure_ascii=False) if options.json else _page(one))
        return 0
    everything = [told(name) for name in names()]
    if options.json:
        print(json.dumps(everything, indent=2, ensure_ascii=False))
        return 0
    width = max(len(m["name"]) for m in everything)
    head = f"{'name':{width}}  {'model':12}  {'modulus':>9}  {'eps_r':9}  {'mark':4}  for"
    print(f"{head}\n{'-' * (len(head) + 20)}")
    of_the_benchmark = [m for m in everything if "thesis" in m["name"]]
    for m in everything:
        if m not in of_the_benchmark:
            print(_row(m, width))
    print("\nOnly for the benchmark of Park (2019), `dea table`:")
    for m in of_the_benchmark:
        print(_row(m, width))
    print("\nmodulus: initial shear modulus.  eps_r: relative permittivity; a conductor has none.\n"
          "mark: where the constants come from.")  # fmt: skip
    for mark, meaning in MARKS.items():
        print(f"  {mark}  {meaning}")
    print("`dea materials NAME` shows constants and source.")
    return 0


def _draw(name: str | None, file: str) -> None:
    """Write the picture of a preset's curves."""
    from dea_fenicsx.materials import preset

    if name is None:
        raise InputError("--plot draws one material; name it: dea materials NAME --plot FILE.")
    path = Path(file)
    if path.suffix.lower() not in PICTURES:
        raise InputError(f"{file} is no picture; let its name end in {' or '.join(PICTURES)}.")
    if not path.parent.is_dir():
        raise InputError(f"There is no folder {path.parent} for {path.name}; make it first.")
    found = preset(name)
    import matplotlib

    matplotlib.use("Agg")
    found.plot().figure.savefig(path, dpi=150)
    print(f"wrote {path}")


def _row(m: dict[str, Any], width: int) -> str:
    electric = f"{m['eps_r']:g}" if m["eps_r"] else "conductor"
    return (f"{m['name']:{width}}  {m['model']:12}  {_short(m['shear_modulus_Pa']):>9}  "
            f"{electric:9}  {m['mark']:4}  {m['use']}")  # fmt: skip


def _page(m: dict[str, Any]) -> str:
    lines = [m["name"], f"  for              {m['use']}", f"  model            {m['model']}"]
    for name, value in m["constants"].items():
        text = ", ".join(f"{v:.6g}" for v in value) if isinstance(value, tuple) else f"{value:.6g}"
        lines.append(f"  {name:16} {text} {_UNITS.get(name, '')}".rstrip())
    lines.append(f"  shear modulus    {_short(m['shear_modulus_Pa'])} (initial)")
    for branch in m["viscous"]:
        lines.append(f"  viscous branch   mu {_short(branch['mu'])}, tau {branch['tau']:g} s")
    bulk = m["bulk_modulus_Pa"]
    lines.append(f"  bulk modulus     {_short(bulk) if bulk else 'none: exactly incompressible'}")
    if m["conductor"]:
        lines.append("  electrically     conductor")
    else:
        lines.append(f"  eps_r            {m['eps_r']:g}")
        field = m["breakdown_V_per_m"]
        lines.append(f"  breakdown        {f'{field / 1e6:g} MV/m' if field else 'not known'}")
    rest = f"{m['marked']}: {m['source']}." + (f" {m['note']}" if m["note"] else "")
    lines.append(textwrap.fill(rest, 96, initial_indent="  source           ",
                               subsequent_indent=" " * 19))  # fmt: skip
    low, high = m["stretches"] or (None, None)
    lines.append(f"  year             {m['year'] or 'not told'}")
    lines.append(f"  range of data    {f'stretch {low:g} to {high:g}' if high else 'not told'}")
    lines.append(f'\nIn a script: dea.materials.get("{m["name"]}")')
    return "\n".join(lines)


def _short(pascal: float) -> str:
    for size, unit in ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")):
        if pascal >= size:
            return f"{pascal / size:.4g} {unit}"
    return f"{pascal:.4g} Pa"
