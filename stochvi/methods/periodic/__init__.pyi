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
from .motor import Motor, sine_power
from .relay import RelayBetweenStops
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
    "Motor",
    "RandomResonance",
    "RandomStarts",
    "RelayBetweenStops",
    "SimulatedSweep",
    "SpecialPoint",
    "StructureResonance",
    "SwitchedDrive",
    "basins",
    "bifurcation",
    "harmonic_response",
    "lyapunov_exponent",
    "sine_power",
]
