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
from .members import Bar, Beam
from .modal_structures import GivenModes
from .plates import Plate
from .records import Record, read_record
from .rigid_body import Mount, RigidBody
from .scene import ImpactPair, Scene, load_scene
from .structures import Isolator, Matrices, NonlinearOscillator, Oscillator
from .vehicles import QuarterCar

__all__ = [
    "Absorber",
    "Bar",
    "Beam",
    "ConstantLoad",
    "Elastic",
    "FilteredNoise",
    "ForceTable",
    "GivenModes",
    "Hertz",
    "ImpactPair",
    "Isolator",
    "Matrices",
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
    "TabulatedNoise",
    "Viscoelastic",
    "WhiteNoise",
    "load_scene",
    "profiles",
    "read_record",
    "shipped_scene",
]
