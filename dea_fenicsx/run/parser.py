"""Command line of a script: the options that all demos share, and clean errors under MPI."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any, NoReturn

from dea_fenicsx.support import progress
from dea_fenicsx.support.errors import InputError, install_hook


class Parser(argparse.ArgumentParser):
    """An argument parser for scripts that are started with mpirun.

    Adds ``--out DIR``, ``--quiet``, ``--verbose``, ``--debug`` and ``--resume``.  A wrong command
    line ends as an `InputError`: one sentence from rank 0, exit status 2.  From here on an uncaught
    error ends all ranks, see `errors.install_hook`.
    """

    def __init__(self, description: str, out: str) -> None:
        install_hook()
        super().__init__(
            description=description, formatter_class=argparse.ArgumentDefaultsHelpFormatter
        )
        self.add_argument("--out", default=out, metavar="DIR", help="results folder")
        self.add_argument("--quiet", action="store_true", help="print nothing")
        self.add_argument("--verbose", action="store_true", help="print each Newton iteration")
        self.add_argument("--debug", action="store_true", help="show the traceback of an error")
        self.add_argument(
            "--resume", action="store_true", help="carry on from the last step in --out"
        )

    def number(self, flag: str, default: float, unit: str, what: str) -> None:
        """Add an option that takes a number; `unit` goes into its help ("-" for none)."""
        self.add_argument(flag, type=float, default=default, metavar=unit, help=what)

    def count(
        self, flag: str, default: int, what: str, choices: Iterable[int] | None = None
    ) -> None:
        """Add an option that takes a whole number, of some `choices` if they are given."""
        self.add_argument(flag, type=int, default=default, metavar="N", help=what, choices=choices)

    def parse_args(self, *arguments: Any, **options: Any) -> Any:
        found = super().parse_args(*arguments, **options)
        progress.verbose_by_default = found.verbose
        return found

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{self.prog}: {message}; see --help.")

    def settings(self, args: Any) -> dict[str, Any]:
        """The parsed options that may shape a result as a dictionary, for summary.json."""
        return {k: v for k, v in vars(args).items() if k not in ("quiet", "verbose", "debug")}
