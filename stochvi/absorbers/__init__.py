"""Impact absorbers: what a loose mass in a box does to its structure, and the best box."""

from stochvi.absorbers.design import Design, design_absorber
from stochvi.absorbers.harmonic import (
    SymmetricRegime,
    residual_vibration,
    symmetric_regimes,
    tuned_force,
)
from stochvi.absorbers.performance import AbsorberReport, absorber

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
