"""From a source to a distributed mesh with tags: by gmsh, or at once where the cells are boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

from dea_fenicsx.geometry._gmsh import quality
from dea_fenicsx.mesh.boxes import boxes_of, distributed
from dea_fenicsx.mesh.cad import name_the_body, open_file, read_names
from dea_fenicsx.mesh.foreign.model import checked
from dea_fenicsx.mesh.foreign.options import gmsh_for, is_family
from dea_fenicsx.support import compat
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError


class Told(NamedTuple):
    """The facts of a source that rank 0 broadcasts.

    Attributes
    ----------
    groups, further : dimension and tag of each named group; tags that groups of facets share
    dim, space : dimension of the cells; number of coordinates, one more for a membrane
    quality, source : as in `Device`
    """

    groups: dict[str, tuple[int, int]]
    further: dict[str, tuple[int, ...]]
    dim: int
    space: int
    quality: dict[str, float]
    source: str


def of_boxes(
    source: Any, label: str, comm: MPI.Comm
) -> tuple[tuple[Any, Any, Any], Told] | None:
    """The mesh of a family whose cells are boxes, and what it is; None of others.  Collective."""
    boxes = together(
        comm, lambda: boxes_of(source) if comm.rank == 0 else None, f"The mesh of {label}"
    )
    told = None
    if boxes is not None:
        dim = boxes.given.dimension
        told = Told(boxes.groups, {}, dim, dim, boxes.quality, label)
    told = comm.bcast(told, root=0)
    return None if told is None else (distributed(boxes, comm), told)


def of_model(
    source: Any, label: str, comm: MPI.Comm, dim: int | None, unit: float, chosen: dict[str, Any]
) -> tuple[tuple[Any, Any, Any], Told]:
    """The mesh of a source that gmsh builds or reads, and what it is.  Collective."""
    model, told = None, None

    def open_and_check() -> None:
        nonlocal model, told
        if comm.rank == 0:
            model = _open(source, unit, chosen)
            if chosen["surfaces"]:
                name_the_body(model)
            model, told = _look_at(model, source, label, dim, unit, chosen["apart"])

    with gmsh_for(source, comm):
        try:
            together(comm, open_and_check, f"The mesh of {label}")
            told = comm.bcast(told, root=0)
            try:
                mesh, cells, facets = compat.model_to_mesh(model, comm, told.space)
            except RuntimeError as error:
                told_by = " ".join(str(error).split()).rstrip(".")
                raise InputError(f"The mesh of {label} cannot be used ({told_by}).") from error
        finally:
            if model is not None:
                model.remove()
    assert told
    return (mesh, cells, facets), told


def _open(source: Any, unit: float, options: dict[str, Any]) -> Any:
    """The gmsh model of a geometry or of a file (rank 0 only)."""
    size, names = options["size"], options["names"]
    if not hasattr(source, "build"):
        largest = None if size is None else size / unit
        return open_file(
            Path(source), largest, names, curved=options["curved"], programs=options["programs"]
        )
    if size is not None or names:
        raise InputError(
            f"size= and names= are for files that are still to be meshed; {type(source).__name__} "
            "has its own."
        )
    return source.build()


def _look_at(
    model: Any, source: Any, label: str, dim: int | None, unit: float, apart: bool
) -> tuple[Any, Told]:
    """Check a model, and bring it into cells that can be computed on (rank 0 only).

    Raises
    ------
    InputError
        If it cannot be used; the model stays then.
    """
    family = is_family(source)
    groups, cells = read_names(model, label, lines=family)
    if dim is not None and dim != cells:
        raise InputError(
            f"{label} has cells of dimension {cells}, but dim is {dim}; leave dim= out, or mesh "
            f"{'the volumes' if dim == 3 else 'a flat section'}."
        )
    further: dict[str, tuple[int, ...]] = {}
    notes: tuple[str, ...] = ()
    if not family:
        model, groups, further, notes = checked(model, groups, cells, label, unit, apart)
    name = f"{label} ({', '.join(notes)})" if notes else label
    space = source.dimension if family else cells
    return model, Told(groups, further, cells, space, quality(model), name)
