"""The verdict on measured records of structures: every gap is judged."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import binom

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    RecordedNoise,
    Restitution,
    Scene,
    TabulatedNoise,
    WhiteNoise,
    load_scene,
    mean_over_records,
    reliability,
    replay,
    size,
)
from stochvi.isolators.record_verdict import RecordVerdict, record_verdict
from stochvi.isolators.sizing.answer import Sizing
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.model.model import model_of
from stochvi.scenes.datasets import shipped_scene
from support.commands import Run, one_document
from support.records import FS as RATE_HZ
from support.records import gaussian, spoilt

# ------------------------------------------------------------------------------
# The mean of answers over several records, and the scatter between them.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# The verdict on measured records of structures:
# ------------------------------------------------------------------------------


Vector = NDArray[np.float64]


def saved(folder: Path, values: Vector, name: str = "record", fs: float = RATE_HZ) -> RecordedNoise:
    """A record in g, from its file."""
    file = folder / f"{name}.npy"
    np.save(file, values)
    return RecordedNoise(file=str(file), unit="g", fs=fs)


def box(*records: RecordedNoise) -> Scene:
    """The rigid box that ships, on a base that records move."""
    return load_scene(shipped_scene("rigid-box")).replace(excitations=list(records))


def judged(scene: Scene) -> RecordVerdict:
    """The verdict on the records of a scene."""
    found = record_verdict(scene)
    assert found is not None
    return found


def by_gap(found: RecordVerdict) -> dict[str, RecordVerdict]:
    """The verdicts on all gaps, by their names."""
    return {str(found.gap): found, **found.others}


def two_masses(zeta: float, *records: RecordedNoise) -> Scene:
    """Two equal masses in a row on a base, the relative motion of which is a gap."""
    spring = np.array([[2.0, -1.0], [-1.0, 1.0]])
    w = 2.0 * math.pi * 12.0
    stops = {"lower": -1.0, "upper": 1.0, "law": Restitution(coefficient=0.5)}
    return Scene(
        structure=Matrices(
            coordinates=("low", "high"), mass=np.eye(2), damping=2.0 * zeta * w * spring,
            stiffness=w**2 * spring,
        ),
        impact_pairs=[
            ImpactPair(name="floor", on="low", **stops),
            ImpactPair(name="between", between=("high", "low"), **stops),
        ],
        excitations=[each.replace(on="base") for each in records],
    )  # fmt: skip


def test_what_each_gap_needs_is_just_not_hit(tmp_path: Path) -> None:
    """By `replay`, which follows the record by another method, on a box with six modes."""
    values = spoilt("potholes", np.random.default_rng(4))
    scene = box(saved(tmp_path, values).replace(axis="z"))
    found = by_gap(judged(scene))
    assert set(found) == {"corner 1", "corner 2", "side"}
    for pair, mean in zip(scene.impact_pairs, model_of(scene).mean_gaps, strict=True):
        each = found[pair.name]
        hits = []
        for share in (1.0, 0.999):
            stops = {
                "lower": mean - share * (each.clearance_lower or 0.0),
                "upper": mean + share * (each.clearance_upper or 0.0),
            }
            alone = scene.replace(impact_pairs=[pair.replace(**stops, clearance=None)])
            hits.append(float(replay(alone).impact_pairs[pair.name].hits))
        assert hits[0] == 0.0 < hits[1]


@pytest.mark.parametrize("zeta", [0.05, 1.0 / math.sqrt(0.5 * (3.0 - math.sqrt(5.0))), 3.0])
def test_the_motion_is_that_of_a_replay(tmp_path: Path, zeta: float) -> None:
    """Also where one of the modes is critically damped, and its poles are one."""
    scene = two_masses(zeta, saved(tmp_path, spoilt("potholes", np.random.default_rng(5))))
    found = by_gap(judged(scene))["floor"]
    low = replay(scene.replace(impact_pairs=[])).coordinates["low"]
    assert found.displacement_std == pytest.approx(float(low.displacement_std), rel=1e-7)
    largest = max(float(low.displacement_max), -float(low.displacement_min))
    assert found.displacement_max == pytest.approx(largest, rel=1e-6)


@pytest.mark.parametrize("records", [8, pytest.param(400, marks=pytest.mark.verify)])
def test_gaussian_records_are_seldom_contradicted(tmp_path: Path, records: int) -> None:
    """At most 1 % of them, by all gaps together; those with potholes always."""
    random = np.random.default_rng(21)
    alarms = sum(
        judged(two_masses(0.05, saved(tmp_path, gaussian(random, 60.0)))).contradicts
        for _ in range(records)
    )
    assert alarms <= binom.isf(1e-3, records, 0.01)
    for _ in range(3):
        scene = two_masses(0.05, saved(tmp_path, spoilt("potholes", random)))
        assert judged(scene).contradicts


def test_records_of_several_axes_that_belong_together(tmp_path: Path) -> None:
    """One motion along two axes moves a gap in a corner by more than the root of the sum of
    squares, or by less; independent records do not."""
    random = np.random.default_rng(6)
    one, other = (gaussian(random, 120.0) for _ in range(2))
    stops = {"lower": -1.0, "upper": 1.0, "law": Restitution(coefficient=0.5)}

    def along(*values: Vector) -> RecordVerdict:
        records = [
            saved(tmp_path, each, name).replace(axis=axis)
            for each, name, axis in zip(values, ("one", "other"), ("x", "z"), strict=True)
        ]
        scene = box(*records)
        pair = ImpactPair(name="edge", at=(0.24, 0.0, -0.08), direction=(1, 0, 1), **stops)
        return judged(scene.replace(impact_pairs=[pair]))

    alike = along(one, one)
    assert alike.contradicts and any("cross_density" in each for each in alike.reasons)
    assert not along(one, other).contradicts


def test_a_record_beside_other_noise_is_judged(tmp_path: Path) -> None:
    """It was passed over in silence: `replay` cannot follow the noise."""
    noise = WhiteNoise(density=1e-4, unit="g2/Hz")
    for kind, contradicts in (("potholes", True), ("none", False)):
        record = saved(tmp_path, spoilt(kind, np.random.default_rng(7)))
        mount = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[record, noise])
        assert judged(mount).contradicts is contradicts


def test_records_of_different_rates_are_judged_each(tmp_path: Path) -> None:
    random = np.random.default_rng(8)
    good, bad = gaussian(random, 60.0), spoilt("potholes", random)
    records = [
        saved(tmp_path, good, "good").replace(axis="x"),
        saved(tmp_path, bad[::2], "bad", fs=0.5 * RATE_HZ).replace(axis="z"),
    ]
    assert judged(box(*records)).contradicts
    assert not judged(box(records[0])).contradicts


@pytest.mark.slow
def test_sizing_a_box_says_that_the_record_contradicts(tmp_path: Path) -> None:
    random = np.random.default_rng(9)

    def sized(values: Vector) -> Sizing:
        scene = box(saved(tmp_path, values).replace(axis="z"))
        found = size(scene, probability=0.01, mission=600.0, rel_error=0.3)
        assert isinstance(found, Sizing)
        return found

    bad = sized(spoilt("potholes", random))
    assert bad.doubtful is not None
    assert bad.verdict() == "Do not size by the spectrum: this record is not Gaussian noise."
    for name, each in by_gap(bad.doubtful).items():
        assert f"{each.needed} at {name}" in bad.doubtful.needs()
        # what is sized for Gaussian noise is far too small
        assert each.clearance > 1.3 * bad.clearances[name].value
    good = sized(gaussian(random, 60.0))
    assert good.doubtful is None
    assert good.verdict().startswith("Make ")


@pytest.mark.slow
def test_commands_say_it_of_a_box(tmp_path: Path, stochvi: Run) -> None:
    values = {
        "bad": spoilt("potholes", np.random.default_rng(7)),
        "good": gaussian(np.random.default_rng(8), 60.0),
    }
    text = shipped_scene("rigid-box").read_text("utf-8")
    structure = text[: text.index("[[excitation]]")]
    for name, a in values.items():
        np.savetxt(tmp_path / f"{name}.txt", a * STANDARD_GRAVITY)
        (tmp_path / f"{name}.toml").write_text(
            f"{structure}[[excitation]]\nkind = 'record'\naxis = 'z'\nfile = '{name}.txt'\n"
            f"unit = 'm/s2'\nfs = {RATE_HZ}\n"
        )
    for command in (
        ["screen"],
        ["size", "--probability", "1%", "--mission", "10min", "--rel-error", "0.3"],
    ):
        run = stochvi(command[0], tmp_path / "bad.toml", *command[1:])
        assert run.code == 1 and "the record is not Gaussian noise" in run.err
        assert "by the spectrum: this record is not Gaussian noise" in run.out.splitlines()[0]
        assert "lower = " not in run.out
        run = stochvi(command[0], tmp_path / "good.toml", *command[1:], "--json", "-")
        assert run.code == 0
        record = one_document(run.out)["record"]
        assert record["contradicts"] is False and len(record["others"]) == 2


def test_a_kurtosis_that_is_stated_stands_for_the_peaks(tmp_path: Path) -> None:
    """Noise that is not Gaussian is not judged as Gaussian; `replay` follows the record all the
    same, where it ended in an error."""
    record = saved(tmp_path, spoilt("potholes", np.random.default_rng(10))).replace(axis="z")
    assert record_verdict(box(record.replace(kurtosis=5.0))) is None
    assert record_verdict(box(record.replace(kurtosis=5.0, level_time=10.0))) is None
    one, other = (
        replay(box(each)).coordinates["z"] for each in (record, record.replace(kurtosis=5.0))
    )
    assert one == other
