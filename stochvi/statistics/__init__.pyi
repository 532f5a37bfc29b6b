from .clusters import Bursts
from .crossings import FirstCrossings
from .damage import Damage, EquipmentSpectra, Shocks, SpectrumValues, TailoredTest
from .histories import History
from .impacts import Exponent, Histogram, ImpactStatistics, PairStatistics, Rate
from .lifetimes import Destination, LifeTime, LifeTimes, lifetimes
from .reliability import Chance, Reliability
from .spectra import ResponseSpectrum
from .stability import Stability

__all__ = [
    "Bursts",
    "Chance",
    "Damage",
    "Destination",
    "EquipmentSpectra",
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
    "Shocks",
    "SpectrumValues",
    "Stability",
    "TailoredTest",
    "lifetimes",
]
