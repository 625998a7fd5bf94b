"""What a stranger's results folder says is data: no path, no link, no command, no escape."""

from __future__ import annotations

import ast
import csv
import json
import shutil
import time
import xml.etree.ElementTree as ET
from itertools import pairwise

import h5py
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx import cli, pictures
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.pictures.command import title_of
from dea_fenicsx.pictures.curves import axis_label, bare, file_stem, lettering
from dea_fenicsx.pictures.paraview import write as write_view
from dea_fenicsx.results import reading
from dea_fenicsx.support import files

pytestmark = pytest.mark.usefixtures("quick_compile")

BAD = ["../../escaped/h_m", "/tmp/escaped_h", "..", "a/b", ".bashrc", "a\x1b[31mb", "x" * 500, "\n",
       "$\\frac{1}{0}$", "con\0trol", "\u202egnp.exe", ""]  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("made") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
        scene = dea.Scene(
            block((1, 1)), {"film": film}, kinematics=dea.PlaneStrain(1e-3),
            electrodes=[dea.Electrode("top", 3e3), dea.Ground("bottom")],
            supports=[dea.Clamp("bottom")],
        )  # fmt: skip
        record = {"h": dea.MeanStretch(("bottom", "top"), "y")}
        dea.solve(scene, dea.Ramp(steps=4), record, out, quiet=True)
    return out


@pytest.fixture
def run(made, tmp_path):
    return shutil.copytree(made, tmp_path / "in" / "run")


def renamed(run, name):
    """The recorded column gets another name."""
    with open(run / "history.csv", newline="") as f:
        rows = list(csv.reader(f))
    rows[0][rows[0].index("h")] = name
    with open(run / "history.csv", "w", newline="") as f:
        csv.writer(f).writerows(rows)


def dea_prints(capsys, *words):
    status = cli.main([str(word) for word in words])
    out, errors = capsys.readouterr()
    strange = [c for c in out + errors if not c.isprintable() and c != "\n"]
    assert not strange, strange
    return status, out, errors


def outside(tmp_path, run):
    return sorted(p for p in tmp_path.rglob("*") if not p.is_relative_to(run) and p.is_file())


@pytest.mark.parametrize("name", [name for name in BAD if "\0" not in name])
def test_names_of_columns(run, tmp_path, capsys, name):
    pytest.importorskip("matplotlib")
    renamed(run, name)
    dea_prints(capsys, "show", run, "--text")
    before = set(run.iterdir())
    status, _, _ = dea_prints(capsys, "show", run, "--y", name, "--format", "svg")
    assert status in (0, 2) and not outside(tmp_path, run)
    new = set(run.iterdir()) - before
    assert all(p.suffix == ".svg" and not p.name.startswith(".") for p in new)
    assert len(new) == (status == 0)


@pytest.mark.parametrize("name", BAD)
def test_names_of_files(name):
    found = files.file_name(name)
    assert found and "/" not in found and not found.startswith(".") and found.isprintable()
    assert len(found.encode()) <= 200


def test_names_that_are_plain_stay():
    assert files.file_name("field_strength") == "field_strength"
    assert file_stem("max_field_V_per_m", "voltage_V") == "max_field_voltage"
    assert axis_label("tip_m", 2e-3) == ("Tip (mm)", 1e-3)
    assert bare("tip_m") == "tip"
    assert lettering("2 $ and $3") == r"2 \$ and \$3"


def test_what_a_summary_says(run, capsys):
    told = json.loads((run / "summary.json").read_text())
    told |= {"status": "\x1b[2Jcompleted\x07", "message": "a\nb\x1b]0;x\x07", "stable": [1],
             "ranks": {}, "wall_s": "x"}  # fmt: skip
    told["settings"]["mesh"] = "\x1b[31m"
    told["settings"]["path"] = [{"what": [{}, "voltage", 3]}, "x"]
    (run / "summary.json").write_text(json.dumps(told))
    status, out, _ = dea_prints(capsys, "show", run, "--text")
    assert status == 0 and "completed" in out
    dea_prints(capsys, "compare", run, run)
    for text in ("[" * 100_000, "9" * 10_000, '{"a": ' * 50_000, "\ufeff{}", "[1]", ""):
        (run / "summary.json").write_text(text)
        assert dea_prints(capsys, "show", run, "--text")[0] == 0
        status, _, errors = dea_prints(capsys, "compare", run, run)
        assert status == 2 and errors.count("\n") == 1


def test_a_table_that_is_none(run, capsys):
    good = (run / "history.csv").read_text()
    head, *rows = good.splitlines()
    for text in (f"{head},h\n" + "\n".join(f"{row},1" for row in rows), "a" * 300_000, "\0,\0\n1,2",
                 good.replace("voltage", '"voltage', 1), head + "\n" + "1," * 5):  # fmt: skip
        (run / "history.csv").write_text(text)
        status, _, errors = dea_prints(capsys, "show", run, "--text")
        assert status == 0 or (errors.count("\n") == 1 and "Traceback" not in errors)
        assert "--debug" not in errors


