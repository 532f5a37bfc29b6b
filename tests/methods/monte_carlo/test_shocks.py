"""Shocks of a shape at random times: theorems, the limit of impulses, and replays judge."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import (
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    damage,
    linearise,
    replay,
    screen,
    simulate,
)
from stochvi.mathematics.pulse_shapes import SHAPES, PulseShape
from stochvi.methods.monte_carlo.history_plans import plan_histories
from stochvi.scenes import Pulses, RecordedNoise

M, F, ZETA = 2.0, 10.0, 0.05
W = 2.0 * math.pi * F
MASS = Oscillator(mass=M, frequency_hz=F, zeta=ZETA)
PROFILE = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")

Array = NDArray[np.float64]


def shaken(*excitations: Any, pairs: Any = ()) -> Scene:
    return Scene(structure=MASS, impact_pairs=list(pairs), excitations=excitations)


def formula(shape: str, time: Array) -> Array:
    """The shapes as a standard draws them, over their length."""
    inside = (time >= 0.0) & (time <= 1.0)
    return {
        "half-sine": np.where(inside, np.sin(math.pi * time), 0.0),
        "saw-tooth": np.where(inside, time, 0.0),
        "trapezoid": np.where(inside, np.clip(np.minimum(time, 1.0 - time) / 0.1, 0.0, 1.0), 0.0),
    }[shape]


def responded(force: Array, step: float) -> Array:
    """Displacement of the mass under a force, by Duhamel's integral."""
    time = step * np.arange(len(force))
    wave = W * math.sqrt(1.0 - ZETA**2)
    kick = np.exp(-ZETA * W * time) * np.sin(wave * time) / (M * wave)
    length = 2 * len(force)
    return step * np.fft.irfft(np.fft.rfft(force, length) * np.fft.rfft(kick, length))[: len(force)]


@pytest.mark.parametrize("shape", list(SHAPES))
def test_the_transform_of_a_shape_is_its_integral(shape: str) -> None:
    pulse, time = PulseShape(SHAPES[shape], 0.02), np.linspace(0.0, 1.0, 400_001)
    for omega in (0.0, 50.0, 400.0, 1500.0):
        wave = formula(shape, time) * np.exp(-1j * omega * 0.02 * time)
        whole = 0.02 * np.trapezoid(wave, time)
        found = pulse.transform(np.array([omega]))[0]
        assert abs(found - whole) < 3e-3 * pulse.area  # a tooth falls within a 400th


