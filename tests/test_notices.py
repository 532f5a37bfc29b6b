"""What is told beside answers: plans and choices to the logger, warnings by category."""

from __future__ import annotations

import logging
import warnings

import pytest

import stochvi
from stochvi.scenes import shipped_scene
from support.known import oscillator


def test_the_logger_tells_plans_and_choices(caplog: pytest.LogCaptureFixture) -> None:
    scene = stochvi.load_scene(shipped_scene("oscillator-lossy"))
    with caplog.at_level(logging.DEBUG, "stochvi"):
        stochvi.simulate(scene, paths=2, duration=5.0, seed=1)
    plans = [each.getMessage() for each in caplog.records if "plan: " in each.getMessage()]
    assert len(plans) == 1 and "2 states, step " in plans[0]
    assert all(each.levelno == logging.DEBUG for each in caplog.records)


def test_nothing_is_told_unless_it_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stochvi.simulate(oscillator(restitution=0.8), paths=2, duration=5.0, seed=1)
    assert capsys.readouterr() == ("", "")


def test_every_category_is_a_warning_of_the_package() -> None:
    for name in ("InputWarning", "KernelWarning", "OutputWarning", "PartWarning"):
        assert issubclass(getattr(stochvi, name), stochvi.StochviWarning)
    assert issubclass(stochvi.StochviWarning, UserWarning)
