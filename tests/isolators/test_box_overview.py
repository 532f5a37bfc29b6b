"""What one oscillator along each axis would buy at the snubbers of a box, by hand."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from stochvi import Isolator, Scene, Sine, screen
from stochvi.isolators.sizing.box_overview import box_overview
from stochvi.scenes import RigidBody
from support.boxes import box, scene_with, tables
from support.pairs import pair, uncoupled

MISSION = 3600.0
LAW = {"kind": "restitution", "coefficient": 0.5}


def snubber(name: str, direction: list[float], **stops: float) -> dict[str, object]:
    at = [0.2, 0.1, -0.05]
    return {"name": name, "at": at, "direction": direction, "law": LAW} | stops


def test_one_axis_is_an_oscillator_on_all_mounts_together() -> None:
    body = box(zeta=0.1, gravity="-z")
    towards = [1.0, 2.0, 2.0]
    pairs = [snubber("up", [0, 0, 1], clearance=0.02), snubber("slant", towards, upper=0.01)]
    found = box_overview(scene_with(body, pairs), MISSION)
    assert found is not None
    _, damping, stiffness = body.matrices
    alone = []
    for row, noise in enumerate(tables()):
        single = Isolator(mass=12.0, stiffness=stiffness[row, row], damping=damping[row, row])
        bare = noise.model_copy(update={"axis": None})
        alone.append(screen(Scene(structure=single, excitations=[bare])).displacement_std)
    shares = np.array(towards) / 3.0
    expected = [3.0 * alone[2], 3.0 * math.sqrt(np.sum((shares * alone) ** 2))]
    rows = found.pairs.set_index("pair")
    assert rows["one_axis_three_sigma"].tolist() == pytest.approx(expected, rel=1e-8)
    # a corner of this box moves otherwise than its centre
    moved = screen(scene_with(body, pairs)).impact_pairs
    for name, stops in (("up", 2.0), ("slant", 1.0)):
        sigma, speed = moved[name].displacement_std, moved[name].velocity_std
        level = rows.loc[name, "one_axis_three_sigma"] / sigma
        assert level != pytest.approx(3.0, rel=1e-3)
        hits = MISSION * stops * speed / sigma / (2.0 * math.pi) * math.exp(-(level**2) / 2.0)
        chance = rows.loc[name, "chance_at_one_axis"]
        assert chance == pytest.approx(-math.expm1(-hits), rel=1e-9)


def test_sines_beside_the_noise_raise_the_chances_of_a_box() -> None:
    body, pairs = box(zeta=0.1), [snubber("up", [0, 0, 1], upper=0.006)]
    quiet = scene_with(body, pairs)
    sine = Sine(on="base", axis="z", frequency_hz=9.0, amplitude=1.0, unit="g")
    loud = quiet.replace(excitations=[*quiet.excitations, sine])
    one, other = (box_overview(scene, MISSION).pairs.iloc[0] for scene in (quiet, loud))
    moved = screen(loud).impact_pairs["up"]
    assert moved.displacement_std > 1.2 * screen(quiet).impact_pairs["up"].displacement_std
    assert other["one_axis_three_sigma"] > 1.1 * one["one_axis_three_sigma"]
    # Rice's rate of a Gaussian process about a moving mean, by plain sums over the phase
    phases = 2.0 * math.pi * np.arange(20_000) / 20_000
    quiet_gap = screen(quiet).impact_pairs["up"]
    sigma, speed = quiet_gap.displacement_std, quiet_gap.velocity_std
    height = math.sqrt(2.0 * (moved.displacement_std**2 - sigma**2))
    mean, rate = height * np.cos(phases), -2.0 * math.pi * 9.0 * height * np.sin(phases)
    turn = rate / speed
    rises = norm.pdf(turn) + turn * norm.cdf(turn)
    hits = MISSION * np.mean(norm.pdf((0.006 - mean) / sigma) * speed / sigma * rises)
    assert other["chance_as_given"] == pytest.approx(-math.expm1(-hits), rel=1e-6)
    assert other["chance_as_given"] > 2.0 * one["chance_as_given"]


def test_a_stop_that_the_weight_presses_on_is_hit_for_certain() -> None:
    body = box(zeta=0.1, gravity="-z")
    found = box_overview(scene_with(body, [snubber("low", [0, 0, 1], lower=-1e-5)]), MISSION)
    assert found is not None and found.pairs["chance_as_given"].tolist() == [1.0]


def test_modes_are_those_of_the_body_and_their_masses_add_up() -> None:
    body = box()
    found = box_overview(scene_with(body, [snubber("up", [0, 0, 1], clearance=0.02)]), MISSION)
    assert found is not None and isinstance(body, RigidBody)
    assert [mode.frequency_hz for mode in found.modes] == pytest.approx(
        body.natural_frequency_hz.tolist(), rel=1e-9
    )
    for axis in ("x", "y", "z"):
        assert sum(mode.effective_mass[axis] for mode in found.modes) == pytest.approx(12.0)


def test_other_structures_are_no_boxes() -> None:
    assert box_overview(uncoupled(pair("x", "x", 4.0)), MISSION) is None
