"""Where DOLFINx 0.9 and 0.11 differ (meshes: `dolfinx_meshes`), and where they are imported.

All other modules take `dolfinx` and `PETSc` from here: with the PyPI wheel the shared libraries are
found only once ``dolfinx_solver`` has been imported.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NoReturn

from dea_fenicsx.support.agreement import before_petsc

with suppress(ImportError):
    before_petsc()  # the first import of petsc4py waits for all ranks
    import dolfinx_solver  # noqa: F401  (loads the wheel's libraries)

import basix
import basix.ufl
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from ffcx.codegeneration import jit
from mpi4py import MPI
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction
from ufl.domain import extract_unique_domain

from dea_fenicsx.support import (
    derived_forms,
    form_kinds,
    ufl_patches,  # noqa: F401  (changes UFL when it is imported)
)
from dea_fenicsx.support.compiling_ahead import compile_ahead
from dea_fenicsx.support.dolfinx_objects import DolfinxObjects
from dea_fenicsx.support.errors import MachineError
from dea_fenicsx.support.form_cache import cache_dir, compiling

__all__ = ["PETSc", "add_assembled", "collapse", "compile_derived", "compile_form",
           "compile_together", "coordinate_element", "copied_mesh", "create_vector", "dolfinx",
           "expression", "geometry_dofmap", "interpolation_matrix", "jit_options"]  # fmt: skip

_objects = DolfinxObjects(dolfinx)
VERSION = _objects.version

# On Q2 hexahedra these flags halve the time to assemble the tangent, compared with -O2, and -g0
# halves the time to compile.  -freciprocal-math saves an eighth of the time of a product with the
# tangent.  We do not use -ffast-math, because it would hide the NaN of a failed trial step.
# A kernel is one block of thousands of statements.  The second scheduling pass of gcc compares all
# pairs of them.  Without this pass the product of a helical cell compiles in 0.7 s instead of 86 s,
# and runs as fast.
_COMPILE_FLAGS = ["-g0", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math",
                  "-fassociative-math", "-fno-signed-zeros", "-freciprocal-math",
                  "-fno-schedule-insns2"]  # fmt: skip


def jit_options() -> dict[str, Any]:
    """Options for FFCx's just-in-time compiler.

    The environment variable DEA_FENICSX_CFLAGS replaces the compiler's flags: ``-O1 -g0`` compiles
    in half the time what will run once.
    """
    flags = os.environ.get("DEA_FENICSX_CFLAGS", "").split() or list(_COMPILE_FLAGS)
    # another run may be compiling the same form: wait for it
    return {"cffi_extra_compile_args": flags, "cache_dir": cache_dir(), "timeout": 300}


def copied_mesh(mesh: Any) -> Any:
    """A mesh with the topology of another one and a copy of its coordinates."""
    geometry = mesh.geometry._cpp_object
    one = VERSION < (0, 11)
    made = dolfinx.cpp.mesh.Geometry_float64(
        geometry.index_map(),
        np.array(geometry.dofmap if one else geometry.dofmaps[0], dtype=np.int32),
        geometry.cmap if one else geometry.cmaps[0],
        np.array(geometry.x[:, : geometry.dim], dtype=np.float64),
        np.array(geometry.input_global_indices, dtype=np.int64),
    )
    copy = dolfinx.cpp.mesh.Mesh_float64(mesh.comm, mesh._cpp_object.topology, made)
    return dolfinx.mesh.Mesh(copy, ufl.Mesh(mesh.ufl_domain().ufl_coordinate_element()))


def slepc() -> Any:
    """SLEPc, which few runs need: it is imported at the first call.  Collective.

    Raises
    ------
    MachineError
        If it is not installed.
    """
    try:
        from slepc4py import SLEPc
    except ImportError as error:
        raise MachineError(
            "Eigenvalues are found by slepc4py, which is not installed; on Debian it is the "
            "package python3-slepc4py, and the wheel dolfinx-solver-real brings it along."
        ) from error
    return SLEPc


class _StripVariables(MultiFunction):
    """Replaces each ufl.variable by what it stands for.

    UFL's own strip_variables visits a shared sub-expression once for each use, which for principal
    stretches takes for ever.
    """

    expr = MultiFunction.reuse_if_untouched

    def variable(self, _: Any, inner: Any, label: Any) -> Any:
        return inner

    def variable_derivative(self, *_: Any) -> NoReturn:
        raise _HasDerivatives

    def coefficient_derivative(self, *_: Any) -> NoReturn:
        raise _HasDerivatives


class _HasDerivatives(Exception):
    """An expression has derivatives by variables or functions, which have to be expanded first."""


def expression(expr: Any, points: np.ndarray) -> Callable[[Any, np.ndarray], np.ndarray]:
    """Compiled evaluation of a UFL expression at reference points of cells.

    Returns a function ``(mesh, cells) -> values`` of shape (cells, points, components).
    """
    compiled = _compiled_expression(expr, points)
    size = int(np.prod(expr.ufl_shape, dtype=int))

    def evaluate(mesh: Any, cells: np.ndarray) -> np.ndarray:
        if len(cells) == 0:
            return np.empty((0, len(points), size))
        values = _objects.values(compiled, mesh, cells)
        return np.asarray(values).reshape(len(cells), len(points), size)

    return evaluate


def _compiled_expression(expr: Any, points: np.ndarray) -> Any:
    """A compiled expression, of DOLFINx."""
    kind, options = form_kinds.kind_of_expression(expr, points), jit_options()
    comm = _ranks_of(kind.domain if kind else extract_unique_domain(expr))
    made = _kept(kind, options, comm)
    if kind and made is not None:
        return _objects.expression(kind, *made)
    # The labels of ufl.variable contain running numbers, so the code of each problem would be new.
    try:
        expr = map_expr_dag(_StripVariables(), expr)
    except _HasDerivatives:
        expr = map_expr_dag(_StripVariables(), expand_derivatives(expr))
    with compiling(jit, comm):
        compiled = dolfinx.fem.Expression(expr, points, jit_options=options)
    _objects.keep_expression(kind, _plain(options), compiled)
    return compiled


def _kept(kind: form_kinds.Kind | None, options: dict[str, Any], comm: MPI.Comm) -> Any:
    """What all ranks have kept for a kind, or None.  Collective.

    A rank may have compiled more than the others, and to compile is collective.
    """
    found = form_kinds.kept(kind, _plain(options))
    if comm.size > 1 and not comm.allreduce(found is not None, op=MPI.LAND):
        return None
    return found


def _plain(options: dict[str, Any]) -> tuple:
    """Options of the compiler that can be part of a key."""
    return str(options["cache_dir"]), tuple(options["cffi_extra_compile_args"])


def _ranks_of(domain: Any) -> MPI.Comm:
    """Communicator of the mesh on which an expression is compiled."""
    return MPI.COMM_SELF if domain is None else domain.ufl_cargo().comm


def collapse(subspace: Any) -> tuple[Any, np.ndarray]:
    """A sub-space standing alone, and where its local degrees of freedom lie in the whole.

    0.11 wraps the numbers in a list, one entry for each cell type.
    """
    space, dofs = subspace.collapse()
    return space, np.asarray(dofs, dtype=np.int32).ravel()


def geometry_dofmap(mesh: Any) -> np.ndarray:
    """Geometry nodes of each local cell, shape (cells, nodes)."""
    return mesh.geometry.dofmap if VERSION < (0, 11) else mesh.geometry.dofmaps[0]


def _kind_of(form: Any) -> form_kinds.Kind | None:
    """The kind of a form, which the form keeps."""
    if KIND not in form._cache:
        form._cache[KIND] = form_kinds.kind_of_form(form)
    return form._cache[KIND]


KIND = "kind of dea_fenicsx"
"""Name of its kind in the dictionary that a form of UFL has for others."""


def compile_derived(
    first: Any, how: str, by: Any, make: Callable[[], Any], beside: Sequence[Any] = ()
) -> Any:
    """Compile a form that follows from another one alone, as its derivative does.  Collective.

    Parameters
    ----------
    first
        The other form.
    how
        How the form follows from it: the same word for the same form.
    by
        The function by which the other form is differentiated.
    make
        Gives the form.
    beside
        Further functions of the form, made after those of the other form.
    """
    parent, options = _kind_of(first), jit_options()
    functions = [] if parent is None else parent.coefficients
    what = how, len(beside), *(place for place, function in enumerate(functions) if function is by)
    recipe = derived_forms.known(parent, what)
    kind = None if parent is None or recipe is None else recipe.kind(parent, beside)
    comm = _ranks_of(parent.domain if parent else first.ufl_domains()[0])
    made = _kept(kind, options, comm)
    if kind and made is not None:
        return _objects.form(kind, *made)
    form = make()
    compiled = compile_form(form)
    derived_forms.note(parent, what, _kind_of(form), beside)
    return compiled


def compile_form(form: Any) -> Any:
    """Compile a UFL form with this package's options."""
    kind, options = _kind_of(form), jit_options()
    comm = _ranks_of(kind.domain if kind else form.ufl_domains()[0])
    made = _kept(kind, options, comm)
    if kind and made is not None:
        return _objects.form(kind, *made)
    with compiling(jit, comm):
        compiled = dolfinx.fem.form(form, jit_options=options)
    _objects.keep_form(kind, _plain(options), form, compiled)
    return compiled


