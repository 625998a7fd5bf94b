"""gmsh, started where it does not run, and left as it was where a script goes on using it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dea_fenicsx.geometry._gmsh import start
from dea_fenicsx.mesh.foreign.meshing import ABORT

_LINE = re.compile(r"^(\w+(?:\.\w+)+) = (\".*\"|[-+.\deE]+); //", re.M)
"""A number or a text in gmsh's file of options.  Colours are left out: no mesh depends on them."""

_READ_ONLY = ("General.Build", "General.ExecutableFileName", "General.Version")


@contextmanager
def kept_option(name: str) -> Iterator[None]:
    """Give one numerical option its value back after the block, if gmsh runs until then."""
    import gmsh

    before = gmsh.option.getNumber(name)
    try:
        yield
    finally:
        if gmsh.isInitialized():
            gmsh.option.setNumber(name, before)


@contextmanager
def kept_options() -> Iterator[None]:
    """Give all options their values back after the block.

    A drawing (.geo) may set options of gmsh.  They would hold for the next file that is read, so
    that the mesh of one file would depend on which files were read before.
    """
    import gmsh

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "before.opt"
        gmsh.write(str(file))  # of all options, those which differ from gmsh's defaults
        before = _LINE.findall(file.read_text("utf-8", errors="replace"))
    try:
        yield
    finally:
        gmsh.option.restoreDefaults()
        for name, value in before:
            if name.startswith(_READ_ONLY):
                continue
            if value.startswith('"'):
                gmsh.option.setString(name, value[1:-1])
            else:
                gmsh.option.setNumber(name, float(value))


def is_family(source: Any) -> bool:
    """Whether a geometry is one of this package's own, whose meshes need no check."""
    return type(source).__module__.startswith("dea_fenicsx.geometry.")


@contextmanager
def gmsh_for(source: Any, comm: MPI.Comm) -> Iterator[None]:
    """Run gmsh on rank 0 and leave it as it was, because the script may use it as well.

    An object of the user's own may have started it for longer, so there it keeps running.
    """
    if comm.rank:
        yield
        return
    import gmsh

    before = gmsh.model.getCurrent() if gmsh.isInitialized() else None
    is_file = not hasattr(source, "build")
    mine = (is_family(source) or is_file) and start()
    kept: AbstractContextManager[None] = nullcontext()
    if before is not None:
        kept = kept_options() if is_file else kept_option(ABORT)
    try:
        with kept:
            if before is not None:
                gmsh.option.setNumber(ABORT, 2)  # raises; a script may have reset all options
            yield
    finally:
        if mine:
            gmsh.finalize()
        elif before is not None and before in gmsh.model.list():
            gmsh.model.setCurrent(before)
