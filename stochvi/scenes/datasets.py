"""Profiles, scenes and reference tables that ship with the package, and tables of the user."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stochvi.results.errors import SceneError

LARGEST_TEXT_FILE = 10_000_000
"""Largest size of a table or scene file, bytes: such files have some kilobytes."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """A tabulated environment: breakpoints in hertz and g^2/Hz, log-log straight between them."""

    name: str
    frequency_hz: tuple[float, ...]
    density: tuple[float, ...]
    stated_g_rms: float
    source: str


def data_folder() -> Path:
    """The folder `data/`: inside an installed wheel, or next to the package in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "data", package.parent / "data"):
        if (folder / "psd_profiles").is_dir():
            return folder
    raise SceneError(f"the folder data/ is missing next to {package}; reinstall stochvi")


@cache
def profiles() -> dict[str, Profile]:
    """Every profile that ships, by name.

    >>> profiles()["navmat-p-9492"].frequency_hz
    (20.0, 80.0, 350.0, 2000.0)
    """
    folder = data_folder() / "psd_profiles"
    with (folder / "index.csv").open(newline="", encoding="utf-8") as index:
        rows = list(csv.DictReader(index))
    found = {}
    for row in rows:
        frequency, density = read_table(folder / f"{row['profile']}.csv")
        found[row["profile"]] = Profile(
            name=row["profile"],
            frequency_hz=tuple(frequency.tolist()),
            density=tuple(density.tolist()),
            stated_g_rms=float(row["stated_g_rms"]),
            source=row["source"],
        )
    return found


def shipped_scene(name: str) -> Path:
    """Path of a scene that ships, `data/scenes/NAME.toml`."""
    path = data_folder() / "scenes" / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(entry.stem for entry in path.parent.glob("*.toml")))
        raise SceneError(f"scene {name!r} does not ship; known: {known}")
    return path


def zoo_files() -> dict[str, Path]:
    """Every scene of the zoo, `data/scenes/zoo/NAME.toml`, by name."""
    files = (data_folder() / "scenes" / "zoo").glob("*.toml")
    return dict(sorted((path.name.removesuffix(".toml"), path) for path in files))


def scene_files(name: str) -> list[Path]:
    """A scene that ships, with the tables that it names."""
    path = shipped_scene(name)
    text = path.read_text(encoding="utf-8")
    return [path, *(table for table in sorted(path.parent.glob("*.csv")) if table.name in text)]


def read_text(path: Path, largest: int | None = None) -> str:
    """The text of a small UTF-8 file; a sentence for everything that it may be instead.

    `largest` is the size in bytes from which a file is refused, by default `LARGEST_TEXT_FILE`.
    """
    check_file(path, largest or LARGEST_TEXT_FILE)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SceneError(f"{path} is not text: expected UTF-8, got binary data") from None
    except OSError as error:
        raise _unreadable(path, error) from None


def check_file(path: Path, largest: int) -> None:
    """Raise `SceneError` unless `path` is a file of at most `largest` bytes."""
    try:
        if "\0" in str(path):
            raise SceneError(f"{str(path)!r} cannot be read: a file name holds no null character")
        size = path.stat().st_size
        if not path.is_file():
            got = "a folder" if path.is_dir() else "a device or a pipe"
            raise SceneError(f"{path} cannot be read: expected a text file, got {got}")
        if size > largest:
            raise SceneError(f"{path} holds {size} bytes, expected a text of at most {largest}")
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> SceneError:
    return SceneError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}")


def read_table(
    path: Path,
    names: Sequence[str] = ("frequency_hz", "density"),
    largest: int | None = None,
) -> tuple[NDArray[np.float64], ...]:
    """Columns of numbers, one for each of `names`, from comma- or space-separated text.

    Lines that start with #, and lines without numbers before the first row, are passed over. Raises
    `SceneError` for anything else that is not that many numbers.
    """
    wanted = f"{_COUNTS.get(len(names), len(names))} ({', '.join(names)})"
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path, largest).splitlines(), start=1):
        cells = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) != len(names):
            if not rows and not any(map(_is_number, cells)):
                _check_order(path, cells, names)
                continue  # names and units of the columns
            raise SceneError(f"{path}, line {number}: expected {wanted}, got {line.strip()[:60]!r}")
        rows.append(row)
    if not rows:
        raise SceneError(f"{path} holds no rows of {wanted}")
    return tuple(np.array(rows).T)


def _check_order(path: Path, heading: Sequence[str], names: Sequence[str]) -> None:
    """A heading that names the columns must name them in the order that is read."""
    found = [cell.lower() for cell in heading if cell.lower() in names]
    if sorted(found) == sorted(names) and found != list(names):
        raise SceneError(
            f"{path} has the columns {', '.join(found)}; expected {', '.join(names)} in this order"
        )


_COUNTS = {1: "one number", 2: "two numbers"}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
