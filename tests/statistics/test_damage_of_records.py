"""Equipment on the motion of a measured record itself, against general solvers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    RecordedNoise,
    Restitution,
    Scene,
    TabulatedNoise,
    damage,
)
from stochvi.scenes.impact_laws import Elastic

RATE, W, ZETA = 500.0, 2.0 * math.pi * 8.0, 0.1
EQUIPMENT, Q = (15.0, 40.0, 90.0), 10.0


def record(folder: Path) -> np.ndarray:
    """Two seconds of noise with a pothole, written to a file."""
    random = np.random.default_rng(7)
    base = np.convolve(random.normal(size=1000), np.ones(6) / 6.0, "same") * 4.0
    base[500:515] += 60.0 * np.sin(math.pi * np.arange(15) / 15.0)
    base -= base.mean()
    np.savetxt(folder / "road.txt", base)
    return base


def scene(folder: Path, *pairs: ImpactPair) -> Scene:
    noise = RecordedNoise(file=str(folder / "road.txt"), unit="m/s2", fs=RATE)
    mount = Isolator(frequency_hz=8.0, zeta=ZETA, mass=1.0)
    return Scene(structure=mount, impact_pairs=pairs, excitations=[noise])


def rung(acceleration: np.ndarray, step: float, impulses: list[tuple[float, float]]) -> Any:
    """Absolute accelerations and pseudo-velocities of the equipment, on the samples, by `lsim` of
    the acceleration and the free ringing after impulses (time, change of velocity)."""
    time = step * np.arange(len(acceleration))
    answers = []
    for f in EQUIPMENT:
        w = 2.0 * math.pi * f
        system = [[0.0, 1.0], [-(w**2), -w / Q]], [[0.0], [-1.0]], np.eye(2), np.zeros((2, 1))
        _, state, _ = lsim(system, acceleration, time)
        for at, change in impulses:
            later = np.maximum(time - at, 0.0)
            ringing = w * math.sqrt(1.0 - 0.25 / Q**2)
            fall = -change * np.exp(-0.5 * w * later / Q) * (time >= at)
            z = fall * np.sin(ringing * later) / ringing
            rate = fall * (
                np.cos(ringing * later) - 0.5 * w / Q * np.sin(ringing * later) / ringing
            )
            state = state + np.stack([z, rate], axis=1)
        answers.append((-(w**2) * state[:, 0] - w / Q * state[:, 1], w * state[:, 0]))
    return answers


def flown(base: np.ndarray, gap: float, restitution: float) -> tuple[Any, Any, list[Any]]:
    """Fine samples of the absolute acceleration of the mount, and its impacts, by `solve_ivp`."""
    times = np.arange(len(base)) / RATE
    step = 1.0 / (16.0 * RATE)
    grid = step * np.arange(16 * (len(base) - 1) + 1)

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -(W**2) * y[0] - 2.0 * ZETA * W * y[1] - np.interp(t, times, base)]

    def met(t: float, y: np.ndarray) -> float:
        return gap - abs(y[0])

    met.terminal, met.direction = True, -1.0  # type: ignore[attr-defined]
    now, state, impulses = 0.0, np.zeros(2), []
    out = np.zeros((len(grid), 2))
    while now < times[-1]:
        found = solve_ivp(
            rates, (now, times[-1]), state, events=met, rtol=1e-9, atol=1e-12, max_step=1.0 / RATE,
            dense_output=True,
        )  # fmt: skip
        inside = (grid >= now) & (grid <= found.t[-1])
        out[inside] = found.sol(grid[inside]).T
        now, state = found.t[-1], found.y[:, -1].copy()
        if found.status == 1:
            impulses.append((now, -(1.0 + restitution) * state[1]))
            state[1] *= -restitution
            state[0] = math.copysign(gap * (1.0 - 1e-12), state[0])
    return -(W**2) * out[:, 0] - 2.0 * ZETA * W * out[:, 1], step, impulses


def test_without_stops_equipment_moves_as_by_a_general_solver(tmp_path: Path) -> None:
    base = record(tmp_path)
    found = damage(scene(tmp_path), equipment=EQUIPMENT, q=Q, way="record")
    acceleration, step, impulses = flown(base, math.inf, 0.0)
    assert not impulses and found.way == "record" and found.impacts_per_hour is None
    assert found.mission == pytest.approx((len(base) - 1) / RATE)
    for k, (answer, _) in enumerate(rung(acceleration, step, [])):
        spectra = found.with_stops
        assert spectra.response_rms.value[k] == pytest.approx(np.std(answer), rel=0.02)
        assert spectra.extreme_response.value[k] == pytest.approx(np.abs(answer).max(), rel=3e-3)
    ten = damage(scene(tmp_path), mission=20.0, equipment=EQUIPMENT, q=Q, way="record").with_stops
    once = found.with_stops.fatigue_damage.value
    assert ten.fatigue_damage.value == pytest.approx(once * 20.0 / found.mission)
    assert ten.extreme_response.value == pytest.approx(found.with_stops.extreme_response.value)


def test_impacts_on_rigid_stops_ring_the_equipment(tmp_path: Path) -> None:
    base = record(tmp_path)
    pair = ImpactPair(clearance=0.008, law=Restitution(coefficient=0.6))
    found = damage(scene(tmp_path, pair), equipment=EQUIPMENT, q=Q, way="record")
    acceleration, step, impulses = flown(base, 0.008, 0.6)
    assert found.impacts_per_hour is not None and found.shocks is not None
    seconds = (len(base) - 1) / RATE
    assert len(impulses) >= 2
    assert found.impacts_per_hour.value == pytest.approx(len(impulses) * 3600.0 / seconds)
    for k, (answer, _) in enumerate(rung(acceleration, step, impulses)):
        largest = np.abs(answer).max()
        assert found.with_stops.extreme_response.value[k] == pytest.approx(largest, rel=0.01)
        assert found.shocks.worst[k] == pytest.approx(largest, rel=0.05)
    # the impacts are most of it: without their impulses the response is far smaller
    for k, (answer, _) in enumerate(rung(acceleration, step, [])):
        if k:
            assert np.abs(answer).max() < 0.8 * found.with_stops.extreme_response.value[k]
    assert found.damage_ratio is not None and np.all(found.damage_ratio.value > 1.0)
    lost = sum((change / 1.6) ** 2 * (1.0 - 0.36) / 2.0 for _, change in impulses)
    assert found.impact_loss_per_hour is not None
    assert found.impact_loss_per_hour.value == pytest.approx(lost * 3600.0 / seconds, rel=1e-4)


def test_a_stiff_stop_shakes_slow_equipment_as_a_rigid_one(tmp_path: Path) -> None:
    record(tmp_path)
    rigid = ImpactPair(clearance=0.008, law=Restitution(coefficient=1.0))
    stiff = ImpactPair(clearance=0.008, law=Elastic(stiffness=4e8))
    soft = ImpactPair(clearance=0.008, law=Elastic(stiffness=4e3))
    one, two, three = (
        damage(
            scene(tmp_path, each), equipment=(15.0, 40.0, 60.0), q=Q, way="record", levels=[50.0]
        )
        for each in (rigid, stiff, soft)
    )
    largest = [each.with_stops.extreme_response.value for each in (one, two, three)]
    assert largest[1] == pytest.approx(largest[0], rel=0.05)
    assert not np.allclose(largest[2], largest[0], rtol=0.1)
    assert two.contacts_above["50"].value > 0.0 and not one.contacts_above


def test_a_place_of_a_structure_under_a_recorded_force_and_its_tailored_test(
    tmp_path: Path,
) -> None:
    force = record(tmp_path)
    mass, damping, stiffness = np.diag([2.0, 0.5]), np.zeros((2, 2)), np.zeros((2, 2))
    damping[:] = [[8.0, -2.0], [-2.0, 2.0]]
    stiffness[:] = [[6000.0, -2000.0], [-2000.0, 2000.0]]
    noise = RecordedNoise(file=str(tmp_path / "road.txt"), unit="N", fs=RATE, on="frame")
    two = Scene(
        structure=Matrices(
            coordinates=("frame", "part"), mass=mass.tolist(), damping=damping.tolist(),
            stiffness=stiffness.tolist(),
        ),
        excitations=[noise],
    )  # fmt: skip
    found = damage(two, equipment=EQUIPMENT, q=Q, at="part", way="record", test_duration=10.0)
    step = 1.0 / (16.0 * RATE)
    grid = step * np.arange(16 * (len(force) - 1) + 1)
    fine = np.interp(grid, np.arange(len(force)) / RATE, force)
    inverse = np.linalg.inv(mass)
    moves = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    pushes = np.concatenate([np.zeros(2), inverse[:, 0]])[:, None]
    part = np.array([moves[3]])
    _, acceleration, _ = lsim((moves, pushes, part, np.zeros((1, 1))), fine, grid)
    for k, (answer, _) in enumerate(rung(acceleration, step, [])):
        largest = found.with_stops.extreme_response.value[k]
        assert largest == pytest.approx(np.abs(answer).max(), rel=3e-3)
    assert found.test is not None and np.all(found.test.damage_ratio > 0.99)


def test_a_scene_without_a_record_is_refused(tmp_path: Path) -> None:
    record(tmp_path)
    truck = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    with pytest.raises(NotApplicable, match="must hold a measured record"):
        damage(scene(tmp_path).replace(excitations=[truck]), mission=60.0, way="record")
    with pytest.raises(ValueError, match="mission must be a positive number of seconds"):
        damage(scene(tmp_path), mission=0.0, way="record")
