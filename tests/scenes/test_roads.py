"""Roads of ISO 8608: class table, units, and the response to a road checked in time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import Isolator, RoadNoise, Scene, SceneError, screen
from stochvi.results.estimates import Estimate
from stochvi.scenes.road_density import ROUGHNESS, velocity_density
from stochvi.testing import assert_agrees


def test_each_class_is_four_times_the_one_before_from_16_cubic_millimetres_times_1000() -> None:
    assert list(ROUGHNESS) == list("ABCDEFGH")
    for power, roughness in enumerate(ROUGHNESS.values()):
        assert roughness == pytest.approx(16e-6 * 4.0**power, rel=1e-12)
    # neighbours share a limit: twice one geometric mean is half the next
    means = list(ROUGHNESS.values())
    assert [2.0 * one for one in means[:-1]] == pytest.approx([0.5 * two for two in means[1:]])


def test_the_acceleration_density_is_that_of_the_displacement_of_the_profile() -> None:
    road, speed = RoadNoise(road="D", speed_kmh=54.0, band_hz=[0.5, 30.0]), 15.0
    f = np.array([0.5, 1.0, 7.3, 30.0])
    n = f / speed
    displacement = 1024e-6 * (n / 0.1) ** -2 / speed
    np.testing.assert_allclose(road.table(f), (2.0 * np.pi * f) ** 4 * displacement, rtol=1e-12)
    assert road.table(40.0) == 0.0


def test_a_mount_that_follows_a_white_velocity_has_the_closed_form() -> None:
    """x'' + b x' + w^2 x = -d(velocity)/dt, velocity white of S0: E x^2 = S0 / (2 b)."""
    mount = Isolator(frequency_hz=5.0, zeta=0.2)
    noise = RoadNoise(roughness=3e-5, speed=20.0, band_hz=[1e-4, 1e5])
    found = screen(Scene(structure=mount, excitations=[noise])).displacement_std
    intensity = velocity_density(3e-5, 20.0) / 2.0
    # above the band lies int 1 / f^2 of the response, about 4 zeta f_n / (pi f_high)
    assert found == pytest.approx(math.sqrt(intensity / (2.0 * mount.damping_rate)), rel=1e-4)


def test_driving_over_a_profile_drawn_in_space_shakes_as_the_table_says() -> None:
    """Wavelengths of an even grid with random phases; the mean square over one period is exact."""
    speed, low, high = 10.0, 0.02, 2.0
    n = np.arange(low, high, low / 10.0)
    f = n * speed
    road = RoadNoise(road="C", speed=speed, band_hz=[low * speed, high * speed])
    amplitude = np.sqrt(2.0 * 256e-6 * (n / 0.1) ** -2 * (low / 10.0))
    phase = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, len(n))
    time = np.linspace(0.0, 10.0 / (low * speed), 40_000, endpoint=False)
    shape = np.zeros_like(time)
    for a, w, p in zip(amplitude, 2.0 * np.pi * f, phase, strict=True):
        shape += a * np.cos(w * time + p)
    step = time[1] - time[0]
    acceleration = np.gradient(np.gradient(shape, step), step)
    within = slice(5, -5)
    found = Estimate(
        value=float(np.mean(acceleration[within] ** 2)),
        # the sum of a grid against the integral, and (sin wh / wh)^4 of the two differences
        bias=road.table.mean_square()
        * (2.0 * (low / 10.0) / high + 2.0 / 3.0 * (2.0 * math.pi * high * speed * step) ** 2),
    )
    assert_agrees(found, road.table.mean_square())


def test_a_level_and_a_default_band() -> None:
    plain = RoadNoise(road="A", speed=20.0)
    assert plain.table.frequency_hz.tolist() == pytest.approx([0.2, 200.0])
    raised = RoadNoise(road="A", speed=20.0, level_db=20.0 * math.log10(2.0))
    assert raised.table.density == pytest.approx(RoadNoise(road="B", speed=20.0).table.density)
    assert "secondary sources" in plain.assumptions()[0]


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"road": "C"}, "needs exactly one of speed and speed_kmh, got none"),
        ({"speed": 10.0}, "needs exactly one of road and roughness, got none"),
        (
            {"road": "C", "roughness": 1e-5, "speed": 10.0},
            "needs exactly one of road and roughness, got road, roughness",
        ),
        ({"road": "J", "speed": 10.0}, "road must be 'A', 'B', 'C', 'D', 'E', 'F', 'G' or 'H'"),
        ({"road": "C", "speed": -10.0}, "speed must be greater than 0, got -10.0"),
        ({"road": "C", "speed": 10.0, "on": "x"}, "moves the base, on = 'base', got on = 'x'"),
        ({"road": "C", "speed": 10.0, "level_db": 300.0}, "level_db outside -200..200, got 300"),
    ],
)
def test_a_mistake_gives_a_sentence(keys, sentence: str) -> None:
    with pytest.raises(SceneError) as failure:
        RoadNoise(**keys)
    assert sentence in str(failure.value)
