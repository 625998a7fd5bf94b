"""Homogeneous states of films against closed forms, to 1e-8."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, T = 50e3, 2.86, 1e-3
MODELS = {
    "neo-Hookean": (dea.NeoHookean(MU), lambda I1: MU),
    # dW/dI1 = mu/2 Jm / (Jm - I1 + 3) takes the place of mu/2
    "Gent": (dea.Gent(MU, 90.0), lambda I1: MU * 90.0 / (90.0 - I1 + 3)),
}
TIGHT = dea.NewtonOptions(tolerance=1e-12)


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


def film_scene(device, elastic, **conditions):
    return dea.Scene(
        device,
        {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R))},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        **conditions,
    )


def voltage(volts):
    return [dea.Electrode("top", volts), dea.Ground("bottom")]


STRETCHES = {
    "x": dea.MeanStretch(("x_min", "x_max"), "x"),
    "y": dea.MeanStretch(("y_min", "y_max"), "y"),
    "z": dea.MeanStretch(("bottom", "top"), "z"),
}


def test_free_film_under_voltage(cube, model):
    """phi^2 = (mu'/mu)(1/lam - lam^2) lam^2 with lam the stretch through the thickness."""
    elastic, modulus = model
    eps = EPS_R * EPSILON_0
    for share in (0.5, 0.98):
        volts = share * 0.687 * T * np.sqrt(MU / eps)
        run = dea.solve(
            film_scene(cube, elastic, electrodes=voltage(volts)),
            dea.Ramp(steps=5), STRETCHES, quiet=True, options=TIGHT,
        )  # fmt: skip

        def balance(lam, volts=volts):
            mu = modulus(lam**2 + 2 / lam)
            return mu * (1 / lam - lam**2) * lam**2 - eps * (volts / T) ** 2

        exact = brentq(balance, 0.63, 1.0, xtol=1e-15)
        assert run["z"] == pytest.approx(exact, rel=1e-8)
        assert run["x"] == pytest.approx(exact**-0.5, rel=1e-8)
        assert run.summary["stable"] is True


def test_unequal_dead_loads_then_voltage(cube, model):
    """lam_i dW/dlam_i - lam_3 dW/dlam_3 = lam_i s_i + eps (lam_1 lam_2 V/T)^2 for i = 1, 2."""
    elastic, modulus = model
    s = (60e3, 20e3)
    volts = 1000.0
    loads = [dea.DeadLoad("x_max", (s[0], 0, 0)), dea.DeadLoad("y_max", (0, s[1], 0))]
    run = dea.solve(
        film_scene(cube, elastic, electrodes=voltage(volts), loads=loads),
        [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=4)],
        STRETCHES, quiet=True, options=TIGHT,
    )  # fmt: skip
    a, b, c = (run[k] for k in "xyz")
    mu = modulus(a**2 + b**2 + c**2)
    field = EPS_R * EPSILON_0 * (a * b * volts / T) ** 2
    assert mu * (a**2 - c**2) == pytest.approx(a * s[0] + field, rel=1e-8)
    assert mu * (b**2 - c**2) == pytest.approx(b * s[1] + field, rel=1e-8)
    assert a * b * c == pytest.approx(1, abs=1e-10)


def test_held_stretches_reactions_and_charge(cube, model):
    """Reaction = area (dW/dlam_i - lam_3/lam_i dW/dlam_3 - eps E^2/lam_i); Q = eps A (ab)^2 V/T."""
    elastic, modulus = model
    a, b, volts = 2.5, 1.4, 800.0
    held = [dea.Stretch("x_max", "x", a), dea.Stretch("y_max", "y", b)]
    run = dea.solve(
        film_scene(cube, elastic, electrodes=voltage(volts), prescribed=held),
        [dea.Ramp("stretch", steps=3), dea.Ramp("voltage", steps=2)],
        {**STRETCHES, "Rx": dea.Reaction("x_max", "x"), "Ry": dea.Reaction("y_max", "y"),
         "Q": dea.Charge("top"), "C": dea.Capacitance("top")},
        quiet=True, options=TIGHT,
    )  # fmt: skip
    c = 1 / (a * b)
    mu, area = modulus(a**2 + b**2 + c**2), T**2
    field = EPS_R * EPSILON_0 * (a * b * volts / T) ** 2
    assert run["z"] == pytest.approx(c, rel=1e-8)
    assert run["Rx_N"] == pytest.approx(area * (mu * (a**2 - c**2) - field) / a, rel=1e-8)
    assert run["Ry_N"] == pytest.approx(area * (mu * (b**2 - c**2) - field) / b, rel=1e-8)
    charge = EPS_R * EPSILON_0 * T * (a * b) ** 2 * volts
    assert run["Q_C"] == pytest.approx(charge, rel=1e-8)
    assert run["C_F"] == pytest.approx(charge / volts, rel=1e-8)
    assert run["max_field_V_per_m"] == pytest.approx(a * b * volts / T, rel=1e-8)


def test_no_volume_is_lost_at_four_by_four(cube, model):
    """Equi-biaxial stretch 4: exactly incompressible, volume error below 1e-8."""
    elastic, _ = model
    held = [dea.Stretch("x_max", "x", 4.0), dea.Stretch("y_max", "y", 4.0)]
    run = dea.solve(
        film_scene(cube, elastic, prescribed=held), dea.Ramp(steps=4), STRETCHES, quiet=True,
        options=TIGHT,
    )  # fmt: skip
    assert run["volume_error"] < 1e-8
    assert run["z"] == pytest.approx(1 / 16, rel=1e-8)


