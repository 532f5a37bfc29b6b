"""Response, fatigue and shocks of equipment at a place of a scene, with its stops and without."""

from stochvi.statistics.damage.answer import Damage, EquipmentSpectra, Shocks, SpectrumValues
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.method import damage

__all__ = ["Damage", "Equipment", "EquipmentSpectra", "Shocks", "SpectrumValues", "damage"]
