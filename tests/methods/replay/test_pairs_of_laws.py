"""Any two laws of stops side by side in a replay, against a plain integration of their formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    ForceFunction,
    ForceTable,
    ImpactPair,
    Matrices,
    RecordedNoise,
    Restitution,
    Scene,
    SpeedRestitution,
    Viscoelastic,
    replay,
)
from stochvi.engine.laws.scattered_restitution import CELLS
from stochvi.scenes import Hertz, PowerLaw
from stochvi.scenes.impact_laws import Law
from support import naive
from support.accuracies import quick_cases

FS, SAMPLES, JUDGED, GAP, SEED = 250.0, 256, 40, 2e-3, 5
"""Sampling rate, samples of the record and those that are judged, clearance, and seed of draws."""

MASSES, DAMPING = np.array([2.0, 0.5]), np.array([[20.0, -4.0], [-4.0, 6.0]])
STIFFNESS = np.array([[12e3, -2e3], [-2e3, 4e3]])
WIDE = Restitution(coefficient={"mean": 0.6, "std": 0.1})

Force = Callable[[float, float], float]
Rebound = Callable[[float, int], float]


def drawn(w: float, number: int) -> float:
    """Speed after an impact whose restitution is the draw of this number."""
    assert WIDE.scatter is not None
    middles, widths = WIDE.scatter.cells(CELLS)
    place = naive.uniform(SEED, number) * CELLS
    return float(middles[int(place)] + widths[int(place)] * (place % 1.0 - 0.5)) * w


class Plain(NamedTuple):
    """A law, and what it says: a force (N) of deflection and rate, or the speed after an impact."""

    law: Law
    force: Force | None = None
    rebound: Rebound | None = None


def plain_laws(mass: float) -> list[Plain]:
    """The laws, with the numbers of those that depend on the mass of the pair."""
    damper = 2.0 * 0.3 * math.sqrt(2e5 * mass)
    return [
        Plain(Restitution(coefficient=0.6), rebound=lambda w, _: 0.6 * w),
        Plain(
            SpeedRestitution(speed=[0.1, 1.1], coefficient=[0.7, 0.3]),
            rebound=lambda w, _: (0.7 - 0.4 * min(max(w - 0.1, 0.0), 1.0)) * w,
        ),
        Plain(WIDE, rebound=drawn),
        Plain(Elastic(stiffness=3e5), lambda y, v: 3e5 * y),
        Plain(
            ForceTable(deflection=[1e-4, 4e-4], force=[5.0, 120.0]),
            lambda y, v: 5e4 * y if y < 1e-4 else 5.0 + 115.0 * (y - 1e-4) / 3e-4,
        ),
        Plain(
            Viscoelastic(stiffness=2e5, damping_ratio=0.3),
            lambda y, v: max(2e5 * y + damper * v, 0.0),
        ),
        Plain(Hertz(coefficient=4e6), lambda y, v: 4e6 * y**1.5),
        Plain(
            PowerLaw(coefficient=4e7, exponent=1.8, loss=1e7),
            lambda y, v: max((4e7 + 1e7 * v) * y**1.8, 0.0),
        ),
        Plain(
            ForceFunction(force=lambda y, v: 1e5 * y * (1.0 + 0.3 * v)),
            lambda y, v: max(1e5 * y * (1.0 + 0.3 * v), 0.0),
        ),
    ]


class Stop(NamedTuple):
    """A stop of one of the masses."""

    of: int
    side: float
    law: Plain


def accelerations(seed: int) -> np.ndarray:
    """Band-limited noise, m/s^2, mean taken off."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=SAMPLES))
    spectrum[np.fft.rfftfreq(SAMPLES, 1.0 / FS) > 40.0] = 0.0
    a = 90.0 * np.fft.irfft(spectrum, SAMPLES)
    return np.asarray(a - a.mean())


def integrated(a: np.ndarray, masses: np.ndarray, stops: list[Stop]) -> tuple[np.ndarray, list]:
    """Displacements at the samples, and (stop, speed) of the impacts in their order."""
    n, times, draws = len(masses), np.arange(len(a)) / FS, 0
    damping, stiffness = DAMPING[:n, :n], STIFFNESS[:n, :n]

    def depth(s: np.ndarray, stop: Stop) -> float:
        return stop.side * float(s[stop.of]) - GAP

    def rate(t: float, s: np.ndarray) -> np.ndarray:
        forces = -stiffness @ s[:n] - damping @ s[n:]
        for stop in stops:
            y = depth(s, stop)
            if stop.law.force is not None and y > 0.0:
                forces[stop.of] -= stop.side * stop.law.force(y, stop.side * s[n + stop.of])
        return np.concatenate([s[n:], forces / masses - np.interp(t, times, a)])

    def touch(stop: Stop) -> Callable[[float, np.ndarray], float]:
        def event(t: float, s: np.ndarray) -> float:
            return depth(s, stop)

        event.direction, event.terminal = 1.0, True  # type: ignore[attr-defined]
        return event

    state, hits, found = np.zeros(2 * n), [], [np.zeros(n)]
    for begin, end in pairwise(times):
        now = begin
        while now < end:
            part = solve_ivp(rate, (now, end), state, "DOP853", events=[touch(s) for s in stops],
                             rtol=1e-9, atol=1e-12, max_step=2.5e-4)  # fmt: skip
            now, state = part.t[-1], part.y[:, -1]
            if part.status != 1:
                continue
            which = next(k for k, each in enumerate(part.t_events) if len(each))
            stop = stops[which]
            speed = stop.side * state[n + stop.of]
            hits.append((which, speed))
            assert len(hits) < 200
            if stop.law.rebound is None:  # past the touch, or the same event ends the next part
                now, state = now + 1e-12, state + 1e-12 * rate(now, state)
                continue
            state[stop.of] = stop.side * GAP * (1.0 - 1e-15)
            state[n + stop.of] = -stop.side * stop.law.rebound(speed, draws)
            # each impact on a stop whose restitution varies takes a number
            draws += stop.law.law is WIDE or isinstance(stop.law.law, SpeedRestitution)
        found.append(state[:n])
    return np.array(found), hits


