"""The command dea: what it prints, what it writes, and one sentence for whatever is wrong."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, clean_environment
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_pictures import VOLTS, write_run

from dea_fenicsx import cli
from dea_fenicsx.materials import names, preset
from dea_fenicsx.pictures import drawing
from dea_fenicsx.thesis.table import collect

needs_pyvista = pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None, reason="pyvista is not installed"
)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run")


@pytest.fixture
def dea(capsys):
    """Calls the command in this process: exit status, output, errors."""

    def call(*arguments: object) -> tuple[int, str, str]:
        status = cli.main([str(a) for a in arguments])
        told = capsys.readouterr()
        return status, told.out, told.err

    return call


def refused(status: int, out: str, err: str, words: str = "") -> None:
    """One sentence, exit status 2, no traceback."""
    assert status == 2, out + err
    assert err.startswith("Error: ")
    assert err.endswith((".\n", "--help.\n")), err
    assert err.count("\n") == 1
    assert words in err
    assert "Traceback" not in err


# ------------------------------------------------------------------- malformed command lines

LINES = {
    "no such command": ("dmeos", "invalid choice"),
    "no such option": ("materials --jsno", "unrecognized arguments"),
    "option before the command": ("--jsn materials", "dea --help"),
    "show without a folder": ("show", "required: RESULTS"),
    "show of nothing": ("show nowhere", "no history.csv in nowhere"),
    "show of a file": ("show {run}/history.csv", "no history.csv"),
    "show of an empty folder": ("show {empty}", "no history.csv"),
    "show, one of two": ("show {run} nowhere", "no history.csv in nowhere"),
    "no such x": ("show {run} --x volts", "no column 'volts'"),
    "no such y": ("show {run} --y tip_m", "no column 'tip_m'"),
    "y is text": ("show {run} --y ramp", "does not hold numbers"),
    "y without a name": ("show {run} --y", "expected one argument"),
    "no such field": ("show {run} --field heat", "no field 'heat'"),
    "no such step": ("show {run} --step 9", "Step 9 is not in"),
    "step as text": ("show {run} --step last", "invalid int value"),
    "warp as text": ("show {run} --warp big", "invalid float value"),
    "warp NaN": ("show {run} --warp nan", "must be a finite number"),
    "warp infinite": ("show {run} --warp inf", "must be a finite number"),
    "no such format": ("show {run} --format jpg", "invalid choice: 'jpg'"),
    "film of no kind": ("show {run} --animate {run}/film", "as .gif or .mp4"),
    "film as avi": ("show {run} --animate {run}/film.avi", "as .gif or .mp4"),
    "film of no such field": ("show {run} --animate {run}/a.gif --field x", "no field 'x'"),
    "film without fields": ("show {bare} --animate {run}/a.gif", "no fields.xdmf"),
    "out is a file": ("show {run} --y contraction --out {run}/history.csv", "cannot be written"),
    "no such place": ("show {run} --y contraction --out /proc/none", "cannot be written"),
    "fields of a run without": ("show {bare} --field J", "no fields.xdmf"),
    "paraview without fields": ("show {bare} --paraview", "no fields.xdmf"),
    "history is binary": ("show {binary}", "not a history"),
    "history is ragged": ("show {ragged}", "damaged"),
    "history has no steps": ("show {headed}", "no steps yet"),
    "xdmf is no XML": ("show {noxml} --field J", "not valid XML"),
    "HDF5 is broken": ("show {noh5} --field region", "cannot be read"),
    "compare one": ("compare {run}", "required: B"),
    "compare with nothing": ("compare {run} nowhere", "no history.csv in nowhere"),
    "compare three": ("compare {run} {run} {run}", "unrecognized arguments"),
    "compare without summary": ("compare {run} {bare}", "no summary.json"),
    "compare with broken summary": ("compare {run} {nojson}", "not valid JSON"),
    "compare with a list": ("compare {run} {listed}", "holds no object"),
    "rtol as text": ("compare {run} {run} --rtol tight", "invalid float value"),
    "rtol negative": ("compare {run} {run} --rtol=-1", "must be a finite number >= 0"),
    "rtol NaN": ("compare {run} {run} --rtol nan", "must be a finite number >= 0"),
    "no such demo": ("demos cubee", "did you mean 'cube'"),
    "demo with a path": ("demos ../cube", "no demo named"),
    "demo onto a file": ("demos cube --to {run}/history.csv", "cannot be written"),
    "demo over another": ("demos cube --to {mine}", "not overwritten"),
    "two demos": ("demos cube fit_rubber", "unrecognized arguments"),
    "no such material": ("materials vhb", "the nearest is"),
    "no material to plot": ("materials --plot {run}/a.png", "name it"),
    "material as no picture": ("materials mylar --plot {run}/a.txt", "end in .png"),
    "material in no folder": ("materials mylar --plot {run}/no/a.png", "There is no folder"),
    "no such system": ("table --system cub", "did you mean 'cube'"),
    "table onto a file": ("table --system cube --out {run}/history.csv", "exists"),
    "whole table onto a file": ("table --out {run}/history.csv", "exists"),
    "table below a file": ("table --out {run}/history.csv/x", "Not a directory"),
    "doctor with time as text": ("doctor --seconds long", "invalid float value"),
}


@pytest.fixture
def places(run: Path, tmp_path: Path) -> dict[str, Path]:
    """Results folders, most of them damaged."""
    found = {name: tmp_path / name for name in ("empty", "mine")}
    for folder in found.values():
        folder.mkdir()
    (found["mine"] / "cube.py").write_text("# mine\n")
    damage = {
        "bare": ("fields.xdmf", None), "binary": ("history.csv", b"\xff\xfe\x00\x01"),
        "ragged": ("history.csv", b"step,time\n0,0.0\n1\n"), "headed": ("history.csv", b"step\n"),
        "noxml": ("fields.xdmf", b"<Xdmf><Dom"), "noh5": ("fields.h5", b"no HDF5"),
        "nojson": ("summary.json", b"{"), "listed": ("summary.json", b"[1]"),
    }  # fmt: skip
    for name, (file, content) in damage.items():
        found[name] = tmp_path / name
        shutil.copytree(run, found[name])
        (found[name] / file).unlink()
        if content is not None:
            (found[name] / file).write_bytes(content)
    (found["bare"] / "summary.json").unlink()
    return found | {"run": run}


DRAWN = ("HDF5 is broken",)


@pytest.fixture(scope="module")
def rows():
    """The thesis's table, which takes a second or two to compute."""
    return collect()


