"""Write the table of the thesis's numbers and draw its curves."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from dea_fenicsx.support.errors import DeaError
from dea_fenicsx.thesis.table import STATUSES, collect, modules, write_csv, write_markdown


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m dea_fenicsx.thesis", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where to write")
    parser.add_argument("--no-pictures", action="store_true", help="the tables only")
    options = parser.parse_args(arguments)
    try:
        rows = collect()
        options.out.mkdir(parents=True, exist_ok=True)
        write_csv(rows, options.out / "thesis.csv")
        write_markdown(rows, options.out / "thesis.md")
        if not options.no_pictures:
            import matplotlib

            matplotlib.use("Agg")
            for module in modules():
                if hasattr(module, "draw"):
                    module.draw(options.out)
    except (DeaError, OSError) as error:
        print(f"thesis: {error}", file=sys.stderr)
        return getattr(error, "exit_status", 1)
    for status in STATUSES:
        print(f"{sum(row.status == status for row in rows):4d} {status}")
    print(f"written to {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
