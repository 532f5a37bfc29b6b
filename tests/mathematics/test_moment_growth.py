"""Growth of moments: integrations in time, closed forms and limits judge it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi.mathematics.moment_growth import (
    FilteredChange,
    SineChange,
    WhiteChange,
    moment_growth,
)

B, W = 0.2, 2.0
SYSTEM = np.array([[0.0, 1.0], [-W * W, -B]])
SPRING = np.array([[0.0, 0.0], [-W * W, 0.0]])
DAMPER = np.array([[0.0, 0.0], [0.0, -B]])
TWO = np.block(
    [[np.zeros((2, 2)), np.eye(2)], [np.array([[-5.0, 1.0], [1.0, -2.0]]), -0.1 * np.eye(2)]]
)
BETWEEN = np.zeros((4, 4))
BETWEEN[2:, :2] = [[-1.0, 1.0], [1.0, -1.0]]


def test_mean_squares_keep_their_size_at_the_boundary() -> None:
    """W^2 S = 2 b; slightly more noise makes them grow, slightly less lets them decay."""
    intensity = 2.0 * B / W**2
    assert moment_growth(SYSTEM, [WhiteChange(SPRING, intensity)], 2) == pytest.approx(
        0.0, abs=1e-12
    )
    for factor in (0.99, 1.01):
        found = moment_growth(SYSTEM, [WhiteChange(SPRING, factor * intensity)], 2)
        assert found is not None and found * (factor - 1.0) > 0.0


def test_white_noise_on_a_damper_takes_a_part_of_its_mean_effect() -> None:
    """In the sense of Stratonovich means decay at (b - b^2 S / 2) / 2; a spring changes nothing."""
    found = moment_growth(SYSTEM, [WhiteChange(DAMPER, 0.5)], 1)
    assert found == pytest.approx(-(B - B**2 * 0.25) / 2.0, rel=1e-12)
    assert moment_growth(SYSTEM, [WhiteChange(SPRING, 0.05)], 1) == pytest.approx(-B / 2.0)


@pytest.mark.parametrize(
    ("system", "change", "omega"),
    [(SYSTEM, SPRING, 4.1), (SYSTEM, 3.0 * DAMPER, 2.0), (TWO, BETWEEN, 3.6)],
)
def test_sines_grow_as_the_multipliers_of_floquet(
    system: np.ndarray, change: np.ndarray, omega: float
) -> None:
    n, period = len(system), 2.0 * math.pi / omega

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return ((system + 0.4 * math.cos(omega * t) * change) @ y.reshape(n, n)).ravel()

    solved = solve_ivp(rates, (0.0, period), np.eye(n).ravel(), rtol=1e-11, atol=1e-13)
    largest = np.abs(np.linalg.eigvals(solved.y[:, -1].reshape(n, n))).max()
    for power in (1, 2):
        found = moment_growth(system, [SineChange(change, 0.4, omega)], power)
        assert found == pytest.approx(power * math.log(largest) / period, abs=1e-8)


def test_a_weak_sine_at_twice_the_frequency_grows_as_in_the_book() -> None:
    """Growth h W / 4 - b / 2 (Babitsky, 11.44), to the second order of h."""
    for h in (0.12, 0.24):
        found = moment_growth(SYSTEM, [SineChange(SPRING, h, 2.0 * W)], 1)
        assert found == pytest.approx(h * W / 4.0 - B / 2.0, abs=0.1 * W * h**2)
    assert moment_growth(SYSTEM, [SineChange(SPRING, 0.24, 3.0 * W)], 1) == pytest.approx(-B / 2.0)


@pytest.mark.parametrize("change", [SPRING, 3.0 * DAMPER], ids=["spring", "damper"])
@pytest.mark.parametrize("power", [1, 2])
def test_noise_of_a_wide_band_acts_as_white_noise(change: np.ndarray, power: int) -> None:
    """The limit of a fast filter is the white noise of Stratonovich; its error falls with the
    bandwidth."""
    white = moment_growth(SYSTEM, [WhiteChange(change, 0.15)], power)
    errors = []
    for omega in (100.0, 200.0):
        filtered = FilteredChange(change, omega, 1.4 * omega, 0.15)
        found = moment_growth(SYSTEM, [filtered], power)
        assert found is not None and white is not None
        errors.append(abs(found - white))
    assert errors[0] < 0.05 * B
    assert errors[1] < 0.7 * errors[0] + 1e-7


def test_filtered_noise_grows_as_many_paths_do() -> None:
    """Mean squares of 40,000 paths, by Heun's method over steps of a hundredth."""
    intensity, omega, rate, h = 0.1, 3.0, 3.0, 0.01
    generator = np.random.default_rng(3)
    x, v = np.ones(40_000), np.zeros(40_000)
    size = math.sqrt(omega**2 * intensity / (2.0 * rate))
    f, g = size * generator.standard_normal((2, 40_000))
    seen = []
    for k in range(1200):
        kick = omega * math.sqrt(intensity * h) * generator.standard_normal(40_000)
        f, g = f + h * omega * g, g - h * (omega * f + rate * g) + kick
        a = -B * v - W * W * (1.0 + f) * x
        middle = x + 0.5 * h * v, v + 0.5 * h * a
        x, v = x + h * middle[1], v + h * (-B * middle[1] - W * W * (1.0 + f) * middle[0])
        if k in (399, 1199):
            seen.append(W * W * x**2 + v**2)
    ratio = seen[1].mean() / seen[0].mean()
    error = math.hypot(*(each.std() / each.mean() / 200.0 for each in seen))
    found = moment_growth(SYSTEM, [FilteredChange(SPRING, omega, rate, intensity)], 2)
    assert found == pytest.approx(math.log(ratio) / 8.0, abs=4.5 * error / 8.0 + 0.01)
    assert abs(found + B) > 9.0 * error / 8.0  # the modulation is seen at all


def test_several_changes_act_together() -> None:
    """A change without effect beside another one leaves its growth."""
    sine = SineChange(SPRING, 0.4, 4.1)
    alone = moment_growth(SYSTEM, [sine], 2)
    still = WhiteChange(0.0 * SPRING, 1.0)
    for changes in ([sine, still], [still, sine]):
        assert moment_growth(SYSTEM, changes, 2) == pytest.approx(alone, abs=1e-8)
    found = moment_growth(SYSTEM, [sine, SineChange(0.0 * SPRING, 0.4, 2.3)], 1)
    assert alone is not None and found == pytest.approx(alone / 2.0, abs=1e-8)


def test_what_takes_too_large_a_matrix_has_no_answer() -> None:
    changes = [SineChange(SPRING, 0.4, 4.1), FilteredChange(SPRING, 3.0, 1.0, 0.1)]
    assert moment_growth(SYSTEM, changes, 2) is None
