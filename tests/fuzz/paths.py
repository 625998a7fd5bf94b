"""Ten paths close to instabilities, each in many random step counts: one answer each.

    python -m tests.fuzz.paths --count 30 --seed 1
    python -m tests.fuzz.paths --only sheet --steps 5 40       given step counts instead

An answer is the verdict and, where the path has an end, the values there; where equilibrium is
lost, how far the path was followed.  Where there is a closed form, the answer is compared with it.
Exit status: the number of paths that have more than one answer, or a wrong one.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq, minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

SAME = 1e-6
"""How far values at the end may lie apart, of the largest size of the value on the way.

Near an instability the usual tolerance of Newton's method leaves more, so that all runs are made
with `TIGHT`.  A tolerance of 1e-12 is below what rounding leaves close to the lock-up of chains.
"""

TIGHT = dea.NewtonOptions(tolerance=1e-11)

PLACE = 2e-3
"""How far apart equilibrium may be lost, as a share of a ramp: its smallest step is 1e-3 of the
first one, and Newton's method fails a little before a limit point."""

MU, EPS_R, T = 5e4, 3.0, 1e-3
UNIT = T * math.sqrt(MU / (EPS_R * EPSILON_0))
LIMIT = 0.687364819 * UNIT
"""Pull-in voltage of a free neo-Hookean film, at a stretch of 2^(1/3)."""

RUBBER = dea.NeoHookean(MU)
SOFT = dea.Material(RUBBER)
FILM = dea.Material(RUBBER, dea.IdealDielectric(EPS_R))


@dataclass(frozen=True)
class Way:
    """A path near an instability.

    Attributes
    ----------
    items : how many ramps have a number of steps
    run : solves with these numbers of steps
    status : how it must end, or None if both ways are right
    right : values at the end, with the relative tolerance that the discretisation allows
    lost_at : time (ramp and position) at which equilibrium is lost, where that is known
    """

    items: int
    run: Callable[..., dea.Run]
    status: str | None = "completed"
    right: dict[str, tuple[float, float]] = field(default_factory=dict)
    lost_at: float | None = None


WAYS: dict[str, Way] = {}


def way(items: int, status: str | None = "completed", lost_at: float | None = None,
        **right: tuple[float, float]) -> Callable:  # fmt: skip
    """Enter a path into the table under its function's name."""

    def enter(function: Callable) -> Callable:
        name = function.__name__.replace("_", " ")
        WAYS[name] = Way(items, function, status, right, lost_at)
        return function

    return enter


@cache
def box(layers: tuple, length: float, width: float | None = None, cells: tuple = (1,)) -> Any:
    parts = [Layer(name, thickness, divisions=n) for name, thickness, n in layers]
    return dea.read_gmsh(BoxStack(length, width, parts, divisions=cells), MPI.COMM_SELF)


def solve(scene: dea.Scene, path: list[Any], record: dict[str, Any]) -> dea.Run:
    return dea.solve(scene, path, record, quiet=True, options=TIGHT)


# ------------------------------------------------------------------------------------ the paths


@way(1, x=(0.954453, 1e-6), y=(3.948580, 1e-6))
def sheet(n: int) -> dea.Run:
    """A free Mooney-Rivlin sheet under dead loads that differ by a thousandth (Treloar, Kearsley).

    Under equal loads it leaves the equal stretches at a bifurcation; the small difference makes the
    branch a smooth one, which turns within a few per cent of the load.  Closed form of a cell.
    """
    load = 4e5
    scene = dea.Scene(
        box((("film", 1e-4, 1),), 1e-3, 1e-3, (1, 1)),
        {"film": dea.Material(dea.MooneyRivlin(4e4, 1.2e4))},
        loads=[dea.DeadLoad("x_max", (load, 0, 0)), dea.DeadLoad("y_max", (0, 1.001 * load, 0))],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )
    record = {a: dea.MeanStretch((f"{a}_min", f"{a}_max"), a) for a in "xy"}
    return solve(scene, [dea.Ramp(steps=n)], record)


def strip(elastic: dea.Material = FILM, load: float = 1.0, press: float = -1.2e-3,
          **more: Any) -> dea.Scene:  # fmt: skip
    """A strip that is clamped at both ends, pressed together, and loaded a little from the side."""
    return dea.Scene(
        box((("film", 1e-3, 1),), 24e-3, None, (24,)), {"film": elastic},
        supports=[dea.Clamp("x_min"), dea.Fix("x_max", "y")],
        prescribed=[dea.Displacement("x_max", "x", press)],
        loads=[dea.DeadLoad("bottom", (0.0, load), ramp="q")],
        kinematics=dea.PlaneStrain(1e-3), **more,
    )  # fmt: skip


