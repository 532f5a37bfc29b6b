"""The risk of a production, whose units differ within their tolerances."""

from stochvi.isolators.production_risk.answer import Production
from stochvi.isolators.production_risk.method import production
from stochvi.isolators.production_risk.spreads import Spread

__all__ = ["Production", "Spread", "production"]
