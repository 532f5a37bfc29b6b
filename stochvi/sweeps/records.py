"""The mean of a method's answer over several records of one phase, and the scatter between them.

Records of one road differ by more than their own statistical errors. Each is taken by itself. What
is averaged is the answer, not the density: the probability of an impact is far from linear in the
level, so that the loudest records have most of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stochvi.model.calculations import calculation
from stochvi.results.estimates import BIAS, ERROR, LIMIT
from stochvi.results.intervals import CONFIDENCE, logarithmic_interval, student_quantile
from stochvi.results.progress import Progress
from stochvi.scenes.excitations import RecordedNoise
from stochvi.scenes.keys import Change
from stochvi.scenes.scene import Scene
from stochvi.sweeps.ranges import check_method, rows_of

if TYPE_CHECKING:
    import pandas as pd


@calculation
def mean_over_records(
    scene: Scene,
    files: Sequence[str | Path],
    *,
    method: str = "reliability",
    out: str | Path | None = None,
    progress: Progress | None = None,
    **arguments: Any,
) -> pd.DataFrame:
    """Mean over several measured records, and scatter between them, of a method's answer.

    Each record takes the place of the file of the scene; unit, level and band stay. The mission
    meets one of them, each as probable as the others. So its probability of an impact is the mean
    of theirs. Noise of their mean density has a smaller one where impacts are rare.

    Parameters
    ----------
    scene
        A scene that one record shakes.
    files
        Files of the records, two at least.
    method, out, progress
        As for `stochvi.sweep`.
    **arguments
        Those of the method, such as `mission`.

    Returns
    -------
    DataFrame
        A row per quantity: `quantity`, its `mean` and the ends `low` and `high` of its 95 %
        interval by Student, which holds the scatter between the records. It is that of the
        logarithm where all values are positive; that of a probability ends at 1. Beside them are
        `bias`, `statistical_error` of the mean, and `std_between_records` without statistical
        errors.
        `attrs["records"]` is the table of the records, a row each.

    Raises
    ------
    ValueError
        If the scene has no single record, or there are fewer than two files.

    See Also
    --------
    stochvi.mean_over_units : The mean over units that differ.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from stochvi import ImpactPair, Isolator, Restitution
    >>> files = [Path(tempfile.mkdtemp()) / f"{level}.txt" for level in (9, 10, 12)]
    >>> for number, file in enumerate(files):
    ...     values = np.random.default_rng(number).normal(size=4000)
    ...     np.savetxt(file, float(file.stem) * values)
    >>> scene = Scene(
    ...     structure=Isolator(frequency_hz=12.0, zeta=0.1),
    ...     impact_pairs=[ImpactPair(clearance=0.008, law=Restitution(coefficient=0.5))],
    ...     excitations=[RecordedNoise(file=str(files[0]), unit="m/s2", fs=400.0)],
    ... )
    >>> table = mean_over_records(scene, files, mission=60.0).set_index("quantity")
    >>> bool(0.0 < table.loc["mission.hit", "mean"] < table.loc["mission.hit", "high"] <= 1.0)
    True
    """
    import pandas as pd

    check_method(method, arguments)
    records = [each for each in scene.excitations if isinstance(each, RecordedNoise)]
    if len(records) != 1:
        raise ValueError(f"scene must have one excitation of kind 'record', got {len(records)}")
    if len(files) < 2:
        raise ValueError(f"files must be two at least, got {len(files)}")
    (record,) = records
    made = [
        scene.replace(
            excitations=[
                record.replace(file=str(file)) if each is record else each
                for each in scene.excitations
            ]
        )
        for file in files
    ]
    grid: list[Change] = [(("record", float(number)),) for number in range(len(files))]
    rows = rows_of(
        scene, grid, lambda change: made[int(change[0][1])], method=method, common=False,
        arguments=arguments, out=out, progress=progress,
    )  # fmt: skip
    rows.insert(0, "file", [str(file) for file in files])
    known = [str(name) for name in rows]
    quantities = [each.removesuffix(f".{ERROR}") for each in known if each.endswith(f".{ERROR}")]
    found = pd.DataFrame([_mean(rows, quantity) for quantity in quantities])
    found.attrs["records"] = rows
    return found


def _mean(rows: pd.DataFrame, quantity: str) -> dict[str, Any]:
    """The row of a quantity; NaN where the answer of any record lacks it."""
    value, error, bias = (
        rows[name].to_numpy(dtype=float)
        for name in (quantity, f"{quantity}.{ERROR}", f"{quantity}.{BIAS}")
    )
    if f"{quantity}.{LIMIT}" in rows:  # what was not seen in a record may be as large as its limit
        bias = bias + rows[f"{quantity}.{LIMIT}"].fillna(0.0).to_numpy(dtype=float)
    count, mean, spread = len(value), float(value.mean()), float(value.std(ddof=1))
    left = float(abs(bias).mean())
    # the scatter of the values holds their statistical errors
    scatter = spread / math.sqrt(count)
    half = student_quantile(1.0 - CONFIDENCE, count - 1.0) * scatter + left
    low, high = mean - half, mean + half
    if value.min() > 0.0:
        low, high = logarithmic_interval(mean, scatter, count - 1, bias=left)
    if quantity.startswith("mission.") and quantity != "mission.expected_hits":
        low, high = max(low, 0.0), min(high, 1.0)  # a probability
    between = spread**2 - float((error**2).mean())
    return {
        "quantity": quantity, "mean": mean, "low": low, "high": high,
        "bias": left, "statistical_error": math.sqrt(float((error**2).sum())) / count,
        "std_between_records": math.sqrt(max(between, 0.0)) if between == between else math.nan,
    }  # fmt: skip
