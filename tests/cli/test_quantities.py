"""Numbers with units on the command line: times, lengths, speeds, accelerations."""

import click
import pytest

from stochvi.cli.options import KINDS, listed, on_page
from support.commands import ISOLATOR, Run, one_document, refused


def test_a_page_states_help_and_options() -> None:
    words, decorate = on_page("""Find it.

    --flag  Whether it is.
    --way a|b as method = a  How it is found,
        in two lines.
    --time TIME (time, needed)  When.
    --level (float) := 2  Hidden default.
    """)
    command = click.Command("find", params=[])
    for each in reversed(decorate):
        each(command)
    flag, way, time, level = command.params[::-1]
    assert words.strip() == "Find it."
    assert (flag.is_flag, way.is_flag, way.type.choices) == (True, False, ("a", "b"))
    assert (way.name, way.default, way.help) == ("method", "a", "How it is found, in two lines.")
    assert (time.metavar, time.required, time.type) == ("TIME", True, KINDS["time"])
    assert (way.show_default, level.show_default, level.default) == (True, False, "2")


@pytest.mark.parametrize("line", ["--x (colour)  Help.", "--X  Help.", "--x as  Help."])
def test_what_is_no_line_of_an_option_is_an_error(line: str) -> None:
    with pytest.raises((ValueError, KeyError)):
        on_page(line)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90", 90.0), ("90s", 90.0), ("30 min", 1800.0), ("10h", 36000.0), ("250ms", 0.25),
     ("1.5e3", 1500.0), ("2 d", 172800.0), (60.0, 60.0),
     ("1e9 s", 1e9), ("1.5E3s", 1500.0), ("1h 5min", 3900.0), ("1h5min2.5s", 3902.5),
     ("1 d 2 hours", 93600.0), ("1:30:00", 5400.0), ("100:00:01.5", 360001.5)],
)  # fmt: skip
def test_times(text: str | float, seconds: float) -> None:
    assert KINDS["time"].convert(text, None, None) == pytest.approx(seconds, rel=1e-15)


@pytest.mark.parametrize("text", ["0.025", "2.5%", "2.5 %", 0.025])
def test_chances(text: str | float) -> None:
    assert KINDS["probability"].convert(text, None, None) == pytest.approx(0.025, rel=1e-15)


@pytest.mark.parametrize("text", ["0.5", "0.5/s", "30/min", "30 / min", "1800 per h", 0.5])
def test_rates(text: str | float) -> None:
    assert KINDS["rate"].convert(text, None, None) == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize("text", ["0.1/kg", "a/h", "1/", "0.1 h"])
def test_what_is_no_rate_is_refused(stochvi: Run, text: str) -> None:
    assert "--rate" in refused(stochvi("size", ISOLATOR, "--rate", text))


@pytest.mark.parametrize(
    "text",
    [
        "10 parsec",
        "10 m",
        "h",
        "",
        "nan",
        "1e999",
        "10h 5",
        "10 Hz",
        "5min 1h",
        "1h 2h",
        "1h 5mm",
        "5:30",
        "1:60:00",
        "1h -5min",
        "1h 5Hz",
        "9" * 400 + "h 1min",
    ],
)
def test_what_is_no_time_is_refused(stochvi: Run, text: str) -> None:
    sentence = refused(stochvi("reliability", ISOLATOR, "--mission", text))
    assert sentence.startswith(
        "--mission must be a number with a unit of time (s, ms, min, h; 1h 5min; 1:30:00), got"
    )
    assert repr(text) in sentence
    assert ("it is too large" in sentence) == (text in ("1e999", "9" * 400 + "h 1min"))


def test_a_mission_in_hours_is_that_in_seconds(stochvi: Run) -> None:
    in_hours, in_seconds = (
        one_document(
            stochvi(
                "reliability", ISOLATOR, "--mission", mission, "--rel-error", ".3", "--json", "-"
            ).out
        )
        for mission in (".0005h", "1.8")
    )
    estimate = in_hours["chances"]["hit"]["estimate"]
    assert estimate == in_seconds["chances"]["hit"]["estimate"] and 0.0 < estimate["value"] < 1.0


def read(kind: str, text: str):
    """A text as an option of this kind reads it."""
    return KINDS[kind].convert(text, click.Option(["--option"]), None)


def test_lengths_speeds_and_accelerations() -> None:
    metres = pytest.approx([1e-3, 2e-3, 3e-3, 2.0], rel=1e-15)
    assert read("multiples", "1mm, 2 mm,0.3 cm,4")(0.5) == metres
    assert read("lengths", "1mm, 2 mm,0.3 cm,2") == metres
    assert read("barriers", "4mm") == (-4e-3, 4e-3)
    assert read("barriers", "-0.003,") == (-3e-3, None)
    assert KINDS["speed"].convert("50 cm/s", None, None) == 0.5
    assert read("list of m/s", "0.1, 50 mm/s") == [0.1, 0.05]
    assert read("list of dB", "-3dB,0,3 dB") == [-3.0, 0.0, 3.0]
    assert read("acceleration", "40g") == read("acceleration", "40 G")
    assert read("acceleration", "40g") == pytest.approx(40.0 * 9.80665)
    assert read("acceleration", "150") == read("acceleration", "150 m/s^2") == 150.0
    assert read("names", "left, right") == ["left", "right"]


@pytest.mark.parametrize(
    ("kind", "text"), [("lengths", "1mm,2s"), ("acceleration", "40 m"), ("barriers", "4kg"),
                       ("multiples", "1mm,")],
)  # fmt: skip
def test_a_unit_of_another_quantity_is_refused(kind: str, text: str) -> None:
    with pytest.raises(ValueError, match=r"^--option must be a number with a unit of"):
        read(kind, text)


@pytest.mark.parametrize(("text", "unit"), [("1mm", "m/s"), ("3 Hz", "dB"), ("0.5m", "")])
def test_a_list_refuses_a_unit_of_another_quantity(text: str, unit: str) -> None:
    with pytest.raises(ValueError, match=r"^--option must be numbers with commas"):
        listed(unit).convert(f"1,{text}", click.Option(["--option"]), None)
