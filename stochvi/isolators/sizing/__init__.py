"""The clearance that an isolator really needs: first impacts, impacts with their stops,
sensitivity."""

from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.size import size

__all__ = ["Sizing", "size"]
