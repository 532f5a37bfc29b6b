"""The drawing of a scene: its lengths are those of the scene, each from its own datum."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from matplotlib.axes import Axes

import stochvi
from stochvi.scenes.datasets import data_folder, shipped_scene
from stochvi.scenes.structures.rigid_body import RigidBody
from stochvi.verification.check import explain
from stochvi.views.schematic import draw_gaps, draw_problem, write_problem
from support.commands import Run

SCENES = sorted((data_folder() / "scenes").glob("*.toml"))


@pytest.fixture(autouse=True)
def _no_figures():
    yield
    plt.close("all")


def words(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts]


def box_under_gravity() -> stochvi.Scene:
    return stochvi.Scene(
        structure=stochvi.Isolator(frequency_hz=12.0, zeta=0.1, gravity=True),
        impact_pairs=[
            stochvi.ImpactPair(lower=-0.005, upper=0.004, law=stochvi.Restitution(coefficient=0.5))
        ],
        excitations=[stochvi.TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )


def rests_of(scene: stochvi.Scene) -> dict[str, float]:
    return {name: gap.position for name, gap in explain(scene).rest_of_gaps.items()}


def test_positions_count_from_the_unloaded_spring_and_clearances_from_the_equilibrium():
    scene = box_under_gravity()
    shown = words(draw_problem(scene, rests_of(scene)))
    # g / omega^2 at 12 Hz is 1.725 mm
    assert "clearance\n3.275 mm" in shown
    assert "clearance\n5.725 mm" in shown
    assert "sag\n1.725 mm" in shown
    assert any(text.startswith("lower = -5 mm") for text in shown)
    assert any(text.startswith("upper = 4 mm") for text in shown)
    assert any(text.startswith("x = -1.725 mm: static equilibrium") for text in shown)


def test_without_a_load_the_two_data_are_one():
    scene = box_under_gravity()
    scene = scene.replace(structure=scene.structure.replace(gravity=False))
    shown = words(draw_problem(scene, rests_of(scene)))
    assert {"clearance\n5 mm", "clearance\n4 mm"} <= set(shown)
    assert not any("sag" in text for text in shown)
    assert any("here also the static equilibrium" in text for text in shown)


def test_levels_are_drawn_in_the_order_of_their_positions():
    scene = box_under_gravity()
    ax = draw_problem(scene, rests_of(scene))
    heights = {text.get_text().split(" ")[0]: text.get_position()[1] for text in ax.texts
               if " = " in text.get_text()}  # fmt: skip
    places = [("lower", -5.0), ("x", 0.0), ("upper", 4.0)]
    assert [name for name, _ in sorted(heights.items(), key=lambda each: each[1])] == [
        name for name, _ in places
    ]


def test_a_preload_is_called_so():
    scene = stochvi.Scene(
        structure=stochvi.Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[stochvi.ImpactPair(upper=-0.001, law=stochvi.Restitution(coefficient=0.5))],
        excitations=[stochvi.WhiteNoise(intensity=1.0)],
    )
    assert "preload of\n1 mm" in words(draw_problem(scene, {}))


@pytest.mark.slow
def test_gaps_of_a_box_have_a_line_each():
    box = stochvi.load_scene(shipped_scene("rigid-box"))
    rests = rests_of(box)
    shown = words(draw_gaps(box.impact_pairs, rests))
    assert {"corner 1", "corner 2", "side"} <= set(shown)
    pair = box.impact_pairs[0]
    assert f"{1e3 * (pair.upper - rests[pair.name]):.4g} mm" in shown


@pytest.mark.parametrize("file", SCENES, ids=lambda file: file.stem)
def test_every_shipped_scene_can_be_drawn(file: Path, tmp_path: Path):
    scene = stochvi.load_scene(file)
    write_problem(scene, {}, tmp_path)
    assert "http" not in (tmp_path / "scene.svg").read_text().split("<defs>")[-1]
    assert (tmp_path / "gaps.svg").exists() == isinstance(scene.structure, RigidBody)


def test_explain_writes_the_drawing(stochvi: Run, tmp_path: Path):
    file = shipped_scene("isolator-bumper")
    assert stochvi("explain", str(file), "--out", str(tmp_path), "--quiet").code == 0
    assert {each.name for each in tmp_path.iterdir()} == {"scene.svg", "methods.csv"}
