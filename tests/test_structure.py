"""The shape of the package: imports go one way through the rooms, and files stay short."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "dea_fenicsx"

ROOMS = [
    "support", "geometry", "mesh", "materials", "exact", "origami",
    "scene", "model", "solvers", "path", "measure", "results", "run", "pictures",
    "design", "thesis", "docs", "cli", "__main__",
]  # fmt: skip
"""Each room may import from the rooms before it.  Within a room no imports go in a circle."""

MOST_LINES = 500
MOST_FUNCTION_LINES = 60
MOST_METHODS = 15


def sources(root: Path = PACKAGE) -> Iterator[Path]:
    """All Python files of a package, those behind its links included, but for its front door."""
    for folder, _, files in os.walk(root, followlinks=True):
        for name in files:
            if name.endswith(".py") and Path(folder, name) != root / "__init__.py":
                yield Path(folder, name)


def module_of(file: Path, root: Path = PACKAGE) -> str:
    """Dotted name of a file's module, without the package's own."""
    parts = file.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(file: Path, root: Path = PACKAGE) -> set[str]:
    """Modules of this package that a file imports anywhere in it, relative imports included."""
    module = module_of(file, root).split(".")
    package = module if file.name == "__init__.py" else module[:-1]
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package[: len(package) - node.level + 1]
                base = ".".join(["dea_fenicsx", *above, *([base] if base else [])])
            # what is imported may be a module itself
            found |= {base} | {f"{base}.{a.name}" for a in node.names}
    known = {module_of(f, root) for f in sources(root)}
    prefix = "dea_fenicsx."
    inside = {name.removeprefix(prefix) for name in found if name.startswith(prefix)}
    return inside & known


def room_of(module: str) -> str:
    return module.split(".")[0]


def backwards(root: Path = PACKAGE) -> list[str]:
    """Imports from a later room."""
    return [
        f"{file.relative_to(root)} imports {name}"
        for file in sources(root)
        if room_of(module_of(file, root)) != "demos"
        for name in sorted(imports_of(file, root))
        if ROOMS.index(room_of(name)) > ROOMS.index(room_of(module_of(file, root)))
    ]


def circle(root: Path = PACKAGE) -> list[str]:
    """Modules that import one another in a circle; empty if there is none.

    A package's ``__init__`` is no step of a circle: Python runs it before any of its modules.
    """
    graph = {}
    for file in sources(root):
        if file.name != "__init__.py":
            graph[module_of(file, root)] = imports_of(file, root) - {module_of(file, root)}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_every_room_has_a_place():
    assert {room_of(module_of(f)) for f in sources()} <= {*ROOMS, "demos"}


def test_imports_go_one_way():
    assert not backwards()


def test_no_modules_import_one_another():
    assert not circle()


@pytest.mark.parametrize("line", [
    "from dea_fenicsx.run.session import solve",
    "import dea_fenicsx.run.session",
    "from dea_fenicsx.run import session",
    "from ..run.session import solve",
    "from ..run import session",
])  # fmt: skip
def test_all_forms_of_an_import_are_seen(tmp_path, line):
    """A package whose mesh imports its run is refused, though a link leads to the mesh."""
    (tmp_path / "apart").mkdir()
    (tmp_path / "apart" / "device.py").write_text(f"def f():\n    {line}\n")
    package = tmp_path / "package"
    (package / "run").mkdir(parents=True)
    (package / "run" / "session.py").write_text("")
    (package / "mesh").symlink_to(tmp_path / "apart")
    assert backwards(package)


def test_a_circle_is_seen(tmp_path):
    for name, other in (("a", "b"), ("b", "c"), ("c", "a")):
        (tmp_path / f"{name}.py").write_text(f"from . import {other}\n")
    assert set(circle(tmp_path)) == {"a", "b", "c"}


def test_every_room_says_what_lives_there():
    for room in ROOMS:
        front = PACKAGE / room / "__init__.py"
        if front.exists():
            assert ast.get_docstring(ast.parse(front.read_text("utf-8"))), room


def imported(file: Path) -> set[str]:
    """Top-level names of all packages that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {a.name.split(".")[0] for a in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").split(".")[0])
    return found


def test_geometry_and_pictures_need_no_solver():
    heavy = {"dolfinx", "ufl", "basix", "petsc4py"}
    for file in sources():
        if room_of(module_of(file)) in ("geometry", "pictures"):
            assert not heavy & imported(file), file


def test_what_a_user_writes_knows_nothing_of_petsc():
    for file in sources():
        if room_of(module_of(file)) in ("scene", "materials"):
            assert "PETSc" not in file.read_text("utf-8"), file


def test_dolfinx_is_imported_in_one_place():
    """With the wheel, any other first import of DOLFINx or PETSc finds no libraries."""
    for file in sources():
        if module_of(file) != "support.compat" and room_of(module_of(file)) != "thesis":
            assert not {"dolfinx", "petsc4py"} & imported(file), file


def test_no_file_is_too_long():
    files = [*sources(), *(ROOT / "tests").rglob("*.py")]
    assert not [f for f in files if len(f.read_text("utf-8").splitlines()) > MOST_LINES]
