"""Scenes of one or two cells in every kinematics, for runs on more ranks than there are cells.

`on_two_ranks` and `on_three` are started under mpirun by test_ranks.py.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from typing import Any

import numpy as np

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer, _gmsh

os.environ["DEA_FENICSX_CFLAGS"] = "-O1 -g0"  # the kernels run on a few cells only
RUBBER = dea.NeoHookean(5e4)
FILM = dea.Material(RUBBER, dea.IdealDielectric(3.0, breakdown=60e6))
KIND = {1: 1, 2: 2, 3: 4}  # gmsh's number of the simplex with straight edges, by dimension


@dataclass(frozen=True)
class Simplices:
    """Triangles or tetrahedra, one region called "film", with named faces; in metres."""

    points: tuple[tuple[float, ...], ...]
    cells: tuple[tuple[int, ...], ...]
    faces: dict[str, tuple[tuple[int, ...], ...]]

    def build(self) -> Any:
        import gmsh

        _gmsh.start()
        model = gmsh.model
        model.add("simplices")
        dim = len(self.cells[0]) - 1
        points = np.zeros((len(self.points), 3))
        points[:, :dim] = self.points
        model.addDiscreteEntity(dim, 1)
        model.mesh.addNodes(dim, 1, range(1, len(points) + 1), points.ravel())
        groups = {"film": self.cells, **self.faces}
        for tag, (name, parts) in enumerate(groups.items(), 1):
            d = dim if name == "film" else dim - 1
            if d < dim:
                model.addDiscreteEntity(d, tag)
            first = 1 + 10 * tag
            numbers = range(first, first + len(parts))
            model.mesh.addElementsByType(tag, KIND[d], numbers, np.ravel(parts) + 1)
            model.addPhysicalGroup(d, [tag], tag=tag, name=name)
        return model


L = 1e-3
TRIANGLES = Simplices(
    ((0, 0), (L, 0), (0, L), (L, L)), ((0, 1, 3), (0, 3, 2)),
    {"bottom": ((0, 1),), "top": ((2, 3),), "x_min": ((0, 2),)},
)  # fmt: skip
TETRAHEDRA = Simplices(
    ((0, 0, 0), (L, 0, 0), (0, L, 0), (0, 0, L), (L, L, L)), ((0, 1, 2, 3), (1, 2, 3, 4)),
    {"bottom": ((0, 1, 2),), "top": ((1, 3, 4),), "front": ((0, 1, 3),)},
)  # fmt: skip


def strip(comm, layers=("film",), x0=0.0, cells=1):
    return dea.read_gmsh(BoxStack(L, None, [Layer(n, L) for n in layers], cells, x0=x0), comm)


def hexahedron(comm):
    """A free cube; failures, the inertia at every step, most observables."""
    device = dea.read_gmsh(BoxStack(L, L, [Layer("film", L)]), comm)
    scene = dea.Scene(
        device, {"film": FILM},
        [dea.Electrode("bottom", 4e3), dea.Ground("top")], [dea.FreeBody()],
        loads=[dea.DeadPressure("top", 500.0), dea.DeadPressure("bottom", 500.0)],
    )  # fmt: skip
    record = {
        "up": dea.MeanDisplacement("top", "z"), "most": dea.LargestDisplacement("top", "z"),
        "high": dea.MeanStretch(("bottom", "top"), "z"),
        "less": dea.Contraction(("bottom", "top"), "z"),
        "area": dea.Area("top"), "q": dea.Charge("bottom"), "c": dea.Capacitance("bottom"),
        "v": dea.Potential("bottom"), "turn": dea.Rotation("top", "z"),
        "bend": dea.BendingAngle(("bottom", "top"), "z"),
    }  # fmt: skip
    failures = [dea.ElectricalBreakdown(safety=1.5), dea.StretchLimit(1.005)]
    return scene, [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=2)], record, {
        "failures": failures, "stability": "every"}  # fmt: skip


def split_factor(comm):
    """A pre-stretch and a follower pressure, with a factor of blocks."""
    device = dea.read_gmsh(BoxStack(L, L, [Layer("film", L)], (2, 1)), comm)
    scene = dea.Scene(
        device, {"film": FILM}, [dea.Electrode("top", 3e3), dea.Ground("bottom")],
        [dea.Clamp("x_min"), dea.Fix("x_max", "x")],
        [dea.PreStretch("film", x=1.1, y=1.0)], [dea.FollowerPressure("top", 300.0)],
    )  # fmt: skip
    record = {"hold": dea.Reaction("x_max", "x"), "up": dea.MeanDisplacement("top", "z")}
    path = dea.Ramp(("prestretch", "voltage", "load"), steps=1)
    return scene, path, record, {
        "options": dea.NewtonOptions(factor="split"), "failures": [dea.LossOfTension("z")]
    }  # fmt: skip


def multigrid(comm):
    """Levels of multigrid, of which a rank may have no cell."""
    device = dea.read_gmsh(BoxStack(L, L, [Layer("film", L)], (2, 1)), comm)
    scene = dea.Scene(
        device, {"film": FILM}, [dea.Electrode("top", 3e3), dea.Ground("bottom")],
        [dea.Clamp("x_min")],
    )  # fmt: skip
    record = {"up": dea.MeanDisplacement("top", "z")}
    return scene, dea.Ramp(steps=1), record, {"options": dea.NewtonOptions(factor="multigrid")}


def tetrahedra(comm, geometry=TETRAHEDRA):
    """Slanted faces; one electrode alone, so that there is a potential and no field."""
    scene = dea.Scene(
        dea.read_gmsh(geometry, comm), {"film": FILM}, [dea.Electrode("bottom", 1e3)],
        [dea.Clamp("bottom")], loads=[dea.DeadLoad("front", (0.0, 0.0, 2e3))],
    )  # fmt: skip
    record = {"up": dea.LargestDisplacement("front", "z"), "hold": dea.Reaction("bottom", "z")}
    return scene, dea.Ramp(steps=1), record, {}


def one_tetrahedron(comm):
    faces = {k: TETRAHEDRA.faces[k] for k in ("bottom", "front")}
    return tetrahedra(comm, Simplices(TETRAHEDRA.points[:4], TETRAHEDRA.cells[:1], faces))


def triangles(comm):
    scene = dea.Scene(
        dea.read_gmsh(TRIANGLES, comm), {"film": FILM},
        [dea.Electrode("top", 2e3), dea.Ground("bottom")], [dea.Clamp("bottom")],
        kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"up": dea.MeanDisplacement("top", "y"), "q": dea.Charge("top")}
    return scene, dea.Ramp(steps=2), record, {"stability": "every"}


def charge(comm):
    """A charged electrode between two films, in plane strain; then a dead load."""
    scene = dea.Scene(
        strip(comm, ("film", "other")), {"film": FILM, "other": FILM},
        [dea.ChargedElectrode("interface_1", 2e-11), dea.Ground(("bottom", "top"))],
        [dea.Clamp("bottom")], loads=[dea.DeadLoad("top", (0.0, 1e3))],
        kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"v": dea.Potential("interface_1"), "q": dea.Charge("interface_1"),
              "c": dea.Capacitance("interface_1")}  # fmt: skip
    return scene, [dea.Ramp("charge", steps=1), dea.Ramp("load", steps=1)], record, {}


def slice_free(comm):
    """Generalised plane strain: the stretch along the depth is free."""
    scene = dea.Scene(
        strip(comm), {"film": FILM}, [dea.Electrode("top", 5e3), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")], loads=[dea.AxialForce(1e-3)],
        kinematics=dea.GeneralisedPlaneStrain(L),
    )  # fmt: skip
    record = {"along": dea.OverallStretch(), "force": dea.OverallForce(),
              "less": dea.OverallContraction()}  # fmt: skip
    return scene, [dea.Ramp("load", steps=1), dea.Ramp("voltage", steps=2)], record, {
        "stability": "every"}  # fmt: skip


def slice_held(comm):
    scene = dea.Scene(
        strip(comm), {"film": FILM}, [dea.Electrode("top", 5e3), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")], [dea.AxialStretch(1.2)],
        kinematics=dea.GeneralisedPlaneStrain(L),
    )  # fmt: skip
    return scene, dea.Ramp(steps=2), {"force": dea.OverallForce()}, {}


def ring(comm):
    """An axisymmetric ring under pressure, with a compressible film."""
    film = dea.Material(RUBBER, dea.IdealDielectric(3.0), bulk_modulus=5e6)
    scene = dea.Scene(
        strip(comm, x0=L), {"film": film}, [dea.Electrode("top", 4e3), dea.Ground("bottom")],
        [dea.Fix("bottom", "z")], [dea.Displacement("x_max", "r", 0.05 * L)],
        [dea.FollowerPressure("x_min", 1e3)], dea.Axisymmetric(),
    )  # fmt: skip
    record = {"out": dea.MeanDisplacement("x_min", "r"), "hold": dea.Reaction("x_max", "r"),
              "area": dea.Area("top")}  # fmt: skip
    return scene, [dea.Ramp("stretch", steps=1), dea.Ramp(("load", "voltage"), steps=2)], record, {}


def helix(comm):
    """A helical cell of one film: free stretch and twist, a torque, a taper."""
    device = strip(comm, x0=2 * L)
    scene = dea.Scene(
        device, {"film": FILM}, [dea.Electrode("x_max", 3e3), dea.Ground("x_min")],
        [dea.FreeBody()], loads=[dea.Torque(1e-7), dea.AxialForce(1e-3)],
        kinematics=dea.Helical(2 * L),
    )  # fmt: skip
    record = {"along": dea.OverallStretch(), "twist": dea.OverallTwist(),
              "torque": dea.OverallTorque()}  # fmt: skip
    return scene, [dea.Ramp("load", steps=1), dea.Ramp("voltage", steps=2)], record, {
        "stability": "every"}  # fmt: skip


def thin_film(comm):
    """A film of given field, plane strain, two ramps at once."""
    scene = dea.Scene(
        strip(comm), {"film": FILM},
        [dea.ThinFilm("film", 4e3, start=0.0, end=L, along="y")], [dea.Clamp("bottom")],
        [dea.Stretch("top", "y", 1.05)], kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"q": dea.Charge("film"), "hold": dea.Reaction("top", "y")}
    return scene, dea.Ramp(steps=2), record, {}


def traced(comm):
    """Pull-in of a free film by arc length, to a stretch behind the limit point."""
    scene = dea.Scene(
        strip(comm), {"film": FILM}, [dea.Electrode("top", 8e3), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")], kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    record = {"high": dea.MeanStretch(("bottom", "top"), "y")}
    path = dea.Trace("voltage", first=0.3, until=("high", 0.6), at=(0.5,))
    return scene, path, record, {"stability": "every"}


class Mine:
    """A user's observable: the number of cells, added up over the ranks."""

    unit = ""

    def bind(self, problem):
        device = problem.scene.device
        return lambda: device.comm.allreduce(device.owned_cells())


