"""Random scenes: what many starts end in, and where slow sweeps jump, by an own integrator."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from stochvi import ConstantLoad, ImpactPair, Oscillator, Scene, Sine, harmonic_response
from stochvi.methods.periodic import HarmonicResponse
from stochvi.methods.periodic.answer import Jump, RandomStarts
from stochvi.scenes.impact_laws import Law, Restitution, Viscoelastic
from support.sine_flights import SMALLEST, Mass, Motion, Swept, changed, jumped, settled, swept

CHEAP = (26, 55, 65, 81)
"""Scenes of which every run judges the answer: 26 jumps where two equal stops are no longer hit
equally hard; the sweep down of 55 ends in another regime where it starts at the unloaded spring,
and not at rest under the load; 65 has two regimes; 81 jumps from chaos, and has a regime that
doubles its period."""

TWO_REGIMES = 65
"""Scene with two stable regimes and a jump up and down, whose answer is spoiled on purpose."""

DOUBLED = (4, 5)
"""Scenes, with rigid and with compliant stops, in which branches join those that double a period;
no regime is the mirror image of another."""

SCENES = 200
"""Number of scenes."""

STARTS = 64
"""Random starts of each scene."""

NEAR = 1e-3
"""Relative difference of displacement, speed and places of jumps that is asked for."""

FINE = 600
"""Values of a slow sweep."""

NARROW = 4e-3
"""Relative width of a range of frequencies between motions that do not repeat themselves up to
which a sweep of the package may step over it: where it is on no branch it takes such steps."""


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


class Compared(NamedTuple):
    """What flights find and an answer does not have, and the other way round, in words; numbers of
    motions, and relative distances of the jumps that were compared."""

    wrong: list[str]
    motions: int
    apart: list[float]


def compared(one: Case, found: HarmonicResponse, seen: Seen) -> Compared:
    """An answer against the flights of the same scene."""
    wrong = [f"end {each}" for each in seen.ends if not listed(found, one, each)]
    apart = list[float]()
    for upwards, sweep in ((True, seen.up), (False, seen.down)):
        jumps = [each for each in found.jumps if each.upwards == upwards]
        for jump in sweep.jumps:
            places = [each.value for each in jumps]
            window = sweep.window(jump.place)
            if window is not None:
                # which windows of chaos a sweep is caught by is chance, but not where they end
                places += [each.value for each in found.special_points]
            away = min((abs(place / jump.place - 1.0) for place in places), default=math.inf)
            if away < NEAR:
                apart.append(away)
            elif window is None or window > NARROW or not _named(found, jump.place):
                wrong.append(f"seen, not listed: {upwards} {jump}")
        for each in jumps:
            if any(abs(each.value / jump.place - 1.0) < NEAR for jump in sweep.jumps):
                continue  # seen; next to a fold the motion before it may be far from that at it
            before = sweep.before(each.value, NEAR)
            if before is None or not before.periods or _change(each) < SMALLEST:
                continue
            on_it = before._replace(size=each.displacement_max[0], speed=each.impact_speed[0])
            away = None
            if changed(before, on_it, each.value) < SMALLEST:
                away = jumped(one.mass, before, each.value, upwards, NEAR)
            elif sweep.window(each.value) is not None:
                # it has come out of chaos on another motion
                continue
            elif (other := reached_before(one, each)) is not None:
                # the jump before this one has led to another of several motions
                away = jumped(one.mass, other, each.value, upwards, NEAR)
            if away is None:
                wrong.append(f"listed, not seen: {each}")
            else:
                apart.append(away)
    return Compared(wrong, len(seen.ends), apart)


def reached_before(one: Case, jump: Jump) -> Motion | None:
    """The motion of a random start that a jump leaves, a little before it."""
    near = jump.value * (1.0 - NEAR if jump.upwards else 1.0 + NEAR)
    for motion in ends(one._replace(inside=near), seed=0):
        on_it = motion._replace(size=jump.displacement_max[0], speed=jump.impact_speed[0])
        if motion.periods and changed(motion, on_it, jump.value) < SMALLEST:
            return motion
    return None


def _named(found: HarmonicResponse, place: float) -> bool:
    """Whether the closing sentence names a place."""
    if found.starts is None or found.starts.elsewhere is None:
        return False
    low, high = found.starts.elsewhere
    return low * (1.0 - NARROW) < place < high * (1.0 + NARROW)


def _change(jump: Jump) -> float:
    """The change of a jump as the flights measure it."""
    before, after = (
        Motion(1, size, speed, 0.0, np.zeros(2))
        for size, speed in zip(jump.displacement_max, jump.impact_speed, strict=True)
    )
    return changed(before, after, jump.value)


class Seen(NamedTuple):
    """What flights find: the ends of random starts, and slow sweeps up and down."""

    ends: list[Motion]
    up: Swept
    down: Swept


def seen_by_flights(one: Case, seed: int) -> Seen:
    """What flights find in a scene."""
    values = np.geomspace(one.values[0], one.values[-1], FINE)
    return Seen(ends(one, seed), swept(one.mass, values), swept(one.mass, values[::-1]))


@functools.cache
def both(seed: int) -> tuple[Case, HarmonicResponse, Seen]:
    """A scene, its answer, and what flights find."""
    one = case(seed)
    return one, harmonic_response(one.scene, one.values), seen_by_flights(one, seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        *CHEAP,
        *(pytest.param(k, marks=pytest.mark.verify) for k in range(SCENES) if k not in CHEAP),
    ],
)
def test_what_flights_end_in_and_where_they_jump_is_listed(seed: int) -> None:
    assert not compared(*both(seed)).wrong


@pytest.mark.slow
@pytest.mark.parametrize("seed", DOUBLED)
def test_each_regime_is_listed_once(seed: int) -> None:
    """A branch that doubles its period passes through each regime again, a period later."""
    one = case(seed)
    found, copies, periods = harmonic_response(one.scene, one.values), 0, list[int]()
    for value in one.values.tolist():
        rows = found.at(value)[["periods", "displacement_max", "impact_speed_max", "multiplier"]]
        numbers = rows.to_numpy(float)
        periods += rows.periods.tolist()
        copies += sum(
            np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in itertools.combinations(numbers, 2)
        )
    assert max(periods) > 1 and copies == 0


@pytest.mark.slow
def test_an_answer_that_lacks_a_branch_or_a_jump_is_caught() -> None:
    """Also one with a jump too many, or at another place, or that hides motions on no branch."""
    one, found, seen = both(TWO_REGIMES)
    assert len(seen.ends) == 2 and len(found.jumps) == 2
    every = RandomStarts(number=192, listed=192, elsewhere=None)

    def faults(**changes: Any) -> list[str]:
        return compared(one, replace(found, starts=every, **changes), seen).wrong

    assert not faults()
    for number, branch in enumerate(found.branches):
        held = [branch.stable[place] for place in branch.at(one.inside)]
        rest = tuple(each for each in found.branches if each is not branch)
        assert len(faults(branches=rest)) == sum(held), number
    for jump in found.jumps:
        rest = tuple(each for each in found.jumps if each is not jump)
        moved = replace(jump, value=jump.value * (1.0 + 2.0 * NEAR))
        assert len(faults(jumps=rest)) == 1
        assert len(faults(jumps=(*found.jumps, moved))) == 1
        assert len(faults(jumps=(*rest, moved))) == 2
    chaos = seen._replace(ends=[seen.ends[0]._replace(periods=0)])
    assert len(compared(one, replace(found, starts=every), chaos).wrong) == 1
