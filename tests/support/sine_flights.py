"""One mass between stops under a sine, flown from event to event by closed forms of its own.

Nothing here is shared with the package. Between events the motion is that of a damped oscillator
under a sine and a constant force, pressed on a stop that gives way that of a stiffer one; events
are bracketed on a fine grid of time and bisected.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

PARTS = 48
"""Steps in the shorter one of the period of the force and of the motion."""


SMALLEST = 0.15
"""Relative change of displacement or speed from which on a change of a sweep may be a jump."""


class Mass(NamedTuple):
    """Per unit mass: spring, damper, force of the sine and of the load; positions of the stops
    (infinite where there is none), restitution, and spring and damper of stops that give way (0:
    rigid)."""

    k: float
    c: float
    force: float
    load: float
    lower: float
    upper: float
    restitution: float
    stop_k: float
    stop_c: float


FREE, UPPER, LOWER, FOLLOWED = 0, 1, -1, 2


@numba.njit(cache=True)
def moved(k, c, force, load, w, x, v, t, tau):
    """Place and speed of x'' + c x' + k x = force cos w t + load, a time tau after t."""
    size = (k - w * w) ** 2 + (c * w) ** 2
    a, b = force * (k - w * w) / size, force * c * w / size
    mean, end = load / k, w * (t + tau)
    p, pv = x - a * math.cos(w * t) - b * math.sin(w * t) - mean, v
    pv += w * (a * math.sin(w * t) - b * math.cos(w * t))
    own = k - 0.25 * c * c
    decay = math.exp(-0.5 * c * tau)
    if own > 0.0:
        root = math.sqrt(own)
        cos, sin = math.cos(root * tau), math.sin(root * tau) / root
    else:
        root = math.sqrt(-own)
        cos, sin = math.cosh(root * tau), math.sinh(root * tau) / root
    lean = pv + 0.5 * c * p
    free = decay * (p * cos + lean * sin)
    rate = decay * (lean * cos - own * p * sin) - 0.5 * c * free
    place = free + a * math.cos(end) + b * math.sin(end) + mean
    return place, rate + w * (b * math.cos(end) - a * math.sin(end))


@numba.njit(cache=True)
def step(m, w, mode, x, v, t, tau):
    """The motion in a mode: free, or pressed on a stop that gives way."""
    k, c, load = m.k, m.c, m.load
    if mode in (UPPER, LOWER):
        k, c = k + m.stop_k, c + m.stop_c
        load += m.stop_k * (m.upper if mode == UPPER else m.lower)
    return moved(k, c, m.force, load, w, x, v, t, tau)


@numba.njit(cache=True)
def beyond(m, mode, x, v):
    """Above 0 where a mode has ended: a stop is passed, or presses no more."""
    if mode == FREE:
        return max(x - m.upper, m.lower - x)
    if mode == FOLLOWED:
        # a stop that follows without a force, until it is left or pressed again
        d, rate = (x - m.upper, v) if x > 0.5 * (m.upper + m.lower) else (m.lower - x, -v)
        return max(-d, m.stop_k * d + m.stop_c * rate)
    d, rate = (x - m.upper, v) if mode == UPPER else (m.lower - x, -v)
    return -(m.stop_k * d + m.stop_c * rate)


