"""Tables of text as instruments, spreadsheets and people write them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ForceTable,
    ImpactPair,
    Matrices,
    Oscillator,
    RecordedNoise,
    Restitution,
    Scene,
    SceneError,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
)
from stochvi.identification import read_test
from stochvi.mathematics.spectra import Table, response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.model import model_of
from stochvi.notices import InputWarning
from stochvi.scenes import Pulses
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.pair_tables import read_pairs
from stochvi.scenes.scene import scene_from
from stochvi.scenes.text_tables import read_table, read_text, read_text_table, unit_in
from support.commands import Run
from support.refusals import refusals

WANTED = [[10.0, 20.5, 40.0], [0.002, 0.01, 0.04]]
"""Columns that each of `LAYOUTS` holds."""

LAYOUTS = {
    "points and commas": "10,0.002\n20.5,0.01\n40,.04\n",
    "decimal commas and semicolons": "10;0,002\n20,5;0,01\n40;0,04\n",
    "decimal commas and tabs": "10\t0,002\n20,5\t0,01\n40\t0,04\n",
    "decimal commas and blanks": "10 0,002\n20,5 0,01\n40 4,0e-2\n",
    "decimal commas in quotes": '"10,0","0,002"\n"20,5","0,01"\n"40,0","0,04"\n',
    "quotes": '"10","0.002"\n"20.5","0.01"\n"40","0.04"\n',
    "Fortran": "  1.000D+01  2.000D-03\n  2.050d+01  1.0D-02\n  0.400D+02  4.0D-02\n",
    "blanks behind semicolons": "10;0.002\n20.5; 0.01\n40; 0.04",
    "a byte-order mark": "\ufeff,G\r\n10,2e-3\r\n20.5,1E-2\r\n40,4.0E-02\r\n",
    "units alone above": "# a comment\n\nHz g2/Hz\n10,0.002 # the first\n\n20.5,0.01\n40,0.04\n",
    "bars": "10|0.002\n20.5|0.01\n40|0.04\n",
    "a delimiter at the end": "10;0,002;\n20,5;0,01;\n40;0,04;\n",
    "old line ends": "10,0.002\r20.5,0.01\r40,0.04\r",
    "numbers in the heading": "ASD run 1 (g^2/Hz)\n10 0.002\n20.5 0.01\n40 0.04\n",
    "several headings": (
        "sep=;\nLogger 4711;\nSample rate;2048\nf [Hz];PSD [g^2/Hz]\n10;0.002\n20.5;0.01\n40;0.04\n"
    ),
    "typeset powers of ten": ("10\t2.0 \u00d7 10^\u20133\n20.5\t1.0 x 10\u22122\n40\t4·10⁻²\n"),
    "a typeset minus": "10\t2e\u22123\n20.5\t1.0E\u20132\n40\t4e-2\n",
    "comments": "% floor\n// run 3\n# 4 of 5\n10 0.002\n\n20.5 0.01 # the second\n40 0.04\n",
}


@pytest.mark.parametrize("text", LAYOUTS.values(), ids=LAYOUTS)
def test_a_table_is_read_however_it_is_laid_out(tmp_path: Path, text: str) -> None:
    (tmp_path / "table.txt").write_text(text, encoding="utf-8", newline="")
    assert [column.tolist() for column in read_table(tmp_path / "table.txt")] == WANTED


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252"]
)
def test_a_table_is_read_in_every_usual_encoding(tmp_path: Path, encoding: str) -> None:
    text = "Frequenz für Ü (Hz);PSD (g²/Hz)\r\n10;0,002\r\n20,5;0,01\r\n40;0,04\r\n"
    (tmp_path / "table.txt").write_bytes(text.encode(encoding))
    table = read_text_table(tmp_path / "table.txt", ("f", "G"))
    assert [column.tolist() for column in table.columns(0, 1)] == WANTED
    known = table.headings[1].unit
    assert known is not None and known.name == "g2/Hz"


def test_a_missing_file_is_answered_with_one_of_nearly_its_name(tmp_path: Path) -> None:
    (tmp_path / "Messung_Floor.csv").write_text("1,1\n2,2\n")
    for name in ("messung_floor.csv", "Messung Floor.csv"):
        with pytest.raises(SceneError, match=r"did you mean \S+/Messung_Floor\.csv\?$"):
            read_table(tmp_path / name)
    with pytest.raises(SceneError, match=rf"looked for in the folder {tmp_path}$"):
        read_table(tmp_path / "wheel.uff")
    with pytest.raises(SceneError, match=r"there is no folder \S+/run$"):
        read_table(tmp_path / "run" / "floor.csv")


@pytest.mark.parametrize(
    "heading",
    [
        "time (ms),acc (mg),comment",
        "time (ms);acc (mg);remark;file",
        "# time (ms), acc (mg), ok?",
        "t(ms) a(mg) remark",
        "time [ms] acc of run [mg]",
        "time,acc,comment\nms,mg,",
        "time,acc,comment\nms,mg",
        "Units: ms, mg\ntime,acc,comment",
        "time (ms),acc (mg),comment\n# run 4\n# sensor 5\n# calibrated in May\n# by Ann",
    ],
)
def test_a_heading_keeps_its_units_where_a_column_of_remarks_is_not_filled(
    tmp_path: Path, heading: str
) -> None:
    (tmp_path / "run.csv").write_text(f"{heading}\n0.0,1.5\n2.5,-0.5\n5.0,0.25\n")
    time, values = read_text_table(tmp_path / "run.csv", ("time", "acceleration")).headings
    assert time.unit is not None and time.unit.name == "ms"
    assert values.unit is not None and values.unit.name == "mg"


@pytest.mark.parametrize(
    "heading",
    ["Run;time (ms);acc (mg)", "time (ms),run,acc (mg)", "Unit;ms;mg",
     "time (ms);acc (mg);temp (m)"],
)  # fmt: skip
@pytest.mark.parametrize("rows", ["0.0,1.5\n2.5,-0.5\n", "1,2,0.0,1.5\n2,2,2.5,-0.5\n"])
def test_a_heading_with_units_that_may_be_those_of_other_columns_is_refused(
    tmp_path: Path, heading: str, rows: str
) -> None:
    (tmp_path / "run.csv").write_text(f"{heading}\n{rows}")
    count = 1 + rows.split()[0].count(",")
    with pytest.raises(SceneError, match=f"line 1: names 3 columns .* rows below have {count}; "):
        read_text_table(tmp_path / "run.csv", ("time", "acceleration"))


@pytest.mark.parametrize(
    "text",
    ["Acceleration in mg, all runs, by Ann", "Unit: mg", "# acc (mg)", "# column 2: a (mg)"],
)
def test_a_unit_that_a_sentence_states_is_that_of_the_values(tmp_path: Path, text: str) -> None:
    rows = "\n".join(f"{0.01 * n:.2f},{n % 7}" for n in range(300))
    (tmp_path / "run.csv").write_text(f"{text}\n{rows}\n")
    noise = RecordedNoise(file=str(tmp_path / "run.csv"))
    assert noise.record.peak == pytest.approx(3e-3 * 9.80665, rel=0.01)
    with pytest.raises(SceneError, match=r"unit is 'g', but line 1 of .* says 'mg'"):
        RecordedNoise(file=str(tmp_path / "run.csv"), unit="g")


RUN = "\n".join(f"{0.01 * n:.2f},{n % 7}" for n in range(300))


@pytest.mark.parametrize(
    "text",
    [
        "Sensitivity: 100 mV/g\ntime (s),acc (V)", "time (s),acc (V)", "# 10 mV/(m/s2)\nt,acc [mV]",
        "t,V\ns,mV", "Time,a\ns,V", "time (s),Voltage", "t/s,a/V", "time_s,acc_mV", "t,acc in V",
        "t,acc [mV/g]", "t,seat (counts)", "Unit: g\ntime (s),acc (V)", "t,a (V/g)",
    ],
)  # fmt: skip
@pytest.mark.parametrize("keys", [{}, {"unit": "g"}])
def test_volts_are_refused_whatever_a_sentence_or_the_scene_says(
    tmp_path: Path, text: str, keys: dict[str, str]
) -> None:
    (tmp_path / "run.csv").write_text(f"{text}\n{RUN}\n")
    with pytest.raises(SceneError, match="divide the values by the sensitivity"):
        RecordedNoise(file=str(tmp_path / "run.csv"), **keys)
    with pytest.raises(SceneError, match="divide the values by the sensitivity"):
        read_test(tmp_path / "run.csv", "drop", mass=1.0, height=1.0, **keys)


@pytest.mark.parametrize(
    "text",
    ["Sensitivity: 100 mV/g", "100 pC/(m/s2)", "10.2 mV per m/s2", "9.81 m/s2 per V", "1 g/V",
     "Range: 500 m/s2", "Range ±50 m/s2", "sensitivity [mV/g]: 100"],
)  # fmt: skip
@pytest.mark.parametrize("heading", ["time (s),acc", "T,V", "Zeit (s),Kanal V"])
def test_the_unit_of_a_sensitivity_or_a_range_is_not_that_of_the_values(
    tmp_path: Path, text: str, heading: str
) -> None:
    (tmp_path / "run.csv").write_text(f"{text}\n{heading}\n{RUN}\n")
    with pytest.raises(SceneError, match="needs unit, one of g, m/s2, N"):
        RecordedNoise(file=str(tmp_path / "run.csv"))
    noise = RecordedNoise(file=str(tmp_path / "run.csv"), unit="mg")
    assert noise.record.peak == pytest.approx(3e-3 * 9.80665, rel=0.01)
    (tmp_path / "run.csv").write_text(f"{text}\ntime (s),acc (mg)\n{RUN}\n")
    noise = RecordedNoise(file=str(tmp_path / "run.csv"))
    assert noise.record.peak == pytest.approx(3e-3 * 9.80665, rel=0.01)


@pytest.mark.parametrize(
    ("heading", "told"), [("CH1 V", "V"), ("acc_V", "V"), ("counts", "counts")]
)
def test_what_may_be_volts_is_told(tmp_path: Path, heading: str, told: str) -> None:
    (tmp_path / "run.csv").write_text(f"time (s),{heading}\n{RUN}\n")
    noise = RecordedNoise(file=str(tmp_path / "run.csv"), unit="g")
    (doubt,) = noise.doubts()
    assert (
        f"the text '{told}' above" in doubt
        and "were taken to be in g, as the scene states" in doubt
    )


MILLI = ["t,acc (milli-g)", "t,acc_milli_g", "t,acc (mgs)", "t,acc (milli g)", "t,a\ns,milli-g"]


@pytest.mark.parametrize("heading", MILLI)
def test_prefixes_and_plurals_of_units_are_read(tmp_path: Path, heading: str) -> None:
    (tmp_path / "run.csv").write_text(f"{heading}\n{RUN}\n")
    noise = RecordedNoise(file=str(tmp_path / "run.csv"))
    assert noise.record.peak == pytest.approx(3e-3 * 9.80665, rel=0.01)
    with pytest.raises(SceneError, match=r"unit is 'g', but line \d of .* says '.*g"):
        RecordedNoise(file=str(tmp_path / "run.csv"), unit="g")


@pytest.mark.parametrize(
    ("heading", "told"),
    [
        ("t,acc (1e-3 g)", "1e-3 g"), ("t,acc (g/1000)", "g/1000"), ("t,a in 0.001g", "0.001g"),
        ("Unit: kilo-gees/2\nt,acc", "kilo-gees/2"),
    ],
)  # fmt: skip
def test_a_unit_that_cannot_be_read_is_told_beside_that_of_the_scene(
    tmp_path: Path, heading: str, told: str
) -> None:
    (tmp_path / "run.csv").write_text(f"{heading}\n{RUN}\n")
    (doubt,) = RecordedNoise(file=str(tmp_path / "run.csv"), unit="g").doubts()
    assert f"the text '{told}' above the values is not a known unit; the values were" in doubt
    with pytest.warns(InputWarning, match="is not a known unit"):
        Pulses(rate=1.0, file=str(tmp_path / "run.csv"), unit="g", on="base")
    with (
        pytest.warns(InputWarning, match="is not a known unit"),
        pytest.raises(ValueError, match="of at least 8"),
    ):
        read_test(tmp_path / "run.csv", "drop", mass=1.0, height=1.0, unit="g")
    (tmp_path / "run.csv").write_text(f"t,acc (front left)\n{RUN}\n")
    assert RecordedNoise(file=str(tmp_path / "run.csv"), unit="g").doubts() == ()


def test_a_unit_of_a_curve_or_a_density_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("deflection (mm),force (N/1000)\n0,0\n1,2\n2,5\n")
    with pytest.warns(InputWarning, match="'N/1000' above column 2 of .* is not a known unit"):
        ForceTable(file=str(tmp_path / "curve.csv"), unit="mm,N")
    with pytest.warns(InputWarning, match="'1e-3 g2/Hz' in array is not a known unit"):
        TabulatedNoise(values={"f": [1.0, 9.0], "(1e-3 g2/Hz)": [1.0, 1.0]}, unit="g2/Hz")


@pytest.mark.parametrize(
    "spelling", ["G/rtHz", "g/√Hz", "g/sqrt(Hz)", "grms/Hz^0.5", "g/Hz^(1/2)", "(m/s2)/root Hz"]
)
@pytest.mark.parametrize("heading", ["ASD ({})", "ASD {}"])
def test_the_root_of_a_density_is_none(tmp_path: Path, spelling: str, heading: str) -> None:
    (tmp_path / "psd.csv").write_text(f"f (Hz),{heading.format(spelling)}\n10,0.1\n100,0.1\n")
    with pytest.raises(SceneError, match="unit is 'g2/Hz', but line 1 of"):
        TabulatedNoise(file=str(tmp_path / "psd.csv"), unit="g2/Hz")
    with pytest.raises(SceneError, match=r"expected the unit of an .*; square its values"):
        TabulatedNoise(file=str(tmp_path / "psd.csv"))


def test_two_units_above_one_column_are_refused(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(f"t,acc (g)\ns,mg\n{RUN}\n")
    with pytest.raises(SceneError, match="line 2: states 'mg' for column 2, and 'g' in another"):
        RecordedNoise(file=str(tmp_path / "run.csv"))


def test_a_curve_in_volts_is_refused(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("deflection (mm),force (V)\n0,0\n1,2\n2,5\n")
    with pytest.raises(SceneError, match="expected no V; divide the values"):
        ForceTable(file=str(tmp_path / "curve.csv"), unit="mm,N")


def test_delimiters_that_fill_a_row_are_no_columns(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("f (kHz);PSD (g2/Hz)\n1;0,5;;;\n2;0,7;;;\n")
    frequency, density = read_text_table(tmp_path / "run.csv", ("f", "G")).headings
    assert frequency.unit is not None and frequency.unit.name == "kHz"
    assert density.unit is not None and density.unit.name == "g2/Hz"


def test_binary_data_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "table.txt").write_bytes(np.linspace(0.0, 1.0, 99).tobytes())
    with pytest.raises(SceneError, match="is not text: expected UTF-8, UTF-16 or Latin-1"):
        read_table(tmp_path / "table.txt")


@pytest.mark.parametrize("comment", ["", " # of the first run", "#3"])
def test_commas_that_part_columns_and_are_decimal_signs_are_refused(
    tmp_path: Path, comment: str
) -> None:
    (tmp_path / "table.csv").write_text(f"f (Hz),PSD (g2/Hz)\n5,0,015{comment}\n40,0,02\n")
    with pytest.raises(SceneError, match=r"line 2: .* with semicolons between columns"):
        TabulatedNoise(on="base", file=str(tmp_path / "table.csv"), column=3)


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("1,O.1\n2,1\n", "line 1", "two numbers"),
        ("1,1\n2,1O\n", "line 2", "a number in column 2, got '1O'"),
        ("1,2,3\n", "line 1", "two numbers"),
        ("1;2;3\n1;1\n2;2\n", "line 1", "two numbers"),
        ("6\n1 1\n2 2\n", "line 1", "two numbers"),
        ("1,1\n2\n", "line 2", "two numbers"),
        ("1,1\nend,0\n", "line 2", "a number in column 1, got 'end'"),
        ("1;2,5\n2;3.5\n", "line 2", "with decimal commas"),
        ("1.000;2,5\n2;3,5\n", "line 1", "no sign between thousands"),
        ("1,1\n2,\n", "line 2", "a number is missing"),
        ("1,1.5\n2,1.#QNAN\n3,1.5\n", "line 2", "a number is missing"),
        ("1,1.5\n2,#DIV/0!\n3,1.5\n", "line 2", "a number is missing"),
        ('"1,1\n2,2\n3,3\n', "line 1", "two numbers"),
    ],
    ids=[
        "letter for a digit above", "letter for a digit", "three columns", "other heading",
        "a count of rows", "one cell", "a word", "two decimal signs", "thousands", "nothing",
        "nothing of C", "nothing of a spreadsheet", "a quote",
    ],
)  # fmt: skip
def test_a_line_that_is_not_two_numbers_is_never_passed_over(
    tmp_path: Path, text: str, where: str, what: str
) -> None:
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as failure:
        read_table(tmp_path / "table.csv")
    assert f"table.csv, {where}: " in str(failure.value) and what in str(failure.value)


@pytest.mark.parametrize("space", ["\u2009", "\u202f", "\u00a0"])
def test_thin_and_no_break_spaces_part_thousands_within_a_cell(tmp_path: Path, space: str) -> None:
    (tmp_path / "table.txt").write_text(f"5\t0,1\n1{space}000\t0,2\n", encoding="utf-8")
    assert read_table(tmp_path / "table.txt")[0].tolist() == [5.0, 1000.0]
    (tmp_path / "columns.txt").write_text("5\u00a0100\n10\u00a0200\n", encoding="utf-8")
    assert read_table(tmp_path / "columns.txt")[1].tolist() == [100.0, 200.0]


@pytest.mark.parametrize(
    "text", ["1\t2 \u00d7 102\n2\t3 \u00d7 102\n", "5\u201340\t1\n40\u201380\t2\n"]
)
def test_a_power_that_lost_its_sign_and_a_range_are_no_numbers(tmp_path: Path, text: str) -> None:
    (tmp_path / "table.txt").write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match="line 1"):
        read_table(tmp_path / "table.txt")


def test_a_column_that_is_filled_now_and_then_is_a_column(tmp_path: Path) -> None:
    rows = [f"{n},0.{n},{n}.5,{21.5 if n % 4 == 0 else ''}\n" for n in range(20)]
    for start in (0, 1):
        text = "t,X [g],Z [g],Temp\n" + "".join(rows[start:])
        (tmp_path / "run.csv").write_text(text)
        table = read_text_table(tmp_path / "run.csv", ("time", "acceleration"))
        assert [heading.name for heading in table.headings] == ["t", "X [g]", "Z [g]", "Temp"]
        (z,) = table.columns(table.column_called("Z"))
        assert z.tolist() == [n + 0.5 for n in range(start, 20)]


@pytest.mark.parametrize(
    "rows",
    [
        "1.3.2025 08:15:02,120;0,5\n1.3.2025 08:15:02,620;-0,7\n",
        "01.03.2025;08:15:02.120;0,5\n01.03.2025;08:15:02.620;-0,7\n",
        "01.03.2025 08:15:02.120,0.5\n01.03.2025 08:15:02.620,-0.7\n",
        # across midnight
        "31.12.2024 23:59:59.500,0.5\n01.01.2025 00:00:00,-0.7\n",
        "2024/12/31 23:59:59.750,0.5\n2025/01/01 00:00:00.250,-0.7\n",
        "2024/12/31;23:59:59,750;0,5\n2025/01/01;00:00:00,250;-0,7\n",
        "23:59:59.750,0.5\n00:00:00.250,-0.7\n",
        "23:59:59,750;0,5\n00:00:00,250;-0,7\n",
    ],
)
def test_time_stamps_of_loggers_german_ones_too(tmp_path: Path, rows: str) -> None:
    (tmp_path / "run.csv").write_text("Zeit;Az [g]\n" + rows)
    time, values = read_text_table(tmp_path / "run.csv", ("time", "a")).columns(0, 1)
    assert time.tolist() == [0.0, 0.5] and values.tolist() == [0.5, -0.7]


def test_time_stamps_without_headings(tmp_path: Path) -> None:
    (tmp_path / "whole.csv").write_text("31.12.2024 23:59:59,0.5\n01.01.2025 00:00:00,0.25\n")
    time, values = read_text_table(tmp_path / "whole.csv", ("time", "a")).columns(0, 1)
    assert time.tolist() == [0.0, 1.0] and values.tolist() == [0.5, 0.25]


def test_a_clock_goes_on_over_days_and_does_not_take_a_step_back_for_one(tmp_path: Path) -> None:
    clock = ["12:00:00", "20:00:00", "04:00:00", "12:00:00", "23:00:00", "02:00:00", "01:59:59"]
    (tmp_path / "run.csv").write_text("".join(f"{time},0.5\n" for time in clock))
    (time,) = read_text_table(tmp_path / "run.csv", ("time", "a")).columns(0)
    assert (time / 3600.0 == [0.0, 8.0, 16.0, 24.0, 35.0, 38.0, 38.0 - 1.0 / 3600.0]).all()
    (tmp_path / "run.csv").write_text("12:00:00,0.5\n25:00:00,0.5\n")
    with pytest.raises(SceneError, match="line 2: expected a time stamp"):
        read_text_table(tmp_path / "run.csv", ("time", "a")).columns(0)


def test_a_date_that_may_be_read_two_ways_is_refused_with_what_to_write(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("Time;Az\n03/04/2025 08:15:02;0.1\n03/04/2025 08:15:03;0.2\n")
    with pytest.raises(SceneError, match=r"write times in seconds or as \d{4}-"):
        read_text_table(tmp_path / "run.csv", ("time", "a"))


@pytest.mark.parametrize("text", ["0,12\n-0,07\n", "0.12\n-0.07\n", "0,12\n-,07\n"])
def test_one_column_of_decimal_fractions(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.csv").write_text(text)
    table = read_text_table(tmp_path / "run.csv", ("a",))
    assert [column.tolist() for column in table.columns(0)] == [[0.12, -0.07]]


def test_whole_numbers_with_commas_between_them_are_two_columns(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("1,20\n2,30\n")
    assert len(read_text_table(tmp_path / "run.csv", ("a",)).headings) == 2


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("ASD run 1 (g^2/Hz)", "g2/Hz"),
        ("PSD ((m/s2)^2/Hz)", "(m/s2)2/Hz"),
        ("PSD [(m/s²)²/Hz]", "(m/s2)2/Hz"),
        ("PSD (m/s2)^2/Hz", "(m/s2)2/Hz"),
        ("PSD in g^2/Hz", "g2/Hz"),
        ("Accel (vertical) [g]", "g"),
        ("Level (dB re 1 g^2/Hz)", "dB re 1 g2/Hz"),
        ("density_g2_per_hz", "g2/Hz"),
        ("acceleration_g", "g"),
        ("time_ms", "ms"),
        ("t_ms", "ms"),
        ("Zeit in ms", "ms"),
        ("Acc g", "g"),
        ("Accel (g rms)", "g"),
        ("Hz", "Hz"),
        ("Frequency [rad/s]", "rad/s"),
        ("PSD (m·s⁻²)²·Hz⁻¹", "(m/s2)2/Hz"),
        ("PSD (m s-2)2 Hz-1", "(m/s2)2/Hz"),
        ("PSD (m²s⁻³)", "(m/s2)2/Hz"),
        ("ASD(m/s²)²/Hz", "(m/s2)2/Hz"),
        ("psd_m2_s4_Hz", "(m/s2)2/Hz"),
        ("Accel_PSD_g2_Hz", "g2/Hz"),
        ("PSD (gRMS²/Hz)", "g2/Hz"),
        ("G_rms^2/Hz", "g2/Hz"),
        ("acceleration_m_s2", "m/s2"),
        ("a in ms-2", "m/s2"),
        ("a [Gal]", "Gal"),
        ("a/(m/s²)", "m/s2"),
        ("f/kHz", "kHz"),
        ("t / ms", "ms"),
        ("timestamp_ns", "ns"),
        ("Frequency (CPM)", "CPM"),
        ("Channel/1", None),
        ("run m-2", None),
        ("G", None),
        ("f", None),
        ("Channel 1 (EU)", None),
        ("run (third)", None),
        ("acc_z", None),
    ],
)
def test_the_unit_in_a_heading(text: str, unit: str | None) -> None:
    found = unit_in(text)
    assert (found and found.name) == unit


def test_a_file_of_the_largest_size_is_read_and_one_byte_more_is_not(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("stochvi.scenes.text_tables.LARGEST_TEXT_FILE", 8)
    (tmp_path / "fits").write_text("12345678", encoding="utf-8")
    (tmp_path / "does not").write_text("123456789", encoding="utf-8")
    assert read_text(tmp_path / "fits") == "12345678"
    with pytest.raises(SceneError, match="holds 9 bytes, expected a text of at most 8"):
        read_text(tmp_path / "does not")


def test_columns_in_another_order_than_their_heading_says_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "swapped.csv"
    file.write_text("density,frequency_hz\n0.01,10\n0.02,100\n")
    with pytest.raises(SceneError, match="has the columns density, frequency_hz; expected"):
        read_table(file)
    file.write_text("frequency_hz density\n10 0.01\n100 0.02\n")
    frequency, _ = read_table(file)
    assert frequency.tolist() == [10.0, 100.0]


def test_commas_that_may_be_decimal_or_part_thousands_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("f;G\n1,000;2\n2,000;3,500\n")
    with pytest.raises(SceneError, match=r"line 2: '1,000' may be .* decimal comma or thousands"):
        read_table(path)
    path.write_text("f;G\n1,000;0,200\n2,000;3,500\n")  # a zero in front: decimal commas
    assert read_table(path)[0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    "text", ["3\n5,1\n10,2\n20,3\n", "3\nHz,g2/Hz\n5,1\n10,2\n20,3\n", "3\n5 1\n10 2\n20 3\n"]
)
def test_a_line_that_counts_the_rows_below_is_no_row(tmp_path: Path, text: str) -> None:
    names = ("frequency_hz", "density")
    (tmp_path / "run.csv").write_text(text)
    frequency, density = read_text_table(tmp_path / "run.csv", names).columns(0, 1)
    assert frequency.tolist() == [5.0, 10.0, 20.0] and density.tolist() == [1.0, 2.0, 3.0]
    (tmp_path / "run.csv").write_text(text.replace("3", "4", 1))
    with pytest.raises(SceneError, match="line 1: expected two numbers as in the lines below"):
        read_text_table(tmp_path / "run.csv", names)


def test_a_large_table_that_is_read_at_once_holds_the_same_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "large.csv"
    rows = [f"{1.1 * n!r}, {10.0**-n!r}" for n in range(40)]
    file.write_text("\n".join(["frequency,density", *rows]), encoding="utf-8")
    slow = read_text_table(file, ("frequency", "density")).columns(0, 1)
    monkeypatch.setattr("stochvi.scenes.text_tables.MANY_ROWS", 1)
    table = read_text_table(file, ("frequency", "density"))
    assert table._plain_columns(2) is not None
    for own, other in zip(table.columns(0, 1), slow, strict=True):
        np.testing.assert_array_equal(own, other)
    file.write_text("\n".join(["frequency,density", *rows, "7.0,missing"]), encoding="utf-8")
    with pytest.raises(SceneError, match="line 42"):
        read_text_table(file, ("frequency", "density")).columns(0, 1)


ROWS_OF_A_LARGE_FILE = {
    "commas": ("{:.4f},{:.5f}\n", "."),
    "decimal commas": ("{:.4f};{:.5f}\r\n", ","),
    "blanks": (" {:.4f}   {:.5e}\n", "."),
    "a delimiter at the end": ("{:.4f}\t{:.5f}\t\n", "."),
    "a note": ("{:.4f},{:.5f}\n", "."),
    "a gap": ("{:.4f},{:.5f}\n", "."),
    "a cell too many": ("{:.4f},{:.5f}\n", "."),
    "a cell too few": ("{:.4f};{:.5f}\n", "."),
    "a letter": ("{:.4f},{:.5f}\n", "."),
}


@pytest.mark.parametrize("kind", ROWS_OF_A_LARGE_FILE)
def test_a_large_file_that_is_read_at_once_is_what_it_is_line_by_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """The judge is the reader of lines, and where it refuses so must the other."""
    form, point = ROWS_OF_A_LARGE_FILE[kind]
    values = np.random.default_rng(3).normal(size=1500)
    rows = [form.format(n / 800, v).replace(".", point) for n, v in enumerate(values)]
    spoilt = {
        "a note": "# a bump\n", "a gap": "0.9,\n", "a cell too many": "0.9,1.0,2.0\n",
        "a cell too few": "0.9\n", "a letter": "0.9,1O\n",
    }  # fmt: skip
    if kind in spoilt:
        rows[720] = spoilt[kind]
    file = tmp_path / "run.csv"
    file.write_bytes(("time (s);acc (mg)\n" + "".join(rows)).encode("utf-8-sig"))

    def found(large: int) -> str | tuple[list[list[float]], list[int], str | None]:
        monkeypatch.setattr("stochvi.scenes.text_tables.LARGE_TEXT", large)
        monkeypatch.setattr("stochvi.scenes.text_tables.PART", 2000)
        monkeypatch.setattr("stochvi.scenes.text_tables.PIECE", 1500)
        try:
            table = read_text_table(file, ("time", "acceleration"))
            columns = table.columns(0, 1)
        except SceneError as error:
            return str(error)
        if large == 0:
            assert (table.values is not None) == (kind not in spoilt)
        unit = table.headings[1].unit
        filled = [np.nan_to_num(column, nan=1e9).tolist() for column in columns]
        return filled, list(table.numbers), unit and unit.name

    assert found(0) == found(10**9)


# ------------------------------------------------------------------------------
# Tables of a density as they come: steps, zeros, order, levels, and the units that they state.
# ------------------------------------------------------------------------------


ROWS = ["10;0,002", "20;0,01", "40;0,04", "80;0,04"]
PLAIN = TabulatedNoise(
    frequency_hz=[10, 20, 40, 80], density=[0.002, 0.01, 0.04, 0.04], unit="g2/Hz"
)


def noise(path: Path, text: str, **keys: object) -> TabulatedNoise:
    (path / "table.csv").write_text(text, encoding="utf-8")
    return TabulatedNoise(file=str(path / "table.csv"), **keys)


def assert_same(found: TabulatedNoise, factor: float = 1.0) -> None:
    np.testing.assert_allclose(found.table.frequency_hz, PLAIN.table.frequency_hz, rtol=1e-8)
    np.testing.assert_allclose(found.table.density, factor * PLAIN.table.density, rtol=1e-5)


@pytest.mark.parametrize("spelling", ["g2/Hz", "g^2/Hz", "G²/Hz", "gn**2 / Hz", "g²/HZ"])
def test_a_unit_is_known_in_every_spelling(tmp_path: Path, spelling: str) -> None:
    found = noise(tmp_path, "\n".join(ROWS), unit=spelling)
    assert_same(found)
    assert found.density_unit == "g2/Hz" and found.assumptions() == ()


@pytest.mark.parametrize(
    ("heading", "factor"),
    [
        ("f;ASD run 1 (g^2/Hz)", 1.0),
        ("Frequency [Hz];PSD [G²/Hz]", 1.0),
        ("f;PSD\nHz;g^2/Hz", 1.0),
        ("# floor 3, (g^2/Hz)", 1.0),
        ("This is the ASD in g²/Hz of run (3)", 1.0),
        ("01.05.2024\n2 channels, 5 to 500 Hz\nUnit;g^2/Hz\nf;G", 1.0),
        ("f;((m/s2)^2/Hz)", STANDARD_GRAVITY**-2),
        ("f;PSD in m2/s4/Hz", STANDARD_GRAVITY**-2),
        ("f;PSD (mm/s^2)^2/Hz", 1e-6 * STANDARD_GRAVITY**-2),
        ("f;PSD ((m/s^2)^2/(rad/s))", 2.0 * np.pi * STANDARD_GRAVITY**-2),
    ],
)
def test_the_unit_of_the_heading_is_taken_and_explained(
    tmp_path: Path, heading: str, factor: float
) -> None:
    found = noise(tmp_path, "\n".join([heading, *ROWS]))
    assert_same(found, factor)
    (told,) = found.assumptions()
    assert "its unit" in told and "table.csv" in told
    stated = found.density_unit
    assert_same(noise(tmp_path, "\n".join([heading, *ROWS]), unit=stated), factor)
    other = "N2/Hz" if factor == 1.0 else "g2/Hz"
    with pytest.raises(SceneError) as failure:
        noise(tmp_path, "\n".join([heading, *ROWS]), unit=other)
    ((key, sentence),) = failure.value.problems
    assert key == "unit" and repr(other) in sentence and repr(stated) in sentence


test_a_unit_that_is_not_known_or_not_of_a_density_is_refused = refusals(
    lambda tmp_path, heading, keys: noise(tmp_path, "\n".join([heading, *ROWS]), **keys),
    ("f;PSD (EU^2/Hz)", {}, "needs unit, one of g2/Hz, (m/s2)2/Hz, N2/Hz, got none; above"),
    ("f;PSD", {"unit": "V2/Hz"}, "expected g2/Hz, (m/s2)2/Hz, N2/Hz"),
    ("f;a (g)", {"unit": "g2/Hz"}, "says 'g'"),
    ("f;a (g)", {}, "says 'g', expected the unit of an acceleration density"),
    ("f;PSD ((mm/s)^2/Hz)", {}, "expected the unit of an acceleration density"),
    ("f;PSD (g2/Hz)", {"unit": "dB re 1 g2/Hz"}, "take out the one that is wrong"),
    ("PSD (g2/Hz);f (Hz)", {}, "put the column of frequency first"),
    ("f;PSD", {"unit": "dB"}, "dB re 1 g2/Hz"),
    ("PSD;Frequency", {"unit": "g2/Hz"}, "has the frequency in its second column"),
    ("rpm;PSD (g2/Hz)", {}, "has 'rpm' in its first column, expected the frequency"),
    ("omega;PSD (g2/Hz)", {}, "has 'omega' in its first column, expected the frequency"),
    ("Frequency (rpm);PSD (g2/Hz)", {}, "'rpm' is not a known unit; write Hz, kHz there"),
    ("f / lines;PSD (g2/Hz)", {}, "'lines' is not a known unit; write Hz, kHz there"),
    ("f;PSD (m·s⁻²)²/Hz", {"unit": "g2/Hz"}, "says '(m/s2)2/Hz'"),
    ("f;Level in dB", {"unit": "g2/Hz"}, "must say what 0 dB stands for"),
    ("f;two-sided PSD (g2/Hz)", {}, "expected a one-sided density"),
    ("f;PSD (mV2/Hz)", {"unit": "g2/Hz"}, "expected no mV"),
    ("f;a (g rms)", {"unit": "g2/Hz"}, "says 'g'"),
    ("f;PSD", {"unit": "g"}, "is a unit of another quantity"),
)


def test_a_heading_with_a_unit_that_is_not_known_is_a_caution(tmp_path: Path) -> None:
    unknown = noise(tmp_path, "\n".join(["f;PSD (EU^2/Hz)", *ROWS]), unit="g2/Hz")
    (caution,) = unknown.cautions(0.0, 0.0)
    assert "'EU^2/Hz'" in caution and "g2/Hz" in caution
    for heading in ("f;PSD (g^2/Hz)", "f;PSD (run 3)", "f;PSD"):
        found = noise(tmp_path, "\n".join([heading, *ROWS]), unit="g2/Hz")
        assert found.cautions(0.0, 0.0) == ()


@pytest.mark.parametrize(
    "text",
    ["# Two-Sided Spectrum\nf;PSD (g2/Hz)\n{}", "Spektrum: zweiseitig\nf;PSD (g2/Hz)\n{}",
     "f;PSD (g2/Hz)\n{}\n# double sided, from fft()"],
)  # fmt: skip
def test_a_two_sided_density_is_refused_wherever_the_file_says_so(
    tmp_path: Path, text: str
) -> None:
    rows = "\n".join(ROWS)
    with pytest.raises(SceneError, match="expected a one-sided density; leave out negative"):
        noise(tmp_path, text.format(rows))
    mended = "# was two-sided, now one-sided\nf;PSD (g2/Hz)\n"
    assert_same(noise(tmp_path, mended + rows))


@pytest.mark.parametrize(
    ("heading", "scale"),
    [("f (kHz);PSD (g2/Hz)", 1e-3), ("w (rad/s);PSD (g2/Hz)", 2.0 * np.pi),
     ("f/kHz;PSD (g2/Hz)", 1e-3), ("f (cycles/min);PSD (g2/Hz)", 60.0)],
)  # fmt: skip
def test_frequencies_are_read_in_the_unit_of_their_heading(
    tmp_path: Path, heading: str, scale: float
) -> None:
    rows = [f"{float(row.split(';')[0]) * scale:.12g};{row.split(';')[1]}" for row in ROWS]
    assert_same(noise(tmp_path, "\n".join([heading, *rows]).replace(",", ".")))


@pytest.mark.parametrize(
    ("heading", "unit", "reference"),
    [
        ("", "dB re 1 g2/Hz", 1.0),
        ("", "dB re 1e-6 g^2/Hz", 1e-6),
        ("f;Level (dB re 1 g²/Hz)\n", None, 1.0),
        ("Level in dB re 1 g^2/Hz\n", None, 1.0),
        ("", "dB re (m/s2)2/Hz", STANDARD_GRAVITY**-2),
    ],
)
def test_levels_in_decibels(
    tmp_path: Path, heading: str, unit: str | None, reference: float
) -> None:
    density = PLAIN.table.density / STANDARD_GRAVITY**2 / reference
    rows = [
        f"{f:g};{10.0 * np.log10(g):.8f}" for f, g in zip([10, 20, 40, 80], density, strict=True)
    ]
    assert_same(noise(tmp_path, heading + "\n".join(rows), unit=unit))


def test_levels_without_their_unit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"got -26\.9; say unit = 'dB re 1 g2/Hz'"):
        noise(tmp_path, "10 -26.9\n20 -20\n", unit="g2/Hz")


def test_levels_in_the_scene(tmp_path: Path) -> None:
    levels = (10.0 * np.log10([0.002, 0.01, 0.04, 0.04])).tolist()
    keys = {"frequency_hz": [10, 20, 40, 80], "density": levels}
    assert_same(TabulatedNoise(unit="dB re 1 g2/Hz", **keys))
    with pytest.raises(SceneError, match=r"density.0 must be greater than 0, got -26\.98"):
        TabulatedNoise(unit="g2/Hz", **keys)


def test_rows_in_descending_order_and_rows_without_density_at_the_ends(tmp_path: Path) -> None:
    turned = noise(tmp_path, "\n".join(reversed(ROWS)), unit="g2/Hz")
    assert_same(turned)
    assert "descending order" in " ".join(turned.assumptions())
    ends = noise(tmp_path, "\n".join(["0;1", "5;0", *ROWS, "100;0", "200;0"]), unit="g2/Hz")
    assert_same(ends)
    assert "4 rows without density or frequency at its ends" in " ".join(ends.assumptions())
    assert_same(noise(tmp_path, "\n".join([ROWS[0], *ROWS]), unit="g2/Hz"))


def test_a_table_from_0_hz_may_have_two_rows_or_begin_with_0(tmp_path: Path) -> None:
    flat = noise(tmp_path, "0 0.02\n100 0.02\n", unit="g2/Hz").table
    # it begins at a thousandth of the next frequency
    assert flat.mean_square() == pytest.approx(0.999 * 2.0 * STANDARD_GRAVITY**2, rel=2e-4)
    rising = noise(tmp_path, "0 0\n50 0.02\n100 0.02\n", unit="g2/Hz").table
    assert rising.mean_square() == pytest.approx(1.5 * STANDARD_GRAVITY**2, rel=2e-4)


@pytest.mark.parametrize("decibels", [False, True])
def test_a_table_that_begins_at_0_hz_has_its_energy_up_to_the_next_row(
    tmp_path: Path, decibels: bool
) -> None:
    frequency, density = np.array([0.0, 5.0, 10.0, 30.0]), np.array([0.004, 0.012, 0.015, 0.006])
    heights = 10.0 * np.log10(density) if decibels else density
    rows = "\n".join(f"{f:.12g} {g:.12g}" for f, g in zip(frequency, heights, strict=True))
    found = noise(tmp_path, rows, unit="dB re 1 g2/Hz" if decibels else "g2/Hz")
    # straight lines up to 5 Hz, and the table without its first row from there on
    omega, zeta = 2.0 * np.pi * 3.0, 0.1
    f = np.linspace(5e-3, 5.0, 200_001)
    gain = 1.0 / ((omega**2 - (2 * np.pi * f) ** 2) ** 2 + (2 * zeta * omega * 2 * np.pi * f) ** 2)
    line = np.trapezoid(gain * np.interp(f, frequency, density) * STANDARD_GRAVITY**2, f)
    rest = TabulatedNoise(frequency_hz=frequency[1:], density=density[1:], unit="g2/Hz").table
    above = response_moments([rest], omega, 2.0 * zeta * omega).displacement
    whole = response_moments([found.table], omega, 2.0 * zeta * omega).displacement
    assert whole == pytest.approx(line + above, rel=1e-3)
    assert whole > 10.0 * above  # the first row is not left out
    assert "between 0 and 5 Hz its density is a straight line" in " ".join(found.assumptions())


def test_the_offset_of_a_sensor_at_0_hz_is_left_out(tmp_path: Path) -> None:
    found = noise(tmp_path, "\n".join(["0;5", *ROWS]), unit="g2/Hz")
    assert_same(found)
    assert "1 row without density or frequency" in " ".join(found.assumptions())


def test_a_column_of_slopes_is_a_remark(tmp_path: Path) -> None:
    slopes = ["+3 dB/oct", "flat", "-3 dB/oct", ""]
    rows = [f"{row};{slope}" for row, slope in zip(ROWS, slopes, strict=True)]
    assert_same(noise(tmp_path, "\n".join(["Frequency (Hz);PSD (g2/Hz);slope", *rows])))
    assert_same(noise(tmp_path, "\n".join(rows), unit="g2/Hz"))


@pytest.mark.parametrize("band", ["20-80", "20 to 80", "20\u201380", "20 - 80"])
def test_a_band_in_place_of_a_frequency_is_to_be_written_as_two_rows(
    tmp_path: Path, band: str
) -> None:
    with pytest.raises(SceneError, match=r"line 2: .* got '20.*80'; write its two ends in rows"):
        noise(tmp_path, f"20,0.01\n{band},0.04\n80,0.04\n350,0.04\n", unit="g2/Hz")


def test_two_tables_in_one_file_are_not_to_be_sorted_into_one(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"line 5: .*; keep one table, as a second one seems"):
        noise(tmp_path, "\n".join([*ROWS, *ROWS]), unit="g2/Hz")
    with pytest.raises(SceneError, match=r"line 5: .*; keep one table, as a second one seems"):
        noise(tmp_path, "\n".join(2 * list(reversed(ROWS))), unit="g2/Hz")
    with pytest.raises(SceneError, match=r"line 5: .*; sort the rows, or keep one table if"):
        noise(tmp_path, "\n".join([*ROWS, "30;0,1", "90;0,1"]), unit="g2/Hz")
    with pytest.raises(SceneError, match=r"line 5: .*; keep one table, as a second one seems"):
        noise(tmp_path, "\n".join(3 * [*ROWS]), unit="g2/Hz")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (
            ["10;1", "30;1", "20;1"],
            "line 3: needs increasing frequency_hz (twice the same for a step)",
        ),
        (["10;1", "20;0", "30;1"], "line 2: the density is 0 at 20 Hz, between others"),
        (["10;1", "20;-1", "30;1"], "line 2: needs positive finite values of density, got -1"),
        (
            ["-10;1", "20;1", "30;1"],
            "line 1: needs positive finite values of frequency_hz, got -10",
        ),
        (["10;1", "20;nan", "30;1"], "line 2: needs positive finite values of density, got nan"),
        (["10;1", "20;1", "20;2", "20;3", "30;1"], "line 4: 20 Hz appears three times"),
        (["10;0", "20;0"], "needs positive finite values of density, got none"),
        (["30;1", "20;0", "10;1"], "line 2: the density is 0 at 20 Hz, between others"),
    ],
)
def test_what_no_table_can_hold_is_refused_with_its_line(
    tmp_path: Path, rows: list[str], words: str
) -> None:
    with pytest.raises(SceneError) as failure:
        noise(tmp_path, "\n".join(rows), unit="g2/Hz")
    assert words in str(failure.value) and "table.csv" in str(failure.value)


@pytest.mark.parametrize("turned", [False, True])
def test_a_step_of_a_specification_is_two_tables_side_by_side(tmp_path: Path, turned: bool) -> None:
    rows = ["10 0.002", "40 0.04", "40 0.01", "80 0.01", "300 0.001"]
    found = noise(tmp_path, "\n".join(rows[::-1] if turned else rows), unit="(m/s2)2/Hz")
    parts = [
        Table(frequency_hz=np.array(f), density=np.array(g))
        for f, g in (([10.0, 40.0], [0.002, 0.04]), ([40.0, 80.0, 300.0], [0.01, 0.01, 0.001]))
    ]
    assert found.table.mean_square() == pytest.approx(sum(each.mean_square() for each in parts))
    assert "a step at 40 Hz" in " ".join(found.assumptions())
    for omega in (100.0, 2.0 * np.pi * 40.0, 1000.0):
        whole, apart = (
            response_moments(tables, omega, 0.1 * omega) for tables in ([found.table], parts)
        )
        assert whole.displacement == pytest.approx(apart.displacement, rel=1e-12)
        assert whole.absolute_acceleration == pytest.approx(apart.absolute_acceleration, rel=1e-12)
    assert found.table([39.999, 40.001]) == pytest.approx([0.04, 0.01], rel=1e-3)


@pytest.mark.parametrize("frequency", [[20.0, 20.0], [10.0, 20.0, 20.0, 20.0], [10.0, 30.0, 20.0]])
def test_a_table_needs_two_frequencies_and_no_more_than_two_densities_at_one(frequency) -> None:
    with pytest.raises(ValueError, match="needs increasing frequency_hz"):
        Table(frequency_hz=np.array(frequency), density=np.ones(len(frequency)))


def test_the_column_is_chosen_where_there_are_several(tmp_path: Path) -> None:
    text = "f;Floor (g2/Hz);Roof (N2/Hz)\n" + "\n".join(f"{row};1" for row in ROWS)
    assert_same(noise(tmp_path, text, column="floor"))
    assert_same(noise(tmp_path, text, column=2))
    assert noise(tmp_path, text, column="Roof").density_unit == "N2/Hz"
    for column in (None, "wall", 4, 0):
        with pytest.raises(SceneError, match=r"1 f, 2 Floor \(g2/Hz\), 3 Roof") as failure:
            noise(tmp_path, text, column=column)
        assert failure.value.problems[0][0] == "column"
    with pytest.raises(SceneError, match="has column without a file"):
        TabulatedNoise(profile="navmat-p-9492", column=2)


@pytest.mark.parametrize("heading", ["row;f;PSD (g2/Hz)", ";Freq;PSD (g2/Hz)", ""])
def test_numbers_of_rows_are_not_read_as_frequencies(tmp_path: Path, heading: str) -> None:
    text = "\n".join([heading, *(f"{n};{row}" for n, row in enumerate(ROWS, start=1))])
    if heading:
        assert_same(noise(tmp_path, text, column=3))
    else:
        with pytest.raises(SceneError, match="has the numbers of rows in its first column"):
            noise(tmp_path, text, column=3, unit="g2/Hz")


def test_a_sentence_above_the_headings_may_name_units(tmp_path: Path) -> None:
    """The shipped bumper has one, with another number of parts than the rows."""
    path = tmp_path / "bumper.csv"
    path.write_text(
        "# a rubber bumper, static test: deflection (mm), force (N)\ndeflection_mm,force_N\n"
        "0,0\n0.5,60\n1,150\n"
    )
    law = ForceTable(file=str(path))
    assert law.deflection == (0.0, 0.0005, 0.001) and law.force == (0.0, 60.0, 150.0)


# ------------------------------------------------------------------------------
# Impact pairs from a table: what it says, with units, and the sentence where it says nothing.
# ------------------------------------------------------------------------------


SCENE = """
pairs = {pairs}
[structure]
kind = "matrices"
coordinates = ["tip", "seat"]
mass = [[1, 0], [0, 1]]
damping = [[0.1, 0], [0, 0.1]]
stiffness = [[1, 0], [0, 1]]
[[excitation]]
kind = "white"
intensity = 0.2
on = "tip"
"""

TABLE = """# gaps of the assembly
name,on,between,lower (mm),upper (mm),tolerance (mm)
latch,tip,,-2.5,1.5,0.1
rail,,tip seat,,3,
,seat,,-4,,0.5
"""


def written(folder: Path, table: str, pairs: str = '"gaps.csv"') -> Path:
    (folder / "gaps.csv").write_text(table, encoding="utf-8")
    (folder / "scene.toml").write_text(SCENE.format(pairs=pairs))
    return folder / "scene.toml"


def test_a_table_is_the_pairs_that_it_lists(tmp_path: Path) -> None:
    scene = load_scene(written(tmp_path, TABLE))
    latch, rail, third = scene.impact_pairs
    assert (latch.name, latch.on, latch.between) == ("latch", "tip", None)
    assert (latch.nearest.lower, latch.nearest.upper) == pytest.approx((-0.0024, 0.0014), rel=1e-12)
    assert (rail.between, rail.lower, rail.upper) == (("tip", "seat"), None, 0.003)
    assert third.name == "gaps line 5"
    assert third.nearest.lower == pytest.approx(-0.0035, rel=1e-12)
    assert latch.law == Restitution(coefficient=0.5)
    again = Scene(**scene.document())
    assert again.impact_pairs == scene.impact_pairs


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("name;on;upper [mm];tolerance [mm]", "latch;tip;1,5;0,1"),
        ("upper_mm,on,name,tolerance_mm", "1.5,tip,latch,0.1"),
        ("name\ton\tupper (in)\ttolerance (mil)", "latch\ttip\t0.0590551181102\t3.93700787402"),
        ("Name,On,Upper (m),Tolerance (um)", "latch,tip,0.0015,100"),
    ],
)
def test_units_and_signs_are_read_as_in_any_table(tmp_path: Path, heading: str, row: str) -> None:
    (tmp_path / "gaps.csv").write_text(f"{heading}\n{row}\n", encoding="utf-8")
    (found,) = read_pairs(str(tmp_path / "gaps.csv"))
    assert (found["name"], found["on"]) == ("latch", "tip")
    assert (found["upper"], found["tolerance"]) == pytest.approx((1.5e-3, 1e-4), rel=1e-9)


def test_a_frame_is_the_table_that_its_file_would_be(tmp_path: Path) -> None:
    wanted = load_scene(written(tmp_path, TABLE))
    frame = pd.read_csv(tmp_path / "gaps.csv", comment="#")
    keys = {"structure": wanted.structure, "excitations": wanted.excitations}
    columns = {str(name): frame[name].tolist() for name in frame}
    by_name = frame.fillna({"name": "third"}).set_index("name")
    for table in (frame, columns, frame.convert_dtypes(), by_name, by_name.to_xarray()):
        given = {"values": table} if table is columns else table
        found = Scene(**keys, pairs=given).impact_pairs
        for one, two in zip(found, wanted.impact_pairs, strict=True):
            assert one == two.replace(name=one.name)
        names = [pair.name for pair in found]
        assert names == ["latch", "rail", "third" if "third" in names else "array row 3"]
    law = Restitution(coefficient=0.8)
    shared = Scene(**keys, pairs={"values": frame, "law": law}).impact_pairs
    assert {pair.law for pair in shared} == {law}
    with pytest.raises(SceneError, match=r"array needs the unit of a length in the heading"):
        Scene(**keys, pairs=frame.rename(columns=lambda name: name.split(" ")[0]))
    with pytest.raises(SceneError, match=r"of a table, a frame, or .*, got 3"):
        Scene(**keys, pairs=3)


test_a_table_that_is_not_understood_is_refused = refusals(
    lambda tmp_path, table: load_scene(written(tmp_path, table)),
    ("name,on,upper\nlatch,tip,1.5\n", "needs the unit of a length in the heading of upper"),
    ("name,on,upper (Hz)\nlatch,tip,1.5\n", "needs the unit of a length"),
    ("name,on,uper (mm)\nlatch,tip,1.5\n", "has a column 'uper (mm)', expected name, on"),
    ("name,on,tolerance (mm)\nlatch,tip,1.5\n", "needs lower or upper"),
    ("name,upper (mm),upper (mm)\nlatch,1.5,1.5\n", "each column once"),
    (
        "name,between,upper (mm)\na,tip seat,1\nlatch,tip seat rail,1.5\n",
        "line 3: between must hold two names, as 'tip seat', got 'tip seat rail'",
    ),
    ("name,on,upper (mm)\na,tip,1\nb,tip,x\n", "line 3: expected a number in column 3"),
    ("name,on,upper (mm)\na,tip,1\nb,tip,1,2\n", "line 3: expected 3 numbers"),
    ("name,on,upper (mm)\na,tip,1\na,tip,2\n", "needs a name of its own"),
    ("name,on,upper (mm)\na,rail,1\n", "must be on 'tip' or 'seat', got 'rail'"),
    ("name,on,upper (mm)\n", "holds no rows"),
)


def test_pairs_of_a_table_share_what_the_scene_says_and_stand_behind_others(
    tmp_path: Path, stochvi: Run
) -> None:
    law = '{ kind = "restitution", coefficient = 0.8 }'
    file = written(tmp_path, TABLE, f'{{ file = "gaps.csv", law = {law} }}')
    file.write_text(
        file.read_text() + f'[[impact_pair]]\nname = "own"\non = "tip"\nupper = 1\nlaw = {law}\n'
    )
    names = [pair.name for pair in load_scene(file).impact_pairs]
    assert names == ["own", "latch", "rail", "gaps line 5"]
    assert {pair.law for pair in load_scene(file).impact_pairs} == {Restitution(coefficient=0.8)}
    assert stochvi("screen", file).code == 0
    for wrong in ("3", "{ law = 3 }"):
        with pytest.raises(SceneError, match="pairs must be the name of a table"):
            load_scene(written(tmp_path, TABLE, wrong))


def test_a_tolerance_puts_stops_nearer() -> None:
    law = Restitution(coefficient=0.5)
    pair = ImpactPair(lower=-2.0, upper=3.0, tolerance=0.5, law=law)
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.2)],
    )

    def places(scene: Scene) -> list[float]:
        return [stop.position for stop in model_of(scene).pairs[0].stops]

    def changed(scene: Scene, change: dict[str, float]) -> Scene:
        return changed_scene(scene.document(), tuple(change.items()))

    assert places(scene) == [-1.5, 2.5]
    # as it is written and read again, with other keys, and once for all
    assert places(scene_from(scene.document())) == [-1.5, 2.5]
    assert places(scene.replace(impact_pairs=[pair.replace(upper=4.0)])) == [-1.5, 3.5]
    assert places(changed(scene, {"impact_pair.0.tolerance": 0.25})) == [-1.75, 2.75]
    assert places(scene.expanded) == places(scene.expanded.expanded) == [-1.5, 2.5]
    both = scene.replace(impact_pairs=[ImpactPair(clearance=2.0, tolerance=0.5, law=law)])
    assert places(both) == [-1.5, 1.5]
    assert places(changed(both, {"impact_pair.0.clearance": 3.0})) == [-2.5, 2.5]
    with pytest.raises(SceneError, match="tolerance below half the distance of its stops"):
        ImpactPair(clearance=0.2, tolerance=0.3, law=law)
    with pytest.raises(SceneError, match="differs between units"):
        ImpactPair(upper={"mean": 1.0, "std": 0.1}, tolerance=0.1, law=law)


def test_a_table_is_read_from_python_too(tmp_path: Path) -> None:
    written(tmp_path, TABLE)
    eye = [[1.0, 0.0], [0.0, 1.0]]
    scene = Scene(
        structure=Matrices(coordinates=("tip", "seat"), mass=eye, damping=eye, stiffness=eye),
        pairs=str(tmp_path / "gaps.csv"),
        excitations=[WhiteNoise(intensity=0.2, on="tip")],
    )
    assert scene.pairs is None
    assert scene.impact_pairs == load_scene(tmp_path / "scene.toml").impact_pairs
