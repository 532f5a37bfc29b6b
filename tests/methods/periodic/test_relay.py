"""A relay between two stops, against integrations of its equation of motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi.methods.periodic import RelayBetweenStops

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


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"force": 0.0}, "force must be greater than 0, got 0"),
        ({"restitution": 1.1}, r"restitution must be in \[0, 1\], got 1.1"),
        ({"restitution": 1.0}, "damping_rate must be greater than 0 with a restitution of 1"),
        ({"damping_rate": -1.0}, "damping_rate must be 0 or more, got -1"),
        ({"frequency": 10.0, "damping_rate": 1.0}, "force must be greater than"),
    ],
)
def test_numbers_out_of_range_are_named(keys: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        RelayBetweenStops(**{"force": 2.0, "clearance": 0.5, "restitution": 0.5} | keys)
