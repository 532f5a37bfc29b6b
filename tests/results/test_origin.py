"""What an answer says of its call: function, arguments, date and commit."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stochvi
from stochvi.results import origin
from stochvi.results.errors import NotConverged
from support.known import oscillator


def lossy() -> stochvi.Scene:
    return oscillator(-1.0, 1.0, 0.8)


@pytest.fixture
def uncached() -> Iterator[None]:
    origin.commit.cache_clear()
    yield
    origin.commit.cache_clear()


def test_an_answer_records_its_call() -> None:
    with ThreadPoolExecutor(1) as executor:
        found = stochvi.simulate(
            lossy(), paths=np.int64(4), duration=5.0, seed=7, executor=executor,
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
        stochvi.simulate(lossy(), rel_error=1e-6, budget=0.05, seed=1)
    assert short.value.partial.provenance["call"]["arguments"]["rel_error"] == 1e-6


def test_one_seed_gives_equal_answers() -> None:
    asked = {"paths": 4, "duration": 5.0}
    first = stochvi.simulate(lossy(), **asked, seed=1, threads=1)
    assert first == stochvi.simulate(lossy(), **asked, seed=1, threads=2)
    assert first != stochvi.simulate(lossy(), **asked, seed=2, threads=1)
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
    monkeypatch.setattr(origin, "distribution", lambda name: installed)
    assert origin.commit() == "c0ffee"
    origin.commit.cache_clear()
    source[0] = None
    monkeypatch.setattr(origin, "__file__", str(tmp_path / "site-packages" / "a" / "b.py"))
    assert origin.commit() is None, "a released wheel"


@pytest.mark.usefixtures("uncached")
def test_a_checkout_without_git_has_no_commit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / ".git").mkdir()
    monkeypatch.setattr(origin, "__file__", str(tmp_path / "stochvi" / "results" / "origin.py"))
    assert origin.commit() is None, "no commit in it"
    monkeypatch.setenv("PATH", "")
    origin.commit.cache_clear()
    assert origin.commit() is None, "no git"
