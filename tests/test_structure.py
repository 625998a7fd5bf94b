"""The shape of the package: imports go one way through the rooms, and files stay short."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "dea_fenicsx"

ROOMS = [
    "support", "geometry", "mesh", "materials", "drives", "exact", "origami",
    "scene", "model", "solvers", "path", "measure", "gradients", "results", "run", "pictures",
    "studies", "calibration", "design", "thesis", "docs", "cli", "__main__",
]  # fmt: skip
"""Each room may import from the rooms before it.  Within a room no imports go in a circle."""

MOST_LINES = 400
"""Lines of a file of the package, its geometry or a demo."""

MOST_TEST_LINES = 500
"""Lines of a file of tests."""

MOST_FUNCTION_LINES = 60
"""Lines of a function without its docstring."""

MOST_PARAMETERS = 8
"""Parameters of a function without `self` or `cls`."""

MOST_METHODS = 15
"""Public methods of a class that are no properties."""

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


@cache
def known_modules(root: Path) -> frozenset[str]:
    """All modules below a folder.  A folder must not change after the first call."""
    return frozenset(module_of(file, root) for file in sources(root))


@cache
def imports_of(file: Path, root: Path = PACKAGE) -> frozenset[str]:
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
    prefix = "dea_fenicsx."
    inside = {name.removeprefix(prefix) for name in found if name.startswith(prefix)}
    return known_modules(root) & inside


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


def length_of(file: Path) -> int:
    return len(file.read_text("utf-8").splitlines())


def test_no_file_is_too_long():
    assert not [f for f in sources() if length_of(f) > MOST_LINES]
    assert not [f for f in (ROOT / "tests").rglob("*.py") if length_of(f) > MOST_TEST_LINES]


Function = ast.FunctionDef | ast.AsyncFunctionDef


def lines_of(function: Function) -> int:
    """Lines of a function with its signature, but without its decorators and its docstring."""
    assert function.end_lineno
    lines = function.end_lineno - function.lineno + 1
    if ast.get_docstring(function, clean=False) is not None:
        docstring = function.body[0]
        assert docstring.end_lineno
        lines -= docstring.end_lineno - docstring.lineno + 1
    return lines


def parameters_of(function: Function) -> int:
    """Number of a function's parameters, ``*values`` and ``**named`` one each, without `self`."""
    a = function.args
    names = [p.arg for p in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
    first_is_owner = names[:1] in (["self"], ["cls"])
    return len(names) - first_is_owner + (a.vararg is not None) + (a.kwarg is not None)


def is_property(function: Function) -> bool:
    """Whether one of its decorators makes a function a property, or a part of one."""
    names = (ast.unparse(decorator).split(".") for decorator in function.decorator_list)
    return any(
        name[-1] in ("property", "cached_property", "setter", "deleter") for name in names
    )


def methods_of(kind: ast.ClassDef) -> int:
    """Number of a class's own public methods that are no properties."""
    own = [node for node in kind.body if isinstance(node, Function)]
    return sum(not (f.name.startswith("_") or is_property(f)) for f in own)


def beyond_limits(root: Path = PACKAGE) -> set[str]:
    """Functions and classes of a package, with its links, that are beyond one of the limits."""
    found = set()
    for file in sources(root):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            where = f"{module_of(file, root)}: {getattr(node, 'name', '')} has"
            if isinstance(node, Function):
                if lines_of(node) > MOST_FUNCTION_LINES:
                    found.add(f"{where} {lines_of(node)} lines")
                if parameters_of(node) > MOST_PARAMETERS:
                    found.add(f"{where} {parameters_of(node)} parameters")
            elif isinstance(node, ast.ClassDef) and methods_of(node) > MOST_METHODS:
                found.add(f"{where} {methods_of(node)} public methods")
    return found


def test_functions_and_classes_are_small():
    """No function or class is beyond a limit."""
    assert beyond_limits() == set()


def test_what_is_too_large_is_seen_behind_a_link(tmp_path):
    (tmp_path / "apart").mkdir()
    many = "".join(f"    def m{k}(self): pass\n" for k in range(MOST_METHODS + 1))
    properties = "".join(f"    @property\n    def p{k}(self): pass\n" for k in range(9))
    docstring = '    """' + "\n" * 9 + '"""\n'
    body = "    pass\n" * (MOST_FUNCTION_LINES - 1)
    (tmp_path / "apart" / "large.py").write_text(
        f"class Many:\n{many}{properties}\n"
        "def wide(a, b, c, d, e, f, /, g, *h, i): pass\n"
        "class Right:\n    def wide(self, a, b, c, d, e, *f, g, **h): pass\n"
        f"def right():\n{docstring}{body}"
        f"async def long():\n{docstring}{body}    pass\n"
    )
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "room").symlink_to(tmp_path / "apart")
    assert beyond_limits(tmp_path / "package") == {
        "room.large: Many has 16 public methods",
        "room.large: wide has 9 parameters",
        "room.large: long has 61 lines",
    }
