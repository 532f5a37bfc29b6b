"""Statistics of impacts one by one: rates, intervals, speeds, energy, clusters."""

from stochvi.statistics.impacts.answer import ImpactStatistics, PairStatistics
from stochvi.statistics.impacts.method import impacts

__all__ = ["ImpactStatistics", "PairStatistics", "impacts"]
