"""The pictures of structures: shapes at impacts, and points instead of modal coordinates."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Isolator,
    NotApplicable,
    RecordedNoise,
    Restitution,
    Scene,
    Sine,
    SpeedRestitution,
    WhiteNoise,
    harmonic_response,
    linearise,
    replay,
)
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.methods.closed_form import exact_density
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.methods.linearisation.one_form import rms_along
from stochvi.scenes import Beam, Plate
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.scenes.structures import Oscillator
from stochvi.statistics.histories import history
from stochvi.views.density import (
    draw_history,
    plot_impact_speeds,
    plot_marginals,
    plot_plane,
    write_animation,
)
from stochvi.views.report.missions import _replay_pictures
from stochvi.views.schematic import draw_shapes, has_shape
from stochvi.views.sine import plot_sine
from support.commands import Run
from support.known import oscillator

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


# ------------------------------------------------------------------------------
# Axes and names of the picture of regimes under a sine.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(("high", "scale"), [(200.0, "log"), (11.0, "linear")])
def test_axes_are_logarithmic_where_motions_of_all_sizes_are_drawn(high: float, scale: str) -> None:
    """The largest displacement falls by (200 / 5)^2 over the first range."""
    scene = Scene(
        structure=Isolator(mass=1.0, frequency_hz=14.0, zeta=0.5),
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=0.5))],
        excitations=[Sine(on="base", amplitude=9.81, frequency_hz=14.0)],
    )
    found = harmonic_response(scene, np.geomspace(5.0, high, 30), most_impacts=1)
    ax = plot_sine(found)
    assert (ax.get_yscale(), ax.get_xscale()) == (scale, scale)
    low, top = ax.get_ylim()
    drawn = ax.lines[0].get_ydata()
    assert top > np.nanmax(drawn) and (low < np.nanmin(drawn) if scale == "log" else low == 0.0)
    assert "no impacts" in ax.figure.legends[0].get_texts()[0].get_text()
    plt.close(ax.figure)


def test_no_picture_is_drawn_where_no_motion_was_found() -> None:
    scene = Scene(
        structure=Isolator(mass=1.0, frequency_hz=14.0, zeta=0.5),
        excitations=[Sine(on="base", amplitude=9.81, frequency_hz=14.0)],
    )
    found = harmonic_response(scene, [10.0, 20.0])
    plt.close(plot_sine(found).figure)
    with pytest.raises(ValueError, match="no motion was found"):
        plot_sine(dataclasses.replace(found, branches=()))
    plt.close("all")


# ------------------------------------------------------------------------------
# The picture of a realisation: what shares a panel, and in which units.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Pictures of densities: what is drawn is what the density says.
# ------------------------------------------------------------------------------


mpl.use("Agg")


LOSSY = oscillator(-0.7, 1.0, 0.4, load=0.2)
SOFT = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    impact_pairs=[
        ImpactPair(
            lower=-1.0,
            upper=1.0,
            lower_law=Restitution(coefficient=1.0),
            upper_law=Elastic(stiffness=20.0),
        )
    ],
    excitations=[WhiteNoise(intensity=0.2)],
)


@pytest.fixture(scope="module")
def lossy():
    return fokker_planck_density(LOSSY)


def test_the_plane_holds_the_density_between_walls_with_a_slit(lossy):
    ax = plot_plane(LOSSY, lossy)
    (mesh,) = ax.collections
    shown = np.asarray(mesh.get_array())
    assert shown.shape == (241, 241) and np.all(np.isfinite(shown))
    x, v = np.linspace(-0.7, 1.0, 241), np.asarray(mesh.get_coordinates())[:, 0, 1]
    assert shown[180, 100] == pytest.approx(float(lossy.density(x[100], v[180])), rel=1e-6)
    walls = [line for line in ax.lines if len(set(line.get_xdata())) == 1]
    assert sorted({float(line.get_xdata()[0]) for line in walls}) == [-0.7, 1.0]
    assert len(walls) == 4 and all(0.5 not in line.get_ydata() for line in walls)


def test_a_stop_that_gives_way_has_no_slit_and_the_picture_goes_on_behind_it():
    found = exact_density(SOFT)
    ax = plot_plane(SOFT, found)
    assert {float(line.get_xdata()[0]) for line in ax.lines} == {-1.0}
    assert ax.get_xlim()[1] > 1.3
    ax = plot_impact_speeds(SOFT, found)
    assert [line.get_label() for line in ax.lines if "β" in line.get_label()] != []


def test_impact_speeds_have_the_slope_that_the_dotted_line_says(lossy):
    ax = plot_impact_speeds(LOSSY, lossy)
    curves = {line.get_label(): line for line in ax.lines}
    dotted = next(line for name, line in curves.items() if "β" in name)
    w, line = dotted.get_data()
    slope = np.log(line[-1] / line[0]) / np.log(w[-1] / w[0])
    assert slope == pytest.approx(1.0 - corner_exponent(0.4), rel=1e-10)
    speeds, flux = curves["upper stop"].get_data()
    slow = (speeds > 0.006) & (speeds < 0.03)
    found = np.polyfit(np.log(speeds[slow]), np.log(flux[slow]), 1)[0]
    assert found == pytest.approx(slope, abs=0.1)
    assert [line.get_linestyle() for line in ax.lines] == ["-", ":", "--", ":"]
    labels = ax.get_legend_handles_labels()[1]
    assert len(labels) == len(set(labels)) == 3 and ax.get_ylabel() == "impact rate per speed (1/m)"


def test_a_stop_alone_is_a_full_line():
    alone = oscillator(None, 1.0, 0.5)
    ax = plot_impact_speeds(alone, fokker_planck_density(alone))
    styles = {line.get_label(): line.get_linestyle() for line in ax.lines}
    assert styles["upper stop"] == "-"


def test_marginals_are_curves_of_unit_area(lossy):
    for ax in plot_marginals(LOSSY, lossy):
        x, p = ax.lines[0].get_data()
        # a singular stop lies between two points of the curve
        assert np.trapezoid(p, x) == pytest.approx(1.0, abs=0.03)
        assert ax.get_ylabel() in ("probability density (1/m)", "probability density (s/m)")
