"""Arrays of oscillators: the same numbers as the model of a scene, and refusals by name."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi import ImpactPair, Oscillator, Restitution, Scene, WhiteNoise
from stochvi.model.model import model_of
from stochvi.model.oscillator_arrays import OscillatorArrays

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


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"omega": [1.0, math.nan]}, "omega must be numbers, got nan"),
        ({"load": math.inf}, "load must be finite, got inf"),
        ({"intensity": -0.1}, "intensity must be at least 0, got -0.1"),
        ({"restitution_upper": 1.2}, r"restitution_upper must be in \[0, 1\], got 1.2"),
        ({"lower": 1.0, "upper": 1.0}, "lower must be below upper, got 1 and 1 at index 0"),
    ],
)
def test_numbers_out_of_range_are_named(changes: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        OscillatorArrays.broadcast(**PLAIN | changes).check()


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
