"""A force that is a function of a user's own, compiled for its author."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from types import CellType, FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba.core import config, types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from stochvi.engine.compiling import kernel
from stochvi.engine.ingredients import BY_NAME, Ingredients
from stochvi.engine.law import force, is_lossy, is_smooth, rate, read

DEFLECTIONS = np.geomspace(1e-9, 1e2, 133)
"""Deflections, m, at which the time scale of a force is known: twelve in a decade."""

RELATIVE_STEP = 1e-6
"""Step of differences, relative to a deflection, and in m/s."""


def contents_of(functions: Iterable[Callable[..., Any]]) -> str:
    """Digest of the instructions of functions and of the values that they use."""
    return ingredients_of(functions).digest()


def ingredients_of(functions: Iterable[Callable[..., Any]]) -> Ingredients:
    made_of = Ingredients(running=True)
    for function in functions:
        if isinstance(function, Dispatcher):
            made_of.add(function)
        elif hasattr(function, "__code__"):
            made_of.function(function)  # type: ignore[arg-type]
        else:
            made_of.add(repr(function))
    return made_of


class NotCompiled(ValueError):
    """A function that numba does not compile; the message says why."""


def compiled_of(function: Callable[..., Any], numbers: int = 2) -> Any:
    """A function of so many numbers that kernels can call, with the functions that it calls.

    Raises
    ------
    NotCompiled
        If numba does not know something in it, or if it does not return a number.
    """
    compiled = _kernel_of(function, ())
    if config.DISABLE_JIT:
        return compiled
    arguments = (types.float64,) * numbers
    try:
        compiled.get_call_template(arguments, {})
        versions = getattr(compiled, "linked", compiled).overloads
        found = versions[arguments].signature.return_type
    except NumbaError as error:
        lines = [line for line in str(error).splitlines() if line.strip()]
        why = next((line for line in lines if "name" in line or "known" in line), lines[-1])
        raise NotCompiled(why.strip()) from None
    if not isinstance(found, types.Number):
        raise NotCompiled(f"it returns {found}")
    return compiled


def _kernel_of(function: Any, within: tuple[Any, ...]) -> Any:
    """A plain function, compiled, and with the plain functions that it names compiled, too."""
    if isinstance(function, Dispatcher) or not isinstance(function, FunctionType):
        return function

    def swapped(value: Any) -> Any:
        plain = (
            isinstance(value, FunctionType) and value.__module__.partition(".")[0] not in BY_NAME
        )
        return _kernel_of(value, (*within, function)) if plain and value not in within else value

    known = function.__globals__
    named = {name: swapped(known[name]) for name in function.__code__.co_names if name in known}
    cells = tuple(CellType(swapped(cell.cell_contents)) for cell in function.__closure__ or ())
    copy = FunctionType(
        function.__code__, known | named, function.__name__, function.__defaults__, cells or None
    )
    copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
    return kernel(copy)


@lru_cache(maxsize=64)
def law_of(function: Callable[..., float], lossy: bool) -> type:
    """The class of laws with a force that is this function of deflection (m) and rate (m/s).

    A law has three numbers: the factor of the force, per unit mass, and the deflection and the rate
    in units of those of the function. `lossy` says whether the force depends on the rate.
    """
    made_of = ingredients_of([function])
    name = f"ForceFunction_{made_of.digest()[:16]}{'_lossy' * lossy}"
    if made_of.obstacles:  # the digest does not determine the function
        name += f"_{len(_KNOWN)}"
    if name in _KNOWN:
        return _KNOWN[name]
    compiled = compiled_of(function)
    deflections, energies, slopes, dampings = scales_of(function)
    kinds = [("factor", float), ("length", float), ("speed", float)]
    ForceFunction: Any = NamedTuple(name, kinds)
    ForceFunction.__module__ = __name__
    # kernels that are loaded from the disk find the class by its name
    globals()[name] = _KNOWN[name] = ForceFunction

    @force.of(ForceFunction)
    def _(law, y, v):
        # sub-steps may end a little before the stop
        return law.factor * compiled(law.length * max(y, 0.0), law.speed * v)

    @rate.of(ForceFunction)
    def _(law, y, v, push):
        # the deflection at which the stop has taken up the energy of the mass
        factor, length, speed = law
        place, energy, known = length * y, 0.5 * v * v, 0.0
        stiff, loss = slopes[0], dampings[0]
        for k in range(deflections.shape[0]):
            if deflections[k] <= place:
                known = energies[k]
            taken = factor * (energies[k] - known) - max(push, 0.0) * (deflections[k] - place)
            stiff, loss = slopes[k], dampings[k]
            if deflections[k] > place and taken >= length * energy:
                break
        return max(math.sqrt(factor * length * stiff), factor * speed * loss)

    @is_lossy.of(ForceFunction)
    def _(law):
        return lossy

    @is_smooth.of(ForceFunction)
    def _(law):
        return False

    @read.of(ForceFunction)
    def _(law, numbers, row):
        return ForceFunction(numbers[row, 0], numbers[row, 1], numbers[row, 2])

    return _KNOWN[name]


_KNOWN: dict[str, type] = {}
"""Classes of laws by their names."""


def scales_of(function: Callable[..., float]) -> tuple[np.ndarray, ...]:
    """Deflections, with the energy at rest, the largest slope and the largest damping up to each,
    as far as they are finite."""

    def at(y: np.ndarray, v: float = 0.0) -> np.ndarray:
        return np.array([_number(function, one, v) for one in y])

    y, step = DEFLECTIONS, RELATIVE_STEP
    slopes = (at(y * (1.0 + step)) - at(y * (1.0 - step))) / (2.0 * step * y)
    dampings = np.abs(at(y, step) - at(y, -step)) / (2.0 * step)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    edges = np.concatenate([[0.0], y])
    half, middle = np.diff(edges) / 2.0, (edges[1:] + edges[:-1]) / 2.0
    forces = at((middle[:, None] + half[:, None] * nodes).ravel()).reshape(len(y), 4)
    energies = np.cumsum(half * (np.maximum(forces, 0.0) @ weights))
    good = np.isfinite(slopes) & np.isfinite(dampings) & np.isfinite(energies)
    last = len(y) if good.all() else max(int(np.argmin(good)), 1)
    return (
        y[:last].copy(), energies[:last].copy(),
        np.maximum.accumulate(np.maximum(slopes[:last], 0.0)),
        np.maximum.accumulate(dampings[:last]),
    )  # fmt: skip


def _number(function: Callable[..., float], y: float, v: float) -> float:
    try:
        return float(function(y, v))
    except (ArithmeticError, ValueError):  # far outside of what the function is for
        return math.nan
