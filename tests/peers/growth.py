"""How cost grows with the mesh, and iterations with the mesh and with the layers' thickness.

    python -m tests.peers.growth [--scenes NAME ...] [--most UNKNOWNS] [--out CSV]

Each run is in a process of its own, on one core, with the package's own elements and settings and
four voltage steps.  The exponents are those of the best fit of wall ~ unknowns^a over all meshes of
a scene.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from dea_fenicsx.geometry import BoxStack
from tests.peers.apart import ask, tell, write
from tests.peers.scenes import Case, bilayer, layers

COLUMNS = ["scene", "size", "unknowns", "value", "newton", "factorisations", "krylov",
           "krylov_per_newton", "assembly_s", "solve_s", "wall_s", "memory_GB"]  # fmt: skip


def strip(n: float) -> Case:
    """The bilayer strip, 20 x 5 x 1 mm, with cells of about the same shape on all meshes."""
    box = BoxStack(20e-3, 5e-3, layers(max(1, round(n))), (round(20 * n), round(5 * n)), order=1)
    return bilayer(box, 3e3, 2, 4)


def stack(n: float) -> Case:
    """Passive and active block of 10 x 10 x 5 mm each: as bulky as actuators get."""
    through = layers(round(2 * n), 5e-3)
    box = BoxStack(10e-3, 10e-3, through, (round(4 * n), round(4 * n)), order=1)
    return bilayer(box, 30e3, 2, 4)


def thin(ratio: float) -> Case:
    """A strip with layers `ratio` times thinner than wide, at one field, on one mesh."""
    thickness = 5e-3 / ratio
    # the curvature grows as the thickness falls: the same turn of the tip for all
    box = BoxStack(40 * thickness, 5e-3, layers(2, thickness), (40, 8), order=1)
    return bilayer(box, 6e6 * thickness, 2, 4)


SCENES: dict[str, tuple[Callable[[float], Case], tuple[float, ...]]] = {
    "strip": (strip, (1.4, 2, 3, 4, 5, 5.4)),
    "stack": (stack, (1.5, 2, 3, 4, 5, 6, 7.8)),
    "thin": (thin, (10, 30, 100, 300, 1000)),
}
"""Builder of a scene's cases and its sizes."""


def child(name: str, size: float) -> None:
    """Solve one case and print what it took."""
    from tests.peers import ours

    tell(lambda case: ours.solve(case, own_elements=True), SCENES[name][0](size))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--most", type=float, default=1.1e6, help="unknowns of the largest run")
    parser.add_argument("--out", default="growth.csv")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(args.child[0], float(args.child[1]))
        return
    rows: list[dict] = []
    for name in args.scenes:
        of_scene: list[dict] = []
        for size in SCENES[name][1]:
            if of_scene and _next_unknowns(of_scene, name, size) > args.most:
                break
            found = ask("tests.peers.growth", name, size)
            assert found  # without a limit there is an answer
            found |= {"scene": name, "size": size}
            found["krylov_per_newton"] = found["krylov"] / found["newton"]
            of_scene.append({key: found[key] for key in COLUMNS})
            print(f"{name:6} {size:7g} {found['unknowns']:8d} unknowns  "
                  f"Newton {found['newton']:3d}  "
                  f"Krylov per Newton {found['krylov_per_newton']:5.1f}  "
                  f"factors {found['factorisations']:2d}  {found['wall_s']:7.1f} s  "
                  f"{found['memory_GB']:6.2f} GB  {found['value']:.8e} m", flush=True)  # fmt: skip
        if name != "thin" and len(of_scene) > 1:
            n = np.log([row["unknowns"] for row in of_scene])
            powers = [np.polyfit(n, np.log([row[key] for row in of_scene]), 1)[0]
                      for key in ("wall_s", "memory_GB")]  # fmt: skip
            print(f"{name}: wall ~ unknowns^{powers[0]:.2f}, memory ~ unknowns^{powers[1]:.2f}")
        rows += of_scene
    write(args.out, COLUMNS, rows)


def _next_unknowns(before: list[dict], name: str, size: float) -> float:
    """About how many unknowns a scene has at a size, from the run before."""
    if name == "thin":
        return 0.0
    return before[-1]["unknowns"] * (size / before[-1]["size"]) ** 3


if __name__ == "__main__":
    main()
