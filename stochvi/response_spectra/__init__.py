"""Power spectral densities of the response by Monte Carlo, with bands and biases."""

from stochvi.response_spectra.answer import Curve, ResponseSpectrum
from stochvi.response_spectra.method import spectrum

__all__ = ["Curve", "ResponseSpectrum", "spectrum"]
