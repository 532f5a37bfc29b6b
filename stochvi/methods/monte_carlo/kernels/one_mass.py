"""One mass with compliant stops under white noise. Chapters: paths of one length; missions until
their event."""

import math

import numpy as np

from stochvi.engine.arithmetic import (
    ENDED,
    FOUND,
    PEAK,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    page_of,
    word_of_step,
)
from stochvi.engine.borrowed import borrowed, hold
from stochvi.engine.compiling import kernel
from stochvi.engine.one_mass import finish_step
from stochvi.methods.monte_carlo.kernels.flight import (
    F1_LOWER,
    F1_UPPER,
    N_LOWER,
    VV,
    XX,
    X,
    add_moments,
    add_noise,
    normals_of_step,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import (
    LANES,
    aligned_rows,
    normal_pairs,
    row_of,
    words_of,
)

# ------------------------------------------------------------------------------
# One mass with compliant stops under white noise by kick-flow-kick, for many paths at once.
#
# The kick is that of `flight`; the flow is the undamped motion with the forces of the stops. Paths
# that stay clear of all stops in a step move together. The engine finishes the step of each of the
# others (`one_mass`).
#
# x is measured from the rest position under the load.
# ------------------------------------------------------------------------------


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
    paths : `flight.Paths`, with sums (CONTACT_SUMS, paths); `kept` holds the largest forces so far
        of contacts that last, of the lower and the upper stop.
    kick, flow, counting : `flight.Kick`, `flight.Flow` and `flight.Counting`.
    at : `one_mass.MassStops`.
    record : zeros (steps, paths, 3), which get x, v and the sum of the speeds of first touches of
        every counted step, negative at the lower stop. Without samples there is no record.
    log : None, or an `arithmetic.Log`, which gets the first touches in the counted steps that are
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
    omega = math.sqrt(flow.stiff)
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
                        flow.stiff, omega, xs[i], vs[i], flow.step, scene, threshold, peaks,
                        target, i, word_of_step(state0[i], step), numbers,
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


# ------------------------------------------------------------------------------
# Missions under white noise by kick-flow-kick, each simulated until its event.
#
# The step is that of compliant stops above: a kick by noise and damping, then the undamped motion
# with the stops in it. A mission ends with its event, with its time, or where its energy first
# reaches a splitting level. Splitting goes on from there with copies. Paths that move together fill
# lanes. A lane whose path has ended takes the next one, so that no lane waits for the longest path.
#
# Symbols: x is measured from the rest position under the load; E2 = v^2 + w0^2 x^2 is twice the
# energy per unit mass, without that stored in a stop.
# ------------------------------------------------------------------------------


OVER, AT_LEVEL, HAPPENED = range(3)
"""How a path ended: its time is over, it reached the level, or the event happened."""

PASSAGE, IMPACT, FORCE, NOTHING = range(4)
"""Events: the mass passes a barrier; it hits a stop at a given speed or faster; the force of a stop
exceeds its limit; there is no event."""


@kernel
def exceeds_force_limit(peaks, sums, lane, limit):
    """Whether the force of a stop exceeded its limit in a step, in contacts that last or ended.

    Contacts with one stop that ended in one step count with their mean peak force: so soon after
    one another they are nearly alike.
    """
    for side in range(2):
        row, force = ROWS_OF_PAIR + ROWS_OF_STOP * side, peaks[lane, side]
        if sums[lane, row + ENDED] > 0.0:
            force = max(force, sums[lane, row + PEAK] / sums[lane, row + ENDED])
        if force > limit[side]:
            return True
    return False


@kernel
def count_down(x, v, left, top, near, stiff, level, mark):
    """Take one step off the steps left, and mark the paths to be handled one by one.

    These are paths at a stop, whose step is still to be made, at the level, or at the end of their
    time. Returns their number.
    """
    count = 0
    for i in range(x.shape[0]):
        energy = v[i] * v[i] + stiff * x[i] * x[i]
        rest = left[i] - 1.0
        at_stop = near[i] != 0.0
        left[i] = rest
        top[i] = max(top[i], 0.0 if at_stop else energy)
        single = (energy >= level) | (rest <= 0.0) | at_stop
        mark[i] = 1.0 if single else 0.0
        count += 1 if single else 0
    return count


@kernel
def run_missions(
    fleet, kick, flow, at, event, limit, threshold, counted, level, flag
):  # fmt: skip
    """Simulate every path that has steps left until its event, the level, or the end of its time.

    Parameters
    ----------
    fleet : the seven arrays of `monte_carlo.missions.Fleet`,
        x, v : (paths,) start, replaced by the end;
        left : (paths,) steps left, replaced by those left at the end;
        top : (paths,) replaced by the largest E2 at the start and at the ends of steps;
        how : (paths,) replaced by OVER, AT_LEVEL or HAPPENED, except for paths without steps left;
        hits : (paths,) replaced by the impacts at `threshold` and faster in the counted steps;
        streams : (2, paths) random streams, advanced.
    kick, flow : `flight.Kick` and `flight.Flow`.
    at : `one_mass.MassStops`; for the event PASSAGE the stops are the barriers.
    event, limit : the event that ends a mission, and its limits at the lower and the upper stop: a
        force per unit mass, m/s^2; of the limits of a speed, m/s, the first holds for both stops.
    counted : events and impacts count in the last `counted` steps only. Barriers act only in them.
    level : E2 at which a path ends.
    flag : (1,), looked at before every other step: where it is not 0, the paths are given up,
        without a result.

    Returns the number of steps that were made.
    """
    x, v, left, top, how, hits, streams = fleet
    stiff = flow.stiff
    z1, z2, near, mark = np.empty((4, LANES))
    xs, vs, rest, high, seen = np.zeros((5, LANES))
    state = np.zeros((2, LANES), np.uint64)
    owner = np.empty(LANES, np.int64)
    peaks, sums = np.zeros((LANES, 2)), np.zeros((LANES, ROWS_OF_CONTACT_PAIR))
    found = np.zeros(FOUND)
    scene, forces, added, numbers = borrowed(at), borrowed(peaks), borrowed(sums), borrowed(found)
    omega = math.sqrt(stiff)
    done = np.zeros(LANES, np.bool_)
    waiting, lanes, steps, ended = 0, 0, 0, True
    while True:
        lane = 0
        while ended:
            # a lane whose path has ended takes the next path, or else the last lane's
            if lane < lanes and not done[lane]:
                lane += 1
                continue
            while waiting < x.shape[0]:
                energy = v[waiting] * v[waiting] + stiff * x[waiting] * x[waiting]
                if left[waiting] > 0.0 and energy < level:
                    break
                if left[waiting] > 0.0:
                    top[waiting], how[waiting] = energy, AT_LEVEL
                waiting += 1
            if waiting < x.shape[0] and lane < LANES:
                owner[lane], done[lane] = waiting, False
                xs[lane], vs[lane], rest[lane] = x[waiting], v[waiting], left[waiting]
                high[lane], seen[lane] = energy, 0.0
                state[0, lane], state[1, lane] = streams[0, waiting], streams[1, waiting]
                peaks[lane, :] = 0.0
                waiting += 1
                lanes = max(lanes, lane + 1)
            elif lane < lanes:
                lanes -= 1
                owner[lane], done[lane] = owner[lanes], done[lanes]
                xs[lane], vs[lane], rest[lane] = xs[lanes], vs[lanes], rest[lanes]
                high[lane], seen[lane] = high[lanes], seen[lanes]
                state[0, lane], state[1, lane] = state[0, lanes], state[1, lanes]
                for which in range(peaks.shape[1]):
                    peaks[lane, which] = peaks[lanes, which]
            else:
                ended = False
        if lanes == 0 or flag[0] != 0:
            hold((at, peaks, sums, found))
            return steps
        normal_pairs(state[0, :lanes], state[1, :lanes], z1[:lanes], z2[:lanes])
        for half in range(2):
            z = z1 if half == 0 else z2
            steps += lanes
            step_clear_paths(xs[:lanes], vs[:lanes], z[:lanes], near[:lanes], kick, flow, at.places)
            marked = count_down(
                xs[:lanes], vs[:lanes], rest[:lanes], high[:lanes], near[:lanes], stiff, level,
                mark[:lanes],
            )  # fmt: skip
            for i in range(lanes if marked > 0 else 0):
                if mark[i] == 0.0 or done[i]:
                    continue
                counts = rest[i] < counted
                happened = False
                if near[i] != 0.0:
                    if event == PASSAGE:
                        happened = counts
                        xs[i], vs[i] = (
                            flow.cosine * xs[i] + flow.sine * vs[i],
                            flow.cosine * vs[i] - stiff * flow.sine * xs[i],
                        )
                    else:
                        for row in range(ROWS_OF_CONTACT_PAIR):
                            sums[i, row] = 0.0
                        least = limit[0] if event == IMPACT else threshold
                        xs[i], vs[i] = finish_step(
                            stiff, omega, xs[i], vs[i], flow.step, scene, least, forces, added, i,
                            word_of_step(state[0, i], half), numbers, None,
                        )  # fmt: skip
                        number = sums[i, 0] + sums[i, 3]
                        if event == IMPACT:
                            happened = counts and number > 0.0
                        elif event == FORCE:
                            happened = counts and exceeds_force_limit(peaks, sums, i, limit)
                        seen[i] += number if counts else 0.0
                energy = vs[i] * vs[i] + stiff * xs[i] * xs[i]
                high[i] = max(high[i], energy)
                if happened or energy >= level or rest[i] <= 0.0:
                    path = owner[i]
                    x[path], v[path], left[path] = xs[i], vs[i], max(rest[i], 0.0)
                    top[path] = math.inf if happened else high[i]
                    hits[path] = seen[i]
                    how[path] = HAPPENED if happened else (AT_LEVEL if energy >= level else OVER)
                    streams[0, path], streams[1, path] = state[0, i], state[1, i]
                    done[i] = True
                    ended = True
