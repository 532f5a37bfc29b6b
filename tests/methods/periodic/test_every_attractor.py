"""Random scenes: what many starts end in, and where slow sweeps jump, by an own integrator."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from stochvi import ConstantLoad, ImpactPair, Oscillator, Scene, Sine, harmonic_response
from stochvi.methods.periodic import HarmonicResponse
from stochvi.scenes.impact_laws import Law, Restitution, Viscoelastic
from support.sine_flights import Mass, Motion, settled, swept

STARTS = 64
"""Random starts of each scene."""

NEAR = 1e-3
"""Relative difference of displacement, speed and places of jumps that is asked for."""

FINE = 600
"""Values of a slow sweep."""


class Case(NamedTuple):
    """A scene, the same mass for the flights, and a range of frequencies with one inside it."""

    scene: Scene
    mass: Mass
    values: np.ndarray
    inside: float


def case(seed: int) -> Case:
    """One mass of 1 kg and 1 N/m between one or two stops, rigid or not, with a load or without."""
    random = np.random.default_rng(seed)
    zeta = 10.0 ** random.uniform(-2.0, -0.7)
    low = 10.0 ** random.uniform(-0.4, 0.4) / (2.0 * math.pi)
    values = np.linspace(low, 1.6 * low, 25)
    inside = float(values[random.integers(2, 23)])
    force, load = 1.0, float(random.normal() * 0.5) * (random.random() < 0.5)
    w = 2.0 * math.pi * values
    response = force / np.hypot(1.0 - w**2, 2.0 * zeta * w)
    gap = float(response.max() * 10.0 ** random.uniform(-1.3, 0.1))
    upper = load + gap * (-0.2 if random.random() < 0.1 else 1.0)
    lower = load - gap * random.choice([1.0, 1.0, random.uniform(0.3, 3.0)])
    if upper < load or random.random() < 0.4:
        lower = -math.inf
    law: Law
    if random.random() < 0.6:
        restitution = float(random.uniform(0.0, 0.95))
        law, stop_k, stop_c = Restitution(coefficient=restitution), 0.0, 0.0
    else:
        restitution, ratio = 0.0, float(random.uniform(0.0, 0.4))
        stop_k = float(10.0 ** random.uniform(0.7, 3.0))
        law = Viscoelastic(stiffness=stop_k, damping_ratio=ratio)
        stop_c = 2.0 * ratio * math.sqrt(stop_k)
    pair = {"upper": upper} | ({"lower": lower} if math.isfinite(lower) else {})
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=2.0 * zeta, stiffness=1.0),
        impact_pairs=[ImpactPair(law=law, **pair)],
        excitations=[
            Sine(amplitude=force, frequency_hz=inside),
            *([ConstantLoad(force=load)] if load else []),
        ],
    )
    mass = Mass(1.0, 2.0 * zeta, force, load, lower, upper, restitution, stop_k, stop_c)
    return Case(scene, mass, values, inside)


def ends(one: Case, seed: int) -> list[Motion]:
    """The motions in which random starts end, each once."""
    random = np.random.default_rng(seed)
    m, w = one.mass, 2.0 * math.pi * one.inside
    size = 2.0 * max(abs(m.upper), m.force / max(abs(1.0 - w**2), m.c * w))
    low, high = max(m.lower, -size), min(m.upper, size)
    low = min(low, high - size) if not math.isfinite(m.lower) else low
    found = list[Motion]()
    for _ in range(STARTS):
        start = [random.uniform(low, high), size * max(w, 1.0) * random.normal()]
        motion = settled(m, w, np.array(start))
        if all(not _alike(motion, each.periods, each.size, each.speed, w) for each in found):
            found.append(motion)
    return found


def _alike(motion: Motion, periods: int, size: float, speed: float, w: float) -> bool:
    if motion.periods != periods:
        return False
    return periods == 0 or (
        abs(motion.size - size) < NEAR * size and abs(motion.speed - speed) < NEAR * w * size
    )


def listed(found: HarmonicResponse, one: Case, motion: Motion) -> bool:
    """Whether a motion is a stable regime of a branch, or is named beside them."""
    if motion.periods == 0:
        return found.starts is not None and not found.starts.all_listed
    return any(
        _alike(
            motion,
            row.periods,
            row.displacement_max,
            row.impact_speed_max,
            2.0 * math.pi * one.inside,
        )
        for row in found.at(one.inside).itertuples()
        if row.stable
    )


def missed(seed: int) -> list[str]:
    """What flights find and the answer does not have, and the other way round, in words."""
    one = case(seed)
    found = harmonic_response(one.scene, one.values)
    wrong = [f"{seed}: end {each}" for each in ends(one, seed) if not listed(found, one, each)]
    for upwards in (True, False):
        values = np.geomspace(one.values[0], one.values[-1], FINE)
        seen = swept(one.mass, values if upwards else values[::-1])
        jumps = [each for each in found.jumps if each.upwards == upwards]
        for place, before, after in seen:
            if not any(abs(each.value / place - 1.0) < NEAR for each in jumps):
                wrong.append(f"{seed}: jump {upwards} {place} {before} {after}")
    return wrong


@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(k, marks=pytest.mark.verify) for k in range(3, 200))]
)
def test_what_flights_end_in_and_where_they_jump_is_listed(seed: int) -> None:
    assert not missed(seed)
