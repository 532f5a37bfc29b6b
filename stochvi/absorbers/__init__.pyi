from .design import Design, design_absorber
from .harmonic import SymmetricRegime, residual_vibration, symmetric_regimes, tuned_force
from .performance import AbsorberReport, absorber
from .tuned_damper import TunedDamper, tuned_damper

__all__ = [
    "AbsorberReport",
    "Design",
    "SymmetricRegime",
    "TunedDamper",
    "absorber",
    "design_absorber",
    "residual_vibration",
    "symmetric_regimes",
    "tuned_damper",
    "tuned_force",
]
