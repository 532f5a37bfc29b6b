"""Pulses at random times, and drives of one's own: theorems, plain twins and exact laws judge."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import brentq

from stochvi import (
    Estimate,
    ForceFunction,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    Statistic,
    Viscoelastic,
    WhiteNoise,
    average,
    check,
    damage,
    exact,
    explain,
    first_passage,
    fokker_planck,
    harmonic_response,
    history,
    impacts,
    linearise,
    reliability,
    screen,
    simulate,
    size,
    spectrum,
    stability,
    transient,
)
from stochvi.isolators import bumper_map
from stochvi.mathematics.quadrature import gauss_panels
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.model.model import model_of
from stochvi.scenes import DriveFunction, Modulation, Pulses
from stochvi.testing import assert_agrees
from support import naive

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
        with pytest.raises(AssertionError):
            assert_agrees(found.statistics[f"{name}_fourth"], gaussian)
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)


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
    found = plan.record(4, 2)["displacement of x"]
    assert met > 10.0 * pulses.impulse
    np.testing.assert_allclose(found, known, atol=1e-12)


def test_twice_the_step_meets_the_same_pulses() -> None:
    """The difference that tells the bias of the step has far less noise than two runs have."""
    plan = make_plan(model_of(scene_of(Pulses(rate=0.7, impulse=0.5))), None, 60.0)
    fine, coarse = plan.averages(3, 0, 256)[1], plan.coarser().averages(3, 0, 256)[1]
    others = plan.averages(4, 0, 256)[1]
    assert (coarse - fine).std() < 0.3 * (others - fine).std()


def test_a_path_does_not_depend_on_its_block_or_on_pieces_of_its_time() -> None:
    scene = scene_of(Pulses(rate=0.7, impulse=0.5), WhiteNoise(intensity=0.1), pairs=STOPS)
    plan = make_plan(model_of(scene), None, 20.0)
    whole = plan.averages(1, 0, 7)
    assert np.array_equal(plan.averages(1, 3, 2), whole[:, 3:5])
    underway = plan.begin(1, 0, 7)
    for at in range(0, underway.total, 10):
        underway.reach(min(at + 10, underway.total))
    underway.reach(underway.total)
    assert np.array_equal(underway.averages(), whole)


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
    with pytest.raises(AssertionError):
        assert_agrees(replace(rate, standard_error=math.hypot(rate.standard_error, error[3])),
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
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)


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
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)
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
        with pytest.raises(AssertionError):
            assert_agrees(found.coordinates["x"][name], white / (W**2 if "disp" in name else 1.0))
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


@pytest.mark.parametrize(
    ("function", "sentence"),
    [
        (lambda z: z, "takes a value, a time"),
        (lambda z, time, uniform: "a", "returns a number, got ValueError"),
        (lambda z, time, uniform: 2.0 * z + 1.0, "gives finite numbers"),
        (lambda z, time, uniform: 1.0, "changes, got 1 for"),
    ],
)
def test_a_drive_that_gives_no_numbers_is_refused(function: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        DriveFunction(function=function, rate=1.0)


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


@pytest.mark.parametrize(
    "calculation",
    [
        exact, average, screen, fokker_planck, bumper_map, stability,
        lambda scene: damage(scene, mission=10.0),
        lambda scene: linearise(scene, form="force"),
        lambda scene: transient(scene, [1.0, 2.0]),
        lambda scene: first_passage(scene, 10.0),
        lambda scene: reliability(scene, mission=10.0),
        lambda scene: size(scene, probability=0.01, mission=10.0),
        lambda scene: harmonic_response(scene, [0.1, 0.2]),
    ],
)  # fmt: skip
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
    error = math.hypot(counted.estimate.standard_error, rate.standard_error)
    bias = (counted.estimate.bias or 0.0) + (rate.bias or 0.0)
    difference = counted.estimate.value - rate.value
    assert_agrees(Estimate(value=difference, standard_error=error, bias=bias), 0.0)
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
