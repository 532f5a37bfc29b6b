from .base import CoordinateResponse, PairResponse, Response
from .errors import (
    CheckpointError,
    Interrupted,
    NoExactSolution,
    NotApplicable,
    NotConverged,
    SceneError,
    StochviError,
)
from .estimates import Cost, Estimate

__all__ = [
    "CheckpointError",
    "CoordinateResponse",
    "Cost",
    "Estimate",
    "Interrupted",
    "NoExactSolution",
    "NotApplicable",
    "NotConverged",
    "PairResponse",
    "Response",
    "SceneError",
    "StochviError",
]
