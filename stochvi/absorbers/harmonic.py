"""A loose mass under a sine: the force that it cancels, the residual vibration, exact regimes."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.state_space import transition

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

ADMISSIBLE_SAMPLES = 720
"""Number of instants of half a period at which the mass must lie inside its box."""

LAWS = {"book": 4.0 / math.pi, "flight": 8.0 / math.pi**2}
"""First harmonic of the relative motion over half the play: of a square wave, as the harmonic
linearisation by force has it (B 7.85, 17.17), and of straight flights from wall to wall."""


@dataclass(frozen=True, kw_only=True)
class SymmetricRegime:
    """One impact on each wall per period, half a period apart (SI units).

    Parameters
    ----------
    absorber_speed
        Speed of the loose mass between impacts, m/s.
    impact_speed
        Relative speed before an impact, m/s.
    amplitude
        Amplitude of the first harmonic of the structure's displacement, m.
    amplitude_without
        The same without the absorber, m.
    phase
        Phase of the force at the impact on the upper wall, where it is a cos(phase), rad.
    stable
        Whether small disturbances die out.
    """

    absorber_speed: float
    impact_speed: float
    amplitude: float
    amplitude_without: float
    phase: float
    stable: bool


def tuned_force(mass: float, play: float, omega: float, law: str = "flight") -> float:
    """Amplitude of the sine force (N) whose first harmonic a mass that loses nothing cancels.

    The absorber is tuned where its partial frequency is that of the excitation, k(a_F) = M2 w^2
    (B 17.11); with k = a_F / a_x and the structure at rest a_F = a_p, so that a_p = M2 w^2 a_x.

    Parameters
    ----------
    mass, play, omega
        M2 in kg; 2 Delta, wall to wall, in m; w in rad/s.
    law
        "flight": a_x = 8 Delta / pi^2, of straight flights. "book": a_x = 4 Delta / pi (B 17.17).

    Returns
    -------
    float
        The number, SI units.

    Raises
    ------
    ValueError
        If a number is not positive, or there is no such law.

    Examples
    --------
    >>> round(tuned_force(0.1, 2.0, 1.0), 5), round(tuned_force(0.1, 2.0, 1.0, "book"), 5)
    (0.08106, 0.12732)
    """
    _check_positive(mass=mass, omega=omega)
    return mass * omega**2 * _relative_amplitude(play, law)


def residual_vibration(play: float, restitution: float, law: str = "flight") -> float:
    """Amplitude (m) that `tuned_force` leaves of a structure in resonance, with a light loose mass.

    As printed, a_x1 = beta a_x / (M2 w) (B 17.12), with beta = p M2 w and p = (1 - R^2) / pi for
    two walls (B 7.62): a_x1 = p a_x (B 17.13). In straight flights of speed u = 2 w Delta / pi the
    wall must return what is lost, with a speed u (1 - R) / (1 + R) against the mass, so that
    a_x1 = (2 Delta / pi) (1 - R) / (1 + R).

    Parameters
    ----------
    play
        2 Delta, wall to wall, m.
    restitution
        R of both walls; at 1 nothing is left.
    law
        "flight" or "book", as for `tuned_force`.

    Returns
    -------
    float
        The number, SI units.

    Raises
    ------
    ValueError
        If play is not positive, restitution not in [0, 1], or there is no such law.

    Examples
    --------
    >>> round(residual_vibration(2.0, 0.8), 5), round(residual_vibration(2.0, 0.8, "book"), 5)
    (0.07074, 0.1459)
    """
    _check_restitution(restitution)
    amplitude = _relative_amplitude(play, law)
    if law == "book":
        return (1.0 - restitution**2) / math.pi * amplitude
    return play / math.pi * (1.0 - restitution) / (1.0 + restitution)


def symmetric_regimes(
    *,
    mass: float,
    damping: float,
    stiffness: float,
    absorber_mass: float,
    play: float,
    restitution: float,
    force: float,
    omega: float,
) -> list[SymmetricRegime]:
    """The exact regimes with one impact on each wall per period of a sine force on the structure.

    Between impacts m x1'' + c x1' + k x1 = a cos(w t + phi) and x2' = u or -u. With j = 2 u m2 / m
    the jump of x1' at an impact, F the transition over half a period and (P, Q)' = -(I + F)^-1 F
    (0, 1)', motion that turns its sign every half period has before the upper impact

        x1 = Re A + P j,  x1' = -w Im A + Q j,  A = a e^(i phi) / (k - m w^2 + i c w),

    which must be x1 = pi u / (2 w) - play / 2 and x1' = u - (2 u + j) / (1 + R): a quadratic
    equation for u. Roots at which the mass would pass a wall in between are left out. A regime is
    stable where all eigenvalues of its map from impact to impact lie inside the unit circle; where
    none is, the absorber works in bursts.

    Parameters
    ----------
    mass, damping, stiffness
        Mass, damping and stiffness of the structure, kg, N s/m and N/m.
    absorber_mass, play, restitution
        Loose mass, kg; play of its box, m from wall to wall; restitution of both walls.
    force, omega
        Amplitude a (N) and w (rad/s) of the sine.

    Returns
    -------
    list of SymmetricRegime
        None, one, or two, the fastest first.

    Raises
    ------
    ValueError
        If a number is not positive, or restitution not in [0, 1].

    Examples
    --------
    Resonance of a structure of Q = 50, with 5 % of its mass loose:

    >>> (found, *_) = symmetric_regimes(
    ...     mass=1.0, damping=0.02, stiffness=1.0, absorber_mass=0.05, play=2.0, restitution=0.8,
    ...     force=0.04, omega=1.0,
    ... )
    >>> found.amplitude < 0.1 * found.amplitude_without
    True
    """
    _check_positive(
        mass=mass, damping=damping, stiffness=stiffness, absorber_mass=absorber_mass, play=play,
        force=force, omega=omega,
    )  # fmt: skip
    _check_restitution(restitution)
    generator = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    half = transition(generator, math.pi / omega)
    before = -np.linalg.solve(np.eye(2) + half, half @ [0.0, 1.0])
    share = absorber_mass / mass
    receptance = 1.0 / complex(stiffness - mass * omega**2, damping * omega)
    # Re A = u along - play / 2 and -w Im A = u across
    along = math.pi / (2.0 * omega) - 2.0 * share * before[0]
    across = 1.0 - 2.0 * (1.0 + share) / (1.0 + restitution) - 2.0 * share * before[1]
    roots = np.roots(
        [
            along**2 + (across / omega) ** 2,
            -along * play,
            play**2 / 4.0 - force**2 * abs(receptance) ** 2,
        ]
    )
    speeds = sorted((float(u.real) for u in roots if u.imag == 0.0 and u.real > 0.0), reverse=True)
    motion = _Motion.of(generator, share, omega, mass)
    found = []
    for speed in speeds:
        wave = complex(speed * along - play / 2.0, -speed * across / omega)
        push = 4.0 * absorber_mass * speed * omega / math.pi
        impact_speed = 2.0 * speed * (1.0 + share) / (1.0 + restitution)
        phase = cmath.phase(wave / receptance)
        at = speed * math.pi / (2.0 * omega)
        state = np.array(
            [at - play / 2.0, speed - impact_speed, at, speed, force * math.cos(phase),
             force * math.sin(phase)]
        )  # fmt: skip
        reset = motion.reset(restitution)
        if motion.stays_inside(reset @ state, play / 2.0):
            found.append(
                SymmetricRegime(
                    absorber_speed=speed,
                    impact_speed=impact_speed,
                    amplitude=abs(wave + receptance * push),
                    amplitude_without=force * abs(receptance),
                    phase=phase,
                    stable=motion.forgets(state, reset),
                )
            )
    return found


@dataclass(frozen=True)
class _Motion:
    """Free motion of (x1, x1', x2, x2', a cos, a sin): generator, mass share m2 / m, rad/s."""

    generator: Matrix
    share: float
    omega: float

    @classmethod
    def of(cls, structure: Matrix, share: float, omega: float, mass: float) -> _Motion:
        generator = np.zeros((6, 6))
        generator[:2, :2] = structure
        generator[1, 4] = 1.0 / mass
        generator[2, 3] = 1.0
        generator[4, 5], generator[5, 4] = -omega, omega
        return cls(generator, share, omega)

    def reset(self, restitution: float) -> Matrix:
        """The matrix that takes the velocities before an impact to those after it."""
        found = np.eye(6)
        exchange = (1.0 + restitution) / (1.0 + self.share)
        found[3, [1, 3]] += exchange, -exchange
        found[1, [1, 3]] += -self.share * exchange, self.share * exchange
        return found

    def stays_inside(self, after: Vector, half_play: float) -> bool:
        """Whether x2 - x1 keeps within the box on its way to the lower wall."""
        onwards = transition(self.generator, math.pi / self.omega / ADMISSIBLE_SAMPLES)
        for _ in range(1, ADMISSIBLE_SAMPLES):
            after = onwards @ after
            if not abs(after[2] - after[0]) <= half_play:
                return False
        return True

    def forgets(self, before: Vector, reset: Matrix) -> bool:
        """Whether disturbances of (x1, x1', x2', phase) at an impact shrink to the next one."""
        wall = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        # half a period later the state is its own negative
        rate = -self.generator @ before
        late = np.eye(6) - np.outer(rate, wall) / (wall @ rate)
        cosine, sine = before[4:]
        disturbed = np.zeros((6, 4))
        disturbed[[0, 2, 1, 3], [0, 0, 1, 2]] = 1.0
        disturbed[4:, 3] = -sine, cosine
        read = np.zeros((4, 6))
        read[[0, 1, 2], [0, 1, 3]] = 1.0
        read[3, 4:] = np.array([-sine, cosine]) / (cosine**2 + sine**2)
        half = transition(self.generator, math.pi / self.omega)
        multipliers = np.linalg.eigvals(read @ late @ half @ reset @ disturbed)
        return bool(np.max(np.abs(multipliers)) < 1.0)


def _relative_amplitude(play: float, law: str) -> float:
    _check_positive(play=play)
    if law not in LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}, got {law!r}")
    return LAWS[law] * play / 2.0


def _check_positive(**numbers: float) -> None:
    for name, number in numbers.items():
        if not 0.0 < number < math.inf:
            raise ValueError(f"{name} must be a positive number, got {number}")


def _check_restitution(restitution: float) -> None:
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must be in [0, 1], got {restitution}")
