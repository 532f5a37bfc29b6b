"""Drives that switch, against integrations of their equation of motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from stochvi import (
    Elastic,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    harmonic_response,
)
from stochvi.methods.periodic import (
    Motor,
    RelayBetweenStops,
    StructureResonance,
    SwitchedDrive,
    sine_power,
)
from stochvi.methods.periodic.sine_response import COLUMNS, Branch, HarmonicResponse
from stochvi.model.model import model_of
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import plan_modal
from stochvi.results.estimates import Estimate
from stochvi.scenes import Beam, Modes
from stochvi.scenes.excitations import ConstantLoad, Sine
from stochvi.scenes.keys import changed_scene
from support.accuracies import quick_cases
from support.bounces import Bounces
from support.refusals import refusals

# ------------------------------------------------------------------------------
# Percussion machines under a sine: section 4 of the book, and an event-driven simulation.
# ------------------------------------------------------------------------------


PAIR = ("striker", "body")


def hammer(feed: float, restitution: float, body: float, damping: float = 0.0) -> Scene:
    """A striker of 1 kg on a spring of 1 N/m to its body, under a force of 1 N between the two."""
    couple = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return Scene(
        structure=Matrices(
            coordinates=PAIR, mass=np.diag([1.0, body]), damping=damping * couple, stiffness=couple
        ),
        impact_pairs=[
            ImpactPair(on="striker", upper=0.0, law=Restitution(coefficient=restitution))
        ],
        excitations=[
            ConstantLoad(on="body", force=feed),
            Sine(between=PAIR, amplitude=1.0, frequency_hz=0.2),
        ],
    )


def hertz(ratio: float, body: float) -> float:
    """A frequency over that of the two masses on their spring, in Hz."""
    return ratio * math.sqrt(1.0 + 1.0 / body) / (2.0 * math.pi)


def single(found: HarmonicResponse) -> list[Branch]:
    """Branches of one impact in each period."""
    return [each for each in found.branches if len(each.stops) == each.periods == 1]


def end_of_range(feed: float, restitution: float, *, above: bool) -> float:
    """Where (4.21) ends, G / P = (1 / pi) (1 + R) / (1 - R) zeta^2 / |1 - zeta^2|."""
    lossy = (1.0 + restitution) / (1.0 - restitution) / math.pi
    sign = 1.0 if above else -1.0
    return math.sqrt(feed / (feed - sign * lossy))


@pytest.mark.slow
@quick_cases(
    ("feed", "restitution", "body", "above"),
    [(0.4, 0.5, 3.0, False), (0.8, 0.7, 0.7, False), (0.9, 0.3, 5.0, True), (1.2, 0.3, 5.0, True)],
    keep=(1, 3),
)
def test_regimes_end_in_a_fold_at_the_limit_of_the_book(
    feed: float, restitution: float, body: float, above: bool
) -> None:
    end = end_of_range(feed, restitution, above=above)
    around = [hertz(end * (1.0 + part), body) for part in np.linspace(-0.02, 0.02, 5)]
    found = harmonic_response(hammer(feed, restitution, body), around, most_impacts=1)
    branch = next(each for each in single(found) if "fold" in each.names)
    place = branch.names.index("fold")
    assert branch.frequency_hz[place] == pytest.approx(hertz(end, body), rel=1e-6)
    # (4.20): momentum gives the speed of an impact, on either branch
    speed = 2.0 * math.pi * feed / (1.0 + restitution) / (2.0 * math.pi * branch.frequency_hz)
    assert branch.impact_speed[:, 0] == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("body", [2.0, 50.0])
@pytest.mark.parametrize(("share", "branches"), [(0.97, 1), (1.03, 2)])
def test_both_branches_exist_from_the_feed_of_the_book(
    body: float, share: float, branches: int
) -> None:
    """(4.28), G / P > (M1 + M2) / (2 M2), which is 1 / 2 of a heavy body (4.12)."""
    feed = share * (1.0 + body) / (2.0 * body)
    found = harmonic_response(hammer(feed, 1.0, body), hertz(1.001, body), most_impacts=1)
    assert len(single(found)) == branches


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_hammers_strike_as_an_event_driven_simulation(seed: int) -> None:
    random = np.random.default_rng(seed)
    scene = hammer(
        random.uniform(0.1, 0.6), random.uniform(0.1, 0.8), random.uniform(0.5, 20.0),
        random.uniform(0.05, 0.3),
    )  # fmt: skip
    where = hertz(random.uniform(0.6, 1.6), scene.structure.mass[1][1])
    found = harmonic_response(scene, where)
    moving = changed_scene(scene.document(), (("excitation.1.frequency_hz", where),))
    compared = 0
    for branch in found.branches:
        for place in [] if branch.sticking else branch.at(where):
            flight = Bounces(moving)
            before = flight.start(
                branch.displacement[place], branch.velocity[place], float(branch.phase[place, 0])
            )
            stop = [f"{pair.name} {each.name}" for pair, each in flight.stops].index(
                branch.stops[0]
            )
            count = len(branch.stops)
            hits = flight.impacts(flight.struck(before, stop), count, 9.0 / where)
            speeds = [flight.speed(state, number) for _, number, state in hits]
            expected = [*branch.impact_speed[place, 1:], branch.impact_speed[place, 0]]
            assert speeds == pytest.approx(expected, abs=1e-9 * max(1.0, branch.multiplier[place]))
            assert hits[-1][0] == pytest.approx(branch.periods / where, rel=1e-9)
            compared += 1
    assert compared


def test_a_free_body_under_a_feed_has_no_motion_without_impacts() -> None:
    found = harmonic_response(hammer(0.4, 0.5, 3.0), hertz(0.9, 3.0))
    assert found.branches
    assert all(each.stops for each in found.branches)


def test_a_crank_is_a_force_that_grows_with_the_spring_and_the_damper() -> None:
    turned = hammer(0.3, 0.2, 10.0, damping=0.2)
    crank = Sine(between=PAIR, displacement=0.7, frequency_hz=0.2)
    scene = turned.model_copy(update={"excitations": (turned.excitations[0], crank)})
    omega = 2.0 * math.pi * 0.2
    force = Sine(between=PAIR, amplitude=0.7 * math.hypot(1.0, 0.2 * omega), frequency_hz=0.2)
    same = turned.model_copy(update={"excitations": (turned.excitations[0], force)})
    one, other = (harmonic_response(each, 0.2).at(0.2) for each in (scene, same))
    columns = ["displacement_max", "impact_speed_max", "multiplier"]
    np.testing.assert_allclose(one[columns], other[columns], rtol=1e-9)
    # the phase, by which the damper leads, is that of the force: seen beside a second crank
    assert model_of(scene).sines[0].phase == pytest.approx(math.atan(0.2 * omega))


@pytest.mark.slow
def test_where_no_regime_is_found_the_table_is_empty_and_has_its_columns() -> None:
    found = harmonic_response(hammer(5.0, 0.5, 3.0), hertz(0.9, 3.0), most_impacts=1)
    assert not found.branches
    assert found.at(hertz(0.9, 3.0)).columns.tolist() == list(COLUMNS)


# ------------------------------------------------------------------------------
# A motor of limited power, against an integration of its own equations of motion.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# A relay between two stops, against integrations of its equation of motion.
# ------------------------------------------------------------------------------


DRIVES = [
    {"force": 2.0, "clearance": 0.5, "restitution": 0.6},
    {"force": 2.0, "clearance": 0.5, "restitution": 0.6, "frequency": 3.0},
    {"force": 1.0, "clearance": 0.4, "restitution": 0.8, "damping_rate": 0.5, "frequency": 1.0},
    {"force": 3.0, "clearance": 0.4, "restitution": 1.0, "damping_rate": 0.7, "frequency": 0.2},
    {"force": 3.0, "clearance": 0.7, "restitution": 0.3, "damping_rate": 5.0, "frequency": 1.5},
]


def flight(drive: RelayBetweenStops, speed: float) -> tuple[float, float]:
    """Duration and last speed of a flight, by an integrator with events."""

    def there(t: float, y: np.ndarray) -> float:
        return y[0] - drive.clearance

    there.terminal, there.direction = True, 1.0
    solved = solve_ivp(
        lambda t, y: [
            y[1], drive.force * np.sign(y[1]) - drive.damping_rate * y[1]
            - drive.frequency**2 * y[0],
        ],
        (0.0, 100.0), [-drive.clearance, max(drive.restitution * speed, 1e-12)], events=there,
        rtol=1e-11, atol=1e-13, max_step=0.01,
    )  # fmt: skip
    return float(solved.t[-1]), float(solved.y[1, -1])


@pytest.mark.parametrize("keys", DRIVES)
def test_flights_are_those_of_the_equation_of_motion(keys: dict[str, float]) -> None:
    drive = RelayBetweenStops(**keys)
    for speed in (0.0, 0.3, drive.impact_speed, 7.0):
        assert drive.flight(speed) == pytest.approx(flight(drive, speed), rel=1e-7)
    assert drive.next_speed(drive.impact_speed) == pytest.approx(drive.impact_speed, rel=1e-11)
    assert drive.period == pytest.approx(2.0 * flight(drive, drive.impact_speed)[0], rel=1e-7)
    off = [flight(drive, drive.impact_speed + d)[1] for d in (-1e-3, 1e-3)]
    assert (off[1] - off[0]) / 2e-3 == pytest.approx(drive.forgotten, rel=1e-4, abs=1e-6)
    assert abs(drive.forgotten) < 1.0
    # the control: another force is another speed
    other = RelayBetweenStops(**keys | {"force": 1.05 * keys["force"]})
    assert other.impact_speed > 1.01 * drive.impact_speed


def test_without_a_damper_the_speed_is_that_of_the_work() -> None:
    for frequency in (0.0, 1.0, 3.0):
        drive = RelayBetweenStops(force=2.0, clearance=0.5, restitution=0.6, frequency=frequency)
        assert drive.impact_speed == pytest.approx(2.0 * math.sqrt(1.0 / (1.0 - 0.36)), rel=1e-11)


def test_the_least_force_is_that_at_which_the_free_motion_reaches_the_stops() -> None:
    """The amplitude of the motion without stops, by an integrator, at the force that is stated."""
    keys: dict[str, Any] = {"clearance": 0.5, "restitution": 0.6, "damping_rate": 0.3}
    keys["frequency"] = 2.0
    least = RelayBetweenStops(force=10.0, **keys).least_force
    y, highest = [0.0, 0.1], 0.0
    for _ in range(90):  # half swings, between turning points
        side = 1.0 if y[1] > 0.0 else -1.0

        def turns(t: float, y: np.ndarray) -> float:
            return y[1]

        turns.terminal = True
        solved = solve_ivp(
            lambda t, y, side=side: [y[1], least * side - 0.3 * y[1] - 4.0 * y[0]],
            (0.0, 100.0), y, events=turns, rtol=1e-11, atol=1e-13, first_step=1e-6,
        )  # fmt: skip
        highest = abs(float(solved.y[0, -1]))
        y = [float(solved.y[0, -1]), -side * 1e-14]
    assert highest == pytest.approx(0.5, rel=1e-6)
    assert RelayBetweenStops(force=1.001 * least, **keys).impact_speed < 0.2
    with pytest.raises(ValueError, match="the mass does not reach its stops"):
        RelayBetweenStops(force=0.999 * least, **keys)
    # of the first harmonic: without loss at impacts it is pi / 4 c w0 b
    elastic = RelayBetweenStops(force=10.0, **keys | {"restitution": 1.0})
    assert elastic.harmonic_least_force == pytest.approx(least, rel=0.01)
    assert RelayBetweenStops(force=10.0, **keys).harmonic_least_force > 1.3 * least


def test_the_first_harmonic_solves_its_balance() -> None:
    """4 U / (pi c w) = b + p w (B 12.20, 12.21); without spring and damper it is off by the factor
    4 / (pi (1 + R)), as the speed of a square wave of force is no sine."""
    for keys in DRIVES:
        drive = RelayBetweenStops(**keys)
        w, p = drive.harmonic_frequency, (1.0 - drive.restitution**2) / math.pi
        force = 4.0 * drive.force / (math.pi * drive.clearance * w)
        assert force == pytest.approx(drive.damping_rate + p * w, rel=1e-12)
    drive = RelayBetweenStops(**DRIVES[0])
    ratio = drive.harmonic_frequency * drive.period / (2.0 * math.pi)
    assert ratio == pytest.approx(4.0 / (math.pi * 1.6), rel=1e-9)


def test_speeds_scatter_as_restitutions_do() -> None:
    drive, std = RelayBetweenStops(**DRIVES[2]), 0.02
    random = np.random.default_rng(4)
    speed, found = drive.impact_speed, []
    for r in 0.8 + std * random.standard_normal(4000):
        speed = drive.next_speed(speed * r / 0.8)
        found.append(speed)
    q = drive.forgotten
    count = len(found) * (1.0 - q**2) / (1.0 + q**2)
    spread = float(np.std(found[20:]))
    assert spread == pytest.approx(drive.speed_std(std), rel=4.5 / math.sqrt(2.0 * count) + 0.01)
    memoryless = abs(q) * drive.impact_speed * std / 0.8  # the control
    assert abs(memoryless - spread) > 2.0 * abs(drive.speed_std(std) - spread)


test_numbers_out_of_range_are_named = refusals(
    lambda keys: RelayBetweenStops(**{"force": 2.0, "clearance": 0.5, "restitution": 0.5} | keys),
    ({"force": 0.0}, "force must be greater than 0, got 0"),
    ({"restitution": 1.1}, "restitution must be in [0, 1], got 1.1"),
    ({"restitution": 1.0}, "damping_rate must be greater than 0 with a restitution of 1"),
    ({"damping_rate": -1.0}, "damping_rate must be 0 or more, got -1"),
    ({"frequency": 10.0, "damping_rate": 1.0}, "force must be greater than"),
    error=ValueError,
)


# ------------------------------------------------------------------------------
# Resonance of a structure that noise would have to maintain: its regimes, power and durations.
# ------------------------------------------------------------------------------


MASS = np.diag([2.0, 1.0, 1.5])
STIFFNESS = np.array([[5.0, -2.0, 0.0], [-2.0, 4.0, -1.0], [0.0, -1.0, 3.0]])
DAMPING = 0.01 * STIFFNESS


def chain(*pairs: ImpactPair, noise: Any = None, damping: float = 1.0) -> Scene:
    """Three masses on springs."""
    return Scene(
        structure=Matrices(
            coordinates=["a", "b", "c"], mass=MASS, damping=damping * DAMPING, stiffness=STIFFNESS
        ),
        impact_pairs=list(pairs),
        excitations=[noise or WhiteNoise(on="b", intensity=0.02)],
    )


def stop(name: str = "stop", on: Any = "c", restitution: float = 0.8, **at: float) -> ImpactPair:
    place = {"between": on} if isinstance(on, list) else {"on": on}
    return ImpactPair(name=name, **place, **at, law=Restitution(coefficient=restitution))


SCENES: dict[str, tuple[Scene, float, dict[str, Any]]] = {
    "one stop": (chain(stop(upper=1.0)), 1.17, {}),
    "lower stop": (chain(stop(lower=-1.0)), 1.17, {}),
    "two stops": (chain(stop(clearance=1.0)), 1.6, {}),
    "between two masses": (chain(stop(on=["a", "c"], clearance=1.0)), 2.6, {}),
    "two pairs": (chain(stop("one", "a", clearance=0.8), stop("two", clearance=1.0)), 1.6, {}),
    "opposed pairs": (
        chain(stop("one", "a", clearance=0.5), stop("two", clearance=1.0)), 2.2,
        {"opposed": ["one"]},
    ),
}  # fmt: skip
"""A scene, the frequency of a regime in rad/s, and what else says which one."""


def found(name: str) -> tuple[Scene, StructureResonance]:
    scene, frequency, how = SCENES[name]
    return scene, StructureResonance.of(scene, frequency / math.tau, **how)


def from_impact_to_impact(
    scene: Scene, case: StructureResonance, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """States (2 n, steps + 1) of the masses in one period without loss, by the flow of the
    undamped structure, from just after an impact; impacts on their pairs by the impulses given."""
    model = model_of(scene)
    n, h = 3, case.period / steps
    generator = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(MASS, STIFFNESS), np.zeros((n, n))]]
    )
    flow = scipy.linalg.expm(generator * h)
    shapes = model.modal.shapes
    q, v = case.response(np.zeros(1))
    force = -np.asarray(case.gaps).T @ case.impulse
    state = np.concatenate([shapes @ (q[:, 0] * force), shapes @ (v[:, 0] * force)])
    states = [state]
    for step in range(1, steps + 1):
        state = flow @ state
        states.append(state)
        if case.both_sides and step == steps // 2:
            state = state.copy()
            state[n:] -= shapes @ force  # the impulse on the other stops
    return np.array(states).T, shapes @ force


@pytest.mark.parametrize("name", SCENES)
def test_a_regime_is_a_free_motion_from_impact_to_impact(name: str) -> None:
    scene, case = found(name)
    states, kick = from_impact_to_impact(scene, case, 2000)
    start, end = states[:, 0], states[:, -1]
    rows = np.asarray(case.gaps) @ np.linalg.inv(model_of(scene).modal.shapes)
    # the impulse at the end of the period makes the motion start again
    assert end[:3] == pytest.approx(start[:3], abs=1e-9)
    assert end[3:] + kick == pytest.approx(start[3:], abs=1e-9)
    assert rows @ start[:3] == pytest.approx(case.clearance, rel=1e-12)
    assert rows @ end[3:] == pytest.approx(case.impact_speed, rel=1e-9)
    assert rows @ start[3:] == pytest.approx(-case.impact_speed, rel=1e-9)
    assert case.admissible
    strain = start[:3] @ STIFFNESS @ start[:3] + start[3:] @ MASS @ start[3:]
    assert case.energy == pytest.approx(0.5 * strain, rel=1e-12)
    # what noise on b supplies, and what dampers take
    speeds = states[3:, :-1]
    if not case.both_sides:
        speeds = 0.5 * (states[3:, :-1] + states[3:, 1:])
    damped = np.mean(np.einsum("it,ij,jt->t", speeds, DAMPING, speeds))
    impacts = (2.0 if case.both_sides else 1.0) / case.period
    lost = impacts * (0.2 / 1.8) * float(case.impulse @ case.impact_speed)
    assert case.power_loss == pytest.approx(damped + lost, rel=5e-3)
    square = np.mean(speeds[1] ** 2)
    assert case.random_power(7.0) == pytest.approx(math.sqrt(0.02 * square / 7.0), rel=5e-3)


def test_one_mass_is_the_case_of_one_mode() -> None:
    scene = Scene(
        structure={"kind": "oscillator", "mass": 2.0, "damping": 0.04, "stiffness": 2.0},
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=0.8))],
        excitations=[WhiteNoise(intensity=0.04)],
    )
    one = StructureResonance(
        omega=[1.0], damping=[[0.02]], gaps=[[1.0]], clearance=[1.0], restitution=[0.8],
        frequency=1.7, both_sides=True, noises=[(0.01, [1.0])],
    )  # fmt: skip
    case = StructureResonance.of(scene, 1.7 / math.tau)
    assert case.impact_speed[0] == pytest.approx(one.impact_speed[0], rel=1e-12)
    assert case.power_loss == pytest.approx(2.0 * one.power_loss, rel=1e-12)
    assert case.longest() == pytest.approx(one.longest(), rel=1e-12)


def test_noise_of_a_table_supplies_by_its_harmonics() -> None:
    flat = TabulatedNoise(on="b", frequency_hz=[1e-3, 100.0], density=[0.04, 0.04], unit="N2/Hz")
    _, white = found("two stops")
    table = StructureResonance.of(chain(stop(clearance=1.0), noise=flat), 1.6 / math.tau)
    assert table.longest() == pytest.approx(white.longest(), rel=5e-3)
    shapes = model_of(chain(stop(clearance=1.0))).modal.shapes
    first = white.harmonics(shapes[1])[0]
    rms = white.smallest_narrow_band(shapes[1])
    assert 2.0537489106318225 * rms * first / 2.0 == pytest.approx(white.power_loss)


def share_maintained(scene: Scene, case: StructureResonance, seconds: float) -> Estimate:
    """Share of paths that start in the regime and have its number of impacts in this time."""
    plan = plan_modal(model_of(scene), 0.0, None)
    steps = math.ceil(seconds / plan.step)
    plan, paths = plan.with_step(seconds / steps), 2000
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(5), 0, streams)
    q, v = case.response(np.zeros(1))
    force = (-np.asarray(case.gaps).T @ case.impulse)[:, None]
    state = np.ascontiguousarray(np.tile(np.concatenate([q * force, v * force]), paths))
    hits = plan.counts(state, streams, steps)[0].sum(axis=0)
    wanted = seconds / case.period * (2.0 if case.both_sides else 1.0)
    share = float(np.mean(hits >= math.floor(wanted)))
    return Estimate(value=share, standard_error=math.sqrt(max(share, 1e-3) / paths))


@pytest.mark.parametrize(("restitution", "frequency"), [(0.99, 1.9), (0.8, 1.6)])
def test_paths_have_left_the_regime_by_its_end(restitution: float, frequency: float) -> None:
    """In 98 % of paths at least; two periods after its start more than these keep it up."""
    pair = stop(clearance=1.0, restitution=restitution)
    scene = chain(pair, noise=WhiteNoise(on="b", intensity=0.02), damping=0.05)
    case = StructureResonance.of(scene, frequency / math.tau)
    late = share_maintained(scene, case, case.ended_by())
    assert late.value - 4.5 * late.standard_error < 0.02
    early = share_maintained(scene, case, 2.0 * case.period)
    assert early.value - 4.5 * early.standard_error > 0.02
    assert case.ended_by() > max(case.longest(), case.energy / case.power_loss)


def test_a_faster_regime_of_a_beam_is_harder_to_maintain() -> None:
    """Above its first natural frequency a cantilever slaps faster, and noise loses hold of it."""
    reed = Beam(
        length=0.2, width=0.02, height=0.002, young=2e11, density=7850.0, zeta=0.01, modes=4
    )
    scene = Scene(
        structure=reed, impact_pairs=[stop(on="tip", upper=1e-3)],
        excitations=[WhiteNoise(on="base", density=0.01, unit="g2/Hz")],
    )  # fmt: skip
    first = reed.natural_frequency_hz[0]
    speeds = [StructureResonance.of(scene, f * first).impact_speed[0] for f in (1.02, 1.05, 1.2)]
    assert speeds[0] < speeds[1] < speeds[2]
    lasting = [StructureResonance.of(scene, f * first).longest() for f in (1.02, 1.05, 1.2)]
    assert lasting[0] > lasting[1] > lasting[2]


test_what_has_no_such_regime_is_refused = refusals(
    lambda scene, how: StructureResonance.of(scene, 0.2, **how),
    (chain(), {}, "the scene needs an impact_pair"),
    (chain(stop(upper=1.0)), {"pairs": ["no"]}, "pairs must be among stop, got 'no'"),
    (chain(stop(upper=1.0)), {"opposed": ["stop"]}, "opposed must name pairs with two stops"),
    (chain(stop(lower=-1.0, upper=2.0)), {}, "must lie evenly about its mean position"),
    (
        chain(stop(upper=1.0), noise=Sine(on="b", amplitude=1.0, frequency_hz=1.0)),
        {},
        "excitation must be white or tabulated noise",
    ),
    (
        chain(stop("one", upper=1.0), stop("two", "a", clearance=1.0)),
        {},
        "pairs must all have one stop or all have two",
    ),
    error=NotApplicable,
)


def test_a_frequency_without_a_regime_is_refused() -> None:
    with pytest.raises(ValueError, match="no free motion meets the stops at"):
        StructureResonance.of(chain(stop(upper=1.0)), 1.02 / math.tau)


# Under a sine ------------------------------------------------------------------------------


def test_the_first_point_of_a_structure_is_shown_under_a_sine() -> None:
    """Its motion without impacts is a sum over modes, and so is its absolute acceleration."""
    blade = Modes(
        frequency_hz=[20.0, 125.0], zeta=0.02, shapes={"tip": [1.0, -0.8], "seat": [0.3, 0.5]},
        participation=[1.5, -0.8],
    )  # fmt: skip
    sine = Sine(on="base", amplitude=3.0, frequency_hz=23.0)
    scene = Scene(structure=blade, impact_pairs=[stop(on="tip", upper=1.0)], excitations=[sine])
    w, table = math.tau * 23.0, blade.table
    rate = 2.0 * table.zeta * table.omega
    motion = -3.0 * np.array([1.5, -0.8]) / (table.omega**2 - w**2 + 1j * rate * w)
    carried = motion * -(table.omega**2 + 1j * rate * w)  # q'' + G a
    for place in (None, "seat"):
        found = harmonic_response(scene, coordinate=place)
        shape = table.shapes[place or "tip"]
        assert found.coordinate == (place or "tip")
        (branch,) = found.branches
        assert branch.displacement_max[0] == pytest.approx(abs(shape @ motion), rel=1e-6)
        assert branch.amplitude[0] == pytest.approx(abs(shape @ motion), rel=1e-9)
        assert branch.acceleration_max[0] == pytest.approx(abs(shape @ carried), rel=1e-5)
    with pytest.raises(ValueError, match="must be one of mode 1, mode 2, tip, seat, got"):
        harmonic_response(scene, coordinate="base")


def test_one_mode_under_a_sine_is_shown_at_its_gap() -> None:
    reed = Modes(frequency_hz=[20.0], zeta=0.02, shapes={"tip": [1.0], "seat": [0.5]})
    sine = Sine(on="tip", amplitude=3.0, frequency_hz=23.0)
    scene = Scene(structure=reed, impact_pairs=[stop(on="seat", upper=1.0)], excitations=[sine])
    assert harmonic_response(scene).coordinate == "seat"


# ------------------------------------------------------------------------------
# Drives that switch, against integrations of their equation of motion.
# ------------------------------------------------------------------------------


def simulated(drive: SwitchedDrive, speed: float, impacts: int) -> tuple[list[float], float, float]:
    """Impact speeds after one of a speed, and height and duration of the last flight, by an
    integrator with events, a piece for each force."""
    up, down = drive.force - drive.load, -drive.force - drive.load
    speeds, highest, lasted = [], 0.0, 0.0
    for _ in range(impacts):
        state, lasted = [0.0, drive.restitution * speed], 0.0
        for force, reaches in ((up, drive.switching), (down, 0.0)):

            def there(t: float, y: np.ndarray, reaches: float = reaches) -> float:
                return y[0] - reaches

            there.terminal, there.direction = True, 1.0 if force > 0.0 else -1.0
            solved = solve_ivp(
                lambda t, y, force=force: [y[1], force], (0.0, 100.0), state, events=there,
                rtol=1e-10, atol=1e-12, max_step=2e-3,
            )  # fmt: skip
            state, lasted = solved.y[:, -1].tolist(), lasted + float(solved.t[-1])
            highest = float(solved.y[0].max())
        speed = -state[1]
        speeds.append(speed)
    return speeds, highest, lasted


@pytest.mark.parametrize(("restitution", "load"), [(0.5, 0.0), (0.8, 3.0), (0.2, 7.0)])
def test_impacts_are_those_of_the_equation_of_motion(restitution: float, load: float) -> None:
    drive = SwitchedDrive(restitution=restitution, force=10.0, switching=0.3, load=load)
    speeds, _, _ = simulated(drive, 0.0, 3)
    assert speeds == pytest.approx(drive.start_up(0.0, 3).tolist(), rel=1e-6)
    again, highest, period = simulated(drive, drive.impact_speed, 1)
    assert again == pytest.approx([drive.impact_speed], rel=1e-6)
    assert (highest, period) == pytest.approx((drive.highest, drive.period), rel=1e-4)
    off = [simulated(drive, drive.impact_speed + d, 1)[0][0] for d in (-0.01, 0.01)]
    assert (off[1] - off[0]) / 0.02 == pytest.approx(drive.forgotten, rel=1e-3)


def test_the_strongest_drive_has_its_period_and_no_other_is_stronger() -> None:
    """Two switches at any times of the period give slower impacts."""
    drive = SwitchedDrive.strongest(restitution=0.5, force=10.0, period=1.0)
    assert (drive.switching, drive.impact_speed) == pytest.approx((0.4329, 4.805), abs=5e-5 + 5e-4)
    assert drive.period == pytest.approx(1.0, rel=1e-12)
    loaded = SwitchedDrive.strongest(restitution=0.3, force=10.0, period=0.7, load=4.0)
    assert loaded.period == pytest.approx(0.7, rel=1e-12)

    def speed_of(share: float) -> float:
        """Impact speed where a part of the thrust is left out: then it must begin earlier."""
        longer = minimize_scalar(
            lambda t: abs(_returns(t, share)), bounds=(0.01, 0.9), method="bounded",
            options={"xatol": 1e-12},
        ).x  # fmt: skip
        return (10.0 * (1.0 - longer) - 10.0 * share * longer) / 1.5

    def _returns(t: float, share: float) -> float:
        """Displacement after the period 1 with the thrust 10 share for t, then -10."""
        speed = (10.0 * (1.0 - t) - 10.0 * share * t) / 1.5
        after = 0.5 * speed
        turned = after + 10.0 * share * t
        rest = 1.0 - t
        return after * t + 5.0 * share * t**2 + turned * rest - 5.0 * rest**2

    assert speed_of(1.0) == pytest.approx(drive.impact_speed, rel=1e-6)
    assert speed_of(0.8) < drive.impact_speed


def test_the_start_that_the_book_prints() -> None:
    """From its x* = 0.45 m the map gives 4.2, 4.75 and 4.87 m/s of 4.9 m/s, as printed."""
    book = SwitchedDrive(restitution=0.5, force=10.0, switching=0.45)
    assert book.start_up(0.0, 3) == pytest.approx([4.2, 4.75, 4.87], abs=0.05)
    assert book.impact_speed == pytest.approx(4.9, abs=0.005)


def delayed(
    drive: SwitchedDrive, restitution: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and times of impacts (impacts, paths) of strikers whose relay sees where each of them
    was a time `delay` ago, by small steps with a buffer; restitutions (impacts, paths).

    The relay pulls up from the impact on, or rather from when it sees it, until it sees x*.
    """
    impacts, paths = restitution.shape
    lag = round(drive.delay / step)
    x, v, time = np.zeros(paths), np.full(paths, 1e-9), 0.0
    seen_up = np.ones((lag + 1, paths), bool)  # what the relay will see, in a ring
    wants_up = np.ones(paths, bool)
    count, number = np.zeros(paths, int), 0
    speeds, times = np.zeros((2, impacts, paths))
    while count.min() < impacts:
        seen_up[number % (lag + 1)] = wants_up
        up = seen_up[(number + 1) % (lag + 1)]
        a = np.where(up, drive.force, -drive.force) - drive.load
        x1, v1 = x + v * step + 0.5 * a * step**2, v + a * step
        hit = (x1 < 0.0) & (v1 < 0.0)
        inside = np.sqrt(np.maximum(v**2 - 2.0 * a * x, 0.0))  # speed where x = 0
        which = np.flatnonzero(hit)
        for i in which:
            if count[i] < impacts:
                w, s = inside[i], (inside[i] + v[i]) / -a[i]
                speeds[count[i], i], times[count[i], i] = w, time + s
                u, rest = restitution[count[i], i] * w, step - s
                x1[i], v1[i] = u * rest + 0.5 * a[i] * rest**2, u + a[i] * rest
            else:
                x1[i], v1[i] = 0.0, 0.0
            count[i] += 1
        wants_up = np.where(hit, True, wants_up & (x1 < drive.switching))
        x, v, time, number = x1, v1, time + step, number + 1
    return speeds, times


