"""Time the scenes here, in NGSolve or FElupe and as a plain FEniCSx script, on one core.

    python -m tests.peers.run [--quick] [--cases NAME ...] [--codes NAME ...] [--limit SECONDS]
                              [--out CSV]

Each runs in processes of its own, one after another.  wall_s is that of the whole solve, with the
mesh, once forms have been compiled and loaded.  process_s is that of a second process, from its
start to its end: imports, forms from the cache, and the solve.  --quick leaves out the scenes that
take a peer minutes.
"""

from __future__ import annotations

import argparse

from tests.peers.apart import ask, tell, write

COLUMNS = ["scene", "code", "unknowns", "value", "newton", "factorisations", "krylov",
           "assembly_s", "solve_s", "wall_s", "process_s", "memory_GB", "ratio_to_ours",
           "process_ratio"]  # fmt: skip
CODES = ("ours", "ours, own elements", "ngsolve", "felupe", "plain")
BY_PEERS = ("ngsolve", "felupe", "plain")
QUICK = ("strip in one step", "plane-strain bender", "pressed block", "axisymmetric membrane")
"""Scenes of a table that takes less than ten minutes."""


def child(case: str, code: str, whole: bool = False) -> None:
    """Solve one case by one code and print what it took.

    With `whole`, nothing runs before it: the time of the process is what is asked for.
    """
    from tests.peers.scenes import CASES

    if code == "ngsolve":
        from tests.peers.ngsolve_peer import solve
    elif code == "felupe":
        from tests.peers.felupe_peer import solve
    elif code == "plain":
        from tests.peers.plain import solve
    else:
        from tests.peers import ours

        def solve(given):
            return ours.solve(given, own_elements="own" in code)

    tell(solve, CASES[case], whole=whole)


def main() -> None:
    from tests.peers.scenes import CASES

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="only scenes that take seconds")
    parser.add_argument("--cases", nargs="*", default=None, choices=list(CASES))
    parser.add_argument("--codes", nargs="*", default=list(CODES), choices=CODES)
    parser.add_argument("--limit", type=float, default=900.0, help="seconds a run may take")
    parser.add_argument("--out", default="peers.csv")
    parser.add_argument("--child", nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(*args.child[:2], whole="whole" in args.child[2:])
        return
    rows = []
    for name in args.cases or (QUICK if args.quick else CASES):
        case, first = CASES[name], None
        for code in args.codes:
            if code in BY_PEERS and (case.alone or code not in case.peers):
                continue
            found = ask("tests.peers.run", name, code, limit=args.limit)
            whole = found and ask("tests.peers.run", name, code, "whole", limit=args.limit)
            if not found or not whole:
                print(f"{name:22} {code:20} more than {args.limit:g} s", flush=True)
                rows.append({"scene": name, "code": code})
                continue
            found["process_s"] = whole["process_s"]
            first = first or found
            found |= {
                "scene": name, "code": code, "ratio_to_ours": found["wall_s"] / first["wall_s"],
                "process_ratio": found["process_s"] / first["process_s"],
            }  # fmt: skip
            rows.append({key: found[key] for key in COLUMNS})
            print(f"{name:22} {code:20} {found['unknowns']:8d} unknowns  {found['value']:.9e} m  "
                  f"Newton {found['newton']:3d}  factors {found['factorisations']:3d}  "
                  f"{found['wall_s']:7.2f} s  {found['memory_GB']:.2f} GB  "
                  f"x {found['ratio_to_ours']:.2f}; process {found['process_s']:.2f} s  "
                  f"x {found['process_ratio']:.2f}", flush=True)  # fmt: skip
    write(args.out, COLUMNS, rows)


if __name__ == "__main__":
    main()
