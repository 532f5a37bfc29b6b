"""Notes on scenes that deserve doubt, and silence on those that do not."""

import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    Restitution,
    Scene,
    TabulatedNoise,
    linearise,
    screen,
    simulate,
)
from stochvi.model.cautions import scene_notes
from support.known import oscillator

LAW = Restitution(coefficient=0.5)


def mount(frequency_hz: float, profile: str, gap: float) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=frequency_hz, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=LAW)],
        excitations=[TabulatedNoise(profile=profile)],
    )


def test_a_resonance_below_the_table_is_told_by_every_answer() -> None:
    scene = mount(8.0, "navmat-p-9492", 0.6e-3)
    notes = scene_notes(scene.system())
    assert "8 Hz lies outside the table (20 to 2000 Hz)" in notes[0]
    assert "one hit can start a burst" in notes[1]
    assert screen(scene).notes == tuple(notes)
    assert screen(scene).miles is None
    assert set(notes) <= set(linearise(scene).warnings)
    assert set(notes) <= set(simulate(scene, paths=4, duration=1.0).warnings)


def test_the_burst_is_real() -> None:
    """At 3 sigma the truth is tens of times Rice's rate, which the note warns of."""
    scene = mount(8.0, "navmat-p-9492", 0.6e-3)
    rate = simulate(scene, rel_error=0.05).estimates()["stops", "collision_rate"]
    assert rate.value - 4.5 * rate.standard_error > 20.0 * screen(scene).rice_rate(0.6e-3)


def test_millimetres_taken_for_metres_are_noted() -> None:
    (note,) = scene_notes(mount(12.0, "mil-std-810h-truck-vertical-5hz", 6.0).system())
    assert "3.02e+03 standard deviations away" in note
    assert "in metres" in note


@pytest.mark.parametrize(
    "scene",
    [
        mount(12.0, "mil-std-810h-truck-vertical-5hz", 6e-3),
        oscillator(-1.0, 1.0, 0.8),
        oscillator(None, -1.0, 1.0),
        oscillator(-1.0, 1.0, 0.8, omega=0.0),
        oscillator(),
    ],
)
def test_ordinary_scenes_draw_no_notes(scene: Scene) -> None:
    assert scene_notes(scene.system()) == []