def compile_together(first: Any, others: Callable[[], Sequence[Any]]) -> None:
    """Compile forms into the cache side by side, if the first is not there.  Collective."""

    def make(form: Any) -> Any:
        scalar = {"scalar_type": dolfinx.default_scalar_type}
        return dolfinx.jit.ffcx_jit(MPI.COMM_SELF, form, scalar, jit_options())

    kind = _kind_of(first)
    comm = _ranks_of(kind.domain if kind else first.ufl_domains()[0])
    if _kept(kind, jit_options(), comm) is None:
        with compiling(jit, comm):
            compile_ahead(jit, make, first, others)


def add_assembled(values: np.ndarray, form: Any) -> None:
    """Add a compiled linear form, as this rank's cells give it, to local values, ghosts included.

    DOLFINx's own function asks for the kinds of its arguments first, which takes as long as the
    assembly over some ten cells.
    """
    made = form._cpp_object
    constants = dolfinx.cpp.fem.pack_constants(made)
    coefficients = dolfinx.cpp.fem.pack_coefficients(made)
    dolfinx.cpp.fem.assemble_vector(values, made, constants, coefficients)


def create_vector(form: Any) -> Any:
    """A ghosted PETSc vector for a linear form's function space."""
    if VERSION >= (0, 10):
        return dolfinx.fem.petsc.create_vector(form.function_spaces[0])
    return dolfinx.fem.petsc.create_vector(form)


