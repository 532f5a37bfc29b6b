from .absorbers import AbsorberReport, Design, absorber, design_absorber
from .isolators.jolts import Jolts
from .isolators.screening import Screening, clearance_curve, screen
from .isolators.sizing import Sizing, size
from .mathematics.kelvin_voigt import identify_viscoelastic
from .methods.averaging import average
from .methods.closed_form import (
    ExactDensity,
    autocorrelation,
    displacement_density,
    exact,
    exact_density,
)
from .methods.fokker_planck import (
    FirstPassage,
    Gaussian,
    StationaryDensity,
    Transient,
    first_passage,
    fokker_planck,
    fokker_planck_density,
    fokker_planck_many,
    transient,
)
from .methods.linearisation import (
    LinearisedOscillator,
    LinearisedStructure,
    linearise,
    linearise_all,
    linearise_many,
    linearised_oscillators,
    linearised_structures,
)
from .methods.monte_carlo import record_path, simulate
from .methods.periodic.resonance import HarmonicResonance, RandomResonance
from .results.errors import (
    CheckpointError,
    Interrupted,
    NoExactSolution,
    NotApplicable,
    NotConverged,
    SceneError,
    StochviError,
)
from .results.estimates import Cost, Estimate, Response
from .scenes.absorbers import Absorber
from .scenes.excitations import (
    ConstantLoad,
    FilteredNoise,
    RecordedNoise,
    RoadNoise,
    Sine,
    TabulatedNoise,
    WhiteNoise,
)
from .scenes.impact_laws import (
    Elastic,
    ForceTable,
    Hertz,
    Restitution,
    SpeedRestitution,
    Viscoelastic,
)
from .scenes.scene import ImpactPair, Scene, load_scene
from .scenes.structures import Isolator, Matrices, NonlinearOscillator, Oscillator
from .statistics.impacts import ImpactStatistics, impacts
from .statistics.reliability import Chance, Reliability, reliability
from .statistics.spectra import ResponseSpectrum, spectrum
from .sweeps import sweep
from .verification.accuracy import WorkPrecision, cost
from .verification.crosscheck import Check, check
from .verification.explanation import Explanation, explain
from .verification.zoo import Checks, check_many, zoo

__version__: str

__all__ = [
    "Absorber",
    "AbsorberReport",
    "Chance",
    "Check",
    "CheckpointError",
    "Checks",
    "ConstantLoad",
    "Cost",
    "Design",
    "Elastic",
    "Estimate",
    "ExactDensity",
    "Explanation",
    "FilteredNoise",
    "FirstPassage",
    "ForceTable",
    "Gaussian",
    "HarmonicResonance",
    "Hertz",
    "ImpactPair",
    "ImpactStatistics",
    "Interrupted",
    "Isolator",
    "Jolts",
    "LinearisedOscillator",
    "LinearisedStructure",
    "Matrices",
    "NoExactSolution",
    "NonlinearOscillator",
    "NotApplicable",
    "NotConverged",
    "Oscillator",
    "RandomResonance",
    "RecordedNoise",
    "Reliability",
    "Response",
    "ResponseSpectrum",
    "Restitution",
    "RoadNoise",
    "Scene",
    "SceneError",
    "Screening",
    "Sine",
    "Sizing",
    "SpeedRestitution",
    "StationaryDensity",
    "StochviError",
    "TabulatedNoise",
    "Transient",
    "Viscoelastic",
    "WhiteNoise",
    "WorkPrecision",
    "absorber",
    "autocorrelation",
    "average",
    "check",
    "check_many",
    "clearance_curve",
    "cost",
    "design_absorber",
    "displacement_density",
    "exact",
    "exact_density",
    "explain",
    "first_passage",
    "fokker_planck",
    "fokker_planck_density",
    "fokker_planck_many",
    "identify_viscoelastic",
    "impacts",
    "linearise",
    "linearise_all",
    "linearise_many",
    "linearised_oscillators",
    "linearised_structures",
    "load_scene",
    "record_path",
    "reliability",
    "screen",
    "simulate",
    "size",
    "spectrum",
    "sweep",
    "transient",
    "zoo",
]
