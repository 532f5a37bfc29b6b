"""One mass between rigid stops under white noise. Chapters: rows of the tables of sums; restitution
that scatters; arguments of the kernels; the kernel, by kick-flow-kick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    MOST_BOUNCES,
    RESTING,
    log_impact,
    page_after,
    page_of,
    uniform_of,
)
from stochvi.engine.compiling import kernel
from stochvi.engine.impact_laws import ScatteredRestitution
from stochvi.engine.parts import generic, rebound
from stochvi.motion.kernels.random_numbers import (
    LANES,
    aligned_rows,
    normal_pair,
    normal_pairs,
    row_of,
    words_of,
)

# ------------------------------------------------------------------------------
# Rows of the tables of sums that the kernels fill, for one oscillator and for pairs of stops.
#
# All quantities are per unit mass.
# ------------------------------------------------------------------------------


Vector = NDArray[np.float64]

X, XX, VV, N_LOWER, F1_LOWER, F2_LOWER, N_UPPER, F1_UPPER, F2_UPPER = range(9)
SUMS = 9
"""Rows of one oscillator with rigid stops: x, x^2, v^2, and for each stop its impacts (N), their
speeds (F1, m/s) and the squares of their speeds (F2, m^2/s^2)."""


# ------------------------------------------------------------------------------
# Rigid stops of one oscillator whose restitution scatters, beside `RigidStop`.
#
# Kernels choose what a stop does by its class while they are compiled, so that a constant
# restitution costs what it did.
# ------------------------------------------------------------------------------


class ScatteredStop(NamedTuple):
    """A rigid stop whose restitution is drawn at each impact.

    As `RigidStop`; `restitution` is the mean, and `slow` infinite: every step with an impact
    is followed impact by impact. `law` is that of the engine.
    """

    position: float
    restitution: float
    slow: float
    law: ScatteredRestitution


@generic
def restitution_of(stop, word, number):
    """Restitution of the impact `number` of those that belong to a word (`engine.arithmetic`)."""


@generic
def is_scattered(stop):
    """Whether the restitution of a stop is drawn."""


@restitution_of.of(object)
def _(stop, word, number):
    return stop.restitution


@restitution_of.of(ScatteredStop)
def _(stop, word, number):
    return rebound(stop.law, 1.0, uniform_of(word, number))


@is_scattered.of(object)
def _(stop):
    return False


@is_scattered.of(type(None))
def _(stop):
    return False


@is_scattered.of(ScatteredStop)
def _(stop):
    return True


# ------------------------------------------------------------------------------
# Arguments of the kernels of one oscillator, as named tuples; all quantities per unit mass.
#
# Numba compiles a named tuple as it does a plain one. Parts that may be absent are arguments of
# their own: numba leaves out the code of an argument that is `None`, but not that of an empty
# field.
# ------------------------------------------------------------------------------


class Kick(NamedTuple):
    """Damping and white noise over a step: v <- decay v + spread z, z a standard normal.

    With b the damping rate and S0 the intensity, `decay` is e^(-b h) and `spread`, in m/s, the root
    of S0 (1 - e^(-2 b h)) / (2 b). A step that has the noise of two steps of half its length makes
    z of the pair of normals that these would take; `earlier` is then the weight of the first one,
    else 0.
    """

    decay: float
    spread: float
    earlier: float = 0.0


class Flow(NamedTuple):
    """Undamped motion over a step of h s: x <- C x + S v, v <- C v - w0^2 S x.

    `cosine` is C = cos w0 h, `sine` is S = sin(w0 h) / w0 in s, `stiff` is w0^2 in 1/s^2.
    """

    step: float
    cosine: float
    sine: float
    stiff: float


class RigidStop(NamedTuple):
    """A rigid stop for kernels that know no other: position from the rest position in m, and R.

    `slow` is the speed after an impact, in m/s, below which the mass may hit the same stop again
    within a step; it is negative where that cannot happen.
    """

    position: float
    restitution: float
    slow: float


class Paths(NamedTuple):
    """State of the paths that a kernel advances, and the sums that it adds to.

    Parameters
    ----------
    x, v : (paths,), m from the rest position and m/s at the start, replaced by those at the end.
    streams : (2, paths), random streams, advanced.
    sums : (rows, paths), added to; the rows are those of `rows`.
    noise : (2, paths), added to: the sums of x z and of v z over the counted steps, with x and v
        before the kick and z its normal.
    kept : (paths, 2), what a kernel knows of a path beside that, replaced: zeros at the start
        unless the kernel states something else.
    """

    x: NDArray
    v: NDArray
    streams: NDArray
    sums: NDArray
    noise: NDArray
    kept: NDArray


class Corner(NamedTuple):
    """How steps are refined in the corner of the phase plane where a mass is slow and near a stop.

    Parameters
    ----------
    width, speed : distance from a stop (m) and speed (m/s) below which steps are refined.
    damping_rate, intensity : b (1/s), and S0 of the noise (m^2/s^3).
    stiff : w0^2, 1/s^2.
    ladder : (levels, 3), length h / 2^k of a sub-step with its (C, S) in row k.
    share : largest length of a sub-step, in units of the time in which noise changes the state.
    """

    width: float
    speed: float
    damping_rate: float
    intensity: float
    stiff: float
    ladder: NDArray
    share: float


class Counting(NamedTuple):
    """Which steps a path takes, and which of its states and impacts are added up.

    Parameters
    ----------
    first, last : number of the first step, and of the one after the last. Steps with negative
        numbers are a burn-in, which is not counted. A path may be advanced by several calls, as
        sums and states go on; each but the last must take an even number of steps, since two
        successive steps use a pair of normals.
    stride : number of steps from one sample of the moments to the next; samples precede the kick.
    origin : m, from where the moments of x are taken; it should be near the mean of x.
    threshold : m/s, speed of the slowest impact that is counted.
    """

    first: int
    last: int
    stride: int
    origin: float
    threshold: float


# ------------------------------------------------------------------------------
# White noise and rigid stops by kick-flow-kick, for many paths at once.
#
# The oscillator x'' + b x' + w0^2 x = f + g is split in two parts that are both solved exactly:
#
#     kick   dv = -b v dt + sqrt(S0) dW        v <- e v + s z,  e = exp(-b h), z ~ N(0, 1)
#     flow   x'' + w0^2 x = g, with its stops  a rotation, and impacts v <- -R v
#
# One step is a kick over h and a flow over h. With elastic stops both parts preserve the density
# exp(-(v^2 + w0^2 x^2) / 2 theta), so the stationary distribution is exact for any h. Else the
# scheme is of second order. The flow draws no random numbers, so nothing about an impact has to be
# sampled.
#
# Symbols: x is measured from the rest position under the load g, u and l are the stops from there;
# (C, S) = (cos w0 h, sin w0 h / w0), so that a flow over h is x1 = C x + S v, v1 = C v - w0^2 S x,
# also for w0 = 0. An orbit of energy E2 = v^2 + w0^2 x^2 passes the stop u with the speed w =
# sqrt(E2 - w0^2 u^2). Sr, Cr belong to the time r between that passage and the end of the step: Sr
# = (x1 w - v1 u) / E2, Cr = (v1 w + w0^2 x1 u) / E2. A reset of the velocity at the stop changes
# the end by -(1 + R) w (Sr, Cr).
# ------------------------------------------------------------------------------


CORNER_SHARE = 0.25
"""Usual length of a sub-step near a stop, as a share of the time in which noise changes the state.
The error of slow impacts falls with its root, and the cost of sub-steps grows with its inverse."""

AGAIN = np.inf
"""Entry of the array of impact speeds for a path that may have several impacts in the step."""


@kernel(inline="always")
def find_crossing(x, v, x1, v1, stiff, stop):
    """Whether the free orbit from (x, v) to (x1, v1) crosses `stop` upwards; w, E2 Sr and E2 Cr."""
    # differences of squares keep their digits close to the stop
    square = v * v + stiff * (x - stop) * (x + stop)
    w = math.sqrt(max(square, 0.0))
    sr = x1 * w - v1 * stop
    since_start = v * stop - x * w
    passed = (square > 0.0) & (sr > 0.0) & ((since_start > 0.0) | (x1 > stop))
    return passed, w, sr, v1 * w + stiff * x1 * stop


@kernel
def step_without_stops(x, v, z, kick, flow):
    """Advance every path by one step where there is no stop."""
    e, s, _ = kick
    _, cosine, sine, stiff = flow
    for i in range(x.shape[0]):
        q = x[i]
        p = e * v[i] + s * z[i]
        x[i] = cosine * q + sine * p
        v[i] = cosine * p - stiff * sine * q


@kernel
def step_with_stops(x, v, z, hit, kick, flow, lower, upper):
    """Advance every path by one step.

    `hit` gets the impact speed, w at the upper stop and -w at the lower one, 0 without an impact,
    or AGAIN for a path that has had its kick only, as it may hit more than once. Returns the number
    of paths marked AGAIN.
    """
    e, s, _ = kick
    h, cosine, sine, stiff = flow
    again = 0
    for i in range(x.shape[0]):
        q = x[i]
        p = e * v[i] + s * z[i]
        x1 = cosine * q + sine * p
        v1 = cosine * p - stiff * sine * q
        energy = p * p + stiff * q * q
        inverse = 1.0 / energy
        speed = 0.0
        both = False
        shift_x = 0.0
        shift_v = 0.0
        if upper is not None:
            stop, restitution, slow = upper.position, upper.restitution, upper.slow
            up, w, sr, cr = find_crossing(q, p, x1, v1, stiff, stop)
            factor = (1.0 + restitution) * w * inverse if up else 0.0
            shift_x = factor * sr
            shift_v = factor * cr
            speed = w if up else 0.0
            both = up & (restitution * w < slow)
        if lower is not None:
            stop, restitution, slow = lower.position, lower.restitution, lower.slow
            down, w, sr, cr = find_crossing(-q, -p, -x1, -v1, stiff, -stop)
            factor = (1.0 + restitution) * w * inverse if down else 0.0
            both = both | (down & ((speed > 0.0) | (restitution * w < slow)))
            shift_x -= factor * sr
            shift_v -= factor * cr
            speed = -w if down else speed
        if (lower is not None) and (upper is not None):
            gap = upper.position - lower.position
            both = both | ((speed != 0.0) & (energy * h * h >= gap * gap))
        x2 = x1 - shift_x
        v2 = v1 - shift_v
        if upper is not None:
            x2 = min(x2, upper.position)
        if lower is not None:
            x2 = max(x2, lower.position)
        x[i] = q if both else x2
        v[i] = p if both else v2
        hit[i] = AGAIN if both else speed
        again += 1 if both else 0
    return again


@kernel(inline="always")
def step_between_stops(x, v, z, hit, kick, flow, lower, upper):
    """`step_with_stops` for stops on either side of the rest position and omega h <= pi / 2.

    One test a step is enough: a mass that moves up cannot hit the lower stop first, since it would
    have to turn before the upper stop, and from there it is more than a quarter of a period to the
    lower one. The signs of x and v are changed so that every mass moves up.
    """
    e, s, _ = kick
    _, cosine, sine, stiff = flow
    low, restitution_low, _ = lower
    high, restitution_high, _ = upper
    again = 0
    for i in range(x.shape[0]):
        q = x[i]
        p = e * v[i] + s * z[i]
        rising = p > 0.0
        q = q if rising else -q
        p = p if rising else -p
        stop = high if rising else -low
        opposite = low if rising else -high
        restitution = restitution_high if rising else restitution_low
        x1 = cosine * q + sine * p
        v1 = cosine * p - stiff * sine * q
        energy = p * p + stiff * q * q
        passed, w, sr, cr = find_crossing(q, p, x1, v1, stiff, stop)
        factor = (1.0 + restitution) * w / energy if passed else 0.0
        x2 = min(x1 - factor * sr, stop)
        v2 = v1 - factor * cr
        more = x2 < opposite
        x2 = q if more else x2
        v2 = p if more else v2
        speed = w if passed else 0.0
        x[i] = x2 if rising else -x2
        v[i] = v2 if rising else -v2
        hit[i] = AGAIN if more else (speed if rising else -speed)
        again += 1 if more else 0
    return again


@kernel
def time_since(s_r, c_r, stiff):
    """Time r in s since a crossing, from its (Sr, Cr)."""
    if stiff > 0.0:
        omega = math.sqrt(stiff)
        return math.atan2(omega * s_r, c_r) / omega
    return s_r / c_r


@kernel
def time_of_hit(x, v, hit, kick, z, flow, lower, upper):
    """Time in s from the start of a step to the impact on the stop that the sign of `hit` names.

    x and v are those before the kick.
    """
    e, s, _ = kick
    h, cosine, sine, stiff = flow
    p = e * v + s * z
    stop = 0.0
    if upper is not None:
        stop = upper.position
    if lower is not None:
        stop = lower.position if hit < 0.0 else stop
    side = 1.0 if hit > 0.0 else -1.0
    x1, v1 = side * (cosine * x + sine * p), side * (cosine * p - stiff * sine * x)
    _, _, sr, cr = find_crossing(side * x, side * p, x1, v1, stiff, side * stop)
    energy = p * p + stiff * x * x
    return min(max(h - time_since(sr / energy, cr / energy, stiff), 0.0), h)


@kernel
def flow_with_impacts(x, v, flow, lower, upper, threshold, sums, page, word, struck):
    """Flow of one path with any number of impacts, which are added to `sums`; returns (x, v) and
    `struck`, increased by their number.

    The restitution of an impact, if it scatters, belongs to `word` and `struck`.

    A mass that is pressed against a stop and rebounds too slowly to leave it rests there; its
    impacts are the limit of ever lower bounces, whose impulses (1 + R) w add up to the pressing
    force.
    """
    h, cosine, sine, stiff = flow
    x1 = cosine * x + sine * v
    v1 = cosine * v - stiff * sine * x
    position, usual, restitution, speed, s_r, c_r = x, 1.0, 1.0, 0.0, 0.0, 1.0
    for bounces in range(MOST_BOUNCES + 1):
        energy = v * v + stiff * x * x
        up = False
        down = False
        upper_cr = 0.0
        if upper is not None:
            up, w, sr, upper_cr = find_crossing(x, v, x1, v1, stiff, upper.position)
            if up:
                position, usual = upper.position, upper.restitution
                restitution = restitution_of(upper, word, struck)
                speed, s_r, c_r = w, sr / energy, upper_cr / energy
        if lower is not None:
            down, w, sr, cr = find_crossing(-x, -v, -x1, -v1, stiff, -lower.position)
            # of two passages the first is the one farther from the end
            if down and (not up or cr < upper_cr):
                position, usual = lower.position, lower.restitution
                restitution = restitution_of(lower, word, struck)
                speed, s_r, c_r = -w, sr / energy, cr / energy
                up = False
            else:
                down = False
        if not (up or down):
            break
        if bounces == MOST_BOUNCES:
            return position, v, struck
        struck += 1
        w = abs(speed)
        row = N_UPPER if up else N_LOWER
        sums[row] += 1.0 if w >= threshold else 0.0
        sums[row + 1] += w
        sums[row + 2] += w * w
        if page.open and w >= threshold:
            log_impact(page, 0, h - time_since(s_r, c_r, stiff), speed)
        x1 -= (1.0 + restitution) * speed * s_r
        v1 -= (1.0 + restitution) * speed * c_r
        x = position
        v = -restitution * speed
        pressing = stiff * abs(position)
        if (position * speed < 0.0) and (abs(v) <= RESTING * pressing * h):
            sums[row + 1] += pressing * time_since(s_r, c_r, stiff) / (1.0 + usual)
            return position, 0.0, struck
    if upper is not None:
        x1 = min(x1, upper.position)
    if lower is not None:
        x1 = max(x1, lower.position)
    return x1, v1, struck


@kernel
def find_near_stop(x, v, owed, usual, corner, lower, upper, found):
    """Mark the paths that are slow and near a stop, and those that were so a step before.

    The latter are known by the half kick `owed`, which differs from the usual one. Returns the
    number of marked paths.
    """
    width, speed = corner.width, corner.speed
    count = 0
    for i in range(x.shape[0]):
        near = False
        if upper is not None:
            near = x[i] > upper.position - width
        if lower is not None:
            near = near | (x[i] < lower.position + width)
        slow = (near & (abs(v[i]) < speed)) | (owed[i] != usual)
        found[i] = 1.0 if slow else 0.0
        count += 1 if slow else 0
    return count


@kernel
def step_near_stop(x, v, owed, s0, s1, struck, corner, lower, upper, threshold, sums, page):
    """Advance one path near a stop by one step in sub-steps that suit the state they start from.

    Noise of intensity S0 alone changes a velocity v in the time v^2 / S0 and a distance d in
    (d^2 / S0)^(1/3); a sub-step is at most `share` of the larger of the two. Its length is chosen
    before its noise is drawn, so the choice brings no bias.

    A sub-step is half a kick, a flow, and half a kick; the last half is `owed` to the next
    sub-step, whose first half it joins. With steps of one length that is a whole kick; here it is
    not.

    Returns x, v, the length in s of the half kick that is owed, the two words of the stream, and
    `struck` of `flow_with_impacts`.
    """
    damping_rate, intensity = corner.damping_rate, corner.intensity
    ladder, share = corner.ladder, corner.share
    deepest = ladder.shape[0] - 1
    unit = ladder[deepest, 0]
    left = 1 << deepest
    spare, have_spare = 0.0, False
    while left > 0:
        distance = np.inf
        if upper is not None:
            distance = min(distance, upper.position - x)
        if lower is not None:
            distance = min(distance, x - lower.position)
        longest = share * max(v * v / intensity, (distance * distance / intensity) ** (1.0 / 3.0))
        level = deepest
        while level > 0 and (2 << (deepest - level)) <= min(left, longest / unit):
            level -= 1
        left -= 1 << (deepest - level)
        if have_spare:
            z = spare
        else:
            s0, s1, z, spare = normal_pair(s0, s1)
        have_spare = not have_spare
        length = ladder[level, 0]
        kick = owed + 0.5 * length
        owed = 0.5 * length
        decay = math.exp(-damping_rate * kick)
        # S0 (1 - e^(-2 b t)) / (2 b), which is S0 t (1 + e^(-2 b t)) / 2 to third order in b t
        v = decay * v + math.sqrt(intensity * kick * 0.5 * (1.0 + decay * decay)) * z
        flow = Flow(length, ladder[level, 1], ladder[level, 2], corner.stiff)
        elapsed = ladder[0, 0] - (left + (1 << (deepest - level))) * unit
        x, v, struck = flow_with_impacts(
            x, v, flow, lower, upper, threshold, sums, page_after(page, elapsed), s0, struck
        )
    return x, v, owed, s0, s1, struck


@kernel(inline="always")
def count_side(hit, side, threshold, number, speed_sum, square_sum):
    """Add the impacts of one step on the stop of a side, 1 or -1, to N, F1 and F2 of every path."""
    for i in range(hit.shape[0]):
        w = side * hit[i]
        w = w if w > 0.0 else 0.0
        number[i] += 1.0 if (w > 0.0) & (w >= threshold) else 0.0
        speed_sum[i] += w
        square_sum[i] += w * w


@kernel(inline="always")
def add_moments(x, v, origin, mean, square, speed):
    """Add x - origin, its square, and v^2 to their sums."""
    for i in range(x.shape[0]):
        away = x[i] - origin
        mean[i] += away
        square[i] += away * away
        speed[i] += v[i] * v[i]


@kernel(inline="always")
def add_noise(x, v, z, place, power):
    """Add x z and v z to their sums, of states before the kick with the normal z."""
    for i in range(x.shape[0]):
        place[i] += x[i] * z[i]
        power[i] += v[i] * z[i]


@kernel(inline="always")
def merge_pairs(first, second, earlier):
    """Put into `first` the normal of one kick in the place of two: both with their weights."""
    later = math.sqrt(1.0 - earlier * earlier)
    for i in range(first.shape[0]):
        first[i] = earlier * first[i] + later * second[i]


@kernel(inline="always")
def normals_of_step(odd, earlier, state0, state1, first, second):
    """Put the normals of a step into `first`: of a pair that two successive steps use, the second
    ones in `odd` steps, or of one drawn for it.

    They are moved where another array could be named, as naming one in every step costs more.
    """
    if earlier > 0.0:
        normal_pairs(state0, state1, first, second)
        merge_pairs(first, second, earlier)
    elif odd:
        for i in range(first.shape[0]):
            first[i] = second[i]
    else:
        normal_pairs(state0, state1, first, second)


@kernel(inline="always")
def first_marked(hit):
    """Number of the first path that is marked AGAIN, by a loop that fills vectors."""
    n = hit.shape[0]
    first = n
    for i in range(n):
        first = min(first, i if hit[i] == AGAIN else n)
    return first


@kernel
def add_impacts(several, counted, local, record, sample, first_path, i):
    """Add the sums of a step with several impacts to those of path i; a record takes their speed.

    The speed of several impacts is the sum of their speeds, negative at the lower stop. There is no
    record where it has no samples.
    """
    if counted:
        for row in range(SUMS):
            local[row, i] += several[row]
    if record.shape[0] > 0:
        record[sample, first_path + i, 2] = several[F1_UPPER] - several[F1_LOWER]


@kernel
def run_white(paths, kick, flow, lower, upper, between, corner, counting, record, log, flag):
    """Advance every path by some steps, and add up those that are counted.

    Parameters
    ----------
    paths : `Paths`, with sums (SUMS, paths); in the first column of `kept` stands the half
        kick that is owed, s, half a step before the first one; in the second, where a restitution
        scatters, the number of impacts since a pair of normals was drawn.
    kick, flow : `Kick` and `Flow`.
    lower, upper : None, a `RigidStop`, or a `ScatteredStop`.
    between : None, or () where the stops lie on either side of the rest position, and no
        restitution scatters.
    corner : None, or a `Corner` to refine steps near a stop.
    counting : `Counting`.
    record : zeros (steps, paths, 3), which get x, v and the impact speed of every counted step.
        Without samples there is no record.
    log : `arithmetic.Log`, which gets the impacts in the counted steps that are at least as fast as
        the threshold.
    flag : (1,), looked at before every step: where it is not 0, the paths are given up, without a
        result.
    """
    x, v, streams, sums, noise, kept = paths
    recording, logging = record.shape[0] > 0, log.events.shape[0] > 0
    first, last, stride, origin, threshold = counting
    scattered = is_scattered(lower) or is_scattered(upper)
    work, local = aligned_rows(14), aligned_rows(SUMS)
    words = words_of(aligned_rows(2))
    several = np.zeros(SUMS)
    usual = 0.5 * flow.step
    for start in range(0, x.shape[0], LANES):
        end = min(start + LANES, x.shape[0])
        n = end - start
        xs, vs, z, z2 = (
            row_of(work, 0, n),
            row_of(work, 1, n),
            row_of(work, 2, n),
            row_of(work, 3, n),
        )
        hits, slow, owed = row_of(work, 4, n), row_of(work, 5, n), row_of(work, 6, n)
        corner_x, corner_v = row_of(work, 7, n), row_of(work, 8, n)
        before_x, before_v = row_of(work, 9, n), row_of(work, 10, n)
        place, power, struck = row_of(work, 11, n), row_of(work, 12, n), row_of(work, 13, n)
        state0, state1 = row_of(words, 0, n), row_of(words, 1, n)
        mean, square = row_of(local, X, n), row_of(local, XX, n)
        speed = row_of(local, VV, n)
        n_low, n_up = row_of(local, N_LOWER, n), row_of(local, N_UPPER, n)
        f1_low, f1_up = row_of(local, F1_LOWER, n), row_of(local, F1_UPPER, n)
        f2_low, f2_up = row_of(local, F2_LOWER, n), row_of(local, F2_UPPER, n)
        for i in range(n):
            xs[i], vs[i], hits[i], owed[i] = x[start + i], v[start + i], 0.0, kept[start + i, 0]
            struck[i] = kept[start + i, 1]
            place[i], power[i] = noise[0, start + i], noise[1, start + i]
            state0[i], state1[i] = streams[0, start + i], streams[1, start + i]
            for row in range(SUMS):
                local[row, i] = sums[row, start + i]
        for step in range(first, last):
            if flag[0] != 0:
                break
            normals_of_step((step - first) % 2 == 1, kick.earlier, state0, state1, z, z2)
            if scattered and ((step - first) % 2 == 0 or kick.earlier > 0.0):
                struck[:] = 0.0
            counted = step >= 0
            refined = 0
            if corner is not None:
                refined = find_near_stop(xs, vs, owed, usual, corner, lower, upper, slow)
                for i in range(n if refined > 0 else 0):
                    if slow[i] != 0.0:
                        several[:] = 0.0
                        (
                            corner_x[i], corner_v[i], owed[i], state0[i], state1[i], so_far,
                        ) = step_near_stop(
                            xs[i], vs[i], owed[i], state0[i], state1[i], int(struck[i]), corner,
                            lower, upper, threshold, several,
                            page_of(log, start + i, step, flow.step),
                        )  # fmt: skip
                        struck[i] = so_far
                        add_impacts(several, counted, local, record, step, start, i)
            if counted:
                # refined steps, known before the normal is, draw others
                if corner is None:
                    add_noise(xs, vs, z, place, power)
                else:
                    for i in range(n):
                        place[i] += 0.0 if slow[i] != 0.0 else xs[i] * z[i]
                        power[i] += 0.0 if slow[i] != 0.0 else vs[i] * z[i]
            if logging:
                for i in range(n):
                    before_x[i], before_v[i] = xs[i], vs[i]
            again = 0
            if (lower is None) and (upper is None):
                step_without_stops(xs, vs, z, kick, flow)
            elif between is not None:
                again = step_between_stops(xs, vs, z, hits, kick, flow, lower, upper)
            else:
                again = step_with_stops(xs, vs, z, hits, kick, flow, lower, upper)
            for i in range(n if refined > 0 else 0):
                if slow[i] != 0.0:
                    again -= 1 if hits[i] == AGAIN else 0
                    xs[i], vs[i], hits[i] = corner_x[i], corner_v[i], 0.0
            for _ in range(again):
                i = first_marked(hits)
                several[:] = 0.0
                xs[i], vs[i], so_far = flow_with_impacts(
                    xs[i], vs[i], flow, lower, upper, threshold, several,
                    page_of(log, start + i, step, flow.step), state0[i], int(struck[i]),
                )  # fmt: skip
                struck[i] = so_far
                hits[i] = 0.0
                add_impacts(several, counted, local, record, step, start, i)
            if counted:
                if logging:
                    for i in range(n):
                        if (hits[i] != 0.0) & (abs(hits[i]) >= threshold):
                            elapsed = time_of_hit(
                                before_x[i], before_v[i], hits[i], kick, z[i], flow, lower, upper
                            )
                            page = page_of(log, start + i, step, flow.step)
                            log_impact(page, 0, elapsed, hits[i])
                if upper is not None:
                    count_side(hits, 1.0, threshold, n_up, f1_up, f2_up)
                if lower is not None:
                    count_side(hits, -1.0, threshold, n_low, f1_low, f2_low)
                if step % stride == 0:
                    add_moments(xs, vs, origin, mean, square, speed)
                    if corner is not None:
                        # so that half the usual kick, added to all, brings what is owed
                        intensity = corner.intensity
                        for i in range(n if refined > 0 else 0):
                            speed[i] += intensity * (owed[i] - usual)
                if recording:
                    for i in range(n):
                        record[step, start + i, 0] = xs[i]
                        record[step, start + i, 1] = vs[i]
                        record[step, start + i, 2] += hits[i]
        for i in range(n):
            x[start + i], v[start + i], kept[start + i, 0] = xs[i], vs[i], owed[i]
            kept[start + i, 1] = struck[i]
            noise[0, start + i], noise[1, start + i] = place[i], power[i]
            streams[0, start + i], streams[1, start + i] = state0[i], state1[i]
            for row in range(SUMS):
                sums[row, start + i] = local[row, i]
