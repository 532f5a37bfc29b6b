"""The clearance that an isolator really needs: first hits, hits with their stops, sensitivity."""

from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.method import size

__all__ = ["Sizing", "size"]
