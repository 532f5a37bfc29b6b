"""Response, fatigue and shocks of equipment at a place of a scene, with its stops and without."""

from stochvi.statistics.damage.answer import (
    Damage,
    EquipmentSpectra,
    Shocks,
    SpectrumValues,
    TailoredTest,
)
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.method import damage

__all__ = [
    "Damage",
    "Equipment",
    "EquipmentSpectra",
    "Shocks",
    "SpectrumValues",
    "TailoredTest",
    "damage",
]
