"""gmsh, started where it does not run, and left as it was where a script goes on using it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dea_fenicsx.geometry._gmsh import start
from dea_fenicsx.mesh.foreign.meshing import ABORT

_LINE = re.compile(r"^(\w+(?:\.\w+)+) = (\".*\"|[-+.\deE]+); //", re.M)
"""A number or a text in gmsh's file of options.  Colours are left out: no mesh depends on them."""

_READ_ONLY = ("General.Build", "General.ExecutableFileName", "General.Version")


def _present() -> list[tuple[str, str]]:
    """All options that differ from gmsh's defaults, by name."""
    import gmsh

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "present.opt"
        gmsh.write(str(file))
        return _LINE.findall(file.read_text("utf-8", errors="replace"))


def _restore(options: list[tuple[str, str]]) -> None:
    """Give all options the values that `_present` has told."""
    import gmsh

    gmsh.option.restoreDefaults()
    for name, value in options:
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

    A drawing (.geo) and an object of the user's own may set options.  They would hold for what is
    read next, so that its mesh would depend on what was read before.  So all options get their
    values back.  An object of the user's own may have started gmsh for longer, so there it keeps
    running.
    """
    if comm.rank:
        yield
        return
    import gmsh

    before = gmsh.model.getCurrent() if gmsh.isInitialized() else None
    options = [] if before is None else _present()
    mine = (is_family(source) or not hasattr(source, "build")) and start()
    if before is not None:
        gmsh.option.setNumber(ABORT, 2)  # raises; a script may have reset all of gmsh's options
    try:
        yield
    finally:
        if mine:
            gmsh.finalize()
        elif gmsh.isInitialized():
            _restore(options)
            if before is not None and before in gmsh.model.list():
                gmsh.model.setCurrent(before)
