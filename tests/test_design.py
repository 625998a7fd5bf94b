"""The design search: exact front, repeatable, resumable, clear about what is wrong."""

from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from conftest import numbers_of_ranks

import dea_fenicsx as dea
from dea_fenicsx.design import (
    EFFECTIVE_MU,
    ENVELOPE,
    TABLE_4_2,
    UNITS,
    HelicalModel,
    draw_sensitivities,
    exact_hypervolume,
    optimise,
    search,
    sensitivities,
)

needs_pymoo = pytest.mark.skipif(find_spec("pymoo") is None, reason="pymoo is not installed")
RUBBER = dea.Material(dea.NeoHookean(EFFECTIVE_MU), dea.IdealDielectric(TABLE_4_2["eps_r"]))
RING = {n: TABLE_4_2[n] for n in ("outer_radius", "inner_radius", "elastomer")}


# ---------------------------------------------------------------------------------- the model


def test_table_4_2():
    """Printed: 8902.528 V and 20.2 um; the rest follows from the analytic model."""
    model = HelicalModel(RUBBER)
    here = model(**TABLE_4_2)
    assert here["strain"] == pytest.approx(0.145011, rel=4e-6)
    assert here["displacement"] == pytest.approx(20.2e-6, rel=1e-12)
    assert here["voltage"] == pytest.approx(8902.528, rel=1e-4)
    assert here["pitch_angle_deg"] == pytest.approx(1.0006, rel=1e-6)
    better = TABLE_4_2 | {"elastomer": 100e-6, "eps_r": 10.0}
    assert model(**better)["voltage"] == pytest.approx(5329.4, rel=1e-4)
    stroke = model(**better | {"contraction": 0.202})
    assert stroke["displacement"] == pytest.approx(20.2e-6)
    assert stroke["voltage"] == pytest.approx(5896.5, rel=1e-4)
    back = model(**{n: v for n, v in TABLE_4_2.items() if n != "contraction"},
                 voltage=here["voltage"])  # fmt: skip
    assert back["contraction"] == pytest.approx(TABLE_4_2["contraction"], rel=1e-9)


def test_energy_is_the_work_of_the_pressure():
    """W = int p d(ln(1/lam3)) over the contraction, for a material that stiffens."""
    model = HelicalModel(dea.materials.get("vhb-thesis-gent-2p125"))
    k = np.linspace(0, 0.3, 3001)
    found = model(3e-3, 1e-3, 2e-4, 5.0, contraction=k)
    pressure = 5.0 * dea.materials.EPSILON_0 * (found["voltage"] / (2e-4 * (1 - k))) ** 2
    work = np.trapezoid(pressure, -np.log(1 - k))
    assert found["energy_density"][-1] == pytest.approx(work, rel=1e-6)
    area = np.pi * (3e-3**2 - 1e-3**2)
    held = 5.0 * dea.materials.EPSILON_0 * (found["voltage"][-1] / 2e-4) ** 2 * area
    assert found["blocked_force"][-1] == pytest.approx(held)


# ---------------------------------------------------------------------------------- the search


@needs_pymoo
@pytest.mark.parametrize("name", ["effective", "elastosil-2030"])
def test_front_against_the_exact_one(name):
    material = RUBBER if name == "effective" else dea.materials.get(name)
    front = search(material, seed=4)
    exact = HelicalModel(material).front()
    worst = {"voltage": 1.1 * exact["voltage"].max(), "strain": 0.0}
    ratio = front.hypervolume(worst) / exact_hypervolume(exact, worst)
    assert 0.995 <= ratio <= 1
    assert front.wall_s < 60
    assert np.all(front["voltage"] >= np.interp(front["strain"], exact["strain"],
                                                exact["voltage"]) * (1 - 1e-6))  # fmt: skip
    for variable, (low, high) in ENVELOPE.items():
        assert np.all((front[variable] >= low) & (front[variable] <= high)), variable


@needs_pymoo
def test_same_seed_same_front(tmp_path):
    fronts = [search(RUBBER, population=40, generations=15, seed=s) for s in (7, 7, 8)]
    paths = [f.write(tmp_path / f"{i}.csv", UNITS) for i, f in enumerate(fronts)]
    texts = [p.read_text() for p in paths]
    assert texts[0] == texts[1] != texts[2]
    head = texts[0].splitlines()[0].split(",")
    assert {"voltage_V", "strain", "outer_radius_m", "pitch_angle_deg"} <= set(head)


@needs_pymoo
def test_the_pitch_angle_ties_the_thickness():
    """pitch = 2 (elastomer + electrode); a fixed angle of 2 degrees makes the layer thicker."""
    front = search(RUBBER, {"pitch_angle_deg": 2.0}, population=40, generations=20)
    tied = np.pi * front["outer_radius"] * np.tan(np.radians(2.0)) - 50e-6
    assert front["elastomer"] == pytest.approx(tied, rel=1e-9, abs=0)
    assert front["elastomer"].min() == pytest.approx(169.4e-6, rel=0.01)  # at r_o = 2 mm
    assert front["pitch_angle_deg"] == pytest.approx(2.0)


