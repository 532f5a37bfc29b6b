"""The probability of any impact under noise with fast peaks, against counted missions of the engine
and, where the noise is Gaussian, against first crossings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    reliability,
    screen,
)
from stochvi.methods.monte_carlo.history_plans import plan_histories
from stochvi.model.model import model_of
from stochvi.results.deadline import NEVER
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_error
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.free_windows import windows_of
from stochvi.statistics.pair_crossings import own_distances
from stochvi.statistics.trial_splitting import pilot, repetition
from stochvi.testing import assert_agrees
from support.accuracies import rel_errors

BAND = TabulatedNoise(frequency_hz=[5.0, 100.0], density=[0.01, 0.01], unit="g2/Hz")
PEAKED = BAND.replace(kurtosis=8.0)
STIFF, SOFT = Isolator(frequency_hz=60.0, zeta=0.4), Isolator(frequency_hz=12.0, zeta=0.05)


def between(mount: Isolator, sigmas: float, *noises: object, upper_alone: bool = False) -> Scene:
    """A mount with stops at so many standard deviations of its motion by the band."""
    free = Scene(structure=mount, excitations=[BAND])
    clearance = sigmas * screen(free).displacement_std
    sides = {"upper": clearance} if upper_alone else {"clearance": clearance}
    pair = ImpactPair(**sides, law=Restitution(coefficient=0.7))
    return Scene(structure=mount, impact_pairs=[pair], excitations=list(noises) or [PEAKED])


def counted(scene: Scene, mission: float, missions: int, together: int = 64) -> Estimate:
    """Share of the missions without stops, as the engine flies them, that go beyond a stop."""
    plan = plan_histories(scene.replace(impact_pairs=())).plan.sampled(1e9, mission)
    samples = plan.history_samples(mission)
    below, above = own_distances(model_of(scene))
    hit = 0
    for first in range(0, missions, together):
        motion = plan.histories(11, first, together, samples).displacement[0]
        hit += int(np.sum((motion.max(axis=1) > above[0]) | (motion.min(axis=1) < -below[0])))
    share = hit / missions
    return Estimate(value=share, standard_error=math.sqrt(share * (1.0 - share) / missions))


def found_for(scene: Scene, mission: float, rel_error: float) -> Estimate:
    answer = reliability(scene, mission=mission, rel_error=rel_error, seed=2, budget=None)
    return answer.chances["hit"].estimate


def both(own: Estimate, judge: Estimate) -> Estimate:
    """An estimate with the errors of its judge, too."""
    error = math.hypot(own.standard_error or 0.0, judge.standard_error or 0.0)
    return Estimate(value=own.value, standard_error=error, bias=own.bias)


@pytest.mark.slow
@pytest.mark.parametrize("upper_alone", [False, True])
@rel_errors(0.1, 0.03)
def test_the_chance_of_a_hit_is_that_of_counted_missions(
    upper_alone: bool, rel_error: float
) -> None:
    scene = between(STIFF, 8.0, upper_alone=upper_alone)
    mission, missions = 10.0, int(64 * round(0.1 / rel_error) ** 2) * 8
    judge, own = counted(scene, mission, missions), found_for(scene, mission, rel_error)
    assert 0.05 < judge.value < 0.95
    assert_agrees(both(own, judge), judge.value)
    # the control: Gaussian noise of the same density never gets there
    gaussian = between(STIFF, 8.0, BAND, upper_alone=upper_alone)
    assert found_for(gaussian, mission, 0.1).value < 1e-6 < judge.value


@pytest.mark.verify
def test_a_narrow_mount_is_hit_a_little_more_than_by_gaussian_noise() -> None:
    scene = between(SOFT, 4.0)
    mission = 60.0
    judge, own = counted(scene, mission, 1024), found_for(scene, mission, 0.1)
    assert_agrees(both(own, judge), judge.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(between(STIFF, 5.0, BAND), id="stiff"),
        pytest.param(
            between(SOFT, 4.5, BAND, WhiteNoise(density=1e-3, unit="g2/Hz")),
            id="soft, with white noise", marks=pytest.mark.verify,
        ),
    ],
)  # fmt: skip
def test_gaussian_pieces_have_the_chance_of_first_crossings(scene: Scene) -> None:
    """A mission of an hour, whose chance is found from pieces of seconds."""
    model, mission = model_of(scene), 3600.0
    below, above = own_distances(model)
    (judge,) = first_crossings(
        scene, lower=below, upper=above, mission=mission, rel_error=0.02
    ).probability(mission)
    kind = windows_of(model, below.tolist(), above.tolist(), mission, 3)
    levels = pilot(kind, 1.0, NEVER)
    assert levels.reached
    rows = np.array([repetition(kind, levels, number, NEVER) for number in range(24)])
    left_out = (rows.sum(axis=0) - rows) / (len(rows) - 1)

    def risk(each: np.ndarray) -> np.ndarray:
        return kind.risk(each[..., 0], each[..., 2], each[..., 3], mission)

    own = Estimate(
        value=float(risk(rows.mean(axis=0))), standard_error=jackknife_error(risk(left_out)),
        bias=judge.bias,
    )  # fmt: skip
    assert own.standard_error < 0.25 * own.value
    assert_agrees(both(own, judge), judge.value)
    # the control: a third of the probability is told apart
    with pytest.raises(AssertionError):
        assert_agrees(both(own, judge), 0.3 * judge.value)


@pytest.mark.slow
def test_answers_say_what_they_leave_out() -> None:
    answer = reliability(between(STIFF, 9.0), mission=10.0, rel_error=0.5, seed=1, budget=None)
    chance = answer.chances["hit"]
    assert chance.way == "splitting" and "noise with fast peaks" in chance.why
    assert answer.hits is None
    assert any("impacts counts all" in each for each in answer.assumptions)


def test_what_is_not_followed_is_refused_in_a_sentence() -> None:
    scene = between(STIFF, 5.0)
    for limit in ({"impact_speed": 0.1}, {"start": "rest"}):
        with pytest.raises(NotApplicable, match="noise with fast peaks"):
            reliability(scene, mission=10.0, **limit)
    beside = between(STIFF, 5.0, PEAKED, Sine(amplitude=1.0, frequency_hz=20.0))
    with pytest.raises(NotApplicable, match="sines must be left out beside noise with fast peaks"):
        reliability(beside, mission=10.0)
