"""Life times in noise against a plain simulation that knows regimes by their impacts."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    growth,
    load_scene,
)
from stochvi.results.deadline import NEVER
from stochvi.results.estimates import poisson_interval
from stochvi.scenes import Modulation
from stochvi.scenes.datasets import shipped_scene
from stochvi.statistics import lifetimes
from stochvi.statistics.lifetimes import Survival
from stochvi.testing import assert_agrees
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


def test_more_noise_shortens_lives() -> None:
    quiet, loud = (
        lifetimes(mount(WhiteNoise(intensity=intensity)), [REST], rel_error=0.3).regimes[0]
        for intensity in (NOISE, 2.0 * NOISE)
    )
    assert loud.life_time < quiet.life_time


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


# ------------------------------------------------------------------------------
# Mean lives of paths that are not all watched to their ends, against lives that are known.
# ------------------------------------------------------------------------------


MEAN, FORGOTTEN = 40.0, 12
"""Mean life beyond the start, and the look after which it is forgotten."""


def lives(seed: int, paths: int, mean: float = MEAN) -> NDArray[np.float64]:
    """Lives in looks; nothing leaves in the first six, and a quarter as much up to the twelfth."""
    random = np.random.default_rng(seed)
    slow = random.exponential(4.0 * mean, paths)
    return 6.0 + np.where(slow < 6.0, slow, 6.0 + random.exponential(mean, paths))


def true_mean(mean: float = MEAN) -> float:
    slow = 4.0 * mean
    return 6.0 + slow * -math.expm1(-6.0 / slow) + math.exp(-6.0 / slow) * mean


def watched(life: NDArray[np.float64], looks: NDArray[np.int64]) -> Survival:
    """Paths that are watched for so many looks each."""
    noted = np.ceil(life).astype(np.int64)
    return Survival.of(np.minimum(noted, looks), noted <= looks)


def test_the_known_mean_is_that_of_lives() -> None:
    many = lives(0, 10**6)
    assert abs(many.mean() - true_mean()) < 4.0 * many.std() / 1e3


@pytest.mark.parametrize(
    ("mean", "paths", "shortest", "longest"),
    [(MEAN, 300, 16, 30), (MEAN, 60, 13, 100), (3.0, 100, 40, 60), (400.0, 2000, 16, 20)],
)
def test_intervals_hold_as_often_as_they_say(
    mean: float, paths: int, shortest: int, longest: int
) -> None:
    """Of paths watched for a part of their lives, of others, and to their ends; the negative
    control takes seconds per departure."""
    truth, held, plain, runs = true_mean(mean), 0, 0, 400
    for seed in range(runs):
        random = np.random.default_rng(seed + 10**6)
        seen = watched(lives(seed, paths, mean), random.integers(shortest, longest, paths))
        found = seen.mean_life(FORGOTTEN)
        held += found.lower <= truth <= found.upper
        slow, fast = poisson_interval(int(seen.departures.sum()), seen.watched)
        plain += 1.0 / fast <= truth <= 1.0 / slow
    spread = math.sqrt(0.05 * 0.95 / runs)
    assert 0.95 - 4.0 * spread < held / runs < 0.99
    if paths >= 300:
        assert plain / runs < 0.95 - 8.0 * spread


def test_lives_that_all_end_have_the_mean_and_error_of_their_ends() -> None:
    life = np.ceil(lives(1, 200, 3.0))
    found = watched(life, np.full(200, 10**4)).mean_life(FORGOTTEN)
    early = watched(life, np.full(200, 10**4)).mean_life(10**4)
    assert early.value == pytest.approx(life.mean() - 0.5, rel=1e-12)
    assert early.error == pytest.approx(life.std() / math.sqrt(200), rel=1e-9)
    assert abs(found.value - early.value) < early.error


def test_where_none_leaves_late_there_is_a_lower_limit_alone() -> None:
    ends = np.full(50, 30)
    none = Survival.of(ends, np.zeros(50, bool)).mean_life(FORGOTTEN)
    assert math.isnan(none.value) and none.upper == math.inf
    fast = poisson_interval(0, 50.0 * 18.0)[1]
    assert none.lower == pytest.approx(FORGOTTEN + 1.0 / fast)
    brief = Survival.of(np.full(50, 7), np.arange(50) < 5).mean_life(FORGOTTEN)
    assert math.isnan(brief.value) and 6.0 < brief.lower < 7.0
    assert Survival.of(np.zeros(3, int), np.zeros(3, bool)).mean_life(5).lower == 0.0


# ------------------------------------------------------------------------------
# Lyapunov exponents and growth of moments against closed forms.
# ------------------------------------------------------------------------------


M, B, W = 2.0, 0.3, 2.0


def scene_of(*modulations: Modulation, **more: Any) -> Scene:
    return Scene(
        structure=Oscillator(mass=M, damping=M * B, stiffness=M * W**2),
        excitations=[*more.pop("excitations", []), *modulations],
        **more,
    )


def exponent(intensity: float, b: float = B, w: float = W) -> float:
    """The Lyapunov exponent of x'' + b x' + w^2 (1 + xi) x = 0 with white xi, in closed form.

    z = y' / y of y = x exp(b t / 2) follows z' = -(g + z^2) + w^2 xi, g = w^2 - b^2 / 4, with a
    stationary flux to minus infinity; with D = w^4 S / 2 its mean is half the ratio of the
    integrals of sqrt(u) and 1 / sqrt(u) times exp(-(g u + u^3 / 12) / D) (Halperin; Imkeller and
    Lederer).
    """
    g, d = w**2 - b**2 / 4.0, w**4 * intensity / 2.0

    def integral(power: float) -> float:
        # u = s^2 takes the root at 0 away
        return quad(
            lambda s: 2.0 * s ** (2.0 * power + 1.0) * math.exp(-(g * s**2 + s**6 / 12.0) / d),
            0.0, math.inf,
        )[0]  # fmt: skip

    return -b / 2.0 + 0.5 * integral(0.5) / integral(-0.5)


@pytest.mark.parametrize("intensity", [0.05, 0.4, 2.0])
def test_white_noise_on_a_spring_has_the_exponent_of_its_closed_form(intensity: float) -> None:
    found = growth(scene_of(Modulation(of="stiffness", intensity=intensity)), seed=3)
    known = exponent(intensity)
    assert_agrees(found.lyapunov_exponent, known)
    if intensity == 0.05:  # weak: -b / 2 + w^2 S / 8
        assert known == pytest.approx(-B / 2.0 + W**2 * intensity / 8.0, abs=3e-4)
    with pytest.raises(AssertionError):  # noise of half the intensity
        assert_agrees(found.lyapunov_exponent, exponent(0.5 * intensity))
    squares = found.mean_square_growth
    assert squares is not None and squares.value >= 2.0 * known


def test_white_noise_on_a_damper_is_that_of_stratonovich() -> None:
    """Weak noise: -b / 2 + b^2 S / 8; by Ito it were -b / 2 - b^2 S / 8."""
    intensity = 0.8
    found = growth(scene_of(Modulation(of="damping", intensity=intensity)), seed=3)
    shift = B**2 * intensity / 8.0
    assert found.lyapunov_exponent.value == pytest.approx(-B / 2.0 + shift, abs=0.4 * shift)


def test_noise_of_a_wide_band_has_the_exponent_of_white_noise() -> None:
    filtered = Modulation(of="stiffness", intensity=0.4, frequency_hz=12.0, zeta=0.7)
    found = growth(scene_of(filtered), rel_error=0.03, seed=3).lyapunov_exponent
    assert found.value == pytest.approx(exponent(0.4), abs=4.5 * found.standard_error + 0.01)


def test_slow_noise_has_the_exponent_of_a_plain_twin() -> None:
    """500 paths of filtered noise by steps of kick, way, kick in numpy, scaled at each step."""
    slow = Modulation(of="stiffness", intensity=0.15, frequency_hz=0.6, zeta=0.2)
    found = growth(scene_of(slow), seed=3).lyapunov_exponent
    assert slow.filter is not None
    omega, rate, intensity = slow.filter
    generator, h, paths = np.random.default_rng(5), 0.01, 400
    x, v = generator.standard_normal((2, paths))
    f, g = math.sqrt(slow.size**2) * generator.standard_normal((2, paths))
    total, counted = np.zeros(paths), 0.0
    for k in range(12_000):
        kick = omega * math.sqrt(intensity * h) * generator.standard_normal(paths)
        f = f + 0.5 * h * omega * g
        g = (g - h * omega * f) * math.exp(-rate * h) + kick
        f = f + 0.5 * h * omega * g
        v = v * math.exp(-0.5 * B * h) - 0.5 * h * W**2 * (1.0 + f) * x
        x = x + h * v
        v = (v - 0.5 * h * W**2 * (1.0 + f) * x) * math.exp(-0.5 * B * h)
        if k % 100 == 99:
            size = np.hypot(W * x, v)
            x, v = x / size, v / size
            if k >= 2000:
                total += np.log(size)
                counted += 100.0 * h
    rates = total / counted
    error = math.hypot(float(rates.std()) / 20.0, found.standard_error)
    assert found.value == pytest.approx(float(rates.mean()), abs=4.5 * error + 0.004)
    assert found.value > -B / 2.0 + 9.0 * error


def test_sines_have_the_multipliers_of_floquet() -> None:
    """No number is drawn, and the result is that of twice the squares."""
    found = growth(scene_of(Modulation(of="stiffness", amplitude=0.5, frequency_hz=2.0 / math.pi)))
    assert found.lyapunov_exponent.standard_error == 0.0 and found.cost.steps == 0
    assert found.lyapunov_exponent.value == pytest.approx(0.5 * W / 4.0 - B / 2.0, abs=0.02)
    assert found.mean_square_growth is not None
    assert found.mean_square_growth.value == pytest.approx(2.0 * found.lyapunov_exponent.value)
    assert found.summary().startswith("unstable: almost every motion grows")
    assert judges.columns_without_judge(found) == []


def test_stops_and_other_noise_do_not_count() -> None:
    """Stability is that of rest, also where the scene has more."""
    white = Modulation(of="stiffness", intensity=0.1)
    alone = growth(scene_of(white), rel_error=0.1, seed=3)
    more = scene_of(
        white, excitations=[WhiteNoise(intensity=0.4)],
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
    )  # fmt: skip
    assert growth(more, rel_error=0.1, seed=3).lyapunov_exponent == alone.lyapunov_exponent


def test_a_spring_between_coordinates() -> None:
    """Two equal masses: the spring between them acts on their difference alone, which then is one
    oscillator."""
    k, c, between = 3.0, 0.3, 0.5
    damping = [[c, 0.0], [0.0, c]]
    two = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 1.0]], damping=damping,
            stiffness=[[k + between, -between], [-between, k + between]],
        ),
        excitations=[Modulation(of="stiffness", intensity=3.2, between=("a", "b"))],
    )  # fmt: skip
    w2 = k + 2.0 * between
    share = 2.0 * between / w2
    found = growth(two, seed=1)
    known = exponent(3.2 * share**2, c, math.sqrt(w2))
    assert_agrees(found.lyapunov_exponent, known)
    assert found.summary().startswith("stable, but mean squares grow")


def test_without_damping_noise_excites_all_the_same() -> None:
    free = Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=4.0),
        excitations=[Modulation(of="stiffness", intensity=0.05)],
    )
    assert_agrees(growth(free, seed=1).lyapunov_exponent, exponent(0.05, 0.0))


def test_what_is_not_modulated_is_refused() -> None:
    with pytest.raises(NotApplicable, match="excitation must modulate stiffness or damping"):
        growth(scene_of(excitations=[WhiteNoise(intensity=1.0)]))
    spring = {"kind": "duffing", "cubic_stiffness": 1.0}
    structure = Oscillator(mass=1.0, damping=0.1, stiffness=1.0, spring=spring)
    scene = Scene(structure=structure, excitations=[Modulation(of="stiffness", intensity=0.1)])
    with pytest.raises(NotApplicable, match="spring must be linear, got kind 'duffing'"):
        growth(scene)


def test_the_boundary_of_mean_squares_is_answered() -> None:
    """Mean squares neither grow nor decay where w^2 S = 2 b, yet almost every motion decays."""
    intensity = 2.0 * B / W**2
    found = growth(scene_of(Modulation(of="stiffness", intensity=intensity)), seed=3)
    squares = found.mean_square_growth
    assert squares is not None and abs(squares.value) < 1e-9
    assert_agrees(found.lyapunov_exponent, exponent(intensity))
