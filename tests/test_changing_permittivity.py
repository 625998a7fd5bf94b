"""Exact states of dielectrics that change, against the energy whose stationary points they are."""

import numpy as np
import pytest
from numpy.polynomial import legendre

import dea_fenicsx as dea
from dea_fenicsx import exact, materials
from dea_fenicsx.design import HelicalModel
from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.materials.dielectric_series import FilmPoint
from dea_fenicsx.materials.stretches import taylor

MU, EPS, H = 50e3, 4.7, 1e-3
LAWS = {
    "constant": dea.IdealDielectric(EPS),
    "linear": materials.LinearPermittivity(EPS, -0.04, 2.5),
    "electrostriction": materials.Electrostriction(EPS, -1.5),
    "ln cosh": materials.SaturatingDielectric(EPS, 3e-3),
}
"""Dielectrics; the last one saturates, and its permittivity falls with the field."""


def rubber(law, **options):
    return dea.Material(dea.Gent(MU, 30.0), LAWS[law], **options)


def energies(material, e, field):
    """Elastic energy less co-energy, per volume, of logarithmic stretches and true fields."""
    electric = material.dielectric.in_si().coenergy(FilmPoint(e, field)).c[0]
    return taylor(material.elastic, e)[0] - electric


def slope(function, x, h):
    """Derivative by four values."""
    values = [function(x + k * h) for k in (-2, -1, 1, 2)]
    return (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)


@pytest.mark.parametrize("law", LAWS)
def test_the_flux_through_a_curved_layer_is_uniform(law):
    e = np.log(np.array([[1.1, 1.3, 1.5], [1.0, 1.0, 1.0], [1 / 1.1, 1 / 1.3, 1 / 1.5]]))
    lengths, areas = np.array([0.3, 0.4, 0.3]) * H, np.array([1.0, 1.4, 2.0])
    field = FilmField(LAWS[law])
    for volts in (0.0, 10.0, -2e4, 6e4):
        E = field.through(e, lengths, areas, volts)
        flux = areas * field.displacement(e, field.maxwell(e, E))
        assert lengths @ E == pytest.approx(volts, rel=1e-13)
        assert flux == pytest.approx(flux.mean() * np.ones(3), rel=1e-12)
    if law == "ln cosh":
        assert np.isnan(field.through(e, lengths, areas, 1e6)).any()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("across", ["held", "uniform"])
def test_a_bent_strip_is_stationary(law, across):
    active, passive = rubber(law), dea.Material(dea.NeoHookean(2 * MU))
    plies = [exact.Ply(passive, 0.4e-3), exact.Ply(active, 0.6e-3, driven=True)]
    volts = 1.2e4
    state = exact.bend(plies, [0.4 * volts, volts], across)[-1]
    points, weights = legendre.leggauss(20)

    def energy(change):
        b, k, a = np.exp(np.array([np.log(state.bottom), 0, np.log(state.across)]) + change[:3])
        k = state.angle_per_length + change[1] / H
        total, low = 0.0, 0.0
        for ply in plies:
            w, Z = weights * ply.thickness / 2, low + ply.thickness * (1 + points) / 2
            lam = np.sqrt(b * b + 2 * k * Z / a)
            e = np.log(np.stack([lam, a + 0 * lam, 1 / (lam * a)]))
            if ply.driven:
                field = FilmField(ply.material.dielectric).through(e, w / (lam * a), lam, volts)
                total += w @ energies(ply.material, e, field)
            else:
                total += w @ taylor(ply.material.elastic, e)[0]
            low += ply.thickness
        return total / (MU * H)

    free = np.eye(3)[: 2 + (across == "uniform")]
    assert state.angle_per_length > 1.0
    for direction in free:
        assert abs(slope(lambda s, d=direction: energy(s * d), 0.0, 1e-3)) < 1e-9


