"""Files that other programs wrote are read and judged: statistics, averages of each path, or
records."""

from __future__ import annotations

import csv
import difflib
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arguments import checked
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.text_tables import check_file, read_text
from stochvi.verification.testing.documents import read_problem
from stochvi.verification.testing.judging import Judgement, judge_returned
from stochvi.verification.testing.known_answers import known_answers
from stochvi.verification.testing.problems import Problem
from stochvi.verification.testing.reference_values import PATHS, RELAXATIONS, known_problems, solved
from stochvi.verification.testing.samples import (
    AVERAGES,
    BATCHES,
    FEWEST_PATHS,
    QUANTITIES,
    SHORTEST_BATCH,
    plain_name,
    returnable,
    split,
)

if TYPE_CHECKING:
    import pandas as pd

STATISTICS, PER_PATH, RECORDS = "statistics", "averages", "records"
FORMATS = (STATISTICS, PER_PATH, RECORDS)
"""The forms of a file: a row for each quantity, for each path, or for each time of each path."""

LARGEST_SHEET = 2_000_000_000
"""Largest size of a file of records, bytes: 10,000 paths of 1,000 samples take 500 million."""

SHORT_NAMES = {"x": "displacement", "v": "velocity"}
"""Short names that columns of records may have, with the names for which they stand."""

STEP_ERROR = 1e-3
"""Largest difference between one time step of a record and the mean step that passes for rounding
of the times; relative to the mean step."""

MOST_BAD_WORDS = 40
"""Number of characters of a wrong entry that a message shows."""


@dataclass(frozen=True)
class Sheet:
    """A table with a header: its cells, which are texts or numbers, and the number of each row in
    its source."""

    source: str
    header: tuple[str, ...]
    cells: Sequence[Sequence[Any]] | NDArray[np.float64]
    rows: Sequence[int]

    def numbers(self) -> NDArray[np.float64]:
        """All cells as numbers, (rows, columns)."""
        try:
            return np.array(self.cells, dtype=float)
        except (TypeError, ValueError):
            for row, cells in enumerate(self.cells):
                for name, cell in zip(self.header, cells, strict=True):
                    self.number(cell, row, name)
            raise

    def number(self, cell: Any, row: int, name: str) -> float:
        """A cell as a number."""
        try:
            return float(cell)
        except (TypeError, ValueError):
            got = repr(cell)[:MOST_BAD_WORDS]
            raise self.wrong(row, f"column {name}: expected a number, got {got}") from None

    def wrong(self, row: int, sentence: str) -> ValueError:
        """An error that names the source and the row."""
        return ValueError(f"{self.source}, row {self.rows[row]}, {sentence}")


@checked
def judge_file(
    path: str | Path,
    problem: str | Path,
    *,
    format: str | None = None,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
    allowed_percent: float = 0.0,
) -> Judgement:
    """Judge the file that another program wrote for a problem.

    Parameters
    ----------
    path
        A text file with a header, its columns separated by commas, semicolons or tabs. Statistics
        have the columns quantity, value, standard_error and, if wanted, bias. Averages have a row
        for each path and a column for each average. Records have the columns time, displacement
        and velocity (or x and v), path where there are several, and impact_speed if wanted; rows
        before the burn-in is over are left out.
    problem
        Name of a problem that ships, or the file of one that `stochvi problems` wrote.
    format
        One of `FORMATS`; None to recognise it by the header.
    paths, relaxations
        Number of paths, and their length in relaxation times, that a problem that ships asks for; a
        file of a problem states its own.
    allowed_percent
        A bias that is harmless, in per cent of each quantity.

    Returns
    -------
    Judgement
        The verdict; `read_as` says how the file was read.

    Raises
    ------
    ValueError
        If the file cannot be read in this form; the message names the file, the row and the column.

    See Also
    --------
    stochvi.testing.judge : The same of a function.
    stochvi.testing.read_problem : A problem from its file.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "mine.csv"
    >>> _ = file.write_text("quantity,value,standard_error\\nvelocity_std,1.001,0.004\\n")
    >>> judge_file(file, "linear").passed
    True
    """
    known = problem_named(problem, paths=paths, relaxations=relaxations)
    return judge_sheet(read_sheet(path), *known, format=format, allowed_percent=allowed_percent)


