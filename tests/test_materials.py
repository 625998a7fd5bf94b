"""Material models: closed forms, Taylor remainders, Ogden at equal stretches, bad constants."""

from __future__ import annotations

import numpy as np
import pytest

from dea_fenicsx.materials import (
    ArrudaBoyce,
    Breakdown,
    Conductor,
    Elastic,
    Gent,
    IdealDielectric,
    Material,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    names,
    preset,
)
from dea_fenicsx.materials.stretches import nominal_stress, taylor

MODELS = [
    NeoHookean(5e4),
    MooneyRivlin(2e4, 3e3),
    Yeoh(3e4, -200.0, 3.0),
    Ogden.from_eq76((4e4, 1e3, -1e2), (1.3, 5.0, -2.0)),
    Gent(5e4, 60.0),
    ArrudaBoyce(4e4, 5.0),
]
by_name = pytest.mark.parametrize("model", MODELS, ids=lambda m: type(m).__name__)


def closed_form(model, l: np.ndarray, n: float) -> np.ndarray:
    """Nominal stress at stretches (l, l^n, 1/(l l^n)), written out by hand for each model."""
    l2 = l**n
    l3 = 1 / (l * l2)
    I1 = l**2 + l2**2 + l3**2
    if isinstance(model, Ogden):
        return sum(
            m * (l**a - l3**a) for m, a in zip(model.mu, model.alpha, strict=True)
        ) / l
    if isinstance(model, NeoHookean):
        W1, W2 = model.mu / 2, 0.0
    elif isinstance(model, MooneyRivlin):
        W1, W2 = model.C10, model.C01
    elif isinstance(model, Yeoh):
        W1, W2 = model.C10 + 2 * model.C20 * (I1 - 3) + 3 * model.C30 * (I1 - 3) ** 2, 0.0
    elif isinstance(model, Gent):
        W1, W2 = model.mu / 2 / (1 - (I1 - 3) / model.Jm), 0.0
    else:
        N = model.lam_m**2
        W1 = model.mu * (
            1 / 2 + I1 / (10 * N) + 11 * I1**2 / (350 * N**2) + 19 * I1**3 / (1750 * N**3)
            + 519 * I1**4 / (134750 * N**4)
        )  # fmt: skip
        W2 = 0.0
    return 2 * (l**2 - l3**2) * (W1 + W2 * l2**2) / l


@by_name
@pytest.mark.parametrize("test, n", [("uniaxial", -0.5), ("planar", 0.0), ("equibiaxial", 1.0)])
def test_stress_against_the_closed_form(model, test, n):
    l = np.array([0.5, 0.8, 0.999, 1.001, 1.2, 2.0, 3.0, 4.5])
    expected = closed_form(model, l, n)
    # relative to the modulus where the stress itself vanishes
    error = np.abs(nominal_stress(model, test, l) - expected)
    assert np.all(error <= 1e-12 * (np.abs(expected) + model.shear_modulus()))


@by_name
def test_taylor_remainders(model):
    """Value, gradient and Hessian belong together: remainders of order 2 and 3."""
    assert isinstance(model, Elastic)
    rng = np.random.default_rng(5)
    e, d = np.log(rng.uniform(0.7, 1.6, 3)), rng.uniform(-1, 1, 3)
    steps = 0.1 / 2 ** np.arange(6)
    W, R, H = taylor(model, e)
    first, second = [], []
    for h in steps:
        Wh, Rh, _ = taylor(model, e + h * d)
        first.append(abs(Wh - W - h * R @ d - h * h / 2 * d @ H @ d))
        second.append(np.abs(Rh - R - h * H @ d).max())
    assert np.log2(np.array(first[:-1]) / first[1:])[-1] == pytest.approx(3, abs=0.15)
    assert np.log2(np.array(second[:-1]) / second[1:])[-1] == pytest.approx(2, abs=0.15)


@by_name
def test_facts_about_the_undeformed_state(model):
    W, R, H = taylor(model, np.zeros(3))
    mu = model.shear_modulus()
    assert pytest.approx(0, abs=1e-12 * mu) == W
    assert np.allclose(R, model.spherical_slope(), rtol=1e-13)
    # simple shear is e = (g/2, -g/2, 0): W = mu g^2/2
    d = np.array([0.5, -0.5, 0.0])
    assert d @ H @ d == pytest.approx(mu, rel=1e-12)
    assert model.faults() == []


