"""reliability: the way that a pilot chooses, what it answers, and what it refuses."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from stochvi import (
    Elastic,
    FilteredNoise,
    ImpactPair,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    WhiteNoise,
    exact,
    reliability,
)
from stochvi.isolators.sizing.answer import spoken_percent
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import logarithmic_interval
from stochvi.sampling.options import DEFAULTS
from stochvi.sampling.run import Run as SampledRun
from stochvi.scenes.datasets import shipped_scene
from stochvi.statistics.bursts import bursts
from stochvi.statistics.reliability import conditioning
from stochvi.statistics.reliability.choice import Jobs
from stochvi.testing import assert_agrees
from stochvi.views.files import to_json
from stochvi.views.statistics_tables import chance_in_words
from support.commands import Run, one_document
from support.known import DOCUMENT, P_AT_3, RARE, TEN_PERIODS, oscillator, to_toml
from support.runs import run_of

FREE, BOX, FAR = oscillator(), oscillator(-1.0, 1.0), oscillator(-4.5, 4.5)
PRELOADED = oscillator(None, -0.5)


def test_likely_events_are_counted_and_rare_ones_split() -> None:
    near = reliability(
        FREE, mission=TEN_PERIODS, barrier=2.0, start="rest", seed=1, threads=1, rel_error=0.1
    )
    assert near.chances["passage"].way == "crude"
    assert "missions suffice" in near.chances["passage"].why
    barrier, _, truth = RARE[0]
    rare = reliability(FREE, mission=TEN_PERIODS, barrier=barrier, start="rest", seed=1, threads=1)
    chance = rare.chances["passage"]
    assert chance.way == "splitting" and chance.levels > 5
    assert "crude simulation takes" in chance.why
    assert chance.estimate.standard_error < 0.07 * chance.estimate.value
    assert_agrees(chance.estimate, truth)
    assert chance.lower < chance.estimate.value < chance.upper
    assert chance.crude_seconds is not None and chance.crude_seconds > 100.0 * chance.seconds
    no_hit = rare.no_hit
    assert no_hit is not None and 1.0 - no_hit.value == pytest.approx(chance.estimate.value)
    assert rare.hits is None


def test_every_way_agrees_and_a_seed_gives_the_same_digits_on_any_threads() -> None:
    asked: dict[str, Any] = {"mission": TEN_PERIODS, "barrier": 3.0, "rel_error": 0.03}
    for way in ("crude", "splitting"):
        found = reliability(FREE, start="rest", way=way, seed=2, threads=1, **asked)  # type: ignore[arg-type]
        chance = found.chances["passage"]
        assert chance.way == way
        assert_agrees(chance.estimate, P_AT_3)
        again = reliability(FREE, start="rest", way=way, seed=2, threads=2, **asked)  # type: ignore[arg-type]
        assert again.chances["passage"].estimate == chance.estimate
        assert (chance.wilson is None) == (way == "splitting")


def test_the_seed_does_not_choose_the_way() -> None:
    asked: dict[str, Any] = {"mission": TEN_PERIODS, "barrier": 3.0, "rel_error": 0.2}
    found = [
        reliability(FREE, start="rest", seed=seed, threads=1, **asked).chances["passage"]
        for seed in (1, 2)
    ]
    assert found[0].why == found[1].why
    assert found[0].estimate.value != found[1].estimate.value  # negative control


def test_a_stationary_start_is_a_matter_of_first_crossings() -> None:
    barrier, _, truth = RARE[2]
    found = reliability(FREE, mission=TEN_PERIODS, barrier=barrier, seed=1, threads=1)
    chance = found.chances["passage"]
    assert chance.way == "first crossings" and "none is waited for" in chance.why
    assert_agrees(chance.estimate, truth)
    ends = logarithmic_interval(
        chance.estimate.value, chance.estimate.standard_error, chance.trials - 1.0
    )
    assert (chance.lower, chance.upper) == pytest.approx(ends, rel=1e-12)


@pytest.mark.slow
def test_missions_shorter_than_what_settles_them() -> None:
    """Fast impacts of 5 s meet a bound, and 12 times their probability is about that of a
    minute."""
    box, asked = oscillator(-2.0, 2.0), {"impact_speed": 5.0, "seed": 1, "rel_error": 0.2}
    short, minute = (
        reliability(box, mission=mission, threads=1, **asked)  # type: ignore[arg-type]
        for mission in (5.0, 60.0)
    )
    rate = exact(box).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate) and short.hits is not None
    assert_agrees(replace(short.hits, bias=0.0), 5.0 * rate.value)
    one, many = (each.chances["impact_speed"].estimate for each in (short, minute))
    assert one.value - 4.5 * one.standard_error < 5.0 * rate.value * math.exp(-12.5)
    # P(A or B) is at most P(A) + P(B), and clusters belong to both
    assert many.value - 12.0 * one.value < 4.5 * math.hypot(
        12.0 * one.standard_error, many.standard_error
    )
    assert many.value > 4.0 * one.value
    moment = reliability(oscillator(-2.5, 2.5, 0.8), mission=0.01, threads=1, rel_error=0.1)
    assert moment.hits is not None
    assert moment.chances["hit"].estimate.value > 10.0 * moment.hits.value
    (note,) = moment.warnings
    outside = math.erfc(2.5 / math.sqrt(2.0))
    assert f"{outside:.3g} of it is the probability" in note


def test_what_was_found_is_told_with_what_is_missing() -> None:
    with pytest.raises(NotConverged, match="impact speed: the budget") as caught:
        reliability(oscillator(-2.5, 2.5), mission=30.0, impact_speed=8.0, threads=1, budget=0.02)
    found = caught.value.partial
    assert "hit" in found.chances and "impact_speed" not in found.chances
    assert "impact_speed" in found.missing and "impact_speed" in found.to_dict()["missing"]
    assert "impact_speed: not found" in repr(found)


def test_what_the_spring_alone_brings_is_said() -> None:
    soft = FAR.model_copy(
        update={"impact_pairs": (ImpactPair(upper=2.0, law=Elastic(stiffness=100.0)),)}
    )
    asked: dict[str, Any] = {"mission": 5.0, "start": "rest", "threads": 1, "rel_error": 0.5}
    found = reliability(soft, peak_acceleration=1.9, **asked)
    assert any("the spring alone brings 2 m/s^2" in each for each in found.warnings)
    found = reliability(soft, peak_acceleration=2.1, **asked)
    assert not any("spring alone" in each for each in found.warnings)


def test_expected_hits_are_the_rate_times_the_mission() -> None:
    found = reliability(
        BOX, mission=TEN_PERIODS, impact_speed=4.0, seed=3, threads=1, rel_error=0.1
    )
    rate = exact(BOX).impact_pairs["stops"]["collision_rate"]
    assert isinstance(rate, Estimate) and found.hits is not None
    assert_agrees(replace(found.hits, bias=0.0), TEN_PERIODS * rate.value)
    speed = found.chances["impact_speed"].estimate
    assert (
        0.0 < speed.value < TEN_PERIODS * rate.value * math.exp(-8.0) + 4.5 * speed.standard_error
    )
    assert found.chances["hit"].estimate.value > 0.99
    # a mission of crude simulation at least 64 steps long, 100 of them at least for 10 %
    assert found.cost.steps - sum(chance.steps for chance in found.chances.values()) > 6400
    document = to_json(found.to_dict())
    assert "expected_hits" in document
    assert list(found.to_frame()["event"]) == ["hit", "impact_speed"]
    assert "expected impacts" in repr(found)


def test_accelerations_need_stops_that_give_way() -> None:
    soft = FAR.model_copy(
        update={"impact_pairs": (ImpactPair(upper=2.0, law=Elastic(stiffness=100.0)),)}
    )
    found = reliability(
        soft, mission=30.0, peak_acceleration=25.0, start="rest", seed=1, threads=1, rel_error=0.2
    )
    sharp = found.chances["peak_acceleration"].estimate.value
    assert 0.0 < sharp < found.chances["hit"].estimate.value
    with pytest.raises(NotApplicable, match="restitution alone"):
        reliability(FAR, mission=30.0, peak_acceleration=25.0)


WITH_A_MEMORY = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    impact_pairs=oscillator(-5.0, 5.0, 0.8).impact_pairs,
    excitations=[FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.5)],
)


def test_noise_with_a_memory_goes_by_what_is_given() -> None:
    scene = WITH_A_MEMORY
    found = reliability(scene, mission=600.0, impact_speed=0.5, seed=1, threads=1, rel_error=0.3)
    hit, fast = found.chances["hit"], found.chances["impact_speed"]
    assert (hit.way, fast.way) == ("first crossings", "bursts")
    assert 0.0 < fast.estimate.value < hit.estimate.value + 4.5 * hit.estimate.standard_error
    rate = bursts(scene, rel_error=0.3, seed=1, threads=1).hit_rate()
    assert found.hits is not None and found.hits.value == pytest.approx(600.0 * rate.value)


def test_what_is_never_seen_has_an_upper_limit_and_is_not_an_answer() -> None:
    with pytest.raises(NotConverged, match=r"at most .* \(95 %\); raise budget") as caught:
        reliability(
            WITH_A_MEMORY, mission=600.0, impact_speed=80.0, threads=1, rel_error=0.5, budget=1.0
        )
    found = caught.value.partial
    never = found.chances["impact_speed"]
    assert never.estimate.value == 0.0 == never.lower and 0.0 < never.upper < 1.0
    assert "P(impact_speed) at most" in repr(found)
    assert found.hits is not None


@pytest.mark.parametrize(
    ("scene", "arguments", "sentence"),
    [
        (FREE, {"mission": 0.0, "barrier": 3.0}, "mission must be a positive number of seconds"),
        (FREE, {}, "barrier must be given where the scene has no impact_pair"),
        (BOX, {"barrier": 3.0}, "barrier must be left out where the scene has stops"),
        (FREE, {"barrier": (1.0, -1.0)}, "with lower < upper"),
        (FREE, {"barrier": 0.0}, "with lower < upper"),
        (FREE, {"barrier": (2.0, 2.0)}, "with lower < upper"),
        (FREE, {"barrier": (1.0, 2.0), "start": "rest"}, r"not between the barriers \(1 m, 2 m\)"),
        (FREE, {"barrier": (3.0, None), "start": "rest"}, r"balance at 0 m, .*\(3 m, none\)"),
        (PRELOADED, {"start": "rest"}, r"not between the stops \(none, -0.5 m\)"),
        (FREE, {"barrier": 3.0, "seed": -1}, r"seed must be in \[0, 2\^63\)"),
        (FREE, {"barrier": 3.0, "seed": 1.5}, "seed must be a whole number"),
        (FREE, {"barrier": 3.0, "seed": 2**80}, r"seed must be a whole number below 2\^63"),
        (FREE, {"barrier": 3.0, "threads": 0}, "threads must be at least 1"),
        (FREE, {"barrier": 3.0, "threads": -3}, "threads must be at least 1"),
        (FREE, {"barrier": 3.0, "budget": 0.0}, "budget must be a positive number of seconds"),
        (BOX, {"impact_speed": -1.0}, "impact_speed must be a positive number of m/s"),
        (BOX, {"start": "asleep"}, "start must be 'rest' or 'stationary'"),
        (BOX, {"way": "luck"}, "way must be 'crude', 'splitting'"),
        (BOX, {"way": "first crossings", "start": "rest"}, "needs start = 'stationary'"),
        (BOX, {"rel_error": 0.0}, "rel_error must be in"),
        (BOX, {"confidence": 1.0}, "confidence must be between 0 and 1"),
    ],
)
def test_arguments_out_of_range_are_named(
    scene: Scene, arguments: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        reliability(scene, **({"mission": 10.0} | arguments))


def test_a_start_beyond_the_barriers_is_a_mission_that_fails_at_once_and_is_said() -> None:
    found = reliability(FREE, mission=10.0, barrier=(3.0, None), threads=1, seed=1)
    assert found.chances["passage"].estimate.value > 0.95
    assert "not between the barriers (3 m, none)" in found.warnings[0]
    about = reliability(FREE, mission=10.0, barrier=(-0.5, 0.5), threads=1, seed=1)
    assert not any("not between" in each for each in about.warnings)


def test_what_does_not_apply_is_said() -> None:
    sine = BOX.model_copy(update={"excitations": (Sine(amplitude=1.0, frequency_hz=0.1),)})
    with pytest.raises(NotApplicable, match="got a sine alone"):
        reliability(sine, mission=10.0)
    filtered = BOX.model_copy(
        update={"excitations": (FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.5),)}
    )
    with pytest.raises(NotApplicable, match="stiffness must be positive"):
        reliability(oscillator(-1.0, 1.0, omega=0.0), mission=10.0)
    with pytest.raises(NotApplicable, match="start = 'rest' needs white noise"):
        reliability(filtered, mission=10.0, start="rest")
    with pytest.raises(NotApplicable, match="needs white noise; leave way out"):
        reliability(filtered, mission=10.0, way="crude")
    with pytest.raises(NotApplicable, match="without impact_pair"):
        reliability(FREE, mission=10.0, barrier=3.0, impact_speed=1.0, start="rest")
    with pytest.raises(NotApplicable, match="ask for a shorter mission"):
        reliability(FREE, mission=1e9, barrier=5.0, start="rest")
    with pytest.raises(NotConverged, match="raise budget or rel_error"):
        reliability(FREE, mission=1e5, barrier=5.0, start="rest", way="crude", budget=1e-3)


def test_chances_near_one_are_told_by_their_lower_end() -> None:
    assert chance_in_words(1.0, 9.8e-7, 0.99812) == "over 99.8 %"
    assert chance_in_words(1.0, 0.0, 1.0) == spoken_percent(1.0)  # as size has it
    assert chance_in_words(0.9, 0.01, 0.88) == "0.900(10)"


def test_the_command(stochvi: Run, tmp_path: Any) -> None:
    scene = str(shipped_scene("oscillator-lossy"))
    done = stochvi(
        "reliability", scene, "--mission", "30", "--impact-speed", "2", "--start", "rest",
        "--rel-error", "0.3", "--threads", "1", "--json", "-", "--out", tmp_path,
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert document["method"] == "reliability" and document["mission"] == 30.0
    fast = document["chances"]["impact_speed"]
    assert 0.0 < fast["lower"] < fast["estimate"]["value"] < fast["upper"] < 1.0
    assert document["expected_hits"]["value"] > fast["estimate"]["value"]
    assert "impact speed > 2 m/s" in done.err and "expected impacts" in done.err
    assert (tmp_path / "reliability.csv").exists()
    done = stochvi(
        "reliability", scene, "--mission", "30", "--impact-speed", "9", "--budget", "0.02",
        "--threads", "1", "--json", "-",
    )  # fmt: skip
    assert done.code == 1 and "not found" in done.err
    assert "impact_speed" in one_document(done.out)["missing"]
    done = stochvi("reliability", scene, "--mission", "30", "--barrier", "3")
    assert done.code == 2 and "barrier must be left out where the scene has stops" in done.err


@pytest.mark.parametrize(
    ("barrier", "code", "said"),
    [
        ("0", 2, "--barrier must be positive, or LO,HI"),
        ("2,1", 2, "with lower < upper, got (2.0, 1.0)"),
        ("1,2", 2, "not between the barriers (1 m, 2 m)"),
        ("3,", 2, "not between the barriers (3 m, none)"),
        (",3", 0, "passage"),
    ],
)
def test_a_barrier_on_the_command_line(
    stochvi: Run, tmp_path: Any, barrier: str, code: int, said: str
) -> None:  # fmt: skip
    path = tmp_path / "free.toml"
    free = {key: value for key, value in DOCUMENT.items() if key != "impact_pair"}
    path.write_text(to_toml(free), encoding="utf-8")
    options = ("--mission", "10", "--start", "rest", "--rel-error", "0.5", "--threads", "1")
    done = stochvi("reliability", path, f"--barrier={barrier}", *options)
    assert done.code == code and said in done.out + done.err


@pytest.mark.parametrize("gap", [30.0, 60.0])
def test_stops_that_are_out_of_reach_have_a_chance_that_is_known(gap: float) -> None:
    stops = {"lower": -gap, "upper": gap, "law": Restitution(coefficient=0.5)}
    scene = Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=[[1, 0], [0, 1]],
            damping=[[0.1, 0], [0, 0.1]], stiffness=[[1, 0], [0, 1]],
        ),
        impact_pairs=[ImpactPair(name=name, on=name, **stops) for name in ("x", "z")],
        excitations=[WhiteNoise(intensity=0.2, on="x"), WhiteNoise(intensity=0.2, on="z")],
    )  # fmt: skip
    # unit variance: crossings of one stop of four in a second, exp(-gap^2 / 2) / (2 pi)
    rice = 100.0 * 4.0 * math.exp(-(gap**2) / 2.0) / (2.0 * math.pi)
    chance = reliability(scene, mission=100.0, threads=1, seed=1).chances["hit"]
    assert chance.estimate.value == pytest.approx(rice, rel=0.05)
    assert chance.upper < 1e-100


def test_the_interval_of_expected_impacts_holds_their_bias() -> None:
    jobs = Jobs(run=SampledRun.of(DEFAULTS), confidence=0.95, deadline=NEVER)
    known = Estimate(value=24.0, standard_error=0.3, bias=0.0)
    low, high = jobs.interval(known, 100)
    wide = jobs.interval(replace(known, bias=19.0), 100)
    assert wide == pytest.approx((low - 19.0, high + 19.0))
    assert jobs.interval(replace(known, bias=40.0), 100)[0] == 0.0


def test_the_time_that_expected_impacts_leave_is_for_the_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are found first, in an equal share; the last limit has all that is left."""
    now, asked = [0.0], list[tuple[str, float]]()
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def taking(name: str, seconds: float) -> Callable[..., Any]:
        def calculate(*arguments: Any, **_: Any) -> Any:
            asked.append((name, arguments[-1].deadline.left))
            now[0] += seconds
            return SimpleNamespace(event=name)

        return calculate

    monkeypatch.setattr(conditioning, "first_hit", taking("hit", 0.0))
    monkeypatch.setattr(conditioning, "_hits", taking("impacts", 3.0))
    monkeypatch.setattr(conditioning, "exceedance", taking("limit", 10.0))
    limits = {"impact_speed": 1.0, "peak_acceleration": 9.0}
    with run_of(rel_error=0.1, seed=1) as run:
        jobs = Jobs(run=run, confidence=0.95, deadline=Deadline.after(60.0))
        conditioning.by_conditioning(BOX, (-1.0, 1.0), limits, 10.0, jobs)
    assert asked[1:] == [("impacts", 20.0), ("limit", 28.5), ("limit", 47.0)]
