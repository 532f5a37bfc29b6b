"""The bumper map: what impacts do to a mass, over the clearance and the stiffness of its stops."""

from stochvi.isolators.bumpers.answer import BumperMap
from stochvi.isolators.bumpers.method import bumper_map

__all__ = ["BumperMap", "bumper_map"]
