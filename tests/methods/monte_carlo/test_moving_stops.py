"""Stops that move: an integrator with events and a plain twin judge them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    WhiteNoise,
    damage,
    exact,
    explain,
    fokker_planck,
    history,
    linearise,
    reliability,
    screen,
    simulate,
    size,
)
from stochvi.isolators import bumper_map
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.model.model import model_of
from stochvi.scenes import Modulation, Sine
from stochvi.testing import assert_agrees

M, B, W, R = 2.0, 0.3, 2.0, 0.7
STOPS = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=R))]
SWING = Modulation(of="clearance", amplitude=0.2, frequency_hz=0.5)


def scene_of(*excitations: Any, pairs: Any = STOPS) -> Scene:
    return Scene(
        structure=Oscillator(mass=M, damping=M * B, stiffness=M * W**2),
        impact_pairs=pairs, excitations=excitations,
    )  # fmt: skip


def test_a_path_between_moving_stops_is_that_of_its_equation() -> None:
    """Under sines alone every step is exact: x meets c (1 + xi), and w' = c xi' - R (w - c xi')."""
    end, push, rate, swing = 12.0, 4.0 / M, 2.0 * math.pi * 0.35, 2.0 * math.pi * 0.5
    scene = scene_of(Sine(amplitude=4.0, frequency_hz=0.35), SWING)
    plan = make_plan(model_of(scene), None, end)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(3), 0, streams)
    x, v, *waves = plan.start(streams)[:, 0]
    x, v = np.array([x, v]) * plan.modes.shapes[0, 0]
    first, second = math.atan2(-waves[1], waves[0]), math.atan2(-waves[3], waves[2])

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], push * math.cos(rate * t + first) - B * y[1] - W**2 * y[0]]

    def stop(place: float) -> Any:
        def gap(t: float, y: np.ndarray) -> float:
            return y[0] - place * (1.0 + 0.2 * math.cos(swing * t + second))

        gap.terminal, gap.direction = True, math.copysign(1.0, place)
        return gap

    stops, times = [stop(1.0), stop(-0.8)], end * np.arange(1, 241) / 240
    t, y, known, speeds = 0.0, [x, v], np.zeros(240), []
    while t < end:
        solved = solve_ivp(
            rates, (t, end), y, events=stops, rtol=1e-10, atol=1e-12, dense_output=True
        )
        inside = (times > t) & (times <= solved.t[-1])
        known[inside] = solved.sol(times[inside])[0]
        t, (x, v) = float(solved.t[-1]), solved.y[:, -1]
        place = 1.0 if len(solved.t_events[0]) else -0.8
        moving = -place * 0.2 * swing * math.sin(swing * t + second)
        y = [x, moving - R * (v - moving)]
        if t < end:
            speeds.append(abs(v - moving))
    plan = replace(plan.with_step(end / 480), duration=end)
    record = np.zeros((plan.steps, 1, plan.record_width))
    plan.averages(3, 0, 1, record)
    columns = plan.columns(record)
    assert columns["displacement of x"][1::2] == pytest.approx(known, abs=1e-5)
    found = [columns[f"impact_speed of stops {side}"] for side in ("lower", "upper")]
    hits = np.abs(np.sum(found, axis=0))
    assert hits[hits > 0.0] == pytest.approx(speeds, abs=1e-4)
    assert len(speeds) > 5


def plain_twin(relative: Any, paths: int, duration: float, h: float) -> np.ndarray:
    """Mean squares of displacement and velocity and impact rates at the lower and the upper stop of
    each path in white noise of 4 N^2 s, by small steps in numpy: an integrator that shares
    nothing with the engine."""
    generator = np.random.default_rng(8)
    x, v = 0.3 * generator.standard_normal((2, paths)).clip(-2.0, 2.0)
    sums, counted = np.zeros((4, paths)), 0
    signal, state = relative(generator, paths, h)
    change, rate = state
    for k in range(round(duration / h)):
        v = v * math.exp(-B * h) - h * W**2 * x
        v = v + math.sqrt(4.0 * h) / M * generator.standard_normal(paths)
        x = x + h * v
        change, rate = signal(k, change, rate)
        for row, place in ((2, -0.8), (3, 1.0)):
            side = math.copysign(1.0, place)
            beyond, closing = side * (x - place * (1.0 + change)), side * (v - place * rate)
            hit = (beyond > 0.0) & (closing > 0.0)
            x = np.where(hit, x - side * (1.0 + R) * beyond, x)
            v = np.where(hit, v - side * (1.0 + R) * closing, v)
            if k * h > 20.0:
                sums[row] += hit / h
        if k * h > 20.0:
            sums[:2] += x**2, v**2
            counted += 1
    return sums / counted


