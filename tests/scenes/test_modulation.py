"""What a user writes for a modulation, and the sentences where it does not fit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stochvi import Matrices, Oscillator, Scene, SceneError, WhiteNoise, simulate, stability
from stochvi.model.model import model_of
from stochvi.scenes import Modulation, Mount, RigidBody
from stochvi.scenes.structures import Modes
from stochvi.testing import assert_agrees


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
    with pytest.raises(SceneError, match=r"of stiffness takes structure\.kind = 'oscillator', "):
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


PLACES = [(x, y, -0.1) for x in (-0.2, 0.3) for y in (-0.15, 0.15)]


def box_of(*mounts: Mount) -> RigidBody:
    """A box on four mounts at its corners, and on others."""
    corners = [Mount(at=at, stiffness=[2e4, 1e4, 3e4], damping=[20.0, 30.0, 40.0]) for at in PLACES]
    return RigidBody(mass=12.0, inertia=[0.2, 0.25, 0.15], mounts=[*corners, *mounts])


def on_box(box: RigidBody, *modulations: dict[str, Any]) -> Scene:
    noise = {"kind": "white", "on": "z", "intensity": 1.0}
    parts = [{"kind": "modulation", "amplitude": 0.3, "frequency_hz": 5.0} | m for m in modulations]
    return Scene(structure=box, excitations=[noise, *parts])


@pytest.mark.parametrize(("of", "matrix"), [("damping", 1), ("stiffness", 2)])
@pytest.mark.parametrize(("axis", "along"), [("x", 0), ("z", 2)])
def test_a_mount_changes_the_matrices_of_its_box(
    of: str, matrix: int, axis: str, along: int
) -> None:
    """By as much as the same box whose third mount is stiffer, or better damped, along the axis."""
    box = box_of()
    (part,) = model_of(on_box(box, {"of": of, "on": "mount 3", "axis": axis})).functions
    strength = part.law.stiffness + part.law.damping
    third = box.mounts[2]
    rates = list(getattr(third, of))
    rates[along] *= 1.25
    changed = box.replace(
        mounts=[*box.mounts[:2], third.replace(**{of: rates}), box.mounts[3]]
    )  # fmt: skip
    wanted = changed.matrices[matrix] - box.matrices[matrix]
    found = 0.25 * strength * np.outer(part.direction, part.direction)
    assert found == pytest.approx(wanted, abs=1e-12 * strength)


def test_a_mount_under_the_centre_drives_its_box_as_an_oscillator() -> None:
    """The growth by Floquet of a motion along z that no other motion shares."""
    centre = Mount(at=(0.0, 0.0, 0.0), stiffness=[1e3, 1e3, 6e4], damping=[0.0, 0.0, 10.0])
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    mounts = [Mount(at=at, stiffness=[2e4] * 3, damping=[30.0] * 3) for at in corners]
    box = RigidBody(mass=12.0, inertia=[0.2, 0.25, 0.15], mounts=[*mounts, centre])
    stiffness, damping = 8e4 + 6e4, 4.0 * 30.0 + 10.0
    twice = 2.0 * math.sqrt(stiffness / 12.0) / (2.0 * math.pi)
    keys = {"of": "stiffness", "amplitude": 0.5, "frequency_hz": twice}
    alone = Scene(
        structure=Oscillator(mass=12.0, damping=damping, stiffness=stiffness),
        excitations=[Modulation(**keys | {"amplitude": 0.5 * 6.0 / 14.0})],
    )
    growth = stability(on_box(box, keys | {"on": "mount 5", "axis": "z"})).lyapunov_exponent
    known = stability(alone).lyapunov_exponent
    assert growth.value == pytest.approx(known.value, rel=1e-6) and known.value > 0.0
    other = stability(on_box(box, keys | {"on": "mount 5", "axis": "x"})).lyapunov_exponent
    assert other.value < 0.0  # the control: along x it leaves that motion alone


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "needs on = 'mount 1' or 'mount 2' or 'mount 3' or 'mount 4' and axis = 'x', 'y' or "),
        ({"on": "mount 5", "axis": "z"}, "'z', got on = 'mount 5', axis = 'z'"),
        ({"on": "mount 1"}, "got on = 'mount 1', axis = None"),
        ({"on": "mount 5", "axis": "y", "more": {"stiffness": [1.0, 0.0, 1.0], "zeta": 0.1}},
         "needs stiffness of mount 5 along y, got 0"),
        ({"of": "damping", "on": "mount 5", "axis": "z",
          "more": {"stiffness": [1.0, 0.0, 1.0], "zeta": 0.1}},
         "of damping needs damping (N s/m along x, y, z) of mount 5, got none"),
    ],
)  # fmt: skip
def test_a_mount_is_named_by_its_number(keys: dict[str, Any], sentence: str) -> None:
    more = keys.pop("more", None)
    box = box_of(*([Mount(at=(0.0, 0.0, 0.0), **more)] if more else []))
    with pytest.raises(SceneError) as error:
        on_box(box, {"of": "stiffness"} | keys)
    assert sentence in str(error.value)


def test_a_box_whose_mount_is_modulated_is_simulated() -> None:
    scene = on_box(box_of(), {"of": "stiffness", "on": "mount 2", "axis": "z"})
    assert "modulation of stiffness by a sine on mount 2 along z" in scene.effects()
    found = simulate(scene, paths=64, duration=20.0, seed=1)
    for balance in found.identities.values():
        assert_agrees(balance, 0.0)
