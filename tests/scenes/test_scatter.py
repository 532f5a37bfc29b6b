"""Numbers that scatter in a scene: what is accepted, what is refused, and how they are varied."""

from __future__ import annotations

import json
from typing import Any

import pytest

from stochvi import Restitution, Scatter, SceneError, load_scene, sweep
from stochvi.scenes.scene import scene_from
from stochvi.scenes.schema import scene_schema

SCENE = """
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0

[[impact_pair]]
lower = -1.0
upper = 1.0
law = { kind = "restitution", coefficient = 0.5 }
upper_law = { kind = "restitution", coefficient = { mean = 0.7, std = 0.1 } }

[[excitation]]
kind = "white"
intensity = 0.2
"""


def test_each_stop_may_have_its_own(tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = load_scene(path)
    lower, upper = (law for _, law in scene.impact_pairs[0].stops())
    assert lower == Restitution(coefficient=0.5)
    assert upper == Restitution(coefficient=Scatter(mean=0.7, std=0.1))
    assert scene.effects()[1:] == (
        "rigid stop lower", "rigid stop upper, restitution drawn at each impact",
    )  # fmt: skip
    again = scene_from(json.loads(json.dumps(scene.model_dump(mode="json", by_alias=True))))
    assert again == scene


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"mean": 0.7, "std": 0.5}, "must have std below sqrt(mean (1 - mean)) = 0.4583, got 0.5"),
        ({"mean": 1.0, "std": 0.1}, "must have std below sqrt(mean (1 - mean)) = 0, got 0.1"),
        ({"mean": 1.2, "std": 0.1}, "coefficient must be in [0, 1], got 1.2"),
        ({"mean": 0.7}, "coefficient.std is missing"),
        ({"mean": 0.7, "std": -0.1}, "coefficient.std must be at least 0, got -0.1"),
        ({"mean": 0.7, "sd": 0.1}, "coefficient.sd is not a known key; did you mean 'std'?"),
        ({"mean": "x", "std": 0.1}, "coefficient.mean must be a finite number, got 'x'"),
        ([0.7, 0.1], "coefficient must be a finite number, got [0.7, 0.1]"),
        (1.7, "coefficient must be in [0, 1], got 1.7"),
    ],
)
def test_what_is_no_restitution_is_refused_in_a_sentence(value: Any, words: str) -> None:
    with pytest.raises(SceneError) as failure:
        Restitution(coefficient=value)
    assert words in str(failure.value)


@pytest.mark.parametrize("mean", [0.0, 0.3, 1.0])
def test_no_scatter_is_allowed_at_any_mean(mean: float) -> None:
    law = Restitution(coefficient={"mean": mean, "std": 0.0})
    assert law.scatter is None
    assert law.restitution == law.slow_restitution == mean
    assert law.restitution_mean_square == mean**2
    assert law.conservative == (mean == 1.0)


def test_mean_and_std_can_be_varied(tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = load_scene(path)
    key = "impact_pair.0.upper_law.coefficient"
    table = sweep(scene, {f"{key}.std": [0.0, 0.2], f"{key}.mean": [0.6]}, method="fokker-planck")
    first, last = table["stops.impact_speed_rate"]
    assert first < last
    with pytest.raises(SceneError, match=r"did you mean 'impact_pair.0.upper_law.coefficient.mean"):
        sweep(scene, {key: [0.5]})
    with pytest.raises(SceneError, match=r"std = 0.6, impact_pair.0.upper_law.coefficient must"):
        sweep(scene, {f"{key}.std": [0.6]})


def test_the_schema_of_scene_files_knows_it() -> None:
    parts = scene_schema()["$defs"]
    choices = parts["Restitution"]["properties"]["coefficient"]["oneOf"]
    assert choices == [{"type": "number"}, {"$ref": "#/$defs/Scatter"}]
    assert parts["Scatter"]["required"] == ["mean", "std"]


@pytest.mark.parametrize("amount", [-2.0, -0.1, 0.1, 2.0])
def test_a_shifted_mean_keeps_a_distribution(amount: float) -> None:
    law = Restitution(coefficient={"mean": 0.7, "std": 0.3}).shifted(amount)
    assert law.scatter is not None and law.scatter.std == 0.3
    assert law.scatter.alpha > 0.0 and law.scatter.beta > 0.0
    if abs(amount) < 1.0:
        assert law.restitution == pytest.approx(0.7 + amount)


def test_a_law_that_was_read_is_the_same_law_and_changes_with_its_coefficient() -> None:
    law, unread = (Restitution(coefficient={"mean": 0.7, "std": 0.1}) for _ in range(2))
    known = law.scatter, law.restitution, law.restitution_mean_square
    assert known[1:] == (0.7, pytest.approx(0.5))
    assert (law, hash(law), repr(law)) == (unread, hash(unread), repr(unread))
    plain = law.replace(coefficient=0.5)
    assert (plain.scatter, plain.restitution, plain.restitution_mean_square) == (None, 0.5, 0.25)
