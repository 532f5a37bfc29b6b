"""A structure in modal coordinates, and a rough stationary law of it for steps and starts."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from stochvi.assemblies import Assembly, Contact
from stochvi.collisions import gaussian_stop
from stochvi.cut_normal import CutNormal
from stochvi.errors import NotApplicable
from stochvi.state_space import stationary_covariance

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

RIGID_BODY = 1e-13
"""Eigenvalue, relative to the largest, that is taken for 0."""

UNSTABLE = 1e-8
"""Decay rate, relative to the fastest frequency, below which there is no stationary law."""

UNSHAKEN = 1e-24
"""Share of the largest modal velocity variance below which that of a gap is rounding."""

ITERATIONS = 40
"""Of the search for springs and dampers in the place of impacts: a few digits are enough."""


class Modes(NamedTuple):
    """M q'' + C q' + K q = forces in modal coordinates, displacements = Phi q with Phi' M Phi = 1.

    The state of a path is s = (q - rest, q', signals); each signal has the states f and f'/omega.

    Parameters
    ----------
    shapes, squares
        Phi (n, n) and omega^2 (n,).
    damping, white
        Phi' C Phi and Phi' S Phi (n, n).
    gaps
        Rows phi (pairs, n): the gap of a pair is y = phi . q.
    rest
        Modal displacements (n,) under the loads where nothing hits. A load on a mode without
        stiffness has none: it is a last signal, of one state that stays 1.
    signals, coupling, signal_noise
        Generator (m, m) of the signals, modal forces per unit of them (n, m), and the intensity
        matrix (m, m) of the white noise that drives them.
    sines
        (first state, omega, amplitude) of the signals that are sines.
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

    @property
    def size(self) -> int:
        """Number of modes, n."""
        return len(self.squares)

    @property
    def kicked(self) -> bool:
        """Whether there is white noise, together with which the damping is kicked."""
        return bool(np.any(self.white))

    @property
    def falling(self) -> Vector:
        """Constant modal forces on modes without stiffness (n,)."""
        return self.coupling[:, -1] if len(self.signals) % 2 else np.zeros(self.size)

    @property
    def fastest(self) -> float:
        """Largest frequency of a mode or a signal, rad/s."""
        rates = [math.sqrt(float(np.max(self.squares))), *np.abs(np.linalg.eigvals(self.signals))]
        return float(max(rates))

    @property
    def fading(self) -> NDArray[np.int64]:
        """States that forget their start: all but those of sines and of what is constant."""
        kept = np.ones(len(self.signals), bool)
        for first, _, _ in self.sines:
            kept[first : first + 2] = False
        if len(self.signals) % 2:
            kept[-1] = False
        return np.concatenate([np.arange(2 * self.size), 2 * self.size + np.flatnonzero(kept)])

    def generator(self, damping: Matrix, stiffness: Matrix) -> Matrix:
        """A of s' = A s + noise with these modal matrices."""
        n, m = self.size, len(self.signals)
        a = np.zeros((2 * n + m, 2 * n + m))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n] = np.hstack([-stiffness, -damping, self.coupling])
        a[2 * n :, 2 * n :] = self.signals
        return a

    @property
    def flow(self) -> Matrix:
        """A between impacts, without what is kicked."""
        damping = np.zeros_like(self.damping) if self.kicked else self.damping
        return self.generator(damping, np.diag(self.squares))

    def noise(self, white: Matrix) -> Matrix:
        """Intensity matrix of all white noise on the states, with `white` on the modes."""
        n, m = self.size, len(self.signals)
        intensity = np.zeros((2 * n + m, 2 * n + m))
        intensity[n : 2 * n, n : 2 * n] = white
        intensity[2 * n :, 2 * n :] = self.signal_noise
        return intensity


