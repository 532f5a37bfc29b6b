"""Stops that move: integrators with events, plain twins and mixtures of stops that stand still or
swing judge them."""

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
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    damage,
    exact,
    explain,
    fokker_planck,
    history,
    impacts,
    linearise,
    reliability,
    screen,
    simulate,
    size,
    spectrum,
)
from stochvi.isolators import bumper_map
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal_tables import streams_of_block
from stochvi.motion.synthesis import MOST_BLOCKS
from stochvi.scenes import Modulation, Sine
from stochvi.testing import assert_agrees
from support.accuracies import assert_balanced, assert_differs, assert_same
from support.modulated import S0, mean_squares
from support.modulated import B as B_OF_MODULATED
from support.modulated import M as M_OF_MODULATED
from support.modulated import W as W_OF_MODULATED
from support.modulated import scene_of as scene_of_of_modulated
from support.refusals import OTHER_METHODS, refusals

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


def series(values: np.ndarray, step: float, start: float) -> Any:
    """A periodic function of time through values from `start` on, and its rate."""
    bins = np.fft.rfft(values) / len(values)
    bins[1:] *= 2.0
    omega = 2.0 * np.pi / len(values) / step * np.arange(len(bins))
    omega, bins = omega[np.abs(bins) > 1e-13], bins[np.abs(bins) > 1e-13]

    def value(t: float, order: int = 0) -> float:
        waves = (1j * omega) ** order * bins * np.exp(1j * omega * (t - start))
        return float(np.sum(waves.real))

    return value


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [Restitution(coefficient=R), Viscoelastic(stiffness=400.0, damping_ratio=0.2)]
)
def test_a_path_between_stops_that_a_table_moves_is_that_of_its_equation(law: Any) -> None:
    """Beside a sine that moves them too, and noise of a table. Of what was drawn, the integrator
    has the relative change xi and the motion y without stops. It follows e = x - y."""
    end, swing = 12.0, 2.0 * math.pi * 0.5
    scene = scene_of(
        TabulatedNoise(frequency_hz=[0.1, 0.8], density=[20.0, 20.0], unit="N2/Hz"),
        SWING.replace(amplitude=0.15),
        Modulation(of="clearance", frequency_hz=[0.2, 1.0], density=[0.01, 0.01]),
        pairs=[ImpactPair(lower=-0.8, upper=1.0, law=law)],
    )
    plan: Any = make_plan(model_of(scene), None, end)
    plan = replace(plan.with_step(0.01), burn_in=1e-9, duration=end)  # one step before the record
    step, shape = plan.step, plan.modes.shapes[0, 0]
    free = plan.free_response(3, 0, 1, 0)
    y = series(shape * free[:, 0, 0], step, 2.0 * step)
    xi = series(free[:, 1, 0], step, 2.0 * step)
    *rest, cosine, sine = plan.start(streams_of_block(3, 0, 1, MOST_BLOCKS - 1))[:, 0]
    phase = math.atan2(-sine, cosine)

    def beyond(place: float, t: float, e: np.ndarray) -> tuple[float, float]:
        change = xi(t) + 0.15 * math.cos(swing * t + phase)
        rate = xi(t, 1) - 0.15 * swing * math.sin(swing * t + phase)
        side = math.copysign(1.0, place)
        return (
            side * (y(t) + e[0] - place * (1.0 + change)), side * (y(t, 1) + e[1] - place * rate)
        )  # fmt: skip

    def rates(t: float, e: np.ndarray) -> list[float]:
        force = 0.0
        for place in () if law.rigid else (-0.8, 1.0):
            deflection, closing = beyond(place, t, e)
            if deflection > 0.0:
                push = law.stiffness * deflection + law.damping(M) * closing
                force -= math.copysign(max(push, 0.0), place)
        return [e[1], force / M - B * e[1] - W**2 * e[0]]

    def touch(place: float) -> Any:
        def gap(t: float, e: np.ndarray) -> float:
            return beyond(place, t, e)[0]

        gap.terminal, gap.direction = law.rigid, 1.0
        return gap

    places, times = (-0.8, 1.0), step * np.arange(2, 2 + plan.steps)
    t, e, known, touches = 0.0, shape * np.array(rest), np.zeros(plan.steps), []
    while t < times[-1]:
        solved = solve_ivp(
            rates, (t, times[-1]), e, events=[touch(place) for place in places],
            rtol=1e-9, atol=1e-11, dense_output=True, max_step=0.02,
        )  # fmt: skip
        inside = (times > t) & (times <= solved.t[-1] + 1e-9)
        known[inside] = solved.sol(times[inside])[0]
        t, e = float(solved.t[-1]), solved.y[:, -1].copy()
        for place, ts, states in zip(places, solved.t_events, solved.y_events, strict=True):
            for at, state in zip(ts, states, strict=True):
                speed = beyond(place, at, state)[1]
                touches.append((at, speed))
                if law.rigid:
                    e[1] -= math.copysign((1.0 + R) * speed, place)
    record = np.zeros((plan.steps, 1, plan.record_width))
    plan.averages(3, 0, 1, record)
    columns = plan.columns(record)
    known += [y(at) for at in times]
    assert columns["displacement of x"] == pytest.approx(known, abs=1e-5)
    found = sum(np.abs(columns[f"impact_speed of stops {side}"]) for side in ("lower", "upper"))
    speeds = [speed for _, speed in sorted(touches)]
    assert found[found > 0.0] == pytest.approx(speeds, abs=1e-4)
    assert len(speeds) > 5


