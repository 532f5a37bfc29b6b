"""First passage: known numbers, a closed form, bounds that no answer may cross, brute force."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numba import njit
from scipy.special import gamma, hyp2f1, ndtr
from scipy.stats import norm

from stochvi import (
    ConstantLoad,
    Elastic,
    Estimate,
    ImpactPair,
    NotApplicable,
    NotConverged,
    Oscillator,
    Restitution,
    Scene,
    SpeedRestitution,
    TabulatedNoise,
    WhiteNoise,
    first_passage,
    fokker_planck,
    transient,
)
from stochvi.cli import main
from stochvi.mathematics.numerics import gauss_panels
from stochvi.mathematics.spectra import step_covariance, transition
from stochvi.methods.fokker_planck import FirstPassage, Gaussian, Transient, in_time, transients
from stochvi.methods.fokker_planck.basis import VelocityCells
from stochvi.methods.fokker_planck.in_time import InitialState, time_groups
from stochvi.methods.fokker_planck.transients import Moments, passages_at_most
from stochvi.model.model import Model, model_of
from stochvi.scenes import NonlinearOscillator
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import BENCH, RIGID_STOPS, oscillator
from support.refusals import refusals

PERIOD = 2.0 * math.pi


def lightly_damped(zeta: float = 0.05, load: float = 0.0) -> Scene:
    """Natural frequency and stationary deviations 1."""
    return oscillator(damping=2.0 * zeta, intensity=4.0 * zeta, load=load)


def free(intensity: float = 2.0) -> Scene:
    """A mass without spring or damping."""
    return oscillator(omega=0.0, damping=0.0, intensity=intensity)


def numbers(found: FirstPassage) -> list[Estimate]:
    return [*found.probability, found.mean_time, found.decay_rate]


def assert_same(found: FirstPassage, other: FirstPassage) -> None:
    """Two answers to one question, each within its own bound."""
    for one, two in zip(numbers(found), numbers(other), strict=True):
        assert one.bias is not None and two.bias is not None
        assert_agrees(replace(one, bias=one.bias + two.bias), two.value)


# Known answers ------------------------------------------------------------------------------

KNOWN = [
    # barrier, decay rate, mean time, P(ten periods) of another solver; half a last unit
    (2.0, (0.017595300, 5e-10), (65.85570, 5e-6), None),
    (3.0, (0.0018091405, 5e-11), (570.3591, 5e-5), (0.0784609, 5e-8)),
    (4.0, None, None, (0.00274504, 5e-9)),
]


@quick_cases("row", KNOWN, ids=lambda row: f"B={row[0]:g}", keep=(1,))
def test_known_rates_times_and_probabilities_are_met(row) -> None:
    barrier, *expected = row
    found = first_passage(lightly_damped(), -barrier, barrier, times=[10.0 * PERIOD], rtol=1e-5)
    for estimate, known in zip(
        (found.decay_rate, found.mean_time, found.probability[0]), expected, strict=True
    ):
        if known is not None:
            truth, half_unit = known
            assert estimate.bias is not None
            assert estimate.bias <= 1e-5 * estimate.value
            assert_agrees(replace(estimate, bias=estimate.bias + half_unit), truth)


def mean_time_in_a_box(place: float, length: float, diffusion: float) -> float:
    """Mean time that a free mass at rest, pushed by white noise, takes to leave a box.

    J. Masoliver, J. M. Porra, Phys. Rev. Lett. 75 (1995) 189; after J. N. Franklin, E. R. Rodemich,
    SIAM J. Numer. Anal. 5 (1968) 680. z = place / length, noise of intensity 2 diffusion.
    """
    z = place / length
    series = hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, z) + hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, 1.0 - z)
    scale = (4.0 / 3.0) ** (1.0 / 6.0) / gamma(7.0 / 3.0) * (length**2 / diffusion) ** (1.0 / 3.0)
    return float(scale * (z * (1.0 - z)) ** (1.0 / 6.0) * series)


@pytest.mark.parametrize(("place", "rtol"), [(1.0, 2e-6), (0.4, 1e-4)])
def test_a_free_mass_leaves_a_box_after_the_time_of_the_closed_form(place, rtol) -> None:
    found = first_passage(free(), 0.0, 2.0, start=(place, 0.0), rtol=rtol)
    assert_agrees(found.mean_time, mean_time_in_a_box(place, 2.0, 1.0))


def test_the_wrong_closed_form_is_caught() -> None:
    found = first_passage(free(1.98), -1.0, 1.0, rtol=1e-4)
    assert_differs(found.mean_time, mean_time_in_a_box(1.0, 2.0, 1.0))


# Bounds and limits --------------------------------------------------------------------------


def test_a_stationary_start_leaves_at_rices_rate_at_first_and_never_faster() -> None:
    """d/dt P = Rice's rate at t = 0; then it falls: some crossings are not the first."""
    times = [0.0, 0.01, 0.3, 3.0, 30.0]
    found = first_passage(lightly_damped(), -2.0, 2.0, times=times, start="stationary", rtol=1e-3)
    assert found.rice_rate is not None
    rice = math.exp(-2.0) / math.pi
    assert found.rice_rate.value == pytest.approx(rice, rel=1e-14)
    beyond = 2.0 * ndtr(-2.0)
    chances = [estimate.value for estimate in found.probability]
    assert chances[0] == pytest.approx(beyond, rel=1e-12)
    for time, chance in zip(times[1:], chances[1:], strict=True):
        assert beyond < chance < beyond + rice * time
    # a passage within h after another: of order sqrt(h), by the noise of the speed
    assert (chances[1] - beyond) / (0.01 * rice) == pytest.approx(1.0, abs=0.02)
    rates = np.diff(chances) / np.diff(times)
    assert (np.diff(rates) < 0.0).all()