ON_TWO = [
    hexahedron, one_tetrahedron, triangles, slice_free, slice_held, ring, helix, thin_film, traced,
]
"""Of one cell, but for the triangles."""

ON_THREE = [split_factor, multigrid, tetrahedra, charge]
"""Of two cells.  Three ranks take long where there are two processors: so these are few."""


class Stop:
    """Interrupts the run at its second measurement, on one rank alone."""

    unit = ""

    def __init__(self, rank: int) -> None:
        self.rank = rank

    def bind(self, problem):
        import itertools
        import signal

        count = itertools.count()

        def measure():
            if next(count) == 1 and problem.comm.rank == self.rank:
                signal.raise_signal(signal.SIGTERM)
            return 0.0

        return measure


def outcome(run):
    """Columns of a run that do not depend on the number of ranks."""
    counted = {"newton_iterations", "krylov_iterations", "factorisations", "wall_s", "residual",
               "volume_error", "step", "retries"}  # fmt: skip
    rows = [
        {k: v for k, v in row.items() if k not in counted and not k.startswith("max_field_")}
        for row in run.history
    ]
    return {"status": run.summary["status"], "stable": run.summary["stable"], "rows": rows}


def solved(make, comm, folder):
    scene, path, record, options = make(comm)
    record = record | {"mine": Mine()}
    out = os.path.join(folder, make.__name__)
    run = dea.solve(scene, path, record, out, quiet=True, **options)
    found = outcome(run)
    if make in (hexahedron, slice_free, helix):  # interrupted and carried on
        out += "_resumed"
        stopping = record | {"stop": Stop(comm.size - 1)}
        try:
            dea.solve(scene, path, stopping, out, quiet=True, **options)
            found["interrupted"] = False
        except dea.Interrupted:
            found["interrupted"] = True
        stopping["stop"] = Stop(-1)
        again = dea.solve(scene, path, stopping, out, quiet=True, resume=True, **options)
        found["resumed"] = outcome(again)["rows"][-1]
        found["resumed"].pop("stop")
    return found


def on(comm, scenes):
    """Every scene by its name: what was found, or why it failed."""
    folder = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None, root=0)
    found = {}
    for make in scenes:
        try:
            found[make.__name__] = solved(make, comm, folder)
        except dea.DeaError as error:
            found[make.__name__] = f"{type(error).__name__}: {error}"
    return found


def on_two_ranks(comm):
    return on(comm, ON_TWO)


def on_three(comm):
    return on(comm, ON_THREE)
