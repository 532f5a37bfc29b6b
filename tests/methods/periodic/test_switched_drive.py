"""Drives that switch, against integrations of their equation of motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from stochvi.methods.periodic import SwitchedDrive


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
def test_speeds_scatter_as_restitutions_do() -> None:
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


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"restitution": 1.0}, r"restitution must be in \[0, 1\), got 1"),
        ({"switching": 0.0}, "switching must be greater than 0 m, got 0"),
        ({"delay": -0.1}, "delay must be 0 s or more, got -0.1"),
        ({"load": 10.0}, r"load must be in \[0, force\), got 10 with force 10"),
    ],
)
def test_numbers_out_of_range_are_named(keys: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        SwitchedDrive(**{"restitution": 0.5, "force": 10.0, "switching": 0.3} | keys)
