"""A rigid box on mounts: its matrices from first principles, its loads, and what is refused."""

import copy
import math
import tomllib

import numpy as np
import pytest

from stochvi import SceneError, load_scene
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.model import model_of
from stochvi.scenes import RigidBody
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import scene_from
from support.boxes import PLACES, box, direct_matrices, scene_with


def test_matrices_are_second_derivatives_of_the_energy_of_springs_between_moved_points() -> None:
    structure = box()
    mass, damping, stiffness = structure.matrices
    for found, expected in zip((mass, damping, stiffness), direct_matrices(structure), strict=True):
        # differences of second order of an energy of rounding 1e-16 at steps of 1e-3
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_a_ratio_of_every_mount_is_that_of_every_mode() -> None:
    for keys, ratio in (({"zeta": 0.07}, 0.07), ({"loss_factor": 0.3}, 0.15)):
        model = model_of(scene_with(box(**keys)))
        modes = model.modal
        np.testing.assert_allclose(
            modes.damping, np.diag(2.0 * ratio * np.sqrt(modes.squares)), atol=1e-9
        )


def test_ratios_that_differ_are_weighted_by_the_energy_that_each_mount_stores() -> None:
    ratios = np.linspace(0.02, 0.2, len(PLACES))
    keys = box().model_dump(by_alias=True, exclude_none=True)
    for mount, ratio in zip(keys["mount"], ratios, strict=True):
        del mount["damping"]
        mount["zeta"] = float(ratio)
    model = model_of(scene_with(RigidBody(**keys)))
    form = model.modal
    for square, shape, damping in zip(
        form.squares, form.shapes.T, np.diag(form.damping), strict=True
    ):
        stored = []
        for mount in keys["mount"]:
            moved = shape[:3] + np.cross(shape[3:], mount["at"])
            stored.append(float(np.sum(np.array(mount["stiffness"]) * moved**2)))
        assert np.sum(stored) == pytest.approx(square, rel=1e-9)
        mean = float(ratios @ stored) / square
        assert damping / (2.0 * math.sqrt(square)) == pytest.approx(mean, rel=1e-9)


