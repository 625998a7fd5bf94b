"""Random damage to files: flipped bits, lost ends, moved lines, other numbers and texts."""

from __future__ import annotations

import json
import random
import re
from typing import Any

NUMBERS = (
    "0", "-1", "1", "2147483648", "9223372036854775808", "-9223372036854775809", "1e308", "-1e308",
    "1e-320", "nan", "inf", "-inf", "0x10", "1_0", "1e999", "9" * 400, "", "x",
)  # fmt: skip
TEXTS = (
    "../../escaped", "/tmp/escaped", "..", ".", "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "$\\frac",
    "$x$ and $", "`touch pwned`", "$(touch pwned)", "'; import os; os.system('touch pwned')", '"',
    "'", ",", ";", "\r\n", "\0", "<", ">", "&", "]]>", "\u202e", "\ud83d\ude00", "=1+1", "%s%n{0}",
    "<!DOCTYPE x [<!ENTITY a 'b'>]>", "&a;", "a" * 3000, "{", "}", "[", "]", "null", "true",
    'SystemCall "touch pwned";', 'Include "/etc/passwd"', "$End", "$MeshFormat", ":/", "://",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, float("nan"), float("inf"), 10**30, "", "x",
    [], {}, [[]], {"a": 1}, [1, 2, 3], "nan", 1e-300, 3, 99,
)  # fmt: skip
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def encoded(text: str) -> bytes:
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace").encode("utf-8")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Data with one to four kinds of damage."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(KINDS)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if found:
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _chunk(data: bytes, rng: random.Random) -> bytes:
    """A stretch of bytes is lost, doubled, zeroed or random."""
    if not data:
        return data
    a = rng.randrange(len(data))
    b = min(len(data), a + rng.choice((1, 4, 16, 200, 2000)))
    put = rng.choice((b"", data[a:b] * 2, bytes(b - a), rng.randbytes(b - a), b"\xff" * (b - a)))
    return data[:a] + put + data[b:]


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _number(data: bytes, rng: random.Random) -> bytes:
    places = list(NUMBER.finditer(data[:200_000]))
    if not places:
        return data
    for place in sorted(rng.sample(places, min(len(places), rng.choice((1, 1, 2, 5)))),
                        key=lambda p: -p.start()):  # fmt: skip
        new = rng.choice((rng.choice(NUMBERS).encode(), rng.choice(places)[0]))
        data = data[: place.start()] + new + data[place.end() :]
    return data


def _text(data: bytes, rng: random.Random) -> bytes:
    """A text is put in, or takes the place of a word."""
    new = encoded(rng.choice(TEXTS))
    words = list(re.finditer(rb"[A-Za-z_]{2,}", data[:200_000]))
    if words and rng.random() < 0.7:
        word = rng.choice(words)
        return data[: word.start()] + new + data[word.end() :]
    a = rng.randrange(len(data) + 1)
    return data[:a] + new + data[a:]


KINDS = (_flip, _cut, _chunk, _lines, _number, _number, _text, _text)


def other_value(thing: Any, rng: random.Random) -> Any:
    """A copy of nested JSON with a value changed, lost or added somewhere."""
    thing = json.loads(json.dumps(thing))
    here = thing
    while True:
        if isinstance(here, dict) and here:
            key: Any = rng.choice(sorted(here))
        elif isinstance(here, list) and here:
            key = rng.randrange(len(here))
        else:
            return thing
        if isinstance(here[key], dict | list) and here[key] and rng.random() < 0.8:
            here = here[key]
            continue
        kind = rng.randrange(5)
        if kind == 0:
            del here[key]
        elif kind == 1 and isinstance(here, dict):
            here[rng.choice(TEXTS)] = rng.choice(VALUES)
        elif kind == 2 and isinstance(here[key], int | float):
            here[key] = here[key] * rng.choice((1 + 1e-6, 0.5, 2, -1)) + rng.choice((0, 1))
        else:
            here[key] = rng.choice((*VALUES, rng.choice(TEXTS)))
        return thing
