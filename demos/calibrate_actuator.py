"""Constants of a bending actuator from its tip, its blocked force and its capacitance.

A soft film with electrodes is bonded to a stiffer film without.  Three constants are to be found:
the shear moduli of both films, and the permittivity.  The measurements are made here: a device of
known constants on a finer mesh, with noise.  From the motion of the tip alone only ratios of the
constants can be found, and the fit says so.  Together with the blocked force and the capacitance
the data fix all three.  The derivatives are those of the runs, by adjoint solves.  The regions know
of the noise alone: the coarser mesh of the fit adds an error of its own, which `--cells` lessens.

What the scatter of constants and thickness does to the stroke follows at the end, with the
probability that a film breaks down.

Run it with `mpirun -n 2 python demos/calibrate_actuator.py`.
"""

import csv
import json
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.calibration import Scatter, SceneTest
from dea_fenicsx.geometry import BoxStack, Layer

LENGTH, WIDTH = 4e-3, 1e-2  # m
ACTIVE, PASSIVE = 0.2e-3, 0.1e-3  # m, thicknesses
TRUE = {"active.elastic.mu": 50e3, "active.electric.eps_r": 3.0, "passive.elastic.mu": 200e3}
PATH = "voltage"


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/calibrate_actuator")
    parser.number("--volts", 3e3, "V", "largest voltage")
    parser.count("--points", 5, "number of voltages")
    parser.number("--noise", 0.01, "-", "standard deviation over the largest value")
    parser.number("--start-mu", 120e3, "Pa", "shear modulus at which both films start")
    parser.count("--cells", 12, "cells along the strip")
    parser.number("--breakdown", 18e6, "V/m", "true field at which a film breaks down")
    parser.count("--samples", 60, "samples of scattered devices")
    parser.count("--seed", 1, "seed of the noise")
    return parser, parser.parse_args()


def bender(comm, materials, volts, cells, blocked=False, active=ACTIVE):
    """The strip as a section, clamped at its left end; its right end is free or kept in height."""
    layers = [Layer("active", active), Layer("passive", PASSIVE)]
    device = dea.device(BoxStack(LENGTH, None, layers, divisions=cells), comm)
    held = [dea.Clamp("x_min"), *([dea.Fix("x_max", "y")] if blocked else [])]
    return dea.Scene(
        device, materials, electrodes=[dea.Electrode("bottom", volts), dea.Ground("interface_1")],
        supports=held, kinematics=dea.PlaneStrain(WIDTH),
    )  # fmt: skip


FREE = {"tip": dea.MeanDisplacement("x_max", "y"), "capacitance": dea.Capacitance("bottom")}
BLOCKED = {"force": dea.Reaction("x_max", "y")}


def material(values):
    return {
        "active": dea.Material(
            dea.NeoHookean(values["active.elastic.mu"]),
            dea.IdealDielectric(values["active.electric.eps_r"]),
        ),
        "passive": dea.Material(
            dea.NeoHookean(values["passive.elastic.mu"]), dea.IdealDielectric(3.0)
        ),
    }


def measured(args, volts, comm):
    """What a device of known constants does on a finer mesh, with noise; and the noise's size."""
    path = dea.Ramp(PATH, at=tuple(volts / volts[-1]))
    rng, values, errors = np.random.default_rng(args.seed), {}, {}
    for blocked, record in ((False, FREE), (True, BLOCKED)):
        scene = bender(comm, material(TRUE), volts[-1], 2 * args.cells, blocked)
        run = dea.solve(scene, path, record, quiet=True)
        at = [int(np.argmin(np.abs(run.column("voltage_V") - v)))
              for v in volts]  # fmt: skip
        for name in ("force_N",) if blocked else ("tip_m", "capacitance_F"):
            exact = run.column(name)[at]
            errors[name] = args.noise * float(np.abs(exact).max())
            values[name] = exact + rng.normal(0, errors[name], len(exact))
    return values, errors


def tests_of(args, volts, values, errors):
    path = dea.Ramp(PATH, at=tuple(volts / volts[-1]))

    def test(name, columns, record, blocked=False):
        return SceneTest(
            name, lambda comm, trial: bender(comm, trial.material, volts[-1], args.cells, blocked),
            path, record, volts, {c: values[c] for c in columns},
            error={c: errors[c] for c in columns},
        )  # fmt: skip

    alone = test("tip alone", ["tip_m"], FREE)
    both = [test("free end", ["tip_m", "capacitance_F"], FREE),
            test("blocked end", ["force_N"], BLOCKED, blocked=True)]  # fmt: skip
    return alone, both


