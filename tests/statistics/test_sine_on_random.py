"""Sines beside noise: the chance of any impact, and what follows from it, against missions of a
judge that shares no code with the package.

The judge makes the response without stops in the frequency domain, from receptances of its own,
adds the exact response to sines of random phases, and counts the missions in which a gap is at a
stop.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

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
    Sine,
    TabulatedNoise,
    WhiteNoise,
    impacts,
    load_scene,
    reliability,
    screen,
    simulate,
    size,
)
from stochvi.isolators import Spread, bumper_map
from stochvi.mathematics.moving_means import MovingMean, Sines, slopes
from stochvi.model.model import model_of
from stochvi.scenes import Phase, shipped_scene
from stochvi.statistics import structure_hits
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.statistics.structure_hits import Limit
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases

Array = NDArray[np.float64]

PER_PERIOD = 100.0
"""Samples in a period of the fastest mode or sine: the largest of them is then below a peak by
(pi / 100)^2 / 6 = 1.6e-4 of it on average."""

ROOM = 1.3
"""Length of a record over that of a mission: the rest is longer than the memory of the motion."""

AT_ONCE = 64
"""Missions that the judge makes together."""

LAW = Restitution(coefficient=0.6)


@dataclass(frozen=True)
class Judge:
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
    judge: Judge
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
    bare = Judge(
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
        stops = ImpactPair(lower=-clearance, upper=upper if both else None, law=LAW)
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
    bare = Judge(mass=mass, damping=damping, stiffness=stiffness, noises=noises, sines=(),
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
                ImpactPair(name="x", on="x", lower=-near, upper=near, law=LAW),
                ImpactPair(name="both", between=("x", "z"), lower=-between, upper=between, law=LAW),
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


def unit(*sines: Sine, clearance: float = 4.0, noise: float = 0.2, law: Any = LAW) -> Scene:
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
    judge = Judge(one, 0.1 * one, one, ((flat(0.4), np.ones(1)),), own, one, mission)
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
    windows = structure_hits.windows(
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
        impact_pairs=[ImpactPair(name="z", on="z", lower=-1.0, upper=1.0, law=LAW)],
        excitations=[WhiteNoise(intensity=0.2, on="x"), Sine(amplitude=1, frequency_hz=1, on="z")],
    )
    with pytest.raises(NotApplicable, match="noise must move the gap of z, got sines alone"):
        PairMotion(model_of(apart))
