"""Answers agree with those that were recorded before the engine was rewritten."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

import stochvi
from stochvi.sampling.workers import machine
from stochvi.scenes.datasets import zoo_files

HERE = Path(__file__).parent

PUSHES = "what impacts and contacts change is added up in another order, and paths amplify rounding"
CONTACTS = "contacts of several coordinates are integrated in the gaps, not in the modes"
INTERVALS = "the interval of expected impacts holds their bias"
ONE_MASS = "one mass has the records and the engine of structures"
THRESHOLD = "the speed above which impacts count follows one rule of all methods, to rounding here"

OTHER_DIGITS = {
    "simulate modal, paths": PUSHES,
    "simulate filtered, paths": PUSHES,
    "simulate two pairs, paths": PUSHES,
    "simulate sine on random, paths": PUSHES,
    "simulate absorber-lossy, rel_error": PUSHES,
    "absorber": PUSHES,
    "absorber design": PUSHES,
    "impacts, rel_error": PUSHES,
    "bursts": ONE_MASS,
    "first crossings": ONE_MASS,
    "rare hits": ONE_MASS,
    "chance in windows": ONE_MASS,
    "bursts of a structure": PUSHES,
    "reliability of pairs": PUSHES,
    "life times": PUSHES,
    "simulate modal contacts, paths": CONTACTS,
    "reliability crude and splitting": INTERVALS,
    "reliability by crossings": INTERVALS,
    "simulate white lossy, paths": THRESHOLD,
    "simulate white slow impacts, paths": THRESHOLD,
    "simulate lossy-0.5, rel_error": THRESHOLD,
    "impacts, paths": THRESHOLD,
    "cost": THRESHOLD,
    "sweep": THRESHOLD,
}
"""Cases whose digits changed since, with the reason."""

LARGEST_Z = 5.0
"""Standard errors by which one of some thousand numbers may differ."""


def recorder() -> Any:
    spec = importlib.util.spec_from_file_location("record", HERE / "record.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RECORDER = recorder()
DIGITS = json.loads((HERE / "digits.json").read_text(encoding="utf-8"))


def accurate() -> dict[str, dict[tuple[str, str], dict[str, str]]]:
    found: dict[str, dict[tuple[str, str], dict[str, str]]] = defaultdict(dict)
    with (HERE / "accurate.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found[row["scene"]][row["of"], row["quantity"]] = row
    return found


ACCURATE = accurate() if (HERE / "accurate.csv").exists() else {}


COUNTED = {"psd-below-table": 0.0027274895589093845}
"""Slowest impact that was counted, m/s, where the rule has changed since by more than the rate is
known to."""


def farthest(before: dict[str, str], now: dict[str, str]) -> float:
    """Largest distance of an estimate from that before, in standard errors of both."""
    largest = 0.0
    for name, value in before.items():
        error = f"{name.removesuffix('value')}standard_error"
        if not name.endswith("value") or error not in before or error not in now:
            continue
        both = math.hypot(float(before[error]), float(now[error]))
        if both > 0.0:
            largest = max(largest, abs(float(now[name]) - float(value)) / both)
    return largest


@pytest.mark.verify
@pytest.mark.parametrize("case", [name for name in DIGITS if name != "machine"])
def test_a_sampler_gives_the_digits_that_it_gave(case: str) -> None:
    found = RECORDER.digits_of(RECORDER.cases()[case])
    if machine() == DIGITS["machine"] and case not in OTHER_DIGITS:
        assert found["values"] == DIGITS[case]["values"]
        assert found["digest"] == DIGITS[case]["digest"]
    assert farthest(DIGITS[case]["values"], found["values"]) < LARGEST_Z


@pytest.mark.verify
@pytest.mark.parametrize("scene", ACCURATE)
def test_the_zoo_agrees_with_what_was_simulated_for_long(scene: str) -> None:
    found = stochvi.simulate(
        stochvi.load_scene(zoo_files()[scene]), rel_error=0.02, seed=5,
        speed_threshold=COUNTED.get(scene),
    )  # fmt: skip
    for key, row in ACCURATE[scene].items():
        now = found.estimates().get(key)
        if now is None or "None" in (row["bias"], repr(now.bias)):
            continue
        error = math.hypot(now.standard_error, float(row["standard_error"]))
        bias = abs(now.bias or 0.0) + abs(float(row["bias"]))
        assert abs(now.value - float(row["value"])) <= LARGEST_Z * error + bias, key


def test_the_comparison_sees_a_shift() -> None:
    """Negative control: a value that is moved by more than its errors fails."""
    case = next(values["values"] for name, values in DIGITS.items() if name.startswith("simulate"))
    moved = {name: repr(1.5 * float(value)) for name, value in case.items()}
    assert farthest(case, case) == 0.0
    assert farthest(case, moved) > LARGEST_Z
