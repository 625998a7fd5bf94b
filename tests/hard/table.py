"""The table: a case is a function that solves something hard and checks the answer itself.

What it must end in is one of `VERDICTS`; a function that returns has completed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.exact import elastic_stress
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

COMPLETED, LOST, REFUSED, FAILED, NOT_REACHED = VERDICTS = (
    "completed", "equilibrium lost", "refused", "solver failed", "not reached",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A hard case: its name, what it must end in, words of the message, and what runs it."""

    name: str
    expected: str
    words: str
    run: Callable[[], Any]


CASES: dict[str, Case] = {}


def case(name: str, expected: str = COMPLETED, words: str = "", *arguments: Any) -> Callable:
    """Enter a function into the table, with arguments if it serves several cases."""
    assert expected in VERDICTS and name not in CASES

    def enter(function: Callable) -> Callable:
        CASES[name] = Case(name, expected, words, lambda: function(*arguments))
        return function

    return enter


def verdict(it: Case) -> tuple[str, str]:
    """Run a case: what it ended in, and the message or what was wrong."""
    try:
        found = it.run()
    except dea.InputError as error:
        return REFUSED, str(error)
    except dea.EquilibriumLost as error:
        return LOST, str(error)
    except dea.NotReached as error:
        return NOT_REACHED, str(error)
    except dea.SolverError as error:
        return FAILED, str(error)
    except AssertionError as error:
        return "wrong answer", str(error).split("\n")[0]
    return COMPLETED, str(found or "")


def passed(it: Case, ended: str, message: str) -> bool:
    """Whether a case ended as it must; a refusal is one sentence that holds the words wanted."""
    if ended != it.expected or it.words not in message:
        return False
    sentence = message.endswith(".") and "\n" not in message and len(message) < 400
    return ended in (COMPLETED, "wrong answer") or sentence


# ---------------------------------------------------------------------------------- small films

MU, EPS_R, T = 50e3, 2.86, 1e-3
EPS = EPS_R * EPSILON_0
UNIT = T * np.sqrt(MU / EPS)
LIMIT = 0.687364819 * UNIT  # stationary value of sqrt(lam^-2 - lam^-8), at lam = 2^(1/3)
RUBBER = dea.NeoHookean(MU)
Z = {"z": dea.MeanStretch(("bottom", "top"), "z")}
ROUND = dea.Axisymmetric()
TIGHT = dea.NewtonOptions(tolerance=1e-12)


def strip(cells=(1, 1), size=T, thickness=None, layers=None, order=2):
    """A flat mesh of quadrilaterals; axisymmetric, a disc with its axis at x_min."""
    layers = layers or [Layer("film", size if thickness is None else thickness, divisions=cells[1])]
    return dea.read_gmsh(BoxStack(size, None, layers, cells[:1], order=order), MPI.COMM_SELF)


def film(elastic=RUBBER, volts=0.0, load=0.0, stretch=None, device=None, eps_r=EPS_R, bulk=None,
         **changes):  # fmt: skip
    """A disc of film on rollers, which stays homogeneous, under a radial dead load or stretch."""
    device = device or strip()
    material = dea.Material(elastic, dea.IdealDielectric(eps_r), bulk)
    settings = dict(
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")],
        loads=[dea.DeadLoad("x_max", (load, 0.0))],
        prescribed=[dea.Stretch("x_max", "r", stretch)] if stretch else (),
        kinematics=ROUND,
    )  # fmt: skip
    return dea.Scene(device, dict.fromkeys(device.regions, material), **(settings | changes))


def close(value, wanted, rel=1e-7, what="value"):
    """Assert that a value (or an array) is the closed form's."""
    error = float(np.max(np.abs(np.asarray(value) - wanted) / np.maximum(np.abs(wanted), 1e-300)))
    assert error <= rel, f"{what} {np.ravel(value)[-1]:.10g} is off by {error:.1e}, allowed {rel:g}"
    return f"{what} within {max(error, 1e-16):.0e}"


def on_the_curve(run, elastic, thickness=T, eps=EPS, load=0.0, rel=1e-7):
    """All steps obey lam s + eps (lam^2 V/T)^2 = f(lam)."""
    z = run.column("z")
    lam = z**-0.5
    volts = run.column("voltage_V") if "voltage_V" in run.history[0] else 0.0
    s = load * (run.column("load_factor") if "load_factor" in run.history[0] else 0.0)
    f = elastic_stress(dea.Material(elastic), lam, lam)[0]
    miss = np.abs(lam * s + eps * (lam**2 * volts / thickness) ** 2 - f)
    worst = float(np.max(miss / (elastic.shear_modulus() + np.abs(f))))
    assert worst < rel, f"closed form missed by {worst:.1e}"
    return f"stretch {lam[-1]:.6g}, closed form within {max(worst, 1e-16):.0e}"


def limit_of(elastic, thickness=T, eps=EPS, load=0.0, highest=2.0):
    """Voltage and stretch at the first maximum of the closed form's curve."""

    def volts(lam):
        f = elastic_stress(dea.Material(elastic), lam, lam)[0] - lam * load
        return thickness * np.sqrt(max(f, 0.0) / eps) / lam**2

    top = minimize_scalar(lambda x: -volts(x), bounds=(1.0, highest), method="bounded",
                          options={"xatol": 1e-10})  # fmt: skip
    return float(-top.fun), float(top.x)


def lost(scene, path, limit, within, record=Z, unit=None, ramp="voltage", **options):
    """Solve to where equilibrium is lost; the loads named must enclose the limit closely."""
    unit = unit or scene.reference_voltage(ramp) or 1.0
    try:
        dea.solve(scene, path, record, quiet=True, **options)
    except dea.EquilibriumLost as error:
        low, high = error.reached[ramp] * unit, error.failed[ramp] * unit
        assert low <= limit * (1 + 1e-6), f"{low:.6g} was accepted, above the limit {limit:.6g}"
        assert low > (1 - within) * limit, f"the path ended at {low:.6g}, far below {limit:.6g}"
        assert high < (1 + within) * limit, f"the limit is said to lie below {high:.6g}"
        raise
    raise AssertionError(f"passed the limit at {limit:.6g}")
