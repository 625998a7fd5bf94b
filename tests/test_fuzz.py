"""A small part of the random scenes and paths (tests/fuzz, `make fuzz` runs all of them)."""

from __future__ import annotations

from dataclasses import replace

import pytest
from conftest import needed_mpirun
from fuzz import branches, checks, paths
from fuzz.checks import check, clear
from fuzz.energy import NODES, SLOPE, WEIGHTS, Watch
from fuzz.ranks import on_two_ranks
from fuzz.scenes import drawn
from fuzz.sketch import read

pytestmark = pytest.mark.usefixtures("quick_compile")

SEED = 1
FEW = drawn(15, SEED, small=True)
"""Flat scenes of two models: few forms to compile."""

NAMES = [f"{k} {s.kinematics.name} {s.kind}" for k, s in enumerate(FEW)]


@pytest.mark.parametrize("number", range(len(FEW)), ids=NAMES)
def test_a_random_scene_holds_what_it_must(number):
    """If this fails: ``python -m tests.fuzz.physics --small --count 15 --only NUMBER``."""
    verdict = check(FEW[number])
    assert not verdict.found, f"{verdict.found}\n{FEW[number].text}"


@pytest.mark.mpi
def test_random_scenes_are_the_same_on_two_ranks():
    needed_mpirun()
    some = dict(enumerate(FEW[:4]))
    for number, found in on_two_ranks(some, 60).items():
        assert not found, f"{found}\n{FEW[number].text}"


@pytest.mark.parametrize("name, steps", [
    ("sheet", ((2,), (5,), (23,))),
    ("film over its pull in", ((1,), (4,), (11,))),
    ("gent film on a battery", ((1,), (7,), (20,))),
])  # fmt: skip
def test_a_path_near_an_instability_has_one_answer(name, steps):
    wrong = paths.faults(name, [paths.answer(name, n) for n in steps])
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("number, kind", list(enumerate(branches.KINDS)))
def test_a_random_trace_stays_on_its_branch(number, kind):
    """If this fails: ``python -m tests.fuzz.branches --trial NUMBER``."""
    outcome, _, words = branches.follow(kind, SEED, number)
    assert outcome == "stays", words


# ------------------------------------------------------------------------------- the harness


def test_a_sketch_survives_its_text():
    for sketch in drawn(25, 5):
        assert read(sketch.text) == sketch


def test_a_seed_draws_the_same_sketches_again():
    assert drawn(15, SEED, small=True) == FEW


def test_the_rule_is_exact_up_to_degree_seven():
    assert abs(WEIGHTS @ NODES**7 - 1 / 8) < 1e-15
    assert abs(SLOPE @ NODES**4 - 4 * NODES**3).max() < 1e-13


def test_what_is_no_sentence_is_told():
    assert clear("The voltage of electrode 'top' is nan, but must be a finite number.")
    assert not clear("<Vector object at 0x7f0> is no number in the scene that is given.")
    assert not clear("KeyError")


def test_work_that_is_not_energy_is_found(monkeypatch):
    """The harness itself: charges that are one per cent too small are seen."""
    usual = Watch.measure

    def wrong(self):
        found = usual(self)
        last = self.records[-1]
        self.records[-1] = replace(last, rates={n: 0.99 * r for n, r in last.rates.items()})
        return found

    sketch = next(s for s in FEW if check(s).status == "completed")
    monkeypatch.setattr(Watch, "measure", wrong)
    monkeypatch.setattr(checks, "ROUNDS", 2)
    assert "energy is not work" in dict(check(sketch).found)
