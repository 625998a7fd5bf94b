"""Films in time against reference values, closed forms and balances of energy."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dea_fenicsx as dea
from dea_fenicsx.drives.waves import Rise, Sine, Square, Step, Table
from dea_fenicsx.exact import (
    Dead,
    Film,
    Held,
    charging_voltage,
    harvesting_cycle,
    instantaneous,
    leaked_charge,
    march,
    pull_in_map,
    relaxed,
    steady_cycle,
    trace,
)  # fmt: skip

G = 15.36e3
BRANCHES = [dea.Maxwell(26.06e3, 0.6074), dea.Maxwell(26.53e3, 6.56), dea.Maxwell(10.83e3, 61.25)]
VHB = dea.Material(
    dea.ArrudaBoyce(G, 5.99, form="pade"), dea.IdealDielectric(4.8), viscous=BRANCHES
)
FILM = Film(VHB, 1e-3)
UNIT = math.sqrt(G / FILM.permittivity)
"""Nominal field in V/m at e = 1."""


def with_branches(*branches, bulk_modulus=None):
    made = [dea.Maxwell(*b) for b in branches]
    return Film(dea.Material(VHB.elastic, VHB.electric, bulk_modulus, viscous=made), 1e-3)


@pytest.mark.parametrize(("rate", "field", "stretch"), [
    (0.016, 1.109476, 1.518227), (1.6, 1.508249, 1.282547),
])  # fmt: skip
def test_ramps(rate, field, stretch):
    """Reference: two independent computations, all printed digits."""
    course = march(FILM, 1.6 / rate, field=Rise(1.6 * UNIT, 1.6 / rate))
    assert course.pull_in_field / UNIT == pytest.approx(field, abs=6e-7)
    assert course.pull_in_stretch == pytest.approx(stretch, abs=6e-7)
    assert course.pull_in_time == pytest.approx(course.pull_in_field / UNIT / rate, rel=1e-12)


@pytest.mark.parametrize(("field", "at_0", "seconds", "stretch"), [
    (0.75, 1.0203304, 417.974, 1.892431),
    (0.90, 1.0309709, 75.208, 1.707944),
    (1.20, 1.0657925, 6.4930, 1.456628),
])  # fmt: skip
def test_creep(field, at_0, seconds, stretch):
    course = march(FILM, 1000, field=field * UNIT)
    assert course.stretch_at_0 == pytest.approx(at_0, abs=6e-8)
    assert course.pull_in_time == pytest.approx(seconds, abs=6e-4 if seconds > 10 else 6e-5)
    assert course.pull_in_stretch == pytest.approx(stretch, abs=6e-7)


def test_limits():
    slow, fast = (trace(f(FILM)).event("pull-in") for f in (relaxed, instantaneous))
    assert slow.voltage / 1e-3 / UNIT == pytest.approx(0.69519, abs=6e-6)
    assert fast.voltage / 1e-3 / UNIT == pytest.approx(1.56015, abs=6e-6)


def test_marches_approach_the_limits():
    """A jump beyond the instantaneous limit loses equilibrium there; the slow one as rate^(2/3)."""
    fast = trace(instantaneous(FILM)).event("pull-in")
    course = march(FILM, 1.0, field=2 * UNIT)
    assert course.pull_in.in_jump and course.pull_in_time == 0
    assert course.pull_in.voltage == pytest.approx(fast.voltage, rel=1e-11)
    slow = trace(relaxed(FILM)).event("pull-in").voltage / 1e-3 / UNIT
    above = [
        march(FILM, s, field=Rise(1.2 * UNIT, s)).pull_in_field / UNIT - slow for s in (1e8, 1e10)
    ]
    assert math.log(above[0] / above[1]) / math.log(1e2) == pytest.approx(2 / 3, abs=0.01)


def test_ten_digits_whatever_the_tolerance():
    a, b = (march(FILM, 100, field=1.2 * UNIT, tolerance=tol) for tol in (1e-11, 1e-13))
    assert a.pull_in_time == pytest.approx(b.pull_in_time, rel=1e-10)
    assert a.pull_in_stretch == pytest.approx(b.pull_in_stretch, rel=1e-10)


def test_held_stretch_against_the_branch_equation():
    """Equal-biaxial at a held stretch 2: dc/dt = (lam^2 - c^3 lam^-4)/(3 tau) for each branch."""
    held = Film(VHB, 1e-3, first=Held(2.0), second=Held(2.0))
    course = march(held, 30.0)
    for k, branch in enumerate(BRANCHES):
        one = solve_ivp(
            lambda t, c, tau=branch.tau: (4 - c**3 / 16) / (3 * tau), (0, 30), [1.0],
            method="DOP853", rtol=1e-13, atol=1e-13, t_eval=[1.0, 30.0],
        )  # fmt: skip
        assert course.at([1.0, 30.0]).viscous[k, 0] == pytest.approx(one.y[0], rel=1e-11)


def test_small_strain_relaxes_exponentially():
    small = 1 + 1e-6
    film = Film(VHB, 1e-3, first=Held(small))
    moments = march(film, 10.0).at([0.0, 3.0, 10.0])
    E = 3 * VHB.elastic.shear_modulus()  # uniaxial, incompressible
    due = [
        1e-6 * (E + sum(3 * b.mu * math.exp(-t / b.tau) for b in BRANCHES)) for t in moments.time
    ]
    assert moments.stress[0] == pytest.approx(due, rel=1e-5)


@pytest.mark.parametrize(("film", "drive"), [
    (FILM, {"field": Step(0.8 * UNIT, at=2.0, low=0.3 * UNIT)}),
    (FILM, {"field": Square(0.5, 0.5 * UNIT)}),
    (FILM, {"charge": Step(1e-3, at=1.0)}),
    (Film(VHB, 1e-3, first=Held(1.0)), {"sides": (Table([0, 5, 9], [1, 2, 1.2]), None)}),
    (Film(VHB, 1e-3, first=Dead(3e3)), {"field": Sine(0.3, 0.4 * UNIT)}),
    (Film(VHB, 1e-3, second=Held(1.0)), {"field": 0.9 * UNIT}),
    (with_branches((3e4, 2.0), bulk_modulus=2e6), {"field": Rise(0.8 * UNIT, 4.0)}),
    (with_branches(), {"field": Rise(1.2 * UNIT, 9.0)}),
    (with_branches((2e4, math.inf)), {"field": Rise(2 * UNIT, 9.0)}),
    (with_branches((2e4, 1e-5)), {"field": Rise(0.5 * UNIT, 9.0)}),
    (with_branches((1000 * G, 5.0)), {"field": Rise(UNIT, 4.0)}),
    (with_branches((2e4, 0.1), (2e4, 10.0)), {"field": lambda t: UNIT * math.tanh(t / 9)}),
])  # fmt: skip
def test_balance_and_dissipation(film, drive):
    """Work in is stored or dissipated, whatever is driven; no branch dissipates less than 0."""
    course = march(film, 9.0, **drive)
    balance = course.balance()
    size = np.abs(balance.stored).max() + balance.dissipated[-1]
    assert np.abs(balance.gap).max() < 1e-9 * size
    assert course.sampled().dissipation.min(initial=0.0) >= 0
    assert np.all(np.diff(balance.dissipated) >= -1e-14 * size)


def test_a_stiff_branch_and_a_slow_one_are_what_they_stand_for():
    """tau to 0: no branch at all, but for 3 mu tau dots; infinite tau: a spring more."""
    none, quick = with_branches(), with_branches((2e4, 1e-7))
    drive = {"field": Rise(0.6 * UNIT, 10.0)}
    a, b = march(none, 10.0, **drive), march(quick, 10.0, **drive)
    assert a.stretch(10.0) == pytest.approx(b.stretch(10.0), rel=1e-7)
    spring = with_branches((2e4, math.inf))
    found = march(spring, 10.0, field=Rise(2 * UNIT, 10.0)).pull_in
    due = trace(instantaneous(spring)).event("pull-in")
    assert found.voltage == pytest.approx(due.voltage, rel=1e-10)
    assert found.stretches == pytest.approx(due.stretches, rel=1e-10)


def test_a_film_at_rest_stays_at_rest():
    pre = relaxed(FILM).prestretched(3.0, 3.0)
    film = Film(VHB, 1e-3, pre.first, pre.second)
    course = march(film, 50.0, start="relaxed")
    assert np.ptp(course.stretch(np.linspace(0, 50, 9))) < 1e-12
    assert course.stretch(0.0) == pytest.approx(3.0, rel=1e-12)


def test_stages_follow_one_another():
    """One march, or two of which the second goes on from the first."""
    wave = Table([0, 4, 10], [0, 0.8 * UNIT, 0.2 * UNIT])
    whole = march(FILM, 10.0, field=wave)
    first = march(FILM, 4.0, field=wave)
    second = march(FILM, 6.0, field=Table([0, 6], [0.8 * UNIT, 0.2 * UNIT]), start=first)
    assert second.stretch(6.0) == pytest.approx(whole.stretch(10.0), rel=1e-11)


def test_steady_cycles():
    course = steady_cycle(FILM, 1.0, field=Sine(1.0, 0.3 * UNIT, 0.3 * UNIT))
    ends = course.at([0.0, 1.0])
    assert np.ptp(ends.viscous, axis=2).max() < 1e-10
    balance = course.balance()
    assert abs(balance.stored[-1]) < 1e-9 * balance.electric_work[-1]
    assert balance.dissipated[-1] == pytest.approx(balance.electric_work[-1], rel=1e-9)


def test_small_steady_cycle_against_the_loss_modulus():
    """Uniaxial strain a sin(w t): loss per cycle pi a^2 3 mu w tau/(1 + (w tau)^2) per branch."""
    amplitude, hertz = 1e-4, 0.2
    film = Film(VHB, 1e-3, first=Held(1.0))
    wave = Sine(hertz, amplitude, 1.0)
    lost = steady_cycle(film, 1 / hertz, sides=(wave, None)).balance().dissipated[-1]
    w = 2 * math.pi * hertz
    due = sum(3 * b.mu * w * b.tau / (1 + (w * b.tau) ** 2) for b in BRANCHES)
    assert lost == pytest.approx(math.pi * amplitude**2 * due, rel=1e-5)


def test_map_against_marches_and_in_time():
    held = np.linspace(0.6, 1.6, 50)[:, None] * UNIT
    rate = np.geomspace(1e-4, 10, 50) * UNIT
    begin = time.process_time()
    found = pull_in_map(FILM, held, rate, seconds=1e4)
    assert time.process_time() - begin < 10  # of one core, whatever else it does
    for i, j in ((30, 30), (12, 25)):
        seconds = found.held[i, j] / found.rate[i, j]
        course = march(FILM, 1e4, field=Rise(found.held[i, j], seconds))
        assert found.time[i, j] == pytest.approx(course.pull_in_time, rel=1e-8)
        assert found.stretch[i, j] == pytest.approx(course.pull_in_stretch, rel=1e-8)
    below = found.held < trace(relaxed(FILM)).event("pull-in").voltage / 1e-3
    assert np.all(np.isinf(found.time[below]))


def test_map_of_switched_fields_and_held_sides():
    found = pull_in_map(FILM, np.array([0.6, 0.9, 1.2, 2.0]) * UNIT, seconds=1000)
    assert found.time == pytest.approx([np.inf, 75.20848630, 6.49301876, 0.0], rel=1e-8)
    loaded = FILM.prestretched(1.3, 1.3)
    found = pull_in_map(loaded, 0.6 * UNIT, 0.1 * UNIT, seconds=1000, start="relaxed")
    course = march(loaded, 1000, field=Rise(0.6 * UNIT, 6.0), start="relaxed")
    assert found.time == pytest.approx(course.pull_in_time, rel=1e-8)
    assert found.stretch == pytest.approx(course.pull_in_stretch, rel=1e-8)
    # a film with a held side only grows longer
    held = Film(VHB, 1e-3, second=Held(1.0))
    assert np.isinf(pull_in_map(held, 0.9 * UNIT, seconds=100).time)


def test_charge_in_closed_form():
    """A leaking film: its charge decays as it creeps, and the film comes back to rest."""
    g, eps, q0 = 1e-12, FILM.permittivity, 5e-4
    course = march(FILM, 200.0, charge=lambda t: leaked_charge(q0, t, g, eps))
    assert course.at(40.0).charge == pytest.approx(q0 * math.exp(-g * 40 / eps), rel=1e-13)
    assert charging_voltage(5e3, 2.0, 1e9, 2e-9) == pytest.approx(5e3 * (1 - math.exp(-1)))
    cycle = harvesting_cycle(VHB, 1.5, 3.0, 0.05 * UNIT)
    due = 0.05**2 / 2 * 3**4 * (2**4 - 1)
    assert cycle.energy / G == pytest.approx(due, rel=1e-13)
    assert cycle.energy_through_resistor / G == pytest.approx(due - 0.05**2 / 2 * 81, rel=1e-13)
    # the same by the work between the states of the film
    low, high = cycle.true_fields[1], cycle.true_fields[0]
    assert cycle.energy == pytest.approx(eps / 2 * (low**2 - high**2), rel=1e-12)


@pytest.mark.parametrize(("call", "words"), [
    (lambda: march(FILM, -1.0), "must last a finite time"),
    (lambda: march(FILM, 9.0, field=Table([0, 5], [0, 1])), "ends at 5 s"),
    (lambda: march(FILM, 9.0, field=Table([1, 9], [0, 1])), "begins at 1 s"),
    (lambda: march(FILM, 9.0, field=Table([0, 5, 3], [0, 1, 2])), "run backwards"),
    (lambda: march(FILM, 9.0, field=1.0, voltage=1.0), "takes one of them"),
    (lambda: march(FILM, 9.0, field="high"), "must be a number, a wave"),
    (lambda: march(Film(VHB, 1e-3, first=Held(1.0)), 9.0, sides=(Rise(-1, 9, low=1), None)), "> 0"),
    (lambda: march(FILM, 9.0, start="rested"), "must be"),
    (lambda: trace(FILM), "say which response"),
    (lambda: with_branches((1e3, -1.0)), "tau"),
    (lambda: with_branches((-1e3, 1.0)), "mu"),
    (lambda: pull_in_map(Film(VHB, 1e-3, first=Dead(1.0)), 1e6, seconds=1), "one free stretch"),
    (lambda: march(FILM, 9.0, field=UNIT).at(10.0), "the course goes from 0"),
])  # fmt: skip
def test_bad_input(call, words):
    with pytest.raises(dea.InputError, match=words):
        call()
