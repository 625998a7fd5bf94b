"""Drives that cannot serve are refused before a march: too fast ones, and functions that fail."""

import math

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.drives import trial
from dea_fenicsx.drives.trial import MANY_LANDINGS, check_pace
from dea_fenicsx.drives.waves import Function, Wave
from dea_fenicsx.path.path_checks import check_path
from dea_fenicsx.path.step_lengths import is_among, next_after, tell_landings
from dea_fenicsx.support.errors import InputError

MANY = np.linspace(0, 1, 1500)


@pytest.fixture(scope="module")
def scene():
    film = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
    plates = [dea.Electrode("top", 100.0), dea.Ground("bottom")]
    return dea.Scene(block((1, 1, 1)), {"film": film}, plates, [dea.Clamp("bottom")])


def refusal(scene, drive, **options):
    with pytest.raises(InputError) as refused:
        check_path(scene, [dea.March(1.0, {"voltage": drive}, **options)])
    words = str(refused.value)
    assert len(words) <= 400 and "\n" not in words and words.endswith(".")
    return words


@pytest.mark.parametrize(
    ("drive", "steps", "corners"),
    [
        (dea.Square(1e5), "3.2e+06", "2e+05"),
        (dea.Triangle(1e5), "3.2e+06", "2e+05"),
        (dea.Sine(1e6), "3.2e+07", "0"),
        (dea.Chirp(1.0, 1e6, 0.5), "3.2e+07", "0"),
        (dea.Square(1e308), "inf", "inf"),
    ],
)
def test_waves_of_too_many_steps_are_refused(scene, drive, steps, corners):
    words = refusal(scene, drive)
    assert f"needs at least {steps} steps for 1 s, of which {corners} end at its corners" in words
    assert "lower frequency (in Hz)" in words


@pytest.mark.parametrize(
    "drive", [dea.Table(MANY, np.zeros(len(MANY))), Function(math.sin, tuple(MANY))]
)
def test_too_many_rows_are_refused(scene, drive, monkeypatch):
    check_path(scene, [dea.March(1.0, {"voltage": drive})])
    monkeypatch.setattr(trial, "MOST_STEPS_OF_MARCH", 1000)
    assert "needs at least 1.5e+03 steps for 1 s" in refusal(scene, drive)


def test_only_corners_count_where_steps_are_fixed(scene):
    check_path(scene, [dea.March(1.0, {"voltage": dea.Sine(1e6)}, steps=100)])
    assert "2e+06 end at its corners" in refusal(scene, dea.Square(1e6), steps=100)


def test_corners_are_counted_as_they_are_listed():
    for wave in (dea.Square(3.3, phase=0.2), dea.Triangle(7.0), dea.Table([0, 1, 2], [0, 1, 0])):
        listed = len(wave.corners(0.0, 1.7))
        assert abs(wave.number_of_corners(0.0, 1.7) - listed) <= 2
        check_pace({"it": wave}, 1.7)


def fails(t):
    raise KeyError("a key\nof two lines" + 200 * "x")


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (fails, "fails at 0 s (KeyError: "),
        (lambda: 1.0, "fails at 0 s (TypeError: "),
        (lambda t: math.nan, "gives nan at 0 s"),
        (lambda t: np.array([t]), "gives array([0.]) at 0 s"),
        (lambda t: 1j * t, "gives 0j at 0 s"),
        (lambda t: None, "gives None at 0 s"),
        (lambda t: math.log(0.8 - t), "fails at 0.8125 s (ValueError: "),
    ],
)
def test_a_function_is_tried_before_the_march(scene, function, words):
    assert words in refusal(scene, function)


def test_a_function_that_fails_later_is_told_in_the_same_words():
    wave = Function(lambda t: 1 / (t - 0.3))
    assert wave(0.2) == pytest.approx(-10.0)
    with pytest.raises(InputError, match=r"fails at 0.3 s \(ZeroDivisionError: "):
        wave(0.3)


def test_a_wave_of_a_user_is_tried_too(scene):
    class Mine(Wave):
        def __call__(self, t):
            return [t]

    assert "The drive of 'voltage' at 0 s is [0.0]" in refusal(scene, Mine())


def test_many_landings_are_told_and_found_quickly():
    told = []
    stops = list(np.linspace(0, 1, MANY_LANDINGS + 1)[1:])
    tell_landings(stops, 1.0, told.append)
    tell_landings(stops[-5:], 1.0, told.append)
    assert len(told) == 1 and f"at least {MANY_LANDINGS} steps for 1 s" in told[0]
    assert next_after(stops, 0.5, 1e-12) == pytest.approx(0.5001)
    assert is_among(stops, 0.5 + 1e-13, 1e-12) and not is_among(stops, 0.50005, 1e-12)
    assert not is_among([], 0.5, 1e-12)


def test_a_film_in_closed_form_refuses_them_too():
    film = dea.exact.Film(dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0)), 1e-4)
    with pytest.raises(InputError, match="steps for 1 s"):
        dea.exact.march(film, 1.0, field=dea.Square(1e6))
