"""Clearances of several pairs: against one oscillator, against the probability that they are to
keep."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from unittest import mock

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ConstantLoad,
    Elastic,
    Isolator,
    NotApplicable,
    NotConverged,
    Oscillator,
    Scene,
    WhiteNoise,
    load_scene,
    screen,
    size,
)
from stochvi.isolators.screening import at_clearances
from stochvi.isolators.sizing import pairs, search
from stochvi.isolators.sizing import sensitivity as sensitivity_module
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.sensitivity import (
    REL_ERROR,
    _largest,
    sensitivity,
    variations,
    worst_case,
)
from stochvi.isolators.tolerances import Change, Region, Tolerances, changed_stops, tolerance_table
from stochvi.model.coverage import natural_modes
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.estimates import Estimate
from stochvi.results.files import origin_of
from stochvi.sampling.run import Run as SampledRun
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.phases import changed_mount
from stochvi.scenes.scene import ImpactPair, scene_from
from stochvi.statistics.clusters import bursts
from stochvi.statistics.crossings import first_crossings
from stochvi.statistics.hardness import Limit
from stochvi.statistics.hazards import KNOWN, HazardCurve
from stochvi.statistics.rare_hits import exceedance
from stochvi.testing import assert_agrees
from stochvi.views.isolator_tables import pairs_grids
from stochvi.views.report.sections import (
    excitations_section,
)
from stochvi.views.report.sizing import sizing_page
from stochvi.views.sizing import plot_pairs_risk
from support.accuracies import run_of
from support.commands import Run, one_document
from support.pairs import LAW, pair, uncoupled
from support.refusals import refusals

MISSION, TARGET = 1000.0, 0.05
MOUNT = Scene(
    structure=Isolator(frequency_hz=10.0, zeta=0.1),
    excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
)
ROUGH_ERROR = 0.1
"""Relative error of the risk of a changed scene."""

QUICK = {"probability": TARGET, "mission": MISSION, "rel_error": 0.1, "seed": 1}


def sized(scene: Scene, *, whole: bool = False, **changed: object) -> Sizing:
    """An answer; without the impacts at its clearances and without tolerances, which are most of
    its time, unless it is asked for as a whole."""
    hits = search.count_impacts if whole else no_hits
    table = pairs.tolerance_table if whole else no_tolerances
    with mock.patch.object(search, "count_impacts", hits), mock.patch.object(
        pairs, "tolerance_table", table
    ):  # fmt: skip
        found = size(scene, **(QUICK | changed))  # type: ignore[arg-type]
    assert isinstance(found, Sizing)
    return found


def no_hits(*_: object, **__: object) -> None:
    raise NotApplicable("hits", ["they are left out here"])


def no_tolerances(*_: object, **__: object) -> tuple[pd.DataFrame, dict[str, str]]:
    return pd.DataFrame(), {}


@pytest.fixture(scope="module")
def both() -> Sizing:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    return sized(scene, whole=True, tolerances=Tolerances.of(scene, usual=True))


@pytest.mark.slow
def test_uncoupled_pairs_share_the_risk(both: Sizing) -> None:
    alone = both.pairs["probability_alone"]
    assert alone[0] == alone[1]
    independent = 1.0 - (1.0 - alone[0]) ** 2
    assert both.probability.lower < independent < both.probability.upper
    assert both.probability.lower < TARGET < both.probability.upper
    # half of the first impacts each, of some thousand crossings
    assert both.pairs["share_of_first_hits"].tolist() == pytest.approx([0.5, 0.5], abs=0.05)
    x, z = both.clearances["x"], both.clearances["z"]
    assert x.lower < x.value < x.upper
    # z crosses its mean twice as often in the mission, so that it needs more room for the same risk
    assert x.value < z.value


@pytest.mark.slow
def test_the_clearances_keep_the_chance_that_they_are_sized_for(both: Sizing) -> None:
    places = np.array([[each.value for each in both.clearances.values()]])
    (again,) = first_crossings(
        both.scene, lower=places, upper=places, mission=MISSION, rel_error=0.03, seed=9
    ).probability(MISSION)
    half = 0.5 * (both.probability.upper - both.probability.lower) / 1.96
    assert_agrees(replace(again, standard_error=math.hypot(again.standard_error, half)), TARGET)
    with pytest.raises(AssertionError):
        assert_agrees(again, 1.3 * TARGET)


@pytest.mark.slow
def test_a_pair_alone_is_sized_as_an_oscillator() -> None:
    unit = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    known = size(unit, **QUICK).clearance  # type: ignore[arg-type]
    (found,) = sized(uncoupled(pair("x", "x", 4.0))).clearances.values()
    off = abs(found.value - known.value)
    assert off < math.hypot(found.upper - found.value, known.upper - known.value) * 2.0
    twice = sized(uncoupled(pair("x", "x", 4.0), pair("again", "x", 4.0))).clearances
    assert twice["x"].value == twice["again"].value
    off = abs(twice["x"].value - found.value)
    assert off < math.hypot(found.upper - found.value, twice["x"].upper - twice["x"].value) * 2.0


def test_pairs_of_one_gap_have_one_clearance_and_share_the_first_hits() -> None:
    """Also where one counts its gap the other way round."""
    plain = ImpactPair(name="a", between=("x", "z"), lower=-4.0, upper=4.0, law=LAW)
    turned = ImpactPair(name="b", between=("z", "x"), lower=-4.0, upper=4.0, law=LAW)
    found = sized(uncoupled(plain, turned), rel_error=0.3)
    assert found.clearances["a"] == found.clearances["b"]
    assert found.pairs["share_of_first_hits"].tolist() == pytest.approx([0.5, 0.5])
    assert any("a and b have the same gap" in each for each in found.warnings)


@pytest.mark.slow
def test_one_pair_of_several_leaves_the_others_where_they_are() -> None:
    """And its stop stays on its side."""
    one = ImpactPair(name="x", on="x", upper=4.0, law=LAW)
    both = uncoupled(one, pair("z", "z", 5.0))
    # what is damped forgets soon, and takes short paths
    damped = both.structure.model_copy(update={"damping": ((0.5, 0.0), (0.0, 1.0))})
    found = sized(both.model_copy(update={"structure": damped}), pair="x", rel_error=0.5)
    assert set(found.clearances) == {"x"}
    rows = found.pairs.set_index("pair")
    assert rows.loc["z", "lower"] == pytest.approx(5.0) == rows.loc["z", "upper"]
    assert math.isnan(rows.loc["x", "lower"])
    assert rows.loc["x", "upper"] == found.clearances["x"].value


@pytest.mark.verify
def test_one_pair_of_several_keeps_the_chance_of_them_all() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 5.0))
    found = sized(scene, pair="x")
    places = np.array([[found.clearances["x"].value, 5.0]])
    (again,) = first_crossings(
        scene, lower=places, upper=places, mission=MISSION, rel_error=0.03, seed=9
    ).probability(MISSION)
    half = 0.5 * (found.probability.upper - found.probability.lower) / 1.96
    assert_agrees(replace(again, standard_error=math.hypot(again.standard_error, half)), TARGET)
    with pytest.raises(NotApplicable, match="no clearance of x keeps"):
        sized(uncoupled(pair("x", "x", 4.0), pair("z", "z", 2.0)), pair="x")


def test_tolerances_follow_linear_theory() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    places = np.array([[4.0, 4.5], [4.0, 4.5]])
    allowed = Tolerances.of(scene, usual=True)
    rows, worst_at = tolerance_table(scene, allowed, places, [0, 1], TARGET)
    table = pd.DataFrame(rows)
    rows = table.set_index("change")
    assert rows.loc["as stated", ["x", "z"]].tolist() == pytest.approx([4.0, 4.5], rel=1e-12)
    assert rows.loc["as stated", "probability"] == pytest.approx(TARGET, rel=1e-12)
    gain = 10.0 ** (3.0 / 20.0)
    assert rows.loc["level +3 dB", "x"] == pytest.approx(4.0 * gain, rel=1e-4)
    # under white noise sigma^2 = pi S0 / (2 zeta omega^3) times a constant, and omega crosses
    soft = math.sqrt((4.0**2 + 2.0 * math.log(0.9)) / 0.9**3)
    assert rows.loc["natural frequency -10 %", "x"] == pytest.approx(soft, rel=1e-9)
    light = 4.0 / math.sqrt(0.7)
    assert rows.loc["damping ratio -30 %", "x"] == pytest.approx(light, rel=1e-9)
    worst = table.iloc[-1]
    assert worst_at["x"] == "natural frequency -10 %, damping ratio -30 %, level +3 dB"
    assert worst["factor"] == table["factor"].max()


def test_a_centre_elsewhere_is_a_box_described_from_there() -> None:
    scene = load_scene(shipped_scene("rigid-box"))
    moved = Change("centre y", 0.02).applied(scene)
    keys = scene.document()
    for part in (*keys["structure"]["mount"], *keys["impact_pair"]):
        part["at"][1] -= 0.02
    keys["structure"]["points"]["display"][1] -= 0.02
    by_hand = scene_from(keys)
    assert model_of(moved).output_rows == pytest.approx(model_of(by_hand).output_rows)
    assert model_of(moved).stiffness == pytest.approx(model_of(by_hand).stiffness)
    allowed = Tolerances.of(scene, centre=0.02)
    places = np.full((2, 3), 0.006)
    table = pd.DataFrame(tolerance_table(scene, allowed, places, [0, 1, 2], TARGET)[0]).set_index(
        "change"
    )
    assert len(table) == 1 + 6 + 1
    before, after = (screen(each).impact_pairs["side"] for each in (scene, by_hand))
    # the same rate of crossings, beyond what the mean has moved
    logs = math.log(
        after.velocity_std
        * before.displacement_std
        / (after.displacement_std * before.velocity_std)
    )
    level = math.sqrt((0.006 / before.displacement_std) ** 2 + 2.0 * logs)
    expected = after.displacement_std * level + abs(after.mean - before.mean)
    assert table.loc["centre of mass +20 mm along y", "side"] == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ValueError, match="rigid-body"):
        Tolerances.of(uncoupled(), centre=0.01)


@pytest.mark.verify
def test_a_sized_changed_scene_agrees_with_the_tolerances(both: Sizing) -> None:
    """Impacts may cluster otherwise: a factor r in the rate of first impacts is ln(r) / c^2 of c /
    sigma, and a factor of 1.5 is more than a change of the damping by 30 % makes."""
    light = both.scene.structure.model_copy(update={"damping": ((0.07, 0.0), (0.0, 0.14))})
    again = sized(both.scene.model_copy(update={"structure": light}))
    row = both.tolerances.set_index("change").loc["damping ratio -30 %"]
    for name, found in again.clearances.items():
        in_sigma = again.pairs.set_index("pair").loc[name, "clearance_in_sigma"]
        share = math.log(1.5) / in_sigma**2
        assert row[name] == pytest.approx(found.value, rel=share)
        assert both.clearances[name].value != pytest.approx(found.value, rel=share)


@pytest.mark.slow
def test_changed_scenes_of_pairs_are_sized_anew(both: Sizing) -> None:
    def three(sizing: Sizing) -> list[tuple[str, Scene]]:
        return [each for each in variations(sizing) if each[0] in ("none", "level +3 dB")]

    with mock.patch.object(sensitivity_module, "variations", three):
        table = sensitivity(both, rel_error=ROUGH_ERROR, seed=1)
    assert list(table) == ["change", "x", "z", "clearance_change", "probability", "note"]
    none, louder = table.to_dict("records")
    gain = 10.0 ** (3.0 / 20.0)
    for name, c in both.clearances.items():
        in_sigma = both.pairs.set_index("pair").loc[name, "clearance_in_sigma"]
        # an error r of the risk is r / c^2 of a clearance c, in standard deviations
        error = 4.5 * 2.0 * ROUGH_ERROR / in_sigma**2
        assert none[name] == pytest.approx(c.value, rel=error)
        assert louder[name] == pytest.approx(gain * c.value, rel=error)
        assert louder[name] != pytest.approx(c.value, rel=error)
    assert none["probability"] == pytest.approx(TARGET, rel=4.5 * ROUGH_ERROR)
    assert louder["clearance_change"] == pytest.approx(
        max(louder[name] / c.value for name, c in both.clearances.items()) - 1.0
    )
    # no more first impacts than crossings (Rice) of the old stops by a motion larger by the gain
    crossings = sum(
        omega / math.pi * math.exp(-0.5 * (c.value / gain) ** 2)
        for omega, c in zip((1.0, 2.0), both.clearances.values(), strict=True)
    )
    assert 0.5 < louder["probability"] < 1.0 - math.exp(-MISSION * crossings)


@pytest.mark.parametrize("damper", [{"damping": [30.0, 30.0, 60.0]}, {"loss_factor": 0.3}])
def test_a_changed_mount_changes_every_mode(damper: dict[str, object]) -> None:
    document = load_scene(shipped_scene("rigid-box")).document()
    for mount in document["structure"]["mount"]:
        for key in ("damping", "zeta", "loss_factor"):
            mount.pop(key, None)
        mount.update(damper)
    scene = scene_from(document)
    changed = changed_mount(scene, 0.9, 1.3)
    for before, after in zip(
        natural_modes(model_of(scene)), natural_modes(model_of(changed)), strict=True
    ):
        assert after.frequency_hz == pytest.approx(0.9 * before.frequency_hz, rel=1e-9)
        assert after.damping_ratio == pytest.approx(1.3 * before.damping_ratio, rel=1e-9)


def test_laws_of_all_pairs_are_changed_each_in_its_way() -> None:
    soft = Elastic(stiffness=100.0)
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0).model_copy(update={"law": soft}))
    bouncing, stiff = changed_stops(scene, restitution=0.1, stiffness=2.0).impact_pairs
    assert bouncing.law.coefficient == pytest.approx(LAW.coefficient + 0.1)
    assert stiff.law.stiffness == pytest.approx(200.0)


def test_the_answer_holds_the_hits_that_are_expected(both: Sizing) -> None:
    assert both.expected_hits is not None
    by_pair = both.pairs["expected_hits"]
    assert by_pair.sum() == pytest.approx(both.expected_hits.value)
    # impacts cluster behind first impacts
    assert both.expected_hits.value > 1.2 * -math.log1p(-TARGET)
    # where hardly an impact was seen, the limits that are known are told, and no 0
    rare = replace(both, expected_hits=Estimate(value=0.0, upper_95=25.0, how="never seen"))
    assert f"; {-math.log1p(-TARGET):.2g} to 25 impacts expected" in rare.calculated()
    assert (both.pairs["impact_speed_mean"] > 0.5).all()


def test_three_sigma_of_every_gap_is_judged(both: Sizing) -> None:
    """Two gaps of 1 and 2 rad/s, both with an rms of 1 m: Rice's crossings of four stops."""
    three = both.three_sigma
    rice = MISSION * math.exp(-4.5) * sum(omega / math.pi for omega in (1.0, 2.0))
    assert three.clearance == pytest.approx(3.0) and both.sigma == pytest.approx(1.0)
    assert three.rice_hits == pytest.approx(rice, rel=1e-6)
    # crossings come in clusters, of which each has one first impact
    assert three.first_hits.value + 4.5 * three.first_hits.standard_error < three.rice_hits
    missed, known = math.exp(-three.first_hits.value), three.probability
    error = 4.5 * (known.standard_error + missed * three.first_hits.standard_error)
    assert abs(1.0 - known.value - missed) < error < 0.01
    assert set(both.to_dict()["three_sigma"]) == {"value", "lower", "upper"}


