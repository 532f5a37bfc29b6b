"""Response, fatigue and shocks of equipment at a place of a scene, with its stops and without."""

from stochvi.statistics.damage.assessment import damage
from stochvi.statistics.damage.equipment import (
    Damage,
    Equipment,
    EquipmentSpectra,
    Shocks,
    SpectrumValues,
    TailoredTest,
)

__all__ = [
    "Damage",
    "Equipment",
    "EquipmentSpectra",
    "Shocks",
    "SpectrumValues",
    "TailoredTest",
    "damage",
]
