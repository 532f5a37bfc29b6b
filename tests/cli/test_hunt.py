"""A hunt with a seed: whatever a command is given, it ends with a code and a sentence."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import resource
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from numba.core.registry import cpu_target

import stochvi as stochvi_package
from stochvi.results.deadline import stood_still
from support.commands import Run
from support.mutations import BARE, BUDGET, COMMANDS, LONG_COMMANDS, Mutator

SECONDS = 1.2 * BUDGET + 2.0
"""CPU seconds that a command may take, without the compiling of kernels."""

MEGABYTES = 1500.0
"""Memory that the process may come to hold, with every library that any command imports."""

QUICKEST = 12
"""Number of commands, from the first, that simulate nothing and take milliseconds."""


def hunt(stochvi: Run, folder: Path, seed: int, commands: tuple[tuple[str, ...], ...]) -> None:
    """A changed scene."""
    mutator = Mutator(seed)
    inside = folder / "a" / "b"
    inside.mkdir(parents=True)
    scene, out = mutator.write(inside), inside / "o1" / "o2"
    words = mutator.command(commands, out)
    if judge(stochvi, folder, seed, scene, words, out) >= SECONDS:
        # what a busy machine took from a process once, it does not take twice
        again = judge(stochvi, folder, seed, scene, words, out)
        assert again < SECONDS, f"{again:.1f} s\nseed {seed}: {' '.join(words)}"


def hunt_in_files(stochvi: Run, folder: Path, seed: int) -> None:
    """A changed file, of a scene or of paths."""
    folder.mkdir(exist_ok=True)
    file, words = Mutator(seed).file(folder)
    if judge(stochvi, folder, seed, file, words, folder / "none") >= SECONDS:
        again = judge(stochvi, folder, seed, file, words, folder / "none")
        assert again < SECONDS, f"{again:.1f} s\nseed {seed}: {' '.join(words)}"


def judge(stochvi: Run, folder: Path, seed: int, file: Path, words: list[str], out: Path) -> float:
    """The CPU seconds of a command without the compiling of kernels. It must end with a code and a
    sentence, and write into `out`."""
    before = files_of(folder)
    case = f"seed {seed}: {' '.join(words)}\n{file.read_text('utf-8', 'replace')[:3000]}"
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # other tests of the process may
    began, stood = time.process_time(), stood_still()
    code, text, errors = stochvi(words[0], file, *words[1:])
    spent = time.process_time() - began - (stood_still() - stood)
    assert code in (0, 1, 2), case
    if code:
        assert "stochvi: " in errors, f"{errors}\n{case}"
        assert not BARE.search(errors), f"{errors}\n{case}"
        assert len(errors.split("stochvi: ", 1)[1].strip()) > 15, f"{errors}\n{case}"
    assert "\x1b" not in text + errors and "\x00" not in text + errors, case
    changed = {path for path, state in files_of(folder).items() if before.get(path) != state}
    assert all(path.is_relative_to(out) for path in changed), f"{changed}\n{case}"
    most = max(held, 1024.0 * MEGABYTES)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss <= most, case
    return spent


def files_of(folder: Path) -> dict[Path, tuple[int, int]]:
    """Every file below a folder with its number and the time when it was written."""
    found = {path: path.stat() for path in folder.rglob("*") if path.is_file()}
    return {path: (state.st_ino, state.st_mtime_ns) for path, state in found.items()}


@pytest.fixture(scope="module", autouse=True)
def libraries(tmp_path_factory: pytest.TempPathFactory) -> None:
    """All modules, numba's registries and the fonts of pictures: the first command of a process
    that needs a library waits for it, which is no work of that command."""
    for module in pkgutil.walk_packages(stochvi_package.__path__, "stochvi."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    picture = Figure()
    picture.suptitle(r"$\sigma$ and a title")
    picture.savefig(tmp_path_factory.mktemp("fonts") / "picture.png")


@contextlib.contextmanager
def beginning(case: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # a traceback: say which case it is
        raise AssertionError(case) from error


@pytest.mark.parametrize("seed", range(10))
def test_a_changed_scene_ends_in_a_sentence(stochvi: Run, tmp_path: Path, seed: int):
    with beginning(f"seed {seed}"):
        hunt(stochvi, tmp_path, seed, COMMANDS[:QUICKEST])


@pytest.mark.verify
@pytest.mark.parametrize("hundred", range(1, 21))
def test_thousands_of_changed_scenes_end_in_sentences(stochvi: Run, tmp_path: Path, hundred: int):
    for seed in range(100 * hundred, 100 * hundred + 100):
        with beginning(f"seed {seed}"):
            hunt(stochvi, tmp_path / str(seed), seed, COMMANDS + LONG_COMMANDS)


@pytest.mark.parametrize("seed", range(12))
def test_a_changed_file_ends_in_a_sentence(stochvi: Run, tmp_path: Path, seed: int):
    with beginning(f"seed {seed}"):
        hunt_in_files(stochvi, tmp_path, seed)


@pytest.mark.verify
@pytest.mark.parametrize("hundred", range(5))
def test_hundreds_of_changed_files_end_in_sentences(stochvi: Run, tmp_path: Path, hundred: int):
    for seed in range(100 * hundred, 100 * hundred + 100):
        with beginning(f"seed {seed}"):
            hunt_in_files(stochvi, tmp_path / str(seed), seed)
