"""Recognises the kind of a file and reads it into gmsh without running anything in it.

gmsh takes a file of an unknown kind for a script, whatever its name, and a script can run any
command.  It also runs the file ``X.msh.opt`` beside a mesh ``X.msh``, and asks the shell to unpack
``.gz``.  So the kind of a file is settled here, by its suffix and by its first bytes.  gmsh only
gets to see a private copy with a plain name in an empty folder.  What is a program by its kind, a
.geo script, runs unless programs are refused.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from dea_fenicsx.mesh.foreign.msh2 import one_group_each
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.subprocesses import environment

GEO = (".geo", ".geo_unrolled")
STEP = (".step", ".stp")
OTHER = (".med", ".unv", ".bdf", ".nas", ".mesh", ".vtk", ".cgns", ".diff")
"""Formats of meshes with a reader of their own in gmsh, which takes none of them for a script."""

KNOWN = (".msh", *GEO, *STEP, *OTHER)

NO_PROGRAMS = "DEA_FENICSX_NO_PROGRAMS"
"""Environment variable: refuse files that are programs wherever nothing else is said."""

_HEADS = (b"$MeshFormat", b"$Comments", b"$NOD")
"""Beginnings of a .msh file by which gmsh takes it for a mesh."""


def kind_of(path: Path) -> str:
    """The suffix of a file in small letters, one of `KNOWN`.

    Raises
    ------
    InputError
        If there is no such file, its kind is not known, or a .msh does not begin as one.
    """
    if not path.is_file():
        raise InputError(f"There is no mesh file {path}; give a gmsh .msh or .geo, or a STEP file.")
    kind = path.suffix.lower()
    if kind not in KNOWN:
        raise InputError(
            f"{path} has a suffix that is not known here, and gmsh would run it as a program; give "
            f"one of {', '.join(KNOWN)}."
        )
    try:
        head = _head(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); see to its rights.") from error
    if kind == ".msh" and not head.startswith(_HEADS):
        raise InputError(
            f"{path} does not begin with $MeshFormat, so it is no mesh of gmsh; a script must be "
            "named .geo."
        )
    return kind


def is_drawing(path: str | os.PathLike) -> bool:
    """Whether a file holds a shape that is still to be meshed."""
    return Path(path).suffix.lower() in (*GEO, *STEP)


def check_program(path: Path, programs: bool | None) -> None:
    """Refuse a file that is a program, if programs are to be refused.

    Raises
    ------
    InputError
        If it is one and `programs` is False, or None with `NO_PROGRAMS` set.
    """
    if programs is None:
        programs = not os.environ.get(NO_PROGRAMS)
    if not programs and path.suffix.lower() in GEO:
        raise InputError(
            f"{path} is a program of gmsh, which can run any command, and programs are refused; "
            "let who wrote it mesh it and give a .msh."
        )


def merge(path: Path, kind: str) -> None:
    """Merge a mesh or a script into the current gmsh model.

    Parameters
    ----------
    path, kind
        The file and what `kind_of` says of it; no STEP file.

    Raises
    ------
    InputError
        If its data are damaged in a way that ends gmsh.
    Exception
        Of gmsh, if it cannot read the file.
    """
    import gmsh

    with tempfile.TemporaryDirectory(prefix="dea_mesh_") as folder:
        place = Path(folder)
        if kind in GEO:
            gmsh.merge(str(_including(path, place)))
            return
        copy = place / f"mesh{kind}"
        shutil.copyfile(path, copy)
        if kind == ".msh":
            if not _head(copy).startswith(_HEADS):
                raise InputError("it does not begin with $MeshFormat")
            one_group_each(copy)
        gmsh.merge(str(_checked_copy(copy)))


def _head(path: Path) -> bytes:
    with open(path, "rb") as file:
        return file.read(64)


def _including(path: Path, folder: Path) -> Path:
    """A script that includes a script, so that gmsh finds no options beside it.

    Names of files in the included script count from its own folder, as they should.
    """
    if '"' in str(path) or "\n" in str(path):
        raise InputError("its path holds a quotation mark")
    script = folder / "drawing.geo"
    script.write_text(f'Include "{path.absolute()}";\n')
    return script


_COPY = """
import resource, sys, gmsh
for limit, most in ((resource.RLIMIT_DATA, sys.argv[3]), (resource.RLIMIT_CPU, sys.argv[4])):
    resource.setrlimit(limit, (int(most), resource.getrlimit(limit)[1]))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
gmsh.initialize([], readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
model = gmsh.model
try:
    gmsh.merge(sys.argv[1])
    model.mesh.getNodes()
    for group in model.getPhysicalGroups():
        model.getPhysicalName(*group)
        model.mesh.getNodesForPhysicalGroup(*group)
    for dim, tag in model.getEntities():
        for tags in model.mesh.getElements(dim, tag)[1]:
            if dim > 1:
                model.mesh.getElementQualities(tags, "minEdge")
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    gmsh.write(sys.argv[2])
    gmsh.clear()
    gmsh.merge(sys.argv[2])
except Exception as error:
    print(error, file=sys.stderr)
    sys.exit(1)
"""


def _checked_copy(path: Path) -> Path:
    """A copy of a mesh that gmsh writes in a process of its own.

    gmsh believes what a file says of its sizes: of damaged ones it dies at once, asks for memory
    without end, or reports an error and has spoilt the memory of the process, which then dies
    anywhere.  So that process has limits, far above what a sound file of its length needs, and it
    reads its copy again, which gmsh may have spoilt as well.
    Python's option -P keeps that process from importing modules out of the working directory.
    """
    copy, length = path.with_name("copy.msh"), path.stat().st_size
    limits = [str(4_000_000_000 + 200 * length), str(20 + length // 50_000)]  # bytes, s
    done = subprocess.run(
        [sys.executable, "-P", "-c", _COPY, str(path), str(copy), *limits], env=environment(),
        stdin=subprocess.DEVNULL, capture_output=True, check=False, text=True, errors="replace",
    )  # fmt: skip
    if done.returncode < 0:
        raise InputError("it ends gmsh itself, so its data must be damaged")
    if done.returncode:
        told = " ".join(done.stderr.split()).rstrip(".")
        raise InputError(told or "its data must be damaged")
    return copy