CASES: dict[str, dict[str, Any]] = {
    "half-sine": {"duration": "20 ms"},
    "saw-tooth": {"duration": 0.06, "two_sided": False},
    "trapezoid": {"duration": 0.01, "sizes": "normal"},
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", list(CASES))
def test_a_linear_response_has_the_moments_of_campbell(shape: str) -> None:
    """Mean, variance and fourth moment; that of a Gaussian motion is far away."""
    keys = CASES[shape]
    pulses = Pulses(rate=0.8, shape=shape, amplitude=30.0, **keys)
    step = 1e-4
    time = np.arange(0.0, 6.0, step)
    assert pulses.shock is not None
    moved = responded(30.0 * formula(shape, time / pulses.shock.duration), step)
    kappa = [
        pulses.rate * pulses.relative_moment(n) * float(np.trapezoid(moved**n, dx=step))
        for n in (1, 2, 3, 4)
    ]
    plan = plan_histories(shaken(pulses)).plan.sampled(1e9, 60.0)
    samples = plan.history_samples(60.0)
    found = np.concatenate(
        [plan.histories(3, k, 16, samples).displacement[0] for k in range(0, 256, 16)]
    )
    apart = found - kappa[0]
    for values, exact in (
        (found, kappa[0]), (apart**2, kappa[1]), (apart**4, kappa[3] + 3.0 * kappa[1] ** 2),
    ):  # fmt: skip
        each = values.mean(axis=1)
        error = float(each.std() / math.sqrt(len(each)))
        assert abs(each.mean() - exact) < 4.5 * error + 2e-3 * abs(exact)
    assert abs(each.mean() - 3.0 * kappa[1] ** 2) > 4.5 * error


def test_short_shocks_are_impulses() -> None:
    """Between rigid stops, by the engine that kicks the mass at each step."""
    stops = [ImpactPair(clearance=0.003, law=Restitution(coefficient=0.6))]
    length = 2e-3  # the response of 10 Hz to it is 7e-4 smaller than to an impulse
    shocks = Pulses(
        rate=5.0, shape="half-sine", duration=length, amplitude=0.3 * math.pi / 2.0 / length
    )
    found = [
        simulate(shaken(each, pairs=stops), rel_error=0.05, seed=seed)
        for seed, each in enumerate((shocks, Pulses(rate=5.0, impulse=0.3)))
    ]
    for name in ("collision_rate", "impact_speed_rate"):
        one, other = (each.impact_pairs["stops"][name] for each in found)
        assert abs(one.value - other.value) < math.hypot(one.reach(4.5), other.reach(4.5))
    # shocks as long as half a period are told apart
    slow = shocks.replace(duration=0.05, amplitude=0.3 * math.pi / 2.0 / 0.05)
    third = simulate(shaken(slow, pairs=stops), rel_error=0.05, seed=3)
    one, other = third.impact_pairs["stops"]["collision_rate"], found[1].impact_pairs["stops"]
    rate = other["collision_rate"]
    assert abs(one.value - rate.value) > math.hypot(one.reach(4.5), rate.reach(4.5))


@pytest.mark.slow
def test_a_shock_alone_is_that_of_a_replayed_record(tmp_path: Path) -> None:
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    fs, length, peak = 20_000.0, 0.011, 150.0
    time = np.arange(round(10.0 * fs)) / fs
    values = peak * formula("half-sine", (time - 0.1) / length)
    np.savetxt(tmp_path / "shock.txt", values - values.mean())
    record = RecordedNoise(file=str(tmp_path / "shock.txt"), unit="m/s2", fs=fs)
    alone = replay(Scene(structure=structure, excitations=[record])).coordinates["x"]
    inside = (time >= 0.1) & (time <= 0.1 + length)
    np.savetxt(tmp_path / "pulse.txt", values[inside][1:])
    pulses = [
        Pulses(rate="90/h", shape="half-sine", duration=length, amplitude=peak),
        Pulses(rate="90/h", file=str(tmp_path / "pulse.txt"), unit="m/s2", fs=fs),
    ]
    largest = []
    for each in pulses:
        plan = plan_histories(Scene(structure=structure, excitations=[each])).plan
        plan = plan.sampled(1e-4, 100.0)
        moved = plan.histories(1, 0, 2, plan.history_samples(100.0)).displacement[0]
        largest.append(np.abs(moved).max())
    assert largest[0] == pytest.approx(largest[1], rel=1e-3)
    most = max(abs(alone["displacement_max"].value), abs(alone["displacement_min"].value))
    # the mean of the record is left out of the replay, 0.2 % of the displacement
    assert largest[0] == pytest.approx(most, rel=3e-3)


def test_damage_takes_shocks_and_other_methods_refuse_them() -> None:
    structure = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    shocks = Pulses(rate=0.5, shape="half-sine", duration="20 ms", amplitude=60.0)
    pair = ImpactPair(clearance=0.01, law=Restitution(coefficient=0.7))
    scene = Scene(structure=structure, impact_pairs=[pair], excitations=[PROFILE, shocks])
    free = scene.replace(impact_pairs=[])
    asked = {"mission": 600.0, "equipment": [39.9, 40.0, 60.0], "rel_error": 0.3}
    with_shocks, without = (
        damage(free, **asked),
        damage(  # type: ignore[arg-type]
            free.replace(excitations=[PROFILE]),
            **asked,  # type: ignore[arg-type]
        ),
    )
    assert with_shocks.way == "simulation" and without.way == "density"
    more = with_shocks.with_stops.fatigue_damage, without.with_stops.fatigue_damage
    assert np.all(more[0].value - more[1].value > 4.5 * more[0].standard_error)
    for ask in (screen, linearise):
        with pytest.raises(NotApplicable, match="must be Gaussian noise, got pulses of a shape"):
            ask(scene)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "needs exactly one of impulse, shape and file, got none"),
        ({"impulse": 1.0, "shape": "half-sine"}, "needs exactly one of impulse, shape and file"),
        ({"shape": "half-sine"}, "needs duration and amplitude with shape"),
        ({"impulse": 1.0, "duration": 0.01}, "has duration, which does not go with impulse"),
        ({"shape": "square", "duration": 0.01, "amplitude": 1.0}, "shape"),
        ({"impulse": 1.0, "rate": "often"}, "rate"),
    ],
)
def test_wrong_keys_are_named(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        shaken({"kind": "pulses", "rate": 1.0} | keys)


def test_a_level_raises_the_peak() -> None:
    pulses = Pulses(rate=1.0, shape="trapezoid", duration=0.01, amplitude=10.0)
    assert pulses.louder(20.0).size == pytest.approx(100.0)
    assert pulses.moment(2) == pytest.approx(100.0)


def test_the_peak_of_a_shape_may_be_in_g() -> None:
    shape = {"rate": 2.0, "shape": "half-sine", "duration": "20 ms"}
    in_g, plain = Pulses(**shape, amplitude=3.0, unit="g"), Pulses(**shape, amplitude=29.41995)
    assert in_g.size == pytest.approx(plain.size) and in_g.moment(2) == pytest.approx(
        plain.moment(2)
    )
    louder = in_g.louder(6.0)
    assert louder.size == pytest.approx(plain.louder(6.0).size) and louder.unit == "g"
    with pytest.raises(SceneError, match="unit"):
        Pulses(**shape, amplitude=3.0, unit="mm")
    with pytest.raises(SceneError, match="does not go with impulse"):
        Pulses(rate=2.0, impulse=0.1, unit="g")