def modes_of(assembly: Assembly) -> Modes:
    """Modal coordinates of an assembly, and its signals as states."""
    squares, shapes = eigh(assembly.stiffness, assembly.mass)
    squares = np.where(squares > RIGID_BODY * max(float(squares[-1]), 0.0), squares, 0.0)
    load = shapes.T @ assembly.load
    free = squares == 0.0
    falling = np.where(free, load, 0.0)
    states = 2 * len(assembly.signals) + int(np.any(falling))
    generator, noise = np.zeros((states, states)), np.zeros((states, states))
    coupling = np.zeros((len(squares), states))
    sines = []
    for number, signal in enumerate(assembly.signals):
        k = 2 * number
        generator[k, k + 1], generator[k + 1, k] = signal.omega, -signal.omega
        generator[k + 1, k + 1] = -signal.damping_rate
        noise[k + 1, k + 1] = signal.omega**2 * signal.intensity
        coupling[:, k] = shapes.T @ signal.direction
        if signal.amplitude:
            sines.append((k, signal.omega, signal.amplitude))
    if np.any(falling):
        coupling[:, -1] = falling
    directions = [contact.direction for contact in assembly.contacts]
    return Modes(
        shapes=shapes,
        squares=squares,
        damping=shapes.T @ assembly.damping @ shapes,
        white=shapes.T @ assembly.white @ shapes,
        gaps=np.array(directions).reshape(-1, len(squares)) @ shapes,
        rest=np.divide(load, squares, out=np.zeros_like(load), where=~free),
        signals=generator,
        coupling=coupling,
        signal_noise=noise,
        sines=tuple(sines),
    )


class LinearLaw(NamedTuple):
    """Stationary law of a linear structure: `covariance` of the states from noise; `waves`, the
    complex amplitudes of the states under each sine; `mean` of the modal displacements; `decay`,
    rates of the damping by mode; `slowest` relaxation of a variance, s."""

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
        """Of the modal velocities."""
        return max(self.variances(row, modes) for row in np.eye(modes))


class PairScale(NamedTuple):
    """Of an impact pair: rms speed, and the acceleration that presses it onto a stop or 0."""

    speed: float
    pressing: float


class _Substitute(NamedTuple):
    """What stands for the impacts of a pair: spring N/m, its centre m, damper N s/m."""

    spring: float
    centre: float
    damper: float


def scales_of(assembly: Assembly, modes: Modes) -> tuple[LinearLaw, tuple[PairScale, ...]] | None:
    """A linear law close to the stationary one; None where it finds none.

    Every pair is replaced by a spring, which brings mean and variance of the gap to those of a
    normal law cut at the stops, and a damper, which takes the power that restitution takes at
    Rayleigh impact speeds; found by repetition.
    """
    substitutes = [_first_guess(modes, contact) for contact in assembly.contacts]
    scales: tuple[PairScale, ...] = ()
    law = following = _linear_law(modes, substitutes)
    for _ in range(ITERATIONS if assembly.contacts else 0):
        if following is None:  # a gap too wide for a spring to stand for: the last one will do
            break
        law = following
        found = [
            _substitute(
                modes, law, contact, modes.gaps[j], old, _without_own_spring(modes, substitutes, j)
            )
            for j, (contact, old) in enumerate(zip(assembly.contacts, substitutes, strict=True))
        ]
        if None in found:
            return None
        substitutes = [each[0] for each in found if each]
        scales = tuple(each[1] for each in found if each)
        following = _linear_law(modes, substitutes)
    return None if law is None else (law, scales)


def _first_guess(modes: Modes, contact: Contact) -> _Substitute:
    frequency = modes.fastest
    if frequency == 0.0:
        # no time but that in which noise brings the mass across the gap
        noise = float(np.trace(modes.white)) / contact.mass
        stops = [stop for _, stop, _ in contact.stops]
        width = max(stops) - min(stops) or abs(stops[0]) or 1.0
        frequency = (noise / width**2) ** (1.0 / 3.0)
    loss = max((1.0 - law.restitution**2 for _, _, law in contact.stops), default=0.0)
    stops = [stop for _, stop, _ in contact.stops]
    return _Substitute(
        spring=contact.mass * frequency**2,
        centre=sum(stops) / len(stops),
        damper=loss * contact.mass * frequency,
    )


