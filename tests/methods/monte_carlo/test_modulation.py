"""Modulated springs and dampers in simulations: equations of moments and plain twins judge them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi import (
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    WhiteNoise,
    average,
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
    transient,
)
from stochvi.isolators import bumper_map
from stochvi.mathematics.moment_growth import FilteredChange
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.model.model import model_of
from stochvi.scenes import Modulation, Sine
from stochvi.testing import assert_agrees
from support.modulated import S0, B, M, W, scene_of

QUANTITIES = ("displacement_mean_square", "velocity_mean_square")
STOPS = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=0.7))]


def squares(scene: Scene, paths: int = 512, duration: float = 200.0) -> list[Estimate]:
    found = simulate(scene, paths=paths, duration=duration, seed=5)
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)
    return [found.coordinates["x"][name] for name in QUANTITIES]


@pytest.mark.parametrize("intensity", [0.02, 0.06])
def test_white_modulation_of_a_spring_has_the_mean_squares_of_its_equations(
    intensity: float,
) -> None:
    """E v^2 = W^2 E x^2 = S0 / (m^2 (2 b - W^2 S)); Ito and Stratonovich are the same."""
    speed = S0 / M**2 / (2.0 * B - W**2 * intensity)
    found = squares(scene_of(Modulation(of="stiffness", intensity=intensity)))
    for estimate, known in zip(found, (speed / W**2, speed), strict=True):
        assert_agrees(estimate, known)
        with pytest.raises(AssertionError):  # the motion without the modulation
            assert_agrees(estimate, known * (1.0 - W**2 * intensity / (2.0 * B)))


def test_white_modulation_of_a_damper_is_that_of_stratonovich() -> None:
    """E v^2 = W^2 E x^2 = S0 / (m^2 (2 b - 2 b^2 S)); by Ito it were 2 b - b^2 S."""
    intensity = 1.2
    found = squares(scene_of(Modulation(of="damping", intensity=intensity)))
    speed = S0 / M**2 / (2.0 * B - 2.0 * B**2 * intensity)
    ito = S0 / M**2 / (2.0 * B - B**2 * intensity)
    for estimate, scale in zip(found, (W**2, 1.0), strict=True):
        assert_agrees(estimate, speed / scale)
        with pytest.raises(AssertionError):
            assert_agrees(estimate, ito / scale)


@pytest.mark.parametrize("of", ["stiffness", "damping"])
def test_a_sine_that_modulates_has_the_mean_squares_of_its_covariance(of: str) -> None:
    """An integration of the covariance over time, averaged over a period."""
    amplitude, omega = (0.25, 3.7) if of == "stiffness" else (0.9, 3.7)
    system = np.array([[0.0, 1.0], [-(W**2), -B]])
    noise = np.diag([0.0, S0 / M**2])
    change = np.zeros((2, 2))
    change[1] = (-(W**2), 0.0) if of == "stiffness" else (0.0, -B)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        a, p = system + amplitude * math.cos(omega * t) * change, y.reshape(2, 2)
        return (a @ p + p @ a.T + noise).ravel()

    period = 2.0 * math.pi / omega
    times = 60.0 * period + period * np.arange(200) / 200.0
    solved = solve_ivp(rates, (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-8, atol=1e-10)
    known = solved.y[0].mean(), solved.y[3].mean()
    modulation = Modulation(of=of, amplitude=amplitude, frequency_hz=omega / (2.0 * math.pi))
    for estimate, value in zip(squares(scene_of(modulation)), known, strict=True):
        assert_agrees(estimate, value)
    still = S0 / M**2 / (2.0 * B)
    assert abs(known[1] / still - 1.0) > 0.05


def test_filtered_noise_that_modulates_has_the_mean_squares_of_its_equations() -> None:
    """Moments times Hermite polynomials of the filter follow linear equations."""
    modulation = Modulation(of="stiffness", intensity=0.08, frequency_hz=0.6, zeta=0.4)
    assert modulation.filter is not None
    system = np.array([[0.0, 2.0, 0.0], [-(W**2), -B, 1.0], [0.0, -2.0 * W**2, -2.0 * B]])
    change = np.array([[0.0, 0.0, 0.0], [-(W**2), 0.0, 0.0], [0.0, -2.0 * W**2, 0.0]])
    generator, size = FilteredChange(change, *modulation.filter).operators(24)
    whole = (
        np.kron(np.eye(len(size)), system) + np.kron(size.T, change)
        + np.kron(generator.T, np.eye(3))
    )  # fmt: skip
    source = np.zeros(len(whole))
    source[2] = S0 / M**2
    known = np.linalg.solve(whole, -source)
    found = squares(scene_of(modulation))
    for estimate, value in zip(found, (known[0], known[2]), strict=True):
        assert_agrees(estimate, float(value))
    assert known[2] > 1.1 * S0 / M**2 / (2.0 * B)


def test_a_spring_between_coordinates_is_modulated() -> None:
    """Two coordinates that are one oscillator and a frame that hardly moves."""
    modulation = Modulation(of="stiffness", intensity=0.05, between=("x", "frame"))
    k, c = M * W**2, M * B
    heavy = Scene(
        structure=Matrices(
            coordinates=["x", "frame"],
            mass=[[M, 0.0], [0.0, 1e7]],
            damping=[[c, -c], [-c, 1e6]],
            stiffness=[[k, -k], [-k, 1e6]],
        ),
        excitations=[WhiteNoise(intensity=S0, on="x"), modulation],
    )
    found = simulate(heavy, paths=256, duration=200.0, seed=2).coordinates["x"]
    speed = S0 / M**2 / (2.0 * B - W**2 * 0.05)
    for name, known in zip(QUANTITIES, (speed / W**2, speed), strict=True):
        assert_agrees(found[name], known)


def plain_twin(
    relative: Any, noise: float, paths: int, duration: float, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares of displacement and velocity, and the impact rate, of each path between the
    stops, by an integrator that shares nothing with the engine: steps of half a kick, a way and
    half a kick, with impacts at the straight line through the step."""
    generator = np.random.default_rng(8)
    x, v = 0.5 * generator.standard_normal((2, paths)).clip(-1.5, 1.5)
    sums, counted = np.zeros((3, paths)), 0
    phase = 2.0 * math.pi * generator.random(paths)
    for k in range(round(duration / h)):
        change = relative((k + 0.5) * h, phase, generator, h)
        for half in (0, 1):
            v = v * math.exp(-0.5 * B * h) - 0.5 * h * W**2 * (1.0 + change) * x
            if half == 0:
                v = v + math.sqrt(noise * h) / M * generator.standard_normal(paths)
                x = x + h * v
                for side, place in ((1.0, 1.0), (-1.0, 0.8)):
                    beyond = side * x - place
                    hit = (beyond > 0.0) & (side * v > 0.0)
                    x = np.where(hit, side * (place - 0.7 * beyond), x)
                    v = np.where(hit, -0.7 * v, v)
                    if k * h > 30.0:
                        sums[2] += hit
        if k * h > 30.0:
            sums[0] += x**2
            sums[1] += v**2
            counted += 1
    sums[2] /= h
    return sums / counted