@pytest.mark.slow
def test_rates_keep_their_digits_however_rare_and_approach_rices() -> None:
    """At 5.6 deviations the rate is 3e-8 of the frequency, at 7 it is 1e-12."""
    ratios = []
    for barrier, rtol in ((2.0, 1e-4), (3.0, 1e-4), (5.6, 3e-2), (7.0, 3e-2)):
        found = first_passage(lightly_damped(), -barrier, barrier, times=[100.0], rtol=rtol)
        rate, rice, chance = found.decay_rate, found.rice_rate, found.probability[0]
        assert rate.bias is not None and rice is not None
        assert rate.bias <= rtol * rate.value
        ratios.append(rate.value / rice.value)
        # from rest a path first needs some relaxation times, of 2 / b = 20 s
        soonest, latest = -np.expm1(-rate.value * np.array([100.0, 50.0]))
        assert latest < chance.value < soonest
    # the digits that the decay rates at 2 and 3 deviations are known to
    assert ratios[:2] == pytest.approx([0.408447, 0.511620], abs=1e-6)
    assert (np.diff(ratios) > 0.0).all()
    assert ratios[-1] < 1.0


def test_the_mean_time_is_the_integral_of_survival() -> None:
    """By Gauss's rule up to 15 s, and from there at the decay rate."""
    times, weights = gauss_panels([0.0, 0.1, 1.0, 5.0, 15.0], 6)
    scene = lightly_damped(0.3)
    found = first_passage(scene, -1.5, 1.5, times=[*times, 15.0], rtol=3e-4, start="stationary")
    survival = np.array([1.0 - estimate.value for estimate in found.probability])
    bounds = np.array([estimate.bias for estimate in found.probability])
    shares = np.append(weights, 1.0 / found.decay_rate.value)
    mean = found.mean_time
    assert mean.bias is not None
    bound = float(shares @ bounds) + mean.bias
    assert bound < 1e-3 * mean.value
    assert_agrees(replace(mean, bias=bound), float(shares @ survival))


RARE = lightly_damped(0.0109), 4.913, (-0.87155, 0.21364)
"""Hardly damped, the barrier five deviations away: early probabilities are nothing beside later
ones."""


@pytest.mark.verify
def test_early_times_take_nothing_from_later_ones(recwarn) -> None:
    """The projection cannot follow the earliest times here, and need not."""
    scene, barrier, start = RARE
    early, late = [1e-3, 0.1, 1.0, 6.28, 20.0], [1e5]
    alone = first_passage(scene, None, barrier, times=late, start=start, rtol=2e-3)
    found = first_passage(scene, None, barrier, times=[*early, *late], start=start, rtol=2e-3)
    assert numbers(found)[len(early) :] == numbers(alone)
    negligible = -math.expm1(-20.0 * alone.decay_rate.value) * 2e-3
    for estimate in found.probability[: len(early)]:
        assert estimate.bias is not None
        assert estimate.value + estimate.bias < negligible
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


@pytest.mark.verify
def test_a_time_that_the_projection_fails_at_is_alone_in_its_doubt(monkeypatch, recwarn) -> None:
    """Without the bound and with few sizes of the space, the early times are lost: they alone."""
    scene, barrier, start = RARE
    monkeypatch.setattr(transients, "passages_at_most", lambda *problem: np.ones(len(problem[-1])))
    monkeypatch.setattr(in_time, "LEVELS", in_time.LEVELS[:2])
    monkeypatch.setattr(in_time, "SIZES", (16, 24, 34, 46))
    with pytest.raises(NotConverged, match="relative error") as reason:
        first_passage(scene, None, barrier, times=[6.28, 20.0, 1e5], start=start, rtol=2e-3)
    reached = reason.value.partial
    assert isinstance(reached, FirstPassage)
    *lost, late = reached.probability
    for kept in (late, reached.decay_rate, reached.mean_time):
        assert kept.bias is not None
        assert kept.bias < 2e-3 * kept.value
    for estimate in lost:
        assert estimate.bias is not None
        assert estimate.bias > 2e-3 * -math.expm1(-40.0 * reached.decay_rate.value)
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


# Symmetries and starts ----------------------------------------------------------------------


def test_a_halved_box_is_the_whole_one() -> None:
    """A barrier moved by 1e-9 breaks the symmetry, and the box is solved whole."""
    start = (-0.5, 0.7)
    half, whole = (
        first_passage(lightly_damped(), -2.0, upper, times=[9.0], start=start, rtol=3e-3)
        for upper in (2.0, 2.0 + 1e-9)
    )
    assert half.mean_time.value != whole.mean_time.value
    assert_same(half, whole)


def test_a_mirrored_scene_and_a_shifted_one_answer_alike() -> None:
    one = first_passage(lightly_damped(), -1.0, 2.0, times=[30.0], start=(0.5, -1.0), rtol=3e-3)
    mirrored = first_passage(
        lightly_damped(), -2.0, 1.0, times=[30.0], start=(-0.5, 1.0), rtol=3e-3
    )
    shifted = first_passage(
        lightly_damped(load=0.3), -0.7, 2.3, times=[30.0], start=(0.8, -1.0), rtol=3e-3
    )
    assert_same(one, mirrored)
    assert_same(one, shifted)


def test_units_are_only_units() -> None:
    natural = first_passage(lightly_damped(), None, 2.0, times=[30.0], rtol=3e-3)
    metres, seconds = BENCH.length, 1.0 / BENCH.omega
    bench = first_passage(
        oscillator(units=BENCH), None, 2.0 * metres, times=[30.0 * seconds], rtol=3e-3
    )
    assert bench.probability[0].value == pytest.approx(natural.probability[0].value, rel=1e-7)
    assert bench.mean_time.value == pytest.approx(seconds * natural.mean_time.value, rel=1e-7)


def test_a_point_that_flies_for_a_while_is_the_gaussian_it_becomes() -> None:
    """P(t + h) from rest is P(t) from the law after h, as long as no barrier is near."""
    early = 0.6
    generator = np.array([[0.0, 1.0], [-1.0, -0.1]])
    spread = step_covariance(generator, np.diag([0.0, 0.2]), early)
    mean = transition(generator, early) @ np.array([0.2, -0.4])
    law = Gaussian(mean=tuple(mean), covariance=tuple(map(tuple, spread)))
    point = first_passage(lightly_damped(), -1.5, 1.5, times=[9.0], start=(0.2, -0.4), rtol=1e-3)
    after = first_passage(lightly_damped(), -1.5, 1.5, times=[9.0 - early], start=law, rtol=1e-3)
    for one, two in zip(point.probability, after.probability, strict=True):
        assert one.bias is not None and two.bias is not None
        assert_agrees(replace(one, bias=one.bias + two.bias), two.value)
    assert after.mean_time.value == pytest.approx(point.mean_time.value - early, rel=2e-3)


