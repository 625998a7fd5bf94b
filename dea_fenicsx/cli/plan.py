"""Tell what a run will take before it is started: unknowns, preconditioner, memory and time."""

from __future__ import annotations

import argparse
import json
import runpy
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import dea_fenicsx
from dea_fenicsx.support.errors import InputError

HELP = "what a run will take: unknowns, memory, time"


def add(parser: argparse.ArgumentParser) -> None:
    _add_own(parser)
    parser.add_argument("script", type=Path, metavar="SCRIPT",
                        help="your script, which is run up to its first dea.solve")  # fmt: skip
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...",
                        help="arguments of the script")  # fmt: skip


def _add_own(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ranks", type=int, default=argparse.SUPPRESS, metavar="N",
                        help="number of ranks on which it will run (default 1)")  # fmt: skip
    parser.add_argument("--json", action="store_true", default=argparse.SUPPRESS,
                        help="print the numbers as JSON")  # fmt: skip


class _Planned(BaseException):
    """Ends a script where it would begin to solve.  It is no Exception, so no script catches it."""

    def __init__(self, found: Any) -> None:
        super().__init__()
        self.found = found


def run(options: argparse.Namespace) -> int:
    # argparse gives all that stands behind the script to the script; options of this command may
    # stand there, too.
    own = argparse.ArgumentParser(prog="dea plan", add_help=False, allow_abbrev=False)
    _add_own(own)
    options, arguments = own.parse_known_args(options.arguments, options)
    found = planned(options.script, arguments, getattr(options, "ranks", 1))
    print(json.dumps(asdict(found), indent=1) if getattr(options, "json", False) else found)
    return 0


def planned(script: Path, arguments: list[str], ranks: int) -> Any:
    """The plan of the first solve of a script, which is run up to there.

    Raises
    ------
    InputError
        If there is no such script, or if it never calls `dea_fenicsx.solve`.
    """
    if not script.is_file():
        raise InputError(f"There is no script {script}; give the file that calls dea.solve.")
    from dea_fenicsx.run.planning import check_ranks  # it imports DOLFINx

    check_ranks(ranks)
    front, given = vars(dea_fenicsx), sys.argv
    before = front.get("solve")  # not there yet, unless something has set it: it is imported late

    def instead(scene: Any, path: Any, *others: Any, **keywords: Any) -> Any:
        stability = keywords.get("stability", "last")
        raise _Planned(dea_fenicsx.plan(scene, path, ranks, keywords.get("options"), stability))

    front["solve"] = instead
    sys.argv = [str(script), *arguments]
    try:
        runpy.run_path(str(script), run_name="__main__")
    except _Planned as end:
        return end.found
    except SystemExit as end:
        if end.code not in (None, 0):
            raise
    finally:
        sys.argv = given
        del front["solve"]
        if before is not None:
            front["solve"] = before
    raise InputError(f"{script} ended without a call of dea.solve, so there is nothing to plan.")
