"""What the review of a sizing calculates, against other ways to the same numbers."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    Restitution,
    RoadNoise,
    Scene,
    WhiteNoise,
    exact,
    screen,
)
from stochvi.isolators.contact import contact_on_mount
from stochvi.isolators.environment import frequencies, input_density, transmissibility
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.chance_at_stops import probability_at, probability_of_stops
from stochvi.isolators.sizing.motion import PathSettings, motion_between_stops
from stochvi.isolators.sizing.review import ReviewSettings, review
from stochvi.isolators.sizing.sensitivity import variations
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotConverged
from stochvi.scenes.impact_laws import ForceTable, Law, Viscoelastic
from support.sized import MOUNT, TRUCK, scene_between_stops, sizing_of


@pytest.fixture(scope="module")
def sizing() -> Sizing:
    return sizing_of(scene_between_stops())


# Sensitivity ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "noise", [TRUCK, RoadNoise(road="C", speed=20.0), WhiteNoise(intensity=1.0)]
)
def test_a_changed_level_and_the_tolerances_reach_every_variation(noise) -> None:
    sizing = sizing_of(scene_between_stops(law=None, noise=noise))
    tried = dict(variations(sizing))
    louder = screen(tried["level +3 dB"]).displacement_std
    assert louder == pytest.approx(10.0**0.15 * sizing.sigma, rel=1e-12)
    strict = replace(sizing, scene=scene_between_stops(structure=MOUNT.model_copy(
        update={"frequency_tolerance": 0.05, "damping_tolerance": 0.2}
    )))  # fmt: skip
    assert {"natural frequency -5 %", "damping ratio +20 %"} <= set(dict(variations(strict)))


# Spectra ----------------------------------------------------------------------------------


def test_the_transmissibility_gives_the_rms_of_the_screening() -> None:
    """The area under its square times the input, on the grid of the pictures."""
    scene = scene_between_stops(law=None)
    model = model_of(scene)
    f = frequencies(model)
    density = transmissibility(model, f) ** 2 * input_density(model, f)
    rms = math.sqrt(np.trapezoid(density, f))
    assert rms == pytest.approx(screen(scene).acceleration_std, rel=1e-3)
    assert transmissibility(model, np.array([12.0]))[0] == pytest.approx(
        math.sqrt(1.0 + 1.0 / 25.0) * 5.0
    )


# One contact ------------------------------------------------------------------------------


def without_damping(law: Law) -> Model:
    mount = Isolator(mass=2.0, frequency_hz=12.0, zeta=0.0)
    return model_of(scene_between_stops(law, structure=mount))


def test_a_contact_on_the_mount_conserves_energy() -> None:
    """v^2 / 2 = U(y) + omega^2 (d y + y^2 / 2) at the deepest point, per unit mass."""
    law = ForceTable(deflection=[1e-3, 3e-3], force=[50.0, 600.0])
    model = without_damping(law)
    assert model.upper is not None
    for speed, distance in ((0.05, 4e-3), (0.4, 1e-3)):
        hit = contact_on_mount(model, model.upper.law, distance, speed)
        y = hit.deflection
        stored = float(model.upper.law.potential_at(y)) + model.omega**2 * (distance + y / 2) * y
        assert stored == pytest.approx(0.5 * speed**2, rel=1e-3)
        force = float(model.upper.law.force_at(y)) + model.omega**2 * (distance + y)
        assert hit.peak_acceleration == pytest.approx(force, rel=1e-3)


def test_a_stiff_stop_does_not_feel_the_mount() -> None:
    """Then the contact is that of a free mass, whose closed form is known (B App. I)."""
    law = Viscoelastic(stiffness=2e8, damping_ratio=0.2)
    model = without_damping(law)
    free = law.impact(0.3, 2.0)
    assert model.upper is not None
    hit = contact_on_mount(model, model.upper.law, 1e-6, 0.3)
    assert hit.peak_acceleration == pytest.approx(free.peak_force / 2.0, rel=2e-3)
    assert hit.deflection == pytest.approx(free.peak_deflection, rel=2e-3)
    assert hit.contact_time == pytest.approx(free.contact_time, rel=1e-2)


# Risk of the stops that the scene has -----------------------------------------------------


def bursts(sizing: Sizing, clearance: float) -> float:
    """Of the sizing made by hand: 0.55 of Rice's crossings of the mission."""
    return 0.55 * screen(sizing.scene).rice_rate(clearance) * sizing.mission


