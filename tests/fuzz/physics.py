"""Random scenes, and what must hold for every one of them.

    python -m tests.fuzz.physics --count 500 --seed 1 --jobs 2
    python -m tests.fuzz.physics --seed 1 --only 17          one of them again, with its script
    python -m tests.fuzz.physics --replay FILE                sketches from a file, one a line

A share of them is solved on two ranks as well.  What is found is printed with its number, and for
each kind the shortest scene as a script and as a line of JSON, which `--replay` takes with any
release of hypothesis.  Exit status: 1 if anything was found.
"""

from __future__ import annotations

import argparse
import collections
import json
import signal
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from .checks import Late, Verdict, check
from .scenes import drawn
from .sketch import Sketch, read, script

LIMIT = 300
"""Seconds of work on a scene.

Three layers of Ogden's model in space that buckle before their load is lost need 160 s on an idle
core: each of six runs tries some 50 steps of ten linear solves, in which the product with the
tangent, compiled in a hurry, takes 2 ms.
"""


def timed(index: int, text: str, limit: int) -> tuple[int, dict[str, Any]]:
    """Check a sketch within a limit of seconds of the processor's time, and ten times it in all."""

    def late(*_: Any) -> None:
        raise Late

    for kind, timer, seconds in (
        (signal.SIGALRM, signal.ITIMER_REAL, 10 * limit),
        (signal.SIGPROF, signal.ITIMER_PROF, limit),
    ):
        signal.signal(kind, late)
        signal.setitimer(timer, seconds)
    try:
        return index, asdict(check(read(text)))
    except Late:
        return index, asdict(Verdict("late", [("too slow", f"more than {limit} s")], [], limit))
    except Exception as error:
        said = "".join(traceback.format_exception(error)[-3:])
        return index, asdict(Verdict("harness failed", [("harness failed", said)]))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.setitimer(signal.ITIMER_PROF, 0)


def all_of(sketches: dict[int, Sketch], jobs: int, limit: int) -> dict[int, dict[str, Any]]:
    """Check sketches by number in several processes, and tell how far it is."""
    verdicts: dict[int, dict[str, Any]] = {}
    start, told = time.perf_counter(), 0.0
    left = dict(sketches)
    while left:
        # numbers go to the workers one by one: a worker that dies takes one sketch with it
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            waiting = {pool.submit(timed, k, s.text, limit): k for k, s in left.items()}
            try:
                for done in as_completed(waiting):
                    k, verdict = done.result()
                    verdicts[k] = verdict
                    del left[k]
                    for kind, detail in verdict["found"]:
                        print(f"  {k}: {kind}: {detail[:300]}", flush=True)
                    now = time.perf_counter() - start
                    if now - told > 30 or not left:
                        told = now
                        print(f"{len(verdicts)} of {len(sketches)} scenes, {now:.0f} s", flush=True)
            except BrokenProcessPool:
                # which of the running ones it was is found by running the next few alone
                for k in list(left)[: 2 * jobs]:
                    verdicts[k] = _alone(k, left.pop(k), limit)
    return verdicts


def _alone(index: int, sketch: Sketch, limit: int) -> dict[str, Any]:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        try:
            return pool.submit(timed, index, sketch.text, limit).result()[1]
        except BrokenProcessPool:
            return asdict(Verdict("crashed", [("crash", "the process has died")]))


def report(sketches: dict[int, Sketch], verdicts: dict[int, dict[str, Any]], source: str) -> int:
    """Print how the sketches ended, what was found, and the shortest script of each kind."""
    ends = collections.Counter(v["status"] for v in verdicts.values())
    notes = collections.Counter(n.split(":")[0] for v in verdicts.values() for n in v["notes"])
    kinds: dict[str, list[int]] = collections.defaultdict(list)
    for k, v in sorted(verdicts.items()):
        for kind in {kind for kind, _ in v["found"]}:
            kinds[kind].append(k)
    print(f"\n{len(verdicts)} scenes of {source}: {dict(ends)}; {dict(notes)}")
    for kind, numbers in kinds.items():
        shortest = min(numbers, key=lambda k: len(sketches[k].text))
        print(f"\n{kind}: {len(numbers)} scenes, {numbers}")
        print(f"number {shortest}: {dict(verdicts[shortest]['found'])[kind][:600]}")
        print(f"{script(sketches[shortest])}\n{sketches[shortest].text}")
    print("nothing was found" if not kinds else f"{sum(map(len, kinds.values()))} findings")
    return bool(kinds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--small", action="store_true", help="flat scenes of two models, as tried "
                        "by the test suite")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of scenes of the seed")
    parser.add_argument("--replay", help="a file with sketches, one line of JSON each")
    parser.add_argument("--limit", type=int, default=LIMIT, help="seconds of work on a scene")
    parser.add_argument("--every", type=int, default=5, help="share on two ranks; 0 for none")
    parser.add_argument("--keep", help="write sketches and verdicts to this file, as JSON lines")
    args = parser.parse_args()
    if args.replay:
        lines = [line for line in Path(args.replay).read_text().splitlines() if line.strip()]
        sketches = {k: read(line) for k, line in enumerate(lines)}
        source = args.replay
    else:
        sketches = dict(enumerate(drawn(args.count, args.seed, args.small)))
        source = f"seed {args.seed}"
    if args.only:
        sketches = {k: sketches[k] for k in args.only}
    print(f"{len(sketches)} scenes of {source}", flush=True)
    verdicts = all_of(sketches, args.jobs, args.limit)
    if args.every:
        from .ranks import on_two_ranks

        some = {k: s for k, s in sketches.items() if k % args.every == 0 or args.only}
        for k, found in on_two_ranks(some, args.limit).items():
            for kind, detail in found:
                print(f"  {k}: {kind}: {detail[:300]}", flush=True)
            verdicts[k]["found"] += found
    if args.keep:
        with open(args.keep, "w", encoding="utf-8") as file:
            for k, v in sorted(verdicts.items()):
                file.write(json.dumps({"number": k, **v, "sketch": asdict(sketches[k])}) + "\n")
    return report(sketches, verdicts, source)


if __name__ == "__main__":
    sys.exit(main())
