"""Random traces past many bifurcations: none may go over to another branch unasked.

    python -m tests.fuzz.branches --count 200 --seed 1
    python -m tests.fuzz.branches --only sphere --trial 17     one trial again, step by step

Films under unequal dead loads, clamped strips, stacks and discs, and thick spheres; their sizes,
meshes and limits of steps are random.  Each keeps a symmetry, or has an exact state, that any other
branch breaks.  A coarse mesh has not quite the symmetry, so that the branch itself may turn aside:
this counts as told if the history has the event ``"turn aside"`` up to the first row that is
astray.  ``--at-turn pass`` asks the traces to go straight on there.  Exit status: the number of
traces that have left their branch without a word.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.geometry import BoxStack, HollowSphere, Layer
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, H = 5e4, 4.0, 1e-3
UNIT = H * math.sqrt(MU / (EPS_R * EPSILON_0))
"""Voltage in V that makes eps E^2 = mu in a film of the thickness H."""

RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))

SAME = 1e-4
"""Largest share by which values may differ that a symmetry of the mesh makes equal."""

ROUND = 1e-2
"""The same of a sphere, whose mesh is not quite round."""


@dataclass(frozen=True)
class Trial:
    """A random trace.

    Attributes
    ----------
    words
        What was drawn.
    scene, path, record
        As of `dea.solve`.
    astray
        How far a row of the history is from the symmetry, or from the exact state.
    limit
        Its largest value on the branch.
    """

    words: str
    scene: dea.Scene
    path: Any
    record: Mapping[str, dea.Observable]
    astray: Callable[[Mapping[str, Any]], float]
    limit: float = SAME


def _steps(rng: np.random.Generator) -> dict[str, Any]:
    """First and longest step of a trace."""
    return {
        "first": float(10 ** rng.uniform(-2, -0.5)),
        "longest": float(10 ** rng.uniform(-0.3, 1.0)),
    }


def _said(**drawn: Any) -> str:
    return "  ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in drawn.items()
    )


def film(rng: np.random.Generator) -> Trial:
    """A free film under two dead loads, in space: its states are homogeneous, and known exactly."""
    cells = tuple(int(n) for n in rng.integers(1, 4, 2))
    sx, sy = (float(s) for s in rng.uniform(0, 1.5, 2))
    if rng.random() < 0.3:
        sy = sx
    steps, far = _steps(rng), float(rng.uniform(1.5, 3.0))
    mesh = BoxStack(4 * H, 4 * H, [Layer("film", H)], divisions=cells)
    scene = dea.Scene(
        dea.read_gmsh(mesh), {"film": RUBBER},
        electrodes=[dea.Electrode("top", UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (sx * MU, 0, 0)), dea.DeadLoad("y_max", (0, sy * MU, 0))],
    )  # fmt: skip
    corners = {(0, 1): "near", (1, 0): "right", (1, 1): "far"}
    record = {
        f"{name}_{axis}": dea.AtPoint((4 * H * x, 4 * H * y, z * H), "displacement", axis)
        for (x, y), name in corners.items() for z in (0, 1) for axis in "xyz"
        if z or axis != "z"
    }  # fmt: skip

    def astray(row: Mapping[str, Any]) -> float:
        lx, ly = (1 + row[f"far_{axis}_m"] / (4 * H) for axis in "xy")
        lz = 1 + row["far_z_m"] / H
        maxwell = (row["voltage_V"] / UNIT / lz) ** 2
        sizes = row["load_factor"] * sx, row["load_factor"] * sy
        wrong = [
            abs(l * l - lz * lz - maxwell - l * s) / max(1.0, l * l)
            for l, s in zip((lx, ly), sizes, strict=True)
        ]
        wrong.append(abs(lx * ly * lz - 1))
        wrong.append(abs(row["right_x_m"] - row["far_x_m"]) / H)
        wrong.append(abs(row["near_y_m"] - row["far_y_m"]) / H)
        return max(wrong)

    path = [
        dea.Ramp("load", steps=4),
        dea.Trace("voltage", steps=400, until=("far_x_m", (far - 1) * 4 * H), **steps),
    ]
    words = _said(cells=cells, sx=sx, sy=sy, until=far, **steps)
    return Trial(words, scene, path, record, astray)


def _flat(rng: np.random.Generator, layers: int, disc: bool) -> Trial:
    """A clamped strip or disc of equal layers, flat up to several times its buckling voltage."""
    slender = float(10 ** rng.uniform(0.6, 1.5))
    cells = int(rng.integers(4, 17))
    divisions = int(rng.integers(1, 3))
    far, steps = float(rng.uniform(1.5, 5.0)), _steps(rng)
    length, height = slender * H, layers * H
    if disc:
        length /= 2
    mesh = BoxStack(length, None, [Layer("film", H, divisions)] * layers, divisions=cells)
    faces = ["bottom", *(f"interface_{k}" for k in range(1, layers)), "top"]
    critical = UNIT * math.sqrt(4 * math.pi**2 / 3) / (slender / layers)
    volts = min(critical, 0.6 * UNIT)
    held = [dea.Fix("x_min", "r")] if disc else [dea.Clamp("x_min")]
    scene = dea.Scene(
        dea.read_gmsh(mesh), {"film": RUBBER},
        electrodes=[
            dea.Electrode(face, volts) if k % 2 else dea.Ground(face)
            for k, face in enumerate(faces)
        ],
        supports=[*held, dea.Clamp("x_max")],
        kinematics=dea.Axisymmetric() if disc else dea.PlaneStrain(),
    )  # fmt: skip
    along, across = "rz" if disc else "xy"
    record = {
        f"{face}_{place}_{axis}": dea.AtPoint((share * length, y), "displacement", axis)
        for face, y in (("bottom", 0.0), ("top", height))
        for place, share in (("start", 0.0), ("quarter", 0.25), ("middle", 0.5))
        for axis in (along, across)
    }

    def astray(row: Mapping[str, Any]) -> float:
        wrong = [0.0]
        for place in ("start", "quarter", "middle"):
            low, high = (
                [row[f"{face}_{place}_{axis}_m"] for axis in (along, across)]
                for face in ("bottom", "top")
            )
            wrong += [abs(low[0] - high[0]), abs(low[1] + high[1])]
            if place == "middle" and not disc:
                wrong.append(abs(low[0]))
        return max(wrong) / H

    trace = dea.Trace("voltage", steps=400, until=("voltage_V", far * volts), **steps)
    words = _said(slender=slender, layers=layers, cells=cells, through=divisions, until=far,
                  **steps)  # fmt: skip
    return Trial(words, scene, trace, record, astray)


def strip(rng: np.random.Generator) -> Trial:
    """A strip between two clamps."""
    return _flat(rng, 1, disc=False)


def stack(rng: np.random.Generator) -> Trial:
    """A stack of layers between two clamps."""
    return _flat(rng, int(rng.integers(2, 4)), disc=False)


def disc(rng: np.random.Generator) -> Trial:
    """A round film that is clamped at its rim."""
    return _flat(rng, 1, disc=True)


def sphere(rng: np.random.Generator) -> Trial:
    """A thick sphere over the maximum of its voltage: its round states are known exactly."""
    part = "half" if rng.random() < 0.7 else "whole"
    outer, far = float(rng.uniform(1.1, 1.5)), float(rng.uniform(1.5, 4.0))
    layers, cells = int(rng.integers(1, 4)), int(rng.integers(5, 13))
    steps, chains = _steps(rng), bool(rng.random() < 0.3)
    wall = dea.Material(
        dea.Gent(MU, 50.0) if chains else dea.NeoHookean(MU), dea.IdealDielectric(EPS_R)
    )
    ball = exact.RoundBalloon(H, outer * H, wall)
    ends = {"upper": (0, H)} if part == "half" else {"upper": (0, H), "lower": (0, -H)}
    scene = dea.Scene(
        dea.read_gmsh(HollowSphere(H, outer * H, part, layers, cells)), {"wall": wall},
        electrodes=[dea.Electrode("inner", ball.limits(2 * H)[0].volts), dea.Ground("outer")],
        supports=[
            dea.Fix("axis", "r"),
            dea.Fix("equator", "z") if part == "half" else dea.FreeBody(),
        ],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    record = {name: dea.AtPoint(place, "displacement", "z") for name, place in ends.items()}
    record |= {f"equator_{axis}": dea.AtPoint((H, 0), "displacement", axis) for axis in "rz"}

    def astray(row: Mapping[str, Any]) -> float:
        a = 1 + row["equator_r_m"] / H
        heights = [abs(row[name] - row["equator_z_m"]) for name in (f"{e}_m" for e in ends)]
        wrong = [abs(1 + height / H - a) / a for height in heights]
        if row["voltage_V"] and a > 1.001:
            wrong.append(abs(row["voltage_V"] / ball.at(a * H).volts - 1))
        return float(max(wrong))

    trace = dea.Trace("voltage", steps=400, until=("equator_r_m", (far - 1) * H), **steps)
    words = _said(part=part, outer=outer, until=far, layers=layers, cells=cells,
                  chains=chains, **steps)  # fmt: skip
    return Trial(words, scene, trace, record, astray, ROUND)


KINDS: dict[str, Callable[[np.random.Generator], Trial]] = {
    "film": film, "strip": strip, "stack": stack, "disc": disc, "sphere": sphere,
}  # fmt: skip


def follow(
    kind: str, seed: int, number: int, at_turn: Any = None, shown: bool = False
) -> tuple[str, float, str]:
    """Run a trial: how it went, the worst row, and what it was.

    It ``"stays"``, ``"leaves"``, or ``"stops"`` by an error with all its rows still on the branch.
    A branch that turns aside is ``"told"``.
    """
    trial = KINDS[kind](np.random.default_rng([seed, number]))
    end = ""
    items = trial.path if isinstance(trial.path, list) else [trial.path]
    path = [replace(i, at_turn=at_turn) if isinstance(i, dea.Trace) else i for i in items]
    try:
        run = dea.solve(
            trial.scene, path, trial.record, quiet=not shown, stability="never"
        )
        rows = run.history
    except dea.Interrupted:
        raise
    except dea.DeaError as error:
        end = str(error)
        rows = error.run.history if getattr(error, "run", None) else []
    found = [trial.astray(row) for row in rows]
    if shown:
        for row, wrong in zip(rows, found, strict=True):
            print(f"{row['step']:4d} {row['voltage_V']:12.3f} {wrong:.1e} {row['event']}")
    worst = max(found, default=0.0)
    where = next((k for k, wrong in enumerate(found) if wrong > trial.limit), len(rows))
    told = any(row["event"] == "turn aside" for row in rows[: where + 1])
    outcome = "stops" if end else "stays"
    if worst > trial.limit:
        outcome = "told" if told else "leaves"
    words = f"{len(rows)} rows{f' (astray from {where})' if where < len(rows) else ''}"
    return outcome, worst, f"{words}  {trial.words}  {end}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=KINDS)
    parser.add_argument("--at-turn", choices=("follow", "pass", "end"))
    parser.add_argument("--trial", type=int, help="one trial alone, whose steps are shown")
    args = parser.parse_args()
    kinds = [args.only] if args.only else list(KINDS)
    told: dict[str, int] = {}
    numbers = range(args.count) if args.trial is None else [args.trial]
    for number in numbers:
        kind = kinds[number % len(kinds)]
        start = time.process_time()
        outcome, worst, words = follow(
            kind, args.seed, number, args.at_turn, args.trial is not None
        )
        told[outcome] = told.get(outcome, 0) + 1
        seconds = time.process_time() - start
        head = f"{number:4d} {kind:7s}{outcome:7s}{worst:8.1e} {seconds:5.1f} s"
        print(f"{head}  {words}", flush=True)
    print(f"\nseed {args.seed}: {told} of {len(numbers)} traces")
    return told.get("leaves", 0)


if __name__ == "__main__":
    sys.exit(main())
