"""Every kind of answer: plain documents, tables, and pages that drop no warning."""

from __future__ import annotations

import gzip
import importlib
import io
import json
import math
import pkgutil
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import jsonschema
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import stochvi
from stochvi import Oscillator, Scene, WhiteNoise
from stochvi.cli.answer_schema import answer_schema
from stochvi.identification import Rebounds
from stochvi.methods import periodic
from stochvi.results.base import Result, plain, total_cost
from stochvi.results.estimates import Cost, Estimate
from stochvi.results.kinds import name_of
from stochvi.statistics.impacts.method import impacts
from stochvi.statistics.spectra.method import spectrum
from stochvi.verification.check_of_many import check_many
from stochvi.verification.cost import cost
from stochvi.views.tables import value_with_error
from support import CHECKOUT, judges
from support.known import oscillator
from support.pairs import pair, uncoupled
from support.sized import scene_between_stops, sizing_of


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
    "MissionSizing": lambda: stochvi.size(
        scene_between_stops().replace(phase=[{"name": "road", "duration": 600.0}]), probability=0.1,
        rel_error=0.5, threads=1,
    ),
    "History": lambda: stochvi.history(lossy(), duration=2.0),
    "Identification": lambda: stochvi.identify(
        Rebounds(approach=[0.5, 1.0, 1.5, 2.0], rebound=[0.36, 0.69, 1.06, 1.39])
    ),
    "Sizing of pairs": lambda: stochvi.size(
        uncoupled(pair("x", "x", 3.0)), probability=0.1, mission=200.0, rel_error=0.5, threads=1
    ),
    "Replay": replayed,
}  # fmt: skip
"""A small answer of each kind. Best boxes, jolts and life times take long, see their own tests."""


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
    ax.get_figure(root=True).savefig(io.BytesIO(), format="svg")
    plt.close("all")


def test_the_picture_of_a_response_tells_its_stops_and_hits() -> None:
    found = stochvi.fokker_planck(oscillator(-1.0, 0.5, 0.8))
    ax = found.plot()
    walls = [line.get_xdata()[0] for line in ax.get_lines() if len(line.get_xdata()) == 2]
    assert walls == [-1.0, 0.5]
    words = " ".join(text.get_text() for text in ax.texts)
    pair = found.impact_pairs["stops"]
    for rate in (pair.collision_rate_lower, pair.collision_rate_upper):
        assert f"{value_with_error(rate)} impacts/s" in words
    assert f"{value_with_error(found.coordinates['x'].displacement_std)} m" in words
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


@pytest.mark.parametrize("file", SAVED, ids=[each.name.partition(".")[0] for each in SAVED])
def test_an_answer_that_an_older_version_saved_is_read(file: Path, tmp_path: Path) -> None:
    saved = tmp_path / "answer.json"
    saved.write_bytes(gzip.decompress(file.read_bytes()))
    found = stochvi.load_answer(saved)
    assert type(found).__name__ == re.match("[A-Za-z]+", file.name)[0]  # type: ignore[index]
    before = json.loads(saved.read_text(encoding="utf-8"))["document"]
    now = found.to_dict()
    # words of a verdict may become better, and keys may come; numbers stay
    kept = before.keys() - {"verdict"}
    assert {key: now[key] for key in kept} == {key: before[key] for key in kept}


def test_a_file_that_holds_no_answer_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    wrong = {
        "{}": "'stochvi'",
        "no JSON": "Expecting value",
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
        version + "[" * 5_000 + "]" * 5_000 + "}": "nested too deeply|must hold an answer",
        version + '{"$tuple": [' * 900 + "]}" * 900 + "}": "nested too deeply|must hold an answer",
        version + '{"$table": []}}': "must be a file that save_answer wrote",
    }
    for text, words in (wrong | deep).items():
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=words):
            stochvi.load_answer(file)
    with pytest.raises(ValueError, match="what a calculation returned"):
        stochvi.save_answer({"rate": 1.0}, file)  # type: ignore[arg-type]


def test_an_answer_says_where_it_comes_from(answer: Result) -> None:
    others = {"Checks", "Judgement", "Identification"}  # of several scenes, and of none
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
        (lambda: scene.at_level("3"), "level_db must be a number, got '3'"),
        (lambda: scene.density_of("x"), "excitation must be an Excitation, got 'x'"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            call()


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
