"""A restitution that depends on the speed: in simulation, replay, Fokker-Planck and elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    RecordedNoise,
    Response,
    Restitution,
    Scene,
    SceneError,
    SpeedRestitution,
    WhiteNoise,
    exact,
    fokker_planck,
    linearise,
    load_scene,
    reliability,
    replay,
    simulate,
)
from stochvi.engine.compiled_laws import functions_of, row_of_numbers
from stochvi.engine.law import is_rigid, rebound
from stochvi.engine.law_calls import mean_rebound_of, rebound_of
from stochvi.engine.uniform_numbers import uniform_of
from stochvi.identification import Rebounds, identify
from stochvi.scenes.impact_laws.bodies import viscoelastic_restitution
from stochvi.testing import assert_agrees
from stochvi.verification.explain import explain
from support.accuracies import quick_cases
from support.known import values

LAWS: dict[str, dict[str, Any]] = {
    "viscoelastic": {"coefficient": 0.6, "at_speed": 0.5, "body": "viscoelastic"},
    "hunt-crossley": {"coefficient": 0.7, "at_speed": 0.6, "body": "hunt-crossley"},
    "yielding": {"coefficient": 0.6, "at_speed": 0.8, "body": "yielding"},
    "power": {"coefficient": 0.8, "at_speed": 0.5, "body": "power", "exponent": -0.3},
    "list": {"speed": [0.1, 0.5, 2.0], "coefficient": [0.95, 0.7, 0.3]},
}
JUDGED = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def law_of(name: str, **changes: Any) -> SpeedRestitution:
    return SpeedRestitution(**{**LAWS[name], **changes})


def scene_of(law: Any, *, gap: float = 0.6, upper: float | None = None, load: float = 0.0) -> Scene:
    pushed = [ConstantLoad(force=load)] if load else []
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap if upper is None else upper, law=law)],
        excitations=[WhiteNoise(intensity=0.2), *pushed],
    )


def assert_alike(found: Response, judge: Response, pair: str = "stops") -> None:
    """The judged quantities of a simulation agree with those of a judge, exact to 1e-4."""
    one = {**found.coordinates["x"], **found.impact_pairs[pair]}
    other = {**judge.coordinates["x"], **judge.impact_pairs["stops"]}
    for name in JUDGED:
        assert_agrees(one[name], other[name].value)


# ---- the law -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_the_engine_has_the_restitution_of_the_law(name: str) -> None:
    law = law_of(name)
    compiled = law.compiled()
    assert is_rigid(compiled)
    speeds = np.geomspace(1e-5, 90.0, 400)
    found = np.array([rebound(compiled, w, 0.5) / w for w in speeds])
    wanted = law.restitution_at(speeds)
    # a kink of the body that yields lies within a cell of the table
    error = 3e-3 if name == "yielding" else 1e-4
    assert found == pytest.approx(wanted, abs=error)
    assert np.ptp(wanted) > 100.0 * 1e-4  # the control: the speed matters
    table, numbers = functions_of([compiled]), row_of_numbers(compiled)[None]
    for w in (0.05, 0.7, 3.0):
        back = rebound_of(table, 0, numbers, 0, w, uniform_of(np.uint64(1), 0))
        assert back == pytest.approx(w * float(law.restitution_at(w)), abs=error * w)
    assert mean_rebound_of(table, 0, numbers, 0, 1.0) == pytest.approx(
        float(law.restitution_at(1e-6)), rel=1e-12
    )


def test_bodies_have_the_restitution_of_their_formulas() -> None:
    yields = law_of("yielding")
    start = 0.8 * 0.6**4  # the speed w_y
    assert yields.restitution_at([0.9 * start, 16.0 * start]) == pytest.approx([1.0, 0.5])
    soft = law_of("viscoelastic")
    # slow impacts lose with w^(1/5)
    lost = 1.0 - soft.restitution_at(np.array([1e-9, 1e-8]))
    assert lost[1] / lost[0] == pytest.approx(10.0**0.2, rel=0.02)
    wet = law_of("hunt-crossley")
    lost = 1.0 - wet.restitution_at(np.array([1e-4, 2e-4]))
    assert lost[1] / lost[0] == pytest.approx(2.0, rel=1e-3)
    assert law_of("power").restitution_at([1e-3, 0.5, 5.0]) == pytest.approx(
        [1.0, 0.8, 0.8 * 10.0**-0.3]
    )
    assert law_of("viscoelastic", coefficient=1.0).conservative


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"coefficient": 0.5}, "needs body where coefficient is one number"),
        ({"coefficient": [0.5, 0.4]}, "needs speed where coefficient is a list"),
        ({"coefficient": [0.5, 0.4], "speed": [1.0]}, "as many entries .* got 2 and 1"),
        ({"coefficient": [0.5, 0.4], "speed": [2.0, 1.0]}, "increasing speed, got 1 after 2"),
        ({"coefficient": [0.5, 1.4], "speed": [1.0, 2.0]}, r"in \[0, 1\], got 1.4"),
        ({"coefficient": 1.5, "body": "yielding"}, r"in \[0.01, 1\] with a body, got 1.5"),
        ({"coefficient": 0.5, "body": "power"}, "needs exponent with body = 'power'"),
        ({"coefficient": 0.5, "body": "stone"}, "body must be 'viscoelastic'"),
        ({"coefficient": lambda w: 0.5, "body": "power"}, "takes no body .* is a function"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        SpeedRestitution(**keys)


# ---- methods that follow it ----------------------------------------------------------------------


def random_cases(count: int) -> list[tuple[SpeedRestitution, dict[str, float]]]:
    rng, found = np.random.default_rng(34), []
    for number in range(count):
        name = list(LAWS)[number % len(LAWS)]
        if name == "list":
            top = float(rng.uniform(0.7, 1.0))
            law = law_of(name, coefficient=[top, 0.8 * top, float(rng.uniform(0.3, 0.6)) * top])
        else:
            law = law_of(name, coefficient=float(rng.uniform(0.45, 0.95)))
        keys = {"gap": float(rng.uniform(0.3, 1.2)), "upper": float(rng.uniform(0.1, 1.2))}
        found.append((law, keys))
    return found


@quick_cases(("law", "keys"), random_cases(20), keep=(0, 2, 3, 4))
def test_simulation_has_the_density_of_fokker_and_planck(
    law: SpeedRestitution, keys: dict[str, float]
) -> None:
    scene = scene_of(law, **keys)
    judge = fokker_planck(scene, rtol=1e-4)
    found, known = simulate(scene, rel_error=0.01, seed=7), values(judge)
    assert_alike(found, judge)
    for balance in ("energy", "virial", "force"):
        assert_agrees(found.identities[balance], 0.0)
    # the control: the restitution at one speed for all
    constant = values(fokker_planck(scene_of(Restitution(coefficient=law.restitution), **keys)))
    worst = max(abs(constant[name] / known[name] - 1.0) for name in JUDGED)
    assert worst > 0.01


def test_the_loss_in_the_balance_is_that_of_each_speed() -> None:
    """With the loss of one restitution for all speeds the balance of energy would fail."""
    scene = scene_of(law_of("list"))
    found = simulate(scene, rel_error=0.01, seed=3)
    assert_agrees(found.identities["energy"], 0.0)
    pair, speed = found.impact_pairs["stops"], found.coordinates["x"]["velocity_mean_square"]
    constant = (1.0 - 0.7**2) / 2.0 * pair["impact_speed_square_rate"].value
    assert abs(0.1 - 0.1 * speed.value - constant) > 0.05 * 0.1


@pytest.mark.slow
def test_a_structure_follows_it_as_one_mass_does() -> None:
    """The oscillator beside another one that it does not know, under a law for each stop; beside a
    compliant stop impacts between contacts are summed as well."""
    law = law_of("viscoelastic")
    known = fokker_planck(scene_of(law), rtol=1e-4)
    other = ImpactPair(on="z", clearance=0.3, law=Elastic(stiffness=50.0))
    scene = Scene(
        structure=Matrices(
            coordinates=["x", "z"], mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[0.1, 0.0], [0.0, 0.1]], stiffness=[[1.0, 0.0], [0.0, 2.0]],
        ),
        impact_pairs=[ImpactPair(on="x", name="own", clearance=0.6, law=law), other],
        excitations=[WhiteNoise(intensity=0.2, on=name) for name in ("x", "z")],
    )  # fmt: skip
    found = simulate(scene, rel_error=0.01, seed=5)
    assert_alike(found, known, "own")
    assert_agrees(found.identities["energy"], 0.0)
    assert_agrees(found.identities["force on x"], 0.0)


def test_a_mass_that_is_pressed_onto_its_stop_rests_there() -> None:
    scene = scene_of(law_of("list"), gap=2.0, upper=0.1, load=0.6)
    found = simulate(scene, rel_error=0.01, seed=5)
    assert_alike(found, fokker_planck(scene, rtol=1e-4))
    assert_agrees(found.identities["force"], 0.0)


def test_a_replay_loses_at_each_impact_what_its_speed_says(tmp_path: Path) -> None:
    """A mass that falls onto its stop again and again: w' = R(w) w."""
    np.savetxt(tmp_path / "rest.txt", np.where(np.arange(20000) < 20, 60.0, 0.0))
    law = law_of("list")
    scene = Scene(
        structure=Isolator(frequency_hz=0.02, zeta=0.0, mass=1.0),
        impact_pairs=[ImpactPair(lower=-5.0, upper=0.0, law=law)],
        excitations=[
            RecordedNoise(file=str(tmp_path / "rest.txt"), unit="m/s2", fs=1000.0),
            ConstantLoad(acceleration=-2.0),
        ],
    )
    speeds = np.abs(replay(scene).impacts["speed"].to_numpy())
    speeds = speeds[speeds > 1e-2]
    assert len(speeds) > 4
    assert speeds[1:] == pytest.approx(law.restitution_at(speeds[:-1]) * speeds[:-1], rel=2e-3)
    assert np.ptp(speeds[1:] / speeds[:-1]) > 0.1  # the control: no constant restitution


