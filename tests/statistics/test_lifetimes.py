"""Life times in noise against a plain simulation that knows regimes by their impacts."""

from __future__ import annotations

import importlib
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import (
    ImpactPair,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
)
from stochvi.results.deadline import NEVER
from stochvi.scenes.datasets import shipped_scene
from stochvi.statistics import lifetimes
from support import judges
from support.bounces import Bounces
from support.clocks import tick

Vector = NDArray[np.float64]

module = importlib.import_module("stochvi.statistics.lifetimes")

GAP, DRIVE, RESTITUTION = 4e-4, 200.0 * math.pi, 0.6
"""Clearance (m), frequency (rad/s) and restitution of a mount that may clatter or not."""

OMEGA, DAMPING = 0.1 * DRIVE, 0.02 * DRIVE
"""Natural frequency, rad/s, and damping rate, 1/s, of the mount."""

PUSH, NOISE = 1e-4 * DRIVE**2, 2e-3
"""Acceleration of the sine, m/s^2, and intensity of the noise, m^2/s^3."""

REST = "no impacts"


def mount(*noise: WhiteNoise | TabulatedNoise) -> Scene:
    """An oscillator between two stops, driven at ten times its natural frequency."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=DAMPING, stiffness=OMEGA**2),
        impact_pairs=[ImpactPair(clearance=GAP, law=Restitution(coefficient=RESTITUTION))],
        excitations=[Sine(amplitude=PUSH, frequency_hz=DRIVE / (2.0 * math.pi)), *noise],
    )


def plain_rest(intensity: float) -> Vector:
    """Seconds without clatter of paths that are followed until all of them clatter.

    Symplectic steps with kicks; a step that ends beyond a stop is reflected. Clatter is known by
    three impacts or more in every two of twelve periods.
    """
    random, paths, steps = np.random.default_rng(5), 256, 64
    h = 2.0 * math.pi / DRIVE / steps
    swing = PUSH / ((OMEGA**2 - DRIVE**2) + 1j * DAMPING * DRIVE)
    x, v = np.full(paths, swing.real), np.full(paths, (1j * DRIVE * swing).real)
    hits, clatter, lives = np.zeros(paths), np.zeros(paths, np.int64), np.zeros(paths)
    number = 0
    while not lives.all():
        phase = 2.0 * math.pi * (number % steps + 0.5) / steps
        v += h * (PUSH * math.cos(phase) - OMEGA**2 * x - DAMPING * v)
        v += math.sqrt(intensity * h) * random.normal(size=paths)
        x += h * v
        beyond = np.abs(x) > GAP
        x[beyond] = np.sign(x[beyond]) * GAP - RESTITUTION * (x - np.sign(x) * GAP)[beyond]
        v[beyond] *= -RESTITUTION
        hits += beyond
        number += 1
        if number % (2 * steps) == 0:
            clatter = np.where(hits > 2, clatter + 1, 0)
            hits[:] = 0.0
            lives[(clatter == 6) & (lives == 0.0)] = h * (number - 13 * steps)
    return lives


def test_rest_lasts_as_long_as_in_a_plain_simulation() -> None:
    noise = WhiteNoise(intensity=NOISE)
    (found,) = lifetimes(mount(noise), [REST], rel_error=0.12, threads=1).regimes
    assert found.life_time is not None and found.life_time_high is not None
    assert found.left >= 70 and found.life_time_low < found.life_time < found.life_time_high
    (there,) = found.destinations
    assert there.regime == "stops lower, stops upper" and there.share == 1.0
    lives = plain_rest(NOISE)
    plain = float(lives.mean())
    error = math.hypot(lives.std() / math.sqrt(len(lives)) / plain, 1.0 / math.sqrt(found.left))
    # the two rules by which a path has left differ by some periods
    assert abs(math.log(plain / found.life_time)) < 4.0 * error + 0.05 / plain


@pytest.mark.slow
def test_a_budget_that_ends_early_makes_no_life_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths that are watched for a part of their lives, and others until all of them have left.

    The negative control takes the first seconds, in which noise has not spread the paths yet, for
    as good as all others.
    """
    made, sampler_of = [], module.DepartureSampler

    def kept(*arguments: object) -> object:
        made.append(sampler_of(*arguments))
        return made[-1]

    monkeypatch.setattr(module, "DepartureSampler", kept)

    def early() -> module.LifeTime:
        with pytest.MonkeyPatch.context() as patched:
            tick(patched, 1e-3)
            with pytest.raises(NotConverged) as ended:
                lifetimes(mount(WhiteNoise(intensity=NOISE)), [REST], rel_error=0.01, budget=2.0)
        return ended.value.partial.regimes[0]

    found = early()
    sampler, lives = made[0], np.empty(0)
    first = sampler.most * (sampler.regimes[0] + 1) - 1  # far behind those that were simulated
    for number in range(first, first - 16, -1):
        group = sampler.begun(number)
        while not np.all(group.left):
            group = sampler.advance(number, group, NEVER)
        lives = np.append(lives, group.left_at - 0.5)
    lives *= module.BETWEEN_LOOKS * 2.0 * math.pi / DRIVE
    error = math.hypot(lives.std() / 32.0, found.life_time / math.sqrt(found.left))
    assert found.left < 0.75 * found.paths and len(lives) == 1024
    assert abs(found.life_time - lives.mean()) < 4.0 * error
    monkeypatch.setattr(module, "FORGOTTEN", 0)
    assert early().life_time - lives.mean() > 4.0 * error