@needs_pymoo
def test_constraints_and_three_objectives():
    material = replace(RUBBER, electric=dea.IdealDielectric(2.0, 60e6))
    front = search(
        material, {"eps_r": 3.0}, ("voltage", "displacement", "blocked_force"), turns=5,
        constraints={"breakdown": 1.5, "pull_in": 1.3, "thickness": 150e-6, "height": 3e-3},
        population=40, generations=20,
    )  # fmt: skip
    assert front.variables == ("outer_radius", "inner_radius", "elastomer", "contraction")
    assert np.all(front["true_field"] * 1.5 <= 60e6 * (1 + 1e-12))
    assert np.all(front["pull_in_margin"] >= 1.3)
    assert np.all(front["elastomer"] >= 150e-6)
    assert np.all(12 * (front["elastomer"] + 50e-6) <= 3e-3 * (1 + 1e-12))
    F = front.minimised
    for row in F[:50]:
        better = F - row
        assert not np.any(np.all(better <= 0, axis=1) & np.any(better < 0, axis=1))


@needs_pymoo
def test_weighted_sum_of_eq_62(tmp_path):
    front = search(RUBBER, population=40, generations=15, start=TABLE_4_2)
    f = 0.3 * front["voltage"] + 0.7 / front["strain"]
    assert front.weighted_sum(0.3) == np.argmin(f)
    assert front.weighted_sum(1.0, scaled=True) == np.argmin(front["voltage"])
    assert front.weighted_sum(0.0) == np.argmax(front["strain"])
    pytest.importorskip("matplotlib")
    picture = front.draw(tmp_path / "front.png", units=UNITS, weight=0.5,
                         points={"Table 4.2": {"voltage": 8902.5, "strain": 0.145}})  # fmt: skip
    assert picture.stat().st_size > 10_000


@needs_pymoo
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"envelope": {"elastomer": (5e-4, 1e-4)}}, "lower bound 0.0005 above its upper"),
        ({"envelope": {"elastomer": (1e-4, np.nan)}}, "must be finite"),
        ({"envelope": {"elastomer": "thin"}}, "must be a number or a pair"),
        ({"envelope": {"thickness": (1e-4, 5e-4)}}, "no design variable 'thickness'"),
        ({"envelope": {"elastomer": (0.0, 5e-4)}}, "must be above 0"),
        ({"envelope": {"contraction": (0.1, 1.0)}}, "must stay below 1"),
        ({"objectives": ("voltage", "stroke")}, "no objective 'stroke'"),
        ({"objectives": ()}, "no objective; name at least one"),
        ({"constraints": {"weight": 1.0}}, "no constraint 'weight'"),
        ({"constraints": {"height": -1.0}}, "must be a number > 0"),
        ({"constraints": {"breakdown": 1.2}}, "needs the material's breakdown field"),
        ({"constraints": {"height": 1e-6}}, r"None of the 200 designs satisfies height <= 1e-06"),
        ({"constraints": {"pull_in": 1.1, "height": 7e-4, "thickness": 4e-4}},
         "satisfies all constraints at once"),
        ({"start": TABLE_4_2 | {"elastomer": 1e-3}}, "outside its range"),
        ({"start": TABLE_4_2, "constraints": {"pull_in": 2.0}},
         "Starting design 1 is infeasible: it violates pull_in_margin >= 2"),
        ({"start": {"elastomer": 1e-4}}, "gives no value of 'outer_radius'"),
        ({"population": 2}, "population is 2"),
        ({"seed": -1}, "seed is -1"),
        ({"material": "vhb-thesis-table-5-2-G-K"}, "incompressible materials only"),
        ({"material": "rubber"}, "no material named 'rubber'"),
    ],
)  # fmt: skip
def test_bad_search_is_refused_in_one_sentence(options, words):
    settings = {"material": RUBBER, "population": 20, "generations": 10} | options
    with pytest.raises(dea.InputError, match=words) as error:
        search(**settings)
    assert "\n" not in str(error.value)


def test_without_pymoo_one_sentence_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymoo.algorithms.moo.nsga2", None)
    with pytest.raises(dea.InputError, match="needs pymoo"):
        search(RUBBER)


# -------------------------------------------------------------------------- any function


def sphere(x, y):
    """Two objectives whose front is the line y = 0, 0 <= x <= 1; fails for x > 1.5."""
    if x > 1.5:
        raise dea.EquilibriumLost("pull-in")
    return {"near": x**2 + y**2, "far": (x - 1) ** 2 + y**2, "sum": x + y}


