"""Sweeps: rows that are right, kept, not done twice; keys that are not there."""

from __future__ import annotations

import itertools
import json
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import stochvi.methods.monte_carlo
from stochvi.cli import main
from stochvi.isolators import size
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import first_passage, fokker_planck
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import simulate
from stochvi.results.deadline import graceful_interrupt
from stochvi.results.errors import Interrupted, SceneError
from stochvi.results.estimates import Estimate, plus_minus
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Restitution, Viscoelastic
from stochvi.scenes.keys import changed_scene
from stochvi.scenes.scene import ImpactPair, Scene, load_scene, scene_from
from stochvi.scenes.structures import Isolator, Oscillator
from stochvi.statistics.histories import history
from stochvi.statistics.reliability import reliability
from stochvi.statistics.spectra import spectrum
from stochvi.sweeps import Job, sweep, values_of
from stochvi.verification.check import check
from stochvi.views.datasets import (
    changes,
    draw_sweep,
    quantities,
    terminal_table,
    to_xarray,
    unseen,
    write_sweep,
)
from support.commands import ELASTIC, Run, one_document, refused
from support.known import DOCUMENT, to_toml
from support.refusals import refusals
from support.sized import scene_between_stops, sizing_of

R = "impact_pair.0.law.coefficient"
GAP = "impact_pair.0.upper"


def oscillator(restitution: float = 1.0, upper: float = 1.0) -> Scene:
    pair = ImpactPair(lower=-1.0, upper=upper, law=Restitution(coefficient=restitution))
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def test_a_row_is_what_the_method_says_of_its_scene() -> None:
    table = sweep(oscillator(), {GAP: [0.5, 2.0], "structure.damping": [0.1, 0.4]}, method="exact")
    assert table[[GAP, "structure.damping"]].to_numpy().tolist() == [
        [0.5, 0.1], [0.5, 0.4], [2.0, 0.1], [2.0, 0.4]
    ]  # fmt: skip
    scene = oscillator(upper=2.0)
    scene = scene.model_copy(update={"structure": Oscillator(mass=1.0, damping=0.4, stiffness=1.0)})
    rate = exact(scene).impact_pairs["stops"]["collision_rate"]
    assert table["stops.collision_rate"].iloc[3] == rate.value
    assert set(table["note"]) == {""}


def test_rates_stand_beside_the_speed_above_which_they_count() -> None:
    """It is 5 % of the rms velocity, which changes with the restitution: from row to row."""
    values = {R: [0.4, 0.8]}
    table = sweep(oscillator(0.8), values, method="fokker-planck")
    for row, value in enumerate(values[R]):
        pair = fokker_planck(oscillator(value)).impact_pairs["stops"]
        assert table["stops.speed_threshold"].iloc[row] == pair.speed_threshold > 0.0
    assert table["stops.speed_threshold"].nunique() == 2
    fixed = sweep(oscillator(0.8), values, method="fokker-planck", speed_threshold=0.01)
    assert fixed["stops.speed_threshold"].tolist() == [0.01, 0.01]


def test_rates_above_several_thresholds_stand_side_by_side() -> None:
    """Each is that of the method with this threshold; xarray has the threshold as a dimension."""
    values = {R: [0.6, 0.8], "speed_threshold": [0.05, 0.5]}
    table = sweep(oscillator(), values, method="fokker-planck")
    for row in table.to_dict("records"):
        threshold = row["speed_threshold"]
        pair = fokker_planck(oscillator(row[R]), speed_threshold=threshold).impact_pairs["stops"]
        assert row["stops.collision_rate"] == pair["collision_rate"].value
        assert row["stops.speed_threshold"] == threshold
    rates = to_xarray(table)["stops.collision_rate"]
    assert rates.speed_threshold.attrs["units"] == "m/s"
    assert (rates.sel(speed_threshold=0.5) < 0.99 * rates.sel(speed_threshold=0.05)).all()
    # the same paths, of which no more impacts can be faster
    few = sweep(
        oscillator(0.8), {"speed_threshold": [0.05, 0.5]}, paths=64, duration=50.0, seed=1
    )["stops.collision_rate"]  # fmt: skip
    assert 0.0 < few[1] < few[0]


def test_a_threshold_is_varied_where_a_method_has_one_and_is_given_once() -> None:
    with pytest.raises(ValueError, match="speed_threshold is for method simulate or fokker-planck"):
        sweep(oscillator(), {"speed_threshold": [0.1]}, method="exact")
    with pytest.raises(ValueError, match="varied or given once for all rows, got both"):
        sweep(oscillator(), {"speed_threshold": [0.1]}, speed_threshold=0.2)


def test_the_error_of_a_bias_is_a_column(tmp_path: Path) -> None:
    asked = {"paths": 64, "duration": 200.0, "seed": 1}
    table = sweep(oscillator(0.6), {R: [0.6]}, **asked)
    rate = simulate(oscillator(0.6), **asked).impact_pairs["stops"].collision_rate
    assert rate is not None and rate.bias_error > 0.0
    assert table["stops.collision_rate.bias_error"].tolist() == [rate.bias_error]
    assert table["stops.collision_rate.bias"].tolist() == [rate.bias]
    write_sweep(table, [R], tmp_path)
    header = (tmp_path / "sweep.csv").read_text().splitlines()[0].split(",")
    assert "stops.collision_rate_per_s.bias_error" in header
    assert "stops.speed_threshold_m_s" in header


@pytest.mark.parametrize("form", ["closure", "clumps", "motion", "force"])
def test_a_sweep_takes_the_forms_of_linearisation(form: str) -> None:
    scene = oscillator(0.8)
    table = sweep(scene, {R: [0.8]}, method="linearise", form=form)
    velocity = linearise(scene, form=form).coordinates["x"].velocity_std
    assert velocity is not None and table["x.velocity_std"].tolist() == [velocity.value]


def test_a_table_of_samples_has_a_scene_for_each_row() -> None:
    samples = pd.DataFrame({GAP: [0.5, 2.0, 1.0], "structure.damping": [0.1, 0.4, 0.2]})
    table = sweep(oscillator(), samples, method="exact")
    pd.testing.assert_frame_equal(table[list(samples)], samples)
    pairs = sweep(oscillator(), samples.to_dict("list"), method="exact")
    assert len(pairs) == 9
    same = pairs.merge(samples)
    assert sorted(same["x.velocity_std"]) == sorted(table["x.velocity_std"])
    twice = pd.DataFrame([[1.0, 2.0]], columns=[GAP, GAP])
    for wrong, said in (
        (twice, "is given twice"),
        (samples.iloc[:0], "has no values"),
        (pd.DataFrame(index=[0, 1]), "at least one key"),
        (samples.assign(**{GAP: [0.5, np.nan, 1.0]}), "finite number, got nan"),
    ):
        with pytest.raises(ValueError, match=said):
            sweep(oscillator(), wrong, method="exact")


