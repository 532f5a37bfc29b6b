"""The numbers that a scene is lowered to, against the physics that they stand for."""

from __future__ import annotations

import importlib
import inspect
import math
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import stochvi
from stochvi import (
    ConstantLoad,
    Elastic,
    FilteredNoise,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    RecordedNoise,
    Restitution,
    RoadNoise,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    exact,
    explain,
    linearise,
    load_scene,
    screen,
    simulate,
)
from stochvi.isolators import Spread, clearance_curve
from stochvi.mathematics.units import _checks_of
from stochvi.model.coverage import scene_notes
from stochvi.model.gap import OscillatorArrays
from stochvi.model.modal import EquivalentLinear, linear_law
from stochvi.model.model import Model, model_of
from stochvi.model.scales import PairScale, scales_of, scales_of_free_motion
from stochvi.results.deadline import stood_still
from stochvi.results.errors import SceneError, StochviError
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.records import read_record
from stochvi.scenes.structures import Matrices
from support.calls import SECONDS, Caller, callables
from support.known import ELASTIC_STOPS, ElasticStops, oscillator, values
from support.mutations import BARE
from support.refusals import refusals

G = 9.80665
WALL = Restitution(coefficient=0.8)


def isolator(mass: float, *excitations) -> Model:
    structure = Isolator(mass=mass, frequency_hz=5.0, zeta=0.1)
    pair = ImpactPair(lower=-2e-3, upper=3e-3, law=Elastic(stiffness=1e4))
    return model_of(Scene(structure=structure, impact_pairs=[pair], excitations=list(excitations)))


def test_an_oscillator_is_described_per_unit_mass() -> None:
    scene = Scene(
        structure=Oscillator(mass=2.0, damping=0.6, stiffness=18.0),
        impact_pairs=[ImpactPair(lower=-1.0, upper=0.5, law=WALL)],
        excitations=[WhiteNoise(intensity=0.4), ConstantLoad(force=-3.0)],
    )
    model = model_of(scene)
    assert (model.omega, model.damping_rate) == pytest.approx((3.0, 0.3))
    assert (model.intensity, model.load) == pytest.approx((0.4 / 4.0, -1.5))
    assert model.temperature == pytest.approx(0.4 / (2.0 * 0.6))
    assert [(stop.side, stop.position) for stop in model.stops] == [(-1, -1.0), (1, 0.5)]
    one_sided = scene.model_copy(update={"impact_pairs": (ImpactPair(upper=0.5, law=WALL),)})
    assert [model_of(each).pairs[0].play for each in (scene, one_sided)] == [1.5, None]


@pytest.mark.parametrize("mass", [1.0, 2.5])
def test_a_base_shakes_every_mass_alike_and_a_force_does_not(mass: float) -> None:
    table = TabulatedNoise(frequency_hz=[1.0, 10.0], density=[0.02, 0.02], unit="g2/Hz", on="base")
    noise = FilteredNoise(
        density=2.0, unit="(m/s2)2/Hz", frequency_hz=8.0, zeta=0.2, on="base"
    )  # fmt: skip
    white = WhiteNoise(density=0.4, unit="(m/s2)2/Hz", on="base")
    on_base = isolator(mass, table, noise, white, ConstantLoad(acceleration=2.0))
    assert on_base.acceleration_tables[0].density == pytest.approx(0.02 * G**2)
    assert on_base.filters[0].intensity == pytest.approx(1.0)
    assert on_base.intensity == pytest.approx(0.2)
    # what is left behind when the base accelerates upwards moves down
    assert on_base.load == pytest.approx(-2.0)
    forced = isolator(mass, WhiteNoise(intensity=0.4, on="x"), ConstantLoad(force=2.0, on="x"))
    assert forced.intensity == pytest.approx(0.4 / mass**2)
    assert forced.load == pytest.approx(2.0 / mass)
    assert forced.noise_on_mass and not on_base.noise_on_mass
    stop = forced.upper
    assert stop is not None
    assert float(stop.law.force_at(1e-4)) == pytest.approx(1.0 / mass)


