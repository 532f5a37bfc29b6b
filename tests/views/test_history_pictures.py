"""The picture of a realisation: what shares a panel, and in which units."""

from __future__ import annotations

import matplotlib.pyplot as plt
import pytest

from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.statistics.histories import history
from stochvi.views.history import draw_history


def panels(name: str) -> dict[str, list[str]]:
    """The curves of each panel of the picture of a scene that ships, by the words at its axis."""
    scene = load_scene(shipped_scene(name))
    figure = draw_history(history(scene, duration=1.0, seed=1), scene).get_figure()
    assert figure is not None
    found = {
        ax.get_ylabel().replace("\n", " "): [
            line for line in ax.get_legend_handles_labels()[1] if not line.startswith("impacts")
        ]
        for ax in figure.axes
    }
    plt.close("all")
    return found


def test_rotations_are_angles_and_share_no_panel_with_displacements() -> None:
    """Their angles were drawn in mm, and their accelerations in g."""
    found = panels("rigid-box")
    assert found["displacement (mm)"] == ["x", "y", "z"]
    assert found["rotation (mrad)"] == ["rx", "ry", "rz"]
    assert found["angular acceleration (rad/s²)"] == ["rx", "ry", "rz"]
    assert "rx" not in found["absolute acceleration (g)"]
    assert [words for words in found if words.startswith("gap of ")] == [
        "gap of corner 1 (mm)", "gap of corner 2 (mm)", "gap of side (mm)",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["isolator-truck", "oscillator-lossy"])
def test_a_mass_between_stops_has_a_panel_of_its_own(name: str) -> None:
    assert next(iter(panels(name))).startswith("displacement of x (")


def test_the_table_of_a_box_states_the_units_of_its_rotations() -> None:
    meanings = history(load_scene(shipped_scene("rigid-box")), duration=1.0, seed=1).meanings
    assert meanings["displacement_m"].endswith("; rx, ry, rz in rad")
    assert meanings["acceleration_m_s2"].endswith("; rx, ry, rz in rad/s^2")
    one = history(load_scene(shipped_scene("isolator-truck")), duration=1.0, seed=1).meanings
    assert "rad" not in one["displacement_m"]
