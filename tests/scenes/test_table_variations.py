"""Tables of known numbers, written as hands and programs write them: with columns added, moved and
unfilled, headings longer and shorter than the rows, units in lines of their own, comments. What is
read is the known numbers in SI units, or nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from stochvi.identification import ForceCurve, read_test
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import DENSITIES
from stochvi.results.errors import SceneError
from stochvi.scenes.excitations.base import agreed_unit
from stochvi.scenes.readers import SPECTRAL_DENSITY, TIME_RESPONSE, read_columns
from stochvi.scenes.text_tables import Heading

G = 9.80665

T = TypeVar("T")

FACTORS = {
    "time": {"s": 1.0, "ms": 1e-3},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "acceleration": {"g": G, "mg": 1e-3 * G, "m/s2": 1.0, "mm/s^2": 1e-3},
    "density": {"g2/Hz": G**2, "(m/s2)2/Hz": 1.0, "mg^2/Hz": 1e-6 * G**2},
    "length": {"m": 1.0, "mm": 1e-3},
    "force": {"N": 1.0, "kN": 1e3},
}
"""Quantity -> its units -> their size in SI units, written down here anew."""

NAMES = {
    "time": ("time", "t", "Zeit", "Time", "TIME"),
    "frequency": ("frequency", "f", "Freq", "Frequenz"),
    "acceleration": ("acc", "a", "acc z", "Ch 1", "Kanal 3", "seat", "X", "acceleration"),
    "density": ("PSD", "density", "G", "floor 2", "ASD run 3", "Level"),
    "length": ("deflection", "y", "Weg"),
    "force": ("force", "F", "Kraft"),
}

KINDS = {
    "record": ("time", "acceleration"),
    "density": ("frequency", "density"),
    "curve": ("length", "force"),
    "values": ("acceleration",),
}


@dataclass(kw_only=True)
class Written:
    """A file with its text, how it is to be read, and its numbers in SI units."""

    kind: str
    content: bytes
    unit: str | None
    column: int | str | None
    truth: list[Vector]
    told: str


def cell(name: str, unit: str, style: str) -> str:
    """The heading of a column with its unit."""
    if not unit:
        return name
    return {
        "round": f"{name} ({unit})", "square": f"{name} [{unit}]", "tight": f"{name}({unit})",
        "over": f"{name}/{unit}", "word": f"{name}_{unit}", "in": f"{name} in {unit}",
    }[style]  # fmt: skip


def written(random: np.random.Generator) -> Written:
    """A file with some of everything."""

    def pick(choices: Sequence[T]) -> T:
        return choices[int(random.integers(len(choices)))]

    def now_and_then(chance: float) -> bool:
        return bool(random.random() < chance)

    kind = pick(list(KINDS))
    quantities = KINDS[kind]
    rows = int(random.integers(5, 14))
    units = [pick(list(FACTORS[each])) for each in quantities]
    if kind != "values" and now_and_then(0.5):
        units[0] = next(iter(FACTORS[quantities[0]]))
    delimiter = pick([",", ";", "\t", "|", "  ", ", ", "; "])
    comma = delimiter.strip() not in ("", ",") and now_and_then(0.3)

    def number(value: float, digits: int = 6) -> str:
        text = pick([f"{value:.{digits}g}", f"{value:.{digits - 1}e}"])
        return text.replace(".", ",") if comma else text

    step = float(pick([0.001, 0.0025, 0.005]))
    plain: list[Vector] = []
    for quantity in quantities:
        if quantity == "time":
            plain.append(step * np.arange(rows))
        elif quantity in ("frequency", "length"):
            plain.append(0.001 + np.cumsum(random.integers(1, 90, rows) / 1000.0))
        elif quantity == "force":
            plain.append(np.cumsum(random.integers(1, 900, rows) / 8.0))
        elif quantity == "density":
            plain.append(random.integers(1, 9000, rows) / 800.0)
        else:
            plain.append(random.integers(-9000, 9000, rows) / 800.0)
    truth = [
        values * FACTORS[quantity][unit]
        for values, quantity, unit in zip(plain, quantities, units, strict=True)
    ]
    if quantities[0] == "time":  # in the unit of the file, so that the step is that of a record
        plain[0] = plain[0] / FACTORS["time"][units[0]]
        truth[0] = step * np.arange(rows)
    blanks = delimiter.strip() == ""
    style = pick(["round", "square", "tight", "over", "word", "in", "round", "square"])
    style = "tight" if blanks and style == "in" else style
    titled = now_and_then(0.9)
    of_units = titled and now_and_then(0.25)
    silent = titled and now_and_then(0.15)  # no units at all
    if not titled or silent:
        for place, quantity in enumerate(quantities[:-1]):
            first = next(iter(FACTORS[quantity]))
            plain[place] = plain[place] * FACTORS[quantity][units[place]]
            units[place] = first
    columns = [[number(value, 9) for value in values] for values in plain]
    names = [pick(NAMES[each]) for each in quantities]
    stated = [*units]
    target = len(columns) - 1
    # further columns
    for _ in range(int(random.choice([0, 0, 1, 1, 2]))):
        what = pick(["count", "number", "empty", "remark", "other", "late"])
        # without headings the first column is that of times or frequencies
        at = int(random.integers(0 if titled else len(columns), len(columns) + 1))
        if kind == "curve" and what != "empty":
            what, at = "empty", len(columns)
        if what in ("empty", "remark", "late"):
            at = len(columns) if now_and_then(0.8) else at
        body = {
            "count": [str(n + 1) for n in range(rows)],
            "number": [number(20.0 + n / 8.0) for n in range(rows)],
            "empty": [""] * rows,
            "remark": ["ok" if n % 3 else "" for n in range(rows)],
            "other": [number(float(value)) for value in random.integers(-99, 99, rows) / 8.0],
            "late": [number(21.5) if n % 4 == 2 else "" for n in range(rows)],
        }[what]
        name = {
            "count": pick(["No.", "Sample", "#", "row", "run"]), "number": pick(["Temp", "T"]),
            "empty": pick(["comment", "remark", "note", ""]), "remark": "comment",
            "other": pick(["b", "Ch 2", "acc y"]), "late": "Temp",
        }[what]  # fmt: skip
        columns.insert(at, body)
        names.insert(at, name)
        stated.insert(at, pick(["g", "m/s2", "", "N"]) if what == "other" else "")
        target += at <= target
    lost = put_in = False
    if blanks:
        kept = [n for n, body in enumerate(columns) if all(body)]
        unfilled = [n for n in range(len(columns)) if n not in kept]
        if silent or any(n < kept[-1] for n in unfilled):  # blanks cannot stand for an empty cell
            names = [names[n] for n in kept]
            stated = [stated[n] for n in kept]
        target = kept.index(target)
        columns = [columns[n] for n in kept]
    cells = [
        cell(name, "" if of_units or silent else unit, style)
        for name, unit in zip(names, stated, strict=True)
    ]
    if blanks:
        cells = [each.replace(" ", "") for each in cells]
    quoted = now_and_then(0.1) and not blanks
    line_of_units = [pick([unit, f"[{unit}]", f"({unit})"]) if unit else "" for unit in stated]
    # words between blanks without a unit may be a sentence
    if titled and now_and_then(0.25) and not (blanks and (silent or not any(stated))):
        at = int(random.integers(len(cells) + 1))
        if now_and_then(0.5) and len(cells) > 1:
            at = min(at, len(cells) - 1)
            # what no text states nobody can read
            whole = all(map(any, columns[len(cells) - 1 :])) and len(cells) == len(columns)
            if whole and (stated[at] in ("", "s", "Hz", "m") or at == target):
                lost = at == target
                del cells[at], line_of_units[at]
        else:
            cells.insert(at, pick(["comment", "run", "remark", "Temp", "flag"]))
            put_in = True
            line_of_units.insert(at, "")
    glue = delimiter if not now_and_then(0.1) else pick([",", ";", "\t", ", "])
    if blanks:
        line_of_units = [each or "-" for each in line_of_units]
        glue = delimiter
    head = []
    if titled:
        wrap = '"{}"' if quoted else "{}"
        lines = [glue.join(wrap.format(each) for each in cells)]
        if of_units:
            lines.append(glue.join(line_of_units))
            if now_and_then(0.15):
                lines.reverse()
        mark = pick(["", "", "", "# ", "% ", "// "])
        head = [mark + line for line in lines]
    notes = ["# run 4", "measured in May", "Sampling rate: 400 Hz", "# by Ann, Bob", "Logger 4711"]
    if now_and_then(0.3):
        at = 0 if now_and_then(0.6) else len(head)
        put = [pick(notes) for _ in range(int(random.integers(1, 6)))]
        if at:  # below a heading a comment alone is usual
            put = [f"# {each.lstrip('# ')}" for each in put]
        head[at:at] = put
    # a heading that is as wide as padded rows is that of their columns
    padding = "" if put_in else pick(["", "", "", "", delimiter.strip(), 3 * delimiter.strip()])
    body = []
    for row in zip(*columns, strict=True):
        around = '"{}"' if quoted and now_and_then(0.5) else "{}"
        text = delimiter.join(around.format(each) for each in row)
        body.append(text + padding)
        if now_and_then(0.02):
            body.append(pick(["", "# a bump", "  ", "// stop"]))
    end = pick(["\n", "\r\n"])
    text = end.join([*head, *body]) + end
    encoding = pick(["utf-8", "utf-8", "utf-8-sig", "utf-16", "cp1252"])
    own = units[-1]
    wrong = pick([each for each in FACTORS[quantities[-1]] if each != own])
    # a wrong unit is to be refused where the file states the right one
    unit = pick([None, own, wrong]) if titled and not silent and not lost else own
    if kind == "curve" and unit is not None:
        unit = f"{units[0]},{unit}"
    column: int | str | None = None
    if len(columns) > len(quantities) and kind != "curve" and now_and_then(0.85):
        column = target + 1
        if titled and now_and_then(0.4):
            column = names[target] if not blanks else cells[min(target, len(cells) - 1)]
            if len(columns) != len(cells):
                column = target + 1
    return Written(
        kind=kind, content=text.encode(encoding), unit=unit, column=column, truth=truth, told=text,
    )  # fmt: skip


def numbers_of(case: Written, path: Path) -> list[Vector]:
    """What is read from a file, in SI units; raises what refuses it."""
    path.write_bytes(case.content)
    quantities = KINDS[case.kind]
    if case.kind == "curve":
        curve = read_test(path, "force", unit=case.unit)
        assert isinstance(curve, ForceCurve)
        return [curve.deflection, curve.observed]
    names = ("time", "acceleration")[-len(quantities) :]
    record = case.kind != "density"
    columns = read_columns(
        path, ("frequency_hz", "density") if not record else names, column=case.column,
        function_type=TIME_RESPONSE if record else SPECTRAL_DENSITY,
    )  # fmt: skip
    allowed = ("acceleration", "force") if record else DENSITIES
    if columns.x is not None and not np.all(np.diff(columns.x) > 0.0):
        raise SceneError("falls")  # records and tables of a density refuse that
    values = agreed_unit(case.unit, columns, allowed).to_si(columns.y)
    return [values] if columns.x is None else [columns.x, values]


def faults_of(seeds: range, folder: Path) -> tuple[Counter[str], list[str]]:
    """How often files were read and refused, and those that gave other numbers."""
    counts: Counter[str] = Counter()
    faults = []
    for seed in seeds:
        case = written(np.random.default_rng(seed))
        try:
            found = numbers_of(case, folder / "table.csv")
        except (SceneError, ValueError):
            counts["refused"] += 1
            continue
        counts["read"] += 1
        same = len(found) == len(case.truth) or (case.kind == "values" and len(found) == 2)
        pairs = zip(found[-len(case.truth) :], case.truth, strict=True)
        if not same or not all(
            len(one) == len(two) and np.allclose(one, two, rtol=1e-7, atol=1e-12)
            for one, two in pairs
        ):
            faults.append(f"seed {seed}: unit {case.unit}, column {case.column}\n{case.told}")
    return counts, faults


def test_a_table_is_its_numbers_or_nothing(tmp_path: Path) -> None:
    counts, faults = faults_of(range(120), tmp_path)
    assert not faults, faults[0]
    assert counts["read"] > counts.total() / 2


@pytest.mark.verify
def test_many_tables_are_their_numbers_or_nothing(tmp_path: Path) -> None:
    counts, faults = faults_of(range(20_000), tmp_path)
    assert not faults, faults[0]
    assert counts["read"] > counts.total() / 2


def test_a_reader_that_passes_over_headings_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "stochvi.scenes.text_tables.headings_above",
        lambda above, delimiter, count, *_: [Heading()] * count,
    )
    assert len(faults_of(range(80), tmp_path)[1]) > 1