def test_a_lower_stop_is_an_upper_one_seen_from_the_other_side() -> None:
    model = isolator(1.0, WhiteNoise(intensity=1.0, on="base"))
    lower, upper = model.lower, model.upper
    assert lower is not None and upper is not None
    depth = np.array([-1e-4, 0.0, 2e-4])
    assert lower.deflection(-2e-3 - depth) == pytest.approx(depth)
    assert upper.deflection(3e-3 + depth) == pytest.approx(depth)
    assert (lower.distance, upper.distance) == (2e-3, 3e-3)


def test_a_pair_between_two_masses_has_their_reduced_mass() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.diag([2.0, 0.5]), damping=np.diag([0.4, 0.1]),
            stiffness=np.diag([3.0, 1.0]),
        ),
        impact_pairs=[
            ImpactPair(name="gap", between=["b", "a"], upper=1.0, law=WALL),
            ImpactPair(name="stop", on="a", lower=-1.0, law=WALL),
        ],
        excitations=[WhiteNoise(on="a", intensity=0.8), WhiteNoise(on="b", intensity=0.2)],
    )  # fmt: skip
    model = model_of(scene)
    gap, stop = model.pairs
    assert gap.mass == pytest.approx(1.0 / (1.0 / 2.0 + 1.0 / 0.5)) and stop.mass == 2.0
    assert gap.direction.tolist() == [-1.0, 1.0] and gap.relative and not stop.relative
    # an impulse P along the gap changes its speed by P / mass
    change = np.linalg.solve(model.mass, gap.direction)
    assert gap.direction @ change == pytest.approx(1.0 / gap.mass)
    assert model.temperature == pytest.approx(1.0)
    assert not model.elastic


def test_noise_that_does_not_match_the_damping_has_no_temperature() -> None:
    structure = Matrices(
        coordinates=["a", "b"], mass=np.eye(2), damping=np.diag([0.4, 0.1]), stiffness=np.eye(2)
    )
    alike = [WhiteNoise(on=name, intensity=0.4) for name in "ab"]
    assert model_of(Scene(structure=structure, excitations=alike)).temperature is None


def test_gravity_is_an_acceleration_of_the_base() -> None:
    mount = Isolator(frequency_hz=5.0, zeta=0.1, gravity=True)
    model = model_of(Scene(structure=mount, excitations=[WhiteNoise(intensity=1.0, on="base")]))
    assert model.load == pytest.approx(-G)
    assert model.rest == pytest.approx(-G / (10.0 * math.pi) ** 2)


# ------------------------------------------------------------------------------
# Modal coordinates and the linear law, against the same structure in its own coordinates.
# ------------------------------------------------------------------------------


MASS = np.array([[2.0, 0.3], [0.3, 0.7]])
DAMPING = np.array([[0.5, -0.2], [-0.2, 0.4]])
STIFFNESS = np.array([[9.0, -3.0], [-3.0, 4.0]])
GAP = np.array([-1.0, 1.0])


def two_masses(*excitations) -> Scene:
    return Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=MASS, damping=DAMPING, stiffness=STIFFNESS
        ),
        impact_pairs=[
            ImpactPair(between=["b", "a"], upper=0.5, law=Restitution(coefficient=0.5))
        ],
        excitations=list(excitations),
    )  # fmt: skip


def gain(omega: float, stiffness=STIFFNESS, damping=DAMPING) -> np.ndarray:
    return np.linalg.inv(stiffness - omega**2 * MASS + 1j * omega * damping)


def test_modes_give_back_the_matrices() -> None:
    modes = model_of(two_masses(WhiteNoise(on="a", intensity=0.3))).modal
    inverse = np.linalg.inv(modes.shapes)
    assert inverse.T @ inverse == pytest.approx(MASS)
    assert inverse.T @ np.diag(modes.squares) @ inverse == pytest.approx(STIFFNESS)
    assert inverse.T @ modes.damping @ inverse == pytest.approx(DAMPING)
    assert inverse.T @ modes.white @ inverse == pytest.approx(np.diag([0.3, 0.0]))
    assert modes.gaps @ inverse == pytest.approx(GAP[None, :])
    assert modes.fastest == pytest.approx(math.sqrt(max(np.linalg.eigvals(
        np.linalg.solve(MASS, STIFFNESS)
    ).real)))  # fmt: skip


