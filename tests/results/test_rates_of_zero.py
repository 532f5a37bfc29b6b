"""A rate is never 0 without an error: it is rare, and an answer says how rare at most."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest

from stochvi import (
    Elastic,
    Estimate,
    ImpactPair,
    Oscillator,
    Response,
    Restitution,
    Scene,
    WhiteNoise,
    average,
    exact,
    fokker_planck,
    linearise,
    simulate,
)
from stochvi.results.base import NEVER_ZERO, PairResponse

METHODS: dict[str, Callable[[Scene], Response]] = {
    "exact": exact,
    "average": average,
    **{f"linearise {form}": lambda scene, form=form: linearise(scene, form=form)  # type: ignore[misc]
       for form in ("closure", "motion", "force", "clumps")},
    "fokker-planck": fokker_planck,
    "simulate": lambda scene: simulate(scene, paths=16, duration=20.0, seed=1),
}  # fmt: skip

ELASTIC = ("exact", "linearise closure", "linearise motion", "linearise force", "fokker-planck",
           "simulate")  # fmt: skip


def far(distance: float, law: Restitution | Elastic) -> Scene:
    """Stops at so many standard deviations."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-distance, upper=distance, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def stated(found: Iterable[Estimate | float | None]) -> bool:
    """Whether each number that is 0 has an error, a limit, or no interval at all."""
    return all(
        each.value != 0.0 or each.bias is None or each.upper_95 or each.half_width_95() > 0.0
        for each in found
        if isinstance(each, Estimate)
    )


@pytest.mark.parametrize("distance", [9.0, 60.0])
@pytest.mark.parametrize("method", METHODS)
def test_no_method_says_a_rate_of_exactly_zero(method: str, distance: float) -> None:
    """exp(-1800) is 0 for a computer, and exp(-40) is less than what a mesh or a sample sees."""
    law = Restitution(coefficient=1.0)
    pair = METHODS[method](far(distance, law)).impact_pairs["stops"]
    assert stated(pair[name] for name in NEVER_ZERO)
    if method in ELASTIC:
        pair = METHODS[method](far(distance, Elastic(stiffness=50.0))).impact_pairs["stops"]
        assert stated(pair[name] for name in NEVER_ZERO)


def test_zeros_that_are_right_stay_as_they_are() -> None:
    plain, limited = Estimate(value=0.0), Estimate(value=0.0, upper_95=0.1)
    pair = PairResponse(
        collision_rate=plain, collision_rate_upper=limited, relative_displacement_mean=plain
    )
    assert not stated([plain]) and stated([pair.collision_rate])
    assert pair.collision_rate_upper == limited and pair.relative_displacement_mean == plain
