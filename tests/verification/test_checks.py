"""The zoo: what ships, and one verdict over many scenes."""

import json
import math
import os
import re
import signal
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from scipy.stats import norm, t

from stochvi import Estimate, Response, check, exact, simulate
from stochvi.cli import main
from stochvi.results import Interrupted
from stochvi.results.estimates import Cost
from stochvi.results.intervals import normal_score, student_quantile
from stochvi.scenes.datasets import data_folder, zoo_files
from stochvi.scenes.scene import scene_from
from stochvi.testing import known_answers
from stochvi.verification import check_many, zoo
from stochvi.verification.check import (
    AGREES,
    BALANCE,
    DISAGREES,
    FAMILY_ALARM_RATE,
    MethodResponses,
    degrees_of_freedom,
    single_alarm_rate,
)
from stochvi.verification.check_of_many import compare_many, seeds_of

SHARE = ("linear", "elastic-unequal-gaps", "lossy-0.95", "spring-stops")


# What ships --------------------------------------------------------------------------------


def test_the_zoo_holds_every_kind_of_structure_law_and_excitation() -> None:
    scenes = list(zoo().values())
    assert len(scenes) >= 60
    assert {scene.structure.kind for scene in scenes} == {"oscillator", "isolator", "matrices"}
    pairs = [pair for scene in scenes for pair in scene.impact_pairs]
    laws = {law.kind for pair in pairs for _, law in pair.stops()}
    assert laws == {"restitution", "elastic", "viscoelastic", "hertz", "table"}
    kinds = {excitation.kind for scene in scenes for excitation in scene.excitations}
    assert kinds == {"white", "psd", "filtered", "sine", "constant", "road", "record"}
    assert {len(pair.stops()) for pair in pairs} == {1, 2}


@pytest.mark.parametrize("name", zoo_files())
def test_a_scene_of_the_zoo_says_what_it_is_for_and_is_its_own_document(name: str) -> None:
    text = zoo_files()[name].read_text(encoding="utf-8")
    assert re.match(r'title = ".+"\n# .+\n\n\[structure\]', text)
    scene = zoo(name)[name]
    assert scene_from(scene.document()) == scene


def test_the_readme_lists_every_scene_and_who_knows_it() -> None:
    text = (data_folder() / "scenes" / "zoo" / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (\S+) \|.*\| ([^|]+) \|$", text, re.M))
    rows.pop("scene", None)
    assert set(rows) == set(zoo_files())
    alone = {name for name, known in rows.items() if known == "Monte Carlo alone"}
    assert set(rows) - alone == set(known_answers())


def test_a_name_that_is_not_in_the_zoo_is_answered_with_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"'lossy'; known: .*lossy-0\.5"):
        zoo("lossy")


# One verdict over many ----------------------------------------------------------------------


def test_a_share_of_the_zoo_passes_under_one_alarm_rate() -> None:
    found = check_many(zoo(*SHARE), rel_error=0.03, seed=4, threads=1)
    assert found.passed, found
    rows = [row for verdict in found.checks.values() for row in verdict.comparisons]
    judged = [row for row in rows if row.tolerance is not None]
    assert found.judged == len(judged)
    single = 2.0 * norm.sf(found.z)
    assert 1.0 - (1.0 - single) ** found.judged == pytest.approx(FAMILY_ALARM_RATE)
    alone = check(zoo("linear")["linear"], rel_error=0.03)
    assert found.z > alone.z
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert sum(len(scene["comparisons"]) for scene in document["scenes"].values()) == len(rows)
    assert set(found.overview()["verdict"]) == {"passed"}
    assert len(set(found.seeds.values())) == len(SHARE)


def test_a_scene_of_balances_alone_is_not_said_to_be_compared() -> None:
    found = check_many(zoo("lossy-0.5"), rel_error=0.05, threads=1)
    (verdict,) = found.checks.values()
    rows = [row for row in verdict.comparisons if row.of == BALANCE]
    alone = replace(found, checks={"alone": replace(verdict, comparisons=rows)})
    assert set(found.overview()["verdict"]) == {"passed"} and alone.passed
    assert set(alone.overview()["verdict"]) == {"balances hold"}


def wrong_by(response: Response, quantity: str, factor: float) -> Response:
    known = dict(response.coordinates["x"])
    estimate = known[quantity]
    assert isinstance(estimate, Estimate)
    known[quantity] = replace(estimate, value=factor * estimate.value)
    return replace(response, coordinates={"x": known})


def test_scenes_share_a_budget_and_those_left_out_are_not_passed() -> None:
    scenes = zoo("linear", "lossy-0.95")
    found = check_many(scenes, rel_error=0.0005, budget=1e-3)
    assert list(found.checks) == list(scenes)
    assert not found.passed
    assert found.checks["linear"].comparisons  # judged by what was reached
    assert not found.checks["lossy-0.95"].comparisons
    assert "no time was left" in found.checks["lossy-0.95"].summary()