@pytest.mark.parametrize("held", [False, True], ids=["free", "spring and damper on the gap"])
def test_white_noise_leaves_the_law_of_lyapunovs_equation(held: bool) -> None:
    substitutes = [EquivalentLinear(spring=2.5, centre=0.4, damper=0.3)] if held else []
    stiffness = STIFFNESS + (2.5 * np.outer(GAP, GAP) if held else 0.0)
    damping = DAMPING + (0.3 * np.outer(GAP, GAP) if held else 0.0)
    scene = two_masses(WhiteNoise(on="a", intensity=0.3), ConstantLoad(on="b", force=0.6))
    modes = model_of(scene).modal
    law = linear_law(modes, substitutes)
    assert law is not None
    inverse = np.linalg.inv(MASS)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    noise = np.zeros((4, 4))
    noise[2:, 2:] = inverse @ np.diag([0.3, 0.0]) @ inverse
    expected = solve_continuous_lyapunov(a, -noise)
    for first in (0, 2):
        found = modes.shapes @ law.covariance[first : first + 2, first : first + 2] @ modes.shapes.T
        assert found == pytest.approx(expected[first : first + 2, first : first + 2])
    push = np.array([0.0, 0.6]) + (2.5 * 0.4 * GAP if held else 0.0)
    mean = modes.shapes @ (modes.rest + law.mean)
    assert mean == pytest.approx(np.linalg.solve(stiffness, push))
    rates = np.linalg.eigvals(a).real
    assert law.slowest == pytest.approx(1.0 / (2.0 * np.min(-rates)))


def test_filtered_noise_and_a_sine_are_integrals_of_the_gain() -> None:
    noise = FilteredNoise(on="b", intensity=0.2, frequency_hz=0.3, zeta=0.2)
    sine = Sine(on="a", amplitude=0.7, frequency_hz=0.25)
    modes = model_of(two_masses(noise, sine)).modal
    law = linear_law(modes)
    assert law is not None
    row = GAP @ modes.shapes
    w = np.linspace(-40.0, 40.0, 2001)
    wf = 2.0 * math.pi * 0.3
    shape = wf**2 / (wf**2 - w**2 + 2j * 0.2 * wf * w)
    moved = np.array([gain(one) @ np.array([0.0, 1.0]) @ GAP for one in w])
    density = 0.2 * np.abs(shape * moved) ** 2  # smooth, and falls as w^-8
    expected = np.trapezoid(density, w) / (2.0 * math.pi)
    turn = 2.0 * math.pi * 0.25
    wave = 0.7 * abs(gain(turn) @ np.array([1.0, 0.0]) @ GAP)
    assert law.variances(row, 0) == pytest.approx(expected + wave**2 / 2.0, rel=1e-6)
    assert law.variances(np.zeros(2), 0) == 0.0


def test_what_nothing_damps_has_no_law() -> None:
    scene = two_masses(WhiteNoise(on="a", intensity=0.3))
    loose = scene.model_copy(
        update={"structure": scene.structure.model_copy(update={"damping": ((0, 0), (0, 0))})}
    )
    assert linear_law(model_of(loose).modal) is None


# ------------------------------------------------------------------------------
# Scales of a model: exact where the Gibbs distribution is, and nothing where no law is found.
# ------------------------------------------------------------------------------


def scale(scene: Scene) -> PairScale:
    model = model_of(scene)
    found = scales_of(model, model.modal)
    assert found is not None
    (pair,) = found[1]
    return pair


@pytest.mark.parametrize("row", ELASTIC_STOPS)
def test_between_elastic_stops_the_scales_are_those_of_the_exact_law(row: ElasticStops) -> None:
    """The repetition ends within a few digits: 40 times halves what is left of each step."""
    scene = oscillator(row.lower, row.upper)
    found, truth = scale(scene), values(exact(scene))
    assert found.speed == pytest.approx(truth["velocity_std"], rel=1e-3)
    assert found.deviation == pytest.approx(truth["displacement_std"], rel=1e-3)


def test_far_stops_leave_the_scales_of_the_motion_without_them() -> None:
    """With a load, which moves the mean; nearer stops change the scales."""

    def both(distance: float) -> tuple[PairScale, PairScale]:
        near = oscillator(0.7 - distance, 0.7 + distance)
        load = ConstantLoad(force=0.7)
        model = model_of(near.replace(excitations=(*near.excitations, load)))
        (one, other) = (scales(model, model.modal) for scales in (scales_of, scales_of_free_motion))
        assert one is not None and other is not None
        return one[1][0], other[1][0]

    far, free = both(7.0)
    assert far == pytest.approx(free, rel=1e-6)
    with pytest.raises(AssertionError):
        assert both(2.0)[0] == pytest.approx(free, rel=1e-6)


