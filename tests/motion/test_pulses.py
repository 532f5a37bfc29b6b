"""Pulses at random times, and drives of one's own: theorems, plain twins and exact laws judge."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import brentq

from stochvi import (
    ForceFunction,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    Statistic,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    check,
    damage,
    exact,
    explain,
    growth,
    history,
    impacts,
    linearise,
    replay,
    screen,
    simulate,
    spectrum,
)
from stochvi.mathematics.numerics import gauss_panels
from stochvi.mathematics.unsteady_noise import SHAPES, PulseShape
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, plan_histories
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.scenes import CrossDensity, DriveFunction, Modulation, Pulses, RecordedNoise
from stochvi.testing import assert_agrees
from support import naive
from support.accuracies import assert_balanced, assert_differs, assert_same
from support.records import shock_shape
from support.refusals import OTHER_METHODS, refusals

M, B, W = 2.0, 0.3, 2.0
MASS: dict[str, float] = {"mass": M, "damping": M * B, "stiffness": M * W**2}
STOPS = [ImpactPair(lower=-0.3, upper=0.2, law=Restitution(coefficient=0.7))]
QUANTITIES = ("displacement_mean_square", "velocity_mean_square")


def scene_of(*excitations: Any, pairs: Any = (), **keys: Any) -> Scene:
    return Scene(
        structure=Oscillator(**MASS | keys), impact_pairs=list(pairs), excitations=excitations
    )


def kick(t: float) -> float:
    """Displacement after a unit impulse, m."""
    wave = math.sqrt(W**2 - B**2 / 4.0)
    return math.exp(-B * t / 2.0) * math.sin(wave * t) / (M * wave)


def speed(t: float) -> float:
    """Velocity after a unit impulse, m/s."""
    wave = math.sqrt(W**2 - B**2 / 4.0)
    turned = math.cos(wave * t) - B / (2.0 * wave) * math.sin(wave * t)
    return math.exp(-B * t / 2.0) * turned / M


def campbell(pulses: Pulses, response: Callable[[float], float]) -> list[float]:
    """Raw moments of the orders 1 to 4, from the cumulants rate E J^n int h^n dt."""
    k = []
    for n in (1, 2, 3, 4):
        times, weights = gauss_panels(np.linspace(0.0, 120.0, 601), 8)
        whole = weights @ np.array([response(t) ** n for t in times])
        k.append(pulses.rate * pulses.moment(n) * float(whole))
    return [
        k[0], k[1] + k[0] ** 2, k[2] + 3.0 * k[1] * k[0] + k[0] ** 3,
        k[3] + 4.0 * k[2] * k[0] + 3.0 * k[1] ** 2 + 6.0 * k[1] * k[0] ** 2 + k[0] ** 4,
    ]  # fmt: skip


def x_third(x: float, v: float) -> float:
    return x**3


def x_fourth(x: float, v: float) -> float:
    return x**4


def v_third(x: float, v: float) -> float:
    return v**3


def v_fourth(x: float, v: float) -> float:
    return v**4


MOMENTS = {
    each.__name__: Statistic(function=each) for each in (x_third, x_fourth, v_third, v_fourth)
}


@pytest.mark.parametrize("sizes", ["equal", "normal", "exponential"])
@pytest.mark.parametrize("two_sided", [True, False])
def test_a_linear_response_has_the_moments_of_campbell(sizes: Any, two_sided: bool) -> None:
    """Mean, variance, skewness and kurtosis; those of a Gaussian motion are far away."""
    pulses = Pulses(rate=0.7, impulse=0.5, sizes=sizes, two_sided=two_sided)
    found = simulate(scene_of(pulses), statistics=MOMENTS, paths=1024, duration=200.0, seed=5)
    x = found.coordinates["x"]
    for name, response, words in (("x", kick, "displacement"), ("v", speed, "velocity")):
        first, second, third, fourth = campbell(pulses, response)
        assert_agrees(x[f"{words}_mean_square"], second)
        assert_agrees(found.statistics[f"{name}_third"], third)
        assert_agrees(found.statistics[f"{name}_fourth"], fourth)
        if name == "x":
            assert_agrees(x["displacement_mean"], first)
        variance = second - first**2
        gaussian = 3.0 * variance**2 + 6.0 * variance * first**2 + first**4
        assert_differs(found.statistics[f"{name}_fourth"], gaussian)
    assert_balanced(found)


def drawn(pulses: Pulses, word: int, half_step: int, h: float) -> float:
    """The sum of the pulses of half a step, as a user of the random numbers would write it."""
    own = (word + (half_step & 0xFFFFFFFF) * 0x9E3779B97F4A7C15) & naive.MASK
    u, count, chance = naive.uniform(own, 1 << 41), 0, math.exp(-pulses.rate * h)
    below = chance
    while u > below:
        count += 1
        chance *= pulses.rate * h / count
        below += chance
    total = 0.0
    for k in range(count):
        first, second = (naive.uniform(own, (1 << 41) + 2 * k + each) for each in (1, 2))
        sizes = {
            "equal": 1.0, "exponential": -math.log(first),
            "normal": math.sqrt(-2.0 * math.log(first)) * abs(math.cos(2.0 * math.pi * second)),
        }  # fmt: skip
        negative = pulses.two_sided and second > 0.5
        total += pulses.impulse * sizes[pulses.sizes] * (-1.0 if negative else 1.0)
    return total


@pytest.mark.parametrize("sizes", ["equal", "normal", "exponential"])
@pytest.mark.parametrize("merged", [False, True])
def test_a_path_is_that_of_its_plain_twin(sizes: Any, merged: bool) -> None:
    """Half of the pulses of a step before the exact motion and half after it. Twice the step meets
    the pulses of both steps."""
    pulses = Pulses(rate=3.0, impulse=0.5, sizes=sizes, two_sided=sizes == "normal")
    plan = make_plan(model_of(scene_of(pulses)), None, 30.0)
    plan = plan.coarser() if merged else plan
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(4), 2, streams)
    shape, h = float(plan.modes.shapes[0, 0]), plan.step
    x, v = plan.start(streams)[:2, 0] * shape
    rest = pulses.mean / (M * W**2)
    x += rest
    moved = expm(np.array([[0.0, 1.0], [-(W**2), -B]]) * h)
    words = naive.words_of_pairs(4, 2, 1000)
    known, met = [], 0.0
    for number in range(plan.steps):
        pair, half = (number, 0) if merged else divmod(number, 2)
        word = words[1 + pair]  # the first pair of normals made the start
        first = 4 * pair + 2 * half
        halves = [(first, first + 1), (first + 2, first + 3)] if merged else [[first], [first + 1]]
        share = h / 4.0 if merged else h / 2.0
        before, after = (sum(drawn(pulses, word, k, share) for k in each) for each in halves)
        v += before / M - pulses.mean * h / (2.0 * M)
        x, v = moved @ [x - rest, v] + [rest, 0.0]
        v += after / M - pulses.mean * h / (2.0 * M)
        known.append(x)
        met += abs(before) + abs(after)
    found = plan.record(4, 2)["displacement"]
    assert met > 10.0 * pulses.impulse
    np.testing.assert_allclose(found, known, atol=1e-12)


def test_twice_the_step_meets_the_same_pulses() -> None:
    """The difference that tells the bias of the step has far less noise than two runs have."""
    plan = make_plan(model_of(scene_of(Pulses(rate=0.7, impulse=0.5))), None, 60.0)
    fine, coarse = plan.averages(3, 0, 256)[1], plan.coarser().averages(3, 0, 256)[1]
    others = plan.averages(4, 0, 256)[1]
    assert (coarse - fine).std() < 0.3 * (others - fine).std()


def test_the_step_has_the_second_order() -> None:
    """Half of the pulses at either end of a step are the trapezoidal rule of Campbell's integral:
    the mean square velocity errs by b^2 h^2 / 3 + b^2 h^4 (10 W^2 - 8 b^2) / 360 + ..."""
    b, pulses = 1.2, Pulses(rate=0.7, impulse=0.5, sizes="exponential")
    plan = make_plan(model_of(scene_of(pulses, damping=M * b)), None, 200.0)
    known = pulses.si_intensity / M**2 / (2.0 * b)
    errors = []
    for h in (0.3, 0.6):
        rows = plan.with_step(h).averages(1, 0, 1024)[2] / known - 1.0
        errors.append((rows.mean(), rows.std() / math.sqrt(1024.0)))
    (fine, fine_error), (coarse, coarse_error) = errors
    assert coarse > 9.0 * coarse_error  # there is a bias to fall
    second, fourth = b**2 * 0.6**2 / 3.0, b**2 * 0.6**4 * (10.0 * W**2 - 8.0 * b**2) / 360.0
    assert abs(coarse - second - fourth) < 4.5 * coarse_error + fourth / 2.0
    allowed = 4.5 * math.hypot(fine_error, coarse_error / 4.0) + abs(coarse / 8.0)
    assert abs(fine - coarse / 4.0) <= allowed


def events(pulses: Pulses, duration: float, generator: Any) -> np.ndarray:
    """A motion between the stops, from pulse to pulse and from impact to impact: time integrals of
    x, x^2 and v^2, and the number of impacts, over `duration`."""
    wave, t, x, v = math.sqrt(W**2 - B**2 / 4.0), 0.0, 0.0, 0.0
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = np.zeros(4)

    def at(s: Any) -> tuple[Any, Any]:
        fade, slope = np.exp(-B * s / 2.0), (v + B * x / 2.0) / wave
        c, d = np.cos(wave * s), np.sin(wave * s)
        return fade * (x * c + slope * d), fade * (
            (slope * wave - B * x / 2.0) * c - (x * wave + B * slope / 2.0) * d
        )

    while t < duration:
        left = generator.exponential(1.0 / pulses.rate)
        while left > 0.0:
            s = np.linspace(0.0, min(left, 0.4), 33)
            places, _ = at(s)
            out = np.flatnonzero((places[1:] > 0.2) | (places[1:] < -0.3))
            end, struck = float(s[-1]), False
            if len(out):
                k = int(out[0])
                place = 0.2 if places[k + 1] > 0.2 else -0.3
                low = float(s[k]) if (places[k] - place) * (places[k + 1] - place) < 0.0 else 1e-13
                end = brentq(lambda one, place=place: float(at(one)[0]) - place, low, s[k + 1])
                struck = True
            y, w = at(end / 2.0 * (nodes + 1.0))
            part = weights * end / 2.0
            total += [part @ y, part @ y**2, part @ w**2, float(struck)]
            x, v = (float(each) for each in at(end))
            if struck:
                x, v = place, -0.7 * v
            t, left = t + end, left - end
        size = pulses.impulse * generator.exponential()
        v += size / M * (generator.choice([-1.0, 1.0]) if pulses.two_sided else 1.0)
    return total / t


def test_stops_and_pulses_are_those_of_an_integrator_by_events() -> None:
    """The test's own integrator knows neither steps nor the engine's random numbers."""
    pulses = Pulses(rate=1.5, impulse=0.4, sizes="exponential", two_sided=False)
    found = simulate(scene_of(pulses, pairs=STOPS), paths=1024, duration=100.0, seed=1)
    generator = np.random.default_rng(7)
    batches = np.array([events(pulses, 60.0, generator) for _ in range(48)])
    known, error = batches.mean(axis=0), batches.std(axis=0) / math.sqrt(47.0)
    x = found.coordinates["x"]
    names = [x["displacement_mean"], *(x[name] for name in QUANTITIES)]
    names.append(found.impact_pairs["stops"]["collision_rate"])
    for estimate, value, its in zip(names, known, error, strict=True):
        both = math.hypot(estimate.standard_error, its)
        assert_agrees(replace(estimate, standard_error=both), float(value))
    white = simulate(  # noise of the same mean and intensity is another motion
        Scene(
            structure=Oscillator(**MASS), impact_pairs=STOPS,
            excitations=[
                WhiteNoise(intensity=pulses.si_intensity),
                {"kind": "constant", "force": pulses.mean},
            ],
        ), paths=1024, duration=100.0, seed=1,
    )  # fmt: skip
    rate = white.impact_pairs["stops"]["collision_rate"]
    assert_differs(replace(rate, standard_error=math.hypot(rate.standard_error, error[3])),
                      float(known[3]))  # fmt: skip


@pytest.mark.slow
def test_many_small_pulses_are_white_noise() -> None:
    """Between elastic stops the exact law of white noise holds, and the spectrum is that of it."""
    intensity, rate = 0.6, 300.0
    pulses = Pulses(rate=rate, impulse=math.sqrt(intensity / rate), sizes="normal")
    elastic = [ImpactPair(lower=-0.3, upper=0.2, law=Restitution(coefficient=1.0))]
    known = exact(scene_of(WhiteNoise(intensity=intensity), pairs=elastic))
    found = simulate(scene_of(pulses, pairs=elastic), paths=256, duration=100.0, seed=2)
    for name in ("collision_rate", "impact_speed_square_rate"):
        assert_agrees(found.impact_pairs["stops"][name], known.impact_pairs["stops"][name].value)
    for name in QUANTITIES:
        assert_agrees(found.coordinates["x"][name], known.coordinates["x"][name].value)
    curve = spectrum(scene_of(pulses), rel_error=0.05, seed=1).curves["x"]["displacement"]
    omega = 2.0 * math.pi * curve.frequency_hz
    shape = 1.0 / ((W**2 - omega**2) ** 2 + (B * omega) ** 2)
    near = (omega > 0.5 * W) & (omega < 1.5 * W)
    ratio = (curve.value / (2.0 * intensity / M**2 * shape))[near]
    assert abs(ratio.mean() - 1.0) < 4.5 * 0.05 / math.sqrt(near.sum()) + 0.01


CHAIN: dict[str, Any] = {
    "coordinates": ["a", "b"], "mass": [[1.0, 0.0], [0.0, 2.0]],
    "damping": [[0.5, -0.2], [-0.2, 0.4]], "stiffness": [[30.0, -10.0], [-10.0, 20.0]],
}  # fmt: skip


@pytest.mark.parametrize(
    ("place", "row"),
    [
        ({"on": "b"}, (0.0, 1.0)), ({"between": ("a", "b")}, (1.0, -1.0)),
        ({"weights": {"a": 0.5, "b": 2.0}}, (0.5, 2.0)), ({"on": "base"}, (-1.0, -2.0)),
    ],
)  # fmt: skip
def test_pulses_act_on_any_coordinates_and_on_the_base(place: Any, row: Any) -> None:
    """Means and mean squares of a linear structure are those of white noise: Lyapunov's equation
    judges `linearise`, and both `simulate`."""
    pulses = Pulses(rate=2.0, impulse=0.3, sizes="normal", two_sided=False, **place)
    scene = Scene(structure=Matrices(**CHAIN), excitations=[pulses])
    mass, damping, stiffness = (np.array(CHAIN[name]) for name in ("mass", "damping", "stiffness"))
    inverse, force = np.linalg.inv(mass), np.array(row)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    g = np.concatenate([np.zeros(2), inverse @ force])
    noise = pulses.rate * 0.3**2 * np.outer(g, g)
    covariance = solve_continuous_lyapunov(a, -noise)
    mean = np.linalg.solve(stiffness, force) * pulses.rate * 0.3 * math.sqrt(2.0 / math.pi)
    linear, found = linearise(scene), simulate(scene, paths=512, duration=60.0, seed=3)
    for k, name in enumerate(CHAIN["coordinates"]):
        known = {
            "displacement_mean": mean[k],
            "displacement_mean_square": covariance[k, k] + mean[k] ** 2,
            "velocity_mean_square": covariance[2 + k, 2 + k],
        }
        for quantity, value in known.items():
            assert linear.coordinates[name][quantity].value == pytest.approx(value, rel=1e-9)
            assert_agrees(found.coordinates[name][quantity], value)
    assert any("under pulses" in each for each in linear.assumptions)
    assert_balanced(found)


def test_accelerations_of_a_mass_on_a_base_with_pulses_are_known() -> None:
    """The absolute acceleration is what spring and damper give: W^2 x + B v."""
    pulses = Pulses(rate=2.0, impulse=0.3)
    scene = Scene(structure=Isolator(**MASS), excitations=[pulses])
    found = simulate(scene, paths=256, duration=100.0, seed=3).coordinates["x"]
    square = 2.0 * 0.3**2 / (2.0 * B)  # E v^2 = W^2 E x^2
    acceleration = math.sqrt(W**2 * square + B**2 * square)
    assert_agrees(found["acceleration_std"], acceleration)
    assert "acceleration_m_s2" in history(scene, duration=5.0, seed=1).to_frame()
    on_mass = scene_of(pulses)
    assert simulate(on_mass, paths=8, duration=5.0).coordinates["x"].get("acceleration_std") is None
    assert "acceleration_m_s2" not in history(on_mass, duration=5.0, seed=1).to_frame()


def test_pulses_add_to_other_excitations_and_functions() -> None:
    """White noise, a sine, a modulation and a compliant stop beside them: the energy balances."""
    scene = Scene(
        structure=Oscillator(**MASS),
        impact_pairs=[
            ImpactPair(upper=0.4, law=Viscoelastic(stiffness=200.0, damping_ratio=0.2))
        ],
        excitations=[
            Pulses(rate=1.0, impulse=0.4), WhiteNoise(intensity=0.1),
            Modulation(of="stiffness", intensity=0.01),
            Pulses(rate=5.0, impulse=0.1, two_sided=False),
        ],
    )  # fmt: skip
    found = simulate(scene, paths=128, duration=50.0, seed=2)
    assert set(found.identities) == {"energy", "force"}
    assert_balanced(found)
    assert found.effects.count("pulses on x") == 2
    with_sine = scene_of(Pulses(rate=0.7, impulse=0.5), Sine(amplitude=0.5, frequency_hz=0.3))
    square = simulate(with_sine, paths=512, duration=100.0, seed=2).coordinates["x"]
    omega = 2.0 * math.pi * 0.3
    gain = 0.5 / M / math.hypot(W**2 - omega**2, B * omega)
    known = campbell(Pulses(rate=0.7, impulse=0.5), kick)[1] + gain**2 / 2.0
    assert_agrees(square["displacement_mean_square"], known)


SWITCHES = 1.3
"""Mean number of changes of a switch per second."""


def switch(z: float, time: float, uniform: float) -> float:
    last = 1.0 if z >= 0.0 else -1.0
    return -last if uniform < 0.5 * (1.0 - math.exp(-2.0 * SWITCHES * time)) else last


def phase(z: float, time: float, uniform: float) -> float:
    return math.fmod(z + 0.7 * time + 0.5 * uniform * time, 1.0)


def test_a_switch_at_random_times_has_the_mean_squares_of_its_correlation() -> None:
    """A force of +-A that changes at random times is correlated as exp(-2 rate time)."""
    force = DriveFunction(function=switch, rate=2.0 * SWITCHES, amplitude=0.9)
    found = simulate(scene_of(force), paths=512, duration=150.0, seed=6)
    decay = 2.0 * SWITCHES
    a = np.array([[0.0, 1.0, 0.0], [-(W**2), -B, 0.9 / M], [0.0, 0.0, -decay]])
    known = solve_continuous_lyapunov(a, -np.diag([0.0, 0.0, 2.0 * decay]))
    for name, value in zip(QUANTITIES, (known[0, 0], known[1, 1]), strict=True):
        assert_agrees(found.coordinates["x"][name], value)
        white = 0.9**2 / M**2 / SWITCHES / (2.0 * B)  # noise of the same density at 0 Hz
        assert_differs(found.coordinates["x"][name], white / (W**2 if "disp" in name else 1.0))
    between = simulate(scene_of(force, pairs=STOPS), paths=128, duration=50.0, seed=6)
    for name in ("energy", "virial", "force"):
        assert_agrees(between.identities[name], 0.0)
    assert "DriveFunction" not in str(found.effects)
    assert "function of random numbers on x" in found.effects


def test_a_drive_of_ones_own_is_named_in_documents_and_known_again() -> None:
    one = DriveFunction(function=switch, rate=2.0)
    document = scene_of(one).document()["excitation"][0]
    assert document["function"].startswith(f"{__name__}.switch (")
    assert explain(scene_of(one)).methods["simulate"] == "applies"
    other = DriveFunction(function=phase, rate=2.0)
    assert scene_of(other).document()["excitation"][0]["function"] != document["function"]


test_a_drive_that_gives_no_numbers_is_refused = refusals(
    lambda function: DriveFunction(function=function, rate=1.0),
    (lambda z: z, "takes a value, a time"),
    (lambda z, time, uniform: "a", "returns a number, got ValueError"),
    (lambda z, time, uniform: 2.0 * z + 1.0, "gives finite numbers"),
    (lambda z, time, uniform: 1.0, "changes, got 1 for"),
    error=ValueError,
)


def test_a_rate_in_words_is_refused_with_the_form_to_write() -> None:
    with pytest.raises(SceneError, match="a number per second, or as \"12/h\", got '4 per hour'"):
        Pulses(rate="4 per hour", impulse=1.0)
    assert Pulses(rate="4/h", impulse=1.0).rate == 4.0 / 3600.0


def test_what_numba_does_not_compile_is_told() -> None:
    force = DriveFunction(function=lambda z, time, uniform: float(Fraction(uniform)), rate=1.0)
    with pytest.raises(ValueError, match="must be a function that numba compiles"):
        simulate(scene_of(force), paths=2, duration=1.0)


def test_linearise_answers_where_white_noise_is_the_same() -> None:
    pulses = Pulses(rate=0.7, impulse=0.5)
    known = linearise(scene_of(WhiteNoise(intensity=pulses.si_intensity)))
    found = linearise(scene_of(pulses))
    for name in QUANTITIES:
        assert found.coordinates["x"][name].value == pytest.approx(
            known.coordinates["x"][name].value, rel=1e-12
        )
        assert found.coordinates["x"][name].bias == 0.0
    assert check(scene_of(pulses), rel_error=0.02, seed=1).passed
    for scene in (
        scene_of(pulses, pairs=STOPS), scene_of(DriveFunction(function=switch, rate=2.0)),
    ):  # fmt: skip
        with pytest.raises(NotApplicable, match="must be Gaussian noise, a sine or constant"):
            linearise(scene)


@pytest.mark.parametrize("calculation", [*OTHER_METHODS, growth])
def test_other_methods_refuse_pulses(calculation: Any) -> None:
    scene = Scene(
        structure=Isolator(**MASS), impact_pairs=STOPS,
        excitations=[WhiteNoise(intensity=0.1), Pulses(rate=1.0, impulse=0.1)],
    )  # fmt: skip
    with pytest.raises(NotApplicable, match="excitation must be Gaussian noise"):
        calculation(scene)


@pytest.mark.slow
def test_statistics_follow_pulses() -> None:
    scene = scene_of(Pulses(rate=1.5, impulse=0.4), pairs=STOPS)
    known = simulate(scene, paths=256, duration=100.0, seed=7)
    counted = impacts(scene, paths=256, duration=100.0, seed=3).pairs["stops"].rates["both"]
    rate = known.impact_pairs["stops"]["collision_rate"]
    assert_same(counted.estimate, rate)
    assert "acceleration" not in spectrum(scene, rel_error=0.2, seed=1).curves["x"]


def rubber(deflection: float, speed: float) -> float:
    return 1e6 * deflection**1.5 * (1.0 + 0.8 * speed)


def touching(x: float, v: float) -> float:
    return 1.0 if abs(x) > 4e-3 else 0.0


@pytest.mark.slow
def test_parts_of_ones_own_move_six_modes_beside_a_stop_that_rubs() -> None:
    """A law, a drive and a statistic that are functions, pulses and friction, in one chain."""
    stiffness = np.diag(np.full(6, 1e4)) - 3e3 * (np.eye(6, k=1) + np.eye(6, k=-1))
    scene = Scene(
        structure=Matrices(
            coordinates=[f"q{k}" for k in range(6)], mass=np.eye(6).tolist(),
            damping=(0.002 * stiffness).tolist(), stiffness=stiffness.tolist(),
        ),
        impact_pairs=[
            ImpactPair(name="own", on="q0", clearance=4e-3, law=ForceFunction(force=rubber)),
            ImpactPair(
                name="rubs", between=("q3", "q2"), clearance=3e-3, tangent="q5",
                law=Restitution(coefficient=0.6, friction=0.3),
            ),
        ],
        excitations=[
            Pulses(on="q1", rate=20.0, impulse=0.3, sizes="exponential"),
            DriveFunction(function=switch, rate=2.0 * SWITCHES, amplitude=20.0, on="q4"),
            WhiteNoise(intensity=20.0, on="q2"),
        ],
    )  # fmt: skip
    asked = {"contact": Statistic(function=touching, of="own")}
    found = simulate(scene, statistics=asked, paths=64, duration=10.0, seed=1)
    assert_agrees(found.identities["energy"], 0.0)
    assert 0.01 < found.statistics["contact"].value < 0.5
    assert all(found.impact_pairs[name]["collision_rate"].value > 1.0 for name in ("own", "rubs"))


def test_a_level_raises_pulses() -> None:
    pulses = Pulses(rate=2.0, impulse=0.1, sizes="exponential", two_sided=False)
    louder = scene_of(pulses).at_level(6.0).excitations[0]
    assert louder.si_intensity == pytest.approx(10.0**0.6 * pulses.si_intensity, rel=1e-12)
    assert louder.mean == pytest.approx(10.0**0.3 * pulses.mean, rel=1e-12)


# ------------------------------------------------------------------------------
# Noise of a steady kurtosis in scenes: what simulations make of it, and who refuses it.
# ------------------------------------------------------------------------------


Array = NDArray[np.float64]

TRUCK = "mil-std-810h-truck-vertical-5hz"
STIFF, SOFT = Isolator(frequency_hz=400.0, zeta=0.7), Isolator(frequency_hz=8.0, zeta=0.05)
STOPS_OF_PEAKS = ImpactPair(clearance=5e-3, law=Restitution(coefficient=0.7))
BAND = {"frequency_hz": [5.0, 100.0], "density": [0.01, 0.01], "unit": "g2/Hz"}


def shaken(structure: Any = STIFF, pairs: Any = (), **keys: Any) -> Scene:
    noise = TabulatedNoise(**BAND, **keys)
    return Scene(structure=structure, impact_pairs=list(pairs), excitations=[noise])


def flown(scene: Scene, paths: int, seconds: float) -> Array:
    """Displacements (paths, samples)."""
    plan = plan_histories(scene).plan.sampled(1e9, seconds)
    samples = plan.history_samples(seconds)
    parts = [plan.histories(3, first, 16, samples) for first in range(0, paths, 16)]
    return np.concatenate([part.displacement[0] for part in parts])


def shaking_of(scene: Scene, paths: int, seconds: float) -> Array:
    """Forces on the mass (paths, samples)."""
    plan = plan_histories(scene).plan.sampled(1e9, seconds)
    samples = plan.history_samples(seconds)
    return np.concatenate([plan.drive(3, path, samples, 0) for path in range(paths)])


def kurtosis_of(records: Array) -> tuple[float, float]:
    each = np.mean(records**4, axis=1) / np.mean(records**2) ** 2
    return float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each)))


@pytest.mark.slow
def test_a_stiff_mount_follows_the_noise_kurtosis_and_all() -> None:
    scene = shaken(kurtosis=5.0)
    (input_, error), (output, its_error) = (
        kurtosis_of(each(scene, 128, 10.0)) for each in (shaking_of, flown)
    )
    assert error < 0.12
    assert abs(input_ - 5.0) < 4.5 * error + 0.05
    assert abs(output - 5.0) < 4.5 * its_error + 0.25
    # the control: Gaussian noise of the same density
    plain, error = kurtosis_of(shaking_of(shaken(), 128, 10.0))
    assert abs(plain - 3.0) < 4.5 * error < abs(plain - 5.0) / 2.0


@pytest.mark.slow
def test_a_narrow_mount_averages_the_peaks_out() -> None:
    """To 3: a Gaussian answer is then right, whatever the kurtosis of the input."""
    narrow, error = kurtosis_of(flown(shaken(SOFT, kurtosis=5.0), 128, 60.0))
    assert error < 0.06
    assert abs(narrow - 3.0) < 4.5 * error
    wide, error = kurtosis_of(flown(shaken(STIFF, kurtosis=5.0), 64, 10.0))
    assert wide - 3.0 > 9.0 * error


def test_the_response_has_the_variance_of_the_density() -> None:
    scene = shaken(Isolator(frequency_hz=30.0, zeta=0.2, mass=2.0), kurtosis=6.0)
    exact = linearise(shaken(Isolator(frequency_hz=30.0, zeta=0.2, mass=2.0)))
    found = simulate(scene, seed=2, rel_error=0.01)
    for name in ("displacement_mean_square", "velocity_mean_square"):
        own, known = (each.coordinates["x"][name] for each in (found, exact))
        margin = 4.5 * own.standard_error + (own.bias or 0.0) + 0.003 * known.value
        assert abs(own.value - known.value) < margin


def test_a_path_at_half_the_sampling_rate_meets_the_same_peaks() -> None:
    plan = plan_histories(shaken(kurtosis=5.0)).plan
    fine, coarse = (
        np.fft.rfft(each.free_response(1, 0, 2, 0)[:, 0, 0]) / each.samples
        for each in (plan, plan.coarser())
    )
    assert len(fine) > 1.9 * len(coarse)
    kept = len(coarse) - 1
    assert np.allclose(fine[:kept], coarse[:kept], rtol=1e-9, atol=1e-12 * np.abs(fine).max())


def test_simulations_follow_the_peaks() -> None:
    """More impacts and a larger extreme than under Gaussian noise, by each command."""
    mount = Isolator(frequency_hz=60.0, zeta=0.4, mass=1.0)
    wide = ImpactPair(clearance=2.6e-4, law=Restitution(coefficient=0.7))
    rates, largest = [], []
    for keys in ({"kurtosis": 6.0}, {}):
        scene = shaken(mount, [wide], **keys)
        found = impacts(scene, seed=1, rel_error=0.1)
        rates.append(found.pairs["stops"].rates["both"].estimate)
        free = shaken(mount, **keys)
        of = damage(free, mission=600.0, equipment=[20.0, 60.0, 200.0], exponent=6.0, seed=1,
                    rel_error=0.2)  # fmt: skip
        largest.append(of.with_stops.extreme_response.value)
    assert rates[0].value - rates[1].value > 4.5 * math.hypot(
        rates[0].standard_error, rates[1].standard_error
    )
    assert np.all(largest[0] > 1.05 * largest[1])
    assert spectrum(shaken(mount, kurtosis=6.0), seed=1) is not None


def test_methods_for_gaussian_motion_refuse_it_in_a_sentence() -> None:
    with pytest.raises(NotApplicable, match="noise with fast peaks, of kurtosis 5; "):
        linearise(shaken(SOFT, [STOPS_OF_PEAKS], kurtosis=5.0))


def test_what_a_scene_may_not_say() -> None:
    with pytest.raises(SceneError, match="above 3 and at most 20, got 25"):
        TabulatedNoise(profile=TRUCK, kurtosis=25.0)
    with pytest.raises(SceneError, match="needs kurtosis with level_time"):
        TabulatedNoise(profile=TRUCK, level_time=2.0)
    box = Matrices(
        coordinates=["a", "b"], mass=np.eye(2).tolist(), damping=np.eye(2).tolist(),
        stiffness=[[50.0, -20.0], [-20.0, 50.0]],
    )  # fmt: skip
    noises = [
        TabulatedNoise(name=f"n{on}", on=on, frequency_hz=[0.2, 5.0], density=[0.3, 0.1],
                       unit="N2/Hz", kurtosis=4.0)
        for on in "ab"
    ]  # fmt: skip
    with pytest.raises(SceneError, match="has a kurtosis without level_time"):
        Scene(structure=box, excitations=noises,
              cross_densities=[CrossDensity(between=("na", "nb"), coherence=0.5)])  # fmt: skip
    narrow = TabulatedNoise(frequency_hz=[50.0, 52.0], density=[1.0, 1.0], unit="(m/s2)2/Hz",
                            kurtosis=20.0)  # fmt: skip
    with pytest.raises(NotApplicable, match="kurtosis must be at most"):
        simulate(Scene(structure=STIFF, excitations=[narrow]), seed=1)


# ------------------------------------------------------------------------------
# Shocks of a shape at random times: theorems, the limit of impulses, and replays judge.
# ------------------------------------------------------------------------------


M_OF_SHOCKS, F, ZETA = 2.0, 10.0, 0.05
W_OF_SHOCKS = 2.0 * math.pi * F
MASS_OF_SHOCKS = Oscillator(mass=M_OF_SHOCKS, frequency_hz=F, zeta=ZETA)
PROFILE = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")


def shaken_of_shocks(*excitations: Any, pairs: Any = ()) -> Scene:
    return Scene(structure=MASS_OF_SHOCKS, impact_pairs=list(pairs), excitations=excitations)


def responded(force: Array, step: float) -> Array:
    """Displacement of the mass under a force, by Duhamel's integral."""
    time = step * np.arange(len(force))
    wave = W_OF_SHOCKS * math.sqrt(1.0 - ZETA**2)
    kick = np.exp(-ZETA * W_OF_SHOCKS * time) * np.sin(wave * time) / (M_OF_SHOCKS * wave)
    length = 2 * len(force)
    return step * np.fft.irfft(np.fft.rfft(force, length) * np.fft.rfft(kick, length))[: len(force)]


