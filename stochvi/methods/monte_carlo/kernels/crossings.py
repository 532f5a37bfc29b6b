"""Time since the last exceedance before an outcrossing of a stationary Gaussian process.

Given that the gap y_c crosses the level u upwards at t = 0 with the slope p, the gaps y_j of a
stationary Gaussian vector process are (D. Slepian 1963)

    y_j(t) = u rho_j(t) + p eta_j(t) + z_j(t),
    rho_j = E[y_j(t) y_c(0)] / E y_c^2,    eta_j = E[y_j(t) y_c'(0)] / E y_c'^2

The residual z does not depend on u and p: it is any record x of the process less its regression on
x_c(0) and x_c'(0), z_j(t) = x_j(t) - x_c(0) rho_j(t) - x_c'(0) eta_j(t). Between the samples a gap
is the cubic through values and slopes. A crossing of a lower stop is that of an upper one by the
process with the opposite sign, which has the same law: its stops change sides.

Beside sines or shocks a gap is y_j + m_j, where m_j is the sum of these. The noise alone then
crosses the level u - m_c with the slope p - m_c'. Both are those at the phases of the sines, or at
the ages and sizes of the shocks (`mathematics.moving_means`).

Symbols: shape holds rho, rho', eta, eta' at 0, -span, -2 span, ...
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel
from stochvi.engine.roots import cubic_maximum

TIE = 1e-9
"""Relative distance from a stop up to which two gaps reach their stops at the same time."""


class StatesAtCrossings(NamedTuple):
    """What sines or shocks beside the noise make of crossings.

    Parameters
    ----------
    places, slopes : (levels, paths, starts), level and slope of the noise alone.
    states : (levels, paths, starts, numbers), phases of sines, or ages and sizes of shocks.
    """

    places: NDArray[np.float64]
    slopes: NDArray[np.float64]
    states: NDArray[np.float64]


class Waves(NamedTuple):
    """Sines: frequencies (sines,), rad/s, and complex amplitudes of each gap (gaps, sines)."""

    omega: NDArray[np.float64]
    real: NDArray[np.float64]
    imaginary: NDArray[np.float64]


class ShockResponses(NamedTuple):
    """Displacements and velocities (gaps, samples, 2) after a shock of size 1, at the sampling
    interval of the records."""

    table: NDArray[np.float64]


@kernel
def exceeds(x0, v0, x1, v1, span, near, far, newest):
    """Whether the cubic reaches `near` above or -`far` below.

    The newest interval ends on `near` itself, so that its maximum does not count.
    """
    if x0 >= near or x0 <= -far:
        return True
    if v0 > 0.0 and v1 < 0.0 and not newest:
        return cubic_maximum(x0, v0, x1, v1, span) >= near
    if v0 < 0.0 and v1 > 0.0:
        return cubic_maximum(-x0, -v0, -x1, -v1, span) >= far
    return False


@kernel
def is_outside(x, near, far, before):
    """Whether another gap is beyond a stop at the moment of the crossing.

    Of gaps that reach their stops at the same time, the first one counts as the one that crosses:
    `before` says whether this gap comes before the one that crosses.
    """
    shift = -TIE if before else TIE
    return x >= near * (1.0 + shift) or x <= -far * (1.0 + shift)


@kernel
def last_exceedance(x, v, shape, u, span, stride, near, far, crosses, most):
    """Number of the newest interval before the crossing in which one gap reaches a stop; `most`
    where it does not in the intervals before that.

    `x` and `v` (n + 1,) are the gap less its part that is proportional to u, `shape` (n + 1, 4) is
    as below, and `crosses` says whether this gap is the one that crosses.
    """
    x0, v0 = x[0] + u * shape[0, 0], v[0] + u * shape[0, 1]
    for k in range(0, most, stride):
        older = k + stride
        x1, v1 = x0, v0
        x0, v0 = x[older] + u * shape[older, 0], v[older] + u * shape[older, 1]
        if exceeds(x0, v0, x1, v1, stride * span, near, far, crosses and k == 0):
            return k
    return most


@kernel
def look_back(record, start, away, change, shape, stride, x, v):
    """Fill `x` and `v` (gaps, n + 1) with x_j + away rho_j + change eta_j and its slope, at the
    samples before a crossing."""
    for k in range(0, shape.shape[1], stride):
        sample = (start - k) % record.shape[0]
        for j in range(shape.shape[0]):
            row = shape[j, k]
            x[j, k] = record[sample, 2 * j] + away * row[0] + change * row[2]
            v[j, k] = record[sample, 2 * j + 1] + away * row[1] + change * row[3]


@kernel
def add_sines(sines, phases, span, stride, x, v):
    """Add the sines of all gaps to `x` and `v` (gaps, n + 1), at the samples before a crossing at
    which they have these phases."""
    for s in range(sines.omega.shape[0]):
        omega = sines.omega[s]
        for k in range(0, x.shape[1], stride):
            phase = phases[s] - omega * span * k
            c, d = np.cos(phase), np.sin(phase)
            for j in range(x.shape[0]):
                a, b = sines.real[j, s], sines.imaginary[j, s]
                x[j, k] += a * c - b * d
                v[j, k] -= omega * (a * d + b * c)


@kernel
def add_shocks(responses, state, span, stride, x, v):
    """Add the shocks with these ages and sizes at a crossing to `x` and `v` (gaps, n + 1), at the
    samples before it."""
    table = responses.table
    for shock in range(state.shape[0] // 2):
        age, size = state[2 * shock], state[2 * shock + 1]
        if size == 0.0:
            continue
        first = int(np.floor(age / span))
        s = age / span - first
        # the cubic of values and slopes at the share s of an interval
        from0, from1 = 1.0 + s * s * (2.0 * s - 3.0), s * s * (3.0 - 2.0 * s)
        of0, of1 = span * s * (1.0 - s) ** 2, span * s * s * (s - 1.0)
        slope, at0, at1 = 6.0 * s * (s - 1.0) / span, 1.0 + s * (3.0 * s - 4.0), s * (3.0 * s - 2.0)
        for k in range(0, x.shape[1], stride):
            place = first - k
            if place < 0:
                break
            if place + 1 < table.shape[1]:
                for j in range(x.shape[0]):
                    x0, v0 = table[j, place]
                    x1, v1 = table[j, place + 1]
                    x[j, k] += size * (from0 * x0 + from1 * x1 + of0 * v0 + of1 * v1)
                    v[j, k] += size * (slope * (x0 - x1) + at0 * v0 + at1 * v1)


@kernel
def outcrossing_ages(
    records, starts, slopes, shape, crossing, span, stride, near, far, states, sines, shocks, ages
):  # fmt: skip
    """Time in s from the end of the last exceedance of any stop to an outcrossing of near[:, c].

    Parameters
    ----------
    records : (paths, samples, 2 gaps), each x_j followed by x_j', of stationary records that are
        periodic in time.
    starts : (starts,), the samples at which the outcrossings are placed.
    slopes : (paths, starts), slopes p > 0 of the crossings; of no use with `states`.
    shape : (gaps, n + 1, 4), as above; `stride` divides n.
    crossing : number c of the gap that crosses its stop.
    span, stride : sampling interval in s, and number of intervals that one cubic spans.
    near, far : (levels, gaps), distances of the stops on the side that is crossed and on the other
        one; infinite for none.
    states : None, or `StatesAtCrossings`, with `sines`, `Waves`, or `shocks`, `ShockResponses`;
        None where there are none.
    ages : (levels, paths, starts), replaced; n span where there was no exceedance, 0 where another
        gap is beyond a stop at the crossing, or where the gap that crosses has no such stop.
    """
    gaps, count = shape.shape[0], shape.shape[1] - 1
    x, v = np.empty((gaps, count + 1)), np.empty((gaps, count + 1))
    for path in range(records.shape[0]):
        for i in range(starts.shape[0]):
            record, start = records[path], starts[i]
            if states is None:
                change = slopes[path, i] - record[start, 2 * crossing + 1]
                look_back(record, start, -record[start, 2 * crossing], change, shape, stride, x, v)
            for level in range(near.shape[0]):
                u = near[level, crossing]
                found = np.isinf(u)
                if states is not None and not found:
                    away = states.places[level, path, i] - record[start, 2 * crossing]
                    change = states.slopes[level, path, i] - record[start, 2 * crossing + 1]
                    look_back(record, start, away, change, shape, stride, x, v)
                    if sines is not None:
                        add_sines(sines, states.states[level, path, i], span, stride, x, v)
                    if shocks is not None:
                        add_shocks(shocks, states.states[level, path, i], span, stride, x, v)
                    u = 0.0
                for j in range(gaps):
                    if j != crossing and not found:
                        here = x[j, 0] + u * shape[j, 0, 0]
                        found = is_outside(here, near[level, j], far[level, j], j < crossing)
                if found:
                    ages[level, path, i] = 0.0
                    continue
                newest = count
                # the gap that crosses is the one most likely to have been near its stop before
                for order in range(gaps):
                    j = (crossing + order) % gaps
                    if np.isfinite(near[level, j]) or np.isfinite(far[level, j]):
                        newest = last_exceedance(
                            x[j], v[j], shape[j], u, span, stride, near[level, j], far[level, j],
                            j == crossing, newest,
                        )  # fmt: skip
                unseen = newest == count
                ages[level, path, i] = count * span if unseen else (newest + 0.5 * stride) * span


@kernel
def motions_around(
    records, paths, starts, stride, shape, away, change, signs, scale, motion
):  # fmt: skip
    """Fill `motion` with the modes around crossings, x_m(t) + away rho_m(t) + change eta_m(t).

    Parameters
    ----------
    records : (paths, samples, 2 modes), as above, of all modes.
    paths, starts : (crossings,), path and sample of each crossing.
    stride : number of samples from one step of the motion to the next.
    shape : (n, modes, 4), rho, rho', eta and eta' of the modes from one step before the crossing.
    away, change : (crossings,), u - x_c(0) and p - x_c'(0).
    signs : (crossings,), -1 where the motion is turned over, else 1.
    scale : rad/s, by which velocities are divided.
    motion : (n, modes, 2 crossings), replaced: values, and slopes over `scale`, in turn, from the
        crossing on; the last step is the one before it.
    """
    count, modes = shape.shape[0], shape.shape[1]
    samples = records.shape[1]
    for k in range(count):
        for m in range(modes):
            row, (rho, rho_rate, eta, eta_rate) = motion[k - 1, m], shape[k, m]
            for i in range(paths.shape[0]):
                here = records[paths[i], (starts[i] + stride * (k - 1)) % samples]
                value = here[2 * m] + away[i] * rho + change[i] * eta
                rate = here[2 * m + 1] + away[i] * rho_rate + change[i] * eta_rate
                row[2 * i] = signs[i] * value
                row[2 * i + 1] = signs[i] * rate / scale
