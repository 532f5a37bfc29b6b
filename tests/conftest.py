"""Fixtures of all tests."""

from __future__ import annotations

import os
import sys
from pathlib import Path

# The workers of pytest-xdist use every core already: threads of BLAS on top of them wait for each
# other and triple the cost of the Fokker-Planck tests. numpy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from stochvi.cli import main
from support.commands import Finished, Run

# Without bytecode on the disk every worker, and every process that a test starts, compiles each
# file again: 10 s of each run. Some machines ask for that by default; the suite does not follow.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.fixture
def stochvi(capsys: pytest.CaptureFixture[str]) -> Run:
    """The command with these arguments, as it ends."""

    def run(*arguments: str | Path) -> Finished:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments], prog_name="stochvi")
        assert isinstance(stop.value.code, int)
        return Finished(stop.value.code, *capsys.readouterr())

    return run
