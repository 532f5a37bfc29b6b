"""stochvi size: the verdict, the document, the files, and what it refuses."""

import hashlib
import json
import math
import re
from dataclasses import replace
from io import StringIO
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from rich.console import Console

from stochvi.isolators.screening import screen
from stochvi.isolators.sizing import sensitivity
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.size import size
from stochvi.results.estimates import spoken_percent
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene
from stochvi.views.isolator_tables import sizing_told
from stochvi.views.pages import print_told
from stochvi.views.sizing import plot_risk
from support.commands import ISOLATOR, Run, one_document, refused
from support.refusals import refusals
from support.sized import scene_between_stops, sizing_of

ROUGH = ("--rel-error", "0.2", "--threads", "1", "--mission", "600", "--budget", "600")


@pytest.fixture(autouse=True)
def time_for_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """However slow the machine is."""
    monkeypatch.setattr("stochvi.cli.options.GRACE_SECONDS", 600.0)


@pytest.fixture(scope="module")
def by_python() -> Sizing:
    return size(load_scene(ISOLATOR), probability=0.05, mission=600.0, rel_error=0.2, threads=1)


@pytest.mark.slow
@pytest.mark.usefixtures("short_review", "blank_pictures")
def test_the_demo_is_the_sizing_of_the_truck_and_ends_with_its_page(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "size").mkdir()
    monkeypatch.chdir(tmp_path / "size")
    asked = ("--probability", "1%", "--mission", "1h", "--out", "out")
    sizing = stochvi("size", ISOLATOR, *asked)
    monkeypatch.chdir(tmp_path)
    code, out, _ = stochvi("demo")
    assert code == 0
    assert out == sizing.out + (
        f"\nits page: {Path('out/report.html')}; your own scene: stochvi new truck.toml\n"
    )
    assert Path("out/report.html").is_file()