@pytest.mark.parametrize("case", LINES)
def test_malformed_command_line(dea, places, rows, case, monkeypatch):
    monkeypatch.setattr("dea_fenicsx.thesis.table.collect", lambda: rows)
    if case in DRAWN and importlib.util.find_spec("pyvista") is None:
        pytest.skip("pyvista is not installed")
    line, words = LINES[case]
    before = {f: f.read_bytes() for f in places["run"].iterdir()}
    refused(*dea(*(word.format(**places) for word in line.split())), words)
    assert {f: f.read_bytes() for f in places["run"].iterdir()} == before
    assert (places["mine"] / "cube.py").read_text() == "# mine\n"


WORDS = st.sampled_from(
    ["show", "compare", "materials", "demos", "table", "--x", "--rtol", "--step", "nan", "-1",
     "1e999", "--out", "", " ", "--", "-", "--format", "'", "\n", "\x00", "é", "no/such", "{}",
     "--system", "--json=1", "--warp=x", "%s"]
)  # fmt: skip


@settings(max_examples=40, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
@given(words=st.lists(WORDS, min_size=1, max_size=5))
def test_nonsense_never_ends_in_a_traceback(capsys, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dea_fenicsx.thesis.table.collect", lambda: [])
    status = cli.main(words)
    told = capsys.readouterr()
    assert status in (0, 2), (words, told.err)
    if status:
        refused(status, told.out, told.err)


def test_debug_shows_the_traceback(run):
    from dea_fenicsx.support.errors import InputError

    for line in (["--debug", "show", "nowhere"], ["show", "nowhere", "--debug"]):
        with pytest.raises(InputError):
            cli.main(line)


def test_help_and_version(dea, capsys):
    status, out, _ = dea()
    assert status == 0
    assert all(name in out for name in cli.COMMANDS)
    for line in (["--version"], ["show", "--help"], ["compare", "--help"]):
        with pytest.raises(SystemExit) as end:
            cli.main(line)
        assert end.value.code == 0
    assert "--animate" in capsys.readouterr().out


def test_as_a_module(tmp_path):
    """In a process of its own, and light: the library of materials needs no MPI."""
    code = (
        "import sys; from dea_fenicsx.cli import main; s = main(['materials', '--json']);"
        "print([m for m in ('mpi4py', 'dolfinx', 'pyvista') if m in sys.modules], file=sys.stderr)"
    )
    for arguments in (["-m", "dea_fenicsx", "materials", "--json"], ["-c", code]):
        done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True,
                              cwd=tmp_path, env=clean_environment(), timeout=60)  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert len(json.loads(done.stdout)) == len(names())
    assert done.stderr.strip() == "[]"


# ----------------------------------------------------------------------------- demos


def test_demos_are_listed_and_copied(dea, tmp_path):
    status, out, _ = dea("demos")
    assert status == 0
    for file in (ROOT / "demos").glob("*.py"):
        line = next(x for x in out.splitlines() if x.startswith(f"{file.stem} "))
        assert len(line.split()) > 3
    to = tmp_path / "new" / "place"
    status, out, _ = dea("demos", "fit_rubber", "--to", to)
    assert status == 0
    assert out.split() == [str(to / "fit_rubber.py"), str(to / "fit_rubber_data")]
    for file in (ROOT / "demos" / "fit_rubber_data").iterdir():
        assert (to / "fit_rubber_data" / file.name).read_bytes() == file.read_bytes()
    refused(*dea("demos", "fit_rubber", "--to", to), "not overwritten")


# --------------------------------------------------------------------------- show


def test_summary(dea, run):
    status, out, _ = dea("show", run, "--text")
    assert status == 0
    for words in ("2 steps", "voltage                  4 kV", "contraction              10 %",
                  "max field                8 MV/m", "fields: region"):  # fmt: skip
        assert words in out
    assert sorted(f.name for f in run.iterdir()) == [
        "fields.h5", "fields.xdmf", "history.csv", "summary.json"
    ]  # fmt: skip


def test_curves(dea, run, tmp_path):
    pytest.importorskip("matplotlib")
    softer = write_run(tmp_path / "softer", 1.5)
    out = tmp_path / "pictures"
    status, told, _ = dea("show", run, softer, "--y", "contraction", "--y", "max_field_V_per_m",
                          "--format", "svg", "--out", out)  # fmt: skip
    assert status == 0
    made = [out / "contraction_voltage.svg", out / "max_field_voltage.svg"]
    assert told.split()[-2:] == [str(f) for f in made]
    assert sorted(out.iterdir()) == sorted(made)
    text = made[0].read_text()
    assert all(words in text for words in ("Voltage (kV)", "Contraction (%)", "softer"))


def test_by_default_what_can_be_drawn_is_drawn(dea, run, monkeypatch):
    """A curve, and a picture; without OpenGL the curve alone, and why."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(drawing, "_child", lambda *a: (-6, "VTK found no OpenGL and ended."))
    status, out, err = dea("show", run)
    assert status == 0
    assert out.split()[-2:] == [str(run / f"contraction_voltage.{k}") for k in ("png", "svg")]
    assert err.count("\n") == 1
    assert "no OpenGL" in err
    status, _, err = dea("show", run, "--step", 1)  # asked for, and not made
    assert status == 1
    assert err.count("\n") == 1


@needs_pyvista
def test_film(dea, run, monkeypatch):
    pytest.importorskip("matplotlib")
    from PIL import Image

    film = run / "film.gif"
    status, out, err = dea("show", run, "--animate", film, "--warp", 2)
    if status == 1:
        pytest.skip(err)
    assert status == 0
    assert out.split()[-1] == str(film)
    with Image.open(film) as image:
        assert image.n_frames == 3
        frames = []
        for k in range(3):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB"), dtype=int))
    assert len({f.shape for f in frames}) == 1
    bars = [f[:, int(0.88 * f.shape[1]) :] for f in frames]  # the colour scale stands still
    assert np.abs(bars[0] - bars[2]).mean() < 2
    assert np.abs(frames[0] - frames[2]).mean() > 5
    monkeypatch.setattr("dea_fenicsx.pictures.movie.ffmpeg", lambda: None)
    refused(*dea("show", run, "--animate", run / "film.mp4"), "needs ffmpeg")


def test_paraview_macro(dea, run):
    """Its picture is looked at in test_vtk.py."""
    status, out, _ = dea("show", run, "--paraview")
    assert status == 0
    macro = run / "view.py"
    assert out.split()[-1] == str(macro)
    text = macro.read_text()
    compile(text, "view.py", "exec")
    assert f"step 2, voltage {VOLTS / 1e3:g} kV" in text


# ------------------------------------------------------------------- compare, table, materials


def test_compare(dea, run, tmp_path):
    status, out, _ = dea("compare", run, run)
    assert status == 0
    assert "the same within 1e-06" in out
    other = write_run(tmp_path / "other", 1 + 3e-5)
    (other / "summary.json").write_text('{"settings": {"script": {"mu": 1.0}}, "ranks": 2}')
    status, out, _ = dea("compare", run, other)
    assert status == 1
    assert "contraction differs by 3e-05 at time 1" in out
    assert "settings.script.mu: (none) in A, 1.0 in B" in out
    assert "ranks: None in A, 2 in B" in out
    assert dea("compare", run, other, "--rtol", "1e-4")[0] == 0


def test_compare_at_common_times_only(dea, run, tmp_path):
    other = write_run(tmp_path / "other")
    rows = (other / "history.csv").read_text().splitlines()
    (other / "history.csv").write_text("\n".join([*rows[:2], rows[3]]) + "\n")
    status, out, _ = dea("compare", run, other)
    assert status == 0
    assert "2 steps at the same time" in out
    moved = rows[3].replace("2,1.0", "2,7.0")
    (other / "history.csv").write_text(f"{rows[0]}\n{moved}\n")
    refused(*dea("compare", run, other), "no step at the same time")


def test_a_number_against_none_is_a_difference(dea, run, tmp_path):
    other = write_run(tmp_path / "other")
    text = (other / "history.csv").read_text()
    (other / "history.csv").write_text(text.replace("0.1,8000000.0", ",8000000.0"))
    status, out, _ = dea("compare", run, other)
    assert status == 1
    assert "contraction differs by inf" in out


def test_materials(dea):
    status, out, _ = dea("materials")
    assert status == 0
    assert all(name in out for name in names())
    for name in names():
        status, out, _ = dea("materials", name)
        assert status == 0
        assert " ".join(preset(name).source.split()) in " ".join(out.split())
        status, out, _ = dea("materials", name, "--json")
        told = json.loads(out)
        assert told["shear_modulus_Pa"] == preset(name).material.elastic.shear_modulus()


def test_table(dea, rows, tmp_path, monkeypatch):
    monkeypatch.setattr("dea_fenicsx.thesis.table.collect", lambda: rows)
    status, out, _ = dea("table", "--system", "cube", "--out", tmp_path)
    assert status == 0
    assert "thesis 1763 V, here 1763.106 V" in out
    assert (tmp_path / "thesis.csv").read_text().count("\ncube,") > 3
    assert (tmp_path / "thesis.md").exists()


def test_a_picture_of_a_material(dea, tmp_path):
    path = tmp_path / "curves.png"
    status, out, _ = dea("materials", "vhb4910-hossain2012", "--plot", path)
    assert status == 0 and out == f"wrote {path}\n"
    assert path.stat().st_size > 5000
