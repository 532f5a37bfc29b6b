"""Impact laws as kernels know them. Chapters: constant restitution; restitution that scatters;
restitution that depends on the speed; linear spring with or without damper; Hertz; power law with
loss; table; a function of a user's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from types import CellType, FunctionType
from typing import Any, NamedTuple, Self

import numpy as np
from numba.core import config, types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.compiling import BY_NAME, Ingredients, kernel
from stochvi.engine.parts import (
    MOST_NUMBERS,
    energy,
    force,
    is_lossy,
    is_rigid,
    is_smooth,
    margin,
    mean_rebound,
    rate,
    read_lane,
    read_law,
    rebound,
)

# ------------------------------------------------------------------------------
# A rigid stop with a constant restitution.
# ------------------------------------------------------------------------------


class Restitution(NamedTuple):
    """v+ = -R v-, with the `restitution` R."""

    restitution: float


@rebound.of(Restitution)
def _(law, w, uniform):
    return law.restitution * w


@is_rigid.of(Restitution)
def _(law):
    return True


@read_law.of(Restitution)
def _(law, numbers, row):
    return Restitution(numbers[row, 0])


# ------------------------------------------------------------------------------
# A rigid stop whose restitution is drawn at each impact.
# ------------------------------------------------------------------------------


CELLS = 512
"""Number of cells of equal probability. E R and E R^2 are exact, and a restitution is drawn within
its cell or the next: the distribution function is off by 4e-4 for mean 0.7 and std 0.1."""


class ScatteredRestitution(NamedTuple):
    """v+ = -R v-, with R uniform in a cell that is drawn.

    Parameters
    ----------
    numbers : (rows, 1 + 2 CELLS). A row begins with E R; then follow the middles of the cells, and
        their widths.
    row : the row of this law.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, law: Any) -> Self:
        """The law of a distribution with a mean and with `cells`."""
        middles, widths = law.cells(CELLS)
        return cls(np.concatenate([[law.mean], middles, widths])[None])


@rebound.of(ScatteredRestitution)
def _(law, w, uniform):
    numbers, row = law
    place = uniform * CELLS
    cell = int(place)
    r = numbers[row, 1 + cell] + numbers[row, 1 + CELLS + cell] * (place - cell - 0.5)
    return min(max(r, 0.0), 1.0) * w


@mean_rebound.of(ScatteredRestitution)
def _(law, w):
    return law.numbers[law.row, 0] * w


@is_rigid.of(ScatteredRestitution)
def _(law):
    return True


@read_law.of(ScatteredRestitution)
def _(law, numbers, row):
    return ScatteredRestitution(numbers, row)


# ------------------------------------------------------------------------------
# A rigid stop whose restitution depends on the speed of the impact.
# ------------------------------------------------------------------------------


class SpeedRestitution(NamedTuple):
    """v+ = -R(v-) v-, with R linear between speeds and constant beyond them.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number n of speeds; then follow n increasing
        speeds, m/s, and n restitutions.
    row : the row of this law.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, speeds: ArrayLike, restitutions: ArrayLike) -> Self:
        """The law of restitutions at increasing speeds, m/s."""
        found = np.concatenate([[np.size(speeds)], np.ravel(speeds), np.ravel(restitutions)])
        return cls(found[None])


@kernel
def restitution_at(law, w):
    """R at the speed w."""
    numbers, row = law
    count = int(numbers[row, 0])
    # the last speed of the table that is not above w, by halving
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if numbers[row, 1 + middle] <= w:
            low = middle
        else:
            high = middle
    before, r = numbers[row, 1 + low], numbers[row, 1 + count + low]
    if w <= before or low == count - 1:
        return r
    share = (w - before) / (numbers[row, 2 + low] - before)
    return r + share * (numbers[row, 2 + count + low] - r)


@rebound.of(SpeedRestitution)
def _(law, w, uniform):
    return restitution_at(law, w) * w


@mean_rebound.of(SpeedRestitution)
def _(law, w):
    # asked where a mass rests on the stop, by ever slower impacts
    return restitution_at(law, 0.0) * w


@is_rigid.of(SpeedRestitution)
def _(law):
    return True


@read_law.of(SpeedRestitution)
def _(law, numbers, row):
    return SpeedRestitution(numbers, row)


# ------------------------------------------------------------------------------
# A linear spring, alone or with a damper beside it.
# ------------------------------------------------------------------------------


class Viscoelastic(NamedTuple):
    """F = K y + c y' while it is positive, with the `stiffness` K (1/s^2) and `damping` c (1/s)."""

    stiffness: float
    damping: float


@force.of(Viscoelastic)
def _(law, y, v):
    return law.stiffness * y + law.damping * v


@energy.of(Viscoelastic)
def _(law, y):
    return 0.5 * law.stiffness * y * y


@margin.of(Viscoelastic)
def _(law, y, v):
    return y + law.damping / law.stiffness * v


@rate.of(Viscoelastic)
def _(law, y, v, push):
    return max(math.sqrt(law.stiffness), law.damping)


@is_lossy.of(Viscoelastic)
def _(law):
    return law.damping > 0.0


