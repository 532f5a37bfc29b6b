from .design import Design, design_absorber
from .harmonic import SymmetricRegime, residual_vibration, symmetric_regimes, tuned_force
from .performance import AbsorberReport, absorber

__all__ = [
    "AbsorberReport",
    "Design",
    "SymmetricRegime",
    "absorber",
    "design_absorber",
    "residual_vibration",
    "symmetric_regimes",
    "tuned_force",
]