def test_polarity_does_not_matter(cube):
    """The field enters squared: the deformation is even and the charge odd in the voltage."""
    results = [
        dea.solve(film_scene(cube, dea.NeoHookean(MU), electrodes=voltage(v)), dea.Ramp(steps=3),
                  {**STRETCHES, "Q": dea.Charge("top")}, quiet=True)
        for v in (2000.0, -2000.0)
    ]  # fmt: skip
    assert results[0]["z"] == pytest.approx(results[1]["z"], rel=1e-10)
    assert results[0]["Q_C"] == pytest.approx(-results[1]["Q_C"], rel=1e-10)


@pytest.mark.parametrize(("augmentation", "stable"), [(None, True), (0.0, False)])
def test_no_false_instability_near_pull_in(cube, augmentation, stable):
    """A dead-loaded film at 99.9 % of pull-in is stable; plain mixed elements deny it.

    Membrane limit: stable against any in-plane mode until pull-in (W_11 > 0, W_11 + W_12 > 0);
    half-space limit (Biot): eps E^2 = 2.7 mu stays below 8.5 mu, the stiffness of its surface at
    equi-biaxial stretch 2.9.  So every negative eigenvalue beyond the expected ones is false.
    """
    P = MU * (2 - 2**-5)
    volts = 0.999 * 8668.1  # pull-in of the film of 1 mm at pre-stretch 2, eq 17
    elements = dea.Discretisation() if augmentation is None else dea.Discretisation(
        augmentation=augmentation)  # fmt: skip
    loads = [dea.DeadLoad("x_max", (P, 0, 0)), dea.DeadLoad("y_max", (0, P, 0))]
    scene = film_scene(cube, dea.NeoHookean(MU), electrodes=voltage(volts), loads=loads,
                       elements=elements)  # fmt: skip
    run = dea.solve(scene, [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=8)], STRETCHES,
                    quiet=True, options=TIGHT)  # fmt: skip
    assert run["x"] == pytest.approx(2.8958, abs=2e-3)
    assert run.summary["stable"] is stable


def test_plane_strain_has_no_limit_point():
    """phi^2 = (mu'/mu)(1 - lam^4), lam the stretch along the field."""
    elastic, modulus = MODELS["Gent"]
    device = block((2, 2))
    eps = EPS_R * EPSILON_0
    for phi in (0.5, 0.95):
        volts = phi * T * np.sqrt(MU / eps)
        scene = dea.Scene(
            device,
            {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R))},
            electrodes=voltage(volts),
            supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
            kinematics=dea.PlaneStrain(depth=0.01),
        )
        run = dea.solve(scene, dea.Ramp(steps=5),
                        {"y": dea.MeanStretch(("bottom", "top"), "y"), "Q": dea.Charge("top")},
                        quiet=True, options=TIGHT)  # fmt: skip
        lam = run["y"]
        mu = modulus(lam**2 + lam**-2 + 1)
        assert mu / MU * (1 - lam**4) == pytest.approx(phi**2, rel=1e-8)
        assert run["Q_C"] == pytest.approx(eps * 0.01 * volts / lam**2, rel=1e-8)


def test_axisymmetric_disc_is_the_free_film():
    """A free disc under voltage is the equi-biaxial film; charge is for the whole circle."""
    elastic, modulus = MODELS["neo-Hookean"]
    device = block((2, 1))
    eps = EPS_R * EPSILON_0
    volts = 0.6 * T * np.sqrt(MU / eps)
    scene = dea.Scene(
        device,
        {"film": dea.Material(elastic, dea.IdealDielectric(EPS_R))},
        electrodes=voltage(volts),
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
        kinematics=dea.Axisymmetric(),
    )
    run = dea.solve(scene, dea.Ramp(steps=5),
                    {"z": dea.MeanStretch(("bottom", "top"), "z"), "Q": dea.Charge("top")},
                    quiet=True, options=TIGHT)  # fmt: skip
    exact = brentq(lambda x: (1 / x - x**2) * x**2 - 0.36, 0.63, 1.0, xtol=1e-15)
    assert run["z"] == pytest.approx(exact, rel=1e-8)
    assert run["Q_C"] == pytest.approx(eps * np.pi * T**2 * volts / T / exact**2, rel=1e-8)


def test_nearly_incompressible_uniaxial(cube):
    """Abaqus's compressible neo-Hookean form: uniaxial dead load against its two equations.

    W = mu/2 (J^(-2/3) I1 - 3) + kappa/2 (J - 1)^2; lateral stress 0, axial nominal stress s.
    """
    mu, kappa, s = 500e3, 2.5e6, 200e3
    scene = dea.Scene(
        cube,
        {"film": dea.Material(dea.NeoHookean(mu), bulk_modulus=kappa)},
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (s, 0, 0))],
    )
    run = dea.solve(scene, dea.Ramp(steps=3), STRETCHES, quiet=True, options=TIGHT)
    a, b = run["x"], run["y"]
    J = a * b**2
    I1 = a**2 + 2 * b**2

    def cauchy(lam):
        return mu * J ** (-5 / 3) * (lam**2 - I1 / 3) + kappa * (J - 1)

    assert cauchy(b) == pytest.approx(0, abs=1e-8 * mu)
    assert cauchy(a) * b**2 == pytest.approx(s, rel=1e-8)
    assert run["z"] == pytest.approx(b, rel=1e-8)