def scattered(args, found, comm):
    """The scatter of the stroke, and the probability of breakdown, of devices as made.

    The moduli scatter by 5 %, the permittivity by 2 % and the thickness by 4 %.
    """

    def device(mu, eps_r, passive_mu, thickness):
        values = dict(zip(TRUE, (mu, eps_r, passive_mu), strict=True))
        scene = bender(comm, material(values), args.volts, args.cells, active=thickness)
        record = {"tip": FREE["tip"], "field": dea.OverRegion("field", regions="active")}
        run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
        margin = args.breakdown / run["field_V_per_m"]
        return {"stroke_m": abs(run["tip_m"]), "breakdown_margin": margin}

    mu, eps_r, passive_mu = found.values.values()
    scatter = {
        "mu": Scatter(mu, 0.05 * mu), "eps_r": Scatter(eps_r, 0.02 * eps_r),
        "passive_mu": Scatter(passive_mu, 0.05 * passive_mu),
        "thickness": Scatter(ACTIVE, 0.04 * ACTIVE),
    }  # fmt: skip
    return dea.uncertainty(device, scatter, samples=args.samples, failure={"breakdown_margin": 1.0})


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    if args.points <= len(TRUE):
        raise dea.InputError(
            f"--points is {args.points}, but must be at least {len(TRUE) + 1}: more than constants."
        )
    volts = np.linspace(args.volts / args.points, args.volts, args.points)

    def tell(text):
        if comm.rank == 0 and not args.quiet:
            print(text, flush=True)

    tell("computing what the true device does ...")
    values, errors = measured(args, volts, comm)
    alone, both = tests_of(args, volts, values, errors)
    parameters = [dea.Parameter(name, TRUE[name] if "eps" in name else args.start_mu,
                                1.0 if "eps" in name else 1e3) for name in TRUE]  # fmt: skip
    template = material({p.name: p.start for p in parameters})
    tell("fitting to the tip alone ...")
    first = dea.calibrate(alone, parameters, template)
    tell("fitting to the tip, the capacitance and the blocked force ...")
    found = dea.calibrate(both, parameters, template)
    tell("computing the scatter of devices as made ...\n")
    spread = scattered(args, found, comm)
    if comm.rank == 0:
        out = found.write(args.out)
        told = summary(found, first, spread) | {"settings": parser.settings(args)}
        (out / "summary.json").write_text(json.dumps(told, indent=1) + "\n", "utf-8")
        history(out, volts, found)
        if not args.quiet:
            print("from the tip alone:", *(f"the data do not fix {d}" for d in first.loose),
                  sep="\n  ")  # fmt: skip
            print(f"from the tip, the capacitance and the blocked force:\n{found}")
            print(f"devices as made:\n{spread}")


def summary(found, first, spread):
    told = {"status": "completed", "loose_from_tip_alone": len(first.loose),
            "loose_parts": first.loose[0].parts if first.loose else None,
            "loose": len(found.loose),
            "true_values_within_95_percent": found.contains(TRUE)}  # fmt: skip
    for name, value in TRUE.items():
        short = name.replace(".elastic", "").replace(".electric", "").replace(".", "_")
        unit = "" if "eps" in name else "_Pa"
        told[f"{short}{unit}"] = found.values[name]
        told[f"{short}_error"] = found.values[name] / value - 1
        told[f"{short}_deviation"] = found.deviations[name]
    for one in found.columns:
        told[f"{one.column.name.rsplit('_', 1)[0]}_relative_rms"] = one.relative
    return told | {
        "stroke_m": spread.value["stroke_m"], "stroke_deviation_m": spread.deviation["stroke_m"],
        "stroke_sampled_deviation_m": spread.sampled_deviation.get("stroke_m"),
        "breakdown_probability": spread.failure["breakdown_margin"],
        "breakdown_sampled_probability": spread.sampled_failure["breakdown_margin"][0],
    }  # fmt: skip


def history(out, volts, found):
    """A row for each voltage: what was measured and what is fitted."""
    columns = {"voltage_V": volts}
    for one in found.columns:
        base, unit = one.column.name.rsplit("_", 1)
        columns |= {f"{base}_measured_{unit}": one.column.measured,
                    f"{base}_fitted_{unit}": one.predicted}  # fmt: skip
    with Path(out, "history.csv").open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(["step", *columns])
        rows = zip(*columns.values(), strict=True)
        writer.writerows([k + 1, *map(repr, map(float, row))] for k, row in enumerate(rows))


if __name__ == "__main__":
    main()