def scene_of(folder: Path, a: np.ndarray, coordinates: int, pairs: list[ImpactPair]) -> Scene:
    file = folder / "record.txt"
    np.savetxt(file, a, fmt="%.17g")
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"][:coordinates],
            mass=np.diag(MASSES[:coordinates]).tolist(),
            damping=DAMPING[:coordinates, :coordinates].tolist(),
            stiffness=STIFFNESS[:coordinates, :coordinates].tolist(),
        ),
        impact_pairs=pairs,
        excitations=[RecordedNoise(file=str(file), unit="m/s2", fs=FS, on="base")],
    )


def agree(folder: Path, coordinates: int, stops: list[Stop], pairs: list[ImpactPair]) -> None:
    a = accelerations(seed=3)
    found = replay(scene_of(folder, a, coordinates, pairs), seed=SEED)
    truth, hits = integrated(a[:JUDGED], MASSES[:coordinates], stops)
    assert {which for which, _ in hits} == set(range(len(stops))) and len(hits) > 5
    assert found.histories is not None
    for number, name in enumerate(found.coordinates):
        apart = np.abs(found.histories.displacement[name][:JUDGED] - truth[:, number]).max()
        assert apart < 1e-5 * np.abs(truth[:, number]).max()
    early = found.impacts[found.impacts["time"] < (JUDGED - 1) / FS]
    assert early["speed"].to_numpy() == pytest.approx([w for _, w in hits], rel=1e-3)


NUMBERS = range(len(plain_laws(1.0)))
PAIRS = list(combinations(NUMBERS, 2))


def named(numbers: tuple[int, int]) -> str:
    laws = plain_laws(1.0)
    return " and ".join(f"{laws[k].law.kind}{k}" for k in numbers)


@quick_cases("numbers", PAIRS, keep=range(0, len(PAIRS), 6), ids=named)
def test_a_mass_between_two_laws_moves_as_their_formulas_say(
    tmp_path: Path, numbers: tuple[int, int]
) -> None:
    lower, upper = (plain_laws(MASSES[0])[k] for k in numbers)
    pair = ImpactPair(on="a", lower=-GAP, upper=GAP, lower_law=lower.law, upper_law=upper.law)
    agree(tmp_path, 1, [Stop(0, -1.0, lower), Stop(0, 1.0, upper)], [pair])


@quick_cases("numbers", PAIRS, keep=range(3, len(PAIRS), 12), ids=named)
def test_two_masses_with_a_law_each_move_as_their_formulas_say(
    tmp_path: Path, numbers: tuple[int, int]
) -> None:
    own = [plain_laws(mass)[k] for mass, k in zip(MASSES, numbers, strict=True)]
    pairs = [
        ImpactPair(name=name, on=name, lower=-GAP, upper=GAP, law=each.law)
        for name, each in zip("ab", own, strict=True)
    ]
    stops = [Stop(k, side, own[k]) for k in (0, 1) for side in (-1.0, 1.0)]
    agree(tmp_path, 2, stops, pairs)


def test_two_masses_that_are_pressed_onto_their_stops_rest_there(tmp_path: Path) -> None:
    """The base pulls one way, then the other: each mass chatters on each of its stops, ever slower
    by its restitution, and rests until the base turns. Neither wakes the other."""
    a = np.repeat([-60.0, 60.0], 256)
    laws = {"a": 0.6, "b": 0.7}
    pairs = [
        ImpactPair(name=name, on=name, lower=-GAP, upper=GAP, law=Restitution(coefficient=r))
        for name, r in laws.items()
    ]
    found = replay(scene_of(tmp_path, a, 2, pairs))
    assert found.histories is not None
    for name, r in laws.items():
        x = found.histories.displacement[name]
        assert np.abs(x[200:256] - GAP).max() < 1e-12 and np.abs(x[456:] + GAP).max() < 1e-12
        assert float(found.impact_pairs[name].rests) == 2.0
        for _, own in found.impacts[found.impacts["pair"] == name].groupby("side"):
            speeds = own["speed"].to_numpy()
            slow = speeds[speeds < 1e-3]
            assert len(slow) > 10 and slow[-1] > 1e-9
            assert slow[1:] / slow[:-1] == pytest.approx(r, rel=1e-3)
