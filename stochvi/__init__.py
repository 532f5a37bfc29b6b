"""stochvi: stochastic vibration of systems that hit their stops.

A `Scene` is a structure, the stops it can hit, and what shakes it. `exact`, `fokker_planck`,
`linearise` and `simulate` turn it into the same kind of `Response`, and `check` asks whether they
agree.

Names are imported when they are first used, so that importing the package costs next to nothing.
"""

from typing import Any

import lazy_loader

_lazy_getattr, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stochvi")
    return _lazy_getattr(name)
