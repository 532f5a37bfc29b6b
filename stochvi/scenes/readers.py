"""Columns of numbers from the files that instruments and analysers write: text, UFF, MATLAB."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import check_file, read_table

Vector = NDArray[np.float64]

LARGEST_DATA_FILE = 200_000_000
"""Largest size of a record file, bytes: an hour at 1 kHz takes about 70 million bytes as text."""

UFF_SUFFIXES = (".uff", ".unv", ".ufb", ".uf")
MATLAB_SUFFIXES = (".mat",)

TIME_RESPONSE, SPECTRAL_DENSITY = 1, 9
"""Function types of UFF dataset 58, record 6, field 1."""

UNIT_LABELS = {
    "g^2/hz": "g2/Hz",
    "g2/hz": "g2/Hz",
    "gn^2/hz": "g2/Hz",
    "(m/s^2)^2/hz": "(m/s2)2/Hz",
    "(m/s2)2/hz": "(m/s2)2/Hz",
    "m^2/s^4/hz": "(m/s2)2/Hz",
    "m^2/s^3": "(m/s2)2/Hz",
    "n^2/hz": "N2/Hz",
    "n2/hz": "N2/Hz",
    "g": "g",
    "gn": "g",
    "m/s^2": "m/s2",
    "m/s2": "m/s2",
    "n": "N",
}
"""Unit as instruments write it (small letters, no blanks) -> unit as scene files write it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """Two columns of a file: `x` (None where the file holds `y` alone), and what `y` is in.

    `unit` is one of the words of `UNIT_LABELS`, or None where the file does not say.
    """

    x: Vector | None
    y: Vector
    unit: str | None = None


def read_columns(
    path: Path,
    names: Sequence[str],
    *,
    variables: Sequence[str] | None = None,
    dataset: int | None = None,
    function_type: int = SPECTRAL_DENSITY,
) -> Columns:
    """The columns `names` (one or two) of a text, UFF or MATLAB file; the ending tells which.

    Parameters
    ----------
    variables
        Of a MATLAB file: the two vectors, or the one matrix of two columns, to read.
    dataset
        Of a UFF file: which of its datasets, counted from 1.
    function_type
        The function type of dataset 58 that is looked for where `dataset` does not say.

    Raises
    ------
    SceneError
        In a sentence, where the file is not what was expected, or leaves a choice.
    """
    suffix = path.suffix.lower()
    if variables is not None and suffix not in MATLAB_SUFFIXES:
        raise SceneError([("variables", f"is for MATLAB files (.mat), got {path.name}")])
    if dataset is not None and suffix not in UFF_SUFFIXES:
        raise SceneError([("dataset", f"is for UFF files (.uff, .unv), got {path.name}")])
    if suffix in UFF_SUFFIXES:
        return _read_uff(path, names, dataset, function_type)
    if suffix in MATLAB_SUFFIXES:
        return _read_matlab(path, names, variables)
    largest = LARGEST_DATA_FILE if function_type == TIME_RESPONSE else None
    columns = read_table(path, names, largest)
    return Columns(x=columns[0] if len(columns) == 2 else None, y=columns[-1])


def known_unit(label: str) -> str | None:
    """The word for a unit as an instrument writes it; None for one that is not known.

    >>> known_unit("(m/s**2)^2 / Hz"), known_unit("EU")
    ('(m/s2)2/Hz', None)
    """
    return UNIT_LABELS.get(label.lower().replace(" ", "").replace("**", "^").replace("²", "^2"))


# UFF --------------------------------------------------------------------------------------


def _read_uff(path: Path, names: Sequence[str], dataset: int | None, function_type: int) -> Columns:
    functions = _uff_functions(path)
    fitting = [n for n, entry in functions.items() if entry["func_type"] == function_type]
    if dataset is None:
        if len(fitting) != 1:
            kind = "a power spectral density" if function_type == SPECTRAL_DENSITY else "a record"
            raise SceneError(
                [("dataset", f"must say which of {path} is {kind}: {_listed_datasets(functions)}")]
            )
        (dataset,) = fitting
    if dataset not in functions:
        raise SceneError(
            [("dataset", f"must be one of {path}: {_listed_datasets(functions)}, got {dataset}")]
        )
    entry = functions[dataset]
    x, y = np.asarray(entry["x"]), np.asarray(entry["data"])
    if np.iscomplexobj(y):
        raise SceneError(
            [("dataset", f"{dataset} of {path} is complex, expected the real column {names[-1]}")]
        )
    label = str(entry.get("ordinate_axis_units_lab") or "")
    return Columns(x=x.astype(float), y=y.astype(float), unit=known_unit(label))


