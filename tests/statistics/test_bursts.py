"""Impact clusters from first impacts on, against exact laws and against simulating everything."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    exact,
    screen,
    simulate,
)
from stochvi.engine.sums import (
    EXTREME,
    EXTREMES,
    FASTEST,
    FORCE_SQUARE,
    FOUND,
    POSITION_FORCE,
    SHARPEST,
)
from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.exceedances import exceedances, window_sampler
from stochvi.isolators.sizing.targets import limit_of_pairs, widening
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.methods.monte_carlo.tabulated import plan_tabulated
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate, of_events
from stochvi.scenes.impact_laws import Law, SpeedRestitution
from stochvi.statistics.bursts import Bursts, bursts, chance_of, is_far
from stochvi.statistics.cluster_paths import ClusterPaths, widened
from stochvi.statistics.rare_hits import rare_hits
from stochvi.statistics.structure_hits import Limit, widening_of
from stochvi.testing import assert_agrees
from stochvi.views.report.stops import limit_in_words
from support.accuracies import rel_errors
from support.one_mass import Flown, fly_along, stops_at


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
    plan = plan_tabulated(model_of(scene), None, window)
    extremes = np.zeros((paths, EXTREMES))
    for first in range(0, paths, plan.block):
        plan.averages(3, first, plan.block, None, extremes[first : first + plan.block])
    share = float(np.mean(extremes[:, SHARPEST] > limit))
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


def test_a_contact_gives_its_largest_acceleration_and_integrals() -> None:
    """A free mass on a spring K: F = w W sin W t, W^2 = K, for half a period."""
    stiffness, w, h = 400.0, 1.5, 0.05
    found, place = np.zeros(FOUND), 2.0
    x, v = place - 0.5 * h * w, w
    at = stops_at({1.0: (place, Elastic(stiffness=stiffness))}, 0.0, shaken=True)
    flown = Flown.before()
    for _ in range(8):
        x, v = fly_along((x, v, x + h * v, v), h, (0.0, 0.0), at, flown, found)
    extremes = found[EXTREME:]
    frequency = math.sqrt(stiffness)
    half = 0.5 * math.pi / frequency
    assert extremes[FASTEST] == pytest.approx(w, rel=1e-12)
    # CONTACT_ERROR of the integration; of the crest, the cubic within a sub-step
    assert extremes[SHARPEST] == pytest.approx(w * frequency, rel=1e-5)
    assert extremes[FORCE_SQUARE] == pytest.approx((w * frequency) ** 2 * half, rel=1e-5)
    lever = place * 2.0 * w + w**2 * half
    assert extremes[POSITION_FORCE] == pytest.approx(lever, rel=1e-5)


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


@pytest.mark.parametrize("event", ["impact_energy", "hit"])
def test_an_event_that_is_not_known_is_refused_and_not_taken_for_another(event: str) -> None:
    scene = unit(4.0, Elastic(stiffness=1e4))
    found = bursts(scene, rel_error=0.5, seed=1)
    assert found.largest("impact_speed").tolist() != found.largest("peak_acceleration").tolist()
    sampler = window_sampler(scene, event, 10.0, 1)
    target = Target(name=event, value=1.0, unit="J", exceedance=0.1)
    asked: list[Callable[[], object]] = [
        lambda: found.largest(event),
        lambda: found.exceedance_rate(event, 1.0),
        lambda: rare_hits(scene, event, 1.0, mission=10.0, rel_error=0.5),
        lambda: exceedances(scene, [4.0], 10.0, event=event),
        lambda: widening_of(model_of(scene), Limit(event, 1.0)),
        lambda: sampler.simulate(0, 2),
        lambda: limit_of_pairs(scene, target, None),
        lambda: widening(scene, target, 1.0, 4.0),
        lambda: limit_in_words(target),
    ]
    for ask in asked:
        with pytest.raises(ValueError, match="event must be 'impact_speed' or 'peak_accel"):
            ask()
