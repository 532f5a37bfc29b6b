"""Pages of reliabilities and replays: verdict first, then the numbers and where they come from."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import pytest

from support.commands import Run

MOUNT = """
title = "a box"
[structure]
kind = "isolator"
mass = 2.0
frequency_hz = 12.0
Q = 5.0
[[impact_pair]]
clearance = 0.002
law = { kind = "restitution", coefficient = 0.5 }
[[excitation]]
"""


def page_in(folder: Path) -> str:
    return (folder / "report.html").read_text("utf-8").replace("\u00a0", " ")


@pytest.mark.usefixtures("blank_pictures")
def test_a_replay_has_a_page_that_names_its_record(stochvi: Run, tmp_path: Path) -> None:
    scene, record = tmp_path / "box.toml", tmp_path / "record.csv"
    lines = [f"{n / 500:.3f},{9.0 * math.sin(75.0 * n / 500):.5f}" for n in range(1500)]
    record.write_text("time (s),a (m/s2)\n" + "\n".join(lines) + "\n")
    scene.write_text(MOUNT + 'kind = "record"\nfile = "record.csv"\nunit = "m/s2"\n')
    out = tmp_path / "out"
    assert stochvi("replay", scene, "--out", out, "--quiet").code == 0
    text, document = page_in(out), json.loads((out / "replay.json").read_text("utf-8"))
    for file in (scene, record):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    pair = document["impact_pairs"]["stops"]
    assert pair["hits"]["value"] > 5.0
    assert f"{pair['hits']['value']:.0f} impacts on stops" in text
    assert (
        text.index("impacts on stops") < text.index("Motion and impacts") < text.index("Approved")
    )
    for field in ("Customer", "Laboratory", "Project", "Report no.", "Date"):
        assert f">{field}</th>" in text
    assert 'class="verdict alarm"' in text  # it touches its stops
    assert "Clearance of &#39;stops&#39;, lower" in text and "2.000 mm" in text
    assert "Natural frequency" in text and "damping ratio 0.1" in text
    # the same question may be asked again, another one not
    assert stochvi("replay", scene, "--out", out, "--quiet").code == 0
    asked = ("replay", scene, "--clearances", "1mm,3mm", "--out", out, "--quiet")
    assert stochvi(*asked).code == 2
    assert stochvi(*asked, "--force").code == 0
    text = page_in(out)
    assert "at 1.000 mm" in text and "at 3.000 mm" in text
    # farther than the motion reaches there is no impact, and no alarm
    far = ("replay", scene, "--clearances", "30mm", "--out", out, "--quiet", "--force")
    assert stochvi(*far).code == 0
    quiet = page_in(out)
    assert "no impact on stops" in quiet or "impacts 0 at 30 mm" in quiet
    assert 'class="verdict alarm"' not in quiet and "largest impact speed (m/s)" not in quiet
    # what the record needs comes first, then the impacts at each clearance
    assert (
        text.index("The record itself needs") < text.index(": impacts ") < text.index("Motion and")
    )


@pytest.mark.usefixtures("blank_pictures")
def test_a_reliability_has_a_page_with_its_chances(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "box.toml"
    scene.write_text(MOUNT + 'kind = "white"\ndensity = 0.002\nunit = "g2/Hz"\n')
    out = tmp_path / "out"
    done = stochvi(
        "reliability", scene, "--mission", "60", "--impact-speed", "0.1", "--rel-error", "0.2",
        "--threads", "1", "--budget", "10", "--out", out, "--quiet",
    )  # fmt: skip
    assert done.code in (0, 1)
    text, document = page_in(out), json.loads((out / "reliability.json").read_text("utf-8"))
    assert document["report"]["command"].startswith("stochvi reliability")
    for name, words in (("hit", "any impact"), ("impact_speed", "an impact faster than 0.1 m/s")):
        chance = document["chances"][name]["estimate"]["value"]
        assert chance > 0.0
        assert f"{words}: " in text[text.index('class="verdict') : text.index("<dl")]
    assert "Expected impacts in 1 min" in text


@pytest.mark.parametrize("command", ["replay", "reliability"])
def test_a_page_that_is_not_ours_is_kept(stochvi: Run, tmp_path: Path, command: str) -> None:
    scene = tmp_path / "box.toml"
    scene.write_text(MOUNT + 'kind = "white"\ndensity = 0.002\nunit = "g2/Hz"\n')
    (tmp_path / "report.html").write_text("mine")
    mission = ("--mission", "60") if command == "reliability" else ()
    done = stochvi(command, scene, *mission, "--out", tmp_path)
    assert done.code == 2 and "--force" in done.err
    assert (tmp_path / "report.html").read_text() == "mine"
