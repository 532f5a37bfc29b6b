"""The structure that moves between the stops. `Structure` lists its kinds."""

from __future__ import annotations

from stochvi.scenes.structures.modes import Bar, Beam, ModalStructure, Modes, Plate
from stochvi.scenes.structures.oscillators import (
    AnyStructure,
    Isolator,
    Matrices,
    NonlinearOscillator,
    Oscillator,
)
from stochvi.scenes.structures.rigid_body import RigidBody

Structure = (
    Oscillator | Isolator | Matrices | RigidBody | NonlinearOscillator | Modes | Bar | Beam | Plate
)
"""A structure that a scene may hold, of any kind."""

__all__ = [
    "AnyStructure",
    "Bar",
    "Beam",
    "Isolator",
    "Matrices",
    "ModalStructure",
    "Modes",
    "NonlinearOscillator",
    "Oscillator",
    "Plate",
    "RigidBody",
    "Structure",
]
