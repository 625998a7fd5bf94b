"""``python docs/gallery.py [NAME ...]``: run the demos, and keep the pictures of the gallery.

Each demo runs on one core, with the options of docs/gallery/runs.toml.  Its picture goes to
docs/gallery/NAME.png.  The command, the seconds, the commit and the versions go to
docs/gallery/results.json, and the site prints them beside the picture.  All demos take about a
quarter of an hour on one core.
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
GALLERY = DOCS / "gallery"
RESULTS = GALLERY / "results.json"


def commit() -> str:
    """The commit of the code that runs; a plus sign tells that code was changed since."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    code = ("dea_fenicsx/*.py", "dea_fenicsx/*.toml", "geometry", "demos/*.py")
    return git("rev-parse", "--short=12", "HEAD") + "+" * bool(git("status", "--short", *code))


def run(demo: Path, options: list[str], out: Path) -> tuple[float, int]:
    """Seconds of one run of a demo and its exit status; its output goes to a file beside `out`.

    The seconds are those of the processor.  On one core without other work the demo takes as long
    by the clock; on a busy machine the clock would show the other work.
    """
    environment = dict(os.environ, OMP_NUM_THREADS="1", MPLBACKEND="Agg")
    paths = [str(ROOT), os.environ.get("PYTHONPATH")]
    environment["PYTHONPATH"] = os.pathsep.join(p for p in paths if p)
    start = used()
    with out.with_suffix(".log").open("w") as log:
        done = subprocess.run([sys.executable, demo, *options, "--out", out], env=environment,
                              cwd=out.parent, stdout=log, stderr=subprocess.STDOUT)  # fmt: skip
    return used() - start, done.returncode


def used() -> float:
    """Seconds of the processor that all ended child processes have used."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def picture_of(out: Path, name: str | None) -> Path | None:
    """The picture to show: the named one, the first that the demo left, or one drawn now."""
    import dea_fenicsx as dea

    if name is not None:
        return out / name
    preferred = [*out.glob("field_strength.png"), *sorted(out.rglob("*.png"))]
    if not preferred and (out / "fields.xdmf").is_file():
        return dea.pictures.deformed(out)
    return preferred[0] if preferred else None


def main(names: list[str], place: Path) -> int:
    """Run the named demos, or all; returns the number of demos that failed."""
    from dea_fenicsx.docs.pictures import small

    settings = tomllib.loads((GALLERY / "runs.toml").read_text("utf-8"))
    results = json.loads(RESULTS.read_text("utf-8")) if RESULTS.is_file() else {}
    code, failed = commit(), 0
    for demo in sorted((ROOT / "demos").glob("*.py")):
        if names and demo.stem not in names and demo.name not in names:
            continue
        wanted = settings.get(demo.name, {})
        options, out = wanted.get("options", []), place / demo.stem
        seconds, status = run(demo, options, out)
        print(f"{demo.name}: {seconds:.1f} s, exit status {status}", flush=True)
        if status != 0:
            failed += 1
            continue
        results[demo.name] = {
            "command": shlex.join(["python", f"demos/{demo.name}", *options]),
            "seconds": float(f"{seconds:.2g}"),
            "commit": code,
        }
        picture = picture_of(out, wanted.get("picture"))
        if picture is not None:
            small(picture, GALLERY / f"{demo.stem}.png", 900)
            results[demo.name]["picture"] = picture.name
        RESULTS.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", "utf-8")
    return failed


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        sys.exit(min(main(sys.argv[1:], Path(os.environ.get("DEA_GALLERY", scratch))), 1))
