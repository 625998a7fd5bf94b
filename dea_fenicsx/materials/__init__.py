"""Materials: each elastic model is an energy and nothing else.

An elastic model states its energy density in the invariants of a :class:`Strain`; stress and
tangent are derived from it, symbolically in finite elements and by exact arithmetic on truncated
Taylor series in the homogeneous theory.  :class:`Material` joins an elastic model with what the
region does electrically: an ideal dielectric, a conductor, or nothing.

All constants are in SI units.
"""

from dea_fenicsx.materials.air import Air
from dea_fenicsx.materials.alexander import Alexander
from dea_fenicsx.materials.base import EPSILON_0, Elastic, Strain
from dea_fenicsx.materials.chains import ArrudaBoyce, Gent
from dea_fenicsx.materials.curve_data import TestData, read_data
from dea_fenicsx.materials.damage import OgdenRoxburgh
from dea_fenicsx.materials.dielectrics import (
    LinearPermittivity,
    PolynomialPermittivity,
    TabulatedPermittivity,
)
from dea_fenicsx.materials.directions import Along, Cylindrical, Direction, Helix, Wound
from dea_fenicsx.materials.electric import (
    Breakdown,
    Conductivity,
    Conductor,
    Debye,
    Dielectric,
    IdealDielectric,
)
from dea_fenicsx.materials.fibres import (
    Family,
    HolzapfelFibres,
    Reinforced,
    StandardReinforcing,
    TransverselyIsotropic,
)
from dea_fenicsx.materials.fitted import Fit
from dea_fenicsx.materials.fitting import fit
from dea_fenicsx.materials.flow_laws import FlowLaw, KumarLopezPamies
from dea_fenicsx.materials.foams import BlatzKo, OgdenHill
from dea_fenicsx.materials.kilian import VanDerWaals
from dea_fenicsx.materials.material import Material, bulk_modulus_of
from dea_fenicsx.materials.networks import ExtendedTube
from dea_fenicsx.materials.ogden import Ogden
from dea_fenicsx.materials.polarisation import (
    CompositeDielectric,
    Electrostriction,
    LangevinDielectric,
    SaturatingDielectric,
    mixed_permittivity,
)
from dea_fenicsx.materials.polynomial import MooneyRivlin, NeoHookean, Yeoh
from dea_fenicsx.materials.presets import Preset, get, names, preset
from dea_fenicsx.materials.rate_data import RateData, rate_errors, rate_stress, read_cycles
from dea_fenicsx.materials.spline import SplineEnergy
from dea_fenicsx.materials.thermal import (
    WLF,
    Arrhenius,
    Entropic,
    LinearChange,
    TabulatedChange,
    Thermal,
    ThermalLaw,
)
from dea_fenicsx.materials.thermal_fitting import ThermalFit, fit_temperatures
from dea_fenicsx.materials.viscous import Maxwell, ViscousBranch
from dea_fenicsx.materials.viscous_fitting import RateFit, fit_rates
from dea_fenicsx.materials.weibull import WeibullBreakdown

list = names  # reads well as dea_fenicsx.materials.list(); not among what * imports

__all__ = [
    "EPSILON_0",
    "Strain",
    "Elastic",
    "NeoHookean",
    "MooneyRivlin",
    "Yeoh",
    "Ogden",
    "Gent",
    "ArrudaBoyce",
    "ExtendedTube",
    "VanDerWaals",
    "Alexander",
    "SplineEnergy",
    "OgdenHill",
    "BlatzKo",
    "Reinforced",
    "Family",
    "StandardReinforcing",
    "HolzapfelFibres",
    "TransverselyIsotropic",
    "Direction",
    "Along",
    "Cylindrical",
    "Wound",
    "Helix",
    "IdealDielectric",
    "Breakdown",
    "Conductivity",
    "Debye",
    "Conductor",
    "Dielectric",
    "WeibullBreakdown",
    "LinearPermittivity",
    "PolynomialPermittivity",
    "TabulatedPermittivity",
    "Electrostriction",
    "SaturatingDielectric",
    "LangevinDielectric",
    "CompositeDielectric",
    "mixed_permittivity",
    "Air",
    "Material",
    "OgdenRoxburgh",
    "Thermal",
    "ThermalLaw",
    "Entropic",
    "LinearChange",
    "TabulatedChange",
    "WLF",
    "Arrhenius",
    "Maxwell",
    "ViscousBranch",
    "FlowLaw",
    "KumarLopezPamies",
    "bulk_modulus_of",
    "names",
    "get",
    "preset",
    "Preset",
    "fit",
    "Fit",
    "TestData",
    "read_data",
    "fit_rates",
    "fit_temperatures",
    "ThermalFit",
    "RateFit",
    "RateData",
    "read_cycles",
    "rate_stress",
    "rate_errors",
]