def test_places_of_stops_count_from_the_unloaded_springs(both: Sizing) -> None:
    """The mean gap of x, on a spring of 1 N/m under 0.3 N, lies 0.3 m above the unloaded one."""
    load = ConstantLoad(force=0.3, on="x")
    loaded = both.scene.replace(excitations=[*both.scene.excitations, load])
    table = replace(both, scene=loaded).placed().set_index("pair")
    made = table["clearance"]
    assert table["mean_gap"].tolist() == pytest.approx([0.3, 0.0])
    for name, found in both.clearances.items():
        assert found.value < both.tolerances[name].iloc[-1] <= made[name]
    there = at_clearances(loaded, np.array([made, made]))
    for name, each in zip(("x", "z"), there.impact_pairs, strict=True):
        assert table.loc[name, "lower"] == pytest.approx(each.lower)
        assert table.loc[name, "upper"] == pytest.approx(each.upper)
    one = loaded.impact_pairs[0].replace(lower=None)
    open_below = loaded.replace(impact_pairs=[one, loaded.impact_pairs[1]])
    assert math.isnan(replace(both, scene=open_below).placed()["lower"][0])


def test_many_pairs_read_by_their_ends_and_alike_ones_are_one_line(both: Sizing) -> None:
    x, z = both.clearances["x"], both.clearances["z"]
    many = replace(
        both,
        clearances={"x": x, "twin": x, "third": replace(x, value=1.01 * x.value), "z": z},
        curve=both.curve.assign(twin=both.curve["x"], third=1.01 * both.curve["x"]),
        tolerances=pd.DataFrame(),
        allowed=Tolerances(),
    )
    ends = [many.each_made[name] for name in ("x", "z")]
    assert f"Make from {ends[0]} at x to {ends[1]} at z, each of 4 pairs" in many.verdict()
    assert "third" not in many.verdict()
    ax = plot_pairs_risk(many)
    labels = [label.partition(":")[0] for label in ax.get_legend_handles_labels()[1]]
    assert labels == ["x, twin", "third", "z", "pairs taken for independent"]
    plt.close(ax.get_figure())