@way(1, v_m=(3.2048e-3, 2e-4))
def strip_with_side_load(n: int) -> dea.Run:
    """Pressed past buckling with a side load of 1 Pa: it must leave the straight shape."""
    return solve(strip(), [dea.Ramp("q", steps=1), dea.Ramp("stretch", steps=n)],
                 {"v": dea.LargestDisplacement("top", "y")})  # fmt: skip


def disc(elastic: Any, electrodes: list[Any], load: float = 0.0) -> dea.Scene:
    """A free disc of film, which stays homogeneous."""
    return dea.Scene(
        box((("film", T, 1),), T, None, (1,)),
        {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R))}, electrodes=electrodes,
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (load, 0.0))] if load else (),
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


Z = {"z": dea.MeanStretch(("bottom", "top"), "z")}


@way(1, "lost", lost_at=1 / 1.1)
def film_over_its_pull_in(n: int) -> dea.Run:
    """A free neo-Hookean film on 1.1 times its pull-in voltage."""
    return solve(disc(RUBBER, [dea.Electrode("top", 1.1 * LIMIT), dea.Ground("bottom")]),
                 [dea.Ramp(steps=n)], Z)  # fmt: skip


GENT = dea.Gent(MU, 40.0)


def gent_volts(lam: float, load: float = 0.0) -> float:
    """Voltage that holds a Gent disc at a stretch in the plane, under a radial dead load in Pa."""
    i1 = 2 * lam**2 + lam**-4
    sigma = MU * GENT.Jm / (GENT.Jm - i1 + 3) * (lam**2 - lam**-4) - lam * load
    return T * math.sqrt(max(sigma, 0.0) / (EPS_R * EPSILON_0)) / lam**2


def gent_maximum(load: float = 0.0) -> tuple[float, float]:
    """Stretch and voltage of the first maximum."""
    low = brentq(lambda x: MU * (x - x**-5) - load, 1.0, 3.0) if load else 1.0
    top = minimize_scalar(lambda x: -gent_volts(x, load), bounds=(low, 2.0), method="bounded",
                          options={"xatol": 1e-12})  # fmt: skip
    return float(top.x), float(-top.fun)


def stretched(volts: float, load: float = 0.0) -> float:
    """Thickness stretch on the stiff branch behind the snap."""
    taut = brentq(lambda x: 2 * x**2 + x**-4 - 3 - GENT.Jm, 2.0, 1e3, xtol=1e-14)
    end = taut * (1 - 1e-9)
    lam = brentq(lambda x: gent_volts(x, load) - volts, 3.2, end, xtol=1e-14)
    return lam**-2


@way(1, z=(stretched(1.2 * gent_maximum()[1]), 1e-6))
def gent_film_on_a_battery(n: int) -> dea.Run:
    """It snaps at the maximum, lands on the stiff branch, and goes on to 1.2 times the maximum."""
    volts = 1.2 * gent_maximum()[1]
    return solve(disc(GENT, [dea.Electrode("top", volts), dea.Ground("bottom")]),
                 [dea.Ramp(steps=n, snap=True)], Z)  # fmt: skip


PULL = 0.3 * MU


@way(2, z=(brentq(lambda z: gent_volts(z**-0.5, PULL) - 0.3 * gent_maximum(PULL)[1], 0.5, 0.9,
                  xtol=1e-15), 1e-6))  # fmt: skip
def gent_film_there_and_back(n: int, m: int) -> dea.Run:
    """Under a dead load: voltage over the maximum, back under the minimum; it snaps twice."""
    top = 1.1 * gent_maximum(PULL)[1]
    scene = disc(GENT, [dea.Electrode("top", top), dea.Ground("bottom")], PULL)
    back = 0.3 * gent_maximum(PULL)[1] / top
    return solve(scene, [
        dea.Ramp("load", steps=1), dea.Ramp("voltage", steps=n, snap=True),
        dea.Ramp("voltage", back, steps=m, snap=True),
    ], Z)  # fmt: skip