def test_stops_limit_a_motion_that_a_sine_excites() -> None:
    """At twice the natural frequency rest is unstable, and the mass goes from stop to stop."""
    amplitude, omega = 0.6, 4.3
    modulation = Modulation(
        of="stiffness", amplitude=amplitude, frequency_hz=omega / (2.0 * math.pi)
    )
    found = simulate(scene_of(modulation, pairs=STOPS, noise=0.1), paths=256, duration=70.0, seed=4)

    def relative(t: float, phase: np.ndarray, generator: Any, h: float) -> np.ndarray:
        return amplitude * np.cos(omega * t + phase)

    compare(found, [plain_twin(relative, 0.1, 256, 100.0, h) for h in (0.005, 0.01)])


def test_a_path_between_stops_under_a_sine_is_that_of_its_equation() -> None:
    """Without noise a path is followed by an integrator with events. Until the first impact errors
    fall by four where the step is halved. An impact within a step finds half a kick too much or
    too little, so that a single path is of the first order from there on."""
    amplitude, omega, end = 1.2, 4.3, 12.0
    modulation = Modulation(
        of="stiffness", amplitude=amplitude, frequency_hz=omega / (2.0 * math.pi)
    )
    plan = make_plan(model_of(scene_of(modulation, pairs=STOPS, noise=0.0)), None, end)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(3), 0, streams)
    x, v, f, g = plan.start(streams)[:4, 0]
    x, v = np.array([x, v]) * plan.modes.shapes[0, 0]
    phase = math.atan2(-g, f)

    def rates(t: float, y: np.ndarray) -> list[float]:
        change = amplitude * math.cos(omega * t + phase)
        return [y[1], -B * y[1] - W**2 * (1.0 + change) * y[0]]

    stops = [lambda t, y: y[0] - 1.0, lambda t, y: y[0] + 0.8]
    for stop, way in zip(stops, (1.0, -1.0), strict=True):
        stop.terminal, stop.direction = True, way
    times = end * np.arange(1, 241) / 240
    t, y, known, hits = 0.0, [x, v], np.zeros(240), []
    while t < end:
        solved = solve_ivp(
            rates, (t, end), y, events=stops, rtol=1e-10, atol=1e-12, dense_output=True
        )
        inside = (times > t) & (times <= solved.t[-1])
        known[inside] = solved.sol(times[inside])[0]
        t, y = float(solved.t[-1]), [float(solved.y[0, -1]), -0.7 * float(solved.y[1, -1])]
        hits.append(t)
    before, errors = times < hits[0], []
    for steps in (2400, 4800):
        finer = replace(plan.with_step(end / steps), duration=end)
        record = np.zeros((finer.steps, 1, finer.record_width))
        finer.averages(3, 0, 1, record)
        found = finer.columns(record)["displacement of x"][steps // 240 - 1 :: steps // 240]
        errors.append(np.abs(found - known))
    assert len(hits) > 4 and before.sum() > 50
    fine, coarse = errors[1][before].max(), errors[0][before].max()
    assert coarse / fine == pytest.approx(4.0, rel=0.1) and fine < 1e-5
    kick = W**2 * amplitude * 1.0 * end / 4800 / 2.0
    assert errors[1].max() < 2.0 * kick


@pytest.mark.verify
def test_stops_limit_a_motion_that_white_noise_excites() -> None:
    """Mean squares would grow without the stops, and no other noise moves the mass."""
    modulation = Modulation(of="stiffness", intensity=0.5)
    found = simulate(
        scene_of(modulation, pairs=STOPS, noise=0.0), paths=256, duration=100.0, seed=4
    )

    def relative(t: float, phase: np.ndarray, generator: Any, h: float) -> np.ndarray:
        return math.sqrt(0.5 / h) * generator.standard_normal(len(phase))

    compare(found, [plain_twin(relative, 0.0, 256, 100.0, h) for h in (0.005, 0.01)])


def compare(found: Any, twins: list[np.ndarray]) -> None:
    """The simulation has the means of a plain twin, whose error is of order 1 in its step."""
    names = [("coordinates", "x", name) for name in QUANTITIES]
    names += [("impact_pairs", "stops", "collision_rate")]
    for (kind, owner, name), fine, double in zip(names, *twins, strict=True):
        estimate = getattr(found, kind)[owner][name]
        error = math.hypot(fine.std() / 16.0, estimate.standard_error)
        bias = (estimate.bias or 0.0) + abs(double.mean() - fine.mean()) + fine.std() / 16.0
        difference = Estimate(value=estimate.value - fine.mean(), standard_error=error, bias=bias)
        assert_agrees(difference, 0.0)


@pytest.mark.slow
def test_statistics_follow_modulations() -> None:
    """Records, spectra and counts of impacts fly the plan of `simulate`."""
    modulation = Modulation(of="stiffness", amplitude=0.5, frequency_hz=0.65)
    mount = Isolator(mass=M, damping=M * B, stiffness=M * W**2)
    scene = Scene(
        structure=mount, impact_pairs=STOPS,
        excitations=[WhiteNoise(intensity=0.3), modulation],
    )  # fmt: skip
    known = simulate(scene, paths=128, duration=100.0, seed=7)
    assert "acceleration_m_s2" not in history(scene, duration=5.0, seed=1).to_frame()
    assert known.coordinates["x"]["acceleration_std"].value > 0.0
    curve = spectrum(scene, rel_error=0.1, seed=1).curves["x"]
    assert set(curve) == {"displacement", "velocity"}
    width = np.gradient(curve["velocity"].frequency_hz)
    whole = math.sqrt(float(np.sum(curve["velocity"].value * width)))
    assert whole == pytest.approx(known.coordinates["x"]["velocity_std"].value, rel=0.05)
    counted = impacts(scene, paths=128, duration=100.0, seed=3).pairs["stops"].rates["both"]
    rate = known.impact_pairs["stops"]["collision_rate"]
    error = math.hypot(counted.estimate.standard_error, rate.standard_error)
    bias = (counted.estimate.bias or 0.0) + (rate.bias or 0.0)
    assert_agrees(
        Estimate(value=counted.estimate.value - rate.value, standard_error=error, bias=bias), 0.0
    )


def test_white_modulation_leaves_accelerations_out() -> None:
    """They have no end."""
    mount = Isolator(mass=M, damping=M * B, stiffness=M * W**2)
    excitations = [WhiteNoise(intensity=0.3), Modulation(of="stiffness", intensity=0.02)]
    found = simulate(Scene(structure=mount, excitations=excitations), paths=8, duration=5.0)
    assert found.coordinates["x"].get("acceleration_std") is None


def test_the_step_has_the_second_order() -> None:
    """The bias of white modulation falls by four where the step is halved."""
    scene = scene_of(Modulation(of="stiffness", intensity=0.05))
    known = S0 / M**2 / (2.0 * B - W**2 * 0.05)
    plan = make_plan(model_of(scene), None, 200.0)
    errors = []
    for factor in (4.0, 8.0):
        rows = plan.with_step(factor * plan.step).averages(1, 0, 2048)[2]
        errors.append((rows.mean() - known, rows.std() / math.sqrt(2048.0)))
    (fine, fine_error), (coarse, coarse_error) = errors
    allowed = 4.5 * math.hypot(fine_error, coarse_error / 4.0) + abs(coarse / 8.0)
    assert abs(fine - coarse / 4.0) <= allowed


def test_a_motion_without_end_is_refused() -> None:
    white = Modulation(of="stiffness", intensity=1.01 * 2.0 * B / W**2)
    with pytest.raises(NotApplicable, match="mean squares must be finite where no stop limits"):
        simulate(scene_of(white), paths=2, duration=1.0)
    assert "mean squares must be finite" in explain(scene_of(white)).methods["simulate"]
    with pytest.raises(NotApplicable, match="got a modulation alone"):
        simulate(scene_of(white, noise=0.0), paths=2, duration=1.0)
    less = scene_of(Modulation(of="stiffness", intensity=0.5 * 2.0 * B / W**2))
    assert explain(less).methods["simulate"] == "applies"
    assert simulate(scene_of(white, pairs=STOPS), paths=8, duration=5.0).coordinates


def test_large_motions_that_are_rare_are_told() -> None:
    """Fourth moments end before mean squares do."""
    boundary = 2.0 * B / W**2
    for share, told in ((0.3, False), (0.9, True)):
        scene = scene_of(Modulation(of="stiffness", intensity=share * boundary))
        found = simulate(scene, paths=8, duration=5.0)
        assert any("fourth moments" in each for each in found.warnings) == told


def test_explain_names_modulations() -> None:
    found = explain(scene_of(Modulation(of="damping", amplitude=0.5, frequency_hz=1.0)))
    assert "modulation of damping by a sine on x" in found.effects
    assert "modulation" not in found.absent
    for method in ("exact", "fokker-planck", "average", "linearise"):
        assert "structure.damping must be constant, got a modulation" in found.methods[method]


@pytest.mark.parametrize(
    "calculation",
    [
        exact, average, screen, linearise, fokker_planck, bumper_map,
        lambda scene: damage(scene, mission=10.0),
        lambda scene: linearise(scene, form="force"),
        lambda scene: transient(scene, [1.0, 2.0]),
        lambda scene: first_passage(scene, 10.0),
        lambda scene: reliability(scene, mission=10.0),
        lambda scene: size(scene, probability=0.01, mission=10.0),
        lambda scene: harmonic_response(scene, [0.1, 0.2]),
    ],
)  # fmt: skip
def test_other_methods_refuse_modulations(calculation: Any) -> None:
    modulation = Modulation(of="stiffness", amplitude=0.5, frequency_hz=1.0)
    mount = Isolator(mass=M, damping=M * B, stiffness=M * W**2)
    noise = WhiteNoise(intensity=0.1)
    scene = Scene(structure=mount, impact_pairs=STOPS, excitations=[noise, modulation])
    with pytest.raises(NotApplicable, match=r"structure\.stiffness must be constant"):
        calculation(scene)


def test_a_modulating_sine_is_no_force() -> None:
    """Beside a force of the same frequency each keeps its own phase."""
    modulation = Modulation(of="stiffness", amplitude=0.3, frequency_hz=0.2)
    forced = scene_of(modulation, noise=0.0)
    forced = forced.replace(excitations=[Sine(amplitude=0.5, frequency_hz=0.31), modulation])
    assert simulate(forced, paths=64, duration=50.0).coordinates["x"]["velocity_std"].value > 0.0