def test_a_barrier_far_beyond_the_other_is_as_good_as_none() -> None:
    one, two = (
        first_passage(lightly_damped(), lower, 2.0, times=[30.0], rtol=3e-3)
        for lower in (None, -40.0)
    )
    assert numbers(one) == numbers(two)
    assert (one.lower, two.lower) == (None, -40.0)


def test_the_stops_are_the_barriers_whatever_their_law() -> None:
    bare = first_passage(lightly_damped(), -1.5, 2.0, times=[30.0], rtol=3e-3)
    laws = (
        Restitution(coefficient=0.3),
        Elastic(stiffness=50.0),
        SpeedRestitution(coefficient=lambda speed: 0.8 / (1.0 + speed)),
    )
    for law in laws:
        pair = ImpactPair(lower=-1.5, upper=2.0, law=law)
        scene = lightly_damped().model_copy(update={"impact_pairs": (pair,)})
        found = first_passage(scene, times=[30.0], rtol=3e-3)
        assert numbers(found) == numbers(bare)
        assert (found.lower, found.upper) == (-1.5, 2.0)
    nearer = first_passage(scene, -1.0, 1.0, times=[30.0], rtol=3e-3)
    assert nearer.probability[0].value > bare.probability[0].value


LONG = pytest.mark.verify
HARD = [
    (lightly_damped(0.01), (-2.0, 2.0), "rest"),
    (lightly_damped(), (-0.05, 0.05), "rest"),
    pytest.param(lightly_damped(2.0), (-1.5, 3.0), "stationary", marks=LONG),
    pytest.param(lightly_damped(load=-2.0), (None, -1.0), "rest", marks=LONG),
    pytest.param(lightly_damped(), (None, -0.5), (-1.0, 0.5), marks=LONG),
    pytest.param(oscillator(damping=0.0, intensity=0.02), (None, 1.0), "rest", marks=LONG),
    pytest.param(lightly_damped(0.003), (-2.5, 2.5), "stationary", marks=LONG),
]


@pytest.mark.parametrize(("scene", "ends", "start"), HARD, ids=range(len(HARD)))
def test_the_stated_bound_holds_against_a_finer_answer(scene, ends, start) -> None:
    times = [4.0, 40.0]
    rough = first_passage(scene, *ends, times=times, start=start, rtol=0.02)
    fine = first_passage(scene, *ends, times=times, start=start, rtol=5e-4)
    assert_same(rough, fine)


def test_every_time_finds_a_pole() -> None:
    times = np.array([0.0, 1e-9, 0.1, 1.0, 30.0, 1e9])
    groups = list(time_groups(times, 1.0))
    assert sorted(place for places, _ in groups for place in places) == list(range(len(times)))
    assert {shift for _, shift in groups} >= {1.0}


# A stop opposite the barrier ------------------------------------------------------------------


@pytest.mark.parametrize("load", [0.0, 0.3])
def test_an_elastic_stop_at_rest_is_a_mirror(load: float) -> None:
    """Its paths are the amounts of those without a stop, which leave at either of two barriers."""
    stopped = oscillator(load, None, 1.0, damping=0.2, intensity=0.4, load=load)
    given = {"times": [3.0, 30.0], "start": (load + 0.2, 0.5)}
    turned = first_passage(stopped, upper=load + 1.5, **given)
    whole = first_passage(lightly_damped(0.1, load), load - 1.5, load + 1.5, **given)
    assert_same(turned, whole)
    assert turned.rice_rate is None and "turns paths back" in " ".join(turned.assumptions)
    lossy = first_passage(
        oscillator(load, None, 0.9, damping=0.2, intensity=0.4, load=load),
        upper=load + 1.5,
        **given,
    )
    with pytest.raises(AssertionError):
        assert_same(lossy, whole)


def test_a_stop_out_of_reach_is_as_good_as_none() -> None:
    far = oscillator(-30.0, None, 0.5, damping=0.2, intensity=0.4)
    assert_same(
        *(first_passage(each, upper=1.5, times=[5.0]) for each in (far, lightly_damped(0.1)))
    )


def passed_beside_a_stop(step: float, restitution: float, omega: float, paths: int) -> Estimate:
    """Share of paths from rest that meet 1 within 10 s, with a stop at -0.5: kicks and flights by
    turns, and a mirror at the stop. What a path does between steps is not seen."""
    rng = np.random.default_rng(6)
    x, v = np.zeros((2, paths))
    passed = np.zeros(paths, dtype=bool)
    for _ in range(round(10.0 / step)):
        v += math.sqrt(0.4 * step) * rng.standard_normal(paths) - step * (omega**2 * x + 0.2 * v)
        x += step * v
        hit = (x < -0.5) & (v < 0.0)
        x, v = (
            np.where(hit, -0.5 - restitution * (x + 0.5), x),
            np.where(hit, -restitution * v, v),
        )
        passed |= x >= 1.0
    share = float(passed.mean())
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / paths))


@pytest.mark.slow
@pytest.mark.parametrize(("restitution", "omega"), [(0.8, 1.0), (0.3, 1.0), (0.8, 0.0)])
def test_a_plain_integration_turns_paths_back_as_often(restitution: float, omega: float) -> None:
    scene = oscillator(-0.5, None, restitution, omega=omega, damping=0.2, intensity=0.4)
    known = first_passage(scene, upper=1.0, times=[10.0], rtol=1e-3).probability[0]
    fine, coarse = (
        passed_beside_a_stop(step, restitution, omega, 20_000) for step in (0.005, 0.01)
    )
    bias = abs(fine.value - coarse.value) + fine.standard_error + (known.bias or 0.0)
    assert_agrees(replace(fine, bias=bias), known.value)
    other = oscillator(-0.5, None, 1.0 - restitution, omega=omega, damping=0.2, intensity=0.4)
    wrong = first_passage(other, upper=1.0, times=[10.0], rtol=1e-3).probability[0]
    assert_differs(replace(fine, bias=bias), wrong.value)


# Brute force --------------------------------------------------------------------------------