@read_law.of(Viscoelastic)
def _(law, numbers, row):
    return Viscoelastic(numbers[row, 0], numbers[row, 1])


# ------------------------------------------------------------------------------
# The contact of two round bodies.
# ------------------------------------------------------------------------------


class Hertz(NamedTuple):
    """F = k y^(3/2), with the `coefficient` k (m^-1/2 s^-2, per unit mass)."""

    coefficient: float


@force.of(Hertz)
def _(law, y, v):
    y = max(y, 0.0)
    return law.coefficient * y * math.sqrt(y)


@energy.of(Hertz)
def _(law, y):
    return 0.4 * law.coefficient * y * y * math.sqrt(y)


@rate.of(Hertz)
def _(law, y, v, push):
    # where (2/5) k y^(5/2) = E + push y, one of the two terms is at least half of it
    k, y = law.coefficient, max(y, 0.0)
    kinetic = 0.5 * v * v + 0.4 * k * y * y * math.sqrt(y)
    deepest = max((5.0 * kinetic / k) ** 0.4, (5.0 * max(push, 0.0) / k) ** (2.0 / 3.0))
    return math.sqrt(1.5 * k * math.sqrt(deepest))


@is_smooth.of(Hertz)
def _(law):
    return False


@read_law.of(Hertz)
def _(law, numbers, row):
    return Hertz(numbers[row, 0])


# ------------------------------------------------------------------------------
# A force that grows as a power of the deflection, with a loss that does so too.
# ------------------------------------------------------------------------------


class Power(NamedTuple):
    """F = k y^n + c y^m y' while it is positive: `coefficient` k, `exponent` n >= 1, `loss` c and
    `loss_exponent` m >= 0, per unit mass."""

    coefficient: float
    exponent: float
    loss: float
    loss_exponent: float


@force.of(Power)
def _(law, y, v):
    y = max(y, 0.0)
    return law.coefficient * y**law.exponent + law.loss * y**law.loss_exponent * v


@energy.of(Power)
def _(law, y):
    n = law.exponent + 1.0
    return law.coefficient / n * max(y, 0.0) ** n


@rate.of(Power)
def _(law, y, v, push):
    # where k y^(n+1) / (n + 1) = E + push y, one of the two terms is at least half of it
    k, n = law.coefficient, law.exponent
    kinetic = 0.5 * v * v + k / (n + 1.0) * max(y, 0.0) ** (n + 1.0)
    scale = 2.0 * (n + 1.0) / k
    deepest = max((scale * kinetic) ** (1.0 / (n + 1.0)), (scale * max(push, 0.0)) ** (1.0 / n))
    spring = math.sqrt(n * k * deepest ** (n - 1.0))
    return max(spring, law.loss * deepest**law.loss_exponent)


@is_lossy.of(Power)
def _(law):
    return law.loss > 0.0


@is_smooth.of(Power)
def _(law):
    return False


@read_law.of(Power)
def _(law, numbers, row):
    return Power(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])


# ------------------------------------------------------------------------------
# A force that is linear between the points of a table.
# ------------------------------------------------------------------------------


KINK = 2.0
"""How much shorter sub-steps are than for a straight line, since kinks lower their order to 3."""


class ForceTable(NamedTuple):
    """F = f_k + s_k (y - y_k) in the piece k.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number of pieces; then y_k, f_k and s_k follow
        for each piece, in m, m/s^2 and 1/s^2.
    row : the row of this table.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, pieces: ArrayLike) -> Self:
        """The law of pieces (pieces, 3)."""
        found = np.asarray(pieces, float)
        return cls(np.concatenate([[len(found)], found.ravel()])[None])


@force.of(ForceTable)
def _(law, y, v):
    numbers, row = law
    piece = int(numbers[row, 0]) - 1
    while piece > 0 and y < numbers[row, 1 + 3 * piece]:
        piece -= 1
    k = 1 + 3 * piece
    return numbers[row, k + 1] + numbers[row, k + 2] * (y - numbers[row, k])


@energy.of(ForceTable)
def _(law, y):
    numbers, row = law
    stored, last = 0.0, int(numbers[row, 0]) - 1
    for piece in range(last + 1):
        k = 1 + 3 * piece
        end = min(y, numbers[row, k + 3]) if piece < last else y
        way = max(end - numbers[row, k], 0.0)
        stored += way * (numbers[row, k + 1] + 0.5 * numbers[row, k + 2] * way)
    return stored


@rate.of(ForceTable)
def _(law, y, v, push):
    numbers, row = law
    steepest = 0.0
    for piece in range(int(numbers[row, 0])):
        steepest = max(steepest, numbers[row, 3 + 3 * piece])
    return KINK * math.sqrt(steepest)


@read_law.of(ForceTable)
def _(law, numbers, row):
    return ForceTable(numbers, row)


@read_lane.of(ForceTable)
def _(law, lanes, lane, numbers):
    return ForceTable(numbers, int(lanes[lane, MOST_NUMBERS]))


# ------------------------------------------------------------------------------
# A force that is a function of a user's own, compiled for its author.
# ------------------------------------------------------------------------------


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

    @read_law.of(ForceFunction)
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
