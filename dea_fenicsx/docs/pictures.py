"""``python -m dea_fenicsx.docs.pictures``: the pictures of README and pages, from runs made now.

From the repository, whose demos and README it runs; about a minute on two cores.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from dea_fenicsx.support.errors import InputError, install_hook

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
COLOURS = 256
"""Enough for these pictures, and less than half of the size."""


def small(source: Path, target: Path, width: int = 1200) -> None:
    """Store a picture with a palette, at most so wide."""
    from PIL import Image

    picture = Image.open(source).convert("RGB")
    if picture.width > width:
        height = round(picture.height * width / picture.width)
        picture = picture.resize((width, height), Image.Resampling.LANCZOS)
    # this method keeps colours that few pixels have, such as those of a scale
    method = Image.Quantize.MAXCOVERAGE
    picture = picture.quantize(COLOURS, method, kmeans=2, dither=Image.Dither.NONE)
    picture.save(target, optimize=True)
    print(f"{target.relative_to(ROOT)}: {target.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    """Run what is drawn, and store its pictures beside the pages."""
    if not (ROOT / "demos").is_dir() or not (ROOT / "README.md").is_file():
        raise InputError("The pictures are made in the repository; run `make pictures` there.")
    environment = dict(os.environ, OMP_NUM_THREADS="1")
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)

        def run(*command: object) -> None:
            subprocess.run([sys.executable, *map(str, command)], check=True, cwd=place,
                           env=environment)  # fmt: skip

        readme = (ROOT / "README.md").read_text("utf-8")
        script = re.search(r"```python\n(.*?)```", readme, re.S)
        assert script is not None
        (place / "bender.py").write_text(script.group(1), "utf-8")
        run("bender.py")
        helix = place / "helix"
        run(ROOT / "demos/hdea_two_turn.py", "--mesh", 1, "--steps", 4, "--out", helix)
        film = place / "film"
        run(ROOT / "demos/snap_through.py", "--out", film)
        made = HERE / "pictures"
        made.mkdir(exist_ok=True)
        small(place / "results/bender/field_strength.png", made / "bender.png", 900)
        small(helix / "field_strength.png", made / "helix.png")
        small(film / "voltage_stretch.png", made / "snap_through.png", 800)


if __name__ == "__main__":
    install_hook()
    main()
