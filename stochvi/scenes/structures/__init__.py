"""The structure that moves between the stops. Each structure is a file; `Structure` lists them."""

from __future__ import annotations

from stochvi.scenes.structures.bars import Bar
from stochvi.scenes.structures.base import AnyStructure
from stochvi.scenes.structures.beams import Beam
from stochvi.scenes.structures.matrices import Matrices
from stochvi.scenes.structures.modes import ModalStructure, Modes
from stochvi.scenes.structures.oscillators import Isolator, NonlinearOscillator, Oscillator
from stochvi.scenes.structures.plates import Plate
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