def test_columns_of_what_is_not_known_are_left_out(both: Sizing) -> None:
    unknown = both.pairs.assign(expected_hits=math.nan, impact_speed_mean=math.nan)
    (whole,), (less,) = pairs_grids(both), pairs_grids(replace(both, pairs=unknown))
    left = set(whole.headings) - set(less.headings)
    assert left == {"expected impacts", "mean speed (m/s)"}


def test_the_worst_tolerances_stand_in_the_verdict(both: Sizing) -> None:
    last = both.tolerances.iloc[-1]
    factors = [last[name] / each.value for name, each in both.clearances.items()]
    assert max(factors) == pytest.approx(last["factor"])
    for name, made in both.each_made.items():
        needed = both.tolerances[name]
        assert 0.0 <= made.value - needed.iloc[-1] <= made.step
        assert needed.iloc[-1] >= needed.max()
        assert f"{made} at {name}" in both.verdict()
    assert "level ± 3 dB" in both.verdict()
    stated = replace(both, tolerances=both.tolerances.iloc[:1], allowed=Tolerances())
    assert "tolerance" not in stated.verdict()
    for name, made in stated.each_made.items():
        assert 0.0 <= made.value - both.clearances[name].value <= made.step


def test_pairs_whose_worst_case_was_not_found_have_nothing_to_make(both: Sizing) -> None:
    """The clearances as stated are smaller than those that the tolerances ask for."""
    assert both.made is not None and both.allowed != Tolerances()
    late = replace(both, tolerances=both.tolerances.iloc[:1])
    assert late.made is None and not late.each_made and late.to_dict()["made"] is None
    assert "No clearance was found" in late.verdict() and "level ± 3 dB" in late.verdict()
    assert not late.stops_to_copy() and late.as_made() == late.scene


