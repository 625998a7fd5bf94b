"""One name means one thing in the whole package: no two classes share one, no two constants do."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping

import pytest
from test_structure import PACKAGE, module_of, sources

import dea_fenicsx.exact
import dea_fenicsx.origami

BOTH_PUBLIC = {"Balloon"}
"""A family of devices and its exact solution, each in a room that users name."""

COMMANDS_AND_TABLES = ("cli", "thesis", "docs", "demos")
"""Each command has a HELP, and each system of the thesis its own numbers."""


def assigned(node: ast.stmt) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Targets and values of an assignment; a tuple's value stands for each of its targets."""
    if isinstance(node, ast.AnnAssign) and node.value is not None:
        yield node.target, node.value
    if isinstance(node, ast.Assign):
        for target in node.targets:
            ones = target.elts if isinstance(target, ast.Tuple) else [target]
            yield from ((one, node.value) for one in ones)


def definitions(texts: Mapping[str, str]) -> tuple[dict, dict]:
    """Modules that define each public class, and the value of each constant in each module."""
    classes, constants = defaultdict(set), defaultdict(dict)
    for module, text in texts.items():
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name].add(module)
            for target, value in assigned(node):
                name = getattr(target, "id", "")
                if name.isupper() and not name.startswith("_"):
                    constants[name][module] = ast.unparse(value)
    return classes, constants


def homonyms(texts: Mapping[str, str]) -> list[str]:
    """Names that mean several things, each with where."""
    classes, constants = definitions(texts)
    found = [f"{n}: {sorted(m)}" for n, m in classes.items() if len(m) > 1]
    found += [f"{n}: {v}" for n, v in constants.items() if len(set(v.values())) > 1]
    return sorted(line for line in found if line.split(":")[0] not in BOTH_PUBLIC)


def test_no_name_means_two_things():
    texts = {module_of(file): file.read_text() for file in sources()}
    own = {m: t for m, t in texts.items() if m.split(".")[0] not in COMMANDS_AND_TABLES}
    assert len(own) > 300 and (PACKAGE / "path").is_dir()
    assert homonyms(own) == []


def test_homonyms_are_seen():
    branch = "class Branch: pass"
    texts = {"a": f"SMALL = 1e-3\n{branch}", "b": f"SMALL: float = 1e-6\n{branch}"}
    assert [line.split(":")[0] for line in homonyms(texts)] == ["Branch", "SMALL"]
    assert homonyms({"a": "SMALL = 1e-3", "b": "SMALL = 1e-3"}) == []
    assert len(homonyms({"a": "SMALL, LARGE = 1, 2", "b": "SMALL = 1"})) == 1


@pytest.mark.parametrize(("room", "old", "new"), [
    (dea_fenicsx.exact, "State", "HomogeneousState"),
    (dea_fenicsx.exact, "ShapeChange", "RoundnessChange"),
    (dea_fenicsx.origami, "State", "StoreyState"),
])  # fmt: skip
def test_earlier_names_go_on_working_with_one_warning(room, old, new):
    with pytest.warns(DeprecationWarning, match=f"is called {new} now") as told:
        found = getattr(room, old)
    assert found is getattr(room, new) and len(told) == 1
    with pytest.raises(AttributeError, match="has no 'Nothing'"):
        room.Nothing  # noqa: B018
