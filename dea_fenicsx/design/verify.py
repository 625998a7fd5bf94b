"""Finite elements of a design, to set beside the analytic strokes.

Three models, each with what the analytic one leaves out: a single ring on its base, the periodic
cell between the middles of two electrodes, and the helix in three dimensions.  All are small enough
to be solved by one rank alone, as inside `optimise`.
"""

from __future__ import annotations

from typing import Any, TypedDict, Unpack

import numpy as np
from mpi4py import MPI
from scipy.interpolate import CubicSpline

from dea_fenicsx.geometry import HDEA, BoxStack, Layer
from dea_fenicsx.materials import Conductor, Material, NeoHookean
from dea_fenicsx.measure.observables import MeanDisplacement, Reaction
from dea_fenicsx.mesh.device import device as device_of
from dea_fenicsx.path.items import Ramp
from dea_fenicsx.results.finished import Run
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.conditions import Clamp, Displacement, Electrode, Fix, FreeBody, Ground
from dea_fenicsx.scene.kinematics import Axisymmetric
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import EquilibriumLost, InputError
from dea_fenicsx.support.validation import keywords

BASES = ("sliding", "bonded")


def ring_stroke(
    outer_radius: float,
    inner_radius: float,
    elastomer: float,
    *,
    material: Material,
    voltage: float,
    base: str = "sliding",
    cells: tuple[int, int] = (12, 2),
    steps: int = 4,
) -> dict[str, float]:
    """One layer between ideal electrodes, axisymmetric, its top free.

    Parameters
    ----------
    outer_radius, inner_radius, elastomer
        In m.
    material, voltage
        The dielectric, and V between its faces.
    base
        ``"sliding"``: then the state is homogeneous and equals the analytic one.  ``"bonded"``:
        the base does not move; the edges of the ring then contract and its middle hardly does.
    cells
        Over the width, graded towards its edges where it is bonded, and through the thickness.
    steps
        Voltage steps.

    Returns
    -------
    dict
        ``stroke_m`` (mean over the top), ``max_field_V_per_m``.

    Raises
    ------
    EquilibriumLost
        At pull-in.
    """
    if base not in BASES:
        raise InputError(f"The base is {base!r}, but must be one of {', '.join(BASES)}.")
    bonded = base == "bonded"
    layer = Layer("film", elastomer, divisions=cells[1])
    shape = BoxStack(outer_radius - inner_radius, None, [layer], divisions=(cells[0],),
                     grading=8.0 if bonded else 1.0, x0=inner_radius)  # fmt: skip
    scene = Scene(
        device_of(shape, MPI.COMM_SELF),
        {"film": material},
        electrodes=[Electrode("top", voltage), Ground("bottom")],
        supports=[Clamp("bottom") if bonded else Fix("bottom", "z")],
        kinematics=Axisymmetric(),
    )
    record = {"top": MeanDisplacement("top", "z")}
    run = solve(scene, Ramp("voltage", steps=steps), record, quiet=True, stability="never")
    return {"stroke_m": -run["top_m"], "max_field_V_per_m": run["max_field_V_per_m"]}


class CellOptions(TypedDict, total=False):
    """Electrodes, mesh and path of `cell_stroke`.

    Attributes
    ----------
    electrode
        Thickness of the electrodes in m.
    cells
        Over the width, and through the elastomer.
    steps
        Of the height.
    """

    electrode: float
    cells: tuple[int, int]
    steps: int


