"""Spectral tables and the response of a linear oscillator to them.

All densities here are one-sided per hertz and in SI units; f is in hertz, omega = 2 pi f.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.quadrature import gauss_panels

NODES = 16
"""Number of Gauss-Legendre nodes in each panel of a table."""

FEW_NODES = 4
"""Number of Gauss-Legendre nodes in a narrow panel, of which a measured table has thousands."""

NARROW, LEVEL = 0.1, 0.5
"""Limits of a narrow panel: its width over its distance to the resonance, and the change of the
logarithm of the density in it. The error of 4 nodes is then below 1e-11 of the integral over the
panel."""

FEWEST_BREAKPOINTS = 200
"""Smallest number of breakpoints of a table whose narrow panels are integrated with fewer nodes."""

MOST_BREAKPOINTS = 100_000
"""Largest number of breakpoints of a table: sums over more take seconds, and no analyser has more
lines."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Breakpoints of a density, which is log-log linear between them and zero outside.

    Parameters
    ----------
    frequency_hz, density
        Arrays of equal length >= 2, positive, frequencies increasing. A frequency that appears
        twice is a step of the density.
    """

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]

    def __post_init__(self) -> None:
        frequency, density = self.frequency_hz, self.density
        if len(frequency) != len(density):
            raise ValueError(
                f"needs as many densities as frequencies, got {len(density)} and {len(frequency)}"
            )
        if len(frequency) < 2:
            raise ValueError(f"needs at least 2 breakpoints, got {len(frequency)}")
        for name, column in (("frequency_hz", frequency), ("density", density)):
            bad = ~(np.isfinite(column) & (column > 0.0))
            if bad.any():
                row = int(np.argmax(bad))
                raise ValueError(
                    f"needs positive finite values of {name}, got {column[row]:g} in row {row + 1}"
                )
        if len(frequency) > MOST_BREAKPOINTS:
            raise ValueError(
                f"needs at most {MOST_BREAKPOINTS} breakpoints, got {len(frequency)}; average the "
                "densities of neighbouring frequencies"
            )
        falling = np.diff(frequency) < 0.0
        if falling.any():
            row = int(np.argmax(falling))
            raise ValueError(
                "needs increasing frequency_hz (twice the same for a step), "
                f"got {frequency[row]:g} before {frequency[row + 1]:g}"
            )
        thrice = frequency[2:] == frequency[:-2]
        if thrice.any() or frequency[0] == frequency[-1]:
            row = int(np.argmax(thrice)) if thrice.any() else 0
            raise ValueError(
                "needs increasing frequency_hz (twice the same for a step, and another frequency), "
                f"got {frequency[row]:g} before {frequency[row]:g} again"
            )

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Table)
            and np.array_equal(self.frequency_hz, other.frequency_hz)
            and np.array_equal(self.density, other.density)
        )

    __hash__ = None  # type: ignore[assignment]

    def __call__(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Density at the given frequencies."""
        f = np.asarray(frequency_hz, dtype=float)
        with np.errstate(divide="ignore"):
            logs = np.interp(np.log(f), np.log(self.frequency_hz), np.log(self.density))
        inside = (f >= self.frequency_hz[0]) & (f <= self.frequency_hz[-1])
        return np.where(inside, np.exp(logs), 0.0)

    def scaled(self, factor: float) -> Table:
        """The same shape at `factor` times the density."""
        with np.errstate(over="ignore", under="ignore"):
            density = self.density * factor
        return Table(frequency_hz=self.frequency_hz, density=density)

    def moment(self, power: float) -> float:
        """Integral of f^power G(f) df over the table, exact on every log-log segment.

        On a segment G = p1 (f / f1)^n; the integral of f^power G is elementary, with a
        logarithm where n + power = -1.
        """
        f1, f2 = self.frequency_hz[:-1], self.frequency_hz[1:]
        p1, p2 = self.density[:-1], self.density[1:]
        ratio = np.log(f2 / f1)
        exponent = np.log(p2 / p1) + (power + 1.0) * ratio
        # (e^t - 1) / t without loss of digits near t = 0, where it is 1
        growth = np.where(
            exponent == 0.0, 1.0, np.expm1(exponent) / np.where(exponent, exponent, 1)
        )
        return float(np.sum(p1 * f1 ** (power + 1.0) * ratio * growth))

    def mean_square(self) -> float:
        """Mean square of the noise: the area under the density.

        >>> flat = Table(frequency_hz=np.array([20.0, 2000.0]), density=np.array([0.01, 0.01]))
        >>> round(flat.mean_square(), 9)
        19.8
        """
        return self.moment(0.0)


TABLE_ERROR = 1e-6
"""Largest relative error of a refined density between the breakpoints of its table, and so of every
mean square that follows from it."""

POINTS_PER_DECADE = 20.0
"""Breakpoints per decade of a density before its table is refined."""

MOST_HALVINGS = 24
"""Largest number of times that an interval between two of these breakpoints is halved."""