def plain_twin(relative: Any, paths: int, duration: float, h: float, law: Any = None) -> np.ndarray:
    """Mean squares of displacement and velocity, impact rates at the lower and the upper stop, and
    sums of impact speeds there, of each path in white noise of 4 N^2 s, by small steps in numpy. It
    is an integrator that shares nothing with the engine. Without a `law` the stops are rigid."""
    generator = np.random.default_rng(8)
    x, v = 0.3 * generator.standard_normal((2, paths)).clip(-2.0, 2.0)
    sums, counted, inside = np.zeros((6, paths)), 0, np.zeros((2, paths), bool)
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
            if law is None:
                x = np.where(hit, x - side * (1.0 + R) * beyond, x)
                v = np.where(hit, v - side * (1.0 + R) * closing, v)
            else:
                hit, inside[row - 2] = (beyond > 0.0) & ~inside[row - 2], beyond > 0.0
                push = np.maximum(law.stiffness * beyond + law.damping(M) * closing, 0.0)
                v = v - side * h / M * np.where(beyond > 0.0, push, 0.0)
            if k * h > 20.0:
                sums[row] += hit / h
                sums[row + 2] += hit * closing / h
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


TABLE = Modulation(of="clearance", frequency_hz=[0.2, 1.0], density=[0.03, 0.03])


