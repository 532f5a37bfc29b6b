"""The pictures of structures: shapes at impacts, and points instead of modal coordinates."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    NotApplicable,
    RecordedNoise,
    Scene,
    SpeedRestitution,
    WhiteNoise,
    linearise,
    replay,
)
from stochvi.methods.linearisation.along import rms_along
from stochvi.scenes import Beam, Plate
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.statistics.histories import history
from stochvi.views.history import draw_history, write_animation
from stochvi.views.report.missions import _replay_pictures
from stochvi.views.shapes import draw_shapes, has_shape
from support.commands import Run

STEEL = {"young": 2e11, "density": 7850.0, "zeta": 0.02, "modes": 2}
REED = Beam(length=0.2, width=0.02, height=0.002, points={"tip": 1.0, "middle": 0.5}, **STEEL)
PANEL = Plate(length=0.4, width=0.3, height=0.002, points={"off": [0.3, 0.4]}, **STEEL)
SPRING = Elastic(stiffness=2e4)


def shaken(structure: Beam | Plate, *pairs: ImpactPair) -> Scene:
    noise = [WhiteNoise(on="base", density=0.01, unit="g2/Hz")]
    return Scene(structure=structure, impact_pairs=list(pairs), excitations=noise)


@pytest.mark.slow
def test_a_reed_is_drawn_where_it_touches_its_stop() -> None:
    scene = shaken(REED, ImpactPair(on="tip", upper=5e-4, law=SPRING))
    found = history(scene, duration=0.5, seed=1)
    assert has_shape(found, scene)
    ax = draw_shapes(found, scene)
    *shapes, rms, stop = ax.lines
    assert len(shapes) == min(len(found.impacts), 60) > 3
    assert stop.get_xydata().tolist() == [[200.0, 0.5]]  # mm from the clamp, mm from rest
    step = 0.5 / len(found.samples) * 2.0
    for shape in shapes:
        x, y = shape.get_data()
        assert x[[0, -1]] == pytest.approx([0.0, 200.0]) and y[0] == pytest.approx(0.0, abs=1e-9)
        # the first sample of an impact lies a step's way beyond the stop at most
        assert 0.5 <= y[-1] < 0.5 + 1e3 * step * found.impacts["speed_m_s"].max()
    tip = found.samples["tip.displacement_m"]
    assert rms.get_ydata()[-1] == pytest.approx(1e3 * np.sqrt(np.mean(tip**2)), rel=1e-9)
    plt.close("all")


def test_a_plate_is_drawn_at_its_fastest_impact() -> None:
    scene = shaken(PANEL, ImpactPair(on="off", clearance=1e-4, law=SPRING))
    found = history(scene, duration=0.2, seed=1)
    ax = draw_shapes(found, scene)
    assert [text.get_text() for text in ax.texts] == ["off, at stops"]
    assert f"{found.impacts['speed_m_s'].max():.3g} m/s" in ax.get_title()
    plt.close("all")


def test_what_has_no_shape_has_no_picture_of_it() -> None:
    far = shaken(REED, ImpactPair(on="tip", upper=1.0, law=SPRING))
    assert not has_shape(history(far, duration=0.1, seed=1), far)
    blade = load_scene(shipped_scene("blade"))
    assert not has_shape(history(blade, duration=0.1, seed=1), blade)


@pytest.mark.slow
def test_points_are_drawn_and_modal_coordinates_are_not(tmp_path) -> None:
    """A pair of weights has a panel of its own; so it has a row of an animation."""
    scene = shaken(
        REED, ImpactPair(name="tip", on="tip", upper=1e-3, law=SPRING),
        ImpactPair(name="mean", weights={"tip": 0.5, "middle": 0.5}, clearance=5e-4, law=SPRING),
        ImpactPair(name="bend", between=["tip", "middle"], upper=1e-3, law=SPRING),
    )  # fmt: skip
    found = history(scene, duration=0.1, seed=1)
    figure = draw_history(found, scene).get_figure()
    assert figure is not None
    words = [ax.get_ylabel().partition("\n")[0] for ax in figure.axes]
    assert words == [
        "displacement of tip", "displacement of middle", "gap of mean", "tip less middle",
        "absolute",
    ]  # fmt: skip
    write_animation(found, scene, tmp_path / "a.gif")
    assert (tmp_path / "a.gif").stat().st_size > 10_000
    plt.close("all")


@pytest.mark.slow
def test_one_mode_is_drawn_by_its_gap(tmp_path) -> None:
    one = REED.replace(modes=1)
    scene = shaken(one, ImpactPair(between=["tip", "middle"], upper=3e-4, law=SPRING))
    found = history(scene, duration=0.2, seed=1, rate=2e5)
    figure = draw_history(found, scene).get_figure()
    assert figure is not None
    first, _ = figure.axes
    assert first.get_ylabel().startswith("displacement of tip")
    assert "impacts, larger = faster" in first.get_legend_handles_labels()[1]
    shape = draw_shapes(found, scene).lines[0].get_ydata()
    assert shape[50] / shape[-1] == pytest.approx(one.table.shapes["middle"][0], rel=1e-9)
    assert shape[-1] - shape[50] == pytest.approx(0.3, abs=0.02)
    write_animation(found, scene, tmp_path / "a.gif")
    plt.close("all")


def test_a_map_is_the_answer_at_all_places() -> None:
    stop = ImpactPair(on="tip", upper=5e-4, law=SPRING)
    for scene in (
        shaken(REED, stop),
        shaken(REED.replace(modes=1), stop),
        shaken(PANEL, stop.replace(on="off", upper=5e-5)),
    ):
        table, point = rms_along(scene), scene.impact_pairs[0].on
        with_stops = linearise(scene).coordinates[point].displacement_std
        without = exact_rms(scene, point)
        at = {"tip": -1, "off": 6 * 21 + 8}[point]  # 0.3 and 0.4 of the sides are places of the map
        assert table["rms_with_stops_m"].iloc[at] == pytest.approx(with_stops.value, rel=1e-9)
        assert table["rms_without_stops_m"].iloc[at] == pytest.approx(without, rel=1e-9)
        assert with_stops.value < 0.97 * without
        # nothing moves at supports
        assert abs(table["rms_without_stops_m"].iloc[0]) < 1e-12


def exact_rms(scene: Scene, point: str) -> float:
    """Rms without stops, from modes that white noise shakes together (Crandall and Mark)."""
    table, level = scene.structure.table, 0.01 * 9.80665**2 / 2.0
    total = 0.0
    for a, first in enumerate(table.omega):
        for b, second in enumerate(table.omega):
            one, two = 2.0 * table.zeta[a] * first, 2.0 * table.zeta[b] * second
            below = (first**2 - second**2) ** 2 + (one + two) * (one * second**2 + two * first**2)
            gain = table.participation[a] * table.participation[b] * level * (one + two)
            total += table.shapes[point][a] * table.shapes[point][b] * gain / below
    return float(np.sqrt(total))


def test_a_map_without_an_answer_for_the_stops_has_that_without_stops() -> None:
    law = SpeedRestitution(coefficient=lambda speed: 0.5 / (1.0 + speed))
    scene = shaken(REED, ImpactPair(on="tip", upper=5e-4, law=law))
    assert list(rms_along(scene)) == ["distance_m", "rms_without_stops_m"]
    with pytest.raises(NotApplicable, match="got 'modes'"):
        rms_along(load_scene(shipped_scene("blade")))


def test_commands_write_the_map(stochvi: Run, tmp_path: Path) -> None:
    found = stochvi("linearise", str(shipped_scene("beam")), "--out", str(tmp_path), "--quiet")
    assert found.code == 0
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert len(pd.read_csv(tmp_path / "map.csv")) == 101


@pytest.mark.slow
@pytest.mark.parametrize("modes", [1, 2])
def test_the_shape_of_a_replay_has_the_rms_of_its_record(modes: int, tmp_path: Path) -> None:
    time = np.arange(2000) / 2000.0
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([time, 60.0 * np.sin(2.2e2 * time)]), delimiter=","
    )
    record = RecordedNoise(file=str(tmp_path / "a.csv"), unit="m/s2", on="base")
    stop = ImpactPair(on="tip", upper=5e-4, law=SPRING)
    scene = Scene(structure=REED.replace(modes=modes), impact_pairs=[stop], excitations=[record])
    found = replay(scene)
    *_, rms, _ = draw_shapes(found.only, scene).lines
    tip = found.histories.displacement["tip"]
    assert rms.get_ydata()[-1] == pytest.approx(1e3 * np.sqrt(np.mean(tip**2)), rel=1e-9)
    captions = [each.caption for each in _replay_pictures(found, scene)]
    assert "shape at impacts" in captions[0] and len(captions) == 3
    plt.close("all")
