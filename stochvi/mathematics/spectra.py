"""Spectral tables and linear responses to noise. Chapters: tables, and the response of an
oscillator; structures of several modes by frequency; white noise, with exact steps and stationary
covariance; growth of moments under random or periodic coefficients.

All densities here are one-sided per hertz and in SI units; f is in hertz, omega = 2 pi f.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from stochvi.mathematics.numerics import Matrix, Vector, Waves, gauss_legendre, gauss_panels

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


# ------------------------------------------------------------------------------
# Response of a linear structure of several modes to tabulated noise, by frequency.
#
# Modal coordinates, q'' + B q' + K q = p f with f of a one-sided density G per hertz, so that
#
#     H(w) = (K - w^2 + i w B)^-1 p,    E q q' = int Re(H H*) G df        (n modes, w = 2 pi f)
#
# Correlated sources are expressed by independent ones whose forces p depend on frequency.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class InputMatrix:
    """Modal forces per unit of a source, as a function of frequency.

    Parameters
    ----------
    rows
        Forces (n, k) per unit of each of the k quantities that the source drives.
    shares
        Function from frequencies (Hz) to complex (frequencies, k): the quantities per unit of the
        source.
    breaks
        Frequencies (Hz) at which `shares` is not smooth.
    """

    rows: Matrix
    shares: Callable[[Vector], Waves]
    breaks: Vector

    def __call__(self, frequency_hz: Vector) -> Waves:
        """Forces (frequencies, n) at the given frequencies."""
        return np.asarray(self.shares(frequency_hz) @ self.rows.T)

    def __rmatmul__(self, matrix: Matrix) -> InputMatrix:
        """The same source with its forces multiplied by a matrix from the left."""
        return InputMatrix(matrix @ self.rows, self.shares, self.breaks)

    __array_ufunc__ = None  # so that numpy leaves matrix @ steering to __rmatmul__


Force = Vector | InputMatrix
"""Forces (n,) per unit of a source: one vector, or a function of frequency."""

Tables = Sequence[tuple[Table, Force]]
"""Each density, with the modal forces per unit of the quantity that the density describes."""


class RelaxingDamping(NamedTuple):
    """A damping matrix with springs behind dampers, whose forces relax: r' = k v - r / tau.

    B(w) = B + sum k tau / (1 + i w tau) g g', with v = g' q' the rate of a spring and damper.

    Parameters
    ----------
    matrix
        B (n, n).
    rows
        g (branches, n).
    stiffness, times
        k and tau (branches,).
    """

    matrix: Matrix
    rows: Matrix
    stiffness: Vector
    times: Vector

    def forces(self, omega: Vector) -> Waves:
        """Forces r per unit of v, k tau / (1 + i w tau), (frequencies, branches)."""
        return np.asarray(
            self.stiffness * self.times / (1.0 + 1j * np.multiply.outer(omega, self.times))
        )

    def __call__(self, omega: Vector) -> Waves:
        """B(w) at frequencies, rad/s, (frequencies, n, n)."""
        relaxing = np.einsum("fb,bi,bj->fij", self.forces(omega), self.rows, self.rows)
        return np.asarray(self.matrix + relaxing)


Damping = Matrix | RelaxingDamping
"""A matrix, or a function of frequency."""


def damping_at(damping: Damping, omega: Vector) -> Waves | Matrix:
    """Damping at frequencies, rad/s: (frequencies, n, n), or the (n, n) of all of them."""
    return damping(omega) if isinstance(damping, RelaxingDamping) else damping


NODES_OF_RESPONSE = 6
"""Number of Gauss-Legendre nodes on each panel; panels narrow geometrically towards resonances."""

AT_ONCE = 2**14
"""Number of frequencies whose matrices are held in memory together: 100 MB for 20 modes."""

MANY_MODES = 17
"""Number of modes from which those that nothing couples are solved one by one: 50 of them take a
thirtieth of the time that all together take."""

NARROWEST = 1e-9
"""Smallest width of a resonance, relative to its frequency, that panels resolve."""


def gains(frequency_hz: Vector, stiffness: Matrix, damping: Damping, force: Force) -> Waves:
    """Frequency responses of the displacements to an excitation, complex (frequencies, n).

    >>> still = gains(np.array([0.0]), np.diag([4.0]), np.diag([0.1]), np.array([2.0]))
    >>> still.real.tolist()
    [[0.5]]
    """
    return _gains_of_all(frequency_hz, stiffness, damping, [force])[:, :, 0]


def _gains_of_all(
    frequency_hz: Vector, stiffness: Matrix, damping: Damping, forces: Sequence[Force]
) -> Waves:
    """`gains` of several excitations, (frequencies, n, excitations)."""
    if len(frequency_hz) > AT_ONCE:  # a budget may end between two parts
        parts = [
            frequency_hz[first : first + AT_ONCE] for first in range(0, len(frequency_hz), AT_ONCE)
        ]
        return np.concatenate([_gains_of_all(each, stiffness, damping, forces) for each in parts])
    w = 2.0 * np.pi * frequency_hz[:, None, None]
    shape = (len(frequency_hz), len(stiffness))
    pushed = np.stack([np.broadcast_to(_at(force, frequency_hz), shape) for force in forces], -1)
    if shape[1] >= MANY_MODES and not isinstance(damping, RelaxingDamping) and _apart(damping):
        own, damped = (np.diag(each)[:, None] for each in (stiffness, damping))
        return np.asarray(pushed / (own - w**2 + 1j * w * damped), dtype=np.complex128)
    dynamic = stiffness - w**2 * np.eye(len(stiffness)) + 1j * w * damping_at(damping, w[:, 0, 0])
    return np.asarray(np.linalg.solve(dynamic, pushed), dtype=np.complex128)


def _apart(matrix: Matrix) -> bool:
    """Whether a matrix is diagonal, so that modes move apart from each other."""
    return bool(np.count_nonzero(matrix) == np.count_nonzero(np.diag(matrix)))


def _at(force: Force, frequency_hz: Vector) -> Waves:
    """Forces of a source at the frequencies, (frequencies, n) or (n,)."""
    if isinstance(force, InputMatrix):
        return force(frequency_hz)
    return force.astype(complex)


def quadrature(tables: Tables, stiffness: Matrix, damping: Damping) -> tuple[Vector, Vector]:
    """Nodes (Hz) and weights over all tables, in panels that narrow towards every resonance."""
    edges = [table.frequency_hz for table, _ in tables]
    edges += [force.breaks for _, force in tables if isinstance(force, InputMatrix)]
    low = float(min(table.frequency_hz[0] for table, _ in tables))
    high = float(max(table.frequency_hz[-1] for table, _ in tables))
    edges.append(np.geomspace(low, high, 2 + 2 * math.ceil(math.log2(high / low))))
    for value in eigenvalues(stiffness, damping):
        resonance = abs(value.imag) / (2.0 * math.pi)
        width = max(abs(value.real) / (2.0 * math.pi), NARROWEST * abs(value), 1e-300)
        reach = max(abs(high - resonance), abs(low - resonance), width)
        offsets = width * 2.0 ** np.arange(-1.0, math.ceil(math.log2(reach / width)) + 1.0)
        edges += [np.array([resonance]), resonance + offsets, resonance - offsets]
    cuts = np.unique(np.concatenate(edges))
    cuts = cuts[(cuts >= low) & (cuts <= high)]
    return gauss_panels(cuts, NODES_OF_RESPONSE)


def eigenvalues(stiffness: Matrix, damping: Damping) -> Waves:
    """Eigenvalues of the free motion q'' + B q' + K q = 0, one of each conjugate pair."""
    n = len(stiffness)
    plain = damping.matrix if isinstance(damping, RelaxingDamping) else damping
    companion = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -plain]])
    if isinstance(damping, RelaxingDamping):
        companion = with_branches(companion, damping)
    found = np.linalg.eigvals(companion).astype(complex)
    kept: Waves = found[found.imag >= 0.0]
    return kept


