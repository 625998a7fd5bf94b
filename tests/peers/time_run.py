"""Time the scenes in time, here and as a plain FEniCSx script, one after another, on one core.

    python -m tests.peers.time_run [--cases NAME ...] [--limit SECONDS] [--out CSV]

Each runs in a process of its own; forms are compiled before.  The wall time is that of the whole
march, with the mesh.
"""

from __future__ import annotations

import argparse

from tests.peers.apart import ask, tell, write

COLUMNS = ["scene", "code", "unknowns", "field", "value", "steps", "newton", "factorisations",
           "assembly_s", "solve_s", "wall_s", "memory_GB", "ratio_to_ours", "end"]  # fmt: skip
CODES = ("ours", "plain")


def child(case: str, code: str) -> None:
    """Solve one case by one code and print what it took."""
    from tests.peers import ours_in_time, plain_in_time
    from tests.peers.time_scenes import CASES

    tell((ours_in_time if code == "ours" else plain_in_time).solve, CASES[case])


def main() -> None:
    from tests.peers.time_scenes import CASES

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--codes", nargs="*", default=list(CODES), choices=CODES)
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds a run may take")
    parser.add_argument("--out", default="peers_in_time.csv")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(*args.child)
        return
    rows, wall = [], {}
    for name in args.cases:
        for code in args.codes:
            found = ask("tests.peers.time_run", name, code, limit=args.limit)
            if found is None:
                print(f"{name:26} {code:6} more than {args.limit:g} s", flush=True)
                rows.append({"scene": name, "code": code})
                continue
            wall.setdefault(name, found["wall_s"])
            found |= {"scene": name, "code": code, "ratio_to_ours": found["wall_s"] / wall[name]}
            rows.append({key: found[key] for key in COLUMNS})
            print(f"{name:26} {code:6} {found['unknowns']:6d} unknowns  field {found['field']:.5f}"
                  f"  {found['value']:.6e} m  {found['steps']:4d} steps  Newton "
                  f"{found['newton']:5d}  {found['wall_s']:7.1f} s  x {found['ratio_to_ours']:.1f}"
                  f"  {found['end']}", flush=True)  # fmt: skip
    write(args.out, COLUMNS, rows)


if __name__ == "__main__":
    main()
