"""Every kind of answer: plain documents, tables, and pages that drop no warning."""

from __future__ import annotations

import errno
import gzip
import importlib
import io
import json
import math
import os
import pickle
import pkgutil
import re
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from pandas.api.types import is_float_dtype

import stochvi
from stochvi import Elastic, ImpactPair, Isolator, Oscillator, Restitution, Scene, WhiteNoise
from stochvi.cli import answer_schema as schemas
from stochvi.cli.answer_schema import answer_schema
from stochvi.identification import DropRecord, ForceCurve, Rebounds
from stochvi.isolators import Spread, perturbations
from stochvi.isolators.record_verdict import response_law
from stochvi.isolators.sizing import Sizing
from stochvi.mathematics.units import (
    WITHOUT_CHOICE,
    shown_as,
    shown_in,
    units_of,
    units_passed_over,
)
from stochvi.methods import periodic
from stochvi.methods.monte_carlo import record_path
from stochvi.methods.periodic import SwitchedDrive
from stochvi.results import base, files
from stochvi.results.base import Response, Result, in_chosen_units, plain, total_cost
from stochvi.results.errors import (
    Interrupted,
    NotApplicable,
    NotConverged,
    SceneError,
    StochviError,
    reason_of,
)
from stochvi.results.estimates import Cost, Estimate, plus_minus
from stochvi.results.files import RENAMED, name_of
from stochvi.sampling.calculations import calculation
from stochvi.sampling.run import Run
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.phases import Phase
from stochvi.scenes.records import read_record
from stochvi.scenes.scene import scene_from
from stochvi.statistics.impacts import impacts
from stochvi.statistics.spectra import spectrum
from stochvi.verification.check import check_many
from stochvi.verification.cost import cost
from stochvi.views.axes import STYLES
from support import CHECKOUT, judges
from support.commands import Run as RunOfCommands
from support.commands import refused
from support.known import oscillator
from support.mutations import BARE
from support.pairs import pair, uncoupled
from support.sized import scene_between_stops, sizing_of

SAID_IN_SENTENCES = {
    "CoordinateReplay.displacement_mean", "PairReplay.hits_lower", "PairReplay.hits_upper",
    "PairReplay.impact_speed_mean", "Performance.velocity_std",
}  # fmt: skip
"""Numbers beside stated ones that no table of stated fields shows: a view names each."""


def test_every_number_of_an_answer_states_its_words_and_a_unit_that_is_known() -> None:
    """A field without them is in JSON, and silently in no table; a unit that is not parsed stays
    where others are chosen."""
    known = schemas.Definitions()
    for kind in schemas.kinds():
        known.reference(kind)
    unstated, units = set(), set()
    for kind in filter(is_dataclass, known._names):
        stated = {}
        if not any(each.metadata.get("stated") for each in fields(kind)):
            continue
        for each in fields(kind):
            if str(each.type) not in ("Estimate", "Estimate | None"):
                continue
            said = each.metadata.get("stated")
            if said is None:
                unstated.add(f"{kind.__name__}.{each.name}")
                continue
            units |= {said.unit, said.unit.replace("J", "J/kg", 1)}
            stated[said] = each.name
            assert said.words, (kind, each.name)
        count = sum(each.metadata.get("stated") in stated for each in fields(kind))
        assert count == len(stated), f"two numbers of {kind.__name__} have the same words and unit"
    assert unstated == SAID_IN_SENTENCES
    with shown_in(units_of("mm, mJ, kN, ms")):
        for unit in units - WITHOUT_CHOICE:
            shown_as(unit)
        assert not units_passed_over()
        assert str(shown_as("J/kg/h")) == "mJ/kg/h"
        shown_as("J/furlong")
        assert list(units_passed_over()) == ["J/furlong"]


def lossy() -> Scene:
    return oscillator(-1.0, 1.0, 0.8)


def judged() -> Result:
    return stochvi.testing.judge(lambda problem, seed: {"velocity_std": (1.0, 0.01)}, ["linear"])


def calmed() -> Result:
    tower = Scene(
        structure=Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        absorber=stochvi.Absorber(
            mass=0.1, play=3.0, law=stochvi.Restitution(coefficient=0.5)
        ),
        excitations=[WhiteNoise(intensity=0.04)],
    )  # fmt: skip
    return stochvi.absorber(tower, levels_db=[0.0], rel_error=0.2, threads=1)


def replayed() -> Result:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.txt"
        np.savetxt(file, np.sin(0.1 * np.arange(400)))
        noise = stochvi.RecordedNoise(file=str(file), unit="m/s2", fs=100.0)
        mount = stochvi.Isolator(frequency_hz=2.0, zeta=0.1)
        return stochvi.replay(Scene(structure=mount, excitations=[noise]))


def shaken() -> Scene:
    """A mass with a stop under a sine."""
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[stochvi.ImpactPair(upper=1.0, law=stochvi.Restitution(coefficient=0.5))],
        excitations=[stochvi.Sine(amplitude=1.0, frequency_hz=0.2)],
    )