def passed_before(
    barrier: float, zeta: float, duration: float, step: float, paths: int, *, between: bool = True
) -> Estimate:
    """Share of paths from rest that meet +-barrier: exact steps, and between them the cubic that
    displacements and velocities at both ends define, unless `between` is switched off."""
    rng = np.random.default_rng(5)
    generator = np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    move = transition(generator, step)
    noise = np.linalg.cholesky(step_covariance(generator, np.diag([0.0, 4.0 * zeta]), step))
    x, v = np.zeros((2, paths))
    passed = np.zeros(paths, dtype=bool)
    inside = np.linspace(0.0, 1.0, 7)[1:-1, None]
    for _ in range(round(duration / step)):
        draws = noise @ rng.standard_normal((2, paths))
        x_new, v_new = move @ np.stack([x, v]) + draws
        passed |= np.abs(x_new) >= barrier
        if between:
            a, b = step * v - (x_new - x), step * v_new - (x_new - x)
            chord = x + inside * (x_new - x)
            cubic = chord + inside * (1.0 - inside) * (a * (1.0 - inside) - b * inside)
            passed |= (np.abs(cubic) >= barrier).any(axis=0)
        x, v = x_new, v_new
    share = float(passed.mean())
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / paths))


def test_brute_force_agrees() -> None:
    known = first_passage(lightly_damped(0.1), -2.0, 2.0, times=[12.0]).probability[0]
    sampled = passed_before(2.0, 0.1, 12.0, 0.1, 20_000)
    assert known.bias is not None
    assert_agrees(replace(sampled, bias=known.bias), known.value)


def test_looking_at_the_ends_of_long_steps_alone_is_caught() -> None:
    known = first_passage(lightly_damped(0.1), -2.0, 2.0, times=[12.0]).probability[0]
    sampled = passed_before(2.0, 0.1, 12.0, 1.0, 20_000, between=False)
    assert_differs(sampled, known.value)


@pytest.mark.verify
@pytest.mark.parametrize(("barrier", "zeta", "duration"), [(2.0, 0.05, 63.0), (3.0, 0.2, 60.0)])
def test_brute_force_agrees_at_length(barrier, zeta, duration) -> None:
    known = first_passage(lightly_damped(zeta), -barrier, barrier, times=[duration]).probability[0]
    sampled = passed_before(barrier, zeta, duration, 0.05, 400_000)
    assert known.bias is not None
    assert_agrees(replace(sampled, bias=known.bias), known.value)


@njit
def _fly(x, v, step, noise, floor, goal, barrier, paths):  # type: ignore[no-untyped-def]
    """From states drawn of (x, v) until the energy has risen to `goal` (the displacement to
    `barrier`, if that is above 0) or fallen to `floor`: the states of those that got there."""
    found = np.zeros((2, paths))
    arrived = 0
    for _ in range(paths):
        place = np.random.randint(len(x))  # noqa: NPY002
        a, b = x[place], v[place]
        while True:
            first, second = np.random.standard_normal(2)  # noqa: NPY002
            a_new = step[0, 0] * a + step[0, 1] * b + noise[0, 0] * first
            b = step[1, 0] * a + step[1, 1] * b + noise[1, 0] * first + noise[1, 1] * second
            a = a_new
            energy = (a * a + b * b) / 2.0
            if (barrier > 0.0 and abs(a) >= barrier) or (barrier == 0.0 and energy >= goal):
                found[0, arrived], found[1, arrived] = a, b
                arrived += 1
                break
            if energy < floor:
                break
    return found[:, :arrived]


def rare_rate(barrier: float, zeta: float, paths: int) -> Estimate:
    """Forward flux sampling (R. J. Allen et al., Phys. Rev. Lett. 94 (2005) 018104): the rate of
    rising from the bulk to a first energy, times the probabilities to rise from each to the
    next."""
    h, floor, energies = 0.02, 0.7, np.arange(2.0, barrier**2 / 2.0 - 0.5, 1.4)
    generator = np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    step = transition(generator, h)
    noise = np.linalg.cholesky(step_covariance(generator, np.diag([0.0, 4.0 * zeta]), h))
    x, v = _record(step, noise, 30_000_000)
    energy = (x**2 + v**2) / 2.0
    risen, inside = [], True
    for place in np.flatnonzero((energy < floor) | (energy >= energies[0])):
        if energy[place] < floor:
            inside = True
        elif inside:
            risen.append(place)
            inside = False
    rate, variance = len(risen) / (h * len(x)), 1.0 / len(risen)
    states = np.stack([x[risen], v[risen]])
    for goal in [*energies[1:], 0.0]:
        last = barrier if goal == 0.0 else 0.0
        states = _fly(states[0], states[1], step, noise, floor, goal, last, paths)
        chance = states.shape[1] / paths
        rate, variance = rate * chance, variance + (1.0 - chance) / (chance * paths)
    return Estimate(value=rate, standard_error=rate * math.sqrt(variance))


@njit
def _record(step, noise, length):  # type: ignore[no-untyped-def]
    np.random.seed(3)  # noqa: NPY002
    x, v = np.zeros(length), np.zeros(length)
    for k in range(1, length):
        first, second = np.random.standard_normal(2)  # noqa: NPY002
        x[k] = step[0, 0] * x[k - 1] + step[0, 1] * v[k - 1] + noise[0, 0] * first
        v[k] = step[1, 0] * x[k - 1] + step[1, 1] * v[k - 1]
        v[k] += noise[1, 0] * first + noise[1, 1] * second
    return x, v


@pytest.mark.verify
def test_a_rare_rate_agrees_with_splitting() -> None:
    """3e-8 of the frequency. Looked at after each step alone, excursions shorter than a step are
    missed: those of speeds below h B / 2, a part (h B / 2)^2 / 2 by Rayleigh's distribution."""
    known = first_passage(lightly_damped(0.02), -5.6, 5.6).decay_rate
    sampled = rare_rate(5.6, 0.02, 60_000)
    missed = (0.02 * 5.6 / 2.0) ** 2 / 2.0
    assert sampled.standard_error < 0.05 * known.value
    assert_agrees(replace(sampled, bias=missed * known.value), known.value)


# What is refused, and what is told ----------------------------------------------------------