def _uff_functions(path: Path) -> dict[int, Mapping[str, Any]]:
    """The datasets 58 of a file by their number, counted from 1."""
    import pyuff

    check_file(path, LARGEST_DATA_FILE)
    try:
        file = pyuff.UFF(str(path))
        numbers = [n for n, kind in enumerate(file.get_set_types()) if int(kind) == 58]
        found: dict[int, Mapping[str, Any]] = {n + 1: file.read_sets(n) for n in numbers}
    except Exception:  # pyuff raises whatever its parsing met
        raise SceneError(f"{path} is not a UFF file that can be read") from None
    if not found:
        raise SceneError(f"{path} holds no dataset 58 (a function at a node)")
    return found


def _listed_datasets(functions: Mapping[int, Mapping[str, Any]]) -> str:
    return "; ".join(
        f"dataset = {number}: {str(entry.get('id1', '')).strip() or 'without a name'} "
        f"(function type {entry['func_type']})"
        for number, entry in functions.items()
    )


# MATLAB -----------------------------------------------------------------------------------


def _read_matlab(path: Path, names: Sequence[str], variables: Sequence[str] | None) -> Columns:
    arrays = _matlab_arrays(path)
    example = ", ".join(f'"{name}"' for name in names)
    if variables is None:
        choices = _matlab_choices(arrays, len(names))
        if len(choices) != 1:
            raise SceneError(
                [
                    (
                        "variables",
                        f"must say which variables of {path} are [{example}]; it holds "
                        f"{_listed_arrays(arrays)}",
                    )
                ]
            )
        (variables,) = choices
    for name in variables:
        if name not in arrays:
            raise SceneError(
                [("variables", f"names {name!r}, but {path} holds {_listed_arrays(arrays)}")]
            )
    chosen = [arrays[name] for name in variables]
    if len(chosen) == 1 and len(names) == 2:
        matrix = chosen[0] if chosen[0].ndim == 2 and chosen[0].shape[1] == 2 else chosen[0].T
        if matrix.ndim == 2 and matrix.shape[1] == 2:
            return Columns(x=matrix[:, 0], y=matrix[:, 1])
    if len(chosen) != len(names) or any(array.ndim != 1 for array in chosen):
        raise SceneError(
            [
                (
                    "variables",
                    f"must name {'vectors' if len(names) == 2 else 'a vector'} [{example}]"
                    f"{' or one matrix of two columns' if len(names) == 2 else ''}, "
                    f"got {_listed_arrays({name: arrays[name] for name in variables})}",
                )
            ]
        )
    if len({len(array) for array in chosen}) > 1:
        raise SceneError(
            [
                (
                    "variables",
                    "must have one length, got "
                    f"{_listed_arrays({name: arrays[name] for name in variables})}",
                )
            ]
        )
    return Columns(x=chosen[0] if len(chosen) == 2 else None, y=chosen[-1])


def _matlab_arrays(path: Path) -> dict[str, Vector]:
    """Every real array of numbers, vectors as one dimension, by its name."""
    from scipy.io import loadmat

    check_file(path, LARGEST_DATA_FILE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = loadmat(str(path))
    except NotImplementedError:
        raise SceneError(f"{path} is of MATLAB 7.3; save it with the option -v7") from None
    except Exception:  # scipy raises whatever its parsing met
        raise SceneError(f"{path} is not a MATLAB file that can be read") from None
    found = {}
    for name, value in content.items():
        array = np.asarray(value)
        if not name.startswith("__") and array.dtype.kind in "fiu" and array.size > 1:
            flat = array.ravel() if max(array.shape) == array.size else array
            found[name] = flat.astype(float)
    return found


def _matlab_choices(arrays: Mapping[str, Vector], count: int) -> list[tuple[str, ...]]:
    """What the columns may be: a matrix of two, or vectors of one length, the first rising."""
    vectors = {name: array for name, array in arrays.items() if array.ndim == 1}
    if count == 1:
        return [(name,) for name in vectors]
    matrices: list[tuple[str, ...]] = [
        (name,) for name, array in arrays.items() if array.ndim == 2 and 2 in array.shape
    ]
    pairs: list[tuple[str, ...]] = [
        (one, two)
        for one, first in vectors.items()
        for two, second in vectors.items()
        if one != two
        and len(first) == len(second)
        and np.all(np.diff(first) > 0.0)
        and not np.all(np.diff(second) > 0.0)
    ]
    return matrices + pairs


def _listed_arrays(arrays: Mapping[str, Vector]) -> str:
    return (
        "; ".join(
            f"{name} ({' x '.join(str(size) for size in array.shape)})"
            for name, array in arrays.items()
        )
        or "no arrays of numbers"
    )
