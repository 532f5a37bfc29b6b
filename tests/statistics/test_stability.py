"""Lyapunov exponents and growth of moments against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    stability,
)
from stochvi.scenes import Modulation
from stochvi.testing import assert_agrees
from support import judges

M, B, W = 2.0, 0.3, 2.0


def scene_of(*modulations: Modulation, **more: Any) -> Scene:
    return Scene(
        structure=Oscillator(mass=M, damping=M * B, stiffness=M * W**2),
        excitations=[*more.pop("excitations", []), *modulations],
        **more,
    )


def exponent(intensity: float, b: float = B, w: float = W) -> float:
    """The Lyapunov exponent of x'' + b x' + w^2 (1 + xi) x = 0 with white xi, in closed form.

    z = y' / y of y = x exp(b t / 2) follows z' = -(g + z^2) + w^2 xi, g = w^2 - b^2 / 4, with a
    stationary flux to minus infinity; with D = w^4 S / 2 its mean is half the ratio of the
    integrals of sqrt(u) and 1 / sqrt(u) times exp(-(g u + u^3 / 12) / D) (Halperin; Imkeller and
    Lederer).
    """
    g, d = w**2 - b**2 / 4.0, w**4 * intensity / 2.0

    def integral(power: float) -> float:
        # u = s^2 takes the root at 0 away
        return quad(
            lambda s: 2.0 * s ** (2.0 * power + 1.0) * math.exp(-(g * s**2 + s**6 / 12.0) / d),
            0.0, math.inf,
        )[0]  # fmt: skip

    return -b / 2.0 + 0.5 * integral(0.5) / integral(-0.5)


@pytest.mark.parametrize("intensity", [0.05, 0.4, 2.0])
def test_white_noise_on_a_spring_has_the_exponent_of_its_closed_form(intensity: float) -> None:
    found = stability(scene_of(Modulation(of="stiffness", intensity=intensity)), seed=3)
    known = exponent(intensity)
    assert_agrees(found.lyapunov_exponent, known)
    if intensity == 0.05:  # weak: -b / 2 + w^2 S / 8
        assert known == pytest.approx(-B / 2.0 + W**2 * intensity / 8.0, abs=3e-4)
    with pytest.raises(AssertionError):  # noise of half the intensity
        assert_agrees(found.lyapunov_exponent, exponent(0.5 * intensity))
    squares = found.mean_square_growth
    assert squares is not None and squares.value >= 2.0 * known


def test_white_noise_on_a_damper_is_that_of_stratonovich() -> None:
    """Weak noise: -b / 2 + b^2 S / 8; by Ito it were -b / 2 - b^2 S / 8."""
    intensity = 0.8
    found = stability(scene_of(Modulation(of="damping", intensity=intensity)), seed=3)
    shift = B**2 * intensity / 8.0
    assert found.lyapunov_exponent.value == pytest.approx(-B / 2.0 + shift, abs=0.4 * shift)


def test_noise_of_a_wide_band_has_the_exponent_of_white_noise() -> None:
    filtered = Modulation(of="stiffness", intensity=0.4, frequency_hz=12.0, zeta=0.7)
    found = stability(scene_of(filtered), rel_error=0.03, seed=3).lyapunov_exponent
    assert found.value == pytest.approx(exponent(0.4), abs=4.5 * found.standard_error + 0.01)


def test_slow_noise_has_the_exponent_of_a_plain_twin() -> None:
    """500 paths of filtered noise by steps of kick, way, kick in numpy, scaled at each step."""
    slow = Modulation(of="stiffness", intensity=0.15, frequency_hz=0.6, zeta=0.2)
    found = stability(scene_of(slow), seed=3).lyapunov_exponent
    assert slow.filter is not None
    omega, rate, intensity = slow.filter
    generator, h, paths = np.random.default_rng(5), 0.01, 400
    x, v = generator.standard_normal((2, paths))
    f, g = math.sqrt(slow.size**2) * generator.standard_normal((2, paths))
    total, counted = np.zeros(paths), 0.0
    for k in range(12_000):
        kick = omega * math.sqrt(intensity * h) * generator.standard_normal(paths)
        f = f + 0.5 * h * omega * g
        g = (g - h * omega * f) * math.exp(-rate * h) + kick
        f = f + 0.5 * h * omega * g
        v = v * math.exp(-0.5 * B * h) - 0.5 * h * W**2 * (1.0 + f) * x
        x = x + h * v
        v = (v - 0.5 * h * W**2 * (1.0 + f) * x) * math.exp(-0.5 * B * h)
        if k % 100 == 99:
            size = np.hypot(W * x, v)
            x, v = x / size, v / size
            if k >= 2000:
                total += np.log(size)
                counted += 100.0 * h
    rates = total / counted
    error = math.hypot(float(rates.std()) / 20.0, found.standard_error)
    assert found.value == pytest.approx(float(rates.mean()), abs=4.5 * error + 0.004)
    assert found.value > -B / 2.0 + 9.0 * error


def test_sines_have_the_multipliers_of_floquet() -> None:
    """No number is drawn, and the result is that of twice the squares."""
    found = stability(
        scene_of(Modulation(of="stiffness", amplitude=0.5, frequency_hz=2.0 / math.pi))
    )
    assert found.lyapunov_exponent.standard_error == 0.0 and found.cost.steps == 0
    assert found.lyapunov_exponent.value == pytest.approx(0.5 * W / 4.0 - B / 2.0, abs=0.02)
    assert found.mean_square_growth is not None
    assert found.mean_square_growth.value == pytest.approx(2.0 * found.lyapunov_exponent.value)
    assert found.summary().startswith("unstable: almost every motion grows")
    assert judges.columns_without_judge(found) == []


def test_stops_and_other_noise_do_not_count() -> None:
    """Stability is that of rest, also where the scene has more."""
    white = Modulation(of="stiffness", intensity=0.1)
    alone = stability(scene_of(white), rel_error=0.1, seed=3)
    more = scene_of(
        white, excitations=[WhiteNoise(intensity=0.4)],
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=0.8))],
    )  # fmt: skip
    assert stability(more, rel_error=0.1, seed=3).lyapunov_exponent == alone.lyapunov_exponent


def test_a_spring_between_coordinates() -> None:
    """Two equal masses: the spring between them acts on their difference alone, which then is one
    oscillator."""
    k, c, between = 3.0, 0.3, 0.5
    damping = [[c, 0.0], [0.0, c]]
    two = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 1.0]], damping=damping,
            stiffness=[[k + between, -between], [-between, k + between]],
        ),
        excitations=[Modulation(of="stiffness", intensity=3.2, between=("a", "b"))],
    )  # fmt: skip
    w2 = k + 2.0 * between
    share = 2.0 * between / w2
    found = stability(two, seed=1)
    known = exponent(3.2 * share**2, c, math.sqrt(w2))
    assert_agrees(found.lyapunov_exponent, known)
    assert found.summary().startswith("stable, but mean squares grow")


def test_without_damping_noise_excites_all_the_same() -> None:
    free = Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=4.0),
        excitations=[Modulation(of="stiffness", intensity=0.05)],
    )
    assert_agrees(stability(free, seed=1).lyapunov_exponent, exponent(0.05, 0.0))


def test_what_is_not_modulated_is_refused() -> None:
    with pytest.raises(NotApplicable, match="excitation must modulate stiffness or damping"):
        stability(scene_of(excitations=[WhiteNoise(intensity=1.0)]))
    spring = {"kind": "duffing", "cubic_stiffness": 1.0}
    structure = Oscillator(mass=1.0, damping=0.1, stiffness=1.0, spring=spring)
    scene = Scene(structure=structure, excitations=[Modulation(of="stiffness", intensity=0.1)])
    with pytest.raises(NotApplicable, match="spring must be linear, got kind 'duffing'"):
        stability(scene)


def test_the_boundary_of_mean_squares_is_answered() -> None:
    """Mean squares neither grow nor decay where w^2 S = 2 b, yet almost every motion decays."""
    intensity = 2.0 * B / W**2
    found = stability(scene_of(Modulation(of="stiffness", intensity=intensity)), seed=3)
    squares = found.mean_square_growth
    assert squares is not None and abs(squares.value) < 1e-9
    assert_agrees(found.lyapunov_exponent, exponent(intensity))
