"""Kernels that read records. Chapters: time since the last exceedance before an outcrossing;
oscillators that stand on sampled accelerations, with peaks, rainflow cycles and mean squares."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import cubic_maximum
from stochvi.engine.compiling import kernel

# ------------------------------------------------------------------------------
# Time since the last exceedance before an outcrossing of a stationary Gaussian process.
#
# Given that the gap y_c crosses the level u upwards at t = 0 with the slope p, the gaps y_j of a
# stationary Gaussian vector process are (D. Slepian 1963)
#
#     y_j(t) = u rho_j(t) + p eta_j(t) + z_j(t),
#     rho_j = E[y_j(t) y_c(0)] / E y_c^2,    eta_j = E[y_j(t) y_c'(0)] / E y_c'^2
#
# The residual z does not depend on u and p: it is any record x of the process less its regression
# on x_c(0) and x_c'(0), z_j(t) = x_j(t) - x_c(0) rho_j(t) - x_c'(0) eta_j(t). Between the samples a
# gap is the cubic through values and slopes. A crossing of a lower stop is that of an upper one by
# the process with the opposite sign, which has the same law: its stops change sides.
#
# Beside sines or shocks a gap is y_j + m_j, where m_j is the sum of these. The noise alone then
# crosses the level u - m_c with the slope p - m_c'. Both are those at the phases of the sines, or
# at the ages and sizes of the shocks (`mathematics.unsteady_noise`).
#
# Symbols: shape holds rho, rho', eta, eta' at 0, -span, -2 span, ...
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Oscillators that stand on sampled accelerations: their peaks, rainflow cycles and mean squares.
#
# An oscillator of the frequency w (rad/s) and the quality Q on a base with the acceleration a:
#
#     z'' + (w / Q) z' + w^2 z = -a          y = a + z'' = -(w / Q) z' - w^2 z
#
# z is its relative displacement, y its absolute acceleration, w z its pseudo-velocity. Over a step
# it follows, exactly, the polynomial through the NODES samples of a around the step. A sudden
# change of the velocity of the base by J changes z' by -J. Turning points of z and peaks of y
# between samples are those of the cubic through values and slopes.
#
# Oscillators go in groups of LANES. Symbols: `motion` holds z, z' and y at samples (samples + 1, 3,
# LANES). `passes` (20, LANES) holds the rows Phi11, Phi12, Phi21, Phi22 of the free motion over a
# step. The weights of the samples in z follow, those in z', and the rows DRAG to SCALE.
# ------------------------------------------------------------------------------


NODES, BEFORE = 6, 2
"""Number of samples of the polynomial of a step, and how many of them lie before the step."""

AT_ONCE = 256
"""Number of samples whose motion is kept, and then searched for turning points."""

STACK = 4096
"""Largest number of turning points that wait for their cycle; beyond it the oldest count as half
cycles."""

LANES = 8
"""Number of oscillators that are followed side by side."""

DRAG, SQUARE, MARGIN, SCALE = 16, 17, 18, 19
"""Rows of `passes` behind the coefficients of a step: w / Q and w^2, times the step and its square;
bound on |y| between samples over that at the samples; scale from z to the pseudo-velocity w z."""


@kernel
def pass_samples(a, jump, first, count, motion, passes, squares, peaks):
    """Motion of a group of oscillators over `count` steps from the sample `first` on, whose motion
    is row 0; adds y^2 to `squares` and raises `peaks` to it.

    Loops of a known length over arrays of one shape are what compilers turn into vectors.
    """
    for k in range(count):
        here = first + k - BEFORE
        a0, a1, a2 = a[here], a[here + 1], a[here + 2]
        a3, a4, a5 = a[here + 3], a[here + 4], a[here + 5]
        for i in range(LANES):
            motion[k + 1, 0, i] = (
                passes[0, i] * motion[k, 0, i] + passes[1, i] * motion[k, 1, i]
                + (passes[4, i] * a0 + passes[5, i] * a1 + passes[6, i] * a2)
                + (passes[7, i] * a3 + passes[8, i] * a4 + passes[9, i] * a5)
            )  # fmt: skip
        for i in range(LANES):
            motion[k + 1, 1, i] = (
                passes[2, i] * motion[k, 0, i] + passes[3, i] * motion[k, 1, i]
                + (passes[10, i] * a0 + passes[11, i] * a1 + passes[12, i] * a2)
                + (passes[13, i] * a3 + passes[14, i] * a4 + passes[15, i] * a5)
            )  # fmt: skip
        if jump is not None:
            change = jump[first + k + 1]
            if change != 0.0:
                for i in range(LANES):
                    motion[k + 1, 1, i] -= change
        for i in range(LANES):
            y = -passes[DRAG, i] * motion[k + 1, 1, i] - passes[SQUARE, i] * motion[k + 1, 0, i]
            motion[k + 1, 2, i] = y
            squares[i] += y * y
            peaks[i] = y * y if y * y > peaks[i] else peaks[i]


@kernel
def highest_peak(a, jump, first, count, motion, i, drag, square):
    """Largest |y| of one oscillator over these steps, between samples too."""
    found = 0.0
    for k in range(count):
        y0, y1, v1 = motion[k, 2, i], motion[k + 1, 2, i], motion[k + 1, 1, i]
        if jump is not None:
            v1 += jump[first + k + 1]
            y1 -= drag * jump[first + k + 1]
        found = max(found, abs(y0), abs(y1))
        rate0 = -drag * (y0 - a[first + k]) - square * motion[k, 1, i]
        rate1 = -drag * (y1 - a[first + k + 1]) - square * v1
        if rate0 * rate1 < 0.0:
            found = max(found, cubic_maximum(y0, rate0, y1, rate1, 1.0))
            found = max(found, cubic_maximum(-y0, -rate0, -y1, -rate1, 1.0))
    return found


@kernel
def cycle_damage(span, exponent):
    """Damage of one cycle of the range `span`, the amplitude to the power of the exponent."""
    return (0.5 * span) ** exponent


@kernel
def count_turn(value, stack, depth, exponent):
    """Add a turning point; returns the number of those that wait, and the damage of the cycles that
    it closes (four-point rule of rainflow counting)."""
    closed = 0.0
    if depth == STACK:
        closed += 0.5 * cycle_damage(abs(stack[1] - stack[0]), exponent)
        for j in range(1, depth):
            stack[j - 1] = stack[j]
        depth -= 1
    stack[depth] = value
    depth += 1
    while depth >= 4:
        inner = abs(stack[depth - 2] - stack[depth - 3])
        after, before = abs(value - stack[depth - 2]), abs(stack[depth - 3] - stack[depth - 4])
        if inner > after or inner > before:
            break
        closed += cycle_damage(inner, exponent)
        stack[depth - 3] = value
        depth -= 2
    return depth, closed


@kernel
def add_turn(value, stacks, depths, sums, counts, i, exponent):
    """Add a turning point to the first `counts` of the counts of one oscillator."""
    for n in range(counts):
        depths[n, i], closed = count_turn(value, stacks[n, i], depths[n, i], exponent)
        sums[n, i] += closed


@kernel
def count_turns(jump, first, count, motion, i, stacks, depths, sums, counts, scale, exponent):
    """Count the turning points of one oscillator over these steps, of `scale` times z."""
    for k in range(count):
        v0, v1 = motion[k, 1, i], motion[k + 1, 1, i]
        step = 0.0
        if jump is not None:
            step = jump[first + k + 1]
            v1 += step
        if v0 > 0.0 and v1 < 0.0:
            turn = cubic_maximum(motion[k, 0, i], v0, motion[k + 1, 0, i], v1, 1.0)
            add_turn(scale * turn, stacks, depths, sums, counts, i, exponent)
        elif v0 < 0.0 and v1 > 0.0:
            turn = -cubic_maximum(-motion[k, 0, i], -v0, -motion[k + 1, 0, i], -v1, 1.0)
            add_turn(scale * turn, stacks, depths, sums, counts, i, exponent)
        if step != 0.0 and v1 * motion[k + 1, 1, i] < 0.0:
            add_turn(scale * motion[k + 1, 0, i], stacks, depths, sums, counts, i, exponent)


@kernel
def open_cycles(stack, depth, again, exponent):
    """Damage of the turning points that wait for their cycle: each range as half a cycle, and that
    of the cycles that they close where the record repeats itself. `again` is memory."""
    halves, closed, waiting = 0.0, 0.0, 0
    for j in range(1, depth):
        halves += 0.5 * cycle_damage(abs(stack[j] - stack[j - 1]), exponent)
    for _ in range(2):
        for j in range(depth):
            # where the record begins again, an end that does not turn is passed over
            if (
                waiting > 1
                and (again[waiting - 1] - again[waiting - 2]) * (stack[j] - again[waiting - 1])
                >= 0.0
            ):
                waiting -= 1
            waiting, more = count_turn(stack[j], again, waiting, exponent)
            closed += more
    return halves, closed


@kernel
def equipment_response(
    accelerations, jumps, first, window, passes, exponent, squares, damage, closing, halving, peaks
):
    """Responses of a group to records (paths, samples), from rest at the sample BEFORE; counted
    from the sample `first` on, in windows of so many samples.

    Time is in steps. `jumps` are the sudden changes of the velocity of the base at the samples,
    times the step as all velocities here are; None where there are none. Results are (paths,
    LANES): `squares`, sums of y^2; `damage`, with half cycles at the end; `closing`, what it has
    more if the record repeats itself; and `halving`, what both halves of it have then more than the
    whole. And `peaks` (paths, windows, LANES), largest |y|.
    """
    motion = np.empty((AT_ONCE + 1, 3, LANES))
    stacks, sums, again = np.empty((2, LANES, STACK)), np.zeros((2, LANES)), np.empty(STACK)
    depths = np.zeros((2, LANES), np.int64)
    unused, chunk = np.zeros(LANES), np.zeros(LANES)
    for path in range(len(accelerations)):
        a = accelerations[path]
        jump = None if jumps is None else jumps[path]
        motion[0] = 0.0
        depths[:], sums[:], counts = 0, 0.0, 1
        place = BEFORE
        while place < first:
            count = min(AT_ONCE, first - place)
            pass_samples(a, jump, place, count, motion, passes, unused, chunk)
            motion[0] = motion[count]
            place += count
        for number in range(peaks.shape[1]):
            tops = peaks[path, number]
            if number and number == peaks.shape[1] // 2:
                counts = 2  # the second one counts from here on
                for i in range(LANES):
                    _, closed = open_cycles(stacks[0, i], depths[0, i], again, exponent)
                    halving[path, i] = sums[0, i] + closed
            end = first + (number + 1) * window
            while place < end:
                count = min(AT_ONCE, end - place)
                chunk[:] = 0.0
                pass_samples(a, jump, place, count, motion, passes, squares[path], chunk)
                for i in range(LANES):
                    count_turns(
                        jump, place, count, motion, i, stacks, depths, sums, counts,
                        passes[SCALE, i], exponent,
                    )  # fmt: skip
                    if passes[MARGIN, i] * math.sqrt(chunk[i]) > tops[i]:
                        highest = highest_peak(
                            a, jump, place, count, motion, i, passes[DRAG, i], passes[SQUARE, i]
                        )
                        tops[i] = max(tops[i], highest)
                motion[0] = motion[count]
                place += count
        for i in range(LANES):
            halves, closed = open_cycles(stacks[0, i], depths[0, i], again, exponent)
            damage[path, i] = sums[0, i] + halves
            closing[path, i] = closed - halves
            if counts == 2:
                _, second = open_cycles(stacks[1, i], depths[1, i], again, exponent)
                halving[path, i] += sums[1, i] + second - sums[0, i] - closed
