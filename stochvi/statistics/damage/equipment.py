"""Equipment on a vibrating place: oscillators of one quality Q over a band of frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.quadrature import gauss_legendre
from stochvi.methods.monte_carlo.kernels.equipment import (
    BEFORE,
    LANES,
    NODES,
    equipment_response,
)
from stochvi.sampling.stop_flag import check_flag

Records = NDArray[np.float64]

SAMPLES_PER_PERIOD = 8.0
"""Smallest number of samples in a period of the fastest equipment. Accelerations at that frequency
then lose 0.1 % between samples, and peaks 0.06 %."""

MEMORY = 8.0
"""Time after which equipment has forgotten its start, in time constants 2 Q / w: it is exp(-8) of
what it was."""

OVERSHOOT = 1.02
"""Bound on peaks between samples that are not those of the free motion."""

HOLD_NODES = 12
"""Gauss-Legendre nodes by which the response to a polynomial over one step is integrated."""


class EquipmentRecords(NamedTuple):
    """Responses of equipment on records of acceleration.

    Parameters
    ----------
    squares
        (paths, equipment): mean square of the absolute acceleration of the equipment, (m/s^2)^2.
    damage, closing, halving
        (paths, equipment): damage of each record, (m/s)^exponent, with half cycles where the record
        does not close them (ASTM E1049); what it has more if the record repeats itself; and what
        its two halves, each repeated, have more than the whole.
    peaks
        (paths, windows, equipment): largest absolute acceleration in each window, m/s^2.
    """

    squares: Matrix
    damage: Matrix
    closing: Matrix
    halving: Matrix
    peaks: Records


@dataclass(frozen=True)
class Equipment:
    """Oscillators on a place that moves, z'' + (w / Q) z' + w^2 z = -a.

    Their response is the absolute acceleration y = a + z''; their stress is proportional to the
    pseudo-velocity w z.

    Parameters
    ----------
    frequency_hz
        Natural frequencies, Hz.
    quality
        Q, above 0.5.
    exponent
        Exponent b of Miner's sum over rainflow cycles, D = sum S^b with the amplitude S of the
        pseudo-velocity, m/s.

    Examples
    --------
    >>> found = Equipment((50.0, 100.0), 10.0, 6.0)
    >>> round(found.memory, 3), round(found.longest_step, 6)
    (0.509, 0.00125)
    """

    frequency_hz: tuple[float, ...]
    quality: float
    exponent: float

    @cached_property
    def omega(self) -> Vector:
        """Natural frequencies, rad/s."""
        return 2.0 * math.pi * np.array(self.frequency_hz)

    @property
    def memory(self) -> float:
        """Time after which the slowest equipment has forgotten its start, s."""
        return MEMORY * 2.0 * self.quality / float(self.omega.min())

    @property
    def longest_step(self) -> float:
        """Longest sampling interval that resolves the fastest equipment, s."""
        return 1.0 / (SAMPLES_PER_PERIOD * max(self.frequency_hz))

    def passes(self, step: float) -> Matrix:
        """Coefficients of a step for `equipment_response`, (20, equipment), time in steps."""
        w, decay = self.omega * step, self.omega * step / (2.0 * self.quality)
        ringing = np.sqrt(w**2 - decay**2)

        def free(time: float) -> tuple[Vector, Vector, Vector, Vector]:
            fall, cosine, sine = (
                np.exp(-decay * time), np.cos(ringing * time), np.sin(ringing * time) / ringing,
            )  # fmt: skip
            return (
                fall * (cosine + decay * sine), fall * sine,
                -fall * w**2 * sine, fall * (cosine - decay * sine),
            )  # fmt: skip

        nodes, weights = gauss_legendre(HOLD_NODES)
        places = np.arange(NODES) - BEFORE
        pushed = np.zeros((2, NODES, len(w)))
        for node, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
            _, moved, _, turned = free(1.0 - node)
            for number, place in enumerate(places):
                others = np.delete(places, number)
                share = float(np.prod((node - others) / (place - others)))
                pushed[:, number] -= weight * share * np.stack([moved, turned])
        margin = OVERSHOOT / np.cos(np.minimum(0.5 * w, 1.0))
        scales = np.stack([2.0 * decay, w**2, margin, self.omega * step**2])
        return np.concatenate([np.stack(free(1.0)), *pushed, scales])

    def respond(
        self, accelerations: Matrix, step: float, first: int, window: int, windows: int = 1,
        jumps: Matrix | None = None,
    ) -> EquipmentRecords:  # fmt: skip
        """Responses to records of acceleration (paths, samples), m/s^2, that begin at rest.

        Parameters
        ----------
        step
            Sampling interval, s.
        first, window, windows
            The response is counted from the sample `first` on, over so many windows of so many
            samples.
        jumps
            (paths, samples): sudden changes of the velocity of the place at the samples, m/s.
        """
        paths, count = len(accelerations), len(self.frequency_hz)
        needed = first + window * windows + NODES - BEFORE - 1
        if first < BEFORE or accelerations.shape[1] < needed:
            raise AssertionError(f"{accelerations.shape[1]} samples, {needed} are needed")
        groups = -(-count // LANES)
        passes = np.pad(self.passes(step), ((0, 0), (0, groups * LANES - count)), mode="edge")
        changes = None if jumps is None else np.ascontiguousarray(jumps) / step
        found: list[tuple[Records, ...]] = []
        for group in np.split(passes, groups, axis=1):
            sums, peaks = np.zeros((4, paths, LANES)), np.zeros((paths, windows, LANES))
            equipment_response(
                np.ascontiguousarray(accelerations), changes, first, window,
                np.ascontiguousarray(group), self.exponent, *sums, peaks,
            )  # fmt: skip
            check_flag()
            found.append((sums[0] / (window * windows), *sums[1:], peaks))
        return EquipmentRecords(
            *(np.concatenate(part, axis=-1)[..., :count] for part in zip(*found, strict=True))
        )
