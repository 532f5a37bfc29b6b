"""Noise of varying level: its simulated records, and the risks, clearances and damage that follow,
against records of a judge that shares no code with the package."""

import importlib.util
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from stochvi import (
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    WhiteNoise,
    damage,
    exact,
    linearise,
    reliability,
    screen,
    simulate,
    size,
)
from stochvi.methods.monte_carlo.history_plans import plan_histories
from stochvi.model.model import model_of
from stochvi.scenes import Phase
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.records import DamageSampler, sampled_for
from support.accuracies import quick_cases

PROFILE = "mil-std-810h-truck-vertical-5hz"
NATURAL, ZETA = 12.0, 0.1
LAW = Restitution(coefficient=0.7)

Array = NDArray[np.float64]


def mount(clearance: float | None = None, **level: Any) -> Scene:
    pairs = [] if clearance is None else [ImpactPair(clearance=clearance, law=LAW)]
    noise = TabulatedNoise(profile=PROFILE, **level)
    structure = Isolator(frequency_hz=NATURAL, zeta=ZETA, mass=1.0)
    return Scene(structure=structure, impact_pairs=pairs, excitations=[noise])


def agree(one: Estimate, other: Estimate) -> bool:
    """Whether two independent estimates differ by no more than their errors."""
    return abs(one.value - other.value) < math.hypot(one.reach(4.5), other.reach(4.5))


class Judge:
    """Records of the mount, made in the frequency domain from noise times a level of its own."""

    rate, margin = 600.0, 10.0

    def __init__(self, kurtosis: float, time: float, duration: float) -> None:
        self.spread = 0.5 * math.sqrt(math.log(kurtosis / 3.0))
        self.samples = 2 * math.ceil((duration + 2.0 * self.margin) * self.rate / 2.0)
        self.keep = math.exp(-1.0 / self.rate / time)
        table = TabulatedNoise(profile=PROFILE).table
        f = np.fft.rfftfreq(self.samples, 1.0 / self.rate)
        low, high = table.frequency_hz[[0, -1]]
        inside = (f >= low) & (f <= high)
        self.density = np.where(inside, table(np.clip(f, low, high)), 0.0)
        w, w0 = 2.0 * math.pi * f, 2.0 * math.pi * NATURAL
        self.gain = -1.0 / (w0**2 - w**2 + 2j * ZETA * w0 * w)

    def records(self, number: int, seed: int) -> Any:
        """Relative displacements, one record at a time, without their ends."""
        random = np.random.default_rng(seed)
        for _ in range(number):
            parts = random.standard_normal((2, len(self.density)))
            bins = (parts[0] + 1j * parts[1]) * np.sqrt(self.density * self.samples * self.rate)
            noise = np.fft.irfft(0.5 * bins, self.samples)
            normal = random.standard_normal(self.samples)
            normal[1:] *= math.sqrt(1.0 - self.keep**2)
            normal = lfilter([1.0], [1.0, -self.keep], normal)
            shaken = noise * np.exp(self.spread * normal - self.spread**2)
            moved = np.fft.irfft(np.fft.rfft(shaken) * self.gain, self.samples)
            ends = round(self.margin * self.rate)
            yield moved[ends:-ends]


def kurtosis_of(records: Array) -> tuple[float, float]:
    """Kurtosis of records (records, samples), and its standard error."""
    squares, fourths = (records**2).mean(axis=1), (records**4).mean(axis=1)
    value = fourths.mean() / squares.mean() ** 2
    apart = fourths / fourths.mean() - 2.0 * squares / squares.mean()
    return float(value), float(value * apart.std() / math.sqrt(len(records)))


def flown(scene: Scene, paths: int, duration: float) -> tuple[Array, Array | None]:
    plan = plan_histories(scene).plan.sampled(1e9, duration)
    found = [
        plan.histories(3, first, 16, plan.history_samples(duration))
        for first in range(0, paths, 16)
    ]
    moved = np.concatenate([each.displacement[0] for each in found])
    known = [each.excitation for each in found if each.excitation is not None]
    return moved, np.concatenate(known) if known else None


