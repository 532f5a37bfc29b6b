from .absorbers import Absorber
from .datasets import Profile, profiles, shipped_scene
from .excitations import (
    ConstantLoad,
    FilteredNoise,
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
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from .records import Record, read_record
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
    "ConstantLoad",
    "Elastic",
    "FilteredNoise",
    "ForceFunction",
    "ForceTable",
    "Hertz",
    "ImpactPair",
    "Isolator",
    "Matrices",
    "Modes",
    "Mount",
    "NonlinearOscillator",
    "Oscillator",
    "Plate",
    "Profile",
    "QuarterCar",
    "Record",
    "RecordedNoise",
    "Restitution",
    "RigidBody",
    "RoadNoise",
    "Scene",
    "Sine",
    "SpeedRestitution",
    "StateSpaceNoise",
    "TabulatedNoise",
    "TransferFunctionNoise",
    "Viscoelastic",
    "WhiteNoise",
    "load_scene",
    "profiles",
    "read_record",
    "shipped_scene",
]
