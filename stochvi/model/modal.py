"""A structure in modal coordinates, and its stationary distribution with springs in place of its
stops."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import (
    Damping,
    Force,
    RelaxingDamping,
    Table,
    Tables,
    eigenvalues,
    gains,
    quadrature,
    stationary_covariance,
    with_branches,
)
from stochvi.mathematics.spectra import covariance as tabulated_covariance

RIGID_BODY = 1e-13
"""Eigenvalue, relative to the largest one, below which it is a rounding error and is set to 0."""

UNREACHED = 1e-26
"""Intensity of a modal force, relative to the largest that it could have, up to which it is a
rounding error: the square of the relative error of a sum of forces that cancel each other."""

UNSTABLE = 1e-8
"""Decay rate, relative to the fastest frequency, up to which a structure is taken to have no
stationary distribution."""


class ModalForm(NamedTuple):
    """M q'' + C q' + K q = forces in modal coordinates, displacements = Phi q with Phi' M Phi = 1.

    The state of a path is s = (q - rest, q', r, signals): r are the forces of branches, springs
    behind dampers, r' = k v - r / tau; each signal has the states f and f'/omega.

    Parameters
    ----------
    shapes, squares
        Phi (n, n) and omega^2 (n,).
    damping, white
        Phi' C Phi and Phi' S Phi (n, n).
    gaps
        Rows phi (pairs, n): the gap of a pair is y = phi . q.
    rest
        Modal displacements (n,) under the constant loads where no stop is touched. A load on a mode
        without stiffness has no such displacement: it is the last signal, a state that stays 1.
    signals, coupling, signal_noise
        Generator (m, m) of the signals; modal forces per unit of them (n, m); and intensity matrix
        (m, m) of the white noise that drives them.
    sines
        (first state, omega, amplitude) of the signals that are sines.
    tables
        Densities of the other noises, and the modal forces (n,) per unit of each.
    branches
        The branches, with `damping` as their matrix; None without any.
    """

    shapes: Matrix
    squares: Vector
    damping: Matrix
    white: Matrix
    gaps: Matrix
    rest: Vector
    signals: Matrix
    coupling: Matrix
    signal_noise: Matrix
    sines: tuple[tuple[int, float, float], ...]
    tables: Tables = ()
    branches: RelaxingDamping | None = None

    @property
    def size(self) -> int:
        """Number of modes, n."""
        return len(self.squares)

    @property
    def moving(self) -> int:
        """Number of states before those of signals: 2 n, and the forces of branches."""
        return 2 * self.size + (0 if self.branches is None else len(self.branches.times))

    def relaxing(self, damping: Matrix) -> Damping:
        """A modal damping matrix with the branches beside it."""
        return damping if self.branches is None else self.branches._replace(matrix=damping)

    @property
    def kicked(self) -> bool:
        """Whether there is white noise; the damping then acts in its kicks."""
        return bool(np.any(self.white))

    @property
    def falling(self) -> Vector:
        """Constant modal forces on modes without stiffness (n,)."""
        return self.coupling[:, -1] if len(self.signals) % 2 else np.zeros(self.size)

    @property
    def fastest(self) -> float:
        """Largest frequency of a mode or a signal, or rate of a branch, rad/s."""
        rates = () if self.branches is None else 1.0 / self.branches.times
        return float(max([self.frequency, *rates]))

    @property
    def frequency(self) -> float:
        """Largest frequency of a mode or a signal, rad/s; of modes before branches relax."""
        largest = float(np.max(self.squares))
        if self.branches is not None:
            rows, stiffness = self.branches.rows, self.branches.stiffness
            at_once = np.diag(self.squares) + (rows.T * stiffness) @ rows
            largest = float(np.linalg.eigvalsh(at_once)[-1])
        return float(max([math.sqrt(largest), *np.abs(np.linalg.eigvals(self.signals))]))

    @property
    def fading(self) -> NDArray[np.int64]:
        """Indices of the states that forget their start: all but those of sines and constants."""
        kept = np.ones(len(self.signals), bool)
        for first, _, _ in self.sines:
            kept[first : first + 2] = False
        if len(self.signals) % 2:
            kept[-1] = False
        return np.concatenate([np.arange(self.moving), self.moving + np.flatnonzero(kept)])

    def generator(self, damping: Matrix, stiffness: Matrix) -> Matrix:
        """Matrix A of s' = A s + noise with these modal matrices."""
        n, first = self.size, self.moving
        a = np.zeros((first + len(self.signals),) * 2)
        motion = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]])
        if self.branches is not None:
            motion = with_branches(motion, self.branches)
        a[:first, :first] = motion
        a[n : 2 * n, first:] = self.coupling
        a[first:, first:] = self.signals
        return a

    @property
    def flow(self) -> Matrix:
        """Matrix A of the motion between impacts, without the damping that acts in kicks."""
        damping = np.zeros_like(self.damping) if self.kicked else self.damping
        return self.generator(damping, np.diag(self.squares))

    @property
    def dynamic(self) -> Damping:
        """The modal damping matrix with the branches beside it."""
        return self.relaxing(self.damping)

    def pulls(self, damping: Matrix) -> Matrix:
        """Modal forces (n, moving) of springs, dampers and branches, from the states before those
        of signals."""
        own = [np.diag(self.squares), damping]
        return np.hstack(own if self.branches is None else [*own, self.branches.rows.T])

    def noise(self, white: Matrix) -> Matrix:
        """Intensity matrix of all white noise on the states, with `white` on the modes."""
        n, first = self.size, self.moving
        intensity = np.zeros((first + len(self.signals),) * 2)
        intensity[n : 2 * n, n : 2 * n] = white
        intensity[first:, first:] = self.signal_noise
        return intensity


