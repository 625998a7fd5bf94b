"""Charge, open circuit, follower pressure and true stress on homogeneous films, to 1e-8."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from test_homogeneous_all_models import MODELS, single
from test_homogeneous_all_models import device as distorted

import dea_fenicsx as dea
from dea_fenicsx.exact import elastic_stress
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, T = 50e3, 2.86, 1e-3
EPS = EPS_R * EPSILON_0
pytestmark = pytest.mark.usefixtures("quick_compile")
TIGHT = dea.NewtonOptions(tolerance=1e-12)
FLAT = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
MEASURED = {
    "x": dea.MeanStretch(("x_min", "x_max"), "x"),
    "z": dea.MeanStretch(("bottom", "top"), "z"),
}
ELECTRIC = {"phi": dea.Potential("top"), "Q": dea.Charge("top"), "C": dea.Capacitance("top")}


@pytest.fixture(scope="module")
def rough():
    """A cube of displaced hexahedra with this file's names; the kernel of all models is shared."""
    cube = distorted("hexahedron")
    cube.surfaces.update(bottom=cube.surfaces["z_min"], top=cube.surfaces["z_max"])
    return cube


@pytest.fixture(params=MODELS)
def model(request):
    """A model for elements, and f(lam) = lam dW/dlam - lam_3 dW/dlam_3 of the equi-biaxial film."""
    exact = dea.Material(MODELS[request.param])
    return single(request.param), lambda lam: elastic_stress(exact, lam, lam)[0]


def film(device, elastic, electrodes=(), **conditions):
    material = dea.Material(elastic, dea.IdealDielectric(EPS_R))
    return dea.Scene(device, {"film": material}, electrodes=electrodes, supports=FLAT, **conditions)


# the same form as in test_homogeneous_all_models, so that its kernel serves here too
NO_LOADS = [dea.DeadLoad("x_max", (0, 0, 0)), dea.DeadLoad("y_max", (0, 0, 0))]


def charge_ramp(cube, elastic, f, lam_end, steps):
    """A free film charged until its stretch in the plane is lam_end."""
    charge = T**2 * lam_end**2 * np.sqrt(EPS * f(lam_end))
    electrodes = [dea.ChargedElectrode("top", charge), dea.Ground("bottom")]
    scene = film(cube, elastic, electrodes, loads=NO_LOADS)
    run = dea.solve(scene, dea.Ramp("charge", steps=steps), MEASURED | ELECTRIC, quiet=True,
                    options=TIGHT, stability="every")  # fmt: skip
    assert run["x"] == pytest.approx(lam_end, rel=1e-8)
    assert run["Q_C"] == pytest.approx(charge, rel=1e-10)
    volts, lam = run.column("phi_V")[1:], run.column("x")[1:]
    assert volts == pytest.approx(T * np.sqrt(f(lam) / EPS) / lam**2, rel=1e-8)
    return run


def test_charge(rough, model):
    """f(lam) = (Q/A)^2/(eps lam^4), and stable."""
    run = charge_ramp(rough, *model, lam_end=1.22, steps=4)
    assert {row["inertia"] for row in run.history} == {0}


def test_charge_has_no_limit_point(cube):
    """Charged past the voltage's maximum at 1.26: the potential falls, the stretch goes on.

    The homogeneous branch is followed on purpose; beyond the maximum it is unstable to uneven
    thinning, since charge moves freely along an equipotential.
    """
    run = charge_ramp(cube, dea.NeoHookean(MU), lambda x: MU * (x**2 - x**-4), 1.8, steps=8)
    volts, lam = run.column("phi_V"), run.column("x")
    assert np.all(np.diff(lam) > 0)
    top = int(np.argmax(volts))
    assert 1.15 < lam[top] < 1.4
    assert volts[-1] < 0.9 * volts[top]
    assert [row["inertia"] for row in run.history if row["x"] < 1.2][-1] == 0
    assert run.history[-1]["inertia"] > 0


def test_open_circuit_follows_the_capacitance(cube):
    """Charged, then stretched: V = Q/C with C = eps A lam_1^2 lam_2^2/T."""
    charge = 1e-10
    held = [dea.Stretch("x_max", "x", 2.0), dea.Stretch("y_max", "y", 1.5)]
    electrodes = [dea.ChargedElectrode("top", charge), dea.Ground("bottom")]
    run = dea.solve(film(cube, dea.NeoHookean(MU), electrodes, prescribed=held),
                    [dea.Ramp("charge", steps=2), dea.Ramp("stretch", steps=4)],
                    MEASURED | ELECTRIC, quiet=True, options=TIGHT)  # fmt: skip
    capacitance = EPS * T * (2.0 * 1.5) ** 2
    assert run["C_F"] == pytest.approx(capacitance, rel=1e-8)
    assert run["phi_V"] == pytest.approx(charge / capacitance, rel=1e-8)
    assert run["Q_C"] == pytest.approx(charge, rel=1e-10)