def test_a_rate_that_was_never_seen_has_an_upper_limit_in_the_table(tmp_path: Path) -> None:
    table = sweep(oscillator(), {"impact_pair.0.upper": [1.0, 40.0]}, paths=8, duration=20.0)
    upper = "stops.collision_rate_upper"
    seen, unseen = table[f"{upper}.upper_95"]
    assert np.isnan(seen) and unseen > 0.0 == table[upper].iloc[1]
    write_sweep(table, [GAP], tmp_path)
    assert "stops.collision_rate_upper_per_s.upper_95" in pd.read_csv(tmp_path / "sweep.csv")


def test_the_terminal_shows_the_limit_of_what_was_never_seen() -> None:
    far = oscillator().model_copy(
        update={"impact_pairs": (ImpactPair(clearance=40.0, law=Restitution(coefficient=0.5)),)}
    )
    table = sweep(far, {"structure.damping": [0.1]}, paths=8, duration=20.0)
    shown = terminal_table(table, ["structure.damping"])
    limit = table["stops.collision_rate.upper_95"].iloc[0]
    assert f"at most {limit:.2g}" in shown.iloc[0].tolist()
    # as simulate shows them; sizings, in mm, are asserted below
    assert {"std. dev. of displ. (m)", "F1, sum of w per s (m/s^2)"} <= set(shown)
    assert unseen(table).tolist() == [True] and "structure.damping (N s/m)" in shown


def test_a_picture_of_rates_that_span_decades_is_logarithmic() -> None:
    rates = [1e-4, 0.0, 1.0]
    columns = {"a": [1.0, 2.0, 3.0], "x.collision_rate": rates, "method": ["exact"] * 3}
    table = pd.DataFrame({**columns, "x.collision_rate.standard_error": [0.0] * 3})
    scales = []
    for values in (rates, [1.0, 0.0, 2.0]):
        ax = draw_sweep(table.assign(**{"x.collision_rate": values}), ["a"], "x.collision_rate")
        scales.append(ax.get_yscale())
        plt.close(ax.get_figure())
    assert scales == ["log", "linear"]


def test_a_clearance_moves_both_stops() -> None:
    law = Restitution(coefficient=1.0)
    even = oscillator().model_copy(update={"impact_pairs": (ImpactPair(clearance=1.0, law=law),)})
    table = sweep(even, {"impact_pair.0.clearance": [0.5, 2.0]}, method="exact")
    for row, clearance in enumerate((0.5, 2.0)):
        pair = ImpactPair(lower=-clearance, upper=clearance, law=law)
        known = exact(even.model_copy(update={"impact_pairs": (pair,)}))
        rate = known.impact_pairs["stops"]["collision_rate"].value
        assert table["stops.collision_rate"][row] == rate
    with pytest.raises(
        SceneError, match="two stops at equal distances, got lower = -1 and upper = 2"
    ):
        sweep(oscillator(upper=2.0), {"impact_pair.0.clearance": [0.5]}, method="exact")
    with pytest.raises(SceneError, match=r"impact_pair\.1\.clearance is not a number of the scene"):
        sweep(even, {"impact_pair.1.clearance": [0.5]}, method="exact")


def test_methods_agree_within_their_errors() -> None:
    vary = {R: [0.9, 1.0]}
    simulated = sweep(oscillator(), vary, rel_error=0.01, seed=2)
    solved = sweep(oscillator(), vary, method="fokker-planck", rtol=1e-4)
    for name in ("x.displacement_std", "stops.impact_speed_rate"):
        error = simulated[f"{name}.standard_error"]
        bias = simulated[f"{name}.bias"] + solved[f"{name}.bias"]
        assert (error > 0.0).all()
        assert ((simulated[name] - solved[name]).abs() <= 4.5 * error + bias).all()
        # the control: rows in the wrong order do not agree
        swapped = solved[name].to_numpy()[::-1]
        assert ((simulated[name] - swapped).abs() > 4.5 * error + bias).all()


def test_random_numbers_are_common_or_each_row_has_its_own() -> None:
    vary, asked = {GAP: [1.0, 1.01]}, {"paths": 200, "duration": 50.0, "seed": 9}
    common = sweep(oscillator(), vary, **asked)
    independent = sweep(oscillator(), vary, common=False, **asked)
    assert set(common["seed"]) == {9}
    assert independent["seed"].nunique() == 2
    own = simulate(
        oscillator(upper=1.01), paths=200, duration=50.0, seed=int(independent["seed"].iloc[1])
    )
    assert independent["x.velocity_std"].iloc[1] == own.coordinates["x"]["velocity_std"].value
    # more values do not change the seeds of those that were there
    more = sweep(oscillator(), {GAP: [0.9, 1.0, 1.01]}, common=False, **asked)
    assert more["seed"].tolist()[1:] == independent["seed"].tolist()
    name = "x.displacement_mean_square"
    error = np.hypot(*independent[f"{name}.standard_error"])
    assert abs(common[name].diff().iloc[1]) < error  # of two runs of their own


def test_rows_are_kept_and_a_stopped_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {"paths": 6000, "duration": 50.0, "seed": 1}
    vary = {R: [0.5, 0.8]}
    whole = sweep(oscillator(), vary, **asked)
    seen = []

    def stop(done: float, text: str) -> None:
        if done > 0.75:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted):
        sweep(oscillator(), vary, out=tmp_path, progress=stop, **asked)
    assert len(list((tmp_path / "rows").glob("*.json"))) == 1
    assert len(list((tmp_path / "rows").glob("*.checkpoint"))) == 1

    def watched(*arguments, **named):
        seen.append(named.get("resume"))
        return simulate(*arguments, **named)

    monkeypatch.setattr(stochvi.methods.monte_carlo, "simulate", watched)
    table = sweep(oscillator(), vary, out=tmp_path, threads=1, **asked)
    assert len(seen) == 1 and seen[0] is not None  # the second row, from where it was
    pd.testing.assert_frame_equal(table.drop(columns="seconds"), whole.drop(columns="seconds"))
    sweep(oscillator(), {R: [0.8, 0.5, 0.9]}, out=tmp_path, **asked)
    assert len(seen) == 2  # one value more, one row more
    sweep(oscillator(), vary, out=tmp_path, **(asked | {"paths": 3000}))
    assert len(seen) == 4  # another question
    assert not list((tmp_path / "rows").glob("*.checkpoint"))


