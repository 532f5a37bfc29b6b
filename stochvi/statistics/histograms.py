"""Histograms of samples, normalised to a probability density."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class SampledDensity:
    """A histogram whose area is 1.

    Parameters
    ----------
    edges
        Edges of the bins, in the unit of the samples.
    density
        Probability density in each bin, one value fewer than `edges`.
    """

    edges: Vector
    density: Vector

    @classmethod
    def of(cls, samples: ArrayLike, bins: int, low: float, high: float) -> SampledDensity:
        """The histogram of the samples between `low` and `high`.

        The caller chooses the number of bins; `OverviewSettings` has that of an overview.

        Examples
        --------
        >>> SampledDensity.of([0.5, 0.6, 1.5, 9.0], 2, 0.0, 2.0).density.round(3).tolist()
        [0.667, 0.333]
        """
        density, edges = np.histogram(samples, bins=bins, range=(low, high), density=True)
        return cls(edges=edges.astype(float), density=density.astype(float))

    def to_dict(self) -> dict[str, Any]:
        """The JSON document."""
        return {"edges": self.edges.tolist(), "density": self.density.tolist()}
