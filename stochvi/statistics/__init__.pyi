from .bursts import Bursts
from .first_crossings import FirstCrossings
from .histories import History
from .impacts import ImpactStatistics
from .lifetimes import Destination, LifeTime, LifeTimes, lifetimes
from .reliability import Chance, Reliability
from .spectra import ResponseSpectrum

__all__ = [
    "Bursts",
    "Chance",
    "Destination",
    "FirstCrossings",
    "History",
    "ImpactStatistics",
    "LifeTime",
    "LifeTimes",
    "Reliability",
    "ResponseSpectrum",
    "lifetimes",
]
