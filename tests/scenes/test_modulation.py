"""What a user writes for a modulation, and the sentences where it does not fit."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stochvi import Matrices, Oscillator, Scene, SceneError, WhiteNoise
from stochvi.model.model import model_of
from stochvi.scenes import Modulation
from stochvi.scenes.structures import Modes


def scene_of(structure: Any = None, **keys: Any) -> Scene:
    plain = Oscillator(mass=2.0, damping=0.2, stiffness=8.0)
    return Scene(
        structure=structure or plain,
        excitations=[
            WhiteNoise(intensity=0.4, on="a" if structure else None),
            {"kind": "modulation"} | keys,
        ],
    )


def test_a_modulation_is_a_force_and_a_signal_of_the_model() -> None:
    model = model_of(scene_of(of="stiffness", intensity=0.1, frequency_hz=1.0, zeta=0.5))
    (part,), (signal,) = model.functions, model.signals
    assert (part.law.stiffness, part.law.damping, part.signal) == (8.0, 0.0, 0)
    assert signal.direction.tolist() == [0.0] and signal.omega == 2.0 * math.pi
    white = model_of(scene_of(of="damping", intensity=0.1))
    assert white.signals == () and white.functions[0].white_modulation == 0.1
    assert white.shaken and not model_of(scene_of(of="damping", intensity=0.1)).pairs


def test_strengths_between_coordinates_come_from_the_matrices() -> None:
    chain = Matrices(
        coordinates=["a", "b"], mass=[[1.0, 0.0], [0.0, 2.0]],
        damping=[[0.3, -0.1], [-0.1, 0.1]], stiffness=[[5.0, -2.0], [-2.0, 2.0]],
    )  # fmt: skip
    between = model_of(scene_of(chain, of="stiffness", intensity=0.1, between=["a", "b"]))
    assert between.functions[0].law.stiffness == 2.0
    assert between.functions[0].mass == pytest.approx(2.0 / 3.0)
    ground = model_of(scene_of(chain, of="damping", intensity=0.1, on="a"))
    assert ground.functions[0].law.damping == pytest.approx(0.2)
    with pytest.raises(SceneError, match=r"needs a linear spring between b and the ground, got 0"):
        scene_of(chain, of="stiffness", intensity=0.1, on="b")


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"of": "mass", "intensity": 1.0}, "of must be 'stiffness', 'damping' or 'clearance', got"),
        ({"of": "stiffness"}, "needs amplitude and frequency_hz (a sine), intensity (white noise)"),
        ({"of": "stiffness", "amplitude": 0.1}, "filtered noise), got amplitude"),
        ({"of": "stiffness", "intensity": 0.1, "on": "y"}, "must act on 'x', got 'y'"),
        ({"of": "stiffness", "intensity": 0.1, "axis": "x"}, "takes no axis"),
    ],
)  # fmt: skip
def test_faults_are_named(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as error:
        scene_of(**keys)
    assert sentence in str(error.value)


def test_a_place_is_needed_where_there_are_several() -> None:
    unit = [[1.0, 0.0], [0.0, 1.0]]
    pair = Matrices(coordinates=["a", "b"], mass=unit, damping=unit, stiffness=unit)
    for keys, sentence in (
        ({}, "needs on or between, with names of 'a' or 'b', got none"),
        ({"on": "a", "between": ["a", "b"]}, "takes on or between, got both"),
        ({"between": ["a", "a"]}, "needs two different names in between"),
    ):
        with pytest.raises(SceneError) as error:
            scene_of(pair, of="stiffness", intensity=0.1, **keys)
        assert sentence in str(error.value)


def test_a_structure_of_modes_has_no_spring_to_modulate() -> None:
    modes = Modes(frequency_hz=[1.0], zeta=[0.1], modal_mass=[1.0], shapes={"a": [1.0]})
    with pytest.raises(SceneError, match=r"of stiffness takes structure\.kind = 'oscillator'"):
        scene_of(modes, of="stiffness", intensity=0.1)


def test_a_level_leaves_a_modulation_as_it_is() -> None:
    scene = scene_of(of="stiffness", intensity=0.1)
    louder = scene.at_level(6.0).excitations
    assert louder[1] == scene.excitations[1] and louder[0] != scene.excitations[0]


def test_two_modulations_have_names_of_their_own() -> None:
    keys = {"of": "stiffness", "amplitude": 0.1, "frequency_hz": 1.0}
    scene = scene_of(**keys)
    scene = scene.replace(excitations=[*scene.excitations, Modulation(**keys | {"amplitude": 0.2})])
    names = [part.name for part in model_of(scene).functions]
    assert names == ["modulation of stiffness by a sine 1", "modulation of stiffness by a sine 2"]
