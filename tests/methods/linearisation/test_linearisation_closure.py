"""The closure between rigid stops: exact densities, balances, preload, the variant of a box."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.methods.fokker_planck import fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.model.balances import residuals
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene
from support.linearised import WAYS, make_scene, random_scene, summary, value


def gibbs_moments(scene: Scene) -> dict[str, float]:
    """Moments and rates from exp(-U / theta) by adaptive quadrature."""
    model = model_of(scene)
    theta = model.intensity / (2.0 * model.damping_rate)
    spread = math.sqrt(theta) / model.omega
    rest = model.rest
    low = model.lower_position
    high = model.upper_position
    nearest = min(max(rest, low), high)

    def log_density(x: float) -> float:
        return -(x - nearest) * (x + nearest - 2.0 * rest) / (2.0 * spread**2)

    # e^-50 of the largest density is as good as nothing
    steep = abs(nearest - rest) / spread
    reach = spread * 100.0 / (steep + math.hypot(steep, 10.0))
    start, end = max(low, nearest - reach), min(high, nearest + reach)

    def integral(power: int, about: float) -> float:
        options = {"epsabs": 0.0, "epsrel": 1e-12, "limit": 200}
        pieces = np.unique(
            np.linspace(start, nearest, 6).tolist() + np.linspace(nearest, end, 6).tolist()
        )
        return sum(
            quad(lambda x: (x - about) ** power * math.exp(log_density(x)), a, b, **options)[0]
            for a, b in itertools.pairwise(pieces.tolist())
        )

    mass = integral(0, 0.0)
    shift = integral(1, nearest) / mass
    rates = [
        0.0
        if stop is None
        else math.exp(log_density(stop.position)) / mass * math.sqrt(theta / (2.0 * math.pi))
        for stop in (model.lower, model.upper)
    ]
    return {
        "displacement_mean": nearest + shift,
        "displacement_std": math.sqrt(integral(2, nearest + shift) / mass),
        "velocity_std": math.sqrt(theta),
        **({} if model.lower is None else {"collision_rate_lower": rates[0]}),
        **({} if model.upper is None else {"collision_rate_upper": rates[1]}),
        "impact_speed_rate": sum(rates) * math.sqrt(math.pi * theta / 2.0),
        "impact_speed_square_rate": sum(rates) * 2.0 * theta,
    }


def test_reproduces_printed_asymmetric_closure() -> None:
    response = linearise(make_scene(-0.5, 1.0))
    names = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
    found = tuple(round(value(response, name), 5) for name in names)
    assert found == (0.16604, 0.19004, 0.49047)


def test_closure_is_nearer_to_the_truth_than_the_book() -> None:
    # near-exact values for R = .8: deviations and rate of impacts
    truth = (0.53209075, 0.78288187, 0.193109)
    errors = {
        way: max(
            abs(found / true - 1.0)
            for found, true in zip(summary(linearise(make_scene(), *way)), truth, strict=True)
        )
        for way in WAYS
    }
    assert min(errors, key=lambda way: errors[way]) == ("closure", "consistent")


def test_closure_is_exact_for_elastic_stops() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        scene, _ = random_scene(rng, elastic=True)
        response = linearise(scene)
        truth = gibbs_moments(scene)
        deviation = truth["displacement_std"]
        for name, expected in truth.items():
            # a mean may vanish by symmetry, a rate far out in the tail
            scale = deviation if name == "displacement_mean" else 0.0
            floor = 1e-9 * scale + 1e-30 * truth["velocity_std"] / deviation
            assert value(response, name) == pytest.approx(expected, rel=1e-9, abs=floor), name
        # a rate that is too small for a float is 0 within a bound
        assert all(
            entry.bias == 0.0 or entry.value == 0.0 < entry.bias < 1e-15
            for entry in response.estimates().values()
        )


def test_square_of_restitution_would_be_seen() -> None:
    """Negative control: R^2 put for R moves the answer far beyond every tolerance here."""
    right, wrong = linearise(make_scene(restitution=0.8)), linearise(make_scene(restitution=0.64))
    assert abs(value(right, "velocity_std") / value(wrong, "velocity_std") - 1.0) > 0.03


def test_closure_obeys_the_balances() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        scene, _ = random_scene(rng)
        found = linearise(scene).identities
        assert set(found) == {"energy", "virial", "force"}
        for name, residual in found.items():
            assert abs(residual.value) < 1e-9, (name, scene)


def test_balances_see_a_wrong_restitution() -> None:
    """Negative control: the answer for R does not balance as one for R^2."""
    response, wrong = linearise(make_scene(restitution=0.8)), make_scene(restitution=0.64)
    half = {name: value(response, f"impact_speed_{name}rate") / 2.0 for name in ("", "square_")}
    moments = {
        ("x", "x"): value(response, "displacement_mean"),
        ("x", "variance"): value(response, "displacement_std") ** 2,
        ("x", "vv"): value(response, "velocity_mean_square"),
    }
    for side in ("lower", "upper"):
        moments["stops", f"f1_{side}"] = half[""]
        moments["stops", f"f2_{side}"] = half["square_"]
    found = residuals(model_of(wrong), moments, (0.0,))
    assert abs(found["energy"]) > 0.01
    assert abs(found["virial"]) > 0.01


def test_deep_preload_joins_on_where_the_family_ends() -> None:
    """No jump where the law turns exponential: half the step in position, half in the answer."""

    def largest_step(count: int) -> float:
        positions = np.linspace(-0.5, -0.3, count + 1)
        found = [linearise(make_scene(None, float(c), restitution=0.5)) for c in positions]
        assert {bool(response.warnings) for response in found} == {False, True}
        return float(np.abs(np.diff([value(one, "displacement_std") for one in found])).max())

    assert largest_step(60) == pytest.approx(largest_step(30) / 2.0, rel=0.05)


def test_deep_preload_between_two_stops_tends_to_one_stop() -> None:
    """What the limit of kappa bends the law between stops 2 D apart falls as 1 / D^2."""
    one = linearise(make_scene(None, -0.9, restitution=0.5))

    def error(gap: float) -> float:
        two = linearise(make_scene(-gap, -0.9, restitution=0.5))
        return value(two, "displacement_std") / value(one, "displacement_std") - 1.0

    assert one.warnings
    assert error(1000.0) == pytest.approx(error(100.0) / 100.0, rel=0.05)


def test_free_mass_in_a_box() -> None:
    """No spring: between elastic stops x is uniform, (B 13.38) with U = 0."""
    response = linearise(make_scene(-1.0, 1.0, stiffness=0.0, restitution=1.0))
    assert value(response, "displacement_std") == pytest.approx(1.0 / math.sqrt(3.0), rel=1e-12)
    assert value(response, "collision_rate") == pytest.approx(1.0 / math.sqrt(2.0 * math.pi))
    assert summary(linearise(make_scene(-1.0, 1.0, stiffness=0.0), "force"))[2] > 0.0


def test_ball_on_a_table() -> None:
    """No spring, one stop, pressed on by a load: for R = 1 the height is exponential."""
    elastic = linearise(make_scene(None, 0.0, stiffness=0.0, restitution=1.0, load=2.0))
    assert value(elastic, "displacement_mean") == pytest.approx(-0.5, rel=1e-9)
    assert value(elastic, "displacement_std") == pytest.approx(0.5, rel=1e-9)
    inelastic = linearise(make_scene(None, 0.0, stiffness=0.0, restitution=0.7, load=2.0))
    # E v^2 = g E y, from the virial with stop and origin in one place
    assert value(inelastic, "velocity_mean_square") == pytest.approx(
        -2.0 * value(inelastic, "displacement_mean"), rel=1e-9
    )
    assert "lies closer to a stop" in inelastic.warnings[0]


def test_box_constants_solve_the_fokker_planck_equation_of_a_box() -> None:
    """s_x and s_v of a free mass in a box, between and at the tabulated restitutions."""
    for restitution in (0.0, 0.5, 0.75):
        scene = make_scene(stiffness=0.0, damping=0.0, restitution=restitution, intensity=1.0)
        truth = fokker_planck(scene, rtol=1e-3)
        found, plain = linearise(scene, variant="box"), linearise(scene)
        for name in ("displacement_std", "velocity_std", "impact_speed_rate"):
            # four digits of the table, and what interpolation leaves
            assert value(found, name) == pytest.approx(value(truth, name), rel=2e-3), name
            assert abs(value(plain, name) / value(truth, name) - 1.0) > 2e-3, name


def test_box_is_exact_for_elastic_stops() -> None:
    for lower, upper in [(-1.0, 1.0), (-0.2, 1.5)]:
        scene = make_scene(lower, upper, restitution=1.0, load=0.3)
        one, two = linearise(scene, variant="box"), linearise(scene)
        assert summary(one) == pytest.approx(summary(two), rel=1e-12)


@pytest.mark.parametrize(("damping", "restitution"), [(0.1, 0.5), (1.0, 0.2)])
def test_box_is_nearer_to_the_truth_than_the_plain_closure(
    damping: float, restitution: float
) -> None:
    """And within what is asked of it: 6 % between half a deviation and a whole one."""
    names = ("displacement_std", "velocity_std", "impact_speed_rate")
    errors: dict[str, list[float]] = {"box": [], "consistent": []}
    for gap in (0.2, 1.0):
        scene = make_scene(
            -gap, gap, restitution=restitution, damping=damping, intensity=2.0 * damping
        )
        truth = fokker_planck(scene, rtol=1e-3)
        for variant, found in errors.items():
            answer = linearise(scene, variant=variant)
            found += [abs(value(answer, name) / value(truth, name) - 1.0) for name in names]
            assert max(abs(one.value) for one in answer.identities.values()) < 1e-9
    assert max(errors["box"]) < 0.06
    assert np.mean(errors["box"]) < np.mean(errors["consistent"])


def test_box_needs_two_rigid_stops() -> None:
    with pytest.raises(NotApplicable, match="variant 'box' needs stops on both sides, got one"):
        linearise(make_scene(None, 1.0), variant="box")
    with pytest.raises(ValueError, match="for form 'force', got 'box'"):
        linearise(make_scene(), "force", "box")
