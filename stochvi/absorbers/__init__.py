"""Impact absorbers: what a loose mass in a box does to its structure, and the best box."""

from stochvi.absorbers.design import Design, design_absorber
from stochvi.absorbers.performance import AbsorberReport, absorber

__all__ = ["AbsorberReport", "Design", "absorber", "design_absorber"]
