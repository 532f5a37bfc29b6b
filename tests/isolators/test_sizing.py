"""The clearance for a stated risk: against textbook numbers, exact laws and simulation."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NoReturn

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import signal

from stochvi import (
    ConstantLoad,
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    RoadNoise,
    Scene,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    first_passage,
    reliability,
    screen,
    simulate,
)
from stochvi.isolators.bumpers import contact_on_mount
from stochvi.isolators.screening import at_clearances, frequencies, input_density, transmissibility
from stochvi.isolators.sizing import pairs, search
from stochvi.isolators.sizing.answer import probability_at, probability_of_stops
from stochvi.isolators.sizing.review import (
    PathSettings,
    ReviewSettings,
    motion_between_stops,
    review,
)
from stochvi.isolators.sizing.risk_curve import RiskCurve, chance_in_windows
from stochvi.isolators.sizing.search import SEARCH, Reached, SizingJob, rate_of
from stochvi.isolators.sizing.sensitivity import variations
from stochvi.isolators.sizing.size import Sizing, risk_curve, size
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.mathematics.unsteady_noise import FastPeaks, MovingMean
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import Overdue
from stochvi.results.estimates import GAUSSIAN_95, Estimate, spoken_percent
from stochvi.sampling.run import Run
from stochvi.scenes.impact_laws import ForceTable, Law
from stochvi.scenes.phases import Phase
from stochvi.statistics.clusters import UNFINISHED, Bursts, chance_of
from stochvi.statistics.clusters import bursts as bursts_of_clusters
from stochvi.statistics.crossings import PairMotion, first_crossings, one_gap
from stochvi.testing import assert_agrees
from stochvi.verification.testing.judging import Z
from stochvi.views.sizing import plot_risk
from support.mounts import HOUR, isolator, ten_hertz, truck
from support.sized import MOUNT, TRUCK, scene_between_stops, sizing_of
from support.synthesis import OfMass

HALF = Restitution(coefficient=0.5)


@pytest.fixture(scope="module")
def hourly() -> Sizing:
    return size(ten_hertz(0.05), probability=0.01, seed=1)


def test_one_per_cent_an_hour_at_ten_hertz_needs_five_point_six_sigma(hourly: Sizing) -> None:
    """With independent crossings it is 5.62 sigma; that they come in clumps takes a little off."""
    sigma = hourly.clearance.value / hourly.sigma
    independent = math.sqrt(2.0 * math.log(2.0 * 10.0 * HOUR / -math.log1p(-0.01)))
    assert 5.5 < sigma < independent
    assert hourly.sigma == pytest.approx(screen(ten_hertz(0.05)).displacement_std, rel=1e-5)
    # the interval is that of 5 % of the risk or less: d ln P / d sigma is -5.6
    half = 0.5 * (hourly.clearance.upper - hourly.clearance.lower)
    assert half < 0.05 * GAUSSIAN_95 * hourly.sigma / 5.0


def test_the_chance_at_the_clearance_is_the_one_asked_for(hourly: Sizing) -> None:
    """Asked the other way round, with other random numbers."""
    found = first_crossings(
        ten_hertz(0.05), [hourly.clearance.value], mission=HOUR, rel_error=0.01, seed=77
    )
    (chance,) = found.probability(HOUR)
    slope = 5.6 / hourly.sigma
    half = 0.5 * (hourly.clearance.upper - hourly.clearance.lower)
    both = Estimate(
        value=chance.value,
        standard_error=math.hypot(chance.standard_error, half / GAUSSIAN_95 * slope * 0.01),
        bias=chance.bias,
    )
    assert_agrees(both, 0.01)
    with pytest.raises(AssertionError):
        assert_agrees(both, 0.01 * math.exp(0.05 * 5.6))  # at a clearance 0.05 sigma less


@pytest.mark.slow
def test_without_simulated_impacts_the_clearance_and_its_curve_are_the_same() -> None:
    scene = truck(HALF)
    whole = size(scene, probability=0.01, seed=1)
    short = risk_curve(scene, probability=0.01, seed=1)
    assert isinstance(whole, Sizing)
    assert isinstance(short, Sizing)
    assert short.clearance == whole.clearance
    assert short.curve.equals(whole.curve)


@pytest.mark.parametrize("wanted", [0.95, 0.999])
def test_a_chance_near_certainty_has_a_clearance_too(wanted: float) -> None:
    """Other random numbers find the same mean number of clusters there, -ln(1 - P)."""
    sized = size(ten_hertz(0.05), probability=wanted, seed=1)
    c = sized.clearance
    (rate,) = first_crossings(
        ten_hertz(0.05), [c.value], mission=HOUR, rel_error=0.02, seed=78
    ).first_rate()
    slope = c.value / sized.sigma**2
    half = 0.5 * (c.upper - c.lower)
    both = Estimate(
        value=rate.value * HOUR,
        standard_error=HOUR
        * math.hypot(rate.standard_error, half / GAUSSIAN_95 * slope * rate.value),
        bias=HOUR * (rate.bias or 0.0),
    )
    assert_agrees(both, -math.log1p(-wanted))
    with pytest.raises(AssertionError):
        assert_agrees(both, -math.log1p(-wanted) * math.exp(0.2 * sized.sigma * slope))
    assert half < 0.05 * sized.sigma


@pytest.mark.parametrize("wanted", [1e-3, 0.3])
def test_the_interval_of_a_clearance_follows_from_that_of_the_chance(wanted: float) -> None:
    """With -ln(1 - P) = h e^(-c^2 / 2), c in sigma: dP / dc = -(1 - P) c h e^(-c^2 / 2)."""
    many, clearances = 50.0, np.linspace(2.0, 6.0, 41)
    clearances[20] = math.sqrt(-2.0 * math.log(-math.log1p(-wanted) / many))
    clearances.sort()
    hazards = many * np.exp(-(clearances**2) / 2.0)
    errors = 0.02 * (1.0 - np.exp(-hazards))
    curve = RiskCurve(
        crossings=SimpleNamespace(rice_rate=hazards),  # type: ignore[arg-type]
        motion=MovingMean.still(1.0, 1.0),
        mission=1.0,
        clearances=clearances,
        probabilities=[
            Estimate(value=-math.expm1(-hazard), standard_error=error)
            for hazard, error in zip(hazards, errors, strict=True)
        ],
        first_rates=[Estimate(value=hazard, standard_error=0.0) for hazard in hazards],
    )
    found, hazard = curve.clearance(wanted), -math.log1p(-wanted)
    assert many * math.exp(-(found.value**2) / 2.0) == pytest.approx(hazard, rel=1e-9)
    half = GAUSSIAN_95 * 0.02 * wanted / ((1.0 - wanted) * found.value * hazard)
    # the slope is a central difference over 1e-3 sigma
    assert found.upper - found.value == pytest.approx(half, rel=1e-5)
    assert found.value - found.lower == pytest.approx(half, rel=1e-5)
    # 50 deviations away Rice's rate is below the smallest number: another phase may size the gap
    assert curve.probability(50.0) == 0.0 and curve.hazards.hazard(50.0)[0] == 0.0
    assert curve.hazards.hazard(1.0)[0] == pytest.approx(many * math.exp(-0.5), rel=1e-9)


def test_a_mission_too_short_for_a_chance_says_so() -> None:
    with pytest.raises(ValueError, match=r"probability must be at most 0\.[0-9]+ .* got 0.95"):
        size(ten_hertz(0.05), probability=0.95, mission=0.05)


def test_three_sigma_is_judged(hourly: Sizing) -> None:
    three = hourly.three_sigma
    assert three.rice_hits == pytest.approx(2.0 * 36000.0 * math.exp(-4.5), rel=1e-4)
    assert three.probability.value > 0.999
    assert 0.4 < three.first_hits.value / three.rice_hits < 0.6
    assert three.hits is None
    required = hourly.required
    assert list(required["probability"]) == [0.1, 0.01, 0.001]
    assert (np.diff(required["clearance"]) > 0.0).all()
    assert required["clearance"][1] == pytest.approx(hourly.clearance.value, rel=1e-9)
    chances = hourly.curve["probability"]
    assert (np.diff(chances) <= 0.0).all()
    assert (hourly.curve["probability_low"] <= chances).all()


def test_the_document_holds_plain_numbers(hourly: Sizing) -> None:
    document = json.loads(json.dumps(hourly.to_dict(), allow_nan=False))
    assert set(document["clearance"]) == {"value", "lower", "upper"}
    assert document["target"] == {
        "name": "probability", "value": 0.01, "unit": "1", "exceedance": None,
    }  # fmt: skip
    assert repr(hourly) == f"Sizing: {hourly.verdict()}" and "(1 % at " in repr(hourly)
    table = hourly._repr_html_()
    assert "1 %" in table and "clearance (mm)" in table
    assert f"{1e3 * hourly.required['clearance'].iloc[0]:.6f}" in table
    assert hourly.to_frame() is hourly.curve


def test_the_only_pair_may_be_named() -> None:
    scene = truck(HALF)
    asked = {"probability": 0.05, "mission": 600.0, "rel_error": 0.2, "seed": 1}
    known = size(scene, **asked).clearance  # type: ignore[arg-type]
    named = size(scene, pair="stops", **asked)  # type: ignore[arg-type]
    assert named.clearance == known == size(scene, common=["stops"], **asked).clearance  # type: ignore[arg-type]


def test_hits_are_counted_with_the_stop_law() -> None:
    scene = truck(HALF)
    found = size(scene, probability=0.01, seed=2)
    stops = simulate(at_clearances(scene, 3.0 * found.sigma), rel_error=0.03, seed=9).impact_pairs[
        "stops"
    ]
    direct, speed = stops.collision_rate, found.three_sigma.impact_speed_mean
    assert speed is not None and stops.impact_speed_mean is not None
    error = math.hypot(speed.standard_error, stops.impact_speed_mean.standard_error)
    assert_agrees(Estimate(value=speed.value, standard_error=error), float(stops.impact_speed_mean))
    assert isinstance(direct, Estimate) and found.three_sigma.hits is not None
    hits = found.three_sigma.hits
    both = Estimate(
        value=hits.value / HOUR,
        standard_error=math.hypot(hits.standard_error / HOUR, direct.standard_error),
        bias=(hits.bias or 0.0) / HOUR + (direct.bias or 0.0),
    )
    assert_agrees(both, direct.value)
    recommended = found.simulated.iloc[-1]
    assert recommended["by"] == "bursts"
    assert recommended["clearance"] == found.clearance.value
    # 1 % of the hours have impacts, and then a little more than one on average
    expected = recommended["hit_rate"] * HOUR / recommended["hits_per_first_hit"]
    assert expected == pytest.approx(-math.log1p(-0.01), rel=0.1)
    assert set(found.evidence) == {"three_sigma"}


def test_the_clearance_for_a_rate_of_elastic_stops_is_the_exact_one() -> None:
    """At R = 1 in white noise impacts come at Rice's rate over the share of time between the
    stops."""
    wanted = 1e-3
    found = size(ten_hertz(0.05, Restitution(coefficient=1.0)), rate=wanted, seed=3)
    level = found.clearance.value / found.sigma
    for _ in range(4):
        share = math.erf(level / math.sqrt(2.0))
        level = math.sqrt(2.0 * math.log(20.0 / (wanted * share)))
    error = (found.clearance.upper - found.clearance.lower) / 2.0 / GAUSSIAN_95
    assert_agrees(Estimate(value=found.clearance.value, standard_error=error), level * found.sigma)
    assert error < 0.05 / level * found.sigma


def test_a_frequent_rate_is_simulated_outright() -> None:
    found = size(truck(HALF), rate=0.3, seed=3)
    direct = simulate(
        at_clearances(truck(HALF), found.clearance.value), rel_error=0.02, seed=8
    ).impact_pairs["stops"]["collision_rate"]
    assert isinstance(direct, Estimate)
    half = 0.5 * (found.clearance.upper - found.clearance.lower)
    slope = found.clearance.value / found.sigma**2
    error = math.hypot(direct.standard_error, half / GAUSSIAN_95 * slope * 0.3)
    assert_agrees(Estimate(value=direct.value, standard_error=error, bias=direct.bias), 0.3)
    assert "recommended" in found.evidence


def test_a_largest_impact_speed_against_whole_missions() -> None:
    scene, mission, limit, exceedance = truck(HALF), 40.0, 0.3, 0.1
    found = size(scene, impact_speed=limit, mission=mission, exceedance=exceedance, seed=4)
    plan = OfMass.of(at_clearances(scene, found.clearance.value), None, mission)
    paths, fastest = 2048, []
    for first in range(0, paths, plan.block):
        _, record = plan.recorded(12, first, plan.block)
        fastest.append(np.abs(record[:, :, 2]).max(axis=0))
    share = float(np.mean(np.concatenate(fastest) > limit))
    half = 0.5 * (found.clearance.upper - found.clearance.lower)
    # d ln(-ln(1 - p)) / d clearance of Rice's rate
    slope = found.clearance.value / found.sigma**2 * exceedance
    counted = math.sqrt(share * (1.0 - share) / paths)
    assert abs(share - exceedance) < Z * counted + Z / GAUSSIAN_95 * half * slope
    assert half * slope < 0.5 * exceedance


@pytest.mark.slow
def test_a_largest_energy_is_sized_as_the_speed_that_brings_it() -> None:
    """Of 4 kg; as if of 1 kg, the speed is twice as large and the clearance smaller."""
    mount = Isolator(mass=4.0, frequency_hz=12.0, zeta=0.1)
    scene, asked = truck(HALF).replace(structure=mount), dict[str, Any](mission=40.0)
    asked |= {"exceedance": 0.1, "rel_error": 0.3, "seed": 4}
    found = size(scene, impact_energy=0.18, **asked)
    assert found.clearance == size(scene, impact_speed=0.3, **asked).clearance
    assert found.clearance.value > size(scene, impact_speed=0.6, **asked).clearance.upper
    assert "An impact of more than 0.18 J in 40 s: less than 10 %" in found.verdict()


def test_static_sag_and_single_stops_are_kept() -> None:
    scene = Scene(
        structure=Isolator(frequency_hz=10.0, zeta=0.05),
        impact_pairs=[ImpactPair(lower=-9e-3, law=HALF)],
        excitations=[
            WhiteNoise(density=0.01, unit="g2/Hz"), ConstantLoad(acceleration=9.80665),
        ],
    )  # fmt: skip
    sag = -9.80665 / scene.structure.omega**2
    pair = at_clearances(scene, 5e-3).impact_pairs[0]
    assert pair.lower == pytest.approx(sag - 5e-3) and pair.upper is None
    one = size(scene, probability=0.01, rel_error=0.1, seed=1)
    two = size(ten_hertz(0.05), probability=0.01, rel_error=0.1, seed=1)
    # half as many crossings: a little less
    assert one.clearance.value < two.clearance.value
    half_rate = math.log(2.0) / (one.clearance.value / one.sigma**2)
    assert two.clearance.value - one.clearance.value == pytest.approx(half_rate, rel=0.2)


def test_a_mount_below_its_table_is_called_pumped() -> None:
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-1e-3, upper=1e-3, law=HALF)],
        excitations=[TabulatedNoise(profile="gevs-qualification")],
    )
    found = size(scene, probability=0.01, rel_error=0.3, seed=1)
    assert any("stops pump this mount" in warning for warning in found.warnings)
    assert found.three_sigma.hits is not None
    assert found.three_sigma.hits.value > 10.0 * found.three_sigma.rice_hits
    assert found.three_sigma.hits.value > 20.0 * found.three_sigma.first_hits.value


def too_short(*scene: object, **asked: Any) -> NoReturn:
    raise NotConverged("the budget ended", None)


def test_a_limit_that_no_hit_reaches_is_kept_by_the_nearest_stops_that_can_be_judged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Counted clusters show no probability below 1 %: there are more first impacts than
    clusters."""
    seen = Estimate(value=0.0, upper_95=2e-5, how="none of 8")
    monkeypatch.setattr(search, "rare_hits", lambda *scene, **asked: SimpleNamespace(chance=seen))
    monkeypatch.setattr(pairs, "chance_in_windows", lambda scene, *asked, **how: None)
    found = size(truck(HALF), impact_speed=5.0, rel_error=0.2)
    assert found.clearance.lower == 0.0
    assert found.clearance.upper == found.clearance.value < 4.0 * found.sigma
    assert any("may do as well" in warning for warning in found.warnings)
    assert found.kept_with is not None and found.kept_with.upper_95 == pytest.approx(2e-5)
    verdict = found.verdict()
    assert verdict.startswith(f"Make {found.made} on each side")
    assert "; less may be enough. An impact faster than 5 m/s in 1 h: less than 1 %" in verdict
    assert "95 % limit of the probability: 0.002 %" in found.calculated()
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["kept_with"]["value"] == 0.0

    monkeypatch.setattr(search, "rare_hits", too_short)
    farther = size(truck(HALF), impact_speed=5.0, rel_error=0.2)
    assert farther.shown_to_keep and farther.clearance.value > found.clearance.value
    assert farther.clearance.lower == 0.0
    unknown = replace(found, kept_with=Estimate(value=0.0, upper_95=0.1))
    assert unknown.verdict().startswith("No clearance was shown to keep the target; ")
    assert "is not known well enough" in unknown.verdict() and unknown.stops_to_copy() == ""


