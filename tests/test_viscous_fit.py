"""Fits of branches: constants that are known come back, and measured tests are met."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT

import dea_fenicsx as dea
from dea_fenicsx.drives.waves import Table
from dea_fenicsx.exact import Film, Held, march
from dea_fenicsx.materials import RateData, fit_rates, rate_errors, rate_stress, read_cycles

TRUE = dea.Material(
    dea.NeoHookean(15e3),
    dea.IdealDielectric(4.7),
    viscous=[dea.Maxwell(26e3, 0.8), dea.Maxwell(11e3, 40.0)],
)
FEW = RateData("uniaxial", [0, 1], [1, 2], [0, 1e4])
DATA = ROOT / "demos" / "fit_viscous_data" / "vhb4910_cyclic_hossain2012.csv"


def cycle(rate, top, noise=0.0, seed=0):
    """A cycle to a stretch and back to half of it, with the exact stress of `TRUE`."""
    stretch = np.concatenate([np.linspace(1, top, 30), np.linspace(top, (1 + top) / 2, 15)[1:]])
    data = RateData.at_rate("uniaxial", rate, stretch, np.zeros(len(stretch)))
    stress = rate_stress(TRUE, data)[0]
    error = np.random.default_rng(seed).normal(size=len(stress))
    return RateData.at_rate("uniaxial", rate, stretch, stress + noise * error)


def relaxation(stretch):
    time = np.geomspace(0.1, 300, 30)
    data = RateData.relaxation("uniaxial", stretch, time, np.zeros(len(time)))
    return RateData.relaxation("uniaxial", stretch, time, rate_stress(TRUE, data)[0][1:])


@pytest.mark.parametrize("test", ["uniaxial", "planar", "equibiaxial"])
@pytest.mark.parametrize("kind", ["relaxation", "cycle"])
def test_stress_against_the_exact_film(test, kind):
    """The same stretch in the ordinary differential equation of a film."""
    if kind == "cycle":
        data = RateData.at_rate(test, 0.05, [1, 1.4, 1.8, 2.2, 1.9, 1.6], np.zeros(6))
        fine = np.interp(np.linspace(0, data.time[-1], 31), data.time, data.stretch)
        data = RateData.at_rate(test, 0.05, fine, np.zeros(31))
        wave = Table(data.time, data.stretch)
    else:
        data, wave = RateData.relaxation(test, 2.0, [0.5, 3.0, 50.0, 900.0], np.zeros(4)), 2.0
    first = Held(float(data.stretch[0]))
    film = {
        "uniaxial": Film(TRUE, 1e-3, first),
        "planar": Film(TRUE, 1e-3, first, Held(1.0)),
        "equibiaxial": Film(TRUE, 1e-3, first, first),
    }[test]
    second = wave if test == "equibiaxial" else None
    exact = march(film, float(data.time[-1]), sides=(wave, second)).at(data.time).stress[0]
    found = rate_stress(TRUE, data)[0]
    assert found == pytest.approx(exact, abs=2e-4 * np.abs(exact).max())


def test_known_constants_come_back():
    """From exact cycles and a relaxation test; the number of branches too."""
    found = fit_rates(dea.NeoHookean, [cycle(0.3, 2.0), cycle(0.02, 1.6), relaxation(1.5)])
    assert len(found.branches) == 2
    assert found.model.mu == pytest.approx(15e3, rel=1e-3)
    for branch, due in zip(found.branches, TRUE.viscous, strict=True):
        assert branch.mu == pytest.approx(due.mu, rel=2e-3)
        assert branch.tau == pytest.approx(due.tau, rel=5e-3)
    assert np.all(found.errors < 5.0)


def test_uncertainty_covers_the_truth_under_noise():
    data = [cycle(0.3, 2.0, 300, 1), cycle(0.02, 1.8, 300, 2), cycle(0.005, 1.5, 300, 3)]
    found = fit_rates(dea.NeoHookean, data, branches=2)
    for branch, (mu, tau), due in zip(
        found.branches, found.branch_uncertainty, TRUE.viscous, strict=True
    ):
        assert 0 < mu < 0.5 * branch.mu and 0 < tau < branch.tau
        assert abs(branch.mu - due.mu) < 4 * mu
        assert abs(branch.tau - due.tau) < 4 * tau
    assert found.errors == pytest.approx(300, rel=0.35)
    assert min(found.criterion) == max(found.criterion) == 2


def test_measured_tests_are_met_and_one_is_predicted():
    """VHB 4910, Hossain et al. 2012: fitted at 0.01 and 0.05 /s, predicted at 0.03 /s."""
    tests = read_cycles(DATA, "uniaxial", columns=(0, 1, 2, 3))
    assert len(tests) == 9 and tests[0].time[-1] == pytest.approx((0.49 + 0.36) / 0.05)
    left_out = [t for t in tests if t.name == "11"]
    found = fit_rates(dea.Yeoh, [t for t in tests if t.name != "11"], branches=2)
    wang = dea.materials.get("vhb4910-wang2016-viscous")
    own, theirs = rate_errors(found.material, tests), rate_errors(wang, tests)
    assert np.sqrt(np.mean(own**2)) < 0.65 * np.sqrt(np.mean(theirs**2))
    assert found.predicted(left_out)[0] < 1.6e3  # of 37 kPa at the top
    assert rate_errors(wang, left_out)[0] > 3e3


@pytest.mark.parametrize(("call", "words"), [
    (lambda: RateData("uniaxial", [0, 2, 1], [1, 2, 3], [0, 1, 2]), "run backwards at row 2"),
    (lambda: RateData("uniaxial", [0, 1], [1, -2], [0, 1]), "stretch is"),
    (lambda: RateData("uniaxial", [0, 1], [1], [0, 1]), "as many of each"),
    (lambda: RateData("shear", [0, 1], [1, 2], [0, 1]), "There is no test"),
    (lambda: RateData.at_rate("uniaxial", 0.0, [1, 2], [0, 1]), "must be a number > 0"),
    (lambda: RateData("uniaxial", [0, 1], [1, 2], [np.nan, np.nan]), "no stress"),
    (lambda: fit_rates(dea.NeoHookean, []), "no data"),
    (lambda: fit_rates(dea.NeoHookean, cycle(0.1, 2.0), branches=-1), "number of branches"),
    (lambda: fit_rates(dea.NeoHookean, FEW, 1), "points"),
    (lambda: read_cycles("no.csv", "uniaxial", (0, 1, 2, 3)), "no data file"),
])  # fmt: skip
def test_bad_input(call, words):
    with pytest.raises(dea.InputError, match=words):
        call()
