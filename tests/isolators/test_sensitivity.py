"""What a sizing hangs on: scaling laws, and inputs that are not Gaussian."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    NotConverged,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
    screen,
)
from stochvi.isolators.sizing import risk_curve as hard
from stochvi.isolators.sizing import sensitivity as method
from stochvi.isolators.sizing import sensitivity as sensitivity_of_sizing
from stochvi.isolators.sizing.answer import Question, RoundedClearance, Sizing, Target
from stochvi.isolators.sizing.pairs import curve_of_gap
from stochvi.isolators.sizing.review import Balance
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.isolators.sizing.sensitivity import (
    KURTOSIS,
    fast_peaks,
    sensitivity,
    slow_bursts,
    variations,
    worst_case,
)
from stochvi.isolators.sizing.size import size
from stochvi.isolators.tolerances import (
    WORST,
    Change,
    Gaps,
    Region,
    SameRisk,
    Tolerances,
    all_applied,
    tolerance_table,
)
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.phases import changed_mount
from stochvi.scenes.scene import scene_from
from stochvi.testing.samples import assert_mean
from stochvi.verification.testing.judging import Z
from support.accuracies import quick_cases, run_of
from support.mounts import HOUR, ten_hertz, truck
from support.refusals import refusals

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
        return curve_of_gap(scene, *asked)

    monkeypatch.setattr(method, "curve_of_gap", fails_once)
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

    monkeypatch.setattr(method, "curve_of_gap", slow)
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

    monkeypatch.setattr(method, "curve_of_gap", late)
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
        curve = curve_of_gap(ten_hertz(0.05), ONE_PER_CENT, HOUR, run)
    clearance = 6.0 * curve.sigma
    shape = 3.0 / (kurtosis - 3.0)
    draws = np.random.default_rng(1).gamma(shape, 1.0 / shape, 20_000)
    rates = np.array([curve.first_rate(clearance / math.sqrt(m)) for m in draws])
    chance = slow_bursts(curve, clearance, kurtosis, HOUR)
    rate = -math.log1p(-chance) / HOUR
    assert_mean(rates, rate)
    assert rate > curve.first_rate(clearance)


# ------------------------------------------------------------------------------
# The largest clearances over all of a region of tolerances: against brute force over a grid.
# ------------------------------------------------------------------------------


PEAK = TabulatedNoise(
    frequency_hz=[5.0, 11.69, 11.7, 12.3, 12.31, 200.0],
    density=[5e-4, 5e-4, 0.05, 0.05, 5e-4, 5e-4],
    unit="g2/Hz",
)
MOUNT = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.05), excitations=[PEAK])
ALLOWED = Tolerances(frequency=0.1, damping=0.3, level_db=3.0)


def rms(frequency: float, zeta: float, points: int = 500) -> tuple[float, float]:
    """rms displacement and velocity of the mount on the peak, by the trapezoidal rule."""
    edges = itertools.pairwise(PEAK.frequency_hz)
    f = np.concatenate([np.geomspace(*edge, points) for edge in edges])
    density = np.exp(np.interp(np.log(f), np.log(PEAK.frequency_hz), np.log(PEAK.density)))
    w, wn = 2.0 * math.pi * f, 2.0 * math.pi * frequency
    gain = STANDARD_GRAVITY**2 * density / ((wn**2 - w**2) ** 2 + (2.0 * zeta * wn * w) ** 2)
    return math.sqrt(np.trapezoid(gain, f)), math.sqrt(np.trapezoid(w**2 * gain, f))


def test_a_resonance_that_meets_a_peak_is_found_inside_the_region() -> None:
    place = 0.0145
    nominal = rms(12.0, 0.05)

    def needed(frequency: float, damping: float, gain: float) -> float:
        s_x, s_v = rms(12.0 * (1.0 + frequency), 0.05 * (1.0 + damping))
        ratio = s_v * nominal[0] / (s_x * nominal[1])
        return gain * s_x * math.sqrt((place / nominal[0]) ** 2 + 2.0 * math.log(ratio))

    grid = {
        (f, d, g): needed(f, d, 10.0 ** (g / 20.0))
        for f in np.linspace(-0.1, 0.1, 81)
        for d in np.linspace(-0.3, 0.3, 7)
        for g in (-3.0, 0.0, 3.0)
    }
    region = Region(MOUNT, ALLOWED)
    same = SameRisk(nominal=region.nominal, stops=np.array([[place], [place]]))
    ((found, where),) = region.worst(same)
    most = max(grid.values())
    # the grid is 0.25 % of the frequency apart, where the maximum is flat
    assert most * (1.0 - 1e-3) <= found <= most * (1.0 + 2e-3)
    assert same(region.gaps(where))[0] == found
    # the control: no combination of ends needs half as much more than the truth is from it
    ends = [grid[f, d, g] for f in (-0.1, 0.1) for d in (-0.3, 0.3) for g in (-3.0, 3.0)]
    assert max(ends) < 0.7 * found


@pytest.mark.slow
def test_the_worst_case_is_sized_and_no_row_is_above_it() -> None:
    sizing = size(
        MOUNT, probability=0.01, mission=600.0, rel_error=0.2, tolerances=ALLOWED, threads=1
    )
    table = sizing.worst_case
    assert table is not None
    last = table.iloc[-1]
    assert last["clearance"] >= table["clearance"].max() > 1.3 * sizing.clearance.value
    assert last["change"].startswith(WORST)
    assert sizing.made is not None and sizing.made.value >= last["clearance"]
    assert sizing.verdict().startswith(f"Make {sizing.made} on each side")
    assert ALLOWED.in_words() in sizing.verdict()
    # a row that is not accurate is no promise
    rough = table.assign(note=["" for _ in range(len(table) - 1)] + ["the budget ended"])
    assert "was not shown as accurately" in replace(sizing, worst_case=rough).verdict()
    assert "was not shown" not in sizing.verdict()
    # brute force: a mount elsewhere in the region needs no more than what was found
    for frequency in (-0.02, 0.0):
        changes = [Change("frequency", frequency), Change("damping", -0.3), Change("level", 3.0)]
        other = size(
            all_applied(changes, MOUNT), probability=0.01, mission=600.0, rel_error=0.1, threads=1
        ).clearance
        assert other.lower <= 1.01 * last["clearance"]
        assert other.value > 0.9 * last["clearance"]


def test_tolerances_that_nobody_asked_for_are_not_applied() -> None:
    sizing = size(MOUNT, probability=0.01, mission=600.0, rel_error=0.4, threads=1)
    assert sizing.worst_case is None and Tolerances.of(MOUNT) == Tolerances()
    assert "tolerance" not in sizing.verdict() and "±" not in sizing.verdict()
    assert sizing.made is not None
    assert 0.0 <= sizing.made.value - sizing.clearance.value <= sizing.made.step


def box_on_a_peak() -> Scene:
    """The shipped box, whose modes meet narrow peaks within the tolerances of their frequencies."""
    box = load_scene(shipped_scene("rigid-box"))
    modes = box.structure.natural_frequency_hz  # type: ignore[union-attr]
    shaken = []
    for number, axis in ((0, "x"), (2, "z")):
        peak = 1.05 * float(modes[number])
        ends = [5.0, 0.97 * peak, 0.98 * peak, 1.02 * peak, 1.03 * peak, 300.0]
        densities = [1e-4, 1e-4, 0.02, 0.02, 1e-4, 1e-4]
        shaken.append(TabulatedNoise(frequency_hz=ends, density=densities, unit="g2/Hz", axis=axis))
    return box.replace(excitations=shaken, cross_densities=())


def scaled(box: Scene, frequency: float, damping: float) -> Scene:
    """The box with every mount stiffer and every damper stronger, key by key."""
    keys = box.document()
    for mount in keys["structure"]["mount"]:
        mount["stiffness"] = [k * (1.0 + frequency) ** 2 for k in mount["stiffness"]]
        for name, factor in (("zeta", 1.0 + damping), ("loss_factor", 1.0 + damping)):
            if name in mount:
                mount[name] *= factor
        if "damping" in mount:
            mount["damping"] = [c * (1.0 + frequency) * (1.0 + damping) for c in mount["damping"]]
    return scene_from(keys)


def test_each_pair_of_a_box_has_its_own_worst_place() -> None:
    box, allowed = box_on_a_peak(), Tolerances(frequency=0.1, damping=0.3)
    names = list(screen(box).impact_pairs)
    before = screen(box).impact_pairs
    places = np.array([5.0 * before[name].displacement_std for name in names])
    rows, worst_at = tolerance_table(box, allowed, np.array([places, places]), [0, 1, 2], 0.01)
    table = pd.DataFrame(rows)
    rows, last = table.iloc[:-1], table.iloc[-1]
    assert last["change"] == WORST and set(worst_at) == set(names)

    def needed(frequency: float, damping: float) -> list[float]:
        after = screen(scaled(box, frequency, damping)).impact_pairs
        found = []
        for name, place in zip(names, places, strict=True):
            old, new = before[name], after[name]
            rates = new.velocity_std * old.displacement_std
            rates /= old.velocity_std * new.displacement_std
            level = math.sqrt((place / old.displacement_std) ** 2 + 2.0 * math.log(rates))
            found.append(new.displacement_std * level + abs(new.mean - old.mean))
        return found

    shares = itertools.product(np.linspace(-0.1, 0.1, 21), (-0.3, 0.0, 0.3))
    grid = np.array([needed(f, d) for f, d in shares])
    for k, name in enumerate(names):
        assert last[name] >= rows[name].max()
        # the grid is 1 % of the frequency apart, a fifth of the resonance
        assert 0.999 * grid[:, k].max() <= last[name] <= 1.03 * grid[:, k].max()
    # the control: no one place is the worst of all pairs
    assert np.all((grid < 0.98 * grid.max(axis=0)).any(axis=1))


@pytest.mark.slow
def test_a_mount_that_hangs_elsewhere_moves_towards_its_stops() -> None:
    """A load does not move with the mount: what the equilibrium moves by adds to the clearance."""
    mount = Scene(
        structure=Isolator(frequency_hz=10.0, zeta=0.2, mass=1.0, gravity=True),
        excitations=[WhiteNoise(density=0.01, unit="g2/Hz")],
    )
    floating = mount.replace(structure=mount.structure.replace(gravity=False))
    allowed = Tolerances(frequency=0.05)
    asked = {"probability": 0.05, "mission": 600.0, "rel_error": 0.1, "threads": 1}
    hung, free = (
        worst_case(size(each, **asked), allowed, threads=1).set_index("change")  # type: ignore[arg-type]
        for each in (mount, floating)
    )
    sag = STANDARD_GRAVITY / (2.0 * math.pi * 10.0) ** 2
    moved = abs(sag / 0.95**2 - sag)
    row = "natural frequency -5 %"
    assert hung.loc[row, "clearance"] - free.loc[row, "clearance"] == pytest.approx(moved, rel=1e-6)
    assert hung.loc[row, "probability"] > 1.05 * free.loc[row, "probability"]


def test_a_stop_that_the_equilibrium_leaves_needs_less() -> None:
    load = ConstantLoad(force=0.5)
    loaded = Scene(
        structure=Isolator(frequency_hz=1.0, zeta=0.1, mass=1.0),
        excitations=[WhiteNoise(density=0.001, unit="g2/Hz"), load],
    )
    region = Region(loaded, Tolerances(frequency=0.1))
    soft = region.gaps([Change("frequency", -0.1)])
    shift = float(soft.mean[0] - region.nominal.mean[0])
    assert shift == pytest.approx(0.5 / (2.0 * math.pi) ** 2 * (0.9**-2 - 1.0))
    upper, lower, both = (
        SameRisk(nominal=region.nominal, stops=np.array(stops))(soft)[0]
        for stops in ([[math.inf], [0.1]], [[0.1], [math.inf]], [[0.1], [0.1]])
    )
    assert upper - lower == pytest.approx(2.0 * shift) and both == upper


def test_a_limit_of_speed_needs_more_where_hits_are_faster() -> None:
    """Crossings at +3 dB that are as fast as the limit: exp(-c^2 / 2 s^2 - w^2 / 2 s_v^2)."""
    region = Region(MOUNT, Tolerances(level_db=3.0))
    place, harm = 0.012, 1e-3
    same = SameRisk(nominal=region.nominal, stops=np.array([[place], [place]]), harm=harm)
    loud = region.gaps([Change("level", 3.0)])
    (found,) = same(loud)
    old, new = region.nominal, loud
    speed = old.speed[0] * math.sqrt(-2.0 * math.log(harm))

    def seldom(clearance: float, gaps: object) -> float:
        sigma, fast = gaps.sigma[0], gaps.speed[0]  # type: ignore[attr-defined]
        return 0.5 * (clearance / sigma) ** 2 + 0.5 * (speed / fast) ** 2

    assert seldom(found, new) == pytest.approx(seldom(place, old), rel=1e-9)
    (hits,) = SameRisk(nominal=old, stops=same.stops)(loud)
    assert hits == pytest.approx(place * 10.0 ** (3.0 / 20.0)) and found > 1.15 * hits


def test_pairs_in_common_need_what_keeps_the_crossings_of_all() -> None:
    """A quiet pair far inside a common clearance does not govern it, however much its motion
    grows; the sum of Rice's rates is the same before and after."""
    sigma, rate = np.array([1.0e-3, 0.9e-3, 1.0e-4]), np.array([12.0, 15.0, 20.0])
    shift = np.array([2e-4, -1e-4, 0.0])
    before = Gaps(sigma, rate, np.zeros(3))
    after = Gaps(sigma * [1.3, 1.4, 3.0], rate * 0.9, shift)
    stops = np.full((2, 3), 5e-3)
    found = SameRisk(nominal=before, stops=stops, common=[0, 1, 2])(after)
    assert np.ptp(found) == 0.0

    def crossings(gaps: Gaps, clearance: float) -> float:
        upper, lower = clearance - gaps.mean, clearance + gaps.mean
        each = np.exp(-0.5 * (upper / gaps.sigma) ** 2) + np.exp(-0.5 * (lower / gaps.sigma) ** 2)
        return float(gaps.rate @ each)

    assert crossings(after, found[0]) == pytest.approx(crossings(before, 5e-3), rel=1e-9)
    # the control: each for itself, the quiet pair would take three times the clearance
    alone = SameRisk(nominal=before, stops=stops)(after)
    assert alone[2] == pytest.approx(3.0 * 5e-3, rel=0.01) and found[0] < alone[:2].max()
    # one stop each, and the same pair twice: as each alone
    twice = Gaps(*(np.repeat(each[:1], 2) for each in (sigma, rate, np.zeros(1))))
    louder = twice._replace(sigma=1.5 * twice.sigma)
    one_sided = np.array([[np.inf, np.inf], [5e-3, 5e-3]])
    same = SameRisk(nominal=twice, stops=one_sided, common=[0, 1])(louder)
    assert same == pytest.approx(SameRisk(nominal=twice, stops=one_sided)(louder), rel=1e-9)


