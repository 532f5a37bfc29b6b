"""Tables of a density as they come: steps, zeros, order, levels, and the units that they state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stochvi import ForceTable, SceneError, TabulatedNoise
from stochvi.mathematics.spectra import Table, response_moments
from stochvi.mathematics.units import STANDARD_GRAVITY

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


@pytest.mark.parametrize(
    ("heading", "keys", "words"),
    [
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
    ],
)
def test_a_unit_that_is_not_known_or_not_of_a_density_is_refused(
    tmp_path: Path, heading: str, keys: dict[str, str], words: str
) -> None:
    with pytest.raises(SceneError) as failure:
        noise(tmp_path, "\n".join([heading, *ROWS]), **keys)
    assert words in str(failure.value)


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


def test_two_tables_in_one_file_are_not_to_be_sorted_into_one(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"line 5: .*; keep one table, as a second one seems"):
        noise(tmp_path, "\n".join([*ROWS, *ROWS]), unit="g2/Hz")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["10;1", "30;1", "20;1"], "line 3: needs increasing frequency_hz"),
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