def test_a_regime_that_the_budget_did_not_reach_has_a_lower_limit_of_zero() -> None:
    with pytest.MonkeyPatch.context() as patched:
        tick(patched, 1e-3)
        with pytest.raises(NotConverged) as ended:
            lifetimes(mount(WhiteNoise(intensity=NOISE)), budget=0.5)
    reached, unreached = ended.value.partial.regimes
    assert reached.paths > 0 and unreached.paths == 0
    assert (unreached.life_time, unreached.life_time_low) == (None, 0.0)
    assert ended.value.partial.to_dict()["regimes"][1]["destinations"] == []
    assert len(ended.value.partial.to_frame()) == 2
    assert judges.columns_without_judge(ended.value.partial) == []


def own_lives(intensity: float, paths: int, outside: float) -> Vector:
    """Seconds for which paths without impacts stay so; a mount of 10 Hz on a base that moves by
    0.1 mm at 100 Hz.

    Symplectic steps with kicks, and reflections. Every five periods the states are kept, and
    followed on without noise for 100 periods: what still hits then has left. A path has left
    where it did so for `outside` seconds on end, from the first look of that stay on.
    """
    random, drive, steps = np.random.default_rng(8), 200.0 * math.pi, 48
    stiffness, damping, push = (0.1 * drive) ** 2, 0.02 * drive, 1e-4 * drive**2
    h = 2.0 * math.pi / drive / steps

    def flown(x: Vector, v: Vector, periods: int, noise: float, counted: int) -> Vector:
        hits = np.zeros(len(x))
        for number in range(steps * periods):
            kick = h * push * math.cos(2.0 * math.pi * (number % steps + 0.5) / steps)
            v += kick - h * (stiffness * x + damping * v)
            if noise:
                v += math.sqrt(noise * h) * random.normal(size=len(v))
            x += h * v
            (beyond,) = np.nonzero(np.abs(x) > 4e-4)
            ends = np.sign(x[beyond]) * 4e-4
            x[beyond], v[beyond] = 1.5 * ends - 0.5 * x[beyond], -0.5 * v[beyond]
            if number >= steps * (periods - counted):
                hits[beyond] += 1
        return hits

    swing = push / ((stiffness - drive**2) + 1j * damping * drive)
    x, v = np.full(paths, swing.real), np.full(paths, (1j * drive * swing).real)
    lives, since, look = np.zeros(paths), np.zeros(paths, np.int64), 0
    while not lives.all():
        (here,) = np.nonzero(lives == 0.0)
        kept = []
        for _ in range(8):
            flown(x, v, 5, intensity, 0)
            kept.append((x[here], v[here]))
        states = [np.concatenate(part) for part in zip(*kept, strict=True)]
        for away in flown(states[0], states[1], 100, 0.0, 20).reshape(8, -1) > 0:
            look += 1
            since[here[away & (since[here] == 0)]] = look
            since[here[~away]] = 0
            gone = away & (0.05 * (look - since[here]) > outside - 1e-9) & (lives[here] == 0.0)
            lives[here[gone]] = 0.05 * (since[here[gone]] - 0.5)
    return lives


@pytest.mark.slow
def test_a_short_life_is_that_of_paths_watched_until_all_have_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of these nothing is censored. A life time that counts the last seconds of those that stayed,
    in which a departure is not noted yet, is nearly twice as long where paths are watched for as
    long as that."""
    quiet = load_scene(shipped_scene("isolator-sine"))
    noisy = quiet.replace(excitations=(*quiet.excitations, WhiteNoise(intensity=0.03)))
    answer = lifetimes(noisy, [REST], rel_error=0.07, threads=1)
    (found,) = answer.regimes
    lives = own_lives(0.03, 192, answer.outside)
    assert found.life_time is not None
    error = math.hypot(lives.std() / math.sqrt(len(lives)), found.life_time / math.sqrt(found.left))
    difference = found.life_time - lives.mean()
    assert abs(difference) < 4.0 * error
    monkeypatch.setattr(module, "FORGOTTEN", 0)
    (brief,) = lifetimes(noisy, [REST], rel_error=0.07, threads=1).regimes
    stayed = (brief.paths - brief.left) * answer.outside
    assert (brief.watched + stayed) / brief.left - lives.mean() > 4.0 * error


def test_tabulated_noise_of_one_level_is_white(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that reaches far beyond the frequencies of the mount, of the same density."""
    monkeypatch.setattr(module, "FIRST_GROUPS", 1)  # several rounds, after each of which it tells
    table = TabulatedNoise(
        density=[2.0 * NOISE] * 2, frequency_hz=[0.5, 400.0], unit="N^2/Hz", on="x"
    )
    done: list[float] = []
    one, other = (
        lifetimes(
            mount(noise), [REST], rel_error=0.1, threads=1,
            progress=lambda share, _: done.append(share),
        ).regimes[0]
        for noise in (WhiteNoise(intensity=NOISE), table)
    )  # fmt: skip
    assert any(0.0 < share < 1.0 for share in done) and done[-1] == 1.0
    error = math.sqrt(1.0 / one.left + 1.0 / other.left)
    assert one.life_time is not None and other.life_time is not None
    assert abs(math.log(one.life_time / other.life_time)) < 4.0 * error


