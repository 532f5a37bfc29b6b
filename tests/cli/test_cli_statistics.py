"""`stochvi spectrum`, `impacts` and `history`: exit codes, the JSON document, the files."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import jsonschema
import pandas as pd
import pytest
from PIL import Image

from stochvi.scenes.datasets import shipped_scene
from support.accuracies import quick_cases
from support.commands import ELASTIC, ISOLATOR, Run, one_document, refused
from support.known import DOCUMENT, changed, to_toml
from support.refusals import refusals

IMPACTS, SPECTRUM = ("impacts", "--paths", "64"), ("spectrum", "--paths", "4")
COMMANDS = [IMPACTS, SPECTRUM]
FILES = {
    "impacts": {"impacts.csv", "histograms.csv", "impacts.png"},
    "spectrum": {"spectrum.csv", "spectrum.png"},
}
SHORT = "the accuracy asked for was not reached"


@pytest.fixture
def never_hit(tmp_path: Path) -> Path:
    """A scene whose stops stand 20 standard deviations away."""
    far = changed(["impact_pair", 0, "lower"], -20.0)
    far["impact_pair"][0]["upper"] = 20.0
    path = tmp_path / "far.toml"
    path.write_text(to_toml(far), encoding="utf-8")
    return path


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
@quick_cases("scene", [ELASTIC, ISOLATOR], ids=["white", "tabulated"], keep=(0,))
def test_an_answer_is_a_document_and_files(
    stochvi: Run, tmp_path: Path, command: tuple[str, ...], scene: str
) -> None:  # fmt: skip
    name, *options = command
    code, out, err = stochvi(
        name, scene, *options, "--threads", "1", "--json", "-", "--out", tmp_path
    )
    assert code == 0 and "paths" in err
    document = one_document(out)
    assert document["method"].startswith(name)
    assert document["cost"]["paths"] == int(options[1])
    assert SHORT not in document["warnings"]
    assert {path.name for path in tmp_path.iterdir()} == FILES[name]
    table = pd.read_csv(tmp_path / f"{name}.csv")
    assert len(table) > 2 and table["value"].notna().all()
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000


@quick_cases("command", COMMANDS, ids=lambda words: words[0], keep=(0,))
@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (("--rel-error", "1e-5"), "relative standard error"),
        (("--paths", "1000000"), "of 1000000 paths; raise --budget"),
    ],
    ids=["error", "paths"],
)
def test_beyond_the_budget_it_exits_with_1_and_still_writes_what_it_has(
    stochvi: Run, tmp_path: Path, command, asked, sentence
) -> None:  # fmt: skip
    name, options = command[0], ("--budget", "0.01", "--threads", "1", "--quiet")
    code, out, err = stochvi(name, ELASTIC, *asked, *options, "--json", "-", "--out", tmp_path)
    assert code == 1
    assert sentence in err and len(err.splitlines()) == 1
    document = one_document(out)
    assert document["warnings"][0] == SHORT
    assert document["cost"]["paths"] > 1
    assert {path.name for path in tmp_path.iterdir()} == FILES[name]


def test_stops_that_are_never_hit_are_said(
    stochvi: Run, never_hit: Path, tmp_path: Path
) -> None:  # fmt: skip
    options = ("--threads", "1", "--json", "-", "--out", tmp_path / "out")
    code, out, err = stochvi("impacts", never_hit, "--budget", "0.01", *options)
    assert code == 1
    assert "division" not in err and "no impact was seen in" in err
    document = one_document(out)
    assert any("upper limit only" in each for each in document["warnings"])
    code, out, _ = stochvi("impacts", never_hit, "--paths", "64", *options)
    assert code == 0
    pair = one_document(out)["impact_pairs"]["stops"]
    assert pair["rates"]["both"]["estimate"]["value"] == 0.0
    assert pair["rates"]["both"]["upper"] > 0.0 and pair["speeds"] is None
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES["impacts"] - {
        "impacts.png"
    }


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--paths", "8", "--rel-error", "0.1"), "give --rel-error or --paths, not both"),
        (("--paths", "1"), "paths must be at least 2 for a standard error, got 1"),
        (("--rel-error", "nan"), "--rel-error must be in [1e-6, 1), got nan"),
        (("--seed", "-1"), "seed must be in [0, 2^63), got -1"),
        (("--threads", "0"), "threads must be at least 1, got 0"),
        (("--budget", "0"), "budget must be a positive number of seconds, got 0.0"),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("command", ["impacts", "spectrum"])
def test_an_option_out_of_range_is_one_sentence(
    stochvi: Run, command: str, arguments, sentence: str
) -> None:  # fmt: skip
    assert refused(stochvi(command, ELASTIC, *arguments)) == sentence


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("impacts", "--duration", "0"), "duration must be a positive number of seconds"),
        (("impacts", "--speed-threshold", "-1"), "--speed-threshold must be at least 0"),
        (("spectrum", "--highest", "0"), "highest must be a positive number"),
        (("spectrum", "--segment", "nan"), "--segment must be a number"),
        (("spectrum", "--segment", "1e-3"), "segment must be at least"),
    ],
    ids=lambda words: " ".join(words) if isinstance(words, tuple) else "",
)
def test_an_option_of_one_command_out_of_range_is_one_sentence(
    stochvi: Run, arguments, sentence: str
) -> None:  # fmt: skip
    command, *options = arguments
    assert refused(stochvi(command, ELASTIC, *options)).startswith(sentence)


def test_quiet_is_silent_and_a_scene_without_stops_has_no_impacts(
    stochvi: Run, tmp_path: Path
) -> None:  # fmt: skip
    path = tmp_path / "free.toml"
    free = {key: value for key, value in DOCUMENT.items() if key != "impact_pair"}
    path.write_text(to_toml(free), encoding="utf-8")
    assert refused(stochvi("impacts", path)).startswith("impacts does not apply")
    options = ("--threads", "1", "--quiet")
    assert stochvi("spectrum", ELASTIC, *SPECTRUM[1:], *options) == (0, "", "")
    assert stochvi("impacts", ELASTIC, *IMPACTS[1:], *options) == (0, "", "")


def test_impacts_of_a_mission_are_the_rate_times_its_time(stochvi: Run, tmp_path: Path) -> None:
    asked = ("impacts", ELASTIC, *IMPACTS[1:], "--mission", "2h")
    told = stochvi(*asked, "--out", tmp_path).out
    table = pd.read_csv(tmp_path / "impacts.csv").set_index("quantity")
    stated = one_document(stochvi(*asked, "--json", "-").out)["impact_pairs"]["stops"]
    for quantity, key in (("rms impact speed", "speed_rms"), ("energy lost per impact", "energy")):
        row = table.loc[quantity, ["value", "standard_error", "bias"]].to_list()
        assert row == [stated[key][name] for name in ("value", "standard_error", "bias")]
    row = 7200.0 * table.loc["rate, both", ["value", "lower", "upper"]].astype(float)
    said = "{:.4g} ({:.4g} to {:.4g}) impacts in 2 h".format(*row)
    assert said in told
    assert " impacts in " not in stochvi("impacts", ELASTIC, *IMPACTS[1:]).out


def test_a_history_is_a_document_tables_a_picture_and_an_animation(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stochvi.views.density.FRAMES", 20)
    asked = ("history", ELASTIC, "--duration", "0.2min", "--path", "2", "--json", "-")
    code, out, err = stochvi(*asked, "--out", tmp_path, "--animate")
    assert code == 0 and "path 2 of seed 0" in err
    document = one_document(out)
    assert document["method"].startswith("history:") and document["duration"] == 12.0
    samples = pd.read_csv(tmp_path / "history.csv")
    assert list(samples) == document["columns"] and len(samples) == document["samples"]
    assert samples["displacement_m"].max() == document["coordinates"]["x"]["displacement_max"]
    impacts = pd.read_csv(tmp_path / "impacts.csv")
    assert len(impacts) == document["impact_pairs"]["stops"]["hits"]
    assert (tmp_path / "history.png").stat().st_size > 10_000
    with Image.open(tmp_path / "history.gif") as film:
        assert 10 < film.n_frames <= 20
    parquet = tmp_path / "history.parquet"
    assert parquet.exists() == (importlib.util.find_spec("pyarrow") is not None)


test_a_history_that_cannot_be_made_is_refused = refusals(
    lambda stochvi, words: stochvi("history", ELASTIC, *words),
    (("--duration", "10s", "--animate"), "--out"),
    (("--duration", "ten"), "--duration must be a number with a unit of time"),
    (("--duration", "5 parsecs"), "(s, ms, min, h;"),
    (("--duration", "-1"), "duration must be a positive number"),
)


TWO_PAIRS = """
[structure]
kind = "matrices"
coordinates = ["a", "b"]
mass = [[2.0, 0.0], [0.0, 1.0]]
damping = [[6.0, -2.0], [-2.0, 3.0]]
stiffness = [[4000.0, -1500.0], [-1500.0, 1500.0]]
[[impact_pair]]
name = "wall"
on = "a"
lower = -0.06
upper = 0.06
law = { kind = "restitution", coefficient = 0.4 }
[[impact_pair]]
name = "between"
between = ["b", "a"]
lower = -0.06
upper = 0.06
law = { kind = "restitution", coefficient = 0.4 }
[[excitation]]
kind = "white"
on = "b"
intensity = 30.0
"""


@pytest.mark.slow
def test_reliability_of_several_pairs_says_what_each_risks(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "two.toml"
    scene.write_text(TWO_PAIRS)
    done = stochvi(
        "reliability", scene, "--mission", "10", "--rel-error", "0.2", "--budget", "600",
        "--json", "-", "--out", tmp_path / "out", "-v",
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert set(document["pairs"]) == {"wall", "between"}
    hits = document["expected_hits"]
    assert hits["value"] > 10.0 * hits["standard_error"] > 0.0
    assert "probability alone" in done.err
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Pair by pair" in page
    wrong = stochvi("reliability", scene, "--mission", "10", "--pair", "roof")
    assert wrong.code == 2 and "pair must be one of wall, between" in wrong.err


def test_damage_is_a_document_of_lists_and_files(stochvi: Run, tmp_path: Path) -> None:
    scene = ISOLATOR
    ask = ["damage", scene, "--mission", "1h", "--equipment", "20:200:5", "--q", "10"]
    more = ["--exponent", "6", "--rel-error", "0.5", "--json", "-", "--out", tmp_path, "-v"]
    code, out, err = stochvi(*ask, *more)
    assert code == 0 and "times the damage" in err
    document = one_document(out)
    assert document["method"] == "damage:simulation"
    for part in (document, document["without_stops"]):
        for name in ("response_rms", "extreme_response", "fatigue_damage"):
            assert len(part[name]) == len(part[f"{name}_bias"]) == 5
            assert all(value > 0.0 for value in part[name])
    assert document["equipment_frequency_hz"][-1] == pytest.approx(200.0)
    assert {path.name for path in tmp_path.iterdir()} == {"damage.csv", "damage.png"}
    assert len(pd.read_csv(tmp_path / "damage.csv")) == 5


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--equipment", "200:20"], "--equipment must be LOW:HIGH or LOW:HIGH:NUMBER"),
        (["--equipment", "20"], "--equipment must be LOW:HIGH or LOW:HIGH:NUMBER"),
        (["--levels", "fast"], "--levels must be numbers with commas"),
        (["--at", "roof"], "at must be a coordinate or point of the scene ('x'), got 'roof'"),
    ],
)
def test_damage_refuses_what_makes_no_sense(stochvi: Run, words: list[str], sentence: str) -> None:
    code, _, err = stochvi("damage", ISOLATOR, "--mission", "60", *words)
    assert code == 2 and sentence in err


def test_the_growth_of_a_modulated_motion_needs_no_option(stochvi: Run, tmp_path: Path) -> None:
    noise = {"kind": "modulation", "of": "stiffness", "intensity": 0.02}
    modulated = {**DOCUMENT, "excitation": [*DOCUMENT["excitation"], noise]}
    path = tmp_path / "modulated.toml"
    path.write_text(to_toml(modulated), encoding="utf-8")
    code, out, _ = stochvi("growth", path, "--json", "-", "--out", tmp_path)
    exponent = one_document(out)["lyapunov_exponent"]
    assert code == 0 and exponent["value"] < 0.0
    assert exponent["standard_error"] <= 0.02 * abs(exponent["value"])
    assert (tmp_path / "stability.png").stat().st_size > 10_000


# ------------------------------------------------------------------------------
# `stochvi identify`: documents, files, and what it refuses.
# ------------------------------------------------------------------------------


SPEEDS = "approach (m/s),rebound (m/s)\n0.5,0.36\n1.0,0.69\n1.5,1.06\n2.0,1.39\n"


def test_a_table_of_speeds_has_a_document_and_files(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "speeds.csv"
    file.write_text(SPEEDS)
    out = tmp_path / "out"
    done = stochvi("identify", str(file), "--test", "speeds", "--out", str(out), "--json", "-")
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert document["method"] == "identify" and document["chosen"] == "constant"
    assert document["line"] == 'law = { kind = "restitution", coefficient = 0.703 }'
    assert document["fits"]["constant"]["rejected"] is None
    assert {each.name for each in out.iterdir()} == {"identify.csv", "curve.csv", "identify.png"}
    told = stochvi("identify", str(file), "--test", "speeds")
    assert "law = { kind" in told.out and "yielding body" in told.out


def test_what_is_no_test_is_refused(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "speeds.csv"
    file.write_text("0.5,0.36\n1.0,0.69\n")
    assert "must be 'm/s,m/s', got none" in refused(
        stochvi("identify", str(file), "--test", "speeds")
    )
    assert "mass must be given" in refused(stochvi("identify", str(file), "--test", "drop"))
    missing = stochvi("identify", str(tmp_path / "none.csv"), "--test", "force")
    assert "cannot be read" in refused(missing)


# ------------------------------------------------------------------------------
# `stochvi shocks`: its sentences, its files, and the scene that others take.
# ------------------------------------------------------------------------------


@pytest.mark.slow
def test_potholes_are_found_and_cut_and_the_scene_of_both_runs(
    stochvi: Run, tmp_path: Path
) -> None:
    scene = shipped_scene("isolator-potholes")
    record, out = str(scene.with_name("truck-potholes.csv")), tmp_path / "out"
    asked = ("shocks", record, "--natural-frequency", "12Hz")
    told = stochvi(*asked, "--scene", str(scene), "--out", str(out))
    assert told.code == 0, told.err
    assert "3 shocks in 30 s of truck-potholes.csv: 360 an hour" in told.out
    assert "Next, stochvi size" in told.out
    names = {"quiet.csv", "shocks.csv", "shocks.png", "with-shocks.toml"}
    assert {each.name for each in out.iterdir()} == names | {f"shock-{k}.csv" for k in (1, 2, 3)}
    document = one_document(stochvi(*asked, "--quiet", "--json", "-").out)
    starts = [each["start"] for each in document["shocks"]]
    assert starts == pytest.approx([6.3, 14.8, 23.1], abs=0.15)  # those of data/scenes/potholes.py
    both = str(out / "with-shocks.toml")
    done = stochvi("reliability", both, "--mission", "10s", "--rel-error", "0.3")
    likely = re.search(r"An impact in 10 s: (\S+) % likely", done.out)
    assert done.code == 0 and likely is not None
    # a shock comes in 10 s with a probability of 63 %, and moves the box past either stop
    assert 40.0 < float(likely[1]) < 80.0


def test_what_is_asked_of_shocks_without_a_folder_is_refused(stochvi: Run, tmp_path: Path) -> None:
    record = str(shipped_scene("isolator-potholes").with_name("truck-potholes.csv"))
    scene = ("--scene", str(shipped_scene("isolator-potholes")))
    assert "--scene needs --out" in refused(stochvi("shocks", record, *scene))
    assert "cannot be read" in refused(stochvi("shocks", str(tmp_path / "none.csv")))


# ------------------------------------------------------------------------------
# The documents that commands write are what `stochvi schema answer` says.
# ------------------------------------------------------------------------------


COMMANDS_OF_SCHEMA = [
    ("exact", ELASTIC),
    ("fokker-planck", ELASTIC),
    ("first-passage", ELASTIC, "--times", "5,10"),
    ("linearise", ISOLATOR),
    ("average", ELASTIC),
    ("explain", ISOLATOR),
    ("screen", ISOLATOR),
    ("history", ELASTIC, "--duration", "2"),
    ("simulate", ELASTIC, "--paths", "16", "--duration", "10", "--seed", "1"),
]


def test_documents_of_commands_follow_the_schema(stochvi: Run) -> None:
    done = stochvi("schema", "answer")
    valid = jsonschema.Draft202012Validator(one_document(done.out))
    jsonschema.Draft202012Validator.check_schema(valid.schema)
    for command in COMMANDS_OF_SCHEMA:
        document = one_document(stochvi(*command, "--quiet", "--json", "-").out)
        assert [each.message for each in valid.iter_errors(document)] == [], command
        assert not valid.is_valid(document | {"no_such_key": 1})


def test_the_schema_of_scenes_is_printed_where_nothing_else_is_asked_for(stochvi: Run) -> None:
    assert "structure" in one_document(stochvi("schema").out)["properties"]
