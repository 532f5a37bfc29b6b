"""stochvi: stochastic vibration of systems that hit their stops.

A `Scene` is a structure, the stops it can hit, and what shakes it. `exact`, `fokker_planck`,
`linearise` and `simulate` turn it into the same kind of `Response`, and `check` asks whether they
agree.

Names are imported when they are first used, so that importing the package costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stochvi.absorbers import AbsorberReport, Design, absorber, design_absorber
    from stochvi.accuracy import WorkPrecision, cost
    from stochvi.attachments import Absorber
    from stochvi.averaging import average
    from stochvi.closed_form import (
        ExactDensity,
        autocorrelation,
        displacement_density,
        exact,
        exact_density,
    )
    from stochvi.contacts import (
        Elastic,
        ForceTable,
        Hertz,
        Restitution,
        SpeedRestitution,
        Viscoelastic,
    )
    from stochvi.crosscheck import Check, check
    from stochvi.errors import (
        CheckpointError,
        Interrupted,
        NoExactSolution,
        NotApplicable,
        NotConverged,
        SceneError,
        StochviError,
    )
    from stochvi.estimates import Cost, Estimate, Response
    from stochvi.excitations import (
        ConstantLoad,
        FilteredNoise,
        RecordedNoise,
        RoadNoise,
        Sine,
        TabulatedNoise,
        WhiteNoise,
    )
    from stochvi.explanation import Explanation, explain
    from stochvi.failures import Chance, Reliability, reliability
    from stochvi.galerkin import (
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
    from stochvi.impact_statistics import ImpactStatistics, impacts
    from stochvi.isolators import Screening, clearance_curve, screen
    from stochvi.jolts import Jolts
    from stochvi.kelvin_voigt import identify_viscoelastic
    from stochvi.linearisation import (
        LinearisedOscillator,
        LinearisedStructure,
        linearise,
        linearise_all,
        linearise_many,
        linearised_oscillators,
        linearised_structures,
    )
    from stochvi.many_scenes import Checks, check_many, zoo
    from stochvi.monte_carlo import record_path, simulate
    from stochvi.resonance import HarmonicResonance, RandomResonance
    from stochvi.response_spectra import ResponseSpectrum, spectrum
    from stochvi.scenes import ImpactPair, Scene, load_scene
    from stochvi.sizing import Sizing, size
    from stochvi.structures import Isolator, Matrices, NonlinearOscillator, Oscillator
    from stochvi.sweeps import sweep

_HOME = {
    "absorbers": ("AbsorberReport", "Design", "absorber", "design_absorber"),
    "accuracy": ("WorkPrecision", "cost"),
    "attachments": ("Absorber",),
    "averaging": ("average",),
    "closed_form": (
        "ExactDensity",
        "autocorrelation",
        "displacement_density",
        "exact",
        "exact_density",
    ),
    "contacts": (
        "Elastic",
        "ForceTable",
        "Hertz",
        "Restitution",
        "SpeedRestitution",
        "Viscoelastic",
    ),
    "crosscheck": ("Check", "check"),
    "errors": (
        "CheckpointError",
        "Interrupted",
        "NoExactSolution",
        "NotApplicable",
        "NotConverged",
        "SceneError",
        "StochviError",
    ),
    "estimates": ("Cost", "Estimate", "Response"),
    "excitations": (
        "ConstantLoad",
        "FilteredNoise",
        "RecordedNoise",
        "RoadNoise",
        "Sine",
        "TabulatedNoise",
        "WhiteNoise",
    ),
    "explanation": ("Explanation", "explain"),
    "failures": ("Chance", "Reliability", "reliability"),
    "galerkin": (
        "FirstPassage",
        "Gaussian",
        "Transient",
        "first_passage",
        "fokker_planck",
        "fokker_planck_many",
        "transient",
        "StationaryDensity",
        "fokker_planck_density",
    ),
    "impact_statistics": ("ImpactStatistics", "impacts"),
    "jolts": ("Jolts",),
    "isolators": ("Screening", "clearance_curve", "screen"),
    "kelvin_voigt": ("identify_viscoelastic",),
    "linearisation": (
        "LinearisedOscillator",
        "LinearisedStructure",
        "linearise",
        "linearise_all",
        "linearise_many",
        "linearised_oscillators",
        "linearised_structures",
    ),
    "monte_carlo": ("record_path", "simulate"),
    "response_spectra": ("ResponseSpectrum", "spectrum"),
    "resonance": ("HarmonicResonance", "RandomResonance"),
    "scenes": ("ImpactPair", "Scene", "load_scene"),
    "sizing": ("Sizing", "size"),
    "structures": ("Isolator", "Matrices", "NonlinearOscillator", "Oscillator"),
    "sweeps": ("sweep",),
    "many_scenes": ("Checks", "check_many", "zoo"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

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


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stochvi")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'stochvi' has no attribute {name!r}")
    return getattr(importlib.import_module(f"stochvi.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
