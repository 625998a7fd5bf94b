"""ParaView itself reads the files of a run and shows them: its readers, and the script view.py.

The tests are left out where ParaView (pvpython) or a display of its own (xvfb-run) is missing.
"""

from __future__ import annotations

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import clean_environment

pyvista = pytest.importorskip("pyvista")

from test_vtk import CELLWISE, NODAL, rows, start  # noqa: E402

from dea_fenicsx.pictures import paraview  # noqa: E402
from dea_fenicsx.results.reading import read_frame  # noqa: E402

TOOLS = ("pvpython", "xvfb-run")
pytestmark = pytest.mark.skipif(
    any(shutil.which(tool) is None for tool in TOOLS), reason="ParaView or xvfb-run is missing"
)

READERS = """
import sys
from paraview import servermanager
from paraview.simple import XDMFReader, Xdmf3ReaderS, Xdmf3ReaderT
file = sys.argv[1]
for make, name in ((XDMFReader, "FileNames"), (Xdmf3ReaderS, "FileName"), (Xdmf3ReaderT, "FileName")):
    reader = make(**{name: [file]})
    reader.UpdatePipelineInformation()
    for time in list(reader.TimestepValues):
        reader.SMProxy.UpdatePipeline(time)
        data = servermanager.Fetch(reader)
        u = data.GetPointData().GetArray("displacement_m")
        print("FOUND", data.GetClassName(), data.GetNumberOfCells(), data.GetNumberOfPoints(),
              data.GetPointData().GetNumberOfArrays(), data.GetCellData().GetNumberOfArrays(),
              repr(float(time)), repr(u.GetRange(2)[0]))
"""  # noqa: E501

BLOCKS = """
import sys
from paraview import servermanager
from paraview.simple import XDMFReader
for file in sys.argv[1:]:
    reader = XDMFReader(FileNames=[file])
    reader.UpdatePipelineInformation()
    times = list(reader.TimestepValues)
    reader.SMProxy.UpdatePipeline(times[-1])
    data = servermanager.Fetch(reader)
    for k in range(data.GetNumberOfBlocks()):
        block = data.GetBlock(k)
        key = data.GetMetaData(k).Get(data.NAME())
        print("FOUND", repr(key).replace(" ", "_"), block.GetNumberOfCells(), len(times),
              repr(block.GetPointData().GetArray("displacement_m").GetRange(2)[0]))
"""


@pytest.fixture(scope="module")
def clamped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clamped at its bottom, so that the deformed cells are curved; with its script view.py."""
    folder = start(tmp_path_factory.mktemp("paraview") / "clamped")
    paraview.write(folder)
    return folder


def pvpython(*arguments: str | Path) -> str:
    """What a script prints in ParaView's own interpreter, on a display that nobody sees."""
    environment = clean_environment()
    environment.pop("PYTHONPATH", None)  # pvpython has packages of its own
    for _ in range(5):
        done = subprocess.run(
            ["xvfb-run", "-a", "pvpython", *map(str, arguments)],
            env=environment, capture_output=True, text=True, timeout=240,
        )  # fmt: skip
        if "bad X server connection" not in done.stderr:
            break  # else xvfb-run took the display of a server that was just ending
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Error" not in done.stderr, done.stderr
    return done.stdout


def found(tmp_path: Path, script: str, *arguments: Path) -> list[list[str]]:
    """The words of each line that a script prints after FOUND."""
    file = tmp_path / "look.py"
    file.write_text(script)
    lines = pvpython(file, *arguments).splitlines()
    return [line.split()[1:] for line in lines if line.startswith("FOUND")]


def test_all_readers_find_all_steps(clamped: Path, tmp_path: Path) -> None:
    lines = found(tmp_path, READERS, clamped / "fields.xdmf")
    assert len(lines) == 3 * 4  # readers, steps
    for k, line in enumerate(lines):
        row = rows(clamped)[k % 4]
        lowest = read_frame(clamped, k % 4).grid.point_data["displacement_m"][:, 2].min()
        counts = ["4", "75", str(len(NODAL)), str(len(CELLWISE))]
        assert line[:5] == ["vtkUnstructuredGrid", *counts]
        assert float(line[5]) == pytest.approx(float(row["time"]))
        assert float(line[6]) == pytest.approx(lowest, rel=1e-12, abs=1e-20)


def test_electrodes_and_surfaces_are_blocks_with_names(clamped: Path, tmp_path: Path) -> None:
    files = clamped / "electrodes.xdmf", clamped / "surfaces.xdmf"
    blocks = {line[0]: line[1:] for line in found(tmp_path, BLOCKS, *files)}
    assert set(blocks) == {
        "'electrode_top'", "'electrode_bottom'", "'x_min'", "'x_max'", "'y_min'", "'y_max'"
    }  # fmt: skip
    for cells, steps, lowest in blocks.values():
        assert (cells, steps) in (("4", "4"), ("2", "4"))  # facets of 2 x 2 cells, and all steps
        assert float(lowest) < -1e-7  # all blocks take the points of the device, which is pressed
    assert blocks["'electrode_top'"][0] == "4"


def shown(folder: Path, shot: Path) -> np.ndarray:
    """The picture that the script view.py of a run makes, shape (900, 1600, 3)."""
    pvpython(folder / "view.py", shot)
    image = pytest.importorskip("matplotlib.image").imread(shot)[..., :3]
    assert image.shape == (900, 1600, 3)
    return image


def test_the_script_shows_the_run_wherever_it_went(clamped: Path, tmp_path: Path) -> None:
    elsewhere = Path(shutil.copytree(clamped, tmp_path / "elsewhere"))
    image = shown(elsewhere, tmp_path / "shot.png")
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert border.min() > 0.95  # nothing is cut off
    middle = image[:, 200:1400]  # without axes and colour bar
    drawn = middle.min(axis=-1) < 0.95
    # a nearly constant field, the largest of all steps: the end of the scale, in shade or not
    hue = middle / np.maximum(middle.max(axis=-1, keepdims=True), 1e-9)
    yellow = drawn & (np.abs(hue - [1, 0.91, 0.15]).max(axis=-1) < 0.15)
    red = (middle[..., 0] > 0.7) & (middle[..., 1] < 0.4)
    orange = drawn & (np.abs(hue - [1, 0.5, 0.05]).max(axis=-1) < 0.12)
    assert 0.1 < drawn.mean() < 0.8
    assert yellow.sum() > 0.2 * drawn.sum()
    assert red.any()
    assert orange.sum() > 500  # the outlines of the electrodes


def test_the_script_shows_a_run_that_has_grown(clamped: Path, tmp_path: Path) -> None:
    """The texts were written for fewer steps, and the history is gone: the time stands there."""
    folder = Path(shutil.copytree(clamped, tmp_path / "grown"))
    script = folder / "view.py"
    before = script.read_text()
    line = next(line for line in before.splitlines() if line.startswith("WRITTEN = "))
    script.write_text(before.replace(line, "WRITTEN = ['step 0']"))
    with open(folder / "history.csv", newline="") as file:
        assert len(list(csv.DictReader(file))) == 4
    (folder / "history.csv").unlink()
    known = shown(clamped, tmp_path / "known.png")
    grown = shown(folder, tmp_path / "grown.png")
    text = np.any(known != grown, axis=-1)
    assert 100 < text.sum() < 2e4  # nothing but the text differs