@quick_cases("time", [0.5, 10.0, 0.2], keep=(0,))
def test_kurtosis_in_is_kurtosis_out_and_the_mount_feels_what_theory_says(time: float) -> None:
    scene = mount(kurtosis=5.0, level_time=time)
    moved, shaken = flown(scene, 64, 300.0)
    assert shaken is not None
    value, error = kurtosis_of(shaken)
    assert abs(value - 5.0) < 4.5 * error and error < 0.25
    level, model = scene.random_level, model_of(scene)
    assert level is not None
    felt, error = kurtosis_of(moved)
    assert abs(felt - level.felt(model.damping_rate).kurtosis) < 4.5 * error
    # noise of steady level is told apart, and so is the same level for the rms
    plain, _ = flown(mount(), 64, 300.0)
    assert abs(kurtosis_of(plain)[0] - 3.0) < 4.5 * kurtosis_of(plain)[1]
    assert felt - 3.0 > 4.5 * error
    squares = (moved**2).mean(axis=1)
    variance = exact(mount()).coordinates["x"]["displacement_mean_square"].value
    assert abs(squares.mean() - variance) < 4.5 * squares.std() / math.sqrt(len(squares))


def test_several_masses_feel_the_same_level() -> None:
    structure = Matrices(
        coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 1.0]],
        damping=[[30.0, -10.0], [-10.0, 30.0]], stiffness=[[12e3, -4e3], [-4e3, 12e3]],
    )  # fmt: skip
    noise = TabulatedNoise(
        frequency_hz=[1.0, 200.0], density=[0.1, 0.1], unit="N2/Hz", on="a", kurtosis=5.0,
        level_time="0.3 s",
    )  # fmt: skip
    scene = Scene(structure=structure, excitations=[noise])
    plan = plan_histories(scene).plan.sampled(1e9, 200.0)
    moved = np.concatenate(
        [plan.histories(3, k, 16, plan.history_samples(200.0)).displacement for k in (0, 16)],
        axis=1,
    )
    steady = exact(scene.at_steady_level(0.0))
    for name, each in zip("ab", moved, strict=True):
        squares = (each**2).mean(axis=1)
        variance = steady.coordinates[name]["displacement_mean_square"].value
        assert abs(squares.mean() - variance) < 4.5 * squares.std() / math.sqrt(len(squares))
        value, error = kurtosis_of(each)
        # both modes have rates of 20 and 40 per second
        level = scene.random_level
        assert level is not None
        lowest, highest = (level.felt(rate).kurtosis for rate in (20.0, 40.0))
        assert lowest - 4.5 * error < value < highest + 4.5 * error


def test_the_spectrum_is_that_of_the_table() -> None:
    _, shaken = flown(mount(kurtosis=5.0, level_time=1.0), 96, 60.0)
    assert shaken is not None
    step = 60.0 / shaken.shape[1]
    found = np.abs(np.fft.rfft(shaken, axis=1)) ** 2 * 2.0 * step / shaken.shape[1]
    f = np.fft.rfftfreq(shaken.shape[1], step)
    table = TabulatedNoise(profile=PROFILE).table
    for low, high in ((8.0, 14.0), (20.0, 40.0), (50.0, 80.0)):
        band = (f > low) & (f < high)
        each = (found[:, band] / table(f[band])).mean(axis=1)
        error = each.std() / math.sqrt(len(each))
        assert error < 0.05
        assert abs(each.mean() - 1.0) < 4.5 * error + 0.002


def test_an_independent_program_reads_the_same_kurtosis_and_spectrum() -> None:
    if importlib.util.find_spec("pyExSi") is None:
        pytest.skip("pyExSi is not installed (pip install 'stochvi[bench]')")
    import pyExSi

    _, shaken = flown(mount(kurtosis=5.0, level_time=1.0), 32, 120.0)
    assert shaken is not None
    own = kurtosis_of(shaken)
    assert pyExSi.get_kurtosis(shaken.ravel()) == pytest.approx(own[0], rel=1e-3)
    assert abs(pyExSi.get_kurtosis(shaken.ravel()) - 5.0) < 4.5 * own[1]


