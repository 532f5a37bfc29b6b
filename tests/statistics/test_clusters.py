"""Impacts per second by clusters: what a single path says of a pair."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    screen,
    simulate,
)
from stochvi.engine.arithmetic import (
    COLUMNS,
    Log,
)
from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.risk_curve import (
    exceedances,
    limit_of_target,
    window_sampler,
)
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan, with_tables
from stochvi.motion.modal_tables import plan_modal_tables
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate, of_events
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of
from stochvi.scenes import RigidBody
from stochvi.scenes.impact_laws import Law, SpeedRestitution
from stochvi.statistics import clusters
from stochvi.statistics.clusters import (
    Bursts,
    ClusterPaths,
    bursts,
    chance_of,
    is_far,
    widened,
)
from stochvi.statistics.crossings import PairMotion, first_crossings
from stochvi.statistics.hardness import Limit, limits_of
from stochvi.statistics.mission_parts import asked_in_parts
from stochvi.statistics.rare_hits import (
    exceedance,
    rare_hits,
    widening_of,
    windows,
)
from stochvi.testing import assert_agrees
from support.accuracies import rel_errors, run_of
from support.boxes import INERTIA, PLACES, TABLES, box, direct_matrices, scene_with, tables
from support.pairs import LAW, diagonal, pair, uncoupled

# ------------------------------------------------------------------------------
# Impact clusters from first impacts on, against exact laws and against simulating everything.
# ------------------------------------------------------------------------------


def unit(level: float, law: Law, lower: float | None = None) -> Scene:
    """omega = sigma_x = sigma_v = 1, zeta = 0.05, stops at -level (or lower) and level."""
    pair = ImpactPair(lower=-level if lower is None else lower, upper=level, law=law)
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def truck(level: float, law: Law) -> Scene:
    mount = Isolator(mass=1.0, damping=2.4 * math.pi * 2.0, stiffness=(24.0 * math.pi) ** 2)
    scene = Scene(
        structure=mount,
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )
    place = level * screen(scene).displacement_std
    pair = ImpactPair(lower=-place, upper=place, law=law)
    return scene.model_copy(update={"impact_pairs": (pair,)})


def test_elastic_stops_are_hit_as_often_as_the_exact_law_says() -> None:
    """At R = 1 the rate is Rice's, however the impacts cluster; so lambda times impacts per
    cluster."""
    found = bursts(unit(4.5, Restitution(coefficient=1.0)), rel_error=0.03, seed=1)
    assert found.apart
    exact = 2.0 * rice_rate(4.5, 1.0, 1.0) / math.erf(4.5 / math.sqrt(2.0))
    assert_agrees(found.hit_rate(), exact)
    assert found.hits_per_burst().value > 1.2
    # impact speeds are Rayleigh distributed
    assert_agrees(found.impact_speed_mean(), math.sqrt(math.pi / 2.0))
    with pytest.raises(AssertionError):
        assert_agrees(found.first_rate, exact)


def test_stops_that_give_way_are_touched_as_often_as_the_exact_law_says() -> None:
    scene = unit(4.5, Elastic(stiffness=50.0))
    known = exact(scene).impact_pairs["stops"]["collision_rate"]
    assert isinstance(known, Estimate)
    found = bursts(scene, rel_error=0.03, seed=3)
    assert_agrees(found.hit_rate(), known.value)
    with pytest.raises(AssertionError):
        assert_agrees(found.first_rate, known.value)


def test_stops_at_two_distances_against_the_exact_law() -> None:
    found = bursts(unit(4.7, Restitution(coefficient=1.0), lower=-4.4), rel_error=0.03, seed=2)
    exact = rice_rate(4.7, 1.0, 1.0) + rice_rate(4.4, 1.0, 1.0)
    assert_agrees(found.hit_rate(), exact)


@rel_errors(0.1, 0.04)
def test_a_mount_that_its_stops_pump_against_simulation(rel_error: float) -> None:
    """Where one first impact leads to twenty, and the overlap of clusters is stated."""
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    scene = Scene(structure=mount, excitations=[TabulatedNoise(profile="gevs-qualification")])
    place = 3.9 * screen(scene).displacement_std
    pair = ImpactPair(lower=-place, upper=place, law=Restitution(coefficient=0.5))
    scene = scene.model_copy(update={"impact_pairs": (pair,)})
    found = bursts(scene, rel_error=rel_error, seed=1)
    full = simulate(scene, rel_error=rel_error, seed=2).impact_pairs["stops"]["collision_rate"]
    assert isinstance(full, Estimate)
    by_bursts = found.hit_rate()
    difference = Estimate(
        value=by_bursts.value - full.value,
        standard_error=math.hypot(by_bursts.standard_error, full.standard_error),
        bias=(by_bursts.bias or 0.0) + (full.bias or 0.0),
    )
    assert_agrees(difference, 0.0)
    assert found.hits_per_burst().value > 15.0
    assert by_bursts.value > 15.0 * found.first_rate.value


def test_weights_of_faster_first_hits_give_back_the_moments_of_rayleighs_law() -> None:
    """Slopes at even quantiles, half of them made larger: E 1 = 1, E s^2 = 2, E s^4 = 8."""

    def moments(count: int) -> np.ndarray:
        quantiles = (np.arange(count) + 0.5) / count
        slopes, weight = widened(
            np.repeat(np.sqrt(-2.0 * np.log1p(-quantiles)), 2)[None, :], widening=2.0
        )
        return np.array([(weight * slopes**power).mean() for power in (0, 2, 4)])

    fine, coarse = moments(40_000), moments(10_000)
    # the tails that the quantiles leave out shrink with their number
    np.testing.assert_array_less(np.abs(fine - [1.0, 2.0, 8.0]), np.abs(fine - coarse) + 1e-9)


def test_faster_first_hits_are_weighted_back() -> None:
    scene = truck(4.5, Restitution(coefficient=0.5))
    plain = bursts(scene, rel_error=0.03, seed=1)
    wide = bursts(scene, rel_error=0.03, widening=2.0, seed=1)
    limit = 2.0 * wide.fastest[0].mean()
    for name in ("hits", "speeds", "fastest"):
        mean = wide._mean(getattr(wide, name)[0])
        other = plain._mean(getattr(plain, name)[0])
        both = Estimate(
            value=mean.value - other.value,
            standard_error=math.hypot(mean.standard_error, other.standard_error),
        )
        assert_agrees(both, 0.0)
    assert np.mean(wide.fastest[0] > limit) > 3.0 * np.mean(plain.fastest[0] > limit)
    unweighted = float(np.mean(wide.fastest[0]))
    with pytest.raises(AssertionError):
        assert_agrees(wide._mean(wide.fastest[0]), unweighted)


def test_what_is_far_from_the_wanted_value_takes_few_bursts() -> None:
    scene = truck(4.5, Restitution(coefficient=0.5))
    exact_one = bursts(scene, rel_error=0.01, seed=1)
    rate = exact_one.hit_rate().value
    far, near = (
        bursts(scene, rel_error=0.01, far_from=factor * rate, seed=1) for factor in (10.0, 1.5)
    )
    assert len(far.path) < len(near.path) == len(exact_one.path)


def test_a_single_burst_beyond_a_limit_is_no_reason_to_stop() -> None:
    """Its rate may be wrong by a factor of ten, though four standard errors are less than that."""
    assert not is_far(Estimate(value=0.1, standard_error=0.1), 1.0)
    assert not is_far(Estimate(value=10.0, standard_error=10.0), 1.0)
    assert is_far(Estimate(value=0.1, standard_error=0.01), 1.0)
    assert is_far(Estimate(value=10.0, standard_error=1.0), 1.0)


def test_chance_of_a_sharp_hit_against_whole_missions() -> None:
    """Largest absolute acceleration in 6 s, from paths with everything simulated."""
    scene = truck(3.6, Elastic(stiffness=100.0 * (24.0 * math.pi) ** 2))
    limit, window, paths = 120.0, 6.0, 4096
    plan = plan_modal_tables(model_of(scene), None, window)
    sharpest = np.zeros((paths, 1))
    for first in range(0, paths, plan.block):
        part = sharpest[first : first + plan.block]
        plan.averages(3, first, plan.block, accelerations=part)
    share = float(np.mean(sharpest > limit))
    rate = -math.log1p(-share) / plan.duration
    error = math.sqrt(share / (1.0 - share) / paths) / plan.duration

    def wanted(some: Bursts) -> Estimate:
        return some.exceedance_rate("peak_acceleration", limit)

    found = wanted(bursts(scene, rel_error=0.03, wanted=wanted, seed=4))
    both = Estimate(
        value=found.value,
        standard_error=math.hypot(found.standard_error, error),
        bias=found.bias,
    )
    assert_agrees(both, rate)
    with pytest.raises(AssertionError):
        assert_agrees(both, 2.0 * rate)


def test_stops_must_lie_beyond_the_mean_position() -> None:
    scene = unit(4.0, Restitution(coefficient=1.0), lower=0.5)
    with pytest.raises(NotApplicable, match="the mean gap of stops must lie between its stops"):
        bursts(scene)
    with pytest.raises(NotApplicable, match="needs an impact_pair"):
        bursts(scene.model_copy(update={"impact_pairs": ()}))


def test_a_restitution_by_speed_is_followed() -> None:
    """One that is the same at all speeds is that number; one that falls leaves fewer impacts."""
    number, constant, falling = (
        bursts(unit(4.0, law), rel_error=0.3, seed=2).hits_per_burst().value
        for law in (
            Restitution(coefficient=0.5),
            SpeedRestitution(coefficient=lambda speed: 0.5 + 0.0 * speed),
            SpeedRestitution(coefficient=lambda speed: 0.5 / (1.0 + speed)),
        )
    )
    assert constant == pytest.approx(number, rel=1e-6)
    assert falling < 0.99 * number


def test_noise_on_the_mass_is_as_sharp_as_noise_on_the_base() -> None:
    """What spring, damper and stop give the mass does not tell which of the two is shaken; on a
    rigid stop there is no largest acceleration."""
    on_mass = unit(4.0, Elastic(stiffness=100.0))
    mount = Isolator(mass=2.0, damping=0.2, stiffness=2.0)
    stops = ImpactPair(lower=-4.0, upper=4.0, law=Elastic(stiffness=200.0))
    on_base = Scene(
        structure=mount, impact_pairs=[stops], excitations=[WhiteNoise(intensity=0.2, on="base")]
    )
    one, other = (bursts(scene, rel_error=0.1, seed=2) for scene in (on_mass, on_base))
    # when it touches the stop the spring alone brings 4 m/s^2
    assert np.all(one.sharpest[0] > 4.0)

    def apart(factor: float) -> Estimate:
        ours = one.exceedance_rate("peak_acceleration", 14.0)
        known = other.exceedance_rate("peak_acceleration", factor * 14.0)
        error = math.hypot(ours.standard_error, known.standard_error)
        return Estimate(value=ours.value - known.value, standard_error=error)

    assert_agrees(apart(1.0), 0.0)
    with pytest.raises(AssertionError):  # the force on a mass twice as heavy
        assert_agrees(apart(2.0), 0.0)
    rigid = bursts(unit(4.0, Restitution(coefficient=0.5)), rel_error=0.3, seed=2)
    assert rigid.outputs == () and rigid.sharpest.shape == (0, len(rigid.path))


def test_a_crest_between_sub_steps_is_found() -> None:
    """Of an elastic contact, w W at the speed w and the rate W, in sub-steps of W h = 0.25."""
    stiffness, w, level = 1e9, np.linspace(0.1, 0.6, 40), 1e-3
    scene = truck(4.5, Elastic(stiffness=stiffness))
    pair = scene.impact_pairs[0].model_copy(update={"lower": None, "upper": level})
    paths = ClusterPaths(model_of(scene.model_copy(update={"impact_pairs": (pair,)})), 1)
    plan, shape = paths.plans[1], float(paths.model.modal.shapes[0, 0])
    # without the stop each motion passes it evenly, at another place of a step
    time = plan.step * (np.arange(-1, 4)[:, None] - np.linspace(0.5, 1.5, 40))
    motion = np.empty((5, 1, 80))
    motion[:, 0, 0::2] = (level + w * time) / shape
    motion[:, 0, 1::2] = w / shape / plan.scale
    found = paths.follow(np.roll(motion, -1, axis=0), accelerations=True).accelerations[:, 0]
    # the spring adds its force; by values at the starts of sub-steps alone it would be up to 8e-3
    # lower
    crest = w * math.sqrt(stiffness) + float(paths.model.omega**2) * level
    assert found == pytest.approx(crest, rel=5e-4)


def test_what_no_burst_does_has_the_limit_of_so_many_trials() -> None:
    """Where all weigh the same, q with (1 - q)^n = 0.05."""
    found = bursts(unit(4.5, Restitution(coefficient=0.5)), rel_error=0.1, seed=5)
    never = found.exceedance_rate("impact_speed", 100.0)
    assert never.value == 0.0 and never.upper_95 is not None
    exact_limit = 1.0 - 0.05 ** (1.0 / len(found.path))
    assert never.upper_95 == pytest.approx(found.first_rate.value * exact_limit, rel=1e-2)
    assert found.exceedance_rate("impact_speed", 0.1).upper_95 is None


def test_a_cluster_of_small_weight_says_nothing_of_those_of_large_weight() -> None:
    """One that was drawn fast, and exceeds the limit, leaves the limit of the others as it is."""
    found = bursts(unit(4.5, Restitution(coefficient=0.5)), rel_error=0.1, seed=5)
    never = found.exceedance_rate("impact_speed", 100.0)
    weight, fastest = found.weight.copy(), found.fastest.copy()
    weight[0], fastest[0, 0] = 1e-9 * weight[1], 200.0
    one = replace(found, weight=weight, fastest=fastest)
    seen = one.exceedance_rate("impact_speed", 100.0)
    assert seen.upper_95 is None and never.upper_95 is not None
    limited = one.limited(seen)
    assert limited.upper_95 == pytest.approx(never.upper_95, rel=1e-2)
    assert is_far(seen, never.upper_95) and not is_far(limited, never.upper_95)
    # the control: without the floor the limit is far below, and many clusters need none
    assert (of_events(seen, one.paths).upper_95 or 1.0) < 1e-6 * never.upper_95
    often = found.exceedance_rate("impact_speed", 0.1)
    assert found.limited(often).value == often.value


def test_equally_far_stops_of_different_laws_are_hit_alike_from_either_side() -> None:
    """Of a stiff and a soft stop only the stiff one is sharp, and takes half of the first
    impacts."""
    stiff, soft = Elastic(stiffness=1e4), Elastic(stiffness=1e2)

    def rate(lower: Law, upper: Law) -> Estimate:
        pair = ImpactPair(lower=-4.0, upper=4.0, lower_law=lower, upper_law=upper)
        scene = unit(4.0, stiff).model_copy(update={"impact_pairs": (pair,)})
        found = bursts(scene, rel_error=0.1, seed=1).exceedance_rate("peak_acceleration", 30.0)
        return replace(found, bias=None)  # that clusters overlap counts in all alike

    def apart(one: Estimate, other: Estimate) -> Estimate:
        error = math.hypot(one.standard_error, other.standard_error)
        return Estimate(value=one.value - other.value, standard_error=error)

    below, above = rate(stiff, soft), rate(soft, stiff)
    assert_agrees(apart(below, above), 0.0)
    # negative control: two stiff stops are sharp more often
    with pytest.raises(AssertionError):
        assert_agrees(apart(below, rate(stiff, stiff)), 0.0)


def test_a_rare_chance_has_the_relative_biases_of_its_rate_and_of_the_ends_of_a_mission() -> None:
    rate = Estimate(value=1e-6, standard_error=1e-7, bias=2e-8)
    found = chance_of(rate, 100.0, reach=0.03)
    # 1 - exp(-h) is h to a relative error of h
    assert found.value == pytest.approx(1e-4, rel=1e-4)
    assert found.standard_error == pytest.approx(1e-5, rel=2e-4)
    assert found.bias == pytest.approx((0.02 + 0.03) * 1e-4, rel=2e-4)


def test_names_that_clusters_do_not_have_are_refused_in_sentences() -> None:
    rigid = bursts(unit(4.0, Restitution(coefficient=0.5)), rel_error=0.5, seed=1)
    with pytest.raises(NotApplicable, match="a restitution alone does not give a force"):
        rigid.largest("peak_acceleration")
    with pytest.raises(ValueError, match=r"^outputs must be among none, got 'y'$"):
        rigid.exceedance_rate("peak_acceleration", 1.0, ["y"])
    soft = bursts(unit(4.0, Elastic(stiffness=1e4)), rel_error=0.5, seed=1)
    with pytest.raises(ValueError, match=r"^outputs must be among x, got 'y'$"):
        soft.largest("peak_acceleration", ["y"])
    for ask in (soft.hit_rate, soft.impact_speed_mean):
        with pytest.raises(ValueError, match=r"^pair must be among .*, got 'left'$"):
            ask("left")
    with pytest.raises(
        TypeError, match=r"^bursts\(\) got an unexpected keyword argument 'mission'"
    ):
        bursts(unit(4.0, Elastic(stiffness=1e4)), mission=3.0)  # type: ignore[call-arg]


def test_a_part_without_an_answer_is_named_where_all_parts_are_needed() -> None:
    def ask(name: str, _: Run) -> str:
        if name == "rail":
            raise NotConverged("the budget of 2 s ended; raise budget")
        return name

    durations = {"road": 60.0, "rail": 60.0}
    with pool_of(None, 1) as pool:
        run = Run(pool, Deadline.after(10.0))
        with pytest.raises(NotConverged, match=r"^there is no answer without rail: the budget"):
            asked_in_parts(run, durations, ask)
        found, missing = asked_in_parts(run, durations, ask, all_needed=False)
    assert [*found] == ["road"] and [*missing] == ["rail, answer"]


@pytest.mark.parametrize("event", ["impulse", "hit"])
def test_an_event_that_is_not_known_is_refused_and_not_taken_for_another(event: str) -> None:
    scene = unit(4.0, Elastic(stiffness=1e4))
    found = bursts(scene, rel_error=0.5, seed=1)
    assert found.largest("impact_speed").tolist() != found.largest("peak_acceleration").tolist()
    sampler = window_sampler(scene, event, 10.0, 1)
    target = Target(name=event, value=1.0, unit="N s", exceedance=0.1)
    asked: list[Callable[[], object]] = [
        lambda: found.largest(event),
        lambda: found.exceedance_rate(event, 1.0),
        lambda: rare_hits(scene, event, 1.0, mission=10.0, rel_error=0.5),
        lambda: exceedances(scene, [4.0], 10.0, event=event),
        lambda: widening_of(model_of(scene), Limit(event, 1.0)),
        lambda: sampler.simulate(0, 2),
        lambda: limit_of_target(scene, target, None),
        lambda: limits_of(scene, {event: 1.0}, None),
    ]
    for ask in asked:
        with pytest.raises(ValueError, match="event must be 'impact_speed' or 'impact_e"):
            ask()


# ------------------------------------------------------------------------------
# Probability that any snubber of a rigid box is hit, against counting missions of a motion that is
# made from direct matrices and the densities of the base alone.
# ------------------------------------------------------------------------------


RECORD, RATE = 200.0, 2000.0
"""Length of a record, s, and samples per second: a hundred in a period of the fastest mode."""

MISSION, APART = 4.0, 1.0
"""Length of a mission, and what lies between two of one record: five time constants, s."""

REACHES = (4.2, 4.75, 5.2)
"""Distances of all snubbers, in standard deviations: probabilities of some 1e-1, 1e-2 and 1e-3."""


def random_box(number: int) -> RigidBody:
    """A box whose eight mounts all differ, with its centre of mass somewhere between them."""
    random = np.random.default_rng([5, number])
    offset = random.uniform(-0.04, 0.04, 3)
    mounts = [
        {
            "at": (np.array(place) + offset).tolist(),
            "stiffness": random.uniform(1e4, 2.5e4, 3).tolist(),
            "damping": random.uniform(15.0, 30.0, 3).tolist(),
        }
        for place in PLACES
    ]
    return RigidBody(mass=float(random.uniform(9.0, 15.0)), inertia=INERTIA, mount=mounts)


def snubbers(number: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Places and unit directions of three to five snubbers."""
    random = np.random.default_rng([6, number])
    chosen = random.permutation(8)[: 3 + number % 3]
    directions = random.standard_normal((len(chosen), 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return [(np.array(PLACES[k]), d) for k, d in zip(chosen, directions, strict=True)]


def gaps_by_frequency(structure: RigidBody, number: int) -> NDArray[np.complex128]:
    """Amplitudes (axes, gaps, bins) of the gaps per standard normal coefficient of the base."""
    mass, damping, stiffness = direct_matrices(structure)
    bins = np.arange(1, round(RECORD * RATE / 2.0)) / RECORD
    w = 2.0 * np.pi * bins[:, None, None]
    dynamic = stiffness - w**2 * mass + 1j * w * damping
    rows = np.array([[*d, *np.cross(at, d)] for at, d in snubbers(number)])
    found = []
    for axis, (frequency, density) in enumerate(TABLES.values()):
        logs = np.interp(np.log(bins), np.log(frequency), np.log(density))
        inside = (bins >= frequency[0]) & (bins <= frequency[-1])
        shaken = np.where(inside, STANDARD_GRAVITY * np.sqrt(np.exp(logs) / RECORD), 0.0)
        force = np.broadcast_to(-mass[:, axis, None], (len(bins), 6, 1))
        moved = np.linalg.solve(dynamic, force)[:, :, 0]
        found.append((moved @ rows.T).T * shaken)
    return np.array(found)


def largest(number: int, missions: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(missions,) largest distance of any gap in its standard deviations, and these (gaps,), m."""
    waves = gaps_by_frequency(random_box(number), number)
    std = np.sqrt(np.sum(np.abs(waves) ** 2, axis=(0, 2)))
    random = np.random.default_rng([7, number])
    samples, length = round(RECORD * RATE), round(MISSION * RATE)
    period = round((MISSION + APART) * RATE)
    found: list[float] = []
    while len(found) < missions:
        normals = random.standard_normal((2, len(waves), 1, waves.shape[2]))
        spectrum = np.zeros((len(std), samples // 2 + 1), complex)
        spectrum[:, 1 : waves.shape[2] + 1] = np.sum((normals[0] - 1j * normals[1]) * waves, axis=0)
        moved = np.fft.irfft(spectrum, samples, norm="forward") / 2.0
        away = np.max(np.abs(moved) / std[:, None], axis=0)
        found += [float(away[first : first + length].max()) for first in range(0, samples, period)]
    return np.array(found), std


def assert_agrees_with_counting(number: int, missions: int, rel_error: float) -> None:
    away, std = largest(number, missions)
    scene = Scene(
        structure=random_box(number),
        impact_pairs=[
            ImpactPair(
                name=f"snubber {k}", at=at.tolist(), direction=direction.tolist(),
                clearance=4.0 * std[k], law=Restitution(coefficient=0.4),
            )
            for k, (at, direction) in enumerate(snubbers(number))
        ],
        excitations=tables(),
    )  # fmt: skip
    rows = np.outer(REACHES, std)
    found = first_crossings(
        scene, lower=rows, upper=rows, mission=MISSION, rel_error=rel_error, seed=number
    )
    np.testing.assert_allclose(found.displacement_std, std, rtol=2e-3)
    for reach, chance in zip(REACHES, found.probability(MISSION), strict=True):
        counted = float(np.mean(away >= reach))
        expected = max(chance.value, 1.0 / len(away))
        error = math.sqrt(expected * (1.0 - expected) / len(away))
        print(number, reach, chance, counted)
        # of rare hits the number counted is Poisson's: one more or less is no standard error
        both = Estimate(
            value=chance.value,
            standard_error=math.hypot(chance.standard_error, error),
            bias=(chance.bias or 0.0) + 1.0 / len(away),
        )
        assert_agrees(both, counted)


@pytest.mark.slow
def test_a_box_against_counting() -> None:
    assert_agrees_with_counting(0, 300, 0.1)


@pytest.mark.verify
@pytest.mark.parametrize("number", range(1, 7))
def test_boxes_against_much_counting(number: int) -> None:
    assert_agrees_with_counting(number, 12_000, 0.01)


# ------------------------------------------------------------------------------
# Impact clusters on several pairs of a structure, against counting impacts in long paths, and the
# largest accelerations in contacts against a plain integration.
# ------------------------------------------------------------------------------


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
                name, 0.03, 2**18 if name == "two masses" else 2048, marks=pytest.mark.verify
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
        print(total, first)
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
    (limit,) = limits_of(scene, {"peak_acceleration": 45.0}, "z")
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
    limit = {"peak_acceleration": 1.0}
    with pytest.raises(NotApplicable, match="the base alone must move"):
        limits_of(masses(), limit, None)
    scene = snubbed(4.0, RUBBER, 1)
    assert limits_of(scene, limit, None)[0].outputs == ("x", "y", "z")
    with pytest.raises(ValueError, match="at must be one of x, y, z, rx"):
        limits_of(scene, limit, "display")


def test_stops_that_are_hit_all_the_time_have_no_bursts() -> None:
    scene = uncoupled(pair("x", "x", 0.5), pair("z", "z", 0.5))
    with pytest.raises(NotApplicable, match="hit without a pause"):
        bursts(scene, rel_error=0.3)


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


# ------------------------------------------------------------------------------
# Impacts per second by clusters:
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(("seen", "known"), [((0,), False), ((0, 3), True)])
def test_a_speed_that_one_path_shows_has_no_error_and_is_not_given(
    monkeypatch: pytest.MonkeyPatch, seen: tuple[int, ...], known: bool
) -> None:
    hits = np.zeros((2, 8))
    hits[0], hits[1, list(seen)] = 1.0, 1.0
    found = Bursts(
        first_rate=Estimate(value=1e-3, standard_error=1e-5), window=1.0, horizon=1.0,
        pairs=("near", "far"), outputs=("x", "z"), path=np.arange(8), weight=np.ones(8),
        early_hits=hits.sum(axis=0), hits=hits, speeds=0.5 * hits, fastest=0.5 * hits,
        sharpest=np.zeros((2, 8)), masses=np.ones(2),
    )  # fmt: skip
    monkeypatch.setattr(clusters, "clusters_apart", lambda *_: found)
    scene = uncoupled(pair("near", "x", 3.0), pair("far", "z", 5.0))
    with run_of(rel_error=0.1) as run:
        counts = clusters.count_impacts(scene, 0.0, run)
    speed = counts.speeds["far"]
    assert (speed is not None) == known
    assert speed is None or speed.value == pytest.approx(0.5)
    assert counts.speeds["near"] is not None