def test_ctrl_c_ends_a_sweep_before_its_next_row(tmp_path: Path, monkeypatch) -> None:
    row = stochvi.sweeps.Job.row

    def pressed(self, *arguments):
        signal.raise_signal(signal.SIGINT)
        return row(self, *arguments)

    monkeypatch.setattr(stochvi.sweeps.Job, "row", pressed)
    with graceful_interrupt(), pytest.raises(Interrupted, match="after row 1 of 3"):
        sweep(oscillator(), {R: [1.0, 0.9, 0.8]}, method="closure", out=tmp_path)
    assert len(list((tmp_path / "rows").glob("*.json"))) == 1


def test_a_table_that_changed_is_another_row(tmp_path: Path) -> None:
    def value(density: float) -> float:
        (tmp_path / "table.csv").write_text(f"5, {density}\n500, 0.01\n")
        noise = TabulatedNoise(file=str(tmp_path / "table.csv"), unit="g2/Hz")
        scene = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[noise])
        vary = {"structure.zeta": [0.1]}
        table = sweep(scene, vary, paths=8, duration=5.0, out=tmp_path)
        return float(table["x.displacement_std"].iloc[0])

    first = value(0.01)
    assert value(0.02) != first
    assert value(0.01) == first


test_unknown_keys_name_the_nearest = refusals(
    lambda key: sweep(oscillator(), {key: [0.5]}, method="exact"),
    ("impact_pairs.0.upper", "did you mean 'impact_pair.0.upper'"),
    ("impact_pair.1.upper", "did you mean 'impact_pair.0.upper'"),
    ("impact_pair.0.law", "did you mean 'impact_pair.0.law"),
    ("coefficient", "did you mean 'impact_pair.0.law.coefficient'"),
    ("clearance", "did you mean 'impact_pair.0.clearance'"),
    ("impact_pair.0.law.restitution", "with .*law.restitution"),
    ("structure.kind", "is not a number of the scene"),
    ("structure.dampin", "did you mean 'damping'"),
    pattern=True,
)


def test_a_key_that_was_left_out_can_be_varied() -> None:
    table = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    scene = Scene(structure=Isolator(frequency_hz=12.0, zeta=0.1), excitations=[table])
    louder = changed_scene(scene.document(), (("excitation.0.level_db", 6.0),))
    assert louder.excitations[0].level_db == 6.0


def test_the_number_of_modes_can_be_varied(stochvi: Run, tmp_path: Path) -> None:
    stochvi("new", tmp_path / "reed.toml", "--kind", "beam")
    reed, out = tmp_path / "reed.toml", tmp_path / "out"
    asked = ("--vary", "structure.modes=1,2", "--method", "closure", "--out", out)
    done = stochvi("sweep", reed, *asked)
    assert done.code == 0, done.err
    rows = pd.read_csv(out / "sweep.csv")
    assert rows["structure.modes"].tolist() == [1, 2]
    (speed, *_) = (name for name in rows if name.startswith("tip.velocity_std"))
    # impacts bring the second mode energy of the first: 0.264 of 0.339 m/s are left by simulation
    assert rows[speed][1] == pytest.approx(0.264, rel=0.05)
    assert rows[speed][0] == pytest.approx(0.339, rel=1e-2)
    half = ("--vary", "structure.modes=1.5", "--method", "closure")
    assert "must be a whole number, got 1.5" in refused(stochvi("sweep", reed, *half))


def test_the_keys_of_an_absorber_can_be_varied() -> None:
    """It stays an absorber in the scene, and is not rewritten as matrices."""
    loose = Absorber(mass=0.1, play=3.0, law=Restitution(coefficient=0.5))
    tower = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        absorber=loose,
        excitations=[WhiteNoise(intensity=0.04)],
    )
    vary = {"absorber.play": [2.0, 3.0], "absorber.law.coefficient": [0.3, 0.5]}
    table = sweep(tower, vary, method="closure")
    for row, (play, coefficient) in zip(
        table.to_dict("records"), itertools.product(*vary.values()), strict=True
    ):
        other = Absorber(mass=0.1, play=play, law=Restitution(coefficient=coefficient))
        found = linearise(tower.model_copy(update={"absorber": other}), form="closure")
        expected = found.coordinates["structure"]["displacement_std"]
        assert row["structure.displacement_std"] == expected.value
    assert table["structure.displacement_std"].nunique() == 4


def test_a_target_out_of_reach_is_the_note_of_its_row() -> None:
    truck = load_scene(shipped_scene("isolator-truck"))
    asked = {"probability": 0.9, "mission": 1e-3, "rel_error": 0.5}
    table = sweep(truck, {"structure.zeta": [0.1, 0.2]}, method="size", **asked)
    assert table["note"].str.contains("probability must be at most").all()


def test_what_a_method_does_not_cover_is_noted() -> None:
    table = sweep(oscillator(), {R: [0.5, 1.0]}, method="exact")
    assert "restitution" in table["note"].iloc[0] and table["note"].iloc[1] == ""
    assert np.isnan(table["x.displacement_std"].iloc[0])
    mount = Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
    scene = Scene(structure=mount, excitations=[Sine(amplitude=1, frequency_hz=1)])
    assert "average" in sweep(scene, {"structure.mass": [1.0]}, method="average")["note"].iloc[0]


@pytest.mark.parametrize("text", ["a", "a=", "a=1:2", "a=1:2:x", "a=1:2:0", "a=0:2:3:log", "=1"])
def test_bad_ranges_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="KEY=FIRST:LAST:NUMBER"):
        values_of(text, {})