@way(1, "lost", lost_at=0.33620)
def plate_under_pressure(n: int) -> dea.Run:
    """A clamped neo-Hookean plate, blown up past its highest pressure, that of 60 steps."""
    scene = dea.Scene(
        box((("film", 1e-3, 1),), 10e-3, None, (6,)), {"film": SOFT},
        supports=[dea.Clamp("x_max"), dea.Fix("x_min", "r")],
        loads=[dea.FollowerPressure("bottom", 3e4)], kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    return solve(scene, [dea.Ramp(steps=n)], {"h": dea.LargestDisplacement("top", "z")})


@way(2, v_m=(2.07649874e-3, 1e-6))
def arch_that_snaps(n: int, m: int) -> dea.Run:
    """A strip that has buckled is pushed back by a side load until it snaps through; 80 steps."""
    scene = strip(SOFT, load=-1.0)
    path = [
        dea.Ramp("q", -1.0, steps=1), dea.Ramp("stretch", steps=n),
        dea.Ramp("q", 150.0, steps=m, snap=True),
    ]  # fmt: skip
    return solve(scene, path, {"v": dea.MeanDisplacement("top", "y")})


GEO = """Point(1)={0,0,0}; Point(2)={20e-3,0,0}; Point(3)={20e-3,1e-3,0};
Point(4)={10e-3,1.01e-3,0}; Point(5)={0,1e-3,0};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,1};
Curve Loop(1)={1,2,3,4,5}; Plane Surface(1)={1};
Transfinite Curve{1}=17; Transfinite Curve{3,4}=9; Transfinite Curve{2,5}=2;
Transfinite Surface{1}={1,2,3,5}; Recombine Surface{1};
Physical Surface("film")={1}; Physical Curve("left")={5}; Physical Curve("right")={2};
Physical Curve("top")={3,4};
Mesh.ElementOrder=2; Mesh.SecondOrderIncomplete=0;
"""


@cache
def column_mesh() -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "column.geo"
        path.write_text(GEO)
        return dea.read_gmsh(str(path), MPI.COMM_SELF)


@way(1, v_m=(1.42081138e-3, 1e-6))
def column_with_an_imperfection(n: int) -> dea.Run:
    """A column that is one per cent thicker in the middle, on one side; pressed past buckling.

    The value is that of a trace from rest by arc length.
    """
    scene = dea.Scene(
        column_mesh(), {"film": SOFT}, supports=[dea.Clamp("left"), dea.Fix("right", "y")],
        prescribed=[dea.Displacement("right", "x", -1.2e-3)], kinematics=dea.PlaneStrain(1e-3),
    )
    return solve(scene, [dea.Ramp(steps=n)], {"v": dea.MeanDisplacement("top", "y")})


@way(1, v_m=(1.9720774e-4, 1e-6), F_N=(-0.0537844334, 1e-6))
def skin_on_a_soft_base(n: int) -> dea.Run:
    """A stiff skin on a soft base, clamped at one end; pressed past its wrinkling.  120 steps."""
    scene = dea.Scene(
        box((("base", 1e-3, 2), ("skin", 1e-4, 1)), 4e-3, None, (16,)),
        {"base": SOFT, "skin": dea.Material(dea.NeoHookean(1e6))},
        supports=[dea.Clamp("x_min"), dea.Fix("bottom", "y")],
        prescribed=[dea.Displacement("x_max", "x", -0.4e-3)], kinematics=dea.PlaneStrain(1e-3),
    )
    return solve(scene, [dea.Ramp(steps=n)], {"v": dea.LargestDisplacement("top", "y"),
                                              "F": dea.Reaction("x_max", "x")})  # fmt: skip


@way(1, "lost", lost_at=1 / 1.05)
def two_electrodes_together(n: int) -> dea.Run:
    """One ramp of two names: the difference of the two potentials pulls the film in."""
    half = 1.05 * LIMIT / 2
    scene = disc(RUBBER, [dea.Electrode("top", half, ramp="left"),
                          dea.Electrode("bottom", -half, ramp="right")])  # fmt: skip
    return solve(scene, [dea.Ramp(("left", "right"), steps=n)], Z)


@way(3, v_m=(1.01853365e-3, 1e-6), F_N=(-1.06868835e-3, 1e-6))
def buckled_strip_with_voltage(n: int, m: int, k: int) -> dea.Run:
    """A film pressed past buckling, then under voltage, then released while the voltage stays.

    The values are those of 60 steps each.
    """
    electrodes = [dea.Electrode("top", 0.3 * UNIT), dea.Ground("bottom")]
    scene = strip(press=-0.8e-3, electrodes=electrodes)
    path = [dea.Ramp("q", steps=1), dea.Ramp("stretch", steps=n), dea.Ramp("voltage", steps=m),
            dea.Ramp("stretch", 0.0, steps=k)]  # fmt: skip
    return solve(scene, path, {"v": dea.MeanDisplacement("top", "y"),
                               "F": dea.Reaction("x_max", "x")})  # fmt: skip


# ------------------------------------------------------------------------------------ the answers


@dataclass
class Answer:
    """What came of a path with some step counts."""

    steps: tuple[int, ...]
    status: str
    message: str
    time: float
    inertia: int | None
    values: dict[str, float]
    scales: dict[str, float]
    seconds: float
    events: list[str]

    def same(self, other: Answer) -> bool:
        if self.status != other.status:
            return False
        if self.status != "completed":
            return abs(self.time - other.time) <= PLACE
        return self.inertia == other.inertia and all(
            abs(v - other.values[k]) <= SAME * max(self.scales[k], other.scales[k])
            for k, v in self.values.items()
        )

    def __str__(self) -> str:
        values = ", ".join(f"{k} = {v:.9g}" for k, v in self.values.items())
        where = "" if self.status == "completed" else f" at {self.time:.6g}"
        return f"{self.status}{where}: {values}, {self.inertia} negative eigenvalues {self.message}"


def answer(name: str, steps: tuple[int, ...]) -> Answer:
    """Run a path with some step counts; what is neither a run nor a `PathError` is let through."""
    start = time.perf_counter()
    status, message = "completed", ""
    try:
        run = WAYS[name].run(*steps)
        message = run.summary["message"]
        status = run.summary["status"]
    except (dea.EquilibriumLost, dea.SolverError) as error:
        status = "lost" if isinstance(error, dea.EquilibriumLost) else "solver failed"
        message, run = str(error), error.run
    rows = run.history
    seen = list(rows[-1])
    seen = [k for k in seen[: seen.index("min_J")] if k in ("x", "y", "z", "v_m", "h_m", "F_N")]
    return Answer(
        steps, status, message, rows[-1]["time"], rows[-1]["inertia"],
        {k: rows[-1][k] for k in seen}, {k: max(abs(r[k]) for r in rows) for k in seen},
        time.perf_counter() - start, [r["event"] for r in rows if r["event"]],
    )  # fmt: skip


def faults(name: str, answers: list[Answer]) -> list[str]:
    """What is wrong with the answers of a path, in words; empty if all is well."""
    it, found = WAYS[name], []
    groups: list[list[Answer]] = []
    for a in answers:
        group = next((g for g in groups if g[0].same(a)), None)
        if group is None:
            groups.append([a])
        else:
            group.append(a)
    if len(groups) > 1:
        found.append(f"{len(groups)} answers")
        for g in sorted(groups, key=len, reverse=True)[:6]:
            found.append(f"  {len(g)} times, with steps {g[0].steps}: {g[0]}")
    for a in answers:
        wrong = ""
        if it.status and a.status != it.status:
            wrong = f"{a.status} where it must be {it.status}"
        elif a.status == "completed":
            # to which side a strip buckles is a matter of the load's sign, and checked by `same`
            off = {k: abs(abs(a.values[k]) / abs(v) - 1) for k, (v, _) in it.right.items()}
            wrong = ", ".join(f"{k} = {a.values[k]:.9g} instead of {it.right[k][0]:.9g}"
                              for k, miss in off.items() if miss > it.right[k][1])  # fmt: skip
            if a.inertia and not a.message:
                wrong = f"{a.inertia} negative eigenvalues, not told"
        elif it.lost_at is not None and abs(a.time - it.lost_at) > PLACE:
            wrong = f"lost at {a.time:.6g} instead of {it.lost_at:.6g}"
        if wrong:
            found.append(f"with steps {a.steps}: {wrong}")
    return found


def counts(items: int, count: int, seed: int, most: int = 40) -> list[tuple[int, ...]]:
    """Random step counts, evenly in their logarithm: few steps are the hard ones."""
    rng = np.random.default_rng(seed)
    span = np.log(most + 1)
    return [tuple(int(np.exp(span * x)) for x in rng.random(items)) for _ in range(count)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="paths whose names hold this word")
    parser.add_argument("--steps", type=int, nargs="*", help="these, for all ramps alike")
    args = parser.parse_args()
    short = 0
    print(f"seed {args.seed}", flush=True)
    for name, it in WAYS.items():
        if args.only not in name:
            continue
        tried = ([(n,) * it.items for n in args.steps] if args.steps
                 else counts(it.items, args.count, args.seed))  # fmt: skip
        answers = [answer(name, steps) for steps in tried]
        wrong = faults(name, answers)
        short += bool(wrong)
        spent = sum(a.seconds for a in answers)
        print(f"{'X ' if wrong else '  '}{name}: {len(answers)} runs, {spent:.0f} s; {answers[0]} "
              f"{answers[0].events}", flush=True)  # fmt: skip
        print("\n".join(f"     {line}" for line in wrong[:16]), flush=True)
    print(f"{short} paths fall short")
    return short


if __name__ == "__main__":
    sys.exit(main())
