"""A drive that is a function of a user's own, compiled for its author."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from stochvi.engine.characteristic import pull, read, remembers
from stochvi.engine.drive import drawn, draws
from stochvi.engine.laws.force_function import compiled_of, ingredients_of
from stochvi.engine.uniform_numbers import uniform_of

_KNOWN: dict[str, type] = {}
"""Classes of drives by their names."""


@lru_cache(maxsize=64)
def drive_part_of(function: Callable[..., float]) -> type:
    """The class of drives whose value after a time is this function of the value before, of the
    time (s) and of a uniform number.

    A drive has one number: the force per unit of its value and of mass.
    """
    made_of = ingredients_of([function])
    name = f"DriveFunction_{made_of.digest()[:16]}"
    if made_of.obstacles:  # the digest does not determine the function
        name += f"_{len(_KNOWN)}"
    if name in _KNOWN:
        return _KNOWN[name]
    compiled = compiled_of(function, 3)
    DriveFunction: Any = NamedTuple(name, [("factor", float)])
    DriveFunction.__module__ = __name__
    # kernels that are loaded from the disk find the class by its name
    globals()[name] = _KNOWN[name] = DriveFunction

    @pull.of(DriveFunction)
    def _(part, x, v, z):
        return -part.factor * z

    @remembers.of(DriveFunction)
    def _(part):
        return True

    @draws.of(DriveFunction)
    def _(part):
        return True

    @drawn.of(DriveFunction)
    def _(part, z, word, event, h):
        return compiled(z, h, uniform_of(word, event))

    @read.of(DriveFunction)
    def _(part, numbers, row):
        return DriveFunction(numbers[row, 0])

    return _KNOWN[name]
