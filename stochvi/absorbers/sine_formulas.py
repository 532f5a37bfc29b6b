"""A loose mass under a sine: the force that it cancels, the residual vibration, exact regimes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stochvi.methods.periodic.even import even_regimes
from stochvi.methods.periodic.family import Numbers
from stochvi.model.calculations import calculation

UPPER_LOWER = (0, 1)
"""Numbers of the stops that are hit in a period, in their order: the upper one, then the lower
one."""

LAWS = {"book": 4.0 / math.pi, "flight": 8.0 / math.pi**2}
"""First harmonic of the relative motion over half the play: of a square wave, as the harmonic
linearisation by force has it (B 7.85, 17.17), and of straight flights from stop to stop."""


@dataclass(frozen=True, kw_only=True)
class SymmetricRegime:
    """One impact on each stop per period, half a period apart (SI units).

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
        Phase of the force at the impact on the upper stop, where it is a cos(phase), rad.
    stable
        Whether small perturbations die out.

    See Also
    --------
    stochvi.absorbers.symmetric_regimes : What finds it.
    """

    absorber_speed: float
    impact_speed: float
    amplitude: float
    amplitude_without: float
    phase: float
    stable: bool


@calculation
def tuned_force(mass: float, play: float, omega: float, law: str = "flight") -> float:
    """Amplitude of the sine force (N) whose first harmonic an elastic loose mass cancels.

    The absorber is tuned where its partial frequency is that of the excitation, k(a_F) = M2 w^2
    (B 17.11); with k = a_F / a_x and the structure at rest a_F = a_p, so that a_p = M2 w^2 a_x.

    Parameters
    ----------
    mass, play, omega
        M2 in kg; 2 Delta, stop to stop, in m; w in rad/s.
    law
        "flight": a_x = 8 Delta / pi^2, of straight flights. "book": a_x = 4 Delta / pi (B 17.17).

    Returns
    -------
    float
        Amplitude of the force, N.

    Raises
    ------
    ValueError
        If a number is not positive, or there is no such law.

    See Also
    --------
    stochvi.absorbers.residual_vibration : The residual vibration.
    stochvi.absorbers.symmetric_regimes : The exact regimes.

    Examples
    --------
    >>> round(tuned_force(0.1, 2.0, 1.0), 5), round(tuned_force(0.1, 2.0, 1.0, "book"), 5)
    (0.08106, 0.12732)
    """
    _check_positive(mass=mass, omega=omega)
    return mass * omega**2 * _relative_amplitude(play, law)


@calculation
def residual_vibration(play: float, restitution: float, law: str = "flight") -> float:
    """Amplitude (m) of a structure in resonance under `tuned_force`, with a light loose mass.

    As printed, a_x1 = beta a_x / (M2 w) (B 17.12), with beta = p M2 w and p = (1 - R^2) / pi for
    two stops (B 7.62): a_x1 = p a_x (B 17.13). In straight flights of speed u = 2 w Delta / pi the
    stop must return the lost speed. It moves at u (1 - R) / (1 + R) against the mass: a_x1 = (2
    Delta / pi) (1 - R) / (1 + R).

    Parameters
    ----------
    play
        2 Delta, stop to stop, m.
    restitution
        R of both stops; at 1 nothing is left.
    law
        "flight" or "book", as for `tuned_force`.

    Returns
    -------
    float
        Amplitude of the displacement, m.

    Raises
    ------
    ValueError
        If play is not positive, restitution not in [0, 1], or there is no such law.

    See Also
    --------
    stochvi.absorbers.tuned_force : The force that is cancelled.
    stochvi.absorbers.symmetric_regimes : The exact regimes.

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


@calculation
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
    """The exact regimes with one impact on each stop per period of a sine force on the structure.

    They are the regimes of `harmonic_response` that have these impacts. None is missed, since the
    distance at an impact is a sine of the phase. Where none is stable, the absorber works in
    clusters, or idles.

    Parameters
    ----------
    mass, damping, stiffness
        Mass, damping and stiffness of the structure, kg, N s/m and N/m.
    absorber_mass, play, restitution
        Loose mass, kg; play of its box, m from stop to stop; restitution of both stops.
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

    See Also
    --------
    stochvi.harmonic_response : All regimes, of any structure.
    stochvi.absorbers.tuned_force : The force that is cancelled.

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
    roots = np.sqrt([mass, absorber_mass])
    numbers = Numbers(
        stiffness=np.diag([stiffness / mass, 0.0]),
        damping=np.diag([damping / mass, 0.0]),
        forces=np.array([[force / roots[0], 0.0, 0.0], [0.0, 0.0, 0.0]]),
        rows=np.outer([1.0, -1.0], np.array([-1.0, 1.0]) / roots),
        distances=np.full(2, play / 2.0),
        restitutions=np.full(2, restitution),
        omega=omega,
        output=np.array([1.0 / roots[0], 0.0]),
        base=np.zeros(3),
        shapes=np.diag(1.0 / roots),
    )
    without = force / abs(complex(stiffness - mass * omega**2, damping * omega))
    return [
        SymmetricRegime(
            absorber_speed=float(each.velocity[1]),
            impact_speed=float(each.impact_speed[0]),
            amplitude=each.amplitude,
            amplitude_without=without,
            phase=math.remainder(float(each.phase[0]), 2.0 * math.pi),
            stable=each.multiplier < 1.0,
        )
        for each in even_regimes(numbers, UPPER_LOWER)
        if each.admissible
    ]


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
