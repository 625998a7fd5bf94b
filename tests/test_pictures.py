"""Pictures from result files: curves, renderings, and what happens where they can't be made."""

from __future__ import annotations

import importlib.util
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import clean_environment, needed_mpirun
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import pictures
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.pictures.command import title_of
from dea_fenicsx.support.errors import InputError

needs_matplotlib = pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None, reason="matplotlib is not installed"
)
needs_pyvista = pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None, reason="pyvista is not installed"
)

VOLTS, H = 4000.0, 5e-4


def write_run(folder: Path, scale: float = 1.0, layers: int = 2) -> Path:
    """A run's files, written by hand: a cube of stacked hexahedra that is pressed flat."""
    import h5py

    folder.mkdir(parents=True)
    nz = 2 * layers + 1
    x, y, z = (np.linspace(0, s * H, n) for s, n in ((4, 3), (3, 3), (layers, nz)))
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    # VTK's 27 nodes by their place on a 3 x 3 x 3 lattice
    places = ["000", "200", "220", "020", "002", "202", "222", "022", "100", "210", "120", "010",
              "102", "212", "122", "012", "001", "201", "221", "021", "011", "211", "101", "121",
              "110", "112", "111"]  # fmt: skip
    cells = [
        [int(p[0]) * 3 * nz + int(p[1]) * nz + int(p[2]) + 2 * k for p in places]
        for k in range(layers)
    ]
    # step: voltage, field in the lowest layer; the others are conductors
    field = np.zeros(layers)
    field[0] = 8e6
    steps = [(0, 0.0), (1, 0.5), (2, 1.0)]
    with h5py.File(folder / "fields.h5", "w") as h5:
        h5["grid/points"], h5["grid/cells"] = points, np.array(cells)
        h5["grid/regions"] = np.arange(1, layers + 1)
        for k, load in steps:
            h5[f"s{k}/u"] = points * np.array([0.05, 0.05, -0.1]) * load**2 * scale
            h5[f"s{k}/e"] = field * load
            h5[f"s{k}/stress"] = np.tile(np.diag([1e3, 1e3, -2e3]).ravel(), (layers, 1)) * load

    def item(where: str) -> str:
        return f'<DataItem Format="HDF">fields.h5:/{where}</DataItem>'

    grids = "".join(
        f'<Grid><Time Value="{load}"/><Topology TopologyType="Hexahedron_27">{item("grid/cells")}'
        f"</Topology><Geometry>{item('grid/points')}</Geometry>"
        + "".join(
            f'<Attribute Name="{name}" Center="{center}">{item(where)}</Attribute>'
            for name, center, where in (
                ("region", "Cell", "grid/regions"),
                ("displacement_m", "Node", f"s{k}/u"),
                ("field_strength_V_per_m", "Cell", f"s{k}/e"),
                ("cauchy_stress_Pa", "Cell", f"s{k}/stress"),
            )
        )
        + "</Grid>"
        for k, load in steps
    )
    (folder / "fields.xdmf").write_text(f"<Xdmf><Domain><Grid>{grids}</Grid></Domain></Xdmf>")
    rows = [f"{k},{load},rise,{VOLTS * load},{0.1 * load**2 * scale},{8e6 * load}"
            for k, load in steps]  # fmt: skip
    header = "step,time,ramp,voltage_V,contraction,max_field_V_per_m"
    (folder / "history.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "summary.json").write_text('{"settings": {"path": [{"what": "voltage"}]}}')
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path / "run")


def png_size(path: Path) -> tuple[int, int]:
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


def python(*arguments: str, **extra: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)} | extra
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=200
    )


# ------------------------------------------------------------------------ labels


@pytest.mark.parametrize(
    ("name", "largest", "label", "divisor"),
    [
        ("voltage_V", 866.0, "Voltage (V)", 1.0),
        ("voltage_V", 6000.0, "Voltage (kV)", 1e3),
        ("top_m", 2.5, "Top (m)", 1.0),
        ("top_m", 3.3e-3, "Top (mm)", 1e-3),
        ("top_m", 2e-5, "Top (µm)", 1e-6),
        ("top_m", 0.0, "Top (m)", 1.0),
        ("max_field_V_per_m", 2e7, "Peak electric field (MV/m)", 1e6),
        ("max_field_V_per_m", 0.0, "Peak electric field (MV/m)", 1e6),
        ("charge_C", 7e-8, "Charge (nC)", 1e-9),
        ("pressure_Pa", 7.4e4, "Pressure (kPa)", 1e3),
        ("contraction", 0.01, "Contraction (%)", 0.01),
        ("stretch", 2.5, "Stretch (-)", 1.0),
        ("min_J", 0.99, "Smallest J (-)", 1.0),
        ("torque_N_m", 2e-3, "Torque (mN m)", 1e-3),
        ("field_strength_MV_per_m", 12.0, "Electric field (MV/m)", 1.0),
    ],
)
def test_axis_labels(name: str, largest: float, label: str, divisor: float) -> None:
    text, unit = pictures.axis_label(name, largest)
    assert text == label
    assert unit == pytest.approx(divisor, rel=1e-12)


