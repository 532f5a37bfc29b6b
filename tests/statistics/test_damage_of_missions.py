"""Damage of a mission of phases, and the random test that does the same damage."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import gumbel_r

from stochvi import ImpactPair, Isolator, Scene, TabulatedNoise, damage, load_scene
from stochvi.model.model import model_of
from stochvi.results.estimates import format_with_error
from stochvi.scenes.impact_laws import Elastic
from stochvi.statistics.damage.answer import EquipmentSpectra, SpectrumValues
from stochvi.statistics.damage.phases import joint_spectra
from stochvi.statistics.damage.tailoring import envelope
from support import judges
from support.commands import Run

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
FREE = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0), excitations=[TRUCK])
BUMPERS = FREE.replace(impact_pairs=[ImpactPair(clearance=6e-3, law=Elastic(stiffness=2e5))])
EQUIPMENT = [20.0, 60.0, 200.0]


def halves(scene: Scene, *changes: dict[str, float]) -> Scene:
    """A mission of two phases of half an hour."""
    changes = changes or ({}, {})
    return scene.replace(
        phase=[
            {"name": name, "duration": 1800.0, **change}
            for name, change in zip(("a", "b"), changes, strict=True)
        ]
    )


def test_two_halves_are_one_mission() -> None:
    whole = damage(FREE, mission=3600.0, equipment=EQUIPMENT).with_stops
    found = damage(halves(FREE), equipment=EQUIPMENT)
    assert found.mission == 3600.0
    for name in ("response_rms", "cumulative_rms", "fatigue_damage"):
        one, two = (getattr(each, name).value for each in (whole, found.with_stops))
        assert two == pytest.approx(one, rel=1e-12)
    largest, bias = found.with_stops.extreme_response.value, whole.extreme_response.bias
    assert np.all(np.abs(largest - whole.extreme_response.value) < bias)
    # the largest of one half alone is smaller by more
    half = damage(FREE, mission=1800.0, equipment=EQUIPMENT).with_stops.extreme_response.value
    assert np.all(largest - half > 1.5 * bias)


def test_the_loud_half_does_nearly_all() -> None:
    loud = damage(FREE.at_level(6.0), mission=1800.0, equipment=EQUIPMENT)
    quiet = damage(FREE, mission=1800.0, equipment=EQUIPMENT)
    both = damage(halves(FREE, {}, {"level_db": 6.0}), equipment=EQUIPMENT).with_stops
    one, two = (each.with_stops for each in (quiet, loud))
    assert both.fatigue_damage.value == pytest.approx(
        one.fatigue_damage.value + two.fatigue_damage.value, rel=1e-12
    )
    mean = 0.5 * (one.response_rms.value**2 + two.response_rms.value**2)
    assert both.response_rms.value**2 == pytest.approx(mean, rel=1e-12)
    assert both.extreme_response.value == pytest.approx(two.extreme_response.value, rel=1e-3)


def test_the_largest_of_phases_is_that_of_drawn_ones() -> None:
    """A million missions whose phases have Gumbel's distribution."""
    modes, widths = np.array([[10.0], [11.0], [9.0]]), np.array([[1.0], [0.5], [1.5]])
    nothing = SpectrumValues(value=np.ones(1), standard_error=np.zeros(1), bias=np.zeros(1))

    def phase(mode: np.ndarray, width: np.ndarray) -> EquipmentSpectra:
        law = gumbel_r(mode, width)
        error = SpectrumValues(value=law.mean(), standard_error=np.ones(1), bias=np.full(1, 0.1))
        return EquipmentSpectra(
            response_rms=nothing, extreme_response=error, extreme_lower=law.ppf(0.025),
            extreme_upper=law.ppf(0.975), fatigue_damage=nothing, cumulative_rms=nothing,
        )  # fmt: skip

    phases = [phase(*each) for each in zip(modes, widths, strict=True)]
    found = joint_spectra(phases, np.ones(3))
    random = np.random.default_rng(1)
    drawn = gumbel_r.rvs(modes, widths, size=(3, 1_000_000), random_state=random)
    largest, first = drawn.max(axis=0), drawn.argmax(axis=0)
    error = 4.5 * largest.std() / 1e3
    assert found.extreme_response.value[0] == pytest.approx(largest.mean(), abs=error)
    assert drawn.mean(axis=1).max() < largest.mean() - 10.0 * error
    for end, share in ((found.extreme_lower, 0.025), (found.extreme_upper, 0.975)):
        assert np.mean(largest < end[0]) == pytest.approx(share, abs=4.5 * math.sqrt(share / 1e6))
    # an error of a phase counts as often as its response is the largest
    shares = np.bincount(first, minlength=3) / 1e6
    assert found.extreme_response.standard_error[0] == pytest.approx(
        np.linalg.norm(shares), abs=5e-3
    )
    assert found.extreme_response.bias[0] == pytest.approx(0.1, abs=1e-4)


@pytest.mark.slow
def test_impacts_of_a_mission_are_those_of_its_phases() -> None:
    mission = halves(BUMPERS, {}, {"level_db": -3.0})
    found = damage(
        mission, equipment=[60.0], levels=[50.0], rel_error=0.3, seed=1, test_duration=900.0
    )
    # the largest responses of its test are told with the error of the mission's
    extremes, test = found.with_stops.extreme_response, found.test
    assert test is not None and float(extremes.standard_error[0]) > 0.0
    shown = format_with_error(
        float(test.extreme_ratio[0]),
        float(test.extreme_ratio[0] * extremes.standard_error[0] / extremes.value[0]),
    )
    assert f"their largest responses are {shown} to" in test.summary()
    parts = [
        damage(phase.of(mission), mission=1800.0, equipment=[60.0], levels=[50.0], rel_error=0.3,
               seed=5 + number)
        for number, phase in enumerate(mission.phases)
    ]  # fmt: skip
    assert found.impacts_per_hour is not None
    rates = [each.impacts_per_hour for each in parts]
    expected = 0.5 * sum(each.value for each in rates if each is not None)
    error = math.hypot(
        found.impacts_per_hour.standard_error,
        *(0.5 * each.standard_error for each in rates if each is not None),
    )
    assert abs(found.impacts_per_hour.value - expected) < 4.5 * error
    assert expected > 10.0 * error
    assert found.shocks is not None and found.damage_ratio is not None
    assert judges.columns_without_judge(found) == []