def tabulated(generator: Any, paths: int, h: float) -> Any:
    """The noise of `TABLE`: lines 0.01 Hz apart with normal amplitudes."""
    lines = np.arange(0.205, 1.0, 0.01)
    size = math.sqrt(0.03 * 0.01)
    waves = size * (generator.standard_normal((2, paths, len(lines))).T @ [1.0, 1j])
    turn = np.exp(2j * np.pi * lines * h)[:, None]
    omega = 2.0 * np.pi * lines[:, None]

    def signal(k: int, change: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        np.multiply(waves, turn, out=waves)
        return waves.real.sum(axis=0), -(omega * waves.imag).sum(axis=0)

    return signal, (np.zeros(paths), np.zeros(paths))


@pytest.mark.parametrize(
    ("modulation", "relative", "law"),
    [
        (SWING, swinging, None),
        pytest.param(FILTERED, filtered, None, marks=pytest.mark.verify),
        pytest.param(TABLE, tabulated, None, marks=pytest.mark.slow),
        pytest.param(
            SWING, swinging, Viscoelastic(stiffness=400.0, damping_ratio=0.2),
            marks=pytest.mark.verify,
        ),
        pytest.param(
            TABLE, tabulated, Viscoelastic(stiffness=400.0, damping_ratio=0.2),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["sine", "filtered", "table", "sine, compliant", "table, compliant"],
)  # fmt: skip
def test_moving_stops_are_hit_as_by_a_plain_twin(
    modulation: Modulation, relative: Any, law: Any
) -> None:
    pairs = STOPS if law is None else [STOPS[0].replace(law=law)]
    scene = scene_of(WhiteNoise(intensity=4.0), modulation, pairs=pairs)
    found = simulate(scene, paths=512, duration=80.0, seed=4, speed_threshold=0.0)
    assert_agrees(found.identities["force"], 0.0)
    twins = [plain_twin(relative, 256, 100.0, h, law) for h in (0.005, 0.01)]
    stops = [found.impact_pairs[f"stops {side}"] for side in ("lower", "upper")]
    wanted = [
        found.coordinates["x"]["displacement_mean_square"],
        found.coordinates["x"]["velocity_mean_square"],
        *(each["collision_rate"] for each in stops),
        *(each["impact_speed_rate"] for each in stops),
    ]
    compare(wanted, twins)


def tabulated_change(deviation: float, low: float, high: float) -> Modulation:
    density = deviation**2 / (high - low)
    return Modulation(of="clearance", frequency_hz=[low, high], density=[density, density])


def is_mixture(found: Any, parts: Any, weights: Any) -> bool:
    """Whether mean square and sum of impact speeds are the means over some answers."""
    agree = True
    for answers in zip(wanted_of(found), *map(wanted_of, parts), strict=True):
        whole, *each = answers
        mean = sum(w * one.value for w, one in zip(weights, each, strict=True))
        spread = [w * one.standard_error for w, one in zip(weights, each, strict=True)]
        bias = sum(w * (one.bias or 0.0) for w, one in zip(weights, each, strict=True))
        error = 4.5 * math.hypot(whole.standard_error, *spread) + (whole.bias or 0.0) + bias
        agree &= abs(whole.value - mean) <= error
    return agree


def wanted_of(found: Any) -> list[Estimate]:
    """The mean square of x, and F1 of all stops of an answer."""
    sums = [each["impact_speed_rate"] for each in found.impact_pairs.values()]
    total = Estimate(
        value=sum(each.value for each in sums),
        standard_error=sum(each.standard_error for each in sums),
        bias=sum(each.bias or 0.0 for each in sums),
    )
    return [found.coordinates["x"]["displacement_mean_square"], total]


@pytest.mark.slow
def test_a_slow_table_is_a_mixture_of_stops_that_stand_still() -> None:
    """Their clearances are normal; the nodes are those of Gauss and Hermite."""
    noise, options = WhiteNoise(intensity=1.2), {"paths": 2048, "duration": 80.0}
    slow = tabulated_change(0.19, 1e-4, 2e-4)
    found = simulate(scene_of(noise, slow), seed=1, **options)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)

    def still(node: float) -> Any:
        share = 1.0 + 0.19 * node
        pairs = [STOPS[0].replace(lower=-0.8 * share, upper=share)]
        return simulate(scene_of(noise, pairs=pairs), seed=2, **options)

    parts = [still(node) for node in nodes]
    assert is_mixture(found, parts, weights / weights.sum())
    assert not is_mixture(found, parts[2:3], [1.0])  # the control: the mean clearance alone


@pytest.mark.slow
def test_a_table_of_one_line_is_a_mixture_of_sines() -> None:
    """Normal noise of a narrow band is a sine whose amplitude has a Rayleigh distribution. The
    nodes are those of Gauss and Laguerre."""
    noise, options = WhiteNoise(intensity=4.0), {"paths": 1024, "duration": 80.0}
    line = tabulated_change(0.06, 0.4995, 0.5005)
    found = simulate(scene_of(noise, line), seed=1, **options)
    nodes, weights = np.polynomial.laguerre.laggauss(4)
    sines = [
        simulate(scene_of(noise, SWING.replace(amplitude=0.06 * math.sqrt(2.0 * node))), seed=2,
                 **options)
        for node in nodes
    ]  # fmt: skip
    assert is_mixture(found, sines, weights)
    assert not is_mixture(found, sines[3:], [1.0])  # the control: the largest of them alone


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


test_faults_are_named = refusals(
    lambda excitations, pairs: scene_of(WhiteNoise(intensity=4.0), *excitations, pairs=pairs),
    ([SWING], [], "must be on the name of an impact pair"),
    ([SWING.replace(on="else")], STOPS, "must be on the name of an impact pair, 'stops', got"),
    (
        [SWING],
        [STOPS[0], STOPS[0].replace(name="more")],
        "needs on = 'stops' or 'more' to say which clearance changes, got none",
    ),
)


@pytest.mark.parametrize(
    "keys",
    [
        {"intensity": 0.1}, {"amplitude": 0.5, "frequency_hz": 1.0},
        {"frequency_hz": [1.0, 2.0], "density": [0.1, 0.1]},
    ],
    ids=["white", "wide", "wide table"],
)  # fmt: skip
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


# ------------------------------------------------------------------------------
# Modulated springs and dampers in simulations: equations of moments and plain twins judge them.
# ------------------------------------------------------------------------------


QUANTITIES = ("displacement_mean_square", "velocity_mean_square")
STOPS_OF_MODULATION = [ImpactPair(lower=-0.8, upper=1.0, law=Restitution(coefficient=0.7))]


def squares(scene: Scene, paths: int = 512, duration: float = 200.0) -> list[Estimate]:
    found = simulate(scene, paths=paths, duration=duration, seed=5)
    assert_balanced(found)
    return [found.coordinates["x"][name] for name in QUANTITIES]


@pytest.mark.parametrize("intensity", [0.02, 0.06])
def test_white_modulation_of_a_spring_has_the_mean_squares_of_its_equations(
    intensity: float,
) -> None:
    """E v^2 = W^2 E x^2 = S0 / (m^2 (2 b - W^2 S)); Ito and Stratonovich are the same."""
    speed = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED - W_OF_MODULATED**2 * intensity)
    found = squares(scene_of_of_modulated(Modulation(of="stiffness", intensity=intensity)))
    for estimate, known in zip(found, (speed / W_OF_MODULATED**2, speed), strict=True):
        assert_agrees(estimate, known)
        # the motion without the modulation
        assert_differs(
            estimate, known * (1.0 - W_OF_MODULATED**2 * intensity / (2.0 * B_OF_MODULATED))
        )


def test_white_modulation_of_a_damper_is_that_of_stratonovich() -> None:
    """E v^2 = W^2 E x^2 = S0 / (m^2 (2 b - 2 b^2 S)); by Ito it were 2 b - b^2 S."""
    intensity = 1.2
    found = squares(scene_of_of_modulated(Modulation(of="damping", intensity=intensity)))
    speed = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED - 2.0 * B_OF_MODULATED**2 * intensity)
    ito = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED - B_OF_MODULATED**2 * intensity)
    for estimate, scale in zip(found, (W_OF_MODULATED**2, 1.0), strict=True):
        assert_agrees(estimate, speed / scale)
        assert_differs(estimate, ito / scale)


