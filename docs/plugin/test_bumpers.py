"""The parts, as a user meets them: by their names alone."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stochvi
from stochvi.testing import assert_agrees

SCENE = """
[structure]
kind = "oscillator"
mass = 2.0
damping = 0.4
stiffness = 200.0
[[impact_pair]]
clearance = 0.01
law = {{ kind = "hardening", stiffness = 2000.0, cubic_stiffness = 1e7 }}
[[excitation]]
{excitation}
"""


def scene(folder: Path, excitation: str) -> Path:
    file = folder / "scene.toml"
    file.write_text(SCENE.format(excitation=excitation))
    return file


def command(*words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "stochvi", *words], check=True, capture_output=True, text=True
    )
    return done.stdout


def test_the_law_agrees_with_the_closed_form_and_with_the_balance_of_energy(tmp_path) -> None:
    loaded = stochvi.load_scene(scene(tmp_path, 'kind = "white"\nintensity = 0.02'))
    law = loaded.impact_pairs[0].law
    contact = law.impact(1.0, 2.0)
    assert law.potential_at(contact.peak_deflection) == pytest.approx(1.0, rel=1e-6)
    truth = stochvi.exact(loaded).coordinates["x"].displacement_mean_square.value
    found = stochvi.simulate(loaded, rel_error=0.03, seed=1)
    assert_agrees(found.coordinates["x"].displacement_mean_square, truth)
    assert "'hardening' is a part of stochvi-bumpers 0.1" in " ".join(found.assumptions)


def test_the_profile_is_found_and_has_its_stated_level() -> None:
    profile = stochvi.scenes.profiles()["flat-example"]
    noise = stochvi.TabulatedNoise(profile="flat-example")
    level = np.sqrt(noise.table.mean_square()) / 9.80665
    assert level == pytest.approx(profile.stated_g_rms, rel=1e-3)
    assert "flat-example" in command("profiles")


def test_the_record_is_read_with_the_units_of_its_headings(tmp_path) -> None:
    times, values = np.arange(1000) / 1000.0, np.sin(np.arange(1000) * 0.3)
    with (tmp_path / "run.f32").open("wb") as file:
        file.write(json.dumps(["time (s)", "Z (g)"]).encode() + b"\n")
        np.column_stack([times, values]).astype("<f4").tofile(file)
    record, columns = stochvi.scenes.read_record(tmp_path / "run.f32")
    assert record.fs == pytest.approx(1000.0, rel=1e-4) and columns.unit.name == "g"
    assert record.values + record.mean == pytest.approx(values, abs=1e-6)


def test_the_command_is_listed_and_runs(tmp_path) -> None:
    assert "drop" in command("--help")
    told = command("drop", str(scene(tmp_path, 'kind = "white"\nintensity = 0.02')))
    assert told.splitlines()[0].startswith("stops lower:")
