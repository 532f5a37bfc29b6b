"""Impact clusters on several pairs of a structure, against counting impacts in long paths, and the
largest accelerations in contacts against a plain integration."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stochvi import Elastic, ImpactPair, Matrices, NotApplicable, Restitution, Scene, WhiteNoise
from stochvi.engine.impact_log import COLUMNS, Log
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.methods.monte_carlo.gap_response import with_tables
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.statistics.bursts import Bursts, bursts
from stochvi.statistics.pair_crossings import PairMotion
from stochvi.statistics.structure_hits import (
    Limit,
    exceedance,
    outputs_of,
    widening_of,
    windows,
)
from stochvi.testing import assert_agrees
from support.boxes import PLACES, box, scene_with
from support.pairs import LAW, diagonal, pair, uncoupled
from support.runs import run_of

RIGID = {"kind": "restitution", "coefficient": 0.4}
RUBBER = {"kind": "viscoelastic", "stiffness": 2e5, "damping_ratio": 0.3}


def snubbed(
    reach: float, law: dict[str, Any], corners: int, sides: tuple[str, ...] = ("lower", "upper")
) -> Scene:
    """A box without symmetry under three tables, with snubbers at some of its corners, each at so
    many standard deviations of its gap."""
    pairs: list[dict[str, Any]] = [
        {"name": f"corner {k}", "at": list(place), "direction": [0.3, 0.2, 1.0], "law": law}
        for k, place in enumerate(PLACES[:corners])
    ]
    free = scene_with(box(), [each | {"clearance": 1.0} for each in pairs])
    sigma = PairMotion(model_of(free)).displacement_std
    for each, std in zip(pairs, sigma.tolist(), strict=True):
        each |= {side: (1.0 if side == "upper" else -1.0) * reach * std for side in sides}
    return scene_with(box(), pairs)


def masses() -> Scene:
    """Two masses under white noise, with a stop between them and stops that differ by side."""
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"),
            mass=diagonal(1.0, 0.5),
            damping=[[0.25, -0.05], [-0.05, 0.2]],
            stiffness=[[2.0, -1.0], [-1.0, 1.5]],
        ),
        impact_pairs=[
            ImpactPair(name="left", on="x", lower=-1.9, upper=2.1, law=LAW),
            ImpactPair(name="apart", between=("x", "z"), upper=1.4, law=Restitution(coefficient=1)),
        ],
        excitations=[WhiteNoise(intensity=0.2, on="x"), WhiteNoise(intensity=0.05, on="z")],
    )


SCENES = {
    "two masses": masses,
    "rubber at one side": lambda: snubbed(4.1, RUBBER, 2, ("upper",)),
    "eight rigid snubbers": lambda: snubbed(4.3, RIGID, 8),
    "rubber snubbers": lambda: snubbed(4.2, RUBBER, 4),
}


def counted(scene: Scene, paths: int) -> dict[str, tuple[float, float]]:
    """Impacts per second of each pair in long paths of the whole motion, with the standard
    error."""
    plan = make_plan(model_of(scene), None, None, None)
    parts = [plan.averages(11, first, plan.block) for first in range(0, paths, plan.block)]
    averages = np.concatenate(parts, axis=1)
    rows = plan.layout.rows
    found = {}
    for each in scene.impact_pairs:
        rates = sum(averages[rows.index((each.name, f"n_{side}"))] for side in ("lower", "upper"))
        found[each.name] = float(rates.mean()), float(rates.std(ddof=1) / math.sqrt(len(rates)))
    return found


def assert_as_counted(found: Bursts, known: dict[str, tuple[float, float]]) -> None:
    assert found.apart
    for name, (rate, error) in known.items():
        own = found.hit_rate(name)
        print(name, own, rate, error)
        both = replace(own, standard_error=math.hypot(own.standard_error, error))
        assert_agrees(both, rate)


@pytest.mark.parametrize(
    ("name", "rel_error", "paths"),
    [
        ("two masses", 0.1, 256),
        # impacts of the two masses are rarest, and of theirs the fewest are not first ones
        *(
            pytest.param(
                name, 0.03, 2**17 if name == "two masses" else 2048, marks=pytest.mark.verify
            )
            for name in SCENES
        ),
    ],
)
def test_rates_of_hits_agree_with_counting(name: str, rel_error: float, paths: int) -> None:
    scene = SCENES[name]()
    found = bursts(scene, rel_error=rel_error, seed=3, budget=None)
    known = counted(scene, paths)
    assert_as_counted(found, known)
    if rel_error < 0.1:
        # impacts cluster: their number is not that of first impacts
        total = sum(rate for rate, _ in known.values())
        error = math.hypot(*(error for _, error in known.values()))
        first = found.first_rate
        first = replace(first, standard_error=math.hypot(first.standard_error, error))
        with pytest.raises(AssertionError):
            assert_agrees(first, total)


@pytest.mark.verify
def test_uncoupled_pairs_have_the_bursts_of_one_oscillator() -> None:
    """Two oscillators that know nothing of each other, one of which is hit a thousand times more
    seldom: the rates of each are those of it alone."""
    both = bursts(uncoupled(pair("x", "x", 4.0), pair("z", "z", 5.5)), rel_error=0.05, seed=1)
    alone = {
        name: bursts(uncoupled(pair(name, name, reach)), rel_error=0.05, seed=2)
        for name, reach in (("x", 4.0), ("z", 5.5))
    }
    for name, found in alone.items():
        for own, known in (
            (both.hit_rate(name), found.hit_rate()),
            (both.impact_speed_mean(name), found.impact_speed_mean()),
        ):
            error = math.hypot(own.standard_error, known.standard_error)
            bias = (own.bias or 0.0) + (known.bias or 0.0)
            assert_agrees(replace(own, standard_error=error, bias=bias), known.value)
    with pytest.raises(AssertionError):
        assert_agrees(both.hit_rate("x"), alone["z"].hit_rate().value)


@pytest.mark.verify
def test_fast_first_hits_drawn_more_often_change_no_expectation() -> None:
    """The rate of clusters beyond a speed that few reach, against first impacts drawn as they
    come."""
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    plain = bursts(scene, rel_error=0.03, seed=4).exceedance_rate("impact_speed", 4.0)
    wide = bursts(scene, rel_error=0.1, seed=5, widening=2.0)
    found = wide.exceedance_rate("impact_speed", 4.0)
    error = math.hypot(found.standard_error, plain.standard_error)
    assert_agrees(replace(found, standard_error=error), plain.value)
    forgotten = replace(wide, weight=np.ones_like(wide.weight))
    with pytest.raises(AssertionError):
        assert_agrees(forgotten.exceedance_rate("impact_speed", 4.0), plain.value)


@pytest.mark.verify
def test_windows_of_the_whole_motion_and_bursts_say_the_same() -> None:
    scene = SCENES["rubber at one side"]()
    limit = Limit("peak_acceleration", 45.0, outputs_of(scene, "z"))
    asked: dict[str, Any] = {"rel_error": 0.15, "seed": 6, "budget": None}
    with run_of(rel_error=0.15, seed=6) as run:
        by_bursts = exceedance(scene, limit, 60.0, 0.0, run)
        harder = exceedance(scene, limit._replace(value=100.0), 60.0, 0.0, run).chance
    whole = windows(scene, limit, 60.0, **asked)
    assert (by_bursts.way, whole.way) == ("bursts", "windows")
    print(by_bursts, whole)
    one, other = by_bursts.chance, whole.chance
    error = math.hypot(one.standard_error, other.standard_error)
    assert_agrees(replace(one, standard_error=error), other.value)
    with pytest.raises(AssertionError):
        assert_agrees(replace(harder, standard_error=error), other.value)


def test_the_largest_acceleration_is_that_of_a_plain_integration() -> None:
    """Two masses on a base and two springs as stops, along a motion without stops that is given."""
    scene = Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=diagonal(1.0, 0.5),
            damping=[[0.3, -0.1], [-0.1, 0.2]], stiffness=[[30.0, -10.0], [-10.0, 15.0]],
        ),
        impact_pairs=[
            ImpactPair(name="x", on="x", upper=0.5, law=Elastic(stiffness=900.0)),
            ImpactPair(name="apart", between=("x", "z"), clearance=0.4, law=Elastic(stiffness=400)),
        ],
        excitations=[WhiteNoise(intensity=0.2, on="base")],
    )  # fmt: skip
    model = with_tables(model_of(scene))
    plan = plan_modal_tables(model, None, None)
    modes = model.modal

    def free(t: NDArray[np.float64] | float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates without stops, and their rates."""
        t = np.asarray(t)
        return (
            np.array([0.8 * np.sin(2.0 * t), 0.5 * np.sin(3.0 * t + 1.0)]),
            np.array([1.6 * np.cos(2.0 * t), 1.5 * np.cos(3.0 * t + 1.0)]),
        )

    def pulls(t: float, d: NDArray[np.float64]) -> NDArray[np.float64]:
        """Absolute accelerations."""
        q, v = (own + change for own, change in zip(free(t), (d[:2], d[2:]), strict=True))
        push = [
            each.force(each.direction @ q, each.direction @ v) * each.direction
            for each in model.pairs
        ]
        force = model.stiffness @ q + model.damping @ v + sum(push)
        return np.linalg.solve(model.mass, force)

    def motion(t: float, d: NDArray[np.float64]) -> NDArray[np.float64]:
        q, v = free(t)
        without = np.linalg.solve(model.mass, model.stiffness @ q + model.damping @ v)
        return np.concatenate([d[2:], without - pulls(t, d)])

    end = 2.5
    times = plan.step * np.arange(0, round(end / plan.step) + 1)
    q, v = (np.linalg.solve(modes.shapes, each) for each in free(times))
    rows = np.zeros((len(times), 2, 2))
    rows[:, :, 0], rows[:, :, 1] = q.T, v.T / plan.scale
    largest = np.zeros((1, 2))
    log = Log(np.zeros((100, COLUMNS)), np.zeros(1, np.int64), 0.0)
    plan.follow(np.ascontiguousarray(np.roll(rows, -1, axis=0)), log, largest)
    assert log.count[0] >= 3
    kept = {"rtol": 1e-7, "atol": 1e-9, "max_step": 1e-2}
    known = solve_ivp(motion, (0.0, times[-1]), np.zeros(4), dense_output=True, **kept)
    fine = np.linspace(0.0, times[-1], 4_000)
    exact = np.max(np.abs([pulls(t, known.sol(t)) for t in fine]), axis=0)
    # the motion without stops is a cubic, its forces a chord, between samples
    assert largest[0] == pytest.approx(exact, rel=2e-3)
    between = np.max(np.abs([pulls(t, known.sol(t)) for t in times[1:]]), axis=0)
    assert np.max(np.abs(between / exact - 1.0)) > 5e-3


