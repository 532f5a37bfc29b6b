from .design import (
    AbsorberSine,
    Design,
    ResidualCurve,
    SymmetricRegime,
    absorber_sine,
    design_absorber,
    residual_vibration,
    symmetric_regimes,
    tuned_force,
)
from .performance import AbsorberReport, TunedDamper, absorber, tuned_damper

__all__ = [
    "AbsorberReport",
    "AbsorberSine",
    "Design",
    "ResidualCurve",
    "SymmetricRegime",
    "TunedDamper",
    "absorber",
    "absorber_sine",
    "design_absorber",
    "residual_vibration",
    "symmetric_regimes",
    "tuned_damper",
    "tuned_force",
]
