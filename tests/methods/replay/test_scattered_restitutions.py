"""A restitution that scatters, in a replay: drawn by the seed and the number of the impact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stochvi import ImpactPair, Isolator, RecordedNoise, Restitution, Scene, replay
from stochvi.engine.laws.scattered_restitution import CELLS
from stochvi.methods.replay import Replay
from support import naive

WIDE = {"mean": 0.5, "std": 0.25}


@pytest.fixture
def pushed(tmp_path: Path) -> Any:
    """A mount that a push of 20 ms throws onto its stops."""
    file = tmp_path / "push.txt"
    np.savetxt(file, np.where(np.arange(300) < 20, 1.0, 0.0))

    def scene(coefficient: Any) -> Scene:
        return Scene(
            structure=Isolator(frequency_hz=2.0, zeta=0.01),
            impact_pairs=[
                ImpactPair(lower=-0.004, upper=0.004, law=Restitution(coefficient=coefficient))
            ],
            excitations=[RecordedNoise(file=str(file), unit="g", fs=1000.0)],
        )

    return scene


def velocity_after(found: Replay) -> float:
    """Velocity at the sample after the first impact, which is linear in its restitution."""
    table = found.histories.to_frame()
    return float(table["velocity"][table["time"] > found.impacts["time"][0]].iloc[0])


@pytest.mark.parametrize("seed", [0, 1, 2, 77])
def test_the_first_restitution_is_that_of_the_plain_twin(pushed: Any, seed: int) -> None:
    low, high = (velocity_after(replay(pushed(r))) for r in (0.0001, 0.9))
    found = replay(pushed(WIDE), seed=seed)
    share = (velocity_after(found) - low) / (high - low)
    law = Restitution(coefficient=WIDE).scatter
    assert law is not None
    middles, widths = law.cells(CELLS)
    place = naive.uniform(seed, 0) * CELLS
    cell = int(place)
    drawn = float(middles[cell] + widths[cell] * (place - cell - 0.5))
    assert 0.0001 + share * (0.9 - 0.0001) == pytest.approx(drawn, rel=1e-6)


def test_a_seed_is_a_realisation(pushed: Any) -> None:
    one, again, other = (replay(pushed(WIDE), seed=seed) for seed in (3, 3, 4))
    assert one.impacts.equals(again.impacts) and not one.impacts.equals(other.impacts)
    assert one.provenance["seed"] == 3
    assert any("seed 3" in each for each in one.assumptions)
    with pytest.raises(ValueError, match=r"seed must be in \[0, 2\^63\), got -1"):
        replay(pushed(WIDE), seed=-1)


def test_without_scatter_it_is_the_plain_replay(pushed: Any) -> None:
    plain, still = (replay(pushed(r), seed=5) for r in (0.5, {"mean": 0.5, "std": 0.0}))
    assert plain.impacts.equals(still.impacts)
    assert plain.provenance["seed"] is still.provenance["seed"] is None