# ------------------------------------------------------------------------ curves


@needs_matplotlib
def test_curve_is_written_beside_the_history(run: Path) -> None:
    paths = pictures.curve(run, "voltage_V", "contraction")
    assert paths == [run / "contraction_voltage.png", run / "contraction_voltage.svg"]
    assert png_size(paths[0])[0] == pytest.approx(85 / 25.4 * 300, abs=1)
    text = paths[1].read_text()
    assert "Voltage (kV)" in text
    assert "Contraction (%)" in text
    assert not list(run.glob(".*"))


@needs_matplotlib
def test_curve_of_several_runs_with_a_line_to_compare(run: Path, tmp_path: Path) -> None:
    other = write_run(tmp_path / "softer", 1.5)
    lines = {"closed form": (np.linspace(0, VOLTS, 20), np.linspace(0, 0.1, 20))}
    png, svg = pictures.curve(
        [run, other], "voltage_V", "contraction", tmp_path / "both.png", lines=lines
    )
    assert (png.name, svg.name) == ("both.png", "both.svg")
    assert all(name in svg.read_text() for name in ("run", "softer", "closed form"))


@needs_matplotlib
def test_curve_is_the_same_each_time_and_leaves_matplotlib_alone(run: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    first = pictures.curve(run, "voltage_V", "contraction")[1].read_bytes()
    assert pictures.curve(run, "voltage_V", "contraction")[1].read_bytes() == first
    assert dict(matplotlib.rcParams) == before


@needs_matplotlib
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": "volts"}, "no column 'volts'"),
        ({"y": "ramp"}, "does not hold numbers"),
        ({"folders": "nowhere"}, "no history.csv"),
        ({"folders": []}, "No folder"),
        ({"labels": ["a", "b"]}, "1 runs but 2 labels"),
    ],
)
def test_curve_refuses_bad_input(run: Path, change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        pictures.curve(**({"folders": run, "x": "voltage_V", "y": "contraction"} | change))


@needs_matplotlib
def test_command_line_curve(run: Path) -> None:
    done = python("-m", "dea_fenicsx.pictures", "curve", str(run), "--y", "max_field_V_per_m")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(run / f"max_field_voltage.{k}") for k in ("png", "svg")]
    done = python("-m", "dea_fenicsx.pictures", "curve", str(run), "--y", "nothing")
    assert done.returncode == InputError.exit_status
    assert done.stderr.count("\n") == 1


