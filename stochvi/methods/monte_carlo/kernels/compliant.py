"""One mass with compliant stops under white noise by kick-flow-kick, for many paths at once.

The kick is that of `flight`; the flow is the undamped motion with the forces of the stops. Paths
that stay clear of all stops in a step move together. The engine finishes the step of each of the
others (`one_mass`).

x is measured from the rest position under the load.
"""

import math

import numpy as np

from stochvi.engine.borrowed import borrowed, hold
from stochvi.engine.compiling import kernel
from stochvi.engine.impact_log import page_of
from stochvi.engine.mass_flows import Rotation
from stochvi.engine.one_mass import finish_step
from stochvi.engine.sums import FOUND, ROWS_OF_CONTACT_PAIR
from stochvi.engine.uniform_numbers import word_of_step
from stochvi.methods.monte_carlo.kernels.flight import add_moments, add_noise, normals_of_step
from stochvi.methods.monte_carlo.kernels.lanes import LANES, aligned_rows, row_of, words_of
from stochvi.methods.monte_carlo.kernels.rows import (
    F1_LOWER,
    F1_UPPER,
    N_LOWER,
    VV,
    XX,
    X,
)

F1_OF_LOWER, F1_OF_UPPER = F1_LOWER - N_LOWER, F1_UPPER - N_LOWER
"""Rows of the sums of impact speeds, from the first row of the pair."""


@kernel
def step_clear_paths(x, v, z, near, kick, flow, places):
    """Advance every path that touches no stop by one step; kick and mark the others.

    This holds for w0 h < pi. A mass turns in the step if it moves up before and down after it; its
    orbit then reaches the stop if v^2 + w0^2 x^2 > w0^2 stop^2. `places` (2,) are those of the
    stops, infinite for none. Returns the number of marked paths.
    """
    e, s, _ = kick
    _, cosine, sine, stiff = flow
    lower, upper = places[0], places[1]
    count = 0
    for i in range(x.shape[0]):
        q = x[i]
        p = e * v[i] + s * z[i]
        x1 = cosine * q + sine * p
        v1 = cosine * p - stiff * sine * q
        high = (p > 0.0) & (v1 < 0.0) & (p * p + stiff * (q - upper) * (q + upper) > 0.0)
        low = (p < 0.0) & (v1 > 0.0) & (p * p + stiff * (q - lower) * (q + lower) > 0.0)
        touches = (q > upper) | (x1 >= upper) | high | (q < lower) | (x1 <= lower) | low
        x[i] = q if touches else x1
        v[i] = p if touches else v1
        near[i] = 1.0 if touches else 0.0
        count += 1 if touches else 0
    return count


@kernel
def run_contacts(paths, kick, flow, at, counting, record, log, flag):
    """Advance every path by some steps, and add up those that are counted.

    Parameters
    ----------
    paths : `steps.Paths`, with sums (CONTACT_SUMS, paths); `kept` holds the largest forces so far
        of contacts that last, of the lower and the upper stop.
    kick, flow, counting : `steps.Kick`, `steps.Flow` and `steps.Counting`.
    at : `one_mass.MassStops`.
    record : zeros (steps, paths, 3), which get x, v and the sum of the speeds of first touches of
        every counted step, negative at the lower stop. Without samples there is no record.
    log : None, or an `impact_log.Log`, which gets the first touches in the counted steps that are
        at least as fast as the threshold.
    flag : (1,), looked at before every step: where it is not 0, the paths are given up, without a
        result.
    """
    x, v, streams, sums, noise, kept = paths
    recording = record.shape[0] > 0
    first, last, stride, origin, threshold = counting
    # close together: rows of `sums` would evict one another
    work, words = aligned_rows(10), words_of(aligned_rows(2))
    extra, spare = np.zeros((2, LANES, ROWS_OF_CONTACT_PAIR))
    found, of_block = np.zeros(FOUND), np.zeros((LANES, 2))
    scene, peaks, numbers = borrowed(at), borrowed(of_block), borrowed(found)
    rotation = Rotation(flow.stiff, math.sqrt(flow.stiff))
    for start in range(0, x.shape[0], LANES):
        end = min(start + LANES, x.shape[0])
        n = end - start
        xs, vs, z, z2 = (
            row_of(work, 0, n),
            row_of(work, 1, n),
            row_of(work, 2, n),
            row_of(work, 3, n),
        )
        near, place, power = row_of(work, 4, n), row_of(work, 5, n), row_of(work, 6, n)
        mean, square, speed = row_of(work, 7, n), row_of(work, 8, n), row_of(work, 9, n)
        state0, state1 = row_of(words, 0, n), row_of(words, 1, n)
        for i in range(n):
            xs[i], vs[i] = x[start + i], v[start + i]
            place[i], power[i] = noise[0, start + i], noise[1, start + i]
            state0[i], state1[i] = streams[0, start + i], streams[1, start + i]
            mean[i], square[i] = sums[X, start + i], sums[XX, start + i]
            speed[i] = sums[VV, start + i]
            peaks[i, 0], peaks[i, 1] = kept[start + i, 0], kept[start + i, 1]
            for row in range(ROWS_OF_CONTACT_PAIR):
                extra[i, row] = sums[N_LOWER + row, start + i]
        for step in range(first, last):
            if flag[0] != 0:
                break
            normals_of_step((step - first) % 2 == 1, kick.earlier, state0, state1, z, z2)
            counted = step >= 0
            if counted:
                add_noise(xs, vs, z, place, power)
            count = step_clear_paths(xs, vs, z, near, kick, flow, at.places)
            target = borrowed(extra if counted else spare)
            for i in range(n if count > 0 else 0):
                if near[i] != 0.0:
                    before = target[i, F1_OF_UPPER] - target[i, F1_OF_LOWER]
                    xs[i], vs[i] = finish_step(
                        rotation, xs[i], vs[i], flow.step, scene, threshold, peaks, target, i,
                        word_of_step(state0[i], step), numbers,
                        page_of(log, start + i, step, flow.step),
                    )  # fmt: skip
                    if recording:
                        after = target[i, F1_OF_UPPER] - target[i, F1_OF_LOWER]
                        record[step, start + i, 2] = after - before
            if counted:
                if step % stride == 0:
                    add_moments(xs, vs, origin, mean, square, speed)
                if recording:
                    for i in range(n):
                        record[step, start + i, 0] = xs[i]
                        record[step, start + i, 1] = vs[i]
        for i in range(n):
            x[start + i], v[start + i] = xs[i], vs[i]
            noise[0, start + i], noise[1, start + i] = place[i], power[i]
            streams[0, start + i], streams[1, start + i] = state0[i], state1[i]
            sums[X, start + i], sums[XX, start + i] = mean[i], square[i]
            sums[VV, start + i] = speed[i]
            kept[start + i, 0], kept[start + i, 1] = peaks[i, 0], peaks[i, 1]
            for row in range(ROWS_OF_CONTACT_PAIR):
                sums[N_LOWER + row, start + i] = extra[i, row]
    hold((at, found, of_block, extra, spare))
