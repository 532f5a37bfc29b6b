"""The clearance for a stated risk: against textbook numbers, exact laws and simulation."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NoReturn

import matplotlib.pyplot as plt
import numpy as np
import pytest

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
    Scene,
    Sine,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    first_passage,
    screen,
    simulate,
)
from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing import job, one_curve
from stochvi.isolators.sizing.answer import spoken_percent
from stochvi.isolators.sizing.exceedances import chance_in_windows
from stochvi.isolators.sizing.method import Sizing, size
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.mathematics.moving_means import MovingMean
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.methods.monte_carlo.kernels.rows import EXTREMES, FASTEST
from stochvi.methods.monte_carlo.tabulated import plan_tabulated
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import GAUSSIAN_95
from stochvi.statistics.bursts import UNFINISHED, Bursts, bursts
from stochvi.statistics.first_crossings import first_crossings, one_gap
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.testing import assert_agrees
from stochvi.verification.testing.agreement import Z
from stochvi.views.sizing import plot_risk
from support.mounts import HOUR, ten_hertz, truck

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
    assert curve.probability(50.0) == 0.0 and curve.hazard(50.0)[0] == 0.0
    assert curve.hazard(1.0)[0] == pytest.approx(many * math.exp(-0.5), rel=1e-9)


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
    assert " mm per side from " in repr(hourly) and "1 %" in hourly._repr_html_()
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
    plan = plan_tabulated(model_of(at_clearances(scene, found.clearance.value)), None, mission)
    paths = 2048
    extremes = np.zeros((paths, EXTREMES))
    for first in range(0, paths, plan.block):
        plan.averages(12, first, plan.block, None, extremes[first : first + plan.block])
    share = float(np.mean(extremes[:, FASTEST] > limit))
    half = 0.5 * (found.clearance.upper - found.clearance.lower)
    # d ln(-ln(1 - p)) / d clearance of Rice's rate
    slope = found.clearance.value / found.sigma**2 * exceedance
    counted = math.sqrt(share * (1.0 - share) / paths)
    assert abs(share - exceedance) < Z * counted + Z / GAUSSIAN_95 * half * slope
    assert half * slope < 0.5 * exceedance


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
    monkeypatch.setattr(job, "rare_hits", lambda *scene, **asked: SimpleNamespace(chance=seen))
    monkeypatch.setattr(one_curve, "chance_in_windows", lambda scene, *asked, **how: None)
    found = size(truck(HALF), impact_speed=5.0, rel_error=0.2)
    assert found.clearance.lower == 0.0
    assert found.clearance.upper == found.clearance.value < 4.0 * found.sigma
    assert any("may do as well" in warning for warning in found.warnings)
    assert found.kept_with is not None and found.kept_with.upper_95 == pytest.approx(2e-5)
    verdict = found.verdict()
    assert verdict.startswith(f"clearance: {found.made} from the static equilibrium is enough")
    assert "any impact speed of 1 h exceeds 5 m/s is below 1 %" in verdict
    assert "95 % limit of the probability: 0.002 %" in found.calculated()
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["kept_with"]["value"] == 0.0

    monkeypatch.setattr(job, "rare_hits", too_short)
    farther = size(truck(HALF), impact_speed=5.0, rel_error=0.2)
    assert farther.shown_to_keep and farther.clearance.value > found.clearance.value
    assert farther.clearance.lower == 0.0
    unknown = replace(found, kept_with=Estimate(value=0.0, upper_95=0.1))
    assert unknown.verdict().startswith("no clearance was shown to keep the target: ")
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
    monkeypatch.setattr(one_curve, "chance_in_windows", lambda scene, *asked, **how: None)
    found = size(truck(HALF), impact_speed=0.5, exceedance=0.5, mission=60.0, rel_error=0.2)
    assert found.kept_with is not None and found.kept_with.upper_95 is None
    assert 0.0 < found.kept_with.value < 0.5
    assert "is below 50 %" in found.verdict()
    assert f"a probability of {spoken_percent(found.kept_with.value)}" in found.calculated()


def test_a_limit_that_says_nothing_does_not_replace_a_chance_that_was_seen() -> None:
    """Words said "over 99.9 %" of a probability that stood beside them in the picture as 1.5 %."""
    bursts = Estimate(value=0.015, standard_error=0.008)
    without_time = Estimate(value=0.0, upper_95=1.0, how="not one window")
    assert job.more_telling(bursts, without_time) is bursts
    assert job.more_telling(bursts, None) is bursts
    windows = Estimate(value=0.011, standard_error=0.002)
    small = Estimate(value=0.0, upper_95=0.02)
    assert job.more_telling(bursts, windows) is windows
    assert job.more_telling(bursts, small) is small
    assert job.more_telling(small, without_time) is small


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
    assert bursts(pumped, rel_error=0.5, budget=0.1).unfinished > UNFINISHED


def test_a_chance_that_is_not_known_gives_no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few clusters reach a limit, and where they are too few, their standard error is no guide."""
    now = [0.0]
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def ended(scene: Scene, *, rel_error: float, budget: float, **asked: Any) -> Bursts:
        # at 10 % on any machine, after a second of a clock that nothing else moves
        now[0] += 1.0
        return bursts(scene, rel_error=max(rel_error, 0.1), budget=None, **asked)

    monkeypatch.setattr(one_curve, "bursts", ended)
    monkeypatch.setattr(job, "rare_hits", too_short)
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

    monkeypatch.setattr("stochvi.statistics.impact_counts.simulate", ended)
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

    monkeypatch.setattr("stochvi.statistics.impact_counts.bursts", pauseless)
    simulated = size(scene, probability=0.01, rel_error=0.2, seed=1, budget=5.0)
    assert bursts_only == {"by": "bursts"} != {"by": simulated.simulated["by"].iloc[-1]}
    monkeypatch.setattr("stochvi.statistics.impact_counts.simulate", refuse)
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
    rate = bursts(scene, seed=2, rel_error=0.05).exceedance_rate("peak_acceleration", limit)
    hazard = rate * mission
    seen = -math.log1p(-windows.value)
    error = math.hypot(windows.standard_error / (1.0 - windows.value), hazard.standard_error)
    assert abs(seen - hazard.value) < Z * error
    # the control: a limit lower by a tenth
    lower = bursts(scene, seed=2, rel_error=0.05).exceedance_rate("peak_acceleration", 0.85 * limit)
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
