"""Noise of varying level: its simulated records, and the risks, clearances and damage that follow,
against records of a judge that shares no code with the package."""

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    SceneError,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    damage,
    exact,
    impacts,
    linearise,
    load_scene,
    reliability,
    screen,
    simulate,
    size,
)
from stochvi.isolators import Spread, bumper_map
from stochvi.mathematics.unsteady_noise import MovingMean, Sines, slopes
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_histories
from stochvi.scenes import Phase, shipped_scene
from stochvi.statistics import rare_hits
from stochvi.statistics.crossings import PairMotion, first_crossings
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.simulated import DamageSampler, sampled_for
from stochvi.statistics.hardness import Limit
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.refusals import refusals

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
    assert "less than 2 % likely" in found.verdict()
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
        NotApplicable, match="impact_speed must be left out with noise of varying level"
    ):
        reliability(scene, mission=60.0, impact_speed=0.1)
    with pytest.raises(NotApplicable, match="level_time must be long beside the memory"):
        reliability(mount(0.01, kurtosis=5.0, level_time=0.05), mission=60.0)


test_wrong_keys_are_named = refusals(
    lambda keys: mount(**keys),
    ({"level_time": 1.0}, "needs kurtosis with level_time, got level_time alone"),
    ({"kurtosis": 3.0, "level_time": 1.0}, "kurtosis must be above 3 and at most 100"),
    ({"kurtosis": 5.0, "level_time": "2 mm"}, "level_time"),
)


def test_all_noise_rises_and_falls_together() -> None:
    scene = mount(kurtosis=5.0, level_time=1.0)
    beside = WhiteNoise(density=1e-4, unit="g2/Hz")
    with pytest.raises(SceneError, match=r"excitation.1 must have the kurtosis and level_time"):
        scene.replace(excitations=[*scene.excitations, beside])


# ------------------------------------------------------------------------------
# Sines beside noise: the chance of any impact, and what follows from it, against missions of a
# judge that shares no code with the package.
#
# The judge makes the response without stops in the frequency domain, from receptances of its own,
# adds the exact response to sines of random phases, and counts the missions in which a gap is at a
# stop.
# ------------------------------------------------------------------------------


PER_PERIOD = 100.0
"""Samples in a period of the fastest mode or sine: the largest of them is then below a peak by
(pi / 100)^2 / 6 = 1.6e-4 of it on average."""

ROOM = 1.3
"""Length of a record over that of a mission: the rest is longer than the memory of the motion."""

AT_ONCE = 64
"""Missions that the judge makes together."""

LOSS = Restitution(coefficient=0.6)


