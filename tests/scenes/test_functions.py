"""Springs, dampers and restitution that are functions: what is checked, carried and refused."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from stochvi.isolators.screening import screen
from stochvi.methods.averaging import average
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import prospect, record_path, simulate
from stochvi.model.coverage import functions
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable, SceneError
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution, SpeedRestitution
from stochvi.scenes.scene import ImpactPair, Scene, scene_from
from stochvi.scenes.structures import NonlinearOscillator, Oscillator
from stochvi.verification.check import check
from stochvi.verification.cost import cost
from stochvi.verification.explain import explain
from support.known import DOCUMENT, changed


def cubic(x):
    return x + 2.0 * x**3


def steel(speed):
    return 1.0 / (1.0 + 0.1 * speed**0.25)


def scene(structure=None, law=None, **pair) -> Scene:
    pair = {"lower": -1.0, "upper": 1.0, **pair}
    return Scene(
        structure=structure or NonlinearOscillator(mass=2.0, damping=0.1, restoring_force=cubic),
        impact_pairs=[ImpactPair(**pair, law=law or Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.2)],
    )


LINEAR = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
SCENES = {
    "spring": scene(),
    "restitution": scene(LINEAR, SpeedRestitution(coefficient=steel)),
}

# What is carried --------------------------------------------------------------------------


def test_forces_and_energies_are_carried_per_unit_mass():
    damper = NonlinearOscillator(
        mass=2.0, restoring_force=cubic, damping_force=lambda v: v * np.abs(v)
    )
    x = np.linspace(-2.0, 2.0, 9)
    model = model_of(scene(damper))
    assert (model.omega, model.damping_rate, model.intensity) == (0.0, 0.0, 0.05)
    assert model.restoring(x) == pytest.approx(cubic(x) / 2.0, rel=1e-15)
    assert model.drag(x) == pytest.approx(x * np.abs(x) / 2.0, rel=1e-15)
    assert model.potential(x) == pytest.approx((x**2 + x**4) / 4.0, rel=1e-14)
    linear = model_of(scene())
    assert linear.damping_rate == 0.05 and linear.drag is None


def test_the_potential_by_quadrature_is_the_integral_of_the_force():
    """Smooth, with a kink, and a wall that is steep but finite."""
    cases = [
        (np.sinh, lambda x: np.cosh(x) - 1.0, 1e-13),
        (lambda x: np.where(x > 0.3, 50.0 * (x - 0.3), 0.0), None, 1e-6),
        (lambda x: np.tan(x), lambda x: -np.log(np.cos(x)), 1e-12),
    ]
    x = np.array([-1.5, -0.2, 0.0, 0.4, 1.5])
    for force, energy, near in cases:
        spring = NonlinearOscillator(mass=1.0, damping=0.1, restoring_force=force)
        expected = energy(x) if energy else 25.0 * np.maximum(x - 0.3, 0.0) ** 2
        assert spring.potential_at(x) == pytest.approx(expected, rel=near, abs=1e-6 * near)


def test_a_potential_of_its_own_counts_from_zero_and_is_not_integrated():
    spring = NonlinearOscillator(
        mass=1.0, damping=0.1, restoring_force=cubic, potential=lambda x: 7.0 + x**2 / 2 + x**4 / 2
    )
    assert spring.potential_at([[0.0, 1.0]]).tolist() == [[0.0, 1.0]]


def test_restitution_by_speed_is_asked_where_it_is_needed():
    law = model_of(SCENES["restitution"]).upper.law
    assert law.restitution_at([1.0, 16.0]) == pytest.approx([1 / 1.1, 1 / 1.2])
    assert model_of(SCENES["restitution"]).upper.coefficient is None
    assert not model_of(SCENES["restitution"]).elastic
    constant = SpeedRestitution(coefficient=lambda speed: 1.0)
    assert constant.conservative and constant.restitution_at([1.0, 2.0]).tolist() == [1.0, 1.0]
    assert Restitution(coefficient=0.5).restitution_at([1.0, 2.0]).tolist() == [0.5, 0.5]
    assert law.restitution == pytest.approx(1 / 1.1)


@pytest.mark.parametrize("name", SCENES)
def test_the_document_names_functions_and_is_json(name):
    document = json.loads(json.dumps(SCENES[name].document()))
    part = {
        "spring": document["structure"].get("restoring_force"),
        "restitution": document["impact_pair"][0]["law"].get("coefficient"),
    }[name]
    assert part == {"spring": f"{__name__}.cubic", "restitution": f"{__name__}.steel"}[name]
    again = Scene(**{key: getattr(SCENES[name], key) for key in Scene.model_fields if key})
    assert again == SCENES[name]


# What is refused --------------------------------------------------------------------------


def recorded(case: Scene):
    return record_path(case, duration=1.0)


CASES = [
    *(("spring", each) for each in (average, linearise, simulate, prospect, recorded, cost)),
    ("restitution", linearise),
]


@pytest.mark.parametrize(
    ("name", "method"), CASES, ids=[f"{name}-{each.__name__}" for name, each in CASES]
)
def test_a_method_for_numbers_says_what_it_cannot_take(name, method):
    words = {"spring": "'nonlinear'", "restitution": "a function of speed at the lower stop"}[name]
    with pytest.raises(NotApplicable, match=words):
        method(SCENES[name])


def test_a_linear_screening_takes_any_stop_and_no_nonlinear_spring():
    with pytest.raises(NotApplicable, match="'nonlinear'"):
        screen(SCENES["spring"])
    scene = SCENES["restitution"]
    elastic = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))
    other_stops = scene.model_copy(update={"impact_pairs": (elastic,)})
    assert screen(scene).displacement_std == screen(other_stops).displacement_std


def test_explain_and_check_answer_for_such_a_scene():
    told = explain(SCENES["spring"])
    assert "function" in told.methods["simulate"] and told.simulation is None
    verdict = check(SCENES["spring"])
    assert any("simulate does not apply" in reason for reason in verdict.left_out)


def nonlinear(**changes) -> NonlinearOscillator:
    return NonlinearOscillator(**{"mass": 1.0, "damping": 0.1, "restoring_force": cubic, **changes})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: nonlinear(damping=None), "exactly one of damping and damping_force, got none"),
        (lambda: nonlinear(damping_force=cubic), "exactly one .* got damping, damping_force"),
        (lambda: nonlinear(restoring_force=3.0), "restoring_force must be a function, got 3.0"),
        (lambda: nonlinear(restoring_force=np.log), "restoring_force with finite values, got nan"),
        (lambda: nonlinear(potential=lambda x: [1.0, 2.0]), "potential that takes an array"),
        (lambda: nonlinear(damping=None, damping_force=lambda v: v if v else 0), "damping_force"),
        (lambda: nonlinear(mass=0.0), "mass must be greater than 0"),
        (lambda: SpeedRestitution(coefficient=0.5), "needs body where coefficient is one number"),
        (lambda: SpeedRestitution(coefficient=lambda w: 1.0 + w), r"in \[0, 1\], got 1"),
        (lambda: SpeedRestitution(coefficient=lambda w: w * math.nan), "finite values, got nan"),
        (
            lambda: scene(nonlinear(restoring_force=lambda x: 1 / (1 - x)), upper=1.0),
            "impact_pair.0 has a stop at 1, where structure.restoring_force is inf",
        ),
        (
            lambda: scene(nonlinear(), Elastic(stiffness=1.0), on="y"),
            "must be on 'x'",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero|invalid value")
def test_what_is_wrong_with_a_function_is_said_once_and_at_once(make, words):
    with pytest.raises(SceneError, match=words):
        make()


def test_a_scene_file_is_told_that_functions_are_for_python_only():
    structure = {"kind": "nonlinear", "mass": 1.0, "damping": 0.1, "restoring_force": "x**3"}
    with pytest.raises(SceneError, match=r"structure.kind 'nonlinear' takes a function.*Python"):
        scene_from(changed(["structure"], structure))
    law = {"kind": "speed-restitution", "coefficient": "steel"}
    with pytest.raises(SceneError, match=r"impact_pair.0.law.coefficient must be a finite number"):
        scene_from(changed(["impact_pair", 0, "law"], law))
    assert functions(model_of(scene_from(DOCUMENT))) == []