def test_gent_ends_where_its_chains_lock():
    model = Gent(5e4, 60.0)
    stretch = np.array([5.0, 6.0])  # equi-biaxial: I1 - 3 = 47, 69
    assert np.isfinite(nominal_stress(model, "equibiaxial", stretch)).tolist() == [True, False]


def test_ogden_conventions():
    a, b = Ogden.from_eq76(28900.0, 1.13), Ogden.from_abaqus(28900.0, 1.13)
    # Table 5.5 of the thesis: G0 16328.5 in eq 76, 28900 in Abaqus's convention
    assert a.shear_modulus() == pytest.approx(16328.5, abs=1e-9)
    assert b.shear_modulus() == pytest.approx(28900.0, rel=1e-14)
    assert b.to_abaqus()[0] == pytest.approx((28900.0,))
    l = np.linspace(0.6, 3, 7)
    assert np.allclose(
        nominal_stress(Ogden.from_abaqus(5e4, 2.0), "planar", l),
        nominal_stress(NeoHookean(5e4), "planar", l), rtol=1e-12, atol=1e-8,
    )  # fmt: skip


# ---------------------------------------------------------------- Ogden in finite elements


def _power_stress(l, Q, R, p):
    """d/dF of sum c^p, c = l^2, and its derivative, for F = R Q^T diag(l) Q.

    From first divided differences of 2 p c^(p-1) between eigenvalues, which expm1 gives to the
    last digits however close they are.
    """
    F = R @ Q.T @ np.diag(l) @ Q
    c = l**2
    s = 2 * p * c ** (p - 1)
    S = Q.T @ np.diag(s) @ Q
    D = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            L = 2 * np.log1p((l[i] - l[j]) / l[j])
            ratio = p - 1 if L == 0 else np.expm1((p - 1) * L) / np.expm1(L)
            D[i, j] = 2 * p * c[j] ** (p - 2) * ratio

    def tangent(H):
        dC = Q @ (H.T @ F + F.T @ H) @ Q.T
        return H @ S + F @ Q.T @ (D * dC) @ Q

    return F, F @ S, tangent


BASES = {
    "three equal": (1, 1, 1),
    "two equal, large": (2, 2, 0.25),
    "two equal, small": (4, 0.5, 0.5),
    "pre-stretched film": (6, 6, 1 / 36),
    "uniaxial": (6, 6**-0.5, 6**-0.5),
    "plane strain": (2, 1, 0.5),
    "apart": (3, 1.1, 1 / 3.3),
}


@pytest.fixture(scope="module")
def power_sum_in_ufl():
    """Evaluates stress : H1 and H1 : tangent : H2 of sum lam^alpha, all cases in one call."""
    pytest.importorskip("dolfinx")
    from dea_fenicsx.support import compat  # first, for the wheel's libraries

    import dolfinx  # isort: skip
    import ufl  # isort: skip
    from mpi4py import MPI  # isort: skip

    from dea_fenicsx.scene.kinematics import StrainOf

    def evaluate(F, H1, H2, alpha):
        mesh = dolfinx.mesh.create_interval(MPI.COMM_SELF, len(F), (0.0, 1.0))
        tensor = dolfinx.fem.functionspace(mesh, ("DG", 0, (3, 3)))
        f, h1, h2 = (dolfinx.fem.Function(tensor) for _ in range(3))
        a = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("DG", 0)))
        for function, values in ((f, F), (h1, H1), (h2, H2), (a, alpha)):
            function.x.array[:] = np.asarray(values).ravel()
        g = StrainOf(f).power_sum(a)
        stress = ufl.derivative(g, f, h1)
        tangent = ufl.derivative(stress, f, h2)
        run = compat.expression(ufl.as_vector([g, stress, tangent]), np.array([[0.5]]))
        return run(mesh, np.arange(len(F), dtype=np.int32))[:, 0]

    return evaluate


