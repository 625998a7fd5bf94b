"""Scenes into which each public class of the package is put, with fields that are right."""

from __future__ import annotations

import functools

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import exact, geometry, materials, origami
from dea_fenicsx.geometry import BoxStack, Layer

RUBBER = materials.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))


@functools.cache
def strip(size=1):
    """Four quadrilaterals of film, on this rank alone or on all."""
    comm = MPI.COMM_WORLD if size > 1 else MPI.COMM_SELF
    return dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(4,)), comm)


def scene(comm=MPI.COMM_SELF, **changes):
    given = dict(
        device=strip(comm.size), materials={"film": RUBBER}, kinematics=dea.PlaneStrain(),
        electrodes=[dea.Electrode("top", 100.0), dea.Ground("bottom")],
        supports=[dea.Clamp("bottom")],
    )  # fmt: skip
    return dea.Scene(**(given | changes))


def solve(comm=MPI.COMM_SELF, path=None, record=None, changes=None, **options):
    """Check a scene and a path; what is refused is refused before anything is solved."""
    path = dea.Ramp(steps=1) if path is None else path
    return dea.solve(scene(comm, **(changes or {})), path, record, **({"quiet": True} | options))


def in_scene(kind, place):
    """Put an object of a class into a scene."""
    return lambda **given: scene(**{place: [kind(**given)]})


def membrane(kind, device=None, loads=(), supports=()):
    """Make an object of a class the kinematics of a film."""
    return lambda **given: scene(
        kinematics=kind(**given), device=device or strip(), loads=list(loads),
        electrodes=[dea.Electrode("film", 100.0)], supports=supports or [dea.Clamp("bottom")],
    )  # fmt: skip


@functools.cache
def surface(shape):
    return dea.device(shape, MPI.COMM_SELF)


def on_a_line(kind, loads=()):
    line = surface(geometry.Meridian((1e-3, 0.0), (2e-3, 0.0), cells=2))
    return membrane(kind, line, loads, [dea.Clamp("end")])


def in_space(kind):
    return membrane(kind, surface(geometry.Balloon(1e-3, 2)), (), [dea.Fix("x_min", "x")])


PLANE = dea.Plane((0.0, 2e-3), (0.0, -1.0))


def touched(kind, kinematics=None):
    """Make an object of a class the shape of an obstacle."""
    more = {} if kinematics is None else {"kinematics": kinematics}
    return lambda **given: scene(supports=[dea.Obstacle("top", kind(**given))], **more)


def pressing(kind):
    """Record an observable of a scene with an obstacle."""
    friction = 0.3 if kind is dea.FrictionWork else 0.0
    supports = [dea.Clamp("bottom"), dea.Obstacle("top", PLANE, friction=friction)]
    return lambda **given: solve(record={"x": kind(**given)}, changes={"supports": supports})


@functools.cache
def derived():
    """A run whose observable has derivatives."""
    return solve(record={"up": dea.MeanDisplacement("top", "y")})


SOURCE = [dea.Source("top", 100.0), dea.Ground("bottom")]


HEAVY = {"materials": {"film": materials.Material(
    dea.NeoHookean(5e4), dea.IdealDielectric(3.0), density=1e3
)}}  # fmt: skip


def switched(kind):
    """Put an item about a switch into a path."""
    return lambda **given: solve(path=kind(**given), changes={"electrodes": SOURCE})


def fed(kind):
    """Record an observable of a scene with a source."""
    return lambda **given: solve(record={"x": kind(**given)}, changes={"electrodes": SOURCE})


def of_material(kind):
    return lambda **given: scene(materials={"film": dea.Material(kind(**given))})


def of_dielectric(kind):
    return lambda **given: scene(
        materials={"film": dea.Material(dea.Gent(5e4, 9.0), kind(**given))}
    )


def thermal(**given):
    """Give a rubber a temperature."""
    rubber = dea.Material(
        dea.NeoHookean(5e4), dea.IdealDielectric(3.0), thermal=dea.Thermal(**given))  # fmt: skip
    return scene(materials={"film": rubber})


def of_temperature(kind):
    """Give a rubber a law of temperature of a class."""
    return lambda **given: thermal(reference=293.15, low=273.15, high=353.15, modulus=kind(**given))


