"""How likely a mission is to go wrong: crude Monte Carlo, splitting, or first crossings."""

from stochvi.statistics.reliability.missions import Chance, Reliability
from stochvi.statistics.reliability.risk import reliability

__all__ = ["Chance", "Reliability", "reliability"]