ANSWERS: dict[str, Callable[[], Result]] = {
    "Response": lambda: stochvi.fokker_planck(lossy()),
    "Check": lambda: stochvi.check(lossy(), rel_error=0.1, threads=1),
    "Checks": lambda: check_many({"a": lossy()}, rel_error=0.1, threads=1),
    "WorkPrecision": lambda: cost(lossy(), paths=64, threads=1),
    "Explanation": lambda: stochvi.explain(lossy()),
    "Judgement": judged,
    "Screening": lambda: stochvi.screen(scene_between_stops()),
    "Sizing": lambda: sizing_of(scene_between_stops(), paths=64),
    "FirstPassage": lambda: stochvi.first_passage(lossy(), times=[1.0]),
    "HarmonicResponse": lambda: stochvi.harmonic_response(shaken(), [0.15, 0.2], sweep="up"),
    "Basins": lambda: periodic.basins(
        shaken(),
        {"displacement.x": np.linspace(-1.0, 1.0, 4), "velocity.x": np.linspace(-1.0, 1.0, 4)},
        threads=1,
    ),
    "Bifurcation": lambda: periodic.bifurcation(
        shaken(), [0.15, 0.2], settling=64, watched=64
    ),
    "Transient": lambda: stochvi.transient(oscillator(), [1.0]),
    "Reliability": lambda: stochvi.reliability(
        oscillator(), mission=5.0, barrier=2.0, start="rest", rel_error=0.5, threads=1
    ),
    "ImpactStatistics": lambda: impacts(
        lossy(), paths=16, duration=20.0, threads=1
    ),
    "ResponseSpectrum": lambda: spectrum(oscillator(), paths=16, threads=1),
    "AbsorberReport": calmed,
    "AbsorberSine": lambda: stochvi.absorbers.absorber_sine(
        Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            absorber=stochvi.Absorber(
                mass=0.1, play=1.0, law=stochvi.Restitution(coefficient=0.5)
            ),
            excitations=[stochvi.Sine(amplitude=0.1, frequency_hz=0.16)],
        ),
        tune={"absorber.play": [1.0]},
        most_impacts=2,
    ),
    "BumperMap": lambda: stochvi.isolators.bumper_map(
        scene_between_stops(), clearances=[6e-3], stiffness_factors=[1.0, 2.0], rel_error=0.5,
        threads=1, limits={"peak_acceleration": 1000.0},
    ),
    "Sizing of phases": lambda: stochvi.size(
        scene_between_stops().replace(phase=[{"name": "road", "duration": 600.0}]), probability=0.1,
        rel_error=0.5, threads=1,
    ),
    "History": lambda: stochvi.history(lossy(), duration=2.0),
    "FoundShocks": lambda: stochvi.shocks(
        shipped_scene("isolator-potholes").with_name("truck-potholes.csv")
    ),
    "Identification": lambda: stochvi.identify(
        Rebounds(approach=[0.5, 1.0, 1.5, 2.0], rebound=[0.36, 0.69, 1.06, 1.39])
    ),
    "Sizing of pairs": lambda: stochvi.size(
        uncoupled(pair("x", "x", 3.0)), probability=0.1, mission=200.0, rel_error=0.5, threads=1
    ),
    "Replay": replayed,
}  # fmt: skip
"""A small answer of each kind. Those that take long are made in their own tests."""


ANSWERS_SCHEMA = answer_schema()


@pytest.fixture(scope="module", params=ANSWERS)
def answer(request: pytest.FixtureRequest) -> Result:
    found = ANSWERS[request.param]()
    assert type(found).__name__ == request.param.split()[0]
    return found


def kinds(kind: type[Result]) -> Iterator[type[Result]]:
    for each in kind.__subclasses__():
        yield each
        yield from kinds(each)


