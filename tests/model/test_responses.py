"""From a few moments to a response: its quantities, and the bounds on their errors."""

import math
import time
from dataclasses import replace

import pytest

from stochvi.mathematics.impact_rates import StopStatistics
from stochvi.model.build_response import StationaryMoments
from support.known import oscillator, values

SCENE = oscillator(-1.0, 0.5, 0.7)
MOMENTS = StationaryMoments(
    mean=-0.2,
    variance=0.3,
    velocity_mean_square=0.6,
    upcrossing_rate=0.2,
    lower=StopStatistics(0.1, 0.07, 0.06),
    upper=StopStatistics(0.25, 0.16, 0.15),
)
ERRORS = StationaryMoments(
    mean=2e-5,
    variance=4e-5,
    velocity_mean_square=3e-5,
    upcrossing_rate=1e-5,
    lower=StopStatistics(1e-5, 2e-5, 3e-5),
    upper=StopStatistics(2e-5, 1e-5, 1e-5),
)


def moved(signs: tuple[int, ...]) -> StationaryMoments:
    """Each number off by its error, up or down."""
    sign = iter(signs)

    def stop(one: StopStatistics, error: StopStatistics) -> StopStatistics:
        return StopStatistics(
            *(a + next(sign) * b for a, b in zip(one[:3], error[:3], strict=True))
        )

    names = ("mean", "variance", "velocity_mean_square", "upcrossing_rate")
    return replace(
        MOMENTS,
        **{name: getattr(MOMENTS, name) + next(sign) * getattr(ERRORS, name) for name in names},
        lower=stop(MOMENTS.lower, ERRORS.lower),
        upper=stop(MOMENTS.upper, ERRORS.upper),
    )


def response(answer: StationaryMoments):
    return answer.response("by hand", SCENE, how="by hand", started=time.perf_counter())


def test_quantities_are_those_of_the_moments() -> None:
    found = values(response(MOMENTS))
    assert found["displacement_std"] == math.sqrt(0.3)
    assert found["displacement_mean_square"] == pytest.approx(0.3 + 0.04)
    assert found["collision_rate"] == pytest.approx(0.35)
    assert found["impact_speed_mean"] == pytest.approx(0.23 / 0.35)


def test_bounds_are_what_each_moment_moves_added_up() -> None:
    whole = response(replace(MOMENTS, errors=ERRORS))
    given = whole.estimates() | whole.identities
    moves = dict.fromkeys(given, 0.0)
    for number in range(10):
        other = response(moved(tuple(int(place == number) for place in range(10))))
        for key, estimate in (other.estimates() | other.identities).items():
            moves[key] += abs(estimate.value - given[key].value)
    for key, total in moves.items():
        bias = given[key].bias
        assert bias is not None
        # to first order in errors of some 1e-4; the bound on a balance may be wider, because its
        # terms move one another
        assert bias > (1.0 - 2e-3) * total, key
        if key not in whole.identities:
            assert bias < (1.0 + 2e-3) * total + 1e-15, key
