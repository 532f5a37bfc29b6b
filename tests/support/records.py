"""Records for tests: Gaussian ones and ones that are not, and universal files, written without the
library that reads them."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from subprocess import run
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stochvi.scenes import foreign_reader
from stochvi.scenes.readers import TIME_RESPONSE

Vector = NDArray[np.float64]

FS = 400.0
"""Sampling rate, Hz."""


def read_here(program: list[str], **how: Any) -> Any:
    """What the process that reads a binary file answers, without a process: it takes a second to
    load its libraries."""
    if foreign_reader.__file__ not in program:
        return run(program, **how)
    output = io.BytesIO()
    with np.printoptions(), warnings.catch_warnings():
        foreign_reader.answer(*program[3:5], output)
    return SimpleNamespace(stdout=output.getvalue(), returncode=0)


def gaussian(
    random: np.random.Generator, seconds: float, low: float = 4.0, high: float = 80.0
) -> Vector:
    """A stretch of stationary Gaussian noise in a band, 1 g rms."""
    length = 2 * int(seconds * FS)
    f = np.fft.rfftfreq(length, 1.0 / FS)
    inside = (f >= low) & (f <= high)
    spectrum = np.where(inside, random.normal(size=(2, len(f))), 0.0)
    a = np.fft.irfft(spectrum[0] + 1j * spectrum[1], length)[: length // 2]
    return np.asarray(a / a.std())


def spoilt(kind: str, random: np.random.Generator) -> Vector:
    """Gaussian noise of a minute with potholes, a sine, a change of level, or cut off; with none of
    these for any other word."""
    a = gaussian(random, 60.0)
    t = np.arange(len(a)) / FS
    if kind == "potholes":
        for start in (20.0, 41.0):
            inside = (t >= start) & (t < start + 0.04)
            a[inside] += 9.0 * np.sin(np.pi * (t[inside] - start) / 0.04)
    elif kind == "sine":
        a += 1.5 * np.sin(2.0 * np.pi * 12.0 * t)
    elif kind == "level":
        a *= np.where(t < 30.0, 1.0, 2.0)
    elif kind == "clipped":
        a = np.clip(a, -2.0, 2.0)
    return a


def shock_shape(shape: str, time: Vector) -> Vector:
    """The shapes of shocks as a standard draws them, over their length."""
    inside = (time >= 0.0) & (time <= 1.0)
    return {
        "half-sine": np.where(inside, np.sin(np.pi * time), 0.0),
        "saw-tooth": np.where(inside, time, 0.0),
        "trapezoid": np.where(inside, np.clip(np.minimum(time, 1.0 - time) / 0.1, 0.0, 1.0), 0.0),
    }[shape]


def write_uff(path: Path, *functions: tuple[int, str, np.ndarray, np.ndarray, str]) -> Path:
    """(function type, name, x, y, unit of y) each a dataset 58 of real doubles, uneven abscissa,
    laid out by the fixed columns of its definition, not by the library that reads it."""
    lines = []
    for kind, name, x, y, unit in functions:
        axis = f"{18 if kind != TIME_RESPONSE else 17:10d}{0:5d}{0:5d}{0:5d}"
        value = f"{12:10d}{0:5d}{0:5d}{0:5d}"
        none = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"
        lines += [f"{-1:6d}", f"{58:6d}", f"{name:80s}", *["NONE"] * 4]
        lines.append(
            f"{kind:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{1:10d}{3:4d} {'NONE':10s}{0:10d}{0:4d}"
        )
        lines.append(f"{4:10d}{len(x):10d}{0:10d}{x[0]:13.5e}{0.0:13.5e}{0.0:13.5e}")
        lines.append(f"{axis} {'x':20s} {'':20s}")
        lines.append(f"{value} {'acceleration':20s} {unit:20s}")
        lines += [none, none]
        cells = [f"{one:13.5e}{two:20.12e}" for one, two in zip(x, y, strict=True)]
        lines += ["".join(cells[n : n + 2]) for n in range(0, len(cells), 2)]
        lines.append(f"{-1:6d}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
