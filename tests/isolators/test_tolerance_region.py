"""The largest clearances over all of a region of tolerances: against brute force over a grid."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi import ConstantLoad, Isolator, Scene, TabulatedNoise, WhiteNoise, load_scene, screen
from stochvi.isolators import size
from stochvi.isolators.sizing.changes import WORST, Change, Tolerances, all_applied
from stochvi.isolators.sizing.tolerance_region import Gaps, Region, SameRisk, tolerance_table
from stochvi.isolators.sizing.worst_case import worst_case
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotConverged
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import scene_from

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
    assert sizing.verdict().startswith(f"clearance: {sizing.made} per side")
    assert ALLOWED.in_words() in sizing.verdict()
    # a row that is not accurate is no promise
    rough = table.assign(note=["" for _ in range(len(table) - 1)] + ["the budget ended"])
    assert "was not shown to keep" in replace(sizing, worst_case=rough).verdict()
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
    table, worst_at = tolerance_table(box, allowed, np.array([places, places]), [0, 1, 2], 0.01)
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