def test_a_region_of_tolerances_that_is_not_searched_in_time_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def late(*_: object) -> None:
        raise NotConverged("the budget of 1 s ended before the tolerances were searched")

    monkeypatch.setattr(Region, "worst", late)
    found = size(
        uncoupled(pair("x", "x", 3.0), pair("z", "z", 3.0)), probability=0.1, mission=200.0,
        rel_error=0.5, tolerances=Tolerances(level_db=3.0), threads=1,
    )  # fmt: skip
    assert found.made is None and found.tolerances["change"].tolist() == ["as stated"]
    (told,) = found.fell_short
    assert told.startswith("the largest clearances within the tolerances were not found: the budg")
    assert told in found.warnings


def sized_by_hits(scene: Scene, **asked: object) -> tuple[Sizing, Scene]:
    """The answer, and the scene with the stops that it asks for."""
    found = sized(scene, whole=True, **asked)
    places = [each.value for each in found.clearances.values()]
    return found, at_clearances(scene, np.array([places, places]))


@pytest.mark.verify
def test_a_rate_of_hits_is_kept() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    rate = 2e-4
    found, there = sized_by_hits(scene, probability=None, rate=rate, rel_error=0.2)
    again = bursts(there, rel_error=0.1, seed=5).hit_rate()
    both_known = replace(again, standard_error=math.hypot(again.standard_error, 0.2 * rate))
    assert_agrees(both_known, rate)
    closer = at_clearances(scene, np.full((2, 2), 3.6))
    with pytest.raises(AssertionError):
        assert_agrees(bursts(closer, rel_error=0.1, seed=5).hit_rate(), rate)
    assert found.probability.value < 1.0 - math.exp(-rate * MISSION)