def test_the_chance_at_a_clearance_is_read_off_the_curve(sizing: Sizing) -> None:
    for multiple in (4.03, 5.11, 6.37, 12.0):
        wanted = -math.expm1(-bursts(sizing, multiple * sizing.sigma))
        assert probability_at(sizing, multiple * sizing.sigma) == pytest.approx(wanted, rel=1e-9)
    assert probability_at(sizing, sizing.clearance.value) == sizing.target.value
    assert probability_at(sizing, 0.1 * sizing.sigma) is None
    assert 0.0 < (probability_at(sizing, 1e3 * sizing.sigma) or 0.0) < 1e-200


def test_uneven_stops_have_their_own_chance_and_even_ones_that_of_the_curve(sizing: Sizing) -> None:
    sag = sizing.scene.structure.sag
    own = sizing.probability_of_stops
    assert own is not None
    assert probability_of_stops(sizing) == own.value
    even = sizing.scene.impact_pairs[0].model_copy(
        update={"lower": -8e-3 - sag, "upper": 8e-3 - sag}
    )
    scene = sizing.scene.model_copy(update={"impact_pairs": (even,)})
    told = replace(sizing, scene=scene, probability_of_stops=None)
    assert probability_of_stops(told) == pytest.approx(-math.expm1(-bursts(sizing, 8e-3)), rel=1e-9)


def test_the_only_stop_of_a_scene_brings_all_the_bursts_of_its_distance(sizing: Sizing) -> None:
    """The curve of a sizing with one stop counts the impacts on it alone."""
    pair = sizing.scene.impact_pairs[0].model_copy(update={"lower": None, "upper": 8e-3})
    scene = sizing.scene.model_copy(update={"impact_pairs": (pair,)})
    expected = bursts(sizing, 8e-3 + sizing.scene.structure.sag)
    told = replace(sizing, scene=scene, probability_of_stops=None)
    assert probability_of_stops(told) == pytest.approx(-math.expm1(-expected), rel=1e-9)


# Numbers of the page ----------------------------------------------------------------------


