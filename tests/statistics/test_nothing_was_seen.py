"""Where no impact was seen an answer states an upper limit, never 0 with an error of 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from stochvi import (
    ImpactPair,
    NotConverged,
    Oscillator,
    Scene,
    WhiteNoise,
    exact,
    impacts,
    reliability,
    simulate,
)
from stochvi.results.base import Result
from stochvi.scenes.impact_laws import Restitution, Viscoelastic
from support.commands import Run


def far(law: Any, clearance: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.5, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-clearance, upper=clearance, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def certain_zeros(document: Any, place: str = "") -> Iterator[str]:
    """Places of estimates that say 0 +- 0 of what was sampled."""
    if isinstance(document, dict):
        if {"value", "standard_error"} <= set(document):
            seen = document["value"] != 0.0 or document["standard_error"] != 0.0
            if not seen and document.get("upper_95") is None:
                yield place
            return
        for key, each in document.items():
            yield from certain_zeros(each, f"{place}.{key}")


def of_missions(scene: Scene) -> Result:
    with pytest.raises(NotConverged) as found:
        reliability(scene, mission=50.0, budget=2.0)
    assert found.value.partial is not None
    return found.value.partial


ASKED: dict[str, Callable[[Scene], Result]] = {
    "simulate": lambda scene: simulate(scene, paths=128, duration=100.0),
    "impacts": lambda scene: impacts(scene, paths=128, duration=100.0),
    "reliability": of_missions,
}
LAWS = {
    "rigid": Restitution(coefficient=0.5),
    "giving way": Viscoelastic(stiffness=100.0, damping_ratio=0.2),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ASKED)
def test_no_answer_is_certain_of_what_it_did_not_see(name: str, law: str) -> None:
    assert list(certain_zeros(ASKED[name](far(LAWS[law], 12.0)).to_dict())) == []


def test_limits_of_the_sums_of_speeds_hold() -> None:
    """Four paths that see nothing of 1.1 expected impacts."""
    scene = far(Restitution(coefficient=1.0), 1.75)
    known = exact(scene).impact_pairs["stops"]
    found = simulate(scene, paths=4, duration=0.28 / known.collision_rate.value, seed=3)
    stops = found.impact_pairs["stops"]
    assert stops.collision_rate.value == 0.0
    for name in ("collision_rate", "impact_speed_rate", "impact_speed_square_rate"):
        limit, truth = stops[name].upper_95, known[name].value
        assert limit is not None and truth < limit < 50.0 * truth


def test_damage_without_an_impact_names_no_ratio(stochvi: Run, tmp_path: Path) -> None:
    """What was not seen is not in the damage: no sentence compares it; the exit code is 1."""
    file = tmp_path / "far.toml"
    file.write_text(
        """
        [structure]
        kind = "isolator"
        frequency_hz = 12.0
        zeta = 0.1
        mass = 1.0
        [[impact_pair]]
        clearance = 0.1
        law = { kind = "viscoelastic", stiffness = 2e5, damping_ratio = 0.11 }
        [[excitation]]
        kind = "psd"
        profile = "mil-std-810h-truck-vertical-5hz"
        """
    )
    asked = ("--mission", "60", "--equipment", "40:80:2", "--rel-error", "0.5")
    ended = stochvi("damage", file, *asked, "--way", "simulation", "--out", tmp_path / "out")
    assert ended.code == 1 and "no impact was seen" in ended.err and "ask reliability" in ended.err
    assert "No artists" not in ended.err
    assert "multiply the damage" not in ended.out and "impacts bring" not in ended.out
    assert "impacts at most" in ended.out and "times the damage" not in ended.out
