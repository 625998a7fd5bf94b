"""More ranks than cells, and ranks that meet different things: same results, or one sentence."""

from __future__ import annotations

import math

import pytest
import rank_scenes


def close(a, b):
    """The same but for rounding; a zero is what is small against 1 in SI units of the scenes."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(close(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(close, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b)) or math.isclose(
            a, b, rel_tol=1e-8, abs_tol=1e-15)  # fmt: skip
    return a == b


@pytest.fixture(scope="module")
def alone():
    from mpi4py import MPI

    return rank_scenes.on(MPI.COMM_SELF, rank_scenes.ON_TWO + rank_scenes.ON_THREE)


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize(("function", "ranks"), [("on_two_ranks", 2), ("on_three", 3)])
def test_more_ranks_than_cells(alone, on_ranks, function, ranks):
    """Every kinematics and cell: histories equal to those on one rank, resumed runs, too."""
    found = on_ranks("rank_scenes", function, ranks)
    for name, what in found.items():
        assert isinstance(what, dict), f"{name}: {what}"
        assert close(what, alone[name]), (name, what, alone[name])
        assert what["status"] == "completed"


# what both ranks raise, and words of its message; or a value
OTHER = "OtherRankFailed"
ALIKE = "a value must be the same on all ranks"
INPUT = "The ranks of this run have been given different input: "
DIFFERENCES = {
    "nan on rank 1": ("SolverError", f"'mine' is 1 on rank 0, but nan on rank 1; {ALIKE}"),
    "inf on rank 0": ("SolverError", f"'mine' is inf on rank 0, but 1 on rank 1; {ALIKE}"),
    "nan on both": ("SolverError", "mine is nan"),
    "nothing": ("SolverError", "'mine' is None on rank 1, but must be a number."),
    "a part of each": ("SolverError", f"'mine' is 1 on rank 0, but 2 on rank 1; {ALIKE}"),
    "rounding": 1.0,
    "bad input": ("InputError", "Not here."),
    "a solver's error": ("SolverError", "Not here."),
    "a slip": ((OTHER, "KeyError"), "What is recorded as 'mine' failed on rank 1 (KeyError: 'x')."),
    "a slip on both": ("KeyError", "'x'"),
    "other volts": ("InputError", f"{INPUT}electrodes has volts=5000.0 on rank 0, but volts=5001"),
    "another order": ("InputError", f"{INPUT}electrodes has where='top' on rank 0, but where='bot"),
    "results on one": ("InputError", f"{INPUT}out has PosixPath on rank 0, but None on rank 1"),
    "another record": ("InputError", f"{INPUT}record has 'top': Charge on rank 0, but 'bottom': C"),
    "other steps": ("InputError", f"{INPUT}path has steps=1 on rank 0, but steps=2 on rank 1"),
    "a geometry": (("RuntimeError", OTHER), "The mesh of Odd failed on rank 0 (RuntimeError: no s"),
    "a failure": (("KeyError", OTHER), "The failure 'stretch limit' failed on rank"),
    "ramps": True,
}


@pytest.mark.mpi
def test_what_one_rank_meets_alone(on_ranks):
    """Both ranks end alike, each with an error that tells why; and nothing hangs."""
    found = on_ranks("rank_differences", "differences", 2)
    assert found.keys() == DIFFERENCES.keys()
    for case, wanted in DIFFERENCES.items():
        if not isinstance(wanted, tuple):
            assert found[case] == [wanted, wanted] + ["completed"] * (case == "rounding"), case
            continue
        kinds, words = wanted
        both = [kinds, kinds] if isinstance(kinds, str) else sorted(kinds)
        told = found[case][:2]
        assert sorted(kind for kind, _ in told) == both, (case, told)
        assert any(words in text for _, text in told), (case, told)
        if "SolverError" in both:
            assert found[case][2] == "solver failed"
