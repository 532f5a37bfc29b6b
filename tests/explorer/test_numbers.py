"""Numbers of the page are those of the command line, for random settings of three scenes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stochvi.explorer.knobs import PRESETS, Setting, chosen, design_of, knobs_of, questions_of
from stochvi.explorer.takeaways import toml_of
from stochvi.explorer.turns import FEW_PATHS, Turn
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from support.commands import Run

TRUCK = load_scene(shipped_scene("isolator-truck"))
CHOICES: list[dict[str, Any]] = [
    {"preset": "box on a truck"},
    {"law": "viscoelastic", "psd": "frequency_hz,density_g2_per_hz\n5,0.01\n60,0.02\n500,0.001\n"},
    {"preset": "box on four mounts"},
]
NUMBER = 20


def setting_of(number: int) -> Setting:
    """One of the random settings; knobs stand in the middle halves of their ranges."""
    choice = CHOICES[number % len(CHOICES)]
    scene, values, rng = chosen(TRUCK, Setting({}, **choice)), {}, np.random.default_rng(number)
    for knob in [*knobs_of(scene), *questions_of(scene)]:
        if knob.group == "tolerances":
            continue
        u = float(rng.uniform(0.25, 0.75))
        low, high = np.log((knob.low, knob.high)) if knob.logarithmic else (knob.low, knob.high)
        place = low + u * (high - low)
        values[knob.key] = float(np.exp(place) if knob.logarithmic else place)
    return Setting(values, **choice)


@pytest.mark.parametrize(
    "number", [0, 1, *(pytest.param(k, marks=pytest.mark.verify) for k in range(2, NUMBER))]
)
@pytest.mark.slow
def test_numbers_shown_are_those_of_the_command_line(
    number: int, stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    design = design_of(TRUCK, setting_of(number))
    document = design.scene.document(as_written=True)
    Path("design.toml").write_text(toml_of(document), encoding="utf-8")
    turn = Turn(design, 5, 1)

    def told(command: str, *words: str) -> Any:
        return json.loads(stochvi(command, "design.toml", *words, "--json", "-").out)

    shown = {each["name"]: each for each in turn.linear()["numbers"]}
    gaps = told("screen")["impact_pairs"]
    several = len(gaps) > 1
    for name, gap in gaps.items():
        words = f" of {name}" if several else ""
        assert shown[f"rms displacement{words}"]["value"] == gap["displacement_std"]
        assert shown[f"usual rule: impact rate by Rice{words}"]["value"] == gap["rice_rate"]

    rates = {each["name"]: each for each in turn.rate()["numbers"]}
    pairs = told("simulate", "--paths", str(FEW_PATHS), "--seed", "5")["impact_pairs"]
    for name, pair in pairs.items():
        words = f" of {name}" if several else ""
        shown_rate = rates[f"simulated impact rate{words}"]
        assert shown_rate["value"] == pair["collision_rate"]["value"]

    question = ["--probability", repr(design.probability), "--mission", repr(design.mission)]
    sized = told("size", *question, "--seed", "5")
    needed = {each["name"]: each for each in turn.risk()["numbers"]}
    clearances = sized["clearances"] if several else {"": sized["clearance"]}
    for name, each in clearances.items():
        found = needed[f"required clearance of {name}" if several else "required clearance"]
        assert (found["value"], found["low"], found["high"]) == (
            each["value"], each["lower"], each["upper"],
        )  # fmt: skip


def test_the_settings_are_of_three_scenes() -> None:
    titles = {design_of(TRUCK, setting_of(number)).scene.structure.kind for number in range(3)}
    assert titles == {"isolator", "rigid-body"}
    assert {*CHOICES[0].values(), *CHOICES[2].values()} <= {*PRESETS}


def test_clearances_count_from_where_the_mass_hangs() -> None:
    """The curve of the page, at the nearer stop of a mount under gravity, is not safer than its
    sentence, which knows both stops."""
    structure = TRUCK.structure.replace(gravity=True)
    (pair,) = TRUCK.impact_pairs
    stops = pair.replace(clearance=0.012)
    hanging = TRUCK.replace(structure=structure, impact_pairs=[stops])
    turn = Turn(design_of(hanging, Setting({})), 5, 1)
    rest = turn.linear()["rest"]
    assert rest == pytest.approx(-9.80665 / (2.0 * np.pi * 12.0) ** 2, rel=1e-6)
    risk = turn.risk()
    curve = risk["curve"]
    nearer = 0.012 - abs(rest)
    there = np.interp(nearer, curve["clearance"], np.log(curve["probability"]))
    said = float(
        next(line for line in risk["lines"] if "Your stops" in line).split(": ")[1].split()[0]
    )
    assert 0.5 * np.exp(there) < said / 100.0 < np.exp(there)
    assert not risk["doubted"]


def test_a_record_that_is_not_gaussian_noise_makes_the_page_doubt_its_numbers() -> None:
    potholes = load_scene(shipped_scene("isolator-potholes"))
    found = Turn(design_of(potholes, Setting({})), 5, 1).risk()
    assert found["doubted"] and found["sentence"].startswith("Do not size by the spectrum")
    assert all(each.startswith("For Gaussian noise. ") for each in found["lines"])


def test_motions_under_a_sine_are_told_by_how_far_they_reach() -> None:
    sine = load_scene(shipped_scene("isolator-sine"))
    sentence = Turn(design_of(sine, Setting({})), 5, 1).branches()["sentence"]
    assert sentence == "Stable motions at 100 Hz reach 0.101 mm, 0.4 mm."
