"""How likely a mission is to go wrong: crude Monte Carlo, splitting, or first crossings."""

from stochvi.statistics.reliability.answer import Chance, Reliability
from stochvi.statistics.reliability.method import reliability

__all__ = ["Chance", "Reliability", "reliability"]
