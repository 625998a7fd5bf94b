"""Devices and meshes: edges, thin and stiff layers, balloons, bad cells, missing supports."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, DiskStack, Layer
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support.compat import dolfinx
from hard.films import run
from hard.table import (
    COMPLETED,
    EPS,
    EPS_R,
    LIMIT,
    LOST,
    MU,
    REFUSED,
    ROUND,
    RUBBER,
    UNIT,
    T,
    Z,
    case,
    close,
    film,
    lost,
    on_the_curve,
    strip,
)

PLANE = dea.PlaneStrain()
DIELECTRIC = dea.Material(RUBBER, dea.IdealDielectric(EPS_R))


# ------------------------------------------------------------------------ edges and stiff layers


def two_layers(cover, thickness, electrode, **changes):
    """A disc of film with a cover bonded to its top, on rollers."""
    device = strip((4, 2), layers=[Layer("film", T, divisions=2), Layer("cover", thickness)])
    settings = dict(
        electrodes=[dea.Electrode(electrode, 0.4 * UNIT), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Fix("bottom", "z")], kinematics=ROUND,
    )  # fmt: skip
    return dea.Scene(device, {"film": DIELECTRIC, "cover": cover}, **(settings | changes))


@case("modulus ratio 1e6 between stiffener and film")
def stiffener():
    """The stiffener lets nothing move in its plane: away from the rim the film stays as it was."""
    scene = two_layers(dea.Material(dea.NeoHookean(1e6 * MU)), T, "interface_1")
    record = {"r": dea.LargestDisplacement("interface_1", "r")}
    done = run(scene, dea.Ramp(steps=2), record)
    assert abs(done["r_m"]) < 1e-5 * T, "the stiffener gives way"
    return f"radial displacement under it {abs(done['r_m']) / T:.0e} of its radius"


@case("a conducting layer as electrode")
def conductor():
    """As stiff as the film and 1/1000 of its thickness: the free film's curve to that share."""
    cover = dea.Material(RUBBER, dea.Conductor())
    done = run(two_layers(cover, T / 1000, "cover"), dea.Ramp(steps=2),
               {"z": dea.MeanStretch(("bottom", "interface_1"), "z")})  # fmt: skip
    return on_the_curve(done, RUBBER, rel=2e-3)


@case("electrode edges inside the film")
def inner_edges():
    """Coarse cells; the largest field lies at the electrode's edge."""
    radius, inset = 1e-3, 3e-4
    geometry = DiskStack(radius, [Layer("film", 1e-4)], inset=inset, end_electrodes=True,
                         angular=8, radial=2)  # fmt: skip
    scene = dea.Scene(
        dea.read_gmsh(geometry, MPI.COMM_SELF), {"film": DIELECTRIC},
        electrodes=[dea.Electrode("top_active", 0.2 * UNIT / 10), dea.Ground("bottom_active")],
        supports=[dea.Clamp("side")],
    )  # fmt: skip
    done = run(scene, dea.Ramp(steps=2), {})
    at = float(np.hypot(done["max_field_x_m"], done["max_field_y_m"]))
    assert abs(at - (radius - inset)) < 2e-4, f"the largest field is at r = {at:.3g} m"
    return f"largest field at r = {at * 1e3:.3g} mm"


@case("stretch 4 x 4 in one go, a cube in space")
def cube():
    geometry = BoxStack(T, T, [Layer("film", T)], divisions=(1, 1))
    scene = dea.Scene(
        dea.read_gmsh(geometry, MPI.COMM_SELF), {"film": DIELECTRIC},
        electrodes=[dea.Electrode("top", 100.0), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.Stretch("x_max", "x", 4.0), dea.Stretch("y_max", "y", 4.0)],
    )  # fmt: skip
    done = run(scene, [dea.Ramp("stretch", steps=1), dea.Ramp("voltage", steps=1)])
    return close(done["z"], 1 / 16, 1e-8, "thickness stretch")


def beam(device, volts=0.0, **changes):
    settings = dict(
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")], kinematics=PLANE,
    )  # fmt: skip
    return dea.Scene(device, dict.fromkeys(device.regions, DIELECTRIC), **(settings | changes))


@case("compressed past buckling, followed straight")
def past_buckling():
    """The strip stays straight, as nothing disturbs it, and the end state is told as unstable."""
    device = strip((12, 1), size=2e-2, thickness=T)
    scene = beam(device, 1.0, supports=[dea.Clamp("x_min"), dea.Fix("x_max", "y")],
                 prescribed=[dea.Displacement("x_max", "x", -2e-3)])  # fmt: skip
    done = run(scene, dea.Ramp("stretch", steps=4), {"tip": dea.MeanDisplacement("top", "y")})
    assert done.summary["stable"] is False, "told as stable"
    return f"{int(done['inertia'])} negative eigenvalues"


