"""Springs, dampers and drives that are functions, as kernels know them. Chapters: polynomials and
Duffing; Coulomb friction; Rayleigh and van der Pol; tables; Bouc-Wen hysteresis; modulated
strengths; switched drives; random impulses; forces and drives of a user's own."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.arithmetic import uniform_of
from stochvi.engine.calls import MOST_DRAWS, drawn, draws, kept
from stochvi.engine.compiling import kernel
from stochvi.engine.impact_laws import compiled_of, ingredients_of
from stochvi.engine.parts import (
    damps,
    kicked,
    moved,
    pull,
    read_characteristic,
    remembers,
    slope,
    watched,
)

# ------------------------------------------------------------------------------
# A spring and a damper whose forces are polynomials; the Duffing spring is one of them.
# ------------------------------------------------------------------------------


class PolynomialSpring(NamedTuple):
    """F = a_1 x + a_2 x^2 + ... + a_n x^n per unit mass.

    Parameters
    ----------
    numbers : (rows, width). A row begins with n; then a_1, ..., a_n follow.
    row : the row of this polynomial.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, coefficients: ArrayLike) -> Self:
        """The spring with these coefficients, m/s^2 per power of m."""
        found = np.asarray(coefficients, float)
        return cls(np.concatenate([[len(found)], found])[None])


class PolynomialDamper(NamedTuple):
    """F = (c_1 + c_2 abs(v) + ... + c_n abs(v)^(n-1)) v per unit mass; the table is as that of
    `PolynomialSpring`."""

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, coefficients: ArrayLike) -> Self:
        """The damper with these coefficients, m/s^2 per power of m/s."""
        return cls(PolynomialSpring.of(coefficients).numbers)


@pull.of(PolynomialSpring)
def _(part, x, v, z):
    numbers, row = part
    total, k = 0.0, int(numbers[row, 0])
    while k > 0:
        total = (total + numbers[row, k]) * x
        k -= 1
    return total


@read_characteristic.of(PolynomialSpring)
def _(part, numbers, row):
    return PolynomialSpring(numbers, row)


@pull.of(PolynomialDamper)
def _(part, x, v, z):
    numbers, row = part
    total, k, speed = 0.0, int(numbers[row, 0]), abs(v)
    while k > 0:
        total = total * speed + numbers[row, k]
        k -= 1
    return total * v


@damps.of(PolynomialDamper)
def _(part):
    return True


@read_characteristic.of(PolynomialDamper)
def _(part, numbers, row):
    return PolynomialDamper(numbers, row)


# ------------------------------------------------------------------------------
# Dry friction of Coulomb.
# ------------------------------------------------------------------------------


class Coulomb(NamedTuple):
    """F = force sign(v) per unit mass; at rest whatever holds the mass, up to `force`.

    Parameters
    ----------
    force : m/s^2.
    """

    force: float


@kernel
def growth(rate, h):
    """Integral of exp(rate t) over the time h, s."""
    return math.expm1(rate * h) / rate if rate != 0.0 else h


@pull.of(Coulomb)
def _(part, x, v, z):
    return math.copysign(part.force, v) if v != 0.0 else 0.0


@damps.of(Coulomb)
def _(part):
    return True


@kicked.of(Coulomb)
def _(part, x, v, z, push, damping, h):
    if v == 0.0 and abs(push) <= part.force:
        return v
    side = math.copysign(1.0, v if v != 0.0 else push)
    gain = push - side * part.force
    after = v + (gain + damping * v) * growth(damping, h)
    if after * side >= 0.0:
        return after
    if abs(push) <= part.force:
        return 0.0
    stopped = -v / gain if damping == 0.0 else -math.log1p(damping * v / gain) / damping
    return (push + side * part.force) * growth(damping, h - stopped)


@read_characteristic.of(Coulomb)
def _(part, numbers, row):
    return Coulomb(numbers[row, 0])


# ------------------------------------------------------------------------------
# Dampers that put energy into small motions and take it from large ones: Rayleigh, van der Pol.
# ------------------------------------------------------------------------------


