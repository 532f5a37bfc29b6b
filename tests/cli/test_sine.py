"""`stochvi sine`, `basins` and `bifurcation`: documents, files, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import pytest

from stochvi.scenes.datasets import shipped_scene
from support.commands import Run, one_document, refused

MOUNT = str(shipped_scene("isolator-sine"))
BRANCH_KEYS = {
    "form", "impacts_per_period", "sticking", "periods", "frequency_hz", "displacement_max",
    "impact_speed", "multiplier", "stable", "admissible",
}  # fmt: skip


@pytest.mark.slow
def test_branches_jumps_and_files_of_a_sweep(stochvi: Run, tmp_path: Path) -> None:
    done = stochvi(
        "sine", MOUNT, "--from", "90", "--to", "0.12kHz", "--points", "3", "--sweep", "up",
        "--out", str(tmp_path), "--json", "-", "--quiet",
    )  # fmt: skip
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert document["jumps"].keys() == {"up_hz", "down_hz"}
    assert all(branch.keys() == BRANCH_KEYS for branch in document["branches"])
    free, *others = document["branches"]
    assert free["impacts_per_period"] == 0 and free["impact_speed"] == [[], [], []]
    assert {2} <= {branch["impacts_per_period"] for branch in others}
    for branch in document["branches"]:
        assert len(branch["frequency_hz"]) == len(branch["stable"]) == len(branch["impact_speed"])
    assert (tmp_path / "sine.csv").is_file() and (tmp_path / "sine.png").is_file()


def test_a_key_of_the_scene_takes_the_place_of_the_frequency(stochvi: Run) -> None:
    asked = ("--vary", "impact_pair.0.clearance=0.3mm:0.4mm:2", "--json", "-", "--quiet")
    document = one_document(stochvi("sine", MOUNT, *asked).out)
    assert document["key"] == "impact_pair.0.clearance"
    branch = document["branches"][0]
    assert branch["value"] == pytest.approx([3e-4, 4e-4])
    assert branch["frequency_hz"] == pytest.approx([100.0, 100.0])


def test_the_table_says_what_was_found(stochvi: Run) -> None:
    done = stochvi("sine", MOUNT)
    assert done.code == 0
    assert "branches of periodic regimes" in done.out


def test_a_budget_that_ends_first_is_a_failure_with_what_there_is(stochvi: Run) -> None:
    done = stochvi("sine", MOUNT, "--from", "90", "--to", "120", "--budget", "1e-6")
    assert done.code == 1
    assert "budget" in done.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--from", "20"), "--from and --to must be two rising frequencies"),
        (("--from", "30", "--to", "20"), "--from and --to must be two rising frequencies"),
        (("--from", "20", "--to", "30", "--points", "1"), "--points must be at least 2, got 1"),
        (("--vary", "a=1:2:3", "--from", "1"), "--vary takes the place of --from and --to"),
        (("--coordinate", "y"), "coordinate must be one of x, got 'y'"),
        (("--impacts", "0"), "most_impacts must be at least 1, got 0"),
    ],
)
def test_what_cannot_be_asked_is_refused(
    stochvi: Run, options: tuple[str, ...], words: str
) -> None:
    assert words in refused(stochvi("sine", MOUNT, *options))


STARTS = ("--start", "displacement.x=-0.3mm:0.3mm:3", "--start", "velocity.x=-0.2,0.2")


def follows_the_schema(document: dict[str, Any], stochvi: Run) -> bool:
    """Whether a document is what `stochvi schema answer` says, and says nothing more."""
    valid = jsonschema.Draft202012Validator(one_document(stochvi("schema", "answer").out))
    return valid.is_valid(document) and not valid.is_valid(document | {"no_such_key": 1})


def test_a_map_of_starts_and_its_files(stochvi: Run, tmp_path: Path) -> None:
    asked = (*STARTS, "--out", str(tmp_path), "--json", "-", "--quiet", "--threads", "1")
    done = stochvi("basins", MOUNT, *asked)
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    assert document["plane"] == ["displacement.x", "velocity.x"]
    assert document["across"] == pytest.approx([-3e-4, 0.0, 3e-4])
    assert [len(row) for row in document["ends"]] == [3, 3]
    assert sum(regime["share"] for regime in document["regimes"]) == pytest.approx(1.0)
    assert {"name", "kind", "multiplier", "lyapunov"} <= document["regimes"][0].keys()
    assert (tmp_path / "basins.csv").is_file() and (tmp_path / "basins.png").is_file()


def test_a_diagram_of_impact_speeds_and_its_files(stochvi: Run, tmp_path: Path) -> None:
    done = stochvi(
        "bifurcation", MOUNT, "--from", "100", "--to", "101", "--points", "2", "--sweep", "up",
        "--start", "velocity.x=-0.3m/s", "--out", str(tmp_path), "--json", "-",
    )  # fmt: skip
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    (sweep,) = document["sweeps"]
    assert sweep["value"] == pytest.approx([100.0, 101.0])
    assert [len(speeds) for speeds in sweep["impact_speed"]] == [2 * 128, 2 * 128]
    assert (tmp_path / "bifurcation.csv").is_file() and (tmp_path / "bifurcation.png").is_file()


@pytest.mark.parametrize(
    ("command", "options", "words"),
    [
        ("basins", ("--start", "velocity.x=fast"), "--start must be NAME=FIRST:LAST:NUMBER"),
        ("basins", ("--start", "velocity.x=1"), "plane must be two of displacement.x"),
        ("basins", ("--periods", "0"), "periods must be at least 1, got 0"),
        ("bifurcation", (), "--from and --to, or --vary, must say what is varied"),
        ("bifurcation", ("--from", "1", "--to", "2", "--watched", "3"), "watched at least 64"),
    ],
)
def test_what_cannot_be_started_is_refused(
    stochvi: Run, command: str, options: tuple[str, ...], words: str
) -> None:
    assert words in refused(stochvi(command, MOUNT, *options))


def test_life_times_of_a_scene_with_noise(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "noisy.toml"
    noise = '[[excitation]]\nkind = "white"\non = "base"\nintensity = 0.01\n'
    scene.write_text(Path(MOUNT).read_text(encoding="utf-8") + noise, encoding="utf-8")
    asked = ("--regime", "no impacts", "--rel-error", "0.4", "--threads", "1")
    out = tmp_path / "out"
    done = stochvi("lifetimes", str(scene), *asked, "--out", str(out), "--json", "-", "--quiet")
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    (regime,) = document["regimes"]
    assert regime["regime"] == "no impacts" and regime["left"] >= 7
    assert regime["life_time_low"] < regime["life_time"] < regime["life_time_high"]
    assert regime["destinations"][0]["regime"] == "stops lower, stops upper"
    assert (out / "lifetimes.csv").is_file() and (out / "lifetimes.png").is_file()
    assert "noise besides the sine" in refused(stochvi("lifetimes", MOUNT))


def test_new_writes_a_hammer_that_sine_and_impacts_take(tmp_path: Path, stochvi: Run) -> None:
    file = str(tmp_path / "breaker.toml")
    assert stochvi("new", file, "--kind", "hammer").code == 0
    found = one_document(stochvi("sine", file, "--impacts", "1", "--json", "-").out)
    # momentum: blows per second times their speed are feed / ((1 + R) m)
    stable = [
        speeds[0]
        for branch in found["branches"]
        if branch["impacts_per_period"] == branch["periods"] == 1
        for speeds, good in zip(branch["impact_speed"], branch["stable"], strict=True)
        if good
    ]
    assert stable == pytest.approx([100.0 / 1.3 / 12.0], rel=1e-9)
    blows = one_document(
        stochvi("impacts", file, "--paths", "16", "--duration", "20", "--json", "-").out
    )
    tool = blows["impact_pairs"]["tool"]
    lost = tool["energy"]["value"] / tool["striking_energy"]["value"]
    assert lost == pytest.approx(1.0 - 0.3**2)
    assert tool["striking_energy"]["value"] == pytest.approx(tool["speed_rms"]["value"] ** 2 / 2.0)