def test_what_a_mission_may_not_be_asked() -> None:
    with pytest.raises(ValueError, match="mission must be left out where the scene has phases"):
        damage(halves(FREE), mission=60.0)
    with pytest.raises(ValueError, match="mission must be a positive number of seconds, got None"):
        damage(FREE)
    for wrong in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match="test_duration must be a positive number"):
            damage(FREE, mission=60.0, test_duration=wrong)
    for wrong in (1, 101):
        with pytest.raises(ValueError, match=r"breakpoints must be in \[2, 100\]"):
            damage(FREE, mission=60.0, test_duration=60.0, breakpoints=wrong)


# The test of equal damage --------------------------------------------------------------------


@pytest.mark.parametrize("breakpoints", [2, 4, 12, 100])
def test_the_profile_does_the_damage_of_the_mission(breakpoints: int) -> None:
    found = damage(
        FREE, mission=14400.0, equipment=(5.0, 500.0), test_duration=3600.0,
        breakpoints=breakpoints,
    )  # fmt: skip
    test = found.test
    assert test is not None and 2 <= len(test.density) <= breakpoints
    assert test.exaggeration == pytest.approx(4.0 ** (1.0 / 6.0))
    # a quarter of the time asks for that factor in rms
    shorter = test.equal_density.value / found.equivalent_density.value
    assert np.sqrt(shorter) == pytest.approx(test.exaggeration, rel=2e-3)
    # judged as any other noise of a base: a stiff mount moves with it
    noise = TabulatedNoise(frequency_hz=test.frequency_hz, density=test.density, unit="m2/s3")
    stiff = Scene(structure=Isolator(frequency_hz=2e4, zeta=0.7), excitations=[noise])
    own = damage(stiff, mission=3600.0, equipment=found.equipment_frequency_hz)
    ratio = own.with_stops.fatigue_damage.value / found.with_stops.fatigue_damage.value
    assert ratio == pytest.approx(test.damage_ratio, rel=5e-3)
    extremes = own.with_stops.extreme_response.value / found.with_stops.extreme_response.value
    assert extremes == pytest.approx(test.extreme_ratio, rel=5e-3)
    assert np.all(ratio > 0.995)
    if breakpoints == 100:
        # as many as there are: nothing is added, but where lower frequencies alone do more
        assert np.all(ratio[found.equipment_frequency_hz < 50.0] < 1.005)


def test_an_envelope_lies_on_a_density_that_is_straight() -> None:
    f = np.geomspace(10.0, 1000.0, 50)
    law = np.interp(np.log(f), np.log([10.0, 50.0, 400.0, 1000.0]), np.log([0.1, 1.0, 1.0, 0.05]))
    straight = np.exp(law)
    table = envelope(f, straight, 8)
    assert table(f) == pytest.approx(straight, rel=0.02)
    assert np.all(table(f) > straight * (1.0 - 1e-6))
    # two points alone lie far above it
    assert np.all(envelope(f, straight, 2)(f) > straight * (1.0 - 1e-6))
    assert np.max(envelope(f, straight, 2)(f) / straight) > 3.0


def test_an_envelope_is_nowhere_below_and_more_breakpoints_bring_it_closer() -> None:
    random = np.random.default_rng(3)
    f = np.geomspace(5.0, 2000.0, 60)
    for _ in range(5):
        density = np.exp(np.cumsum(random.normal(size=60)))
        squares = []
        for number in (3, 6, 12, 60):
            table = envelope(f, density, number)
            assert len(table.density) <= number
            assert np.all(table(f) >= density * (1.0 - 1e-6))
            squares.append(table.moment(0.0))
        assert squares == sorted(squares, reverse=True)


def test_the_command_writes_a_profile_that_a_scene_reads(stochvi: Run, tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(
        """
        [structure]
        kind = "isolator"
        frequency_hz = 12.0
        zeta = 0.1

        [[excitation]]
        kind = "psd"
        profile = "mil-std-810h-truck-vertical-5hz"

        [[phase]]
        name = "road"
        duration = "3h"

        [[phase]]
        name = "track"
        duration = "10min"
        level_db = 6
        """
    )
    done = stochvi(
        "damage", tmp_path / "mission.toml", "--equipment", "20:500", "--test-duration", "1h",
        "--breakpoints", "6", "--out", tmp_path / "out", "--json", tmp_path / "found.json",
    )  # fmt: skip
    assert done.code == 0
    assert "random test of 1 h with the damage of 3.167 h" in done.out
    test = json.loads((tmp_path / "found.json").read_text())["test"]
    (tmp_path / "table.toml").write_text(
        """
        [structure]
        kind = "isolator"
        frequency_hz = 12.0
        zeta = 0.1

        [[excitation]]
        kind = "psd"
        file = "out/profile.csv"
        """
    )
    (noise,) = model_of(load_scene(tmp_path / "table.toml")).tables
    assert noise[0].density == pytest.approx(test["density"], rel=1e-6)
