"""Many scenes at once as dimensionless boxes with a stop, or an elastic wall, at either end."""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.quadrature import gauss_panels
from stochvi.methods.fokker_planck.linear_box import Boxes, LinearBox
from stochvi.methods.fokker_planck.mesh import Array
from stochvi.model.oscillator_arrays import OscillatorArrays

LAW_REACH = 6.0
"""The law exp(-energy / s^2) is cut at the energy LAW_REACH^2 / 2 in units of s^2, where it is
2e-8 of its peak."""

FARTHEST_STOP = 7.0
"""A stop at a higher energy than FARTHEST_STOP^2 / 2, in units of s^2, counts as out of reach."""

LAW_NODES = 20
"""Gauss nodes on either side of the peak of exp(-energy / s^2)."""

BISECTIONS = 24
"""Halvings of a factor 2 in speed: seven digits, of a number that only sets a scale."""

DOUBLINGS = 400
"""More than the range of speeds that a scene may have calls for."""


def speed_scale(scenes: OscillatorArrays) -> Array:
    """The speed s at which the law exp(-energy / s^2) takes up the power of the noise, m/s.

    b s^2 + sum over stops of (1 - R^2) p s^3 / sqrt(2 pi) = S0 / 2, with p the density at the
    stop: the balance of energy, with F2 of Rayleigh's law. Exact between elastic stops.
    """
    power = scenes.intensity / 2.0
    damped = scenes.damping_rate > 0.0
    free = np.sqrt(power / np.where(damped, scenes.damping_rate, 1.0))
    # without damping any speed that scales as it should
    gap = np.minimum(scenes.upper - scenes.lower, 1e300)
    undamped = np.minimum(np.cbrt(gap * power), _swing(scenes, power))
    high = np.where(damped, free, undamped)
    for _ in range(DOUBLINGS):
        rising = ~damped & (_power_taken(scenes, high) < power)
        if not rising.any():
            break
        high = np.where(rising, 2.0 * high, high)
    for _ in range(DOUBLINGS):
        falling = _power_taken(scenes, high / 2.0) > power
        if not falling.any():
            break
        high = np.where(falling, high / 2.0, high)
    low = high / 2.0
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        above = _power_taken(scenes, middle) > power
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.where(scenes.elastic & damped, free, np.sqrt(low * high))


def _swing(scenes: OscillatorArrays, power: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.sqrt(power / scenes.omega)


def _power_taken(scenes: OscillatorArrays, speed: Array) -> Array:
    """By damping and by the stops, under the law exp(-energy / s^2)."""
    lowest, energy = scenes.lowest(), speed**2 * LAW_REACH**2 / 2.0
    climb = scenes.climb(energy)
    left = np.minimum(lowest - scenes.lower, climb)
    right = np.minimum(scenes.upper - lowest, climb)
    y, weights = gauss_panels(np.stack([-left, np.zeros_like(left), right], axis=1), LAW_NODES)

    def density(offset: Array) -> Array:
        slope = scenes.force(lowest) / speed**2
        fall = offset * (slope - (scenes.omega / speed) ** 2 * offset / 2.0)
        return np.exp(np.minimum(fall, 0.0))

    mass = np.sum(weights * density(y.T).T, axis=1)
    taken = scenes.damping_rate * speed**2
    for stop, restitution in scenes.stops:
        there = np.isfinite(stop)
        at_stop = density(np.where(there, stop, lowest) - lowest) / mass
        loss = (1.0 - restitution**2) * at_stop * speed**3 / math.sqrt(2.0 * math.pi)
        taken = taken + np.where(there, loss, 0.0)
    return taken


def boxes(scenes: OscillatorArrays, speed: Array, reach: float) -> Boxes:
    """The boxes that scenes are solved in: mirrored so that a single stop is on the right.

    `speed` is the scale s, in what follows widened where the law has a heavier tail. Where no
    stop is, a box ends at the energy s^2 reach^2 / 2 above the lowest.
    """
    speed = speed * _widening(scenes, speed)
    lowest = scenes.lowest()
    far = scenes.climb(speed**2 * FARTHEST_STOP**2 / 2.0)
    end = scenes.climb(speed**2 * reach**2 / 2.0)
    stop_left, stop_right = lowest - scenes.lower <= far, scenes.upper - lowest <= far
    left = np.where(stop_left, scenes.lower, lowest - end)
    right = np.where(stop_right, scenes.upper, lowest + end)
    r_left = np.where(stop_left, scenes.restitution_lower, 1.0)
    r_right = np.where(stop_right, scenes.restitution_upper, 1.0)
    middle, length = (left + right) / 2.0, right - left
    halved = stop_left & stop_right & (r_left == r_right)
    halved &= np.abs(scenes.force(middle)) * length <= SYMMETRIC * speed**2
    left = np.where(halved, middle, left)
    box = LinearBox.between(scenes, left, right, speed)
    r_left = np.where(halved, 1.0, r_left)
    stop_left = stop_left & ~halved
    mirrored = stop_left & ~stop_right
    return Boxes(
        centre=box.centre,
        half_length=box.half_length,
        speed=box.speed,
        force=np.where(mirrored, -1.0, 1.0) * box.force,
        stiffness=box.stiffness,
        damping=box.damping,
        diffusion=box.diffusion,
        restitution_left=np.where(mirrored, r_right, r_left),
        restitution_right=np.where(mirrored, r_left, r_right),
        stop_left=np.where(mirrored, stop_right, stop_left),
        stop_right=np.where(mirrored, stop_left, stop_right),
        mirrored=mirrored,
        halved=halved,
    )


def _widening(scenes: OscillatorArrays, speed: Array) -> Array:
    """From 1 to 1 + LEANING, the more a mass leans on a stop and the more that stop takes.

    Such a mass lies near the stop most of the time, at a lower speed than s, with rare excursions
    that reach far beyond what exp(-energy / s^2) allows.
    """
    lowest = scenes.lowest()
    restitution = np.where(
        lowest == scenes.lower,
        scenes.restitution_lower,
        np.where(lowest == scenes.upper, scenes.restitution_upper, 1.0),
    )
    press = np.abs(scenes.force(lowest))
    leaning = press / (press + scenes.omega * speed + 1e-300)
    return 1.0 + LEANING * (1.0 - restitution**2) * leaning


LEANING = 0.5
"""Found best at preloads up to 2 standard deviations: the error of the deviation falls fourfold."""

SYMMETRIC = 1e-12
"""Work of spring and load over the gap's excess, in units of s^2, below which stops are even."""
