from .bumpers import BumperMap, bumper_map
from .clearance import clearance_curve
from .jolt_response import Jolts, jolts
from .production_risk import Production, Spread, production
from .screening import Screening, screen
from .sizing import Sizing, size
from .sizing.answer import PairsSizing
from .sizing.by_damage import size_by_damage
from .sizing.clatter import clatter
from .sizing.damage_answer import DamageSizing
from .sizing.missions_answer import MissionSizing
from .sizing.sensitivity import sensitivity

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
    "jolts",
    "production",
    "screen",
    "sensitivity",
    "size",
    "size_by_damage",
]
