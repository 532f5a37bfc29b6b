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
from .response import Response

__all__ = [
    "CheckpointError",
    "Cost",
    "Estimate",
    "Interrupted",
    "NoExactSolution",
    "NotApplicable",
    "NotConverged",
    "Response",
    "SceneError",
    "StochviError",
]
