"""A kernel is compiled again after any file of its folder has changed, only then, and once."""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stochvi.methods import kernel_cache

ADDEND = "import numba\n\n\n@numba.njit(cache=True)\ndef addend():\n    return {value}\n"

TOTAL = """\
import numba
from pretend.addend import addend


@numba.njit(cache=True)
def total(x):
    return x + addend()
"""

RUN = """\
from pretend.total import total
print(total(1), sum(total.stats.cache_hits.values()), total.stats.cache_path)
"""

RUN_TOGETHER = """\
import os, pathlib, sys, time
from pretend.total import total
here = pathlib.Path(sys.argv[1])
(here / str(os.getpid())).touch()
while len(list(here.iterdir())) < 2:
    time.sleep(0.01)
print(total(1), sum(total.stats.cache_hits.values()))
"""


def made_package(folder: Path, watched: bool = True) -> Path:
    """A package of two kernels, the first of which calls the second."""
    package = folder / "pretend"
    package.mkdir()
    shutil.copy(kernel_cache.__file__, package / "kernel_cache.py")
    start = "from pretend.kernel_cache import watch_package\n\nwatch_package(__path__)\n"
    (package / "__init__.py").write_text(start if watched else "", encoding="utf-8")
    (package / "total.py").write_text(TOTAL, encoding="utf-8")
    (package / "addend.py").write_text(ADDEND.format(value=10), encoding="utf-8")
    return package


def run(folder: Path) -> tuple[int, int, Path]:
    """The answer of the kernel in a process of its own, how often it came from the cache, and
    where that is."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    words = subprocess.run(
        [sys.executable, "-c", RUN], capture_output=True, text=True, check=True, env=environment
    ).stdout.split(maxsplit=2)
    return int(words[0]), int(words[1]), Path(words[2].strip())


def test_a_kernel_is_compiled_again_after_a_file_that_it_imports_has_changed(tmp_path: Path):
    package = made_package(tmp_path)
    assert run(tmp_path) == (11, 0, package / "__pycache__")
    assert run(tmp_path) == (11, 1, package / "__pycache__")
    (package / "addend.py").write_text(ADDEND.format(value=20), encoding="utf-8")
    assert run(tmp_path)[:2] == (21, 0)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_of_two_processes_that_need_a_kernel_at_once_one_compiles_it(tmp_path: Path):
    made_package(tmp_path)
    ready = tmp_path / "ready"
    ready.mkdir()
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", RUN_TOGETHER, ready]
    both = [
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(2)
    ]
    assert sorted(each.communicate()[0].split() for each in both) == [["11", "0"], ["11", "1"]]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [b"", b"\x80\x05garbage", b"\x00" * 300])
def test_a_damaged_cache_is_compiled_again(tmp_path: Path, kind: str, damage: bytes):
    package = made_package(tmp_path)
    run(tmp_path)
    for file in (package / "__pycache__").glob(f"*.{kind}"):
        file.write_bytes(damage)
    assert run(tmp_path)[:2] == (11, 0)
    assert run(tmp_path)[:2] == (11, 1)


@pytest.mark.verify
def test_numba_alone_keeps_the_old_kernel(tmp_path: Path):
    """The control: once numba looks at imported files itself, the stamps can go."""
    package = made_package(tmp_path, watched=False)
    assert run(tmp_path)[:2] == (11, 0)
    (package / "addend.py").write_text(ADDEND.format(value=20), encoding="utf-8")
    assert run(tmp_path)[:2] == (11, 1)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a folder of the user in HOME")
def test_where_the_folder_cannot_be_written_the_cache_is_a_folder_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = made_package(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "caches"))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    (package / "__pycache__").touch()  # a file in its place, which also an administrator cannot use
    value, _, path = run(tmp_path)
    assert value == 11 and path.is_relative_to(tmp_path / "home")
    (package / "addend.py").write_text(ADDEND.format(value=20), encoding="utf-8")
    assert run(tmp_path)[0] == 21


@pytest.mark.parametrize(
    ("module", "function"),
    [
        ("stochvi.methods.monte_carlo.kernels.random_numbers", "seed_streams"),
        ("stochvi.methods.periodic.kernels.solver", "march"),
        ("stochvi.methods.periodic.kernels.flights", "fly"),
    ],
)
def test_the_kernels_of_the_package_are_watched(module: str, function: str):
    kernels = importlib.import_module(module)
    stamp = getattr(kernels, function)._cache._impl.locator.get_source_stamp()
    assert stamp == kernel_cache.digest(Path(kernels.__file__).parent)
