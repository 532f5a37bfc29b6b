from .missions import Chance, Reliability
from .risk import reliability

__all__ = ["Chance", "Reliability", "reliability"]
