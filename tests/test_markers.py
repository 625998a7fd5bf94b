"""Markers are complete: what starts mpirun is marked `mpi`, what runs a demo is marked `demo`.

`make quick` leaves these out by their markers.  The source of all tests is read here, and nothing
of it is run.  A test reaches what its own code names: helpers of the same file, helpers that are
imported from other files of this folder, constants, and fixtures.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from conftest import AROUND, ROOT

TESTS = ROOT / "tests"
FILES = sorted(TESTS.glob("test_*.py"))
MARKS = ("mpi", "demo")


class Module(NamedTuple):
    """The functions and constants of a file, and what it imports from files of this folder."""

    definitions: dict[str, ast.AST]
    imported: dict[str, tuple[Path, str]]
    marks: set[str]


@cache
def read(file: Path) -> Module:
    definitions, imported, marks = {}, {}, set()
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            definitions[node.name] = node
        elif isinstance(node, ast.Assign):
            definitions |= {n.id: node.value for n in node.targets if isinstance(n, ast.Name)}
        elif isinstance(node, ast.ImportFrom):
            source = TESTS.joinpath(*(node.module or "").split(".")).with_suffix(".py")
            if source.exists():
                imported |= {a.asname or a.name: (source, a.name) for a in node.names}
    if "pytestmark" in definitions:
        marks = marks_in(definitions["pytestmark"])
    return Module(definitions, imported, marks)


def marks_in(tree: ast.AST) -> set[str]:
    """Names X of all ``pytest.mark.X`` in a piece of code."""
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "mark"
    }


def needs_of(tree: ast.AST) -> set[str]:
    """What a piece of code does by itself: start mpirun, run a demo."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr == "mpirun":
                found.add("mpi")
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "start":
            ranks = [k.value for k in node.keywords if k.arg == "ranks"]
            if any(getattr(r, "value", None) != 1 for r in ranks):
                found.add("mpi")
        elif isinstance(node, ast.BinOp):
            words = [n.value for n in ast.walk(node) if isinstance(n, ast.Constant)]
            if "demos" in words and any(str(w).endswith(".py") for w in words):
                found.add("demo")
    return found


def names_in(tree: ast.AST) -> set[str]:
    """Names that a piece of code uses, those of its arguments included: fixtures."""
    used = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
    return used | {n.arg for n in ast.walk(tree) if isinstance(n, ast.arg)}


def reached(file: Path, name: str) -> set[tuple[Path, str]]:
    """All functions and constants that a function uses, through others too, with itself."""
    found, waiting = set(), [(file, name)]
    while waiting:
        place, name = waiting.pop()
        module = read(place)
        if name in module.imported:
            place, name = module.imported[name]
        elif name not in module.definitions:
            place = TESTS / "conftest.py"  # where common fixtures are
        definition = read(place).definitions.get(name)
        # Without a number of ranks the fixture `start` starts no mpirun; its callers are asked.
        if definition is None or (place, name) in found or name == "start":
            continue
        found.add((place, name))
        waiting += [(place, other) for other in names_in(definition)]
    return found


def missing(file: Path) -> list[str]:
    """Tests of a file that lack a marker."""
    told = []
    for name, test in read(file).definitions.items():
        if not (name.startswith("test_") and isinstance(test, ast.FunctionDef)):
            continue
        pieces = [read(place).definitions[known] for place, known in reached(file, name)]
        needs = set().union(*map(needs_of, pieces))
        # A mark may also stand in one case of a parametrisation, or in a list of cases.
        marks = read(file).marks.union(*map(marks_in, pieces))
        told += [f"{file.name}::{name} lacks {mark}" for mark in sorted(needs - marks)]
    return told


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_markers_are_complete(file):
    assert not missing(file)


def test_files_around_the_solution_are_there():
    assert {f"test_{name}" for name in AROUND} <= {file.stem for file in FILES}


def test_what_lacks_a_marker_is_found(tmp_path):
    file = tmp_path / "test_x.py"
    file.write_text(
        "from conftest import ROOT, needed_mpirun\n"
        "import pytest\n"
        "CUBE = ROOT / 'demos' / 'cube.py'\n"
        "def helper():\n    return needed_mpirun()\n"
        "def test_a():\n    helper()\n"
        "def test_b(on_ranks):\n    on_ranks('m', 'f', 2)\n"
        "def test_c(start):\n    start(CUBE)\n"
        "def test_d(start):\n    start('x.py', ranks=3)\n"
        "def test_e(start):\n    start('x.py', ranks=1)\n"
        "@pytest.mark.mpi\n@pytest.mark.demo\ndef test_f(start):\n    start(CUBE, ranks=2)\n"
    )
    assert missing(file) == [
        "test_x.py::test_a lacks mpi", "test_x.py::test_b lacks mpi",
        "test_x.py::test_c lacks demo", "test_x.py::test_d lacks mpi",
    ]  # fmt: skip