@pytest.mark.slow
def test_places_that_were_tried_are_told_as_those_of_one_pair_are() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    asked = {"probability": None, "impact_speed": 1.5, "exceedance": 0.2, "rel_error": 0.3}
    found = sized(scene, whole=True, mission=200.0, **asked)
    hits, limits = found.simulated, found.exceeding
    assert limits is not None and found.expected_hits is not None
    at_answer = hits.iloc[(hits["x"] - found.clearances["x"].value).abs().argmin()]
    assert at_answer["x"] == pytest.approx(found.clearances["x"].value)
    assert at_answer["hit_rate"] * 200.0 == pytest.approx(found.expected_hits.value)
    assert at_answer["clearance_in_sigma"] == pytest.approx(found.pairs["clearance_in_sigma"].min())
    assert limits["x"].is_monotonic_increasing and limits["z"].is_monotonic_increasing
    near = limits.iloc[(limits["x"] - found.clearances["x"].value).abs().argmin()]
    assert near["probability_low"] < 0.2 < near["probability_high"]
    page = sizing_page(found, origin_of(found.provenance))
    (told,) = [each for each in page.sections if each.title == "Verification"]
    assert "clusters" in told.lead and "Records" in told.facts[-1].name


@pytest.mark.verify
def test_a_speed_is_kept() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    asked = {"probability": None, "impact_speed": 3.0, "exceedance": 0.01, "rel_error": 0.1}
    found, there = sized_by_hits(scene, **asked)
    limit = Limit("impact_speed", 3.0)
    with run_of(rel_error=0.05, seed=5) as run:
        again = exceedance(there, limit, MISSION, 0.0, run).chance
    assert_agrees(replace(again, standard_error=math.hypot(again.standard_error, 0.1 * 0.01)), 0.01)
    assert found.probability.value > 2.0 * 0.01