def test_import_is_light() -> None:
    heavy = "('dolfinx', 'mpi4py', 'matplotlib', 'pyvista', 'vtkmodules', 'h5py')"
    done = python(
        "-c", f"import sys, dea_fenicsx.pictures; print([m for m in {heavy} if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]", done.stderr


# -------------------------------------------------------------------- renderings


def draw(*arguments, **options) -> Path:
    """A rendering, or a skip where this machine can't draw."""
    reasons: list[str] = []
    path = pictures.deformed(*arguments, **options, say=reasons.append)
    if path is None:
        pytest.skip(reasons[0])
    return path


def colours(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return imread(path)[..., :3]


@needs_matplotlib
@needs_pyvista
def test_rendering_shows_the_field_and_the_conductors(run: Path) -> None:
    path = draw(run)
    assert path == run / "field_strength.png"
    width, height = png_size(path)
    assert width == pytest.approx(174 / 25.4 * 300, abs=1)
    assert 300 < height < width
    image = colours(path)
    right = image[:, int(0.5 * width) : int(0.85 * width)]  # the section
    yellow = np.abs(right - [0.993, 0.906, 0.144]).max(axis=-1) < 0.03
    grey = np.abs(right - 0xB8 / 255).max(axis=-1) < 0.03
    red = (right[..., 0] > 0.7) & (right[..., 1] < 0.4) & (right[..., 2] < 0.4)
    for seen in (yellow, grey):
        assert seen.mean() > 0.05
    assert red.any()
    # the dielectric lies under the conductor
    assert np.argwhere(yellow)[:, 0].mean() > np.argwhere(grey)[:, 0].mean()
    assert not list(run.glob(".*"))


@needs_matplotlib
@needs_pyvista
@pytest.mark.parametrize(("width", "height"), [(0.1e-3, 10e-3), (0.5e-3, 10e-3), (10e-3, 0.1e-3)])
def test_flat_sections_of_any_shape(tmp_path: Path, width: float, height: float) -> None:
    """A uniform field is one colour, and no picture is black."""
    film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
    device = dea.read_gmsh(
        BoxStack(width, None, [Layer("film", height, divisions=8)], divisions=8), MPI.COMM_SELF
    )
    scene = dea.Scene(
        device, {"film": film}, [dea.Electrode("x_max", 1e6 * width), dea.Ground("x_min")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
        kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    dea.solve(scene, dea.Ramp(steps=1), out=tmp_path / "out", quiet=True, stability="never")
    begun = time.perf_counter()
    picture = colours(draw(tmp_path / "out"))
    assert time.perf_counter() - begun < 60  # 2 to 3 s on an idle machine
    yellow = np.array([0.993, 0.906, 0.144])  # the upper end of the scale
    assert 1e-3 < np.all(np.abs(picture - yellow) < 0.03, axis=-1).mean() < 0.9
    assert np.all(picture < 0.25, axis=-1).mean() < 0.03


@needs_matplotlib
@needs_pyvista
def test_rendering_of_other_fields_by_command_line(run: Path, tmp_path: Path) -> None:
    draw(run, "displacement_m", step=1, path=tmp_path / "u.png")
    target = tmp_path / "stress.png"
    done = python("-m", "dea_fenicsx.pictures", "render", str(run), "--field", "cauchy_stress_Pa",
                  "--warp", "0", "--out", str(target))  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(target)
    assert png_size(target)[0] == png_size(tmp_path / "u.png")[0]


def test_title_names_load_step_and_scale(run: Path) -> None:
    assert title_of(run, 5.0, 0.5) == (
        "voltage 2 kV, step 1, displacements × 5, undeformed in red"
    )
    (run / "summary.json").unlink()
    assert title_of(run, 1.0, 1.0).startswith("step 2, ")


@needs_matplotlib
@needs_pyvista
@pytest.mark.parametrize(
    ("options", "message"),
    [({"field": "heat"}, "no field 'heat'"), ({"step": 7}, "holds steps 0 to 2")],
)
def test_rendering_refuses_bad_input(run: Path, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        pictures.deformed(run, **options)
    with pytest.raises(InputError, match=r"no fields\.xdmf"):
        pictures.deformed(run / "nothing")


@needs_matplotlib
@pytest.mark.parametrize(
    ("module", "reason"),
    [
        ("import os; os.abort()", "ended by signal 6"),
        ("raise ImportError('libfoo.so.1: cannot open shared object file')", "libfoo.so.1"),
        ("import time; time.sleep(60)", "took more than"),
    ],
)
def test_no_picture_is_no_error(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, reason: str
) -> None:
    (tmp_path / "fake").mkdir()
    (tmp_path / "fake" / "matplotlib.py").write_text(module)
    monkeypatch.syspath_prepend(str(tmp_path / "fake"))
    if "sleep" in module:
        monkeypatch.setattr(pictures.drawing, "_TIMEOUT_S", 2.0)
    reasons: list[str] = []
    assert pictures.deformed(run, say=reasons.append) is None
    assert len(reasons) == 1
    assert reason in reasons[0]
    assert "\n" not in reasons[0]
    assert not list(run.glob("*.png"))


@needs_matplotlib
def test_without_display_opengl_and_pyvista(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (run.parent / "fake").mkdir()
    (run.parent / "fake" / "pyvista.py").write_text("import os; os.abort()")
    monkeypatch.syspath_prepend(str(run.parent / "fake"))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkXOpenGLRenderWindow")
    assert pictures.deformed(run) == run / "field_strength.png"


@needs_matplotlib
@needs_pyvista
@pytest.mark.mpi
def test_rendering_from_inside_an_mpi_run(run: Path) -> None:
    mpirun = needed_mpirun()
    script = (
        "import dea_fenicsx as dea, sys\n"
        "from mpi4py import MPI\n"
        "if MPI.COMM_WORLD.rank == 0:\n"
        "    print(dea.pictures.deformed(sys.argv[1], say=lambda r: print('none:', r)))\n"
        "MPI.COMM_WORLD.Barrier()\n"
    )
    done = subprocess.run(
        [mpirun, "-n", "2", sys.executable, "-c", script, str(run)],
        env=clean_environment(), capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    if "none:" in done.stdout:
        pytest.skip(done.stdout.strip())
    assert done.stdout.strip() == str(run / "field_strength.png")


def test_a_run_without_an_electric_field_shows_the_displacement(tmp_path: Path) -> None:
    scene = dea.Scene(
        dea.device(BoxStack(1e-3, None, [Layer("film", 1e-4)], 2)),
        {"film": dea.Material(dea.NeoHookean(1e5))}, supports=[dea.Clamp("x_min")],
        loads=[dea.DeadLoad("x_max", (10.0, 0.0))], kinematics=dea.PlaneStrain(1.0),
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), out=tmp_path / "pulled", quiet=True)
    drawn = dea.pictures.deformed(run.out)
    assert drawn is None or drawn.name == "displacement.png"


def _lattice(folder: Path, across: int, along: int) -> Path:
    """A run of so many flat cells of second order, whose field grows with x."""
    import h5py

    x, y = (np.linspace(0, side, 2 * n + 1) for side, n in ((1e-2, across), (1e-3, along)))
    points = np.stack([*(a.ravel() for a in np.meshgrid(x, y, indexing="ij"))], axis=1)
    points = np.column_stack([points, np.zeros(len(points))])
    i, j = (2 * a.ravel() for a in np.meshgrid(range(across), range(along), indexing="ij"))
    local = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
    cells = np.stack([(i + a) * len(y) + j + b for a, b in local], axis=1)
    folder.mkdir()
    with h5py.File(folder / "fields.h5", "w") as h5:
        h5["points"], h5["cells"], h5["u"] = points, cells, 0.1 * points
        h5["e"] = 1e6 * np.ones(len(cells))

    def item(where: str) -> str:
        return f'<DataItem Format="HDF">fields.h5:/{where}</DataItem>'

    (folder / "fields.xdmf").write_text(
        '<Xdmf><Domain><Grid><Grid><Time Value="1"/><Topology TopologyType="Quadrilateral_9">'
        f"{item('cells')}</Topology><Geometry>{item('points')}</Geometry>"
        f'<Attribute Name="displacement_m" Center="Node">{item("u")}</Attribute>'
        f'<Attribute Name="field_strength_V_per_m" Center="Cell">{item("e")}</Attribute>'
        "</Grid></Grid></Domain></Xdmf>"
    )
    return folder


@needs_matplotlib
def test_many_cells_take_little_time_and_memory(tmp_path: Path) -> None:
    """50 000 cells: at most 3 s of processor time and 500 MB, in the colour of a uniform field."""
    run = _lattice(tmp_path / "many", 500, 100)
    script = (
        "import resource, sys\n"
        "from dea_fenicsx.pictures.command import main\n"
        "main(['render', sys.argv[1], '--here', '--out', sys.argv[2]])\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "peak = [l.split()[1] for l in open('/proc/self/status') if l.startswith('VmHWM')][0]\n"
        "print(used.ru_utime + used.ru_stime, int(peak) / 1024)\n"
    )
    picture = tmp_path / "many.png"
    done = python("-c", script, str(run), str(picture))
    assert done.returncode == 0, done.stderr
    seconds, megabytes = map(float, done.stdout.split())
    assert seconds < 3 and megabytes < 500
    yellow = np.abs(colours(picture) - [0.993, 0.906, 0.144]).max(axis=-1) < 0.03
    assert 0.05 < yellow.mean() < 0.9


@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0])
def test_edges_that_are_drawn(angle: float) -> None:
    """A bent strip: its border, and the fold where it is sharp; two regions meet at a line."""
    from dea_fenicsx.pictures.faces import Faces, edges_of, normals, sharp

    n = 4
    along = np.arange(2 * n + 1.0)
    turn = np.radians(angle)
    x = np.where(along < n, along, n + (along - n) * np.cos(turn))
    z = np.where(along < n, 0, (along - n) * np.sin(turn))
    points = np.array([(a, y, c) for a, c in zip(x, z, strict=True) for y in range(n + 1)])
    i, j = (a.ravel() for a in np.meshgrid(range(2 * n), range(n), indexing="ij"))
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    nodes = np.stack([(i + a) * (n + 1) + j + b for a, b in corners], axis=1).astype(np.int32)
    count, inner = len(nodes), np.zeros(len(nodes), dtype=bool)
    for regions, lines in ((np.ones(count, int), 0), ((i >= 1).astype(int), 2 * n)):
        faces = Faces(nodes, 4, np.arange(count), regions, inner, np.arange(len(points)), points,
                      0 * points, np.ones(len(points), dtype=bool))  # fmt: skip
        normal = normals(faces, points)
        edges, pairs = edges_of(faces, [normal])
        drawn = np.sort(edges[sharp(pairs, normal)], axis=1)
        assert len(drawn) == 6 * n + (n if angle > 40 else 0) + lines
        assert len(np.unique(drawn, axis=0)) == 6 * n + (n if angle > 40 else 0) + lines // 2