def test_lossy_stops_slow_the_mass_as_the_energy_balance_says() -> None:
    """S0 / 2 = b E v^2 + (1 - R^2) / 2 F2, with F2 of Rayleigh speeds at either stop."""
    found = scale(oscillator(-1.0, 1.0, 0.6))
    x = np.linspace(-1.0, 1.0, 20_001)
    density = np.exp(found.slope * x - found.curvature * x * x / 2.0)
    at_stops = (density[0] + density[-1]) / np.trapezoid(density, x)
    square_rate = at_stops * 2.0 * found.speed**3 / math.sqrt(2.0 * math.pi)
    power = 0.1 * found.speed**2 + (1.0 - 0.6**2) / 2.0 * square_rate
    assert power == pytest.approx(0.1, rel=1e-3)


def test_only_a_mass_that_lies_on_a_stop_is_pressed() -> None:
    assert scale(oscillator(-1.0, 1.0)).pressing == 0.0
    # far from rest the spring presses with omega^2 times the distance
    assert scale(oscillator(None, -8.0)).pressing == pytest.approx(8.0, rel=1e-6)
    assert scale(oscillator(8.0, None)).pressing == pytest.approx(8.0, rel=1e-6)


def test_a_gap_that_nothing_shakes_is_refused() -> None:
    scene = Scene(
        structure=Matrices(
            coordinates=["a", "b"], mass=np.eye(2), damping=0.1 * np.eye(2), stiffness=np.eye(2)
        ),
        impact_pairs=[ImpactPair(on="b", upper=1.0, law=Restitution(coefficient=0.5))],
        excitations=[WhiteNoise(on="a", intensity=0.2)],
    )
    model = model_of(scene)
    for scales in (scales_of, scales_of_free_motion):
        with pytest.raises(NotApplicable, match="at rest"):
            scales(model, model.modal)


# ------------------------------------------------------------------------------
# Notes on scenes that deserve doubt: each appears where a number passes its limit, only there.
# ------------------------------------------------------------------------------


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
    assert f"({1e3 * sigma:.3g} mm each)" in note
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


def two_masses_of_notes(profile: str, on: str) -> Scene:
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
    (note,) = scene_notes(model_of(two_masses_of_notes(NAVMAT, "a")))
    assert note.startswith("1 mode lies below the tables, which begin at 20 Hz: 10 Hz.")
    assert note in screen(two_masses_of_notes(NAVMAT, "a")).notes
    assert note in explain(two_masses_of_notes(NAVMAT, "a"), budget=0.1).notes
    # the other mass is not moved by that mode, and the table of a truck begins at 5 Hz
    assert not scene_notes(model_of(two_masses_of_notes(NAVMAT, "b")))
    assert not scene_notes(model_of(two_masses_of_notes(TRUCK, "a")))


def test_a_box_is_noted_as_one_mass_is() -> None:
    """An input in a wrong unit, stops in millimetres, damping in per cent, modes above the table;
    the box as it ships draws no note."""
    box = load_scene(shipped_scene("rigid-box"))
    assert scene_notes(model_of(box)) == []

    def noted(scene: Scene, words: str) -> bool:
        return any(words in note for note in scene_notes(model_of(scene)))

    assert noted(box.at_level(30.0), "g rms, more than any usual test")
    far = [pair.replace(clearance=None, lower=-6.0, upper=6.0) for pair in box.impact_pairs]
    (note,) = scene_notes(model_of(box.replace(impact_pairs=far)))
    gaps = screen(box).impact_pairs
    nearest = max(gaps, key=lambda name: gaps[name].displacement_std)
    rms = gaps[nearest].displacement_std
    assert note.startswith(f"the stop of {nearest} is ")
    assert f" rms motions ({1e3 * rms:.3g} mm each) away, those of 2 others farther: did" in note
    assert note.endswith("did you write mm for m?")
    two = [far[0], *box.impact_pairs[1:]]
    (note,) = scene_notes(model_of(box.replace(impact_pairs=two)))
    assert note.startswith("the stop of corner 1 is ") and "others" not in note
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
    assert [note for note in found if note.startswith("the record's length")]
    road = RoadNoise(road="B", speed=10.0, axis="z")

    def without_vehicle(scene: Scene) -> bool:
        return any("no vehicle" in note for note in scene_notes(model_of(scene)))

    assert without_vehicle(box.replace(excitations=[road]))
    soft = [each.replace(stiffness=[1e2, 1e2, 1e2]) for each in box.structure.mounts]
    slow = box.replace(structure=box.structure.replace(mounts=soft), excitations=[road])
    assert not without_vehicle(slow)


