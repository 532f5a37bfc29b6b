"""A restitution that scatters in the methods without chance, and what the others say of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from scipy.optimize import brentq

from stochvi import (
    ConstantLoad,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    Sine,
    WhiteNoise,
    average,
    exact,
    fokker_planck,
    harmonic_response,
    linearise,
    simulate,
    transient,
)
from stochvi.isolators.jolt_response import jolts
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.mathematics.impact_rates import (
    COLLAPSE_RESTITUTION,
    corner_exponent,
    equivalent_restitution,
)
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.testing import assert_agrees
from stochvi.verification.explain import explain
from support.known import values


def scene_of(coefficient: Any, *, damping: float = 0.1, gap: float = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=Restitution(coefficient=coefficient))],
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


# ---- slow impacts ------------------------------------------------------------------------------


@pytest.mark.parametrize(("mean", "std"), [(0.5, 0.25), (0.7, 0.2)])
def test_slow_impacts_have_the_exponent_of_the_mean_power(mean: float, std: float) -> None:
    """E R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6), read off the density by Fokker-Planck."""
    scene = scene_of({"mean": mean, "std": std})
    exponent = fokker_planck_density(scene, rtol=1e-6).slow_impact_exponent("upper")
    assert_agrees(exponent, corner_exponent(equivalent_restitution(BetaDistribution(mean, std))))
    # neither the mean restitution nor that of the same energy has it
    for other in (mean, math.hypot(mean, std)):
        with pytest.raises(AssertionError):
            assert_agrees(exponent, corner_exponent(other))


def test_the_equivalent_restitution_lies_between_power_means() -> None:
    """That of R^-2 and the geometric one, which it is where the rate of impacts becomes infinite;
    R itself without scatter."""
    for mean, std in ((0.7, 0.1), (0.5, 0.25), (0.3, 0.1), (0.9, 0.2)):
        law = BetaDistribution(mean, std)
        equivalent = equivalent_restitution(law)
        assert law.moment(-2.0) ** -0.5 < equivalent < math.exp(law.mean_logarithm) < mean

    def away(std: float) -> float:
        return BetaDistribution(0.2, std).mean_logarithm - math.log(COLLAPSE_RESTITUTION)

    at_collapse = float(brentq(away, 0.05, 0.2))
    for share in (0.98, 1.02):
        law = BetaDistribution(0.2, share * at_collapse)
        equivalent = equivalent_restitution(law)
        assert equivalent == pytest.approx(math.exp(law.mean_logarithm), rel=2e-3)
        assert (equivalent > COLLAPSE_RESTITUTION) == (share < 1.0)
    for mean in (0.1, 0.5, 0.99):
        assert equivalent_restitution(BetaDistribution(mean, 1e-6)) == pytest.approx(mean, rel=1e-6)


def test_collapse_is_told_by_the_geometric_mean() -> None:
    """At a mean of 0.22, where a constant restitution would not bring the mass to rest."""
    law = {"mean": 0.22, "std": 0.17}
    assert Restitution(coefficient=law).slow_restitution < COLLAPSE_RESTITUTION < 0.22
    for method in (fokker_planck, lambda scene: simulate(scene, paths=64, duration=20.0)):
        told = " ".join(method(scene_of(law)).warnings)
        assert "as it scatters" in told and "infinit" in told
    assert "infinit" not in " ".join(fokker_planck(scene_of(0.22)).warnings)


# ---- the other methods ---------------------------------------------------------------------------


def test_the_density_in_time_ends_in_the_stationary_one() -> None:
    scene = scene_of({"mean": 0.5, "std": 0.25})
    late, known = transient(scene, times=[120.0]).to_frame().iloc[-1], values(fokker_planck(scene))
    plain = values(fokker_planck(scene_of(0.5)))
    for column, name, power in (
        ("variance", "displacement_std", 2), ("velocity_mean_square", "velocity_std", 2),
    ):  # fmt: skip
        bias = late[f"{column}_bias"] + 1e-4
        assert late[column] == pytest.approx(known[name] ** power, abs=bias)
        assert late[column] != pytest.approx(plain[name] ** power, abs=bias)


@pytest.mark.parametrize("variant", ["finite jumps", "continuous"])
def test_averaging_tends_to_fokker_planck_at_light_damping(variant: str) -> None:
    """Losses of 1 - E R^2 = 0.018, of which the scatter takes back a sixth."""
    scene = scene_of({"mean": 0.99, "std": 0.006}, damping=0.005)
    known, found = values(fokker_planck(scene, rtol=1e-5)), values(average(scene, variant=variant))
    for name in ("velocity_std", "impact_speed_rate", "impact_speed_square_rate"):
        assert found[name] == pytest.approx(known[name], rel=0.02)


def test_averaging_takes_the_mean_of_finite_jumps() -> None:
    """Nearer to Fokker-Planck than the average of a constant restitution of the same energy."""
    law = {"mean": 0.6, "std": 0.4}
    known = values(fokker_planck(scene_of(law, damping=0.02)))
    own = values(average(scene_of(law, damping=0.02)))
    same_energy = values(average(scene_of(math.hypot(0.6, 0.4), damping=0.02)))
    for name in ("velocity_std", "impact_speed_square_rate"):
        assert abs(own[name] - known[name]) < abs(same_energy[name] - known[name])


@pytest.mark.parametrize("form", ["closure", "motion", "force", "clumps"])
def test_linearisation_balances_energy_with_the_mean_square(form: str) -> None:
    """b E v^2 + (1 - E R^2) F2 / 2 = S0 / 2, which holds in no form without the scatter."""
    law = Restitution(coefficient={"mean": 0.5, "std": 0.3})
    found = values(linearise(scene_of(law.coefficient), form=form))
    power = 0.1 * found["velocity_std"] ** 2
    square = found["impact_speed_square_rate"]
    lost = (1.0 - law.restitution_mean_square) / 2.0 * square
    assert power + lost == pytest.approx(0.1, rel=1e-6)
    assert power + (1.0 - 0.5**2) / 2.0 * square != pytest.approx(0.1, rel=1e-2)


def test_the_closure_errs_as_it_does_without_scatter() -> None:
    for law in (0.5, {"mean": 0.5, "std": 0.25}):
        known, found = (values(method(scene_of(law))) for method in (fokker_planck, linearise))
        for name in ("displacement_std", "velocity_std"):
            assert found[name] == pytest.approx(known[name], rel=0.04)


def test_no_error_is_taken_from_the_atlas_of_constant_restitutions() -> None:
    for method in (linearise, average):
        constant, scattered = (method(scene_of(law)) for law in (0.7, {"mean": 0.7, "std": 0.1}))
        assert constant.coordinates["x"]["velocity_std"].bias is not None
        assert scattered.coordinates["x"]["velocity_std"].bias is None


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (exact, r"restitution must be 1 \(an elastic stop\), got 0.7 \+- 0.1"),
        (lambda scene: harmonic_response(sine(scene)), "which scatters; give its mean alone"),
        (lambda scene: jolts(sine(scene), [1.0]), "which scatters; give its mean alone"),
    ],
    ids=["exact", "sine", "jolts"],
)
def test_methods_that_cannot_follow_it_say_so(method: Callable[[Scene], Any], words: str) -> None:
    with pytest.raises(NotApplicable, match=words):
        method(scene_of({"mean": 0.7, "std": 0.1}))


def sine(scene: Scene) -> Scene:
    return scene.replace(
        excitations=[Sine(amplitude=1.0, frequency_hz=0.2), ConstantLoad(force=0.0)]
    )


def test_explain_and_the_assumptions_name_the_draw() -> None:
    scene = scene_of({"mean": 0.7, "std": 0.1})
    assert any("drawn at each impact" in effect for effect in explain(scene).effects)
    assert any("beta distribution" in each for each in scene.assumptions())
    assert not any("beta distribution" in each for each in scene_of(0.7).assumptions())