@pytest.mark.slow
@pytest.mark.parametrize(
    ("restitution", "load", "delay"), [(0.5, 0.0, 0.03), (0.7, 3.0, 0.05), (0.6, 0.0, 0.1)]
)
def test_a_delayed_drive_is_that_of_a_relay_that_sees_the_past(
    restitution: float, load: float, delay: float
) -> None:
    drive = SwitchedDrive(
        restitution=restitution, force=10.0, switching=0.3, load=load, delay=delay
    )
    step, impacts = 2e-4, 12
    speeds, times = delayed(drive, np.full((impacts, 1), restitution), step)
    # a relay that sees a step late reverses a step late
    error = 4.0 * drive.force * step
    assert speeds[:4, 0] == pytest.approx(drive.start_up(0.0, 4), abs=error)
    assert speeds[-1, 0] == pytest.approx(drive.impact_speed, abs=error)
    assert times[-1, 0] - times[-2, 0] == pytest.approx(drive.period, abs=8.0 * step)
    off = [drive.next_speed(drive.impact_speed + d) for d in (-1e-4, 1e-4)]
    assert (off[1] - off[0]) / 2e-4 == pytest.approx(drive.forgotten, rel=1e-5)
    at_once = SwitchedDrive(restitution=restitution, force=10.0, switching=0.3, load=load)
    assert abs(at_once.impact_speed - drive.impact_speed) > 3.0 * error  # the control
    assert abs(at_once.forgotten - drive.forgotten) > 0.02