def refined_table(density: Callable[[Vector], Vector], frequency_hz: Vector) -> Table:
    """A table that follows a density so closely that log-log interpolation is off by `TABLE_ERROR`
    at most.

    Parameters
    ----------
    density
        One-sided density at given frequencies (Hz), positive.
    frequency_hz
        Frequencies that become breakpoints, in any order; the table reaches from the lowest to the
        highest.

    Examples
    --------
    >>> found = refined_table(lambda f: 1.0 / (1.0 + f**2), np.array([0.01, 100.0]))
    >>> round(found.mean_square(), 4)  # the arc tangent of 100, less that of .01
    1.5508
    """
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    count = 2 + math.ceil(POINTS_PER_DECADE * math.log10(high / low))
    f = np.unique(np.concatenate([frequency_hz, np.geomspace(low, high, count)]))
    f = np.clip(f, low, high)
    values = np.log(density(f))
    for _ in range(MOST_HALVINGS):
        middle = np.sqrt(f[1:] * f[:-1])
        exact = np.log(density(middle))
        wrong = np.abs(exact - 0.5 * (values[1:] + values[:-1])) > TABLE_ERROR
        if not wrong.any():
            break
        places = np.flatnonzero(wrong) + 1
        f = np.insert(f, places, middle[wrong])
        values = np.insert(values, places, exact[wrong])
    return Table(frequency_hz=f, density=np.exp(values))


@dataclass(frozen=True, kw_only=True)
class LinearMoments:
    """Stationary mean squares of x'' + b x' + omega^2 x = f without stops."""

    displacement: float
    velocity: float
    absolute_acceleration: float
    relative_acceleration: float