@pytest.mark.parametrize("of", ["stiffness", "damping"])
def test_a_sine_that_modulates_has_the_mean_squares_of_its_covariance(of: str) -> None:
    """An integration of the covariance over time, averaged over a period."""
    amplitude, omega = (0.25, 3.7) if of == "stiffness" else (0.9, 3.7)
    system = np.array([[0.0, 1.0], [-(W_OF_MODULATED**2), -B_OF_MODULATED]])
    noise = np.diag([0.0, S0 / M_OF_MODULATED**2])
    change = np.zeros((2, 2))
    change[1] = (-(W_OF_MODULATED**2), 0.0) if of == "stiffness" else (0.0, -B_OF_MODULATED)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        a, p = system + amplitude * math.cos(omega * t) * change, y.reshape(2, 2)
        return (a @ p + p @ a.T + noise).ravel()

    period = 2.0 * math.pi / omega
    times = 60.0 * period + period * np.arange(200) / 200.0
    solved = solve_ivp(rates, (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-8, atol=1e-10)
    known = solved.y[0].mean(), solved.y[3].mean()
    modulation = Modulation(of=of, amplitude=amplitude, frequency_hz=omega / (2.0 * math.pi))
    for estimate, value in zip(squares(scene_of_of_modulated(modulation)), known, strict=True):
        assert_agrees(estimate, value)
    still = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED)
    assert abs(known[1] / still - 1.0) > 0.05


def test_filtered_noise_that_modulates_has_the_mean_squares_of_its_equations() -> None:
    """Moments times Hermite polynomials of the filter follow linear equations."""
    modulation = Modulation(of="stiffness", intensity=0.08, frequency_hz=0.6, zeta=0.4)
    known = mean_squares(modulation)
    found = squares(scene_of_of_modulated(modulation))
    for estimate, value in zip(found, known, strict=True):
        assert_agrees(estimate, value)
    assert known[1] > 1.1 * S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED)


def test_a_spring_between_coordinates_is_modulated() -> None:
    """Two coordinates that are one oscillator and a frame that hardly moves."""
    modulation = Modulation(of="stiffness", intensity=0.05, between=("x", "frame"))
    k, c = M_OF_MODULATED * W_OF_MODULATED**2, M_OF_MODULATED * B_OF_MODULATED
    heavy = Scene(
        structure=Matrices(
            coordinates=["x", "frame"],
            mass=[[M_OF_MODULATED, 0.0], [0.0, 1e7]],
            damping=[[c, -c], [-c, 1e6]],
            stiffness=[[k, -k], [-k, 1e6]],
        ),
        excitations=[WhiteNoise(intensity=S0, on="x"), modulation],
    )
    found = simulate(heavy, paths=256, duration=200.0, seed=2).coordinates["x"]
    speed = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED - W_OF_MODULATED**2 * 0.05)
    for name, known in zip(QUANTITIES, (speed / W_OF_MODULATED**2, speed), strict=True):
        assert_agrees(found[name], known)


