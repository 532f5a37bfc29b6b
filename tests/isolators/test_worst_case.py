"""Worst cases over tolerances, probabilities of hard impacts, and the judgement of balances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stochvi import Elastic, ImpactPair, Isolator, Restitution, Scene, WhiteNoise
from stochvi.isolators import size
from stochvi.isolators.sizing import exceedances as hard
from stochvi.isolators.sizing import sensitivity
from stochvi.isolators.sizing.answer import RoundedClearance, Sizing, Target
from stochvi.isolators.sizing.changes import WORST, Tolerances
from stochvi.isolators.sizing.one_curve import risk_curve
from stochvi.isolators.sizing.question import Question
from stochvi.isolators.sizing.review import Balance
from stochvi.isolators.sizing.worst_case import worst_case
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes.changed_mounts import changed_mount
from support.runs import run_of

NOISE = WhiteNoise(density=0.01, unit="g2/Hz")
MISSION = 600.0


@pytest.fixture(scope="module")
def sizing() -> Sizing:
    mount = Isolator(frequency_hz=10.0, zeta=0.2)
    scene = Scene(structure=mount, excitations=[NOISE])
    return size(scene, probability=0.05, mission=MISSION, rel_error=0.1, threads=1)


def test_a_changed_scene_is_sized_without_its_tolerances(
    sizing: Sizing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else each row would look for a worst case of its own, and each row of that one again."""
    asked: list[object] = []

    def sized(scene: Scene, question: Question) -> Sizing:
        asked.append(question.tolerances)
        raise NotApplicable("size", ["it is not sized here"])

    monkeypatch.setattr(sensitivity, "nominal_sizing", sized)
    target = Target(name="rate", value=0.1, unit="1/s")
    mount = Isolator(frequency_hz=10.0, zeta=0.2, frequency_tolerance=0.1)
    scene = sizing.scene.replace(structure=mount)
    with run_of(rel_error=0.5, seed=1) as run:
        again = sensitivity.Resizing(sizing=replace(sizing, target=target), run=run)
        assert "not sized here" in again.row("none", scene, run)["note"]
    assert asked == [Tolerances()]
    assert Tolerances.of(scene) != Tolerances()


def test_the_worst_level_scales_the_clearance(sizing: Sizing) -> None:
    """Linear until the first impact: a level raised by 2 dB takes a clearance 10^0.1 times
    larger."""
    table = worst_case(sizing, Tolerances(frequency=0.0, damping=0.0, level_db=2.0), threads=1)
    assert table["change"].tolist() == [
        "as stated", "level -2 dB", "level +2 dB", f"{WORST}: level +2 dB"
    ]  # fmt: skip
    quiet, loud, worst = 1.0 + table["clearance_change"].iloc[1:]
    # one part of a curve may be interpolated elsewhere than another
    assert loud == worst == pytest.approx(10.0**0.1, rel=1e-2)
    assert quiet == pytest.approx(10.0**-0.1, rel=1e-2)


@pytest.mark.slow
def test_the_worst_combination_is_a_scene_of_its_own(sizing: Sizing) -> None:
    table = worst_case(sizing, Tolerances(frequency=0.05, damping=0.2, level_db=1.0), threads=1)
    last = table.iloc[-1]
    assert last["change"].endswith("natural frequency -5 %, damping ratio -20 %, level +1 dB")
    assert last["clearance"] > table["clearance"].iloc[:-1].max()
    changed = changed_mount(sizing.scene, 0.95, 0.8).at_level(1.0)
    with run_of(rel_error=0.1, seed=sizing.seed) as run:
        curve = risk_curve(changed, sizing.target, MISSION, run)
    assert last["clearance"] == pytest.approx(curve.clearance(0.05).value, rel=1e-9)
    assert last["probability"] == pytest.approx(curve.probability(sizing.clearance.value), rel=1e-9)


def test_a_case_without_time_is_a_row_that_says_so(sizing: Sizing) -> None:
    table = worst_case(sizing, Tolerances(level_db=1.0), threads=1, budget=1e-6)
    missing = table[table["clearance"].isna()]
    assert len(missing) and all("raise budget" in note for note in missing["note"])


