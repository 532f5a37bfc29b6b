"""The schema of scene files takes what is a scene, and nothing that has a wrong key or type."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from stochvi.cli.scenes import KINDS
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.impact_laws.compliant import DAMPING, PAD
from stochvi.scenes.keys import RUBBER, scene_schema
from support.commands import Run

SCENES = sorted((data_folder() / "scenes").rglob("*.toml"))
SCHEMA = scene_schema()
PARTS = {"Scene": SCHEMA, **SCHEMA["$defs"]}


def problems(document: dict[str, Any]) -> list[str]:
    return [each.message for each in jsonschema.Draft202012Validator(SCHEMA).iter_errors(document)]


def test_the_schema_itself_is_valid() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_every_scene_that_ships_is_valid() -> None:
    assert len(SCENES) > 80
    for path in SCENES:
        assert problems(tomllib.loads(path.read_text(encoding="utf-8"))) == [], path


@pytest.mark.parametrize("kind", ["any", *KINDS])
def test_every_new_scene_is_valid(kind: str, stochvi: Run, tmp_path: Path) -> None:
    assert stochvi("new", tmp_path / "scene.toml", "--kind", kind).code == 0
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    assert problems(tomllib.loads(text)) == []


WHOLE = """
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0

[[impact_pair]]
upper = 1.0
law = { coefficient = 0.5 }

[[excitation]]
kind = "white"
intensity = 1.0
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mass =", "mas ="),
        ("mass = 1.0", "mass = -1.0"),
        ("mass = 1.0", 'mass = "1 kg"'),
        ("mass = 1.0", "mass = true"),
        ('kind = "oscillator"', 'kind = "nonlinear"'),
        ('kind = "oscillator"', ""),
        ("coefficient = 0.5", 'kind = "hertz", stiffness = 1.0'),
        ("[[excitation]]", "[excitation]"),
        ("upper =", "uppper ="),
    ],
)
def test_a_wrong_key_or_type_is_noticed(old: str, new: str) -> None:
    assert old in WHOLE
    assert problems(tomllib.loads(WHOLE)) == []
    assert problems(tomllib.loads(WHOLE.replace(old, new))) != []


@pytest.mark.parametrize(
    "law",
    [
        '{ kind = "elastic", shore_a = 60.0, area = 4e-4, thickness = 0.01 }',
        '{ kind = "viscoelastic", stiffness = 1e5, loss_factor = 0.4 }',
        '{ kind = "viscoelastic", stiffness = 1e5, restitution = 0.6, at_speed = 0.5 }',
        '{ kind = "table", file = "bumper.csv", unit = "mm,N" }',
    ],
)
def test_numbers_that_are_converted_are_valid(law: str) -> None:
    assert problems(tomllib.loads(WHOLE.replace("{ coefficient = 0.5 }", law))) == []


def test_every_key_of_every_part_is_described() -> None:
    assert set(RUBBER) == {*PAD, *DAMPING[1:], "at_speed"}
    for name, part in PARTS.items():
        assert part["description"].endswith((".", ":")), name
        for key, each in part["properties"].items():
            assert each["description"], (name, key)