class Branch(NamedTuple):
    """A branch of a spring that relaxes, r' = stiffness v - r / time, v = direction . q' its rate.

    Parameters
    ----------
    spring
        Name of the spring.
    stiffness, time
        N/m, and s.
    direction
        (n,), of the coordinates.
    """

    spring: str
    stiffness: float
    time: float
    direction: Vector


class LinearStructure(Protocol):
    """Parts of a modal form: a `Model`, without its stops."""

    @property
    def mass(self) -> Matrix: ...

    @property
    def damping(self) -> Matrix: ...

    @property
    def stiffness(self) -> Matrix: ...

    @property
    def white(self) -> Matrix: ...

    @property
    def constant_force(self) -> Vector: ...

    @property
    def pairs(self) -> Any: ...

    @property
    def signals(self) -> Any: ...

    @property
    def tables(self) -> Any: ...

    @property
    def branches(self) -> Any: ...


def modal_form(model: LinearStructure) -> ModalForm:
    """A model in modal coordinates, with its signals as states."""
    squares, shapes = _modes(model.stiffness, model.mass)
    squares = np.where(squares > RIGID_BODY * max(float(squares[-1]), 0.0), squares, 0.0)
    load = shapes.T @ model.constant_force
    free = squares == 0.0
    falling = np.where(free, load, 0.0)
    states = 2 * len(model.signals) + int(np.any(falling))
    generator, noise = np.zeros((states, states)), np.zeros((states, states))
    coupling = np.zeros((len(squares), states))
    sines = []
    for number, signal in enumerate(model.signals):
        k = 2 * number
        generator[k, k + 1], generator[k + 1, k] = signal.omega, -signal.omega
        generator[k + 1, k + 1] = -signal.damping_rate
        noise[k + 1, k + 1] = signal.omega**2 * signal.intensity
        coupling[:, k] = shapes.T @ signal.direction
        if signal.amplitude:
            sines.append((k, signal.omega, signal.amplitude))
    if np.any(falling):
        coupling[:, -1] = falling
    directions = [pair.direction for pair in model.pairs]
    damping = shapes.T @ model.damping @ shapes
    return ModalForm(
        shapes=shapes,
        squares=squares,
        damping=damping,
        white=_modal_white(model.white, shapes),
        gaps=np.array(directions).reshape(-1, len(squares)) @ shapes,
        rest=np.divide(load, squares, out=np.zeros_like(load), where=~free),
        signals=generator,
        coupling=coupling,
        signal_noise=noise,
        sines=tuple(sines),
        tables=tuple((table, shapes.T @ direction) for table, direction in model.tables),
        branches=_branches(model.branches, damping, shapes),
    )