@pytest.mark.slow
def test_peaks_for_which_no_time_is_left_cost_no_review(
    sizing: Sizing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the time of a review is over, a window alone may take longer than what is left."""
    module = importlib.import_module("stochvi.isolators.sizing.review")

    def late(*_: object, **named: object) -> None:
        raise NotConverged("the budget of 0.001 s ended before there was an answer; raise budget")

    monkeypatch.setattr(module, "clatter", late)
    found = review(sizing, settings=ReviewSettings(budget=1e-3))
    assert found.peaks is None and module.NO_PEAKS in found.warnings


def test_numbers_of_a_review_without_stops_are_plain_sums_and_motions() -> None:
    """The base by sums over frequency, the mount by its definitions, the largest displacement by
    motions that are made from white noise."""
    found = review(
        sizing_of(scene_between_stops(law=None), mission=60.0), settings=ReviewSettings(budget=1e-3)
    )
    f = np.geomspace(5.0, 500.0, 200_001)
    density = TRUCK.table(f)
    base = found.environment.base
    assert base is not None
    for power, rms in (
        (0, base.acceleration_std),
        (2, base.velocity_std),
        (4, base.displacement_std),
    ):
        plain = math.sqrt(np.trapezoid(density / (2.0 * np.pi * f) ** power, f))
        assert rms == pytest.approx(plain, rel=1e-4)
    omega = 2.0 * np.pi * 12.0
    mount = found.mount
    assert mount is not None and mount.static_sag == pytest.approx(9.80665 / omega**2, rel=1e-9)
    assert (mount.natural_frequency_hz, mount.damping_ratio, mount.quality_factor) == (
        pytest.approx(12.0), pytest.approx(0.1), pytest.approx(5.0)
    )  # fmt: skip
    linear = found.linear
    assert linear is not None
    gain = 1.0 / (omega**2 - (2.0 * np.pi * f) ** 2 + 0.2j * omega * 2.0 * np.pi * f)
    moved = np.abs(gain) ** 2 * density
    sigma = math.sqrt(np.trapezoid(moved, f))
    crossings = math.sqrt(np.trapezoid(moved * f**2, f)) / sigma
    assert linear.rice_rate_at_three_sigma == pytest.approx(
        2.0 * crossings * math.exp(-4.5), rel=1e-4
    )
    felt = np.trapezoid(
        np.abs(gain) ** 2 * density * (omega**4 + (0.2 * omega * 2.0 * np.pi * f) ** 2), f
    )
    miles = math.sqrt(0.5 * np.pi * 12.0 * 5.0 * float(TRUCK.table(np.array([12.0]))[0]))
    assert linear.miles_error == pytest.approx(miles / math.sqrt(felt) - 1.0, abs=1e-3)
    rate, random = 200.0, np.random.default_rng(1)
    count = int(60.0 * rate)
    bins = np.fft.rfftfreq(2 * count, 1.0 / rate)
    w = 2.0 * np.pi * bins
    shape = np.sqrt(TRUCK.table(bins)) / np.abs(omega**2 - w**2 + 0.2j * omega * w)
    peaks = []
    for _ in range(300):
        x = np.fft.irfft(shape * np.fft.rfft(random.normal(size=2 * count)))[:count]
        peaks.append(np.abs(x).max() / x.std())
    error = float(np.std(peaks)) / math.sqrt(len(peaks))
    # Davenport takes all peaks for independent: those of a resonance come in groups
    assert -4.5 * error < linear.largest_in_sigma - np.mean(peaks) < 0.05 * np.mean(peaks)
    assert linear.largest_displacement == pytest.approx(linear.largest_in_sigma * sigma, rel=1e-4)


def test_a_long_path_between_elastic_stops_has_the_exact_law() -> None:
    """Rates by speed and kurtosis of the Gibbs distribution; far from stops the linear
    transmissibility."""
    mount = Isolator(frequency_hz=1.0, zeta=0.05)
    noise = WhiteNoise(density=1e-3, unit="g2/Hz")
    stops = ImpactPair(clearance=1.0, law=Restitution(coefficient=1.0))
    scene = Scene(structure=mount, impact_pairs=[stops], excitations=[noise])
    sized = sizing_of(scene, paths=16)
    sigma = sized.sigma
    near = replace(sized, three_sigma=replace(sized.three_sigma, clearance=1.5 * sigma))
    motion = motion_between_stops(near, PathSettings(periods=20_000.0))
    x = np.linspace(-1.5, 1.5, 20_001)
    law = np.exp(-0.5 * x**2)
    known = exact(at_clearances(scene, 1.5 * sigma)).impact_pairs["stops"]
    rate = float(known.collision_rate or 0.0)
    hits = motion.hits / motion.duration
    # impacts of a resonance come in groups of some ten
    spread = math.sqrt(20.0 / motion.hits)
    assert hits == pytest.approx(rate, rel=4.5 * spread) and 4.5 * spread < 0.2
    kurtosis = np.trapezoid(law * x**4, x) * np.trapezoid(law, x) / np.trapezoid(law * x**2, x) ** 2
    assert motion.kurtosis == pytest.approx(kurtosis, rel=0.03)
    assert abs(motion.kurtosis - 3.0) > 0.5
    assert motion.mean_position == 0.0
    faster = motion.faster_hits
    assert faster is not None
    speed = math.sqrt(2.0) * 2.0 * math.pi * sigma  # exceeded by exp(-1) of Rayleigh's speeds
    row = faster.iloc[(faster["impact_speed"] - speed).abs().argmin()]
    share = math.exp(-0.5 * (row["impact_speed"] / (2.0 * math.pi * sigma)) ** 2)
    assert row["rate"] == pytest.approx(rate * share, rel=0.2)
    density = motion.displacement
    middles = 0.5 * (np.asarray(density.edges)[1:] + np.asarray(density.edges)[:-1]) / sigma
    truth = np.exp(-0.5 * middles**2) / (np.trapezoid(law, x) * sigma)
    assert np.asarray(density.density) == pytest.approx(truth, rel=0.15)
    far = replace(sized, three_sigma=replace(sized.three_sigma, clearance=8.0 * sigma))
    free = motion_between_stops(far, PathSettings(periods=5_000.0))
    table = free.transmissibility
    assert table is not None and free.transmissibility_change is not None
    f, gain = table["frequency_hz"].to_numpy(), table["transmissibility"].to_numpy()
    band = (f > 0.3) & (f < 3.0)
    ratio = gain[band] / transmissibility(model_of(scene), f[band])
    assert f.min() < 0.5 and f.max() > 2.0
    for low, high in ((0.3, 0.7), (0.7, 1.4), (1.4, 3.0)):  # each of some dozens of bins
        inside = (f[band] > low) & (f[band] < high)
        assert np.median(ratio[inside]) == pytest.approx(1.0, rel=0.05)
    assert free.transmissibility_change < 0.1 and free.hits == 0
