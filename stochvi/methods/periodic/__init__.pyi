from .resonance import HarmonicResonance, RandomResonance

__all__ = [
    "HarmonicResonance",
    "RandomResonance",
]