MISSIONS = [(0.010, 5.0, 10.0, 60.0), (0.008, 4.0, 2.0, 60.0), (0.012, 8.0, 30.0, 10.0)]


@quick_cases(("clearance", "kurtosis", "time", "mission"), MISSIONS, keep=(2,))
def test_the_chance_of_any_hit_is_that_of_counted_missions(
    clearance: float, kurtosis: float, time: float, mission: float
) -> None:
    scene = mount(clearance, kurtosis=kurtosis, level_time=time)
    found = reliability(scene, mission=mission, seed=1, rel_error=0.1)
    chance = found.chances["hit"]
    number = round(min(4000.0, 15e4 / mission))
    records = Judge(kurtosis, time, mission).records(number, seed=5)
    counted = np.mean([np.abs(each).max() > clearance for each in records])
    error = math.sqrt(counted * (1.0 - counted) / number)
    own = chance.estimate
    assert own.bias is not None
    assert abs(own.value - counted) < 4.5 * math.hypot(error, own.standard_error) + own.bias
    # Gaussian noise of the same spectrum is told apart
    plain = reliability(mount(clearance), mission=mission, seed=1, rel_error=0.1).chances["hit"]
    apart = math.hypot(error, plain.estimate.standard_error)
    assert abs(plain.estimate.value - counted) > 4.5 * apart
    assert chance.way == "levels" and "dB" in chance.why


def test_expected_impacts_are_those_of_a_simulation() -> None:
    scene = mount(0.008, kurtosis=5.0, level_time=10.0)
    found = reliability(scene, mission=3600.0, seed=2, rel_error=0.1)
    assert found.hits is not None
    flown = simulate(scene, rel_error=0.08, seed=3)
    rate = flown.impact_pairs["stops"]["collision_rate"]
    assert agree(found.hits / 3600.0, rate)
    plain = reliability(mount(0.008), mission=3600.0, seed=2, rel_error=0.1).hits
    assert plain is not None
    assert not agree(plain / 3600.0, rate)


def test_two_masses_and_one_have_the_same_risk() -> None:
    """The second mass has no stops, and is no part of the question."""
    one = mount(0.011, kurtosis=6.0, level_time=8.0)
    omega = 2.0 * math.pi * NATURAL
    apart = Matrices(
        coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 1.0]],
        damping=np.diag([2.0 * ZETA * omega, 2.0 * ZETA * 1.5 * omega]).tolist(),
        stiffness=np.diag([omega**2, (1.5 * omega) ** 2]).tolist(),
    )  # fmt: skip
    pair = ImpactPair(on="x", clearance=0.011, law=LAW)
    noise = TabulatedNoise(
        profile=PROFILE, on="base", kurtosis=6.0, level_time=8.0
    )  # fmt: skip
    two = Scene(structure=apart, impact_pairs=[pair], excitations=[noise])
    found = [
        reliability(each, mission=600.0, seed=seed, rel_error=0.1).chances["hit"].estimate
        for seed, each in enumerate((one, two))
    ]
    assert agree(found[0], found[1])


def test_a_clearance_keeps_its_chance() -> None:
    level = {"kurtosis": 5.0, "level_time": "10 s"}
    found = size(mount(**level), probability=0.02, mission=1800.0, seed=1, rel_error=0.1)
    risk = reliability(
        mount(found.clearance.value, **level), mission=1800.0, seed=4, rel_error=0.05
    ).chances["hit"]
    assert abs(risk.estimate.value - 0.02) < risk.estimate.reach(4.5) + 4.5 * 0.05 * 0.02
    plain = size(mount(), probability=0.02, mission=1800.0, seed=1).clearance.value
    assert found.clearance.value > 1.3 * plain
    assert found.verdict().endswith("at or below 2 %")
    # a second phase at the same level adds to the risk
    phases = [Phase(name=name, duration=900.0) for name in ("first", "second")]
    joint = size(mount(**level).replace(phases=phases), probability=0.02, seed=3)
    assert abs(joint.clearance.value / found.clearance.value - 1.0) < 0.02


