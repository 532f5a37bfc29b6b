"""Statistics of impacts one by one: rates, intervals, speeds, energy, clusters."""

from stochvi.impact_statistics.answer import ImpactStatistics, PairStatistics
from stochvi.impact_statistics.method import impacts

__all__ = ["ImpactStatistics", "PairStatistics", "impacts"]
