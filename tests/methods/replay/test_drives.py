"""Impulses and random forces beside a record: their momentum, their statistics, their motion."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    RecordedNoise,
    Restitution,
    Scene,
    damage,
    replay,
    simulate,
)
from stochvi.engine.drive import FIRST_DRAW, MOST_DRAWS, changes_of
from stochvi.model.model import model_of
from stochvi.scenes import DriveFunction, Pulses
from stochvi.scenes.excitations import BaseExcitation

FS, MASS, SAMPLES = 500.0, 2.0, 4000
MOUNT = {"mass": MASS, "frequency_hz": 10.0, "zeta": 0.05}
KNOCKS = Pulses(on="x", rate=5.0, impulse=0.3, sizes="exponential")
STOPS = ImpactPair(clearance=3e-3, law=Restitution(coefficient=0.6))
CHANGES = 2.0


def switch(value: float, time: float, uniform: float) -> float:
    """On or off, with 2 changes per second."""
    on = value > 0.5
    changes = uniform < 0.5 * (1.0 - math.exp(-2.0 * CHANGES * time))
    return 0.0 if on == changes else 1.0


GUST = DriveFunction(on="x", function=switch, rate=2.0 * CHANGES, amplitude=20.0)


def record(folder: Path, samples: int = SAMPLES, size: float = 0.5, **where: str) -> RecordedNoise:
    file = folder / f"{samples}-{size:g}.txt"
    np.savetxt(file, size * np.random.default_rng(3).normal(size=samples), fmt="%.17g")
    return RecordedNoise(file=str(file), unit="m/s2", fs=FS, **where)


def mount_of(folder: Path, *drives: BaseExcitation, pairs: tuple = (), samples: int = SAMPLES,
             size: float = 0.5) -> Scene:  # fmt: skip
    return Scene(
        structure=Isolator(**MOUNT), impact_pairs=list(pairs),
        excitations=[record(folder, samples, size), *drives],
    )  # fmt: skip


def momenta(scene: Scene, number: int = 0, seed: int = 0, samples: int = SAMPLES) -> np.ndarray:
    """Momentum, N s, or m/s of the base, that a drive brings in each sampling interval."""
    part = model_of(scene).drives[number]
    found = np.empty(samples)
    event = FIRST_DRAW + number * MOST_DRAWS
    changes_of(part.law.compiled(part.mass), np.uint64(seed), event, 1.0 / FS, found)
    return part.mass * found


def linear(forces: np.ndarray, mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray):
    """Displacements under forces that are linear between samples, by scipy."""
    n, inverse = len(mass), np.linalg.inv(mass)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    into = np.vstack([np.zeros((n, n)), inverse])
    system = (flow, into, np.eye(n, 2 * n), np.zeros((n, n)))
    return lsim(system, forces, np.arange(len(forces)) / FS, interp=True)[1].reshape(-1, n)


@pytest.mark.parametrize("on_base", [False, True])
def test_one_mass_moves_by_the_momenta_as_well(tmp_path: Path, on_base: bool) -> None:
    knocks = Pulses(on="base", rate=5.0, impulse=0.1) if on_base else KNOCKS
    scene = mount_of(tmp_path, knocks, GUST)
    with_them = replay(scene, seed=4).only.histories.displacement["x"]
    without = replay(mount_of(tmp_path)).only.histories.displacement["x"]
    forces = FS * momenta(scene, 0, 4) * (-MASS if on_base else 1.0) + FS * momenta(scene, 1, 4)
    omega = 2.0 * math.pi * MOUNT["frequency_hz"]
    numbers = [np.array([[MASS * each]]) for each in (1.0, 2.0 * MOUNT["zeta"] * omega, omega**2)]
    expected = linear(forces[:, None], *numbers)[:, 0]
    assert np.abs(expected).max() > 1e-4
    assert with_them - without == pytest.approx(expected, abs=1e-9 * np.abs(expected).max() + 1e-12)
    # the control: another seed is another realisation
    other = replay(scene, seed=5).only.histories.displacement["x"]
    assert np.abs(other - with_them).max() > 0.1 * np.abs(expected).max()


def test_six_modes_move_by_them_as_well(tmp_path: Path) -> None:
    n = 6
    mass, stiffness = np.eye(n), 4e3 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    damping, names = 2.0 * np.eye(n) + 1e-3 * stiffness, [f"x{k}" for k in range(n)]
    structure = Matrices(coordinates=names, mass=mass.tolist(), damping=damping.tolist(),
                         stiffness=stiffness.tolist())  # fmt: skip
    file = tmp_path / "force.txt"
    np.savetxt(file, np.random.default_rng(3).normal(size=SAMPLES), fmt="%.17g")
    pushed = RecordedNoise(file=str(file), unit="N", fs=FS, on="x0")
    drives = [KNOCKS.replace(on="x2"), GUST.replace(between=("x4", "x1"), on=None)]
    scene = Scene(structure=structure, excitations=[pushed, *drives])
    quiet = scene.replace(excitations=[pushed])
    motions = [replay(each, seed=2).only.histories.displacement for each in (scene, quiet)]
    forces = np.zeros((SAMPLES, n))
    forces[:, 2] = FS * momenta(scene, 0, 2)
    gust = FS * momenta(scene, 1, 2)
    forces[:, 4], forces[:, 1] = gust, -gust
    expected = linear(forces, mass, damping, stiffness)
    for k, name in enumerate(names):
        apart = motions[0][name] - motions[1][name]
        assert apart == pytest.approx(expected[:, k], abs=1e-8 * np.abs(expected).max())


def test_impulses_and_switches_have_their_statistics(tmp_path: Path) -> None:
    scene = mount_of(tmp_path, KNOCKS, GUST)
    samples, seeds = 50_000, range(20)
    knocks = np.array([momenta(scene, 0, seed, samples) for seed in seeds])
    time = samples / FS
    for found, expected in (
        ((knocks**2).sum(axis=1) / time, 5.0 * 2.0 * 0.3**2),  # rate * E J^2
        (np.abs(knocks).sum(axis=1) / time, 5.0 * 0.3),
        (knocks.sum(axis=1) / time, 0.0),
    ):
        error = found.std(ddof=1) / math.sqrt(len(found))
        assert abs(found.mean() - expected) < 4.5 * error
        assert abs(found.mean() - 1.2 * expected - 0.3) > 4.5 * error
    force = FS * np.array([momenta(scene, 1, seed, samples) for seed in seeds])
    assert set(np.round(np.unique(force), 9)) == {0.0, 20.0}
    changes = (np.diff(force, axis=1) != 0.0).sum(axis=1) / time
    assert abs(changes.mean() - CHANGES) < 4.5 * changes.std(ddof=1) / math.sqrt(len(changes))


@pytest.mark.slow
def test_impacts_are_as_frequent_as_in_a_simulation(tmp_path: Path) -> None:
    """A record that hardly moves the mass; the same pulses alone are simulated."""
    scene = mount_of(tmp_path, KNOCKS, pairs=(STOPS,), samples=50_000, size=1e-9)
    found = [replay(scene, seed=seed).only for seed in range(12)]
    alone = Scene(structure=Oscillator(**MOUNT), impact_pairs=[STOPS], excitations=[KNOCKS])
    answer = simulate(alone, rel_error=0.01, seed=1)
    for values, known in (
        ([float(each.coordinates["x"].displacement_std) for each in found],
         answer.coordinates["x"]["displacement_std"]),
        ([float(each.impacts.query("speed > 0.05").shape[0]) / 100.0 for each in found],
         simulate(alone, rel_error=0.01, seed=1, speed_threshold=0.05)
         .impact_pairs["stops"]["collision_rate"]),
    ):  # fmt: skip
        error = math.hypot(np.std(values, ddof=1) / math.sqrt(len(values)), known.standard_error)
        limit = 4.5 * error + (known.bias or 0.0)
        assert abs(np.mean(values) - known.value) < limit
        assert abs(np.mean(values) - 1.3 * known.value) > limit


def test_shocks_noise_and_damage_are_refused(tmp_path: Path) -> None:
    shock = Pulses(rate=0.1, shape="half-sine", duration=0.02, amplitude=50.0)
    with pytest.raises(NotApplicable, match="a shock belongs in the record"):
        replay(mount_of(tmp_path, shock))
    with pytest.raises(NotApplicable, match="damage does not apply: excitation must be Gaussian"):
        damage(mount_of(tmp_path, KNOCKS), equipment=[50.0], way="record")
    told = replay(mount_of(tmp_path, KNOCKS), seed=7)
    assert any("drawn (seed 7)" in each for each in told.assumptions)
    assert told.provenance["seed"] == 7
