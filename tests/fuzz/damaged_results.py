"""Damage to one file of a results folder, or to a mesh: of its bytes, or of what it tells."""

from __future__ import annotations

import contextlib
import json
import random
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from dea_fenicsx.results.checkpoint import digest
from tests.fuzz.damage import NUMBERS, TEXTS, damaged, other_value


def in_file(*names: str) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, rng: random.Random) -> None:
        file = folder / rng.choice(names)
        file.write_bytes(damaged(file.read_bytes(), rng))

    return damage


def in_summary(folder: Path, rng: random.Random) -> None:
    file = folder / "whole" / "summary.json"
    if rng.random() < 0.3:
        return in_file("whole/summary.json")(folder, rng)
    told = json.loads(file.read_text())
    for _ in range(rng.choice((1, 2, 5, 30))):
        told = other_value(told, rng)
    file.write_text(json.dumps(told))


def in_xdmf(folder: Path, rng: random.Random) -> None:
    """Bytes, or well-formed XML with another attribute, text or element."""
    if rng.random() < 0.3:
        return in_file("whole/fields.xdmf")(folder, rng)
    file = folder / "whole" / "fields.xdmf"
    tree = ET.parse(file)
    elements = list(tree.getroot().iter())
    for _ in range(rng.choice((1, 1, 3))):
        one, other = rng.choice(elements), rng.choice(elements)
        new = "".join(c for c in rng.choice((*TEXTS, *NUMBERS)) if c >= " ")
        kind = rng.randrange(5)
        if kind == 0 and one.attrib:
            one.set(rng.choice(sorted(one.attrib)), new)
        elif kind == 1 and one.attrib:
            del one.attrib[rng.choice(sorted(one.attrib))]
        elif kind == 2:
            one.text = other.text
        elif kind == 3 and len(one):
            one.remove(one[rng.randrange(len(one))])
        else:
            name, _, where = (one.text or "").strip().partition(":")
            one.text = rng.choice((f"{new}:{where}", f"{name}:{new}", new, f"../{name}:{where}"))
    tree.write(file)
    return None


def in_hdf5(folder: Path, rng: random.Random) -> None:
    """Bytes, or a good file that holds something else under one of its names."""
    file = folder / "whole" / "fields.h5"
    if rng.random() < 0.3:
        return in_file("whole/fields.h5")(folder, rng)
    if rng.random() < 0.5:  # few bits only, so that more of it is read
        raw = bytearray(file.read_bytes())
        for _ in range(rng.choice((1, 3))):
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        file.write_bytes(raw)
        return None
    with h5py.File(file, "a") as h5:
        names: list[str] = []
        h5.visit(names.append)
        name = rng.choice(names)
        old = h5[name][()] if isinstance(h5[name], h5py.Dataset) else np.zeros((3, 3))
        del h5[name]
        kind = rng.randrange(8)
        if kind == 0:
            h5[name] = h5py.ExternalLink("/etc/passwd", "/")
        elif kind == 1:
            h5[name] = h5py.SoftLink("/" + rng.choice(names))
        elif kind == 2:
            h5.create_dataset(name, (1 << 20, 1 << 10), "f8", chunks=(1024, 1024), fillvalue=1.0)
        elif kind == 3:
            h5.create_dataset(name, (64,), "f8", external=[("/etc/hostname", 0, 512)])
        elif kind == 4:
            h5[name] = rng.choice(("text", [b"a", b"b"], 7, np.zeros((0, 3)), np.zeros(3)))
        elif kind == 5:
            h5[name] = (old * rng.choice((-1, 1e9, np.nan))).astype(old.dtype)
        elif kind == 6:
            h5[name] = rng.choice((old[:-1], old[..., :-1], old.ravel(), old.astype("c16")))
        elif kind == 7:
            h5.create_dataset(name, (10**15,), "f8", chunks=(1024,), compression="gzip")
    return None


def in_checkpoint(folder: Path, rng: random.Random) -> None:
    """Bytes, or a well-formed file that tells something else, sealed anew or not."""
    if rng.random() < 0.2:
        return in_file("cut/checkpoint.npz")(folder, rng)
    file = folder / "cut" / "checkpoint.npz"
    with np.load(file) as data:
        state, told = data["state"], json.loads(str(data["told"]))
        earlier = data.get("earlier")
    if rng.random() < 0.15:
        state = state.copy()
        state.flat[rng.randrange(state.size)] *= rng.choice((0.9, 2, -1, np.nan, np.inf))
    elif rng.random() < 0.1:
        state = rng.choice((state[:-1], state.astype("f4"), state.ravel(), state.astype("c16")))
    else:
        for _ in range(rng.choice((1, 1, 3))):
            told = other_value(told, rng)
    text = json.dumps(told)
    more = {} if earlier is None else {"earlier": earlier}
    if more and rng.random() < 0.1:
        earlier = rng.choice((earlier[:-1], earlier[0], earlier * np.nan, earlier.astype("c16")))
        more["earlier"] = earlier
    if rng.random() < 0.8:
        with contextlib.suppress(TypeError, ValueError):
            more["digest"] = digest(state, text, earlier)
    with contextlib.suppress(UnicodeEncodeError):
        np.savez(file, state=state, told=text, **more)
    return None


def in_mesh(kind: str) -> Callable[[Path, random.Random], None]:
    def damage(folder: Path, rng: random.Random) -> None:
        other = {"ascii": "binary", "binary": "ascii"}[kind]
        (folder / "mesh" / f"{other}.msh").unlink()
        in_file(f"mesh/{kind}.msh")(folder, rng)

    return damage
