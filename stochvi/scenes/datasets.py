"""Profiles, scenes and reference tables that ship with the package, and tables of the user."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stochvi.mathematics.units import checked
from stochvi.results.errors import SceneError
from stochvi.scenes.outside import Parts
from stochvi.scenes.text_tables import read_table


@dataclass(frozen=True, kw_only=True)
class Profile:
    """A tabulated environment: breakpoints in Hz and g^2/Hz, with log-log interpolation.

    See Also
    --------
    stochvi.scenes.profiles : All that ship.
    """

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
def profiles() -> Parts[Profile]:
    """Every profile that ships, by name.

    Returns
    -------
    dict[str, Profile]
        Profiles by the names that scenes use. One of another package is found by its name, and
        `with_others()` adds all of them.

    See Also
    --------
    stochvi.TabulatedNoise : Noise of a profile.

    Examples
    --------
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
    return Parts("profiles", found, _profile_called)


def _profile_called(name: str, given: Any) -> Profile:
    """The profile that another package gives, as such or by a function."""
    profile = given() if callable(given) else given
    if not isinstance(profile, Profile) or profile.name != name:
        raise TypeError(f"must be a stochvi.scenes.Profile of the name {name!r}, got {profile!r}")
    return profile


@checked
def shipped_scene(name: str) -> Path:
    """Path of a scene that ships, `data/scenes/NAME.toml`.

    Parameters
    ----------
    name
        Name of the scene.

    Returns
    -------
    Path
        The file.

    See Also
    --------
    stochvi.load_scene : The scene of a file.

    Examples
    --------
    >>> shipped_scene("isolator-truck").name
    'isolator-truck.toml'
    """
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
    """Files of a scene that ships: its TOML file and the tables that it names."""
    path = shipped_scene(name)
    text = path.read_text(encoding="utf-8")
    return [path, *(table for table in sorted(path.parent.glob("*.csv")) if table.name in text)]
