"""Bands and sines that move through a phase: their steps, and their risk against counted missions
in which they move."""

import math
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    damage,
    reliability,
    size,
)
from stochvi.scenes import MovingBand, Phase

PROFILE = "mil-std-810h-truck-vertical-5hz"
NATURAL, ZETA, RATE = 12.0, 0.1, 480.0
BAND = {"from_hz": 8.0, "to_hz": 18.0, "width_hz": 3.0, "density": 0.08, "unit": "g2/Hz"}


def swept(clearance: float, **phase: Any) -> Scene:
    pair = ImpactPair(clearance=clearance, law=Restitution(coefficient=0.7))
    return Scene(
        structure=Isolator(frequency_hz=NATURAL, zeta=ZETA), impact_pairs=[pair],
        excitations=[TabulatedNoise(profile=PROFILE)],
        phases=[{"name": "tracks", "duration": "1 min"} | phase],
    )  # fmt: skip


def moved(accelerations: np.ndarray) -> np.ndarray:
    """Relative displacement of the mount on a base with these accelerations."""
    f = np.fft.rfftfreq(len(accelerations), 1.0 / RATE)
    w, own = 2.0 * math.pi * f, 2.0 * math.pi * NATURAL
    gain = -1.0 / (own**2 - w**2 + 2j * ZETA * own * w)
    return np.asarray(np.fft.irfft(np.fft.rfft(accelerations) * gain, len(accelerations)))


def road(random: np.random.Generator, samples: int) -> np.ndarray:
    table = TabulatedNoise(profile=PROFILE).table
    f = np.fft.rfftfreq(samples, 1.0 / RATE)
    low, high = table.frequency_hz[[0, -1]]
    density = np.where((f >= low) & (f <= high), table(np.clip(f, low, high)), 0.0)
    parts = random.standard_normal((2, len(f)))
    return np.asarray(
        np.fft.irfft(0.5 * (parts[0] + 1j * parts[1]) * np.sqrt(density * samples * RATE), samples)
    )


def moving(random: np.random.Generator, samples: int, band: dict[str, Any]) -> np.ndarray:
    """A band or a sine whose frequency moves evenly in its logarithm."""
    share = np.arange(samples) / samples
    hertz = band["from_hz"] * (band["to_hz"] / band["from_hz"]) ** share
    phase = 2.0 * math.pi * (np.cumsum(hertz) / RATE + random.random())
    if "amplitude" in band:
        return np.asarray(band["amplitude"] * np.cos(phase))
    f = np.fft.fftfreq(samples, 1.0 / RATE)
    inside = np.abs(f) < 0.5 * band["width_hz"]
    parts = random.standard_normal((2, samples)) * inside
    slow = np.fft.ifft(parts[0] + 1j * parts[1]) * samples
    variance = band["density"] * 9.80665**2 * band["width_hz"]
    slow *= math.sqrt(variance / float(inside.sum()))
    return np.asarray((slow * np.exp(1j * phase)).real)


@pytest.mark.parametrize(
    ("clearance", "band", "steps"),
    [(0.0143, BAND, 24), (0.0098, {"from_hz": 9.0, "to_hz": 16.0, "amplitude": 4.0}, 24)],
    ids=["band", "sine"],
)
def test_the_chance_of_any_hit_is_that_of_missions_through_which_it_moves(
    clearance: float, band: dict[str, Any], steps: int
) -> None:
    scene = swept(clearance, moving=[band], steps=steps)
    found = reliability(scene, seed=1, rel_error=0.1).chances["hit"].estimate
    random, number = np.random.default_rng(4), 1200
    samples, ends = round(70.0 * RATE), round(5.0 * RATE)
    hit = []
    for _ in range(number):
        base = road(random, samples)
        base[ends:-ends] += moving(random, samples - 2 * ends, band)
        hit.append(np.abs(moved(base)[ends:-ends]).max() > clearance)
    counted = float(np.mean(hit))
    error = math.sqrt(counted * (1.0 - counted) / number)
    assert 0.1 < counted < 0.9
    assert abs(found.value - counted) < 4.5 * math.hypot(error, found.standard_error)
    # a band that stands at the middle is told apart
    middle = band | {"from_hz": 8.0, "to_hz": 8.1}
    still = reliability(swept(clearance, moving=[middle]), seed=1, rel_error=0.2).chances["hit"]
    assert abs(still.estimate.value - counted) > 4.5 * math.hypot(
        error, still.estimate.standard_error
    )


def test_the_bias_covers_what_more_steps_change() -> None:
    few, many = (
        reliability(swept(0.0175, moving=[BAND], steps=steps), seed=1, rel_error=0.05)
        for steps in (6, 36)
    )
    one, other = (each.chances["hit"].estimate for each in (few, many))
    assert one.bias is not None and other.bias is not None
    statistical = math.hypot(one.standard_error, other.standard_error)
    assert abs(one.value - other.value) < 4.5 * statistical + one.bias + other.bias
    assert other.bias < 0.1 * other.value
    # the bias is needed: at this number of steps it is the larger error
    assert one.bias > 2.0 * one.standard_error
    assert few.hits is not None and few.hits.bias is not None
    assert few.hits.bias > 2.0 * few.hits.standard_error


def test_size_and_one_step_follow_without_a_word_of_their_own() -> None:
    scene = swept(0.0155, moving=[BAND], steps=6)
    assert scene.phases[0].name == "tracks, 8.559 Hz"
    assert sum(each.duration for each in scene.phases) == pytest.approx(60.0)
    step = scene.in_phase("tracks, 12.84 Hz")
    assert [each.kind for each in step.excitations] == ["psd", "psd"]
    worn = damage(step, mission=10.0, equipment=[40.0, 41.0, 50.0]).way
    assert worn == "simulation" or worn == "clusters"
    found = size(scene, probability=0.1, rel_error=0.2, seed=1)
    assert found.clearance.value > 0.0155
    assert Scene(**scene.document()) == scene


def test_what_moves_is_written_in_full() -> None:
    band = MovingBand(from_hz=10.0, to_hz=40.0, amplitude=2.0)
    assert band.frequency(0.5, "logarithmic") == pytest.approx(20.0)
    assert band.frequency(0.5, "linear") == pytest.approx(25.0)
    sine = band.at(1.0, "linear")
    assert isinstance(sine, Sine) and sine.frequency_hz == pytest.approx(40.0)
    phase = Phase(name="a", duration=10.0, moving=[MovingBand(**BAND)])
    assert len(phase.standing) == 14  # a quarter of a width of 3 Hz over 10 Hz
    added = Scene(
        structure=Isolator(frequency_hz=NATURAL, zeta=ZETA),
        phases=[{"name": "b", "duration": 1.0, "added_excitation": [{"kind": "sine",
                 "amplitude": 1.0, "frequency_hz": 5.0}]}],
    )  # fmt: skip
    assert added.in_phase("b").excitations[0].kind == "sine"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"moving": [{"from_hz": 5.0, "to_hz": 9.0}]}, "needs width_hz, density and unit"),
        ({"moving": [BAND | {"width_hz": 20.0}]}, "width_hz below twice its lowest frequency"),
        ({"steps": 4}, "has steps = 4 without a moving_band"),
    ],
)
def test_wrong_keys_are_named(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        swept(0.01, **keys)
