"""Notes on scenes that deserve doubt: each appears where a number passes its limit, only there."""

import math
from pathlib import Path

import numpy as np
import pytest

from stochvi import (
    ConstantLoad,
    ImpactPair,
    Isolator,
    Matrices,
    RecordedNoise,
    Restitution,
    RoadNoise,
    Scene,
    TabulatedNoise,
    explain,
    linearise,
    load_scene,
    screen,
    simulate,
)
from stochvi.model.cautions import scene_notes
from stochvi.model.model import model_of
from stochvi.scenes.datasets import shipped_scene
from support.known import oscillator

NAVMAT, TRUCK = "navmat-p-9492", "mil-std-810h-truck-vertical-5hz"


def mount(
    frequency_hz: float = 12.0, profile: str = TRUCK, gap: float = 6e-3, zeta: float = 0.1
) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=frequency_hz, zeta=zeta),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=Restitution(coefficient=0.5))],
        excitations=[TabulatedNoise(profile=profile)],
    )


def notes(scene: Scene) -> set[str]:
    return set(screen(scene).notes)


BELOW_ITS_TABLE = mount(8.0, NAVMAT, 0.6e-3)
"""The table of NAVMAT P-9492 starts at 20 Hz."""


def test_every_method_carries_the_notes_of_the_scene() -> None:
    found = notes(BELOW_ITS_TABLE)
    assert len(found) == 2
    assert found <= set(linearise(BELOW_ITS_TABLE).warnings)
    assert found <= set(simulate(BELOW_ITS_TABLE, paths=4, duration=1.0).warnings)


@pytest.mark.parametrize(("inside", "outside"), [(20.1, 19.9), (1999.0, 2001.0)])
def test_a_resonance_off_the_table_is_noted_and_gets_no_miles(
    inside: float, outside: float
) -> None:
    at_edge = {f: mount(f, NAVMAT, gap=1e-6) for f in (inside, outside)}
    (note,) = notes(at_edge[outside]) - notes(at_edge[inside])
    assert f"{outside:.4g}" in note and "20" in note and "2000" in note
    assert screen(at_edge[outside]).miles is None
    assert screen(at_edge[inside]).miles is not None


def test_the_note_on_bursts_is_true() -> None:
    """At 3 sigma the truth is tens of times Rice's rate; where no cluster is noted it is near
    it."""
    rate = simulate(BELOW_ITS_TABLE, rel_error=0.05).estimates()["stops", "collision_rate"]
    rice = screen(BELOW_ITS_TABLE).rice_rate(0.6e-3)
    assert rate.value - 4.5 * rate.standard_error > 20.0 * rice
    gap = 3.0 * screen(mount()).displacement_std
    quiet = mount(gap=gap)
    rate = simulate(quiet, rel_error=0.05).estimates()["stops", "collision_rate"]
    assert rate.value + 4.5 * rate.standard_error < 2.0 * screen(quiet).rice_rate(gap)


@pytest.mark.parametrize("load", [0.0, 2.0])
def test_stops_twenty_deviations_from_rest_are_noted(load: float) -> None:
    """A position in millimetres is a thousand times too far; a load moves the rest position."""
    sigma = screen(mount()).displacement_std
    acceleration = load * sigma * (24.0 * math.pi) ** 2

    def at(deviations: float) -> Scene:
        scene = mount(gap=deviations * sigma)
        loads = [ConstantLoad(acceleration=acceleration)] if load else []
        return scene.model_copy(update={"excitations": (*scene.excitations, *loads)})

    far = 20.0 + load
    assert notes(at(0.999 * far)) == set()
    (note,) = notes(at(1.001 * far))
    assert f"{sigma:.3g}" in note
    (thousandfold,) = notes(mount(gap=6.0))
    assert f"{6.0 / sigma:.3g}" in thousandfold


def test_damping_in_per_cent_is_noted() -> None:
    per_cent, below, above = (
        {note for note in notes(mount(zeta=zeta)) if "zeta" in note} for zeta in (10.0, 0.99, 1.01)
    )
    assert not below and len(above) == 1
    assert [f"{10.0:.3g}" in note for note in per_cent] == [True]


@pytest.mark.parametrize(
    "scene",
    [
        mount(),
        oscillator(-1.0, 1.0, 0.8),
        oscillator(None, -1.0, 1.0),
        oscillator(-1.0, 1.0, 0.8, omega=0.0),
        oscillator(),
    ],
)
def test_ordinary_scenes_draw_no_notes(scene: Scene) -> None:
    assert scene_notes(model_of(scene)) == []