def keeps_single() -> bool:
    """Whether this PETSc (3.24 or later) can keep a factor of MUMPS in single precision."""
    return bool(PETSc.Sys.getVersion() >= (3, 24))


def interpolation_matrix(coarse: Any, fine: Any) -> Any:
    """The PETSc matrix that interpolates from one space onto another one of the same mesh."""
    if hasattr(dolfinx.fem.petsc, "interpolation_matrix"):
        made = dolfinx.fem.petsc.interpolation_matrix(coarse, fine)
    else:
        make = dolfinx.cpp.fem.petsc.interpolation_matrix
        made = make(coarse._cpp_object, fine._cpp_object)
    made.assemble()
    return made


def mark_positive(matrix: Any) -> None:
    """Tell PETSc that a matrix is positive definite; blocks on ranks take it from 3.24 on."""
    blocks = matrix.getType() == "mpibaij" and PETSc.Sys.getVersion() < (3, 24)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC if blocks else PETSc.Mat.Option.SPD, True)


def set_precision(pc: Any, single: bool) -> None:
    """Let MUMPS keep this factor in single precision, where PETSc can (3.24), or in double.

    PETSc notes the prefix with the matrix, which two factors may share: so both kinds have one.
    """
    prefix = "dea_single_" if single else "dea_double_"
    if single and keeps_single():
        PETSc.Options()[f"{prefix}pc_precision"] = "single"
    pc.setOptionsPrefix(prefix)
    pc.setFromOptions()


def coordinate_element(mesh: Any) -> Any:
    """The scalar basix element in which a mesh's coordinates are given."""
    cmap = mesh.geometry.cmap if VERSION < (0, 11) else mesh.geometry.cmaps[0]
    variants = basix.LagrangeVariant
    variant = variants(cmap.variant) if cmap.degree > 2 else variants.gll_warped
    kind = getattr(basix.CellType, mesh.topology.cell_name())
    return basix.create_element(basix.ElementFamily.P, kind, cmap.degree, variant)