@dataclass(frozen=True)
class JudgeOfSines:
    """A linear structure of its own matrices, and what shakes it.

    `noises` are one-sided densities (functions of hertz) with the forces per unit; `sines` are
    (forces, amplitude, hertz); `gaps` are rows.
    """

    mass: Array
    damping: Array
    stiffness: Array
    noises: tuple[tuple[Callable[[Array], Array], Array], ...]
    sines: tuple[tuple[Array, float, float], ...]
    gaps: Array
    mission: float

    def receptance(self, hertz: Array) -> Any:
        """Gaps per force, (frequencies, gaps, coordinates)."""
        w = 2.0 * math.pi * np.asarray(hertz)[:, None, None]
        return self.gaps @ np.linalg.inv(self.stiffness - w**2 * self.mass + 1j * w * self.damping)

    def extremes(self, missions: int, seed: int) -> Array:
        """Lowest and highest place of each gap in each mission, (2, missions, gaps)."""
        random = np.random.default_rng(seed)
        squares = np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness)).real
        natural = math.sqrt(squares.max()) / (2.0 * math.pi)
        fastest = max(natural, *(each[2] for each in self.sines), 0.0)
        length = ROOM * self.mission
        samples = math.ceil(PER_PERIOD * fastest * length)
        counted = math.floor(samples / ROOM)
        time = np.arange(counted) * length / samples
        bins = np.arange(1, samples // 2) / length
        gains = self.receptance(bins)
        found = []
        for _ in range(math.ceil(missions / AT_ONCE)):
            spectrum = np.zeros((AT_ONCE, len(self.gaps), samples // 2 + 1), complex)
            for density, force in self.noises:
                normal = random.standard_normal((2, AT_ONCE, len(bins)))
                own = (normal[0] + 1j * normal[1]) * np.sqrt(density(bins) / length) / 2.0
                spectrum[:, :, 1:-1][:, :, : len(bins)] += own[:, None] * (gains @ force).T
            gaps = np.fft.irfft(spectrum, samples, axis=2)[:, :, :counted] * samples
            for force, amplitude, hertz in self.sines:
                wave = amplitude * (self.receptance(np.array([hertz]))[0] @ force)
                turn = 2.0 * math.pi * hertz * time + random.uniform(
                    0.0, 2.0 * math.pi, (AT_ONCE, 1)
                )
                gaps += (np.exp(1j * turn)[:, None] * wave[:, None]).real
            found.append([gaps.min(axis=2), gaps.max(axis=2)])
        return np.concatenate(np.array(found).transpose(0, 1, 2, 3), axis=1)[:, :missions]


def flat(level: float) -> Callable[[Array], Array]:
    return lambda f: np.full_like(f, level)


def sloping(low: float, high: float, first: float, last: float) -> Callable[[Array], Array]:
    """A density that is straight on logarithmic axes between two frequencies, and 0 beyond."""
    slope = math.log(last / first) / math.log(high / low)
    return lambda f: np.where((f >= low) & (f <= high), first * (f / low) ** slope, 0.0)


@dataclass(frozen=True)
class Case:
    """A scene without its clearance, the judge of it, and the shares of clearances of its sides."""

    scene: Callable[[float], Scene]
    judge: JudgeOfSines
    sides: tuple[tuple[float, float], ...]

    def hit(self, extremes: Array, clearance: float) -> NDArray[np.bool_]:
        lower, upper = (clearance * each for each in np.transpose(self.sides))
        return np.asarray(((extremes[0] <= -lower) | (extremes[1] >= upper)).any(axis=1))

    def needed(self, extremes: Array) -> Array:
        """The largest clearance at which each mission has an impact."""
        lower, upper = np.transpose(self.sides)
        return np.maximum(-extremes[0] / lower, extremes[1] / upper).max(axis=1)


def drawn_sines(
    random: np.random.Generator, natural: float, rms: float
) -> list[tuple[float, float]]:
    """One to three sines (hertz, share of the rms of the gap): slow, near the resonance, fast."""
    return [
        (natural * float(random.uniform(0.3, 2.5)), rms * float(random.uniform(0.3, 2.0)))
        for _ in range(random.integers(1, 4))
    ]


def one_mass(random: np.random.Generator, on_base: bool) -> Case:
    """An oscillator in white noise, or a mount on a base with a sloping density."""
    natural, zeta = float(random.uniform(2.0, 20.0)), float(random.uniform(0.03, 0.15))
    omega = 2.0 * math.pi * natural
    mission = float(random.uniform(30.0, 80.0)) / natural
    mass = 1.0 if on_base else float(random.uniform(0.5, 3.0))
    bare = JudgeOfSines(
        mass=np.array([[mass]]), damping=np.array([[2.0 * zeta * omega * mass]]),
        stiffness=np.array([[omega**2 * mass]]), noises=(), sines=(), gaps=np.eye(1),
        mission=mission,
    )  # fmt: skip
    force = np.array([-mass if on_base else 1.0])
    if on_base:
        low, high, first, last = 0.3 * natural, 10.0 * natural, 0.5, float(random.uniform(0.05, 1))
        density = sloping(low, high, first, last)
        noise: Any = TabulatedNoise(
            frequency_hz=[low, high], density=[first, last], unit="(m/s2)2/Hz", on="base"
        )
    else:
        density, noise = flat(2.0 * 3.0), WhiteNoise(intensity=3.0)
    f = np.linspace(1e-3, 30.0, 60001) * natural
    gains = np.abs((bare.receptance(f) @ force)[:, 0]) ** 2
    rms = math.sqrt(float(np.trapezoid(gains * density(f), f)))
    waves = [
        (force, amplitude / abs(complex((bare.receptance(np.array([hertz]))[0] @ force)[0])), hertz)
        for hertz, amplitude in drawn_sines(random, natural, rms)
    ]
    both = bool(random.integers(0, 2))
    sides = ((1.0, float(random.uniform(1.0, 1.5)) if both else math.inf),)

    def scene(clearance: float) -> Scene:
        upper = clearance * sides[0][1]
        stops = ImpactPair(lower=-clearance, upper=upper if both else None, law=LOSS)
        structure: Any = Oscillator(mass=mass, damping=2.0 * zeta * omega * mass,
                                    stiffness=omega**2 * mass)  # fmt: skip
        on = {"on": "base"} if on_base else {}
        if on_base:
            structure = Isolator(frequency_hz=natural, zeta=zeta)
        return Scene(
            structure=structure, impact_pairs=[stops],
            excitations=[
                noise, *(Sine(amplitude=a, frequency_hz=hertz, **on) for _, a, hertz in waves)
            ],
        )  # fmt: skip

    judge = replace(bare, noises=((density, force),), sines=tuple(waves))
    return Case(scene, judge, sides)


def two_masses(random: np.random.Generator) -> Case:
    """Two masses with noise and sines on either, and stops on one of them and between both."""
    mass = np.diag(random.uniform(0.5, 2.0, 2))
    springs = (2.0 * math.pi * random.uniform(2.0, 8.0, 3)) ** 2
    stiffness = np.array([[springs[0] + springs[2], -springs[2]],
                          [-springs[2], springs[1] + springs[2]]])  # fmt: skip
    natural = math.sqrt(float(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min()))
    damping = 0.12 / natural * stiffness
    hertz = natural / (2.0 * math.pi)
    mission = float(random.uniform(30.0, 60.0)) / hertz
    gaps = np.array([[1.0, 0.0], [-1.0, 1.0]])
    low, high = 0.2 * hertz, 15.0 * hertz
    noises = (
        (flat(2.0 * 2.0), np.array([1.0, 0.0])),
        (sloping(low, high, 3.0, 1.0), np.array([0.0, 1.0])),
    )
    bare = JudgeOfSines(mass=mass, damping=damping, stiffness=stiffness, noises=noises, sines=(),
                 gaps=gaps, mission=mission)  # fmt: skip
    f = np.linspace(1e-3, 40.0, 60001) * hertz
    squares = sum(
        np.trapezoid(np.abs(bare.receptance(f) @ force) ** 2 * density(f)[:, None], f, axis=0)
        for density, force in noises
    )
    rms = np.sqrt(squares)
    waves = []
    for own, amplitude in drawn_sines(random, hertz, 1.0):
        force = np.eye(2)[random.integers(0, 2)]
        moved = np.abs(bare.receptance(np.array([own]))[0] @ force) / rms
        waves.append((force, amplitude / float(moved.max()), own))
    sides = ((float(rms[0]),) * 2, (float(rms[1]),) * 2)

    def scene(clearance: float) -> Scene:
        near, between = (clearance * each for each, _ in sides)
        return Scene(
            structure=Matrices(
                coordinates=("x", "z"), mass=mass.tolist(), damping=damping.tolist(),
                stiffness=stiffness.tolist(),
            ),
            impact_pairs=[
                ImpactPair(name="x", on="x", lower=-near, upper=near, law=LOSS),
                ImpactPair(
                    name="both", between=("x", "z"), lower=-between, upper=between, law=LOSS
                ),
            ],
            excitations=[
                WhiteNoise(intensity=2.0, on="x"),
                TabulatedNoise(
                    frequency_hz=[low, high], density=[3.0, 1.0], unit="N2/Hz", on="z"
                ),
                *(Sine(amplitude=a, frequency_hz=own, on="xz"[int(force[1])])
                  for force, a, own in waves),
            ],
        )  # fmt: skip

    return Case(scene, replace(bare, sines=tuple(waves)), sides)


def drawn(number: int) -> tuple[Case, float]:
    """One of the random scenes, and the share of its missions that should have an impact."""
    random = np.random.default_rng([number, 0x51E])
    share = float(random.uniform(0.02, 0.5))
    kind = number % 3
    return (two_masses(random) if kind == 2 else one_mass(random, kind == 1)), share


def counted(case: Case, share: float, missions: int, number: int) -> tuple[float, float, float]:
    """A clearance with about this share of missions with an impact, and that share by other
    missions, with its standard error."""
    clearance = float(np.quantile(case.needed(case.judge.extremes(512, number)), 1.0 - share))
    hit = case.hit(case.judge.extremes(missions, 1000 + number), clearance)
    chance = float(hit.mean())
    return clearance, chance, math.sqrt(chance * (1.0 - chance) / missions)


def chance_of(scene: Scene, mission: float, rel_error: float) -> Estimate:
    return first_crossings(scene, mission=mission, rel_error=rel_error, seed=2).probability(
        mission
    )[0]


def widened(found: Estimate, error: float) -> Estimate:
    """An estimate whose standard error is that of its difference to one of another error."""
    return replace(found, standard_error=math.hypot(found.standard_error, error))


@quick_cases("number", range(20), keep=(0, 1, 2))
def test_the_chance_of_any_hit_of_random_scenes(number: int) -> None:
    """Oscillators in white noise, mounts on a shaken base, and two masses; one to three sines."""
    case, share = drawn(number)
    clearance, chance, error = counted(case, share, 1024 if number < 3 else 8192, number)
    found = chance_of(case.scene(clearance), case.judge.mission, 0.02)
    print(number, found, chance, (found.value - chance) / math.hypot(error, found.standard_error))
    assert_agrees(widened(found, error), chance)


UNIT = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
NOISE = WhiteNoise(intensity=0.2)
"""omega = sigma_x = sigma_v = 1, zeta = 0.05."""

MISSION = 100.0


def unit(*sines: Sine, clearance: float = 4.0, noise: float = 0.2, law: Any = LOSS) -> Scene:
    return Scene(
        structure=UNIT,
        impact_pairs=[ImpactPair(lower=-clearance, upper=clearance, law=law)],
        excitations=[WhiteNoise(intensity=noise), *sines],
    )


def force(place: float, omega: float) -> Sine:
    """A sine that moves the unit oscillator by an amplitude."""
    stiffness = math.hypot(1.0 - omega**2, 0.1 * omega)
    return Sine(amplitude=place * stiffness, frequency_hz=omega / (2.0 * math.pi))


def judge_of(*sines: tuple[float, float], mission: float = MISSION) -> Case:
    """The judge of the unit oscillator under sines (amplitude of motion, rad/s)."""
    own = tuple(
        (np.ones(1), place * math.hypot(1.0 - w**2, 0.1 * w), w / (2.0 * math.pi))
        for place, w in sines
    )
    one = np.eye(1)
    judge = JudgeOfSines(one, 0.1 * one, one, ((flat(0.4), np.ones(1)),), own, one, mission)
    waves = [force(*each) for each in sines]
    return Case(lambda c: unit(*waves, clearance=c), judge, ((1.0, 1.0),))


def test_a_chance_without_the_sine_or_with_noise_in_its_place_fails() -> None:
    """Negative control: the judge notices a sine that is left out of the crossing rates, and one
    that counts as more of the noise. The sine moves the mass by 2 rms of the noise."""
    case = judge_of((2.0, 0.6))
    hit = case.hit(case.judge.extremes(2048, 5), 4.4)
    chance, error = float(hit.mean()), float(hit.std()) / math.sqrt(len(hit))
    whole = chance_of(case.scene(4.4), MISSION, 0.05)
    assert_agrees(widened(whole, error), chance)
    louder = unit(clearance=4.4, noise=0.2 * (1.0 + 2.0**2 / 2.0))
    for wrong in (unit(clearance=4.4), louder):
        with pytest.raises(AssertionError):
            assert_agrees(widened(chance_of(wrong, MISSION, 0.05), error), chance)


def test_a_beat_as_long_as_the_mission_makes_missions_differ() -> None:
    """Two sines whose beat lasts ten missions: they agree in some missions and cancel in others.
    With one rate for all missions the probability is too high, and the judge notices."""
    mission = 600.0
    case = judge_of((1.5, 0.6), (1.5, 0.601), mission=mission)
    hit = case.hit(case.judge.extremes(2048, 6), 5.0)
    chance, error = float(hit.mean()), float(hit.std()) / math.sqrt(len(hit))
    found = first_crossings(case.scene(5.0), mission=mission, rel_error=0.03, seed=4)
    print(chance, found.probability(mission)[0])
    assert_agrees(widened(found.probability(mission)[0], error), chance)
    alike = replace(found, exposure=None).probability(mission)[0]
    with pytest.raises(AssertionError):
        assert_agrees(widened(alike, error), chance)


def test_hardly_any_sine_is_noise_alone_and_hardly_any_noise_is_the_sine() -> None:
    calm = chance_of(unit(), MISSION, 0.05)
    assert chance_of(unit(force(1e-9, 0.6)), MISSION, 0.05).value == pytest.approx(
        calm.value, abs=3.0 * calm.standard_error
    )
    quiet = 0.2 * 1e-4**2
    inside, outside = (
        chance_of(unit(force(1.0, 0.6), clearance=c, noise=quiet), MISSION, 0.2).value
        for c in (1.001, 0.999)
    )
    assert inside < 1e-12 and outside > 0.94


@pytest.mark.parametrize("turn", [-1.5, 0.0, 0.7, 6.0])
def test_slopes_of_crossings_have_their_distribution(turn: float) -> None:
    """By quadrature of p exp(-(p - r)^2 / 2)."""
    units = np.array([0.1, 0.6, 1.2, 2.0, 3.5])
    p = np.linspace(0.0, 20.0, 400_001)
    density = p * np.exp(-0.5 * (p - turn) ** 2)
    below = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    below /= below[-1]
    found = np.interp(slopes(units, np.full(5, turn)), p, below)
    np.testing.assert_allclose(found, -np.expm1(-0.5 * units**2), atol=2e-7)


def test_the_rate_of_crossings_of_a_mean_that_moves() -> None:
    """By quadrature over phase, and over the slope of the crossing (Rice)."""
    motion = MovingMean(0.7, 1.9, Sines(np.array([3.0]), np.array([[0.4 + 0.3j]])))
    theta = np.linspace(0.0, 2.0 * math.pi, 401)[:-1, None]
    p = np.linspace(0.0, 25.0, 5001)
    wave = 0.5 * np.exp(1j * theta)
    density = np.exp(-0.5 * ((1.8 - wave.real) / 0.7) ** 2) / (0.7 * math.sqrt(2.0 * math.pi))
    turning = (3.0j * wave).real
    slope = np.exp(-0.5 * ((p - turning) / 1.9) ** 2) / (1.9 * math.sqrt(2.0 * math.pi))
    rate = float(np.mean(density[:, 0] * np.trapezoid(p * slope, p, axis=1)))
    assert motion.rate(1.8) == pytest.approx(rate, rel=1e-6)
    assert motion.rate(motion.distance_of(rate)) == pytest.approx(rate, rel=1e-9)
    chance = MovingMean.still(0.7, 1.9).rate(1.8)
    assert chance < 0.8 * rate


SOFT = Elastic(stiffness=30.0)


def test_impacts_of_clusters_are_those_of_simulation() -> None:
    scene = unit(force(0.8, 0.6), clearance=4.4, law=SOFT)
    found = reliability(scene, mission=MISSION, rel_error=0.1, seed=1)
    whole = simulate(scene, rel_error=0.05, seed=2).impact_pairs["stops"].collision_rate
    assert found.hits is not None and whole is not None
    assert "clusters" in found.hits.how
    bias = (found.hits.bias or 0.0) + (whole.bias or 0.0) * MISSION
    together = replace(widened(found.hits, MISSION * whole.standard_error), bias=bias)
    assert_agrees(together, MISSION * whole.value)


@pytest.mark.verify
def test_fast_impacts_are_as_probable_as_in_windows_of_the_whole_motion() -> None:
    """By splitting of records with a crossing, in which the phases are a part of the state."""
    scene, mission = unit(force(0.8, 0.6), clearance=4.6, law=SOFT), 1000.0
    found = reliability(
        scene, mission=mission, impact_speed=0.8, rel_error=0.05, seed=1, budget=None
    ).chances["impact_speed"]
    windows = rare_hits.windows(
        scene, Limit("impact_speed", 0.8), mission, rel_error=0.05, seed=2, budget=None
    ).chance
    print(found.estimate, windows)
    assert found.way == "bursts"
    both = widened(found.estimate, windows.standard_error)
    assert_agrees(replace(both, bias=(both.bias or 0.0) + (windows.bias or 0.0)), windows.value)


def test_a_size_keeps_its_probability() -> None:
    case = judge_of((0.8, 0.6))
    found = size(case.scene(1.0), probability=0.2, mission=MISSION, rel_error=0.05, seed=1)
    hit = case.hit(case.judge.extremes(2048, 7), found.clearance.value)
    assert_agrees(Estimate(value=float(hit.mean()), standard_error=0.4 / math.sqrt(2048.0)), 0.2)
    smaller = case.hit(case.judge.extremes(2048, 7), 0.93 * found.clearance.value)
    assert smaller.mean() > 0.2 + 5.0 * 0.4 / math.sqrt(2048.0)


def test_a_box_is_sized_beside_a_sine() -> None:
    """Its page compares it with one oscillator along each axis, under the same sine."""
    scene = load_scene(shipped_scene("rigid-box"))
    sine = Sine(on="base", axis="z", frequency_hz=17.0, amplitude=0.5, unit="g")
    loud = scene.replace(excitations=[*scene.excitations, sine])
    asked = {"probability": 0.05, "mission": 600.0, "rel_error": 0.3, "threads": 1}
    quiet, found = size(scene, **asked), size(loud, **asked)
    for name, clearance in found.clearances.items():
        wider = clearance.value - quiet.clearances[name].value
        assert (wider > 1e-4) == name.startswith("corner")  # the sine is vertical


def test_a_screening_holds_the_sines() -> None:
    """Against long motion of the judge; the sine alone brings a mean square of a^2 / 2."""
    case = judge_of((0.8, 0.6))
    gap = screen(case.scene(3.0)).impact_pairs["stops"]
    assert gap.displacement_std == pytest.approx(math.sqrt(1.0 + 0.32), rel=1e-9)
    assert gap.velocity_std == pytest.approx(math.sqrt(1.0 + 0.32 * 0.36), rel=1e-9)
    assert gap.sines == screen(case.scene(3.0)).only.sines
    ((hertz, amplitude),) = gap.sines
    assert (hertz * 2.0 * math.pi, amplitude) == pytest.approx((0.6, 0.8))
    rates = impacts(case.scene(3.0), rel_error=0.2, seed=1).pairs["stops"].rice_rates
    assert rates is not None and rates["both"] == pytest.approx(gap.rice_rate)
    assert gap.rate_at(3.0) == pytest.approx(gap.rice_rate)


def test_phases_of_a_mission_may_have_sines() -> None:
    """The probability of no impact is the product of those of the phases."""
    sines = {"excitations": [NOISE, force(0.8, 0.6)]}
    scene = unit(clearance=4.2).replace(
        phases=[Phase(name="calm", duration=MISSION), Phase(name="engine", duration=50.0, **sines)]
    )
    found = reliability(scene, rel_error=0.05, seed=3).chances["hit"].estimate
    calm = chance_of(unit(clearance=4.2), MISSION, 0.03)
    engine = chance_of(unit(force(0.8, 0.6), clearance=4.2), 50.0, 0.03)
    joint = 1.0 - (1.0 - calm.value) * (1.0 - engine.value)
    error = math.hypot(calm.standard_error, engine.standard_error)
    assert_agrees(widened(found, error), joint)


def test_what_does_not_take_sines_says_so() -> None:
    scene = unit(force(0.8, 0.6), law=SOFT)
    with pytest.raises(NotApplicable, match="got sine"):
        bumper_map(scene)
    with pytest.raises(NotApplicable, match="gaps of units are compared as Gaussian"):
        size(scene, probability=0.01, spreads={"frequency": Spread(std=0.03)}, rel_error=0.3)
    alone = unit(force(0.8, 0.6)).replace(excitations=[force(0.8, 0.6)])
    with pytest.raises(NotApplicable, match="must contain noise, got a sine alone"):
        first_crossings(alone, [3.0])
    coordinates = {"mass": [[1, 0], [0, 1]], "damping": [[0.1, 0], [0, 0.1]]}
    apart = Scene(
        structure=Matrices(coordinates=("x", "z"), stiffness=[[1, 0], [0, 1]], **coordinates),
        impact_pairs=[ImpactPair(name="z", on="z", lower=-1.0, upper=1.0, law=LOSS)],
        excitations=[WhiteNoise(intensity=0.2, on="x"), Sine(amplitude=1, frequency_hz=1, on="z")],
    )
    with pytest.raises(NotApplicable, match="noise must move the gap of z, got sines alone"):
        PairMotion(model_of(apart))