def _linear_law(modes: Modes, substitutes: list[_Substitute]) -> LinearLaw | None:
    n = modes.size
    springs = np.array([s.spring for s in substitutes])
    dampers = np.array([s.damper for s in substitutes])
    centres = np.array([s.centre for s in substitutes])
    stiffness = np.diag(modes.squares) + (modes.gaps.T * springs) @ modes.gaps
    damping = modes.damping + (modes.gaps.T * dampers) @ modes.gaps
    generator = modes.generator(damping, stiffness)
    fading = modes.fading
    inner = generator[np.ix_(fading, fading)]
    slowest = float(np.min(-np.linalg.eigvals(inner).real))
    fastest = math.sqrt(float(np.linalg.eigvalsh(stiffness)[-1]))
    if slowest <= UNSTABLE * max(fastest, modes.fastest):
        return None
    covariance = np.zeros_like(generator)
    noise = modes.noise(modes.white)[np.ix_(fading, fading)]
    # in units in which every entry is a rate: displacements and signals may be of any size
    size = np.ones(len(generator))
    reference = max(fastest, modes.fastest)
    size[:n] = 1.0 / reference
    pull = np.max(np.abs(modes.coupling), axis=0)
    pairs = len(modes.signals) // 2
    pull[1 : 2 * pairs : 2] = pull[0 : 2 * pairs : 2]  # f' / omega is of the size of f
    size[2 * n :] = np.divide(reference, pull, out=np.ones_like(pull), where=pull > 0.0)
    size = size[fading]
    with warnings.catch_warnings():
        # decays far apart cost digits, of which a rough law needs few
        warnings.simplefilter("ignore", RuntimeWarning)
        scaled = stationary_covariance(inner * size / size[:, None], noise / np.outer(size, size))
    covariance[np.ix_(fading, fading)] = scaled * np.outer(size, size)
    waves = []
    for first, omega, amplitude in modes.sines:
        wave = np.zeros(len(generator), complex)
        wave[2 * n + first], wave[2 * n + first + 1] = amplitude, 1j * amplitude
        forced = generator[np.ix_(fading, np.arange(len(generator)))] @ wave
        wave[fading] = np.linalg.solve(1j * omega * np.eye(len(fading)) - inner, forced)
        waves.append(wave)
    held = modes.gaps.T @ (springs * (centres - modes.gaps @ modes.rest))
    return LinearLaw(
        covariance=covariance,
        waves=tuple(waves),
        mean=np.linalg.solve(stiffness, held + modes.falling),
        decay=np.linalg.eigvalsh(damping),
        slowest=1.0 / (2.0 * slowest),
    )


def _without_own_spring(
    modes: Modes, substitutes: Sequence[_Substitute], j: int
) -> tuple[float, float]:
    """Stiffness k and force f of a gap without the spring of its own stops: k y - f pulls it back.

    The static ones: with noise that matches the damping, the law of y is the Gibbs law of them.
    """
    gap, soft = modes.gaps[j], SOFTEST * substitutes[j].spring  # where nothing else holds the gap
    stiffness = np.diag(modes.squares) + soft * np.outer(gap, gap)
    forces = modes.falling.copy()
    for other, substitute in enumerate(substitutes):
        if other != j:
            row = modes.gaps[other]
            stiffness += substitute.spring * np.outer(row, row)
            forces += substitute.spring * (substitute.centre - row @ modes.rest) * row
    compliance = float(gap @ np.linalg.solve(stiffness, gap))
    mean = float(gap @ (modes.rest + np.linalg.solve(stiffness, forces)))
    return max(1.0 / compliance - soft, 0.0), mean / compliance


def _substitute(
    modes: Modes,
    law: LinearLaw,
    contact: Contact,
    gap: Vector,
    old: _Substitute,
    held: tuple[float, float],
) -> tuple[_Substitute, PairScale] | None:
    """The next spring and damper: what the gap's law would be without the old spring, cut; None
    where nothing holds the gap on a side without a stop."""
    square = law.variances(gap, modes.size)
    if not square > UNSHAKEN * law.largest_variance(modes.size):
        raise NotApplicable(
            "simulate", [f"no excitation reaches the impact pair {contact.name!r}: it is at rest"]
        )
    energy = contact.mass * square
    own, slope = held[0], held[1] / energy
    try:
        cut = CutNormal(
            slope=slope, curvature=own / energy, lower=contact.lower, upper=contact.upper
        )
    except ValueError:
        return None
    needed = energy / cut.variance
    spring = max(needed - own, SOFTEST * needed)
    power = sum(
        (1.0 - restitution.restitution**2)
        / 2.0
        * contact.mass
        * gaussian_stop(cut.density_at(stop), square).speed_square_rate
        for _, stop, restitution in contact.stops
    )
    pressing = max(
        (1.0 if side == "upper" else -1.0) * square * (slope - own / energy * stop)
        for side, stop, _ in contact.stops
    )
    mixed = _Substitute(
        spring=math.sqrt(old.spring * spring),
        centre=(needed * cut.mean - slope * energy) / spring,
        damper=0.5 * (old.damper + power / square),
    )
    leans = pressing * math.sqrt(cut.variance) > LEANING * square
    return mixed, PairScale(speed=math.sqrt(square), pressing=pressing if leans else 0.0)


LEANING = 0.5
"""Share of the energy of a pair that pressing turns over within the spread of its gap from which
it is said to lean on a stop; for a mass that lies on it the share is 1."""


SOFTEST = 1e-6
"""Spring for the stops of a gap that hardly feels them, relative to one that does."""
