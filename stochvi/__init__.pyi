from . import (
    absorbers,
    identification,
    isolators,
    mathematics,
    methods,
    results,
    scenes,
    statistics,
    testing,
    verification,
)
from .absorbers.performance import absorber
from .explorer.notebook import explore
from .identification.fitting import identify
from .identification.shocks import shocks
from .isolators.screening import screen
from .isolators.sizing.size import size
from .methods.averaging import average
from .methods.closed_form import exact
from .methods.fokker_planck import first_passage, fokker_planck, transient
from .methods.linearisation import linearise
from .methods.monte_carlo import simulate
from .methods.periodic import harmonic_response
from .methods.replay import replay
from .notices import InputWarning, KernelWarning, OutputWarning, PartWarning, StochviWarning
from .results.base import Response
from .results.errors import NotApplicable, NotConverged, SceneError, StochviError
from .results.estimates import Estimate
from .saved_answers import load_answer, save_answer
from .scenes.absorbers import Absorber
from .scenes.excitations import (
    ConstantLoad,
    FilteredNoise,
    RecordedNoise,
    RoadNoise,
    Sine,
    StateSpaceNoise,
    TabulatedNoise,
    TransferFunctionNoise,
    WhiteNoise,
)
from .scenes.impact_laws import (
    Elastic,
    ForceFunction,
    ForceTable,
    PowerLaw,
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from .scenes.scene import ImpactPair, Scene, load_scene
from .scenes.structures import Isolator, Matrices, Oscillator
from .scenes.validation import BetweenUnits, Scatter
from .statistics.damage import damage
from .statistics.histories import history
from .statistics.impacts import impacts
from .statistics.reliability import reliability
from .statistics.spectra import spectrum
from .statistics.stability import growth
from .sweeps import mean_over_records, mean_over_units, sweep
from .verification.check import check, explain
from .verification.cost import cost

__version__: str

__all__ = [
    "Absorber",
    "BetweenUnits",
    "ConstantLoad",
    "Elastic",
    "Estimate",
    "FilteredNoise",
    "ForceFunction",
    "ForceTable",
    "ImpactPair",
    "InputWarning",
    "Isolator",
    "KernelWarning",
    "Matrices",
    "NotApplicable",
    "NotConverged",
    "Oscillator",
    "OutputWarning",
    "PartWarning",
    "PowerLaw",
    "RecordedNoise",
    "Response",
    "Restitution",
    "RoadNoise",
    "Scatter",
    "Scene",
    "SceneError",
    "Sine",
    "SpeedRestitution",
    "StateSpaceNoise",
    "StochviError",
    "StochviWarning",
    "TabulatedNoise",
    "TransferFunctionNoise",
    "Viscoelastic",
    "WhiteNoise",
    "absorber",
    "absorbers",
    "average",
    "check",
    "cost",
    "damage",
    "exact",
    "explain",
    "explore",
    "first_passage",
    "fokker_planck",
    "growth",
    "harmonic_response",
    "history",
    "identification",
    "identify",
    "impacts",
    "isolators",
    "linearise",
    "load_answer",
    "load_scene",
    "mathematics",
    "mean_over_records",
    "mean_over_units",
    "methods",
    "reliability",
    "replay",
    "results",
    "save_answer",
    "scenes",
    "screen",
    "shocks",
    "simulate",
    "size",
    "spectrum",
    "statistics",
    "sweep",
    "testing",
    "transient",
    "verification",
]
