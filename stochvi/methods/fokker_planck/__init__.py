"""Numerical solution of the Fokker-Planck equation: stationary, in time, until a first passage."""

from stochvi.methods.fokker_planck.density import StationaryDensity
from stochvi.methods.fokker_planck.in_time import Gaussian
from stochvi.methods.fokker_planck.motion import unmet, unmet_by_first_passage, unmet_by_transient
from stochvi.methods.fokker_planck.stationary import (
    Batch,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
)
from stochvi.methods.fokker_planck.transients import (
    FirstPassage,
    Transient,
    first_passage,
    transient,
)

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
    "unmet",
    "unmet_by_first_passage",
    "unmet_by_transient",
]
