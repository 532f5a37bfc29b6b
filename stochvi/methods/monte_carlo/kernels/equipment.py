"""Oscillators that stand on sampled accelerations: their peaks, rainflow cycles and mean squares.

An oscillator of the frequency w (rad/s) and the quality Q on a base with the acceleration a:

    z'' + (w / Q) z' + w^2 z = -a          y = a + z'' = -(w / Q) z' - w^2 z

z is its relative displacement, y its absolute acceleration, w z its pseudo-velocity. Over a step
it follows, exactly, the polynomial through the NODES samples of a around the step. A sudden change
of the velocity of the base by J changes z' by -J. Turning points of z and peaks of y between
samples are those of the cubic through values and slopes.

Oscillators go in groups of LANES. Symbols: `motion` holds z, z' and y at samples (samples + 1, 3,
LANES). `passes` (20, LANES) holds the rows Phi11, Phi12, Phi21, Phi22 of the free motion over a
step. The weights of the samples in z follow, those in z', and the rows DRAG to SCALE.
"""

import math

import numpy as np

from stochvi.engine.compiling import kernel
from stochvi.engine.roots import cubic_maximum

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
