"""The bumper map against plain simulation of the whole motion, and its region within limits."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import StringIO

import matplotlib.pyplot as plt
import numba
import numpy as np
import pytest
from rich.console import Console

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    history,
    reliability,
    simulate,
)
from stochvi.isolators import BumperMap, bumper_map
from stochvi.isolators.bumpers.answer import QUANTITIES
from stochvi.isolators.bumpers.method import stiffness_of
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.changes import changed_stops
from stochvi.isolators.sizing.clatter import WindowSampler, plan_windows
from stochvi.results.deadline import NEVER
from stochvi.results.intervals import binomial_interval
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.statistics.damage import SpectrumValues
from stochvi.views.bumper_map import draw_bumper_map, print_bumper_map

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
MOUNT = Isolator(frequency_hz=12.0, zeta=0.1, mass=2.5)


def between(law: object = None, mount: Isolator = MOUNT) -> Scene:
    law = law or Viscoelastic(stiffness=5e5, damping_ratio=0.2)
    pair = ImpactPair(lower=-4e-3, upper=4e-3, law=law)
    return Scene(structure=mount, impact_pairs=[pair], excitations=[TRUCK])


def largest_of(scene: Scene, window: float, number: int) -> np.ndarray:
    """Largest absolute accelerations of windows of the whole motion, by the kernels of one mass."""
    sampler = WindowSampler((plan_windows(scene, window),), 7)
    block = sampler.block
    found = [sampler.sample(first, block, NEVER)[0].largest for first in range(0, number, block)]
    return np.concatenate(found)


def chances_around(largest: np.ndarray, level: float, reach: float) -> tuple[float, float]:
    """Limits, at 4.5 standard errors, of the probability to exceed a level that errs by `reach`."""
    confidence = math.erf(4.5 / math.sqrt(2.0))
    above, below = (int(np.sum(largest > level + side * reach)) for side in (1.0, -1.0))
    low = binomial_interval(above, len(largest), confidence)[0]
    return low, binomial_interval(below, len(largest), confidence)[1]


WINDOW, CHANCE = 40.0, 0.2
PLACES, FACTORS = (3e-3, 4.5e-3, 6e-3, 6.8e-3, 7.5e-3), (0.1, 1.0)


@pytest.mark.parametrize(
    ("places", "factors", "number"),
    [(PLACES[1:4:2], FACTORS[:1], 256),
     pytest.param(PLACES, FACTORS, 2048, marks=pytest.mark.verify)],
)  # fmt: skip
def test_peaks_are_exceeded_as_often_as_by_plain_simulation(
    places: tuple[float, ...], factors: tuple[float, ...], number: int
) -> None:
    """Ten points, by records and by clusters."""
    scene, fine = between(), number > 1000
    found = bumper_map(
        scene, mission=WINDOW, exceedance=CHANCE, clearances=places, stiffness_factors=factors,
        rel_error=0.04 if fine else 0.1, budget=600.0,
    )  # fmt: skip
    peak = found.peak_acceleration
    for row, place in enumerate(places):
        for column, factor in enumerate(factors):
            stopped = at_clearances(changed_stops(scene, stiffness=factor), place)
            largest = largest_of(stopped, WINDOW, number)
            level = peak.value[row, column]
            reach = 4.5 * peak.standard_error[row, column] + peak.bias[row, column]
            low, high = chances_around(largest, level, reach)
            assert low < CHANCE < high, (place, factor)
            # a level that is off by half is told apart
            low, high = chances_around(largest, 1.5 * level, reach if fine else 0.0)
            assert not low < CHANCE < high, (place, factor)


@numba.njit  # type: ignore[untyped-decorator]
def own_extremes(
    base: np.ndarray, sample: float, fine: int, burn_in: int, mass: float, spring: float,
    damper: float, place: float, stiff: float, loss: float,
) -> np.ndarray:  # fmt: skip
    """Largest absolute acceleration, force on a stop and travel in windows of a mass between two
    stops, by the midpoint rule; the acceleration of the base is straight between its samples."""
    found = np.zeros((3, base.shape[0]))
    whole = sample / fine
    for n in range(base.shape[0]):
        x = v = 0.0
        for k in range(base.shape[1] - 1):
            for j in range(fine):
                push = (base[n, k] * (fine - j - 0.5) + base[n, k + 1] * (j + 0.5)) / fine
                here, rate = x, v
                for half in range(2):
                    side = 1.0 if here > 0.0 else -1.0
                    deep, contact = abs(here) - place, 0.0
                    if deep > 0.0:
                        contact = max(stiff * deep + loss * side * rate, 0.0)
                    pull = (spring * here + damper * rate + side * contact) / mass
                    step = 0.5 * whole if half == 0 else whole
                    if half == 0:
                        here, rate = x + step * v, v + step * (-push - pull)
                    else:
                        x, v = x + step * rate, v + step * (-push - pull)
                if k >= burn_in:
                    found[0, n] = max(found[0, n], abs(pull))
                    found[1, n] = max(found[1, n], contact)
                    found[2, n] = max(found[2, n], abs(x))
    return found


def own_levels(
    windows: int, place: float, stiff: float, fine: int
) -> dict[str, tuple[float, float]]:
    """Levels that 10 % of the windows of 60 s exceed, with their standard errors: 10 kg at 12 Hz on
    a base with 0.0204 g^2/Hz from 5 to 80 Hz, between linear stops of damping ratio 0.1."""
    sample, burn_in, mass, omega = 1e-3, 4.0, 10.0, 2.0 * math.pi * 12.0
    length = burn_in + 60.0
    count = round(length / sample)
    frequency = np.fft.rfftfreq(count, sample)
    density = np.where((frequency >= 5.0) & (frequency <= 80.0), 0.0204 * 9.80665**2, 0.0)
    random = np.random.default_rng(3)
    normal = random.standard_normal((2, windows, len(frequency)))
    base = np.fft.irfft((normal[0] + 1j * normal[1]) * count * np.sqrt(density / length / 4.0))
    found = own_extremes(
        base, sample, fine, round(burn_in / sample), mass, mass * omega**2, 0.2 * omega * mass,
        place, stiff, 0.2 * math.sqrt(stiff * mass),
    )  # fmt: skip
    reach = 0.3 / math.sqrt(windows)
    values = np.quantile(found, [0.9 - reach, 0.9, 0.9 + reach], axis=1)
    names = "peak_acceleration", "pad_force", "rattle_space"
    return {
        name: (float(values[1, k]), float(values[2, k] - values[0, k]) / 2.0)
        for k, name in enumerate(names)
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "factors", "windows", "rel_error"),
    [((4e-3,), (1.0,), 300, 0.012),
     pytest.param((4e-3, 6.5e-3), (0.1, 1.0, 10.0), 600, 0.02, marks=pytest.mark.verify)],
)  # fmt: skip
def test_contacts_are_those_of_mount_base_and_stop_together(
    places: tuple[float, ...], factors: tuple[float, ...], windows: int, rel_error: float
) -> None:
    """Stops of 2e5 N/m beside a mount of 5.7e4 N/m: a base at rest during a contact, and the mount
    alone before it, would give 7 to 9 % less."""
    noise = TabulatedNoise(frequency_hz=[5.0, 80.0], density=[0.0204, 0.0204], unit="g2/Hz")
    law = Viscoelastic(stiffness=2e5, damping_ratio=0.1)
    pair = ImpactPair(lower=-4e-3, upper=4e-3, law=law)
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=10.0)
    scene = Scene(structure=mount, impact_pairs=[pair], excitations=[noise])
    found = bumper_map(
        scene, mission=60.0, exceedance=0.1, clearances=places, stiffness_factors=factors,
        rel_error=rel_error, budget=600.0,
    )  # fmt: skip
    for row, place in enumerate(places):
        for column, factor in enumerate(factors):
            own = own_levels(windows, place, 2e5 * factor, 10 if factor > 1.0 else 4)
            for name, (level, error) in own.items():
                values = getattr(found, name)
                value, own_error, bias = (
                    float(each[row, column])
                    for each in (values.value, values.standard_error, values.bias)
                )
                both = 4.5 * math.hypot(own_error, error) + bias
                assert abs(value - level) < both, (name, place, factor)
                if name == "peak_acceleration" and factor == 1.0 and place == 4e-3:
                    assert not abs(0.92 * value - level) < both  # by the contact alone
    # what `reliability` says of the level of the map
    stiff = at_clearances(scene, places[0])
    peak = found.peak_acceleration
    at = 0, factors.index(1.0)
    reach = 4.5 * peak.standard_error[at] + peak.bias[at]
    asked = [peak.value[at] + side * reach for side in (1.0, -1.0)]
    low, high = (
        reliability(stiff, mission=60.0, peak_acceleration=level, rel_error=0.3, budget=300.0)
        .chances["peak_acceleration"]
        .estimate
        for level in asked
    )
    assert low.value - low.reach(4.5) < 0.1 < high.value + high.reach(4.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "paths"),
    [((4.5e-3,), 120), pytest.param((4.5e-3, 7.5e-3), 1000, marks=pytest.mark.verify)],
)
def test_forces_travels_and_speeds_are_exceeded_as_often_as_by_plain_paths(
    places: tuple[float, ...], paths: int
) -> None:
    """Of elastic stops the force is the stiffness times the deflection, which paths show."""
    stiffness = 4e5
    scene = between(Elastic(stiffness=stiffness))
    found = bumper_map(
        scene, mission=WINDOW, exceedance=CHANCE, clearances=places, stiffness_factors=[1.0],
        rel_error=0.1, budget=600.0,
    )  # fmt: skip
    assert tuple(found.ways) == ("records", "clusters")[: len(places)]
    for row, place in enumerate(places):
        stopped = at_clearances(scene, place)
        seen = [
            history(stopped, duration=WINDOW, rate=1000.0, seed=5, path=n) for n in range(paths)
        ]
        travel = np.array([each.samples["displacement_m"].abs().max() for each in seen])
        speed = np.array([each.impacts["speed_m_s"].abs().max() for each in seen])
        largest = {
            "rattle_space": travel - place,
            "pad_force": stiffness * (travel - place),
            "impact_speed": np.nan_to_num(speed),
        }
        for name, values in largest.items():
            level, error, bias = (
                getattr(getattr(found, name), part)[row, 0]
                for part in ("value", "standard_error", "bias")
            )
            level -= place if name == "rattle_space" else 0.0
            low, high = chances_around(values, level, 4.5 * error + bias)
            assert low < CHANCE < high, (name, place)
            # a level that is off by half is told apart
            low, high = chances_around(values, 1.5 * level, 0.0)
            assert not low < CHANCE < high, (name, place)


def test_energies_and_rates_are_those_of_a_simulation() -> None:
    scene = between(Elastic(stiffness=4e5))
    found = bumper_map(scene, clearances=[3.5e-3, 8.1e-3], stiffness_factors=[1.0], rel_error=0.1)
    assert list(found.ways) == ["records", "clusters"]
    pair = simulate(at_clearances(scene, 3.5e-3), rel_error=0.02).impact_pairs["stops"]
    rate, square = (float(pair[name]) for name in ("collision_rate", "impact_speed_square_rate"))
    hourly, energy = found.impacts_per_hour.estimates()[0], found.energy_per_hit.estimates()[0]
    error = pair["collision_rate"].standard_error * 3600.0
    assert abs(hourly.value - 3600.0 * rate) < 4.5 * math.hypot(hourly.standard_error, error)
    own = 0.5 * 2.5 * square / rate
    assert abs(energy.value - own) < 4.5 * math.hypot(energy.standard_error, 0.03 * own)
    assert not abs(energy.value - 0.5 * own) < 4.5 * math.hypot(energy.standard_error, 0.03 * own)
    # first impacts of far clusters have the mean energy of a Rayleigh distribution, others less
    most = 2.5 * 0.5 * 2.0 * (2.0 * math.pi * 12.0 * found.sigma) ** 2
    assert 0.5 * most < found.energy_per_hit.value[1, 0] < 1.2 * most


def test_without_hits_at_the_chance_the_mount_alone_counts() -> None:
    found = bumper_map(
        between(), clearances=[0.02, 0.03], stiffness_factors=[0.5, 2.0], rel_error=0.3
    )
    assert not found.impact_speed.value.any() and not found.pad_force.value.any()
    omega = 2.0 * math.pi * 12.0
    ratio = found.peak_acceleration.value / found.rattle_space.value
    # spring and damper, whose forces are not correlated: the rms speed is about omega sigma
    assert np.allclose(ratio, omega**2 * math.hypot(1.0, 0.2), rtol=0.005)
    assert 5.4 * found.sigma < found.rattle_space.value[0, 0] < 5.8 * found.sigma


def made(peak: list[list[float]], rattle: list[list[float]], **limits: float) -> BumperMap:
    """A map made by hand."""

    def of(values: list[list[float]]) -> SpectrumValues:
        value = np.array(values)
        return SpectrumValues(value=value, standard_error=0.1 * value, bias=0.0 * value)

    ones = [[1.0, 1.0], [1.0, 1.0]]
    return BumperMap(
        clearance=np.array([1e-3, 2e-3]), stiffness_factor=np.array([1.0, 2.0]), stiffness=None,
        mission=60.0, exceedance=0.01, sigma=1e-3, peak_acceleration=of(peak), pad_force=of(ones),
        rattle_space=of(rattle), impact_speed=of(ones), energy_per_hit=of(ones),
        impacts_per_hour=of(ones), limits=limits, ways=["records", "clusters"],
    )  # fmt: skip


def test_the_best_point_has_the_least_rattle_space_within_the_limits() -> None:
    peak, rattle = [[30.0, 90.0], [20.0, 50.0]], [[3e-3, 1.5e-3], [4e-3, 2.5e-3]]
    found = made(peak, rattle, peak_acceleration=60.0)
    assert found.feasible.tolist() == [[True, False], [True, True]]
    assert found.best is not None and found.best[:2] == (2e-3, 2.0)
    assert "3 of 4 designs keep all limits" in found.summary()
    assert made(peak, rattle, peak_acceleration=60.0, rattle_space=2e-3).best is None
    assert made(peak, rattle).best is None
    frame = found.to_frame()
    assert len(frame) == 4 and frame["feasible"].sum() == 3
    assert frame["peak_acceleration"].tolist() == [30.0, 90.0, 20.0, 50.0]
    assert found.relative_error == pytest.approx(0.1)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["best"]["clearance"] == 2e-3


def test_a_limit_is_kept_where_that_is_shown_alone() -> None:
    """Peaks have a standard error of a tenth: 56 may exceed 60, and 64 keep it."""
    found = made([[40.0, 56.0], [64.0, 90.0]], [[3e-3, 1e-3], [1e-3, 1e-3]], peak_acceleration=60.0)
    assert found.feasible.tolist() == [[True, False], [False, False]]
    assert found.exceeded.tolist() == [[False, False], [False, True]]
    assert found.best is not None and found.best[:2] == (1e-3, 1.0)
    assert "1 of 4 designs keep all limits" in found.summary()
    assert "(2 not known well enough)" in found.summary()
    console = Console(file=StringIO(), width=200)
    print_bumper_map(console, found)
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert [shown.count(word) for word in (" kept", "not shown", " exceeded\n")] == [1, 2, 1]
    assert found.to_frame()["exceeded"].sum() == 1
    # the control: without errors every point is known
    sure = replace(found.peak_acceleration, standard_error=np.zeros((2, 2)))
    known = replace(found, peak_acceleration=sure)
    assert np.array_equal(known.feasible, ~known.exceeded) and known.feasible.sum() == 2
    # a peak that is not known keeps nothing, and exceeds nothing
    lost = replace(found.peak_acceleration, value=np.full((2, 2), np.nan))
    lost_map = replace(found, peak_acceleration=lost)
    assert not lost_map.feasible.any() and not lost_map.exceeded.any()
    plt.close(draw_bumper_map(found).get_figure())


def test_what_makes_no_map_is_refused() -> None:
    with pytest.raises(NotApplicable, match="needs the stiffness of the stops"):
        bumper_map(between(Restitution(coefficient=0.5)))
    with pytest.raises(ValueError, match="limits must be of peak_acceleration"):
        bumper_map(between(), limits={"stress": 1.0})
    with pytest.raises(ValueError, match="clearances must be positive rising numbers"):
        bumper_map(between(), clearances=[2e-3, 1e-3])
    with pytest.raises(ValueError, match=r"exceedance must be in \(0, 1\), got 1"):
        bumper_map(between(), exceedance=1.0)
    assert stiffness_of(between()) == 5e5


def test_the_table_has_limits_and_forces_only_where_there_are_any() -> None:
    peak, rattle = [[30.0, 90.0], [20.0, 50.0]], [[3e-3, 1.5e-3], [4e-3, 2.5e-3]]

    def printed(found: BumperMap) -> str:
        console = Console(file=StringIO(), width=200)
        print_bumper_map(console, found)
        return console.file.getvalue()  # type: ignore[attr-defined]

    found = made(peak, rattle)
    none = np.array([[1.0, 1.0], [0.0, 0.0]])
    calm = replace(
        found,
        impact_speed=replace(found.impact_speed, value=none),
        pad_force=replace(found.pad_force, value=none),
    )
    assert "limits " not in printed(found).splitlines()[2] and "no contact" not in printed(found)
    assert printed(calm).count("no contact") == 2 and "8.154845" not in printed(calm)
    limited = printed(made(peak, rattle, peak_acceleration=60.0))
    assert "kept" in limited and "exceeded" in limited and "travel per side" in limited
    many = replace(
        found, stiffness_factor=np.arange(1.0, 6.0),
        **{name: of_ones() for name in QUANTITIES},
    )  # fmt: skip
    assert "2 more points in the file of the map" in printed(many)


def of_ones() -> SpectrumValues:
    ones = np.ones((2, 5))
    return SpectrumValues(value=ones, standard_error=0.1 * ones, bias=0.0 * ones)


def test_a_structure_is_sent_to_size() -> None:
    with pytest.raises(NotApplicable, match="got 3; a map is of one linear mass"):
        bumper_map(load_scene(shipped_scene("rigid-box")))
