"""What a sizing hangs on: scaling laws, and inputs that are not Gaussian."""

import math
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    Elastic,
    Isolator,
    NotApplicable,
    NotConverged,
    Restitution,
    Scene,
    TabulatedNoise,
)
from stochvi.isolators.sizing import sensitivity as method
from stochvi.isolators.sizing.answer import Sizing, Target
from stochvi.isolators.sizing.method import size
from stochvi.isolators.sizing.one_curve import risk_curve
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.isolators.sizing.sensitivity import (
    KURTOSIS,
    fast_peaks,
    sensitivity,
    slow_bursts,
    variations,
)
from stochvi.results.deadline import Deadline
from stochvi.sampling.run import Run
from stochvi.verification.testing.agreement import Z
from support.accuracies import quick_cases
from support.mounts import HOUR, ten_hertz, truck
from support.runs import run_of

ONE_PER_CENT = Target(name="probability", value=0.01, unit="1")


@pytest.fixture(scope="module")
def on_a_truck() -> tuple[Sizing, pd.DataFrame]:
    sizing = size(truck(Restitution(coefficient=0.5)), probability=0.01, seed=1, rel_error=0.1)
    return sizing, sensitivity(sizing, seed=1).set_index("change")


@pytest.mark.slow
def test_a_level_scales_the_clearance(on_a_truck: tuple[Sizing, pd.DataFrame]) -> None:
    sizing, table = on_a_truck
    assert table.loc["none", "clearance_change"] == pytest.approx(0.0, abs=1e-3)
    for level in (-3.0, 3.0):
        # the same random numbers, so that only the grid of levels is scaled with it
        factor = 10.0 ** (level / 20.0)
        assert table.loc[f"level {level:+.0f} dB", "clearance"] == pytest.approx(
            factor * table.loc["none", "clearance"], rel=1e-6
        )
    chances = table["probability"]
    assert chances["level -3 dB"] < 0.01 < chances["level +3 dB"]
    assert chances["damping ratio +30 %"] < 0.01 < chances["damping ratio -30 %"]
    assert chances["natural frequency +10 %"] < 0.01 < chances["natural frequency -10 %"]
    assert chances["none"] == pytest.approx(0.01, rel=0.1)
    assert sizing.clearance.value == pytest.approx(table.loc["none", "clearance"], rel=1e-3)


