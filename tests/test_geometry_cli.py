"""Device meshes from the command line: files, printed measures, bad input."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from dea_fenicsx.geometry import HDEA
from dea_fenicsx.geometry import _gmsh as to_gmsh

gmsh = pytest.importorskip("gmsh")


@pytest.fixture(autouse=True)
def clean_gmsh():
    """Every test ends with gmsh not running."""
    yield
    if gmsh.isInitialized():
        gmsh.finalize()


def command(*arguments, cwd):
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_command_line_hdea(tmp_path):
    done = command("dea_fenicsx.geometry.hdea", "--turns", 2, "out.msh", cwd=tmp_path)
    assert done.returncode == 0 and done.stderr == ""
    rows = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines()[3:]}
    assert "least scaled Jacobian 0." in done.stdout.splitlines()[1]
    exact = HDEA().measures()
    assert set(rows) == set(exact)
    for name, (_, _, size, closed, error) in rows.items():
        assert float(closed) == pytest.approx(exact[name], rel=1e-6)
        assert float(size) == pytest.approx(exact[name], rel=2e-4) and abs(float(error)) < 2e-4
    gmsh.initialize(readConfigFiles=False)
    gmsh.option.setNumber("General.Verbosity", 2)
    gmsh.open(str(tmp_path / "out.msh"))
    assert set(to_gmsh.measure(gmsh.model)) == set(exact)


def test_command_line_of_caps(tmp_path):
    done = command("dea_fenicsx.geometry.hdea", "--ends", "flat", "--cap", 1e-3, "--strands", 2,
                   "out.msh", cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0 and "\ncaps " in done.stdout, done.stderr
    wrong = command("dea_fenicsx.geometry.hdea", "--strands", 1.5, "out.msh", cwd=tmp_path)
    assert wrong.returncode == 2
    assert wrong.stderr == "HDEA: strands is 1.5; it must be a whole number of at least 1.\n"


def test_command_line_stacks(tmp_path):
    strip = "--length 0.1 --layer soft:1e-3:2 --layer stiff:2e-4 --divisions 8 --ends start"
    box = command("dea_fenicsx.geometry.box_stack", *strip.split(), "strip.msh", cwd=tmp_path)
    assert box.returncode == 0 and "interface_1" in box.stdout, box.stderr
    rings = "--radius 7e-3 --inset 3e-4 --layer soft:5e-4 --layer metal:5e-5:1:electrode"
    disk = command(
        "dea_fenicsx.geometry.disk_stack",
        *rings.split(),
        "--layer=soft:5e-4",
        "disk.msh",
        cwd=tmp_path,
    )
    assert disk.returncode == 0 and "rim_2" in disk.stdout, disk.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"strip.msh", "disk.msh"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("--turns 2.5 out.msh", "turns is 2.5"),
        ("--inset 3e-3 out.msh", "below 0.0025 m"),
        ("--elastomer nan out.msh", "elastomer is nan"),
        ("--refine 0 out.msh", "factor is 0"),
        ("--turns two out.msh", "'two' is not a number"),
        ("nowhere/out.msh", "no folder nowhere"),
        ("out.vtk", "must end in .msh"),
    ],
)
def test_command_line_refuses(tmp_path, arguments, says):
    (tmp_path / "out.msh").write_text("earlier")
    done = command("dea_fenicsx.geometry.hdea", *arguments.split(), cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert says in done.stderr and len(done.stderr.splitlines()) == 1
    assert (tmp_path / "out.msh").read_text() == "earlier" and len(list(tmp_path.iterdir())) == 1
