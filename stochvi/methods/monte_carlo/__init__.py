"""Monte Carlo of vibro-impact scenes: many paths at once, impacts inside the step."""

from stochvi.methods.compile_time import leave_out_of_budgets
from stochvi.methods.monte_carlo.simulate import (
    Prospect,
    prospect,
    record_path,
    record_paths,
    simulate,
)
from stochvi.methods.monte_carlo.statistic import Statistic
from stochvi.sampling.options import SamplingOptions

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
