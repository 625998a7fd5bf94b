"""Time the scenes here, in NGSolve and as a plain FEniCSx script, one after another, on one core.

    python -m tests.peers.run [--cases NAME ...] [--codes NAME ...] [--limit SECONDS] [--out CSV]

Each runs in a process of its own; the wall time is that of the whole solve, with the mesh.
"""

from __future__ import annotations

import argparse

from tests.peers.apart import ask, tell, write

COLUMNS = ["scene", "code", "unknowns", "value", "newton", "factorisations", "krylov",
           "assembly_s", "solve_s", "wall_s", "memory_GB", "ratio_to_ours"]  # fmt: skip
CODES = ("ours", "ours, own elements", "ngsolve", "plain")
BY_PEERS = ("ngsolve", "plain")


def child(case: str, code: str) -> None:
    """Solve one case by one code and print what it took."""
    from tests.peers.scenes import CASES

    if code == "ngsolve":
        from tests.peers.ngsolve_peer import solve
    elif code == "plain":
        from tests.peers.plain import solve
    else:
        from tests.peers import ours

        def solve(given):
            return ours.solve(given, own_elements="own" in code)

    tell(solve, CASES[case])


def main() -> None:
    from tests.peers.scenes import CASES

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument("--codes", nargs="*", default=list(CODES), choices=CODES)
    parser.add_argument("--limit", type=float, default=900.0, help="seconds a run may take")
    parser.add_argument("--out", default="peers.csv")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(*args.child)
        return
    rows = []
    for name in args.cases:
        case, wall = CASES[name], None
        for code in args.codes:
            if code in BY_PEERS and case.alone:
                continue
            found = ask("tests.peers.run", name, code, limit=args.limit)
            if found is None:
                print(f"{name:22} {code:20} more than {args.limit:g} s", flush=True)
                rows.append({"scene": name, "code": code})
                continue
            wall = wall or found["wall_s"]
            found |= {"scene": name, "code": code, "ratio_to_ours": found["wall_s"] / wall}
            rows.append({key: found[key] for key in COLUMNS})
            print(f"{name:22} {code:20} {found['unknowns']:8d} unknowns  {found['value']:.9e} m  "
                  f"Newton {found['newton']:3d}  factors {found['factorisations']:3d}  "
                  f"{found['wall_s']:7.1f} s  {found['memory_GB']:.2f} GB  "
                  f"x {found['ratio_to_ours']:.2f}", flush=True)  # fmt: skip
    write(args.out, COLUMNS, rows)


if __name__ == "__main__":
    main()