@pytest.mark.slow
def test_the_theory_is_shown_by_commands_that_a_reader_can_type(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stochvi.cli.scenes.THEORY", {"oscillator-elastic": ("exact", "linearise")})
    code, out, _ = stochvi("demo", "--theory", "--out", tmp_path)
    assert code == 0
    for name in ("exact", "linearise"):
        assert f"stochvi {name} oscillator-elastic.toml" in out
        alone = stochvi(name, shipped_scene("oscillator-elastic")).out
        assert {*alone.splitlines()[:6]} <= {*out.splitlines()}
    assert (tmp_path / "oscillator-elastic" / "response.csv").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("short_review")
def test_the_clearance_and_what_three_sigma_buys(
    stochvi: Run, tmp_path: Path, by_python: Sizing
) -> None:
    done = stochvi(
        "size", ISOLATOR, "--probability", "0.05", *ROUGH, "--json", "-", "--out", tmp_path
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert document["method"] == "size" and document["mission"] == 600.0
    clearance = document["clearance"]
    assert clearance["lower"] < clearance["value"] < clearance["upper"]
    # a slow machine tells its progress before the verdict
    verdict = next(line for line in done.err.splitlines() if line.startswith("Make "))
    made = document["made"]
    assert 0.0 <= made["value"] - clearance["value"] <= made["step"] <= 1e-4
    assert verdict.startswith(f"Make {1e3 * made['value']:.1f} mm on each side")
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        position = document["gap"]["recommended"][side]
        assert f"{side} = {position:g}" in " ".join(done.err.split())  # lines are wrapped
        assert position - document["gap"]["mean_position"] == pytest.approx(sign * made["value"])
    assert " impacts in 10 min" in done.err
    assert clearance["value"] == by_python.clearance.value
    for name in ("risk.csv", "required.csv", "hits.csv", "size.json"):
        assert (tmp_path / name).stat().st_size > 0
    assert (tmp_path / "risk.png").read_bytes().startswith(b"\x89PNG")
    curve = pd.read_csv(tmp_path / "risk.csv")
    assert (curve["probability"].between(0.0, 1.0)).all()


WHITE = """
[structure]
kind = "isolator"
frequency_hz = 10.0
zeta = 0.2
[[excitation]]
kind = "white"
density = 0.01
unit = "g2/Hz"
"""


@pytest.mark.usefixtures("short_review", "blank_pictures")
def test_a_changed_scene_stands_beside_it(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = sensitivity.variations
    monkeypatch.setattr(
        sensitivity, "variations",
        lambda sizing: [case for case in every(sizing) if case[0] in ("none", "level +3 dB")],
    )  # fmt: skip
    scene = tmp_path / "white.toml"
    scene.write_text(WHITE, encoding="utf-8")
    done = stochvi(
        "size", scene, "--probability", "0.05", *ROUGH, "--json", "-", "--out", tmp_path,
        "--sensitivity",
    )  # fmt: skip
    assert done.code == 0
    changes = [row["change"] for row in one_document(done.out)["sensitivity"]]
    assert changes[0] == "none" and "level +3 dB" in changes
    assert "level +3 dB" in done.err and "no stops" in done.err
    assert list(pd.read_csv(tmp_path / "sensitivity.csv")["change"]) == changes


@pytest.mark.usefixtures("short_review", "blank_pictures")
def test_another_report_is_not_replaced(stochvi: Run, tmp_path: Path) -> None:
    """Refused before the work; --force replaces it."""
    asked = ("--probability", "0.05", *ROUGH, "--out", tmp_path / "out")
    for name in ("one", "other"):
        (tmp_path / f"{name}.toml").write_text(f'title = "{name}"\n' + WHITE, encoding="utf-8")
    page = tmp_path / "out" / "report.html"

    def titled() -> str:
        return page.read_text("utf-8").partition("<h1>")[2].partition("</h1>")[0]

    assert stochvi("size", tmp_path / "one.toml", *asked).code == 0
    before = page.read_bytes()
    for other in (("size", tmp_path / "other.toml", *asked), ("size", tmp_path / "one.toml",
                  "--probability", "0.04", *ROUGH, "--out", tmp_path / "out")):  # fmt: skip
        refused = stochvi(*other)
        assert refused.code == 2 and "--force" in refused.err and refused.out == ""
        assert page.read_bytes() == before
    assert stochvi("size", tmp_path / "other.toml", *asked, "--force").code == 0
    assert titled() == "other"
    text = page.read_text("utf-8")
    digest = hashlib.sha256((tmp_path / "other.toml").read_bytes()).hexdigest()
    assert digest in text and "stochvi size" in text and "Approved" in text


@pytest.mark.parametrize("text", ["speed=3%", "level=loud", "frequency=200%"])
def test_tolerances_that_are_not_are_refused(stochvi: Run, text: str) -> None:
    done = stochvi("size", ISOLATOR, "--probability", "0.05", "--tolerances", text)
    assert done.code == 2 and "toleranc" in done.err


def test_the_picture_holds_rice_three_sigma_and_the_answer(by_python: Sizing) -> None:
    sizing = by_python
    ax = plot_risk(sizing)
    rice, risk, three, answer = ax.get_lines()[:4]
    assert (risk.get_ydata() <= rice.get_ydata() + 0.02).all()  # type: ignore[operator]
    assert three.get_xdata()[0] == pytest.approx(3e3 * sizing.sigma)  # type: ignore[index]
    assert answer.get_xdata()[0] == pytest.approx(1e3 * sizing.clearance.value)  # type: ignore[index]
    assert math.log(answer.get_ydata()[0]) == pytest.approx(math.log(0.05), abs=0.05)  # type: ignore[index]
    plt.close("all")


test_bad_input_is_a_sentence = refusals(
    lambda stochvi, arguments: stochvi("size", ISOLATOR, *arguments),
    ((), "give exactly one of --probability, --rate, --impact-speed, --impact-energy, --"),
    (("--probability", "200,0%"), "probability must be in (0, 0.999], got 2; 2 % is 0.02"),
    (("--probability", "2"), "probability must be in (0, 0.999], got 2; 2 % is 0.02"),
    (
        ("--probability", "0,1,2%"),
        "--probability must be a probability such as 0.01 or 1%, got '0,1,2%'",
    ),
    (
        ("--probability", "one"),
        "--probability must be a probability such as 0.01 or 1%, got 'one'",
    ),
    (("--probability", "100%"), "probability must be in (0, 0.999], got 1"),
    (
        ("--peak-acceleration", "30 apples"),
        "must be a number with a unit of acceleration (g, m/s2)",
    ),
    (("--peak-acceleration", "30g"), "needs the stiffness of the stops"),
    (("--impact-energy", "5N"), "must be a number with a unit of energy (J, mJ)"),
    (("--impact-energy", "5J"), "impact_energy needs structure.mass (kg), got none; give it"),
    (("--rate", "1", "--mission", "-1"), "mission must be a positive"),
    (("--probability", "0.1", "--rel-error", "2"), "--rel-error must be in"),
)


def printed(sizing: Sizing) -> str:
    """What a terminal shows, without its line ends."""
    memory = StringIO()
    print_told(Console(file=memory, width=200), sizing_told(sizing))
    return memory.getvalue()


def test_the_stops_of_the_scene_are_judged_where_they_are() -> None:
    """Of each, half the clusters of two at its distance."""
    sizing = sizing_of(scene_between_stops(), paths=64)
    rest = -sizing.scene.structure.sag  # type: ignore[union-attr]
    bursts = [
        0.5 * 0.55 * screen(sizing.scene).rice_rate(distance) * sizing.mission
        for distance in (rest + 9e-3, 5e-3 - rest)
    ]
    chance = -math.expm1(-sum(bursts))
    near, far = 1e3 * (rest + 9e-3), 1e3 * (5e-3 - rest)
    line = (
        f"Your stops, {near:.3g} mm below and {far:.3g} mm above the static equilibrium: "
        "hit almost surely"
    )
    assert chance > 0.999
    assert line in printed(sizing)


def test_the_answer_takes_ten_lines_and_the_rest_is_asked_for(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What less risk takes is the difference of two rows of the table that -v shows."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    assert stochvi("new", "truck.toml").code == 0
    asked = ("size", "truck.toml", "--probability", "1%", "--rel-error", "0.2", "--json", "a")
    brief, whole = stochvi(*asked), stochvi(*asked, "-v")
    assert brief.code == whole.code == 0
    *answer, page, last = brief.out.splitlines()
    assert len(answer) + 2 <= 10 and whole.out.startswith("\n".join(answer))
    for words in ("at 3 sigma = ", "method: ", "cost: "):
        assert words in whole.out and words not in brief.out
    assert last.startswith("-v shows the tables") and "-v" not in whole.out
    assert page.startswith("Next, a page to sign: stochvi size ")
    table = json.loads(Path("a").read_text(encoding="utf-8"))["required"]
    more = table[2]["clearance"] - table[1]["clearance"]
    assert f"A tenth of the risk needs {1e3 * more:.2g} mm more" in brief.out


def test_one_stop_and_none_are_told_apart() -> None:
    sizing = sizing_of(scene_between_stops(), paths=64)
    alone = sizing.scene.impact_pairs[0].model_copy(update={"lower": None})
    one = replace(sizing, scene=sizing.scene.model_copy(update={"impact_pairs": (alone,)}))
    told = printed(one)
    assert f"{sizing.made} to the upper stop from the static" in told and "upper = " in told
    assert "lower = " not in told and "Your stop, " in told
    none = replace(sizing, scene=sizing.scene.model_copy(update={"impact_pairs": ()}))
    told = printed(none)
    assert f"{sizing.made} on each side of" in told and "Your stop" not in told
    assert f"{sizing.stops_to_copy()}; the static equilibrium is at -1.725 mm" in told


def test_what_was_tried_on_the_way_is_no_row_of_the_answer() -> None:
    sizing = sizing_of(scene_between_stops(), paths=64)
    between = sizing.simulated.iloc[[0]].assign(clearance=7.7777e-3)
    tried = replace(sizing, simulated=pd.concat([sizing.simulated, between]))
    assert len(tried.simulated) == 3 and "7.778" not in printed(tried)
    assert printed(tried) == printed(sizing)


def test_chances_are_never_rounded_to_certainty() -> None:
    assert [spoken_percent(p) for p in (0.5, 1e-3, 1e-9, 0.9995)] == [
        "50 %", "0.1 %", "1.0e-07 %", "over 99.9 %",
    ]  # fmt: skip


def test_a_page_leaves_out_the_pictures_that_no_time_is_left_for_and_says_so(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stochvi.cli.options.GRACE_SECONDS", -3600.0)
    scene = tmp_path / "white.toml"
    scene.write_text(WHITE, encoding="utf-8")
    done = stochvi("size", scene, "--probability", "0.05", *ROUGH, "--out", tmp_path)
    assert done.code == 0
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("Not drawn: no time was left") >= 2 and "<img" not in page
    assert (tmp_path / "size.json").is_file() and (tmp_path / "risk.png").is_file()


# Maps, damage and phases -------------------------------------------------------------------


@pytest.fixture
def rubber(tmp_path: Path) -> Path:
    file = tmp_path / "rubber.toml"
    file.write_text(
        '[structure]\nkind = "isolator"\nmass = 2.5\nfrequency_hz = 12.0\nzeta = 0.1\n'
        "[[impact_pair]]\nclearance = 0.006\n"
        'law = { kind = "viscoelastic", stiffness = 5e5, damping_ratio = 0.2 }\n'
        '[[excitation]]\nkind = "psd"\nprofile = "mil-std-810h-truck-vertical-5hz"\n',
        encoding="utf-8",
    )
    return file


def test_a_map_has_its_axes_limits_and_files(rubber: Path, tmp_path: Path, stochvi: Run) -> None:
    done = stochvi(
        "size", rubber, "--map", "clearance=6mm:9mm:2,stiffness=1e5:1e6:2", "--rattle-space",
        "9mm", "--peak-acceleration", "40g", "--rel-error", "0.4", "--json", "-", "--out", tmp_path,
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert document["method"] == "size:map" and document["stiffness"] == [1e5, 1e6]
    assert document["limits"]["rattle_space"] == pytest.approx(9e-3)
    assert document["feasible"][1] == [False, False] and document["best"]["clearance"] == 6e-3
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert (tmp_path / "map.csv").is_file()


def test_a_scene_with_phases_is_sized(rubber: Path, stochvi: Run) -> None:
    road, test = (f'[[phase]]\nname = "{name}"\nduration = "1 h"\n' for name in ("road", "test"))
    text = rubber.read_text(encoding="utf-8")
    for phases, words in (
        ((road,), "less than 5 % likely ("),
        ((road, test), "over 2 phases"),
    ):
        rubber.write_text("\n".join([text, *phases]), encoding="utf-8")
        done = stochvi("size", rubber, "--probability", "5%", "--rel-error", "0.3")
        assert done.code == 0 and words in " ".join(done.out.split())
        assert "assumptions: \n" not in done.out and "Not included: tolerances" in done.out
    refusal = refused(stochvi("size", rubber, "--probability", "5%", "--sensitivity"))
    assert "size one phase, as FILE.toml#PHASE" in refusal
    allowed = ("--rel-error", "0.3", "--tolerances", "level=1dB")
    done = stochvi("size", rubber, "--probability", "5%", *allowed)
    assert done.code == 0 and "within level ± 1 dB" in " ".join(done.out.split())
    assert "Not included" not in done.out
    spread = ("--tolerances", "frequency=normal:3%")
    assert "ask for each, as FILE.toml#PHASE" in refused(stochvi("reliability", rubber, *spread))


test_what_is_no_map_is_refused = refusals(
    lambda rubber, stochvi, options: stochvi("size", rubber, *options),
    (("--map", "clearance"), "--map must be clearance,stiffness"),
    (("--map", "clearance,stiffness=9:3"), "must be FIRST:LAST"),
    (("--map", "clearance,stiffness=0.2:5"), "is in N/m where stops are linear springs, here "),
    (("--map", "clearance,stiffness", "--probability", "1%"), "without --probability"),
    (("--probability", "1%", "--pad-force", "100"), "must stand with --map"),
    (("--damage-ratio", "2", "--rate", "1"), "without --rate"),
    (("--damage-ratio", "0.5"), "ratio must be above 1"),
)


def test_the_mission_of_a_phase_is_its_duration(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "mission.toml"
    phase = '[[phase]]\nname = "rough"\nduration = "5 min"\nlevel_db = 1.0\n'
    file.write_text(f"{Path(ISOLATOR).read_text()}\n{phase}")
    rough = (f"{file}#rough", "--rel-error", "0.2", "--threads", "1", "--json", "-")
    for command in (("size", *rough, "--probability", "5%"), ("reliability", *rough)):
        done = stochvi(*command)
        assert done.code == 0, done.err
        assert one_document(done.out)["mission"] == 300.0
    done = stochvi("reliability", *rough, "--mission", "1min")
    assert one_document(done.out)["mission"] == 60.0


@pytest.mark.slow
def test_the_page_of_a_mission_names_what_shakes_in_each_phase(
    stochvi: Run, tmp_path: Path
) -> None:
    file = tmp_path / "flight.toml"
    file.write_text(
        f"""{Path(ISOLATOR).read_text()}
[[phase]]
name = "climb"
duration = "1 min"

[[phase.added_excitation]]
kind = "sine"
amplitude = 0.1
unit = "g"
frequency_hz = 17.0

[[phase]]
name = "tracks"
duration = "1 min"

[[phase.moving_band]]
from_hz = 8.0
to_hz = 12.0
width_hz = 3.0
density = 1e-4
unit = "g2/Hz"
""",
        encoding="utf-8",
    )
    done = stochvi("reliability", file, "--rel-error", "0.5", "--out", tmp_path / "out", "--quiet")
    assert done.code == 0, done.err
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    words = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    assert "Phase climb" in words and "Sine on base 0.9807 m/s² peak at 17 Hz" in words
    assert re.search(r"Phase tracks the first of \d+ steps", words)
    assert words.count("Simulated ") == 2


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            ["size"],
            "give exactly one of --probability, --rate, --impact-speed, --impact-energy, --",
        ),
        (["simulate", "--rel-error", "2"], "--rel-error must be in [1e-6, 1), got 2"),
        (["simulate", "--rel-error", "0.1", "--paths", "8"], "give --rel-error or --paths, not"),
        (["simulate", "--rel-error", "1e-6", "--budget", "0.2s"], "raise --budget"),
    ],
)
def test_an_error_names_options_and_not_arguments_of_python(
    stochvi: Run, asked: list[str], said: str
) -> None:
    command, *options = asked
    done = stochvi(command, ISOLATOR, *options)
    assert done.code in (1, 2) and said in done.err


def test_an_error_in_a_scene_names_its_keys(stochvi: Run, tmp_path: Path) -> None:
    """`rate` is an option of `size`, and a key of pulses."""
    text = Path(ISOLATOR).read_text(encoding="utf-8")
    scene = tmp_path / "pulses.toml"
    scene.write_text(f'{text}\n[[excitation]]\nkind = "pulses"\nrate = -1.0\non = "base"\n')
    done = stochvi("size", scene, "--rate", "1/h")
    assert done.code == 2 and "rate" in done.err and "--rate" not in done.err
