"""Monte Carlo of vibro-impact scenes: many paths at once, impacts inside the step."""

from stochvi.methods.monte_carlo.simulate import (
    Prospect,
    prospect,
    record_path,
    record_paths,
    simulate,
)

__all__ = ["Prospect", "prospect", "record_path", "record_paths", "simulate"]
