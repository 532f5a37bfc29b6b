"""A loose mass under a sine: exact regimes against integration from impact to impact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stochvi.absorbers import residual_vibration, symmetric_regimes, tuned_force
from stochvi.absorbers.sine_formulas import SymmetricRegime

SCENE = {
    "mass": 1.0, "damping": 0.02, "stiffness": 1.0, "absorber_mass": 0.05, "play": 2.0,
    "restitution": 0.8, "force": 0.05, "omega": 1.05,
}  # fmt: skip


def before_upper(scene: dict[str, float], regime: SymmetricRegime) -> list[float]:
    """x1, x1', x2, x2' as the docstring has them, just before the impact at time 0."""
    at = regime.absorber_speed * math.pi / (2.0 * scene["omega"])
    speed = regime.absorber_speed
    return [at - scene["play"] / 2.0, speed - regime.impact_speed, at, speed]


def integrated(
    scene: dict[str, float], state: list[float], phase: float, impacts: int
) -> tuple[np.ndarray, np.ndarray]:
    """States before each impact and the times, by Runge-Kutta with events."""
    m, m2 = scene["mass"], scene["absorber_mass"]

    def rates(t: float, s: np.ndarray) -> list[float]:
        push = scene["force"] * math.cos(scene["omega"] * t + phase)
        pull = scene["stiffness"] * s[0] + scene["damping"] * s[1]
        return [s[1], (push - pull) / m, s[3], 0.0]

    wall, time, found, times = 1.0, 0.0, [], []
    for _ in range(impacts):
        # the wall that was hit moves away: the event is the other one, or this one again
        found.append(state)
        times.append(time)
        exchange = (1.0 + scene["restitution"]) / (m + m2) * (state[3] - state[1])
        after = [state[0], state[1] + m2 * exchange, state[2], state[3] - m * exchange]

        def other(t: float, s: np.ndarray, wall: float = wall) -> float:
            return float(s[2] - s[0] + wall * scene["play"] / 2.0)

        other.terminal = True  # type: ignore[attr-defined]
        flown = solve_ivp(
            rates, (time, time + 20.0), after, events=other, rtol=1e-10, atol=1e-12
        )  # fmt: skip
        state, time, wall = flown.y_events[0][0].tolist(), float(flown.t_events[0][0]), -wall
    return np.array(found), np.array(times)


@pytest.mark.parametrize("restitution", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("omega", [1.0, 1.05])
def test_a_regime_repeats_itself_from_impact_to_impact(restitution: float, omega: float) -> None:
    scene = SCENE | {"restitution": restitution, "omega": omega}
    regimes = symmetric_regimes(**scene)
    assert regimes
    for regime in regimes:
        start = before_upper(scene, regime)
        states, times = integrated(scene, start, regime.phase, 3)
        np.testing.assert_allclose(times, np.arange(3) * math.pi / omega, rtol=1e-7)
        np.testing.assert_allclose(states[1], np.negative(start), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(states[2], start, rtol=1e-5, atol=1e-7)
        # negative control: another phase of the force
        _, times = integrated(scene, start, regime.phase + 0.1, 3)
        assert abs(times[2] - 2.0 * math.pi / omega) > 1e-4


def test_disturbances_of_a_stable_regime_die_out_and_of_an_unstable_one_grow() -> None:
    for scene, stable in ((SCENE, True), (SCENE | {"force": 0.03}, False)):
        (regime, *_) = symmetric_regimes(**scene)
        assert regime.stable is stable
        start = before_upper(scene, regime)
        start[3] += 1e-4
        states, _ = integrated(scene, start, regime.phase, 41 if stable else 9)
        away = np.abs(states[::2] - before_upper(scene, regime)).max(axis=1)
        assert away[-1] < 0.1 * away[1] if stable else away[-1] > 4.0 * away[1]


def test_the_first_harmonic_is_that_of_the_motion() -> None:
    """From the integrated motion of a period, by its own transform."""
    (regime, *_) = symmetric_regimes(**SCENE)
    states, times = integrated(SCENE, before_upper(SCENE, regime), regime.phase, 2)
    # m X = (a e^(i phase) - c X' - k X + impulses) over a period, all known at the impacts
    omega, m2 = SCENE["omega"], SCENE["absorber_mass"]
    impulse = m2 * (states[0, 3] - states[1, 3])
    period = 2.0 * (times[1] - times[0])
    push = SCENE["force"] * np.exp(1j * regime.phase) + 4.0 * impulse / period
    amplitude = abs(push / complex(1.0 - omega**2, 0.02 * omega))
    assert regime.amplitude == pytest.approx(amplitude, rel=1e-6)


def test_a_tuned_mass_that_loses_nothing_cancels_the_first_harmonic() -> None:
    """At R = 1 and a light mass; what is left falls with the mass, by the third harmonic."""
    left = []
    for share in (0.01, 0.001):
        scene = SCENE | {"absorber_mass": share, "damping": 1e-6, "restitution": 1.0, "omega": 1.3}
        for law in ("flight", "book"):
            force = tuned_force(share, 2.0, 1.3, law)
            regimes = symmetric_regimes(**scene | {"force": force})
            left.append(min(each.amplitude for each in regimes) / regimes[0].amplitude_without)
    heavy, wrong, light, also_wrong = left
    assert light < 0.2 * heavy < 0.01
    # negative control: the force that the book's square wave gives
    assert min(wrong, also_wrong) > 0.1


@pytest.mark.parametrize("restitution", [0.5, 0.8, 0.95])
def test_residual_vibration_is_the_limit_of_a_light_mass(restitution: float) -> None:
    """In resonance, at the tuned force: the error falls with the mass."""
    expected = residual_vibration(2.0, restitution)
    away = []
    for share in (4e-3, 1e-3):
        scene = SCENE | {"absorber_mass": share, "restitution": restitution, "damping": 1e-6}
        force = tuned_force(share, 2.0, 1.0)
        (regime,) = symmetric_regimes(**scene | {"omega": 1.0, "force": force})
        away.append(abs(regime.amplitude / expected - 1.0))
    assert away[1] < 0.5 * away[0] < 0.01
    # negative control: the harmonic linearisation is twice as much and more
    assert residual_vibration(2.0, restitution, "book") > 1.4 * expected


def test_what_a_sine_cannot_be_asked() -> None:
    with pytest.raises(ValueError, match=r"restitution must be in \[0, 1\], got 1\.2"):
        residual_vibration(2.0, 1.2)
    with pytest.raises(ValueError, match="play must be a positive number"):
        tuned_force(0.1, 0.0, 1.0)
    with pytest.raises(ValueError, match="law must be one of book, flight"):
        tuned_force(0.1, 1.0, 1.0, "bok")
    with pytest.raises(ValueError, match="omega must be a positive number"):
        symmetric_regimes(**SCENE | {"omega": -1.0})
    assert symmetric_regimes(**SCENE | {"force": 1e-6, "omega": 3.0}) == []
