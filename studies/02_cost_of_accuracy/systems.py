"""A scene as the arrays that an integrator of one's own needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

import stochvi as sv
from stochvi.mathematics.spectra import Table
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan

ROWS = ("y", "yy", "ww", "n", "f1", "f2")
"""Averages that every method returns of a path: of the gap y of a pair, of y^2 and of the square of
its rate w; per second the impacts from the threshold on, and of all impacts the speeds and their
squares."""

LARGEST_RECORDS = 2**24
"""Largest number of samples of the records of all paths that are simulated together, 128 MB."""


@dataclass(frozen=True)
class System:
    """q'' + damping q' + squares (q - rest) = kicks . white noises + columns . records, by modes.

    The gap of a pair is gaps . q, and a row of `stops` is (lower, upper, restitution, speed from
    which impacts are counted); `pushes` (pairs, modes) is what a change of a gap by one unit in an
    impact adds to the modes. The records are accelerations or forces with the densities `tables`.
    The averages that are asked for are those of the pair `watched`.
    """

    squares: np.ndarray
    damping: np.ndarray
    rest: np.ndarray
    kicks: np.ndarray
    tables: tuple[Table, ...]
    columns: np.ndarray
    gaps: np.ndarray
    pushes: np.ndarray
    stops: np.ndarray
    watched: int

    @property
    def relaxation(self) -> float:
        """Longest relaxation time of the energy, s."""
        return 1.0 / float(self.damping.min())

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Numbers of modes, white noises, tables and pairs."""
        return len(self.squares), self.kicks.shape[1], len(self.tables), len(self.stops)

    def batches(self, paths: int, samples: int) -> tuple[int, int]:
        """Number of batches, and of paths in each, whose records are in memory together."""
        count = math.ceil(paths * samples * len(self.tables) / LARGEST_RECORDS) or 1
        return count, math.ceil(paths / count)

    def records(self, rng: np.random.Generator, paths: int, samples: int, h: float) -> np.ndarray:
        """Gaussian records of the tables, (paths, tables, samples): sums of cosines by FFT."""
        length = scipy.fft.next_fast_len(samples, real=True)
        frequency = np.arange(1, (length + 1) // 2) / (length * h)
        spectra = np.zeros((paths, len(self.tables), length // 2 + 1), complex)
        for number, table in enumerate(self.tables):
            normals = rng.standard_normal((paths, 2 * len(frequency))).view(complex)
            scale = length / 2.0 * np.sqrt(table(frequency) / (length * h))
            spectra[:, number, 1 : 1 + len(frequency)] = scale * normals
        return scipy.fft.irfft(spectra, length, axis=2)[:, :, :samples]


def system_of(scene: sv.Scene, watched: str) -> System:
    """The arrays of a scene between rigid stops whose damping leaves the modes uncoupled."""
    model = model_of(scene)
    modal = model.modal
    damping = np.diag(modal.damping)
    if not np.allclose(modal.damping, np.diag(damping), atol=1e-9 * damping.max()):
        raise ValueError("the damping couples the modes; the others are written for modes apart")
    thresholds = make_plan(model).layout.thresholds
    stops = [
        (
            pair.lower.position if pair.lower else -math.inf,
            pair.upper.position if pair.upper else math.inf,
            pair.stops[0].law.restitution,
            thresholds[pair.name],
        )
        for pair in model.pairs
    ]
    kicks = [math.sqrt(s0) * modal.shapes.T @ direction for s0, direction in model.whites]
    columns = [np.asarray(force) for _, force in modal.tables]
    return System(
        squares=modal.squares,
        damping=damping,
        rest=modal.rest,
        kicks=np.array(kicks).reshape(-1, modal.size).T,
        tables=tuple(table for table, _ in modal.tables),
        columns=np.array(columns).reshape(-1, modal.size).T,
        gaps=modal.gaps,
        pushes=modal.gaps * np.array([[pair.mass] for pair in model.pairs]),
        stops=np.array(stops),
        watched=[pair.name for pair in model.pairs].index(watched),
    )
