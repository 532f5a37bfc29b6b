"""A cantilever that slaps against a spring stop: its modes against finite elements in time."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from stochvi.methods.replay import replay
from stochvi.methods.replay.answer import Replay
from stochvi.scenes import Elastic, ImpactPair, RecordedNoise, Scene

LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY, ZETA = 0.25, 0.02, 0.003, 7e10, 2700.0, 0.02
STIFFNESS, CLEARANCE = 2e4, 5e-4
RATE, SAMPLES = 8000.0, 2000


def base_acceleration() -> np.ndarray:
    """A quarter of a second of noise below 600 Hz, m/s^2."""
    low_pass = scipy.signal.butter(4, 600.0 / (RATE / 2.0))
    noise = np.random.default_rng(3).normal(size=SAMPLES)
    found = 60.0 * scipy.signal.lfilter(*low_pass, noise)
    return found - found.mean()


def elements(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, stiffness and inertia under the base of a cantilever of elements with cubic shapes."""
    h, bending = LENGTH / count, YOUNG * WIDTH * HEIGHT**3 / 12.0
    per_length = DENSITY * WIDTH * HEIGHT
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])  # fmt: skip
    size = 2 * count + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for each in range(count):
        part = slice(2 * each, 2 * each + 4)
        mass[part, part] += per_length * h / 420.0 * m
        stiffness[part, part] += bending / h**3 * k
    follow = mass @ np.tile([1.0, 0.0], count + 1)
    return mass[2:, 2:], stiffness[2:, 2:], follow[2:]


def newmark(count: int, parts: int) -> tuple[np.ndarray, int, float]:
    """Displacement of the tip at the samples, contacts, and the largest force on the stop, by the
    rule of Newmark with constant mean acceleration and `parts` steps a sample."""
    mass, stiffness, follow = elements(count)
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    damping = mass @ shapes @ np.diag(2.0 * ZETA * np.sqrt(squares)) @ shapes.T @ mass
    h, tip, base = 1.0 / (RATE * parts), len(mass) - 2, base_acceleration()
    inverse = np.linalg.inv(mass + h / 2.0 * damping + h**2 / 4.0 * stiffness)
    column = inverse[:, tip].copy()
    stop = h**2 / 4.0 * STIFFNESS
    x, v = np.zeros(len(mass)), np.zeros(len(mass))
    a = np.linalg.solve(mass, -follow * base[0])
    tips, peak, contacts, touching = [0.0], 0.0, 0, False
    for first, second in itertools.pairwise(base):
        for part in range(1, parts + 1):
            shaken = first + (second - first) * part / parts
            ahead, faster = x + h * v + h**2 / 4.0 * a, v + h / 2.0 * a
            a = inverse @ (-follow * shaken - stiffness @ ahead - damping @ faster)
            beyond = ahead[tip] + h**2 / 4.0 * a[tip] - CLEARANCE
            if beyond > 0.0:  # the stop adds its stiffness to the matrix of the step
                contacts, touching = contacts + (not touching), True
                a = a - column * STIFFNESS * beyond / (1.0 + stop * column[tip])
            else:
                touching = False
            x, v = ahead + h**2 / 4.0 * a, faster + h / 2.0 * a
            peak = max(peak, STIFFNESS * (x[tip] - CLEARANCE))
        tips.append(x[tip])
    return np.array(tips), contacts, peak


def measures(count: int) -> dict[str, Any]:
    """Keys of the cantilever with `count` modes."""
    return {
        "kind": "beam", "length": LENGTH, "width": WIDTH, "height": HEIGHT, "young": YOUNG,
        "density": DENSITY, "zeta": ZETA, "support": "cantilever", "modes": count,
        "points": {"tip": 1.0},
    }  # fmt: skip


def textbook_modes(count: int) -> dict[str, Any]:
    """Keys of the same modes from a textbook, without the compliance of those left out."""
    guesses = [1.875, 4.694, *(math.pi * (n - 0.5) for n in range(3, count + 1))][:count]
    waves = scipy.optimize.newton(lambda k: np.cos(k) + 1.0 / np.cosh(k), np.array(guesses))
    sigma = (np.sinh(waves) - np.sin(waves)) / (np.cosh(waves) + np.cos(waves))
    mass = DENSITY * WIDTH * HEIGHT * LENGTH
    rate = math.sqrt(YOUNG * WIDTH * HEIGHT**3 / 12.0 / (mass * LENGTH**3))
    return {
        "kind": "modes", "zeta": ZETA, "modal_mass": mass / 4.0,
        "frequency_hz": (waves**2 * rate / (2.0 * math.pi)).tolist(),
        "shapes": {"tip": [1.0] * count},
        "participation": (4.0 * sigma / waves * (-1.0) ** np.arange(count)).tolist(),
    }  # fmt: skip


def replayed(structure: dict[str, Any], folder: Path) -> Replay:
    record = folder / "base.txt"
    np.savetxt(record, base_acceleration())
    scene = Scene(
        structure=structure,
        impact_pairs=[ImpactPair(on="tip", upper=CLEARANCE, law=Elastic(stiffness=STIFFNESS))],
        excitations=[RecordedNoise(file=str(record), unit="m/s2", fs=RATE, on="base")],
    )
    return replay(scene)


def tip_of(found: Replay) -> np.ndarray:
    """Displacement of the tip: shapes are 1 there, so that it is the sum of all modes."""
    modes = [name for name in found.histories.displacement if name.startswith("mode ")]
    return np.sum([found.histories.displacement[name] for name in modes], axis=0)


def peak_force(found: Replay) -> float:
    return found.impact_pairs["stops"].peak_force.value


def test_modes_of_a_beam_at_a_stop_are_finite_elements_in_time(tmp_path: Path) -> None:
    coarse, _, coarse_peak = newmark(24, 6)
    tip, contacts, peak = newmark(48, 12)
    found = replayed(measures(10), tmp_path)
    ours = tip_of(found)
    assert found.impact_pairs["stops"].hits.value == contacts == 8
    # the rule of Newmark is of second order: the finer one is off by a third of the difference
    error = np.abs(tip - coarse).max()
    assert error < 0.02 * np.abs(tip).max()
    assert np.abs(ours - tip).max() < error
    assert peak_force(found) == pytest.approx(peak, abs=abs(peak - coarse_peak) + 1e-3 * peak)
    # one mode alone hits half as often: the comparison would see a wrong structure
    assert replayed(textbook_modes(1), tmp_path).impact_pairs["stops"].hits.value == 4


def test_the_compliance_of_left_out_modes_quickens_convergence(tmp_path: Path) -> None:
    peak = peak_force(replayed(measures(16), tmp_path))
    for count in (2, 3, 4):
        error, plain = (
            abs(peak_force(replayed(structure, tmp_path)) / peak - 1.0)
            for structure in (measures(count), textbook_modes(count))
        )
        assert error < 0.4 * plain