TARGETS = ("h_voltage.png", ".h_voltage.png.new", "view.py", ".view.py.new")


@pytest.mark.parametrize("target", TARGETS)
def test_links_are_not_followed(run, tmp_path, capsys, target):
    pytest.importorskip("matplotlib")
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (run / target).symlink_to(victim)
    assert dea_prints(capsys, "show", run, "--y", "h", "--format", "png")[0] == 0
    write_view(run)
    assert victim.read_text() == "mine"
    assert not (run / target).is_symlink()


# ---------------------------------------------------------------------------------- XDMF and HDF5


def place_of(run, old, new):
    file = run / "fields.xdmf"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def refused(make, words=""):
    with pytest.raises(dea.InputError) as caught:
        make()
    text = str(caught.value)
    assert words in text and text.endswith(".") and text.isprintable() and len(text) < 500, text


@pytest.mark.parametrize("name", ["../secret.h5", "{}/secret.h5", "sub/../../secret.h5",
                                  "link.h5", "sub/secret.h5", "/dev/stdin", "no.h5"])  # fmt: skip
def test_files_outside_are_not_opened(run, name):
    pytest.importorskip("pyvista")
    secret = run.parent / "secret.h5"
    shutil.copy(run / "fields.h5", secret)
    (run / "link.h5").symlink_to(secret)
    (run / "sub").symlink_to(run.parent)
    assert reading.read_frame(run).grid.n_cells == 1
    place_of(run, "fields.h5:", name.format(run.parent) + ":")
    refused(lambda: reading.read_frame(run), "cannot be read")


def replaced(run, name, put):
    with h5py.File(run / "fields.h5", "a") as h5:
        old = h5[name][()]
        del h5[name]
        put(h5, name, old)


DATA = {
    "a link outside": lambda h5, name, old: h5.__setitem__(
        name, h5py.ExternalLink("../secret.h5", name)),
    "a link inside": lambda h5, name, old: h5.__setitem__(name, h5py.SoftLink("/grid/points")),
    "numbers outside": lambda h5, name, old: h5.create_dataset(
        name, (8,), "u1", external=[("/etc/hostname", 0, 8)]),
    "far too many": lambda h5, name, old: h5.create_dataset(
        name, (10**12, 3), "f8", chunks=(1024, 3), compression="gzip"),
    "texts": lambda h5, name, old: h5.__setitem__(name, "text"),
    "too few": lambda h5, name, old: h5.__setitem__(name, old[:, :1]),
    "a group": lambda h5, name, old: h5.create_group(name),
    "nothing": lambda h5, name, old: None,
    "cells of no nodes": lambda h5, name, old: h5.__setitem__(name, old * 0 + 10**9),
    "negative nodes": lambda h5, name, old: h5.__setitem__(name, old - 10**6),
}  # fmt: skip


@pytest.mark.parametrize("what", DATA)
def test_data_that_are_no_numbers(run, what):
    pytest.importorskip("pyvista")
    shutil.copy(run / "fields.h5", run.parent / "secret.h5")
    replaced(run, "grid/cells", DATA[what])
    refused(lambda: reading.read_frame(run))


@pytest.mark.parametrize("kind", ["f2", "f4", ">f8", "g"])
def test_floats_of_every_length(run, kind):
    """VTK takes some of them only; they are read as those of the usual length."""
    pytest.importorskip("pyvista")
    name = "step_00004/node/potential_V"
    with h5py.File(run / "fields.h5") as h5:
        wanted = h5[name][()]
    replaced(run, name, lambda h5, name, old: h5.__setitem__(name, old.astype(kind)))
    found = reading.read_frame(run).grid.point_data["potential_V"]
    assert found == pytest.approx(wanted, rel=1e-3) and found.dtype == float


def test_a_virtual_data_set(run):
    pytest.importorskip("pyvista")
    shutil.copy(run / "fields.h5", run.parent / "secret.h5")

    def put(h5, name, old):
        layout = h5py.VirtualLayout(old.shape, old.dtype)
        layout[:] = h5py.VirtualSource("../secret.h5", name, old.shape)
        h5.create_virtual_dataset(name, layout)

    replaced(run, "grid/points", put)
    refused(lambda: reading.read_frame(run), "another file")


NAMES = "abcdefghij"
TENFOLD = "".join(f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in pairwise(NAMES))
LAUGHS = f'<!DOCTYPE x [<!ENTITY a "ha">{TENFOLD}]><Xdmf>&j;</Xdmf>'
PASSWD = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><Xdmf><Domain>&a;</Domain></Xdmf>'


