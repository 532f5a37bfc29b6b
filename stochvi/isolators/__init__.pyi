from .clearance import clearance_curve
from .jolt_response import Jolts, jolts
from .production_risk import Production, Spread, production
from .screening import Screening, screen
from .sizing import Sizing, size
from .sizing.clatter import clatter
from .sizing.pairs_answer import PairsSizing
from .sizing.sensitivity import sensitivity

__all__ = [
    "Jolts",
    "PairsSizing",
    "Production",
    "Screening",
    "Sizing",
    "Spread",
    "clatter",
    "clearance_curve",
    "jolts",
    "production",
    "screen",
    "sensitivity",
    "size",
]
