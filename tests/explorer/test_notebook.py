"""The panel in a notebook: one module, and a kernel that answers its messages."""

from __future__ import annotations

import re
import time
from typing import Any

import pytest

import stochvi
from stochvi.explorer import onefile
from stochvi.explorer.turns import Turn


def test_the_module_is_one_text_that_imports_nothing() -> None:
    text = onefile.module()
    assert re.findall(r"^\s*import\b", text, re.MULTILINE) == []
    assert re.findall(r"^export .*", text, re.MULTILINE) == [
        "export function render({ model, el }) {"
    ]
    assert "uPlot=function" in text.replace(" ", "")


def test_a_panel_answers_as_the_server_does(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("anywidget", reason="the extra notebook brings it")
    monkeypatch.setattr(Turn, "parts", lambda turn: iter([("closed", turn.linear)]))
    panel, told = stochvi.explore(seed=3), list[dict[str, Any]]()
    assert panel._esm.endswith("\nexport default { render };")
    monkeypatch.setattr(panel, "send", told.append)

    def answers(message: Any, number: int) -> list[dict[str, Any]]:
        told.clear()
        panel._handle_custom_msg(message, [])
        until = time.monotonic() + 60.0
        while len(told) < number and time.monotonic() < until:
            time.sleep(0.01)
        return told

    (opened,) = answers({"type": "open", "id": 1, "tab": "a"}, 1)
    assert opened["kind"] == "pair" and not {"command", "html"} & {*opened["offers"]}
    linear, done = answers({"type": "turn", "id": 2, "tab": "a", "values": {}}, 2)
    assert linear["numbers"] and done["type"] == "done"
    (refused,) = answers({"type": "turn", "id": 3, "tab": "a", "values": {"x": 1.0}}, 1)
    assert refused["id"] == 3 and "values must name knobs" in refused["sentence"]
    (refused,) = answers([], 1)
    assert refused["sentence"].startswith("no message: type must be one of")


def test_a_scene_that_is_not_shown_is_refused() -> None:
    scene = stochvi.load_scene(stochvi.scenes.shipped_scene("isolator-truck"))
    with pytest.raises(ValueError, match="scenes with stops"):
        stochvi.explore(scene.replace(impact_pairs=[]))
