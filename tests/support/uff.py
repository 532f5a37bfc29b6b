"""Universal files, written without the library that reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stochvi.scenes.readers import TIME_RESPONSE


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
