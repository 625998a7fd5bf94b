"""Time the scenes in time, here and as a plain FEniCSx script, one after another.

    python -m tests.peers.time_run [--cases NAME ...] [--steps N] [--limit SECONDS] [--out CSV]

Each runs in processes of its own, on one rank but for the scenes that say otherwise; forms are
compiled before.  The times are those of the whole march, with the mesh.  cpu_s is that of the rank
with most; a busy machine changes it least, so that ratio_to_ours is made of it.  A motion that is
long is timed on its first steps, and its times are multiplied; the note says so.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import numpy as np

from tests.peers.apart import ask, tell, write

COLUMNS = ["scene", "code", "ranks", "unknowns", "field", "value", "apart", "steps", "newton",
           "factorisations", "assembly_s", "solve_s", "cpu_s", "wall_s", "memory_GB",
           "ratio_to_ours", "end", "note"]  # fmt: skip
CODES = ("ours", "plain")
TIMES = ("cpu_s", "wall_s")


def cases() -> dict[str, Any]:
    """All scenes by name."""
    from tests.peers import motion_scenes, time_scenes

    return time_scenes.CASES | motion_scenes.CASES


def child(name: str, code: str, steps: int, budget_s: float) -> None:
    """Solve one case by one code and print what it took."""
    case = cases()[name]
    if not hasattr(case, "shortened"):
        from tests.peers import ours_in_time, plain_in_time

        plain = partial(plain_in_time.solve, budget_s=budget_s)
        tell(ours_in_time.solve if code == "ours" else plain, case)
        return
    from tests.peers import ours_in_motion, plain_in_motion

    if steps:
        case = case.shortened(steps)
    tell((ours_in_motion if code == "ours" else plain_in_motion).solve, case)


def extrapolated(found: dict[str, Any], steps: int) -> None:
    """Take the times of the first steps of a motion for those of all, and say so."""
    taken = len(found["history"]) - 1
    found |= {"steps": taken, "value": found["history"][-1]}
    if taken < steps:
        found |= {name: found[name] * steps / taken for name in TIMES}
        found["note"] = f"the first {taken} of {steps} steps; times are multiplied by the ratio"


def apart(one: dict[str, Any], other: dict[str, Any]) -> float:
    """Largest difference of two histories as a share of the largest value, where both are."""
    until = min(one["time"][-1], other["time"][-1]) * (1 + 1e-9)
    times = [t for t in other["time"] if t <= until]
    known = np.interp(times, other["time"], other["history"])
    off = np.interp(times, one["time"], one["history"]) - known
    return float(np.abs(off).max() / np.abs(known).max())


def parsed(names: list[str]) -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", nargs="*", default=names, choices=names)
    parser.add_argument("--codes", nargs="*", default=list(CODES), choices=CODES)
    parser.add_argument("--steps", type=int, default=0, help="of a motion, the first alone")
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds a run may take")
    parser.add_argument("--budget", type=float, default=1e9,
                        help="CPU seconds after which a plain script in time ends")
    parser.add_argument("--out", default="peers_in_time.csv")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> None:
    known = cases()
    args = parsed(list(known))
    if args.child:
        name, code, steps, budget_s = args.child
        child(name, code, int(steps), float(budget_s))
        return
    rows, told = [], {}
    for name in args.cases:
        case = known[name]
        for code in [c for c in args.codes if c in getattr(case, "codes", CODES)]:
            steps = args.steps or (getattr(case, "plain_steps", 0) if code == "plain" else 0)
            ranks = getattr(case, "ranks", 1)
            found = ask(
                "tests.peers.time_run", name, code, steps, args.budget,
                limit=args.limit, ranks=ranks,
            )  # fmt: skip
            if found is None:
                print(f"{name:26} {code:6} more than {args.limit:g} s", flush=True)
                rows.append({"scene": name, "code": code})
                continue
            found |= {"scene": name, "code": code, "ranks": ranks}
            if "history" in found:
                extrapolated(found, case.steps)
            elif found["end"] == "the time allowed":
                shown = f"{found['cpu_s']:.0f} s of CPU up to there"
                found |= {time: found[time] * case.steps / found["steps"] for time in TIMES}
                found["note"] = f"{shown}; times are multiplied by {case.steps}/{found['steps']}"
            told[name, code] = found
            first = told.get((name, "ours"), found)
            found["ratio_to_ours"] = found["cpu_s"] / first["cpu_s"]
            against = told.get((getattr(case, "like", None) or name, "plain"))
            ours = told.get((name, "ours"))
            if "history" in found and against and ours:
                found["apart"] = apart(ours, against)
            rows.append({key: found[key] for key in COLUMNS if key in found})
            print(line_of(found), flush=True)
    write(args.out, COLUMNS, rows)


def line_of(found: dict[str, Any]) -> str:
    """What is printed of a run."""
    words = [
        f"{found['scene']:26} {found['code']:6} {found['unknowns']:6d} unknowns",
        f"field {found['field']:.5f}" if "field" in found else "",
        f"{found['value']:.6e} m  {found['steps']:4d} steps  Newton {found['newton']:5d}",
        f"{found['cpu_s']:7.1f} s of CPU, {found['wall_s']:7.1f} s",
        f"x {found['ratio_to_ours']:.1f}",
        f"histories apart by {100 * found['apart']:.2f} %" if "apart" in found else "",
        found.get("end", ""), found.get("note", ""),
    ]  # fmt: skip
    return "  ".join(word for word in words if word)


if __name__ == "__main__":
    main()