# ------------------------------------------------------------------------------
# Arrays of oscillators: the same numbers as the model of a scene, and refusals by name.
# ------------------------------------------------------------------------------


PLAIN = {"omega": 1.0, "damping_rate": 0.1, "intensity": 0.2}


def test_a_scene_becomes_arrays_of_one_oscillator_per_unit_mass() -> None:
    scene = Scene(
        structure=Oscillator(mass=2.0, damping=0.4, stiffness=18.0),
        impact_pairs=[ImpactPair(upper=0.5, law=Restitution(coefficient=0.7))],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    found = OscillatorArrays.of(model_of(scene))
    assert found.omega[0] == pytest.approx(3.0)
    assert found.damping_rate[0] == pytest.approx(0.2)
    assert (found.lower[0], found.upper[0]) == (-math.inf, 0.5)
    assert found.restitutions.tolist() == [[1.0], [0.7]]
    assert not found.elastic[0]


def test_the_potential_rises_by_the_energy_of_a_climb() -> None:
    found = OscillatorArrays.broadcast(
        **PLAIN | {"omega": [2.0, 2.0, 0.0]}, load=[1.0, 20.0, 3.0], lower=-1.0, upper=2.0
    )
    lowest = found.lowest()
    np.testing.assert_allclose(lowest, [0.25, 2.0, 2.0])
    energy = np.array([0.3, 5.0, 0.7])
    x = lowest - found.climb(energy)

    def potential(x: np.ndarray) -> np.ndarray:
        return np.asarray(found.omega**2 * x**2 / 2.0 - found.load * x)

    np.testing.assert_allclose(potential(x) - potential(lowest), energy, rtol=1e-12)


def test_masks_slices_and_indices_take_the_same_oscillators() -> None:
    found = OscillatorArrays.broadcast(**PLAIN | {"omega": [[1.0, 2.0], [3.0, 4.0]]}).flat()
    assert found.omega.tolist() == [1.0, 2.0, 3.0, 4.0]
    by_mask = found.take(np.array([False, True, True, False]))
    assert by_mask.omega.tolist() == found.take(slice(1, 3)).omega.tolist() == [2.0, 3.0]
    assert found.take(np.array([3, 0])).omega.tolist() == [4.0, 1.0]


test_numbers_out_of_range_are_named = refusals(
    lambda changes: OscillatorArrays.broadcast(**PLAIN | changes).check(),
    ({"omega": [1.0, math.nan]}, "omega must be numbers, got nan"),
    ({"load": math.inf}, "load must be finite, got inf"),
    ({"intensity": -0.1}, "intensity must be at least 0, got -0.1"),
    ({"restitution_upper": 1.2}, "restitution_upper must be in [0, 1], got 1.2"),
    ({"lower": 1.0, "upper": 1.0}, "lower must be below upper, got 1 and 1 at index 0"),
    error=ValueError,
)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"intensity": 0.0}, "intensity"),
        ({"damping_rate": 0.0}, "damping_rate"),
        ({"omega": 0.0, "upper": 1.0, "load": -1.0}, "omega"),
    ],
)
def test_conditions_of_a_stationary_state(changes: dict[str, float], word: str) -> None:
    (sentence,) = OscillatorArrays.broadcast(**PLAIN | changes).unmet()
    assert sentence.startswith(word)


def test_a_load_towards_a_stop_holds_a_mass_without_spring() -> None:
    pressed = OscillatorArrays.broadcast(**PLAIN | {"omega": 0.0}, upper=1.0, load=1.0)
    assert pressed.unmet() == []