def test_what_has_no_acceleration_is_refused() -> None:
    with pytest.raises(NotApplicable, match="the base alone must move"):
        outputs_of(masses(), None)
    scene = snubbed(4.0, RUBBER, 1)
    assert outputs_of(scene, None) == ("x", "y", "z")
    with pytest.raises(ValueError, match="at must be one of x, y, z, rx"):
        outputs_of(scene, "display")


def test_stops_that_are_hit_all_the_time_have_no_bursts() -> None:
    scene = uncoupled(pair("x", "x", 0.5), pair("z", "z", 0.5))
    with pytest.raises(NotApplicable, match="hit without a pause"):
        bursts(scene, rel_error=0.3)


@pytest.mark.verify
def test_a_seed_gives_the_same_digits_on_any_number_of_threads() -> None:
    scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
    rates: list[Estimate] = [
        bursts(scene, rel_error=0.2, seed=8, threads=threads).hit_rate() for threads in (1, 2)
    ]
    assert rates[0] == rates[1]


@pytest.mark.slow
def test_telling_of_the_progress_does_not_change_the_answer() -> None:
    """A block of a box has fewer paths than an error needs."""
    scene = snubbed(5.0, RUBBER, 2)
    told: list[float] = []
    quiet, spoken = (
        bursts(scene, rel_error=0.3, budget=None, progress=progress)
        for progress in (None, lambda done, text: told.append(done))
    )
    assert told and spoken.hit_rate() == quiet.hit_rate()


def test_a_pair_that_pushes_nothing_whose_acceleration_is_limited_does_not_count() -> None:
    law = Elastic(stiffness=1e4)
    first, second = (
        each.replace(law=law) for each in (pair("first", "x", 3.0), pair("second", "z", 3.0))
    )
    both, alone, other = (
        model_of(uncoupled(*pairs)) for pairs in ((first, second), (first,), (second,))
    )
    limit = Limit("peak_acceleration", 300.0, ("x",))
    assert widening_of(both, limit) == widening_of(alone, limit) > 1.0
    # the control: where z counts as well, its mass moves faster and needs less
    either = Limit("peak_acceleration", 300.0, ("x", "z"))
    assert widening_of(both, either) == widening_of(other, Limit(*limit[:2], ("z",)))
    assert widening_of(both, either) < widening_of(both, limit)
