"""The motion of gaps of a linear structure under measured records, where nothing is hit.

A structure q'' + B q' + K q = f has 2 n poles l_j, one or two for each mode, and

    gap = sum_j c_j z_j,    z_j' = l_j z_j + e_j . f.

Every z_j is moved in exact steps. Forces are linear between their samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import ztbtrs

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.frequency_response import Force, InputMatrix
from stochvi.model.model import Model

LARGEST_ANGLE = 0.1
"""Fastest natural frequency times the longest step of a response, rad: the cubics between its
samples are off by less than this to the power 4 over 384, 3e-7 of the response."""

MOST_STEPS = 2**24
"""Largest number of steps of all modes. Where the angle would take more, steps are longer, of many
samples as long as their distance: of the fastest modes the cubics then miss more."""

CONDITION, SPLIT = 1e8, 1e-9
"""Condition number of the poles' shapes above which poles count as equal, as those of a critically
damped mode; and the share by which stiffnesses are then raised, so that poles lie apart. Motions
change by about this share."""

SHORT, TERMS = 0.5, 16
"""Size of a pole times a step up to which a series serves, and number of its terms."""


class FreeResponse(NamedTuple):
    """Displacement of a gap from its mean where nothing is hit (m): at the samples, and the
    extremes, between samples too."""

    displacement: Vector
    highest: float
    lowest: float


@dataclass(frozen=True, eq=False)
class GapPoles:
    """The poles of a structure, and how forces move its gaps.

    Parameters
    ----------
    poles
        (2 n,), 1/s.
    shapes
        (gaps, 2 n): c_j of each gap.
    entries
        (2 n, n): e_j, for forces on the coordinates.
    naturals, widths
        (n,): natural frequencies, and half-power bandwidths of the modes, rad/s; a bandwidth is at
        most the natural frequency.
    """

    poles: Waves
    shapes: Waves
    entries: Waves
    naturals: Vector
    widths: Vector

    @classmethod
    def of(cls, model: Model, directions: Matrix, least_damping: float = 0.0) -> GapPoles:
        """Those of a model for gaps along `directions` (gaps, n). With a `least_damping` ratio its
        modes are damped at least so, each alone.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the shapes of the poles cannot be found.
        """
        modes = model.modal
        n, naturals, damping = modes.size, np.sqrt(modes.squares), modes.damping
        if least_damping:
            damping = np.diag(np.maximum(np.diag(damping), 2.0 * least_damping * naturals))
        poles, shapes = _eigen(modes.squares, damping, 1.0)
        if np.linalg.cond(shapes) > CONDITION:
            poles, shapes = _eigen(modes.squares, damping, 1.0 + SPLIT)
        pushed = np.linalg.inv(shapes)[:, n:]
        return cls(
            poles=poles,
            shapes=(directions @ modes.shapes) @ shapes[:n],
            entries=pushed @ modes.shapes.T,
            naturals=naturals,
            widths=np.minimum(np.diag(damping), naturals),
        )

    @property
    def settles(self) -> bool:
        """Whether springs and dampers hold the structure, so that every motion dies out."""
        return bool(np.all(self.poles.real < 0.0))

    def gain(self, frequency_hz: Vector, force: Force, gap: int) -> Waves:
        """Frequency response (frequencies,) of one gap to a force (n,) per unit of its source."""
        pushed = force(frequency_hz) if isinstance(force, InputMatrix) else force[None]
        found = np.zeros(len(frequency_hz), complex)
        for pole, shape, entry in zip(self.poles, self.shapes[gap], self.entries, strict=True):
            found += shape * (pushed @ entry) / (2j * math.pi * frequency_hz - pole)
        return found

    def response(self, forces: Matrix, step: float) -> list[FreeResponse]:
        """The motion of every gap from rest under forces (samples, n), N, `step` seconds apart.

        Between samples of a gap and its rate lie cubics. `replay` without stops is the same by
        another method, whose kernel has to be compiled first.
        """
        last = len(forces) - 1
        parts = math.ceil(self.naturals.max() * step / LARGEST_ANGLE)
        parts = max(min(parts, MOST_STEPS // (len(forces) * len(self.naturals))), 1)
        at = np.arange(parts * last + 1) / parts
        x, v = np.zeros((2, len(self.shapes), len(at)))
        for pole, shape, entry in zip(self.poles, self.shapes.T, self.entries, strict=True):
            if pole.imag < 0.0:
                continue
            pushed = forces @ entry
            fine = np.interp(at, np.arange(last + 1), pushed)
            z = _moved(pole, fine, step / parts)
            # the conjugate pole adds the conjugate motion
            weight = shape * (2.0 if pole.imag > 0.0 else 1.0)
            x += np.outer(weight.real, z.real) - np.outer(weight.imag, z.imag)
            weight = weight * pole
            v += np.outer(weight.real, z.real) - np.outer(weight.imag, z.imag)
        found = []
        for place, speed in zip(x, v, strict=True):
            reached = np.concatenate([place, _turning_points(place, speed, step / parts)])
            found.append(FreeResponse(place[::parts], float(reached.max()), float(reached.min())))
        return found


def _eigen(squares: Vector, damping: Matrix, stiffer: float) -> tuple[Waves, Waves]:
    """Poles, and their shapes as displacements and velocities (2 n, poles)."""
    n = len(damping)
    generator = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffer * np.diag(squares), -damping]])
    poles, shapes = np.linalg.eig(generator)
    return poles.astype(complex), shapes.astype(complex)


def _moved(pole: complex, push: Waves, step: float) -> Waves:
    """z of z' = pole z + push from rest, the push linear between its samples."""
    early, late = _weights(pole * step)
    driven = np.zeros(len(push), complex)
    driven[1:] = step * ((early - late) * push[:-1] + late * push[1:])
    # a triangular band is solved from its first row on; a filter of scipy.signal would do the same,
    # but takes half a second to import
    band = np.ones((2, len(push)), complex)
    band[1] = -np.exp(pole * step)
    return np.asarray(ztbtrs(band, driven[:, None], uplo="L")[0][:, 0])


def _weights(turned: complex) -> tuple[complex, complex]:
    """phi_1 and phi_2 of a pole times a step: int_0^1 exp(p (1 - s)) ds, and the same times s.

    >>> early, late = _weights(0.0)
    >>> early.real, late.real
    (1.0, 0.5)
    """
    if abs(turned) > SHORT:
        early = (np.exp(turned) - 1.0) / turned
        return early, (early - 1.0) / turned
    early = sum(turned**k / math.factorial(k + 1) for k in range(TERMS))
    return complex(early), complex(sum(turned**k / math.factorial(k + 2) for k in range(TERMS)))


def _turning_points(x: Vector, v: Vector, h: float) -> Vector:
    """Extremes, between samples, of the cubics through x and x'."""
    turning = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    x0, x1, v0, v1 = x[turning], x[turning + 1], h * v[turning], h * v[turning + 1]
    # x0 + v0 t + p t^2 + q t^3 for t from 0 to 1
    p, q = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
    # the root of v0 + 2 p t + 3 q t^2 between ends of different signs, without cancellation
    root = np.sqrt(np.maximum(p**2 - 3.0 * q * v0, 0.0))
    t = v0 / (-p + np.sign(v0) * root)
    return np.asarray(x0 + t * (v0 + t * (p + t * q)))