BOX = {"x": (-1.0, 2.0), "y": (-1.0, 1.0)}
BOTH = {"near": "min", "far": "min"}


@needs_pymoo
def test_failures_are_infeasible_and_logged(tmp_path):
    front = optimise(sphere, BOX, BOTH, {"sum": (0.2, None)}, population=20, generations=15,
                     out=tmp_path, quiet=True)  # fmt: skip
    assert front.failed > 0
    assert set(front.reasons) == {"EquilibriumLost"}
    assert np.all((front["x"] <= 1.5) & (front["sum"] >= 0.2))
    assert np.max(abs(front["y"])) < 0.1
    lines = [json.loads(line) for line in (tmp_path / "designs.0.jsonl").open()]
    lost = [line for line in lines if "failed" in line]
    assert len(lost) == front.failed
    assert lost[0]["failed"] == "EquilibriumLost: pull-in"
    assert lost[0]["design"]["x"] > 1.5


@needs_pymoo
@pytest.mark.parametrize("kind", [dea.Interrupted, dea.MachineError])
def test_what_is_no_fault_of_the_design_ends_the_search(kind):
    def ends(x, y):
        raise kind("stopped")

    with pytest.raises(kind):
        optimise(ends, BOX, BOTH, population=4, generations=1, quiet=True)


@needs_pymoo
def test_a_killed_search_goes_on_and_ends_the_same(tmp_path):
    calls = 0

    def dies(x, y):
        nonlocal calls
        calls += 1
        if calls == 33:
            raise KeyboardInterrupt
        return sphere(x, y)

    options = {"population": 8, "generations": 6, "quiet": True}
    dies.__qualname__ = sphere.__qualname__
    whole = optimise(sphere, BOX, BOTH, out=tmp_path / "whole", **options)
    with pytest.raises(KeyboardInterrupt):
        optimise(dies, BOX, BOTH, out=tmp_path / "cut", **options)
    with (tmp_path / "cut" / "designs.0.jsonl").open("a") as f:
        f.write('{"design": {"x": 0.')  # what a kill in the midst of a write leaves
    calls = 100
    again = optimise(dies, BOX, BOTH, out=tmp_path / "cut", resume=True, **options)
    assert calls - 100 == whole.evaluations - 32
    assert {n: v.tolist() for n, v in again.columns.items()} == {
        n: v.tolist() for n, v in whole.columns.items()
    }
    longer = optimise(dies, BOX, BOTH, out=tmp_path / "cut", resume=True, population=8,
                      generations=7, quiet=True)  # fmt: skip
    assert longer.evaluations == again.evaluations + 8
    with pytest.raises(dea.InputError, match="its variables are not these"):
        optimise(dies, BOX | {"y": (0.0, 1.0)}, BOTH, out=tmp_path / "cut", resume=True, **options)
    optimise(sphere, BOX, BOTH, out=tmp_path / "cut", population=4, generations=1, quiet=True)
    assert (tmp_path / "cut" / "previous" / "designs.0.jsonl").exists()


@needs_pymoo
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"objectives": {"near": "down"}}, 'must be "min" or "max"'),
        ({"objectives": {"height": "max"}}, "returns no quantity 'height'"),
        ({"constraints": {"sum": (2.0, 1.0)}}, "so nothing satisfies it"),
        ({"constraints": {"sum": (None, None)}}, "bounds nothing"),
        ({"constraints": {"sum": (10.0, None)}}, "None of the 40 designs satisfies sum >= 10"),
        ({"variables": {"x": 1.0, "y": 0.0}}, "All variables are fixed"),
        ({"variables": {"x": (1.6, 2.0), "y": 0.0}},
         "None of the 8 designs .* first failed with: EquilibriumLost: pull-in"),
        ({"resume": True}, "from a folder only"),
    ],
)  # fmt: skip
def test_bad_optimisation_is_refused_in_one_sentence(changes, words):
    settings = {"variables": BOX, "objectives": BOTH, "population": 8, "generations": 5} | changes
    with pytest.raises(dea.InputError, match=words):
        optimise(sphere, quiet=True, **settings)


@needs_pymoo
def test_other_errors_end_the_search():
    with pytest.raises(ZeroDivisionError):
        optimise(lambda x: {"f": 1 / 0}, {"x": (0.0, 1.0)}, {"f": "min"}, quiet=True)


