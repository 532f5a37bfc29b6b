"""Statistical linearisation in all forms: printed values, symmetries, extremes, what is said."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from stochvi.methods.linearisation import linearise
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene
from support.linearised import WAYS, make_scene, random_scene, summary, value


@pytest.mark.parametrize(
    ("form", "variant", "restitution", "printed"),
    [
        ("motion", "book", 1.0, (0.8347, 1.0000, 0.2419)),
        ("motion", "book", 0.8, (0.7120, 0.7980, 0.1584)),
        ("motion", "book", 0.5, (0.6639, 0.7155, 0.1271)),
        ("force", "book", 1.0, (0.7320, 1.0000, 0.3326)),
        ("force", "book", 0.8, (0.6863, 0.8360, 0.2394)),
        ("force", "book", 0.5, (0.6555, 0.7606, 0.1943)),
        ("force", "consistent", 1.0, (0.7320, 1.0000, 0.3326)),
        ("force", "consistent", 0.8, (0.6575, 0.7649, 0.1970)),
        ("force", "consistent", 0.5, (0.6179, 0.6864, 0.1497)),
        ("closure", "consistent", 1.0, (0.5396, 1.0000, 0.2828)),
        ("closure", "consistent", 0.8, (0.5231, 0.7738, 0.1862)),
        ("closure", "consistent", 0.5, (0.5169, 0.6814, 0.1539)),
    ],
)
def test_reproduces_printed_values(
    form: str, variant: str, restitution: float, printed: tuple[float, float, float]
) -> None:
    response = linearise(make_scene(restitution=restitution), form, variant)
    assert tuple(round(number, 4) for number in summary(response)) == printed


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_mirrored_scene_gives_mirrored_answer(form: str, variant: str) -> None:
    for lower, upper, load in [(-0.4, 1.3, 0.2), (None, 0.7, -0.3), (None, -0.8, 0.0)]:
        one = linearise(
            make_scene(lower, upper, restitution=0.7, restitution_lower=0.9, load=load),
            form,
            variant,
        )
        other = linearise(
            make_scene(
                -upper,
                None if lower is None else -lower,
                restitution=0.7 if lower is None else 0.9,
                restitution_lower=0.7,
                load=-load,
            ),
            form,
            variant,
        )
        same = pytest.approx(value(one, "displacement_std"), rel=1e-9)
        assert value(other, "displacement_std") == same
        same = pytest.approx(-value(one, "displacement_mean"), rel=1e-9)
        assert value(other, "displacement_mean") == same
        same = pytest.approx(value(one, "collision_rate_upper"), rel=1e-9)
        assert value(other, "collision_rate_lower") == same


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_scales_exactly_to_si(form: str, variant: str) -> None:
    """Lengths in mm, 12 Hz and 2.5 kg: the same numbers in other units."""
    length, omega, mass = 1.7e-3, 2.0 * math.pi * 12.0, 2.5
    for lower, upper in [(-0.5, 1.0), (None, 0.8), (None, -1.0)]:
        plain = linearise(make_scene(lower, upper, load=0.1), form, variant)
        scaled = linearise(
            make_scene(
                None if lower is None else lower * length,
                upper * length,
                damping=0.1 * omega * mass,
                stiffness=omega**2 * mass,
                mass=mass,
                intensity=0.2 * length**2 * omega**3 * mass**2,
                load=0.1 * length * omega**2 * mass,
            ),
            form,
            variant,
        )
        factors = {
            "displacement_mean": length,
            "displacement_std": length,
            "velocity_std": length * omega,
            "upcrossing_rate": omega,
            "collision_rate": omega,
            "impact_speed_square_rate": length**2 * omega**3,
        }
        for name, factor in factors.items():
            expected = pytest.approx(factor * value(plain, name), rel=1e-9)
            assert value(scaled, name) == expected, name


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_a_far_stop_is_no_stop(form: str, variant: str) -> None:
    one = linearise(make_scene(None, 0.5), form, variant)
    two = linearise(make_scene(-50.0, 0.5), form, variant)
    for name in ("displacement_mean", "displacement_std", "velocity_std", "collision_rate"):
        assert value(two, name) == pytest.approx(value(one, name), rel=1e-9), name


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_without_stops_the_answer_is_the_linear_one(form: str, variant: str) -> None:
    response = linearise(make_scene(None, None, stiffness=2.0, load=0.6), form, variant)
    assert value(response, "displacement_mean") == pytest.approx(0.3, rel=1e-14)
    assert value(response, "displacement_std") == pytest.approx(math.sqrt(0.5), rel=1e-14)
    assert value(response, "velocity_std") == pytest.approx(1.0, rel=1e-14)
    assert value(response, "upcrossing_rate") == pytest.approx(
        math.sqrt(2.0) / (2.0 * math.pi), rel=1e-14
    )
    assert all(entry.bias == 0.0 for entry in response.estimates().values())


@pytest.mark.parametrize(
    ("form", "variant", "count"),
    [(*way, 80) for way in WAYS[:1]] + [(*way, 40) for way in WAYS[1:]],
)
def test_random_sweep_ends_in_finite_answers(form: str, variant: str, count: int) -> None:
    """Gaps of .001 to 1000 deviations, preload to 3, any R, also without damping.

    An `Estimate` refuses what is not finite.
    """
    rng = np.random.default_rng(4)
    for _ in range(count):
        scene, deviation = random_scene(rng)
        response = linearise(scene, form, variant)
        assert value(response, "displacement_std") > 0.0
        assert value(response, "velocity_std") > 0.0
        model = model_of(scene)
        if form == "closure":
            mean, slack = value(response, "displacement_mean"), 1e-9 * deviation
            assert mean > model.lower_position - slack
            assert mean < model.upper_position + slack


@pytest.mark.parametrize(("form", "variant"), WAYS)
def test_response_names_method_and_assumptions(form: str, variant: str) -> None:
    response = linearise(make_scene(), form, variant)
    assert response.method == f"linearise:{form}" + (":book" if variant == "book" else "")
    # of a pair that the atlas knows
    assert response.estimates()["x", "velocity_std"].bias
    assert any("Gaussian" in sentence for sentence in response.assumptions)
    response.to_dict()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("spline",), "form must be one of closure, motion, force, clumps, got 'spline'"),
        (("force", "best"), "variant must be one of consistent, book, box, got 'best'"),
        (
            ("closure", "book"),
            "variant must be 'consistent' or 'box' for form 'closure', which is not in the book; "
            "'book' is of the forms 'motion' and 'force'",
        ),
    ],
)
def test_unknown_words_are_refused(words: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        linearise(make_scene(), *words)


@pytest.mark.parametrize(
    ("scene", "form", "conditions"),
    [
        (
            make_scene(intensity=None, load=0.5, damping=0.0, restitution=1.0),
            "closure",
            (
                "excitation must contain noise, got a constant load alone",
                "damping must be positive where no stop takes energy, got 0",
            ),
        ),
        (
            make_scene(None, 1.0, stiffness=0.0),
            "closure",
            ("stiffness must be positive where stops do not hold the mass, got 0",),
        ),
        (
            make_scene(stiffness=0.0),
            "motion",
            ("stiffness must be positive for form 'motion', got 0",),
        ),
        (
            make_scene(None, 1.0, stiffness=0.0, load=0.5),
            "force",
            ("stiffness must be positive for form 'force' with one stop, got 0",),
        ),
    ],
)
def test_unmet_conditions_are_listed(scene: Scene, form: str, conditions: tuple[str, ...]) -> None:
    with pytest.raises(NotApplicable) as caught:
        linearise(scene, form)
    assert caught.value.conditions == conditions
