"""Monte Carlo of vibro-impact scenes: many paths at once, impacts inside the step."""

from stochvi.methods.monte_carlo.plan import Statistic
from stochvi.methods.monte_carlo.simulation import (
    Prospect,
    prospect,
    record_path,
    record_paths,
    simulate,
)
from stochvi.sampling.calculations import SamplingOptions
from stochvi.sampling.workers import leave_out_of_budgets

leave_out_of_budgets()

__all__ = [
    "Prospect",
    "SamplingOptions",
    "Statistic",
    "prospect",
    "record_path",
    "record_paths",
    "simulate",
]