@pytest.mark.parametrize("several", [False, True])
def test_ctrl_c_leaves_the_verdict_on_what_there_is(several: bool) -> None:
    scenes = zoo("linear", "lossy-0.95")
    heard: list[str] = []

    def once(_share: float, sentence: str) -> None:
        if "compiling" not in sentence and not heard:
            heard.append(sentence)
            os.kill(os.getpid(), signal.SIGINT)

    ask: Any = partial(check_many, scenes) if several else partial(check, scenes["linear"])
    with pytest.raises(Interrupted) as stopped:
        ask(rel_error=0.0005, progress=once)
    assert heard
    assert stopped.value.partial.interrupted
    assert not stopped.value.partial.passed


def test_one_wrong_number_in_one_scene_is_found_and_named() -> None:
    scenes = zoo(*SHARE[:2])
    found = {
        name: MethodResponses(responses=[exact(scene), simulate(scene, rel_error=0.01, seed=8)])
        for name, scene in scenes.items()
    }
    assert compare_many(found).passed
    first, second = found["linear"].responses
    found["linear"] = MethodResponses(responses=[first, wrong_by(second, "velocity_std", 1.05)])
    verdict = compare_many(found)
    assert [(name, row.quantity) for name, row in verdict.alarms] == [("linear", "velocity_std")]
    assert verdict.summary().endswith("DISAGREE: velocity_std of linear")
    assert not verdict.passed


def test_nothing_to_check_is_no_pass() -> None:
    assert not check_many({}).passed


# Student's distribution ------------------------------------------------------------


@pytest.mark.parametrize("degrees", [5.0, 63.0, math.inf])
def test_quantiles_and_scores_are_those_of_student(degrees: float) -> None:
    rate = single_alarm_rate(200)
    law = norm if math.isinf(degrees) else t(degrees)
    quantile = student_quantile(rate, degrees)
    assert 2.0 * law.sf(quantile) == pytest.approx(rate)
    score = normal_score(-0.1 * quantile, 0.1, degrees)
    assert score == pytest.approx(-norm.isf(rate / 2.0))


def test_degrees_of_freedom_of_one_sample_and_of_two() -> None:
    few, many, none = (Response(
        method="", coordinates={}, impact_pairs={}, cost=Cost(paths=paths)
    ) for paths in (11, 41, 0))  # fmt: skip
    assert degrees_of_freedom(few, none, (0.1, 0.0)) == pytest.approx(10.0)
    assert degrees_of_freedom(few, many, (0.1, 0.1)) == pytest.approx(4.0 / (1 / 10 + 1 / 40))
    assert math.isinf(degrees_of_freedom(none, none, (0.0, 0.0)))


def test_fewer_paths_are_granted_more() -> None:
    scene = zoo("linear")["linear"]
    truth, found = exact(scene), simulate(scene, paths=64, duration=50.0, seed=1)
    few, many = (
        compare_many(
            {"linear": MethodResponses(responses=[truth, replace(found, cost=Cost(paths=paths))])}
        ).to_frame()["tolerance"]
        for paths in (16, 16_000)
    )
    assert (few[many > 1e-6] > 1.05 * many[many > 1e-6]).any()
    assert (few >= many).all()


def test_the_error_of_a_sampled_bias_counts() -> None:
    truth = exact(zoo("linear")["linear"])
    value = replace(truth.coordinates["x"]["velocity_std"], value=1.02, standard_error=0.001)

    def verdict(bias_error: float) -> str:
        own = replace(value, bias=0.01, bias_error=bias_error)
        response = replace(truth, method="mine", coordinates={"x": {"velocity_std": own}})
        rows = (
            compare_many({"": MethodResponses(responses=[truth, response])}).checks[""].comparisons
        )
        return next(row.verdict for row in rows if row.method == "mine" and row.of == "x")

    assert verdict(0.0) == DISAGREES
    assert verdict(0.005) == AGREES


def test_seeds_differ_from_scene_to_scene_and_do_not_depend_on_their_number() -> None:
    assert list(seeds_of(3, 5))[:2] == list(seeds_of(3, 2))
    assert len({*seeds_of(0, 50), *seeds_of(1, 50)}) == 100


def test_the_command_judges_several_files_together(tmp_path, capsys) -> None:
    files = [str(zoo_files()[name]) for name in SHARE[:2]]
    options = ["--rel-error", "0.03", "--threads", "1", "--out", str(tmp_path), "--json", "-"]
    main(["check", *files, *options], standalone_mode=False)
    printed = capsys.readouterr()
    document = json.loads(printed.out)
    assert document["passed"] and set(document["scenes"]) == set(files)
    assert "2 scenes" in " ".join(printed.err.split())
    assert {path.name for path in tmp_path.iterdir()} == {"check.csv", "scores.png"}


def test_the_command_refuses_a_scene_named_twice(capsys) -> None:
    name = str(zoo_files()["linear"])
    with pytest.raises(SystemExit) as stop:
        main(["check", name, name])
    assert stop.value.code == 2
    assert f"needs each scene once, got {name} twice" in capsys.readouterr().err


def test_the_command_without_a_scene_says_what_it_takes(capsys) -> None:
    with pytest.raises(SystemExit) as failure:
        main(["check"], standalone_mode=False)
    assert failure.value.code == 2
    assert "a scene file, several, or --zoo" in capsys.readouterr().err
