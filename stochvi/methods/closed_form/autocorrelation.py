"""Exact autocorrelations of the displacement: the two that are known."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import zeta

from stochvi.mathematics.arrays import Vector
from stochvi.methods.closed_form.method import unmet
from stochvi.model.calculations import calculation
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NoExactSolution
from stochvi.scenes.scene import Scene

MOST_TERMS = 2000
"""Number of terms of the series for a box. The rest is bounded, and at most 1e-11 of the
variance."""


@calculation
def autocorrelation(scene: Scene, lag: ArrayLike) -> Vector:
    """Stationary autocovariance of the displacement, E (x(t) - m)(x(t + lag) - m), m^2.

    Without stops, under white noise, with w^2 = omega^2 - b^2 / 4,

        R = (theta / omega^2) e^(-b t / 2) (cos w t + (b / 2 w) sin w t),  t = |lag|,

    hyperbolic functions where damping is above critical. A mass without a spring between two
    elastic rigid stops, a distance 2 D apart, is the mirror image of a free one. The displacement
    of the free mass over a time t has the variance s2 = 2 (theta / b^2)(b t - 1 + e^(-b t)). The
    Fourier series of the mirror gives

        R = (32 D^2 / pi^4) sum over odd k of k^-4 exp(-(k pi / 2 D)^2 s2 / 2).

    Parameters
    ----------
    scene
        The scene.
    lag
        Times, s, of either sign.

    Returns
    -------
    Vector
        One value for each place or time, SI units.

    Raises
    ------
    NoExactSolution
        For any other scene, with what is unmet.

    See Also
    --------
    stochvi.exact : The averages of the same scene.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> box = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=0.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> autocorrelation(box, [0.0, 1.0]).round(9).tolist()
    [0.333333333, 0.099582601]
    """
    model = model_of(scene)
    conditions = unmet(model) or beyond_one_oscillator(model) or _neither(model)
    if conditions:
        raise NoExactSolution(conditions)
    time = np.abs(np.asarray(lag, dtype=float))
    theta = model.intensity / (2.0 * model.damping_rate)
    if model.lower is None or model.upper is None:
        return _linear(model, theta, time)
    width = model.upper.position - model.lower.position
    return _box(width / 2.0, theta, model.damping_rate, time)


def _neither(model: Model) -> list[str]:
    """Why the scene is neither a linear oscillator nor a box; empty if it is one."""
    if model.tables:
        return ["excitation must be white noise for an autocorrelation, got a tabulated density"]
    if not model.stops:
        return []
    box = len(model.stops) == 2 and model.rigid
    if model.omega == 0.0 and model.load == 0.0 and box:
        return []
    return [
        "an autocorrelation is known without stops, or between two rigid stops without a spring "
        "and a load"
    ]


def _linear(model: Model, theta: float, time: Vector) -> Vector:
    omega, half = model.omega, model.damping_rate / 2.0
    # complex where damping is above critical; the limit sin(w t) / w = t where it is critical
    own = np.emath.sqrt(omega**2 - half**2)
    if np.iscomplexobj(own):
        rate = float(own.imag)
        # both exponentials decay: written so that neither overflows
        slow, fast = np.exp((rate - half) * time), np.exp(-(rate + half) * time)
        shape = (slow + fast) / 2.0 + half / rate * (slow - fast) / 2.0
    else:
        swing = half * time * np.sinc(own * time / math.pi)
        shape = np.exp(-half * time) * (np.cos(own * time) + swing)
    return np.asarray(theta / omega**2 * shape)


def _box(half_width: float, theta: float, b: float, time: Vector) -> Vector:
    spread = 2.0 * theta / b**2 * (b * time + np.expm1(-b * time))
    k = 2.0 * np.arange(MOST_TERMS) + 1.0
    decay = (math.pi / (2.0 * half_width)) ** 2 * spread / 2.0
    with np.errstate(under="ignore"):
        terms = np.exp(-(k**2) * decay[..., None]) @ k**-4
        # the terms left out lie between 0 and this; their middle has half the error
        rest = zeta(4.0, MOST_TERMS + 0.5) / 16.0 * np.exp(-((k[-1] + 2.0) ** 2) * decay)
    return np.asarray(32.0 * half_width**2 / math.pi**4 * (terms + rest / 2.0))
