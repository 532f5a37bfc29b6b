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


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"restitution": 1.0}, r"restitution must be in \[0, 1\), got 1"),
        ({"switching": 0.0}, "switching must be greater than 0 m, got 0"),
        ({"load": 10.0}, r"load must be in \[0, force\), got 10 with force 10"),
    ],
)
def test_numbers_out_of_range_are_named(keys: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        SwitchedDrive(**{"restitution": 0.5, "force": 10.0, "switching": 0.3} | keys)
