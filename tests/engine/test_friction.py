"""Impacts on a stop that rubs: losses, energy, and an integration over the impulse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi.engine.friction import held_back, loss_of, rub
from support.rubbing import small_steps


def impact(
    inverse: np.ndarray, w: float, u: float, restitution: float, friction: float
) -> tuple[float, float, float]:
    """Speeds after the impact by `rub`, and the energy that it takes, J; w is into the stop."""
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    rebound, push, rubbed = rub(w, u, restitution, friction, c / a, b / a, b / c)
    after = np.array([w - push + b / c * rubbed, u - b / a * push + rubbed])
    assert after[0] == pytest.approx(-rebound, abs=1e-9 * (w + abs(u)))
    mass = np.linalg.inv(inverse)
    before = np.array([w, u])
    loss = 0.5 * (before @ mass @ before - after @ mass @ after)
    stated = loss_of(w, u, push, rubbed, c / a, b / c) / a
    assert stated == pytest.approx(loss, abs=1e-9 * (before @ mass @ before))
    return -rebound, float(after[1]), float(loss)


def random_impacts(count: int, seed: int):
    """Inverse mass matrices with speeds, restitutions and frictions of all sizes."""
    generator = np.random.default_rng(seed)
    for _ in range(count):
        size, ratio = 10.0 ** generator.uniform(-1.0, 1.0, 2)
        coupled = generator.uniform(-0.98, 0.98) * ratio
        inverse = size * np.array([[1.0, coupled], [coupled, ratio**2]])
        w, u = abs(generator.normal()), generator.normal() * 10.0 ** generator.uniform(-2.0, 1.0)
        friction = 10.0 ** generator.uniform(-2.0, 0.7)
        yield inverse, w, u, float(generator.uniform(0.0, 1.0)), friction


def test_a_point_mass_loses_along_the_stop_what_coulomb_says() -> None:
    """mu (1 + R) w while it slides, at most all of the speed (B 1.62); Newton's rebound."""
    point = np.eye(2) / 0.7
    for u, left in ((3.0, 3.0 - 0.3 * 1.6 * 2.0), (-3.0, -3.0 + 0.3 * 1.6 * 2.0), (0.5, 0.0)):
        after, along, loss = impact(point, 2.0, u, 0.6, 0.3)
        assert after == -0.6 * 2.0
        assert along == pytest.approx(left, abs=1e-15)
        assert loss == pytest.approx(0.35 * (0.64 * 4.0 + u**2 - left**2), rel=1e-12)


def test_no_impact_gains_energy_whatever_the_masses() -> None:
    """10,000 impacts with random masses; a restitution of the speed, as without friction, gains."""
    gains = 0
    for inverse, w, u, restitution, friction in random_impacts(10_000, 1):
        mass = np.linalg.inv(inverse)
        size = float(np.array([w, u]) @ mass @ np.array([w, u]))
        _, _, loss = impact(inverse, w, u, restitution, friction)
        assert loss >= -1e-9 * size
        # Newton's restitution with a sliding or sticking impulse (Kane's paradox)
        a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
        push = w * (1.0 + restitution) / (a - b * b / c)
        along = (b * push - u) / c
        if abs(along) > friction * push:
            share = -friction * math.copysign(1.0, u)
            push = w * (1.0 + restitution) / (a - b * share)
            along = share * push
        if push > 0.0:
            after = np.array([w - a * push + b * along, u - b * push + c * along])
            gains += 0.5 * float(after @ mass @ after) > 0.5 * size * (1.0 + 1e-9)
    assert gains > 100


@pytest.mark.parametrize("seed", range(60))
def test_an_impact_is_that_of_small_steps_over_its_impulse(seed: int) -> None:
    """Slip, stick and slip back, in compression and after it. The error of small steps is of the
    first order."""
    ((inverse, w, u, restitution, friction),) = random_impacts(1, 100 + seed)
    after, along, _ = impact(inverse, w, u, restitution, friction)
    fine = small_steps(inverse, w, u, restitution, friction, 20_000)
    coarse = small_steps(inverse, w, u, restitution, friction, 10_000)
    scale = w * (1.0 + float(np.abs(inverse).max() / inverse[0, 0])) + abs(u)
    for found, one, other in zip((after, along), fine, coarse, strict=True):
        assert abs(found - one) <= 4.0 * abs(other - one) + 1e-3 * scale


def test_the_kinds_of_impacts_are_all_among_them() -> None:
    """Sliding on, sticking, sliding back, and a normal speed that first grows (jam)."""
    found = set()
    for seed in range(60):
        ((inverse, w, u, restitution, friction),) = random_impacts(1, 100 + seed)
        _, along, _ = impact(inverse, w, u, restitution, friction)
        a, b = inverse[0, 0], inverse[0, 1]
        if a + friction * math.copysign(1.0, u) * b < 0.0:
            found.add("jam")
        small = 1e-9 * (w + abs(u))
        found.add("sticks" if abs(along) < small else "on" if along * u > 0.0 else "back")
    assert found == {"jam", "sticks", "on", "back"}


def test_a_mass_at_rest_on_a_stop_is_held_back_and_not_driven() -> None:
    assert held_back(0.3, 1.0, 0.2) == -0.2
    assert held_back(-0.1, 1.0, 0.2) == 0.1
    assert held_back(0.0, 1.0, 0.2) == 0.0
