"""What a checkpoint tells of time: right or refused, whatever stands in it."""

import itertools

import pytest

from dea_fenicsx.results.moment import NO_MOMENT, ChargeMoment, MomentInTime, moment_told

RIGHT = {"now": 2.0, "times": [2.0, 1.0], "span": 0.0, "rule": "BDF2", "charge": None}
CHARGE = {"times": [2.0, 1.0], "wires": [[1e-9, -1e-9], [0.0, 0.0]], "closed": [True, False]}
WRONG = (None, [], {}, ["1"], {"a": 1}, "x", float("nan"), float("inf"), True, [[]], [None], -1.0)


def test_a_right_one_is_read():
    assert moment_told(None) == NO_MOMENT
    assert moment_told(RIGHT) == MomentInTime(2.0, (2.0, 1.0))
    old = {name: value for name, value in RIGHT.items() if name != "charge"}
    assert moment_told(old) == MomentInTime(2.0, (2.0, 1.0))
    both = moment_told(RIGHT | {"charge": CHARGE})
    assert both is not None
    assert both.charge == ChargeMoment((2.0, 1.0), ((1e-9, -1e-9), (0.0, 0.0)), (True, False))


@pytest.mark.parametrize(("name", "value"), itertools.product(RIGHT, WRONG))
def test_a_wrong_entry_raises_nothing(name, value):
    """Lists and dictionaries cannot be looked up in a set, so that they need a look before."""
    found = moment_told(RIGHT | {name: value})
    allowed = (name == "times" and value == []) or (name == "charge" and value is None)
    allowed |= name in ("now", "span") and value in (-1.0, float("inf")) and found is not None
    assert found is None or allowed


@pytest.mark.parametrize(("name", "value"), itertools.product(CHARGE, WRONG))
def test_a_wrong_entry_of_the_charges_raises_nothing(name, value):
    assert moment_told(RIGHT | {"charge": CHARGE | {name: value}}) is None
