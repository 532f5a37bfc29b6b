"""Progress predicts the time left; notebooks show that of the calculation that was asked for."""

from __future__ import annotations

import math
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from stochvi.model.calculations import calculation
from stochvi.results import progress as module
from stochvi.results.progress import Pace, Progress


def test_the_time_left_is_that_at_the_pace_since_the_first_report(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time before the first report used to count, in which the fraction did not grow."""
    now = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    pace = Pace("size")
    now[0] += 30.0
    assert math.isinf(pace.left(0.5))
    now[0] += 2.0
    assert pace.left(0.6) == pytest.approx(8.0)
    assert pace(0.6, "first crossings") == "size: 60 %, first crossings, 8 s left"


@calculation
def inner(*, progress: Progress | None = None) -> bool:
    if progress:
        progress(0.5, "inside")
    return progress is not None


@calculation
def outer(*, progress: Progress | None = None) -> tuple[bool, bool]:
    if progress:
        progress(0.25, "100 paths < 200")
    return progress is not None, inner()


class Notebook:
    """What a kernel has of IPython, which keeps what is displayed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, kernel: object) -> None:
        self.shown: list[str] = []
        self.places = 0
        shell = SimpleNamespace(kernel=kernel)
        fake = SimpleNamespace(get_ipython=lambda: shell)
        monkeypatch.setitem(sys.modules, "IPython", fake)
        monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=self.display))
        monkeypatch.setattr(module, "FIRST_SECONDS", 0.0)

    def display(self, forms: dict[str, str], **more: Any) -> Notebook:
        self.places += 1
        self.update(forms)
        return self

    def update(self, forms: dict[str, str], **more: Any) -> None:
        self.shown.append(forms["text/html"])


def test_a_notebook_shows_one_bar_for_a_calculation_and_what_it_calls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notebook = Notebook(monkeypatch, kernel=object())
    assert outer() == (True, False)
    assert notebook.places == 1
    first, last = notebook.shown
    assert "outer: 25 %, 100 paths &lt; 200" in first
    assert last == ""
    assert inner(), "the next calculation has the cell to itself"


def test_a_calculation_that_fails_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = Notebook(monkeypatch, kernel=object())

    @calculation
    def failing(*, progress: Progress | None = None) -> None:
        assert progress
        progress(0.1, "begun")
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        failing()
    assert notebook.shown[-1] == ""
    assert inner()


def test_who_gives_a_progress_gets_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = Notebook(monkeypatch, kernel=object())
    heard: list[str] = []
    inner(progress=lambda done, text: heard.append(text))
    assert heard == ["inside"]
    assert notebook.shown == []


@pytest.mark.parametrize("where", ["script", "terminal of IPython"])
def test_programs_stay_silent(monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    notebook = Notebook(monkeypatch, kernel=None)
    if where == "script":
        monkeypatch.delitem(sys.modules, "IPython")
    assert outer() == (False, False)
    assert notebook.shown == []
