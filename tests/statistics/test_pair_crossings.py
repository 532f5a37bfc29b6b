"""First impacts of any of several pairs, against independent simulation and against one
oscillator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_lyapunov

from stochvi import (
    Elastic,
    FilteredNoise,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    exact,
    impacts,
    reliability,
    simulate,
)
from stochvi.isolators.moved_stops import at_clearances
from stochvi.model.free_motion import free_motion
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.impact_counts import count_impacts
from stochvi.statistics.pair_crossings import (
    PairMotion,
    listed_under_first,
    same_gaps,
)
from stochvi.testing import assert_agrees
from support.pairs import LAW, diagonal, pair, uncoupled
from support.runs import run_of

Matrix = NDArray[np.float64]

MISSION = 100.0


def chance(scene: Scene, rel_error: float = 0.06, seed: int = 1) -> Estimate:
    return first_crossings(scene, mission=MISSION, rel_error=rel_error, seed=seed).probability(
        MISSION
    )[0]


def both(first: Estimate, second: float, error: float) -> Estimate:
    """An estimate with the standard error of what it is compared with as well."""
    return Estimate(
        value=first.value, standard_error=math.hypot(first.standard_error, error), bias=first.bias
    )


def test_pairs_that_are_hit_at_once_share_their_hits() -> None:
    """Two equal snubbers at one place: the numbers of each are half of those of one alone."""
    twins = uncoupled(pair("left", "x", 2.0), pair("z", "z", 3.0), pair("right", "x", 2.0))
    alone = uncoupled(pair("left", "x", 2.0), pair("z", "z", 3.0))
    found, one = (simulate(each, paths=64, duration=200.0, seed=1) for each in (twins, alone))
    left, right, whole = (
        answer.impact_pairs[name]
        for answer, name in ((found, "left"), (found, "right"), (one, "left"))
    )
    for name in ("collision_rate", "collision_rate_lower", "impact_speed_rate"):
        assert float(getattr(left, name)) == float(getattr(right, name)) > 0.0
        assert_agrees(2.0 * getattr(left, name), float(getattr(whole, name)))
    assert float(left.impact_speed_mean) == pytest.approx(float(whole.impact_speed_mean), rel=0.1)
    shares = first_crossings(twins, mission=MISSION, rel_error=0.2).shares(MISSION)[0]
    assert shares.sum() == pytest.approx(1.0)
    assert shares[0] == pytest.approx(shares[2], rel=1e-9)
    with run_of(rel_error=0.2, seed=2) as run:
        counts = count_impacts(at_clearances(twins, [4.0, 4.5, 4.0]), 0.0, run)
    assert counts.way == "bursts"
    assert counts.rates["left"].value == counts.rates["right"].value > 0.0
    # stops that are not equally far are not hit at once: the farther ones are never hit
    farther = uncoupled(pair("left", "x", 2.0), pair("right", "x", 2.1))
    crossings = first_crossings(farther, mission=MISSION, rel_error=0.2)
    assert crossings.shares(MISSION)[0] == pytest.approx([1.0, 0.0])


def test_stops_that_are_hit_at_once_share_their_hits_side_by_side() -> None:
    """The lower stops of two pairs coincide, or the upper one of a pair that is turned over."""
    plain = {"between": ("x", "z"), "lower": -2.0, "law": LAW}
    turned = ImpactPair(name="b", between=("z", "x"), lower=-4.0, upper=2.0, law=LAW)
    alike = ImpactPair(name="b", upper=4.0, **plain)
    first = ImpactPair(name="a", upper=3.0, **plain)
    (alone,) = simulate(uncoupled(first), paths=64, duration=200.0, seed=1).impact_pairs.values()
    lower, upper = alone.collision_rate_lower, alone.collision_rate_upper
    assert lower is not None and upper is not None and upper.value > 0.0
    for second in (alike, turned):
        scene = uncoupled(first, second)
        found = simulate(scene, paths=64, duration=200.0, seed=1).impact_pairs
        shared = both(found["b"].collision_rate * 2.0, lower.value, lower.standard_error)
        assert_agrees(shared, lower.value)
        lone = found["a"].collision_rate_lower
        assert lone is not None and lone.value == pytest.approx(found["b"].collision_rate.value)
        # the other stop of the first pair is its own
        rate = found["a"].collision_rate_upper
        assert_agrees(both(rate, upper.value, upper.standard_error), upper.value)
        shares = first_crossings(scene, mission=MISSION, rel_error=0.2, seed=1).shares(MISSION)[0]
        assert 0.0 < shares[1] < 0.5 < shares[0]
        assert len(same_gaps(model_of(scene))) == 1
        (told,) = listed_under_first(model_of(scene))
        assert told.endswith("such impacts stand under a alone")
        assert told in impacts(scene, paths=64, duration=5.0, seed=1).warnings
    assert not listed_under_first(model_of(uncoupled(first)))


def test_compliant_stops_at_one_place_count_their_own_forces() -> None:
    """Both are touched at once, and push by their own stiffness."""
    stiff, soft = (
        ImpactPair(name=name, on="x", upper=2.0, law=Elastic(stiffness=stiffness))
        for name, stiffness in (("stiff", 40.0), ("soft", 10.0))
    )
    found = simulate(uncoupled(stiff, soft), paths=128, duration=50.0, seed=1).impact_pairs
    forces = [float(found[name].contact_force_upper) for name in ("stiff", "soft")]
    assert forces[0] == pytest.approx(4.0 * forces[1], rel=1e-9)
    assert float(found["stiff"].collision_rate) == float(found["soft"].collision_rate) > 0.0


def test_one_pair_is_one_oscillator() -> None:
    unit = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    (known,) = first_crossings(unit, [3.0], mission=MISSION, rel_error=0.03, seed=2).probability(
        MISSION
    )
    found = chance(uncoupled(pair("wall", "x", 3.0)))
    assert_agrees(both(found, known.value, known.standard_error), known.value)


def test_uncoupled_pairs_are_independent_and_equal_ones_count_once() -> None:
    x, z = pair("x", "x", 3.0), pair("z", "z", 3.1)
    alone = [chance(uncoupled(each)) for each in (x, z)]
    none = math.prod(1.0 - each.value for each in alone)
    error = none * math.hypot(*(each.standard_error / (1.0 - each.value) for each in alone))
    found = chance(uncoupled(x, z), seed=3)
    assert_agrees(both(found, 1.0 - none, error), 1.0 - none)
    twice = chance(uncoupled(x, pair("again", "x", 3.0)), seed=4)
    assert_agrees(both(twice, alone[0].value, alone[0].standard_error), alone[0].value)
    # the same motion under the opposite sign is no other motion either
    mirrored = ImpactPair(name="mirrored", between=("z", "x"), lower=-3.0, upper=3.0, law=LAW)
    plain = ImpactPair(name="plain", between=("x", "z"), lower=-3.0, upper=3.0, law=LAW)
    one, two = chance(uncoupled(plain), seed=5), chance(uncoupled(plain, mirrored), seed=6)
    assert_agrees(both(two, one.value, one.standard_error), one.value)
    # counted twice they would be hit as independent ones are
    wrong = 1.0 - (1.0 - alone[0].value) ** 2
    with pytest.raises(AssertionError):
        assert_agrees(both(twice, wrong, 2.0 * alone[0].standard_error), wrong)


def random_scene(number: int, coordinates: int, stops: int, rarity: float) -> Scene:
    """Masses in a row between springs of random sizes, shaken at two places, with random stops."""
    random = np.random.default_rng([77, number])
    names = tuple(f"q{i}" for i in range(coordinates))
    springs = random.uniform(0.5, 3.0, coordinates + 1)
    stiffness = np.diag(springs[:-1] + springs[1:])
    for i in range(coordinates - 1):
        stiffness[i, i + 1] = stiffness[i + 1, i] = -springs[i + 1]
    mass = np.diag(random.uniform(0.5, 2.0, coordinates))
    damping = 0.08 * stiffness + 0.06 * mass
    places = [(name, None) for name in names] + [(None, each) for each in pairwise(names)]
    chosen = random.permutation(len(places))[:stops]
    scene = Scene(
        structure=Matrices(
            coordinates=names, mass=mass.tolist(), damping=damping.tolist(),
            stiffness=stiffness.tolist(),
        ),
        impact_pairs=[
            pair(f"p{i}", places[k][0], 1.0, places[k][1]) for i, k in enumerate(chosen)
        ],
        excitations=[
            WhiteNoise(intensity=random.uniform(0.1, 0.3), on=names[0]),
            WhiteNoise(intensity=random.uniform(0.1, 0.3), on=names[-1]),
        ],
    )  # fmt: skip
    model = model_of(scene)
    std, _ = free_motion(model).deviations(np.array([each.direction for each in model.pairs]))
    reach = rarity * std * random.uniform(0.95, 1.05, stops)
    moved = [
        each.model_copy(update={"lower": -(r if i else 0.97 * r), "upper": r})
        for i, (each, r) in enumerate(zip(scene.impact_pairs, reach, strict=True))
    ]
    return scene.model_copy(update={"impact_pairs": tuple(moved)})


def hits(scene: Scene, missions: int, seed: int) -> Matrix:
    """(missions, pairs) whether a pair is hit, from exact steps of the linear motion under white
    noise, drawn at its stationary distribution; gaps are cubics between samples."""
    structure = scene.structure
    assert isinstance(structure, Matrices)
    m, c, k = structure.matrices
    n, inverse = len(m), np.linalg.inv(m)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ c]])
    noise = np.zeros((2 * n, 2 * n))
    for each in scene.excitations:
        assert isinstance(each, WhiteNoise) and each.intensity is not None
        place = inverse[:, structure.coordinates.index(str(each.on))]
        noise[n:, n:] += each.intensity * np.outer(place, place)
    law = solve_continuous_lyapunov(flow, -noise)
    fastest = math.sqrt(np.linalg.eigvals(inverse @ k).real.max())
    h = 2.0 * math.pi / fastest / 32.0
    step = expm(h * flow)
    random = np.random.default_rng(seed)
    state = random.standard_normal((missions, 2 * n)) @ np.linalg.cholesky(law).T
    root = np.linalg.cholesky(law - step @ law @ step.T)
    rows = np.zeros((len(scene.impact_pairs), n))
    for row, each in zip(rows, scene.impact_pairs, strict=True):
        if each.between is not None:
            row[[structure.coordinates.index(name) for name in each.between]] = 1.0, -1.0
        else:
            row[structure.coordinates.index(str(each.on))] = 1.0
    upper = np.array([each.upper for each in scene.impact_pairs], float)
    lower = np.array([each.lower for each in scene.impact_pairs], float)
    y, v = state[:, :n] @ rows.T, state[:, n:] @ rows.T
    hit = (y >= upper) | (y <= lower)
    for _ in range(round(MISSION / h)):
        state = state @ step.T + random.standard_normal(state.shape) @ root.T
        y1, v1 = state[:, :n] @ rows.T, state[:, n:] @ rows.T
        # the middle of the cubic, and the parabola through the ends and the middle
        middle = 0.5 * (y + y1) + h * (v - v1) / 8.0
        bend, slope = 2.0 * (y + y1) - 4.0 * middle, 4.0 * middle - 3.0 * y - y1
        place = np.clip(-slope / np.where(bend == 0.0, 1.0, 2.0 * bend), 0.0, 1.0)
        peak = y + place * (slope + place * bend)
        for each in (y1, peak):
            hit |= (each >= upper) | (each <= lower)
        y, v = y1, v1
    return hit


def assert_counts_agree(scene: Scene, missions: int, seed: int, rel_error: float) -> None:
    found = first_crossings(scene, mission=MISSION, rel_error=rel_error, seed=seed)
    (estimate,) = found.probability(MISSION)
    struck = hits(scene, missions, seed)
    counted = float(np.mean(struck.any(axis=1)))
    error = math.sqrt(counted * (1.0 - counted) / missions)
    print(estimate, counted, error)
    assert_agrees(both(estimate, counted, error), counted)


@pytest.mark.parametrize(("number", "coordinates", "stops", "rarity"), [
    (1, 2, 3, 3.7),
    pytest.param(2, 3, 4, 4.4, marks=pytest.mark.verify),
])  # fmt: skip
def test_random_structures_against_counting(
    number: int, coordinates: int, stops: int, rarity: float
) -> None:
    scene = random_scene(number, coordinates, stops, rarity)
    assert_counts_agree(scene, 2000, number, 0.03)


@pytest.mark.verify
@pytest.mark.parametrize("rarity", [3.6, 4.2, 4.8])
@pytest.mark.parametrize("number", range(6))
def test_random_structures_against_much_counting(number: int, rarity: float) -> None:
    coordinates = 2 + number % 3
    scene = random_scene(10 + number, coordinates, min(2 + number, 2 * coordinates - 1), rarity)
    assert_counts_agree(scene, 20_000, number, 0.01)


@pytest.mark.slow
def test_independence_fails_where_pairs_move_together() -> None:
    """Two places of one stiff beam: the middle between them hardly moves on its own."""
    scene = Scene(
        structure=Matrices(
            coordinates=("left", "right"), mass=diagonal(1, 1), damping=[[0.2, -0.1], [-0.1, 0.2]],
            stiffness=[[26.0, -25.0], [-25.0, 26.0]],
        ),
        impact_pairs=[pair("left", "left", 2.5), pair("right", "right", 2.5)],
        excitations=[WhiteNoise(intensity=0.2, on="left"), WhiteNoise(intensity=0.2, on="right")],
    )  # fmt: skip
    found = first_crossings(
        scene,
        lower=[[2.5, 2.5], [2.5, math.inf], [math.inf, 2.5]],
        upper=[[2.5, 2.5], [2.5, math.inf], [math.inf, 2.5]],
        mission=MISSION, rel_error=0.04, seed=1,
    ).probability(MISSION)  # fmt: skip
    struck = hits(scene, 1000, 9)
    counted = float(np.mean(struck.any(axis=1)))
    error = math.sqrt(counted * (1.0 - counted) / len(struck))
    assert_agrees(both(found[0], counted, error), counted)
    apart = 1.0 - (1.0 - found[1].value) * (1.0 - found[2].value)
    wrong = Estimate(value=apart, standard_error=math.hypot(error, 2.0 * found[1].standard_error))
    with pytest.raises(AssertionError):
        assert_agrees(wrong, counted)


def test_stops_on_one_side_and_gaps_off_the_middle() -> None:
    scene = random_scene(3, 2, 2, 3.6)
    first, second = scene.impact_pairs
    scene = scene.model_copy(
        update={"impact_pairs": (first.model_copy(update={"lower": None}), second)}
    )
    found = first_crossings(scene, mission=MISSION, rel_error=0.03, seed=1)
    assert len(found.crossing) == 3
    struck = hits_one_sided(scene, 2000)
    error = math.sqrt(struck * (1.0 - struck) / 2000)
    assert_agrees(both(found.probability(MISSION)[0], struck, error), struck)


def hits_one_sided(scene: Scene, missions: int) -> float:
    wide = scene.impact_pairs[0].model_copy(update={"lower": -1e9})
    both_sides = scene.model_copy(update={"impact_pairs": (wide, scene.impact_pairs[1])})
    return float(np.mean(hits(both_sides, missions, 4).any(axis=1)))


def test_a_start_beyond_several_stops_counts_once() -> None:
    found = first_crossings(
        uncoupled(pair("x", "x", 1.0), pair("again", "x", 1.0), pair("z", "z", 1.5)), rel_error=0.5
    )
    inside = math.erf(1.0 / math.sqrt(2.0)) * math.erf(1.5 / math.sqrt(2.0))
    assert abs(found.outside[0] - (1.0 - inside)) < 4.0 * found.outside_error[0] + 1e-4


def test_records_have_the_deviations_of_the_structure_under_every_noise() -> None:
    """White, filtered and tabulated noise together, at two places and on the base."""
    scene = random_scene(5, 3, 3, 4.0).model_copy(
        update={
            "excitations": (
                WhiteNoise(intensity=0.1, on="q0"),
                FilteredNoise(intensity=0.3, frequency_hz=0.2, zeta=0.2, on="q1"),
                TabulatedNoise(
                    frequency_hz=[0.02, 0.2, 2.0], density=[0.5, 1.0, 0.1], unit="(m/s2)2/Hz",
                    on="base",
                ),
            )
        }
    )  # fmt: skip
    model = model_of(scene)
    motion = PairMotion(model)
    variance = np.diag(motion.correlations[0, 0])
    speeds = -np.diag(motion.correlations[2, 0])
    # Rice's rate at 5 sigma changes by 25 times the relative error of sigma
    np.testing.assert_allclose(np.sqrt(variance), motion.displacement_std, rtol=2e-4)
    np.testing.assert_allclose(np.sqrt(speeds), motion.velocity_std, rtol=2e-4)
    sample = motion.response.records(3, 0, 32, np.arange(3))[:, ::40, 0::2].reshape(-1, 3)
    spread = np.cov(sample.T) / np.outer(motion.displacement_std, motion.displacement_std)
    wanted = motion.correlations[0, 0] / np.sqrt(np.outer(variance, variance))
    # some 4000 independent samples
    np.testing.assert_allclose(spread, wanted, atol=5.0 * math.sqrt(2.0 / 4000.0))


def no_hits(*_: object, **__: object) -> None:
    """In place of the simulation of impacts, which has tests of its own."""
    raise NotApplicable("hits", ["they are left out here"])


def test_reliability_of_any_pair_and_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stochvi.statistics.reliability.method.hits_of_pairs", no_hits)
    scene = uncoupled(pair("x", "x", 3.3), pair("z", "z", 3.6))
    found = reliability(scene, mission=MISSION, seed=1)
    parts = [each.probability for each in found.pairs.values()]
    none = math.prod(1.0 - each.value for each in parts)
    error = none * math.hypot(*(each.standard_error for each in parts))
    chance = found.chances["hit"]
    assert_agrees(both(chance.estimate, 1.0 - none, error), 1.0 - none)
    assert chance.lower < 1.0 - none < chance.upper
    assert sum(each.share_of_first_hits for each in found.pairs.values()) == pytest.approx(1.0)
    (alone,) = reliability(scene, mission=MISSION, seed=2, pair="z").chances.values()
    known = parts[1]
    assert_agrees(both(alone.estimate, known.value, known.standard_error), known.value)


def test_hits_of_pairs_that_lose_nothing_are_those_of_the_exact_law() -> None:
    """Pair by pair of two oscillators that know nothing of each other."""
    elastic = Restitution(coefficient=1.0)
    walls = [each.replace(law=elastic) for each in (pair("x", "x", 3.0), pair("z", "z", 3.2))]
    found = reliability(uncoupled(*walls), mission=MISSION, rel_error=0.1, seed=1)
    hazards = {}
    for wall, damping, stiffness, intensity in zip(
        walls, (0.1, 0.2), (1.0, 4.0), (0.2, 1.6), strict=True
    ):
        alone = Scene(
            structure=Oscillator(mass=1.0, damping=damping, stiffness=stiffness),
            impact_pairs=[ImpactPair(lower=wall.lower, upper=wall.upper, law=elastic)],
            excitations=[WhiteNoise(intensity=intensity)],
        )
        known, risk = exact(alone).impact_pairs["stops"], found.pairs[wall.name]
        assert risk.expected_hits is not None and risk.impact_speed_mean is not None
        for estimate, truth in (
            (risk.expected_hits, MISSION * float(known.collision_rate or 0.0)),
            (risk.impact_speed_mean, float(known.impact_speed_mean or 0.0)),
        ):
            plain = Estimate(value=estimate.value, standard_error=estimate.standard_error)
            assert_agrees(plain, truth)
            with pytest.raises(AssertionError):
                assert_agrees(plain, 1.2 * truth)
        hazards[wall.name] = -math.log1p(-risk.probability.value)
    for name, hazard in hazards.items():  # of independent pairs each comes first by its hazard
        share = hazard / sum(hazards.values())
        assert found.pairs[name].share_of_first_hits == pytest.approx(share, abs=0.03)


@pytest.mark.slow
def test_expected_hits_and_hard_hits_of_pairs() -> None:
    scene = uncoupled(pair("x", "x", 5.0), pair("z", "z", 5.0))
    found = reliability(scene, mission=MISSION, impact_speed=2.0, rel_error=0.4, seed=1)
    speed, hit = found.chances["impact_speed"], found.chances["hit"]
    assert speed.way == "bursts" and 0.0 < speed.estimate.value < hit.estimate.value
    assert found.hits is not None and found.hits_interval is not None
    by_pair = [each.expected_hits for each in found.pairs.values()]
    assert found.hits.value == pytest.approx(sum(each.value for each in by_pair if each))
    assert found.hits.value > -math.log1p(-hit.estimate.value)


@pytest.mark.parametrize(("change", "words"), [
    ({"pair": "y"}, "pair must be one of x"),
    ({"peak_acceleration": 1.0}, "a restitution alone does not give a force"),
    ({"at": "x"}, "belongs to peak_acceleration"),
    ({"start": "rest"}, "start must be 'stationary'"),
    ({"way": "crude"}, "way must be 'first crossings'"),
])  # fmt: skip
def test_what_reliability_of_pairs_does_not_cover(change: dict[str, object], words: str) -> None:
    scene = uncoupled(pair("x", "x", 3.3))
    with pytest.raises((NotApplicable, ValueError), match=words):
        reliability(scene, mission=MISSION, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(("pairs", "excitations", "words"), [
    ([pair("x", "x", 3.0)], [Sine(amplitude=1.0, frequency_hz=1.0, on="x")], "got a sine alone"),
    ([pair("z", "z", 3.0)], [WhiteNoise(intensity=0.2, on="x")], "must move at least one gap"),
    ([ImpactPair(name="x", on="x", lower=1.0, law=LAW)], [WhiteNoise(intensity=0.2, on="x")],
     "mean gap of x must lie between"),
])  # fmt: skip
def test_what_has_no_first_crossings(
    pairs: Sequence[ImpactPair], excitations: Sequence[WhiteNoise | Sine], words: str
) -> None:
    scene = uncoupled(*pairs).model_copy(update={"excitations": tuple(excitations)})
    with pytest.raises(NotApplicable, match=words):
        first_crossings(scene)
