"""Options of a gmsh that a script has started and goes on using."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