SCRIPT = """
import os, signal, sys
import dea_fenicsx as dea
from dea_fenicsx.design import optimise
from dea_fenicsx.design.verify import ring_stroke

out, resume, lives = sys.argv[1], sys.argv[2] == "resume", int(sys.argv[3])
rubber = dea.Material(dea.NeoHookean(100e3), dea.IdealDielectric(5.0))

def layer(elastomer, voltage):
    global lives
    lives -= 1
    if lives == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    found = ring_stroke(2e-3, 1e-3, elastomer, material=rubber, voltage=voltage, base="bonded",
                        cells=(4, 1), steps=2)
    return {"voltage_V": voltage, **found}

front = optimise(layer, {"elastomer": (1e-4, 3e-4), "voltage": (500.0, 12000.0)},
                 {"voltage_V": "min", "stroke_m": "max"}, population=8, generations=3, seed=2,
                 out=out, resume=resume)
if front and __import__("mpi4py.MPI").MPI.COMM_WORLD.rank == 0:
    front.write(out + "/front.csv")
    print("failed:", front.failed, dict(front.reasons))
"""


@pytest.mark.slow
@needs_pymoo
@pytest.mark.mpi
def test_finite_elements_inside_killed_and_resumed_on_several_ranks(start, tmp_path, quick_compile):
    """The full size, 8 designs x 5 generations of the cell, was run by hand the same way."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    ranks = max(numbers_of_ranks())
    whole = start(script, tmp_path / "whole", "anew", 0, ranks=ranks, check=True)
    killed = start(script, tmp_path / "cut", "anew", 5, ranks=ranks)
    assert killed.returncode != 0
    known = sum(len(p.read_text().splitlines()) for p in (tmp_path / "cut").glob("*.jsonl"))
    assert 8 <= known < 24
    resumed = start(script, tmp_path / "cut", "resume", 0, ranks=ranks, check=True)
    assert f"{known} designs are known" in resumed.stdout
    assert "EquilibriumLost" in whole.stdout
    fronts = [(tmp_path / name / "front.csv").read_text() for name in ("whole", "cut")]
    assert fronts[0] == fronts[1]
    assert len(fronts[0].splitlines()) > 3


# ---------------------------------------------------------------------- finite elements beside


def test_finite_elements_beside_the_analytic_stroke(quick_compile):
    """Thin layers with ideal electrodes: within 5 %; stiffer electrodes take the stroke away."""
    from dea_fenicsx.design.verify import cell_stroke, helix_stroke, ring_stroke

    volts = 2000.0
    model = HelicalModel(RUBBER)
    analytic = model(**RING, eps_r=TABLE_4_2["eps_r"], voltage=volts)["displacement"]
    load = {"material": RUBBER, "voltage": volts}
    slides = ring_stroke(**RING, **load)["stroke_m"]
    assert slides == pytest.approx(analytic, rel=1e-7)
    helix = helix_stroke(**RING, **load, turns=3, steps=2)
    assert helix["stroke_m"] / helix["layers"] == pytest.approx(analytic, rel=0.05)
    cells = [
        cell_stroke(**RING, **load, electrode_mu=ratio * EFFECTIVE_MU, largest=1.2 * analytic)
        for ratio in (1, 10)
    ]
    soft, stiff = (c["stroke_m"] / analytic for c in cells)
    assert 0.95 < soft < 1
    assert stiff < 0.4
    bonded = ring_stroke(**RING, **load, base="bonded")["stroke_m"]
    assert bonded < 0.3 * analytic


# ------------------------------------------------------------------------------- sensitivities


def test_sensitivities_of_power_laws(tmp_path):
    found = sensitivities(lambda x, y: {"f": x**2 / y, "g": 5 * x}, {"x": 3.0, "y": 0.2},
                          ("f", "g"))  # fmt: skip
    assert found.table["f"] == pytest.approx({"x": 2, "y": -1}, rel=1e-9)
    assert found.table["g"] == pytest.approx({"x": 1, "y": 0}, abs=1e-9)
    with found.write(tmp_path / "s.csv").open() as f:
        assert next(csv.reader(f)) == ["quantity", "x", "y"]
    pytest.importorskip("matplotlib")
    assert draw_sensitivities(found, tmp_path / "s.png").stat().st_size > 5_000
    with pytest.raises(dea.InputError, match="no quantity 'h'"):
        sensitivities(lambda x: {"f": x}, {"x": 1.0}, ("h",))
    with pytest.raises(dea.InputError, match="needs a number > 0"):
        sensitivities(lambda x: {"f": -x}, {"x": 1.0}, ("f",))


def test_three_of_five_variables_move_neither_voltage_nor_strain():
    """Radii do not enter (and so not the pitch angle); V = T (1 - k) sqrt(p/eps)."""
    found = sensitivities(HelicalModel(RUBBER), TABLE_4_2, ("voltage", "strain"))
    volts = found.table["voltage"]
    assert volts["outer_radius"] == volts["inner_radius"] == 0
    assert volts["elastomer"] == pytest.approx(1, rel=1e-9)
    assert volts["eps_r"] == pytest.approx(-0.5, rel=1e-9)
