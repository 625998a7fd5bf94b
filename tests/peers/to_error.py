"""What an error of 0.1 % costs here and in NGSolve, each with its best mesh and order.

    python -m tests.peers.to_error [--scenes NAME ...] [--limit SECONDS] [--out CSV]

Here: the package's own elements on a ladder of meshes.  NGSolve: orders 2, 3 and 4 on ladders of
their own, with a pressure that may jump between the regions, without which it converges slowly.
The exact answer is taken from the finest run of the highest order that ends in time; the finest run
here must agree with it to a fifth of the error asked, or the scene is said not to be settled.
Each run is in a process of its own, on one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

from dea_fenicsx.geometry import BoxStack
from tests.peers.apart import ask, tell, write
from tests.peers.scenes import Case, bilayer, layers
from tests.peers.scenes import helix as turns

ASKED = 1e-3

GRADED = 30.0
"""Largest over smallest cell along the strip: the field is singular at its ends."""

COLUMNS = ["scene", "code", "order", "mesh", "unknowns", "value", "wall_s", "error"]


def strip(mesh: tuple[int, ...]) -> Case:
    """20 x 5 x 1 mm, 6 kV in one step."""
    box = BoxStack(20e-3, 5e-3, layers(mesh[2]), mesh[:2], order=1, grading=(GRADED, 1.0))
    return bilayer(box, 6e3, 2, 1)


def bender(mesh: tuple[int, ...]) -> Case:
    """The same in plane strain, 8 kV in eight steps."""
    box = BoxStack(20e-3, None, layers(mesh[1]), mesh[0], order=1, grading=GRADED)
    return bilayer(box, 8e3, 1, 8)


def membrane(mesh: tuple[int, ...]) -> Case:
    """A disc, radius 20 mm, held along its axis."""
    return replace(bender(mesh), axisymmetric=True)


def helix(mesh: tuple[int, ...]) -> Case:
    """One turn of 16 straight pieces, which all meshes share, 6 kV in four steps."""
    through = {"angular": 16, "radial": mesh[0], "rim": mesh[1], "through": mesh[2]}
    return replace(turns(1, through), steps=4)


FLAT = ((10, 1), (20, 1), (20, 2), (40, 2), (40, 4), (80, 4), (80, 8))
SCENES: dict[str, tuple[Callable[[tuple[int, ...]], Case], dict[str, tuple]]] = {
    "strip in one step": (
        strip,
        {
            "ours": ((10, 3, 1), (15, 4, 1), (20, 5, 1), (30, 8, 1), (30, 8, 2), (60, 16, 2)),
            "2": ((10, 3, 1), (15, 4, 1), (20, 5, 1), (30, 8, 1), (30, 8, 2)),
            "3": ((6, 2, 1), (8, 3, 1), (12, 4, 1), (20, 5, 1)),
            "4": ((4, 1, 1), (6, 2, 1), (8, 3, 1), (12, 4, 1), (20, 5, 1)),
        },
    ),
    "helix": (
        helix,
        {
            "ours": ((2, 1, 1), (3, 1, 1), (4, 1, 1), (6, 2, 1), (8, 2, 2), (12, 4, 2)),
            "2": ((2, 1, 1), (3, 1, 1), (4, 1, 1), (6, 2, 1), (8, 2, 2)),
            "3": ((1, 1, 1), (2, 1, 1), (3, 1, 1), (4, 1, 1)),
            "4": ((1, 1, 1), (2, 1, 1), (3, 1, 1)),
        },
    ),
    "plane-strain bender": (bender, {"ours": FLAT, "2": FLAT, "3": FLAT, "4": ((5, 1), *FLAT)}),
    "axisymmetric membrane": (membrane, {"ours": FLAT, "2": FLAT, "3": FLAT, "4": ((5, 1), *FLAT)}),
}
"""Builder of a scene's cases, and the meshes for each choice, coarse to fine."""


def child(scene: str, choice: str, mesh: tuple[int, ...]) -> None:
    """Solve one case and print what it took."""

    def solve(case: Case) -> dict:
        if choice == "ours":
            from tests.peers import ours

            return ours.solve(case, own_elements=True)
        from tests.peers import ngsolve_peer

        return ngsolve_peer.solve(case, int(choice), jumps=True)

    tell(solve, SCENES[scene][0](mesh))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--limit", type=float, default=300.0, help="seconds a run may take")
    parser.add_argument("--out", default="to_error.csv")
    parser.add_argument("--child", nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        scene, choice, *mesh = args.child
        child(scene, choice, tuple(map(int, mesh)))
        return
    rows: list[dict] = []
    for scene in args.scenes:
        rows += of_scene(scene, args.limit)
    write(args.out, COLUMNS, rows)


def of_scene(scene: str, limit: float) -> list[dict]:
    """Run all choices of a scene, and print them with what the error asked costs."""
    rows: list[dict] = []
    for choice, meshes in SCENES[scene][1].items():
        for mesh in meshes:
            found = ask("tests.peers.to_error", scene, choice, *mesh, limit=limit)
            code = "ours" if choice == "ours" else "ngsolve"
            row = {"scene": scene, "code": code, "order": 2 if code == "ours" else int(choice),
                   "mesh": "x".join(map(str, mesh))}  # fmt: skip
            if found is None:
                print(f"{scene}: {code}, order {row['order']}, {row['mesh']}: too long")
                break
            row |= {key: found[key] for key in ("unknowns", "value", "wall_s")}
            rows.append(row)
            print(f"{scene:22} {code:8} order {row['order']} {row['mesh']:8} "
                  f"{row['unknowns']:7d} unknowns {row['value']:.8e} m {row['wall_s']:7.2f} s",
                  flush=True)  # fmt: skip
    highest = max(row["order"] for row in rows)
    exact = next(row["value"] for row in reversed(rows) if row["order"] == highest)
    print("errors:")
    for row in rows:
        row["error"] = abs(row["value"] / exact - 1)
        print(f"{scene:22} {row['code']:8} order {row['order']} {row['mesh']:8} "
              f"{row['error']:.1e}", flush=True)  # fmt: skip
    ours = [row for row in rows if row["code"] == "ours"]
    if ours[-1]["error"] > ASKED / 5:
        print(f"{scene}: not settled, the two codes' finest runs differ by {ours[-1]['error']:.1e}")
    best = {code: min((row for row in rows if row["code"] == code and row["error"] < ASKED),
                      key=lambda row: row["wall_s"], default=None)
            for code in ("ours", "ngsolve")}  # fmt: skip
    if None not in best.values():
        a, b = best["ours"], best["ngsolve"]
        print(f"{scene}: to {ASKED:.1%}: here {a['wall_s']:.2f} s ({a['mesh']}), NGSolve "
              f"{b['wall_s']:.2f} s (order {b['order']}, {b['mesh']}), "
              f"x {b['wall_s'] / a['wall_s']:.2f}", flush=True)  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