def plain_twin_of_modulation(
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
            v = (
                v * math.exp(-0.5 * B_OF_MODULATED * h)
                - 0.5 * h * W_OF_MODULATED**2 * (1.0 + change) * x
            )
            if half == 0:
                v = v + math.sqrt(noise * h) / M_OF_MODULATED * generator.standard_normal(paths)
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
    found = simulate(
        scene_of_of_modulated(modulation, pairs=STOPS_OF_MODULATION, noise=0.1),
        paths=256,
        duration=70.0,
        seed=4,
    )

    def relative(t: float, phase: np.ndarray, generator: Any, h: float) -> np.ndarray:
        return amplitude * np.cos(omega * t + phase)

    compare(
        of_modulated(found),
        [plain_twin_of_modulation(relative, 0.1, 256, 100.0, h) for h in (0.005, 0.01)],
    )


def test_a_path_between_stops_under_a_sine_is_that_of_its_equation() -> None:
    """Without noise a path is followed by an integrator with events. Until the first impact errors
    fall by four where the step is halved. An impact within a step finds half a kick too much or
    too little, so that a single path is of the first order from there on."""
    amplitude, omega, end = 1.2, 4.3, 12.0
    modulation = Modulation(
        of="stiffness", amplitude=amplitude, frequency_hz=omega / (2.0 * math.pi)
    )
    plan = make_plan(
        model_of(scene_of_of_modulated(modulation, pairs=STOPS_OF_MODULATION, noise=0.0)), None, end
    )
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(3), 0, streams)
    x, v, f, g = plan.start(streams)[:4, 0]
    x, v = np.array([x, v]) * plan.modes.shapes[0, 0]
    phase = math.atan2(-g, f)

    def rates(t: float, y: np.ndarray) -> list[float]:
        change = amplitude * math.cos(omega * t + phase)
        return [y[1], -B_OF_MODULATED * y[1] - W_OF_MODULATED**2 * (1.0 + change) * y[0]]

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
    kick = W_OF_MODULATED**2 * amplitude * 1.0 * end / 4800 / 2.0
    assert errors[1].max() < 2.0 * kick


@pytest.mark.verify
def test_stops_limit_a_motion_that_white_noise_excites() -> None:
    """Mean squares would grow without the stops, and no other noise moves the mass."""
    modulation = Modulation(of="stiffness", intensity=0.5)
    found = simulate(
        scene_of_of_modulated(modulation, pairs=STOPS_OF_MODULATION, noise=0.0),
        paths=256,
        duration=100.0,
        seed=4,
    )

    def relative(t: float, phase: np.ndarray, generator: Any, h: float) -> np.ndarray:
        return math.sqrt(0.5 / h) * generator.standard_normal(len(phase))

    compare(
        of_modulated(found),
        [plain_twin_of_modulation(relative, 0.0, 256, 100.0, h) for h in (0.005, 0.01)],
    )


def compare(estimates: list[Estimate], twins: list[np.ndarray]) -> None:
    """A simulation has the means of a plain twin, whose error is of order 1 in its step."""
    for own, fine, double in zip(estimates, *twins, strict=True):
        error = float(fine.std()) / 16.0
        bias = abs(double.mean() - fine.mean()) + error
        assert_same(own, Estimate(value=fine.mean(), standard_error=error, bias=bias))


def of_modulated(found: Any) -> list[Estimate]:
    of_x = [found.coordinates["x"][name] for name in QUANTITIES]
    return [*of_x, found.impact_pairs["stops"]["collision_rate"]]