@case("a cantilever bent by a dead load to a right angle")
def bent():
    """The tip's load grows 1000-fold; the tip ends below the clamp, hanging down."""
    device = strip((20, 1), size=2e-2, thickness=T)
    scene = beam(device, 0.0, loads=[dea.DeadLoad("x_max", (0.0, -0.2 * MU))], electrodes=())
    done = run(scene, dea.Ramp(steps=5), {"tip": dea.MeanDisplacement("x_max", "y")})
    assert done["tip_m"] < -1.5e-2, f"the tip is at {done['tip_m']:.3g} m"
    return f"tip at {done['tip_m'] * 1e3:.4g} mm of 20"


# -------------------------------------------------------------------------------------- balloon


def balloon(pressure, ratio=0.9):
    """Upper half of a thick sphere of unit outer radius (mm), bulged from a flat strip."""
    device = strip((8, 1), size=T, thickness=T)
    x = device.mesh.geometry.x
    angle, r = np.pi / 2 * x[:, 0], ratio + (1 - ratio) * x[:, 1]
    # from the pole to the equator; the strip's lower side becomes the inner face
    x[:, 0], x[:, 1] = r * np.sin(angle), r * np.cos(angle)
    x[np.abs(x) < 1e-15] = 0.0
    return dea.Scene(
        device, {"film": dea.Material(RUBBER)},
        supports=[dea.Fix("x_min", "r"), dea.Fix("x_max", "z")],
        loads=[dea.FollowerPressure("bottom", pressure)], kinematics=ROUND,
    )  # fmt: skip


def balloon_pressure(inner, ratio=0.9):
    """Neo-Hookean thick sphere: p/mu from the stretch of its inner face."""
    outer = (1 + ratio**3 * (inner**3 - 1)) ** (1 / 3)
    return (2 / outer + 0.5 / outer**4) - (2 / inner + 0.5 / inner**4)


TOP = minimize_scalar(lambda x: -balloon_pressure(x), bounds=(1.1, 2.0), method="bounded")
INNER = {"a": dea.LargestDisplacement("bottom", "z")}


@case("a balloon inflated past its highest pressure", LOST)
def burst():
    limit = -TOP.fun * MU
    lost(balloon(1.3 * limit), dea.Ramp(steps=6), limit, 3e-3, INNER, 1.3 * limit, "load")


@case("a balloon followed past its highest pressure")
def inflated():
    done = run(balloon(MU), dea.Trace("load", first=0.05, until=("a_m", 0.9e-3)), INNER)
    inner = 1 + done.column("a_m") / 0.9e-3
    close(done.column("load_factor")[3:], balloon_pressure(inner)[3:], 2e-3, "pressure")
    top = next(row for row in done.history if row["event"] == "maximum")
    return close(top["load_factor"], -TOP.fun, 1e-4, "highest pressure")


# --------------------------------------------------------------------------------------- meshes


def triangles(flat=1.0, kind="triangle", n=3):
    """A mesh of triangles or tetrahedra, flattened, with the names of a film."""
    cell = getattr(dolfinx.mesh.CellType, kind)
    if kind == "triangle":
        mesh = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, n, n, cell)
    else:
        mesh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, n, n, n, cell)
    d = mesh.topology.dim
    ends = [("x_min", "x_max"), ("y_min", "y_max"), ("bottom", "top")]
    ends = ends if d == 3 else [ends[0], ends[2]]
    marks, surfaces = [], {}
    for axis, names in enumerate(ends):
        for end, name in enumerate(names):
            found = dolfinx.mesh.locate_entities_boundary(
                mesh, d - 1, lambda p, a=axis, e=end: np.isclose(p[a], e)
            )
            surfaces[name] = len(surfaces) + 1
            marks += [(f, surfaces[name]) for f in found]
    marks = np.array(sorted(marks), dtype=np.int32)
    facets = dolfinx.mesh.meshtags(mesh, d - 1, marks[:, 0], marks[:, 1])
    count = mesh.topology.index_map(d).size_local
    cells = dolfinx.mesh.meshtags(
        mesh, d, np.arange(count, dtype=np.int32), np.ones(count, dtype=np.int32)
    )
    for k in (d - 1, d):
        mesh.topology.create_connectivity(k, d)
    mesh.topology.create_connectivity(d, d - 1)
    mesh.geometry.x[:, d - 1] *= flat
    return Device(mesh, cells, facets, {"film": 1}, surfaces, T, kind)


def inner_nodes(device):
    """Numbers of the nodes inside a unit square or cube."""
    x = device.mesh.geometry.x[:, : device.dim]
    high = x.max(axis=0)
    return np.flatnonzero(np.all((x > 1e-9) & (x < high - 1e-9), axis=1))