@pytest.mark.slow
def test_a_limit_far_above_every_impact_is_kept_by_the_smallest_clearances_that_are_tried() -> None:
    """Smaller ones may do as well, and a sweep says so."""
    pairs_of_it = (pair("x", "x", 4.0), pair("z", "z", 4.0))
    asked = {"probability": None, "impact_speed": 40.0, "mission": 20.0, "exceedance": 0.2}
    found = sized(uncoupled(*pairs_of_it), rel_error=0.5, **asked)
    assert found.kept_with is not None and found.shown_to_keep
    assert {c.lower for c in found.clearances.values()} == {0.0}
    assert "; less may be enough. " in found.verdict()
    assert found.to_dict()["kept_with"]["value"] <= 0.2
    for name, c in found.clearances.items():
        told = found[f"{name}.clearance"]
        assert told is not None and told.upper_95 == c.value
    # some windows cannot show that one mission in a million exceeds it: farther stops can
    rare = asked | {"exceedance": 1e-6, "budget": 10.0}
    farther = partial_result(sized, uncoupled(*pairs_of_it), rel_error=0.5, **rare)
    assert farther.shown_to_keep and "; less may be enough. " in farther.verdict()
    for name, c in farther.clearances.items():
        assert c.value > found.clearances[name].value


@pytest.mark.slow
def test_the_worst_case_of_pairs_is_sized_anew(both: Sizing) -> None:
    """A level scales every gap; the control is the clearance as stated."""
    table = worst_case(both, Tolerances(level_db=3.0), threads=1, budget=600.0).set_index("change")
    assert list(table.index) == [
        "as stated", "level -3 dB", "level +3 dB", "worst within all tolerances: level +3 dB",
    ]  # fmt: skip
    gain, worst = 10.0 ** (3.0 / 20.0), table.iloc[-1]
    for name, c in both.clearances.items():
        in_sigma = both.pairs.set_index("pair").loc[name, "clearance_in_sigma"]
        error = 4.5 * math.hypot(REL_ERROR, QUICK["rel_error"]) / in_sigma**2
        assert worst[name] == pytest.approx(gain * c.value, rel=error)
        assert worst[name] != pytest.approx(c.value, rel=error)
        assert table[name].max() == worst[name] and table.loc["as stated", name] == c.value
    assert worst["clearance_change"] == table["clearance_change"].max()


