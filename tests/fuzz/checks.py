"""What must hold for a sketch: energy and work, step counts, clear sentences, true losses.

For each sketch: the change of the potential energy over a ramp is the work done; the end is the
same for other step counts; a path that has no end says so in one sentence, at the same load however
it is stepped, and an equilibrium that is lost is lost at a limit point.
"""

from __future__ import annotations

import math
import re
import time
import traceback
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea

from .energy import NODES, Record, Watch, balance, stops
from .sketch import Call, Sketch, build, device_of

WORK = 1e-6
"""How far the change of energy may miss the work, of the sum of the sizes of both."""

ROUNDS = 10
"""How often the panels in which energy and work do not agree are halved.

A ramp that ends close to a limit point, or passes close to a bifurcation, needs narrow ones there.
Two numbers that are found apart agree to 1e-6 by chance only, so the first agreement counts; a
jump between two branches never agrees.
"""

END = 1e-6
"""How far two ends may lie apart, of the largest displacement or potential."""

SMALL = 1e-3
"""Displacement, of the device's size, below which `END` is a share of this instead."""

PLACE = 1e-2
"""How far apart two runs may lose equilibrium, as a share of the ramp.

Newton's method fails a little before a limit point, and how much before depends on where the last
steps lie.
"""

FINE = 2.0**-5
"""Arc of the traces that decide whether a loss is at a limit point, in units of arc.

Some folds are narrow: a dielectric of two layers has a maximum and a minimum of its load 0.1 apart.
"""

TIGHT = dea.NewtonOptions(tolerance=1e-11)
"""With the usual tolerance a soft device may rest 1e-6 away; with this one no two ends may.

Where chains are near their lock-up, rounding leaves more; then the usual one has to do.
"""


@dataclass
class Outcome:
    """How a run has ended.

    Attributes
    ----------
    status : "completed", "lost", "solver failed", "refused", or "crashed"
    message : the error's sentence, or the last lines of a traceback
    time : ramp and position of the last step
    run : its history and summary, if there is one
    records : of each step
    """

    status: str
    message: str = ""
    time: float = 0.0
    run: Any = None
    records: list[Record] = field(default_factory=list)
    problem: Any = None

    @property
    def inertia(self) -> int | None:
        return self.run.history[-1]["inertia"] if self.run else None