@numba.njit(cache=True)
def fly(m, w, state, periods, sizes, ends):
    """Fly a state (2,) from the phase 0, in its place, over some periods.

    `sizes` (periods, 3) takes the largest |x| and impact speed and the time of rest of each period,
    `ends` (periods, 2) the state after it.
    """
    x, v = state
    period = 2.0 * math.pi / w
    coarse = min(period, 2.0 * math.pi / math.sqrt(m.k)) / PARTS
    fine = coarse
    if m.stop_k > 0.0:
        fine = min(coarse, 2.0 * math.pi / math.sqrt(m.k + m.stop_k) / PARTS)
    mode, rested, fastest = FREE, 0, 0.0
    for number in range(periods):
        t, largest, hardest, resting = 0.0, abs(x), 0.0, 0.0
        while t < period * (1.0 - 1e-14):
            tau = min(coarse if mode == FREE else fine, period - t)
            if rested != 0:
                # pressed on a rigid stop: until the forces turn
                place = m.upper if rested > 0 else m.lower
                low, high, push = 0.0, tau, 0.0
                for end in (tau, 0.0):
                    push = rested * (m.force * math.cos(w * (t + end)) + m.load - m.k * place)
                    if push <= 0.0:
                        break
                if push > 0.0:
                    t, resting = t + tau, resting + tau
                    continue
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    push = rested * (m.force * math.cos(w * (t + middle)) + m.load - m.k * place)
                    if push > 0.0:
                        low = middle
                    else:
                        high = middle
                t, resting, x, v, rested = t + high, resting + high, place, 0.0, 0
                continue
            later, rate = step(m, w, mode, x, v, t, tau)
            over = beyond(m, mode, later, rate)
            if over <= 0.0 and mode == FREE and v * rate < 0.0:
                low, high = 0.0, tau
                for _ in range(40):
                    middle = 0.5 * (low + high)
                    there, speed = step(m, w, mode, x, v, t, middle)
                    if speed * v > 0.0:
                        low = middle
                    else:
                        high = middle
                there, speed = step(m, w, mode, x, v, t, low)
                largest = max(largest, abs(there))
                if beyond(m, mode, there, speed) > 0.0:
                    tau, over = low, 1.0
            if over > 0.0:
                # false position, where an end that stays counts half, and at times the middle
                low, high, side = 0.0, tau, 0
                there, speed = step(m, w, mode, x, v, t, tau)
                below, above = beyond(m, mode, x, v), beyond(m, mode, there, speed)
                for turn in range(60):
                    if high - low < 1e-15 * period:
                        break
                    share = 0.5 if turn % 4 == 3 or below >= 0.0 else below / (below - above)
                    middle = low + share * (high - low)
                    there, speed = step(m, w, mode, x, v, t, middle)
                    value = beyond(m, mode, there, speed)
                    if value > 0.0:
                        high, above, below = middle, value, below * (0.5 if side > 0 else 1.0)
                        side = 1
                    else:
                        low, below, above = middle, value, above * (0.5 if side < 0 else 1.0)
                        side = -1
                # rounding would let a stop that is left be pressed again, without end
                high = max(high, 1e-13 * period)
                x, v = step(m, w, mode, x, v, t, high)
                t += high
                side = 1 if abs(x - m.upper) < abs(x - m.lower) else -1
                largest = max(largest, abs(x))
                if mode == FREE:
                    speed = side * v
                    hardest = max(hardest, speed)
                    if m.stop_k > 0.0:
                        mode = side
                        continue
                    fastest = max(fastest, speed)
                    v = -m.restitution * v
                    x = m.upper if side > 0 else m.lower
                    push = side * (m.force * math.cos(w * t) + m.load - m.k * x - m.c * v)
                    # below the second one the rounding of places would keep it bouncing
                    slow = max(1e-9 * fastest, math.sqrt(1e-14 * max(push, 0.0) * largest))
                    if m.restitution * speed < slow and push > 0.0:
                        rested, v = side, 0.0
                else:
                    d = x - m.upper if side > 0 else m.lower - x
                    other = side if mode == FOLLOWED else FOLLOWED
                    mode = other if d > 1e-12 * largest else FREE
                continue
            largest = max(largest, abs(later))
            x, v, t = later, rate, t + tau
        sizes[number, 0], sizes[number, 1], sizes[number, 2] = largest, hardest, resting
        ends[number, 0], ends[number, 1] = x, v
    state[0], state[1] = x, v


class Motion(NamedTuple):
    """The end of a flight: periods after which it repeats itself (0: not within 8), largest |x| and
    impact speed and rest over them, and its state."""

    periods: int
    size: float
    speed: float
    rest: float
    state: np.ndarray


def settled(m: Mass, w: float, state: np.ndarray, rounds: int = 12, periods: int = 128) -> Motion:
    """The motion that a state leads to."""
    state = np.array(state, float)
    for _ in range(rounds):
        sizes, ends = np.empty((periods, 3)), np.empty((periods, 2))
        fly(m, w, state, periods, sizes, ends)
        scale = np.array([sizes[-8:, 0].max(), w * sizes[-8:, 0].max()]) + 1e-300
        for number in range(1, 9):
            away = np.max(np.abs(ends[-2 * number - 1 :: number] - ends[-1]) / scale)
            if away < 1e-7:
                last = sizes[-number:]
                return Motion(number, *last[:, :2].max(axis=0), last[:, 2].sum(), state)
            if away < 1e-4:
                # a slow approach may come closest to itself after several periods
                break
    return Motion(0, *sizes[:, :2].max(axis=0), sizes[-8:, 2].sum(), state)