def test_linear_damage_and_extremes_are_those_of_records() -> None:
    scene, equipment = mount(kurtosis=4.5, level_time=2.0), Equipment((40.0, 90.0), 10.0, 4.0)
    mission = 30.0
    assert scene.random_level is not None
    assert 3.0 * scene.random_level.moment(4.0) == pytest.approx(4.5)
    found = damage(
        scene, mission=mission, equipment=[39.9, 40.0, 90.0], q=10.0, exponent=4.0
    )  # fmt: skip
    assert found.way == "density"
    sampler = DamageSampler(
        sampled_for(plan_histories(scene), equipment), equipment, (1.0,), False, (), 3
    )
    worn = mission * sampler.simulate(0, 384).damage / sampler.seconds
    plain = damage(mount(), mission=mission, equipment=[39.9, 40.0, 90.0], exponent=4.0)
    for row in range(2):
        error = float(worn[:, row].std() / math.sqrt(len(worn)))
        seen = Estimate(value=float(worn[:, row].mean()), standard_error=error)
        assert agree(found.with_stops.fatigue_damage.estimates()[row + 1], seen)
        assert not agree(plain.with_stops.fatigue_damage.estimates()[row + 1], seen)
    # the largest of a mission, and the levels below which it stays with 2.5 and 97.5 %
    f, w0 = 90.0, 2.0 * math.pi * 90.0
    largest = []
    judge = Judge(4.5, 2.0, mission)
    for moved in judge.records(400, seed=8):
        w = 2.0 * math.pi * np.fft.rfftfreq(len(moved), 1.0 / judge.rate)
        own = 2.0 * math.pi * NATURAL
        carried = -(own**2 + 2j * ZETA * own * w)
        passed = (w0**2 + 1j * w0 * w / 10.0) / (w0**2 - w**2 + 1j * w0 * w / 10.0)
        stands = np.fft.irfft(np.fft.rfft(moved) * carried * passed, len(moved))
        largest.append(float(np.abs(stands).max()))
    assert f == equipment.frequency_hz[1]
    seen = Estimate(
        value=float(np.mean(largest)),
        standard_error=float(np.std(largest) / math.sqrt(len(largest))),
        bias=float(np.mean(largest)) * (math.pi * f / judge.rate) ** 2 / 6.0,
    )
    assert agree(found.with_stops.extreme_response.estimates()[2], seen)
    assert not agree(plain.with_stops.extreme_response.estimates()[2], seen)
    above = np.mean(np.array(largest) > found.with_stops.extreme_upper[2])
    assert above < 0.025 + 4.5 * math.sqrt(0.025 * 0.975 / len(largest))


def test_what_does_not_follow_the_level_refuses_in_a_sentence() -> None:
    scene = mount(0.01, kurtosis=5.0, level_time=10.0)
    for ask in (screen, linearise, exact):
        with pytest.raises(
            NotApplicable, match="must be Gaussian noise, got noise of varying level"
        ):
            ask(scene)
    with pytest.raises(
        NotApplicable, match="impact_speed must be left out under noise of varying level"
    ):
        reliability(scene, mission=60.0, impact_speed=0.1)
    with pytest.raises(NotApplicable, match="level_time must be long beside the memory"):
        reliability(mount(0.01, kurtosis=5.0, level_time=0.05), mission=60.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"level_time": 1.0}, "needs kurtosis with level_time, got level_time alone"),
        ({"kurtosis": 3.0, "level_time": 1.0}, "kurtosis must be above 3 and at most 100"),
        ({"kurtosis": 5.0, "level_time": "2 mm"}, "level_time"),
    ],
)
def test_wrong_keys_are_named(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        mount(**keys)


def test_all_noise_rises_and_falls_together() -> None:
    scene = mount(kurtosis=5.0, level_time=1.0)
    beside = WhiteNoise(density=1e-4, unit="g2/Hz")
    with pytest.raises(SceneError, match=r"excitation.1 must have the kurtosis and level_time"):
        scene.replace(excitations=[*scene.excitations, beside])