@pytest.mark.verify
def test_a_limit_far_above_every_hit_is_shown_to_be_kept() -> None:
    found = size(truck(HALF), impact_speed=5.0, rel_error=0.2)
    assert found.kept_with is not None and found.kept_with.upper_95 is not None
    assert found.target.exceedance is not None
    assert found.kept_with.upper_95 <= found.target.exceedance


def test_the_chance_that_is_kept_already_is_told_where_it_was_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pairs, "chance_in_windows", lambda scene, *asked, **how: None)
    found = size(truck(HALF), impact_speed=0.5, exceedance=0.5, mission=60.0, rel_error=0.2)
    assert found.kept_with is not None and found.kept_with.upper_95 is None
    assert 0.0 < found.kept_with.value < 0.5
    assert "faster than 0.5 m/s in 1 min: less than 50 % likely." in found.verdict()
    assert f"a probability of {spoken_percent(found.kept_with.value)}" in found.calculated()


def test_a_limit_that_says_nothing_does_not_replace_a_chance_that_was_seen() -> None:
    """Words said "over 99.9 %" of a probability that stood beside them in the picture as 1.5 %."""
    bursts = Estimate(value=0.015, standard_error=0.008)
    without_time = Estimate(value=0.0, upper_95=1.0, how="not one window")
    assert search.more_telling(bursts, without_time) is bursts
    assert search.more_telling(bursts, None) is bursts
    windows = Estimate(value=0.011, standard_error=0.002)
    small = Estimate(value=0.0, upper_95=0.02)
    assert search.more_telling(bursts, windows) is windows
    assert search.more_telling(bursts, small) is small
    assert search.more_telling(small, without_time) is small


