"""Presets and fits: known constants come back, published data give published constants."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from dea_fenicsx import materials
from dea_fenicsx.materials import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    TestData,
    Yeoh,
    fit,
    read_data,
)
from dea_fenicsx.materials.base import constants
from dea_fenicsx.materials.presets import MARKS
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.support.errors import InputError

DATA = Path(__file__).parent / "data"
TRELOAR = Path(__file__).parents[1] / "demos" / "fit_rubber_data"
STRETCH = np.linspace(1.1, 3.5, 12)


def exact_data(model) -> list[TestData]:
    return [
        TestData(t, STRETCH, nominal_stress(model, t, STRETCH))
        for t in ("uniaxial", "planar", "equibiaxial")
    ]


@pytest.mark.parametrize("model", [
    NeoHookean(5e4), MooneyRivlin(2e4, 3e3), Yeoh(3e4, -200.0, 3.0), Gent(5e4, 60.0),
    ArrudaBoyce(4e4, 5.0),
], ids=lambda m: type(m).__name__)  # fmt: skip
def test_the_constants_of_exact_data_come_back(model):
    found = fit(type(model), exact_data(model))
    for name in constants(model):
        assert getattr(found.model, name) == pytest.approx(getattr(model, name), rel=1e-6)
    assert found.r_squared > 1 - 1e-10 and max(found.residual.values()) < 1e-6
    assert found.stable


def test_ogden_comes_back_from_a_start_nearby():
    model = Ogden.from_eq76((4e4, 1e2), (1.3, 5.0))
    found = fit(Ogden.from_eq76((3e4, 2e2), (1.6, 4.5)), exact_data(model))
    # terms of a sum have no order: which of equally good starts wins is chosen by rounding
    terms = sorted(zip(found.model.alpha, found.model.mu, strict=True))
    assert np.array(terms) == pytest.approx(
        np.array(sorted(zip(model.alpha, model.mu, strict=True))), rel=1e-4
    )


def test_uncertainty_is_that_of_the_noise():
    """A straight line in mu: its standard deviation is known in closed form."""
    rng = np.random.default_rng(2)
    shape = nominal_stress(NeoHookean(1.0), "uniaxial", STRETCH)
    found = [
        fit(NeoHookean, TestData("uniaxial", STRETCH, 5e4 * shape + rng.normal(0, 1e3, 12)))
        for _ in range(40)
    ]
    spread = 1e3 / np.sqrt(np.sum(shape**2))
    assert np.mean([f.uncertainty["mu"] for f in found]) == pytest.approx(spread, rel=0.15)
    assert np.std([f.model.mu for f in found]) == pytest.approx(spread, rel=0.35)


def treloar() -> list[TestData]:
    """Treloar 1944, vulcanised natural rubber at 20 C; stresses in MPa in the files."""
    return [
        read_data(TRELOAR / f"treloar1944_{k}.txt", t, stretch=1, stress=0, unit=1e6)
        for k, t in (("UT", "uniaxial"), ("PS", "planar"), ("ET", "equibiaxial"))
    ]


def test_treloar():
    uniaxial, planar, equal = treloar()
    # check values of the data: (1.24, 0.226 MPa), (2.97, 0.942), (4.45, 2.443)
    assert np.interp(1.24, uniaxial.stretch, uniaxial.stress) == pytest.approx(0.2256e6)
    assert np.interp(2.97, planar.stretch, planar.stress) == pytest.approx(0.9418e6)
    assert equal.stress[-1] == pytest.approx(2.4426e6)
    start = Ogden.from_eq76((6.3e5, 1.2e3, -1e4), (1.3, 5.0, -2.0))  # Ogden 1972
    found = fit(start, treloar())
    assert found.stable and found.r_squared > 0.995 and max(found.residual.values()) < 0.06
    assert fit(NeoHookean, treloar()).r_squared < 0.85  # it cannot follow the upturn


def test_vhb4910_of_hossain_2012():
    """Constants quoted in the presets: neo-Hookean 13.41 kPa, Yeoh 7.20, -0.0415, 0.0009 kPa."""
    data = read_data(
        DATA / "vhb4910_equilibrium_hossain2012.csv", "uniaxial", 1, 2, unit=1.0, delimiter=","
    )
    assert fit(NeoHookean, data).model.mu == pytest.approx(13.41e3, rel=0.01)
    yeoh = fit(Yeoh, data).model
    assert pytest.approx(7.20e3, rel=0.02) == yeoh.C10
    assert pytest.approx(-41.5, rel=0.1) == yeoh.C20 and pytest.approx(0.9, rel=0.1) == yeoh.C30


def test_an_unstable_energy_is_called_so():
    falling = Yeoh(3e4, -2.2e3, 1.0)  # the stress turns down near stretch 2.4
    found = fit(Yeoh, exact_data(falling)[0])
    assert pytest.approx(-2.2e3, rel=1e-5) == found.model.C20
    assert not found.stable and "NOT stable" in str(found)


# ---------------------------------------------------------------- presets


def test_presets():
    names = materials.list()
    assert len(names) == len(set(names)) >= 25
    for name in names:
        entry = materials.preset(name)
        assert entry.material.faults() == [] and entry.material.name == name
        assert entry.mark in MARKS and len(entry.source) > 10
    assert sum(n.startswith("vhb49") for n in names) >= 2
    silicones = {"elastosil-2030", "sylgard-186", "sylgard-184", "cf19-2186"}
    assert silicones | {"petg", "mylar", "carbon-grease"} <= set(names)
    flagged = materials.preset("vhb-thesis-mooney-rivlin-2p125")
    assert "slip" in flagged.note
    assert "Incompatible" in materials.preset("vhb-thesis-table-5-2-G-K").note
    # 2 mu (1 + nu) = E, and nu from mu and kappa
    mylar = materials.get("mylar-thesis")
    mu, kappa = mylar.elastic.mu, mylar.bulk_modulus
    assert 9 * kappa * mu / (3 * kappa + mu) == pytest.approx(710_000 * 6894.757293, rel=1e-9)


def test_a_preset_draws_its_three_curves():
    pytest.importorskip("matplotlib").use("Agg")
    ax = materials.preset("elastosil-2030").plot()
    assert [line.get_label() for line in ax.lines] == ["uniaxial", "planar", "equibiaxial"]
    assert ax.lines[0].get_ydata()[-1] * 1e3 == pytest.approx(
        nominal_stress(materials.get("elastosil-2030").elastic, "uniaxial", 3.0)
    )


# ---------------------------------------------------------------- bad input


def data(n: int = 12, factor: float = 1.0) -> TestData:
    s = STRETCH[:n]
    return TestData("uniaxial", s, factor * nominal_stress(NeoHookean(5e4), "uniaxial", s))


@pytest.mark.parametrize("call, words", [
    (lambda: materials.get("vhb4910-sou"), "nearest is 'vhb4910-suo'"),
    (lambda: fit(Yeoh, data(3)), "3 data points .* at least 4"),
    (lambda: fit(Ogden, data()), "no starting point"),
    (lambda: fit(NeoHookean, []), "no data"),
    (lambda: TestData("shear", STRETCH, STRETCH), "no test 'shear'"),
    (lambda: TestData("planar", STRETCH, STRETCH[1:]), "12 stretches and 11 stresses"),
    (lambda: TestData("planar", STRETCH - 2, STRETCH), "stretch of -0.9"),
    (lambda: TestData("planar", STRETCH, STRETCH * np.nan), "no finite numbers"),
    (lambda: read_data("absent.csv", "planar", 0, 1, 1.0), "no data file absent.csv"),
    (lambda: Ogden.from_abaqus((1.0, 2.0), 3.0), "2 moduli and 1 exponents"),
])  # fmt: skip
def test_bad_input(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize("factor, word", [
    (1e-3, "too soft"), (1e-6, "too soft"), (1e4, "too stiff")
])  # fmt: skip
def test_wrong_units_warn(factor, word):
    with pytest.warns(UserWarning, match=word):
        fit(NeoHookean, data(factor=factor))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit(NeoHookean, data())


def test_constants_from_memory_give_a_warning():
    """They do so where they are used, not where presets are listed."""
    with pytest.warns(UserWarning, match="from memory of the literature, unverified"):
        materials.get("vhb4910-suo")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        materials.preset("vhb4910-suo")
        materials.get("vhb4910-wang2016")