def with_branches(motion: Matrix, damping: RelaxingDamping) -> Matrix:
    """The generator (2n, 2n) of displacements and velocities with the forces of branches as further
    states."""
    n, count = len(motion) // 2, len(damping.times)
    pulled, moved = np.zeros((2 * n, count)), np.zeros((count, 2 * n))
    pulled[n:] = -damping.rows.T
    moved[:, n:] = damping.stiffness[:, None] * damping.rows
    return np.block([[motion, pulled], [moved, np.diag(-1.0 / damping.times)]])


def covariance(tables: Tables, stiffness: Matrix, damping: Damping) -> Matrix:
    """Stationary covariance of displacements and velocities, (2n, 2n), and of the forces of
    branches behind them.

    Examples
    --------
    >>> wide = Table(frequency_hz=np.array([1e-4, 1e4]), density=np.array([0.4, 0.4]))
    >>> found = covariance([(wide, np.array([1.0]))], np.diag([1.0]), np.diag([0.1]))
    >>> found.round(3) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    branches = len(damping.times) if isinstance(damping, RelaxingDamping) else 0
    total = np.zeros((2 * len(stiffness) + branches,) * 2)
    if not tables:
        return total
    nodes, weights = quadrature(tables, stiffness, damping)
    for first in range(0, len(nodes), AT_ONCE):
        f, weight = nodes[first : first + AT_ONCE], weights[first : first + AT_ONCE]
        solved = _gains_of_all(f, stiffness, damping, [force for _, force in tables])
        for number, (table, _) in enumerate(tables):
            moved = np.sqrt(table(f) * weight)[:, None] * solved[:, :, number]
            both = np.hstack([moved, 2j * np.pi * f[:, None] * moved])
            if isinstance(damping, RelaxingDamping):
                rates = both[:, len(stiffness) :] @ damping.rows.T
                both = np.hstack([both, damping.forces(2.0 * np.pi * f) * rates])
            # einsum rather than a product of matrices: no thread of BLAS changes its digits
            for part in (both.real, both.imag):
                total += np.einsum("fi,fj->ij", part, part)
    return total


def beyond(
    tables: Tables, stiffness: Matrix, damping: Damping, rows: Matrix
) -> tuple[Vector, Matrix]:
    """Frequencies (Hz), and the part of the velocity variance of each `rows` . q that comes from
    each frequency and above, (frequencies, rows)."""
    nodes, parts = [], []
    for table, force in tables:
        f, weight = quadrature([(table, force)], stiffness, damping)
        velocity = 2.0 * np.pi * f[:, None] * (gains(f, stiffness, damping, force) @ rows.T)
        nodes.append(f)
        parts.append((table(f) * weight)[:, None] * np.abs(velocity) ** 2)
    order = np.argsort(np.concatenate(nodes))
    shares = np.concatenate(parts)[order]
    return np.concatenate(nodes)[order], np.cumsum(shares[::-1], axis=0)[::-1]


NODES_OF_BIN = 3
"""Number of Gauss-Legendre nodes in a bin, or in each part of a bin that a breakpoint cuts."""


def bin_variances(table: Table, length: float, count: int) -> Vector:
    """Variances of the noise itself in the bins k = 1 ... count - 1, as `bin_amplitudes` has them:
    the integral of the density over each bin, and in the first that of all below."""
    nodes, weights = gauss_legendre(NODES_OF_BIN)
    edges = (np.arange(count) + 0.5) / length
    cuts = np.unique(np.concatenate([edges, table.frequency_hz]))
    cuts = cuts[(cuts >= table.frequency_hz[0]) & (cuts <= min(edges[-1], table.frequency_hz[-1]))]
    half, middle = np.diff(cuts) / 2.0, (cuts[1:] + cuts[:-1]) / 2.0
    owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
    parts = half * np.sum(weights[:, None] * table(middle + half * nodes[:, None]), axis=0)
    return np.asarray(np.bincount(owner, parts, count - 1), float)


def bin_amplitudes(
    table: Table, force: Force, stiffness: Matrix, damping: Damping, length: float, count: int
) -> tuple[Waves, Matrix]:
    """Amplitudes B of the bins k = 1 ... count - 1, and the contributions of each bin to E q'^2.

    Both are (count - 1, n). Bin k reaches from (k - 1/2) / length to (k + 1/2) / length. |B|^2 is
    the integral of |H|^2 G over the bin, so that a table that ends within a bin loses nothing. The
    phases, which relate the modes to each other, are those of H in the middle of the bin. The
    density below the first bin is added to it.
    """
    nodes, weights = gauss_legendre(NODES_OF_BIN)
    edges = (np.arange(count) + 0.5) / length
    low, high = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
    breaks = [force.breaks] if isinstance(force, InputMatrix) else []
    cuts = np.unique(np.concatenate([edges, table.frequency_hz, *breaks]))
    cuts = cuts[(cuts >= low) & (cuts <= min(edges[-1], high))]
    squares, velocities = np.zeros((2, count - 1, len(stiffness)))
    half, middle = np.diff(cuts) / 2.0, (cuts[1:] + cuts[:-1]) / 2.0
    owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
    for node, weight in zip(nodes, weights, strict=True):
        f = middle + half * node
        share = (half * weight * table(f))[:, None]
        share = share * np.abs(gains(f, stiffness, damping, force)) ** 2
        np.add.at(squares, owner, share)
        np.add.at(velocities, owner, (2.0 * np.pi * f[:, None]) ** 2 * share)
    turned = gains(np.arange(1, count) / length, stiffness, damping, force)
    size = np.abs(turned)
    phase = np.divide(turned, size, out=np.ones_like(turned), where=size > 0.0)
    return phase * np.sqrt(squares), velocities


# ------------------------------------------------------------------------------
# Linear systems driven by white noise, s' = A s + noise: exact steps and stationary covariance.
# ------------------------------------------------------------------------------


DOUBLINGS_FROM = 0.5
"""Largest norm of A h for which a step is computed directly; longer ones are found by doubling."""


def transition(generator: Matrix, step: float) -> Matrix:
    """exp(A h), (n, n).

    >>> transition(np.array([[0.0, 1.0], [0.0, 0.0]]), 2.0)
    array([[1., 2.],
           [0., 1.]])
    """
    exponential: Matrix = scipy.linalg.expm(generator * step)
    return exponential


def step_covariance(generator: Matrix, noise: Matrix, step: float) -> Matrix:
    """Covariance that white noise brings in over a step, (n, n).

    Q(h) = int_0^h exp(A s) N exp(A' s) ds, from one matrix exponential (C. F. Van Loan, IEEE
    Trans. Autom. Control 23 (1978) 395) over a short step, and Q(2h) = Q(h) + exp(A h) Q(h)
    exp(A' h). The matrix exponential contains exp(-A h), which grows with h, and is therefore
    taken over the short step only.

    Parameters
    ----------
    generator, noise
        A and the intensity matrix N, E w w' = N delta.

    Examples
    --------
    >>> step_covariance(np.array([[-0.5]]), np.array([[1.0]]), 100.0)
    array([[1.]])
    """
    size = len(generator)
    norm = float(np.linalg.norm(generator, 1)) * step
    doublings = max(0, int(np.ceil(np.log2(norm / DOUBLINGS_FROM)))) if norm > 0.0 else 0
    short = step / 2.0**doublings
    block = np.zeros((2 * size, 2 * size))
    scale = float(np.max(np.abs(noise))) or 1.0  # its size depends on its unit
    block[:size, :size], block[:size, size:] = -generator, noise / scale
    block[size:, size:] = generator.T
    grown = scipy.linalg.expm(block * short)
    forward = grown[size:, size:].T
    covariance = scale * (forward @ grown[:size, size:])
    for _ in range(doublings):
        covariance = covariance + forward @ covariance @ forward.T
        forward = forward @ forward
    return np.asarray((covariance + covariance.T) / 2.0, float)


def stationary_covariance(generator: Matrix, noise: Matrix) -> Matrix:
    """Solution of A P + P A' + N = 0 for a stable A, (n, n).

    >>> oscillator = np.array([[0.0, 1.0], [-1.0, -0.1]])
    >>> stationary_covariance(oscillator, np.diag([0.0, 0.2])).round(12) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    solution = scipy.linalg.solve_continuous_lyapunov(generator, -noise)
    return np.asarray((solution + solution.T) / 2.0, float)


def square_root(covariance: Matrix, tolerance: float) -> Matrix:
    """Columns L with L L' equal to a covariance, one for each independent noise.

    Eigenvalues of the correlations below `tolerance` times the largest one are left out, and
    correlations below it: rounding must not choose the axes of independent states.

    >>> square_root(np.diag([4.0, 0.0]), 1e-12)
    array([[2.],
           [0.]])
    """
    own = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(own > 0.0, own, 1.0)
    correlations = covariance / np.outer(size, size)
    np.fill_diagonal(correlations, own > 0.0)
    correlations[np.abs(correlations) < tolerance] = 0.0
    values, vectors = np.linalg.eigh(correlations)
    kept = values > tolerance * max(float(values[-1]), 0.0)
    signs = np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(len(vectors))])
    columns: Matrix = size[:, None] * (vectors * signs * np.sqrt(np.maximum(values, 0.0)))[:, kept]
    return columns[:, ::-1]


