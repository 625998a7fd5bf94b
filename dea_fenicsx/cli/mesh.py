"""The named parts and surfaces of a mesh, a .geo or a STEP file: what a scene can refer to."""

from __future__ import annotations

import argparse
from pathlib import Path

from dea_fenicsx.errors import InputError
from dea_fenicsx.files import clean

HELP = "the names in a .msh, .geo or STEP file"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="a .msh, .geo, .step or .stp file")
    parser.add_argument("--size", type=float, metavar="M",
                        help="largest element size in m, for .geo and STEP")  # fmt: skip
    parser.add_argument("--unit", type=float, metavar="M",
                        help="unit of length in m (default 1; STEP has its own)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx.cad import groups_of, lengths, open_file
    from dea_fenicsx.geometry._gmsh import quality

    unit, size = lengths(options.file, options.unit, options.size)
    model = open_file(options.file, None if size is None else size / unit)
    try:
        groups = groups_of(model, str(options.file))
        good = quality(model)
    finally:
        model.remove()
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
    print(f"least scaled Jacobian of a cell {good['least_scaled_jacobian']:.3g} (must be > 0), "
          f"longest over shortest edge {good['largest_aspect']:.3g}")  # fmt: skip
    if not any(g.dim == dim - 1 for g in groups):
        raise InputError(
            f"{options.file} names no surface; an electrode or a support needs a physical group "
            f"of dimension {dim - 1}."
        )
    return 0
