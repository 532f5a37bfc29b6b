from .density import StationaryDensity
from .in_time import Gaussian
from .motion import unmet, unmet_by_first_passage, unmet_by_transient
from .stationary import (
    Batch,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
)
from .transients import (
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