# ------------------------------------------------------------------------------
# Growth of the moments of linear systems whose coefficients are random or periodic.
#
#     x' = (A + sum_j xi_j(t) B_j) x
#
# Its moments of one order p, E x^(p), follow the same kind of equation with the Kronecker sums of A
# and B_j. A modulation xi is a function of a process of its own: of a phase that turns, or of a
# filter that noise drives. Moments times the functions of a basis of that process follow a constant
# matrix, whose rightmost eigenvalue is the rate of growth. White noise has no process: in the sense
# of Stratonovich it adds S B^2 / 2 to the matrix.
# ------------------------------------------------------------------------------


FIRST_ORDER, LARGEST_SIZE = 6, 1000
"""First order of the bases, and the largest size of a matrix whose eigenvalues are sought."""

AT_ENDS = 1e-6
"""Share of an eigenvector at the ends of a basis, from which on it is one of the cut."""

SETTLED = 1e-7
"""Change of the growth between an order and a half more, relative to the norm of A, up to which it
has converged."""


class WhiteChange(NamedTuple):
    """White noise, E xi(t) xi(t + tau) = intensity delta(tau), in the sense of Stratonovich.

    Parameters
    ----------
    matrix, intensity : B, and S, s.
    """

    matrix: Matrix
    intensity: float


