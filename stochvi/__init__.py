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

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import lazy_loader

from stochvi.results.errors import name_of_today
from stochvi.results.plots import register

_lazy_getattr, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    name = name_of_today(name)
    if name == "__version__":
        from importlib.metadata import version

        return version("stochvi")
    if not (name in __all__ or name.startswith("_") or find_spec(f"stochvi.{name}")):
        # programs use `stochvi.NAME` for public names of the rooms, too
        for room in _rooms(__name__, __all__):
            if name in room.__all__:
                return getattr(room, name)
        from stochvi.results.base import unknown_name

        raise AttributeError(*unknown_name(name, __dir__()).args)
    return _lazy_getattr(name)


def __dir__() -> list[str]:
    return sorted({*__all__}.union(*(room.__all__ for room in _rooms(__name__, __all__))))


def _rooms(package: str, names: list[str]) -> Iterator[ModuleType]:
    """The rooms among the public names of a package, then the rooms in these."""
    inner = []
    for each in names:
        if find_spec(f"{package}.{each}"):
            room = import_module(f"{package}.{each}")
            if hasattr(room, "__all__"):
                yield room
                if hasattr(room, "__path__"):
                    inner.append(room)
    for room in inner:
        yield from _rooms(room.__name__, room.__all__)


def _draw(answer: Any, ax: Any, style: str) -> Any:
    from stochvi.views.pictures import plot

    return plot(answer, ax, style)


def _densities(answer: Any) -> Any:
    from stochvi.statistics.densities import densities_of

    return densities_of(answer)


register(_draw, _densities)
