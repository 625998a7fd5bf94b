"""Compare the counts of a benchmark with those that are committed.

    python -m tests.bench.compare build/bench.json tests/bench/counts.json [--update]

Counts do not depend on the machine, so a change in them is a change of the code.  Seconds are shown
as a ratio, and never make the comparison fail.

Exit status: 0 if all agrees, 1 if a scene is missing or a count, status or value differs, 2 for a
file that cannot be compared.  Between two versions of DOLFINx, which may number a mesh differently,
only a missing scene fails.  ``--update`` writes the counts into the second file and ends with 0.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from tests.bench.files import COUNTS, BadFile, read, write

VALUE_TOLERANCE = 1e-9
"""Relative difference of values that is taken for rounding: Newton's method stops at 1e-10."""

SHORT = {"unknowns": "unknowns", "newton_iterations": "Newton", "krylov_iterations": "Krylov",
         "factorisations": "factors", "steps": "steps"}  # fmt: skip
"""Headings of the table."""


def missing(new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """A sentence for each scene that only one of two files holds."""
    here, there = new["scenes"], old["scenes"]
    added = "the scene is not among the committed ones; --update adds it."
    return [
        *(f"{name}: the scene is missing." for name in there if name not in here),
        *(f"{name}: {added}" for name in here if name not in there),
    ]


def differences(new: dict[str, Any], old: dict[str, Any]) -> list[str]:
    """A sentence for each count, status or value that differs, scene by scene."""
    found = []
    for name, before in old["scenes"].items():
        now = new["scenes"].get(name)
        if now is None:
            continue
        for key in (*COUNTS, "status"):
            if now[key] != before[key]:
                found.append(f"{name}: {key} is {now[key]}, committed is {before[key]}.")
        a, b = now["value"], before["value"]
        if abs(a - b) > VALUE_TOLERANCE * max(abs(a), abs(b)):
            found.append(f"{name}: value is {a:.12g}, committed is {b:.12g}.")
    return found


def table(new: dict[str, Any], old: dict[str, Any]) -> str:
    """Both files side by side; a count that changed is shown as "committed -> now"."""
    heads = ["scene", *SHORT.values(), "value", "seconds", "ratio"]
    rows = [heads]
    for name in dict.fromkeys([*old["scenes"], *new["scenes"]]):
        now, before = new["scenes"].get(name), old["scenes"].get(name)
        shown = now or before
        row = [name]
        for key in COUNTS:
            changed = now and before and now[key] != before[key]
            row.append(f"{before[key]} -> {now[key]}" if changed else str(shown[key]))
        row += [f"{shown['value']:.12g}", f"{shown['seconds']:.2f}"]
        if now and before:
            row.append(f"{now['seconds'] / before['seconds']:.2f}" if before["seconds"] else "-")
        else:
            row.append("new" if now else "missing")
        rows.append(row)
    widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
    lines = []
    for row in rows:
        first, *others = (x.rjust(n) for x, n in zip(row, widths, strict=True))
        lines.append("  ".join([first.strip().ljust(widths[0]), *others]))
    return "\n".join(lines)


def compare(new: dict[str, Any], old: dict[str, Any]) -> int:
    """Print the table and what differs; returns the exit status."""
    print(table(new, old))
    print(f"Seconds: their ratio is to those of {old.get('machine', 'an unknown machine')}.")
    gone, changed = missing(new, old), differences(new, old)
    print(*gone, *changed, sep="\n", end="\n" if gone or changed else "")
    here, there = (found["versions"]["dolfinx"] for found in (new, old))
    if here != there:
        print(f"The committed counts are those of DOLFINx {there}, these are of {here}, which may "
              "number a mesh differently, so a difference is only a hint.")  # fmt: skip
        changed = []
    elif not gone and not changed:
        print(f"All {len(old['scenes'])} scenes have the committed counts and values.")
    return 1 if gone or changed else 0


def _may_replace(new: dict[str, Any], old: dict[str, Any]) -> bool:
    """Print what changes; False if a committed scene would be lost."""
    compare(new, old)
    lost = [name for name in old["scenes"] if name not in new["scenes"]]
    if lost:
        print("Nothing was written, since committed scenes are missing; run all scenes first, or "
              "delete the committed file to leave some out on purpose.")  # fmt: skip
    return not lost


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("new", help="the JSON file that tests.bench.run wrote")
    parser.add_argument("committed", help="the JSON file of the committed counts")
    parser.add_argument("--update", action="store_true", help="write the counts into COMMITTED")
    args = parser.parse_args(arguments)
    try:
        new = read(args.new)
        if not args.update:
            return compare(new, read(args.committed))
        if Path(args.committed).exists() and not _may_replace(new, read(args.committed)):
            return 1
        write(args.committed, new)
    except BadFile as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{args.committed} holds the counts of {len(new['scenes'])} scenes now.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
