from .absorbers import Absorber
from .datasets import Profile, profiles, shipped_scene
from .excitations import (
    ConstantLoad,
    FilteredNoise,
    RecordedNoise,
    RoadNoise,
    Sine,
    TabulatedNoise,
    WhiteNoise,
)
from .impact_laws import Elastic, ForceTable, Hertz, Restitution, SpeedRestitution, Viscoelastic
from .records import Record, read_record
from .rigid_body import Mount, RigidBody
from .scene import ImpactPair, Scene, load_scene
from .structures import Isolator, Matrices, NonlinearOscillator, Oscillator
from .vehicles import QuarterCar

__all__ = [
    "Absorber",
    "ConstantLoad",
    "Elastic",
    "FilteredNoise",
    "ForceTable",
    "Hertz",
    "ImpactPair",
    "Isolator",
    "Matrices",
    "Mount",
    "NonlinearOscillator",
    "Oscillator",
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
    "TabulatedNoise",
    "Viscoelastic",
    "WhiteNoise",
    "load_scene",
    "profiles",
    "read_record",
    "shipped_scene",
]
