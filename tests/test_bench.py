"""The benchmark of fixed scenes (tests/bench, `make bench-compare` runs all of them)."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
COUNTS = ROOT / "tests" / "bench" / "counts.json"

CHEAPEST = ("generalised plane strain", "axisymmetric membrane")

ONE = {
    "unknowns": 561, "newton_iterations": 12, "krylov_iterations": 60, "factorisations": 4,
    "steps": 4, "status": "completed", "value": -6.08088123457e-3, "seconds": 0.1,
}  # fmt: skip
MADE_UP = {"versions": {"dolfinx": "0.11.0"}, "machine": "made up", "scenes": {
    "bender": ONE, "strip": ONE | {"unknowns": 27603, "value": 2.0},
}}  # fmt: skip


def started(*arguments, timeout=300):
    """Start one of the programs; returns the finished process with its output."""
    # Other flags of the compiler round differently, and so may change a count.
    changed = {k: v for k, v in os.environ.items() if k != "DEA_FENICSX_CFLAGS"}
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)], capture_output=True, text=True, cwd=ROOT,
        timeout=timeout, env=changed | {"OMP_NUM_THREADS": "1"},
    )  # fmt: skip


@pytest.fixture
def compared(tmp_path):
    """Compare a file of the given content (text, or what JSON can hold) with `MADE_UP`."""

    def call(new, *options, old=MADE_UP):
        for name, content in (("new.json", new), ("old.json", old)):
            text = content if isinstance(content, str) else json.dumps(content)
            (tmp_path / name).write_text(text)
        files = tmp_path / "new.json", tmp_path / "old.json"
        return started("tests.bench.compare", *files, *options)

    return call


def with_change(**changes):
    """`MADE_UP` with other entries of its strip."""
    changed = copy.deepcopy(MADE_UP)
    changed["scenes"]["strip"] |= changes
    return changed


def test_equal_counts_agree_whatever_the_seconds(compared):
    done = compared(with_change(seconds=50.0, value=2.0 * (1 + 5e-10)))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "500.00" in done.stdout and "All 2 scenes" in done.stdout


@pytest.mark.parametrize(
    "key", ["unknowns", "newton_iterations", "krylov_iterations", "factorisations", "steps"]
)
def test_a_changed_count_is_told(compared, key):
    before = MADE_UP["scenes"]["strip"][key]
    done = compared(with_change(**{key: before + 1}))
    assert done.returncode == 1
    assert f"strip: {key} is {before + 1}, committed is {before}." in done.stdout
    assert f"{before} -> {before + 1}" in done.stdout and "bender: " not in done.stdout


@pytest.mark.parametrize(
    "change, told",
    [({"value": 2.0 * (1 + 3e-9)}, "strip: value is 2.000000006, committed is 2."),
     ({"status": "completed, unstable"}, "strip: status is completed, unstable")],
)  # fmt: skip
def test_another_value_or_status_is_told(compared, change, told):
    done = compared(with_change(**change))
    assert done.returncode == 1 and told in done.stdout


def test_a_missing_and_a_new_scene_are_told(compared):
    fewer = copy.deepcopy(MADE_UP)
    fewer["scenes"]["box"] = fewer["scenes"].pop("strip")
    done = compared(fewer)
    assert done.returncode == 1
    assert "strip: the scene is missing." in done.stdout
    assert "box: the scene is not among the committed ones" in done.stdout


def test_another_version_of_dolfinx_is_a_hint_only(compared):
    changed = with_change(krylov_iterations=61)
    changed["versions"]["dolfinx"] = "0.9.0"
    done = compared(changed)
    assert done.returncode == 0
    assert "krylov_iterations is 61" in done.stdout and "only a hint" in done.stdout
    del changed["scenes"]["bender"]
    assert compared(changed).returncode == 1  # a lost scene is none of the version's


@pytest.mark.parametrize(
    "bad, told",
    [("{", "is not a JSON file"), ("", "is not a JSON file"), ("\udcff", "is not a JSON file"),
     ("[" * 100_000, "is not a JSON file"), ([], "it holds no object"),
     ({"scenes": {}}, 'it has no object "versions"'),
     ({"versions": {}, "scenes": {}}, "do not name that of dolfinx"),
     (with_change(steps=4.0), '"steps" of the scene "strip" is no whole number'),
     (with_change(steps=True), '"steps" of the scene "strip" is no whole number'),
     (with_change(value=float("nan")), '"value" of the scene "strip" is no finite number')],
    ids=range(10),
)  # fmt: skip
def test_a_bad_file_is_told_in_one_sentence(tmp_path, bad, told):
    new, old = tmp_path / "new.json", tmp_path / "old.json"
    text = bad if isinstance(bad, str) else json.dumps(bad)
    new.write_bytes(text.encode("utf-8", "surrogateescape"))
    old.write_text(json.dumps(MADE_UP))
    for pair in ((new, old), (old, new)):
        done = started("tests.bench.compare", *pair)
        assert done.returncode == 2 and not done.stdout
        assert told in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_missing_file_is_told_in_one_sentence(tmp_path):
    done = started("tests.bench.compare", tmp_path / "none.json", COUNTS)
    assert done.returncode == 2 and not done.stdout
    assert "cannot be read" in done.stderr and len(done.stderr.splitlines()) == 1


def test_update_writes_all_scenes_and_loses_none(compared, tmp_path):
    changed = with_change(steps=5)
    assert compared(changed, "--update").returncode == 0
    assert json.loads((tmp_path / "old.json").read_text()) == changed
    del changed["scenes"]["strip"]
    done = compared(changed, "--update")
    assert done.returncode == 1 and "Nothing was written" in done.stdout
    assert json.loads((tmp_path / "old.json").read_text()) == MADE_UP


def test_the_committed_counts_are_of_the_fixed_scenes():
    from tests.bench.scenes import SCENES

    assert list(json.loads(COUNTS.read_text())["scenes"]) == list(SCENES)
    assert len(SCENES) == 10


@pytest.mark.slow
def test_the_cheapest_scenes_have_the_committed_counts(tmp_path):
    import dolfinx

    committed = json.loads(COUNTS.read_text())
    if committed["versions"]["dolfinx"] != dolfinx.__version__:
        pytest.skip("the committed counts are those of another version of DOLFINx")
    out = tmp_path / "build" / "bench.json"
    done = started("tests.bench.run", "--scenes", *CHEAPEST, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    committed["scenes"] = {name: committed["scenes"][name] for name in CHEAPEST}
    (tmp_path / "committed.json").write_text(json.dumps(committed))
    done = started("tests.bench.compare", out, tmp_path / "committed.json")
    assert done.returncode == 0, done.stdout + done.stderr
