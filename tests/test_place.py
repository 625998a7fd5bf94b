"""What a user meets beside the mechanics: fits, names, titles, curves, hand-over, messages."""

from __future__ import annotations

import ast
import csv
import io
import os
import shutil
import subprocess
import sys
import types
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.cli import main as cli
from dea_fenicsx.materials import TestData, fit, read_cycles, read_data
from dea_fenicsx.materials.fitted import with_spread
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.model.state import Factors
from dea_fenicsx.path.verdicts import ramp_lost
from dea_fenicsx.pictures import paraview
from dea_fenicsx.pictures.command import title_of
from dea_fenicsx.pictures.curves import first_shown
from dea_fenicsx.results import provenance
from dea_fenicsx.results.axes import axes_told
from dea_fenicsx.results.history import History
from dea_fenicsx.results.reading import moved_ramps
from dea_fenicsx.run.resuming import add_present_names
from dea_fenicsx.solvers.outcome import Outcome
from dea_fenicsx.support import form_cache
from dea_fenicsx.support.progress import Progress, step_line

LAM = np.linspace(1.05, 3.0, 15)


def curves(model, tests=("uniaxial", "equibiaxial"), noise=0.0) -> list[TestData]:
    rng = np.random.default_rng(1)
    return [
        TestData(t, LAM, nominal_stress(model, t, LAM) * (1 + noise * rng.standard_normal(15)))
        for t in tests
    ]


def cost(found) -> float:
    """The sum that is minimised, which is the same for all models."""
    return sum(r**2 for r in found.residual.values())


# --------------------------------------------------------------------------- fits

TRUTHS = {
    "gent": dea.Gent(5e4, 60.0), "steep": dea.Ogden((1e3,), (5.0,)),
    "negative": dea.Ogden((-3e4,), (-3.0,)), "soft": dea.Ogden((2e5,), (0.5,)),
}  # fmt: skip


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("tests", [("uniaxial",), ("equibiaxial",), ("uniaxial", "planar")])
def test_a_model_never_fits_worse_than_its_special_case(truth, tests):
    """Also where the best constants of all have a negative initial shear modulus."""
    data = curves(TRUTHS[truth], tests, 0.02)
    plain = fit(dea.NeoHookean, data)
    for model in (dea.MooneyRivlin, dea.Yeoh):
        found = fit(model, data)
        assert found.model.faults() == []
        assert cost(found) <= cost(plain) * (1 + 1e-9)
        assert found.r_squared >= plain.r_squared - 1e-9


@pytest.mark.parametrize(("start", "alpha"), [
    ((1e5, 2.0), -3.0), ((1e5, 0.2), -0.3), ((-1e5, -2.0), 5.0), ((1e5, -2.0), 0.5),
])  # fmt: skip
def test_an_exponent_of_ogden_crosses_zero(start, alpha):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the stresses are small
        truth = dea.Ogden((1e3 / alpha,), (alpha,))
        found = fit(dea.Ogden((start[0],), (start[1],)), curves(truth))
    assert found.model.alpha == pytest.approx((alpha,), rel=1e-6)
    assert found.model.mu == pytest.approx((1e3 / alpha,), rel=1e-6)


def test_a_printed_fit_has_uncertainties_and_digits_that_mean_something():
    text = str(fit(dea.MooneyRivlin, curves(dea.MooneyRivlin(4e4, 5e3), noise=0.02)))
    assert " ± " in text and "kPa" in text and text.startswith("MooneyRivlin(C10 = ")
    digits = [word for word in text.replace("(", " ").split() if len(word.strip("0.,;)")) > 8]
    assert not [word for word in digits if any(c.isdigit() for c in word)]
    assert repr(fit(dea.Gent, curves(dea.NeoHookean(4e4)))).startswith("Gent(mu = 40")


@pytest.mark.parametrize(("value", "deviation", "told"), [
    (42.3456, 1.234, "42.3 ± 1.2"), (419.77, 16.2, "420 ± 16"), (4197.7, 162.0, "4200 ± 160"),
    (4.736097, 0.0684, "4.736 ± 0.068"), (3.14159265, float("inf"), "3.142 ± inf"),
    (-2.3946, 0.149, "-2.39 ± 0.15"), (1.0, 0.0996, "1.00 ± 0.10"), (5.0, 0.0, "5 ± 0"),
])  # fmt: skip
def test_a_number_ends_where_its_uncertainty_ends(value, deviation, told):
    assert with_spread(value, deviation) == told


