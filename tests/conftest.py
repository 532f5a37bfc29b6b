"""Fixtures of all tests."""

from __future__ import annotations

import functools
import gc
import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any, NoReturn

# The workers of pytest-xdist use every core already: threads of BLAS on top of them wait for each
# other and triple the cost of the Fokker-Planck tests. numpy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from stochvi.cli import main
from support import records
from support.commands import Finished, Run

# Without bytecode on the disk every worker, and every process that a test starts, compiles each
# file again: 10 s of each run. Some machines ask for that by default; the suite does not follow.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A look for garbage after every 700 new objects is some 7 % of the time of the suite.
gc.set_threshold(10_000)

# A shell that starts the suite in the background lets it ignore Ctrl-C, of which it tests a lot.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def stochvi(capsys: pytest.CaptureFixture[str]) -> Run:
    """The command with these arguments, as it ends."""

    def run(*arguments: str | Path) -> Finished:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments], prog_name="stochvi")
        assert isinstance(stop.value.code, int)
        return Finished(stop.value.code, *capsys.readouterr())

    return run


@pytest.fixture
def apart() -> None:
    """Binary files are read in processes of their own in spite of `read_here`."""


@pytest.fixture
def read_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Binary files of other programs are read in this process, but for tests that want one."""
    if "apart" not in request.fixturenames:
        monkeypatch.setattr("stochvi.scenes.readers.subprocess.run", records.read_here)


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are put together and left blank: to draw them is most of the time of a page."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_where, **_how: None)


@pytest.fixture
def early_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulation of a check ends after 64 paths, as one whose budget is over. On a busy machine
    a real budget would end before the first paths, and on a fast one after the last."""

    def simulated(scene: Any, **_: Any) -> NoReturn:
        from stochvi import simulate
        from stochvi.results import NotConverged

        answer = simulate(scene, paths=64, seed=1, threads=1)
        raise NotConverged("the budget of 1 s ended after 64 paths; raise budget", answer)

    module = importlib.import_module("stochvi.verification.check")
    monkeypatch.setattr(module, "simulate", simulated)


@pytest.fixture
def short_review(monkeypatch: pytest.MonkeyPatch) -> None:
    """The report of a sizing simulates as little as it can, for tests of something else."""
    from stochvi.isolators.sizing.review import PathSettings, PeakSettings, ReviewSettings

    short = functools.partial(
        ReviewSettings,
        path=PathSettings(periods=500),
        peaks=PeakSettings(stiffness_ratios=(1000.0,), multiples=(3.0,), seconds=0.1),
        closure_points=5,
        clearances=2,
        exceedance_share=0.05,
    )
    monkeypatch.setattr("stochvi.isolators.sizing.review.ReviewSettings", short)
