"""With matched noise and elastic stops the Gibbs distribution holds at every number of modes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stochvi.methods.closed_form import exact
from stochvi.methods.monte_carlo import simulate
from stochvi.scenes import Elastic, ImpactPair, Scene, WhiteNoise
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases

THETA, ZETA = 0.5, 0.05


def matched(count: int, *, raised: float = 1.0) -> Scene:
    """Modes whose white noise is 2 theta times their damping: it acts on as many points as there
    are modes, of which each moves with an orthogonal mixture of them. `raised` raises that on the
    first point."""
    omega = 2.0 * math.pi * np.array([10.0, 24.0, 37.0, 55.0, 71.0])[:count]
    number = np.arange(1, count + 1)
    mixed = math.sqrt(2.0 / (count + 1)) * np.sin(np.outer(number, number) * math.pi / (count + 1))
    points = {f"p{k}": (np.sqrt(2.0 * ZETA * omega) * mixed[k]).tolist() for k in range(count)}
    tip = (-1.0) ** np.arange(count)
    structure = {
        "kind": "modes", "frequency_hz": (omega / (2.0 * math.pi)).tolist(), "zeta": ZETA,
        "modal_mass": 1.0, "shapes": points | {"tip": tip.tolist()},
    }  # fmt: skip
    intensities = [2.0 * THETA * (raised if k == 0 else 1.0) for k in range(count)]
    return Scene(
        structure=structure,
        impact_pairs=[ImpactPair(on="tip", lower=-0.02, upper=0.01, law=Elastic(stiffness=4e4))],
        excitations=[WhiteNoise(on=f"p{k}", intensity=s) for k, s in enumerate(intensities)],
    )


@quick_cases("count", [1, 2, 3, 5], keep={1, 2})
def test_the_gibbs_law_holds_at_every_number_of_modes(count: int) -> None:
    known = exact(matched(count))
    found = simulate(matched(count), paths=16, duration=20.0, seed=7)
    for quantity in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        truth = getattr(known.impact_pairs["stops"], quantity).value
        assert_agrees(getattr(found.impact_pairs["stops"], quantity), truth)
    for name, motion in found.coordinates.items():
        assert_agrees(motion.displacement_std, known.coordinates[name].displacement_std.value)


def test_noise_that_is_not_matched_is_noticed() -> None:
    known = exact(matched(3)).impact_pairs["stops"].collision_rate
    found = simulate(matched(3, raised=2.0), paths=16, duration=20.0, seed=7)
    with pytest.raises(AssertionError):
        assert_agrees(found.impact_pairs["stops"].collision_rate, known.value)