# ------------------------------------------------------------------------------
# Public calculations refuse what they cannot take in a sentence, before they begin.
# ------------------------------------------------------------------------------


ROOMS = (
    "", ".statistics", ".isolators", ".absorbers", ".verification", ".testing", ".methods.periodic",
    ".methods.closed_form", ".methods.linearisation", ".methods.fokker_planck",
    ".methods.monte_carlo",
)  # fmt: skip


def functions() -> Iterator[Callable[..., Any]]:
    """Every public function."""
    for room in ROOMS:
        package = importlib.import_module(f"stochvi{room}")
        for name in package.__all__:
            if inspect.isfunction(each := getattr(package, name)):
                yield each


def of_a_scene() -> list[Callable[..., Any]]:
    """The public functions whose first argument is a scene."""
    found = {
        each
        for each in functions()
        for first in list(inspect.signature(each).parameters.values())[:1]
        if first.annotation == "Scene"
    }
    return sorted(found, key=lambda each: each.__name__)


@pytest.mark.parametrize("function", of_a_scene(), ids=lambda each: each.__name__)
@pytest.mark.parametrize("wrong", ["truck.toml", None, {"structure": {}}, 3])
def test_what_is_no_scene_is_refused(function: Callable[..., Any], wrong: Any) -> None:
    parameters = list(inspect.signature(function).parameters.values())
    needed = [each for each in parameters[1:] if each.default is inspect.Parameter.empty]
    by_place = [0.0 for each in needed if each.kind is each.POSITIONAL_OR_KEYWORD]
    by_name = {each.name: 1 for each in needed if each.kind is each.KEYWORD_ONLY}
    with pytest.raises(SceneError, match=r"must be a Scene, as load_scene\("):
        function(wrong, *by_place, **by_name)


test_what_is_no_number_is_refused = refusals(
    lambda arguments: stochvi.simulate(oscillator(-1.0, 1.0, 0.8), **arguments),
    ({"budget": -1.0}, "budget must be a positive number of seconds, got -1.0"),
    ({"budget": float("nan")}, "budget must be a positive number of seconds, got nan"),
    ({"budget": "60"}, "budget must be a number, got '60'"),
    ({"budget": 10**400}, "budget must be a number, got 10000"),
    ({"seed": 10**29}, r"seed must be a whole number below 2\^63, got 10000"),
    ({"paths": 2.5}, "paths must be a whole number, got 2.5"),
    ({"rel_error": [0.1]}, r"rel_error must be a number, got \[0.1\]"),
    ({"threads": "x" * 500}, "threads must be a whole number, got 'xxx.*xxx...$"),
    ({"statistics": 3.0}, "statistics must be a table of names and values of Statistic, got 3"),
    error=ValueError,
    pattern=True,
)


def test_a_column_beyond_all_numbers_is_refused() -> None:
    with pytest.raises(ValueError, match="column must be a number, got 1000"):
        read_record("drive.csv", column=10**400)


@pytest.mark.parametrize("function", [stochvi.production, stochvi.mean_over_units])
def test_spreads_are_a_table(function: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match="spreads must be a table of names and values of Spread"):
        function(oscillator(-1.0, 1.0, 0.8), 0.05)


CHECKED_BY_ITSELF = {
    "Any", "Branch", "Mapping[str, Any]", "Mapping[str, Scene] | Iterable[str]",
    "Mapping[str, Sequence[float]] | DataFrame", "Measurement", "Random", "Result",
    "Scene | str | Path", "Sequence[str | Path]", "float | Ends | None", "str | Path | Frame",
}  # fmt: skip
"""Annotations of arguments that are no plain ones: the function itself looks at what it got."""


@pytest.mark.parametrize("function", [*functions()], ids=lambda each: each.__name__)
def test_every_argument_is_checked_before_a_calculation(function: Callable[..., Any]) -> None:
    """The hunt below asks for one of thousands of wrong arguments at a time, on scenes that many a
    function refuses first, and takes any answer for a right one: it does not meet them all."""
    within = inspect.unwrap(function)
    for name, each in inspect.signature(within).parameters.items():
        kind = str(each.annotation)
        if name in _checks_of(within) or kind.startswith("Unpack[") or kind in CHECKED_BY_ITSELF:
            continue
        assert function.__name__.startswith("unmet"), f"{name}: {kind} has no check"


