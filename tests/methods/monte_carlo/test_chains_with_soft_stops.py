"""Masses whose soft stops push at the same time, against the law of Gibbs.

Where the noise on each mass matches its damper, and no stop loses energy, the stationary density is
exp(-energy / theta) whatever the stops are (B 13.38).
"""

from __future__ import annotations

import numpy as np
import pytest

from stochvi import (
    Elastic,
    ForceTable,
    ImpactPair,
    Matrices,
    Response,
    Scene,
    WhiteNoise,
    exact,
    simulate,
)
from stochvi.scenes import Hertz
from stochvi.scenes.impact_laws import CompliantLaw

MASS = np.diag([1.0, 1.5, 0.8])
STIFFNESS = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 2.0]])
DAMPING = 0.15 * MASS
NAMES = ["a", "b", "c"]
FARTHEST = 4.5
"""Standard errors by which one of some 34 numbers of a scene may be off: one scene in 4000."""

TABLE = ForceTable(deflection=[0.0, 0.1, 0.5], force=[0.0, 5.0, 60.0])
LAWS = {
    "stiff springs": (Elastic(stiffness=500.0), Elastic(stiffness=300.0)),
    "soft springs": (Elastic(stiffness=10.0), Elastic(stiffness=5.0)),
    "Hertz": (Hertz(coefficient=200.0), Hertz(coefficient=100.0)),
    "a table and a spring": (TABLE, Elastic(stiffness=20.0)),
}


def chain(first: CompliantLaw, second: CompliantLaw) -> Scene:
    """Three masses, one between two stops, the two others with a stop between them; theta = 1."""
    return Scene(
        structure=Matrices(
            coordinates=NAMES, mass=MASS.tolist(), damping=DAMPING.tolist(),
            stiffness=STIFFNESS.tolist(),
        ),
        impact_pairs=[
            ImpactPair(name="one", on="a", lower=-0.8, upper=0.9, law=first),
            ImpactPair(name="two", between=["b", "c"], upper=0.7, law=second),
        ],
        excitations=[
            WhiteNoise(on=name, intensity=2.0 * DAMPING[k, k]) for k, name in enumerate(NAMES)
        ],
    )  # fmt: skip


def farthest(known: Response, found: Response) -> float:
    """The largest difference, in standard errors, of what is beyond the stated bias."""
    largest = 0.0
    for key, truth in known.estimates().items():
        now = found.estimates().get(key)
        if now is not None and now.standard_error > 0.0:
            beyond = abs(now.value - truth.value) - (now.bias or 0.0)
            largest = max(largest, beyond / now.standard_error)
    return largest


@pytest.mark.verify
@pytest.mark.parametrize("name", LAWS)
def test_soft_stops_of_several_masses_keep_the_law_of_gibbs(name: str) -> None:
    scene = chain(*LAWS[name])
    found = simulate(scene, rel_error=0.004, seed=3, budget=240.0)
    assert farthest(exact(scene), found) < FARTHEST
    # negative control: stops that are a twentieth stiffer
    first, second = LAWS[name]
    if isinstance(first, Elastic) and isinstance(second, Elastic):
        stiffer = (law.replace(stiffness=1.05 * law.stiffness) for law in (first, second))
        assert farthest(exact(chain(*stiffer)), found) > FARTHEST
