from .bursts import Bursts
from .first_crossings import FirstCrossings
from .histories import History
from .impacts import ImpactStatistics
from .reliability import Chance, Reliability
from .spectra import ResponseSpectrum

__all__ = [
    "Bursts",
    "Chance",
    "FirstCrossings",
    "History",
    "ImpactStatistics",
    "Reliability",
    "ResponseSpectrum",
]