@pytest.mark.parametrize("shape", list(SHAPES))
def test_the_transform_of_a_shape_is_its_integral(shape: str) -> None:
    pulse, time = PulseShape(SHAPES[shape], 0.02), np.linspace(0.0, 1.0, 400_001)
    for omega in (0.0, 50.0, 400.0, 1500.0):
        wave = shock_shape(shape, time) * np.exp(-1j * omega * 0.02 * time)
        whole = 0.02 * np.trapezoid(wave, time)
        found = pulse.transform(np.array([omega]))[0]
        assert abs(found - whole) < 3e-3 * pulse.area  # a tooth falls within a 400th


CASES: dict[str, dict[str, Any]] = {
    "half-sine": {"duration": "20 ms"},
    "saw-tooth": {"duration": 0.06, "two_sided": False},
    "trapezoid": {"duration": 0.01, "sizes": "normal"},
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", list(CASES))
def test_a_linear_response_has_the_moments_of_campbell_shocks(shape: str) -> None:
    """Mean, variance and fourth moment; that of a Gaussian motion is far away."""
    keys = CASES[shape]
    pulses = Pulses(rate=0.8, shape=shape, amplitude=30.0, **keys)
    step = 1e-4
    time = np.arange(0.0, 6.0, step)
    assert pulses.shock is not None
    moved = responded(30.0 * shock_shape(shape, time / pulses.shock.duration), step)
    kappa = [
        pulses.rate * pulses.relative_moment(n) * float(np.trapezoid(moved**n, dx=step))
        for n in (1, 2, 3, 4)
    ]
    plan = plan_histories(shaken_of_shocks(pulses)).plan.sampled(1e9, 60.0)
    samples = plan.history_samples(60.0)
    found = np.concatenate(
        [plan.histories(3, k, 16, samples).displacement[0] for k in range(0, 256, 16)]
    )
    apart = found - kappa[0]
    for values, known in (
        (found, kappa[0]), (apart**2, kappa[1]), (apart**4, kappa[3] + 3.0 * kappa[1] ** 2),
    ):  # fmt: skip
        each = values.mean(axis=1)
        error = float(each.std() / math.sqrt(len(each)))
        assert abs(each.mean() - known) < 4.5 * error + 2e-3 * abs(known)
    assert abs(each.mean() - 3.0 * kappa[1] ** 2) > 4.5 * error


def test_short_shocks_are_impulses() -> None:
    """Between rigid stops, by the engine that kicks the mass at each step."""
    stops = [ImpactPair(clearance=0.003, law=Restitution(coefficient=0.6))]
    length = 2e-3  # the response of 10 Hz to it is 7e-4 smaller than to an impulse
    shocks = Pulses(
        rate=5.0, shape="half-sine", duration=length, amplitude=0.3 * math.pi / 2.0 / length
    )
    found = [
        simulate(shaken_of_shocks(each, pairs=stops), rel_error=0.05, seed=seed)
        for seed, each in enumerate((shocks, Pulses(rate=5.0, impulse=0.3)))
    ]
    for name in ("collision_rate", "impact_speed_rate"):
        one, other = (each.impact_pairs["stops"][name] for each in found)
        assert abs(one.value - other.value) < math.hypot(one.reach(4.5), other.reach(4.5))
    # shocks as long as half a period are told apart
    slow = shocks.replace(duration=0.05, amplitude=0.3 * math.pi / 2.0 / 0.05)
    third = simulate(shaken_of_shocks(slow, pairs=stops), rel_error=0.05, seed=3)
    one, other = third.impact_pairs["stops"]["collision_rate"], found[1].impact_pairs["stops"]
    rate = other["collision_rate"]
    assert abs(one.value - rate.value) > math.hypot(one.reach(4.5), rate.reach(4.5))


@pytest.mark.slow
def test_a_shock_alone_is_that_of_a_replayed_record(tmp_path: Path) -> None:
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    fs, length, peak = 20_000.0, 0.011, 150.0
    time = np.arange(round(10.0 * fs)) / fs
    values = peak * shock_shape("half-sine", (time - 0.1) / length)
    np.savetxt(tmp_path / "shock.txt", values - values.mean())
    record = RecordedNoise(file=str(tmp_path / "shock.txt"), unit="m/s2", fs=fs)
    alone = replay(Scene(structure=structure, excitations=[record])).coordinates["x"]
    inside = (time >= 0.1) & (time <= 0.1 + length)
    np.savetxt(tmp_path / "pulse.txt", values[inside][1:])
    pulses = [
        Pulses(rate="90/h", shape="half-sine", duration=length, amplitude=peak),
        Pulses(rate="90/h", file=str(tmp_path / "pulse.txt"), unit="m/s2", fs=fs),
    ]
    largest = []
    for each in pulses:
        plan = plan_histories(Scene(structure=structure, excitations=[each])).plan
        plan = plan.sampled(1e-4, 100.0)
        moved = plan.histories(1, 0, 2, plan.history_samples(100.0)).displacement[0]
        largest.append(np.abs(moved).max())
    assert largest[0] == pytest.approx(largest[1], rel=1e-3)
    most = max(abs(alone["displacement_max"].value), abs(alone["displacement_min"].value))
    # the mean of the record is left out of the replay, 0.2 % of the displacement
    assert largest[0] == pytest.approx(most, rel=3e-3)


def test_damage_takes_shocks_and_other_methods_refuse_them() -> None:
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    shocks = Pulses(rate=0.5, shape="half-sine", duration="20 ms", amplitude=60.0)
    pair = ImpactPair(clearance=0.01, law=Restitution(coefficient=0.7))
    scene = Scene(structure=structure, impact_pairs=[pair], excitations=[PROFILE, shocks])
    free = scene.replace(impact_pairs=[])
    asked = {"mission": 600.0, "equipment": [39.9, 40.0, 60.0], "rel_error": 0.3}
    with_shocks, without = (
        damage(free, **asked),
        damage(  # type: ignore[arg-type]
            free.replace(excitations=[PROFILE]),
            **asked,  # type: ignore[arg-type]
        ),
    )
    assert with_shocks.way == "simulation" and without.way == "density"
    more = with_shocks.with_stops.fatigue_damage, without.with_stops.fatigue_damage
    assert np.all(more[0].value - more[1].value > 4.5 * more[0].standard_error)
    for ask in (screen, linearise):
        with pytest.raises(NotApplicable, match="must be Gaussian noise, got pulses of a shape"):
            ask(scene)


test_wrong_keys_are_named = refusals(
    lambda keys: shaken_of_shocks({"kind": "pulses", "rate": 1.0} | keys),
    ({}, "needs exactly one of impulse, shape, file and values, got none"),
    ({"impulse": 1.0, "shape": "half-sine"}, "exactly one of impulse, shape, file and values"),
    ({"shape": "half-sine"}, "needs duration and amplitude with shape"),
    ({"impulse": 1.0, "duration": 0.01}, "has duration, which does not go with impulse"),
    ({"shape": "square", "duration": 0.01, "amplitude": 1.0}, "shape"),
    ({"impulse": 1.0, "rate": "often"}, "rate"),
)


def test_a_level_raises_the_peak() -> None:
    pulses = Pulses(rate=1.0, shape="trapezoid", duration=0.01, amplitude=10.0)
    assert pulses.louder(20.0).size == pytest.approx(100.0)
    assert pulses.moment(2) == pytest.approx(100.0)


def test_the_peak_of_a_shape_may_be_in_g() -> None:
    shape = {"rate": 2.0, "shape": "half-sine", "duration": "20 ms"}
    in_g, plain = Pulses(**shape, amplitude=3.0, unit="g"), Pulses(**shape, amplitude=29.41995)
    assert in_g.size == pytest.approx(plain.size) and in_g.moment(2) == pytest.approx(
        plain.moment(2)
    )
    louder = in_g.louder(6.0)
    assert louder.size == pytest.approx(plain.louder(6.0).size) and louder.unit == "g"
    with pytest.raises(SceneError, match="unit"):
        Pulses(**shape, amplitude=3.0, unit="mm")
    with pytest.raises(SceneError, match="does not go with impulse"):
        Pulses(rate=2.0, impulse=0.1, unit="g")
