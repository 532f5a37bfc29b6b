"""Probability that any snubber of a rigid box is hit, against counting missions of a motion that is
made from direct matrices and the densities of the base alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from stochvi import ImpactPair, Restitution, Scene
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.estimates import Estimate
from stochvi.scenes import RigidBody
from stochvi.statistics.first_crossings import first_crossings
from stochvi.testing import assert_agrees
from support.boxes import INERTIA, PLACES, TABLES, direct_matrices, tables

RECORD, RATE = 200.0, 2000.0
"""Length of a record, s, and samples per second: a hundred in a period of the fastest mode."""

MISSION, APART = 4.0, 1.0
"""Length of a mission, and what lies between two of one record: five time constants, s."""

REACHES = (4.2, 4.75, 5.2)
"""Distances of all snubbers, in standard deviations: probabilities of some 1e-1, 1e-2 and 1e-3."""


def random_box(number: int) -> RigidBody:
    """A box whose eight mounts all differ, with its centre of mass somewhere between them."""
    random = np.random.default_rng([5, number])
    offset = random.uniform(-0.04, 0.04, 3)
    mounts = [
        {
            "at": (np.array(place) + offset).tolist(),
            "stiffness": random.uniform(1e4, 2.5e4, 3).tolist(),
            "damping": random.uniform(15.0, 30.0, 3).tolist(),
        }
        for place in PLACES
    ]
    return RigidBody(mass=float(random.uniform(9.0, 15.0)), inertia=INERTIA, mount=mounts)


def snubbers(number: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Places and unit directions of three to five snubbers."""
    random = np.random.default_rng([6, number])
    chosen = random.permutation(8)[: 3 + number % 3]
    directions = random.standard_normal((len(chosen), 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return [(np.array(PLACES[k]), d) for k, d in zip(chosen, directions, strict=True)]


def gaps_by_frequency(structure: RigidBody, number: int) -> NDArray[np.complex128]:
    """Amplitudes (axes, gaps, bins) of the gaps per standard normal coefficient of the base."""
    mass, damping, stiffness = direct_matrices(structure)
    bins = np.arange(1, round(RECORD * RATE / 2.0)) / RECORD
    w = 2.0 * np.pi * bins[:, None, None]
    dynamic = stiffness - w**2 * mass + 1j * w * damping
    rows = np.array([[*d, *np.cross(at, d)] for at, d in snubbers(number)])
    found = []
    for axis, (frequency, density) in enumerate(TABLES.values()):
        logs = np.interp(np.log(bins), np.log(frequency), np.log(density))
        inside = (bins >= frequency[0]) & (bins <= frequency[-1])
        shaken = np.where(inside, STANDARD_GRAVITY * np.sqrt(np.exp(logs) / RECORD), 0.0)
        force = np.broadcast_to(-mass[:, axis, None], (len(bins), 6, 1))
        moved = np.linalg.solve(dynamic, force)[:, :, 0]
        found.append((moved @ rows.T).T * shaken)
    return np.array(found)


def largest(number: int, missions: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(missions,) largest distance of any gap in its standard deviations, and these (gaps,), m."""
    waves = gaps_by_frequency(random_box(number), number)
    std = np.sqrt(np.sum(np.abs(waves) ** 2, axis=(0, 2)))
    random = np.random.default_rng([7, number])
    samples, length = round(RECORD * RATE), round(MISSION * RATE)
    period = round((MISSION + APART) * RATE)
    found: list[float] = []
    while len(found) < missions:
        normals = random.standard_normal((2, len(waves), 1, waves.shape[2]))
        spectrum = np.zeros((len(std), samples // 2 + 1), complex)
        spectrum[:, 1 : waves.shape[2] + 1] = np.sum((normals[0] - 1j * normals[1]) * waves, axis=0)
        moved = np.fft.irfft(spectrum, samples, norm="forward") / 2.0
        away = np.max(np.abs(moved) / std[:, None], axis=0)
        found += [float(away[first : first + length].max()) for first in range(0, samples, period)]
    return np.array(found), std


def assert_agrees_with_counting(number: int, missions: int, rel_error: float) -> None:
    away, std = largest(number, missions)
    scene = Scene(
        structure=random_box(number),
        impact_pairs=[
            ImpactPair(
                name=f"snubber {k}", at=at.tolist(), direction=direction.tolist(),
                clearance=4.0 * std[k], law=Restitution(coefficient=0.4),
            )
            for k, (at, direction) in enumerate(snubbers(number))
        ],
        excitations=tables(),
    )  # fmt: skip
    rows = np.outer(REACHES, std)
    found = first_crossings(
        scene, lower=rows, upper=rows, mission=MISSION, rel_error=rel_error, seed=number
    )
    np.testing.assert_allclose(found.displacement_std, std, rtol=2e-3)
    for reach, chance in zip(REACHES, found.probability(MISSION), strict=True):
        counted = float(np.mean(away >= reach))
        expected = max(chance.value, 1.0 / len(away))
        error = math.sqrt(expected * (1.0 - expected) / len(away))
        print(number, reach, chance, counted)
        # of rare hits the number counted is Poisson's: one more or less is no standard error
        both = Estimate(
            value=chance.value,
            standard_error=math.hypot(chance.standard_error, error),
            bias=(chance.bias or 0.0) + 1.0 / len(away),
        )
        assert_agrees(both, counted)


@pytest.mark.slow
def test_a_box_against_counting() -> None:
    assert_agrees_with_counting(0, 300, 0.1)


@pytest.mark.verify
@pytest.mark.parametrize("number", range(1, 7))
def test_boxes_against_much_counting(number: int) -> None:
    assert_agrees_with_counting(number, 12_000, 0.01)
