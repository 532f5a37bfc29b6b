from .jolt_response import Jolts, jolts
from .screening import Screening, clearance_curve, screen
from .sizing import Sizing, size
from .sizing.clatter import clatter
from .sizing.pairs_answer import PairsSizing
from .sizing.sensitivity import sensitivity
from .structure_screening import StructureScreening

__all__ = [
    "Jolts",
    "PairsSizing",
    "Screening",
    "Sizing",
    "StructureScreening",
    "clatter",
    "clearance_curve",
    "jolts",
    "screen",
    "sensitivity",
    "size",
]