STOPPED = {
    "structure": {"kind": "isolator", "frequency_hz": 12.0, "zeta": 0.1},
    "impact_pair": [{"lower": -0.01, "upper": 0.01, "law": {"kind": "hertz", "coefficient": 1e6}}],
    "excitation": [
        {"kind": "white", "density": 0.01, "unit": "g2/Hz"},
        {"kind": "sine", "amplitude": 1.0, "frequency_hz": 20.0},
        {"kind": "sine", "amplitude": 1.0, "frequency_hz": 20.0, "on": "x"},
        {"kind": "road", "speed_kmh": 80.0, "band_hz": [1.0, 50.0]},
    ],
}


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("impact_pair.0.clearance=3mm:6mm:4", [0.003, 0.004, 0.005, 0.006]),
        ("impact_pair.0.upper=0.3 cm,4e-3", [0.003, 0.004]),
        ("structure.frequency_hz=10Hz,0.012kHz,14", [10.0, 12.0, 14.0]),
        ("excitation.0.density=0.01 g^2/Hz,0.02", [0.01, 0.02]),
        ("excitation.0.level_db=-3dB:3 dB:3", [-3.0, 0.0, 3.0]),
        ("excitation.1.amplitude=1g", [9.80665]),
        ("excitation.2.amplitude=2N", [2.0]),
        ("excitation.3.speed_kmh=10m/s,50 km/h", [36.0, 50.0]),
        ("excitation.3.band_hz.1=0.1kHz", [100.0]),
        ("impact_pair.0.law.coefficient=1e6 N/m^1.5", [1e6]),
    ],
)
def test_values_bear_units(text: str, values: list[float]) -> None:
    key, _, _ = text.partition("=")
    assert values_of(text, STOPPED) == (key, values)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("impact_pair.0.clearance=3Hz:6Hz:4", "m"),
        ("structure.frequency_hz=10mm", "Hz"),
        ("excitation.0.density=1 N2/Hz", "g2/Hz"),
        ("excitation.1.amplitude=1N", "m/s2"),
        ("excitation.2.amplitude=1g", "N"),
        ("excitation.0.level_db=3 Hz", "dB"),
    ],
)
def test_a_value_of_another_quantity_is_refused(text: str, unit: str) -> None:
    key, _, _ = text.partition("=")
    with pytest.raises(ValueError, match=rf"vary: {key} must be a number.* such as {unit}, got"):
        values_of(text, STOPPED)


def test_a_unit_of_a_number_that_has_none_is_refused(stochvi: Run) -> None:
    sentence = refused(stochvi("sweep", ELASTIC, "--vary", "structure.damping_rate=1mm"))
    assert "structure.damping_rate is not a number of the scene" in sentence
    with pytest.raises(ValueError, match=r"structure\.zeta must be a number without a unit, got"):
        values_of("structure.zeta=1mm", STOPPED)


@pytest.mark.parametrize(
    ("keys", "varied", "instead"),
    [
        ({"stiffness": 2.0, "loss_factor": 0.2}, {"loss_factor": 0.3}, {}),
        ({"stiffness": 2.0, "damping_ratio": 0.2}, {"loss_factor": 0.3}, {"damping_ratio": None}),
        (
            {"stiffness": 2.0, "restitution": 0.5, "at_speed": 1.0},
            {"damping_ratio": 0.3},
            {"restitution": None, "at_speed": None},
        ),
        ({"stiffness": 2.0, "restitution": 0.5, "at_speed": 1.0}, {"restitution": 0.6}, {}),
        (
            {"shore_a": 60.0, "area": 1e-4, "thickness": 0.01, "loss_factor": 0.1},
            {"shore_a": 50.0, "thickness": 0.02},
            {},
        ),
        (
            {"shore_a": 60.0, "area": 1e-4, "thickness": 0.01, "loss_factor": 0.1},
            {"stiffness": 5.0},
            {"shore_a": None, "area": None, "thickness": None},
        ),
    ],
)
def test_the_keys_of_rubber_vary_as_they_are_written(keys, varied, instead) -> None:
    def scene(**law: float) -> Scene:
        pair = ImpactPair(lower=-1.0, upper=1.0, law=Viscoelastic(**law))
        return oscillator().model_copy(update={"impact_pairs": (pair,)})

    change = tuple((f"impact_pair.0.law.{key}", value) for key, value in varied.items())
    changed = changed_scene(scene(**keys).document(as_written=True), change)
    expected = {key: value for key, value in (keys | instead | varied).items() if value is not None}
    assert changed == scene(**expected) != scene(**keys)
    # it states where its numbers come from, and not where the others came from
    assert changed.impact_pairs[0].law.source == scene(**expected).impact_pairs[0].law.source


def test_a_law_with_another_number_is_no_more_as_it_was_written() -> None:
    law = Viscoelastic(stiffness=2.0, loss_factor=0.2)
    stiffer = law.model_copy(update={"stiffness": 3.0})
    pair = ImpactPair(lower=-1.0, upper=1.0, law=stiffer)
    scene = oscillator().model_copy(update={"impact_pairs": (pair,)})
    assert scene_from(scene.document(as_written=True)).impact_pairs[0].law.stiffness == 3.0


def test_a_line_for_each_combination_of_the_other_keys() -> None:
    vary = {GAP: [0.5, 1.0, 2.0], "structure.damping": [0.1, 0.4]}
    table = sweep(oscillator(), vary, method="exact")
    ax = draw_sweep(table, list(vary), "stops.collision_rate")
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["structure.damping 0.1", "structure.damping 0.4"]
    assert ax.get_ylabel() == "impacts, all stops (1/s)"
    assert ax.get_xlabel() == "impact_pair.upper (m)" and ax.get_title() == "exact"


TRUCK = """
[structure]
kind = "isolator"
frequency_hz = 12.0
Q = 5.0
mass = 2.0
[[impact_pair]]
clearance = 0.006
law = { kind = "restitution", coefficient = 0.5 }
[[excitation]]
kind = "white"
density = 0.01
unit = "g2/Hz"
"""


def test_a_sizing_for_each_row(stochvi: Run, tmp_path: Path) -> None:
    """Each row is the answer of `size`; one sheet holds the pictures, and kept rows are read."""
    scene = tmp_path / "truck.toml"
    scene.write_text(TRUCK)
    asked = {"probability": 0.05, "mission": 600.0, "rel_error": 0.3, "threads": 1}
    vary = {"structure.Q": [4.0, 5.0]}
    table = sweep(scene, vary, method="size", out=tmp_path / "out", **asked)
    own = size(changed_scene(load_scene(scene).document(), (("structure.Q", 4.0),)), **asked)
    assert table["size.clearance"][0] == own.clearance.value
    hits = own.expected_hits
    assert hits is not None and hits.standard_error > 0.0
    assert table["size.expected_hits"][0] == hits.value
    assert table["size.expected_hits.standard_error"][0] == hits.standard_error
    again = sweep(scene, vary, method="size", out=tmp_path / "out", **asked)
    pd.testing.assert_frame_equal(again, table)
    done = stochvi(
        "sweep", scene, "--vary", "structure.Q=4,5", "--method", "size", "--probability", "5%",
        "--mission", "10min", "--rel-error", "0.3", "--threads", "1", "--out", tmp_path / "out",
    )  # fmt: skip
    assert done.code == 0 and "clearance per side (mm)" in done.out
    written = pd.read_csv(tmp_path / "out" / "sweep.csv")
    assert written["size.clearance_m"].tolist() == table["size.clearance"].tolist()
    assert [path.name for path in (tmp_path / "out").glob("*.png")] == ["sweep.png"]