def test_a_frequency_is_that_of_all_mounts_together_along_z() -> None:
    corners = [[x, y, 0.0] for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    keys = {
        "mass": 5.0, "inertia": [0.1, 0.1, 0.1],
        "mount": [{"at": at, "frequency_hz": 9.0, "zeta": 0.1} for at in corners],
    }  # fmt: skip
    structure = RigidBody(**keys)
    assert np.min(np.abs(structure.natural_frequency_hz - 9.0)) < 1e-9
    with pytest.raises(SceneError, match="mount needs one frequency_hz"):
        RigidBody(
            **keys | {"mount": [*keys["mount"][1:], {**keys["mount"][0], "frequency_hz": 8.0}]}
        )


def test_gravity_hangs_the_box_where_the_mounts_balance_weight_and_moments() -> None:
    structure = box(gravity="-z")
    scene = scene_with(structure)
    model = model_of(scene)
    rest = model.modal.shapes @ model.modal.rest
    forces = np.zeros(3)
    moments = np.zeros(3)
    for mount in structure.mounts:
        moved = rest[:3] + np.cross(rest[3:], mount.at)
        force = -np.array(mount.stiffness) * moved
        forces += force
        moments += np.cross(mount.at, force)
    weight = structure.mass * STANDARD_GRAVITY
    np.testing.assert_allclose(forces, [0.0, 0.0, weight], atol=1e-9 * weight)
    np.testing.assert_allclose(moments, 0.0, atol=1e-9 * weight)


def test_a_direction_counts_by_where_it_points_not_by_its_length() -> None:
    gaps = []
    for direction in ([0.0, 0.6, 0.8], [0.0, 3.0, 4.0]):
        pair = {"name": "a", "at": [0.1, 0.2, 0.3], "direction": direction, "clearance": 0.01}
        scene = scene_with(
            box(), pairs=[pair | {"law": {"kind": "restitution", "coefficient": 0.5}}]
        )
        gaps.append(model_of(scene).pairs[0].direction)
    np.testing.assert_allclose(*gaps, rtol=1e-15)
    motion = np.array([1.0, -2.0, 0.5, 0.01, 0.02, -0.03])
    moved = motion[:3] + np.cross(motion[3:], [0.1, 0.2, 0.3])
    assert gaps[0] @ motion == pytest.approx(moved @ [0.0, 0.6, 0.8], rel=1e-14)


# What is refused ---------------------------------------------------------------------------


def keys() -> dict:
    return tomllib.loads(shipped_scene("rigid-box").read_text("utf-8"))


def changed(place: str, value: object) -> dict:
    """The shipped box with one key changed; None takes it out."""
    found = part = copy.deepcopy(keys())
    *way, last = place.split(".")
    for word in way:
        part = part[int(word)] if isinstance(part, list) else part[word]
    if value is None:
        del part[last]
    else:
        part[int(last) if isinstance(part, list) else last] = value
    return found


@pytest.mark.parametrize(
    ("place", "value", "key"),
    [
        ("structure.inertia", [0.2, 0.25, 0.46], "structure.inertia"),
        ("structure.inertia", [0.2, -0.25, 0.15], "structure.inertia"),
        ("structure.inertia", [0.2, 0.25], "structure.inertia"),
        ("structure.inertia", [math.nan, 0.2, 0.2], "structure.inertia"),
        ("structure.inertia", [0.2, [0.2, 0.1, 0], 0.2], "structure.inertia"),
        ("structure.inertia", [[0.2, 0], [0, 0.2], [0, 0]], "structure.inertia"),
        ("structure.inertia", [[0.2, 0.1, 0], [0, 0.2, 0], [0, 0, 0.2]], "structure.inertia"),
        ("structure.inertia", [[0.2, 0.3, 0], [0.3, 0.2, 0], [0, 0, 0.2]], "structure.inertia"),
        ("structure.mount", [], "structure.mount"),
        ("structure.mount", keys()["structure"]["mount"][:1], "structure.mount"),
        ("structure.mount.1.stiffness", [1e4, 1e4], "structure.mount.1.stiffness.2"),
        ("structure.mount.1.stiffness", [1e4, 1e4, -1.0], "structure.mount.1.stiffness.2"),
        ("structure.mount.1.zeta", 0.1, "structure.mount.1"),
        ("structure.mount.1.loss_factor", None, "structure.mount.1"),
        ("structure.gravity", "down", "structure.gravity"),
        ("structure.points", {"a.b": [0, 0, 0]}, "structure.points"),
        ("impact_pair.0.direction", [0, 0, 0], "impact_pair.0.direction"),
        ("impact_pair.0.direction", None, "impact_pair.0"),
        ("impact_pair.0.at", None, "impact_pair.0"),
        ("impact_pair.0.on", "z", "impact_pair.0"),
        ("impact_pair.1.name", "corner 1", "impact_pair.1"),
        ("excitation.0.axis", None, "excitation.0"),
        ("excitation.0.axis", "rz", "excitation.0.axis"),
        ("excitation.0.on", "x", "excitation.0"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_that_names_the_key(place, value, key) -> None:
    with pytest.raises(SceneError) as caught:
        scene_from(changed(place, value))
    assert [name for name, _ in caught.value.problems] == [key], str(caught.value)


def test_the_motion_that_mounts_leave_free_is_named() -> None:
    line = [{"at": [x, 0.0, 0.0], "stiffness": [1e4, 1e4, 1e4], "zeta": 0.1} for x in (-0.2, 0.2)]
    with pytest.raises(SceneError, match=r"structure\.mount .*rx: the box rolls"):
        scene_from(changed("structure.mount", line))


@pytest.mark.parametrize("place", ["excitation.0.axis", "impact_pair.0.at"])
def test_keys_of_a_rigid_body_are_refused_elsewhere(place: str) -> None:
    found = changed("title", "an isolator")
    found["structure"] = {"kind": "isolator", "frequency_hz": 12.0, "zeta": 0.1}
    found["impact_pair"] = found["impact_pair"][:1]
    del found["excitation"][1:]
    if place.startswith("excitation"):
        found["impact_pair"] = []
    else:
        del found["excitation"][0]["axis"]
    with pytest.raises(SceneError, match="rigid-body"):
        scene_from(found)


def test_the_document_of_a_box_is_its_scene() -> None:
    scene = load_scene(shipped_scene("rigid-box"))
    again = scene_from(scene.document())
    assert again == scene and again.document() == scene.document()
