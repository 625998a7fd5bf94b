"""A run as one HTML file: the device to turn with the mouse, its steps, curves and settings."""

from __future__ import annotations

import argparse
from pathlib import Path

from dea_fenicsx.support.files import LONGEST_PATH, clean

HELP = "a run as one HTML file for the browser"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("results", type=Path, metavar="RESULTS", help="results folder")
    parser.add_argument("--field", metavar="NAME", action="append",
                        help="field to choose from, may be given several times (default: electric "
                        "field, displacement, stress, J and potential)")
    parser.add_argument("--out", type=Path, metavar="FILE",
                        help="the HTML file (default: report.html in the folder)")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx.pictures.report import report

    print(clean(report(options.results, options.out, options.field), LONGEST_PATH))
    return 0