def test_bursts_that_do_not_end_give_no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {"impact_speed": 0.3, "mission": 40.0, "exceedance": 0.1}
    found = size(truck(HALF), **asked, rel_error=0.2, seed=4)
    monkeypatch.setattr(Bursts, "unfinished", 2.0 * UNFINISHED)
    with pytest.raises(NotConverged, match=r"had not ended after .* s: the probability") as refused:
        size(truck(HALF), **asked, rel_error=0.2, seed=4)
    assert refused.value.partial.clearance.value == pytest.approx(found.clearance.value, rel=0.05)


def test_the_bursts_of_a_pumped_mount_do_not_end() -> None:
    """Where an impact speed of 0.5 m/s would be looked for; without this it seems to be found."""
    pumped = Scene(
        structure=Isolator(frequency_hz=8.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-0.92e-3, upper=0.92e-3, law=HALF)],
        excitations=[TabulatedNoise(profile="navmat-p-9492")],
    )
    assert bursts_of_clusters(pumped, rel_error=0.5, budget=0.1).unfinished > UNFINISHED


def test_a_chance_that_is_not_known_gives_no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few clusters reach a limit, and where they are too few, their standard error is no guide."""
    now = [0.0]
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def ended(scene: Scene, *, rel_error: float, budget: float, **asked: Any) -> Bursts:
        # at 10 % on any machine, after a second of a clock that nothing else moves
        now[0] += 1.0
        return bursts_of_clusters(scene, rel_error=max(rel_error, 0.1), budget=None, **asked)

    monkeypatch.setattr(pairs, "bursts", ended)
    monkeypatch.setattr(search, "rare_hits", too_short)
    with pytest.raises(NotConverged, match=r"error of .* beyond the limit at 7.* 0.01 was asked"):
        size(
            truck(HALF), impact_speed=0.3, mission=40.0, exceedance=0.1, rel_error=0.01,
            budget=4.0, seed=4, threads=1,
        )  # fmt: skip


def test_warnings_speak_of_the_answer_and_of_three_sigma_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ended(scene: Scene, *, seed: int, executor: Any, **_: Any) -> NoReturn:
        # after so many paths on any machine
        answer = simulate(scene, paths=256, seed=seed, executor=executor)
        raise NotConverged("the budget ended", answer)

    monkeypatch.setattr("stochvi.statistics.clusters.simulate", ended)
    found = size(truck(HALF), rate=0.3, rel_error=5e-3, budget=600.0, seed=4, threads=1)
    places = [1e3 * place for place in (found.clearance.value, 3.0 * found.sigma)]
    unknown = [text for text in found.warnings if "before the impacts" in text]
    assert len(unknown) == 2 < len(found.simulated)
    for place in places:
        assert any(f"at {place:.4g} mm" in text for text in unknown)
    # the interval is that of what was reached
    half = 0.5 * (found.clearance.upper - found.clearance.lower)
    assert half > 2.0 * GAUSSIAN_95 * 5e-3 * found.sigma**2 / found.clearance.value


def test_filtered_noise_is_sized() -> None:
    """The list of what is covered names it."""
    filtered = FilteredNoise(density=0.01, unit="g2/Hz", frequency_hz=30.0, zeta=0.5)
    scene = Scene(structure=Isolator(frequency_hz=10.0, zeta=0.1), excitations=[filtered])
    found = size(scene, probability=0.01, rel_error=0.2)
    assert 5.0 < found.clearance.value / found.sigma < 6.0


def test_what_cannot_be_kept_says_why() -> None:
    with pytest.raises(ValueError, match="exactly one of probability, rate"):
        size(ten_hertz(0.05))
    with pytest.raises(ValueError, match="got probability and rate"):
        size(ten_hertz(0.05), probability=0.1, rate=1.0)
    with pytest.raises(ValueError, match=r"probability must be in \(0, 0.999\], got 1"):
        size(ten_hertz(0.05), probability=1.0)
    with pytest.raises(ValueError, match="exceedance belongs to a limit of the hardest impact"):
        size(ten_hertz(0.05), probability=0.1, exceedance=0.5)
    with pytest.raises(NotApplicable, match="needs an impact_pair"):
        size(ten_hertz(0.05), rate=1.0)
    with pytest.raises(NotApplicable, match="peak_acceleration needs the stiffness"):
        size(truck(HALF), peak_acceleration=100.0)
    stiff = Elastic(stiffness=100.0 * (24.0 * math.pi) ** 2)
    with pytest.raises(NotApplicable, match="exceeded without any stop"):
        size(truck(stiff), peak_acceleration=20.0)
    with pytest.raises(NotApplicable, match="the rate stays below 500 1/s at any clearance"):
        size(truck(HALF), rate=500.0)
    with pytest.raises(ValueError, match="mission must be"):
        size(ten_hertz(0.05), probability=0.1, mission=0.0)
    alone = (Sine(amplitude=1.0, frequency_hz=20.0),)
    with pytest.raises(NotApplicable, match="excitation must contain noise, got a sine"):
        size(ten_hertz(0.05).model_copy(update={"excitations": alone}), probability=0.1)
    still = Scene(
        structure=Oscillator(frequency_hz=10.0, zeta=0.05, mass=1.0),
        excitations=[ConstantLoad(force=1.0)],
    )
    with pytest.raises(NotApplicable, match=r"^size does not apply: excitation must contain noise"):
        size(still, probability=0.1)


@pytest.mark.slow
def test_the_chance_between_uneven_stops_is_that_of_their_first_passage() -> None:
    """Clusters on two even stops touch both: half of them for either side are too few."""
    mount = Isolator(frequency_hz=10.0, zeta=0.02)
    free = Scene(structure=mount, excitations=[WhiteNoise(intensity=0.5)])
    sigma, mission = screen(free).displacement_std, 30.0
    lower, upper = -3.0 * sigma, 3.6 * sigma
    stops = ImpactPair(lower=lower, upper=upper, law=Restitution(coefficient=0.5))
    found = size(
        free.replace(impact_pairs=[stops]), probability=0.5, mission=mission, rel_error=0.02, seed=1
    )
    passage = first_passage(free, lower, upper, times=[mission], start="stationary")
    chance = found.probability_of_stops
    assert_agrees(chance, passage.probability[0].value)
    even = found.curve.set_index("clearance_in_sigma")["probability"]
    halves = [-0.5 * math.log1p(-np.interp(each, even.index, even)) for each in (3.0, 3.6)]
    independent = -math.expm1(-sum(halves))
    assert independent < passage.probability[0].value - Z * chance.standard_error


def test_where_the_stops_of_the_scene_stand_does_not_matter() -> None:
    """Not even as near as a placeholder."""
    wide, near = (
        ten_hertz(0.05, HALF).model_copy(
            update={"impact_pairs": (ImpactPair(lower=-place, upper=place, law=HALF),)}
        )
        for place in (1e-3, 1e-6)
    )
    one, two = (size(scene, probability=0.01, rel_error=0.2, seed=1) for scene in (wide, near))
    assert one.clearance == two.clearance
    assert one.three_sigma.hits == two.three_sigma.hits


@pytest.mark.verify
def test_a_motion_of_picometres_needs_as_many_sigma() -> None:
    """At 200 dB less, sigma is below the tolerances by which roots are usually searched for."""
    loud, faint = (
        Scene(
            structure=Isolator(frequency_hz=8.0, zeta=0.1),
            excitations=[TabulatedNoise(profile="navmat-p-9492", level_db=level)],
        )
        for level in (0.0, -200.0)
    )
    one, two = (size(scene, probability=0.01, rel_error=0.4, seed=1) for scene in (loud, faint))
    assert two.sigma < 2e-12 < one.sigma
    for side in ("value", "lower", "upper"):
        in_sigma = [getattr(found.clearance, side) / found.sigma for found in (one, two)]
        assert in_sigma[1] == pytest.approx(in_sigma[0], rel=1e-6)


def test_a_chance_is_told_where_hits_are_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = ten_hertz(0.05, HALF)
    known = size(scene, probability=0.01, rel_error=0.2, seed=1)
    bursts_only = {"by": known.simulated["by"].iloc[-1]}

    def refuse(*_: object, **__: object) -> None:
        raise NotConverged("budget of 0.3 s was too short for a single block of paths")

    def pauseless(*_: object, **__: object) -> None:
        raise NotApplicable("bursts", ["stops as near as these are hit without a pause"])

    monkeypatch.setattr("stochvi.statistics.clusters.bursts", pauseless)
    simulated = size(scene, probability=0.01, rel_error=0.2, seed=1, budget=5.0)
    assert bursts_only == {"by": "bursts"} != {"by": simulated.simulated["by"].iloc[-1]}
    monkeypatch.setattr("stochvi.statistics.clusters.simulate", refuse)
    found = size(scene, probability=0.01, rel_error=0.2, seed=1)
    assert found.clearance == known.clearance
    assert found.three_sigma.hits is None and found.simulated.empty
    assert list(found.simulated.columns) == list(known.simulated.columns)
    assert sum("are not known: budget of 0.3 s" in text for text in found.warnings) == 2
    json.dumps(found.to_dict(), allow_nan=False)


@pytest.mark.slow
@pytest.mark.parametrize("mission", [0.5, pytest.param(1.0, marks=pytest.mark.verify)])
def test_a_chance_near_one_falls_with_the_clearance_and_is_a_limit(mission: float) -> None:
    """Against records that are looked through from end to end."""
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    )
    curve = size(scene, probability=0.5, mission=mission, seed=1).curve
    assert (np.diff(curve["probability"]) <= 0.0).all()
    response = PairMotion(one_gap(model_of(scene))).response
    x = np.abs(response.records(7, 0, 2048, np.arange(1))[:, :, 0])
    largest = x[:, : math.ceil(mission / response.step) + 1].max(axis=1)
    for row in curve.iloc[:6].itertuples():
        share = float(np.mean(largest > row.clearance))
        error = math.sqrt(max(share * (1.0 - share), 1.0 / len(largest)) / len(largest))
        assert row.probability_low - Z * error < share < row.probability_high + Z * error
    # what was clipped does not pass for known
    assert curve["probability_high"][0] == pytest.approx(1.0, abs=1e-9)
    assert curve["probability_low"][0] < 0.99


SOFT = Viscoelastic(stiffness=5e4, damping_ratio=0.2)


def soft_bumper() -> Scene:
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=2.0)
    noise = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    stops = ImpactPair(clearance=0.004, law=SOFT)
    return Scene(structure=mount, impact_pairs=[stops], excitations=[noise])


@pytest.mark.slow
def test_a_soft_bumper_may_stand_closer_than_bursts_can_judge() -> None:
    """Where impacts follow each other without pauses, windows of the whole motion decide."""
    limit = 20.0 * STANDARD_GRAVITY
    found = size(
        soft_bumper(), peak_acceleration=limit, exceedance=0.2, mission=36.0, rel_error=0.3,
        seed=1, budget=300.0,
    )  # fmt: skip
    assert found.kept_with is not None and found.kept_with.upper_95 is not None
    assert found.kept_with.upper_95 <= 0.2
    assert found.clearance.value < 2.0 * found.sigma < 3.0 * found.sigma
    assert any("how hard an impact is, not how many" in warning for warning in found.warnings)
    assert found.exceeding is not None and found.exceeding["clearance"].is_monotonic_increasing
    # whole missions, simulated by another engine: none exceeds the limit
    several = at_clearances(soft_bumper(), found.clearance.value)
    response = simulate(several, paths=64, duration=36.0, seed=3)
    force = response.impact_pairs[several.impact_pairs[0].name]["peak_force"]
    assert isinstance(force, Estimate) and force.value / 2.0 < limit


def test_windows_and_bursts_agree_on_a_limit() -> None:
    clearance, limit, mission = 0.0075, 7.0 * STANDARD_GRAVITY, 600.0
    scene = at_clearances(soft_bumper(), clearance)
    windows = chance_in_windows(
        scene, "peak_acceleration", limit, mission, accepted=0.5, seed=1, budget=None
    )
    assert windows is not None
    rate = bursts_of_clusters(scene, seed=2, rel_error=0.05).exceedance_rate(
        "peak_acceleration", limit
    )
    hazard = rate * mission
    seen = -math.log1p(-windows.value)
    error = math.hypot(windows.standard_error / (1.0 - windows.value), hazard.standard_error)
    assert abs(seen - hazard.value) < Z * error
    # the control: a limit lower by a tenth
    lower = bursts_of_clusters(scene, seed=2, rel_error=0.05).exceedance_rate(
        "peak_acceleration", 0.85 * limit
    )
    assert abs(seen - lower.value * mission) > Z * error


def test_the_picture_of_a_limit_shows_the_chance_of_that_limit() -> None:
    limit = 9.0 * STANDARD_GRAVITY
    found = size(soft_bumper(), peak_acceleration=limit, mission=600.0, rel_error=0.3, seed=1)
    table = found.exceeding
    assert table is not None and len(table)
    ax = plot_risk(found)
    labels = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    drawn = labels["an impact beyond the limit, simulated"].lines[0]
    assert drawn.get_ydata() == pytest.approx(table["probability"])
    assert "peak acceleration" in ax.get_ylabel() and "any impact" not in ax.get_ylabel()
    # any impact at all is some ten times as likely there
    hit = found.curve.set_index("clearance")["probability"]
    assert np.interp(found.clearance.value, hit.index, hit) > 5.0 * 0.01
    plt.close(ax.get_figure())


def test_three_sigma_beside_a_sine_is_no_place_nearby() -> None:
    """The nearest clearance of the curve had 2709 impacts by Rice in an hour, not 3842."""
    noise = TabulatedNoise(
        frequency_hz=[20.0, 50.0, 800.0, 2000.0], density=[0.01, 0.04, 0.04, 0.01], unit="g2/Hz"
    )
    scene = Scene(
        structure=Isolator(frequency_hz=45.0, zeta=0.08),
        excitations=[noise, Sine(amplitude=24.5, frequency_hz=68.0)],
    )
    linear, found = screen(scene), size(scene, probability=0.01, mission=3600.0, rel_error=0.1)
    place = 3.0 * linear.displacement_std
    assert found.three_sigma.clearance == pytest.approx(place, rel=1e-9)
    assert found.three_sigma.rice_hits == pytest.approx(3600.0 * linear.rice_rate(place), rel=1e-4)
    assert found.three_sigma.first_hits.value < found.three_sigma.rice_hits


# ------------------------------------------------------------------------------
# What the review of a sizing calculates, against other ways to the same numbers.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# The search for a place that keeps a target, where rates are known at some places alone.
# ------------------------------------------------------------------------------


WANTED = 1.0


class Places:
    """Places for which nothing is calculated."""

    ends, searched, outputs = (0.1, 10.0), (0.0, 1.0), None
    steep = -1.0
    steepness = staticmethod(lambda place: 1.0)
    coordinate = place_at = length = staticmethod(lambda place: place)
    first_guess = staticmethod(lambda wanted: 3.0)
    words = staticmethod(lambda place: f"{place:g}")
    exceedance_rate: Callable[[float, Run], Estimate]

    def slope(self, place: float) -> float:
        return self.steep

    def already_kept(self, place: float, rate: Estimate) -> Reached:
        raise AssertionError("the nearest place is far away")


class Job(SizingJob):
    """A search over a rate that is 20 at places up to `seen`, unknown up to 2 and small beyond."""

    def __init__(self, unknown: float, seen: float = 1.0) -> None:
        self.unknown, self.seen = unknown, seen
        self.method = self.places = Places()  # type: ignore[assignment]
        self.target = SimpleNamespace(exceedance=0.01, name="peak_acceleration", value=WANTED)
        self.exceeded, self.unfinished, self.warnings = {}, {}, []  # type: ignore[assignment]
        self.rel_error, self.tried = 0.1, list[float]()
        self.late = self.deadline = SimpleNamespace(passed=lambda: False)

    def stage(self, low: float, high: float, words: str) -> None:
        pass

    def rate(self, place: float, rel_error: float, unseen: bool = False) -> Estimate:
        self.tried.append(place)
        if place > 2.0:
            return Estimate(value=0.0, upper_95=0.01, how="none seen")
        if place > self.seen:
            return Estimate(value=0.0, upper_95=self.unknown, how="none seen")
        return Estimate(value=20.0, standard_error=1.0, bias=0.0, how="seen")


def test_a_place_where_nothing_could_be_seen_is_not_one_that_keeps_the_target() -> None:
    job = Job(unknown=30.0)
    found = job.search(WANTED)
    # the nearest place whose upper limit keeps the target, and the last one that misses it
    assert found.place == found.upper == min(place for place in job.tried if place > 2.0)
    assert found.place < 2.0 / SEARCH.near_enough
    assert found.lower == max(place for place in job.tried if place <= 1.0)
    assert "may do as well" in job.warnings[0]
    # the control: where the limit between keeps the target, the answer is as near as any was tried
    job = Job(unknown=0.5)
    with pytest.raises(NotConverged, match="was not found in 24 places") as caught:
        job.search(WANTED)
    assert caught.value.partial.place == min(place for place in job.tried if place > 1.0) < 2.0


def test_where_the_nearest_place_is_unknown_a_farther_one_that_keeps_the_target_is_found() -> None:
    job = Job(unknown=30.0, seen=0.0)
    found = job.search(WANTED)
    assert min(job.tried) == job.method.ends[0]
    assert 2.0 < found.place == min(place for place in job.tried if place > 2.0)
    assert found.place < 2.0 / SEARCH.near_enough
    assert found.lower == -math.inf


class ByBoth(Job):
    """A search whose rate is 20 exp(-4 (place - 1)), where counting sees nothing beyond 1."""

    rate = SizingJob.rate
    splits = True
    mission = 0.01

    def __init__(self) -> None:
        super().__init__(unknown=30.0)
        self.target.exceedance = -math.expm1(-WANTED * self.mission)
        self.places.steep = -4.0
        self.places.exceedance_rate = lambda place, run: Job.rate(self, place, run.accuracy)

    def part(self, share: float = 1.0, rel_error: float | None = None) -> Run:
        never = SimpleNamespace(passed=lambda: False, share=lambda share: None)
        run = SimpleNamespace(accuracy=rel_error or self.rel_error, deadline=never)
        run.part = lambda deadline: run
        return run  # type: ignore[return-value]

    def by_splitting(self, place: float, run: Run | None = None) -> Estimate | None:
        rate = 20.0 * math.exp(-4.0 * (place - 1.0))
        known = Estimate(value=rate, standard_error=0.05 * rate, bias=0.0)
        return chance_of(known, self.mission) if self.splits else None


def test_splitting_shows_what_counted_clusters_do_not() -> None:
    job = ByBoth()
    found = job.search(WANTED)
    assert found.place == pytest.approx(1.0 + math.log(20.0) / 4.0, rel=0.02)
    assert found.lower < found.place < found.upper
    # the control: without it the nearest place that is shown is farther away
    job = ByBoth()
    job.splits = False
    assert job.search(WANTED).place > 2.0 > found.upper


def test_the_rate_of_a_chance() -> None:
    chance = chance_of(Estimate(value=0.3, standard_error=0.1, bias=0.0), 2.0)
    again = rate_of(chance, 2.0)
    assert (again.value, again.standard_error) == pytest.approx((0.3, 0.1))
    most = rate_of(Estimate(value=0.0, upper_95=0.5, how="none"), 2.0).upper_95
    assert most == pytest.approx(math.log(2.0) / 2.0)


# ------------------------------------------------------------------------------
# Clearances under noise with fast peaks, against records that are made and filtered here, against
# `reliability`, and against Gaussian noise.
# ------------------------------------------------------------------------------


BAND = TabulatedNoise(frequency_hz=[5.0, 100.0], density=[0.01, 0.01], unit="g2/Hz")
PEAKED, NEARLY_GAUSSIAN = BAND.replace(kurtosis=8.0), BAND.replace(kurtosis=3.001)
STIFF = Isolator(frequency_hz=60.0, zeta=0.4)
LAW = Restitution(coefficient=0.7)


def mount(noise: TabulatedNoise = PEAKED, **keys: Any) -> Scene:
    pairs = [ImpactPair(clearance=1e-3, law=LAW)]
    return Scene(**{"structure": STIFF, "impact_pairs": pairs, "excitations": [noise]} | keys)


def sized(scene: Scene, probability: float = 0.2, **keys: Any) -> Sizing:
    found = size(scene, probability=probability, **{"seed": 1, "budget": None} | keys)
    assert found.scene.phases
    return found


def error_of_risk(found: Sizing) -> float:
    """The standard error of the risk at the clearance of a sizing."""
    at = found.curve.iloc[len(found.curve) // 2]
    assert at["clearance"] == pytest.approx(found.clearance.value)
    return float(at["probability_high"] - at["probability"]) / 1.96


def chance_at(scene: Scene, mission: float | None, rel_error: float = 0.05) -> Estimate:
    keys: dict[str, Any] = {"rel_error": rel_error, "seed": 7, "budget": None}
    return reliability(scene, mission=mission, **keys).chances["hit"].estimate


def counted(kurtosis: float, clearance: float, mission: float, missions: int) -> Estimate:
    """Share of the missions in which records of the noise, through the equation of motion in steps,
    go beyond a stop."""
    burn_in, length = 0.1, mission + 1.0
    records = FastPeaks(BAND.table, kurtosis).over(length)
    samples = 16 * records.samples
    step = length / samples
    omega = 2.0 * math.pi * STIFF.frequency_hz
    # q'' + 2 zeta omega q' + omega^2 q = -a, with a straight between samples
    system = ([-1.0], [1.0, 2.0 * STIFF.zeta * omega, omega**2])
    top, bottom, _ = signal.cont2discrete(system, step, method="foh")
    hits, random = 0, np.random.default_rng(3)
    for _ in range(missions // 50):
        drive = 16 * np.fft.irfft(records.bins(random, 50), samples, axis=0)
        motion = signal.lfilter(np.ravel(top), bottom, drive, axis=0)
        first = round(burn_in / step)
        kept = motion[first : first + round(mission / step)]
        hits += int(np.sum(np.abs(kept).max(axis=0) > clearance))
    share = hits / missions
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / missions))


@pytest.mark.slow
def test_records_that_are_simulated_reach_the_stops_as_often_as_was_asked_for() -> None:
    found = sized(mount(), mission=10.0)
    judge = counted(8.0, found.clearance.value, 10.0, 2000)
    spread = math.hypot(judge.standard_error or 0.0, error_of_risk(found))
    assert spread < 0.02
    assert_agrees(Estimate(value=judge.value, standard_error=spread, bias=0.0), 0.2)
    again = chance_at(found.sized().replace(phases=()), 10.0)
    spread = math.hypot(again.standard_error or 0.0, error_of_risk(found))
    assert_agrees(Estimate(value=again.value, standard_error=spread, bias=again.bias), 0.2)
    # the control: a tenth less clearance is told apart, and Gaussian noise needs far less
    nearer = counted(8.0, 0.9 * found.clearance.value, 10.0, 2000)
    assert nearer.value > 0.2 + 4.5 * math.hypot(nearer.standard_error or 0.0, spread)
    gaussian = size(mount(BAND), probability=0.2, mission=10.0, seed=1)
    assert gaussian.clearance.value < 0.7 * found.clearance.value


@pytest.mark.slow
def test_a_kurtosis_of_three_is_sized_as_gaussian_noise() -> None:
    found = sized(mount(NEARLY_GAUSSIAN), 0.05, mission=600.0, rel_error=0.1)
    gaussian = size(mount(BAND), probability=0.05, mission=600.0, rel_error=0.02, seed=1)
    reach = math.hypot(*(each.clearance.upper - each.clearance.value for each in (found, gaussian)))
    assert abs(found.clearance.value - gaussian.clearance.value) < 4.5 / 1.96 * reach
    assert reach < 0.02 * gaussian.clearance.value
    # the whole curve, where both know it
    assert gaussian.curve is not None
    curve = found.curve[(found.curve["probability"] > 2e-3) & (found.curve["probability"] < 0.9)]
    judge = np.interp(
        curve["clearance"], gaussian.curve["clearance"], gaussian.curve["probability"]
    )
    left = np.abs(np.log(np.log1p(-curve["probability"]) / np.log1p(-judge)))
    wide = np.log(np.log1p(-curve["probability_high"]) / np.log1p(-curve["probability"]))
    assert len(curve) > 5 and np.all(left < 4.5 / 1.96 * wide + 0.05)


@pytest.mark.slow
def test_phases_and_several_pairs_keep_the_probability() -> None:
    """A peaked phase beside a Gaussian one that hangs lower; one stop alone beside two."""
    soft = STIFF.replace(gravity=True)
    pairs = [
        ImpactPair(name="both", clearance=1e-3, law=LAW),
        ImpactPair(name="above", upper=1e-3, law=LAW),
    ]
    phases = [
        Phase(name="peaked", duration=10.0, stiffness_factor=0.95),
        Phase(name="calm", duration=300.0, excitations=[BAND.replace(level_db=6.0)]),
    ]
    for chosen in (pairs[:1], pairs):
        scene = mount(structure=soft, impact_pairs=chosen, phases=phases)
        found = sized(scene, rel_error=0.1)
        again = chance_at(found.sized(), None, 0.1)
        spread = math.hypot(again.standard_error or 0.0, error_of_risk(found))
        assert spread < 0.03
        assert_agrees(Estimate(value=again.value, standard_error=spread, bias=again.bias), 0.2)
        assert found.phases["probability"].min() > 0.01


def test_the_rms_motion_is_that_of_gaussian_noise() -> None:
    peaked, gaussian = screen(mount()), screen(mount(BAND))
    assert peaked.displacement_std == gaussian.displacement_std
    assert any("fast peaks" in note for note in peaked.notes)
    assert not any("fast peaks" in note for note in gaussian.notes)


def test_what_is_not_followed_beside_fast_peaks_is_refused() -> None:
    sine = Sine(amplitude=1.0, frequency_hz=20.0)
    with pytest.raises(NotApplicable, match="sines must be left out beside noise with fast peaks"):
        sized(mount(excitations=[PEAKED, sine]), mission=10.0)
    with pytest.raises(NotApplicable, match="the target must be a probability"):
        size(mount(), rate=1e-3)
    with pytest.raises(ValueError, match="pair must be left out"):
        sized(mount(), mission=10.0, pair="upper")


def test_impacts_that_take_far_longer_than_the_budget_lose_no_clearance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = isolator(4e-3, restitution=1.0)
    whole = size(scene, probability=0.01, mission=HOUR, rel_error=0.2)

    def overdue(*_: object) -> NoReturn:
        raise Overdue

    monkeypatch.setattr(search, "count_impacts", overdue)
    found = size(scene, probability=0.01, mission=HOUR, rel_error=0.2)
    assert found.clearance == whole.clearance and not whole.fell_short
    assert found.expected_hits is None
    assert any("not known: the budget ended" in each for each in found.fell_short)