@dataclass
class Verdict:
    """What came of a sketch: how it ended, and what does not hold (kind and details)."""

    status: str
    found: list[tuple[str, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def note(self, kind: str, detail: str) -> None:
        self.found.append((kind, detail))


class Late(Exception):
    """A sketch has used up its time."""


def solve(
    sketch: Sketch, path: list[Any], device: Any = None, comm: Any = MPI.COMM_SELF, **options: Any
) -> Outcome:
    """Solve a sketch along a path; every exception but the end of the time is an outcome."""
    watch = Watch()
    record: dict[str, Any] = {"energy": watch}
    for k, electrode in enumerate(sketch.electrodes):
        record[f"q{k}"] = dea.Charge(electrode.args["where"])
    try:
        scene = build(sketch, comm, device)
        run = dea.solve(scene, path, record, quiet=True, **options)
        return Outcome("completed", "", run.history[-1]["time"], run, watch.records, run.problem)
    except Late:
        raise
    except dea.InputError as error:
        return Outcome("refused", str(error))
    except (dea.EquilibriumLost, dea.SolverError) as error:
        status = "lost" if isinstance(error, dea.EquilibriumLost) else "solver failed"
        run = error.run
        return Outcome(status, str(error), run.history[-1]["time"], run, watch.records, run.problem)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        return Outcome("crashed", f"{type(error).__name__} at {where}: {str(error)[:200]}")


def path_of(sketch: Sketch, more: int = 0) -> list[dea.Ramp]:
    """The path of a sketch; with `more`, in (1 + more) n + more steps instead of n."""
    return [dea.Ramp(what, to, steps=n * (1 + more) + more) for what, to, n in sketch.path]


def check(sketch: Sketch) -> Verdict:
    """Run a sketch as often as needed and say what does not hold."""
    start = time.perf_counter()
    try:
        device = device_of(sketch, MPI.COMM_SELF)
    except dea.InputError as error:
        return Verdict("refused", [("unclear sentence", str(error))] * (not clear(str(error))))
    first = solve(sketch, path_of(sketch), device)
    verdict = Verdict(first.status)
    _check_outcome(first, verdict)
    if first.status == "refused":
        verdict.notes.append(f"refused: {first.message}")
    if first.status in ("completed", "lost", "solver failed"):
        second = solve(sketch, path_of(sketch, 2), device)
        _check_outcome(second, verdict)
        _compare(sketch, device, first, second, verdict)
        if first.status == "completed" == second.status:
            _check_work(sketch, path_of(sketch), device, verdict, first)
        elif first.status == "lost" == second.status:
            _check_loss(sketch, device, first, verdict)
    verdict.found = list(dict.fromkeys(verdict.found))
    verdict.seconds = time.perf_counter() - start
    return verdict


# ------------------------------------------------------------------------------ one outcome


def clear(message: str) -> bool:
    """Whether a message is for a user: a sentence, or two where the count has changed as well.

    The load of four ramps takes 70 characters, and a range names it twice.
    """
    return (
        message.endswith(".") and "\n" not in message and 20 < len(message) < 700
        and " object at 0x" not in message and "Traceback" not in message
    )  # fmt: skip


def _check_outcome(it: Outcome, verdict: Verdict) -> None:
    if it.status == "crashed":
        verdict.note("crash", it.message)
        return
    if it.status != "completed" and not clear(it.message):
        verdict.note("unclear sentence", it.message)
    if it.status == "solver failed":
        verdict.note("solver failed", it.message)
    ends = re.search(r"between (.+) and (.+) of the", it.message)
    if it.status == "lost" and (not ends or ends[1] == ends[2]):
        verdict.note("range without width", it.message)
    if it.run is None:
        return
    for row in it.run.history:
        bad = [k for k, v in row.items() if isinstance(v, float) and not math.isfinite(v)]
        if bad:
            verdict.note("not finite", f"step {row['step']}: {', '.join(bad)}")
            break
    _check_charges(it, verdict)
    counts = [row["inertia"] for row in it.run.history if row["inertia_is_of_this_step"]]
    if any(c is not None and c < 0 for c in counts):
        verdict.note("count below zero", f"{counts}")
    told = it.run.summary["status"] != "completed" or it.run.summary["message"]
    if it.status == "completed" and it.inertia and not told:
        verdict.note("unstable end, not told", f"{it.inertia} negative eigenvalues")


def _check_charges(it: Outcome, verdict: Verdict) -> None:
    """All charges add up to zero where each electrode holds a potential that is constant on it."""
    electrodes = it.problem.scene.electrodes
    if not electrodes or any(isinstance(e, dea.ThinFilm) or getattr(e, "taper", ())
                             for e in electrodes):  # fmt: skip
        return
    last = it.run.history[-1]
    charges = np.array([last[f"q{k}_C"] for k in range(len(electrodes))])
    # Newton's method leaves 1e-10 of the potential's reference, which is of the charges' size
    scale = max(float(np.abs(charges).max()), 1e-3 * it.problem.scales.charge)
    if abs(charges.sum()) > 1e-7 * scale:
        verdict.note("charges do not add up", f"{charges.tolist()} C")


# ---------------------------------------------------------------------------- two outcomes


def apart(a: Outcome, b: Outcome) -> float:
    """How far two ends lie apart: of the largest displacement, or potential, on the way there.

    On the way, for at the end the device may be back where it was, but for rounding.  The pressure
    is left out: it is not determined where a block is held all around.
    """
    problem = a.problem
    worst = 0.0
    for name, floor in (("u", SMALL), ("phi", 1e-300)):
        if name in problem.roles.groups:
            dofs = problem.roles.of_group(name)[0]
            x, y = (o.records[-1].state[dofs] for o in (a, b))
            sizes = [np.abs(r.state[dofs]).max(initial=0.0) for o in (a, b) for r in o.records]
            scale = max(floor, *map(float, sizes))
            worst = max(worst, float(np.abs(x - y).max(initial=0)) / scale)
    return worst


def _compare(sketch: Sketch, device: Any, a: Outcome, b: Outcome, verdict: Verdict) -> None:
    """Two step counts end in the same way, at the same place."""
    counts = [[ramp.steps for ramp in path_of(sketch, more)] for more in (0, 2)]
    if a.status != b.status:
        verdict.note("verdict depends on steps", f"{counts[0]}: {a.status} at {a.time:.6g}; "
                     f"{counts[1]}: {b.status} at {b.time:.6g} ({a.message or b.message})")
    elif a.status == "lost":
        if abs(a.time - b.time) > PLACE:
            verdict.note("loss depends on steps",
                         f"{counts[0]}: lost at {a.time:.6g}; {counts[1]}: at {b.time:.6g}")
    elif a.status == "completed" and apart(a, b) > END:
        gap = apart(a, b)
        tight = [solve(sketch, path_of(sketch, m), device, options=TIGHT) for m in (0, 2)]
        if all(o.status == "completed" for o in tight):
            gap = apart(*tight)
        if gap > END:
            verdict.note("end depends on steps", f"{counts[0]} and {counts[1]}: ends {gap:.2g} "
                         f"apart, negative eigenvalues {a.inertia} and {b.inertia}")  # fmt: skip
    elif a.status == "completed" and a.inertia != b.inertia:
        verdict.note("count depends on steps", f"{a.inertia} and {b.inertia} at one end")


# -------------------------------------------------------------------------------- the work


def _check_work(sketch: Sketch, path: list[dea.Ramp], device: Any, verdict: Verdict,
                end: Outcome | None = None) -> None:  # fmt: skip
    """The change of energy over each ramp of the path is the work done, and its end is `end`'s."""
    factors = dict.fromkeys({n for ramp in path for n in ramp.what}, 0.0)
    moved = []
    for ramp in path:
        moved.append({n: ramp.to - factors[n] for n in ramp.what})
        factors |= dict.fromkeys(ramp.what, ramp.to)
    panels = [[(0.0, 0.5), (0.5, 1.0)] for _ in path]
    said: list[str] = []
    for round_ in range(ROUNDS):
        at = [
            replace(ramp, steps=4 * len(mine), at=tuple(
                ramp.to - (1 - s) * change[ramp.what[0]] for s in stops(mine)))
            for ramp, mine, change in zip(path, panels, moved, strict=True)
        ]  # fmt: skip
        it = solve(sketch, at, device, options=TIGHT if round_ else None)
        if it.status == "solver failed" and round_:
            it = solve(sketch, at, device)
        if it.status != "completed":
            verdict.note("verdict depends on steps", f"{it.status} at {it.time:.6g} with landings, "
                         f"which completed before ({it.message})")  # fmt: skip
            return
        worst = _split(it, panels, moved)
        if not worst:
            verdict.notes.append(f"rounds {round_ + 1}")
            if end and (gap := apart(it, end)) > END:
                verdict.note("end depends on steps", f"{[r.steps for r in path]} and "
                             f"{[r.steps for r in at]} with landings: ends {gap:.2g} apart, "
                             f"negative eigenvalues {end.inertia} and {it.inertia}")  # fmt: skip
            return
        said.append(f"{worst:.2g}")
    verdict.note("energy is not work", f"missed by {', '.join(said)} in round after round; "
                 f"narrowest panel {min((b - a, a) for mine in panels for a, b in mine)}")


def _split(it: Outcome, panels: list[list[tuple[float, float]]],
           moved: list[dict[str, float]]) -> float:  # fmt: skip
    """Halve the panels in which energy and work differ; the largest miss, or 0 if none does."""
    found = []
    for item, (mine, change) in enumerate(zip(panels, moved, strict=True)):
        if any(change.values()):
            found.append([balance(_at(it, item, [a + x * (b - a) for x in NODES]), change, b - a)
                          for a, b in mine])  # fmt: skip
        else:
            found.append([(0.0, 0.0)] * len(mine))
    worst = 0.0
    for item, misses in enumerate(found):
        scale = sum(size for _, size in misses)
        if scale < 1e-14:
            continue  # nothing has moved
        halved = []
        for (a, b), (miss, _) in zip(panels[item], misses, strict=True):
            if miss <= WORK * scale:
                halved.append((a, b))
                continue
            worst = max(worst, miss / scale)
            halved += [(a, (a + b) / 2), ((a + b) / 2, b)]
        panels[item] = halved
    return worst


def _at(it: Outcome, item: int, places: list[float]) -> list[Record]:
    """The records at given positions of a ramp.  Events are left out."""
    rows = [(row["time"] - item, r) for row, r in zip(it.run.history, it.records, strict=True)
            if not row["event"]]  # fmt: skip
    return [min(rows, key=lambda row: abs(row[0] - s))[1] for s in places]


# -------------------------------------------------------------------------- equilibrium lost


def _check_loss(sketch: Sketch, device: Any, it: Outcome, verdict: Verdict) -> None:
    """Energy is work up to the loss, and the loss is at a limit point of the branch."""
    item = min(int(it.time), len(sketch.path) - 1)
    share = it.time - item
    if share > 1 - 1e-12:
        item, share = min(item + 1, len(sketch.path) - 1), 0.0
    what, to, steps = sketch.path[item]
    begin = 0.0
    for names, target, _ in sketch.path[:item]:
        begin = target if what and what[0] in names else begin
    before = path_of(sketch)[:item]
    if share > 0.02:
        part = dea.Ramp(what, begin + 0.7 * share * (to - begin), steps=steps)
        _check_work(sketch, [*before, part], device, verdict)
    single = one_ramp(sketch) if item == 0 else sketch
    if single is None or (item and len(what) > 1):
        verdict.notes.append("loss not traced")
        return
    ramp = "one" if item == 0 else what[0]
    reached = begin + share * (to - begin)
    first = 0.02 * (to - begin)
    coarse = dea.Trace(ramp, first=first, steps=60, longest=1.0)
    fine = dea.Trace(ramp, first=first, steps=60, longest=FINE)
    said = ""
    # A long step may pass over a fold that is narrow, so a false loss is one in short steps too.
    for trace, way in ((coarse, 0.9), (fine, 0.999)):
        near = dea.Ramp(ramp, begin + way * share * (to - begin), steps=max(4, steps))
        path = [*before, near, trace] if share > 0.02 else [*before, trace]
        found = solve(single, path, device)
        if found.run is None:
            verdict.notes.append(f"loss not traced: {found.status}")
            return
        rows = found.run.history
        column = next(k for k in rows[-1] if k in (f"{ramp}_V", f"{ramp}_factor"))
        unit = found.problem.scene.reference_voltage(ramp) or 1.0
        gone = [np.sign(to - begin) * (row[column] / unit - reached) / abs(to - begin)
                for row in rows]  # fmt: skip
        turns = [abs(g) for row, g in zip(rows, gone, strict=True)
                 if row["event"] in ("maximum", "minimum")]  # fmt: skip
        if any(g <= PLACE for g in turns):
            verdict.notes.append("loss at a limit point")
            return
        if max(gone) <= PLACE and not said:
            verdict.notes.append(f"loss without limit point: {it.message}")
            return
        said = said or f"a trace passes it by {max(gone):.3g} of the ramp, without limit point"
    verdict.note("false loss", f"lost at {it.time:.6g} of the path, but {said} ({it.message})")


def one_ramp(sketch: Sketch) -> Sketch | None:
    """The sketch with everything on one ramp, if its first ramp moves all; None if it does not."""
    names = {c.ramp for c in (*sketch.prescribed, *sketch.loads, *sketch.electrodes) if c.ramp}
    if any(c.name == "PreStretch" for c in sketch.prescribed) or (
        names and not names <= set(sketch.path[0][0])
    ):
        return None

    def renamed(calls: tuple[Call, ...]) -> tuple[Call, ...]:
        return tuple(Call(c.name, c.args | {"ramp": "one"}) for c in calls)

    return replace(sketch, prescribed=renamed(sketch.prescribed), loads=renamed(sketch.loads),
                   electrodes=renamed(sketch.electrodes))  # fmt: skip
