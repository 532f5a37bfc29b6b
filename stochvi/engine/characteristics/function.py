"""A force that is a function of a user's own, compiled for its author."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from stochvi.engine.characteristic import damps, pull, read
from stochvi.engine.laws.force_function import compiled_of, ingredients_of

_KNOWN: dict[str, type] = {}
"""Classes of parts by their names."""


@lru_cache(maxsize=64)
def part_of(function: Callable[..., float], damping: bool) -> type:
    """The class of parts with a force that is this function of displacement (m) and rate (m/s).

    A part has one number: the factor of the force per unit mass. `damping` says whether the force
    depends on the rate.
    """
    made_of = ingredients_of([function])
    name = f"SpringFunction_{made_of.digest()[:16]}{'_damped' * damping}"
    if made_of.obstacles:  # the digest does not determine the function
        name += f"_{len(_KNOWN)}"
    if name in _KNOWN:
        return _KNOWN[name]
    compiled = compiled_of(function)
    SpringFunction: Any = NamedTuple(name, [("factor", float)])
    SpringFunction.__module__ = __name__
    # kernels that are loaded from the disk find the class by its name
    globals()[name] = _KNOWN[name] = SpringFunction

    @pull.of(SpringFunction)
    def _(part, x, v, z):
        return part.factor * compiled(x, v)

    @damps.of(SpringFunction)
    def _(part):
        return damping

    @read.of(SpringFunction)
    def _(part, numbers, row):
        return SpringFunction(numbers[row, 0])

    return _KNOWN[name]