def test_more_noise_shortens_lives_and_a_seed_gives_the_same_digits() -> None:
    lives = [
        [each.life_time for each in lifetimes(mount(noise), [REST], rel_error=0.3).regimes]
        for noise in (WhiteNoise(intensity=NOISE), *[WhiteNoise(intensity=2.0 * NOISE)] * 2)
    ]
    assert sum(lives[1]) < sum(lives[0])
    assert lives[1] == lives[2]


def test_noise_that_mixes_regimes_is_warned_of() -> None:
    for factor, warned in ((1.0, False), (40.0, True)):
        found = lifetimes(mount(WhiteNoise(intensity=factor * NOISE)), [REST], rel_error=0.3)
        assert any("mixes the regime 'no impacts'" in each for each in found.warnings) == warned


def test_a_regime_that_outlasts_the_budget_has_a_lower_limit() -> None:
    quiet = mount(WhiteNoise(intensity=NOISE / 50.0))
    with pytest.raises(NotConverged, match="before enough paths had left") as ended:
        lifetimes(quiet, budget=1.5)
    for each in ended.value.partial.regimes:
        assert each.life_time is None and each.life_time_high is None and not each.destinations
    assert "longer than" in ended.value.partial.summary()


def test_what_has_no_life_time_is_refused_in_a_sentence() -> None:
    with pytest.raises(NotApplicable, match="noise besides the sine"):
        lifetimes(mount())
    pair = ImpactPair(clearance=1.0, law=Restitution(coefficient=0.5))
    wide = mount(WhiteNoise(intensity=NOISE)).model_copy(update={"impact_pairs": (pair,)})
    with pytest.raises(NotApplicable, match="several motions must coexist"):
        lifetimes(wide)
    with pytest.raises(ValueError, match="rel_error must be in"):
        lifetimes(mount(WhiteNoise(intensity=NOISE)), rel_error=0.0)
    with pytest.raises(ValueError, match="regimes must be some of 'no impacts'"):
        lifetimes(mount(WhiteNoise(intensity=NOISE)), ["rattle"])


def test_a_small_budget_is_not_spent_on_the_beginnings_of_many_paths() -> None:
    with pytest.raises(NotConverged) as ended:
        lifetimes(mount(WhiteNoise(intensity=NOISE)), [REST], rel_error=1e-3, budget=0.6, threads=1)
    asked = module.MORE_PATHS * 1e6
    assert 0 < ended.value.partial.cost.paths < 0.02 * asked


def test_groups_that_begin_later_live_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = mount(WhiteNoise(intensity=NOISE))
    (at_once,) = lifetimes(scene, [REST], rel_error=0.1, seed=1).regimes
    monkeypatch.setattr(module, "FIRST_GROUPS", 1)
    (in_turn,) = lifetimes(scene, [REST], rel_error=0.1, seed=2).regimes
    assert in_turn.left >= 100
    lives = [math.log(each.life_time) for each in (at_once, in_turn)]
    error = math.hypot(*(each.left**-0.5 for each in (at_once, in_turn)))
    assert abs(lives[0] - lives[1]) < 4.0 * error


@pytest.mark.slow
def test_regimes_hit_as_fast_as_in_a_simulation_of_the_sine_alone() -> None:
    with pytest.raises(NotConverged) as short:  # the clatter outlasts any budget
        lifetimes(mount(WhiteNoise(intensity=NOISE)), budget=3.0, threads=1)
    fastest = {each.regime: each.impact_speed_max for each in short.value.partial.regimes}
    seen = set()
    for start in (0.0, 0.25):
        flight = Bounces(mount(), steps=60)
        state, time, speeds = flight.start(np.zeros(1), np.array([start]), 0.0), 0.0, [0.0]
        end, period = 0.5, 2.0 * math.pi / DRIVE
        while (hit := flight.next_impact(state, end - time)) is not None:
            time += hit[0]
            if time > end - 2.0 * period:
                speeds.append(flight.speed(hit[2], hit[1]))
            state = flight.struck(hit[2], hit[1])
        seen.add(round(max(speeds), 3))
    assert len(seen) == 2
    assert {round(speed, 3) for speed in fastest.values()} == seen