class SineChange(NamedTuple):
    """A sine of an amplitude and a frequency omega (rad/s), with a random phase."""

    matrix: Matrix
    amplitude: float
    omega: float

    def operators(self, order: int) -> tuple[Matrix, Matrix]:
        """Generator and xi on the functions exp(i k phase), k = -order .. order."""
        turns = np.arange(-order, order + 1)
        near = np.eye(len(turns), k=1) + np.eye(len(turns), k=-1)
        return np.diag(1j * self.omega * turns), 0.5 * self.amplitude * near


class FilteredChange(NamedTuple):
    """White noise of an intensity through a resonance, xi'' + b xi' + w^2 xi = w^2 noise.

    Parameters
    ----------
    matrix, omega, damping_rate, intensity : B, w, rad/s, b, 1/s, and S, s.
    """

    matrix: Matrix
    omega: float
    damping_rate: float
    intensity: float

    def operators(self, order: int) -> tuple[Matrix, Matrix]:
        """Generator and xi on products of normed Hermite polynomials of xi and xi' / w, up to a
        degree."""
        index = {(i, d - i): k for k, (d, i) in enumerate(
            (d, i) for d in range(order + 1) for i in range(d + 1))}  # fmt: skip
        lower_u, lower_w = np.zeros((2, len(index), len(index)))
        for (i, j), k in index.items():
            if i:
                lower_u[index[i - 1, j], k] = np.sqrt(i)
            if j:
                lower_w[index[i, j - 1], k] = np.sqrt(j)
        turning = lower_w.T @ lower_u - lower_u.T @ lower_w
        generator = self.omega * turning - self.damping_rate * lower_w.T @ lower_w
        size = np.sqrt(self.omega**2 * self.intensity / (2.0 * self.damping_rate))
        return generator, size * (lower_u + lower_u.T)