def of_a_truck(_: Scene, **arguments: Any) -> Any:
    truck = load_scene(shipped_scene("isolator-truck"))
    return stochvi.production(truck, **{"probability": 0.1} | arguments)


SPREAD = {"frequency": Spread(std=0.03)}

test_arguments_of_the_wrong_kind_are_refused = refusals(
    lambda function, arguments: function(oscillator(-1.0, 1.0, 0.8), **arguments),
    *(
        (stochvi.transient, {"times": [1.0], "start": start}, "start must be ")
        for start in (10**400, {}, 1j, object(), np.zeros(0), [1j, 0.0], (0.1, "a"), "abc")
    ),
    *(
        (stochvi.damage, {"equipment": equipment}, "equipment must be ")
        for equipment in (10**400, "abc", 1j, np.zeros(0), None)
    ),
    *(
        (stochvi.impacts, {name: wrong}, f"{name} must be True or False, got")
        for name in ("slow_impacts", "first_hits")
        for wrong in ("abc", math.nan, -1, 1e300, [], np.zeros(0))
    ),
    (stochvi.damage, {"way": np.zeros(0)}, "way must be a text, got an array"),
    (stochvi.reliability, {"mission": 1.0, "way": np.zeros(0)}, "way must be a text, got an"),
    (stochvi.history, {"duration": 1.0, "rate": 1e-300}, "rate must be at least 1 Hz, 1 / dur"),
    (stochvi.history, {"duration": 1e-300}, "duration must be above .* s, a step here, got"),
    (stochvi.first_passage, {"upper": 0.5, "rtol": True}, "rtol must be a number, got True"),
    (stochvi.first_passage, {"upper": 0.5, "rtol": 1e300}, r"rtol must be below 1, got 1e\+300"),
    (clearance_curve, {"clearances": []}, r"clearances must be positive, got \[\] m"),
    (of_a_truck, {"spreads": {}}, "spreads must hold what varies between units, as .* got none"),
    (of_a_truck, {"spreads": None}, "spreads must hold what varies between units"),
    (of_a_truck, {"spreads": SPREAD, "pair": "abc"}, "pair must name impact pairs .*, got abc"),
    error=ValueError,
    pattern=True,
)  # fmt: skip


def test_a_very_long_budget_is_none() -> None:
    scene = oscillator(-1.0, 1.0, 0.8)
    found = stochvi.simulate(scene, paths=2, duration=1.0, budget=10**29, threads=1)
    same = stochvi.simulate(scene, paths=np.int64(2), duration=np.float32(1.0), threads=1)
    assert found.coordinates == same.coordinates


OF_PYTHON = re.compile(r"missing .* required|unexpected keyword|positional argument|keywords only")
"""What Python says of arguments that are missing or unknown."""

LONGEST = 1.2 * SECONDS + 2.0
"""CPU seconds that a call may take, without the compiling of kernels."""


def call(seed: int, again: bool = True) -> None:
    """One call, which answers or refuses in a sentence, in time.

    One that is late is made again: what a busy machine took from a process once, it does not take
    twice, and a loop that no budget reaches is late each time.
    """
    caller = Caller(seed)
    began, stood = time.process_time(), stood_still()
    said = "an answer"
    try:
        caller()
    except (StochviError, ValueError, OSError) as error:
        said = str(error).split(", got ")[0]
    except TypeError as error:
        if not OF_PYTHON.search(str(error)):
            raise AssertionError(f"seed {seed}: {caller}") from error
    except BaseException as error:
        raise AssertionError(f"seed {seed}: {caller}") from error
    bare = BARE.search(said.replace("must be finite", ""))
    assert len(said) > 8 and not bare, f"seed {seed}: {said}, {caller}"
    spent = time.process_time() - began - (stood_still() - stood)
    if again and spent >= LONGEST:
        call(seed, again=False)
    else:
        assert spent < LONGEST, f"seed {seed}: {spent:.1f} s, {caller}"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_calls_with_wrong_arguments_end_in_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(len(callables())):
        call(seed)


@pytest.mark.verify
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", range(1, 31))
def test_thousands_of_calls_end_in_sentences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int
) -> None:
    monkeypatch.chdir(tmp_path)
    for seed in range(part * len(callables()), (part + 1) * len(callables())):
        call(seed)
