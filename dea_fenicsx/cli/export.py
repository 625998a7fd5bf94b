"""A run or a mesh in the files of others: VTU, an input file of Abaqus, or a table as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import LONGEST_PATH, clean

HELP = "a run or a mesh as VTU, VTKHDF, Abaqus' input file or CSV"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path, metavar="RESULTS|MESH",
                        help="results folder; or a .msh, .geo, .step or .stp file, for --inp")
    parser.add_argument("--vtu", action="store_true", help="for VTK, ParaView, pyvista and meshio")
    parser.add_argument("--vtkhdf", action="store_true",
                        help="all steps in one file, for ParaView 5.13 and newer")
    parser.add_argument("--inp", action="store_true", help="the undeformed mesh for Abaqus")
    parser.add_argument("--csv", action="store_true", help="a table of the nodes and their fields")
    parser.add_argument("--step", type=int, default=-1, metavar="N",
                        help="step to export, -1 for the last (default)")
    parser.add_argument("--all", action="store_true", help="all steps")
    parser.add_argument("--out", type=Path, metavar="FILE",
                        help="the file, where there is one (default: in the folder export of the "
                        "results, or beside the mesh)")
    parser.add_argument("--size", type=float, metavar="M",
                        help="largest element size of a .geo or STEP file in m")
    parser.add_argument("--unit", type=float, metavar="M",
                        help="unit of length of a mesh in m (default 1; STEP has its own)")
    parser.add_argument("--no-programs", action="store_true",
                        help="refuse a .geo file instead of running it")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    kinds = [kind for kind in ("vtu", "vtkhdf", "inp", "csv") if getattr(options, kind)]
    if not kinds:
        raise InputError("Say what to export to: --vtu, --vtkhdf, --inp or --csv.")
    if options.source.is_file():
        if kinds != ["inp"]:
            raise InputError("A mesh is exported as --inp alone; results have the other files.")
        return _mesh(options)
    from dea_fenicsx.pictures.export import export
    from dea_fenicsx.pictures.vtkhdf import export_vtkhdf
    from dea_fenicsx.results.reading import frame_times

    steps = range(len(frame_times(options.source))) if options.all else [options.step]
    if options.out is not None and len(kinds) * len(steps) > 1:
        raise InputError("--out names one file, but several are asked for; leave it out.")
    for kind in kinds:
        if kind == "vtkhdf":  # all steps, in any case
            print(clean(export_vtkhdf(options.source, options.out), LONGEST_PATH))
            continue
        for step in steps:
            path = export(options.source, kind, step, options.out)
            print(clean(path, LONGEST_PATH))
    return 0


def _mesh(options: argparse.Namespace) -> int:
    """Write the input file of a mesh; all elements are hybrid, because no material is known."""
    from dea_fenicsx.mesh.cad import lengths, open_file, read_names
    from dea_fenicsx.mesh.foreign.model import checked
    from dea_fenicsx.mesh.named_mesh import of_model
    from dea_fenicsx.pictures.curves import write_whole
    from dea_fenicsx.results.abaqus import input_file

    target = options.out or options.source.with_suffix(".inp")
    if target.exists():
        raise InputError(f"{target} exists already; give another file with --out.")
    unit, size = lengths(options.source, options.unit, options.size)
    model = open_file(
        options.source, None if size is None else size / unit,
        programs=False if options.no_programs else None,
    )  # fmt: skip
    try:
        names, dim = read_names(model, str(options.source))
        found = checked(model, names, dim, str(options.source), unit)
        model = found.model
        mesh = of_model(model, found.groups, dim, unit)
    finally:
        model.remove()
    text = input_file(mesh, title=options.source.name)
    print(clean(write_whole(target, lambda f: f.write_text(text, "ascii")), LONGEST_PATH))
    return 0