def test_the_document_is_plain_and_complete() -> None:
    found = first_passage(lightly_damped(), -1.0, None, times=[1.0, 2.0], rtol=0.01)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["method"] == "first-passage"
    assert document["barriers"] == {"lower": -1.0, "upper": None}
    assert len(document["probability"]) == len(found.to_frame()) == 2
    assert document["mean_time"]["value"] == found.mean_time.value
    assert repr(found).startswith("FirstPassage: mean time to the first passage ")


NO_STOPS = lightly_damped()
STOPPED = oscillator(-1.0, 1.0, 0.5)
SOFT = Scene(
    structure=STOPPED.structure,
    impact_pairs=[ImpactPair(lower=-1.0, law=Elastic(stiffness=50.0))],
    excitations=STOPPED.excitations,
)


test_what_does_not_apply_is_said_in_a_sentence = refusals(
    lambda scene, ends: first_passage(scene, *ends),
    (NO_STOPS, (None, None), "there must be a lower or an upper barrier"),
    (NO_STOPS, (1.0, -1.0), "barriers must have lower < upper, got 1 and -1"),
    (STOPPED, (-0.5, 1.5), "got upper at 1.5 m and a stop at 1 m"),
    (SOFT, (None, 0.5), "law of the lower stop must be a restitution, as no barrier is"),
    (free(), (None, 1.0), "stiffness must be positive where only one barrier is"),
    (NO_STOPS, (-15.0, 15.0), "barriers must be within 10 standard deviations, got 15"),
    error=NotApplicable,
)


def test_a_spring_that_is_a_function_is_refused() -> None:
    hardening = NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=lambda x: x + x**3)
    scene = Scene(structure=hardening, excitations=[WhiteNoise(intensity=0.2)])
    with pytest.raises(NotApplicable, match="must not be 'nonlinear'"):
        first_passage(scene, -1.0, 1.0)


def test_only_white_noise_is_covered() -> None:
    table = TabulatedNoise(on="x", frequency_hz=[1.0, 2.0], density=[1.0, 1.0], unit="N2/Hz")
    for excitation, got in ((table, "tabulated"), (ConstantLoad(force=1.0), "constant load")):
        scene = Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0), excitations=[excitation]
        )
        with pytest.raises(NotApplicable, match=got):
            first_passage(scene, -1.0, 1.0)


test_an_argument_out_of_range_is_named = refusals(
    lambda options: first_passage(NO_STOPS, -1.0, 1.0, **options),
    ({"rtol": 0.0}, "rtol must be at least 1e-12, got 0"),
    ({"rtol": 1e-30}, "rtol must be at least 1e-12, got 1e-30"),
    ({"times": [-1.0]}, "times must be finite and at least 0 s"),
    ({"times": [math.inf]}, "times must be finite"),
    ({"start": (1.0, 0.0)}, "start must lie between the barriers"),
    ({"start": (0.0, math.nan)}, "start must be a finite"),
    ({"start": "asleep"}, "start must be 'rest', 'stationary'"),
    error=ValueError,
)


def test_a_stationary_start_needs_a_stationary_law() -> None:
    with pytest.raises(ValueError, match="needs a stiffness and a damping"):
        first_passage(free(), -1.0, 1.0, start="stationary")


@pytest.mark.parametrize(
    "covariance", [((1.0, 0.0), (0.0, 0.0)), ((1.0, 2.0), (2.0, 1.0)), ((1.0, 0.1), (0.2, 1.0))]
)
def test_a_covariance_that_is_none_is_refused(covariance) -> None:
    with pytest.raises(ValueError, match="symmetric and positive definite"):
        Gaussian(mean=(0.0, 0.0), covariance=covariance)


def test_an_accuracy_out_of_reach_is_not_claimed(monkeypatch) -> None:
    monkeypatch.setattr(in_time, "LEVELS", in_time.LEVELS[:2])
    with pytest.raises(NotConverged, match="reached a relative error of") as reason:
        first_passage(lightly_damped(0.002), -2.0, 2.0, rtol=1e-7)
    reached = reason.value.partial
    assert isinstance(reached, FirstPassage)
    assert reached.decay_rate.bias is not None
    assert reached.decay_rate.bias > 1e-7 * reached.decay_rate.value


def test_the_lowest_place_is_that_of_the_potential() -> None:
    falling = model_of(oscillator(omega=0.0, damping=0.0, intensity=2.0, load=1.0))
    assert in_time.lowest(falling, -1.0, 2.0) == 2.0
    assert in_time.rise(falling, -1.0, 2.0) == 3.0


# The command --------------------------------------------------------------------------------


