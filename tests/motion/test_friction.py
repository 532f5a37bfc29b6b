"""Stops that rub in simulations: balances, exact laws and an integrator by events judge."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
from support.refusals import refusals
from support.rubbing import ContactByEvents, small_steps

WHITES = [WhiteNoise(intensity=0.5, on="x"), WhiteNoise(intensity=0.3, on="y")]


def law(friction: float, restitution: Any = 0.7) -> Restitution:
    return Restitution(coefficient=restitution, friction=friction)


def scene_of(friction: float, coupled: float = 0.0, restitution: Any = 0.7, **keys: Any) -> Scene:
    """A body that moves along x between two stops and along y, with a mass matrix that couples."""
    pair: dict[str, Any] = {"on": "x", "lower": -0.4, "upper": 0.5}
    if friction:
        pair["tangent"] = "y"
    return Scene(
        **{
            "structure": Matrices(
                coordinates=["x", "y"], mass=[[1.0, coupled], [coupled, 1.5]],
                damping=[[0.3, 0.0], [0.0, 0.1]], stiffness=[[4.0, 0.0], [0.0, 1.0]],
            ),
            "impact_pairs": [ImpactPair(**pair, law=law(friction, restitution))],
            "excitations": WHITES,
        } | keys
    )  # fmt: skip


@pytest.mark.parametrize("friction", [0.2, 1.5])
def test_the_normal_motion_is_that_without_friction_where_nothing_couples(friction: float) -> None:
    """The exact law of the oscillator judges it, though friction makes the stops lossy along y."""
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.3, stiffness=4.0),
        impact_pairs=[ImpactPair(lower=-0.4, upper=0.5, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.5)],
    )
    known = exact(alone)
    found = simulate(scene_of(friction, restitution=1.0), paths=512, duration=100.0, seed=2)
    for name in ("displacement_mean_square", "velocity_mean_square"):
        assert_agrees(found.coordinates["x"][name], known.coordinates["x"][name].value)
    for name in ("collision_rate", "impact_speed_square_rate"):
        assert_agrees(found.impact_pairs["stops"][name], known.impact_pairs["stops"][name].value)
    free = 0.3 / 2.0 / 0.1 / 1.5  # E y'^2 without friction
    with pytest.raises(AssertionError):
        assert_agrees(found.coordinates["y"]["velocity_mean_square"], free)


@pytest.mark.parametrize("coupled", [0.0, 0.7, -0.9])
def test_the_energy_balance_holds_and_not_without_the_loss_of_friction(coupled: float) -> None:
    for restitution in (0.0, 0.7, {"mean": 0.6, "std": 0.2}):
        scene = scene_of(0.4, coupled, restitution)
        found = simulate(scene, paths=256, duration=60.0, seed=4)
        assert set(found.identities) == {"energy"}
        assert_agrees(found.identities["energy"], 0.0)
    plan = make_plan(model_of(scene), None, 60.0)
    rows = dict(zip(plan.layout.rows, plan.averages(4, 0, 256), strict=True))
    moments = rows | {(name, "variance"): rows[name, "xx"] for name in ("x", "y")}
    moments = {key: value.mean() for key, value in moments.items()}
    with_loss = residuals(plan.model, moments, [0.0, 0.0])["energy"]
    without = residuals(plan.model, moments | {("stops", "rubbing"): 0.0}, [0.0, 0.0])["energy"]
    assert abs(with_loss) < 0.03 < 0.1 < without


def test_sliding_impacts_lose_along_the_stop_what_coulomb_says() -> None:
    """On a mass that slides fast all impacts slide: the mean force along the stops is mu times the
    mean normal force (B 1.62)."""
    drift = 40.0
    structure = Matrices(
        coordinates=["x", "y"], mass=[[1.0, 0.0], [0.0, 1.5]],
        damping=[[0.3, 0.0], [0.0, 0.1]], stiffness=[[4.0, 0.0], [0.0, 1e-6]],
    )  # fmt: skip
    plan = make_plan(model_of(scene_of(0.2, structure=structure)), None, 20.0)
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
    coupled, friction, end = 0.7, 0.7, 12.0
    sines = [
        Sine(on="x", amplitude=3.0, frequency_hz=0.31), Sine(on="y", amplitude=1.0,
                                                            frequency_hz=0.17),
    ]  # fmt: skip
    scene = scene_of(friction, coupled, excitations=sines)
    plan = replace(make_plan(model_of(scene), None, end), duration=end)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(5), 0, streams)
    start = plan.start(streams)[:, 0]
    shapes = plan.modes.shapes
    mass = np.array([[1.0, coupled], [coupled, 1.5]])
    inverse = np.linalg.inv(mass)
    waves = []
    for (first, omega, _), signal in zip(plan.modes.sines, plan.model.sines, strict=True):
        value, rate = start[4 + first : 6 + first]
        waves.append((signal.direction, value, rate, omega))

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        force = sum(
            (d * (a * math.cos(w * t) + b * math.sin(w * t)) for d, a, b, w in waves), np.zeros(2)
        )
        force = force - np.array([4.0, 1.0]) * y[:2] - np.array([0.3, 0.1]) * y[2:]
        return np.concatenate([y[2:], inverse @ force])

    stops = [lambda t, y: y[0] - 0.5, lambda t, y: y[0] + 0.4]
    for stop, way in zip(stops, (1.0, -1.0), strict=True):
        stop.terminal, stop.direction = True, way
    y = np.concatenate([shapes @ start[:2], shapes @ start[2:4]])
    times = plan.step * np.arange(1, plan.steps + 1)
    t, known, kinds = 0.0, np.zeros((len(times), 2)), set()
    while t < times[-1]:
        solved = solve_ivp(
            rates, (t, times[-1] + 1e-9), y, events=stops, rtol=1e-10, atol=1e-12,
            dense_output=True,
        )  # fmt: skip
        inside = (times > t) & (times <= solved.t[-1])
        known[inside] = solved.sol(times[inside])[:2].T
        t, y = float(solved.t[-1]), solved.y[:, -1].copy()
        if not solved.status:
            break
        side = math.copysign(1.0, y[0])
        turned = inverse * np.array([[1.0, side], [side, 1.0]])
        fine, coarse = (
            np.array(small_steps(turned, side * y[2], y[3], 0.7, friction, steps))
            for steps in (40_000, 20_000)
        )
        after = 2.0 * fine - coarse if fine[1] * coarse[1] > 0.0 else fine
        print(t, fine, coarse, side * y[2], y[3])
        kinds.add("stuck" if after[1] == 0.0 else "slid")
        y[2], y[3] = side * after[0], after[1]
    found = plan.record(5, 0)
    errors = [np.abs(found[f"displacement of {name}"] - known[:, k]) for k, name in enumerate("xy")]
    print(kinds, [e.max() for e in errors])
    assert kinds == {"stuck", "slid"}
    assert max(error.max() for error in errors) < 1e-3
    plain = plan.with_step(plan.step)
    smooth = replace(plain, model=model_of(scene_of(0.0, coupled, excitations=sines)))
    other = smooth.record(5, 0)["displacement of y"]
    assert np.abs(other - known[:, 1]).max() > 0.05


def test_tables_and_compliant_stops_may_be_beside_stops_that_rub() -> None:
    band = {"frequency_hz": [0.1, 1.0], "density": [1.0, 1.0], "unit": "N2/Hz"}
    tables = [TabulatedNoise(on=name, **band) for name in "xy"]
    rubbing = simulate(scene_of(0.4, excitations=tables), paths=128, duration=100.0, seed=1)
    plain = simulate(scene_of(0.0, excitations=tables), paths=128, duration=100.0, seed=1)
    for name in ("displacement_mean_square", "velocity_mean_square"):  # x does not feel it
        first, second = (each.coordinates["x"][name] for each in (rubbing, plain))
        error = math.hypot(first.standard_error, second.standard_error)
        assert abs(first.value - second.value) < 4.5 * error
        y = [each.coordinates["y"][name].value for each in (rubbing, plain)]
        assert y[0] < 0.9 * y[1]
    soft = ImpactPair(
        name="soft", on="y", clearance=0.3, law=Viscoelastic(stiffness=50.0, damping_ratio=0.1)
    )
    hard = scene_of(0.4, 0.5).impact_pairs[0]
    found = simulate(
        scene_of(0.4, 0.5, impact_pairs=[hard, soft]), paths=128, duration=60.0, seed=1
    )
    assert_agrees(found.identities["energy"], 0.0)
    assert found.impact_pairs["soft"]["collision_rate"].value > 0.1


def test_a_mass_that_is_pressed_onto_a_stop_keeps_its_balance() -> None:
    """Chatter ends at rest, and friction holds the mass back as far as the load presses."""
    for restitution in (0.0, 0.5):
        loaded = scene_of(
            0.3, 0.2, restitution, excitations=[*WHITES, ConstantLoad(force=2.5, on="x")]
        )
        found = simulate(loaded, paths=256, duration=40.0, seed=1)
        assert_agrees(found.identities["energy"], 0.0)


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
        assert_agrees(found[friction].identities["energy"], 0.0)
    rubbed, smooth = (found[each].coordinates["x"]["velocity_std"] for each in (0.5, 0.0))
    error = math.hypot(rubbed.standard_error, smooth.standard_error)
    assert smooth.value - rubbed.value > 4.5 * error


@pytest.mark.slow
def test_records_counts_and_pages_know_only_the_pairs() -> None:
    scene = scene_of(0.3)
    found = simulate(scene, paths=16, duration=10.0, seed=1)
    assert list(found.impact_pairs) == ["stops"]
    assert "rigid stop lower, friction 0.3" in found.effects
    assert any("Coulomb's" in each for each in found.assumptions)
    columns = history(scene, duration=10.0, seed=1).to_frame().columns
    assert not any("tangent" in each for each in columns)
    rate = impacts(scene, paths=64, duration=60.0, seed=1).pairs["stops"].rates["both"].estimate
    assert rate.value > 0.1
    assert explain(scene).methods["simulate"] == "applies"
    assert check(scene, rel_error=0.05, seed=1).passed
    assert screen(scene).coordinates  # stops are left out


@pytest.mark.parametrize(
    "calculation", [linearise, exact, lambda scene: harmonic_response(scene, [0.1, 0.2])]
)
def test_other_methods_refuse_friction(calculation: Any) -> None:
    for scene in (scene_of(0.3), scene_of_of_contacts(Elastic(stiffness=400.0, friction=0.3))):
        with pytest.raises(NotApplicable, match=r"law\.friction must be 0, got 0\.3 at the lower"):
            calculation(scene)


test_a_tangent_that_is_none_is_refused = refusals(
    lambda keys: scene_of(0.2, impact_pairs=[ImpactPair(on="x", upper=0.5, **keys)]),
    ({"law": law(0.2)}, "takes tangent and a law with friction together"),
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


DAMPING, STIFFNESS = np.array([0.3, 0.1]), np.array([4.0, 1.0])
LOWER, UPPER = -0.4, 0.5
WHITES_OF_CONTACTS = [WhiteNoise(on="x", intensity=0.5), WhiteNoise(on="y", intensity=0.3)]
SINES = [
    Sine(on="x", amplitude=3.0, frequency_hz=0.31), Sine(on="y", amplitude=1.0, frequency_hz=0.17)
]  # fmt: skip


def mass_of(coupled: float) -> np.ndarray:
    return np.array([[1.0, coupled], [coupled, 1.5]])


def scene_of_of_contacts(
    law: CompliantLaw, coupled: float = 0.0, excitations: Any = WHITES_OF_CONTACTS
) -> Scene:
    """A body that moves along x between two stops and along y, with a mass matrix that couples."""
    tangent = {"tangent": "y"} if law.friction else {}
    return Scene(
        structure=Matrices(
            coordinates=["x", "y"], mass=mass_of(coupled).tolist(),
            damping=np.diag(DAMPING).tolist(), stiffness=np.diag(STIFFNESS).tolist(),
        ),
        impact_pairs=[ImpactPair(on="x", lower=LOWER, upper=UPPER, law=law, **tangent)],
        excitations=excitations,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.2, 1.5])
def test_the_normal_motion_is_that_without_friction_where_nothing_couples_contacts(
    friction: float,
) -> None:
    """The exact law of the oscillator judges it."""
    alone = Scene(
        structure=Oscillator(mass=1.0, damping=0.3, stiffness=4.0),
        impact_pairs=[ImpactPair(lower=LOWER, upper=UPPER, law=Elastic(stiffness=400.0))],
        excitations=[WhiteNoise(intensity=0.5)],
    )
    known = exact(alone)
    law = Elastic(stiffness=400.0, friction=friction)
    found = simulate(scene_of_of_contacts(law), paths=512, duration=100.0, seed=2)
    for name in ("displacement_mean_square", "velocity_mean_square"):
        assert_agrees(found.coordinates["x"][name], known.coordinates["x"][name].value)
    for name in ("collision_rate", "impact_speed_square_rate", "contact_probability"):
        assert_agrees(found.impact_pairs["stops"][name], known.impact_pairs["stops"][name].value)
    free = 0.3 / 2.0 / 0.1 / 1.5  # E y'^2 without friction
    with pytest.raises(AssertionError):
        assert_agrees(found.coordinates["y"]["velocity_mean_square"], free)


LAWS: list[CompliantLaw] = [
    Elastic(stiffness=400.0, friction=0.4),
    Viscoelastic(stiffness=400.0, damping_ratio=0.2, friction=0.4),
    Hertz(coefficient=2000.0, friction=0.4),
    PowerLaw(coefficient=2000.0, exponent=1.5, loss=500.0, friction=0.4),
]


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("coupled", [0.0, 0.7])
def test_the_energy_balance_holds_and_not_without_the_loss_of_friction_contacts(
    law: CompliantLaw, coupled: float
) -> None:
    scene = scene_of_of_contacts(law, coupled)
    found = simulate(scene, paths=256, duration=60.0, seed=4)
    assert set(found.identities) == {"energy"}
    assert_agrees(found.identities["energy"], 0.0)
    if law is LAWS[0]:
        plan = make_plan(model_of(scene), None, 60.0)
        rows = dict(zip(plan.layout.rows, plan.averages(4, 0, 256), strict=True))
        moments = rows | {(name, "variance"): rows[name, "xx"] for name in ("x", "y")}
        moments = {key: value.mean() for key, value in moments.items()}
        with_loss = residuals(plan.model, moments, [0.0, 0.0])["energy"]
        without = residuals(plan.model, moments | {("stops", "rubbing"): 0.0}, [0.0, 0.0])
        assert abs(with_loss) < 0.03 < 0.1 < without["energy"]


def waving(waves: Any) -> Callable[[float], np.ndarray]:
    """Forces of sines (direction, value, rate, frequency) at a time."""

    def forces(t: float) -> np.ndarray:
        return np.sum([d * (a * math.cos(w * t) + b * math.sin(w * t)) for d, a, b, w in waves], 0)

    return forces


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
def test_a_path_between_stops_that_rub_is_that_of_an_integrator_by_events_contacts(
    law: CompliantLaw, coupled: float, kinds: set[str]
) -> None:
    scene, end = scene_of_of_contacts(law, coupled, SINES), 12.0
    plan = replace(make_plan(model_of(scene), None, end), duration=end)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(5), 0, streams)
    start, shapes, waves = plan.start(streams)[:, 0], plan.modes.shapes, []
    for (first, omega, _), signal in zip(plan.modes.sines, plan.model.sines, strict=True):
        value, rate = start[4 + first : 6 + first]
        waves.append((signal.direction, value, rate, omega))
    judge = ContactByEvents(
        law, mass_of(coupled), np.diag(DAMPING), np.diag(STIFFNESS), (LOWER, UPPER), waving(waves)
    )
    times = plan.step * np.arange(1, plan.steps + 1)
    known = judge.path(np.concatenate([shapes @ start[:2], shapes @ start[2:4]]), times)
    assert judge.kinds == kinds
    found = plan.record(5, 0)
    largest = np.abs(known[:, :2]).max(axis=0)
    for k, name in enumerate("xy"):
        assert np.abs(found[f"displacement of {name}"] - known[:, k]).max() < 6e-3 * largest[k]
    alone = scene_of_of_contacts(law.replace(friction=None), coupled, SINES)
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
        scene = scene_of_of_contacts(
            Elastic(stiffness=stiffness, friction=friction), coupled, SINES
        )
        plan = make_plan(model_of(scene), None, 1.0)
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


@pytest.mark.slow
def test_tables_loads_and_statistics_go_beside_stops_that_rub() -> None:
    law = Viscoelastic(stiffness=400.0, damping_ratio=0.1, friction=0.4)
    band = {"frequency_hz": [0.1, 1.0], "density": [1.0, 1.0], "unit": "N2/Hz"}
    tables = [TabulatedNoise(on=name, **band) for name in "xy"]
    loaded = [*WHITES_OF_CONTACTS, ConstantLoad(force=2.5, on="x")]
    pressed = simulate(scene_of_of_contacts(law, 0.3, loaded), paths=128, duration=60.0, seed=1)
    assert_agrees(pressed.identities["energy"], 0.0)
    rubbing, plain = (
        simulate(scene_of_of_contacts(each, 0.0, tables), paths=128, duration=100.0, seed=1)
        for each in (law, law.replace(friction=None))
    )
    x, y = ([each.coordinates[name]["velocity_mean_square"] for each in (rubbing, plain)]
            for name in "xy")  # fmt: skip
    error = 4.5 * math.hypot(x[0].standard_error, x[1].standard_error)
    assert x[0].value == pytest.approx(x[1].value, abs=error)  # x does not feel it
    assert y[0].value < 0.9 * y[1].value
    scene = scene_of_of_contacts(law)
    assert "viscoelastic stop lower, friction 0.4" in scene.effects()
    assert any("friction in a contact" in each for each in scene.assumptions())
    assert impacts(scene, paths=64, duration=60.0, seed=1).pairs["stops"].rates
    assert explain(scene).methods["simulate"] == "applies"


def test_friction_needs_a_tangent() -> None:
    with pytest.raises(SceneError, match="takes tangent and a law with friction together"):
        ImpactPair(upper=0.5, law=Elastic(stiffness=1.0, friction=0.3))
