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
from importlib.util import find_spec
from typing import Any

import lazy_loader

_lazy_getattr, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_ROOMS = (
    "scenes", "results", "statistics", "isolators", "absorbers", "verification",
    "methods.periodic", "methods.closed_form", "methods.linearisation", "methods.fokker_planck",
    "methods.monte_carlo", "mathematics.kelvin_voigt",
)  # fmt: skip
"""Packages whose public names `stochvi.NAME` finds too, because programs use them so; those that
take long to import stand last."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stochvi")
    if not (name in __all__ or name.startswith("_") or find_spec(f"stochvi.{name}")):
        for room in _ROOMS:
            package = import_module(f"stochvi.{room}")
            if name in package.__all__:
                return getattr(package, name)
    return _lazy_getattr(name)