def test_each_pair_has_a_worst_row_of_its_own() -> None:
    rows = [
        {"change": "soft", "x": 2.0, "z": 1.0, "clearance_change": 0.1, "probability": 0.2,
         "note": ""},
        {"change": "loud", "x": 1.5, "z": 1.6, "clearance_change": 0.6, "probability": 0.1,
         "note": "rough"},
    ]  # fmt: skip
    last = _largest(rows[:1], rows[1:], ["x", "z"])
    assert last["change"] == "worst within all tolerances: soft (x); loud (z)"
    assert (last["x"], last["z"], last["clearance_change"]) == (2.0, 1.6, 0.6)
    assert (last["probability"], last["note"]) == (0.2, "rough")
    unknown = _largest([rows[0] | {"z": math.nan}], rows[1:], ["x", "z"])
    assert math.isnan(unknown["z"]) and unknown["change"].endswith("soft")


def test_a_stop_that_is_hit_for_certain_leaves_no_clearance_to_another() -> None:
    near = ImpactPair(name="z", on="z", upper=0.01, law=LAW)
    with pytest.raises(NotApplicable, match=r"the other stops .z. are hit with a probability of 1"):
        sized(uncoupled(pair("x", "x", 4.0), near), pair="x", mission=1e4)


test_what_is_not_sized = refusals(
    lambda scene, asked: size(scene, **(QUICK | asked)),
    (
        uncoupled(pair("x", "x", 4.0)),
        {"probability": None, "peak_acceleration": 9.0},
        "does not give a force .stops of x",
    ),
    (uncoupled(pair("x", "x", 4.0)), {"at": "z"}, "belongs to peak_acceleration"),
    (MOUNT, {"at": "x"}, "belongs to peak_acceleration"),
    (MOUNT, {"probability": None, "peak_acceleration": 9.0, "at": "y"}, "at must be one of x"),
    (uncoupled(), {}, "needs an impact_pair"),
    (uncoupled(pair("x", "x", 4.0)), {"pair": "y"}, "pair must name impact pairs .x., got y"),
    (MOUNT, {"pair": "x"}, "pair must name impact pairs .none., got x"),
    error=(NotApplicable, ValueError),
    pattern=True,
)


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_the_command_sizes_a_box(stochvi: Run, tmp_path: Path) -> None:
    scene = Path(__file__).parents[2] / "data" / "scenes" / "rigid-box.toml"
    options = ("--probability", "0.05", "--mission", "60", "--rel-error", "0.4")
    allowed = ("--tolerances", "frequency=5%,level=1dB")
    with mock.patch.object(sensitivity_module, "variations", lambda each: [("none", each.scene)]):
        done = stochvi(
            "size", scene, *options, *allowed, "--sensitivity", "--json", "-", "--out", tmp_path,
            "--budget", "600",
        )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    for each in (*document["clearances"].values(), document["probability"]):
        assert each["lower"] < each["value"] < each["upper"]
    assert set(document["clearances"]) == {"corner 1", "corner 2", "side"}
    made = document["made"]["corner 1"]["value"]
    assert f"Make {1e3 * made:.1f} mm at corner 1, " in done.err and "pair by pair" not in done.err
    page = (tmp_path / "report.html").read_text()
    assert "the largest of each column over the region" in page and "the box bounces" in page
    assert [mode["frequency_hz"] for mode in document["box"]["modes"]] == pytest.approx(
        load_scene(scene).structure.natural_frequency_hz.tolist()
    )
    tables = ("risk", "pairs", "required", "tolerances", "sensitivity")
    for name in (*(f"{each}.csv" for each in tables), "size.json"):
        assert (tmp_path / name).stat().st_size > 0
    (row,) = document["sensitivity"]
    assert set(document["clearances"]) < set(row)
    assert "one thing changed at a time" in done.err
    assert 'id="sensitivity"' in page