class Jump(NamedTuple):
    """A place at which a motion that repeats itself changes by a share, and both motions."""

    place: float
    before: Motion
    after: Motion


class Swept(NamedTuple):
    """A slow sweep: its frequencies in their order, the motion at each, and its jumps."""

    frequencies: list[float]
    motions: list[Motion]
    jumps: list[Jump]

    def before(self, place: float, near: float) -> Motion | None:
        """The last motion whose frequency is at least a relative distance before a place."""
        upwards = self.frequencies[-1] > self.frequencies[0]
        passed = [
            motion
            for frequency, motion in zip(self.frequencies, self.motions, strict=True)
            if (frequency < place * (1.0 - near) if upwards else frequency > place * (1.0 + near))
        ]
        return passed[-1] if passed else None

    def window(self, place: float) -> float | None:
        """The relative distance of a place from the last one before it at which the motion did not
        repeat itself; None if it always did."""
        before = [
            frequency
            for frequency, motion in zip(self.frequencies, self.motions, strict=True)
            if not motion.periods
            and (frequency < place) == (self.frequencies[-1] > self.frequencies[0])
        ]
        return abs(place / before[-1] - 1.0) if before else None


def swept(m: Mass, frequencies: np.ndarray, near: float = 1e-4) -> Swept:
    """A slow sweep from rest under the load, with its jumps bisected to a relative distance."""
    rest = min(max(m.load / m.k, m.lower), m.upper)
    state, passed, jumps = np.array([rest, 0.0]), list[Motion](), []
    for number, frequency in enumerate(frequencies.tolist()):
        w, here = 2.0 * math.pi * frequency, passed[-1] if passed else None
        there = settled(m, w, state, rounds=4 if here is None or here.periods else 2)
        if here is not None and here.periods and not there.periods:
            # near a fold motions approach slowly
            there = settled(m, w, there.state)
        if here is not None and here.periods and changed(here, there, frequency) > SMALLEST:
            jumps += _bisected(m, (frequencies[number - 1], here), (frequency, there), near)
        passed.append(there)
        state = there.state
    return Swept(frequencies.tolist(), passed, jumps)


def jumped(m: Mass, before: Motion, place: float, upwards: bool, near: float) -> float | None:
    """Where a motion changes at once in a slow sweep over a relative distance on both sides of a
    place, or repeats itself no more, as the relative distance from it; None where it does not.

    How large a motion is that does not repeat itself depends on how long it is flown.
    """
    way, last = (1.0 if upwards else -1.0), before
    for away in (0.1 * near * np.arange(-10, 11)).tolist():
        frequency = place * (1.0 + way * away)
        there = settled(m, 2.0 * math.pi * frequency, last.state)
        ended = last.periods and not there.periods
        if ended or changed(last, there, frequency) > SMALLEST:
            return abs(away)
        last = there
    return None


def _bisected(
    m: Mass, start: tuple[float, Motion], end: tuple[float, Motion], near: float
) -> list[Jump]:
    """The jump between two frequencies of a sweep; none where the change is gradual."""
    (low, before), (high, after) = start, end
    while abs(high / low - 1.0) > near and before.periods:
        middle = math.sqrt(low * high)
        motion = settled(m, 2.0 * math.pi * middle, before.state)
        if changed(before, motion, middle) > SMALLEST:
            high, after = middle, motion
        else:
            low, before = middle, motion
    jumped = before.periods and changed(before, after, high) > SMALLEST
    return [Jump(low, before, after)] if jumped else []


def changed(before: Motion, after: Motion, frequency: float) -> float:
    """The larger one of the relative changes of displacement and impact speed."""
    size = max(before.size, after.size)
    speed = max(before.speed, after.speed, 2.0 * math.pi * frequency * size)
    return max(abs(after.size - before.size) / size, abs(after.speed - before.speed) / speed)