@pytest.mark.parametrize("text", [
    "1.5,2.25\n2.5,3.5\n", "stretch,stress\n1.5, 2.25\n2.5, 3.5\n", "1.5;2.25\n2.5;3.5\n",
    "1,5;2,25\n2,5;3,5\n", "1,5 2,25\n2,5 3,5\n", "1.5\t2.25\n2.5\t3.5\n", "1,5\t2,25\n2,5\t3,5\n",
    '"a";"b"\n"1,5";"2,25"\n"2,5";"3,5"\n', "# made 2020\n1.5 2.25\n2.5 3.5\n",
])  # fmt: skip
def test_the_separator_of_a_file_is_found(tmp_path, text):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    found = read_data(file, "uniaxial", 0, 1, unit=1e3)
    assert found.stretch == pytest.approx([1.5, 2.5])
    assert found.stress == pytest.approx([2250.0, 3500.0])


def test_the_separator_of_cycles_is_found(tmp_path):
    file = tmp_path / "cycles.txt"
    file.write_text("fast;0,1;1,0;0\nfast;0,1;1,5;2\nfast;0,1;1,2;1\n")
    (found,) = read_cycles(file, "uniaxial", (0, 1, 2, 3))
    assert found.stretch[found.measured][-1] == pytest.approx(1.2)


def test_a_file_without_numbers_is_told(tmp_path):
    file = tmp_path / "curve.csv"
    file.write_text("a,b\n")
    with pytest.raises(dea.InputError, match="whatever sign separates"):
        read_data(file, "uniaxial", 0, 1, unit=1.0)


# --------------------------------------------------------------------------- materials, meshes


def test_a_rubber_with_several_sets_is_answered_by_what_they_are_for():
    with pytest.raises(dea.InputError, match=r"nearest is 'vhb4910-wang2016' .slow"):
        dea.materials.get("vhb-4910")
    with pytest.raises(dea.InputError, match=r"'sylgard-186' .*'sylgard-184' "):
        dea.materials.get("Sylgard")
    with pytest.raises(dea.InputError, match="nearest is 'elastosil-2030'"):
        dea.materials.get("elastosl-2030")
    assert all(dea.materials.preset(name).use for name in dea.materials.list())


