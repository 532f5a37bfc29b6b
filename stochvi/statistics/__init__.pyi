from .bursts import Bursts
from .crossing_ages import FirstCrossings
from .histories import History
from .impacts import Exponent, Histogram, ImpactStatistics, PairStatistics, Rate
from .lifetimes import Destination, LifeTime, LifeTimes, lifetimes
from .reliability import Chance, Reliability
from .spectra import ResponseSpectrum

__all__ = [
    "Bursts",
    "Chance",
    "Destination",
    "Exponent",
    "FirstCrossings",
    "Histogram",
    "History",
    "ImpactStatistics",
    "LifeTime",
    "LifeTimes",
    "PairStatistics",
    "Rate",
    "Reliability",
    "ResponseSpectrum",
    "lifetimes",
]
