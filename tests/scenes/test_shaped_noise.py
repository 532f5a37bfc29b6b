"""White noise through filters of any order, against resonances and Lyapunov's equation."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.signal import butter, tf2ss

from stochvi import (
    FilteredNoise,
    Scene,
    StateSpaceNoise,
    TransferFunctionNoise,
    exact,
    load_scene,
    simulate,
)
from stochvi.results.errors import SceneError
from stochvi.scenes import ImpactPair, Isolator, Oscillator, Restitution

Z = 4.5
"""Standard errors by which two simulations may differ."""

OMEGA, ZETA = 60.0, 0.2
RESONANCE = {"numerator": [OMEGA**2], "denominator": [1.0, 2.0 * ZETA * OMEGA, OMEGA**2]}


def resonance(zeta: float = ZETA) -> FilteredNoise:
    return FilteredNoise(on="base", intensity=2.0, frequency_hz=OMEGA / (2.0 * math.pi), zeta=zeta)


def isolator(noise: Any, **more: Any) -> Scene:
    return Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[noise], **more)


def test_a_resonance_is_that_of_filtered_noise() -> None:
    """Of every mean square the table leaves out less than 1e-6, and interpolates to 1e-6."""
    shaped = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE)
    table, closed = (exact(isolator(each)).coordinates["x"] for each in (shaped, resonance()))
    for name in ("displacement_mean_square", "velocity_mean_square"):
        assert getattr(table, name).value == pytest.approx(getattr(closed, name).value, rel=3e-6)


def test_between_stops_simulations_of_both_agree() -> None:
    pair = ImpactPair(lower=-3e-3, upper=3e-3, law=Restitution(coefficient=0.7))
    shaped = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE)

    def rate(noise: Any) -> Any:
        scene = isolator(noise, impact_pairs=[pair])
        found = simulate(scene, rel_error=0.01, seed=3).impact_pairs["stops"].collision_rate
        assert found is not None
        return found

    one, other, wrong = rate(shaped), rate(resonance()), rate(resonance(0.15))
    assert abs(one.value - other.value) < math.hypot(one.reach(Z), other.reach(Z))
    assert abs(one.value - wrong.value) > math.hypot(one.reach(Z), wrong.reach(Z))


@pytest.mark.parametrize("order", [1, 3, 6])
def test_state_space_and_transfer_function_have_one_density(order: int) -> None:
    numerator, denominator = butter(order, 2.0 * math.pi * 30.0, analog=True)
    a, b, c, _ = tf2ss(numerator, denominator)
    shaped = TransferFunctionNoise(
        on="base", intensity=2.0, numerator=numerator, denominator=denominator
    )
    states = StateSpaceNoise(on="base", intensity=2.0, A=a, B=b, C=c)
    f = np.geomspace(0.1, 100.0, 50)
    assert states.table(f) == pytest.approx(shaped.table(f), rel=3e-6)
    # E f f' = C P C' with A P + P A' + S0 B B' = 0; the table ends where its tail is faint
    covariance = solve_continuous_lyapunov(a, -2.0 * b @ b.T)
    square = (c @ covariance @ c.T).item()
    assert shaped.table.mean_square() == pytest.approx(square, rel=1e-3 if order == 1 else 3e-6)


def test_independent_noises_add_their_densities() -> None:
    a, c = [[-3.0, 1.0], [0.0, -7.0]], [1.0, 2.0]
    both = StateSpaceNoise(on="base", intensity=2.0, A=a, B=[[1.0, 0.5], [0.0, 2.0]], C=c)
    each = [
        StateSpaceNoise(on="base", intensity=2.0, A=a, B=b, C=c) for b in ([1.0, 0.0], [0.5, 2.0])
    ]
    f = np.geomspace(0.01, 10.0, 20)
    assert both.table(f) == pytest.approx(sum(one.table(f) for one in each), rel=3e-6)


def test_a_level_raises_the_density() -> None:
    noise = TransferFunctionNoise(on="base", intensity=2.0, **RESONANCE)
    louder = noise.louder(10.0)
    assert louder.table(5.0) == pytest.approx(10.0 * noise.table(5.0), rel=1e-9)


def test_a_notch_is_followed_down_to_what_cannot_be_heard() -> None:
    notch = TransferFunctionNoise(
        on="base", intensity=2.0, numerator=[1.0, 0.0, 900.0], denominator=[1.0, 90.0, 2700.0, 27e3]
    )
    at = 30.0 / (2.0 * math.pi)
    assert notch.table(at) < 1e-6 * notch.table(0.5 * at)


def test_a_scene_file_may_call_it_filtered(tmp_path: Any) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
        '[[excitation]]\nkind = "filtered"\nintensity = 0.2\nnumerator = [2.0]\n'
        "denominator = [1.0, 2.0]\n"
        '[[excitation]]\nkind = "filtered"\nintensity = 0.2\nA = [[-2.0]]\nB = [2.0]\nC = [1.0]\n',
        encoding="utf-8",
    )
    scene = load_scene(file)
    one, other = scene.excitations
    assert isinstance(one, TransferFunctionNoise) and isinstance(other, StateSpaceNoise)
    document = json.loads(json.dumps(scene.document()))
    assert Scene.model_validate(document).excitations == scene.excitations


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"numerator": [1.0], "denominator": [1.0, -2.0]}, "every pole with a negative real part"),
        ({"numerator": [1.0], "denominator": [1.0, 0.0]}, "every pole with a negative real part"),
        ({"numerator": [1.0, 1.0], "denominator": [1.0, 2.0]}, "of a lower degree"),
        ({"numerator": [1.0], "denominator": [2.0]}, "of degree 1 at least"),
        ({"numerator": [0.0], "denominator": [1.0, 2.0]}, "lets noise pass"),
        ({"A": [[-1.0, 2.0]], "B": [1.0], "C": [1.0]}, "square matrix A"),
        ({"A": [[-1.0]], "B": [1.0, 2.0], "C": [1.0]}, "B with 1 rows"),
        ({"A": [[-1.0]], "B": [1.0], "C": [1.0, 2.0]}, "C with 1 numbers"),
        ({"A": [[1.0]], "B": [1.0], "C": [1.0]}, "every pole with a negative real part"),
    ],
)
def test_what_is_no_filter_is_refused(keys: dict[str, Any], words: str) -> None:
    excitation = {"kind": "filtered", "intensity": 0.2} | keys
    with pytest.raises(SceneError, match=words):
        Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            excitations=[excitation],
        )


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"C": Scene}, "C must be a list, got <class"),
        ({"C": "x"}, "C must be a list, got 'x'"),
        ({"B": 3.0}, "B must be a list, got 3.0"),
        ({"B": [[1.0], [2.0, 3.0]]}, "needs B with 1 rows of equal length"),
    ],
)
def test_what_is_no_matrix_is_refused(wrong: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        StateSpaceNoise(**{"intensity": 1.0, "A": [[-1.0]], "B": [1.0], "C": [1.0]} | wrong)