@pytest.mark.slow
def test_statistics_follow_modulations() -> None:
    """Records, spectra and counts of impacts fly the plan of `simulate`."""
    modulation = Modulation(of="stiffness", amplitude=0.5, frequency_hz=0.65)
    mount = Isolator(
        mass=M_OF_MODULATED,
        damping=M_OF_MODULATED * B_OF_MODULATED,
        stiffness=M_OF_MODULATED * W_OF_MODULATED**2,
    )
    scene = Scene(
        structure=mount, impact_pairs=STOPS_OF_MODULATION,
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
    assert_same(counted.estimate, rate)


def test_white_modulation_leaves_accelerations_out() -> None:
    """They have no end."""
    mount = Isolator(
        mass=M_OF_MODULATED,
        damping=M_OF_MODULATED * B_OF_MODULATED,
        stiffness=M_OF_MODULATED * W_OF_MODULATED**2,
    )
    excitations = [WhiteNoise(intensity=0.3), Modulation(of="stiffness", intensity=0.02)]
    found = simulate(Scene(structure=mount, excitations=excitations), paths=8, duration=5.0)
    assert found.coordinates["x"].get("acceleration_std") is None


def test_the_step_has_the_second_order() -> None:
    """The bias of white modulation falls by four where the step is halved."""
    scene = scene_of_of_modulated(Modulation(of="stiffness", intensity=0.05))
    known = S0 / M_OF_MODULATED**2 / (2.0 * B_OF_MODULATED - W_OF_MODULATED**2 * 0.05)
    plan = make_plan(model_of(scene), None, 200.0)
    errors = []
    for factor in (4.0, 8.0):
        rows = plan.with_step(factor * plan.step).averages(1, 0, 2048)[2]
        errors.append((rows.mean() - known, rows.std() / math.sqrt(2048.0)))
    (fine, fine_error), (coarse, coarse_error) = errors
    allowed = 4.5 * math.hypot(fine_error, coarse_error / 4.0) + abs(coarse / 8.0)
    assert abs(fine - coarse / 4.0) <= allowed


def test_a_motion_without_end_is_refused() -> None:
    white = Modulation(of="stiffness", intensity=1.01 * 2.0 * B_OF_MODULATED / W_OF_MODULATED**2)
    with pytest.raises(NotApplicable, match="mean squares must be finite where no stop limits"):
        simulate(scene_of_of_modulated(white), paths=2, duration=1.0)
    assert (
        "mean squares must be finite" in explain(scene_of_of_modulated(white)).methods["simulate"]
    )
    with pytest.raises(NotApplicable, match="got a modulation alone"):
        simulate(scene_of_of_modulated(white, noise=0.0), paths=2, duration=1.0)
    less = scene_of_of_modulated(
        Modulation(of="stiffness", intensity=0.5 * 2.0 * B_OF_MODULATED / W_OF_MODULATED**2)
    )
    assert explain(less).methods["simulate"] == "applies"
    assert simulate(
        scene_of_of_modulated(white, pairs=STOPS_OF_MODULATION), paths=8, duration=5.0
    ).coordinates


def test_large_motions_that_are_rare_are_told() -> None:
    """Fourth moments end before mean squares do."""
    boundary = 2.0 * B_OF_MODULATED / W_OF_MODULATED**2
    for share, told in ((0.3, False), (0.9, True)):
        scene = scene_of_of_modulated(Modulation(of="stiffness", intensity=share * boundary))
        found = simulate(scene, paths=8, duration=5.0)
        assert any("fourth moments" in each for each in found.warnings) == told


def test_explain_names_modulations() -> None:
    found = explain(
        scene_of_of_modulated(Modulation(of="damping", amplitude=0.5, frequency_hz=1.0))
    )
    assert "modulation of damping by a sine on x" in found.effects
    assert "modulation" not in found.absent
    for method in ("exact", "fokker-planck", "average", "linearise"):
        assert "structure.damping must be constant, got a modulation" in found.methods[method]


@pytest.mark.parametrize("calculation", [*OTHER_METHODS, linearise])
def test_other_methods_refuse_modulations(calculation: Any) -> None:
    modulation = Modulation(of="stiffness", amplitude=0.5, frequency_hz=1.0)
    mount = Isolator(
        mass=M_OF_MODULATED,
        damping=M_OF_MODULATED * B_OF_MODULATED,
        stiffness=M_OF_MODULATED * W_OF_MODULATED**2,
    )
    noise = WhiteNoise(intensity=0.1)
    scene = Scene(
        structure=mount, impact_pairs=STOPS_OF_MODULATION, excitations=[noise, modulation]
    )
    with pytest.raises(NotApplicable, match=r"structure\.stiffness must be constant"):
        calculation(scene)


def test_a_modulating_sine_is_no_force() -> None:
    """Beside a force of the same frequency each keeps its own phase."""
    modulation = Modulation(of="stiffness", amplitude=0.3, frequency_hz=0.2)
    forced = scene_of_of_modulated(modulation, noise=0.0)
    forced = forced.replace(excitations=[Sine(amplitude=0.5, frequency_hz=0.31), modulation])
    assert simulate(forced, paths=64, duration=50.0).coordinates["x"]["velocity_std"].value > 0.0
