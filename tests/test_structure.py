"""The shape of the package: imports go one way, files stay short, demos are known."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "dea_fenicsx"

# Each room may import from the rooms before it, and within itself in the order given.
ORDER = [
    "errors", "agreement", "launch", "files", "stored", "lock", "declared", "units",
    "geometry", "foreign", "cad", "form_cache", "compat", "mesh", "cells",
    "materials", "kinematics", "conditions", "validation", "neighbours", "potentials",
    "electrode_checks", "scene",
    "exact", "origami",
    "forms", "loads", "components", "rigid", "freebody", "deadloads", "prescriptions",
    "constraints", "ties", "turning", "balance", "weakform", "orientation",
    "tangent", "factors", "corotation", "references", "solver",
    "stability", "events", "arclength", "tracing", "predictor", "evidence", "verdicts",
    "stepping", "volume",
    "checks", "charges", "observables", "overall", "rotation", "failures", "fields", "reading",
    "turns", "columns", "identity", "checkpoint", "provenance", "summary", "xdmf", "hdf5",
    "results", "resuming", "interruption", "progress", "arguments", "run",
    "ladder", "script",
    "pictures_curves", "pictures_ladder", "pictures_fields", "pictures_movie",
    "pictures_paraview", "pictures",
    "design", "thesis", "docs", "cli", "__main__",
]  # fmt: skip


def module_of(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(file: Path) -> set[str]:
    """Rooms of this package that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dea_fenicsx"):
            parts = (node.module or "").split(".")
            names = [parts[1]] if len(parts) > 1 else [alias.name for alias in node.names]
            found.update(names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                parts = alias.name.split(".")
                if parts[0] == "dea_fenicsx" and len(parts) > 1:
                    found.add(parts[1])
    return found


def sources() -> list[Path]:
    return [f for f in PACKAGE.rglob("*.py") if f != PACKAGE / "__init__.py"]


def test_every_room_has_a_place():
    assert {module_of(f) for f in sources()} <= set(ORDER)


def test_imports_go_one_way():
    backwards = [
        f"{file.relative_to(ROOT)} imports {name}"
        for file in sources()
        for name in imports_of(file)
        if name in ORDER and ORDER.index(name) > ORDER.index(module_of(file))
    ]
    assert not backwards


def test_import_order_is_really_checked(tmp_path):
    """The check sees both forms of import."""
    file = tmp_path / "x.py"
    file.write_text("from dea_fenicsx.run import solve\nimport dea_fenicsx.mesh\n")
    assert imports_of(file) == {"run", "mesh"}


def test_geometry_and_pictures_need_no_solver():
    heavy = {"dolfinx", "ufl", "basix", "petsc4py"}
    for file in [*(PACKAGE / "geometry").glob("*.py"), *PACKAGE.glob("pictures*.py")]:
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [a.name for a in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not heavy & {n.split(".")[0] for n in names}, file


def test_dolfinx_is_imported_in_one_place():
    """With the wheel, any other first import of DOLFINx or PETSc finds no libraries."""
    for file in sources():
        if module_of(file) in ("compat", "thesis"):
            continue
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not {"dolfinx", "petsc4py"} & {n.split(".")[0] for n in names}, file


def test_no_file_is_too_long():
    folders = (PACKAGE, ROOT / "demos", ROOT / "tests")
    files = [f for folder in folders for f in folder.rglob("*.py")]
    long = [str(f.relative_to(ROOT)) for f in files if len(f.read_text("utf-8").splitlines()) > 500]
    assert not long
