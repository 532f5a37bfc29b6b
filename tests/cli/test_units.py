"""--units: every command shows its numbers in the units that are asked for, and JSON stays SI."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pint
import pytest

import stochvi as package
from stochvi.cli import main
from stochvi.mathematics.units import CHOICES, units_of
from stochvi.scenes.datasets import shipped_scene
from support.commands import ELASTIC, ISOLATOR, Run, one_document, refused

WITHOUT_ANSWERS = {"profiles", "new", "schema", "explore"}
"""Commands that show no numbers of an answer; the page of `explore` has a knob of its own."""

CHOSEN = "in, ft/s2, mm/s, lbf, mJ, ms, per hour"
SIZES = {
    "m": {"mm": 1e-3, "m": 1.0, "chosen": 0.0254},
    "m/s2": {"g": 9.80665, "m/s2": 1.0, "chosen": 0.3048},
    "m/s": {"m/s": 1.0, "chosen": 1e-3},
    "N": {"N": 1.0, "chosen": 4.4482216152605},
    "J": {"J": 1.0, "chosen": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "chosen": 1e-3},
    "1/s": {"1/s": 1.0, "1/h": 1.0 / 3600.0, "chosen": 1.0 / 3600.0},
}
"""Sizes of the usual units and of the chosen one in SI units: BIPM, and the agreement of 1959."""

FACTORS = {1.0} | {
    (size / sizes["chosen"]) ** power
    for sizes in SIZES.values()
    for name, size in sizes.items()
    if name != "chosen"
    for power in (1, 2)
}
"""All factors between a number in a usual unit and the same in the chosen one."""

RECORD = str(shipped_scene("isolator-record"))
SINE = str(shipped_scene("isolator-sine"))
COMMANDS = {
    "exact": ("exact", ELASTIC),
    "average": ("average", ELASTIC),
    "linearise": ("linearise", ISOLATOR),
    "first-passage": ("first-passage", ELASTIC, "--times", "5,10"),
    "screen": ("screen", ISOLATOR),
    "screen a box": ("screen", str(shipped_scene("rigid-box"))),
    "history": ("history", ISOLATOR, "--duration", "2"),
    "replay": ("replay", RECORD, "--clearances", "4mm,6mm"),
    "sine": ("sine", SINE),
    "size": ("size", ISOLATOR, "--probability", "0.05", "--mission", "600", "--rel-error", "0.3",
             "--threads", "1", "--budget", "600"),
    "clearance": ("clearance", ISOLATOR, "--gaps", "4mm", "--rel-error", "0.3", "--threads", "1",
                  "--budget", "600"),
    "impacts": ("impacts", ELASTIC, "--paths", "16", "--duration", "50", "--threads", "1"),
    "spectrum": ("spectrum", ISOLATOR, "--paths", "8", "--threads", "1"),
}  # fmt: skip
"""Quick commands of all sorts of quantities, by a name."""

NUMBER = re.compile(r"(?<![\w.^/])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!/[a-z])")
ERROR_DIGITS = re.compile(r"(?<=\d)\(\d+(?:\.\d+)?\)")
TIMES = re.compile(r"^(?:cost|simulating|sizing|clearances?|impacts|spectrum): .*$", re.MULTILINE)
"""Lines of progress and of the cost, which depend on the machine."""


def numbers_of(text: str) -> list[str]:
    return NUMBER.findall(ERROR_DIGITS.sub("", text))


def last_digit(number: str) -> float:
    mantissa, _, exponent = number.partition("e")
    places = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - places)


def assert_same_but_for_units(usual: str, chosen: str, factors: set[float]) -> int:
    """Each number of one text is that of the other times a factor, within the last digits of both;
    returns how many differ."""
    before, after = numbers_of(usual), numbers_of(chosen)
    assert len(before) == len(after), list(itertools.zip_longest(before, after))
    changed = 0
    for one, other in zip(before, after, strict=True):
        off = min(
            abs(float(other) - factor * float(one))
            - 1.01 * (last_digit(other) + factor * last_digit(one))
            for factor in factors
        )
        assert off <= 0.0, (one, other)
        changed += one != other
    return changed


@pytest.fixture(autouse=True)
def one_line_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """No line is wrapped, and pictures have all the time that they need."""
    monkeypatch.setenv("COLUMNS", "1000")
    monkeypatch.setattr("stochvi.cli.options.GRACE_SECONDS", 600.0)


def test_every_command_that_shows_an_answer_takes_the_option(stochvi: Run) -> None:
    for name, command in main.commands.items():
        taken = any("--units" in option.opts for option in command.params)
        assert taken == (name not in WITHOUT_ANSWERS), name
        if taken:
            said = refused(stochvi(name, "none.toml", "--units", "furlong"))
            assert said == (
                f"--units must be of {', '.join(itertools.chain(*CHOICES.values()))}, got 'furlong'"
            )


@pytest.mark.usefixtures("short_review")
@pytest.mark.parametrize("name", COMMANDS)
def test_tables_and_sentences_are_the_same_but_for_their_units(
    stochvi: Run, tmp_path: Path, name: str
) -> None:
    texts, documents = [], []
    whole = ["-v"] * any(each.name == "verbose" for each in main.commands[COMMANDS[name][0]].params)
    for units in ("", CHOSEN):
        done = stochvi(*COMMANDS[name], *whole, "--units", units, "--json", tmp_path / "a.json")
        assert done.code in (0, 1), done.err
        texts.append("\n".join(TIMES.sub("", text) for text in (done.out, done.err)))
        documents.append(json.loads((tmp_path / "a.json").read_text()))
    assert assert_same_but_for_units(*texts, FACTORS) >= 5
    with pytest.raises(AssertionError):  # negative control: the same numbers are not taken for SI
        assert_same_but_for_units(*texts, {1.0})
    with pytest.raises(AssertionError):
        assert_same_but_for_units(*texts, {1.01 * factor for factor in FACTORS})
    assert " mm" not in texts[1].replace("mm/s", "") and "(mm)" not in texts[1]
    assert timeless(documents[0]) == timeless(documents[1])


def timeless(part: object) -> object:
    """A document without what differs from run to run."""
    if isinstance(part, dict):
        left_out = ("cost", "call", "seconds", "tenfold_wall_time")
        return {key: timeless(each) for key, each in part.items() if key not in left_out}
    return [timeless(each) for each in part] if isinstance(part, list) else part


@pytest.mark.slow
@pytest.mark.usefixtures("short_review")
@pytest.mark.parametrize("name", ["exact", "history", "replay", "size", "clearance"])
def test_columns_state_the_units_in_which_they_are(stochvi: Run, tmp_path: Path, name: str) -> None:
    for folder, units in (("usual", ""), ("chosen", CHOSEN)):
        stochvi(*COMMANDS[name], "--units", units, "--quiet", "--out", tmp_path / folder)
    changed = 0
    for path in sorted((tmp_path / "usual").glob("*.csv")):
        usual, chosen = pd.read_csv(path), pd.read_csv(tmp_path / "chosen" / path.name)
        assert len(usual.columns) == len(chosen.columns)
        if "unit" in usual:
            factor = usual["unit"].map(judged) / chosen["unit"].map(judged)
            expected = (usual["value"] * factor).to_numpy()
            assert chosen["value"].to_numpy() == pytest.approx(expected, rel=1e-9, nan_ok=True)
            changed += (usual["unit"] != chosen["unit"]).sum()
            continue
        for before, after in zip(usual, chosen, strict=True):
            if before == after:
                assert usual[before].equals(chosen[after]), before
                continue
            (size,) = {size for end, size in COLUMN_SIZES.items() if re.search(end, after)}
            expected = (usual[before] / size).to_numpy()
            assert chosen[after].to_numpy() == pytest.approx(expected, rel=1e-9, nan_ok=True)
            changed += 1
    assert changed >= 2


COLUMN_SIZES = {
    r"_in(?=_low|_high|$)": 0.0254, "_ft_s2": 0.3048, "_mm_s": 1e-3, "_lbf": 4.4482216152605,
    "_ms": 1e-3, "_per_h": 1.0 / 3600.0,
}  # fmt: skip
"""Size of a unit by the pattern of a column that states it."""


def judged(unit: str) -> float:
    """Size of a unit in SI units, by the registry that comes with pint."""
    words = {"g": "g_0", "1/h": "1/hour", "1": ""}.get(unit, unit)
    found = pint.get_application_registry()(words.replace("²", "^2") or "1")
    return float(found if isinstance(found, int | float) else found.to_base_units().magnitude)


@pytest.mark.slow
def test_units_that_can_be_chosen_have_the_sizes_of_pint() -> None:
    for names in CHOICES.values():
        for name in names:
            spelt = {"in lbf": "inch * lbf", "g": "g_0", "mil": "thou", "g²/Hz": "g_0^2 / Hz"}
            words = spelt.get(name, name)
            size = next(iter(units_of(name).values())).si
            if "Hz" in name and "²" in name:
                continue  # an acceleration per hertz is judged by its square root below
            judge = pint.UnitRegistry()(words.replace("²", "^2"))
            in_si = judge.to_base_units()
            assert in_si.magnitude == pytest.approx(size, rel=1e-12), name
    assert units_of("g2/Hz")["acceleration density"].si == pytest.approx(9.80665**2)


def labels(name: str, units: str) -> Iterator[str]:
    found = {"screen": lambda: package.screen(package.load_scene(ISOLATOR)),
             "exact": lambda: package.exact(package.load_scene(ELASTIC))}[name]()  # fmt: skip
    ax = found.plot(units=units)
    yield from (ax.get_xlabel(), ax.get_ylabel())
    plt.close("all")


def test_pictures_and_frames_of_answers_take_units() -> None:
    assert any("(in)" in label for label in labels("screen", "in"))
    assert any("(mm)" in label for label in labels("screen", ""))
    answer = package.exact(package.load_scene(ELASTIC))
    frame, si = answer.in_units("in, per min"), answer.to_frame()
    rates = si["unit"] == "1/s"
    assert set(frame.loc[rates, "unit"]) == {"1/min"}
    assert frame.loc[rates, "value"].to_numpy() == pytest.approx(60.0 * si.loc[rates, "value"])
    assert frame.loc[si["unit"] == "m", "unit"].eq("in").all()
    with pytest.raises(ValueError, match=r"must name one unit of length, got in and mm"):
        answer.in_units("in, mm")


@pytest.mark.slow
def test_a_clearance_to_make_is_never_rounded_down(stochvi: Run, tmp_path: Path) -> None:
    for units in ("mm", "in", "mil", "ft", "µm", "cm"):
        done = stochvi(*COMMANDS["size"], "--units", units, "--json", tmp_path / "a.json")
        made = one_document((tmp_path / "a.json").read_text())["made"]
        shown = re.search(rf"^Make ([\d.]+) {units} on each side", done.out)
        assert shown is not None, done.out
        size = units_of(units)["length"].si
        over = float(shown[1]) * size - made["value"]
        assert -1e-9 * made["value"] <= over <= made["step"] and math.isfinite(over)
        # the line to copy is that of a scene file whatever is shown
        assert f"upper = {made['value']:g}" in done.out and "(m from the" in done.out
