from .answer import (
    Branch,
    HarmonicResponse,
    Jump,
    RandomStarts,
    SimulatedSweep,
    SpecialPoint,
)
from .basins import BasinRegime, Basins, basins
from .bifurcation import Bifurcation, BifurcationSweep, bifurcation, lyapunov_exponent
from .method import harmonic_response
from .resonance import HarmonicResonance, RandomResonance
from .structure_resonance import StructureResonance
from .switched_drive import SwitchedDrive

__all__ = [
    "BasinRegime",
    "Basins",
    "Bifurcation",
    "BifurcationSweep",
    "Branch",
    "HarmonicResonance",
    "HarmonicResponse",
    "Jump",
    "RandomResonance",
    "RandomStarts",
    "SimulatedSweep",
    "SpecialPoint",
    "StructureResonance",
    "SwitchedDrive",
    "basins",
    "bifurcation",
    "harmonic_response",
    "lyapunov_exponent",
]
