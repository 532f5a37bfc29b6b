"""The tuned damper that an absorber is compared with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from stochvi import (
    FilteredNoise,
    Isolator,
    Matrices,
    Oscillator,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    exact,
)
from stochvi.absorbers import residual_vibration, symmetric_regimes, tuned_force
from stochvi.absorbers.design import SymmetricRegime
from stochvi.absorbers.performance import den_hartog_tuning, tuned_damper, white_noise_tuning


def rms_with_damper(
    mass_ratio: float, frequency: float, zeta: float, own_zeta: float, moving_base: bool
) -> float:
    """rms displacement of a unit mass on a unit spring with a damper, in white noise of intensity 1
    on the mass or on the base, from the Lyapunov equation of its four states."""
    m, k = mass_ratio, mass_ratio * frequency**2
    c = 2.0 * zeta * math.sqrt(k * m)
    mass = np.diag([1.0, m])
    stiffness = np.array([[1.0 + k, -k], [-k, k]])
    damping = np.array([[2.0 * own_zeta + c, -c], [-c, c]])
    force = mass @ np.ones(2) if moving_base else np.array([1.0, 0.0])
    pulls = [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]
    a = np.block([[np.zeros((2, 2)), np.eye(2)], pulls])
    b = np.concatenate([np.zeros(2), np.linalg.solve(mass, force)])
    return math.sqrt(solve_continuous_lyapunov(a, -np.outer(b, b))[0, 0])


@pytest.mark.parametrize("moving_base", [False, True])
@pytest.mark.parametrize("mass_ratio", [0.01, 0.1, 0.4])
def test_the_search_finds_warburtons_damper_where_the_carrier_has_no_damping(
    mass_ratio: float, moving_base: bool
) -> None:
    kind = Isolator if moving_base else Oscillator
    noise = WhiteNoise(intensity=3.0)
    scene = Scene(structure=kind(mass=2.0, damping=2e-5, stiffness=50.0), excitations=[noise])
    found = tuned_damper(scene, "x", 2.0 * mass_ratio)
    frequency, zeta = white_noise_tuning(mass_ratio, moving_base)
    assert found.frequency_hz == pytest.approx(frequency * 5.0 / (2.0 * math.pi), rel=1e-3)
    assert found.zeta == pytest.approx(zeta, rel=1e-3)
    best = rms_with_damper(mass_ratio, frequency, zeta, 0.0, moving_base)
    for change in (0.97, 1.03):  # the formulas themselves, by brute force
        assert rms_with_damper(mass_ratio, change * frequency, zeta, 0.0, moving_base) > best
        assert rms_with_damper(mass_ratio, frequency, change * zeta, 0.0, moving_base) > best
    # negative control: the tuning for the other place of the noise is not the best
    other = white_noise_tuning(mass_ratio, not moving_base)
    assert rms_with_damper(mass_ratio, *other, 0.0, moving_base) > best


def test_a_damped_carrier_has_a_better_damper_than_the_formula() -> None:
    structure = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    scene = Scene(structure=structure, excitations=[WhiteNoise(intensity=0.2)])
    found = tuned_damper(scene, "x", 0.1)
    alone = 1.0 / math.sqrt(2.0 * 0.1)  # rms in noise of intensity 1
    frequency = 2.0 * math.pi * found.frequency_hz
    left = rms_with_damper(0.1, frequency, found.zeta, 0.05, moving_base=False)
    assert found.ratio == pytest.approx(left / alone, rel=1e-9)
    assert found.displacement_std == pytest.approx(found.ratio, rel=1e-12)
    formula = white_noise_tuning(0.1, moving_base=False)
    assert left < rms_with_damper(0.1, *formula, 0.05, moving_base=False)
    assert found.damping == pytest.approx(2.0 * found.zeta * math.sqrt(0.1 * found.stiffness))
    assert found.stroke_std > found.displacement_std


def test_an_environment_tunes_the_damper_to_itself() -> None:
    truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    scene = Scene(structure=Isolator(mass=2.3, frequency_hz=18.0, Q=5.0), excitations=[truck])
    found = tuned_damper(scene, "x", 0.23)
    assert 0.5 < found.ratio < 1.0 and found.tuning == "least rms displacement"
    louder = tuned_damper(scene.at_level(6.0), "x", 0.23)
    assert louder.ratio == pytest.approx(found.ratio, rel=1e-6)


@pytest.mark.parametrize(
    ("band", "damping", "mass"), [(0.05, 0.5, 0.5), (0.5, 0.5, 0.5), (0.05, 3.0, 0.01)]
)
def test_no_damper_of_a_grid_is_better_under_a_narrow_band(
    band: float, damping: float, mass: float
) -> None:
    noise = FilteredNoise(intensity=0.04, frequency_hz=band, zeta=0.01, on="x")
    carrier = Oscillator(mass=1.0, damping=damping, stiffness=1.0)
    found = tuned_damper(Scene(structure=carrier, excitations=[noise]), "x", mass)

    def left(frequency_hz: float, zeta: float) -> float:
        k = mass * (2.0 * math.pi * frequency_hz) ** 2
        c = 2.0 * zeta * math.sqrt(k * mass)
        both = Matrices(
            coordinates=("x", "d"), mass=[[1.0, 0.0], [0.0, mass]],
            damping=[[damping + c, -c], [-c, c]], stiffness=[[1.0 + k, -k], [-k, k]],
        )  # fmt: skip
        answer = exact(Scene(structure=both, excitations=[noise]))
        return float(answer.coordinates["x"]["displacement_std"].value)

    assert left(found.frequency_hz, found.zeta) == pytest.approx(found.displacement_std, rel=1e-6)
    grid = [(f, zeta) for f in band * np.geomspace(0.5, 2.0, 9) for zeta in (1e-3, 0.01, 0.1, 1.0)]
    # the search ends where the rms displacement changes by less than 1e-4 of itself
    assert found.displacement_std < min(left(*each) for each in grid) * (1.0 + 1e-4)
    assert found.ratio < 1.0


def test_a_sine_takes_den_hartogs_tuning() -> None:
    """With it the amplification nowhere exceeds that of the fixed points, sqrt(1 + 2 / m), by more
    than the 1 % that the approximate damping costs."""
    mass_ratio = 0.05
    _, zeta = den_hartog_tuning(mass_ratio)
    steps = np.linspace(0.7, 1.2, 101)
    structure = Oscillator(mass=1.0, damping=1e-6, stiffness=1.0)
    ratios = []
    for omega in steps:
        sine = Sine(amplitude=1.0, frequency_hz=omega / (2.0 * math.pi))
        scene = Scene(structure=structure, excitations=[sine])
        found = tuned_damper(scene, "x", mass_ratio)
        ratios.append(found.displacement_std * math.sqrt(2.0))  # amplification of a unit force
    assert found.tuning == "Den Hartog" and found.zeta == pytest.approx(zeta)
    fixed = math.sqrt(1.0 + 2.0 / mass_ratio)
    assert 1.0 <= max(ratios) / fixed < 1.01


def test_a_wrong_carrier_or_mass_is_refused() -> None:
    carrier = Oscillator(mass=1.0, damping=0.02, stiffness=1.0)
    scene = Scene(structure=carrier, excitations=[WhiteNoise(intensity=0.04)])
    with pytest.raises(ValueError, match=r"carrier must be a coordinate of the structure \(x\)"):
        tuned_damper(scene, "tower", 0.1)
    with pytest.raises(ValueError, match="mass must be positive, got -1e\\+200"):
        tuned_damper(scene, "x", -1e200)


# ------------------------------------------------------------------------------
# A loose mass under a sine: exact regimes against integration from impact to impact.
# ------------------------------------------------------------------------------


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