def test_an_input_beyond_every_test_is_noted() -> None:
    def shaken(g_rms: float) -> set[str]:
        flat = TabulatedNoise(
            frequency_hz=[5.0, 105.0], density=[g_rms**2 / 100.0] * 2, unit="g2/Hz"
        )
        return notes(Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[flat]))

    (note,) = shaken(26.0) - shaken(24.0)
    assert "26 g rms" in note and "unit" in note
    assert not [each for each in shaken(24.0) if "g rms" in each]


def test_a_mount_on_a_road_without_a_vehicle_is_noted() -> None:
    def on_road(**keys) -> Scene:
        road = RoadNoise(road="B", speed=10.0, **keys)
        return Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[road])

    (note,) = (each for each in notes(on_road()) if "no vehicle" in each)
    assert "g rms" in note and note in explain(on_road()).notes
    assert not [each for each in notes(on_road(band_hz=[0.5, 20.0])) if "no vehicle" in each]


def two_masses(profile: str, on: str) -> Scene:
    """Masses apart: `a` at 10 Hz and `b` at 30 Hz, with stops for one of them."""
    squares = [(2.0 * math.pi * f) ** 2 for f in (10.0, 30.0)]
    return Scene(
        structure=Matrices(
            coordinates=("a", "b"), mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[0.2 * math.sqrt(squares[0]), 0.0], [0.0, 0.2 * math.sqrt(squares[1])]],
            stiffness=[[squares[0], 0.0], [0.0, squares[1]]],
        ),
        impact_pairs=[ImpactPair(on=on, lower=-1e-3, upper=1e-3, law=Restitution(coefficient=0.5))],
        excitations=[TabulatedNoise(profile=profile, on="base")],
    )  # fmt: skip


def test_modes_below_the_tables_are_noted_where_they_move_a_gap() -> None:
    (note,) = scene_notes(model_of(two_masses(NAVMAT, "a")))
    assert note.startswith("1 mode lies below the tables, which begin at 20 Hz: 10 Hz.")
    assert note in screen(two_masses(NAVMAT, "a")).notes
    assert note in explain(two_masses(NAVMAT, "a"), budget=0.1).notes
    # the other mass is not moved by that mode, and the table of a truck begins at 5 Hz
    assert not scene_notes(model_of(two_masses(NAVMAT, "b")))
    assert not scene_notes(model_of(two_masses(TRUCK, "a")))


def test_a_box_is_noted_as_one_mass_is() -> None:
    """An input in a wrong unit, stops in millimetres, damping in per cent, modes above the table;
    the box as it ships draws no note."""
    box = load_scene(shipped_scene("rigid-box"))
    assert scene_notes(model_of(box)) == []

    def noted(scene: Scene, words: str) -> bool:
        return any(words in note for note in scene_notes(model_of(scene)))

    assert noted(box.at_level(30.0), "g rms, more than any usual test")
    far = [pair.replace(clearance=None, lower=-6.0, upper=6.0) for pair in box.impact_pairs]
    assert noted(
        box.replace(impact_pairs=far), "m without stops, corner 1); positions are in metres"
    )
    mounts = [each.replace(loss_factor=6.0) for each in box.structure.mounts]
    assert noted(
        box.replace(structure=box.structure.replace(mounts=mounts)),
        "the damping ratio zeta is 3 in one mode",
    )
    low = TabulatedNoise(frequency_hz=[0.5, 2.0], density=[1e-3, 1e-3], unit="g2/Hz", axis="z")
    assert noted(box.replace(excitations=[low]), "lies outside the table (0.5 to 2 Hz)")


def test_the_length_of_a_record_and_a_missing_vehicle_are_noted_for_a_box(tmp_path: Path) -> None:
    """As for one mass; a structure as slow as a vehicle may hold the vehicle itself."""
    box = load_scene(shipped_scene("rigid-box"))
    file = tmp_path / "record.npy"
    np.save(file, np.random.default_rng(1).normal(size=8000))
    record = RecordedNoise(file=str(file), unit="g", fs=200.0, axis="z")
    found = scene_notes(model_of(box.replace(excitations=[record])))
    assert [note for note in found if note.startswith("the length of the record")]
    road = RoadNoise(road="B", speed=10.0, axis="z")

    def without_vehicle(scene: Scene) -> bool:
        return any("no vehicle" in note for note in scene_notes(model_of(scene)))

    assert without_vehicle(box.replace(excitations=[road]))
    soft = [each.replace(stiffness=[1e2, 1e2, 1e2]) for each in box.structure.mounts]
    slow = box.replace(structure=box.structure.replace(mounts=soft), excitations=[road])
    assert not without_vehicle(slow)