Change = WhiteChange | SineChange | FilteredChange
"""A coefficient that changes."""


def moment_growth(system: Matrix, changes: Sequence[Change], power: int) -> float | None:
    """Rate at which the moments of an order grow in the long run, 1/s.

    Parameters
    ----------
    system
        A (n, n), 1/s.
    changes
        xi_j and B_j of what changes.
    power
        The order of the moments: 1 for means, 2 for mean squares.

    Returns
    -------
    float or None
        The rate; below 0 where the moments decay. None where no basis of a bearable size suffices.

    Examples
    --------
    White noise on the spring of x'' + b x' + w^2 (1 + xi) x = 0: mean squares neither grow nor
    decay at w^2 S = 2 b.

    >>> system, spring = np.array([[0.0, 1.0], [-4.0, -0.2]]), np.array([[0.0, 0.0], [-4.0, 0.0]])
    >>> abs(moment_growth(system, [WhiteChange(spring, 0.1)], 2)) < 1e-12
    True
    """
    order, before, white = FIRST_ORDER, math.inf, all(isinstance(c, WhiteChange) for c in changes)
    while True:
        found = _growth(system, changes, power, order)
        if found is None or white or abs(found - before) <= SETTLED * np.linalg.norm(system, 2):
            return found
        order, before = order + order // 2, found


