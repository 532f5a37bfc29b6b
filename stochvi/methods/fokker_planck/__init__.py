"""Numerical solution of the Fokker-Planck equation: stationary, in time, until a first passage."""

from stochvi.methods.fokker_planck.conditions import (
    unmet,
    unmet_by_first_passage,
    unmet_by_transient,
)
from stochvi.methods.fokker_planck.density import StationaryDensity
from stochvi.methods.fokker_planck.initial_states import Gaussian
from stochvi.methods.fokker_planck.method import (
    Batch,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
)
from stochvi.methods.fokker_planck.passage import FirstPassage, first_passage
from stochvi.methods.fokker_planck.transients import Transient, transient

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
