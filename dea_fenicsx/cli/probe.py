"""What `dea doctor` tries in processes of their own, since each may hang or kill its process.

``python -m dea_fenicsx.cli.probe solver|ranks|draw`` prints a line of JSON for each finding, as
soon as it is known.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import sys
import tempfile
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.support import form_cache


def tell(**facts: Any) -> None:
    print(json.dumps(facts), flush=True)


def ranks() -> None:
    """Hello from each rank, and a reduction over all."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    total = comm.allreduce(comm.rank + 1)
    if comm.rank == 0:
        tell(size=comm.size, total=total, library=_mpi_name(MPI.Get_library_version()))


def _mpi_name(text: str) -> str:
    """"MPICH 5.0.2" from what the library says about itself."""
    found = re.match(r"\s*(Open MPI|MPICH|Intel\S* MPI)?[^0-9]*([0-9.]*[0-9])?", text)
    return " ".join(part for part in (found.groups() if found else ()) if part)


def solver() -> None:
    """DOLFINx, PETSc's BLAS, MUMPS and the compiler of forms, in this order."""
    try:
        compat = import_module("dea_fenicsx.support.compat")
    except Exception as error:
        found = getattr(sys.modules.get("dolfinx"), "__version__", None)
        tell(dolfinx=found, failed=f"{type(error).__name__}: {error}")
        return
    PETSc = compat.PETSc
    tell(
        dolfinx=compat.dolfinx.__version__,
        petsc=".".join(map(str, PETSc.Sys.getVersion())),
        scalar=np.dtype(PETSc.ScalarType).name,
    )
    tell(blas=_blas(PETSc))
    try:
        tell(inertia=_inertia(PETSc))
    except Exception as error:
        tell(inertia=None, failed=" ".join(str(error).split())[-200:])
    _cache(compat)
    try:
        start = time.perf_counter()
        value = _form(compat)
        tell(form=value, seconds=time.perf_counter() - start)
    except Exception as error:
        lines = [line for line in str(error).splitlines() if line.strip()] or ["no message"]
        tell(form=None, failed=f"{type(error).__name__}: {lines[-1][-200:]}")


def _blas(PETSc: Any, n: int = 700) -> dict[str, Any]:
    """Rate of a product of dense matrices in PETSc, threads it ran on, and the libraries loaded."""
    a = PETSc.Mat().createDense((n, n), comm=PETSc.COMM_SELF)
    a.setUp()
    a.setRandom()
    a.assemble()
    b = a.matMult(a)  # the first one starts threads
    best, threads = 0.0, 1.0
    for _ in range(3):
        wall, cpu = time.perf_counter(), time.process_time()
        a.matMult(a, b)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        if 2e-9 * n**3 / wall > best:
            best, threads = 2e-9 * n**3 / wall, cpu / wall
    libraries: list[str] = []
    with suppress(OSError), open("/proc/self/maps") as maps:
        files = {line.split()[-1] for line in maps if "/" in line}
        libraries = sorted(f for f in files if re.search(r"blas|libmkl|blis", Path(f).name))
    plain = [f for f in libraries if Path(f).name.startswith("libblas") and _is_reference(f)]
    return {"gigaflops": best, "threads": threads, "libraries": libraries, "plain": plain}


def _is_reference(library: str) -> bool:
    """Whether a BLAS is none of the optimised ones, going by the functions that these add."""
    marks = ("openblas_get_config", "MKL_Get_Version", "bli_info_get_version_str", "ATL_buildinfo")
    with suppress(OSError):
        loaded = ctypes.CDLL(library)
        return not any(hasattr(loaded, mark) for mark in marks)
    return False


def _inertia(PETSc: Any) -> list[int]:
    """MUMPS's L D L^T of a matrix with two negative eigenvalues: negative, zero, positive."""
    entries = np.array([[2.0, 1, 0, 0], [1, -3, 1, 0], [0, 1, 0, 2], [0, 0, 2, 1]])
    mat = PETSc.Mat().createAIJ((4, 4), nnz=4, comm=PETSc.COMM_SELF)
    mat.setValues(range(4), range(4), entries)
    mat.assemble()
    mat.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setUp()
    negative = pc.getFactorMatrix().getMumpsInfog(12)
    x, rhs = mat.createVecs()
    rhs.set(1.0)
    pc.apply(rhs, x)
    error = np.abs(entries @ x.array - 1).max()
    wanted = int((np.linalg.eigvalsh(entries) < 0).sum())
    if error > 1e-12:
        raise ArithmeticError(f"the solution is wrong by {error:.1e}")
    return [negative, wanted]


def _cache(compat: Any) -> None:
    """Whether the folder of compiled forms can be written."""
    folder = Path(compat.jit_options()["cache_dir"])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        tell(cache=str(folder), damaged=form_cache.all_damaged(folder))
    except OSError as error:
        tell(cache=None, folder=str(folder), failed=error.strerror)


def _form(compat: Any) -> float:
    """Compile a form afresh and integrate it: the length of the unit interval."""
    import ufl
    from mpi4py import MPI

    mesh = compat.dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, 2)
    with tempfile.TemporaryDirectory() as scratch:
        options = compat.jit_options() | {"cache_dir": Path(scratch)}
        one = compat.dolfinx.fem.Constant(mesh, compat.PETSc.ScalarType(1))
        form = compat.dolfinx.fem.form(one * ufl.dx(domain=mesh), jit_options=options)
        return float(np.real(compat.dolfinx.fem.assemble_scalar(form)))


def draw() -> None:
    """Draw a triangle as a picture in memory."""
    import io
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import matplotlib
    from matplotlib.figure import Figure

    from dea_fenicsx.pictures.raster import Canvas

    canvas = Canvas(64, 64)
    corners = np.array([[4.0, 4.0, 0.0], [60.0, 4.0, 0.0], [4.0, 60.0, 0.0]])
    red = np.array([[255, 0, 0]])
    canvas.fill(corners, np.array([[0, 1, 2]]), np.ones(1), False, red, red[0], (0.0, 1.0))
    figure = Figure(figsize=(1, 1))
    figure.subplots().imshow(canvas.image())
    file = io.BytesIO()
    figure.savefig(file, format="png")
    tell(drawn=len(file.getvalue()) > 0, matplotlib=matplotlib.__version__)


if __name__ == "__main__":
    {"ranks": ranks, "solver": solver, "draw": draw}[sys.argv[1]]()
    sys.stdout.flush()
    if sys.argv[1] == "draw":
        os._exit(0)  # some drivers crash while they are unloaded