@pytest.mark.parametrize("name", MODELS)
def test_true_stress_and_live_maxwell_pressure(rough, name):
    """True stress s in both directions and true pressure p on the faces, then a voltage.

    f(lam) = s + p + eps (lam^2 V/T)^2: p alone is the thesis's Maxwell pressure, held live.
    """
    exact = dea.Material(MODELS[name])
    s, p, volts = 20e3, 10e3, 1500.0
    loads = [dea.FollowerPressure("x_max", -s, ramp="stress"),
             dea.FollowerPressure("y_max", -s, ramp="stress"),
             dea.FollowerPressure("top", p, ramp="pressure")]  # fmt: skip
    electrodes = [dea.Electrode("top", volts), dea.Ground("bottom")]
    path = [dea.Ramp(what, steps=2) for what in ("pressure", "stress", "voltage")]
    run = dea.solve(film(rough, single(name), electrodes, loads=loads), path, MEASURED, quiet=True,
                    options=TIGHT)  # fmt: skip
    x = run.column("x")
    for k, total in ((2, p), (4, p + s), (6, p + s + EPS * (x[6] ** 2 * volts / T) ** 2)):
        assert elastic_stress(exact, x[k], x[k])[0] == pytest.approx(total, rel=1e-8)
    assert x[6] > 1.05


@pytest.mark.parametrize(
    ("kinematics", "supports", "exact"),
    [
        (dea.PlaneStrain(depth=0.02), [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
         lambda q: q["depth"]),
        (dea.Axisymmetric(), [dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
         lambda q: np.pi * T),
    ],
    ids=["plane strain", "axisymmetric"],
)  # fmt: skip
def test_charge_in_two_dimensions(kinematics, supports, exact):
    """Held in the plane: V = Q T/(eps A), A = T x depth or pi T^2, whatever presses on it."""
    charge = 2e-10
    area = exact({"depth": getattr(kinematics, "depth", 1.0)}) * T
    device = block((2, 2))
    sides = [dea.Fix("x_max", kinematics.axes[0])]
    scene = dea.Scene(
        device,
        {"film": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.ChargedElectrode("top", charge), dea.Ground("bottom")],
        supports=[*supports, *sides],
        loads=[dea.FollowerPressure("top", 1e3)],
        kinematics=kinematics,
    )
    run = dea.solve(scene, dea.Ramp(steps=2), ELECTRIC, quiet=True, options=TIGHT)
    assert run["phi_V"] == pytest.approx(charge * T / (EPS * area), rel=1e-8)


def test_given_charges_alone_are_refused(cube):
    with pytest.raises(dea.InputError, match="add a Ground"):
        film(cube, dea.NeoHookean(MU), [dea.ChargedElectrode("top", 1e-9)])


def test_nan_charge_is_refused(cube):
    electrodes = [dea.ChargedElectrode("top", float("nan")), dea.Ground("bottom")]
    with pytest.raises(dea.InputError, match="charge of electrode 'top' is nan"):
        film(cube, dea.NeoHookean(MU), electrodes)


@pytest.mark.slow
@pytest.mark.mpi
def test_charge_on_several_ranks(start, tmp_path):
    """The one floating potential is shared by all ranks."""
    script = tmp_path / "charged.py"
    script.write_text(
        "import sys\nfrom mpi4py import MPI\nimport dea_fenicsx as dea\n"
        "from dea_fenicsx.geometry import BoxStack, Layer\n"
        "box = BoxStack(4e-3, 2e-3, [Layer('film', 1e-3)], divisions=(4, 2))\n"
        "device = dea.read_gmsh(box, MPI.COMM_WORLD)\n"
        "film = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0))\n"
        "scene = dea.Scene(device, {'film': film}, supports=[dea.Clamp('x_min')],\n"
        "    electrodes=[dea.ChargedElectrode('top', 3e-9), dea.Ground('bottom')])\n"
        "dea.solve(scene, dea.Ramp(steps=3), {'phi': dea.Potential('top'),\n"
        "    'tip': dea.MeanDisplacement('x_max', 'x')}, out=sys.argv[1], quiet=True)\n"
    )
    found = []
    for ranks in (1, 3):
        start(script, tmp_path / str(ranks), ranks=ranks, check=True)
        found.append(dea.read_history(tmp_path / str(ranks)))
    for column in ("phi_V", "tip_m"):
        assert found[1][column] == pytest.approx(found[0][column], rel=1e-8, abs=1e-15)
    assert found[0]["phi_V"][-1] > 1000
