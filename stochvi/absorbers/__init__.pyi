from .design import Design, design_absorber
from .performance import AbsorberReport, absorber
from .sine import AbsorberSine, ResidualCurve, absorber_sine
from .sine_formulas import SymmetricRegime, residual_vibration, symmetric_regimes, tuned_force
from .tuned_damper import TunedDamper, tuned_damper

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