def test_a_clearance_that_is_an_upper_limit_stays_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest stops that can be judged keep the target: the table stated an error of them."""
    known = sizing_of(scene_between_stops(), paths=64)
    kept = replace(known, kept_with=Estimate(value=0.0, upper_95=2e-5))
    answers = iter([known, kept])
    monkeypatch.setattr("stochvi.isolators.size", lambda scene, **asked: next(answers))
    scene, asked = scene_between_stops(), {"probability": 0.05, "mission": 600.0, "threads": 1}
    table = sweep(scene, {"structure.frequency_hz": [10.0, 11.0]}, method="size", **asked)
    first, second = (table.iloc[row] for row in (0, 1))
    assert first["size.clearance"] == known.clearance.value
    assert first["size.clearance.standard_error"] > 0.0 and np.isnan(first[LIMIT])
    assert second["size.clearance"] == 0.0 and second[LIMIT] == known.clearance.value


LIMIT = "size.clearance.upper_95"


def test_a_reliability_for_each_row(tmp_path: Path) -> None:
    asked = {"mission": 20.0, "rel_error": 0.3, "threads": 1, "budget": 60.0}
    table = sweep(oscillator(0.5), {GAP: [2.0, 3.0]}, method="reliability", **asked)
    own = reliability(oscillator(0.5, 2.0), **asked)
    assert table["mission.hit"][0] == own.chances["hit"].estimate.value
    assert own.hits is not None and table["mission.expected_hits"][0] == own.hits.value
    assert table["mission.expected_hits"][1] < table["mission.expected_hits"][0]


def test_phases_bring_their_own_mission_to_a_sweep(stochvi: Run, tmp_path: Path) -> None:
    phases = '[[phase]]\nname = "road"\nduration = 20.0\n'
    (tmp_path / "phases.toml").write_text(TRUCK + phases)
    asked = ("--vary", "impact_pair.0.clearance=8mm,9mm", "--method", "reliability")
    limits = ("--rel-error", "0.3", "--threads", "1", "--out", tmp_path / "out")
    done = stochvi("sweep", tmp_path / "phases.toml", *asked, *limits)
    assert done.code == 0, done.err
    hit = pd.read_csv(tmp_path / "out" / "sweep.csv")["mission.hit"]
    assert 0.0 < hit[1] < hit[0]


@pytest.mark.slow
def test_a_mission_is_sized_for_each_row() -> None:
    """A row has the clearance that `size` gives its scene, with the error of its interval."""
    phases = [{"name": "road", "duration": 3600.0}, {"name": "air", "duration": 60.0}]
    scene = scene_between_stops(Restitution(coefficient=0.5)).replace(phase=phases)
    asked: dict[str, Any] = {"probability": 0.05, "rel_error": 0.3, "threads": 1}
    key = "structure.frequency_hz"
    table = sweep(scene, {key: [12.0, 15.0]}, method="size", **asked)
    assert (table["note"] == "").all()
    own = size(changed_scene(scene.document(), [(key, 15.0)]), **asked).clearance
    assert table["size.clearance"][1] == own.value < table["size.clearance"][0]
    error = table["size.clearance.standard_error"][1]
    assert error == pytest.approx((own.upper - own.lower) / (2.0 * 1.96), rel=1e-3)


def test_what_a_row_takes_too_long_the_others_have_less(monkeypatch: pytest.MonkeyPatch) -> None:
    now, given = [0.0], []
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))

    def row(job: Any, *_: Any) -> dict[str, Any]:
        given.append(job.arguments["budget"])
        now[0] += 22.0 if len(given) == 1 else 1.0
        return {"seed": 0, "paths": 2, "seconds": 1.0, "note": ""}

    monkeypatch.setattr(stochvi.sweeps.Job, "row", row)
    sweep(oscillator(0.5), {GAP: [2.0, 3.0, 4.0]}, budget=10.0)
    assert given == [10.0, 4.0, 7.0]
    given.clear()
    sweep(oscillator(0.5), {GAP: [2.0]}, budget=None)
    assert given == [None]


def test_a_record_is_replayed_for_each_row(tmp_path: Path) -> None:
    t = np.arange(4000) / 400.0
    record = np.column_stack([t, 10.0 * np.sin(2.0 * np.pi * 3.0 * t)])
    np.savetxt(tmp_path / "record.csv", record, delimiter=",", header="time (s),a (m/s^2)")
    scene = tmp_path / "recorded.toml"
    text = TRUCK[: TRUCK.index("[[excitation]]")]
    scene.write_text(text + '[[excitation]]\nkind = "record"\nfile = "record.csv"\nunit = "m/s2"\n')
    table = sweep(scene, {"impact_pair.0.clearance": [0.001, 0.05]}, method="replay")
    assert set(table["note"]) == {""}, table["note"].tolist()
    assert table["stops.hits"][0] > 10.0 and table["stops.hits"][1] == 0.0
    assert table["x.displacement_max"][0] == pytest.approx(0.001, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--method", "size"), "needs exactly one of --probability"),
        (("--method", "reliability"), "needs --mission"),
        (("--method", "replay", "--mission", "10h"), "--mission is for --method size or reliab"),
        (("--probability", "0.1"), "--probability is for --method size alone"),
        (("--impact-energy", "5J"), "--impact-energy is for --method size or reliability"),
    ],
)
def test_options_of_other_methods_are_refused(
    stochvi: Run, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    (tmp_path / "truck.toml").write_text(TRUCK)
    done = stochvi("sweep", tmp_path / "truck.toml", "--vary", "structure.Q=4,5", *arguments)
    assert done.code == 2 and said in done.err


def test_a_table_and_a_picture_tell_the_errors(tmp_path: Path) -> None:
    table = sweep(oscillator(), {GAP: [0.5, 1.0]}, paths=64, duration=20.0, threads=1)
    rate = "stops.collision_rate"
    errors = {end: float(table[f"{rate}.{end}"][0]) for end in ("standard_error", "bias")}
    told = plus_minus(Estimate(value=float(table[rate][0]), **errors))
    assert terminal_table(table, [GAP])["impacts, all stops (1/s)"][0] == told and "±" in told
    told = draw_sweep(table, [GAP], "stops.collision_rate", "a box").get_title()
    assert told == "a box\nsimulate; bars: 95 % intervals"


def test_a_mean_that_vanishes_is_not_drawn() -> None:
    table = pd.DataFrame({"x.displacement_std": [1.0, 2.0], "x.displacement_mean": [1e-20, -2e-20]})
    assert changes(table, "x.displacement_std") and not changes(table, "x.displacement_mean")
    table["x.displacement_mean"] = [1e-3, 2e-3]
    assert changes(table, "x.displacement_mean")


def test_the_command_writes_a_table_and_pictures(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(to_toml(DOCUMENT))
    ask = ["sweep", str(scene), "--vary", f"{GAP}=0.5:1:2", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(main, [*ask, "--method", "exact"])
    assert done.exit_code == 0, done.output
    table = pd.read_csv(tmp_path / "out" / "sweep.csv")
    assert len(table) == 2 and (tmp_path / "out" / "sweep.png").exists()
    assert not any(" " in name for name in table)
    named = {f"{GAP}_m", "x.displacement_std_m.standard_error", "stops.collision_rate_per_s.bias"}
    assert named <= set(table)
    assert {f"{name}.bias" for name in quantities(table)} <= set(table)
    (kept, _) = (tmp_path / "out" / "rows").glob("*.json")
    assert json.loads(kept.read_text())["method"] == "exact"
    done = CliRunner().invoke(main, [*ask, "--vary", f"{R}=0.5", "--method", "exact"])
    assert done.exit_code == 1 and "2 of 2 rows fell short" in done.output
    done = CliRunner().invoke(main, [*ask, "--method", "exact", "--threads", "1"])
    assert done.exit_code == 0  # nothing is sampled: it changes nothing
    done = CliRunner().invoke(main, [*ask, "--method", "exact", "--paths", "10"])
    assert done.exit_code == 2 and "--paths is for --method simulate" in done.output


# ---- what is there and damaged, and what makes no sense ----------------------------------------


@pytest.mark.parametrize(
    "text", ["{", "", "[]", '{"coordinates": {}}', '{"coordinates": {"x": {}}}', "\xff"]
)
def test_a_row_that_cannot_be_read_is_done_again(tmp_path: Path, text: str) -> None:
    whole = sweep(oscillator(), {GAP: [1.0]}, method="exact", out=tmp_path)
    (kept,) = (tmp_path / "rows").iterdir()
    sound = kept.read_text()
    kept.write_bytes(text.encode("latin-1"))
    with pytest.warns(UserWarning, match=f"{kept.name} holds no answer .* computed again"):
        again = sweep(oscillator(), {GAP: [1.0]}, method="exact", out=tmp_path)
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), whole.drop(columns="seconds"))
    assert json.loads(kept.read_text())["coordinates"] == json.loads(sound)["coordinates"]


def test_a_checkpoint_of_a_row_that_is_damaged_is_left(tmp_path: Path) -> None:
    asked = {"paths": 64, "duration": 5.0}
    whole = sweep(oscillator(), {GAP: [1.0]}, out=tmp_path, **asked)
    (kept,) = (tmp_path / "rows").iterdir()
    for damage in ("garbage", "stochvi checkpoint 3 cut sh"):
        kept.unlink()
        kept.with_suffix(".checkpoint").write_text(damage)
        with pytest.warns(UserWarning, match="checkpoint is .* computed again"):
            again = sweep(oscillator(), {GAP: [1.0]}, out=tmp_path, **asked)
        pd.testing.assert_frame_equal(again.drop(columns="seconds"), whole.drop(columns="seconds"))
        assert list((tmp_path / "rows").iterdir()) == [kept]


test_ranges_that_are_none_are_refused = refusals(
    lambda vary: sweep(oscillator(), vary, method="exact"),
    ({GAP: []}, "has no values"),
    ({GAP: 0.5}, "must have a list of numbers, got 0.5"),
    ({GAP: "1"}, "must have a list of numbers, got '1'"),
    ({GAP: ["a"]}, "got 'a' among them"),
    ({GAP: [[1, 2]]}, r"got \[1, 2\] among them"),
    ({GAP: [True]}, "got True among them"),
    ({GAP: [1.0], "impact_pair.00.upper": [2.0]}, f"{GAP} is given twice"),
    ({"impact_pair.².upper": [1.0]}, "did you mean"),
    ({}, "at least one key"),
    ([GAP], "at least one key"),
    error=ValueError,
    pattern=True,
)


test_arguments_that_make_no_sense_are_refused = refusals(
    lambda asked: sweep(oscillator(), {GAP: [1.0]}, **asked),
    ({"seed": -1, "common": False}, "seed must be in"),
    ({"seed": 1.5}, "seed must be a whole number"),
    ({"out": ""}, "out must name a folder"),
    ({"checkpoint": "run", "out": "rows"}, "give checkpoint or out, not both"),
    ({"method": "size"}, "give exactly one of probability, rate.* got none"),
    ({"method": "size", "probability": 2.0}, r"probability must be in \(0, .*got 2"),
    ({"method": "size", "rate": "a"}, "rate must be a number"),
    ({"method": "size", "rate": 1.0, "pair": "wall"}, "pair must name impact pairs"),
    ({"method": "closure", "form": "clumps"}, "form must be left out .* method='linearise'"),
    error=ValueError,
    pattern=True,
)


def test_numbers_of_numpy_are_the_same_rows(tmp_path: Path) -> None:
    sweep(oscillator(), {GAP: [1, 2]}, out=tmp_path, paths=64, duration=5.0, seed=3)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "rows").iterdir()}
    sweep(
        oscillator(), {"impact_pair.00.upper": np.array([1, 2])}, out=tmp_path,
        paths=np.int64(64), duration=np.float64(5.0), seed=np.int64(3),
    )  # fmt: skip
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "rows").iterdir()}


def test_the_command_refuses_a_key_twice_and_folders_without_a_name() -> None:
    for ask, said in (
        (["--vary", f"{GAP}=1", "--vary", "impact_pair.00.upper=2"], "is given twice"),
        (["--vary", f"{GAP}=1", "--out", ""], "--out must name a folder, got ''"),
        (["--vary", f"{GAP}=1:inf:3"], "--vary must be"),
    ):
        done = CliRunner().invoke(main, ["sweep", ELASTIC, *ask])
        assert done.exit_code == 2 and done.stderr.count("\n") == 1 and said in done.stderr


@pytest.mark.parametrize(
    ("vary", "rows"),
    [
        (["1:2:1000000000"], "1000000000 of structure.stiffness are 1000000000 rows"),
        (["1:2:5000", "structure.damping=1:2:5000"], "are 25000000 rows"),
    ],
)
def test_more_rows_than_a_sweep_may_have_are_refused_at_once(stochvi, vary, rows):
    words = [word for part in vary for word in ("--vary", f"structure.stiffness={part}")]
    words = [word.replace("structure.stiffness=structure", "structure") for word in words]
    began = time.process_time()
    message = refused(stochvi("sweep", ELASTIC, *words, "--method", "exact"))
    assert rows in message and "at most 10000" in message
    assert time.process_time() - began < 2.0


def test_ctrl_c_leaves_the_rows_that_are_complete_in_a_table(
    stochvi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(to_toml(DOCUMENT))
    answered, row = [], Job.row

    def interrupted(self: Job, *arguments: object) -> object:
        if len(answered) == 2:
            raise KeyboardInterrupt
        answered.append(self)
        return row(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Job, "row", interrupted)
    vary = ("--vary", "structure.stiffness=1,2,3", "--method", "exact")
    done = stochvi("sweep", scene, *vary, "--out", tmp_path / "out")
    assert done.code == 1 and "rows are kept" in done.err
    table = pd.read_csv(tmp_path / "out" / "sweep.csv")
    assert table.filter(like="stiffness").iloc[:, 0].tolist() == [1.0, 2.0]
    answered.clear()
    with pytest.raises(Interrupted, match="after row 2 of 3") as stopped:
        sweep(scene, {"structure.stiffness": [1.0, 2.0, 3.0]}, method="exact")
    assert len(stopped.value.partial) == 2


def test_what_is_no_table_is_no_grid() -> None:
    pytest.importorskip("xarray")
    with pytest.raises(ValueError, match="table must be a table or an answer that is one, got a i"):
        to_xarray(3)


def test_a_sweep_is_a_grid_with_units_for_xarray() -> None:
    values = {"impact_pair.0.upper": [1.0, 2.0], "structure.damping": [0.1, 0.2, 0.4]}
    table = sweep(load_scene(shipped_scene("oscillator-elastic")), values, method="exact")
    grid = to_xarray(table.sample(frac=1.0, random_state=1))
    assert dict(grid.sizes) == {"impact_pair.0.upper": 2, "structure.damping": 3}
    for row in table.itertuples(index=False):
        place = dict(zip(values, row, strict=False))
        named = dict(zip(table, row, strict=True))
        for name in ("x.displacement_std", "stops.collision_rate", "stops.collision_rate.bias"):
            assert float(grid[name].sel(place)) == named[name]
    assert grid["stops.collision_rate.bias"].attrs["units"] == "1/s"
    assert grid["impact_pair.0.upper"].attrs["units"] == "m"
    # rows that are no grid are samples, and keys that are not known are asked for
    samples = to_xarray(table.iloc[:5])
    assert samples.sizes == {"sample": 5} and set(samples.coords) == {"sample", *values}
    with pytest.raises(ValueError, match="keys must name columns"):
        to_xarray(pd.DataFrame(table.to_dict("list")))
    assert to_xarray(pd.DataFrame(table.to_dict("list")), list(values)).sizes == grid.sizes


def test_an_answer_is_a_grid_over_the_columns_that_tell_its_rows_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = load_scene(shipped_scene("oscillator-lossy"))
    found = spectrum(scene, paths=16, threads=1)
    grid, table = to_xarray(found), found.to_frame()
    assert set(grid.sizes) == {"of", "quantity", "frequency_hz"}
    for row in table.iloc[::17].itertuples(index=False):
        place = {"of": row.of, "quantity": row.quantity, "frequency_hz": row.frequency_hz}
        for name in ("value", "lower", "upper"):
            assert float(grid[name].sel(place)) == getattr(row, name)
    assert int(grid["value"].notnull().sum()) == int(table["value"].notna().sum())
    assert grid["unit"].sel(of="x", quantity="displacement").item() == "m^2/Hz"
    assert set(grid["unit"].dims) == {"of", "quantity"}
    times = to_xarray(first_passage(scene, times=[1.0, 2.0]))
    assert times.sizes == {"time": 2} and times["time"].attrs["units"] == "s"
    # most cells of a grid of all pairs would be empty: rows stay rows
    rows = to_xarray(check(scene, rel_error=0.2, threads=1))
    assert list(rows.sizes) == ["sample"] and {"of", "quantity"} <= set(rows.coords)
    past = to_xarray(history(scene, duration=1.0))
    units = {name: past[name].attrs["units"] for name in past.variables}
    assert units == {"time_s": "s", "displacement_m": "m", "velocity_m_s": "m/s"}
    density = simulate(scene, paths=16, duration=10.0).densities()["x"]
    bins = to_xarray(density)
    assert bins["value"].attrs["units"] == "1/m" and bins["displacement"].attrs["units"] == "m"
    np.testing.assert_array_equal(bins["value"], density.density)
    np.testing.assert_array_equal(bins["displacement"], density.to_frame()["displacement"])
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"^to_xarray needs xarray: pip install .*xarray"):
        to_xarray(found)


# ------------------------------------------------------------------------------
# `stochvi sine`, `basins` and `bifurcation`: documents, files, and what they refuse.
# ------------------------------------------------------------------------------


MOUNT = str(shipped_scene("isolator-sine"))
BRANCH_KEYS = {
    "form", "impacts_per_period", "sticking", "periods", "frequency_hz", "displacement_max",
    "impact_speed", "multiplier", "stable", "admissible",
}  # fmt: skip


@pytest.mark.slow
def test_branches_jumps_and_files_of_a_sweep(stochvi: Run, tmp_path: Path) -> None:
    done = stochvi(
        "sine", MOUNT, "--from", "90", "--to", "0.12kHz", "--points", "3", "--sweep", "up",
        "--out", str(tmp_path), "--json", "-", "--quiet",
    )  # fmt: skip
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert document["jumps"].keys() == {"up_hz", "down_hz"}
    assert all(branch.keys() == BRANCH_KEYS for branch in document["branches"])
    free, *others = document["branches"]
    assert free["impacts_per_period"] == 0 and free["impact_speed"] == [[], [], []]
    assert {2} <= {branch["impacts_per_period"] for branch in others}
    for branch in document["branches"]:
        assert len(branch["frequency_hz"]) == len(branch["stable"]) == len(branch["impact_speed"])
    assert (tmp_path / "sine.csv").is_file() and (tmp_path / "sine.png").is_file()


def test_a_key_of_the_scene_takes_the_place_of_the_frequency(stochvi: Run) -> None:
    asked = ("--vary", "impact_pair.0.clearance=0.3mm:0.4mm:2", "--json", "-", "--quiet")
    document = one_document(stochvi("sine", MOUNT, *asked).out)
    assert document["key"] == "impact_pair.0.clearance"
    branch = document["branches"][0]
    assert branch["value"] == pytest.approx([3e-4, 4e-4])
    assert branch["frequency_hz"] == pytest.approx([100.0, 100.0])


def test_the_table_says_what_was_found(stochvi: Run) -> None:
    done = stochvi("sine", MOUNT)
    assert done.code == 0
    assert "branches of periodic regimes" in done.out


def test_a_budget_that_ends_first_is_a_failure_with_what_there_is(stochvi: Run) -> None:
    done = stochvi("sine", MOUNT, "--from", "90", "--to", "120", "--budget", "1e-6")
    assert done.code == 1
    assert "budget" in done.err


test_what_cannot_be_asked_is_refused = refusals(
    lambda stochvi, options: stochvi("sine", MOUNT, *options),
    (("--from", "20"), "--from and --to must be two rising frequencies"),
    (("--from", "30", "--to", "20"), "--from and --to must be two rising frequencies"),
    (("--from", "20", "--to", "30", "--points", "1"), "--points must be at least 2, got 1"),
    (("--vary", "a=1:2:3", "--from", "1"), "--vary takes the place of --from and --to"),
    (("--coordinate", "y"), "coordinate must be one of x, got 'y'"),
    (("--impacts", "0"), "--impacts must be at least 1, got 0"),
)


STARTS = ("--start", "displacement.x=-0.3mm:0.3mm:3", "--start", "velocity.x=-0.2,0.2")


def follows_the_schema(document: dict[str, Any], stochvi: Run) -> bool:
    """Whether a document is what `stochvi schema answer` says, and says nothing more."""
    valid = jsonschema.Draft202012Validator(one_document(stochvi("schema", "answer").out))
    return valid.is_valid(document) and not valid.is_valid(document | {"no_such_key": 1})


def test_a_map_of_starts_and_its_files(stochvi: Run, tmp_path: Path) -> None:
    asked = (*STARTS, "--out", str(tmp_path), "--json", "-", "--quiet", "--threads", "1")
    done = stochvi("basins", MOUNT, *asked)
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    assert document["plane"] == ["displacement.x", "velocity.x"]
    assert document["across"] == pytest.approx([-3e-4, 0.0, 3e-4])
    assert [len(row) for row in document["ends"]] == [3, 3]
    assert sum(regime["share"] for regime in document["regimes"]) == pytest.approx(1.0)
    assert {"name", "kind", "multiplier", "lyapunov"} <= document["regimes"][0].keys()
    assert (tmp_path / "basins.csv").is_file() and (tmp_path / "basins.png").is_file()


def test_a_diagram_of_impact_speeds_and_its_files(stochvi: Run, tmp_path: Path) -> None:
    done = stochvi(
        "bifurcation", MOUNT, "--from", "100", "--to", "101", "--points", "2", "--sweep", "up",
        "--start", "velocity.x=-0.3m/s", "--out", str(tmp_path), "--json", "-",
    )  # fmt: skip
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    (sweep,) = document["sweeps"]
    assert sweep["value"] == pytest.approx([100.0, 101.0])
    assert [len(speeds) for speeds in sweep["impact_speed"]] == [2 * 128, 2 * 128]
    assert (tmp_path / "bifurcation.csv").is_file() and (tmp_path / "bifurcation.png").is_file()


test_what_cannot_be_started_is_refused = refusals(
    lambda stochvi, command, options: stochvi(command, MOUNT, *options),
    ("basins", ("--start", "velocity.x=fast"), "--start must be NAME=FIRST:LAST:NUMBER"),
    ("basins", ("--start", "velocity.x=1"), "plane must be two of displacement.x"),
    ("basins", ("--periods", "0"), "periods must be at least 1, got 0"),
    ("bifurcation", (), "--from and --to, or --vary, must say what is varied"),
    ("bifurcation", ("--from", "1", "--to", "2", "--watched", "3"), "watched at least 64"),
)


def test_life_times_of_a_scene_with_noise(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "noisy.toml"
    noise = '[[excitation]]\nkind = "white"\non = "base"\nintensity = 0.01\n'
    scene.write_text(Path(MOUNT).read_text(encoding="utf-8") + noise, encoding="utf-8")
    asked = ("--regime", "no impacts", "--rel-error", "0.4", "--threads", "1")
    out = tmp_path / "out"
    done = stochvi("lifetimes", str(scene), *asked, "--out", str(out), "--json", "-", "--quiet")
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert follows_the_schema(document, stochvi)
    (regime,) = document["regimes"]
    assert regime["regime"] == "no impacts" and regime["left"] >= 7
    assert regime["life_time_low"] < regime["life_time"] < regime["life_time_high"]
    assert regime["destinations"][0]["regime"] == "stops lower, stops upper"
    assert (out / "lifetimes.csv").is_file() and (out / "lifetimes.png").is_file()
    assert "noise besides the sine" in refused(stochvi("lifetimes", MOUNT))


def test_new_writes_a_hammer_that_sine_and_impacts_take(tmp_path: Path, stochvi: Run) -> None:
    file = str(tmp_path / "breaker.toml")
    assert stochvi("new", file, "--kind", "hammer").code == 0
    found = one_document(stochvi("sine", file, "--impacts", "1", "--json", "-").out)
    # momentum: blows per second times their speed are feed / ((1 + R) m)
    stable = [
        speeds[0]
        for branch in found["branches"]
        if branch["impacts_per_period"] == branch["periods"] == 1
        for speeds, good in zip(branch["impact_speed"], branch["stable"], strict=True)
        if good
    ]
    assert stable == pytest.approx([100.0 / 1.3 / 12.0], rel=1e-9)
    blows = one_document(
        stochvi("impacts", file, "--paths", "16", "--duration", "20", "--json", "-").out
    )
    tool = blows["impact_pairs"]["tool"]
    lost = tool["energy"]["value"] / tool["striking_energy"]["value"]
    assert lost == pytest.approx(1.0 - 0.3**2)
    assert tool["striking_energy"]["value"] == pytest.approx(tool["speed_rms"]["value"] ** 2 / 2.0)
