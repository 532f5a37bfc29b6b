"""Records through springs that relax, with stops: an integrator of its own with the inner state
judges the path, the impacts and what the step is said to leave."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ImpactPair,
    Matrices,
    RecordedNoise,
    Restitution,
    Scene,
    Viscoelastic,
    replay,
)
from stochvi.methods.replay.recorded_motion import records_of, shaking_of
from stochvi.methods.replay.steps import SteppedReplay
from stochvi.model.model import model_of
from support.rubber import OwnPath, OwnStop, random_rubber

FS, SAMPLES, PARTS = 20.0, 256, 24
LAWS = {
    "rigid": Restitution(coefficient=0.6),
    "elastic": Elastic(stiffness=60.0),
    "viscoelastic": Viscoelastic(stiffness=60.0, damping_ratio=0.2),
}


def scene_with_record(folder: Path, seed: int, kind: str) -> tuple[Scene, OwnPath, np.ndarray]:
    """A random structure with stops of a kind, the integrator, and the forces at the samples."""
    own, keys = random_rubber(seed, most=3)
    draw = np.random.default_rng(1000 + seed)
    n, name = len(own.mass), keys["coordinates"][0]
    t = np.arange(SAMPLES) / FS
    waves = [
        draw.uniform(0.5, 2.0) * np.sin(2.0 * np.pi * f * t + draw.uniform(0.0, 6.0))
        for f in draw.uniform(0.1, 1.0, 4)
    ]
    force = np.sum(waves, axis=0) * np.minimum(t, 1.0)
    force -= force.mean()
    file = folder / f"{seed}.txt"
    np.savetxt(file, force, fmt="%.17g")
    row, place = np.eye(n)[0], {"on": name}
    if n > 1 and seed % 2:
        row, place = np.eye(n)[0] - np.eye(n)[1], {"between": keys["coordinates"][:2]}
    free = OwnPath(own, []).follow(np.outer(force, np.eye(n)[0]), 1.0 / FS, 20)
    away = 0.5 * float(np.abs(free @ row).max())
    law = LAWS[kind]
    scene = Scene(
        structure=Matrices(**keys),
        impact_pairs=[ImpactPair(lower=-away, upper=1.2 * away, law=law, **place)],
        excitations=[RecordedNoise(file=str(file), unit="N", fs=FS, on=name)],
    )
    (pair,) = model_of(scene).pairs
    stiffness = getattr(law, "stiffness", 0.0)
    damping = 2.0 * getattr(law, "damping_ratio", 0.0) * np.sqrt(stiffness * pair.mass)
    stops = [
        OwnStop(row, side, where, 0.6, stiffness, damping)
        for side, where in ((-1.0, -away), (1.0, 1.2 * away))
    ]
    return scene, OwnPath(own, stops), np.outer(force, np.eye(n)[0])


LEAVES = 108
"""Seed of a mass that comes to rest on a rigid stop, and leaves it within a step of either run."""


class Compared(NamedTuple):
    """Largest error of the path, the difference to twice the step, and that of the integrator."""

    error: float
    step: float
    own: float
    impacts: int


def compare(folder: Path, seed: int, *, remembers: bool = True) -> Compared:
    scene, path, forces = scene_with_record(folder, seed, list(LAWS)[seed % len(LAWS)])
    if not remembers:  # never relaxed, as a stiffness at one frequency would have it
        path.stop_relaxing()
    half = path.afresh().follow(forces, 1.0 / FS, PARTS // 2)
    wanted = path.follow(forces, 1.0 / FS, PARTS)
    model = model_of(scene)
    (shaking,) = shaking_of(records_of(scene, model), model)
    way = SteppedReplay(model, shaking)
    fine, coarse = (way.move(shaking, 0, parts).displacement for parts in way.runs)
    error, step, own = (
        float(np.abs(one - other).max())
        for one, other in ((fine, wanted), (fine, coarse), (wanted, half))
    )
    return Compared(error, step, own, len(path.impacts))


def judge(folder: Path, seed: int) -> None:
    found = compare(folder, seed)
    assert found.impacts > 0
    assert found.error <= found.step + found.own


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(each, marks=pytest.mark.slow) for each in (1, 2, LEAVES))]
)
def test_paths_are_those_of_an_integrator_with_the_inner_state(tmp_path: Path, seed: int) -> None:
    judge(tmp_path, seed)


@pytest.mark.verify
@pytest.mark.parametrize("seed", [each for each in range(3, 203) if each != LEAVES])
def test_paths_of_200_random_scenes(tmp_path: Path, seed: int) -> None:
    judge(tmp_path, seed)


def test_an_integrator_without_the_inner_state_is_noticed(tmp_path: Path) -> None:
    found = compare(tmp_path, 0, remembers=False)
    assert found.error > 100.0 * (found.step + found.own)


@pytest.mark.slow
def test_replay_answers_with_the_bias_of_its_steps(tmp_path: Path) -> None:
    scene, path, forces = scene_with_record(tmp_path, 1, "elastic")
    wanted = path.follow(forces, 1.0 / FS, PARTS)
    found = replay(scene)
    assert found.histories is not None
    for k, name in enumerate(scene.structure.coordinates):
        own = found.histories.displacement[name]
        assert np.abs(own - wanted[:, k]).max() <= 1e-6 * np.abs(wanted).max()
    assert found.impact_pairs["stops"].hits.value == len(path.impacts)
