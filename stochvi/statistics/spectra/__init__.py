"""Power spectral densities of the response by Monte Carlo, with bands and biases."""

from stochvi.statistics.spectra.answer import Curve, ResponseSpectrum
from stochvi.statistics.spectra.method import spectrum

__all__ = ["Curve", "ResponseSpectrum", "spectrum"]
