"""Vibration isolators between stops: linear screening, required clearance, perturbations."""

from typing import Any

import lazy_loader

from stochvi.results.errors import name_of_today

_lazy_getattr, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    return _lazy_getattr(name_of_today(name))
