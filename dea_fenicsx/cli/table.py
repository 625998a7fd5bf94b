"""The numbers of J. Park's thesis (2019), one by one, beside this package's."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import did_you_mean

HELP = "the benchmark of Park (2019), number by number"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--system", metavar="NAME", help="the rows of one system only")
    parser.add_argument("--out", type=Path, metavar="DIR",
                        help="also write thesis.csv, thesis.md and the curves there")  # fmt: skip


def run(options: argparse.Namespace) -> int:
    from dea_fenicsx.thesis import __main__ as thesis
    from dea_fenicsx.thesis.table import COLUMNS, STATUSES, Row, collect

    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)  # before anything is computed
    if options.out is not None and options.system is None:
        return thesis.main(["--out", str(options.out)])
    rows: list[Row] = collect()
    systems = list(dict.fromkeys(row.system for row in rows))
    if options.system is not None:
        if options.system not in systems:
            hint = f"{did_you_mean(options.system, systems)} ".lstrip()
            raise InputError(
                f"The table has no system {options.system!r}; {hint}it has: {', '.join(systems)}."
            )
        rows = [row for row in rows if row.system == options.system]
    if options.out is not None:
        from dea_fenicsx.thesis.table import write_csv, write_markdown

        write_csv(rows, options.out / "thesis.csv")
        write_markdown(rows, options.out / "thesis.md")
    for system in dict.fromkeys(row.system for row in rows):
        print(f"\n{system}")
        for row in rows:
            if row.system != system:
                continue
            cells = dict(zip(COLUMNS, row.cells(), strict=True))
            unit = "" if row.unit in ("-", "") else f" {row.unit}"
            printed = f"{cells['printed']}{unit}" if cells["printed"] else "-"
            ours = f"{cells['ours']}{unit}" if cells["ours"] else "-"
            print(f"  {row.name}: thesis {printed}, here {ours}: {row.status}")
            if row.note and options.system is not None:
                print(textwrap.fill(row.note, 96, initial_indent=" " * 6,
                                    subsequent_indent=" " * 6))  # fmt: skip
    counts = {s: sum(row.status == s for row in rows) for s in STATUSES}
    print("\n" + ", ".join(f"{n} {s}" for s, n in counts.items() if n))
    if options.out is not None:
        print(f"written to {options.out}")
    return 0
