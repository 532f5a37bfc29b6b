"""Exact stationary solutions of the Fokker-Planck equation, where they exist in closed form."""

from stochvi.methods.closed_form.autocorrelation import autocorrelation
from stochvi.methods.closed_form.density import ExactDensity, displacement_density, exact_density
from stochvi.methods.closed_form.method import exact, unmet

__all__ = [
    "ExactDensity",
    "autocorrelation",
    "displacement_density",
    "exact",
    "exact_density",
    "unmet",
]