def swinging(generator: Any, paths: int, h: float) -> Any:
    """The sine of `SWING`."""
    omega, phase = 2.0 * math.pi * 0.5, 2.0 * math.pi * generator.random(paths)

    def signal(k: int, change: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = omega * (k + 1) * h + phase
        return 0.2 * np.cos(angle), -0.2 * omega * np.sin(angle)

    return signal, (np.zeros(paths), np.zeros(paths))


FILTERED = Modulation(of="clearance", intensity=0.01, frequency_hz=0.5, zeta=0.3)


def filtered(generator: Any, paths: int, h: float) -> Any:
    """The noise of `FILTERED`, by small steps."""
    assert FILTERED.filter is not None
    omega, decay, intensity = FILTERED.filter
    size = math.sqrt(omega**2 * intensity / (2.0 * decay))

    def signal(k: int, change: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        kick = omega**2 * math.sqrt(intensity * h) * generator.standard_normal(paths)
        rate = rate - h * (omega**2 * change + decay * rate) + kick
        return change + h * rate, rate

    start = size * generator.standard_normal((2, paths)).clip(-2.5, 2.5)
    return signal, (start[0], omega * start[1])


@pytest.mark.parametrize(
    ("modulation", "relative"),
    [(SWING, swinging), pytest.param(FILTERED, filtered, marks=pytest.mark.verify)],
    ids=["sine", "filtered"],
)
def test_moving_stops_are_hit_as_by_a_plain_twin(modulation: Modulation, relative: Any) -> None:
    scene = scene_of(WhiteNoise(intensity=4.0), modulation)
    found = simulate(scene, paths=512, duration=80.0, seed=4)
    assert_agrees(found.identities["force"], 0.0)
    twins = [plain_twin(relative, 256, 100.0, h) for h in (0.005, 0.01)]
    wanted = [
        found.coordinates["x"]["displacement_mean_square"],
        found.coordinates["x"]["velocity_mean_square"],
        found.impact_pairs["stops lower"]["collision_rate"],
        found.impact_pairs["stops upper"]["collision_rate"],
    ]
    for estimate, fine, double in zip(wanted, *twins, strict=True):
        error = math.hypot(float(fine.std()) / 16.0, estimate.standard_error)
        bias = (estimate.bias or 0.0) + abs(double.mean() - fine.mean()) + fine.std() / 16.0
        away = Estimate(value=estimate.value - fine.mean(), standard_error=error, bias=bias)
        assert_agrees(away, 0.0)


def test_still_stops_are_hit_less() -> None:
    """The negative control: the same stops that stand still."""
    noise = WhiteNoise(intensity=2.0)
    moving = simulate(scene_of(noise, SWING), paths=1024, duration=80.0, seed=1)
    still = simulate(scene_of(noise), paths=1024, duration=80.0, seed=2)
    more = moving.impact_pairs["stops upper"]["collision_rate"]
    less = still.impact_pairs["stops"]["collision_rate_upper"]
    error = math.hypot(more.standard_error, less.standard_error)
    assert more.value - less.value > 4.5 * error


def test_one_stop_keeps_its_name_and_records_say_its_impacts() -> None:
    pair = ImpactPair(name="bumper", upper=0.5, law=Restitution(coefficient=0.7))
    scene = scene_of(WhiteNoise(intensity=4.0), SWING, pairs=[pair])
    assert list(simulate(scene, paths=8, duration=5.0).impact_pairs) == ["bumper"]
    assert history(scene, duration=20.0, seed=1).impact_pairs["bumper"].hits > 0


@pytest.mark.parametrize(
    ("excitations", "pairs", "sentence"),
    [
        ([SWING], [], "must be on the name of an impact pair"),
        ([SWING.replace(on="else")], STOPS, "must be on the name of an impact pair, 'stops', got"),
        (
            [SWING], [ImpactPair(upper=1.0, law=Elastic(stiffness=50.0))],
            "moves rigid stops only, got 'elastic' at the upper of stops",
        ),
        (
            [SWING], [STOPS[0], STOPS[0].replace(name="more")],
            "needs on = 'stops' or 'more' to say which clearance changes, got none",
        ),
        (
            [SWING, TabulatedNoise(frequency_hz=[0.1, 1.0], density=[1.0, 1.0], unit="N2/Hz")],
            STOPS, "takes white and filtered noise and sines beside it, got a density",
        ),
    ],
)  # fmt: skip
def test_faults_are_named(excitations: Any, pairs: Any, sentence: str) -> None:
    with pytest.raises(SceneError) as error:
        scene_of(WhiteNoise(intensity=4.0), *excitations, pairs=pairs)
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    "keys", [{"intensity": 0.1}, {"amplitude": 0.5, "frequency_hz": 1.0}], ids=["white", "wide"]
)
def test_a_clearance_stays_above_zero(keys: dict[str, float]) -> None:
    with pytest.raises(SceneError, match=r"a standard deviation of at most 0\.2 for a clearance"):
        Modulation(of="clearance", **keys)


@pytest.mark.parametrize(
    "calculation",
    [
        exact, fokker_planck, linearise, screen, bumper_map,
        lambda scene: damage(scene, mission=10.0),
        lambda scene: reliability(scene, mission=10.0),
        lambda scene: size(scene, probability=0.01, mission=10.0),
    ],
)  # fmt: skip
def test_other_methods_refuse_moving_stops(calculation: Any) -> None:
    pair = ImpactPair(upper=0.5, law=Restitution(coefficient=1.0))
    scene = scene_of(WhiteNoise(intensity=4.0), SWING, pairs=[pair])
    with pytest.raises(NotApplicable, match="must have stops that stand still"):
        calculation(scene)
    assert explain(scene).methods["simulate"] == "applies"