class Rayleigh(NamedTuple):
    """F = linear v + cubic v^3 per unit mass.

    Parameters
    ----------
    linear, cubic : 1/s and s/m^2.
    """

    linear: float
    cubic: float


class VanDerPol(NamedTuple):
    """F = damping ((x / amplitude)^2 - 1) v per unit mass.

    Parameters
    ----------
    damping, amplitude : 1/s and m.
    """

    damping: float
    amplitude: float


@pull.of(Rayleigh)
def _(part, x, v, z):
    return (part.linear + part.cubic * v * v) * v


@damps.of(Rayleigh)
def _(part):
    return True


@kicked.of(Rayleigh)
def _(part, x, v, z, push, damping, h):
    # half of the push before and after the exact solution of v' = a v - cubic v^3
    v, a = v + 0.5 * h * push, damping - part.linear
    growth = math.exp(2.0 * a * h)
    way = (growth - 1.0) / a if a != 0.0 else 2.0 * h
    return v * math.sqrt(growth / (1.0 + part.cubic * v * v * way)) + 0.5 * h * push


@read_characteristic.of(Rayleigh)
def _(part, numbers, row):
    return Rayleigh(numbers[row, 0], numbers[row, 1])


@pull.of(VanDerPol)
def _(part, x, v, z):
    return part.damping * ((x / part.amplitude) ** 2 - 1.0) * v


@damps.of(VanDerPol)
def _(part):
    return True


@kicked.of(VanDerPol)
def _(part, x, v, z, push, damping, h):
    v, a = v + 0.5 * h * push, damping - part.damping * ((x / part.amplitude) ** 2 - 1.0)
    return v * math.exp(a * h) + 0.5 * h * push


@read_characteristic.of(VanDerPol)
def _(part, numbers, row):
    return VanDerPol(numbers[row, 0], numbers[row, 1])


# ------------------------------------------------------------------------------
# A spring whose force is linear between the points of a table.
# ------------------------------------------------------------------------------


