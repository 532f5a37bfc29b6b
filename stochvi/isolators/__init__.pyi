from .jolt_response import Jolts, jolts
from .screening import Screening, clearance_curve, screen
from .sizing import Sizing, size
from .sizing.clatter import clatter
from .sizing.sensitivity import sensitivity

__all__ = [
    "Jolts",
    "Screening",
    "Sizing",
    "clatter",
    "clearance_curve",
    "jolts",
    "screen",
    "sensitivity",
    "size",
]
