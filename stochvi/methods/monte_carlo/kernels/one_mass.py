"""One mass with compliant stops or under tabulated noise. Chapters: compliant stops under white
noise; missions until their event; stops under tabulated noise."""

import math

import numpy as np

from stochvi.engine.arithmetic import (
    ENDED,
    EXTREME,
    EXTREMES,
    FASTEST,
    FORCE_SQUARE,
    FOUND,
    MOST_BOUNCES,
    PEAK,
    POSITION_FORCE,
    RESTING,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    SHARPEST,
    log_impact,
    page_of,
    time_to_stop,
    word_of_step,
)
from stochvi.engine.borrowed import borrowed, hold
from stochvi.engine.compiling import kernel
from stochvi.engine.one_mass import Chord, Rotation, finish_step
from stochvi.engine.sub_steps import decay
from stochvi.methods.monte_carlo.kernels.flight import (
    F1_LOWER,
    F1_UPPER,
    N_LOWER,
    N_UPPER,
    VV,
    XX,
    X,
    add_impacts,
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
    rotation = Rotation(stiff, math.sqrt(stiff))
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
                            rotation, xs[i], vs[i], flow.step, scene, least, forces, added, i,
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


# ------------------------------------------------------------------------------
# Stops under tabulated noise: impacts are added to a given response without stops.
#
# Between impacts the structure is linear, so x = y + e with y the stationary response without
# stops, synthesised from its own spectrum, and e a free decay that every impact changes:
#
#     e(t + h) = A(h) e(t),    impact at u with speed w:  e' <- e' - (1 + R) w
#
# Only y and y' at the samples enter. Within a sampling interval x is the cubic through the end
# values and slopes (error of fourth order); an impact takes the first upward root of x - u, and
# changes the end of the interval by -(1 + R) w times the second column of A(remaining time). Where
# a stop is compliant, the engine finishes the interval instead (`one_mass`).
#
# All paths move together from sample to sample: a loop without branches advances those that stay
# clear of the stops, which most do, and marks the others, which are then advanced one by one. To
# that end a row holds one sample (or one bin) of all paths, (y, y' / w0) or (real, imaginary) in
# turn.
#
# Symbols: x0, v0, x1, v1 values and slopes at the ends; s in [0, 1] the place in the interval.
# ------------------------------------------------------------------------------


F1_OF_LOWER, F1_OF_UPPER = F1_LOWER - N_LOWER, F1_UPPER - N_LOWER
"""Rows of the sums of impact speeds, from the first row of the pair."""


@kernel(inline="always")
def impacts_end(w, v1, restitution):
    """Whether ever slower impacts, the first at the speed w, end in the interval.

    Without the stop the mass would end the interval with the velocity v1. In the time t that is
    left the acceleration a = (v1 - w) / t presses it. The next impact comes after 2 R w / a, and
    each later one after R of the time before.
    """
    return 2.0 * restitution * w < (1.0 - restitution) * (v1 - w)


@kernel
def impulse_of_rest(beyond, v1, sampling, span):
    """Impulse of a stop per mass, m/s, that holds a mass at rest through `span`.

    Without the stop the mass would end `beyond` it, with the velocity v1. The stop takes that
    motion: its force is x'' + b x' + w0^2 x. The last term is that of a constant force.
    """
    b, omega = sampling.damping_rate, sampling.omega
    return v1 + (b + omega * omega * span / 3.0) * beyond


@kernel
def interval_with_impacts(x0, v0, x1, v1, sampling, lower, upper, extremes, sums, page):
    """One sampling interval with any number of impacts on rigid stops; returns the end (x, v)."""
    span, omega, damping_rate, threshold, scale, _, _ = sampling
    whole = span
    for bounces in range(MOST_BOUNCES + 1):
        s, w, position, restitution, side = 2.0, 0.0, 0.0, 0.0, 1.0
        if upper is not None:
            s, w = time_to_stop(x0, v0, x1, v1, span, upper.position)
            position, restitution, _ = upper
        if lower is not None:
            t, below = time_to_stop(-x0, -v0, -x1, -v1, span, -lower.position)
            if t < s:
                s, w, side = t, below, -1.0
                position, restitution, _ = lower
        if s > 1.0:
            return x1, v1
        row = N_UPPER if side > 0.0 else N_LOWER
        span *= 1.0 - s
        extremes[FASTEST] = max(extremes[FASTEST], w)
        dies_out = w < threshold and impacts_end(w, side * v1, restitution)
        if dies_out or w <= RESTING * scale or bounces == MOST_BOUNCES:
            impulse = side * impulse_of_rest(x1 - position, v1, sampling, span)
            sums[row + 1] += max(impulse, 0.0) / (1.0 + restitution)
            sums[row + 2] += w * w / (1.0 - restitution * restitution) if dies_out else 0.0
            return position, 0.0
        sums[row] += 1.0 if w >= threshold else 0.0
        sums[row + 1] += w
        sums[row + 2] += w * w
        if page.open and w >= threshold:
            log_impact(page, 0, whole - span, side * w)
        shape, slope = decay(span, damping_rate, omega)
        change = -(1.0 + restitution) * w * side
        x1 += change * shape
        v1 += change * slope
        x0, v0 = position, -restitution * w * side
    return x1, v1


@kernel
def fill_bin(cosine, sine, above, below, up, down):
    """Fill the rows of the spectrum at +w and at -w with one bin of every path."""
    for i in range(cosine.shape[0]):
        up[2 * i] = above * cosine[i]
        up[2 * i + 1] = -above * sine[i]
        down[2 * i] = below * cosine[i]
        down[2 * i + 1] = below * sine[i]


@kernel
def fill_spectrum(streams, amplitudes, relative, spectrum):
    """Gaussian spectrum of y + i y' / w0 for y = sum a cos wt + b sin wt = Re sum (a - i b) e^iwt.

    y has (a - i b) / 2 at +w and the complex conjugate at -w; i y' / w0 adds -w / w0 and w / w0
    times these.

    Parameters
    ----------
    streams : (2, paths) random streams, advanced by a pair of normals per bin.
    amplitudes, relative : (bins,), standard deviation of a and b, and w / w0, of bins 1, 2, ...
    spectrum : (samples, 2 paths), replaced. The inverse transform must not divide by `samples`.
    """
    samples, paths = spectrum.shape[0], streams.shape[1]
    count = amplitudes.shape[0]
    cosine, sine = np.empty(paths), np.empty(paths)
    spectrum[0] = 0.0
    spectrum[count + 1 : samples - count] = 0.0
    for k in range(count):
        normal_pairs(streams[0], streams[1], cosine, sine)
        half = 0.5 * amplitudes[k]
        above, below = half * (1.0 - relative[k]), half * (1.0 + relative[k])
        fill_bin(cosine, sine, above, below, spectrum[k + 1], spectrum[samples - 1 - k])


@kernel
def advance_clear_paths(y, x, v, e, rate, near, sampling, column, lower, upper):
    """Advance every path that stays clear of the stops by one interval; mark the others `near`.

    In a marked path only e has decayed. The cubic between the samples lies in the hull of its four
    control points. `column` is the second column of A(span). Returns the number of marked paths.
    """
    span, omega, damping_rate = sampling.span, sampling.omega, sampling.damping_rate
    shape, slope = column
    # first column of A, from e'' = -b e' - w0^2 e
    shape_x, slope_x = slope + damping_rate * shape, -omega * omega * shape
    third = span / 3.0
    count = 0
    for i in range(x.shape[0]):
        e1 = shape_x * e[i] + shape * rate[i]
        rate1 = slope_x * e[i] + slope * rate[i]
        x0, v0 = x[i], v[i]
        x1 = y[2 * i] + e1
        v1 = omega * y[2 * i + 1] + rate1
        a, b = x0 + v0 * third, x1 - v1 * third
        close = False
        if upper is not None:
            close = max(max(a, b), max(x0, x1)) > upper.position
        if lower is not None:
            close = close | (min(min(a, b), min(x0, x1)) < lower.position)
        e[i], rate[i] = e1, rate1
        x[i] = x0 if close else x1
        v[i] = v0 if close else v1
        near[i] = 1.0 if close else 0.0
        count += 1 if close else 0
    return count


@kernel
def update_peak_acceleration(x, v, sampling, extremes):
    """Update the largest absolute acceleration of each path with that by spring and damper."""
    omega, damping_rate = sampling.omega, sampling.damping_rate
    for i in range(x.shape[0]):
        acceleration = abs(damping_rate * v[i] + omega * omega * x[i])
        extremes[i, SHARPEST] = max(extremes[i, SHARPEST], acceleration)


@kernel
def add_extremes(found, own):
    """Add the extremes of the contacts of an interval to those of its path."""
    own[FASTEST] = max(own[FASTEST], found[EXTREME + FASTEST])
    own[SHARPEST] = max(own[SHARPEST], found[EXTREME + SHARPEST])
    own[FORCE_SQUARE] += found[EXTREME + FORCE_SQUARE]
    own[POSITION_FORCE] += found[EXTREME + POSITION_FORCE]


@kernel
def run_response(
    free, sampling, lower, upper, at, state, peaks, sums, record, extremes, log, flag
):  # fmt: skip
    """Add impacts to `free` responses, which are periodic in time, and add up the counted samples.

    It may be done by several calls, as sums and states go on.

    Parameters
    ----------
    free : (samples, 2 paths), y and y' / w0 of each path in turn, at equal intervals.
    sampling : `flight.Sampling`.
    lower, upper : None, or a `flight.RigidStop`, of which only the position counts where `at` is
        given. Positions are those from the mean position.
    at : None, or `one_mass.MassStops` where a stop is compliant.
    state : (4, paths), replaced: what impacts have changed of position and velocity before the
        first sample, then position and velocity.
    peaks : None, or (paths, 2) with `at`: the largest forces so far of contacts that last, of the
        lower and the upper stop.
    sums : (SUMS, paths), with `at` (CONTACT_SUMS, paths), added to.
    record : (counted, paths, 3). Without samples there is no record.
    extremes : (paths, EXTREMES) as in `rows`, of the counted samples. Without paths there are none.
    log : `arithmetic.Log`, which gets the impacts in the intervals that end on counted samples and
        that are at least as fast as the threshold.
    flag : (1,), looked at before every sample: where it is not 0, the paths are given up, without a
        result.
    """
    span, omega, damping_rate, threshold, _, first, last = sampling
    column = decay(span, damping_rate, omega)
    samples, paths = free.shape[0], free.shape[1] // 2
    e, rate, x, v = state[0], state[1], state[2], state[3]
    mean, square, speed = sums[X], sums[XX], sums[VV]
    near, several, spare = np.zeros(paths), np.zeros(sums.shape[0]), np.zeros(EXTREMES)
    of_paths, of_none = np.zeros((2, paths, ROWS_OF_CONTACT_PAIR))
    found = np.zeros(FOUND)
    if at is not None:
        scene, numbers, largest = borrowed(at), borrowed(found), borrowed(peaks)
        for row in range(ROWS_OF_CONTACT_PAIR):
            of_paths[:, row] = sums[N_LOWER + row]
    extreme = extremes.shape[0] > 0
    for step in range(first, last):
        if flag[0] != 0:
            break
        y = free[step if step >= 0 else samples + step]
        marked = advance_clear_paths(y, x, v, e, rate, near, sampling, column, lower, upper)
        for i in range(paths if marked > 0 else 0):
            if near[i] != 0.0:
                own = extremes[i] if extreme and step >= 0 else spare
                y0, y1 = y[2 * i], omega * y[2 * i + 1]
                if at is None:
                    several[:] = 0.0
                    x[i], v[i] = interval_with_impacts(
                        x[i], v[i], y0 + e[i], y1 + rate[i], sampling, lower, upper, own, several,
                        page_of(log, i, step, span),
                    )  # fmt: skip
                    if step >= 0:
                        add_impacts(several, True, sums, record, step, 0, i)
                else:
                    target = borrowed(of_paths if step >= 0 else of_none)
                    before = target[i, F1_OF_UPPER] - target[i, F1_OF_LOWER]
                    numbers[EXTREME:] = 0.0
                    chord = Chord(y0 + e[i], y1 + rate[i], damping_rate, omega)
                    x[i], v[i] = finish_step(
                        chord, x[i], v[i], span, scene, threshold, largest, target, i,
                        np.uint64(0), numbers, page_of(log, i, step, span),
                    )  # fmt: skip
                    add_extremes(numbers, own)
                    if step >= 0 and record.shape[0] > 0:
                        after = target[i, F1_OF_UPPER] - target[i, F1_OF_LOWER]
                        record[step, i, 2] = after - before
                e[i], rate[i] = x[i] - y0, v[i] - y1
        if step >= 0:
            add_moments(x, v, 0.0, mean, square, speed)
            if extreme:
                update_peak_acceleration(x, v, sampling, extremes)
            if record.shape[0] > 0:
                for i in range(paths):
                    record[step, i, 0] = x[i]
                    record[step, i, 1] = v[i]
    if at is not None:
        for row in range(ROWS_OF_CONTACT_PAIR):
            sums[N_LOWER + row] = of_paths[:, row]
        hold((at, peaks, of_paths, of_none, found))


@kernel
def add_free_motion(free, begin, end, stops, sums):
    """Add up what the motion without stops does in the samples from `begin` to before `end`.

    Parameters
    ----------
    free : (samples, 2 paths), y and y' / w0 in turn; the last sample is the one before the first.
    stops : (stops, 2), the side of each stop, 1 or -1, and its position in m.
    sums : (2 + 3 stops, paths), added to: y^2, (y' / w0)^2; and for each stop the number of
        passages beyond it between two samples, the sum of the rises from the sample before a
        passage to the one after it, and the sum of their squares.
    """
    paths = free.shape[1] // 2
    squares, rates = sums[0], sums[1]
    for k in range(begin, end):
        now, before = free[k], free[k - 1]
        for i in range(paths):
            squares[i] += now[2 * i] * now[2 * i]
            rates[i] += now[2 * i + 1] * now[2 * i + 1]
        for j in range(stops.shape[0]):
            side, level = stops[j, 0], stops[j, 0] * stops[j, 1]
            number, first, second = sums[2 + 3 * j], sums[3 + 3 * j], sums[4 + 3 * j]
            for i in range(paths):
                y0, y1 = side * before[2 * i], side * now[2 * i]
                passed = (y0 < level) & (y1 >= level)
                rise = y1 - y0 if passed else 0.0
                number[i] += 1.0 if passed else 0.0
                first[i] += rise
                second[i] += rise * rise
