"""The rms displacement along a bar or a beam, or over a plate, with its stops and without."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import numpy as np

from stochvi.methods.linearisation.method import linearise
from stochvi.results.errors import NotApplicable, NotConverged
from stochvi.scenes.structures.spans import Span

if TYPE_CHECKING:
    import pandas as pd

    from stochvi.results.response import CoordinateResponse
    from stochvi.scenes.scene import Scene

PLACES = {1: 101, 2: 21}
"""Number of places along each side, of a structure with a length alone and of one with an area."""


def rms_along(scene: Scene) -> pd.DataFrame:
    """Find the rms displacement at places over a structure, by statistical linearisation.

    Parameters
    ----------
    scene
        Scene with a bar, a beam or a plate.

    Returns
    -------
    pandas.DataFrame
        A row for each place: its distance from the first end (m), or `x_m` and `y_m` on a plate,
        row after row along y; the rms about the mean without stops (m), which is exact; and that
        with stops, which is approximate. The latter is missing where `linearise` has no answer.

    Examples
    --------
    >>> from stochvi.scenes import load_scene, shipped_scene
    >>> rms_along(load_scene(shipped_scene("beam"))).iloc[[50, 100]].round(5).values.tolist()
    [[0.1, 0.00045, 0.00029], [0.2, 0.00133, 0.00083]]
    """
    import pandas as pd

    span = scene.structure
    if not isinstance(span, Span):
        raise NotApplicable(
            "map", [f"structure.kind must be 'bar', 'beam' or 'plate', got {span.kind!r}"]
        )
    count = PLACES[len(span.sides)]
    fine = scene.replace(structure=span.with_places(count))
    share = np.linspace(0.0, 1.0, count)
    sides = np.meshgrid(*(share * side for side in span.sides), indexing="ij")
    names = ("distance_m",) if len(sides) == 1 else ("x_m", "y_m")
    table = {name: place.ravel() for name, place in zip(names, sides, strict=True)}
    table["rms_without_stops_m"] = _rms(fine.replace(impact_pairs=[]))
    if scene.impact_pairs:
        with contextlib.suppress(NotApplicable, NotConverged):
            table["rms_with_stops_m"] = _rms(fine)
    return pd.DataFrame(table)


def _rms(fine: Scene) -> np.ndarray:
    """Standard deviations of the displacement at all places, m."""
    found = linearise(fine).coordinates
    places = [name for name in fine.structure.places if name.startswith("place ")]
    return np.array([_std(found[name]) for name in places])


def _std(motion: CoordinateResponse) -> float:
    """Standard deviation of a displacement, m; nan where it is not known."""
    return np.nan if motion.displacement_std is None else motion.displacement_std.value