# ---- those that refuse it, and files -------------------------------------------------------------


@pytest.mark.parametrize("method", [exact, linearise])
def test_methods_for_a_number_refuse_it_by_name(method: Any) -> None:
    with pytest.raises(NotApplicable, match="got a function of speed at the lower stop"):
        method(scene_of(law_of("list")))


def test_a_scene_file_holds_every_form(tmp_path: Path) -> None:
    lines = [
        'law = { kind = "speed-restitution", coefficient = 0.8, at_speed = 0.5, '
        'body = "viscoelastic" }',
        'law = { kind = "speed-restitution", speed = [0.1, 2.0], coefficient = [0.9, 0.5] }',
    ]
    for line in lines:
        (tmp_path / "a.toml").write_text(
            '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
            f'[[impact_pair]]\nclearance = 0.6\n{line}\n[[excitation]]\nkind = "white"\n'
            "intensity = 0.2\n"
        )
        scene = load_scene(tmp_path / "a.toml")
        found = explain(scene)
        assert found.methods["simulate"] == found.methods["fokker-planck"] == "applies"
        assert "rigid stop upper, restitution by speed" in found.effects
        assert "restitution depends on the speed of the impact alone" in scene.assumptions()


def test_the_line_of_a_test_is_a_law_of_a_scene(tmp_path: Path) -> None:
    """The numbers of the line give the restitutions of the law that the test shows."""
    speeds = np.geomspace(0.05, 2.5, 14)
    rebounds = viscoelastic_restitution(0.2 * speeds**0.2) * speeds
    noise = 1.0 + 2e-3 * np.random.default_rng(2).standard_normal(14)
    found = identify(Rebounds(approach=speeds, rebound=rebounds * noise), at_speed=0.5)
    assert found.chosen == "viscoelastic body"
    (tmp_path / "a.toml").write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
        f'[[impact_pair]]\nclearance = 0.6\n{found.line}\n[[excitation]]\nkind = "white"\n'
        "intensity = 0.2\n"
    )
    law = load_scene(tmp_path / "a.toml").impact_pairs[0].law
    assert isinstance(law, SpeedRestitution)
    wanted = viscoelastic_restitution(0.2 * speeds**0.2)
    assert law.restitution_at(speeds) == pytest.approx(wanted, abs=3e-3)
    assert found.law.restitution_at(speeds) == pytest.approx(wanted, abs=3e-3)
    constant = found.law.restitution_at([0.5])
    assert np.abs(constant - wanted).max() > 0.03  # the control


def test_fast_impacts_of_missions_know_the_law() -> None:
    """The probability of an impact above a speed in a time that is too short for two of them: their
    rate times it, by Fokker-Planck."""
    scene = scene_of(law_of("list"), gap=0.4)
    found = reliability(scene, mission=0.2, impact_speed=0.9, rel_error=0.03, seed=2)
    chance = found.chances["impact_speed"].estimate
    judged = [
        fokker_planck(each, rtol=1e-4, speed_threshold=0.9).impact_pairs["stops"]["collision_rate"]
        for each in (scene, scene_of(Restitution(coefficient=0.7), gap=0.4))
    ]
    known, constant = (each.value * 0.2 for each in judged)
    assert_agrees(chance, known)
    assert abs(constant / known - 1.0) > 0.2