def test_every_kind_of_answer_is_tested_here_or_where_it_is_made() -> None:
    for module in pkgutil.walk_packages(stochvi.__path__, "stochvi."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    own = [each for each in kinds(Result) if each.__module__.startswith("stochvi.")]
    names = {each.__name__ for each in own if not each.__subclasses__()}
    elsewhere = {
        "Damage", "DamageSizing", "Design", "Jolts", "LifeTimes", "Production", "Stability",
    }  # fmt: skip
    assert names == {*(each.split()[0] for each in ANSWERS), *elsewhere}


def test_answers_are_equal_if_their_documents_are(answer: Result) -> None:
    assert replace(answer) == answer
    other = replace(answer, provenance={"scene": None})
    assert (other == answer) == (other.to_dict() == answer.to_dict())
    assert answer != answer.to_dict()


def test_a_document_is_plain_json(answer: Result) -> None:
    document = answer.to_dict()
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_a_document_follows_the_schema_of_its_kind(answer: Result) -> None:
    kind = type(answer).__name__
    if kind != "Transient":  # no command writes one
        document = answer.to_dict()
        schema = ANSWERS_SCHEMA | {"anyOf": [{"$ref": f"#/$defs/{kind}"}]}
        valid = jsonschema.Draft202012Validator(schema)
        assert [each.message for each in valid.iter_errors(document)] == []
        assert not valid.is_valid(document | {"no_such_key": 1})
        assert not valid.is_valid({key: document[key] for key in list(document)[1:]})


def test_a_table_has_rows(answer: Result) -> None:
    assert len(answer.to_frame()) > 0


def test_every_column_of_a_table_has_a_judge(answer: Result) -> None:
    """A new column needs a row in docs/judges.toml, and with it a test that could refute it."""
    assert judges.columns_without_judge(answer) == []


def test_a_column_without_a_judge_is_noticed() -> None:
    sizing = sizing_of(scene_between_stops(), paths=64)
    known = {"clearance", "rice_rate", "first_hit_rate", "hit_rate", "probability"}
    strange = sizing.curve.assign(noise_level=1.0, noise_level_low=0.5, word="a", passed=True)
    assert known <= set(strange) | set(sizing.simulated)
    changed = replace(sizing, curve=strange)
    assert judges.columns_without_judge(changed) == ["noise_level", "noise_level_low"]


def test_a_picture_is_drawn_in_axes_of_its_own_and_in_given_ones(answer: Result) -> None:
    for given in (None, plt.figure().subplots()):
        ax = answer.plot(given)
        assert ax.has_data() or ax.texts
        assert ax.get_xlabel() or ax.get_ylabel() or ax.get_title()
        assert given is None or ax is given
        figure: Any = ax.get_figure(root=True)
        several = len(set(ax.get_legend_handles_labels()[1])) > 1
        assert not several or figure.legends or any(each.get_legend() for each in figure.axes)
    ax.get_figure(root=True).savefig(io.BytesIO(), format="svg")
    plt.close("all")


def assert_nothing_is_cut(figure: Any) -> None:
    """An axis is asked itself: by matplotlib 3.10 the box of a figure holds but the height of its
    labels, by which a layout is made, and not where they end."""
    figure.canvas.draw()
    drawn = [part for ax in figure.axes for part in (ax, *ax.child_axes) if part.axison]
    boxes = [axis.get_tightbbox() for ax in drawn for axis in (ax.xaxis, ax.yaxis)]
    ends = [np.divide(box.extents, figure.dpi) for box in boxes if box]
    ends.append(figure.get_tightbbox().extents)
    width, height = figure.get_size_inches()
    for left, low, right, high in ends:
        assert min(left, low, width - right, height - high) > -0.01


COLUMNS = (85.0 / 25.4, 170.0 / 25.4)
"""Widths of a picture for a paper, inches: one column, and two for panels side by side."""


def test_a_picture_for_a_paper_has_the_width_of_its_columns_and_no_title(answer: Result) -> None:
    """Labels and legends are within the figure, and curves of several colours differ in grey."""
    figure: Any = answer.plot(style="paper").get_figure(root=True)
    assert_nothing_is_cut(figure)
    width = figure.get_size_inches()[0]
    assert min(abs(width - each) for each in COLUMNS) < 0.01
    assert not figure.get_suptitle()
    assert len(figure.axes) > 1 or not figure.axes[0].get_title()
    for ax in figure.axes:
        solid = [
            each
            for each in ax.get_lines()
            if each.get_linestyle() == "-" and not each.get_label().startswith("_")
        ]
        assert len({to_hex(each.get_color()) for each in solid}) < 2
    plt.close("all")


@pytest.mark.slow
def test_no_picture_of_any_kind_is_cut_in_any_style(tmp_path: Path) -> None:
    for file in SAVED:
        (tmp_path / "answer.json").write_bytes(gzip.decompress(file.read_bytes()))
        saved = stochvi.load_answer(tmp_path / "answer.json")
        for style in STYLES:
            assert_nothing_is_cut(saved.plot(style=style).get_figure(root=True))  # type: ignore[arg-type]
        plt.close("all")


def test_a_style_changes_nothing_beside_its_picture() -> None:
    """What given Axes held before, their size, and settings of matplotlib stay; a cut picture is
    noticed."""
    found, settings = stochvi.exact(oscillator(-1.0, 1.0, 1.0)), dict(plt.rcParams)
    figure, ax = plt.subplots(figsize=(5.0, 3.0))
    mine = ax.plot([0.0, 1.0], linewidth=3.0)[0]
    found.plot(ax, style="paper")
    assert mine.get_linewidth() == 3.0 and mine.get_linestyle() == "-"
    assert list(figure.get_size_inches()) == [5.0, 3.0]
    assert dict(plt.rcParams) == settings
    narrow: Any = found.plot(style="paper").get_figure(root=True)
    narrow.axes[0].set_xlabel(100 * "x")
    with pytest.raises(AssertionError):
        assert_nothing_is_cut(narrow)
    with pytest.raises(ValueError, match=r"^style must be 'screen' or 'paper', got 'poster'$"):
        found.plot(style="poster")  # type: ignore[arg-type]
    plt.close("all")


def test_the_picture_of_a_response_tells_its_stops_and_hits() -> None:
    found = stochvi.fokker_planck(oscillator(-1.0, 0.5, 0.8))
    ax = found.plot()
    walls = [line.get_xdata()[0] for line in ax.get_lines() if len(line.get_xdata()) == 2]
    assert walls == [-1.0, 0.5]
    words = " ".join(" ".join(text.get_text().split()) for text in ax.texts)
    pair = found.impact_pairs["stops"]
    for rate in (pair.collision_rate_lower, pair.collision_rate_upper):
        assert f"{plus_minus(rate)} impacts/s" in words
    assert f"{plus_minus(found.coordinates['x'].displacement_std)} m" in words
    plt.close("all")


def test_the_picture_of_a_long_history_is_no_comb() -> None:
    found = stochvi.history(oscillator(-1.0, 1.0, 0.8), duration=3000.0, seed=1)
    low, high = found.plot().get_xlim()
    fastest = found.impacts["time_s"].iloc[found.impacts["speed_m_s"].argmax()]
    assert low <= fastest <= high
    assert high - low == pytest.approx(20 * 2.0 * math.pi, rel=0.5)
    plt.close("all")


def test_a_page_shows_what_was_found_and_drops_no_warning(answer: Result) -> None:
    page = replace(answer, warnings=("the bias is < 1 %",))._repr_html_()
    assert "the bias is &lt; 1 %" in page
    assert "<table" in page
    assert answer.summary().split("<")[0] in page


def test_a_page_has_three_columns_where_a_row_is_a_quantity(answer: Result) -> None:
    three = {"Response", "Screening", "ImpactStatistics", "Identification", "Reliability"}
    shown = answer._shown()
    assert ([*shown] == ["quantity", "value", "note"]) == (type(answer).__name__ in three)
    assert len(shown) > 0
    if isinstance(answer, Response):
        for name, value in zip(shown["quantity"], shown["value"], strict=True):
            assert float(value.split()[0]) == pytest.approx(answer[name].value, rel=0.02, abs=1e-4)


def test_a_note_says_what_a_number_lacks() -> None:
    rows = [
        {"of": "x", "quantity": "rms", "value": 2.0, "bias": None, "unit": "m", "how": "closure"},
        {"of": "x", "quantity": "rate", "value": 0.0, "upper_95": 3.0, "unit": "1/s", "how": "MC"},
        {"of": "x", "quantity": "share, both", "value": math.nan, "unit": "1", "how": "MC"},
    ]
    with shown_in(units_of("mm")):
        found = base.in_three_columns(base.frame_of(rows))
    assert [[*row.values()] for row in found] == [
        ["x.rms", "2000 mm", "closure; bias not known"],
        ["x.rate", "at most 3 1/s", "MC; bias not known"],
        ["x: share, both", "-", "MC"],
    ]


def test_errors_in_tables_are_numbers(answer: Result) -> None:
    for name, column in answer.to_frame().items():
        if str(name).endswith(base.ERRORS):
            assert is_float_dtype(column), name


def test_an_error_that_no_row_knows_is_a_number() -> None:
    row = {"of": "x", "value": 1.0, "bias": None, "acceleration_std": None, "note": None}
    table = base.frame_of([row])
    for name in ("bias", "acceleration_std"):
        assert table[name].dtype == float and np.isnan(table[name][0])
    assert table["note"].dtype == object


def test_an_answer_shows_a_number_and_finds_its_numbers_by_name(answer: Result) -> None:
    assert re.search(r"\d", repr(answer))
    for name in answer._ipython_key_completions_():
        owner, dot, quantity = name.partition(".")
        part = answer[owner]
        assert name in answer
        assert answer[name] == (getattr(part, quantity) if dot else part)
    with pytest.raises(KeyError, match="such; known: "):
        answer["no.such"]
    assert "no.such" not in answer
    with pytest.raises(TypeError):
        iter(answer)  # it is no sequence


def test_a_wrong_name_is_told_with_the_nearest_known_one_first() -> None:
    found = stochvi.exact(oscillator(-1.0, 1.0, 1.0))
    assert found["stops"].collision_rate is found["stops.collision_rate"]
    for wrong, part in (("stop", found), ("stop", found.impact_pairs), ("stopss", found)):
        with pytest.raises(KeyError, match=f"{wrong}; known: stops"):
            part[wrong]
    with pytest.raises(KeyError, match=r"known: stops.collision_rate, .* and \d+ more"):
        found["stops.colision_rate"]
    with pytest.raises(AttributeError, match="clearence; known: clearance"):
        _ = base.Named(clearance=1.0).clearence
    with pytest.raises(AttributeError, match="velocity_sdt; known: velocity_std, "):
        _ = found["x"].velocity_sdt
    with pytest.raises(AttributeError, match=r"simulat; known: simulate, .* more"):
        _ = stochvi.simulat


def test_the_names_of_an_answer_are_those_of_a_sweep() -> None:
    scene = oscillator(-1.0, 1.0, 1.0)
    (row,) = stochvi.sweep(scene, {"structure.mass": [1.0]}, method="exact").to_dict("records")
    found = stochvi.exact(scene)
    for name in found._by_name():
        if "." in name:
            assert row[name] == float(found[name])
    impacts_of = impacts(lossy(), paths=16, duration=20.0, threads=1)
    rate = impacts_of["stops.collision_rate_lower"]
    assert rate is impacts_of.pairs["stops"].rates["lower"].estimate
    sizing = sizing_of(scene_between_stops(), paths=64)
    assert sizing["stops"].clearance == sizing["stops.clearance"] == sizing["size.clearance"]
    assert float(sizing["stops.clearance"]) == sizing.clearance.value


def test_a_document_drops_no_warning(answer: Result) -> None:
    # notes, hints or the documents of responses hold what a reader of these must know
    elsewhere = {"Check", "Explanation", "Judgement", "Screening"}
    document = json.dumps(replace(answer, warnings=("the bias is not known",)).to_dict())
    assert ("the bias is not known" in document) == (type(answer).__name__ not in elsewhere)


def test_an_answer_is_saved_and_read_again(answer: Result, tmp_path: Path) -> None:
    again = stochvi.load_answer(stochvi.save_answer(answer, tmp_path / "answer.json"))
    assert again == answer
    assert again.cost == answer.cost
    assert again.provenance == answer.provenance
    pd.testing.assert_frame_equal(again.to_frame(), answer.to_frame())
    again.plot()
    plt.close("all")
    document = json.loads((tmp_path / "answer.json").read_text(encoding="utf-8"))["document"]
    assert document == answer.to_dict()


SAVED = sorted((CHECKOUT / "tests" / "reference" / "saved_answers").glob("*.json.gz"))


def test_a_table_is_a_frame_once_it_is_asked_for() -> None:
    found = sizing_of(scene_between_stops(), paths=64)
    rows = [{"probability": 0.1, "clearance": 0.004}, {"probability": 0.01, "clearance": 0.005}]
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    for kept in (rows, columns):
        again = pickle.loads(pickle.dumps(replace(found, required=kept)))
        assert vars(again)["required"] == kept  # nothing has asked for a frame
        assert base.rows_of(again, "required") == rows
        assert again.required.equals(pd.DataFrame(rows)) and again.required is again.required
        assert base.rows_of(again, "required") == rows
    with pytest.raises(TypeError, match="curve"):
        Sizing(**{name: part for name, part in vars(found).items() if name != "curve"})


COUNTS_AND_RATIOS = {
    "absorbed_share", "best", "branch", "captured", "clearance_in_sigma", "damage_ratio",
    "displacement_kurtosis", "first_harmonic", "first_order", "hits", "hits_lower",
    "hits_upper", "impacts_per_hour", "impacts_per_period", "independent", "left",
    "left_later", "model", "multiplier", "on_both_stops", "order", "over_threshold", "pair",
    "paths", "peak_factor", "peak_factor_without", "periods", "play_in_sigma", "probability",
    "probability_alone", "reference", "regime", "relative", "restitution", "rests",
    "rms_ratio", "score", "share", "side", "size", "stated", "step_bias_limit",
    "stiffness_factor", "total", "trials", "units", "worst",
}  # fmt: skip
"""Columns of pure numbers: counts, ratios, probabilities, relative errors, numbers of parts."""

IN_UNITS_OF_THE_NAME = re.compile(r"(^|_)(seconds(_[\d.]+)?|hz|percent|db)$|^error_of_a_second$")
"""Columns whose name says the unit in words."""

OF_THE_ROW = {
    "value", "lower", "upper", "limit", "reference_value", "difference", "tolerance", "step",
    "standard_error", "bias", "x", "displacement.x", "velocity.x",
}  # fmt: skip
"""Columns whose unit is that of the quantity, the key or the pair of a row, or of the plane."""


@pytest.mark.parametrize("file", SAVED, ids=[each.name.partition(".")[0] for each in SAVED])
def test_a_column_of_numbers_has_a_unit_or_is_known_to_have_none(
    file: Path, tmp_path: Path
) -> None:
    """A new column states its unit in `results/base.py`, or is listed above."""
    plain = tmp_path / "answer.json"
    plain.write_bytes(gzip.decompress(file.read_bytes()))
    table = stochvi.load_answer(plain).to_frame()
    assert without_unit(table) == []
    if "unit" not in table:
        assert without_unit(table.assign(swing=1.0)) == ["swing"]


def test_a_column_of_a_new_answer_has_a_unit_or_is_known_to_have_none(answer: Result) -> None:
    assert without_unit(answer.to_frame()) == []


def without_unit(table: pd.DataFrame) -> list[str]:
    """Columns of numbers, of a table whose rows state none, whose unit nothing tells."""
    numbers = [] if "unit" in table else table.select_dtypes("number")
    return [
        name
        for name in map(str, numbers)
        if (own := base.ENDING.sub("", name)) not in COUNTS_AND_RATIOS
        and own not in OF_THE_ROW
        and name not in OF_THE_ROW
        and not IN_UNITS_OF_THE_NAME.search(own)
        and not own.endswith(tuple(f"_{each}" for each in base.SUFFIXES.values()))
        and base.unit_of_column(name) is None
    ]


def assert_the_same(now: Any, before: Any) -> None:
    """A document holds what an older one does: keys and words may come, numbers stay but for the
    last digit of those that are calculated when they are asked for."""
    if isinstance(before, dict):
        for key in before.keys() - {"verdict", "summary"}:
            assert_the_same(now[key], before[key])
    elif isinstance(before, float):
        assert now == pytest.approx(before, rel=1e-15, abs=0.0)
    else:
        assert now == before


@pytest.mark.parametrize("file", SAVED, ids=[each.name.partition(".")[0] for each in SAVED])
def test_an_answer_that_an_older_version_saved_is_read(file: Path, tmp_path: Path) -> None:
    saved = tmp_path / "answer.json"
    saved.write_bytes(gzip.decompress(file.read_bytes()))
    found = stochvi.load_answer(saved)
    kind = file.name.partition(".")[0].partition("_")[0]
    assert type(found).__name__ == RENAMED.get(kind, kind)
    before = json.loads(saved.read_text(encoding="utf-8"))["document"]
    assert_the_same(found.to_dict(), before)


def test_a_file_that_holds_no_answer_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    wrong = {
        "{}": "'stochvi'",
        "[]": "'stochvi'",
        '{"stochvi": "0.1"}': "'answer'",
        "no JSON": "it is not JSON from line 1, column 1, on, and names",
        '{"stochvi": "0.1", "answer": {"$kind": "os:system", "parts": {}}}': "no part of this",
        '{"stochvi": "0.1", "answer": {"$kind": "stochvi.sweeps:sweep", "parts": {}}}': "no part",
        '{"stochvi": "0.1", "answer": {"$kind": "results:SceneError", "parts": {}}}': "no kind",
        '{"stochvi": "0.1", "answer": {"$kind": "stochvi.results.estimates:Cost", "parts":'
        ' {"no_such_part": 1}}}': "no_such_part",
        '{"stochvi": "0.1", "answer": 3}': "must hold an answer, got int",
    }
    version = '{"stochvi": "1", "answer": '
    deep = {
        "[" * 100_000: "nested too deeply",
        version + '{"$array": {"type": "<f8", "shape": [2], "bytes": "="}}}': "has a part that",
        version + "[" * 5_000 + "]" * 5_000 + "}": "nested too deeply|must hold an answer",
        version + '{"$tuple": [' * 900 + "]}" * 900 + "}": "nested too deeply|must hold an answer",
        version + '{"$table": []}}': "must be a file that save_answer wrote",
    }
    for text, words in (wrong | deep).items():
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=words) as told:
            stochvi.load_answer(file)
        assert not BARE.search(str(told.value))
    known = stochvi.exact(stochvi.load_scene(shipped_scene("oscillator-elastic")))
    file.write_text(json.dumps(known.to_dict()))
    with pytest.raises(ValueError, match=r"stochvi\.Response\.from_dict.* makes the response"):
        stochvi.load_answer(file)
    file.write_text('{"method": "screen", "provenance": {}}')
    with pytest.raises(ValueError, match="load a file of save_answer"):
        stochvi.load_answer(file)
    with pytest.raises(ValueError, match=f"did you mean {re.escape(str(file))}"):
        stochvi.load_answer(f"{file}.json")
    with pytest.raises(ValueError, match="what a calculation returned"):
        stochvi.save_answer({"rate": 1.0}, file)  # type: ignore[arg-type]


