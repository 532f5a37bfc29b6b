"""Stops under tabulated noise: impacts are added to a given response without stops.

Between impacts the structure is linear, so x = y + e with y the stationary response without
stops, synthesised from its own spectrum, and e a free decay that every impact changes:

    e(t + h) = A(h) e(t),    impact at u with speed w:  e' <- e' - (1 + R) w

Only y and y' at the samples enter. Within a sampling interval x is the cubic through the end
values and slopes (error of fourth order); an impact takes the first upward root of x - u, and
changes the end of the interval by -(1 + R) w times the second column of A(remaining time). Where a
stop is compliant, the engine finishes the interval instead (`one_mass`).

All paths move together from sample to sample: a loop without branches advances those that stay
clear of the stops, which most do, and marks the others, which are then advanced one by one. To that
end a row holds one sample (or one bin) of all paths, (y, y' / w0) or (real, imaginary) in turn.

Symbols: x0, v0, x1, v1 values and slopes at the ends; s in [0, 1] the place in the interval.
"""

import numpy as np

from stochvi.engine.borrowed import borrowed, hold
from stochvi.engine.bounces import MOST_BOUNCES, RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.free_motion import decay
from stochvi.engine.impact_log import log_impact, page_of
from stochvi.engine.mass_flows import Chord
from stochvi.engine.one_mass import finish_step
from stochvi.engine.roots import time_to_stop
from stochvi.engine.sums import (
    EXTREME,
    EXTREMES,
    FASTEST,
    FORCE_SQUARE,
    FOUND,
    POSITION_FORCE,
    ROWS_OF_CONTACT_PAIR,
    SHARPEST,
)
from stochvi.methods.monte_carlo.kernels.flight import add_impacts, add_moments
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs
from stochvi.methods.monte_carlo.kernels.rows import (
    F1_LOWER,
    F1_UPPER,
    N_LOWER,
    N_UPPER,
    VV,
    XX,
    X,
)

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
    sampling : `steps.Sampling`.
    lower, upper : None, or a `steps.RigidStop`, of which only the position counts where `at` is
        given. Positions are those from the mean position.
    at : None, or `one_mass.MassStops` where a stop is compliant.
    state : (4, paths), replaced: what impacts have changed of position and velocity before the
        first sample, then position and velocity.
    peaks : None, or (paths, 2) with `at`: the largest forces so far of contacts that last, of the
        lower and the upper stop.
    sums : (SUMS, paths), with `at` (CONTACT_SUMS, paths), added to.
    record : (counted, paths, 3). Without samples there is no record.
    extremes : (paths, EXTREMES) as in `rows`, of the counted samples. Without paths there are none.
    log : `impact_log.Log`, which gets the impacts in the intervals that end on counted samples and
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
