"""The mean of answers over several records, and the scatter between them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from stochvi import (
    ImpactPair,
    Isolator,
    RecordedNoise,
    Restitution,
    Scene,
    TabulatedNoise,
    mean_over_records,
    reliability,
)

FS, LEVELS = 400.0, (9.0, 10.0, 12.0, 11.0)


def written(folder: Path, levels: tuple[float, ...] = LEVELS, samples: int = 8000) -> list[Path]:
    files = [folder / f"{number}.txt" for number in range(len(levels))]
    for number, (file, level) in enumerate(zip(files, levels, strict=True)):
        np.savetxt(file, level * np.random.default_rng(number).normal(size=samples))
    return files


def shaken(file: Path, clearance: float = 0.0065) -> Scene:
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=[ImpactPair(clearance=clearance, law=Restitution(coefficient=0.5))],
        excitations=[RecordedNoise(file=str(file), unit="m/s2", fs=FS)],
    )


def test_the_chance_is_the_mean_of_those_of_the_records(tmp_path: Path) -> None:
    files = written(tmp_path)
    keys: dict[str, Any] = {"mission": 600.0, "seed": 3, "rel_error": 0.05}
    table = mean_over_records(shaken(files[0]), files, **keys)
    found = table.set_index("quantity").loc["mission.hit"]
    each = [reliability(shaken(file), **keys).chances["hit"].estimate for file in files]
    values = np.array([one.value for one in each])
    errors = np.array([one.reach(4.5) for one in each])
    assert abs(found["mean"] - values.mean()) < math.sqrt(2.0) * np.linalg.norm(errors) / 4.0
    rows = table.attrs["records"]["mission.hit"].to_numpy(dtype=float)
    assert found["mean"] == pytest.approx(rows.mean(), rel=1e-12)
    # the interval by the textbook, of the logarithm
    reach = stats.t.ppf(0.975, 3) * rows.std(ddof=1) / 2.0 / rows.mean()
    low = rows.mean() * math.exp(-reach) - found["bias"]
    assert found["low"] == pytest.approx(low, rel=1e-9)
    assert 0.0 < found["low"] < found["mean"] < found["high"]
    # the scatter between the records is no statistical error
    assert found["std_between_records"] > 4.5 * found["statistical_error"]
    # the chance of the mean density is smaller
    tables = [shaken(file).excitations[0].table for file in files]  # type: ignore[union-attr]
    noise = TabulatedNoise(
        frequency_hz=tables[0].frequency_hz.tolist(), unit="(m/s2)2/Hz",
        density=np.mean([one.density for one in tables], axis=0).tolist(),
    )  # fmt: skip
    chance = reliability(shaken(files[0]).replace(excitations=[noise]), **keys).chances["hit"]
    assert chance.estimate.value + chance.estimate.reach(4.5) < found["mean"]


def test_records_of_one_noise_scatter_by_their_length_alone(tmp_path: Path) -> None:
    """The control: four records of the same level differ far less than those of four levels."""
    files = written(tmp_path, (10.0,) * 4, 40_000)
    same = mean_over_records(shaken(files[0]), files, mission=600.0, seed=3)
    files = written(tmp_path, LEVELS, 40_000)
    apart = mean_over_records(shaken(files[0]), files, mission=600.0, seed=3)
    spreads = [
        float(table.set_index("quantity").loc["mission.hit", "std_between_records"])
        / float(table.set_index("quantity").loc["mission.hit", "mean"])
        for table in (same, apart)
    ]
    assert 3.0 * spreads[0] < spreads[1]


def test_what_is_no_set_of_records_is_refused(tmp_path: Path) -> None:
    files = written(tmp_path, (1.0, 1.0), 2000)
    with pytest.raises(ValueError, match="files must be two at least, got 1"):
        mean_over_records(shaken(files[0]), files[:1], mission=60.0)
    quiet = shaken(files[0]).replace(excitations=[TabulatedNoise(profile="navmat-p-9492")])
    with pytest.raises(ValueError, match="one excitation of kind 'record', got 0"):
        mean_over_records(quiet, files, mission=60.0)
