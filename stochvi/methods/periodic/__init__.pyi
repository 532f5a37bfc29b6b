from .attracted import (
    BasinRegime,
    Basins,
    Bifurcation,
    BifurcationSweep,
    basins,
    bifurcation,
    lyapunov_exponent,
)
from .resonance import (
    HarmonicResonance,
    Motor,
    RelayBetweenStops,
    StructureResonance,
    SwitchedDrive,
    sine_power,
)
from .sine_response import (
    Branch,
    HarmonicResponse,
    Jump,
    RandomStarts,
    SimulatedSweep,
    SpecialPoint,
    harmonic_response,
)

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