def _growth(system: Matrix, changes: Sequence[Change], power: int, order: int) -> float | None:
    """The rightmost eigenvalue with bases of one order; None if the matrix is too large.

    A sine has all turns, of which the basis is a part. What lives at its ends is left out: it is of
    the cut, and of no motion.
    """
    moments = _lifted(system, power)
    coloured = [each for each in changes if not isinstance(each, WhiteChange)]
    for each in changes:
        if isinstance(each, WhiteChange):
            lifted = _lifted(each.matrix, power)
            moments = moments + 0.5 * each.intensity * lifted @ lifted
    bases = [each.operators(order) for each in coloured]
    units = [np.eye(len(generator)) for generator, _ in bases]
    if len(moments) * math.prod(len(unit) for unit in units) > LARGEST_SIZE:
        return None
    total, ends = _product(*units, moments), np.zeros(1, bool)
    for number, (each, (generator, size)) in enumerate(zip(coloured, bases, strict=True)):
        for own, last in (
            (generator.T, np.eye(len(moments))), (size.T, _lifted(each.matrix, power))
        ):  # fmt: skip
            factors = [*units[:number], own, *units[number + 1 :], last]
            total = total + _product(*factors)
        cut = np.zeros(len(generator), bool)
        if isinstance(each, SineChange):
            cut[[0, 1, -2, -1]] = True
        ends = (ends[:, None] | cut).ravel()
    values, vectors = np.linalg.eig(total)
    weights = np.abs(vectors) ** 2
    inside = weights[np.repeat(ends, len(moments))].sum(axis=0) <= AT_ENDS * weights.sum(axis=0)
    return float(np.max(values.real[inside], initial=-math.inf))


def _product(*factors: Matrix) -> Matrix:
    """The Kronecker product of all factors."""
    found: Matrix = np.eye(1)
    for factor in factors:
        found = np.asarray(np.kron(found, factor))
    return found


def _lifted(matrix: Matrix, power: int) -> Matrix:
    """The matrix for all products of `power` of the variables."""
    products = list(combinations_with_replacement(range(len(matrix)), power))
    index = {product: number for number, product in enumerate(products)}
    found = np.zeros((len(products), len(products)))
    for row, product in enumerate(products):
        for k, factor in enumerate(product):
            for j in np.flatnonzero(matrix[factor]):
                other = tuple(sorted((*product[:k], int(j), *product[k + 1 :])))
                found[row, index[other]] += matrix[factor, j]
    return found
