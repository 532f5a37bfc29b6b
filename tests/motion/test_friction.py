"""Stops that rub in simulations: balances, exact laws and an integrator by events judge."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Matrices,
    NotApplicable,
    Oscillator,
    PowerLaw,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    check,
    exact,
    explain,
    harmonic_response,
    history,
    impacts,
    linearise,
    screen,
    simulate,
)
from stochvi.engine.sub_steps import rub, rub_evenly
from stochvi.model.build_response import residuals
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.scenes import ConstantLoad, Hertz, RigidBody, Sine
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.structures.rigid_body import Mount
from stochvi.testing import assert_agrees
from support.accuracies import apart, assert_balanced, assert_differs
from support.refusals import refusals
from support.rubbing import ContactByEvents, ImpactsByEvents

WHITES = [WhiteNoise(intensity=0.5, on="x"), WhiteNoise(intensity=0.3, on="y")]
SINES = [
    Sine(on="x", amplitude=3.0, frequency_hz=0.31), Sine(on="y", amplitude=1.0, frequency_hz=0.17)
]  # fmt: skip
BAND = {"frequency_hz": [0.1, 1.0], "density": [1.0, 1.0], "unit": "N2/Hz"}
TABLES = [TabulatedNoise(on=name, **BAND) for name in "xy"]
DAMPING, STIFFNESS = np.array([0.3, 0.1]), np.array([4.0, 1.0])
LOWER, UPPER = -0.4, 0.5


def law(friction: float, restitution: Any = 0.7) -> Restitution:
    return Restitution(coefficient=restitution, friction=friction)


SOFT = Viscoelastic(stiffness=400.0, damping_ratio=0.1, friction=0.4)


def mass_of(coupled: float) -> np.ndarray:
    return np.array([[1.0, coupled], [coupled, 1.5]])


def scene_of(law: Any, coupled: float = 0.0, **keys: Any) -> Scene:
    """A body that moves along x between two stops and along y, with a mass matrix that couples."""
    tangent = {"tangent": "y"} if law.friction else {}
    structure = Matrices(
        coordinates=["x", "y"], mass=mass_of(coupled).tolist(),
        damping=np.diag(DAMPING).tolist(), stiffness=np.diag(STIFFNESS).tolist(),
    )  # fmt: skip
    pair = ImpactPair(on="x", lower=LOWER, upper=UPPER, law=law, **tangent)
    given = {"structure": structure, "impact_pairs": [pair], "excitations": WHITES}
    return Scene(**given | keys)


def rubbed_path(plan: Any, judge: Any) -> tuple[np.ndarray, np.ndarray]:
    """Displacements of a path under sines alone, and the states that a judge has of it."""
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(5), 0, streams)
    start, shapes, waves = plan.start(streams)[:, 0], plan.modes.shapes, []
    for (first, omega, _), signal in zip(plan.modes.sines, plan.model.sines, strict=True):
        value, rate = start[4 + first : 6 + first]
        waves.append((signal.direction, value, rate, omega))
    judge.driving = lambda t: np.sum(
        [d * (a * math.cos(w * t) + b * math.sin(w * t)) for d, a, b, w in waves], axis=0
    )
    times = plan.step * np.arange(1, plan.steps + 1)
    known = judge.path(np.concatenate([shapes @ start[:2], shapes @ start[2:4]]), times)
    found = plan.record(5, 0)
    return np.stack([found[f"displacement of {name}"] for name in "xy"], axis=1), known


STIFF: Any = Elastic(stiffness=400.0)


@pytest.mark.parametrize("friction", [0.2, 1.5])
@pytest.mark.parametrize(
    "law", [Restitution(coefficient=1.0), pytest.param(STIFF, marks=pytest.mark.slow)]
)
def test_the_normal_motion_is_that_without_friction_where_nothing_couples(
    law: Any, friction: float
) -> None:
    """The exact law of the oscillator judges it, though friction makes the stops lossy along y."""
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.3, stiffness=4.0),
        impact_pairs=[ImpactPair(lower=LOWER, upper=UPPER, law=law)],
        excitations=[WhiteNoise(intensity=0.5)],
    )
    known = exact(alone)
    scene = scene_of(law.replace(friction=friction))
    found = simulate(scene, paths=512, duration=100.0, seed=2)
    for name in ("displacement_mean_square", "velocity_mean_square"):
        assert_agrees(found.coordinates["x"][name], known.coordinates["x"][name].value)
    of_contacts = () if law.rigid else ("contact_probability",)
    for name in ("collision_rate", "impact_speed_square_rate", *of_contacts):
        assert_agrees(found.impact_pairs["stops"][name], known.impact_pairs["stops"][name].value)
    free = 0.3 / 2.0 / 0.1 / 1.5  # E y'^2 without friction
    assert_differs(found.coordinates["y"]["velocity_mean_square"], free)


RUBBING = [
    law(0.4, 0.0), law(0.4, {"mean": 0.6, "std": 0.2}), law(0.4), STIFF.replace(friction=0.4), SOFT,
    Hertz(coefficient=2000.0, friction=0.4),
    PowerLaw(coefficient=2000.0, exponent=1.5, loss=500.0, friction=0.4),
]  # fmt: skip


@pytest.mark.parametrize(
    "law", [each if each.rigid else pytest.param(each, marks=pytest.mark.slow) for each in RUBBING]
)
@pytest.mark.parametrize("coupled", [0.0, 0.7, -0.9])
def test_the_energy_balance_holds_and_not_without_the_loss_of_friction(
    law: Any, coupled: float
) -> None:
    scene = scene_of(law, coupled)
    found = simulate(scene, paths=256, duration=60.0, seed=4)
    assert set(found.identities) == {"energy"}
    assert_balanced(found)
    if law is RUBBING[2] or law is RUBBING[3]:
        plan = make_plan(model_of(scene), None, 60.0)
        rows = dict(zip(plan.layout.rows, plan.averages(4, 0, 256), strict=True))
        moments = rows | {(name, "variance"): rows[name, "xx"] for name in ("x", "y")}
        moments = {key: value.mean() for key, value in moments.items()}
        with_loss, without = (
            residuals(plan.model, moments | left_out, [0.0, 0.0])["energy"]
            for left_out in ({}, {("stops", "rubbing"): 0.0})
        )
        assert abs(with_loss) < 0.03 < 0.1 < without


def test_sliding_impacts_lose_along_the_stop_what_coulomb_says() -> None:
    """On a mass that slides fast all impacts slide: the mean force along the stops is mu times the
    mean normal force (B 1.62)."""
    drift = 40.0
    structure = Matrices(
        coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 1.5]],
        damping=[[0.3, 0.0], [0.0, 0.1]], stiffness=[[4.0, 0.0], [0.0, 1e-6]],
    )  # fmt: skip
    plan = make_plan(model_of(scene_of(law(0.2), structure=structure)), None, 20.0)
    streams = np.empty((2, 256), np.uint64)
    seed_streams(np.uint64(1), 0, streams)
    state = plan.start(streams)
    slow = int(np.argmin(plan.modes.squares))
    state[2 + slow] = drift * math.sqrt(1.5)
    before = state[2 + slow].copy()
    sums = plan.fly(state, streams, plan.steps).sums
    hits = plan.of_pairs(sums)[0]
    speeds = hits[plan.sums_of_pair.index("f1_lower")] + hits[plan.sums_of_pair.index("f1_upper")]
    lost = (before - state[2 + slow]) / math.sqrt(1.5)
    decay = 0.1 / 1.5
    t = plan.steps * plan.step
    # y' decays as well; what an impact takes decays from then on, in the mean for half of the time
    expected = drift * -math.expm1(-decay * t)
    expected += 0.2 * 1.7 * speeds.mean() / 1.5 * -math.expm1(-decay * t) / (decay * t)
    error = lost.std() / 16.0
    assert abs(lost.mean() - expected) < 4.5 * error
    assert 0.2 * 1.7 * speeds.mean() / 1.5 > 20.0 * error


def test_a_path_between_stops_that_rub_is_that_of_an_integrator_by_events() -> None:
    """Under sines alone; impacts of the integrator are those of small steps over their impulse."""
    coupled, end = 0.7, 12.0
    plan = make_plan(model_of(scene_of(law(0.7), coupled, excitations=SINES)), None, end)
    plan = replace(plan, duration=end)
    judge = ImpactsByEvents(
        law(0.7), mass_of(coupled), np.diag(DAMPING), np.diag(STIFFNESS), (LOWER, UPPER)
    )
    found, known = rubbed_path(plan, judge)
    assert set(judge.kinds) == {"stuck", "slid"}
    assert np.abs(found - known[:, :2]).max() < 1e-3
    smooth = replace(plan, model=model_of(scene_of(law(0.0), coupled, excitations=SINES)))
    other = smooth.record(5, 0)["displacement of y"]
    assert np.abs(other - known[:, 1]).max() > 0.05


@pytest.mark.parametrize("law", [law(0.4), pytest.param(SOFT, marks=pytest.mark.slow)])
def test_tables_shake_a_body_whose_stops_rub(law: Any) -> None:
    rubbing, plain = (
        simulate(scene_of(each, excitations=TABLES), paths=128, duration=100.0, seed=1)
        for each in (law, law.replace(friction=None))
    )
    for name in ("displacement_mean_square", "velocity_mean_square"):  # x does not feel it
        one, other = (each.coordinates["x"][name] for each in (rubbing, plain))
        assert abs(one.value - other.value) < 4.5 * apart(one, other).standard_error
        y = [each.coordinates["y"][name].value for each in (rubbing, plain)]
        assert y[0] < 0.9 * y[1]


def test_compliant_stops_may_be_beside_stops_that_rub() -> None:
    soft = ImpactPair(
        name="soft", on="y", clearance=0.3, law=Viscoelastic(stiffness=50.0, damping_ratio=0.1)
    )
    hard = scene_of(law(0.4), 0.5).impact_pairs[0]
    both = scene_of(law(0.4), 0.5, impact_pairs=[hard, soft])
    found = simulate(both, paths=128, duration=60.0, seed=1)
    assert_balanced(found)
    assert found.impact_pairs["soft"]["collision_rate"].value > 0.1


@pytest.mark.parametrize(
    "law", [law(0.3, 0.0), law(0.3, 0.5), pytest.param(SOFT, marks=pytest.mark.slow)]
)
def test_a_mass_that_is_pressed_onto_a_stop_keeps_its_balance(law: Any) -> None:
    """Chatter ends at rest, and friction holds the mass back as far as the load presses."""
    loaded = scene_of(law, 0.2, excitations=[*WHITES, ConstantLoad(force=2.5, on="x")])
    assert_balanced(simulate(loaded, paths=256, duration=40.0, seed=1))


def test_a_box_rubs_on_its_snubber() -> None:
    mounts = [
        Mount(at=[x, y, 0.0], stiffness=[2e4] * 3, damping=[60.0] * 3)
        for x, y in ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1))
    ]
    snubber = {"at": [0.1, 0.1, 0.05], "direction": [0.0, 0.0, 1.0], "clearance": 0.002}
    body = RigidBody(mass=8.0, inertia=[0.1, 0.1, 0.15], mounts=mounts)
    shaking = [WhiteNoise(intensity=0.5, axis=axis) for axis in "xyz"]
    found = {}
    for friction in (0.0, 0.5):
        keys = {"tangent": [1.0, 0.0, 0.0]} if friction else {}
        pair = ImpactPair(**snubber, **keys, law=law(friction))
        scene = Scene(structure=body, impact_pairs=[pair], excitations=shaking)
        found[friction] = simulate(scene, paths=64, duration=10.0, seed=3)
        assert_balanced(found[friction])
    rubbed, smooth = (found[each].coordinates["x"]["velocity_std"] for each in (0.5, 0.0))
    assert smooth.value - rubbed.value > 4.5 * apart(smooth, rubbed).standard_error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "effect", "assumption"),
    [
        (law(0.3), "rigid stop lower, friction 0.3", "Coulomb's"),
        (SOFT, "viscoelastic stop lower, friction 0.4", "friction in a contact"),
    ],
)
def test_records_counts_and_pages_know_only_the_pairs(law: Any, effect: str, assumption) -> None:
    scene = scene_of(law)
    found = simulate(scene, paths=16, duration=10.0, seed=1)
    assert list(found.impact_pairs) == ["stops"]
    assert effect in found.effects
    assert any(assumption in each for each in found.assumptions)
    columns = history(scene, duration=10.0, seed=1).to_frame().columns
    assert not any("tangent" in each for each in columns)
    rate = impacts(scene, paths=64, duration=60.0, seed=1).pairs["stops"].rates["both"].estimate
    assert rate.value > 0.1
    assert explain(scene).methods["simulate"] == "applies"
    assert check(scene, rel_error=0.05, seed=1).passed
    assert screen(scene).coordinates  # stops are left out


test_other_methods_refuse_friction = refusals(
    lambda calculation, law: calculation(scene_of(law)),
    *(
        (calculation, each, "law.friction must be 0, got 0.3 at the lower")
        for calculation in (linearise, exact, lambda scene: harmonic_response(scene, [0.1, 0.2]))
        for each in (law(0.3), STIFF.replace(friction=0.3))
    ),
    error=NotApplicable,
)


test_a_tangent_that_is_none_is_refused = refusals(
    lambda keys: scene_of(law(0.2), impact_pairs=[ImpactPair(on="x", upper=0.5, **keys)]),
    ({"law": law(0.2)}, "takes tangent and a law with friction together"),
    ({"law": STIFF.replace(friction=0.3)}, "takes tangent and a law with friction together"),
    ({"law": law(0.0), "tangent": "y"}, "got tangent alone"),
    ({"law": law(0.2), "tangent": "z"}, "must have its tangent on 'x' or 'y', got 'z'"),
    ({"law": law(0.2), "tangent": "x"}, "a tangent that moves apart from the pair"),
    ({"law": law(0.2), "tangent": (1.0, 0.0, 0.0)}, "on a rigid body only"),
)


def test_a_level_of_friction_is_not_negative() -> None:
    with pytest.raises(SceneError, match="friction"):
        law(-0.1)


# ------------------------------------------------------------------------------
# Compliant stops that rub: exact laws, balances, an integrator by events, and the rigid limit.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "coupled", "kinds"),
    [
        (Elastic(stiffness=400.0, friction=0.7), 0.0, {"sticks", "breaks loose"}),
        (Elastic(stiffness=400.0, friction=0.7), 0.7, {"sticks", "breaks loose", "slides back"}),
        (Viscoelastic(stiffness=400.0, damping_ratio=0.2, friction=0.4), -0.6,
         {"sticks", "breaks loose", "slides back"}),
        (Elastic(stiffness=400.0, friction=0.05), -0.6, {"slides back"}),
    ],
)  # fmt: skip
def test_a_path_between_compliant_stops_that_rub_is_that_of_an_integrator_by_events(
    law: CompliantLaw, coupled: float, kinds: set[str]
) -> None:
    end = 12.0
    plan = make_plan(model_of(scene_of(law, coupled, excitations=SINES)), None, end)
    plan = replace(plan, duration=end)
    judge = ContactByEvents(
        law, mass_of(coupled), np.diag(DAMPING), np.diag(STIFFNESS), (LOWER, UPPER)
    )
    found, known = rubbed_path(plan, judge)
    assert judge.kinds == kinds
    assert np.all(
        np.abs(found - known[:, :2]).max(axis=0) < 6e-3 * np.abs(known[:, :2]).max(axis=0)
    )
    alone = scene_of(law.replace(friction=None), coupled, excitations=SINES)
    smooth = replace(plan, model=model_of(alone)).record(5, 0)["displacement of y"]
    assert np.abs(smooth - known[:, 1]).max() > 0.05  # the control
    plan = replace(plan, burn_in=1e-9)
    rows = dict(zip(plan.layout.rows, plan.averages(5, 0, 1), strict=True))
    lost = float(rows["stops", "rubbing"][0]) * plan.model.pairs[0].mass * plan.steps * plan.step
    first = plan.burn_in_steps  # one step
    later = known[-1, 4] - known[first - 1, 4]
    assert lost == pytest.approx(later, rel=0.05)
    assert later > 0.5


@pytest.mark.parametrize(
    ("coupled", "friction", "along"),
    [(0.0, 0.2, 2.0), (0.0, 0.8, 0.3), (0.7, 0.3, 1.5), (0.7, 0.9, 0.2), (-0.6, 0.2, 0.1)],
)
def test_a_stiff_stop_is_a_rigid_one(coupled: float, friction: float, along: float) -> None:
    """The impact of Routh and Stronge with the restitution 1, as a spring gives back its work."""
    w = 1.0
    inverse = np.linalg.inv(mass_of(coupled))
    ratio = inverse[1, 1] / inverse[0, 0]
    rebound, push, rubbed = rub(
        w, along, 1.0, friction, ratio, inverse[0, 1] / inverse[0, 0], inverse[0, 1] / inverse[1, 1]
    )  # fmt: skip
    known = np.array([
        -rebound, along - push * inverse[0, 1] / inverse[0, 0] + rubbed,
    ])  # fmt: skip
    errors = []
    for stiffness in (1e4, 1e6):
        soft = Elastic(stiffness=stiffness, friction=friction)
        plan = make_plan(model_of(scene_of(soft, coupled, excitations=SINES)), None, 1.0)
        plan = plan.with_step(8.0 / math.sqrt(stiffness))
        streams = np.empty((2, 1), np.uint64)
        seed_streams(np.uint64(1), 0, streams)
        state = plan.start(streams)
        state[4:] = 0.0
        shapes = np.linalg.inv(plan.modes.shapes)
        state[:2, 0] = shapes @ np.array([UPPER - 0.1 * plan.step * w, 0.0])
        state[2:4, 0] = shapes @ np.array([w, along])
        plan.fly(state, streams, 1)
        after = plan.modes.shapes @ state[2:4, 0]
        errors.append(float(np.abs(after - known).max()))
    # the rest is what springs and dampers add in a step, which falls with the step
    assert errors[1] < 0.02 and errors[1] < 0.3 * errors[0]
    without = np.array([-w, along - 2.0 * w * inverse[0, 1] / inverse[0, 0]])
    assert np.abs(known - without).max() > 0.1  # the control: friction changes the impact


def test_friction_over_a_sub_step_is_that_of_many_small_parts() -> None:
    """Slide, end of the slide, stick and slide back, against a thousandth of the sub-step each."""
    cases = [(1.0, 0.9, 0.2), (0.3, 0.3, 0.5), (0.2, -1.0, 0.4), (-0.2, 0.5, 0.1), (0.0, 0.3, 0.5)]
    for u, free, bound in cases:
        added, lost = rub_evenly(u, free, bound)
        speed, taken, parts = u, 0.0, 20_000
        for _ in range(parts):
            driven = speed + (free - u) / parts
            rubs = -math.copysign(min(abs(driven), bound / parts), driven)
            taken -= rubs * (driven + 0.5 * rubs)
            speed = driven + rubs
        assert free + added == pytest.approx(speed, abs=1e-4)
        assert lost == pytest.approx(taken, abs=1e-4)
        assert lost >= 0.0
