"""The page as a file: turns that are stored are those of the server, and nothing is asked."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from typing import Any

import pytest

from stochvi.cli.scenes import line_of
from stochvi.explorer import onefile, turns
from stochvi.explorer.knobs import Setting, design_of, knobs_of, questions_of
from stochvi.explorer.onefile import Grid
from stochvi.explorer.turns import Explorer, Refused, Turn
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import load_scene

TRUCK = load_scene(shipped_scene("isolator-truck"))
STOPS = ["impact_pair.0.lower", "impact_pair.0.upper"]
FREQUENCY = ["structure.frequency_hz"]
KNOBS = {each.key: each for each in (*knobs_of(TRUCK), *questions_of(TRUCK))}


def asked(explorer: Explorer, kind: str, knobs: Any, steps: Any = 3, **setting: Any) -> list[Any]:
    message = {"type": kind, "id": 4, "tab": "a", "what": {"knobs": knobs, "steps": steps}}
    return [*explorer.answers({**message, **setting})]


def content_of(page: str) -> Any:
    """What a file has stored."""
    (found,) = re.findall(r'id="stored">([^<]*)<', page)
    return json.loads(gzip.decompress(base64.b64decode(found)))


# ------------------------------------------------------------------------------
# Which designs are stored.
# ------------------------------------------------------------------------------


def test_a_grid_lies_about_the_design_within_the_knobs() -> None:
    setting = Setting({"structure.frequency_hz": 40.0, "excitation.0.level_db": 3.0})
    grid = Grid.of(
        setting, KNOBS, {"knobs": [STOPS, FREQUENCY, ["excitation.0.level_db"]], "steps": 3}
    )
    assert grid.axes[0].places == [(-0.002, 0.002), (-0.004, 0.004), (-0.008, 0.008)]
    assert [each[0] for each in grid.axes[1].places] == [20.0, 40.0, 48.0]  # the knob ends there
    assert [each[0] for each in grid.axes[2].places] == [-3.0, 3.0, 9.0]
    settings = grid.settings()
    assert len(settings) == grid.size == 27
    assert all(design_of(TRUCK, each) for each in settings)
    assert settings[0].values == {
        "structure.frequency_hz": 20.0, "excitation.0.level_db": -3.0,
        "impact_pair.0.lower": -0.002, "impact_pair.0.upper": 0.002,
    }  # fmt: skip
    assert settings[1].values == {**settings[0].values, "excitation.0.level_db": 3.0}


@pytest.mark.parametrize(
    ("knobs", "steps", "sentence"),
    [
        ([FREQUENCY], 4, "steps must be one of 3, 5, 7, 9"),
        ([FREQUENCY], True, "steps must be one of"),
        ([], 3, "1 to 3 knobs can move"),
        ([FREQUENCY] * 4, 3, "1 to 3 knobs can move"),
        ([FREQUENCY] * 2, 3, "along one axis alone"),
        ([[*FREQUENCY, "tolerances.frequency"]], 5, "cannot move together"),
        ([["../secret"]], 3, "values must name knobs"),
        (["structure"], 3, "lists of keys"),
        (None, 3, "1 to 3 knobs"),
    ],
    ids=str,
)
def test_a_grid_that_is_none_is_refused(knobs: Any, steps: Any, sentence: str) -> None:
    for kind in ("price", "page"):
        with pytest.raises(Refused, match=sentence):
            asked(Explorer(TRUCK), kind, knobs, steps)
    with pytest.raises(Refused, match="steps must be"):
        [*Explorer(TRUCK).answers({"type": "price", "id": 1, "what": "all"})]


# ------------------------------------------------------------------------------
# What the file holds.
# ------------------------------------------------------------------------------


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> Explorer:
    """An explorer whose turns end after their closed forms."""
    monkeypatch.setattr(Turn, "parts", lambda turn: iter([("closed", turn.linear)]))
    return Explorer(TRUCK, 3, line_of)


def test_a_file_is_priced_by_three_of_its_designs(closed: Explorer) -> None:
    priced, done = asked(closed, "price", [STOPS, FREQUENCY])
    assert (priced["designs"], done) == (9, {"type": "done", "id": 4})
    *_, made, _ = asked(closed, "page", [STOPS, FREQUENCY])
    assert priced["bytes"] == pytest.approx(len(made["text"]), rel=0.1)
    assert priced["seconds"] > 0.0


def test_a_file_that_takes_too_long_is_refused_with_a_remedy(
    closed: Explorer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(turns, "PAGE_SECONDS", 0.0)
    with pytest.raises(Refused, match=r"9 designs take .* choose fewer knobs"):
        asked(closed, "price", [STOPS, FREQUENCY])
    with pytest.raises(Refused, match="choose fewer"):
        asked(closed, "page", [STOPS, FREQUENCY])


def test_its_policy_allows_its_own_script_and_style_alone(closed: Explorer) -> None:
    *_, made, _ = asked(closed, "page", [FREQUENCY])
    page = made["text"]
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    for name in ("script", "style"):
        text = re.findall(rf"<{name}(?: type=.module.)?>(.*?)</{name}>", page, re.DOTALL)[-1]
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{name}-src 'sha256-{digest}'" in policy
    assert re.findall(r"(?:src|href)=", page) == []
    assert "fetch(" not in page and "XMLHttpRequest" not in page


def test_nothing_of_a_scene_gets_out_of_its_place(closed: Explorer) -> None:
    closed.scene = TRUCK.replace(title="</title><script>alert(1)</script>")
    *_, made, _ = asked(closed, "page", [FREQUENCY])
    assert "<script>alert" not in made["text"]


def test_knobs_of_a_file_stand_at_stored_values(closed: Explorer) -> None:
    *_, made, _ = asked(closed, "page", [STOPS], values={"structure.zeta": 0.2})
    opened = content_of(made["text"])["opened"]
    stored = {each["key"]: each["stored"] for each in opened["knobs"]}
    assert stored["impact_pair.0.upper"] == [0.002, 0.004, 0.008]
    assert stored["impact_pair.0.lower"] == [-0.008, -0.004, -0.002]
    assert stored["structure.zeta"] == [0.2]
    assert (opened["designs"], opened["offers"], opened["presets"]) == (3, [], [])
    assert opened["profiles"] == ["mil-std-810h-truck-vertical-5hz"]


def test_a_cancel_ends_the_making_of_a_file(closed: Explorer) -> None:
    message = {"type": "page", "id": 5, "tab": "a", "what": {"knobs": [FREQUENCY], "steps": 9}}
    making = closed.answers(message)
    assert next(making)["type"] == "progress"
    assert [*closed.answers({"type": "cancel", "id": 6, "tab": "a"})]
    assert "file" not in [each["type"] for each in making]


@pytest.mark.slow
def test_stored_numbers_are_those_of_the_turn() -> None:
    explorer = Explorer(TRUCK, 3, line_of)
    *progress, made, done = asked(explorer, "page", [STOPS, FREQUENCY])
    assert [each["done"] for each in progress] == pytest.approx([k / 9 for k in range(9)])
    assert done["type"] == "done"
    found = content_of(made["text"])
    keys = [key for axis in found["axes"] for key in axis["keys"]]
    for places, place in (((0, 2), 2), ((2, 1), 7)):
        at = [axis["places"][k] for axis, k in zip(found["axes"], places, strict=True)]
        values = dict(zip(keys, (each for row in at for each in row), strict=True))
        turn = {"type": "turn", "id": 0, "tab": "b", "values": values}
        expected = [json.loads(json.dumps(each)) for each in explorer.answers(turn)]
        stored = found["turns"][place]
        assert [each.get("part") for each in stored] == [each.get("part") for each in expected]
        for mine, other in zip(stored, expected, strict=True):
            for name in ("numbers", "sentence", "lines", "clearance", "simulated", "closure"):
                assert mine.get(name) == other.get(name)
        curve, own = (rows[3]["curve"]["probability"] for rows in (stored, expected))
        assert curve == pytest.approx(own, rel=10.0 ** (1 - onefile.DIGITS))
