"""Files of strangers: no command of theirs is run, and nothing is read that was not asked for."""

from __future__ import annotations

import os
from pathlib import Path

import gmsh
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import cli
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.geometry._gmsh import start
from dea_fenicsx.mesh.foreign.formats import KNOWN, NO_PROGRAMS

FORMAT = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"


@pytest.fixture
def ran(tmp_path) -> Path:
    """The file that a script makes where it runs."""
    return tmp_path / "RAN"


def script(ran: Path) -> str:
    """A harmless script of gmsh: a command, and a square to mesh."""
    return (
        f'SystemCall "touch {ran}";\nSetFactory("OpenCASCADE"); Rectangle(1) = {{0, 0, 0, 1, 1}};\n'
        'Physical Surface("film") = {1}; Physical Curve("left") = {4};\n'
    )


def refused(path, **options) -> str:
    with pytest.raises(dea.InputError) as caught:
        dea.read_gmsh(path, MPI.COMM_SELF, **options)
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text and str(path) in text
    return text


SUFFIXES = [*(s for s in KNOWN if not s.startswith(".geo")), ".MSH", ".Msh", ".Med", ".inp", ".su2",
            ".pos", ".txt", ".gz", ".msh.gz", ".key", ".lua", ".py", ".opt", ""]  # fmt: skip


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_script_runs_under_no_other_name(tmp_path, ran, suffix):
    path = tmp_path / f"mesh{suffix}"
    path.write_text(script(ran))
    refused(path)
    assert cli.main(["mesh", str(path)]) == 2
    assert not ran.exists()
    assert sorted(tmp_path.iterdir()) == [path]


HEADS = {
    "behind the format": FORMAT,
    "in comments": "$Comments\n",
    "behind comments": "$Comments\n$EndComments\n",
    "on the first line": "$MeshFormat;",
    "in an old mesh": "$NOD\n",
    "behind a blank": " " + FORMAT,
    "in a view": FORMAT + "$View\n",
    "as an option": "$Options\n",
    "behind a mark": "\ufeff" + FORMAT,
    "in format 2": FORMAT.replace("4.1", "2.2") + "$Elements\n",
    "in binary": FORMAT.replace(" 0 ", " 1 "),
}


@pytest.mark.parametrize("head", HEADS)
def test_a_script_inside_a_mesh_does_not_run(tmp_path, ran, head):
    path = tmp_path / "mesh.msh"
    path.write_text(HEADS[head] + script(ran))
    refused(path)
    assert not ran.exists()


def test_no_options_are_read_from_beside_a_mesh(tmp_path, ran, monkeypatch):
    """Nor of a home folder, nor beside a script, whose own includes are found all the same."""
    mesh = tmp_path / "film.msh"
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]).write(mesh)
    drawing = tmp_path / "film.geo"
    drawing.write_text('Include "part of it.txt";\n')
    (tmp_path / "part of it.txt").write_text(script(ran).split("\n", 1)[1])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("film.msh.opt", "film.geo.opt", ".gmshrc", ".gmsh-options"):
        (tmp_path / name).write_text(script(ran))
    for path in (mesh, drawing):
        assert set(dea.read_gmsh(path, MPI.COMM_SELF).regions) == {"film"}
        assert cli.main(["mesh", str(path)]) == 0
    assert not ran.exists()


def test_no_module_is_taken_from_the_working_directory(tmp_path, ran, monkeypatch):
    """A binary mesh is read by a second process, which stands where the stranger's files lie."""
    mesh = tmp_path / "film.msh"
    BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]).write(mesh)
    for name in ("gmsh", "sys", "json", "numpy"):
        (tmp_path / f"{name}.py").write_text(f"open({str(ran)!r}, 'w')\n")
    monkeypatch.chdir(tmp_path)
    assert set(dea.read_gmsh(mesh, MPI.COMM_SELF).regions) == {"film"}
    assert not ran.exists()


def test_programs_can_be_refused(tmp_path, ran, monkeypatch, capsys):
    path = tmp_path / "film.GEO"
    path.write_text(script(ran))
    assert "program" in refused(path, programs=False)
    assert cli.main(["mesh", str(path), "--no-programs"]) == 2
    monkeypatch.setenv(NO_PROGRAMS, "1")
    assert "program" in refused(path)
    assert not ran.exists()
    capsys.readouterr()
    dea.read_gmsh(path, MPI.COMM_SELF, programs=True)
    assert ran.exists()
    monkeypatch.delenv(NO_PROGRAMS)
    assert cli.main(["mesh", str(path)]) == 0
    assert "is a program of gmsh" in capsys.readouterr().out


@pytest.mark.parametrize(("version", "old", "new"), [
    (4.1, "\n1 4 0 ", "\n1 4 0 2147483648 "),  # two thousand million nodes on a curve
    (4.0, "$MeshFormat\n4 ", "$MeshFormat\n4.1 "),  # the numbers of another format
    (2.2, "\n2 2 2 1 1 ", "\n2 2 99999 1 1 "),
])  # fmt: skip
def test_false_numbers_do_not_end_the_program(tmp_path, version, old, new):
    """gmsh asks for memory without end, or dies: in a process of its own, with limits."""
    path = tmp_path / "mesh.msh"
    mine = start()
    gmsh.model.add("mesh")
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], name="film")
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.option.restoreDefaults()
    gmsh.model.remove()
    if mine:
        gmsh.finalize()
    path.write_text(path.read_text().replace(old, new, 1))
    refused(path)


def test_what_is_no_file_is_told(tmp_path):
    os.mkfifo(tmp_path / "pipe.msh")
    (tmp_path / "folder.msh").mkdir()
    for name in ("pipe.msh", "folder.msh", "none.msh"):
        assert "no mesh file" in refused(tmp_path / name)


def test_names_are_shown_without_control_characters(tmp_path, capsys):
    path = tmp_path / "film.msh"
    path.write_text(
        FORMAT + '$PhysicalNames\n2\n1 1 "le\x1b[31mft\t"\n2 2 "film  "\n$EndPhysicalNames\n'
        "$Entities\n0 1 1 0\n1 0 0 0 0 1 0 1 1 0\n1 0 0 0 1 1 0 1 2 0\n$EndEntities\n"
        "$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n$EndNodes\n"
        "$Elements\n2 2 1 2\n1 1 1 1\n1 3 1\n2 1 2 1\n2 1 2 3\n$EndElements\n"
    )
    assert cli.main(["mesh", str(path)]) == 0
    assert "\x1b" not in capsys.readouterr().out
    device = dea.read_gmsh(path, MPI.COMM_SELF)
    assert (set(device.regions), set(device.surfaces)) == ({"film"}, {"le[31mft"})


def test_gmsh_is_left_as_it_was(tmp_path):
    """A script that uses gmsh itself finds it neither running nor silenced by this package."""
    path = tmp_path / "film.msh"
    shape = BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)])
    shape.write(path)
    if gmsh.isInitialized():
        gmsh.finalize()
    for source in (path, shape):
        dea.read_gmsh(source, MPI.COMM_SELF)
        assert not gmsh.isInitialized()
    refused(tmp_path / "none.msh")
    assert not gmsh.isInitialized()
    start()
    gmsh.option.setNumber("General.Terminal", 1)
    gmsh.model.add("mine")
    gmsh.model.add("other")
    gmsh.model.setCurrent("mine")
    dea.read_gmsh(path, MPI.COMM_SELF)
    assert gmsh.option.getNumber("General.Terminal") == 1
    assert gmsh.model.getCurrent() == "mine" and "mine" in gmsh.model.list()
    gmsh.finalize()
