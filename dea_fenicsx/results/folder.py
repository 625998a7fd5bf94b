"""A run's folder: fields for ParaView, history, summary and checkpoint, safe against a kill.

    fields.xdmf     one grid for each step that holds every field; ParaView opens this
    fields.h5       its numbers (while the run lasts: one small file a step in parts/)
    electrodes.xdmf the electrodes that are surfaces, each a block by its name; no numbers
    surfaces.xdmf   all other named surfaces in the same way
    nodal.xdmf      the same as fields.xdmf with all fields at the nodes, if they are not too many
    fields_X.xdmf   the same on the surface X, where the writer of fields has surfaces
    history.csv     a row for each accepted step
    summary.json    settings, versions, sizes, final observables
    checkpoint.npz  the last accepted state, to resume from
    states/         the state of each step, to start another run from, if they are kept
    modes/          the null vector of each critical point, on its deformed state
    script.py       the script that made it
    run.log         what the run said, with the time of day
    previous/       an earlier run's files; those of later ones in previous_2/ and so on

Each file is written under another name and then renamed, so that at any moment every file on disk
is whole.  Rank 0 writes.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.results import checkpoint, hdf5, provenance, xdmf
from dea_fenicsx.results.fields import Fields, Grid
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.plain_text import json_value, number_text
from dea_fenicsx.results.reading import read_history, read_summary
from dea_fenicsx.results.shared_folder import SharedFolder
from dea_fenicsx.results.split_grid import SplitGrid
from dea_fenicsx.results.spread import Table
from dea_fenicsx.results.surface_blocks import DOCUMENTS, Blocks, block_xml, blocks_in
from dea_fenicsx.results.surface_names import (
    NODAL,
    NODAL_DOCUMENT,
    SURFACES,
    surface_document,
    surface_group,
    surface_of,
)
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import free_name, replace_file

__all__ = ["RUN_FILES", "Folder", "read_history", "read_summary", "replace_file"]

RUN_FILES = (
    "fields.xdmf", "fields.h5", "history.csv", "summary.json", "checkpoint.npz", "parts", "modes",
    "states", "run.log", NODAL_DOCUMENT, *DOCUMENTS,
)  # fmt: skip


class Folder(SharedFolder):
    """A run's results folder, handled by rank 0 alone.

    Parameters
    ----------
    path
        The folder.
    comm
        Communicator of the run; errors on rank 0 are raised on all ranks.

    Raises
    ------
    InputError
        If the folder cannot be made or written.
    """

    def __init__(self, path: str | os.PathLike, comm: MPI.Comm) -> None:
        super().__init__(path, comm)
        self.origin: dict[str, Any] = {}
        self._summary: bytes | None = None
        self._said: dict[str, dict[int, tuple[float, str]]] = {}  # time and text, by step
        self._surfaces: tuple[str, ...] = ()
        self._nodal = False

    def start(self) -> None:
        """Make room for a new run: an earlier run's files move into a folder previous...

        Nothing is deleted: the first one's go to previous/, the next one's to previous_2/.
        Collective.
        """

        def action() -> None:
            found = [n for n in RUN_FILES if os.path.lexists(self.path / n)]
            found += sorted(file.name for file in self.path.glob("fields_*.xdmf"))
            if found:
                old = free_name(self.path / "previous")
                old.mkdir()
                copies = [
                    name
                    for name in (provenance.COPY, provenance.RESUMED)
                    if (self.path / name).exists() and not provenance.is_script(self.path / name)
                ]
                # Move the checkpoint first: if the run is killed here, nothing wrong is resumed.
                for name in sorted([*found, *copies], key=lambda n: n != "checkpoint.npz"):
                    os.replace(self.path / name, old / name)
            (self.path / "parts").mkdir(exist_ok=True)

        self.together(action)

    def keep_origin(self) -> None:
        """Copy the script into the folder, and find out its state in git.  Collective."""

        def action() -> dict[str, Any]:
            provenance.keep_script(self.path)
            return provenance.origin()

        self.origin = self.together(action)

    # -------------------------------------------------------------- checkpoint

    def load_checkpoint(self) -> tuple[dict[str, Any], list[np.ndarray]] | None:
        """The last accepted step: what was told to `write_step`, and the states (rank 0).

        Collective; the first part is given to all ranks, the states to rank 0 only: the others get
        an empty list.  None if the folder holds no checkpoint.
        """
        file = self.path / "checkpoint.npz"
        states: list[np.ndarray] = []

        def action() -> dict[str, Any] | None:
            if not file.exists():
                return None
            told, found = checkpoint.read(file)
            states.extend(found)
            return told

        told = self.together(action)
        return None if told is None else (told, states)

    # ------------------------------------------------------------------ writing

    def write_grid(
        self,
        grid: Grid | None,
        surfaces: Mapping[str, Grid] = MappingProxyType({}),
        blocks: Blocks | None = None,
        nodal: SplitGrid | None = None,
    ) -> None:
        """Write the undeformed grid, those of surfaces by their names, and blocks (rank 0).

        `nodal` is the split grid of the fields at nodes.

        Surfaces that a run had before it was resumed without them keep their grids.
        """
        if self.comm.rank != 0:
            return
        assert grid is not None
        (self.path / "parts").mkdir(exist_ok=True)

        def put(h5: Any) -> None:
            hdf5.put_grid(h5, grid)
            if blocks is not None:
                blocks.put(h5)
            if nodal is not None:
                hdf5.put_split_grid(h5.create_group(NODAL), nodal)
            for name, surface in surfaces.items():
                hdf5.put_grid(h5.create_group(surface_group(name)), surface)
            earlier = self._where(self.path / "parts" / "grid.h5", "grid/", False)
            groups = hdf5.carry_over(h5, *earlier, SURFACES)
            self._surfaces = tuple(surface_of(group) for group in groups)

        self._nodal = nodal is not None
        replace_file(self.path / "parts" / "grid.h5", hdf5.image(put))
        self._said.clear()

    def write_step(
        self,
        step: int,
        told: dict[str, Any] | None,
        history: list[dict[str, Any]],
        nodes: Mapping[str, Table] | None,
        cells: Mapping[str, Table] | None,
        states: Sequence[Table | None],
        surfaces: Mapping[str, tuple[Fields, Fields]] = MappingProxyType({}),
        nodal: Mapping[str, Table] | None = None,
    ) -> None:
        """Write an accepted step: fields first, the checkpoint that vouches for them last.

        Without anything told there is no checkpoint, and a run is resumed from the step before.
        `states` has this step's state in each cell, and earlier states after it.  `surfaces` has
        the fields at nodes and of cells for each surface, `nodal` those on the split grid.
        """
        if self.comm.rank != 0:
            return

        def put_fields(h5: Any) -> None:
            assert nodes is not None and cells is not None
            hdf5.put_fields(h5, nodes, cells)
            if nodal is not None:
                hdf5.put_nodal_fields(h5.create_group(NODAL), nodal)
            for name, (on_nodes, on_cells) in surfaces.items():
                hdf5.put_fields(h5.create_group(surface_group(name)), on_nodes, on_cells)

        if nodes is not None:
            replace_file(self._part(step), hdf5.image(put_fields))
            for said in self._said.values():
                said.pop(step, None)
            self.write_xdmf(history)
        self.write_history(history)
        if told is None:
            return

        values, facts = [one for one in states if one is not None], told
        replace_file(
            self.path / "checkpoint.npz", lambda target: checkpoint.write(target, values, facts)
        )

    def write_history(self, history: list[dict[str, Any]]) -> None:
        """Write history.csv: a row for each accepted step (rank 0)."""
        if self.comm.rank != 0:
            return

        def write(target: Path) -> None:
            with open(target, "w", newline="") as f:
                writer = csv.DictWriter(f, fieldnames=list(history[0]))
                writer.writeheader()
                writer.writerows({k: number_text(v) for k, v in row.items()} for row in history)

        replace_file(self.path / "history.csv", write)

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json (rank 0)."""
        if self.comm.rank != 0:
            return
        text = json.dumps(json_value(summary), indent=2, ensure_ascii=False) + "\n"
        data = text.encode("utf-8", "replace")
        replace_file(self.path / "summary.json", lambda target: target.write_bytes(data))
        self._summary = data

    def add_to_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json again, unless another run has the folder by now (rank 0).

        Raises
        ------
        InputError
            If the folder holds another run, or one is writing into it.
        """
        if self.comm.rank != 0:
            return
        self.lock.take()
        try:
            file = self.path / "summary.json"
            if file.exists() and self._summary not in (None, file.read_bytes()):
                raise InputError(
                    f"{self.path} holds another run by now, whose summary is left as it is; give "
                    "each run a folder of its own."
                )
            self.write_summary(summary)
        finally:
            self.lock.release()

    def _part(self, step: int) -> Path:
        return self.path / "parts" / f"step_{step:05d}.h5"

    # --------------------------------------------------------------------- XDMF

    def write_xdmf(self, history: list[dict[str, Any]], whole: bool = False) -> None:
        """Write fields.xdmf for the steps on disk: one grid a step, with every field (rank 0).

        Parameters
        ----------
        history
            The accepted steps.
        whole
            Whether all steps are in fields.h5; otherwise those in parts/ are taken from there.
        """
        if self.comm.rank != 0:
            return
        self._write_document("fields.xdmf", "device", "", history, whole)
        if self._nodal:
            self._write_document(NODAL_DOCUMENT, "device", f"{NODAL}/", history, whole)
        for name in self._surfaces:
            group = f"{surface_group(name)}/"
            self._write_document(surface_document(name), name, group, history, whole)
        for document, electrodes in DOCUMENTS.items():
            text = ""
            for key, name in blocks_in(self._grid(whole), electrodes).items():
                make = partial(block_xml, root=self.path, key=key)
                grids = self._steps_xml(f"{document}/{key}", "", history, whole, make)
                text += xdmf.collection(grids, name) if grids else ""
            if text:
                self._put_document(document, text, whole)

    def _put_document(self, file_name: str, collections: str, whole: bool) -> None:
        """Write a document, with a note on regions and axes."""
        text = xdmf.whole_document(collections, xdmf.note_of(self._grid(whole)))
        replace_file(self.path / file_name, lambda target: target.write_text(text, "utf-8"))

    def _grid(self, whole: bool) -> tuple[Path, str]:
        """The file of the grid, and the group in it."""
        return self._where(self.path / "parts" / "grid.h5", "grid/", whole)

    def _write_document(
        self, file_name: str, name: str, group: str, history: list[dict[str, Any]], whole: bool
    ) -> None:
        """Write the document of the device or of a surface, whose data lie in a group."""
        make = partial(xdmf.grid_xml, root=self.path)
        text = self._steps_xml(file_name, group, history, whole, make)
        self._put_document(file_name, xdmf.collection(text, name), whole)

    def _steps_xml(
        self, document: str, group: str, history: list[dict[str, Any]], whole: bool,
        make: Callable[..., str],
    ) -> str:  # fmt: skip
        """What a document says of each step on disk.

        What it says of a step is kept, so that the cost of a step does not grow with their number.

        Parameters
        ----------
        document, group, history, whole
            The file's name, the group of a surface, and as of `write_xdmf`.
        make
            From the step's name, its time, and the places of its mesh and its fields.
        """
        grids: list[str] = []
        said = {} if whole else self._said.setdefault(document, {})
        names = [n for n in ("time", "time_s") if n == "time" or (history and n in history[0])]
        times = field_times({name: [row[name] for row in history] for name in names})
        for row, time in zip(history, times, strict=True):
            step = int(row["step"])
            if not whole and (kept := said.get(step)) is not None and kept[0] == time:
                grids.append(kept[1])
                continue
            file, prefix = self._where(self._part(step), f"step_{step:05d}/", whole)
            if file.exists():
                mesh, before = self._grid(whole)
                grids.append(
                    make(f"step {step}", time, (mesh, before + group), (file, prefix + group))
                )
                said[step] = (time, grids[-1])
        return "".join(grids)

    def _where(self, part: Path, group: str, whole: bool) -> tuple[Path, str]:
        """File and group in it that hold a part of the results."""
        return (part, "") if part.exists() and not whole else (self.path / "fields.h5", group)

    def write_mode(
        self,
        step: int,
        grid: Grid | None,
        nodes: Mapping[str, Table] | None,
        mode: Table | None,
    ) -> None:
        """Write a null vector with the state it belongs to: modes/mode_<step>.xdmf (rank 0)."""
        if self.comm.rank != 0:
            return
        assert grid is not None and nodes is not None and mode is not None
        folder = self.path / "modes"
        folder.mkdir(exist_ok=True)
        file = folder / f"mode_{step:05d}.h5"

        def put(h5: Any) -> None:
            hdf5.put_grid(h5, grid)
            for name, values in {**nodes, "mode": mode}.items():
                hdf5.put_table(h5, f"node/{name}", values)

        replace_file(file, hdf5.image(put))
        grid_xml = xdmf.grid_xml(f"mode of step {step}", 0.0, (file, ""), (file, ""), folder)
        text = xdmf.document(grid_xml)
        replace_file(file.with_suffix(".xdmf"), lambda target: target.write_text(text, "utf-8"))

    def consolidate(self, history: list[dict[str, Any]]) -> None:
        """Bring all steps into one fields.h5 and remove the parts (rank 0)."""
        if self.comm.rank != 0:
            return
        parts = self.path / "parts"
        if not (parts / "grid.h5").exists():
            shutil.rmtree(parts, ignore_errors=True)
            return
        whole = self.path / "fields.h5"

        steps = {f"step_{int(r['step']):05d}": self._part(int(r["step"])) for r in history}
        sources = {"grid": parts / "grid.h5", **steps}
        replace_file(whole, lambda target: hdf5.join(target, whole, sources))
        self.write_xdmf(history, whole=True)
        shutil.rmtree(parts)
