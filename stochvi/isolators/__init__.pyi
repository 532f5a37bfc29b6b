from .bumpers import BumperMap, bumper_map
from .jolt_response import Jolts, perturbations
from .production_risk import Production, Spread, production
from .screening import Screening, clearance_curve, screen
from .sizing import Sizing, size
from .sizing.answer import DamageSizing, MissionSizing, PairsSizing
from .sizing.review import clatter
from .sizing.sensitivity import sensitivity
from .sizing.size import risk_curve, size_by_damage

__all__ = [
    "BumperMap",
    "DamageSizing",
    "Jolts",
    "MissionSizing",
    "PairsSizing",
    "Production",
    "Screening",
    "Sizing",
    "Spread",
    "bumper_map",
    "clatter",
    "clearance_curve",
    "perturbations",
    "production",
    "risk_curve",
    "screen",
    "sensitivity",
    "size",
    "size_by_damage",
]