def cell_stroke(
    outer_radius: float,
    inner_radius: float,
    elastomer: float,
    *,
    material: Material,
    voltage: float,
    electrode_mu: float,
    largest: float,
    **options: Unpack[CellOptions],
) -> dict[str, float]:
    """One layer of a tall stack: from the middle of an electrode to the middle of the next.

    Both ends are planes of symmetry, so they stay flat.  The voltage is brought on at constant
    height, and then the height is lowered until the axial force on the end has changed sign: the
    stroke is where it vanishes.

    Parameters
    ----------
    electrode_mu
        Shear modulus in Pa of the electrodes, which are neo-Hookean.
    largest
        A stroke in m that is not reached, as the analytic one times 1.1.
    options
        ``electrode``, the thickness of the electrodes in m (50e-6), ``cells`` over the width and
        through the elastomer ((12, 2)), and ``steps`` of the height (12).

    Returns
    -------
    dict
        ``stroke_m``, ``max_field_V_per_m`` (the latter at the largest stroke).

    Raises
    ------
    EquilibriumLost
        If the force does not change sign: beyond pull-in, as a rule.
    """
    chosen = keywords(
        "cell_stroke", options, CellOptions,
        {"electrode": 50e-6, "cells": (12, 2), "steps": 12},
    )  # fmt: skip
    width, through = chosen["cells"]
    half = chosen["electrode"] / 2
    layers = [
        Layer("lower", half),
        Layer("film", elastomer, divisions=through, grading=3.0),
        Layer("upper", half),
    ]
    shape = BoxStack(outer_radius - inner_radius, None, layers, divisions=(width,), grading=8.0,
                     x0=inner_radius)  # fmt: skip
    metal = Material(NeoHookean(electrode_mu), Conductor())
    scene = Scene(
        device_of(shape, MPI.COMM_SELF),
        {"lower": metal, "film": material, "upper": metal},
        electrodes=[Electrode("upper", voltage), Ground("lower")],
        supports=[Fix("bottom", "z")],
        prescribed=[Displacement("top", "z", -largest)],
        kinematics=Axisymmetric(),
    )
    path = [Ramp("voltage", steps=4), Ramp("stretch", steps=chosen["steps"])]
    run = solve(scene, path, {"force": Reaction("top", "z")}, quiet=True, stability="never")
    lowered = run.column("stretch_factor")
    kept = run.column("voltage_V") == voltage
    x, force = lowered[kept], run.column("force_N")[kept]
    if np.all(force > 0) or np.all(force < 0):
        raise EquilibriumLost(
            f"The cell finds no equilibrium at {voltage:g} V down to a stroke of {largest:g} m: it "
            "has pulled in, or `largest` is too small."
        )
    roots = CubicSpline(x, force).roots(extrapolate=False)
    return {
        "stroke_m": float(roots[0]) * largest,
        "max_field_V_per_m": run["max_field_V_per_m"],
    }


def helix_stroke(
    outer_radius: float,
    inner_radius: float,
    elastomer: float,
    *,
    material: Material,
    voltage: float,
    turns: int = 2,
    steps: int = 4,
    **options: Any,
) -> dict[str, float]:
    """A free helix with ideal electrodes, in three dimensions.

    The layer below the first electrode is passive and curls a helix of few turns, whose stroke is
    then well above the analytic one; over eight turns they agree within 1 %.

    Parameters
    ----------
    turns
        See `HDEA`.
    steps
        Voltage steps.
    options
        ``comm``, whose ranks share the work (MPI.COMM_SELF); all others are parameters of `HDEA`,
        such as ``inset`` (0) and its divisions ``angular``, ``radial``, ``rim`` and ``through``.

    Returns
    -------
    dict
        ``stroke_m`` (mean of the top against mean of the bottom), ``layers`` that are driven,
        ``max_field_V_per_m``, ``unknowns``.
    """
    comm, inset = options.pop("comm", MPI.COMM_SELF), options.pop("inset", 0.0)
    shape = HDEA(outer_radius, inner_radius, inset, elastomer, 0.0, turns, **options)
    driven = ("electrode_b_active", "electrode_b_top") if turns > 1 else "electrode_b_top"
    scene = Scene(
        device_of(shape, comm),
        {"elastomer": material},
        electrodes=[Electrode("electrode_a_active", voltage), Ground(driven)],
        supports=[FreeBody()],
    )
    record = {
        "top": MeanDisplacement("electrode_b_top", "z"),
        "bottom": MeanDisplacement("bottom", "z"),
    }
    run: Run = solve(scene, Ramp("voltage", steps=steps), record, quiet=True, stability="never")
    return {
        "stroke_m": run["bottom_m"] - run["top_m"],
        "layers": 2 * turns - 1,
        "max_field_V_per_m": run["max_field_V_per_m"],
        "unknowns": float(run.summary["unknowns"]),
    }
