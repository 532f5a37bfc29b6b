from .absorbers import Absorber
from .between_units import BetweenUnits
from .characteristics import (
    BoucWen,
    Coulomb,
    Duffing,
    PolynomialDamper,
    PolynomialSpring,
    Rayleigh,
    SpringFunction,
    SpringTable,
    VanDerPol,
)
from .cross_densities import CrossDensity
from .datasets import Profile, profiles, shipped_scene
from .excitations import (
    ConstantLoad,
    DriveFunction,
    FilteredNoise,
    Modulation,
    Pulses,
    RecordedNoise,
    RoadNoise,
    Sine,
    StateSpaceNoise,
    TabulatedNoise,
    TransferFunctionNoise,
    WhiteNoise,
)
from .impact_laws import (
    Elastic,
    ForceFunction,
    ForceTable,
    Hertz,
    PowerLaw,
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from .moving_bands import MovingBand
from .phases import Phase
from .records import Record, read_record
from .scatter import Scatter
from .scene import ImpactPair, Scene, load_scene
from .structures import (
    Bar,
    Beam,
    Isolator,
    Matrices,
    Modes,
    NonlinearOscillator,
    Oscillator,
    Plate,
)
from .structures.rigid_body import Mount, RigidBody
from .vehicles import QuarterCar

__all__ = [
    "Absorber",
    "Bar",
    "Beam",
    "BetweenUnits",
    "BoucWen",
    "ConstantLoad",
    "Coulomb",
    "CrossDensity",
    "DriveFunction",
    "Duffing",
    "Elastic",
    "FilteredNoise",
    "ForceFunction",
    "ForceTable",
    "Hertz",
    "ImpactPair",
    "Isolator",
    "Matrices",
    "Modes",
    "Modulation",
    "Mount",
    "MovingBand",
    "NonlinearOscillator",
    "Oscillator",
    "Phase",
    "Plate",
    "PolynomialDamper",
    "PolynomialSpring",
    "PowerLaw",
    "Profile",
    "Pulses",
    "QuarterCar",
    "Rayleigh",
    "Record",
    "RecordedNoise",
    "Restitution",
    "RigidBody",
    "RoadNoise",
    "Scatter",
    "Scene",
    "Sine",
    "SpeedRestitution",
    "SpringFunction",
    "SpringTable",
    "StateSpaceNoise",
    "TabulatedNoise",
    "TransferFunctionNoise",
    "VanDerPol",
    "Viscoelastic",
    "WhiteNoise",
    "load_scene",
    "profiles",
    "read_record",
    "shipped_scene",
]
