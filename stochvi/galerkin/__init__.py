"""Numerical solution of the stationary Fokker-Planck equation of one oscillator with stops."""

from stochvi.galerkin.density import StationaryDensity
from stochvi.galerkin.method import (
    Batch,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
    unmet_conditions,
)

__all__ = [
    "Batch",
    "StationaryDensity",
    "fokker_planck",
    "fokker_planck_density",
    "fokker_planck_many",
    "unmet_conditions",
]