def test_a_region_that_was_not_searched_is_not_answered() -> None:
    region = Region(MOUNT, ALLOWED)
    same = SameRisk(nominal=region.nominal, stops=np.array([[0.01], [0.01]]))
    with pytest.raises(NotConverged, match="before the tolerances were searched"):
        region.worst(same, Deadline.after(0.0))
    sizing = size(MOUNT, probability=0.05, mission=60.0, rel_error=0.4, threads=1)
    last = worst_case(sizing, ALLOWED, threads=1, budget=1e-6).iloc[-1]
    assert math.isnan(last["clearance"]) and "raise budget" in last["note"]


# ------------------------------------------------------------------------------
# Worst cases over tolerances, probabilities of hard impacts, and the judgement of balances.
# ------------------------------------------------------------------------------


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

    monkeypatch.setattr(sensitivity_of_sizing, "nominal_sizing", sized)
    target = Target(name="rate", value=0.1, unit="1/s")
    mount = Isolator(frequency_hz=10.0, zeta=0.2, frequency_tolerance=0.1)
    scene = sizing.scene.replace(structure=mount)
    with run_of(rel_error=0.5, seed=1) as run:
        again = sensitivity_of_sizing.Resizing(sizing=replace(sizing, target=target), run=run)
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
        curve = curve_of_gap(changed, sizing.target, MISSION, run)
    assert last["clearance"] == pytest.approx(curve.clearance(0.05).value, rel=1e-9)
    assert last["probability"] == pytest.approx(curve.probability(sizing.clearance.value), rel=1e-9)


def test_a_case_without_time_is_a_row_that_says_so(sizing: Sizing) -> None:
    table = worst_case(sizing, Tolerances(level_db=1.0), threads=1, budget=1e-6)
    missing = table[table["clearance"].isna()]
    assert len(missing) and all("raise budget" in note for note in missing["note"])


test_tolerances_have_their_ranges = refusals(
    Tolerances,
    ({"frequency": 1.0}, "tolerance of frequency must be in [0, 1)"),
    ({"level_db": -1.0}, "tolerance of level must be in"),
    error=ValueError,
)


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