def _branches(
    branches: Sequence[Branch], damping: Matrix, shapes: Matrix
) -> RelaxingDamping | None:
    if not branches:
        return None
    return RelaxingDamping(
        damping,
        np.array([each.direction for each in branches]) @ shapes,
        np.array([each.stiffness for each in branches]),
        np.array([each.time for each in branches]),
    )


def _modes(stiffness: Matrix, mass: Matrix) -> tuple[Vector, Matrix]:
    """Squares of the natural frequencies and shapes of unit modal mass; one mass needs no solver of
    eigenvalues, which takes longer to import than all else of its model."""
    if len(mass) == 1:
        root = np.sqrt(mass)
        return stiffness[0] / root[0] ** 2, 1.0 / root
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    return squares, shapes


def _modal_white(white: Matrix, shapes: Matrix) -> Matrix:
    """Phi' S Phi, with zeros for modes that the noise does not reach: rounding errors would give
    these modes correlations above 1."""
    found: Matrix = shapes.T @ white @ shapes
    largest = np.diag(np.abs(shapes).T @ np.abs(white) @ np.abs(shapes))
    still = np.diag(found) <= UNREACHED * largest
    found[still], found[:, still] = 0.0, 0.0
    return found


class LinearLaw(NamedTuple):
    """Stationary distribution of a linear structure.

    `covariance` is that of the states under noise; `waves` are the complex amplitudes of the states
    under each sine; `mean` are the mean modal displacements; `decay` are the eigenvalues of the
    modal damping matrix (1/s); `slowest` is the longest relaxation time of a variance (s).
    """

    covariance: Matrix
    waves: tuple[NDArray[np.complex128], ...]
    mean: Vector
    decay: Vector
    slowest: float

    def variances(self, row: Vector, first: int) -> float:
        """Variance of the sum row . s over the states from `first`, sines included."""
        part = slice(first, first + len(row))
        waves = sum(abs(row @ wave[part]) ** 2 / 2.0 for wave in self.waves)
        return float(row @ self.covariance[part, part] @ row + waves)

    def largest_variance(self, modes: int) -> float:
        """The largest variance of a modal velocity."""
        return max(self.variances(row, modes) for row in np.eye(modes))


ENDS = 1000.0
"""Ends of a band that stands for white noise, relative to the slowest and the fastest frequency."""


def bias_of_stiffness(
    modes: ModalForm, rows: Matrix, sizes: Callable[[Vector], Vector], shaken: Sequence[Force]
) -> float:
    """Relative bias of rms displacements and velocities by errors of dynamic stiffnesses.

    To first order an error dK along g changes x by -(H g) dK (g'q), whatever its phase, so that the
    rms of x is off by at most int abs(x) abs(H g) abs(dK) abs(g'q) S df / int abs(x)^2 S df.

    Parameters
    ----------
    modes
        The structure.
    rows, sizes
        g (springs, n) of the coordinates, and abs(dK), N/m, at frequencies (Hz), (frequencies,
        springs).
    shaken
        Modal forces per unit of white noises and signals.
    """
    squares, along = np.diag(modes.squares), rows @ modes.shapes
    free = np.abs(eigenvalues(squares, modes.dynamic)) / (2.0 * math.pi)
    ends = np.array([float(free[free > 0.0].min()) / ENDS, ENDS * float(free.max())])
    flat = Table(frequency_hz=ends, density=np.ones(2))
    bias = 0.0
    for table, force in [*modes.tables, *((flat, force) for force in shaken)]:
        f, weight = quadrature([(table, force)], squares, modes.dynamic)
        moved = gains(f, squares, modes.dynamic, force)
        steered = np.array([gains(f, squares, modes.dynamic, g) for g in along])
        wrong = np.abs(moved @ along.T) * sizes(f)
        x, by = np.abs(moved @ modes.shapes.T), np.abs(steered @ modes.shapes.T)
        change = np.einsum("fs,sfx->fx", wrong, by)
        for speed in (1.0, (2.0 * math.pi * f) ** 2):
            share = (table(f) * weight * speed)[:, None] * x
            own, off = (share * x).sum(axis=0), (share * change).sum(axis=0)
            found = np.divide(off, own, out=np.zeros_like(own), where=own > 0.0)
            bias = max(bias, float(found.max()))
    return bias


