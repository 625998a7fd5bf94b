"""List the demos, or copy one out to edit."""

from __future__ import annotations

import argparse
import ast
import shutil
from importlib import resources
from pathlib import Path

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import did_you_mean

HELP = "the demos; copy one out to edit"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="the demo to copy; without it all are listed")
    parser.add_argument("--to", type=Path, default=Path(), metavar="DIR",
                        help="where to copy it (default: here)")  # fmt: skip


def folder() -> Path:
    """Where the demos are: demos/ of the repository, linked into the package and into its wheel."""
    return Path(str(resources.files("dea_fenicsx") / "demos"))


def available() -> dict[str, str]:
    """Name of each demo and the first line of its docstring."""
    found = {}
    for file in sorted(folder().glob("*.py")):
        words = ast.get_docstring(ast.parse(file.read_text("utf-8"))) or ""
        found[file.stem] = words.split("\n")[0]
    return found


def run(options: argparse.Namespace) -> int:
    known = available()
    if options.name is None:
        width = max(map(len, known), default=0)
        for name, words in known.items():
            print(f"{name:{width}}  {words}")
        print("\n`dea demos NAME` copies one here, to edit and to run.")
        return 0
    for path in copy(options.name, options.to):
        print(path)
    return 0


def copy(name: str, to: Path) -> list[Path]:
    """Copy a demo, and the folder NAME_data that it may read, into a folder.

    Raises
    ------
    InputError
        If there is no such demo, or a file of that name is already there.
    """
    known, name = available(), name.removesuffix(".py")
    if name not in known:
        hint = f"{did_you_mean(name, known)} ".lstrip()
        raise InputError(
            f"There is no demo named {name!r}; {hint}the demos are: {', '.join(known)}."
        )
    sources = [folder() / f"{name}.py", folder() / f"{name}_data"]
    pairs = [(s, to / s.name) for s in sources if s.exists()]
    for _, target in pairs:
        if target.exists():
            raise InputError(
                f"{target} is already there and is not overwritten; choose another folder with "
                "--to."
            )
    try:
        to.mkdir(parents=True, exist_ok=True)
        for source, target in pairs:
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copyfile(source, target)
    except OSError as error:
        raise InputError(
            f"The demo cannot be written into {to} ({error.strerror}); choose another folder with "
            "--to."
        ) from error
    return [target for _, target in pairs]
