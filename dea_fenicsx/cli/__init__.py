"""The command ``dea``: what a user wants besides running scripts.

    dea doctor            is this machine set up, and if not, how to mend it
    dea demos [NAME]      the demos; copy one out to edit
    dea mesh FILE         the names in a .msh, .geo or STEP file
    dea plan SCRIPT       what a run will take: unknowns, memory, time
    dea show RESULTS      curves and pictures of a run
    dea report RESULTS    a run as one HTML file
    dea export RESULTS    a run or a mesh in the files of others
    dea compare A B       two runs, column by column
    dea table             the benchmark of Park (2019), number by number
    dea materials [NAME]  the library of materials

One file a command, each with ``HELP``, ``add(parser)`` and ``run(options)``.  What is heavy to
import is imported when it is needed: ``dea show`` works without MPI and DOLFINx.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from dea_fenicsx import __version__
from dea_fenicsx.support.errors import DeaError, InputError, install_hook
from dea_fenicsx.support.files import clean

__all__ = ["main"]

COMMANDS = (
    "doctor", "demos", "mesh", "plan", "show", "report", "export", "compare", "table", "materials",
)  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """argparse, with one sentence for an unusable command line instead of the whole usage."""

    def error(self, message: str) -> NoReturn:
        text = " ".join(message.split())
        raise InputError(f"{self.prog}: {text}; see {self.prog} --help.")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="dea", description="Simulation of dielectric elastomer actuators.")
    parser.add_argument("--version", action="version", version=f"dea_fenicsx {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
    for name in COMMANDS:
        module = import_module(f"dea_fenicsx.cli.{name}")
        words = (module.__doc__ or "").split("\n")[0]
        sub = commands.add_parser(name, help=module.HELP, description=words)
        module.add(sub)
        sub.set_defaults(run=module.run)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``dea``.

    Parameters
    ----------
    arguments
        The command line after the program's name; by default that of the process.

    Returns
    -------
    int
        Exit status: 0 success, 1 a check or comparison failed, 2 bad input.
    """
    if arguments is None:
        install_hook()  # this process is the command
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given  # before or after the command
    try:
        parser = _parser()
        options = parser.parse_args([a for a in given if a != "--debug"])
        if options.command is None:
            parser.print_help()
            return 0
        return int(options.run(options))
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # the reader (head, less) has gone; nothing more is to be written at exit either
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except Exception as error:
        if debug:
            raise
        print(f"Error: {_sentence(error)}", file=sys.stderr, flush=True)
        if isinstance(error, OSError):
            return InputError.exit_status
        return getattr(error, "exit_status", 1)


def _sentence(error: Exception) -> str:
    """What went wrong, on one line."""
    text = clean(error, 2000)
    if isinstance(error, DeaError):
        return text
    if isinstance(error, OSError):
        where = f"{clean(error.filename, 1000)}: " if error.filename else ""
        return f"{where}{error.strerror or text}."
    return f"{type(error).__name__}: {text.rstrip('.')} (--debug shows where)."
