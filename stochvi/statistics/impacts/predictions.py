"""Rates of impacts that linear theory predicts: Rice's, and with clumps (Vanmarcke)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from stochvi.mathematics.moving_means import MovingMean
from stochvi.mathematics.spectra import Table, response_moments, squared_gain
from stochvi.model.coverage import beyond_one_oscillator
from stochvi.model.free_motion import free_motion
from stochvi.model.modal import linear_law
from stochvi.model.model import Model, Pair
from stochvi.results.errors import NotApplicable

CLUMPING = 1.2
"""Power of the bandwidth in E. H. Vanmarcke's rate (J. Appl. Mech. 42 (1975) 215)."""

NODES = 20_001
"""Number of nodes of the integral for the first moment of a spectrum."""


class LinearGap(NamedTuple):
    """Stationary gap of a pair without stops: mean, deviations of it and of its rate; `bandwidth`
    q = (1 - l1^2 / (l0 l2))^(1/2) of its spectrum, None where it is not computed; its noise and
    sines, None without sines."""

    mean: float
    displacement_std: float
    velocity_std: float
    bandwidth: float | None
    motion: MovingMean | None = None


def linear_gap(model: Model, pair: Pair) -> LinearGap | None:
    """None where noise and structure have no Gaussian stationary distribution, or a spring or a
    damper is a function."""
    if model.functions or model.level is not None or model.drawn:
        return None
    if model.sines:
        return _beside_sines(model, pair)
    if not model.tables:
        modes = replace(model, pairs=(pair,)).modal
        law = linear_law(modes)
        if law is None:
            return None
        gap, n = modes.gaps[0], modes.size
        x, v = (math.sqrt(law.variances(gap, first)) for first in (0, n))
        mean = float(gap @ (modes.rest + law.mean))
        single = len(model.coordinates) == 1 and not model.signals
        return LinearGap(mean, x, v, _white_bandwidth(model) if single else None)
    if model.signals or beyond_one_oscillator(model):
        return None
    omega, b = model.omega, model.damping_rate
    if omega == 0.0 or b == 0.0:
        return None
    tables = model.acceleration_tables
    moments, theta = response_moments(tables, omega, b), model.intensity / (2.0 * b)
    x2, v2 = moments.displacement + theta / omega**2, moments.velocity + theta
    bandwidth = None
    if theta == 0.0:
        first = sum(_first_moment(table, omega, b) for table in tables)
        bandwidth = math.sqrt(max(1.0 - first**2 / (x2 * v2), 0.0))
    return LinearGap(model.rest, math.sqrt(x2), math.sqrt(v2), bandwidth)


def _beside_sines(model: Model, pair: Pair) -> LinearGap | None:
    try:
        free = free_motion(model, with_sines=True)
    except NotApplicable:
        return None
    (motion,) = free.moving_means(pair.direction[None])
    if not motion.place:
        return None
    mean = float(pair.direction @ model.modal.shapes @ model.modal.rest)
    return LinearGap(mean, *motion.deviations, None, motion)


def _white_bandwidth(model: Model) -> float | None:
    """q of an oscillator under white noise, in closed form below critical damping."""
    zeta = model.damping_rate / (2.0 * model.omega) if model.omega else math.inf
    if not 0.0 < zeta < 1.0:
        return None
    root = math.sqrt(1.0 - zeta**2)
    shape = (1.0 - 2.0 / math.pi * math.atan(zeta / root)) / root
    return math.sqrt(1.0 - shape**2)


def _first_moment(table: Table, omega: float, damping_rate: float) -> float:
    """Integral of w |H|^2 G df over a table."""
    low, high = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
    f = np.geomspace(low, high, NODES)
    density = 2.0 * np.pi * f * squared_gain(f, omega, damping_rate) * table(f)
    return float(np.trapezoid(density, f))


def rice_rates(gap: LinearGap, pair: Pair) -> dict[str, float]:
    """Rice's rate of crossings of each stop, 1/s, as if impacts changed nothing, and their sum
    under "both"."""
    motion = gap.motion or MovingMean.still(gap.displacement_std, gap.velocity_std)
    found = {stop.name: motion.rate(stop.side * (stop.position - gap.mean)) for stop in pair.stops}
    return found | {"both": sum(found.values())}


def vanmarcke_rate(gap: LinearGap, pair: Pair) -> float | None:
    """Rate of clumps of crossings, 1/s, of one stop or of two evenly about the mean.

    nu [1 - exp(-(pi / 2)^(1/2) q^1.2 r)] / [1 - exp(-r^2 / 2)] at r deviations for |x|, nu Rice's
    rate of both; for one stop (2 pi)^(1/2) stands for (pi / 2)^(1/2) and the share of time within
    it for the denominator (Vanmarcke 1975).

    >>> from stochvi.model.model import Stop
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> gap = LinearGap(0.0, 1.0, 1.0, 0.2456120698613)
    >>> stops = [Stop(side, 2.0 * side, Restitution(coefficient=1.0)) for side in (-1, 1)]
    >>> two = Pair("", np.ones(1), 1.0, False, tuple(stops))
    >>> round(vanmarcke_rate(gap, two) / rice_rates(gap, two)["both"], 4)
    0.43
    """
    if gap.bandwidth is None:
        return None
    positions = [stop.position - gap.mean for stop in pair.stops]
    levels = [abs(position) / gap.displacement_std for position in positions]
    width, nu = gap.bandwidth**CLUMPING, rice_rates(gap, pair)["both"]
    if len(levels) == 1:
        if positions[0] * pair.stops[0].side <= 0.0:  # the stop lies beyond the mean position
            return None
        share = -math.expm1(-math.sqrt(2.0 * math.pi) * width * levels[0])
        return nu * share / float(ndtr(levels[0]))
    if abs(levels[0] - levels[1]) > 1e-9 * max(levels) or positions[0] * positions[1] >= 0.0:
        return None
    share = -math.expm1(-math.sqrt(math.pi / 2.0) * width * levels[0])
    return nu * share / -math.expm1(-0.5 * levels[0] ** 2)
