"""Spectra that `stochvi spectrum --out` wrote, as the excitation of another scene."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.units import unit
from stochvi.results.errors import SceneError
from stochvi.scenes.foreign_files import LARGEST_DATA_FILE
from stochvi.scenes.readers import Columns
from stochvi.scenes.text_cells import as_text
from stochvi.scenes.text_tables import decoded

HEADING = ("of", "quantity", "frequency_hz", "value", "standard_error", "unit")
"""Names of the columns of a `spectrum.csv` that are read; the file has more columns."""

QUANTITY = "acceleration"
"""Quantity in the file that excites a mount on a mass: the absolute acceleration of the mass."""


class EstimatedDensity(NamedTuple):
    """A density that was estimated by simulation, and a sentence about its error."""

    columns: Columns
    error: str


def is_response_spectrum(path: Path) -> bool:
    """Whether a file begins as a `spectrum.csv` does; False for what cannot be read."""
    if not path.is_file():  # reading a pipe would wait for its writer
        return False
    try:
        with path.open(encoding="utf-8-sig") as file:
            cells = next(csv.reader([file.readline(1000)]), [])
    except (OSError, ValueError, csv.Error):
        return False
    return set(HEADING) <= set(cells)


def read_response_spectrum(path: Path, of: str | None) -> EstimatedDensity:
    """The density of the absolute acceleration of a coordinate, (m/s^2)^2/Hz.

    Parameters
    ----------
    path
        A `spectrum.csv`.
    of
        Name of the coordinate; None if the file holds only one.

    Raises
    ------
    SceneError
        If the file is no such table, or does not hold the acceleration of that coordinate.
    """
    if not is_response_spectrum(path):
        raise SceneError(
            [("of", f"chooses a coordinate of a spectrum.csv that `stochvi spectrum --out` wrote, "
              f"got {path.name} without its columns {', '.join(HEADING)}; column = chooses one of "
              "another table")]
        )  # fmt: skip
    try:
        table = list(csv.DictReader(decoded(path, LARGEST_DATA_FILE).splitlines()))
    except csv.Error as reason:
        raise SceneError([("file", f"{path} cannot be read: {reason}; write it again")]) from None
    owners = list(dict.fromkeys(row["of"] for row in table if row["quantity"] == QUANTITY))
    if not owners:
        raise SceneError(
            [("file", f"{path} holds no absolute acceleration: the spectra of a scene have none "
              "where a force acts on a mass; use the spectra of a scene whose base alone moves")]
        )  # fmt: skip
    of = None if of is None else as_text(of)
    if of is None and len(owners) > 1:
        raise SceneError([("of", f"must say whose acceleration is meant: {_listed(owners)}")])
    if of is not None and of not in owners:
        raise SceneError([("of", f"must be {_listed(owners)}, got {of!r}")])
    chosen = [
        row for row in table if row["of"] == (of or owners[0]) and row["quantity"] == QUANTITY
    ]
    try:
        frequency, density, error = (
            np.array([float(row[name]) for row in chosen])
            for name in ("frequency_hz", "value", "standard_error")
        )
        stated = unit(chosen[0]["unit"])
    except (TypeError, ValueError) as reason:
        raise SceneError(
            [("file", f"{path} holds a row with a text in place of a number: {reason}")]
        ) from None
    known = density > 0.0
    relative = 100.0 * float(np.median(error[known] / density[known])) if known.any() else 0.0
    whole = 100.0 * float(error.sum() / density.sum()) if known.any() else 0.0
    return EstimatedDensity(
        Columns(x=frequency, y=density, unit=stated, stated_in=path.name),
        f"it is the acceleration of {of or owners[0]}, estimated by simulation: {relative:.2g} % "
        f"standard error at a frequency (median), less than {whole:.2g} % of the mean square; the "
        "intervals of results computed from it do not include that, nor a motion that is not "
        "Gaussian",
    )


def _listed(names: list[str]) -> str:
    return " or ".join(repr(name) for name in names)
