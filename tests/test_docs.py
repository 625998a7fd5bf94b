"""Code blocks of README and pages run and print what stands below them; links lead somewhere."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import pytest
from conftest import ROOT

from dea_fenicsx import cli

DOCS = ROOT / "dea_fenicsx" / "docs"
SITE = ROOT / "docs"
PAGES = [
    ROOT / "README.md", *sorted(DOCS.glob("*.md")), ROOT / "demos" / "README.md",
    *sorted(SITE.rglob("*.md")),
]  # fmt: skip
IDS = [str(p.relative_to(ROOT)) for p in PAGES]
OTHERS = [
    ROOT / "CONTRIBUTING.md", ROOT / "docker" / "README.md", ROOT / "tests" / "hard" / "README.md",
]  # fmt: skip
SHOWN = ("bibtex",)  # languages of blocks that are only shown; {...} is a directive of the site
SLOW = ("doctor",)  # commands of dea that measure the machine; they have their own tests
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class Block(NamedTuple):
    language: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    found, start, language, lines = [], None, "", []
    for number, line in enumerate(page.read_text("utf-8").splitlines(), start=1):
        if start is None and line.startswith("```"):
            start, language, lines = number, line[3:].strip(), []
        elif start is not None and line.startswith("```"):
            found.append(Block(language, "\n".join(lines), start))
            start = None
        elif start is not None:
            lines.append(line)
    assert start is None, f"{page} has a block without end, from line {start}"
    return found


def same(found: str, expected: str) -> bool:
    """The same words, and the same numbers up to the last digit that is written."""
    if NUMBER.sub("#", found).split() != NUMBER.sub("#", expected).split():
        return False
    for a, b in zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True):
        digits = len(b.partition("e")[0].partition(".")[2])
        scale = float("1e" + (b.partition("e")[2] or "0"))
        if abs(float(a) - float(b)) > 1.5 * 10.0**-digits * scale:
            return False
    return True


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """Where all pages are worked through, one after another."""
    return tmp_path_factory.mktemp("docs")


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_blocks(page, place, monkeypatch, capsys):
    """Python blocks run in turn, in one namespace; `dea` is called; other commands must exist."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(place)
    module = ModuleType("__page__")  # dataclasses look for the module of their class
    monkeypatch.setitem(sys.modules, module.__name__, module)
    names = vars(module)
    printed = None
    for block in blocks(page):
        where = f"{page.name}, line {block.line}"
        if block.language == "python":
            for optional in re.findall(r"^import (pint)$", block.text, re.M):
                pytest.importorskip(optional)
            told = io.StringIO()
            code = compile("\n" * block.line + block.text, str(page), "exec")
            with redirect_stdout(told):
                exec(code, names)
            printed = told.getvalue()
        elif block.language == "text":
            if printed is not None:
                assert same(printed, block.text), f"{where}: printed\n{printed}"
            printed = None
        elif block.language == "sh":
            check_shell(block.text, where, capsys)
        elif not block.language.startswith("{") and block.language not in SHOWN:
            raise AssertionError(f"{where}: a block of the language {block.language!r}")


def check_shell(text: str, where: str, capsys) -> None:
    done = subprocess.run(["bash", "-n"], input=text, text=True, capture_output=True)
    assert done.returncode == 0, f"{where}: {done.stderr}"
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M)
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        while words and re.match(r"[A-Z_]+=", words[0]):
            words.pop(0)  # PATH=... and the like
        if words[:1] == ["dea"] and words[1] not in SLOW:
            status = cli.main(words[1:])
            told = capsys.readouterr()
            assert status == 0, f"{where}, {line}: {told.err}"
        elif words[:2] == ["python", "-m"]:
            subprocess.run([sys.executable, *words[1:]], check=True, capture_output=True)
        elif words[:1] == ["make"]:
            assert set(words[1:]) <= set(targets), f"{where}, {line}"
        for word in words:
            if word.endswith(".py") and "/" in word:
                assert (ROOT / word).is_file(), f"{where}: there is no {word}"


@pytest.mark.parametrize("page", [*PAGES, *OTHERS], ids=lambda p: str(p.relative_to(ROOT)))
def test_links(page):
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = target.partition("#")
        if "://" in target:
            continue
        goal = (page.parent / file).resolve() if file else page
        assert goal.exists(), f"{page.name} links to {target}"
        if anchor:
            heads = re.findall(r"^#+ (.*)$", goal.read_text("utf-8"), re.M)
            known = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in heads}
            assert anchor in known, f"{page.name} links to {target}"


def test_short_scripts_are_short():
    scripts = [b for b in blocks(DOCS / "scripts.md") if b.language == "python"]
    assert len(scripts) >= 5
    for script in scripts:
        lines = [line for line in script.text.splitlines() if line.strip()]
        assert len(lines) <= 20, f"line {script.line}: {len(lines)} lines"
        assert max(map(len, lines)) <= 100, f"line {script.line}"


def test_every_page_and_picture_is_reached():
    """From the README, over links."""
    seen: set[Path] = set()
    todo = [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        seen.add(page)
        if page.suffix != ".md":
            continue
        for target in re.findall(r"\]\(([^)\s#]+)", page.read_text("utf-8")):
            goal = (page.parent / target).resolve()
            if "://" not in target and goal.is_file() and goal not in seen:
                todo.append(goal)
    wanted = [*DOCS.glob("*.md"), *DOCS.glob("pictures/*"), *(ROOT / "demos").glob("*.py"),
              *SITE.rglob("*.md")]  # fmt: skip
    assert not [str(f.relative_to(ROOT)) for f in wanted if f not in seen]


def test_pictures_are_small():
    pictures = list((DOCS / "pictures").iterdir())
    assert pictures
    assert all(p.suffix == ".png" and p.stat().st_size < 150_000 for p in pictures)


def test_api_pages_hold_every_public_name(tmp_path):
    pytest.importorskip("pdoc")
    from importlib import import_module

    from dea_fenicsx.docs.api import ROOMS, write

    first = write(tmp_path)
    assert first.is_file()
    for room in ROOMS:
        name = f"dea_fenicsx{room}"
        html = (tmp_path / (name.replace(".", "/") + ".html")).read_text("utf-8")
        for public in import_module(name).__all__:
            assert f'id="{public}"' in html or f"{public}.html" in html, f"{name}.{public}"


def test_every_public_name_has_a_docstring():
    from importlib import import_module

    from dea_fenicsx.docs.api import ROOMS

    silent = []
    for room in ROOMS:
        module = import_module(f"dea_fenicsx{room}")
        for public in module.__all__:
            thing = getattr(module, public)
            # a dataclass without one gets its signature for a docstring
            text = getattr(thing, "__doc__", None) or ""
            if callable(thing) and (not text or text.startswith(f"{public}(")):
                silent.append(f"{module.__name__}.{public}")
    assert not silent


def test_numbers_are_compared():
    """The comparison of outputs can fail."""
    assert same("stretch 2.3001 at 8000 V\n", "stretch 2.3002 at 8000 V")
    assert not same("stretch 2.3001 at 8000 V", "stretch 2.3003 at 8000 V")
    assert not same("stretch 2.3 at 8000 V", "height 2.3 at 8000 V")
    assert not same("a 1", "a 1 2")
