"""A part of the table of hard cases (tests/hard, `make hard` runs all of it)."""

from __future__ import annotations

import pytest
from hard import (  # noqa: F401  (each enters its cases)
    air,
    cavities,
    contacts,
    devices,
    films,
    marches,
    mechanisms,
    motions,
    repeating,
    runs,
)
from hard.table import CASES, passed, verdict

pytestmark = pytest.mark.usefixtures("quick_compile")

# All films are neo-Hookean or Gent discs: two kernels, both small.
PART = [
    "zero voltage",
    "reversed polarity",
    "load reversed half-way",
    "voltage step ten times too long",
    "voltage beyond pull-in",
    "arc length over pull-in",
    "a ramp to the present value",
    "several ramps at once",
    "stretch 4 x 4 in one go",
    "Gent at 99 % of lock-up in one go",
    "Gent pulled by a dead load of 100 moduli",
    "eps_r = 1000",
    "size 1e-06 m, shear modulus 1e+09 Pa",
    "needle cells, 1 : 10000",
    "layers 1 : 1000 thin",
    "augmentation 10000",
    "two electrodes at different voltages",
    "Newton's tolerance at rounding",
    "a folded quadrilateral",
    "an inverted tetrahedron",
    "rigid motion: a film on a table in space",
    "resuming after pull-in",
    "resuming from a broken checkpoint",
    "cavity: gas that leaks to zero",
    "cavity: outside pressure of a million moduli",
    "cavity: liquid between walls that cannot move",
    "march: a relaxation time that is infinite",
    "march: a branch 1000 times stiffer than the equilibrium",
    "march: a square wave, which jumps",
    "march: a table with a jump, and rows close together",
    "march: pull-in within the first step",
    "march: steps of backward Euler against the same recurrence",
    "march: relaxed before, then creep",
    "march: resumed in its midst",
    "periodic: a mean strain of 4 in one go",
    "periodic: both faces held, and free to strain",
    "mechanism: gravity without density",
    "motion: free flight over a thousand sizes of the body",
    "motion: time steps a thousand times too long",
    "motion: time steps a thousand times too long, conserving energy",
    "motion: a voltage step ten times pull-in, in fixed steps",
    "motion: more modes than unknowns",
    "mechanism: a rigid part on one facet",
    "mechanism: a spring of zero length",
    "obstacle: a tenth of the layer deep in it at the start",
    "friction: to and fro three times",
]


@pytest.mark.parametrize("name", PART)
def test_a_hard_case_ends_as_it_must(name):
    case = CASES[name]
    ended, message = verdict(case)
    assert passed(case, ended, message), f"{ended} instead of {case.expected}: {message}"


def test_the_table_holds_what_it_must():
    assert len(CASES) >= 60
    assert {case.expected for case in CASES.values()} == {
        "completed", "equilibrium lost", "refused", "solver failed", "not reached",
    }  # fmt: skip


def test_a_wrong_answer_is_told():
    """The harness itself: an assertion in a case is a verdict, and never passes."""
    from hard.table import COMPLETED, Case, close

    it = Case("wrong", COMPLETED, "", lambda: close(1.0, 2.0))
    ended, message = verdict(it)
    assert ended == "wrong answer" and "off by" in message and not passed(it, ended, message)
