from .answer import Branch, HarmonicResponse, Jump, SimulatedSweep, SpecialPoint
from .method import harmonic_response
from .resonance import HarmonicResonance, RandomResonance

__all__ = [
    "Branch",
    "HarmonicResonance",
    "HarmonicResponse",
    "Jump",
    "RandomResonance",
    "SimulatedSweep",
    "SpecialPoint",
    "harmonic_response",
]