@pytest.mark.slow
def test_speeds_scatter_as_restitutions_do_switched() -> None:
    drive = SwitchedDrive(restitution=0.6, force=10.0, switching=0.3, delay=0.04)
    std, paths, impacts = 0.03, 300, 20
    drawn = 0.6 + std * np.random.default_rng(3).standard_normal((impacts, paths))
    speeds, _ = delayed(drive, drawn, 2e-4)
    settled = speeds[8:]
    found = float(settled.std())
    # paths are independent, impacts of one are correlated by q: fewer count
    q = drive.forgotten
    count = settled.size * (1.0 - q**2) / (1.0 + q**2)
    known = drive.speed_std(std)
    first_order = (std / 0.6) ** 2
    assert found == pytest.approx(known, rel=4.5 / np.sqrt(2.0 * count) + first_order)
    memoryless = abs(q) * drive.impact_speed * std / 0.6  # the control: without a memory
    assert abs(memoryless - found) > 2.0 * abs(known - found)
    still = SwitchedDrive(restitution=0.0, force=10.0, switching=0.3)
    assert still.speed_std(0.1) == 0.0


@pytest.mark.parametrize(
    ("restitution", "std", "delay"), [(0.3, 0.05, 0.03), (0.5, 0.05, 0.1), (0.6, 0.1, 0.0)]
)
def test_the_scatter_of_speeds_holds_where_the_first_order_fails(
    restitution: float, std: float, delay: float
) -> None:
    """Impact by impact by closed throws of this test, each with a restitution of its own."""
    force, switching, count = 10.0, 0.3, 40_000
    drive = SwitchedDrive(restitution=restitution, force=force, switching=switching, delay=delay)
    random, speed = np.random.default_rng(5), np.full(count, drive.impact_speed)
    for _ in range(12):
        u = np.maximum(restitution + std * random.standard_normal(count), 0.0) * speed
        thrown, rising = u * delay - force * delay**2 / 2.0, u - force * delay
        passing = np.sqrt(rising**2 + 2.0 * force * (switching - thrown))
        late = switching + passing * delay + force * delay**2 / 2.0
        speed = np.sqrt(u**2 + 4.0 * force * (late - thrown))
    found, known = float(speed.std()), drive.speed_std(std)
    # what the third order adds, and the error of a standard deviation of skewed numbers
    higher = 2.0 * (std / restitution) ** 2
    kurtosis = float(np.mean((speed - speed.mean()) ** 4)) / found**4
    assert found == pytest.approx(known, rel=higher + 4.5 * np.sqrt((kurtosis - 1.0) / 4.0 / count))
    if delay == 0.1:  # the control: the first order alone
        q = drive.forgotten
        first = abs(q) * drive.impact_speed * std / restitution / np.sqrt(1.0 - q**2)
        assert abs(first - found) > 3.0 * abs(known - found)


def test_a_force_that_comes_too_late_is_refused() -> None:
    late = SwitchedDrive(restitution=0.3, force=10.0, switching=0.3, delay=0.3)
    with pytest.raises(ValueError, match="delay must be so short that the striker neither falls"):
        late.next_speed(1.0)


test_numbers_out_of_range_are_named_switched = refusals(
    lambda keys: SwitchedDrive(**{"restitution": 0.5, "force": 10.0, "switching": 0.3} | keys),
    ({"restitution": 1.0}, "restitution must be in [0, 1), got 1"),
    ({"switching": 0.0}, "switching must be greater than 0, got 0"),
    ({"delay": -0.1}, "delay must be 0 or more, got -0.1"),
    ({"load": 10.0}, "load must be in [0, force), got 10 with force 10"),
    error=ValueError,
)