def problem_named(
    problem: str | Path, *, paths: int = PATHS, relaxations: float = RELAXATIONS
) -> tuple[Problem, Response]:
    """A problem by its name or from its file, with its answer."""
    # a name comes before a file of that name, which may be the program that is judged
    if str(problem) not in known_answers() and (
        Path(problem).suffix.lower() == ".json" or Path(problem).is_file()
    ):
        own = read_problem(problem)
        truth = solved(own.scene, own.speed_threshold)
        thresholds = {pair["speed_threshold"] for pair in truth.impact_pairs.values()}
        if thresholds and thresholds != {own.speed_threshold}:
            raise ValueError(
                f"{problem}: speed_threshold must be 0 where the answer is a closed form, which "
                f"counts all impacts, got {own.speed_threshold:g}"
            )
        return own, truth
    if str(problem) not in known_answers():
        near = difflib.get_close_matches(str(problem), known_answers(), n=1)
        raise ValueError(
            "problem must be a name that `stochvi problems` lists, or a .json file that it wrote, "
            f"got {str(problem)!r}" + (f"; did you mean {near[0]!r}?" if near else "")
        )
    (known,) = known_problems([str(problem)], paths=paths, relaxations=relaxations)
    return known


def judge_sheet(
    sheet: Sheet,
    problem: Problem,
    truth: Response,
    *,
    format: str | None = None,
    allowed_percent: float = 0.0,
) -> Judgement:
    """Judge a table by the known answer of a problem."""
    form = _recognised(sheet, problem) if format is None else format
    if form == STATISTICS:
        returned: dict[str, Any] = _statistics(sheet, problem)
        content = f"statistics of {len(returned)} quantities"
    elif form == PER_PATH:
        returned = _averages(sheet, problem)
        content = f"averages of {len(sheet.cells)} paths"
    elif form == RECORDS:
        returned, problem, content = _records(sheet, problem)
    else:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {form!r}")
    try:
        verdict = judge_returned(problem, truth, returned, allowed_percent=allowed_percent)
    except ValueError as error:
        text = str(error).replace("integrator returned", "holds")
        raise ValueError(f"{sheet.source}: {text}") from None
    return replace(verdict, read_as=f"{sheet.source} was read as {content}")


# Reading ----------------------------------------------------------------------------------------


def read_sheet(path: str | Path) -> Sheet:
    """The table of a text file; empty lines and lines that begin with # are left out."""
    check_file(Path(path), LARGEST_SHEET)
    try:
        with Path(path).open(encoding="utf-8-sig") as file:
            place, first = next(
                ((number, line) for number, line in enumerate(file, start=1) if _holds(line)),
                (0, ""),
            )
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not text in UTF-8; write it as a CSV file") from None
    separator = max(";\t,", key=first.count)
    header = tuple(name.strip() for name in next(_rows(path, [first], separator), []))
    twice = [name for number, name in enumerate(header) if name in header[:number]]
    if twice:
        raise ValueError(f"{path}, header: the column {twice[0]!r} stands there twice")
    cells = None if "quantity" in header else _all_numbers(path, separator, place)
    if cells is not None and len(cells) and cells.shape[1] == len(header):
        return Sheet(str(path), header, cells, range(place + 1, place + 1 + len(cells)))
    return _texts(path, separator, header)


def _rows(path: str | Path, lines: Sequence[str], separator: str) -> Iterator[list[str]]:
    """The cells of each line."""
    try:
        yield from csv.reader(lines, delimiter=separator)
    except csv.Error as error:
        raise ValueError(f"{path} is not a table of numbers: {error}; write it again") from None


def _holds(line: str) -> bool:
    """Whether a line holds anything but a comment."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _all_numbers(path: str | Path, separator: str, header: int) -> NDArray[np.float64] | None:
    """The rows below the header if all cells are numbers, else None; this is quick for long
    files."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on a file without rows
            return np.loadtxt(
                path, delimiter=separator, skiprows=header, ndmin=2, encoding="utf-8-sig",
                quotechar='"',
            )  # fmt: skip
    except ValueError:
        return None


def _texts(path: str | Path, separator: str, header: tuple[str, ...]) -> Sheet:
    """The table as texts, so that a cell that is wrong can be named."""
    lines = read_text(Path(path), LARGEST_SHEET).splitlines()
    kept = [(number, line) for number, line in enumerate(lines, start=1) if _holds(line)][1:]
    if not kept:
        raise ValueError(f"{path} must hold a header and at least one row below it, got none")
    cells = list(_rows(path, [line for _, line in kept], separator))
    if separator != ",":
        cells = [[cell.replace(",", ".") for cell in row] for row in cells]  # decimal commas
    for (number, _), row in zip(kept, cells, strict=True):
        if len(row) != len(header):
            comma = "; write decimals with a point" if separator == "," else ""
            raise ValueError(
                f"{path}, row {number}: expected {len(header)} columns as in the header "
                f"({', '.join(header)}), got {len(row)}{comma}"
            )
    return Sheet(str(path), header, cells, [number for number, _ in kept])


def sheet_of(frame: pd.DataFrame) -> Sheet:
    """The table of a DataFrame; rows are counted from 0."""
    return Sheet(
        "the frame", tuple(map(str, frame.columns)), frame.to_numpy().tolist(), range(len(frame))
    )


