"""Numerical solution of the Fokker-Planck equation: stationary, in time, until a first passage."""

from stochvi.galerkin.density import StationaryDensity
from stochvi.galerkin.method import (
    Batch,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
    unmet_conditions,
)
from stochvi.galerkin.passage import FirstPassage, first_passage
from stochvi.galerkin.starts import Gaussian
from stochvi.galerkin.transients import Transient, transient

__all__ = [
    "Batch",
    "FirstPassage",
    "Gaussian",
    "StationaryDensity",
    "Transient",
    "first_passage",
    "fokker_planck",
    "fokker_planck_density",
    "fokker_planck_many",
    "transient",
    "unmet_conditions",
]
