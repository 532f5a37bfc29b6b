"""Statistics of impacts one by one: rates, intervals, speeds, energy, clusters."""

from stochvi.statistics.impacts.answer import Exponent, ImpactStatistics, PairStatistics
from stochvi.statistics.impacts.method import impacts
from stochvi.statistics.impacts.tallies import Histogram, Rate

__all__ = ["Exponent", "Histogram", "ImpactStatistics", "PairStatistics", "Rate", "impacts"]
