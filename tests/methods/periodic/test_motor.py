"""A motor of limited power, against an integration of its own equations of motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    harmonic_response,
)
from stochvi.methods.periodic import Branch, Motor, sine_power

M, C, K, R, GAP, CRANK = 1.0, 0.4, 100.0, 0.6, 0.02, 0.002

State = tuple[float, ...]


def scene_of(**sine: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=M, damping=C, stiffness=K),
        impact_pairs=[ImpactPair(upper=GAP, law=Restitution(coefficient=R))],
        excitations=[Sine(**({"amplitude": K * CRANK, "frequency_hz": 1.6} | sine))],
    )


def stepped(rates: Callable[[State], State], state: State, h: float) -> State:
    """The classical method of Runge and Kutta."""
    a = rates(state)
    b = rates(tuple(s + 0.5 * h * k for s, k in zip(state, a, strict=True)))
    c = rates(tuple(s + 0.5 * h * k for s, k in zip(state, b, strict=True)))
    d = rates(tuple(s + h * k for s, k in zip(state, c, strict=True)))
    return tuple(
        s + h / 6.0 * (k + 2.0 * m + 2.0 * n + o)
        for s, k, m, n, o in zip(state, a, b, c, d, strict=True)
    )


def flown(
    rates: Callable[[State], State], state: State, seconds: float, h: float
) -> tuple[list[State], list[float]]:
    """States after each step, and impact speeds, of a mass whose displacement and velocity come
    first, between impacts on its stop."""
    states, speeds = [], []
    while len(states) * h < seconds:
        after = stepped(rates, state, h)
        if after[0] > GAP:
            low, high = 0.0, h
            for _ in range(45):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if stepped(rates, state, middle)[0] > GAP else (
                    middle, high
                )  # fmt: skip
            hit = stepped(rates, state, low)
            speeds.append(hit[1])
            after = stepped(rates, (GAP, -R * hit[1], *hit[2:]), h - low)
        state = after
        states.append(state)
    return states, speeds


def settled(
    motor: Motor, inertia: float, start_hz: float, state: State, seconds: float = 90.0
) -> tuple[float, float]:
    """Mean speed, turns per second, and last impact speed of a motor that turns the crank of a
    spring, with the torque of that spring on its shaft."""

    def rates(s: State) -> State:
        x, v, angle, w = s
        pull = K * (x - CRANK * math.sin(angle))
        torque = motor.slope * (2.0 * math.pi * motor.idle_hz - w)
        return v, (-pull - C * v) / M, w, (torque + pull * CRANK * math.cos(angle)) / inertia

    states, speeds = flown(rates, (*state, 0.0, 2.0 * math.pi * start_hz), seconds, 4e-3)
    last = np.array(states)[-len(states) // 5 :, 3]
    return float(last.mean() / (2.0 * math.pi)), speeds[-1] if speeds else 0.0


@pytest.fixture(scope="module")
def response() -> object:
    return harmonic_response(scene_of(), np.linspace(1.4, 2.2, 161))


@pytest.mark.slow
@pytest.mark.parametrize(("idle_hz", "slope"), [(1.9, 0.004), (1.8, 0.01)])
def test_a_motor_settles_where_the_table_says(
    idle_hz: float, slope: float, response: object
) -> None:
    motor = Motor(idle_hz=idle_hz, slope=slope)
    table = motor.regimes(scene_of(), response)  # type: ignore[arg-type]
    struck = table[(table["impact_speed_max"] > 0.0) & table["stable"]]
    free = table[(table["impact_speed_max"] == 0.0) & table["stable"]]
    assert len(struck) == len(free) == 1
    # run up from below the resonance, with impacts, and with a push into the motion without
    for row, start_hz in ((struck.iloc[0], 1.4), (free.iloc[0], idle_hz)):
        speeds = []
        for inertia in (0.02, 0.04):
            speed, impact = settled(motor, inertia, start_hz, (0.0, 0.0), 4500.0 * inertia)
            speeds.append(speed)
            assert impact == pytest.approx(row["impact_speed_max"], rel=2e-3)
        # the speed pulsates less, and the rest is the distance of the frequencies of the response
        slip = idle_hz - row["frequency_hz"]
        assert speeds == pytest.approx([row["frequency_hz"]] * 2, abs=0.02 * slip + 1e-5)
        # the control: a motor that is not loaded idles
        assert abs(idle_hz - row["frequency_hz"]) > 0.02 * slip + 1e-5


def test_regimes_between_both_are_unstable_where_the_load_falls_faster(response: object) -> None:
    """A soft motor on the far side of the resonance: the load falls faster than the torque."""
    soft, stiff = Motor(idle_hz=1.9, slope=0.004), Motor(idle_hz=1.84, slope=1.0)
    table = soft.regimes(scene_of(), response)  # type: ignore[arg-type]
    unstable = table[~table["stable"]]
    assert len(unstable) == 1
    speed, _ = settled(soft, 0.02, float(unstable["frequency_hz"].iloc[0]), (0.0, 0.0))
    assert abs(speed - unstable["frequency_hz"].iloc[0]) > 5e-3
    # a stiff one holds every regime that is stable at a given frequency
    held = stiff.regimes(scene_of(), response)  # type: ignore[arg-type]
    given = response.at(1.84)  # type: ignore[attr-defined]
    assert held["stable"].sum() == given["stable"].sum()


@pytest.mark.parametrize(("lag", "held"), [(80.0, True), (400.0, False)])
def test_a_torque_that_is_late_may_let_the_speed_swing_up(lag: float, held: bool) -> None:
    """Beyond the resonance of a mass without stops, where the load falls: the whole machine with
    the torque as a further state, from near the regime."""
    scene = scene_of().model_copy(update={"impact_pairs": ()})
    response = harmonic_response(scene, np.linspace(1.55, 1.8, 251))
    motor = Motor(idle_hz=1.645, slope=0.05, lag=lag, inertia=2.0)
    table = motor.regimes(scene, response)
    (at_once,) = Motor(idle_hz=1.645, slope=0.05).regimes(scene, response).itertuples()
    (row,) = table.itertuples()
    assert at_once.stable and row.stable == held
    assert row.frequency_hz == at_once.frequency_hz > math.sqrt(K / M) / (2.0 * math.pi)
    w0 = 2.0 * math.pi * row.frequency_hz

    def rates(s: State) -> State:
        x, v, angle, w, torque = s
        pull = K * (x - CRANK * math.sin(angle))
        wanted = motor.slope * (2.0 * math.pi * motor.idle_hz - w)
        turned = (torque + pull * CRANK * math.cos(angle)) / 2.0
        return v, (-pull - C * v) / M, w, turned, (wanted - torque) / lag

    # a free mass settles within 5 s, the speed within 100 s
    state: State = (0.0, 0.0, 0.0, w0 + 2e-3, row.torque)
    states = []
    for number in range(90_000):
        state = stepped(rates, state, 0.02)
        if number % 50 == 0:
            states.append(state[3] - w0)
    swings = np.abs(np.array(states))
    early, late = swings[100:700].max(), swings[-600:].max()
    assert late < 0.5 * early if held else late > 1.5 * early


def test_the_power_of_a_sine_is_what_is_lost() -> None:
    """With the amplitude of an unbalance, by the mean of force times velocity of own flights."""
    scene = scene_of(amplitude=None, unbalance=0.002, frequency_hz=1.6)  # type: ignore[arg-type]
    found = harmonic_response(scene, [1.6, 1.65])
    once = [b for b in found.branches if len(b.stops) == 1 and b.periods == 1]
    for frequency in (1.6, 1.65):
        w = 2.0 * math.pi * frequency
        force = 0.002 * w**2

        def rates(s: State, force: float = force, w: float = w) -> State:
            x, v, t = s
            return v, (force * math.cos(w * t) - C * v - K * x) / M, 1.0

        period = 2.0 * math.pi / w
        states, speeds = flown(rates, (0.0, 0.0, 0.0), 120.0 * period, period / 400.0)
        _, v, t = np.array(states[-40 * 400 :]).T
        known = float(np.mean(force * np.cos(w * t) * v))
        near = [
            sine_power(scene, b)[i]
            for b in once
            for i in b.at(frequency)
            if b.stable[i] and abs(b.impact_speed[i, 0] - speeds[-1]) < 1e-3
        ]
        assert near == [pytest.approx(known, rel=5e-3)]
        by_damper = C * float(np.mean(v**2))  # the control: what impacts lose is not small
        assert abs(by_damper - known) > 0.05 * known


def test_the_power_of_two_masses_is_that_of_dampers_and_impacts() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[2.0, 0.0], [0.0, 1.0]],
            damping=[[0.8, -0.2], [-0.2, 0.6]], stiffness=[[160.0, -60.0], [-60.0, 120.0]],
        ),
        impact_pairs=[
            ImpactPair(between=("b", "a"), lower=-0.02, law=Restitution(coefficient=R))
        ],
        excitations=[Sine(on="a", amplitude=5.0, frequency_hz=1.9)],
    )  # fmt: skip
    found = harmonic_response(scene, [1.2, 1.9])
    picked = [
        (branch, i)
        for branch in found.branches
        for i in (*branch.at(1.2), *branch.at(1.9))
        if branch.stops and branch.stable[i] and np.isfinite(branch.phase[i]).all()
    ]
    assert sorted(len(branch.stops) for branch, _ in picked) == [1, 3]
    for branch, i in picked:
        power = sine_power(scene, branch)[i]
        w = 2.0 * math.pi * float(branch.frequency_hz[i])
        lost = lost_in_a_period(branch, i, w)
        assert power * 2.0 * math.pi * branch.periods / w == pytest.approx(lost, rel=1e-4)


def lost_in_a_period(branch: Branch, point: int, w: float) -> float:
    """What impacts and dampers take, J, from the state before the first impact, by small steps,
    with the impacts when the branch has them."""
    inverse = np.array([0.5, 1.0])
    stiffness = np.array([[160.0, -60.0], [-60.0, 120.0]])
    damping = np.array([[0.8, -0.2], [-0.2, 0.6]])

    def rates(s: np.ndarray, t: float) -> np.ndarray:
        force = np.array([5.0 * math.cos(w * t), 0.0]) - damping @ s[2:] - stiffness @ s[:2]
        return np.concatenate([s[2:], inverse * force])

    s = np.concatenate([branch.displacement[point], branch.velocity[point]])
    times = (branch.phase[point] - branch.phase[point, 0]) / w
    t, lost, reduced = float(branch.phase[point, 0] / w), 0.0, 2.0 / 3.0
    for begins, ends in pairwise([*times, 2.0 * math.pi * branch.periods / w]):
        gap = s[3] - s[2]
        lost += 0.5 * (1.0 - R**2) * reduced * gap**2
        s[2:] -= (1.0 + R) * reduced * gap * np.array([-0.5, 1.0])
        h = (ends - begins) / 4000
        for _ in range(4000):
            middle = s + 0.5 * h * rates(s, t)
            lost += h * float(middle[2:] @ damping @ middle[2:])
            s, t = s + h * rates(middle, t + 0.5 * h), t + h
    return lost


def test_what_a_motor_cannot_turn_is_refused(response: object) -> None:
    with pytest.raises(ValueError, match="slope must be greater than 0, got 0"):
        Motor(idle_hz=1.0, slope=0.0)
    two = scene_of().replace(excitations=[Sine(amplitude=0.1, frequency_hz=f) for f in (1.0, 2.0)])
    with pytest.raises(NotApplicable, match="excitation must be one sine, got 2"):
        Motor(idle_hz=1.9, slope=0.004).regimes(two, response)  # type: ignore[arg-type]
    soft = scene_of().replace(impact_pairs=[ImpactPair(upper=GAP, law=Elastic(stiffness=1e4))])
    with pytest.raises(NotApplicable, match=r"law\.kind must be 'restitution'"):
        Motor(idle_hz=1.9, slope=0.004).regimes(soft, response)  # type: ignore[arg-type]
    wide = harmonic_response(scene_of(), vary={"impact_pair.0.upper": [0.015, 0.02]})
    with pytest.raises(NotApplicable, match="the response must be one over frequency_hz"):
        Motor(idle_hz=1.9, slope=0.004).regimes(scene_of(), wide)