@pytest.fixture
def stochvi(capsys: pytest.CaptureFixture[str]):
    """The command first-passage with these options: exit code, stdout, stderr."""

    def run(*options: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main(["first-passage", LOSSY, *options], prog_name="stochvi")
        return (int(stop.value.code or 0), *capsys.readouterr())

    return run


LOSSY = str(shipped_scene("oscillator-lossy"))


def test_the_command_answers_with_a_table_a_document_and_a_picture(stochvi, tmp_path) -> None:
    options = ("--mission", "50", "--rtol", "0.05", "--json", "-", "--out", str(tmp_path))
    code, out, err = stochvi(*options)
    document = json.loads(out)
    assert code == 0
    assert document["barriers"] == {"lower": -1.0, "upper": 1.0}
    assert document["times"][-1] == 50.0
    assert "P(first passage before t)" in err and "mean time to the first passage" in err
    assert len(pd.read_csv(tmp_path / "first_passage.csv")) == len(document["times"])
    assert (tmp_path / "first_passage.png").stat().st_size > 10_000


def test_barriers_on_the_command_line_are_those_of_python(stochvi) -> None:
    options = ("--barrier", "-0.9,0.5", "--times", "20,40", "--start", "stationary")
    code, out, err = stochvi(*options, "--rtol", "0.05", "--json", "-", "--quiet")
    found = first_passage(
        load_scene(LOSSY), -0.9, 0.5, times=[20.0, 40.0], start="stationary", rtol=0.05
    )
    assert (code, err) == (0, "")
    assert json.loads(out)["probability"] == found.to_dict()["probability"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ((), "needs exactly one of --times and --mission; give one"),
        (
            ("--times", "1", "--mission", "1"),
            "needs exactly one of --times and --mission; give one",
        ),
        (("--times", "1,x"), "--times must be numbers with commas, got '1,x'"),
        (("--mission", "1", "--barrier", "-3"), "--barrier must be positive"),
        (("--mission", "1", "--barrier", ","), "--barrier must be B, or LO,HI with at least"),
        (("--mission", "1", "--barrier", "-3,3"), "barriers must not lie beyond a stop"),
        (
            ("--mission", "1", "--barrier", ",0.5", "--start", "stationary"),
            "start must lie between the lower stop and the barrier",
        ),
        (("--mission", "nan"), "--mission must be a number with a unit of time"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_an_option_out_of_range_is_one_sentence(stochvi, options, sentence) -> None:
    code, out, err = stochvi(*options)
    assert (code, out) == (2, "")
    assert sentence in err
    assert err.startswith("stochvi: ")


def test_an_accuracy_that_was_not_reached_exits_with_1_and_tells_what_was(
    stochvi, monkeypatch
) -> None:
    monkeypatch.setattr(in_time, "LEVELS", in_time.LEVELS[:2])
    code, out, err = stochvi("--times", "20", "--rtol", "1e-9", "--json", "-", "--quiet")
    assert code == 1
    assert err.startswith("stochvi: first-passage reached a relative error of")
    assert json.loads(out)["decay_rate"]["value"] > 0.0


# ------------------------------------------------------------------------------
# The bound on early first passages: Rice's integral, answers, what it does not know.
# ------------------------------------------------------------------------------


def linear(omega: float, damping: float, intensity: float, load: float) -> Model:
    """The model of an oscillator of unit mass without stops."""
    return model_of(oscillator(omega=omega, damping=damping, intensity=intensity, load=load))


def mean_crossings(model: Model, start: InitialState, barrier: float, duration: float) -> float:
    """Of an upper barrier from below before `duration`, by Rice's integral and Gauss's rule."""
    generator = np.array([[0.0, 1.0], [-(model.omega**2), -model.damping_rate]])
    places, weights = gauss_panels(np.linspace(0.0, duration, 41), 6)
    rest = np.array([model.rest, 0.0])
    total = 0.0
    for place, weight in zip(places, weights, strict=True):
        mean = rest + transition(generator, place) @ (np.array(start) - rest)
        spread = step_covariance(generator, np.diag([0.0, model.intensity]), place)
        slope = spread[0, 1] / spread[0, 0]
        speed = mean[1] + slope * (barrier - mean[0])
        noise = math.sqrt(spread[1, 1] - slope * spread[0, 1])
        upwards = speed * norm.cdf(speed / noise) + noise * norm.pdf(speed / noise)
        total += weight * norm.pdf(barrier, mean[0], math.sqrt(spread[0, 0])) * upwards
    return float(total)


BOUNDED = [
    # model, start, barrier, time
    (linear(1.0, 0.0218, 0.0436, 0.0), InitialState(-0.87, 0.21), 4.9, 20.0),
    (linear(1.0, 0.1, 0.2, 0.0), InitialState(0.5, -0.5), 2.5, 2.0),
    (linear(2.0, 0.4, 1.6, 2.0), InitialState(0.5, 0.0), 3.5, 3.0),
    (linear(1.0, 3.0, 2.0, -0.5), InitialState(-0.5, 0.0), 1.5, 3.0),
]


@pytest.mark.parametrize(("model", "start", "barrier", "duration"), BOUNDED)
def test_the_bound_is_above_rices_mean_crossings(model, start, barrier, duration) -> None:
    (bound,) = passages_at_most(model, start, -math.inf, barrier, np.array([duration]))
    crossings = mean_crossings(model, start, barrier, duration)
    assert 0.0 < crossings <= bound < 1.0
    # it knows that the noise has not had the time to spread to the stationary distribution
    rest = model.rest
    z = (barrier - rest) * model.omega / math.sqrt(model.intensity / 2.0 / model.damping_rate)
    assert bound < duration * model.omega / (2.0 * math.pi) * math.exp(-(z**2) / 2.0)
    # that of a barrier twice as far is no bound for this one
    (farther,) = passages_at_most(model, start, -math.inf, 2.0 * barrier, np.array([duration]))
    assert farther < crossings


def test_two_barriers_are_bounded_by_the_sum_and_what_is_unknown_by_one() -> None:
    model, start, times = linear(1.0, 0.1, 0.2, 0.2), InitialState(0.1, 0.2), np.array([0.0, 3.0])
    both, low, high = (
        passages_at_most(model, start, *ends, times)
        for ends in ((-2.5, 3.0), (-2.5, math.inf), (-math.inf, 3.0))
    )
    assert both[0] == 0.0
    assert both[1] == pytest.approx(low[1] + high[1], rel=1e-12)
    law = Gaussian(mean=(0.0, 0.0), covariance=((1.0, 0.0), (0.0, 1.0)))
    adrift = linear(0.0, 0.1, 0.2, 0.2)
    for case in ((model, law, -9.0, 9.0), (adrift, start, -9.0, 9.0), (model, start, -9.0, 0.1)):
        assert passages_at_most(*case, times[1:]).tolist() == [1.0]


def test_no_answer_crosses_the_bound() -> None:
    """Where both are known: early, and still with the digits that rtol asks for."""
    scene = oscillator(damping=0.4, intensity=0.8)
    times = [1.5, 2.0, 3.0]
    found = first_passage(scene, -2.2, 2.2, times=times, rtol=1e-3)
    bounds = passages_at_most(model_of(scene), InitialState(0.0, 0.0), -2.2, 2.2, np.array(times))
    for estimate, bound in zip(found.probability, bounds, strict=True):
        assert estimate.bias is not None
        assert estimate.bias < 0.5 * estimate.value < 0.5 * bound < 0.5


# ------------------------------------------------------------------------------
# Transients: exact laws, the stationary answer in the end, the balance of energy at any time.
# ------------------------------------------------------------------------------


FLYING = Gaussian(mean=(0.8, -0.7), covariance=((0.09, 0.05), (0.05, 0.2)))


def told(found: Transient, name: str, index: int) -> Estimate:
    value, bound = (float(getattr(group, name)[index]) for group in (found.values, found.errors))
    return Estimate(value=value, bias=bound)


# Exact laws ---------------------------------------------------------------------------------


def law_after(start: Gaussian, seconds: float, load: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of omega = 1, b = 0.1, S0 = 0.2 without stops."""
    generator = np.array([[0.0, 1.0], [-1.0, -0.1]])
    step = transition(generator, seconds)
    rest = np.array([load, 0.0])
    mean = rest + step @ (np.array(start.mean) - rest)
    spread = step_covariance(generator, np.diag([0.0, 0.2]), seconds)
    return mean, spread + step @ np.array(start.covariance) @ step.T


def test_without_stops_a_gaussian_stays_gaussian() -> None:
    times = [0.5, 2.0, 9.0]
    found = transient(oscillator(load=0.4), times, FLYING, rtol=2e-3)
    for index, seconds in enumerate(times):
        mean, spread = law_after(FLYING, seconds, 0.4)
        assert_agrees(told(found, "mean", index), mean[0])
        assert_agrees(told(found, "variance", index), spread[0, 0])
        assert_agrees(told(found, "velocity_mean", index), mean[1])
        assert_agrees(told(found, "velocity_mean_square", index), spread[1, 1] + mean[1] ** 2)
        law = Gaussian(mean=tuple(mean), covariance=tuple(map(tuple, spread)))
        x, v = (mean[k] + math.sqrt(spread[k, k]) * np.linspace(-2.0, 2.0, 9) for k in (0, 1))
        exact = law.density(x[:, None], v)
        largest = np.abs(found.density(x[:, None], v, index) - exact).max()
        assert largest < 0.01 * exact.max()


def test_a_wrong_damping_is_caught() -> None:
    found = transient(oscillator(damping=0.11, load=0.4), [2.0], FLYING, rtol=2e-3)
    _, spread = law_after(FLYING, 2.0, 0.4)
    assert_differs(told(found, "variance", 0), spread[0, 0])


def test_a_free_mass_between_elastic_stops_is_a_sum_of_mirror_images() -> None:
    """Unfolded, the mass is free: x = +-(y - 4 k) or its reflection about a stop."""
    damping, intensity, start = 0.5, 1.0, (0.3, 0.5)
    scene = oscillator(-1.0, 1.0, omega=0.0, damping=damping, intensity=intensity)
    times = [0.7, 2.0]
    found = transient(scene, times, start, rtol=3e-3)
    generator = np.array([[0.0, 1.0], [0.0, -damping]])
    x = np.linspace(-1.0, 1.0, 21)
    for index, seconds in enumerate(times):
        mean = transition(generator, seconds) @ np.array(start)
        spread = step_covariance(generator, np.diag([0.0, intensity]), seconds)
        law = Gaussian(mean=tuple(mean), covariance=tuple(map(tuple, spread)))
        for v in (-0.6, 0.0, 0.9):
            exact = sum(
                law.density(x + 4.0 * k, np.array(v)) + law.density(2.0 - x + 4.0 * k, np.array(-v))
                for k in range(-4, 5)
            )
            assert np.abs(found.density(x, v, index) - exact).max() < 2e-3 * exact.max()


# The stationary answer in the end -----------------------------------------------------------

SHARED = ("variance", "velocity_mean_square")


def assert_stationary(scene: Scene, found: Transient, index: int) -> None:
    truth = fokker_planck(scene, rtol=2e-3).estimates()
    pairs = {
        "mean": ("x", "displacement_mean"),
        "velocity_mean_square": ("x", "velocity_mean_square"),
    }
    for name, key in pairs.items():
        known, mine = truth[key], told(found, name, index)
        assert known.bias is not None and mine.bias is not None
        assert_agrees(replace(mine, bias=mine.bias + known.bias), known.value)
    for name in ("speed_rate", "speed_square_rate"):
        known = truth["stops", f"impact_{name}"]
        sides = [told(found, f"{name}_{side}", index) for side in ("lower", "upper")]
        total = sum(side.value for side in sides)
        bound = sum(side.bias or 0.0 for side in sides) + (known.bias or 0.0)
        assert_agrees(Estimate(value=total, bias=bound), known.value)


ENDED = [
    (oscillator(-0.6, 1.1, 0.7, load=-0.2), "rest", 5e-3),
    (oscillator(None, -0.3, 0.6), (-1.0, 0.0), 2e-2),
    (oscillator(-1.0, 1.0, 0.1), "rest", 5e-3),
]


@quick_cases(("scene", "start", "rtol"), ENDED, ids=range(len(ENDED)), keep=(0,))
def test_in_the_end_the_answer_is_stationary(scene: Scene, start, rtol: float) -> None:
    found = transient(scene, [1.0, 300.0], start, rtol=rtol)
    assert_stationary(scene, found, 1)
    with pytest.raises(AssertionError, match="differs from"):
        assert_stationary(scene, found, 0)


@quick_cases("row", RIGID_STOPS, ids=lambda row: f"R={row.restitution}", keep=(0, 3))
def test_the_near_exact_table_is_met_in_the_end(row) -> None:
    found = transient(oscillator(-1.0, 1.0, row.restitution), [400.0], rtol=3e-3)
    names = {
        "displacement_std": ("variance", 0.5),
        "velocity_std": ("velocity_mean_square", 0.5),
        "impact_speed_rate": ("speed_rate_upper", 1.0),
        "impact_speed_square_rate": ("speed_square_rate_upper", 1.0),
    }
    for known, (name, power) in names.items():
        mine = told(found, name, 0)
        both = 1.0 if power == 0.5 else 2.0
        value = (both * mine.value) ** power
        assert mine.bias is not None
        bound = power * value * mine.bias / mine.value + row.errors[known]
        assert_agrees(Estimate(value=value, bias=bound), row.values[known])


# At any time --------------------------------------------------------------------------------


def energy_gained(found: Transient, weights: np.ndarray, restitution: float) -> tuple[float, float]:
    """Over the inner times, by noise less damping and impacts, per unit mass; its error."""
    inner = slice(1, -1)
    rates, bounds = (
        group.velocity_mean_square[inner] * 0.1
        + sign * (1.0 - restitution**2) / 2.0 * sum(
            getattr(group, f"speed_square_rate_{side}")[inner] for side in ("lower", "upper")
        )
        for group, sign in ((found.values, 1.0), (found.errors, 1.0))
    )  # fmt: skip
    return float(weights @ (0.1 - rates)), float(weights @ bounds)


def energy(group: Moments, index: int) -> float:
    return (
        float(group.variance[index] + group.mean[index] ** 2 + group.velocity_mean_square[index])
        / 2.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.3, pytest.param(0.8, marks=pytest.mark.verify)])
def test_energy_is_gained_and_lost_as_noise_damping_and_impacts_say(restitution: float) -> None:
    """The balance of energy: d/dt E (v^2 + x^2) / 2 = S0 / 2 - b E v^2 - (1 - R^2) F2 / 2."""
    inner, weights = gauss_panels([1.0, 2.0, 4.0], 6)
    scene = oscillator(-0.8, 1.2, restitution)
    found = transient(scene, [1.0, *inner, 4.0], (0.0, 0.5), rtol=1e-2)
    gained, bound = energy_gained(found, weights, restitution)
    change = energy(found.values, -1) - energy(found.values, 0)
    sizes = [
        found.errors.variance[k] / 2.0
        + found.errors.velocity_mean_square[k] / 2.0
        + abs(found.values.mean[k]) * found.errors.mean[k]
        for k in (0, -1)
    ]
    estimate = Estimate(value=change, bias=bound + float(sum(sizes)))
    assert estimate.bias is not None
    assert estimate.bias < 0.05 * gained
    assert_agrees(estimate, gained)
    wrong, _ = energy_gained(found, weights, restitution - 0.1)
    assert_differs(estimate, wrong)


def test_the_density_holds_what_the_averages_say() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.5), [2.0], (0.2, 0.6), rtol=2e-3)
    # elements meet with small jumps
    operator = found._states[0].operator
    x, weights = gauss_panels(operator.mesh.x_breaks, 12)
    profile = found.displacement_density(x, 0)
    mean = float(weights @ (x * profile))
    assert float(weights @ profile) == pytest.approx(1.0, rel=1e-9)
    assert mean == pytest.approx(found.values.mean[0], rel=1e-9)
    assert float(weights @ (x**2 * profile)) - mean**2 == pytest.approx(
        found.values.variance[0], rel=1e-9
    )
    half = operator.box.speed * np.array(operator.mesh.u_breaks)
    v, v_weights = gauss_panels(np.union1d(-half, half), 12)
    again = found.density(x[5::12, None], v, 0) @ v_weights
    assert again == pytest.approx(profile[5::12], rel=1e-9)


def test_before_the_stops_are_felt_the_law_is_that_without_them() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.5), [0.1], rtol=1e-2)
    spread = step_covariance(np.array([[0.0, 1.0], [-1.0, -0.1]]), np.diag([0.0, 0.2]), 0.1)
    assert found.values.variance[0] == pytest.approx(spread[0, 0], rel=1e-12)
    assert found.values.speed_rate_upper[0] == 0.0
    peak = 1.0 / math.sqrt(2.0 * math.pi * spread[0, 0])
    assert found.displacement_density(0.0, 0) == pytest.approx(peak, rel=1e-12)


def test_a_mirrored_start_is_a_mirrored_answer() -> None:
    one, other = (
        transient(oscillator(-0.9, 0.9, 0.6), [1.5], (side * 0.3, side * 0.8), rtol=5e-2)
        for side in (1.0, -1.0)
    )
    assert one.values.mean[0] == pytest.approx(-other.values.mean[0], rel=1e-6)
    assert one.values.speed_rate_upper == pytest.approx(other.values.speed_rate_lower, rel=1e-6)


def test_units_are_only_units_transients() -> None:
    natural = transient(oscillator(-1.0, 1.0, 0.8), [3.0], rtol=2e-2)
    bench = transient(oscillator(-1.0, 1.0, 0.8, units=BENCH), [3.0 / BENCH.omega], rtol=2e-2)
    scale = BENCH.length**2
    assert bench.values.variance[0] == pytest.approx(scale * natural.values.variance[0], rel=1e-8)
    scale = BENCH.length * BENCH.omega**2
    assert bench.values.speed_rate_upper[0] == pytest.approx(
        scale * natural.values.speed_rate_upper[0], rel=1e-8
    )


def test_a_wrong_restitution_at_the_wall_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = VelocityCells.returned
    monkeypatch.setattr(
        VelocityCells, "returned", lambda self, r, side: right(self, r - 0.02, side)
    )
    scene = oscillator(-0.6, 1.1, 0.7, load=-0.2)
    found = transient(scene, [300.0], rtol=2e-3)
    monkeypatch.undo()
    with pytest.raises(AssertionError, match="differs from"):
        assert_stationary(scene, found, 0)


# What is refused, and what is told ----------------------------------------------------------


def test_the_document_is_plain_and_complete_transients() -> None:
    found = transient(oscillator(-1.0, 1.0, 0.8), [0.1, 5.0], rtol=0.02)
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["method"] == "transient"
    assert set(document["values"]) == set(document["errors"]) == set(Moments._fields)
    assert len(found.to_frame()) == len(document["times"]) == 2
    assert repr(found) == "Transient: 2 times from 0.1 to 5 s"


test_an_argument_out_of_range_is_named_transients = refusals(
    lambda options: transient(oscillator(-1.0, 1.0, 0.8), **{"times": [1.0], **options}),
    ({"times": []}, "times must be one or more finite numbers above 0"),
    ({"times": [0.0]}, "times must be one or more finite numbers above 0"),
    ({"rtol": -1.0}, "rtol must be at least 1e-12, got -1"),
    ({"start": "stationary"}, "start must be 'rest', a point or a Gaussian"),
    ({"start": (1.0, 0.0)}, "start must lie between the stops"),
    ({"start": FLYING}, "got a distribution with 25 % beyond"),
    error=ValueError,
)


def test_a_scene_without_a_stationary_state_is_refused() -> None:
    with pytest.raises(NotApplicable, match="stiffness must be positive"):
        transient(oscillator(omega=0.0), [1.0])


def test_an_accuracy_out_of_reach_is_not_claimed_transients(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(in_time, "LEVELS", in_time.LEVELS[:2])
    with pytest.raises(NotConverged, match="reached a relative error of") as reason:
        transient(oscillator(-1.0, 1.0, 0.8), [2.0], rtol=1e-9)
    assert isinstance(reason.value.partial, Transient)
