"""The clearance that an isolator really needs: first hits, hits with their stops, sensitivity."""

from stochvi.sizing.answer import Sizing
from stochvi.sizing.method import size

__all__ = ["Sizing", "size"]
