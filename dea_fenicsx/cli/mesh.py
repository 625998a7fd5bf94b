"""The named parts and surfaces of a mesh, a .geo or a STEP file: what a scene can refer to."""

from __future__ import annotations

import argparse
from pathlib import Path

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

HELP = "the names in a .msh, .geo or STEP file"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Show the named regions and surfaces of a file.  A .msh and a STEP file are data. A .geo "
        "file is a program of gmsh: to look at it is to run it, and it can run any command."
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a .msh, .geo, .step or .stp file")
    parser.add_argument("--size", type=float, metavar="M",
                        help="largest element size in m, for .geo and STEP")  # fmt: skip
    parser.add_argument("--unit", type=float, metavar="M",
                        help="unit of length in m (default 1; STEP has its own)")  # fmt: skip
    parser.add_argument("--straight", action="store_true",
                        help="straight cells where a .geo or STEP file is curved")  # fmt: skip
    parser.add_argument("--apart", action="store_true",
                        help="parts may touch that share no nodes")  # fmt: skip
    parser.add_argument("--no-programs", action="store_true",
                        help="refuse a .geo file instead of running it")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx.geometry._gmsh import quality
    from dea_fenicsx.mesh.cad import groups_of, lengths, open_file, read_names
    from dea_fenicsx.mesh.foreign.formats import GEO
    from dea_fenicsx.mesh.foreign.model import checked

    file, label = options.file, str(options.file)
    unit, size = lengths(file, options.unit, options.size)
    model = open_file(
        file, None if size is None else size / unit, curved=not options.straight,
        programs=False if options.no_programs else None,
    )  # fmt: skip
    try:
        if file.suffix.lower() in GEO:
            print(f"{label} is a program of gmsh, and has been run")
        groups = groups_of(model, label)
        _show(groups, unit)
        names, dim = read_names(model, label)
        found = checked(model, names, dim, label, unit, options.apart)
        for note in found.notes:
            print(f"cells: {note}")
        good = quality(model)
    finally:
        model.remove()
    print(f"least scaled Jacobian of a cell {good['least_scaled_jacobian']:.3g} (must be > 0), "
          f"longest over shortest edge {good['largest_aspect']:.3g}")  # fmt: skip
    if not any(g.dim == dim - 1 for g in groups):
        raise InputError(
            f"{label} names no surface; an electrode or a support needs a physical group of "
            f"dimension {dim - 1}."
        )
    return 0


def _show(groups: list, unit: float) -> None:
    """Print the groups of regions and of facets with their sizes in SI units."""
    dim = groups[0].dim
    width = max(len(clean(g.name)) for g in groups)
    for d, title in ((dim, "regions (materials)"), (dim - 1, "surfaces (electrodes, supports)")):
        print(f"{title}:")
        for g in (g for g in groups if g.dim == d):
            size_of = f"{g.measure * unit**d:.4g} {('m', 'm2', 'm3')[d - 1]}"
            box = ", ".join(
                f"{axis} {low * unit:.4g} to {high * unit:.4g}"
                for axis, low, high in zip("xyz", g.low, g.high, strict=True)
            )
            print(f"  {clean(g.name):{width}}  {g.elements:6d} elements  {size_of:>13}  {box} m")