@pytest.mark.slow
def test_a_case_that_fails_is_a_row_that_says_so(
    on_a_truck: tuple[Sizing, pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    sizing, known = on_a_truck
    first = list(islice(variations(sizing), 4))
    tried: list[Scene] = []

    def fails_once(scene: Scene, *asked: Any) -> RiskCurve:
        tried.append(scene)
        if len(tried) == 3:
            raise NotConverged("the budget of 1 s ended in this case")
        return risk_curve(scene, *asked)

    monkeypatch.setattr(method, "risk_curve", fails_once)
    monkeypatch.setattr(method, "variations", lambda _sizing: first)
    monkeypatch.setattr(method, "_not_gaussian", lambda *_how: [])
    table = sensitivity(sizing, seed=1).set_index("change")
    (failed,) = table.index[table["note"] != ""]
    assert table.loc[failed, "note"] == "the budget of 1 s ended in this case"
    assert math.isnan(table.loc[failed, "clearance"])
    assert len(table) == 4
    pd.testing.assert_frame_equal(table.drop(failed), known.loc[table.index].drop(failed))
    assert not known["note"].any()


def test_no_case_is_begun_once_the_budget_has_ended(
    on_a_truck: tuple[Sizing, pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    sizing, _ = on_a_truck
    now, budgets = [0.0], []
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def slow(scene: Scene, target: Target, mission: float, run: Run) -> RiskCurve:
        budgets.append(run.deadline.left)
        now[0] += 4.0
        raise NotConverged("late")

    monkeypatch.setattr(method, "risk_curve", slow)
    table = sensitivity(sizing, seed=1, budget=7.0)
    assert len(budgets) == 2 and sum(budgets) < 7.0
    assert list(table["note"][:2]) == ["late", "late"]
    assert all("the budget of 7 s ended before this case" in note for note in table["note"][2:])


def test_no_case_is_begun_in_less_time_than_a_case_takes(
    on_a_truck: tuple[Sizing, pd.DataFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shares of little time used to be handed out, which every case overran."""
    sizing, _ = on_a_truck
    now = [0.0]
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def late(*_: Any) -> RiskCurve:
        now[0] += method.LEAST_SECONDS
        raise NotConverged("late")

    monkeypatch.setattr(method, "risk_curve", late)
    cases = sensitivity(sizing, seed=1, budget=3.5 * method.LEAST_SECONDS)["note"]
    assert list(cases[:3]) == ["late"] * 3 and now[0] == pytest.approx(3.0 * method.LEAST_SECONDS)
    assert all("before this case" in note for note in cases[3:])


def test_mounts_and_laws_are_varied_however_they_are_given() -> None:
    sizing = size(truck(Elastic(stiffness=1e5)), rate=0.3, rel_error=0.2, seed=1)
    varied = dict(variations(sizing))
    stiffer = varied["stiffness of the stops x 2"].impact_pairs[0].law
    assert isinstance(stiffer, Elastic) and stiffer.stiffness == 2e5
    old = sizing.scene.structure
    for key, frequency, damping in (
        ("natural frequency -10 %", 0.9, 1.0),
        ("damping ratio +30 %", 1.0, 1.3),
    ):
        new = varied[key].structure
        assert new.omega == pytest.approx(frequency * old.omega)
        assert new.damping_rate == pytest.approx(frequency * damping * old.damping_rate)


def test_a_mount_lets_little_of_fast_peaks_through() -> None:
    scene = truck(Restitution(coefficient=0.5))
    gaussian = fast_peaks(scene, 3.0, seed=2, records=4)
    assert abs(gaussian.response_kurtosis - 3.0) < Z * gaussian.standard_error
    well_damped = scene.model_copy(update={"structure": Isolator(frequency_hz=12.0, zeta=0.3)})
    peaked = fast_peaks(well_damped, KURTOSIS, seed=2, records=20)
    assert peaked.input_kurtosis > 4.5
    assert peaked.response_kurtosis - 3.0 > Z * peaked.standard_error
    assert peaked.response_kurtosis < 3.3
    with pytest.raises(NotApplicable, match="excitation must hold a table"):
        fast_peaks(ten_hertz(0.05), KURTOSIS)


def test_fast_peaks_end_with_the_records_that_there_are_when_the_budget_ends() -> None:
    scene = truck(Restitution(coefficient=0.5))
    late = fast_peaks(scene, 5.0, seed=1, deadline=Deadline(0.0))
    assert late == fast_peaks(scene, 5.0, seed=1, records=2)
    assert late != fast_peaks(scene, 5.0, seed=1, records=3)


def test_a_wide_mount_lets_them_through() -> None:
    """Negative control: a stiff mount follows the input, kurtosis and all."""
    scene = truck(Restitution(coefficient=0.5))
    slow = TabulatedNoise(frequency_hz=[0.5, 2.0], density=[0.01, 0.01], unit="g2/Hz")
    peaked = fast_peaks(
        scene.model_copy(update={"excitations": (slow,)}), KURTOSIS, seed=2, records=4
    )
    assert peaked.response_kurtosis == pytest.approx(peaked.input_kurtosis, rel=0.02)


@quick_cases("kurtosis", [3.02, 3.5, 5.0], keep=(1,))
def test_slow_bursts_are_a_mean_over_a_gamma_law(kurtosis: float) -> None:
    with run_of(rel_error=0.05, seed=1) as run:
        curve = risk_curve(ten_hertz(0.05), ONE_PER_CENT, HOUR, run)
    clearance = 6.0 * curve.sigma
    shape = 3.0 / (kurtosis - 3.0)
    draws = np.random.default_rng(1).gamma(shape, 1.0 / shape, 20_000)
    rates = np.array([curve.first_rate(clearance / math.sqrt(m)) for m in draws])
    chance = slow_bursts(curve, clearance, kurtosis, HOUR)
    rate = -math.log1p(-chance) / HOUR
    assert abs(rates.mean() - rate) < Z * rates.std() / math.sqrt(len(rates))
    assert rate > curve.first_rate(clearance)