def heated(kind):
    """Heat a rubber."""
    rubber = dea.Material(
        dea.NeoHookean(5e4), dea.IdealDielectric(3.0),
        thermal=dea.Thermal(293.15, 273.15, 353.15),
    )  # fmt: skip
    return lambda **given: scene(materials={"film": rubber}, prescribed=[kind(**given)])


def fibre(kind):
    """Give a rubber a family of fibres of a class."""
    return lambda **given: of_material(dea.Reinforced)(
        matrix=dea.NeoHookean(5e4), fibres=kind(**given))  # fmt: skip


def along(kind):
    """Give fibres a direction of a class."""
    return lambda **given: fibre(dea.StandardReinforcing)(k=1e4, direction=kind(**given))


def recorded(kind):
    return lambda **given: solve(record={"it": kind(**given)})


def placed(kind):
    """Name a surface by its place."""
    square = BoxStack(1e-3, None, [Layer("film", 1e-3)])
    return lambda **given: dea.read_gmsh(square, MPI.COMM_SELF, surfaces={"new": kind(**given)})


def driven(kind):
    return lambda **given: solve(path=dea.March(1.0, {"voltage": kind(**given)}))


FIELDS = {
    dea.Scene: (scene, dict.fromkeys(
        ("device", "materials", "electrodes", "supports", "prescribed", "loads", "kinematics",
         "elements"))),
    dea.Electrode: (in_scene(dea.Electrode, "electrodes"), dict(where="top", volts=1.0)),
    dea.ThinFilm: (in_scene(dea.ThinFilm, "electrodes"),
                   dict(where="film", volts=1.0, end=1e-3, along="y")),
    dea.ChargedElectrode: (
        in_scene(dea.ChargedElectrode, "electrodes"), dict(where="top", coulombs=1e-12)),
    dea.Taper: (lambda **g: scene(electrodes=[dea.Electrode("top", 1.0, taper=dea.Taper(**g))]),
                dict(start=0.0, end=1e-4, along="x")),
    dea.Graded: (in_scene(dea.Graded, "supports"),
                 dict(where="film", constant="elastic.mu", factor=lambda X: 1 + X[:, 0])),
    dea.Fix: (in_scene(dea.Fix, "supports"), dict(where="bottom", axes="x")),
    dea.Clamp: (in_scene(dea.Clamp, "supports"), dict(where="bottom")),
    dea.Stretch: (in_scene(dea.Stretch, "prescribed"), dict(where="top", axes="x", stretch=2.0)),
    dea.Displacement: (
        in_scene(dea.Displacement, "prescribed"), dict(where="top", axes="x", metres=1e-4)),
    dea.DeadLoad: (in_scene(dea.DeadLoad, "loads"), dict(where="top", pascal=(1.0, 0.0))),
    dea.DeadPressure: (in_scene(dea.DeadPressure, "loads"), dict(where="top", pascal=1.0)),
    dea.FollowerPressure: (in_scene(dea.FollowerPressure, "loads"), dict(where="top", pascal=1.0)),
    dea.PlaneStrain: (lambda **g: scene(kinematics=dea.PlaneStrain(**g)), dict(depth=1.0)),
    dea.Discretisation: (lambda **g: scene(elements=dea.Discretisation(**g)), {}),
    dea.NeoHookean: (of_material(dea.NeoHookean), dict(mu=5e4)),
    dea.Gent: (of_material(dea.Gent), dict(mu=5e4, Jm=100.0)),
    dea.MooneyRivlin: (of_material(dea.MooneyRivlin), dict(C10=2e4, C01=1e3)),
    dea.Yeoh: (of_material(dea.Yeoh), dict(C10=2e4, C20=10.0, C30=1.0)),
    dea.Ogden: (of_material(dea.Ogden), dict(mu=(5e4,), alpha=(2.0,))),
    dea.ArrudaBoyce: (of_material(dea.ArrudaBoyce), dict(mu=5e4, lam_m=3.0)),
    dea.Alexander: (
        of_material(dea.Alexander), dict(C1=1e4, C2=1e4, C3=1e3, k=1e-4, gamma=1.0)),
    dea.VanDerWaals: (of_material(dea.VanDerWaals), dict(mu=5e4, lam_m=8.0, a=0.2)),
    dea.OgdenRoxburgh: (
        lambda **g: scene(materials={"film": dea.Material(
            dea.NeoHookean(5e4), dea.IdealDielectric(3.0), damage=dea.OgdenRoxburgh(**g))}),
        dict(r=2.0, m=1e3)),
    dea.Thermal: (thermal, dict(reference=293.15, low=273.15, high=353.15)),
    dea.LinearChange: (of_temperature(dea.LinearChange), dict(per_kelvin=1e-3)),
    dea.TabulatedChange: (
        of_temperature(dea.TabulatedChange), dict(kelvin=[270.0, 360.0], values=[1.0, 2.0])),
    dea.WLF: (of_temperature(dea.WLF), dict(C1=8.0, C2=100.0)),
    dea.Arrhenius: (of_temperature(dea.Arrhenius), dict(joule_per_mole=5e4)),
    dea.Temperature: (heated(dea.Temperature), dict(where="film", kelvin=310.0)),
    dea.ExtendedTube: (of_material(dea.ExtendedTube), dict(Gc=1e5, Ge=1e5, delta=0.1, beta=0.5)),
    dea.SplineEnergy: (of_material(dea.SplineEnergy), dict(
        slope_1=1e5, knots_1=(1.0, 2.0), curvature_1=(1e5, 1e5),
        slope_2=1e4, knots_2=(1.0, 2.0), curvature_2=(1e4, 0.0))),
    dea.OgdenHill: (of_material(dea.OgdenHill), dict(mu=(5e4,), alpha=(2.0,), beta=(0.5,))),
    dea.BlatzKo: (of_material(dea.BlatzKo), dict(mu=5e4)),
    dea.Reinforced: (of_material(dea.Reinforced), dict(
        matrix=dea.NeoHookean(5e4), fibres=(dea.StandardReinforcing(1e4, (1, 0, 0)),))),
    dea.StandardReinforcing: (fibre(dea.StandardReinforcing), dict(k=1e4, direction=(1, 0, 0))),
    dea.HolzapfelFibres: (fibre(dea.HolzapfelFibres), dict(k1=1e4, k2=1.0, direction=(1, 0, 0))),
    dea.TransverselyIsotropic: (
        fibre(dea.TransverselyIsotropic), dict(k=1e4, c=1e3, direction=(1, 0, 0))),
    dea.Along: (along(dea.Along), dict(vector=(1.0, 0.0, 0.0))),
    dea.Cylindrical: (along(dea.Cylindrical), dict(vector=(1.0, 0.0, 0.0))),
    dea.Wound: (along(dea.Wound), dict(degrees=0.0)),
    dea.Helix: (along(dea.Helix), dict(pitch=1e-3)),
    dea.IdealDielectric: (
        lambda **g: scene(materials={"film": dea.Material(dea.Gent(5e4, 9.0), dea.IdealDielectric(
            **g))}), dict(eps_r=3.0)),
    dea.LinearPermittivity: (of_dielectric(dea.LinearPermittivity), dict(eps_r=3.0, slope=0.01)),
    dea.PolynomialPermittivity: (
        of_dielectric(dea.PolynomialPermittivity), dict(eps_r=3.0, coefficients=(0.01,))),
    dea.TabulatedPermittivity: (
        of_dielectric(dea.TabulatedPermittivity), dict(stretches=(1.0, 2.0), eps_r_at=(3.0, 2.0))),
    dea.Electrostriction: (of_dielectric(dea.Electrostriction), dict(eps_r=3.0, a1=0.5)),
    dea.SaturatingDielectric: (of_dielectric(dea.SaturatingDielectric), dict(eps_r=3.0, D_s=1e-3)),
    dea.LangevinDielectric: (of_dielectric(dea.LangevinDielectric), dict(eps_r=3.0, P_s=1e-3)),
    dea.CompositeDielectric: (
        of_dielectric(dea.CompositeDielectric), dict(matrix=3.0, filler=9.0, fraction=0.1)),
    dea.WeibullBreakdown: (
        lambda **g: scene(materials={"film": dea.Material(dea.Gent(5e4, 9.0), dea.IdealDielectric(
            3.0, dea.WeibullBreakdown(**g)))}), dict(field=1e8)),
    dea.Breakdown: (
        lambda **g: scene(materials={"film": dea.Material(dea.Gent(5e4, 9.0), dea.IdealDielectric(
            3.0, dea.Breakdown(**g)))}), dict(field=1e8)),
    dea.Air: (lambda **g: scene(materials={"film": dea.Air(**g)}, supports=[]),
              dict(name="air", stiffness=1e-9, smoothing=0.0)),
    dea.Material: (lambda **g: scene(materials={"film": dea.Material(**g)}),
                   dict(elastic=dea.NeoHookean(5e4))),
    dea.Ramp: (lambda **g: solve(path=dea.Ramp(**g)), {}),
    dea.ModeShape: (lambda **g: dea.imperfect(strip(1), dea.ModeShape(**g), 1e-5),
                    dict(folder="nowhere")),
    dea.RandomShape: (lambda **g: dea.imperfect(strip(1), dea.RandomShape(**g), 1e-5),
                      dict(axis="y", wavelength=1e-3, dim=2)),
    dea.Trace: (lambda **g: solve(path=dea.Trace(**g)), dict(what="voltage")),
    dea.StoredStep: (lambda **g: solve(start=dea.StoredStep(**g)), dict(folder="nowhere", step=1)),
    dea.March: (lambda **g: solve(path=dea.March(**g)), dict(seconds=1.0)),
    dea.Constant: (driven(dea.Constant), {}),
    dea.Rise: (driven(dea.Rise), {}),
    dea.Step: (driven(dea.Step), {}),
    dea.Sine: (driven(dea.Sine), dict(hertz=1.0)),
    dea.Triangle: (driven(dea.Triangle), dict(hertz=1.0)),
    dea.Square: (driven(dea.Square), dict(hertz=1.0)),
    dea.Chirp: (driven(dea.Chirp), dict(low=1.0, high=2.0, seconds=1.0)),
    dea.Table: (driven(dea.Table), dict(times=[0.0, 1.0], values=[0.0, 1.0])),
    dea.Function: (driven(dea.Function), dict(function=abs)),
    dea.Maxwell: (
        lambda **g: scene(materials={"film": dea.Material(
            dea.NeoHookean(5e4), dea.IdealDielectric(3.0), viscous=[dea.Maxwell(**g)])}),
        dict(mu=1e4, tau=1.0)),
    dea.Conductivity: (
        lambda **g: scene(materials={"film": dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(
            3.0, conductivity=dea.Conductivity(**g)))}),
        dict(siemens_per_metre=1e-13)),
    dea.Debye: (
        lambda **g: scene(materials={"film": dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(
            3.0, relaxation=[dea.Debye(**g)]))}),
        dict(eps_r=1.0, tau=1.0)),
    dea.Source: (
        lambda **g: scene(electrodes=[dea.Source(**g), dea.Ground("bottom")]),
        dict(where="top", volts=100.0)),
    dea.Open: (switched(dea.Open), dict(where="top")),
    dea.Close: (switched(dea.Close), dict(where="top")),
    dea.Current: (fed(dea.Current), dict(electrode="top")),
    dea.ChargeLoss: (fed(dea.ChargeLoss), {}),
    dea.ViscousBranch: (
        lambda **g: scene(materials={"film": dea.Material(
            dea.NeoHookean(5e4), dea.IdealDielectric(3.0), viscous=[dea.ViscousBranch(**g)])}),
        dict(spring=dea.NeoHookean(1e4), tau=1.0)),
    dea.KumarLopezPamies: (
        lambda **g: scene(materials={"film": dea.Material(
            dea.NeoHookean(5e4), dea.IdealDielectric(3.0), viscous=[dea.ViscousBranch(
                dea.NeoHookean(1e4), flow=dea.KumarLopezPamies(**g))])}),
        dict(eta_0=1e4, eta_inf=1e3)),
    dea.Dissipation: (recorded(dea.Dissipation), {}),
    dea.DamageLoss: (recorded(dea.DamageLoss), {}),
    dea.NewtonOptions: (lambda **g: solve(options=dea.NewtonOptions(**g)), {}),
    dea.LossOfTension: (lambda **g: solve(failures=[dea.LossOfTension(**g)]), dict(normal="y")),
    dea.StretchLimit: (lambda **g: solve(failures=[dea.StretchLimit(**g)]), dict(stretch=2.0)),
    dea.ElectricalBreakdown: (lambda **g: solve(failures=[dea.ElectricalBreakdown(**g)]), {}),
    dea.MeanDisplacement: (recorded(dea.MeanDisplacement), dict(where="top", axis="y")),
    dea.LargestDisplacement: (recorded(dea.LargestDisplacement), dict(where="top", axis="y")),
    dea.MeanStretch: (recorded(dea.MeanStretch), dict(between=("bottom", "top"), axis="y")),
    dea.Contraction: (recorded(dea.Contraction), dict(between=("bottom", "top"), axis="y")),
    dea.Area: (recorded(dea.Area), dict(where="top")),
    dea.Reaction: (recorded(dea.Reaction), dict(where="bottom", axis="y")),
    dea.Charge: (recorded(dea.Charge), dict(electrode="top")),
    dea.Potential: (recorded(dea.Potential), dict(electrode="top")),
    dea.Capacitance: (recorded(dea.Capacitance), dict(electrode="top")),
    dea.Rotation: (recorded(dea.Rotation), dict(where="top", about="z")),
    dea.BendingAngle: (recorded(dea.BendingAngle), dict(between=("bottom", "top"), axis="z")),
    dea.PreStretch: (in_scene(dea.PreStretch, "prescribed"), dict(where="film", x=2.0)),
    dea.GeneralisedPlaneStrain: (
        lambda **g: scene(kinematics=dea.GeneralisedPlaneStrain(**g)), dict(depth=1.0)),
    dea.Membrane: (membrane(dea.Membrane), dict(thickness=1e-3)),
    dea.AxisymmetricMembrane: (on_a_line(dea.AxisymmetricMembrane), dict(thickness=1e-3)),
    dea.SurfaceMembrane: (in_space(dea.SurfaceMembrane), dict(thickness=1e-3)),
    dea.MembranePressure: (
        lambda **g: on_a_line(dea.AxisymmetricMembrane, [dea.MembranePressure(**g)])(
            thickness=1e-3),
        dict(where="film", pascal=1.0, away_from=(0.0, -1.0))),
    dea.Helical: (lambda **g: scene(kinematics=dea.Helical(**g)), dict(pitch=1e-3)),
    dea.AxialStretch: (in_scene(dea.AxialStretch, "prescribed"), dict(stretch=1.1)),
    dea.Twist: (in_scene(dea.Twist, "prescribed"), dict(radians_per_metre=1.0)),
    dea.AxialForce: (in_scene(dea.AxialForce, "loads"), dict(newtons=1.0)),
    dea.Torque: (in_scene(dea.Torque, "loads"), dict(newton_metres=1.0)),
    dea.Obstacle: (in_scene(dea.Obstacle, "supports"), dict(where="top", shape=PLANE)),
    dea.Plane: (touched(dea.Plane), dict(point=(0.0, 2e-3), normal=(0.0, -1.0))),
    dea.Sphere: (touched(dea.Sphere, dea.Axisymmetric()), dict(centre=(0.0, 3e-3), radius=1e-3)),
    dea.Cylinder: (touched(dea.Cylinder), dict(point=(0.0, 3e-3), axis=None, radius=1e-3)),
    dea.ContactForce: (pressing(dea.ContactForce), dict(where="top", axis="y")),
    dea.ContactArea: (pressing(dea.ContactArea), dict(where="top")),
    dea.ContactPressure: (pressing(dea.ContactPressure), dict(where="top")),
    dea.ContactGap: (pressing(dea.ContactGap), dict(where="top")),
    dea.FrictionWork: (pressing(dea.FrictionWork), dict(where="top")),
    dea.Rigid: (in_scene(dea.Rigid, "supports"), dict(where="top")),
    dea.Turn: (in_scene(dea.Turn, "prescribed"), dict(where="top", radians=1.0)),
    dea.Moment: (in_scene(dea.Moment, "loads"), dict(where="top", newton_metres=1.0)),
    dea.Cavity: (
        in_scene(dea.Cavity, "loads"), dict(where="top", liquid=1e-9, openings="y")),
    dea.CavityPressure: (recorded(dea.CavityPressure), dict(where="top")),
    dea.CavityVolume: (recorded(dea.CavityVolume), dict(where="top")),
    dea.CavityEnergy: (recorded(dea.CavityEnergy), dict(where="top")),
    dea.Spring: (in_scene(dea.Spring, "supports"), dict(where="top", law=1.0, axis="y")),
    dea.CubicLaw: (dea.CubicLaw, dict(linear=1.0)),
    dea.BistableLaw: (dea.BistableLaw, dict(newtons=1.0, metres=1e-3)),
    dea.TableLaw: (dea.TableLaw, dict(elongations=(0.0, 1e-3), forces=(0.0, 1.0))),
    dea.TorsionSpring: (in_scene(dea.TorsionSpring, "supports"), dict(where="top", law=1.0)),
    dea.ElasticFoundation: (
        in_scene(dea.ElasticFoundation, "supports"),
        dict(where="top", newtons_per_cubic_metre=1e6)),
    dea.Gravity: (in_scene(dea.Gravity, "loads"), dict(acceleration=(0.0, -9.81))),
    dea.BodyForce: (
        in_scene(dea.BodyForce, "loads"),
        dict(where="film", newtons_per_cubic_metre=(0.0, 1.0))),
    dea.Centrifugal: (in_scene(dea.Centrifugal, "loads"), dict(radians_per_second=1.0)),
    dea.Force: (in_scene(dea.Force, "loads"), dict(where="top", newtons=(0.0, 1.0))),
    dea.PartDisplacement: (recorded(dea.PartDisplacement), dict(where="top", axis="y")),
    dea.PartForce: (recorded(dea.PartForce), dict(where="top", axis="y")),
    dea.PartMoment: (recorded(dea.PartMoment), dict(where="top")),
    exact.Cone: (exact.Cone, dict(prestretch=1.5, force=0.5)),
    dea.Energy: (recorded(dea.Energy), dict(what="elastic")),
    dea.AtPoint: (recorded(dea.AtPoint),
                  dict(point=(5e-4, 5e-4), what="displacement", axis="y")),
    dea.OverRegion: (recorded(dea.OverRegion), dict(what="field")),
    dea.Expression: (recorded(dea.Expression), dict(value=lambda at: at.J)),
    dea.CentreOfMass: (recorded(dea.CentreOfMass), dict(axis="y")),
    dea.AlongLine: (recorded(dea.AlongLine),
                    dict(start=(0.0, 5e-4), end=(1e-3, 5e-4), what="stretch")),
    dea.Curvature: (recorded(dea.Curvature), dict(start=(0.0, 5e-4), end=(1e-3, 5e-4))),
    dea.Periodic: (lambda **g: scene(supports=[dea.Clamp("bottom"), dea.Periodic(**g)]),
                   dict(first="x_min", second="x_max")),
    dea.MeanStrain: (
        lambda **g: scene(supports=[dea.Fix("bottom", "y"), dea.Periodic("x_min", "x_max")],
                          prescribed=[dea.MeanStrain(**g)]),
        dict(between=("x_min", "x_max"), axis="x", strain=0.1)),
    dea.PeriodicForce: (
        lambda **g: solve(record={"it": dea.PeriodicForce(**g)}, changes={
            "supports": [dea.FreeBody(), dea.Periodic("x_min", "x_max")]}),
        dict(between=("x_min", "x_max"), axis="x")),
    dea.OnPlane: (placed(dea.OnPlane), dict(axis="x", at=0.0)),
    dea.InBox: (placed(dea.InBox), dict(low=(0.0, 0.0), high=(1e-3, 1e-3))),
    dea.OnCylinder: (placed(dea.OnCylinder), dict(radius=5e-4)),
    dea.InCylinder: (placed(dea.InCylinder), dict(radius=5e-3)),
    dea.Interior: (placed(dea.Interior), {}),
    dea.PartRotation: (recorded(dea.PartRotation), dict(where="top")),
    dea.Inertia: (
        lambda **g: solve(path=dea.March(1.0, inertia=dea.Inertia(**g)), changes=HEAVY), {}),
    dea.InMotion: (
        lambda **g: solve(path=dea.Ramp(at_loss=dea.InMotion(**g)), changes=HEAVY),
        dict(inertia=dea.Inertia(drag=1.0))),
    dea.Frequency: (lambda **g: solve(record={"it": dea.Frequency(**g)}, changes=HEAVY), {}),
    dea.KineticEnergy: (recorded(dea.KineticEnergy), {}),
    dea.Momentum: (recorded(dea.Momentum), dict(axis="x")),
    dea.AngularMomentum: (recorded(dea.AngularMomentum), dict(axis="z")),
    dea.Parameter: (
        lambda **g: dea.calibrate(
            dea.calibration.FunctionTest(
                "line", lambda t, x: t["a"] * x, [1.0, 2.0], {"y": [1.0, 2.0]}),
            [dea.Parameter(**g)]),
        dict(name="a", start=1.0)),
    dea.LatinHypercube: (
        lambda **g: dea.study(scene, dea.LatinHypercube(**g), {}, out="/dev/null/study"),
        dict(ranges={"x": (0.0, 1.0)}, count=2, seed=1)),
    dea.ShapeChange: (
        lambda **g: derived().sensitivity("up", [dea.ShapeChange(**g)]),
        dict(name="height", velocity=lambda X: 0 * X)),
    dea.ConstantChange: (
        lambda **g: derived().sensitivity("up", [dea.ConstantChange(**g)]),
        dict(name="softer", rates={"film.elastic.mu": lambda X: 1 - X[:, 0]})),
    geometry.Layer: (geometry.Layer, dict(name="film", thickness=1e-3)),
    geometry.BoxStack: (BoxStack, dict(length=1e-3, width=1e-3, layers=[Layer("film", 1e-3)])),
    geometry.DiskStack: (geometry.DiskStack, dict(radius=1e-2, layers=[Layer("film", 1e-3)])),
    geometry.AirBox: (
        geometry.AirBox, dict(stack=geometry.BoxStack(1e-3, None, [geometry.Layer("film", 1e-3)]),
                              thickness=1e-3, sides=("top",))),
    geometry.AirCore: (
        geometry.AirCore, dict(storey=geometry.KreslingCell(
            0.054, 0.03, 0.8, 5e-4, 2e-3, relief=0.3, sides=3))),
    geometry.AirGap: (
        geometry.AirGap, dict(device=BoxStack(1e-3, None, [Layer("film", 1e-3)]), face="top",
                              thickness=1e-3)),
    geometry.DiscCapacitor: (
        geometry.DiscCapacitor, dict(radius=1e-2, gap=1e-2, box=1e-1, divisions=(2, 2, 2))),
    geometry.MembraneDisc: (
        geometry.MembraneDisc, dict(radius=3e-2, electrode_radius=1e-2, thickness=1e-3)),
    geometry.Meridian: (geometry.Meridian, dict(start=(1e-2, 0.0), end=(2e-2, 0.0))),
    geometry.Balloon: (geometry.Balloon, dict(radius=1e-2)),
    geometry.HollowSphere: (geometry.HollowSphere, dict(inner=1e-2, outer=1.2e-2)),
    geometry.Tube: (geometry.Tube, dict(inner=1e-2, height=1e-2, layers=[Layer("film", 1e-3)])),
    geometry.Roll: (
        geometry.Roll, dict(inner=1e-3, turns=2, layers=[Layer("film", 1e-3)])),
    geometry.TabbedStack: (
        geometry.TabbedStack, dict(length=1e-2, layers=[Layer("film", 1e-3)] * 3, margin=1e-3)),
    geometry.FingerStack: (
        geometry.FingerStack,
        dict(layers=[Layer("film", 1e-3)], fingers=2, finger=1e-3, gap=1e-3)),
    geometry.HDEA: (geometry.HDEA, {}),
    geometry.HelicalCell: (geometry.HelicalCell, {}),
    exact.Balloon: (exact.Balloon, dict(inner=1e-2, outer=1.2e-2, mu=5e4)),
    exact.RoundBalloon: (
        exact.RoundBalloon, dict(inner=1e-2, outer=1.2e-2, material=RUBBER)
    ),
    exact.Film: (exact.Film, dict(material=RUBBER, thickness=1e-3)),
    exact.Helicoid: (exact.Helicoid, dict(outer_radius=1e-2, inner_radius=5e-3, elastomer=1e-3)),
    origami.Kresling: (origami.Kresling, dict(side=5e-2, edge=7e-2)),
    origami.CreasePattern: (origami.CreasePattern, {}),
}  # fmt: skip
