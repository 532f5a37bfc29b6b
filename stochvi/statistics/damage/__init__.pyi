from .assessment import damage
from .equipment import (
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
