"""Vibration isolators between stops: linear screening, required clearance, jolts."""

from stochvi.isolators.jolts import Jolts
from stochvi.isolators.screening import Screening, clearance_curve, screen
from stochvi.isolators.sizing import Sizing, size

__all__ = ["Jolts", "Screening", "Sizing", "clearance_curve", "screen", "size"]
