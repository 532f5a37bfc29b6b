from .answer import Branch, HarmonicResponse, Jump, SpecialPoint
from .method import harmonic_response
from .resonance import HarmonicResonance, RandomResonance

__all__ = [
    "Branch",
    "HarmonicResonance",
    "HarmonicResponse",
    "Jump",
    "RandomResonance",
    "SpecialPoint",
    "harmonic_response",
]