def test_an_answer_says_where_it_comes_from(answer: Result) -> None:
    others = {"Checks", "FoundShocks", "Judgement", "Identification"}  # of several, or of none
    if type(answer).__name__ not in others:
        assert answer.provenance["scene"]["structure"]
    if type(answer).__name__ != "Sizing":  # the tests here make it
        assert answer.provenance["call"]["date"]


def test_a_document_of_a_check_holds_every_warning_of_its_responses() -> None:
    found = stochvi.check(lossy(), rel_error=0.1, threads=1)
    warned = {each for response in found.to_dict()["responses"] for each in response["warnings"]}
    assert warned and set(found.warnings) == warned


@dataclass(frozen=True)
class Pair:
    left: float
    right: np.ndarray


def test_what_is_not_finite_is_none_in_a_document() -> None:
    found = plain(
        {
            "numbers": [math.inf, np.float64(1.0), np.array([math.nan])],
            "pair": Pair(math.nan, np.arange(2)),
            "table": pd.DataFrame({"a": [1.0, math.nan]}),
            "estimate": Estimate(value=1.0),
        }
    )
    assert found["numbers"] == [None, 1.0, [None]]
    assert found["pair"] == {"left": None, "right": [0, 1]}
    assert found["table"] == [{"a": 1.0}, {"a": None}]
    assert found["estimate"]["value"] == 1.0