class SpringTable(NamedTuple):
    """F through the points (x_k, F_k), straight on beyond the first and the last one.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number of points; then x_k, m, F_k, m/s^2, and
        the slope from there on, 1/s^2, follow for each.
    row : the row of this table.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, x: ArrayLike, force: ArrayLike) -> Self:
        """The table of these points."""
        places, forces = np.asarray(x, float), np.asarray(force, float)
        slopes = np.diff(forces) / np.diff(places)
        points = np.stack([places[:-1], forces[:-1], slopes], axis=1)
        return cls(np.concatenate([[len(points)], points.ravel()])[None])


@pull.of(SpringTable)
def _(part, x, v, z):
    numbers, row = part
    low, high = 0, int(numbers[row, 0])
    while high - low > 1:
        middle = (low + high) // 2
        if x < numbers[row, 1 + 3 * middle]:
            high = middle
        else:
            low = middle
    k = 1 + 3 * low
    return numbers[row, k + 1] + numbers[row, k + 2] * (x - numbers[row, k])


@read_characteristic.of(SpringTable)
def _(part, numbers, row):
    return SpringTable(numbers, row)


# ------------------------------------------------------------------------------
# Hysteresis of Bouc and Wen.
# ------------------------------------------------------------------------------


LONGEST_WAY = 0.25
"""Longest way, in yield displacements, of one step of the memory's equation; its relative error is
then below 1e-6."""


class BoucWen(NamedTuple):
    """F = force z per unit mass, with length dz/dx = 1 - (gamma + beta sign(z dx)) abs(z)^exponent.

    Parameters
    ----------
    force, length : largest force, m/s^2, and yield displacement, m.
    exponent, beta : dimensionless; gamma = 1 - beta.
    """

    force: float
    length: float
    exponent: float
    beta: float


@kernel
def relative_slope(part, z, step, exponent):
    """length dz/dx of a way in the direction of `step`; an `exponent` of None is 1, as a power
    takes four fifths of the time."""
    side = part.beta if z * step > 0.0 else -part.beta
    size = abs(z) if exponent is None else abs(z) ** exponent
    return 1.0 - (1.0 - part.beta + side) * size


@kernel
def moved_along(part, z, way, exponent):
    """The memory after a way, by steps of Runge and Kutta."""
    count = math.ceil(abs(way) / (part.length * LONGEST_WAY))
    for _ in range(count):
        step = way / part.length / count
        a = relative_slope(part, z, step, exponent)
        b = relative_slope(part, z + 0.5 * step * a, step, exponent)
        c = relative_slope(part, z + 0.5 * step * b, step, exponent)
        d = relative_slope(part, z + step * c, step, exponent)
        z += step * (a + 2.0 * b + 2.0 * c + d) / 6.0
    return z


@pull.of(BoucWen)
def _(part, x, v, z):
    return part.force * z


@remembers.of(BoucWen)
def _(part):
    return True


@moved.of(BoucWen)
def _(part, z, way):
    if part.exponent == 1.0:
        return moved_along(part, z, way, None)
    return moved_along(part, z, way, part.exponent)


@slope.of(BoucWen)
def _(part, z, way):
    return relative_slope(part, z, way, part.exponent) / part.length


@read_characteristic.of(BoucWen)
def _(part, numbers, row):
    return BoucWen(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])


# ------------------------------------------------------------------------------
# A spring and damper whose strength a signal changes.
# ------------------------------------------------------------------------------


class Modulated(NamedTuple):
    """F = z (stiffness x + damping v) per unit mass, with z the relative change at this time.

    Parameters
    ----------
    stiffness, damping : 1/s^2 and 1/s.
    """

    stiffness: float
    damping: float


@pull.of(Modulated)
def _(part, x, v, z):
    return z * (part.stiffness * x + part.damping * v)


@damps.of(Modulated)
def _(part):
    return True


@kicked.of(Modulated)
def _(part, x, v, z, push, damping, h):
    rate = damping - z * part.damping
    return v + (push - z * part.stiffness * x + rate * v) * growth(rate, h)


@read_characteristic.of(Modulated)
def _(part, numbers, row):
    return Modulated(numbers[row, 0], numbers[row, 1])


# ------------------------------------------------------------------------------
# A drive whose force of constant size switches by the motion, at once or with a delay.
# ------------------------------------------------------------------------------


AT_REST = 4.0
"""Rate down to which a mass counts as at rest, in units of that of a kick."""


class Relay(NamedTuple):
    """A force along the rate, per unit mass, against it beyond two displacements.

    Parameters
    ----------
    force : m/s^2.
    above, below : m; the force is against the rate above the first on the way up, and below the
        second on the way down.
    """

    force: float
    above: float
    below: float


class LateRelay(NamedTuple):
    """`Relay` that switches when another direction has been wanted for a time, the `delay`, s.

    Its memory is the direction, 1 or -1, plus or minus the time for which the other one has been
    wanted; 0 before the first kick.
    """

    force: float
    above: float
    below: float
    delay: float


@kernel
def wanted(part, x, v):
    """Direction of the force at a displacement and a rate."""
    if v >= 0.0:
        return 1.0 if x < part.above else -1.0
    return -1.0 if x > part.below else 1.0


@kernel
def share_before(left, v, h):
    """Share of the time from -h to h that a mass spends before a place that is `left` m ahead."""
    return min(max(0.5 + 0.5 * left / (h * v), 0.0), 1.0)


@kernel
def mean_direction(part, x, v, h):
    """Mean direction over the time from -h to h: half of a switch within it acts in either kick."""
    if v > 0.0:
        return 2.0 * share_before(part.above - x, v, h) - 1.0
    if v < 0.0:
        return 1.0 - 2.0 * share_before(x - part.below, -v, h)
    return wanted(part, x, v)


@pull.of(Relay)
def _(part, x, v, z):
    return -part.force * wanted(part, x, v)


@damps.of(Relay)
def _(part):
    return True


@kicked.of(Relay)
def _(part, x, v, z, push, damping, h):
    gain = push + part.force * mean_direction(part, x, v, h)
    after = v + (gain + damping * v) * growth(damping, h)
    if after * v >= 0.0:
        return after
    stopped = -v / gain if damping == 0.0 else -math.log1p(damping * v / gain) / damping
    return (push + part.force * wanted(part, x, after)) * growth(damping, h - stopped)


@read_characteristic.of(Relay)
def _(part, numbers, row):
    return Relay(numbers[row, 0], numbers[row, 1], numbers[row, 2])


@watched.of(LateRelay)
def _(part, x, v, z, h):
    # a mass that the force of a kick presses onto its stop does not move down
    side = wanted(part, x, v + AT_REST * part.force * h)
    now = math.copysign(1.0, z) if z != 0.0 else side
    if side == now:
        return now
    # half a kick is the mean time since the change at the first kick that meets it
    waited = abs(z) - 1.0
    waited += h if waited > 0.0 else 0.5 * h
    return side if waited >= part.delay else math.copysign(1.0 + waited, now)


@pull.of(LateRelay)
def _(part, x, v, z):
    return -part.force * math.copysign(1.0, z if z != 0.0 else wanted(part, x, v))


@remembers.of(LateRelay)
def _(part):
    return True


@kicked.of(LateRelay)
def _(part, x, v, z, push, damping, h):
    return v + (push + damping * v - pull(part, x, v, z)) * growth(damping, h)


@read_characteristic.of(LateRelay)
def _(part, numbers, row):
    return LateRelay(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])


# ------------------------------------------------------------------------------
# Instantaneous impulses at random times.
# ------------------------------------------------------------------------------


SIZES = "equal", "normal", "exponential"
"""Names of the distributions of sizes, whose numbers here are their kinds."""


class RandomPulses(NamedTuple):
    """Impulses at the times of a Poisson process; z is their sum in a kick.

    Parameters
    ----------
    rate : mean number of impulses per second.
    size : change of the rate of the displacement, m/s, which scales all sizes.
    two_sided : whether one impulse in two has the opposite direction.
    sizes : distribution of the sizes over `size`, a number of `SIZES`: 1, the absolute value of a
        normal number, or an exponential number.
    """

    rate: float
    size: float
    two_sided: float
    sizes: float


@kernel
def relative_size(sizes, uniform, other):
    """Size of an impulse in units of `size`, from two uniform numbers; it must not change with
    other to 1 - other in its distribution, as `other` also gives the direction."""
    if sizes == 0.0:
        return 1.0
    exponential = -math.log(uniform)
    if sizes == 1.0:
        return math.sqrt(2.0 * exponential) * abs(math.cos(2.0 * math.pi * other))
    return exponential


@pull.of(RandomPulses)
def _(part, x, v, z):
    return 0.0


@kicked.of(RandomPulses)
def _(part, x, v, z, push, damping, h):
    return v + push * h + z


@remembers.of(RandomPulses)
def _(part):
    return True


@draws.of(RandomPulses)
def _(part):
    return True


@kept.of(RandomPulses)
def _(part, z):
    return 0.0


@drawn.of(RandomPulses)
def _(part, z, word, event, h):
    # the number of impulses is the inverse of the distribution function of Poisson
    expected, uniform, count = part.rate * h, uniform_of(word, event), 0
    probability = math.exp(-expected)
    below = probability
    while uniform > below and probability > 0.0:
        count += 1
        probability *= expected / count
        below += probability
    for k in range(min(count, MOST_DRAWS // 2 - 1)):
        other = uniform_of(word, event + 2 * k + 2)
        size = part.size * relative_size(part.sizes, uniform_of(word, event + 2 * k + 1), other)
        z += -size if part.two_sided * other > 0.5 else size
    return z


@read_characteristic.of(RandomPulses)
def _(part, numbers, row):
    return RandomPulses(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])


# ------------------------------------------------------------------------------
# A force that is a function of a user's own, compiled for its author.
# ------------------------------------------------------------------------------


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

    @read_characteristic.of(SpringFunction)
    def _(part, numbers, row):
        return SpringFunction(numbers[row, 0])

    return _KNOWN[name]


# ------------------------------------------------------------------------------
# A drive that is a function of a user's own, compiled for its author.
# ------------------------------------------------------------------------------


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

    @read_characteristic.of(DriveFunction)
    def _(part, numbers, row):
        return DriveFunction(numbers[row, 0])

    return _KNOWN[name]