@pytest.mark.parametrize("law", LAWS)
def test_a_round_balloon_is_stationary(law):
    balloon = exact.RoundBalloon(10 * H, 13 * H, rubber(law))
    state = balloon.at(14 * H)
    points, weights = legendre.leggauss(24)

    def energy(a):
        b = np.cbrt(a**3 + (13 * H) ** 3 - (10 * H) ** 3)
        r, w = a + (b - a) * (1 + points) / 2, weights * (b - a) / 2
        s = np.log(r / np.cbrt(r**3 - a**3 + (10 * H) ** 3))
        e = np.stack([s, s, -2 * s])
        field = FilmField(balloon.material.dielectric).through(e, w, r**2, state.volts)
        return w @ (r**2 * energies(balloon.material, e, field)) / (MU * H**3)

    assert abs(slope(lambda a: energy(a * H), 14.0, 2e-3)) < 1e-8 * 14**2
    if law != "constant":
        with pytest.raises(dea.InputError, match="one permittivity"):
            balloon.is_stable(14 * H, 2)


@pytest.mark.parametrize("law", LAWS)
def test_a_film_in_time_keeps_the_balance_and_goes_to_the_static_state(law):
    film = exact.Film(rubber(law, viscous=[dea.Maxwell(MU, 0.5)]), H)
    volts = 15e3
    course = exact.march(film, 30.0, voltage=dea.Table([0.0, 2.0, 30.0], [0.0, volts, volts]))
    balance = course.balance()
    assert np.abs(balance.gap).max() < 1e-9 * np.abs(balance.electric_work).max()
    rest = exact.trace(exact.Film(rubber(law), H)).states_at(volts)[0][0]
    assert course.stretch(30.0) == pytest.approx(rest.stretches[0], rel=1e-9)


def test_a_map_of_pull_in_gives_the_times_of_marches():
    film = exact.Film(rubber("linear", viscous=[dea.Maxwell(MU, 0.5)]), H)
    field = 1.2 * exact.trace(exact.Film(rubber("linear"), H)).event("pull-in").voltage / H
    found = exact.pull_in_map(film, field, seconds=1e3)
    course = exact.march(film, 1e3, field=field)
    assert float(found.time) == pytest.approx(course.pull_in.time, rel=1e-6)
    with pytest.raises(dea.InputError, match="does not change with the field"):
        exact.pull_in_map(exact.Film(rubber("ln cosh", viscous=[dea.Maxwell(MU, 1.0)]), H), 1e6,
                          seconds=1.0)  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
def test_the_energy_of_a_harvesting_cycle_is_its_area(law):
    low, high, E = 1.2, 2.0, 20e6 if law != "ln cosh" else 5e6
    cycle = exact.harvesting_cycle(rubber(law), low, high, E)
    electric = FilmField(LAWS[law])

    def given(lam, charge):
        """Integral of the nominal field over the charge, at a stretch."""
        x, w = legendre.leggauss(40)
        Q = charge * (1 + x) / 2
        e = np.log(np.array([[lam], [lam], [lam**-2]]))
        return charge / 2 * w @ (electric.field_of(e, Q / lam**2) / lam**2)

    area = given(low, cycle.charge) - given(high, cycle.charge)
    assert cycle.energy == pytest.approx(area, rel=1e-9)
    assert cycle.nominal_fields[0] == E
    if law == "ln cosh":
        with pytest.raises(dea.InputError, match="saturates"):
            exact.harvesting_cycle(rubber(law), low, high, 20e6)


@pytest.mark.parametrize("law", LAWS)
def test_helicoid_and_design_know_the_law(law):
    free = exact.trace(exact.Film(rubber(law), H))
    pull_in = free.event("pull-in")
    volts = 0.8 * pull_in.voltage if pull_in else 10e3
    state = free.states_at(volts)[0][0]
    ring = exact.Helicoid(5e-3, 2e-3, H, inset=0.2e-3)
    assert ring.contraction(rubber(law), volts) == pytest.approx(1 - state.stretches[2], rel=1e-9)
    limit = pull_in.voltage if pull_in else np.inf
    assert ring.pull_in_voltage(rubber(law)) == pytest.approx(limit)
    if law == "ln cosh":
        with pytest.raises(dea.InputError, match="changes with the field"):
            HelicalModel(rubber(law))
        return
    made = HelicalModel(rubber(law))(5e-3, 2e-3, H, EPS, voltage=volts)
    assert made["strain"] == pytest.approx(1 - state.stretches[2], rel=1e-9)
    twice = HelicalModel(rubber(law))(5e-3, 2e-3, H, 2 * EPS, voltage=volts / np.sqrt(2))
    assert twice["strain"] == pytest.approx(made["strain"], rel=1e-9)