@pytest.mark.parametrize(
    ("stated", "sentence"),
    [({"frequency": 1.0}, r"tolerance of frequency must be in \[0, 1\)"),
     ({"level_db": -1.0}, "tolerance of level must be in")],
)  # fmt: skip
def test_tolerances_have_their_ranges(stated: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Tolerances(**stated)


def test_the_tolerances_of_the_scene_stand_unless_others_are_stated() -> None:
    mount = Isolator(frequency_hz=10.0, zeta=0.2, frequency_tolerance=0.04)
    scene = Scene(structure=mount, excitations=[NOISE])
    assert Tolerances.of(scene).frequency == 0.04
    assert Tolerances.of(scene, frequency=0.02).frequency == 0.02


# Probabilities of hard impacts ------------------------------------------------------------


def chances(clearance: float, **asked: object) -> pd.DataFrame:
    pair = ImpactPair(clearance=1.0, law=Restitution(coefficient=0.5))
    mount = Isolator(frequency_hz=10.0, zeta=0.2)
    scene = Scene(structure=mount, impact_pairs=[pair], excitations=[NOISE])
    return hard.exceedances(scene, [clearance], MISSION, threads=1, budget=5.0, **asked)


def test_any_speed_at_all_is_the_chance_of_a_hit(sizing: Sizing) -> None:
    """First crossings, which know no impact, give the probability of any impact; so does a limit of
    0."""
    table = chances(sizing.clearance.value, marks=[1e-9])
    (row,) = table[table["mark"]].to_dict("records")
    assert row["by"] == "bursts" and row["event"] == "impact_speed"
    assert row["probability_low"] <= 0.05 <= row["probability_high"]
    # the control: a mission twice as long is another probability
    assert not row["probability_low"] <= 1.0 - 0.95**2 <= row["probability_high"]
    falling = table.sort_values("limit")["probability"]
    assert falling.is_monotonic_decreasing and falling.iloc[-1] < 0.2 * falling.iloc[0]


@pytest.mark.slow
def test_bursts_and_windows_agree(sizing: Sizing, monkeypatch: pytest.MonkeyPatch) -> None:
    place, limit = 3.6 * sizing.sigma, 0.3 * sizing.screening.velocity_std
    (burst,) = chances(place, marks=[limit]).query("mark").to_dict("records")

    def none(*_: object, **__: object) -> None:
        raise NotApplicable("bursts", ["not now"])

    monkeypatch.setattr(hard, "bursts", none)
    (window,) = chances(place, marks=[limit]).query("mark").to_dict("records")
    assert (burst["by"], window["by"]) == ("bursts", "windows")

    def hazards(row: dict[str, float]) -> list[float]:
        names = ("probability", "probability_low", "probability_high")
        return [-math.log1p(-min(row[name], 1.0 - 1e-12)) for name in names]

    one, other = hazards(burst), hazards(window)
    error = np.hypot(one[2] - one[1], other[2] - other[1]) / (2.0 * 1.96)
    assert abs(one[0] - other[0]) <= 4.5 * error
    assert abs(1.6 * one[0] - other[0]) > 4.5 * error


def test_only_contacts_count_among_the_accelerations_of_windows() -> None:
    """A window without an impact has none, and each with an impact has at least that of the spring
    at the stop."""
    natural = 20.0 * math.pi
    mount = Isolator(frequency_hz=10.0, zeta=0.2, mass=1.0)
    stops = ImpactPair(clearance=0.004, law=Elastic(stiffness=100.0 * natural**2))
    scene = Scene(structure=mount, impact_pairs=[stops], excitations=[NOISE])
    speeds, sharpest = (
        hard.window_sampler(scene, event, 1.0, 1).simulate(0, 64)[0, 0]
        for event in ("impact_speed", "peak_acceleration")
    )
    touched = speeds > 0.0
    assert 8 < touched.sum() < 56
    np.testing.assert_array_equal(sharpest > 0.0, touched)
    assert sharpest[touched].min() > natural**2 * 0.004


def test_limits_that_no_hit_reaches_give_way_to_those_that_hits_reach(sizing: Sizing) -> None:
    table = chances(sizing.clearance.value, marks=[1e3])
    assert 1e3 not in set(table["limit"]) and table["mark"].any()


# Rounding and balances --------------------------------------------------------------------


@pytest.mark.parametrize("clearance", [3.088e-3, 4.9e-3, 0.31234e-3, 1.9999e-3, 2e-6, 0.7])
def test_a_clearance_is_rounded_up_and_by_little(clearance: float) -> None:
    made = RoundedClearance.of(clearance)
    assert clearance * (1.0 - 1e-8) <= made.value <= clearance + made.step
    assert made.step <= min(1e-4, 0.05 * clearance) * (1.0 + 1e-9)


def test_a_balance_is_judged_by_its_errors() -> None:
    def passed(value: float, bias: float) -> bool:
        residual = Estimate(value=value, standard_error=6.4e-7, bias=bias)
        return Balance.of("energy", "recommended", residual).passed

    assert passed(1.8e-6, 0.0) and passed(4e-6, 2e-6)
    assert not passed(4e-6, 0.0)