@pytest.mark.parametrize("text", [
    LAUGHS, PASSWD, "<Xdmf>", "\x1b", "<a>" * 200_000, LAUGHS.encode("utf-16"),
    b'<?xml version="1.0" encoding="cp037"?><Xdmf/>' + "<!DOCTYPE x>".encode("cp037"), b"\xff" * 9,
], ids=range(8))  # fmt: skip
def test_documents_that_are_none(run, text):
    (run / "fields.xdmf").write_bytes(text if isinstance(text, bytes) else text.encode())
    begun = time.monotonic()
    refused(lambda: reading.field_names(run))
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize("change", ["no name", "no place", "no time", "no topology", "no data"])
def test_documents_that_lack_something(run, change):
    pytest.importorskip("pyvista")
    tree = ET.parse(run / "fields.xdmf")
    for grid in tree.getroot().findall("./Domain/Grid/Grid"):
        if change == "no name":
            del grid.find("Attribute").attrib["Name"]
        elif change == "no place":
            del grid.find("Attribute").attrib["Center"]
        elif change == "no time":
            grid.find("Time").set("Value", "soon")
        elif change == "no topology":
            grid.remove(grid.find("Topology"))
        else:
            grid.find("Geometry").remove(grid.find("Geometry").find("DataItem"))
    tree.write(run / "fields.xdmf")
    refused(lambda: reading.read_frame(run))


def test_a_script_for_paraview_holds_texts_only(run):
    told = json.loads((run / "summary.json").read_text())
    evil = '"""); import os; os.system("touch pwned") #'
    renamed(run, f"{evil}_V")
    told["settings"]["path"] = [{"what": evil}]
    (run / "summary.json").write_text(json.dumps(told))
    text = write_view(run).read_text("utf-8")
    called = {node.attr for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)}
    assert "pwned" in text and "system" not in called


# --------------------------------------------------------------------------------------- compare


def shortened(run, rows, status="completed"):
    lines = (run / "history.csv").read_text().splitlines(keepends=True)
    (run / "history.csv").write_text("".join([lines[0], *(lines[1 + k] for k in rows)]))
    told = json.loads((run / "summary.json").read_text()) | {"status": status}
    (run / "summary.json").write_text(json.dumps(told))


@pytest.mark.parametrize(("rows", "status", "words"), [
    ((0, 1, 2), "interrupted", "A is completed, but B is interrupted; A ends at time 1"),
    ((0, 1, 2), "completed", "but B at 0.5 after 3"),
    ((0, 1, 2, 3, 4), "running", "but B is running"),
])  # fmt: skip
def test_runs_that_end_otherwise(made, run, capsys, rows, status, words):
    shortened(run, rows, status)
    found, out, _ = dea_prints(capsys, "compare", made, run)
    assert found == 1 and words in out and "the same within" not in out
    assert dea_prints(capsys, "compare", run, made)[0] == 1


def test_a_run_with_fewer_steps_may_be_the_same(made, run, capsys):
    shortened(run, (0, 2, 4))
    found, out, _ = dea_prints(capsys, "compare", made, run)
    assert found == 0 and "the same within 1e-06" in out


def test_a_column_that_one_of_them_lacks(made, run, capsys):
    renamed(run, "height")
    found, out, _ = dea_prints(capsys, "compare", made, run)
    assert found == 1 and "only A has h; only B has height" in out


def test_steps_at_other_times(made, run, capsys):
    text = (run / "history.csv").read_text()
    (run / "history.csv").write_text(text.replace("\n2,0.5,", "\n2,0.6,"))
    found, out, _ = dea_prints(capsys, "compare", made, run)
    assert found == 1 and "of which only 4 are at the same time" in out


def test_a_title_of_a_picture(run):
    renamed(run, "$\\frac{1}{$")
    told = json.loads((run / "summary.json").read_text())
    told["settings"]["path"] = [{"what": "voltage"}, {"what": "$x^$"}]
    (run / "summary.json").write_text(json.dumps(told))
    assert "$" not in title_of(run, 1.0, 1.0).replace(r"\$", "")


def test_names_from_a_mesh(tmp_path, capsys):
    """Groups of a mesh file are shown without what a terminal would obey."""
    geometry = BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(1,))
    geometry.write(tmp_path / "film.msh")
    raw = (tmp_path / "film.msh").read_bytes()
    (tmp_path / "film.msh").write_bytes(raw.replace(b'"film"', b'"fi\x1b[31mlm"'))
    status, out, _ = dea_prints(capsys, "mesh", tmp_path / "film.msh")
    assert status == 0 and "fi[31mlm" in out


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "error,wall_s,fidelity\nx,1,a\n", "\0", '"'])
def test_a_table_of_rungs_that_is_none(tmp_path, text):
    pytest.importorskip("matplotlib")
    (tmp_path / "rungs.csv").write_text(text)
    with pytest.raises(dea.InputError, match="rungs"):
        pictures.ladder(tmp_path / "rungs.csv")
