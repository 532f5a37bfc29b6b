"""Arrays from binary files of other programs, read where a damaged file does no harm.

MATLAB, UFF and IDE files are read by libraries in a process of its own with limits of memory and
time: it takes a tenth of a second longer than to import them here. Files of numpy are read here,
after their sizes were compared with what they claim.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.results.errors import SceneError
from stochvi.scenes import foreign_reader
from stochvi.scenes.foreign_reader import MOST_NUMBERS, MOST_SECONDS, REAL
from stochvi.scenes.text_tables import check_file

LARGEST_DATA_FILE = 200_000_000
"""Largest size of a record file, bytes: an hour at 1 kHz takes about 70 million bytes as text."""

OF_EXTRAS = {
    "IDE": ("idelib", "ide"),
    "Nastran modes": ("pyyeti", "fem"),
    "Nastran matrices": ("pyyeti", "fem"),
    "Exodus modes": ("netCDF4", "fem"),
}
"""Kind of file -> the package that reads it, and the extra by which it is installed."""

LONGEST_WAIT = 10 * MOST_SECONDS
"""Longest time of a reader by the clock, s, on a machine that has other work."""


class Foreign(NamedTuple):
    """An array `y` of a file, over `x` if the file says so, and what the file says of it."""

    name: str
    x: Vector | None
    y: Vector
    facts: Mapping[str, Any]


def read_foreign(path: Path, kind: str) -> tuple[Foreign, ...]:
    """The arrays of a file of a kind of `READERS` ("MATLAB", "UFF", "IDE"), read apart.

    Raises
    ------
    SceneError
        If the file cannot be read, whatever happens to the program that reads it.
    """
    package, extra = OF_EXTRAS.get(kind, ("numpy", ""))
    if importlib.util.find_spec(package) is None:
        raise SceneError(f"{path} needs the package {package}: pip install 'stochvi[{extra}]'")
    check_file(path, LARGEST_DATA_FILE)
    found = path.stat()
    return _read_apart(str(path), kind, (found.st_ino, found.st_size, found.st_mtime_ns))


@lru_cache(maxsize=1)
def _read_apart(path: str, kind: str, _: tuple[int, ...]) -> tuple[Foreign, ...]:
    """The arrays of a file. The same file again, as a sweep asks for it, costs nothing."""
    program = [sys.executable, "-I", foreign_reader.__file__, kind, path, json.dumps(sys.path)]
    alone = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    try:
        ended = subprocess.run(
            program, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            timeout=LONGEST_WAIT, check=False, env=os.environ | alone,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise _refusal(path, kind, f"is not read after {LONGEST_WAIT} s") from None
    head, _newline, body = ended.stdout.partition(b"\n")
    try:
        answer = json.loads(head)
    except ValueError:
        answer = {"error": "crash"}
    reason = answer.get("error")
    if reason == "version":
        raise SceneError(f"{path} is of MATLAB 7.3; save it with the option -v7")
    if reason == "short":
        raise SceneError(f"{path} ends before the numbers that it claims to hold; write it again")
    if reason == "memory":
        raise _refusal(path, kind, f"holds more than {MOST_NUMBERS:.0e} numbers, or claims to")
    if reason == "crash" and ended.returncode == -getattr(signal, "SIGXCPU", math.inf):
        raise _refusal(path, kind, f"takes more than {MOST_SECONDS} s to be read")
    if reason is not None:
        raise SceneError(f"{path} is not a {kind} file that can be read; write it again")
    return tuple(_arrays(answer["arrays"], body))


def _refusal(path: str, kind: str, what: str) -> SceneError:
    return SceneError(f"{path} {what}; write a {kind} file with the record alone")


def _arrays(entries: list[dict[str, Any]], body: bytes) -> Iterator[Foreign]:
    """Arrays from their facts and from the bytes of all of them."""
    place = 0
    for entry in entries:
        held: dict[str, Vector | None] = {}
        for axis in ("x", "y"):
            shape = entry.pop(axis)
            if shape is None:
                held[axis] = None
                continue
            count = math.prod(shape)
            held[axis] = np.frombuffer(body, "<f8", count, place).reshape(shape)
            place += 8 * count
        assert held["y"] is not None
        yield Foreign(entry.pop("name"), held["x"], held["y"], entry)


def read_numpy(path: Path) -> dict[str, Vector]:
    """The real arrays of a .npy or .npz file by their names; objects are never unpickled."""
    check_file(path, LARGEST_DATA_FILE)
    wrong = SceneError(f"{path} is not a NumPy file that can be read; write it again")
    try:
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                return dict(_real("data", _array(file, path.stat().st_size)))
        found: dict[str, Vector] = {}
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(each.file_size for each in members) > 8 * MOST_NUMBERS:
                raise _refusal(str(path), "NumPy", f"holds more than {MOST_NUMBERS:.0e} numbers")
            for each in members:
                with archive.open(each) as file:
                    name = each.filename.removesuffix(".npy")
                    found |= _real(name, _array(file, each.file_size))
        return found
    except SceneError:
        raise
    except Exception:  # numpy and zipfile raise errors of many kinds when they parse
        raise wrong from None


def _real(name: str, array: NDArray[Any]) -> dict[str, Vector]:
    if array.dtype.kind not in REAL or array.size < 2:
        return {}
    flat = array.ravel() if max(array.shape) == array.size else array
    return {name: flat.astype(float)}


def _array(file: Any, size: int) -> NDArray[Any]:
    """An array from its file of `size` bytes, which must hold what its header claims."""
    form = np.lib.format
    version = form.read_magic(file)
    header = {(1, 0): form.read_array_header_1_0}.get(version, form.read_array_header_2_0)(file)
    shape, fortran, dtype = header
    if dtype.hasobject or math.prod(shape) * dtype.itemsize > size:
        raise ValueError
    data = np.frombuffer(file.read(math.prod(shape) * dtype.itemsize), dtype)
    return data.reshape(shape, order="F" if fortran else "C")