@pytest.mark.parametrize("hazard", [1e-6, 0.3, 5.0, 25.0])
def test_a_chance_next_to_one_has_an_interval(hazard: float) -> None:
    """Of 1000 paths: next to 1 the relative error of a hazard grows like 1 / (1 - P), beyond what a
    double holds."""
    hazards = hazard * np.array([0.5, 1.0, 2.0])
    values = np.minimum(-np.expm1(-hazards), KNOWN)
    errors = np.sqrt(values * (1.0 - values) / 1000.0) + 1e-4
    estimates = [Estimate(value=v, standard_error=e) for v, e in zip(values, errors, strict=True)]
    places = -np.log([0.4, 0.2, 0.1])
    family = mock.Mock(total=HazardCurve.of(places, estimates[::-1], MISSION))
    found = pairs.SharedRisk.chance(family, places[1])
    assert found.value == pytest.approx(values[1], rel=1e-6)
    assert 0.0 <= found.lower < found.value <= found.upper <= 1.0
    # where a probability and its complement are resolved, the interval is that of the estimate
    half = 1.959964 * errors[1]
    assert found.value - found.lower == pytest.approx(min(half, found.value), rel=1e-3)
    place, width = pairs.SharedRisk._place(family, found.value)
    assert place == pytest.approx(places[1], rel=1e-6) and math.isfinite(math.exp(width))


@pytest.mark.slow
def test_looks_are_never_rougher_than_a_simulation_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def counted(scene: Scene, overlap: float, run: SampledRun) -> None:
        asked.append(run.accuracy)
        raise NotApplicable("hits", ["enough was seen"])

    monkeypatch.setattr(search, "count_impacts", counted)
    with pytest.raises(NotApplicable, match="enough was seen"):
        size(uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0)), rate=0.2, rel_error=0.6)
    assert asked and max(asked) < 1.0


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_hits_that_the_budget_left_unknown_end_with_code_one(
    stochvi: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Path(__file__).parents[2] / "data" / "scenes" / "zoo" / "chain-two-pairs.toml"
    options = ("--probability", "5%", "--mission", "1000", "--rel-error", "0.4", "--json", "-")

    def outcome(reason: Exception) -> tuple[int, list[str]]:
        def none(*_: object, **__: object) -> None:
            raise reason

        monkeypatch.setattr(search, "count_impacts", none)
        done = stochvi("size", scene, *options)
        assert "not known" in " ".join(done.err.split())
        return done.code, one_document(done.out)["fell_short"]

    code, short = outcome(NotConverged("the budget of 5 s ended", None))
    assert code == 1 and "not known: the budget of 5 s ended" in short[0]
    # the control: what cannot be counted by nature is no lack of accuracy
    assert outcome(NotApplicable("hits", ["a law"])) == (0, [])


def test_the_page_of_a_box_states_its_profiles() -> None:
    """As the page of one mass does: the rms of each table beside that of its source."""
    box = load_scene(shipped_scene("rigid-box"))
    facts = excitations_section(box).facts
    assert [fact.name.split(" on ")[0] for fact in facts] == 3 * [
        "Tabulated noise", "Stated by its source", "Acceleration, recomputed"
    ]  # fmt: skip
    for stated, found in zip(facts[1::3], facts[2::3], strict=True):
        known, calculated = (float(fact.value.split()[0]) for fact in (stated, found))
        assert calculated == pytest.approx(known, rel=0.03)


def test_one_clearance_for_all_is_said_to_be_common(both: Sizing) -> None:
    """The risks of its pairs then differ: no page says that they are equal."""
    x = both.clearances["x"]
    stated = both.tolerances.iloc[:1]
    common = replace(both, clearances={"x": x, "z": x}, common=("x", "z"), tolerances=stated)
    common = replace(common, allowed=Tolerances())
    assert "at all 2 pairs in common, on each side" in common.verdict()
    page = sizing_page(common, origin_of(common.provenance))
    lead = page.sections[0].lead
    assert lead == "x, z have one clearance in common, so that their risks differ."
    assert "Environment" in [section.title for section in page.sections]
    assert "in common" not in both.verdict()
    equal = sizing_page(both, origin_of(both.provenance)).sections[0].lead
    assert equal.startswith("Pairs share the risk equally: each alone")