def _recognised(sheet: Sheet, problem: Problem) -> str:
    """The form of a table by its header."""
    names = set(sheet.header)
    if "quantity" in names:
        return STATISTICS
    if "time" in names:
        return RECORDS
    averages = returnable(problem, AVERAGES)
    if names & {*averages, *returnable(problem, QUANTITIES)} or any(
        plain_name(problem, name) in averages for name in names
    ):
        return PER_PATH
    raise ValueError(
        f"{sheet.source}, header: expected the columns quantity, value, standard_error "
        "(statistics), time, x, v (records), or averages of each path "
        f"({', '.join(averages)}), got {', '.join(sheet.header)}"
    )


def _needed(sheet: Sheet, *names: str, form: str) -> None:
    missing = [name for name in names if name not in sheet.header]
    if missing:
        raise ValueError(
            f"{sheet.source}, header: {form} need the column {missing[0]}, got "
            f"{', '.join(sheet.header)}"
        )


def _statistics(sheet: Sheet, problem: Problem) -> dict[str, Estimate]:
    _needed(sheet, "quantity", "value", "standard_error", form="statistics")
    unknown = set(sheet.header) - {"quantity", "value", "standard_error", "bias", "unit"}
    if unknown:
        raise ValueError(
            f"{sheet.source}, header: expected quantity, value, standard_error and bias, got "
            f"{sorted(unknown)[0]!r}"
        )
    known = returnable(problem, QUANTITIES)
    found: dict[str, Estimate] = {}
    for row, cells in enumerate(sheet.cells):
        entry = dict(zip(sheet.header, cells, strict=True))
        stated = str(entry["quantity"]).strip()
        name = plain_name(problem, stated)
        if name not in known:
            root = name.replace("_mean_square", "_std")
            remedy = f"; give its root, {root}" if root in known else ""
            raise sheet.wrong(
                row,
                f"column quantity: expected one of {', '.join(known)}, got {stated!r}{remedy}",
            )
        if name in found:
            raise sheet.wrong(row, f"column quantity: {stated} stands there twice")
        value = sheet.number(entry["value"], row, "value")
        error = sheet.number(entry["standard_error"], row, "standard_error")
        bias = sheet.number(entry.get("bias", 0.0) or 0.0, row, "bias")
        if not math.isfinite(value):
            raise sheet.wrong(
                row,
                f"column value: expected a finite number, got {value}; the integration may have "
                "grown beyond all bounds",
            )
        # a count of 0 has no error of its own; every other number needs one
        if not (0.0 < error < math.inf or (error == 0.0 and value == 0.0)):
            raise sheet.wrong(
                row,
                f"column standard_error: expected a number above 0, got {error:g}; it is the "
                "standard deviation of the averages of the paths over the root of their number",
            )
        if not 0.0 <= bias < math.inf:
            raise sheet.wrong(row, f"column bias: expected a number of at least 0, got {bias:g}")
        found[name] = Estimate(value=value, standard_error=error, bias=bias)
    return found


def _averages(sheet: Sheet, problem: Problem) -> dict[str, NDArray[np.float64]]:
    known = returnable(problem, AVERAGES)
    for name in sheet.header:
        if name != "path" and plain_name(problem, name) not in known:
            square = name.replace("_std", "_mean_square")
            remedy = f"; write {square}" if plain_name(problem, square) in known else ""
            raise ValueError(
                f"{sheet.source}, header: expected the averages {', '.join(known)}, and path if "
                f"wanted, got {name!r}{remedy}"
            )
    if len(sheet.cells) < FEWEST_PATHS:
        raise ValueError(
            f"{sheet.source}: expected averages of at least {FEWEST_PATHS} independent paths, a "
            f"row each, got {len(sheet.cells)}"
        )
    columns = sheet.numbers().T
    return {
        name: column for name, column in zip(sheet.header, columns, strict=True) if name != "path"
    }


