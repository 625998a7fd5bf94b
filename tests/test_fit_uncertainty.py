"""The standard deviation of fitted constants: against a count of random data, and infinite where
the data determine nothing."""

from __future__ import annotations

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.materials import TestData, fit
from dea_fenicsx.materials.stretches import nominal_stress

LAM = np.linspace(1.05, 2.0, 30)


def data(model, noise=0.0, seed=1, test="uniaxial", lam=LAM):
    """Stresses of a model with scatter of the same size at all stretches, as a share of the rms."""
    stress = nominal_stress(model, test, lam)
    scatter = np.random.default_rng(seed).standard_normal(len(lam))
    return TestData(test, lam, stress + noise * np.sqrt(np.mean(stress**2)) * scatter)


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3, 0.05])
@pytest.mark.parametrize("start", [10.0, 50.0, 1e4])
def test_a_lock_up_that_the_data_do_not_reach(noise, start):
    """A Gent model on data of a neo-Hookean one: any large Jm does."""
    found = fit(dea.Gent(3e4, start), data(dea.NeoHookean(4e4), noise))
    sigma = found.uncertainty["Jm"]
    assert found.model.Jm < 1e3 / max(noise, 1e-3) or not sigma < abs(found.model.Jm)
    assert found.uncertainty["mu"] < 0.05 * found.model.mu
    if not noise:
        assert found.undetermined == ("Jm",)
        assert "the data do not determine Jm" in str(found)


def test_two_terms_that_are_the_same():
    """Ogden with equal exponents: only the sum of the moduli is determined, and one exponent."""
    model = dea.Ogden.from_eq76((2e4, 2e4), (2.0, 2.0))
    found = fit(model, data(dea.NeoHookean(4e4)), starts=1)
    for deviation in found.uncertainty.values():
        assert np.all(np.isinf(deviation))
    assert set(found.undetermined) == set(found.uncertainty)


def test_mooney_rivlin_from_one_test_only():
    """At small strains uniaxial data fix C1 + C2 alone; with equibiaxial data both are fixed."""
    model = dea.MooneyRivlin(1.5e4, 5e3)
    small = np.linspace(1.0005, 1.002, 20)
    one = fit(dea.MooneyRivlin, data(model, 0.01, lam=small))
    both = fit(dea.MooneyRivlin, [
        data(model, 0.01), data(model, 0.01, seed=2, test="equibiaxial")])  # fmt: skip
    names = list(both.uncertainty)
    for name in names:
        assert one.uncertainty[name] > 2e4  # their sum
        assert both.uncertainty[name] < 0.1 * getattr(model, name)
    assert not both.undetermined


def test_a_constant_near_zero_is_determined():
    """C2 of neo-Hookean data is 0, to within a small share of C1."""
    found = fit(dea.MooneyRivlin, data(dea.NeoHookean(4e4), 0.01))
    c1, c2 = (getattr(found.model, name) for name in found.uncertainty)
    s1, s2 = found.uncertainty.values()
    assert 0 < s2 < 0.1 * c1 and 0 < s1 < 0.1 * c1
    assert abs(c2) < 4 * s2


@pytest.mark.parametrize(
    "model", [dea.NeoHookean(4e4), dea.Gent(4e4, 8.0), dea.MooneyRivlin(1.5e4, 5e3)]
)
def test_against_random_data(model):
    """The scatter of the constants over 40 sets of data is what each fit tells of itself."""
    lam = np.linspace(1.05, 2.6, 30)
    fits = [fit(model, data(model, 0.01, seed, lam=lam), starts=1) for seed in range(40)]
    for name in fits[0].uncertainty:
        values = [getattr(f.model, name) for f in fits]
        told = np.median([f.uncertainty[name] for f in fits])
        # the standard deviation of 40 samples is known to 11 %: three times that
        assert np.std(values, ddof=1) == pytest.approx(told, rel=0.35), name
