"""How likely a mission is to go wrong: crude Monte Carlo, splitting, or first crossings."""

from stochvi.failures.answer import Chance, Reliability
from stochvi.failures.method import reliability

__all__ = ["Chance", "Reliability", "reliability"]
