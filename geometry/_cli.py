"""Command lines of the device families: parameters in, .msh out, measures against closed form."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields
from typing import Any, NoReturn

from dea_fenicsx.support.errors import InputError

from . import _gmsh
from .base import Geometry, Layer


class MeshParser(argparse.ArgumentParser):
    """argparse, with one sentence for an unusable command line instead of the whole usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see --help.\n")


def value(text: str) -> Any:
    """A whole number where the text is one, else a float: the device itself judges which fits."""
    try:
        return int(text)
    except ValueError:
        with suppress(ValueError):
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not a number")


def values(text: str) -> tuple[Any, ...]:
    """One number for every direction, separated by commas."""
    return tuple(value(part) for part in text.split(","))


def parse_layer(text: str) -> Layer:
    """NAME:THICKNESS[:DIVISIONS][:electrode], thickness in metres."""
    parts = text.split(":")
    electrode = parts[-1] == "electrode" and len(parts) > 2
    if electrode:
        parts = parts[:-1]
    try:
        name, thickness, *rest = parts
        (divisions,) = rest or ["1"]
        return Layer(name, value(thickness), value(divisions), electrode=electrode)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).rstrip(".")) from error
    except (ValueError, argparse.ArgumentTypeError) as error:
        raise argparse.ArgumentTypeError(
            f"layer {text!r} can't be read; write NAME:THICKNESS[:DIVISIONS][:electrode] with the "
            "thickness in m"
        ) from error


def parameter_parser(
    module: str, summary: str, device: Callable[..., Geometry], about: Mapping[str, str]
) -> argparse.ArgumentParser:
    """A parser with one option for each number or word among the fields named in ``about``."""
    parser = MeshParser(prog=f"python -m {module}", description=summary)
    parser.add_argument("output", help="mesh file to write, ending in .msh")
    for field in fields(device):  # type: ignore[arg-type]
        if field.name not in about:
            continue
        needed = field.default is MISSING
        parser.add_argument(
            "--" + field.name.replace("_", "-"),
            type=str if isinstance(field.default, str) else value,
            required=needed,
            default=None if needed else field.default,
            help=about[field.name] + ("" if needed else " (default %(default)s)"),
        )
    parser.add_argument(
        "--refine", type=value, default=1, help="multiply all divisions (default %(default)s)"
    )
    return parser


def add_layers(parser: argparse.ArgumentParser) -> None:
    """The option that gives a stack its layers."""
    parser.add_argument(
        "--layer",
        dest="layers",
        action="append",
        type=parse_layer,
        default=[],
        metavar="NAME:THICKNESS[:DIVISIONS][:electrode]",
        help="a layer, thickness in m; repeat it from the bottom up",
    )


def run(
    parser: argparse.ArgumentParser,
    device: Callable[..., Geometry],
    arguments: list[str] | None,
) -> int:
    """Make the device, write the file, print its groups; the exit status."""
    chosen = vars(parser.parse_args(arguments))
    output, factor = chosen.pop("output"), chosen.pop("refine")
    try:
        made = device(**chosen).refine(factor)
        target = _gmsh.checked_path(output)
        with _gmsh.temporary_model(made.mesh(), type(made).__name__) as model:
            found = _gmsh.measure(model)
            quality = _gmsh.quality(model)
            nodes = len(model.mesh.getNodes()[0])
            _gmsh.write_current(target)
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    dim, exact = made.dimension, made.measures()
    cells = sum(number for d, number, _ in found.values() if d == dim)
    print(f"{target}: {nodes} nodes, {cells} cells, lengths in metres")
    print(
        f"cells: least scaled Jacobian {quality['least_scaled_jacobian']:.3f} (1 is a right "
        f"angle), longest over shortest edge up to {quality['largest_aspect']:.1f}"
    )
    print(f"{'group':<22}{'dim':>4}{'count':>8}{'measure':>15}{'closed form':>15}{'error':>10}")
    for name, (d, number, size) in sorted(found.items(), key=lambda item: -item[1][0]):
        off = size / exact[name] - 1
        print(f"{name:<22}{d:>4}{number:>8}{size:>15.6e}{exact[name]:>15.6e}{off:>10.1e}")
    return 0