def absolute_accelerations(modes: ModalForm, law: LinearLaw, rows: Matrix) -> Vector:
    """Mean squares (len(rows),) of the absolute accelerations -rows . Phi (omega^2 q + B q') of a
    linear structure that only its base shakes, without constant loads, (m/s^2)^2.

    Parameters
    ----------
    modes, law
        The structure, and its stationary distribution without stops.
    rows
        Combinations (len(rows), n) of the coordinates.
    """
    pulls = rows @ modes.shapes @ modes.pulls(modes.damping)
    return np.array([law.variances(pull, 0) for pull in pulls])


class EquivalentLinear(NamedTuple):
    """Linear substitute for the impacts of a pair: spring (N/m), its centre (m), damper (N s/m)."""

    spring: float
    centre: float
    damper: float


def linear_law(modes: ModalForm, substitutes: Sequence[EquivalentLinear] = ()) -> LinearLaw | None:
    """Exact stationary distribution of a structure whose impact pairs are replaced by springs and
    dampers.

    Without substitutes it is the law of the structure without stops. None where there is no
    stationary distribution.
    """
    gaps = modes.gaps[: len(substitutes)]
    n = modes.size
    springs = np.array([s.spring for s in substitutes])
    dampers = np.array([s.damper for s in substitutes])
    centres = np.array([s.centre for s in substitutes])
    stiffness = np.diag(modes.squares) + (gaps.T * springs) @ gaps
    damping = modes.damping + (gaps.T * dampers) @ gaps
    generator = modes.generator(damping, stiffness)
    fading = modes.fading
    inner = generator[np.ix_(fading, fading)]
    slowest = float(np.min(-np.linalg.eigvals(inner).real))
    fastest = math.sqrt(float(np.linalg.eigvalsh(stiffness)[-1]))
    if slowest <= UNSTABLE * max(fastest, modes.frequency):
        return None
    covariance = np.zeros_like(generator)
    noise = modes.noise(modes.white)[np.ix_(fading, fading)]
    # scaled to units in which every entry is a rate: displacements and signals may have any size
    size = np.ones(len(generator))
    reference = max(fastest, modes.frequency)
    size[:n] = 1.0 / reference
    first = modes.moving
    if modes.branches is not None:
        _, rows, strength, times = modes.branches
        remembered = np.minimum(times, 1.0 / reference)
        size[2 * n : first] = strength * np.linalg.norm(rows, axis=1) * remembered
    pull = np.max(np.abs(modes.coupling), axis=0)
    pairs = len(modes.signals) // 2
    pull[1 : 2 * pairs : 2] = pull[0 : 2 * pairs : 2]  # f' / omega is of the size of f
    size[first:] = np.divide(reference, pull, out=np.ones_like(pull), where=pull > 0.0)
    size = size[fading]
    with warnings.catch_warnings():
        # decay rates of very different size cost digits, but a rough law needs few
        warnings.simplefilter("ignore", RuntimeWarning)
        scaled = stationary_covariance(inner * size / size[:, None], noise / np.outer(size, size))
    covariance[np.ix_(fading, fading)] = scaled * np.outer(size, size)
    if modes.tables:
        relaxing = modes.relaxing(damping)
        covariance[:first, :first] += tabulated_covariance(modes.tables, stiffness, relaxing)
    waves = []
    for number, omega, amplitude in modes.sines:
        wave = np.zeros(len(generator), complex)
        wave[first + number], wave[first + number + 1] = amplitude, 1j * amplitude
        forced = generator[np.ix_(fading, np.arange(len(generator)))] @ wave
        wave[fading] = np.linalg.solve(1j * omega * np.eye(len(fading)) - inner, forced)
        waves.append(wave)
    held = gaps.T @ (springs * (centres - gaps @ modes.rest))
    return LinearLaw(
        covariance=covariance,
        waves=tuple(waves),
        mean=np.linalg.solve(stiffness, held + modes.falling),
        decay=np.linalg.eigvalsh(damping),
        slowest=1.0 / (2.0 * slowest),
    )
