"""Stated error of the closure of a structure, against simulations of random structures."""

from __future__ import annotations

import csv
import importlib

import pytest
from scipy.stats import binom

from stochvi import Elastic, ImpactPair, Restitution, Scene, WhiteNoise, linearise
from stochvi.methods.linearisation import structure_bounds
from stochvi.model.model import model_of
from stochvi.scenes import Hertz
from stochvi.scenes.structures import Modes
from support import CHECKOUT
from support.accuracies import quick_cases

random_structure = importlib.import_module(
    "studies.32_linearised_structures.cases"
).random_structure

CALIBRATED = 200
"""Structures with smaller numbers were used to choose the factors of the bounds."""

PROMISED = 0.99


def simulated() -> dict[int, list[tuple[str, str, float]]]:
    """Values by the number of a structure: owner, quantity, simulated value."""
    found: dict[int, list[tuple[str, str, float]]] = {}
    place = CHECKOUT / "data" / "linearisation_atlas" / "structures.csv"
    with place.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            # a stated bias above 10 % says that the simulation knows no better
            if row["bias"] and float(row["bias"]) < 0.1 * float(row["value"]):
                entry = row["owner"], row["quantity"], float(row["value"])
                found.setdefault(int(row["number"]), []).append(entry)
    return found


@quick_cases("step", [20, 1], keep={0})
def test_bounds_hold_on_structures_that_were_not_used_to_choose_them(step: int) -> None:
    known, count, misses, halved = simulated(), 0, 0, 0
    for number in range(CALIBRATED, 400, step):
        found = linearise(random_structure(number)).estimates()
        for owner, quantity, value in known[number]:
            estimate = found[owner, quantity]
            if estimate.bias is not None:
                count += 1
                misses += abs(estimate.value - value) > estimate.bias
                halved += abs(estimate.value - value) > estimate.bias / 8.0
    assert count > 50
    # misses of one structure go together, which the factor of 2 allows for
    most = 2.0 * binom.ppf(0.999, count, 1.0 - PROMISED)
    assert misses <= most
    # an eighth of the bounds is too little, and that is noticed
    assert halved > most


def two_modes(**changes: object) -> Scene:
    pair: dict[str, object] = {"on": "tip", "upper": 0.01, "law": Restitution(coefficient=0.7)}
    structure = {
        "frequency_hz": [10.0, 17.0], "zeta": 0.02, "modal_mass": 1.0,
        "shapes": {"tip": [1.0, 0.6], "seat": [0.5, -1.0]},
    }  # fmt: skip
    pair |= {key: value for key, value in changes.items() if key in {"upper", "law"}}
    structure |= {key: value for key, value in changes.items() if key in structure}
    return Scene(
        structure=Modes(**structure),
        impact_pairs=[ImpactPair(**pair)],
        excitations=[WhiteNoise(on="tip", intensity=1.0)],
    )


def test_a_structure_like_those_has_a_bound() -> None:
    answer = linearise(two_modes())
    rate = answer.impact_pairs["stops"].collision_rate
    assert rate.bias is not None and 0.0 < rate.bias < rate.value
    assert "error bound from random structures" in rate.how
    assert answer.impact_pairs["stops"].impact_speed_mean.bias is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"zeta": 0.3}, "damping ratios"),
        ({"upper": 1.0}, "deviations of their gap"),
        ({"law": Restitution(coefficient=0.2)}, "rigid stops of R"),
        ({"law": Elastic(stiffness=100.0)}, "as stiff as the structure"),
        ({"law": Hertz(coefficient=1e7)}, "rigid stops of R"),
    ],
)
def test_other_structures_have_none_and_say_why(changes: dict[str, object], words: str) -> None:
    entry = linearise(two_modes(**changes)).coordinates["tip"].displacement_std
    assert entry.bias is None
    assert "no error bound" in entry.how and words in entry.how


def test_gaps_that_move_together_have_none() -> None:
    scene = two_modes()
    other = ImpactPair(name="other", on="tip", upper=0.012, law=Restitution(coefficient=0.7))
    both = scene.model_copy(update={"impact_pairs": [*scene.impact_pairs, other]})
    assert "move together" in structure_bounds.outside(model_of(both))
    apart = other.model_copy(update={"on": "seat"})
    alone = scene.model_copy(update={"impact_pairs": [*scene.impact_pairs, apart]})
    assert structure_bounds.outside(model_of(alone)) == ""