def _records(sheet: Sheet, problem: Problem) -> tuple[dict[str, Any], Problem, str]:
    """The records of all paths after the burn-in, the problem with the paths and the duration that
    were found, and how the file was read."""
    _needed(sheet, "time", form="records")
    names = {name: _record_name(sheet, problem, name) for name in sheet.header}
    values = sheet.numbers()
    columns = {names[name]: column for name, column in zip(sheet.header, values.T, strict=True)}
    time, path = columns.pop("time"), columns.pop("path", np.zeros(len(values)))
    finite = np.isfinite(time)
    if not finite.all():
        row = int(np.argmin(finite))
        raise sheet.wrong(row, f"column time: expected a finite number, got {time[row]:g}")
    order = np.lexsort((time, path))
    counts = np.unique(path, return_counts=True)[1]
    if len(set(counts.tolist())) > 1:
        raise ValueError(
            f"{sheet.source}: expected the same times for all paths, got {counts.min()} rows of "
            f"one path and {counts.max()} of another"
        )
    shape = (len(counts), int(counts[0]))
    times = time[order].reshape(shape)
    step = _step(sheet, times, order.reshape(shape))
    kept = times[0] > problem.burn_in - 0.5 * step
    if kept.sum() < 2:
        raise ValueError(
            f"{sheet.source}: records end at {times.max():.6g} s, but the burn-in lasts "
            f"{problem.burn_in:.6g} s from the start of a path; times count from that start"
        )
    found = {name: column[order].reshape(shape)[:, kept] for name, column in columns.items()}
    duration = float(kept.sum() * step)
    if shape[0] == 1:
        needed = BATCHES * SHORTEST_BATCH * problem.relaxation_time
        if duration < needed:
            raise ValueError(
                f"{sheet.source}: expected {needed:.4g} s or more of a single path after the "
                f"burn-in of {problem.burn_in:.4g} s, or {FEWEST_PATHS} or more paths, got "
                f"{duration:.4g} s"
            )
        found = {name: column[0] for name, column in found.items()}
    elif shape[0] < FEWEST_PATHS:
        raise ValueError(
            f"{sheet.source}: expected records of one long path, or of at least {FEWEST_PATHS} "
            f"independent paths, got {shape[0]}"
        )
    content = (
        f"records of {shape[0]} {'path' if shape[0] == 1 else 'paths'}, {duration:.6g} s in steps "
        f"of {step:.4g} s after the burn-in of {problem.burn_in:.6g} s"
    )
    return found, replace(problem, paths=shape[0], duration=duration), content


def _record_name(sheet: Sheet, problem: Problem, name: str) -> str:
    """The name of a record that a column stands for: x and v may be short, and one oscillator
    may have its owner named."""
    owner, short = split(name)
    full = plain_name(problem, owner + SHORT_NAMES.get(short, short))
    known = returnable(problem, ("displacement", "velocity", "impact_speed"))
    if full not in known and name not in ("time", "path"):
        raise ValueError(
            f"{sheet.source}, header: expected the records time, path, {', '.join(known)} (or x "
            f"and v for displacement and velocity), got {name!r}"
        )
    return full


def _step(sheet: Sheet, times: NDArray[np.float64], rows: NDArray[np.intp]) -> float:
    """The time step of records, which must be the same throughout."""
    if times.shape[1] < 2:
        raise ValueError(f"{sheet.source}: expected two or more times of each path, got 1")
    steps = np.diff(times, axis=1)
    step = float(np.median(steps))
    wrong = np.abs(steps - step) > STEP_ERROR * step + 1e-9 * np.abs(times).max()
    apart = np.abs(times[:, 0] - times[0, 0]) > 0.5 * step
    if wrong.any():
        path, place = divmod(int(wrong.argmax()), wrong.shape[1])
        raise sheet.wrong(
            int(rows[path, place + 1]),
            f"column time: expected equal steps of {step:.6g} s, got "
            f"{times[path, place + 1]:.9g} s after {times[path, place]:.9g} s",
        )
    if apart.any():
        late = int(apart.argmax())
        raise sheet.wrong(
            int(rows[late, 0]),
            f"column time: expected every path to begin at {times[0, 0]:.6g} s, got "
            f"{times[late, 0]:.6g} s",
        )
    return step


def judge_anything(
    problem: str | Path,
    found: Any,
    *,
    allowed_percent: float = 0.0,
    paths: int = PATHS,
    relaxations: float = RELAXATIONS,
    seed: int = 0,
) -> Judgement:
    """Judge a function, a DataFrame, a mapping or a file by the answer of one problem.

    Parameters
    ----------
    found
        A function of (problem, seed) as `judge` takes it; a DataFrame of statistics, averages or
        records, as a file has them; a mapping as such a function returns it; or the name of a file.
    """
    known, truth = problem_named(problem, paths=paths, relaxations=relaxations)
    if callable(found):
        found = found(known, seed)
    if isinstance(found, str | Path):
        return judge_sheet(read_sheet(found), known, truth, allowed_percent=allowed_percent)
    if hasattr(found, "columns") and hasattr(found, "to_numpy"):
        return judge_sheet(sheet_of(found), known, truth, allowed_percent=allowed_percent)
    if not isinstance(found, Mapping):
        raise ValueError(
            "expected a function of (problem, seed), a DataFrame, a mapping or the name of a file, "
            f"got {type(found).__name__}"
        )
    return judge_returned(known, truth, found, allowed_percent=allowed_percent)