def test_what_has_no_form_in_json_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no form in JSON"):
        plain({"a": object()})


def test_costs_add_up() -> None:
    found = total_cost([Cost(wall_time=1.0, paths=2, threads=2), Cost(wall_time=2.0, steps=3)])
    assert found == Cost(wall_time=3.0, paths=2, steps=3, threads=2)


def test_methods_of_answers_and_scenes_check_their_plain_arguments() -> None:
    scene = lossy()
    found = stochvi.linearise(scene)
    for call, message in (
        (lambda: found.in_units(["mm", "g"]), "units must be a text, got ['mm', 'g']"),
        (lambda: found.plot(units=1), "units must be a text, got 1"),
        (lambda: found.plot(1), "ax must be an Axes, got 1"),
        (lambda: found.changed("x"), "change must be a function, got 'x'"),
        (
            lambda: scene.at_level("3"),
            "level_db must be a number, got '3'; write 3, without quotes",
        ),
        (lambda: scene.density_of("x"), "excitation must be an Excitation, got 'x'"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            call()


def test_a_unit_that_no_choice_is_known_for_is_told(
    stochvi: RunOfCommands, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that there are now are known, or stay as they are on purpose."""
    known = {*base.COLUMN_UNITS.values(), *base.SUFFIXES}
    angles = {base.in_angles("ry", each.unit) for each in base.RESPONSE_QUANTITIES.values()}
    with shown_in(units_of("in")):
        for unit in known | angles:
            shown_as(unit)
        assert units_passed_over() == []
    scene = str(shipped_scene("oscillator-lossy"))
    said = "note: numbers in Pa are shown as they are"
    assert said not in stochvi("linearise", scene, "--units", "in").err
    monkeypatch.setitem(base.RESPONSE_QUANTITIES, "displacement_std", base.Stated("pressure", "Pa"))
    assert said in stochvi("linearise", scene, "--units", "in").err
    assert said not in stochvi("linearise", scene).err


def test_parts_that_users_make_and_call_name_a_wrong_argument() -> None:
    law, noise = Elastic(stiffness=1e5), WhiteNoise(intensity=1.0)
    for call, message in (
        (lambda: stochvi.Estimate(value=1.0, bias="0.1"), "bias must be a number, got '0.1'"),
        (lambda: Estimate(value=1.0).interval("x"), "confidence must be a number, got 'x'"),
        (lambda: Spread(std="x"), "std must be a number, got 'x'"),
        (lambda: Rebounds(approach=1j, rebound=[1.0]), "approach must be numbers, got 1j"),
        (lambda: ForceCurve(deflection=["x"], force=[1.0]),
         "deflection must be numbers, got ['x']"),
        (lambda: DropRecord(acceleration=3.0, fs=1.0, mass=1.0),
         "acceleration must be a list of numbers, got 3.0"),
        (lambda: SwitchedDrive(restitution="x", force=1.0, switching=1.0),
         "restitution must be a number, got 'x'"),
        (lambda: law.force_at("x"), "deflection must be numbers, got 'x'"),
        (lambda: law.impact("1", 1.0),
         "speed must be a number, got '1'; write 1, without quotes"),
        (lambda: stochvi.size(lossy(), probability=0.01, tolerances={"frequency": 0.1}),
         "tolerances must be a Tolerances, as stochvi.isolators.tolerances.Tolerances("
         "frequency=0.1), got {'frequency': 0.1}"),
        (lambda: noise.louder("x"), "level_db must be a number, got 'x'"),
        (lambda: stochvi.spectrum(lossy(), method=np.array([1.0])),
         "method must be a text, got an array"),
        (lambda: read_record(3), "path must be a file or a Frame, got 3"),
        (lambda: stochvi.scenes.PolynomialDamper(coefficients=[]),
         "needs coefficients whose last one is positive, so that the damper takes energy, got []"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            call()
    # what they can take is taken, whatever the annotation says
    assert law.force_at(np.float32(1e-3)) == pytest.approx(100.0)
    for wrong, words in (
        (lambda: law.impact(), "impact() missing a required argument: 'speed'"),
        (lambda: stochvi.screen(lossy(), level=3.0),
         "screen() got an unexpected keyword argument 'level'"),
        (lambda: stochvi.size(lossy(), mision=3.0),
         "size() got an unexpected keyword argument 'mision'; did you mean mission?"),
        (lambda: stochvi.simulate(mision=3.0),
         "simulate() missing a required argument: 'scene'"),
        (lambda: lossy().at_level(1.0, 2.0), "at_level() got too many positional arguments"),
    ):  # fmt: skip
        with pytest.raises(TypeError, match=f"^{re.escape(words)}$"):
            wrong()


def test_names_of_parts_in_files_are_those_of_one_class() -> None:
    """Each room names its records once, so that a file finds a class wherever it stands there."""
    known: dict[str, set[type]] = {}
    for found in pkgutil.walk_packages(stochvi.__path__, "stochvi."):
        if found.name.endswith((".__main__", ".foreign_reader", ".plugin")):
            continue
        module = importlib.import_module(found.name)
        for kind in vars(module).values():
            if isinstance(kind, type) and kind.__module__ == found.name:
                known.setdefault(name_of(kind), set()).add(kind)
    assert len(known) > 500
    assert {name: kinds for name, kinds in known.items() if len(kinds) > 1} == {}


# ------------------------------------------------------------------------------
# Tables in the units that a reader has chosen.
# ------------------------------------------------------------------------------


INCH, FOOT = 0.0254, 0.3048


def test_columns_are_converted_where_their_unit_is_known_and_chosen() -> None:
    table = pd.DataFrame(
        {
            "time_s": [1.0], "x.displacement_m": [INCH], "ry.displacement_m": [0.5],
            "x.acceleration_m_s2.standard_error": [FOOT], "hit_rate_low": [2.0],
            "corner 1": [INCH], "limit": [3.0], "clearance_in_sigma": [4.0], "note": ["m"],
        }
    )  # fmt: skip
    with shown_in(units_of("in, ft/s2, per min")):
        found = in_chosen_units(table, {"corner 1": "m"})
    assert list(found) == [
        "time_s", "x.displacement_in", "ry.displacement_m",
        "x.acceleration_ft_s2.standard_error", "hit_rate_per_min_low",
        "corner 1_in", "limit", "clearance_in_sigma", "note",
    ]  # fmt: skip
    # an angle is no length, and a ratio has no unit
    assert found.iloc[0].tolist() == pytest.approx([1.0, 1.0, 0.5, 1.0, 120.0, 1.0, 3.0, 4.0, "m"])


def test_rows_are_converted_where_they_state_a_unit_that_has_a_choice() -> None:
    table = pd.DataFrame(
        {
            "unit": ["m", "m^2", "rad", "1", "m/s"],
            "value": [INCH, INCH**2, 1.0, 1.0, 1.0],
            "standard_error": [2.0 * INCH, float("nan"), 1.0, 1.0, 1.0],
            "method": "exact",
        }
    )
    with shown_in(units_of("in")):
        found = in_chosen_units(table)
    assert found["unit"].tolist() == ["in", "in²", "rad", "1", "m/s"]
    assert found["value"].tolist() == pytest.approx([1.0, 1.0, 1.0, 1.0, 1.0])
    assert found["standard_error"].iloc[0] == pytest.approx(2.0)


def test_without_a_choice_a_table_is_as_it_was() -> None:
    table = pd.DataFrame({"clearance": [0.004], "unit": ["m"], "value": [1]})
    assert in_chosen_units(table) is table


# ------------------------------------------------------------------------------
# What an answer says of its call: function, arguments, date and commit.
# ------------------------------------------------------------------------------


def lossy_of_origin() -> stochvi.Scene:
    return oscillator(-1.0, 1.0, 0.8)


@pytest.fixture
def uncached() -> Iterator[None]:
    files.commit.cache_clear()
    yield
    files.commit.cache_clear()


def test_an_answer_records_its_call() -> None:
    with ThreadPoolExecutor(1) as executor:
        found = stochvi.simulate(
            lossy_of_origin(), paths=np.int64(4), duration=5.0, seed=7, executor=executor,
            progress=lambda done, text: None,
        )  # fmt: skip
    call = found.provenance["call"]
    assert call["function"] == "simulate"
    asked = call["arguments"]
    assert (asked["paths"], asked["duration"], asked["seed"]) == (4, 5.0, 7)
    assert asked["budget"] == 60.0, "also what was left out"
    assert asked["executor"] == "ThreadPoolExecutor"
    assert not {"scene", "progress"} & asked.keys()
    assert datetime.fromisoformat(call["date"]).tzinfo is not None
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False)) == found.to_dict()


def test_an_answer_that_falls_short_records_its_call() -> None:
    with pytest.raises(NotConverged) as short:
        stochvi.simulate(lossy_of_origin(), rel_error=1e-6, budget=0.05, seed=1)
    assert short.value.partial.provenance["call"]["arguments"]["rel_error"] == 1e-6


def test_one_seed_gives_equal_answers() -> None:
    asked = {"paths": 4, "duration": 5.0}
    first = stochvi.simulate(lossy_of_origin(), **asked, seed=1, threads=1)
    assert first == stochvi.simulate(lossy_of_origin(), **asked, seed=1, threads=2)
    assert first != stochvi.simulate(lossy_of_origin(), **asked, seed=2, threads=1)
    assert first != stochvi.simulate(oscillator(-1.0, 1.0, 0.7), **asked, seed=1, threads=1)


def test_a_long_argument_is_recorded_by_its_size() -> None:
    scene = oscillator(-1.0, 1.0)
    for number in (3, 200):
        times = np.linspace(0.1, 1.0, number)
        found = stochvi.first_passage(scene, times=times, rtol=1e-2)
        recorded = found.provenance["call"]["arguments"]["times"]
        assert recorded == (times.tolist() if number == 3 else "200 entries")


@pytest.mark.usefixtures("uncached")
def test_the_commit_is_that_of_an_installation_from_a_repository(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    source: list[str | None] = [json.dumps({"vcs_info": {"vcs": "git", "commit_id": "c0ffee"}})]
    installed = SimpleNamespace(read_text=lambda name: source[0])
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: installed)
    assert files.commit() == "c0ffee"
    files.commit.cache_clear()
    source[0] = None
    monkeypatch.setattr(files, "__file__", str(tmp_path / "site-packages" / "a" / "b.py"))
    assert files.commit() is None, "a released wheel"


@pytest.mark.usefixtures("uncached")
def test_a_checkout_without_git_has_no_commit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / ".git").mkdir()
    monkeypatch.setattr(files, "__file__", str(tmp_path / "stochvi" / "results" / "origin.py"))
    assert files.commit() is None, "no commit in it"
    monkeypatch.setenv("PATH", "")
    files.commit.cache_clear()
    assert files.commit() is None, "no git"


# ------------------------------------------------------------------------------
# Sentences of errors, whatever the locale of the user.
# ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "reason"),
    [(errno.ENOENT, "no such file or directory"), (errno.ECONNRESET, "in der sprache des systems")],
)
def test_the_reason_of_a_system_is_said_in_english_where_it_is_known(
    monkeypatch: pytest.MonkeyPatch, number: int, reason: str
) -> None:
    monkeypatch.setattr(os, "strerror", lambda _: "In der Sprache des Systems")
    assert reason_of(OSError(number, "In der Sprache des Systems")) == reason
    assert reason_of(OSError(number, "Our own reason")) == "our own reason"


@pytest.mark.parametrize("kind", [NotConverged, Interrupted])
def test_an_error_carries_what_was_found_and_answers_to_the_former_name(
    kind: type[NotConverged | Interrupted],
) -> None:
    assert kind("too late").partial is None
    error = kind("too late", "so far")
    assert (str(error), error.partial, error.response) == ("too late", "so far", "so far")
    error.response = "more"
    assert error.partial == "more"


FAR = {"kind": "rigid-body", "mass": 5.0, "inertia": [0.05, 0.06, 0.07], "mount": [
    {"at": [x, y, -0.1], "stiffness": [5e3, 5e3, 8e3], "zeta": 0.05}
    for x, y in ((0.1, 0.1), (-0.1, 0.1), (0.1, -0.1), (1e300, -0.1))
]}  # fmt: skip
HIGH = {"kind": "beam", "length": 0.3, "width": 0.02, "height": 1e300, "young": 7e10,
        "density": 2700.0, "zeta": 0.02, "modes": 3}  # fmt: skip
NOISE = [{"kind": "psd", "profile": "mil-std-810h-truck-vertical-5hz"}]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("document", "place"),
    [({"structure": FAR, "excitation": NOISE}, "look at mount.3.at.0 = 1e+300"),
     ({"structure": HIGH, "excitation": NOISE}, "look at height = 1e+300")],
)  # fmt: skip
def test_numbers_beyond_arithmetic_are_named(document: dict[str, Any], place: str) -> None:
    with pytest.raises(SceneError, match="too large, too small or too far apart") as told:
        scene_from(document).structure.matrices()
    assert place in str(told.value)


def test_a_calculation_names_the_number_that_it_overflows_with() -> None:
    @calculation
    def overflowing(scene: Scene) -> float:
        return math.exp(float(scene.excitations[0].intensity))  # type: ignore[union-attr]

    structure = Isolator(frequency_hz=10.0, zeta=0.1)
    scene = Scene(structure=structure, excitations=[WhiteNoise(intensity=1e40)])
    with pytest.raises(NotApplicable, match=r"look at excitation.0.intensity = 1e\+40"):
        overflowing(scene)
    mild = Scene(structure=structure, excitations=[WhiteNoise(intensity=2e3)])
    with pytest.raises(NotApplicable, match="too far apart to calculate with") as told:
        overflowing(mild)
    assert "look at" not in str(told.value)
    assert "(a number is too large)" in str(told.value)


def test_a_calculation_names_the_argument_that_it_overflows_with() -> None:
    scene = stochvi.load_scene(shipped_scene("oscillator-lossy"))
    with pytest.raises(NotApplicable, match=r"look at speed_threshold = 1e\+300") as told:
        stochvi.fokker_planck_density(scene, speed_threshold=1e300)
    assert not BARE.search(str(told.value))


def test_one_path_of_impacts_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A budget that ends after one path, which has no standard error."""
    law = Restitution(coefficient=0.5)
    scene = Scene(
        structure=Isolator(frequency_hz=10.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-1e-3, upper=1e-3, law=law)],
        excitations=[WhiteNoise(intensity=1e-3)],
    )

    def after_one(self: Run, sampler: Any, *_: Any, **__: Any) -> Any:
        return self.until(sampler, 1)

    monkeypatch.setattr(Run, "to_accuracy", after_one)
    with pytest.raises(NotConverged, match="after one path; raise budget"):
        impacts(scene, budget=60.0)


def test_a_level_of_a_phase_has_the_limits_of_that_of_an_excitation() -> None:
    with pytest.raises(SceneError, match=r"level_db outside -200\.\.200, got 1e\+09"):
        Phase(name="road", duration=10.0, level_db=1e9)


def test_a_mount_far_above_its_record_is_screened() -> None:
    """A law of its motion: it follows the base, however stiff it is."""

    def density(f: np.ndarray) -> np.ndarray:
        return np.where((f >= 5.0) & (f <= 120.0), 1.0, 0.0)

    found = response_law(density, top=125.0, natural=1e4, width=2e3)
    zero, two = 115.0, (120.0**3 - 5.0**3) / 3.0
    assert found.crossing_rate == pytest.approx(math.sqrt(two / zero), rel=0.03)


# ------------------------------------------------------------------------------
# Sizes are refused before memory is taken for them.
# ------------------------------------------------------------------------------


MOUNT, BUMPER = str(shipped_scene("isolator-sine")), str(shipped_scene("isolator-bumper"))

MANY, ENDS = "100000000", ("--from", "1", "--to", "20")

QUESTIONS = {
    "sine": ((MOUNT, *ENDS, "--points", MANY), "--points must be at most 1000000"),
    "bifurcation": ((MOUNT, *ENDS, "--points", MANY), "--points must be at most 1000000"),
    "basins": (
        (MOUNT, "--start", f"displacement.x=-1:1:{MANY}", "--start", f"velocity.x=-1:1:{MANY}"),
        "--start displacement.x must be at most 1000000",
    ),
    "history": ((BUMPER, "--duration", "1e6"), r"ask for about 1.2e\+04 s or less"),
    "perturbations": (
        (MOUNT, "--speeds", "0.1", "--paths", MANY),
        "paths must be at most 1[0-9]{5}, got",
    ),
}


@pytest.mark.parametrize("command", QUESTIONS)
def test_a_command_refuses_what_would_not_fit(stochvi: RunOfCommands, command: str) -> None:
    words, sentence = QUESTIONS[command]
    tracemalloc.start()
    said = refused(stochvi(command, *words))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert pytest.approx(0, abs=2e8) == peak  # it used to take gigabytes
    with pytest.raises(ValueError, match=sentence):
        raise ValueError(said)


@pytest.mark.parametrize(
    "ask",
    [
        lambda scene: record_path(scene, duration=10.0, step=1e-300),
        lambda scene: record_path(scene, duration=1e12),
        lambda scene: stochvi.history(scene, duration=10.0, rate=1e300),
        lambda scene: stochvi.history(scene, duration=1e12),
        lambda scene: perturbations(stochvi.load_scene(MOUNT), [0.1], paths=10**9),
    ],
)
def test_a_function_refuses_what_would_not_fit(ask: Callable[[Any], Any]) -> None:
    with pytest.raises((StochviError, ValueError), match="at most"):
        ask(oscillator(-1.0, 1.0, 0.8))


def test_a_message_has_few_lines() -> None:
    error = SceneError([(f"key.{number}", "is wrong") for number in range(100_000)])
    lines = str(error).splitlines()
    assert len(lines) == 20 and lines[-1] == "and 99981 more like these"
    assert len(error.problems) == 100_000
