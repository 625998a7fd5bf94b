"""CONTRIBUTING.md: its map is that of the house, and each diff applies and passes its test."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import ROOT, clean_environment
from test_structure import PACKAGE, ROOMS

PAGE = ROOT / "CONTRIBUTING.md"
MOST_LINES = 60
SHOWN = (
    "material", "fibre", "dielectric", "support", "load", "field", "observable", "device family",
)  # fmt: skip
"""Kinds of things whose addition is shown by a diff."""

ADDED = tuple(
    kind
    for kind in SHOWN
    if kind not in ("support", "load", "field") or (PACKAGE / "scene" / "declarations.py").exists()
)
"""Those that this package takes: some need the declarations of the scene."""


def diffs() -> dict[str, list[str]]:
    """The lines of each diff, by the heading above it."""
    found: dict[str, list[str]] = {}
    for section in re.split(r"^## ", PAGE.read_text("utf-8"), flags=re.M)[1:]:
        heading, _, text = section.partition("\n")
        for block in re.findall(r"^```diff\n(.*?)^```", text, re.M | re.S):
            assert heading not in found, f"{heading}: two diffs"
            found[heading] = block.splitlines()
    return found


def apply(lines: list[str], tree: Path) -> list[Path]:
    """Apply a unified diff to a tree; returns the files that it makes or changes.

    Neither git nor patch is needed.  Each hunk must fit exactly where it says.
    """
    touched: list[Path] = []
    text: list[str] = []
    shift = position = 0
    for line in lines:
        if line.startswith("--- "):
            continue
        if line.startswith("+++ "):
            touched.append(tree / line[4:].strip().removeprefix("b/"))
            text = touched[-1].read_text("utf-8").splitlines() if touched[-1].exists() else []
            shift = 0
        elif line.startswith("@@ "):
            begin, count = re.match(r"@@ -(\d+)(?:,(\d+))? ", line).groups()
            position = int(begin) - (count != "0") + shift
        elif line.startswith("+"):
            text.insert(position, line[1:])
            position, shift = position + 1, shift + 1
        elif line.startswith("-"):
            assert text.pop(position) == line[1:], line
            shift -= 1
        else:
            assert text[position] == line[1:], line
            position += 1
        if touched:
            touched[-1].write_text("\n".join(text) + "\n", "utf-8")
    return touched


def diff_of(kind: str) -> list[str]:
    """The lines of the diff that adds something of a kind."""
    return next(lines for heading, lines in diffs().items() if heading.endswith(f" {kind}"))


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the repository to which all diffs have been applied."""
    tree = tmp_path_factory.mktemp("tree")
    unneeded = shutil.ignore_patterns("__pycache__", "*.png", "*.msh")
    for name in ("dea_fenicsx", "geometry", "demos"):
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=unneeded)
    (tree / "tests").mkdir()
    for name in ("pyproject.toml", "tests/conftest.py"):
        shutil.copy(ROOT / name, tree / name)
    for kind in ADDED:
        lines = diff_of(kind)
        for file in {tree / line[6:] for line in lines if line.startswith("+++ b/")}:
            assert lines.count("--- /dev/null") and file.parent.is_dir(), file
        apply(lines, tree)
    return tree


def run(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python in the copied tree, whose package comes before the installed one."""
    environment = clean_environment()
    environment.pop("PYTEST_ADDOPTS", None)
    others = [p for p in environment["PYTHONPATH"].split(os.pathsep) if Path(p) != ROOT]
    environment["PYTHONPATH"] = os.pathsep.join([str(tree), *others])
    return subprocess.run(
        [sys.executable, "-B", *arguments], cwd=tree, env=environment, capture_output=True,
        text=True, timeout=300, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_all_kinds_are_shown():
    assert set(diffs()) == {f"Adding a{'n' * (k[0] in 'aeiou')} {k}" for k in SHOWN}


@pytest.mark.parametrize("kind", SHOWN)
def test_a_diff_is_short(kind):
    """One new file and its test, in at most 60 lines."""
    lines = diff_of(kind)
    assert len(lines) <= MOST_LINES
    made = [line.removeprefix("+++ b/") for line in lines if line.startswith("+++ ")]
    assert len(made) == 2 and made[1].startswith("tests/test_")
    assert not any((ROOT / name).exists() for name in made)


def test_what_is_added_passes_its_tests(tree):
    made = sorted((tree / "tests").glob("test_*.py"))
    assert len(made) == len(ADDED)
    done = run(tree, "-m", "pytest", "-p", "no:cacheprovider", "-rA", *map(str, made))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASSED") >= len(ADDED)


@pytest.mark.skipif(find_spec("ruff") is None, reason="ruff is not installed")
def test_what_is_added_is_clean(tree):
    made = [line[6:] for kind in ADDED for line in diff_of(kind) if line.startswith("+++ b/")]
    done = run(tree, "-m", "ruff", "check", "--no-cache", *made)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_diff_that_does_not_fit_is_refused(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("one\ntwo\nthree\nfour\n")
    head = ["--- a/a.txt", "+++ b/a.txt"]
    fits = ["@@ -1,2 +1,3 @@", " one", "+new", " two", "@@ -3,2 +4,1 @@", "-three", " four"]
    apply([*head, *fits], tmp_path)
    assert file.read_text() == "one\nnew\ntwo\nfour\n"
    with pytest.raises(AssertionError):
        apply([*head, "@@ -1,1 +1,1 @@", "-two"], tmp_path)


def first_line(room: str) -> str:
    """The first line of a room's docstring."""
    front = PACKAGE / room / "__init__.py"
    source = front if front.exists() else PACKAGE / f"{room}.py"
    return ast.get_docstring(ast.parse(source.read_text("utf-8"))).splitlines()[0]


def test_the_map_is_that_of_the_house():
    rest = PAGE.read_text("utf-8").partition("## The map of the house\n")[2]
    section = rest.partition("\n## ")[0]
    shown = re.findall(r"^- `(\w+)`: (.*)$", section, re.M)
    assert shown == [(room, first_line(room)) for room in ROOMS]


def test_commands_are_targets():
    """Each `make` that the page names is a target of the Makefile."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    named = set(re.findall(r"`make ([a-z-]+)`", PAGE.read_text("utf-8")))
    assert "quick" in named and named <= targets