@pytest.mark.slow
def test_ogden_in_finite_elements_at_and_near_equal_stretches(power_sum_in_ufl):
    from scipy.stats import special_ortho_group

    rng = np.random.default_rng(11)
    rotation = special_ortho_group(3, seed=12)
    rows, labels = [], []
    for alpha in (1.13, 1.95, 2.0, -2.0, 5.2):
        for label, base in BASES.items():
            for size in [0.0, *10.0 ** -np.arange(1, 17)]:
                for _ in range(3):
                    l = np.array(base) * (1 + size * rng.uniform(-1, 1, 3))
                    F, P, tangent = _power_stress(l, rotation.rvs(), rotation.rvs(), alpha / 2)
                    H1, H2 = rng.uniform(-1, 1, (2, 3, 3))
                    T = tangent(H2)
                    rows.append((F, H1, H2, alpha, np.sum(P * H1), np.sum(T * H1),
                                 np.abs(P).sum(), np.abs(T).sum(), np.sum(l**alpha)))  # fmt: skip
                    labels.append(label)
    F, H1, H2, alpha, stress, tangent, P_size, T_size, value = (
        np.array(x) for x in zip(*rows, strict=True)
    )
    ours = power_sum_in_ufl(F, H1, H2, alpha)
    assert np.all(np.isfinite(ours))
    errors = {
        "value": np.abs(ours[:, 0] / value - 1),
        "stress": np.abs(ours[:, 1] - stress) / P_size,
        "tangent": np.abs(ours[:, 2] - tangent) / T_size,
    }
    # at 6 x 6 x 1/36 the rounding of F itself, the test's input, is worth some 1e-12
    limit = np.where(np.array(labels) == "pre-stretched film", 1e-11, 1e-12)
    for what, error in errors.items():
        k = int(np.argmax(error / limit))
        assert error[k] < limit[k], f"{what}: {error[k]:.1e} at {labels[k]}, alpha {alpha[k]}"


# ---------------------------------------------------------------- bad constants


@pytest.mark.parametrize("thing, words", [
    (NeoHookean(-5.0), "mu is -5.0, but must be a finite number > 0"),
    (NeoHookean(float("nan")), "mu is nan"),
    (MooneyRivlin(1e4, -2e4), "half the initial shear modulus"),
    (Yeoh(0.0, 1.0, 1.0), "C10 is 0.0"),
    (Gent(5e4, -1.0), "Jm is -1.0"),
    (ArrudaBoyce(5e4, 0.9), "locking stretch"),
    (Ogden.from_eq76(-5e4, 2.0), "the initial shear modulus sum mu alpha/2 is -50000 Pa"),
    (Ogden((1e4,), (2.0, 3.0)), "1 moduli and 2 exponents"),
    (Ogden((1e4,), (0.0,)), "alpha holds 0.0"),
    (IdealDielectric(0.5), "eps_r is 0.5"),
    (IdealDielectric(3.0, breakdown=40.0), "1 MV/m = 1e6 V/m"),
    (IdealDielectric(3.0, Breakdown(-1.0)), "breakdown field is -1.0"),
    (Material(NeoHookean(5e4), bulk_modulus=1e4), "2/3 of the shear modulus"),
])  # fmt: skip
def test_unphysical_constants(thing, words):
    assert words in thing.faults()[0]


def test_breakdown_laws():
    assert IdealDielectric(3.0).breakdown_field(2.0) is None
    assert IdealDielectric(3.0, breakdown=5e7).breakdown_field(2.0) == 5e7
    law = IdealDielectric(3.0, Breakdown(30.6e6, 1.13))
    assert law.breakdown_field(2.0) == pytest.approx(30.6e6 * 2**1.13)
    assert Conductor().faults() == []


def test_presets_tell_year_range_and_data():
    with_data = [name for name in names() if preset(name).curve]
    assert len(with_data) >= 5
    for name in with_data:
        found = preset(name)
        data = found.data()
        low, high = found.stretches
        inside = (data.stretch >= low) & (data.stretch <= high)
        model = nominal_stress(found.material.elastic, "uniaxial", data.stretch[inside])
        error = np.sqrt(np.mean((model - data.stress[inside]) ** 2)) / data.stress[inside].max()
        assert found.year and error < 0.12
    for name in names():
        found = preset(name)
        assert found.year is None or str(found.year) in found.source
