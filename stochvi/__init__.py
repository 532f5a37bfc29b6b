"""stochvi: stochastic vibration of systems that hit their stops.

A `Scene` is a structure, the stops it can hit, and what shakes it. `exact`, `fokker_planck`,
`linearise` and `simulate` turn it into the same kind of `Response`, and `check` asks whether they
agree. What most users need is here; the rest is in the packages of each subject:

* `scenes`: tables, records and profiles that a scene is made of;
* `methods`: of each method its densities, arrays of scenes, and intermediate results;
* `statistics`, `isolators`, `absorbers`, `verification`: types of answers, and special cases;
* `testing`: scenes with known answers, and the judge of other integrators;
* `results`: numbers with their errors, and what can go wrong.

Names are imported when they are first used, so that importing the package costs next to nothing.
"""

from importlib import import_module
from typing import Any

import lazy_loader

_lazy_getattr, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_HOMES = {
    "absorbers": ("AbsorberReport", "Design", "design_absorber"),
    "isolators": ("Jolts", "Screening", "Sizing", "clearance_curve"),
    "mathematics.kelvin_voigt": ("identify_viscoelastic",),
    "methods.closed_form": (
        "ExactDensity",
        "autocorrelation",
        "displacement_density",
        "exact_density",
    ),
    "methods.fokker_planck": (
        "FirstPassage",
        "Gaussian",
        "StationaryDensity",
        "Transient",
        "fokker_planck_density",
        "fokker_planck_many",
    ),
    "methods.linearisation": (
        "LinearisedOscillator",
        "LinearisedStructure",
        "linearise_all",
        "linearise_many",
        "linearised_oscillators",
        "linearised_structures",
    ),
    "methods.monte_carlo": ("record_path",),
    "methods.periodic": ("HarmonicResonance", "RandomResonance"),
    "results": ("CheckpointError", "Cost", "NoExactSolution"),
    "statistics": ("Chance", "History", "ImpactStatistics", "Reliability", "ResponseSpectrum"),
    "verification": ("Check", "Checks", "Explanation", "WorkPrecision", "check_many", "zoo"),
}
"""Names that `stochvi.NAME` finds too, because programs use them so, by the package they are in."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stochvi")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"stochvi.{home}"), name)
    return _lazy_getattr(name)