class Filter(NamedTuple):
    """White noise w of intensity S0 through a resonance, f'' + b_f f' + w_f^2 f = w_f^2 w(t).

    `omega` is w_f (rad/s), `damping_rate` b_f (1/s), `intensity` S0.
    """

    omega: float
    damping_rate: float
    intensity: float

    def __call__(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """One-sided density at the given frequencies, 2 S0 w_f^4 |H_f|^2."""
        gain = squared_gain(frequency_hz, self.omega, self.damping_rate)
        return np.asarray(2.0 * self.intensity * self.omega**4 * gain)

    def response_moments(self, omega: float, damping_rate: float) -> tuple[float, float]:
        """E x^2 and E x'^2 of x'' + b x' + W^2 x = f, in closed form.

        The integral of 1 / |(W^2 - w^2 + i b w)(w_f^2 - w^2 + i b_f w)|^2, by the table of such
        integrals for the fourth order (H. M. James, N. B. Nichols and R. S. Phillips, Theory of
        Servomechanisms, 1947, appendix): with d = (W^2 - w_f^2)^2 + (b + b_f)(b w_f^2 + b_f W^2),

            E x^2  = S0 w_f^2 (b W^2 + b_f w_f^2 + b b_f (b + b_f)) / (2 b b_f W^2 d),
            E x'^2 = S0 w_f^4 (b + b_f) / (2 b b_f d).

            Both are infinite without damping, and E x^2 is infinite without stiffness.

        >>> sea = Filter(omega=1.0, damping_rate=0.2, intensity=0.2)
        >>> [round(moment, 6) for moment in sea.response_moments(omega=1.0, damping_rate=0.1)]
        [17.0, 16.666667]
        """
        own, own_rate = self.omega**2, self.damping_rate
        if self.intensity == 0.0:
            return 0.0, 0.0
        if damping_rate <= 0.0:
            return math.inf, math.inf
        square, both = omega**2, damping_rate + own_rate
        detuning = (square - own) ** 2 + both * (damping_rate * own + own_rate * square)
        common = self.intensity * own / (2.0 * damping_rate * own_rate * detuning)
        velocity = common * own * both
        if square == 0.0:
            return math.inf, velocity
        stored = damping_rate * square + own_rate * own + damping_rate * own_rate * both
        return common * stored / square, velocity


def squared_gain(frequency_hz: ArrayLike, omega: float, damping_rate: float) -> NDArray[np.float64]:
    """|H|^2 of displacement over acceleration input, 1 / |omega0^2 - omega^2 + i b omega|^2."""
    w = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
    # (omega0 - w)(omega0 + w) keeps its digits at the resonance
    return 1.0 / (((omega - w) * (omega + w)) ** 2 + (damping_rate * w) ** 2)


def response_moments(tables: Sequence[Table], omega: float, damping_rate: float) -> LinearMoments:
    """Mean squares of the linear response to the sum of `tables` (acceleration densities).

    |H|^2 G is integrated over frequency by 16-point Gauss-Legendre. The panels end at the
    breakpoints and narrow geometrically towards the resonance, so any damping is resolved.

    Examples
    --------
    >>> wide = Table(frequency_hz=np.array([1e-4, 1e4]), density=np.array([0.4, 0.4]))
    >>> moments = response_moments([wide], omega=1.0, damping_rate=0.1)
    >>> round(moments.displacement, 3), round(moments.velocity, 3)
    (1.0, 1.0)
    """
    totals = np.zeros(4)
    for table in tables:
        f, weight = _quadrature(table, omega, damping_rate)
        w2 = (2.0 * np.pi * f) ** 2
        response = squared_gain(f, omega, damping_rate) * table(f) * weight
        totals += [
            response.sum(),
            (w2 * response).sum(),
            ((damping_rate**2 * w2 + omega**4) * response).sum(),
            (w2**2 * response).sum(),
        ]
    return LinearMoments(
        displacement=float(totals[0]),
        velocity=float(totals[1]),
        absolute_acceleration=float(totals[2]),
        relative_acceleration=float(totals[3]),
    )


RIGID = 2000.0
"""An oscillator whose frequency (rad/s) is so many times the highest frequency (Hz) of the noise
follows the noise to 1e-5."""


def band_of_velocity(tables: Sequence[Table], omega: float, left_out: float) -> float:
    """Frequency (Hz) above which a share `left_out` of the velocity variance of an oscillator lies.

    It has half of critical damping; its frequency `omega` (rad/s) may be infinite.

    Examples
    --------
    >>> flat = Table(frequency_hz=np.array([10.0, 500.0]), density=np.array([1.0, 1.0]))
    >>> [round(band_of_velocity([flat], omega, 0.005)) for omega in (6.0, np.inf)]
    [403, 499]
    """
    omega = min(omega, RIGID * max(float(table.frequency_hz[-1]) for table in tables))
    nodes, parts = [], []
    for table in tables:
        f, weight = _quadrature(table, omega, omega)
        nodes.append(f)
        parts.append(f**2 * squared_gain(f, omega, omega) * table(f) * weight)
    order = np.argsort(np.concatenate(nodes))
    reached = np.cumsum(np.concatenate(parts)[order])
    enough = int(np.searchsorted(reached, (1.0 - left_out) * reached[-1]))
    return float(np.concatenate(nodes)[order][enough])


def _quadrature(
    table: Table, omega: float, damping_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes (Hz) and weights over the table, in panels that narrow towards the resonance."""
    resonance = omega / (2.0 * math.pi)
    low, high = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
    width = max(damping_rate / (4.0 * math.pi), 1e-9 * resonance, 1e-300)
    reach = max(abs(high - resonance), abs(low - resonance), width)
    offsets = width * 2.0 ** np.arange(-1.0, math.ceil(math.log2(reach / width)) + 1.0)
    edges = np.concatenate(
        [
            table.frequency_hz,
            [resonance],
            resonance + offsets,
            resonance - offsets,
            np.geomspace(low, high, 2 + 2 * math.ceil(math.log2(high / low))),
        ]
    )
    edges = np.unique(edges[(edges >= low) & (edges <= high)])
    if len(table.frequency_hz) < FEWEST_BREAKPOINTS:
        return gauss_panels(edges, NODES)
    distance = np.maximum(np.minimum(*np.abs(_ends(edges) - resonance)), width)
    logs = np.interp(np.log(edges), np.log(table.frequency_hz), np.log(table.density))
    narrow = (np.diff(edges) <= NARROW * distance) & (np.abs(np.diff(logs)) <= LEVEL)
    parts = [
        gauss_panels(_ends(edges)[:, chosen].T, nodes)
        for chosen, nodes in ((narrow, FEW_NODES), (~narrow, NODES))
        if chosen.any()
    ]
    f, weights = (
        np.concatenate([each.ravel() for each in both]) for both in zip(*parts, strict=True)
    )
    return f, weights


def _ends(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Left and right ends of the panels between edges."""
    return np.stack([edges[:-1], edges[1:]])


def welch(
    samples: NDArray[np.float64], rate: float, length: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (Hz) and one-sided density of samples, from segments of `length` samples.

    Hann windows overlap by half, and each segment has its mean subtracted (P. D. Welch, IEEE Trans.
    Audio Electroacoust. 15 (1967) 70). scipy.signal is not used, because its import takes half a
    second.

    >>> wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * 8.0 * np.arange(1024) / 64.0)
    >>> frequency, density = welch(wave, 64.0, 256)
    >>> round(float(density.sum() * frequency[1]), 9), float(frequency[density.argmax()])
    (1.0, 8.0)
    """
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    starts = range(0, len(samples) - length + 1, length - length // 2)
    total = np.zeros(length // 2 + 1)
    for start in starts:
        segment = samples[start : start + length]
        total += np.abs(np.fft.rfft(window * (segment - segment.mean()))) ** 2
    density = total / (len(starts) * rate * np.sum(window**2))
    density[1 : (length + 1) // 2] *= 2.0  # not at 0 Hz, nor at half the rate for an even length
    # whole frequencies stay whole, unlike those from 1 / rate
    return np.arange(length // 2 + 1) * rate / length, density
