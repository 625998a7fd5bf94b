"""Run the table of hard cases, each in a process of its own, and write hard_cases.csv.

    python tests/hard/run.py                 all cases, then the kills
    python tests/hard/run.py --only balloon  cases whose name holds a word
    python tests/hard/run.py --table         all cases, and their table in tests/hard/README.md

A case that hangs or crashes has that as its verdict, and the table goes on.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parents[1])]
LIMIT_S = 240
MARK = "verdict of the case: "


def load() -> dict:
    """All cases, by name."""
    parts = ("films", "devices", "runs", "marches", "cavities", "air", "repeating", "mechanisms",
             "contacts", "motions")  # fmt: skip
    for part in parts:
        import_module(f"hard.{part}")
    from hard.table import CASES

    return CASES


def alone(name: str) -> None:
    """Run one case in this process and print its verdict as the last line."""
    from hard.table import passed, verdict

    it = load()[name]
    start = time.perf_counter()
    ended, message = verdict(it)
    told = {"verdict": ended, "message": message, "passed": passed(it, ended, message),
            "seconds": time.perf_counter() - start}  # fmt: skip
    print(MARK + json.dumps(told), flush=True)


def in_a_process(name: str) -> dict:
    """Run one case in a new process."""
    start = time.perf_counter()
    environment = {"DEA_FENICSX_CFLAGS": "-O1 -g0"} | os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, __file__, "--alone", name], stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, stdin=subprocess.DEVNULL, env=environment,
    )  # fmt: skip
    try:
        output, _ = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"verdict": f"no end within {LIMIT_S} s", "message": "", "passed": False,
                "seconds": time.perf_counter() - start}  # fmt: skip
    lines = [line for line in output.splitlines() if line.startswith(MARK)]
    if process.returncode == 0 and lines:
        return json.loads(lines[-1].removeprefix(MARK))
    last = output.strip().splitlines()[-1:] or [""]
    return {"verdict": f"crashed with status {process.returncode}", "message": last[0],
            "passed": False, "seconds": time.perf_counter() - start}  # fmt: skip


def table(rows: list[dict]) -> str:
    """The cases as a Markdown table."""
    lines = ["| case | expected | verdict | measured, or the sentence |", "|---|---|---|---|"]
    for row in rows:
        message = row["message"].replace("|", "/")
        message = re.sub(re.escape(tempfile.gettempdir()) + r"/\w+", "FOLDER", message)
        lines.append(f"| {row['case']} | {row['expected']} | {row['verdict']} | {message} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help="only cases whose name holds this")
    parser.add_argument("--out", default="hard_cases.csv", help="the table as CSV")
    parser.add_argument("--table", action="store_true", help="write the table to README.md too")
    parser.add_argument("--no-kills", action="store_true", help="leave out the random kills")
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.alone:
        alone(args.alone)
        return 0
    rows: list[dict] = []
    start = time.perf_counter()
    for name, it in load().items():
        if args.only not in name:
            continue
        found = in_a_process(name)
        expected = it.expected + (f": {it.words}" if it.words else "")
        rows.append({"case": name, "expected": expected, **found})
        sign = "  " if found["passed"] else "X "
        print(f"{sign}{name}: {found['verdict']} ({found['seconds']:.1f} s)  "
              f"{found['message'][:90]}", flush=True)  # fmt: skip
    if args.only in "random kill" and not args.no_kills:
        from hard.kills import as_cases

        for row in (*as_cases(), *as_cases(10, "march")):
            rows.append(row)
            print(f"{'  ' if row['passed'] else 'X '}{row['case']}: {row['verdict']} "
                  f"({row['seconds']:.1f} s)  {row['message'][:90]}", flush=True)  # fmt: skip
    columns = ["case", "expected", "verdict", "seconds"]
    with open(args.out, "w", newline="") as f:
        writer = csv.DictWriter(f, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows({**row, "seconds": f"{row['seconds']:.2f}"} for row in rows)
    if args.table:
        text = (HERE / "README.md").read_text("utf-8").split("| case |")[0]
        (HERE / "README.md").write_text(text + table(rows), "utf-8")
    bad = [row["case"] for row in rows if not row["passed"]]
    print(f"{len(rows) - len(bad)} of {len(rows)} cases ended as they must, in "
          f"{time.perf_counter() - start:.0f} s; {args.out}")  # fmt: skip
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main())
