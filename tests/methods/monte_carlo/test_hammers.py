"""Tools pressed by a feed, without springs to hold them: what impacts with loss make stationary."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from stochvi import ImpactPair, Matrices, Oscillator, Restitution, Scene, WhiteNoise, simulate
from stochvi.methods.monte_carlo.choose_plan import make_plan
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations import (
    ConstantLoad,
    Excitation,
    FilteredNoise,
    Sine,
    TabulatedNoise,
)
from stochvi.testing import assert_agrees

STRIKER, BODY, ANVIL = 1.0, 4.0, 10.0
"""Masses, kg."""

NOISE = WhiteNoise(between=("striker", "body"), intensity=0.1)


def hammer(
    excitations: Sequence[Excitation], feed: float = 0.5, restitution: float = 0.5, *,
    anvil: bool = False,
) -> Scene:  # fmt: skip
    """A striker on a spring to its body, which a feed presses onto the ground, or onto an anvil
    that is free to move."""
    names = ("striker", "body", "anvil") if anvil else ("striker", "body")
    stiffness = np.zeros((len(names), len(names)))
    stiffness[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]
    where = {"between": ("striker", "anvil")} if anvil else {"on": "striker"}
    return Scene(
        structure=Matrices(
            coordinates=names, mass=np.diag([STRIKER, BODY, ANVIL][: len(names)]),
            damping=np.zeros_like(stiffness), stiffness=stiffness,
        ),
        impact_pairs=[ImpactPair(**where, upper=0.0, law=Restitution(coefficient=restitution))],
        excitations=[ConstantLoad(on="body", force=feed), *excitations],
    )  # fmt: skip


def test_momentum_and_energy_of_a_hammer_balance() -> None:
    """Feed = (1 + R) m F1; the noise brings S (1 / m1 + 1 / m2) / 2, impacts take (1 - R^2) m F2 /
    2."""
    found = simulate(hammer([NOISE]), paths=128, duration=800.0).impact_pairs["stops"]
    assert_agrees(found["impact_speed_rate"], 0.5 / (1.5 * STRIKER))
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    blows = power / ((1.0 - 0.5**2) * STRIKER / 2.0)
    assert_agrees(found["impact_speed_square_rate"], blows)
    with pytest.raises(AssertionError):
        # as if the whole body struck
        assert_agrees(found["impact_speed_square_rate"], blows * STRIKER / (STRIKER + BODY))


def test_a_hammer_on_a_free_anvil_is_seen_from_the_anvil() -> None:
    scene = hammer([NOISE], anvil=True)
    found = simulate(scene, paths=128, duration=800.0)
    assert list(found.coordinates) == ["striker", "body"]
    # the anvil runs away with the share of the feed that its mass takes
    pressed = 0.5 * ANVIL / (STRIKER + BODY + ANVIL)
    mass = STRIKER * ANVIL / (STRIKER + ANVIL)
    pair = found.impact_pairs["stops"]
    assert_agrees(pair["impact_speed_rate"], pressed / (1.5 * mass))
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    assert_agrees(pair["impact_speed_square_rate"], power / (0.75 * mass / 2.0))
    assert any("relative to 'anvil'" in each for each in found.assumptions)


def test_a_little_noise_leaves_the_blows_of_the_sine() -> None:
    sine = Sine(between=("striker", "body"), amplitude=1.0, frequency_hz=0.25)
    quiet = WhiteNoise(between=("striker", "body"), intensity=1e-7)
    damped = hammer([sine, quiet], feed=0.3, restitution=0.1)
    scene = damped.model_copy(
        update={
            "structure": Matrices(
                coordinates=("striker", "body"), mass=np.diag([1.0, 10.0]),
                damping=[[0.2, -0.2], [-0.2, 0.2]], stiffness=[[1.0, -1.0], [-1.0, 1.0]],
            ),
            "excitations": (damped.excitations[0], sine.model_copy(
                update={"frequency_hz": math.sqrt(1.1) / (2.0 * math.pi)}
            ), quiet),
        }
    )  # fmt: skip
    frequency = math.sqrt(1.1) / (2.0 * math.pi)
    found = simulate(scene, paths=32, duration=300.0).impact_pairs["stops"]
    assert found["collision_rate"].value == pytest.approx(frequency, rel=2e-3)
    assert_agrees(found["impact_speed_rate"], 0.3 / 1.1)


def loose(excitation: Excitation) -> Scene:
    """A mass that a load presses onto a stop, held by nothing else."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=0.0),
        impact_pairs=[ImpactPair(upper=0.0, law=Restitution(coefficient=0.5))],
        excitations=[ConstantLoad(force=0.5), excitation],
    )


def test_a_loose_mass_under_a_table_is_hit_as_under_the_filtered_noise_of_that_density() -> None:
    """Synthesised paths against paths of states: two schemes, and different random numbers."""
    zeta, intensity = 0.1, 0.03
    filtered = FilteredNoise(intensity=intensity, frequency_hz=1.0, zeta=zeta)
    # below the table lies less than a hundredth of the variance, omega S0 / (4 zeta)
    frequency = np.geomspace(0.05, 10.0, 200)
    gain = 1.0 / ((1.0 - frequency**2) ** 2 + (2.0 * zeta * frequency) ** 2)
    table = TabulatedNoise(
        frequency_hz=frequency.tolist(), density=(2.0 * intensity * gain).tolist(), unit="N2/Hz"
    )
    one, other = (
        simulate(loose(noise), paths=64, duration=60.0, seed=seed).impact_pairs["stops"]
        for seed, noise in enumerate((filtered, table))
    )
    for name in ("impact_speed_rate", "impact_speed_square_rate", "collision_rate"):
        a, b = one[name], other[name]
        error = math.hypot(a.standard_error, b.standard_error)
        assert abs(a.value - b.value) < 4.5 * error + (a.bias or 0.0) + (b.bias or 0.0)
    assert_agrees(other["impact_speed_rate"], 0.5 / 1.5)


@pytest.mark.parametrize(("feed", "limit"), [(0.5, 3e4), (5.0, 5e6)])
def test_a_hard_feed_does_not_ask_for_paths_without_end(feed: float, limit: float) -> None:
    """The body swings behind a striker that lies on the tool, until it lifts it: with an energy of
    feed^2 / k at most, which the noise brings in a time known beforehand."""
    plan = make_plan(model_of(hammer([NOISE], feed=feed)))
    assert plan.steps_per_path < limit
    power = 0.1 * (1.0 / STRIKER + 1.0 / BODY) / 2.0
    assert plan.relaxation < 10.0 * max(1.0, feed**2) / power


@pytest.mark.parametrize(
    ("scene", "remedy"),
    [
        (hammer([NOISE], restitution=1.0), "restitution below 1"),
        (hammer([NOISE], feed=-0.5), "kind = 'constant'"),
        (hammer([NOISE], feed=0.0), "kind = 'constant'"),
    ],
)
def test_what_has_no_stationary_state_is_refused_with_a_remedy(scene: Scene, remedy: str) -> None:
    with pytest.raises(NotApplicable, match="no stationary state was found") as caught:
        simulate(scene)
    assert remedy in str(caught.value)