def test_the_table_of_materials_has_a_head_and_a_legend(capsys):
    assert cli(["materials"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "model", "modulus", "eps_r", "mark", "for"]
    for mark in ("S", "M", "D"):
        assert any(line.startswith(f"  {mark}  ") for line in lines)
    names = [line.split()[0] for line in lines if line.strip()]
    corner = lines.index("Only for the benchmark of Park (2019), `dea table`:")
    assert all("thesis" not in line.split()[0] for line in lines[:corner] if line.strip())
    assert set(dea.materials.list()) <= set(names)


@pytest.mark.parametrize(("name", "text", "told"), [
    ("bad.geo", "Point(1) = {0,0,0\n", "syntax error.*look at the script"),
    ("bad.step", "nonsense", "write it anew as STEP"),
    ("bad.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\nx", "write it anew"),
])  # fmt: skip
def test_what_gmsh_cannot_read_is_told_by_its_kind(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(dea.InputError, match=told) as caught:
        dea.device(tmp_path / name)
    assert "must be a .msh, .geo or STEP" not in str(caught.value)


def test_a_device_is_made_by_either_name():
    from dea_fenicsx.geometry import BoxStack, Layer

    stack = BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(1,))
    new = dea.device(stack)
    with pytest.warns(PendingDeprecationWarning, match="dea_fenicsx.device"):
        old = dea.read_gmsh(stack)
    assert old.regions == new.regions and old.surfaces == new.surfaces
    with pytest.raises(dea.InputError, match="device takes no keyword"):
        dea.device(stack, curve=False)


# --------------------------------------------------------------------------- a run


def build():
    """A round film on conducting paste, whose rim is pulled out: axes r, z and hoop."""
    from dea_fenicsx.geometry import BoxStack, Layer

    layers = [Layer("paste", 1e-4), Layer("film", 5e-4)]
    device = dea.device(BoxStack(2e-3, None, layers, divisions=(3,)), MPI.COMM_SELF)
    film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
    paste = dea.Material(dea.NeoHookean(1e4), dea.Conductor())
    return dea.Scene(
        device, {"film": film, "paste": paste},
        [dea.Electrode("top", VOLTS), dea.Ground("paste")],
        [dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        prescribed=[dea.Stretch("x_max", "r", STRETCH)], kinematics=dea.Axisymmetric(),
    )  # fmt: skip


VOLTS, STRETCH = 5e3, 1.3
FIELD = VOLTS / (5e-4 / STRETCH**2)


@pytest.fixture(scope="module")
def done(tmp_path_factory, request):
    """Pre-stretch, then a ramp that names nothing; what was printed on the way."""
    out = tmp_path_factory.mktemp("place") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        text = io.StringIO()
        with redirect_stdout(text):
            run = dea.solve(
                build(), [dea.Ramp("stretch", steps=2), dea.Ramp(steps=2)],
                {"h": dea.MeanDisplacement("top", "z")}, out=out,
            )  # fmt: skip
    return run, out, text.getvalue()


def test_the_summary_names_the_ramps_that_a_path_moves(done):
    run, out, _ = done
    path = run.summary["settings"]["path"]
    assert [item["what"] for item in path] == ["stretch", ["stretch", "voltage"]]
    assert title_of(out, 1.0, 2.0).startswith("stretch × 1, voltage 5 kV, step 4")
    assert title_of(out, 1.0, 1.0).startswith("stretch × 1, voltage 0 V, step 2")
    # summaries of earlier versions name nothing
    told = dict(run.summary, settings={"path": [{"what": []}]})
    assert moved_ramps(told) == []


def test_ramps_of_switches_and_drives_are_found_beside_each_other():
    path = [{"what": "stretch"}, {"type": "Open", "where": "top"}, {"drive": {"voltage": 1}},
            {"type": "Close", "where": "top", "ramps": ["source"]}]  # fmt: skip
    found = moved_ramps({"settings": {"path": path}})
    assert found == ["stretch", "voltage", "source"]


def test_a_body_of_revolution_is_told_by_r_z_and_hoop(done):
    run, out, _ = done
    assert axes_told(run.summary) == ("r", "z", "hoop")
    assert axes_told({"settings": {"kinematics": {"type": "Axisymmetric"}}}) == ("r", "z", "hoop")
    assert axes_told({}) == ("x", "y", "z")
    assert "(r, z, hoop). Regions: 1 paste, 2 film." in (out / "fields.xdmf").read_text()
    with h5py.File(out / "fields.h5") as h5:
        stress = h5["step_00004/cell/cauchy_stress_Pa"][-1].reshape(3, 3)
    # equibiaxial: radial and hoop stress are equal, the axial one is 0 with the electric part
    assert stress[0, 0] == pytest.approx(stress[2, 2], rel=1e-8)
    assert abs(stress[1, 1]) < 1e-6 * stress[0, 0]


def test_the_field_is_told_in_megavolts_and_not_where_there_is_none(done):
    with h5py.File(done[1] / "fields.h5") as h5:
        cells, regions = h5["step_00004/cell"], h5["grid/regions"][:]
        strength = cells["field_strength_MV_per_m"][:]
        assert np.isnan(strength[regions == 1]).all()
        assert strength[regions == 2] == pytest.approx(FIELD / 1e6, rel=1e-6)
        assert cells["field_strength_V_per_m"][:][regions == 1] == pytest.approx(0.0)


def test_electrodes_and_surfaces_are_blocks_by_name(done):
    run, out, _ = done
    found = {}
    for document in ("electrodes", "surfaces"):
        blocks = ElementTree.parse(out / f"{document}.xdmf").findall("./Domain/Grid")
        assert all(len(block.findall("Grid")) == len(run.history) for block in blocks)
        found[document] = [block.attrib["Name"] for block in blocks]
    assert found["electrodes"] == ["electrode top"]
    others = set(run.problem.scene.device.surfaces) - {"top"}
    assert set(found["surfaces"]) <= others and {"bottom", "x_max"} <= set(found["surfaces"])
    with h5py.File(out / "fields.h5") as h5:
        nodes = np.unique(h5["grid/facets/top"][:])
        assert h5["grid/points"][:][nodes, 1] == pytest.approx(6e-4)
        assert len(nodes) == 7  # three quadratic edges
        assert h5["step_00004/node/potential_V"][:][nodes] == pytest.approx(VOLTS)


def test_the_script_for_paraview_reads_a_run_that_has_grown(done, tmp_path):
    """Its functions are called here without ParaView; the folder's name has quotes."""
    folder = tmp_path / """it's a "run" & {more}"""
    shutil.copytree(done[1], folder)
    text = paraview.write(folder).read_text("utf-8")
    tree = ast.parse(text)
    wanted = [node for node in tree.body if isinstance(node, ast.FunctionDef | ast.Assign)]
    names = {"FOLDER", "REGIONS", "WRITTEN", "LOADS", "told"}
    kept = [
        node for node in wanted
        if getattr(node, "name", None) in names
        or (isinstance(node, ast.Assign) and getattr(node.targets[0], "id", None) in names)
    ]  # fmt: skip
    space = {"csv": csv, "os": os}
    exec(compile(ast.Module(kept, []), "view.py", "exec"), space)
    assert space["FOLDER"] == str(folder.resolve())
    assert space["told"]() == space["WRITTEN"]
    assert space["told"]()[-1] == "step 4, stretch 1, voltage 5 kV"
    assert space["REGIONS"] == [(1, "paste"), (2, "film")]
    history = folder / "history.csv"
    rows = history.read_text().splitlines()
    history.write_text("\n".join([*rows, rows[-1].replace("4,", "5,", 1)]) + "\n")
    assert space["told"]()[-1] == "step 5, stretch 1, voltage 5 kV"
    texts, t_value = space["told"](), 2.5
    (shown,) = (
        node.value for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "attr", "") == "Expression"
    )  # fmt: skip
    later = {"told_later": "'time %.4g' % t_value"}
    expression = eval(compile(ast.Expression(shown), "view.py", "eval"), {"texts": texts} | later)
    for t_index in (0, 5, 6, 9):  # more steps than texts, as after the run has grown again
        told = eval(expression, {"t_index": t_index, "t_value": t_value})
        assert told == (texts[t_index] if t_index < 6 else "time 2.5")
    assert 'FIELD, LABEL = \'field_strength_MV_per_m\', \'Electric field (MV/m)\'' in text


def test_a_curve_over_the_voltage_begins_where_the_voltage_does(done, tmp_path):
    out = done[1]
    assert first_shown(out, ("voltage_V", "h_m")) == 2
    assert first_shown(out, ("h_m", "voltage_V")) == 2
    assert first_shown(out, ("stretch_factor", "h_m")) == 0
    assert first_shown(out, ("stretch_factor", "voltage_V")) == 0
    assert first_shown(out, ("time", "voltage_V")) == 0
    assert first_shown(out, ("max_field_x_m", "h_m")) == 0


def test_negative_modes_are_told_under_their_name(done):
    run, _, _ = done
    assert [row["negative_modes"] for row in run.history] == [
        row["inertia"] for row in run.history
    ]
    assert run["negative_modes"] == run.summary["negative_modes"] == 0


def test_a_run_of_an_earlier_version_gets_the_column_when_it_is_resumed(done):
    rows = [{k: v for k, v in row.items() if k != "negative_modes"} for row in done[0].history]
    told = {"history": rows}
    add_present_names(told)
    assert told["history"] == list(done[0].history)
    assert list(told["history"][0]) == done[0].history.names
    for other in ({}, {"history": 3}, {"history": [1, {"step": 0}]}):
        before = repr(other)
        add_present_names(other)
        assert repr(other) == before


def test_each_stage_of_a_path_is_told(done):
    lines = [line for line in done[2].splitlines() if line.startswith("stage")]
    assert lines == [
        "stage 1 of 2: ramp of stretch to 1 in 2 steps",
        "stage 2 of 2: ramp of stretch+voltage to 1 in 2 steps",
    ]


def test_a_run_is_short_in_a_notebook(done):
    run, out, _ = done
    assert len(repr(run)) < 200 and len(repr(run.history)) < 500
    assert repr(run.history).startswith("History(5 steps; columns: step, time")
    table = run._repr_html_()
    assert "<b>completed</b>, 4 steps" in table and table.count("<tr>") == 6
    assert "voltage_V" in table and "krylov" not in table
    long = History({"step": k, "x_<b>": float("nan")} for k in range(40))
    assert "28 more steps" in long._repr_html_() and "x_&lt;b&gt;" in long._repr_html_()


def test_the_cells_of_a_notebook_are_kept_as_script(tmp_path, monkeypatch):
    cells = ["", "import dea_fenicsx as dea", "run = dea.solve(scene, path)"]
    shell = types.SimpleNamespace(user_ns={"In": cells})
    fake = types.SimpleNamespace(get_ipython=lambda: shell)
    monkeypatch.setitem(sys.modules, "IPython", fake)
    provenance.keep_script(tmp_path)
    text = (tmp_path / "script.py").read_text()
    assert text == (
        "# In [1]\nimport dea_fenicsx as dea\n\n# In [2]\nrun = dea.solve(scene, path)\n"
    )
    assert provenance.origin()["script"] == "notebook"


def test_a_lost_ramp_says_how_to_go_on():
    attempt = types.SimpleNamespace(outcome=Outcome.DIVERGED, residual=1.0)
    low, high = Factors({"voltage": 0.9}), Factors({"voltage": 1.0})
    lost = ramp_lost(("voltage",), "voltage", low, high, attempt, True)
    assert 'dea.Trace("voltage")' in str(lost) and "snap=True" in str(lost)
    low, high = Factors({"a": 0.9, "b": 0.9}), Factors({"a": 1.0, "b": 1.0})
    both = ramp_lost(("a", "b"), "a+b", low, high, attempt, True)
    assert "snap=True" in str(both) and 'Trace("' not in str(both)


def test_compiling_is_told_once_and_apart_from_the_steps(capsys):
    progress = Progress(True, False)
    progress.renews = False
    with form_cache.telling(progress.compiling):
        form_cache.on_compiling()
        form_cache.on_compiling()
    told = capsys.readouterr()
    assert told.err == "compiling forms (once; kept in the cache)\n" and told.out == ""
    quiet = Progress(True, True)
    quiet.compiling()
    assert capsys.readouterr().err == ""


def test_a_step_tells_what_a_long_count_took():
    row = {"step": 3, "newton_iterations": 4, "krylov_iterations": 9, "event": ""}
    assert "30.1 s (24.0 s of it to count negative modes)" in step_line(row, {}, {}, (), 30.1, 24.0)
    assert "negative" not in step_line(row, {}, {}, (), 30.1, 0.5)


# --------------------------------------------------------------------------- the image

DOCKER = Path(__file__).resolve().parents[1] / "docker"


def engine(folder: Path, text: str) -> dict[str, str]:
    """An environment in which docker is a script."""
    program = folder / "bin" / "docker"
    program.parent.mkdir()
    program.write_text(f"#!/bin/bash\n{text}\n")
    program.chmod(0o755)
    path = f"{program.parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "ENGINE": "docker", "HOME": str(folder)}


@pytest.mark.skipif(not DOCKER.is_dir(), reason="not in a checkout")
@pytest.mark.parametrize(("options", "changes", "mount"), [
    (["--results", "out"], {}, "{home}/.cache/dea_fenicsx_image:/cache:rw"),
    (["--results", "out"], {"CACHE": "{home}/c"}, "{home}/c:/cache:rw"),
    (["--results", "out"], {"CACHE": "none"}, None),
    ([], {}, "dea_fenicsx_cache:/cache"), ([], {"CACHE": "none"}, None),
])  # fmt: skip
def test_the_image_keeps_compiled_forms(tmp_path, options, changes, mount):
    home = str(tmp_path)
    variables = engine(tmp_path, 'printf "%s\\n" "$@"')
    variables.pop("XDG_CACHE_HOME", None)
    variables |= {key: text.format(home=home) for key, text in changes.items()}
    found = subprocess.run(
        [DOCKER / "run", *options, "true"], env=variables, cwd=tmp_path, capture_output=True,
        text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    mounts = [line for line in found if line.endswith((":/cache", ":/cache:rw"))]
    assert mounts == ([mount.format(home=home)] if mount else [])
    assert ("XDG_CACHE_HOME=/cache" in found) == bool(mount)


@pytest.mark.skipif(not DOCKER.is_dir(), reason="not in a checkout")
def test_the_image_says_why_its_base_cannot_be_pulled(tmp_path):
    variables = engine(tmp_path, 'echo "no route to the registry" >&2; exit 1')
    tool = tmp_path / "bin" / "mmdebstrap"
    tool.write_text("#!/bin/bash\nexit 7\n")
    tool.chmod(0o755)
    found = subprocess.run([DOCKER / "build"], env=variables, capture_output=True, text=True)
    assert found.returncode != 0
    assert "cannot be pulled (no route to the registry)" in found.stdout + found.stderr