def distort(device, share, n=3, seed=1):
    """Move the inner nodes at random, by a share of a cell."""
    inside = inner_nodes(device)
    size = device.mesh.geometry.x.max(axis=0) / n
    rng = np.random.default_rng(seed)
    device.mesh.geometry.x[inside] += share * size * rng.uniform(-1, 1, (len(inside), 3))
    return device


for _label, _make, _thick in (
    ("distorted quadrilaterals", lambda: distort(strip((3, 3), order=1), 0.3), T),
    ("triangles flattened 1 : 1000", lambda: triangles(1e-3), T / 1000),
    ("distorted triangles, down to slivers", lambda: distort(triangles(), 0.3, seed=3), T),
):

    @case(_label, COMPLETED, "", _make, _thick)
    def distorted(make, thickness):
        device = make()
        scene = film(volts=0.99 * LIMIT * thickness / T, device=device)
        return on_the_curve(run(scene, dea.Ramp(steps=4)), RUBBER, thickness=thickness, rel=1e-6)


@case("distorted tetrahedra")
def tetrahedra():
    device = distort(triangles(kind="tetrahedron", n=2), 0.3, n=2)
    scene = dea.Scene(
        device, {"film": DIELECTRIC},
        electrodes=[dea.Electrode("top", 0.95 * LIMIT), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip
    return on_the_curve(run(scene, dea.Ramp(steps=3)), RUBBER)


@case("a quadrilateral that is nearly folded")
def nearly_folded():
    """One inner corner pushed to 2 % before the opposite diagonal."""
    device = strip((2, 2), order=1)
    inside = inner_nodes(device)
    device.mesh.geometry.x[inside, :2] = 0.26
    return on_the_curve(run(film(volts=0.9 * LIMIT, device=device), dea.Ramp(steps=3)), RUBBER)


def fold(device, by):
    device.mesh.geometry.x[inner_nodes(device)[0], 0] += by
    return device


@case("a folded quadrilateral", REFUSED, "are folded or flat", lambda: strip((3, 3), order=1))
@case("an inverted triangle", REFUSED, "are inverted (", triangles)
@case("an inverted tetrahedron", REFUSED, "are inverted (", lambda: triangles(1.0, "tetrahedron"))
def inverted(make):
    device = fold(make(), 0.7)
    kinematics = ROUND if device.dim == 2 else dea.ThreeD()
    scene = beam(device, 1.0, supports=[dea.Clamp("bottom")], kinematics=kinematics)
    run(scene, dea.Ramp(steps=1))


@case("cells of no thickness", REFUSED, "are folded or flat")
def flat():
    run(film(volts=1.0, device=triangles(0.0)), dea.Ramp(steps=1))


@case("a mesh that reaches beyond the axis", REFUSED, "shift it so that the axis is at r = 0")
def beyond_the_axis():
    device = strip((2, 1))
    device.mesh.geometry.x[:, 0] -= 0.5
    run(film(volts=1.0, device=device), dea.Ramp(steps=1))


@case("cells that do not reach the axis: a ring")
def ring():
    """A ring whose hole is free is in the same homogeneous state under voltage alone."""
    geometry = BoxStack(T, None, [Layer("film", T)], divisions=(2,), x0=T / 2)
    device = dea.read_gmsh(geometry, MPI.COMM_SELF)
    scene = film(volts=0.95 * LIMIT, device=device, supports=[dea.Fix("bottom", "z")])
    return on_the_curve(run(scene, dea.Ramp(steps=3)), RUBBER)


# --------------------------------------------------------------------------------- rigid motions

for _label, _supports, _words in (
    ("a strip on rollers", [dea.Fix("x_min", "x")], "translation along y"),
    ("a strip on a rail", [dea.Fix("x_min", "y")], "rotation about (0, 0.0005) m"),
):

    @case(f"rigid motion: {_label}", REFUSED, _words, _supports)
    def loose(supports):
        run(beam(strip(), 1.0, supports=supports), dea.Ramp(steps=1))


@case("rigid motion: a disc held at its rim only radially", REFUSED, "translation along z")
def loose_disc():
    run(film(volts=1.0, supports=[dea.Fix("x_max", "r")]), dea.Ramp(steps=1))


@case("rigid motion: a film on a table in space", REFUSED, "rotation about the z axis")
def loose_film():
    geometry = BoxStack(T, T, [Layer("film", T)], divisions=(1, 1))
    device = dea.read_gmsh(geometry, MPI.COMM_SELF)
    scene = beam(device, 1.0, supports=[dea.Fix("bottom", "z")], kinematics=dea.ThreeD())
    run(scene, dea.Ramp(steps=1))


assert EPS > 0 and Z
