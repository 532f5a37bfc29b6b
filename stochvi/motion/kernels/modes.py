"""Any linear structure with stops, in modal coordinates. Chapters: products of a sparse matrix and
many states; the kernel."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int64
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    ENDED,
    NO_RECORD,
    PEAK,
    ROWS_OF_CONTACT_PAIR,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    Log,
    cleared,
    fma,
)
from stochvi.engine.borrowed import borrowed, lent
from stochvi.engine.calls import (
    NO_STATISTICS,
    Characteristics,
    Statistics,
    Stops,
    add_pulls_of_parts,
    add_statistics,
    all_rates,
    apart,
    call_apart,
    draw_all,
    force_of,
    kick_all,
    move_all,
    remembering,
    take_samples,
)
from stochvi.engine.compiling import kernel
from stochvi.engine.compliant_contacts import END_ROWS, Following, Workspace, make_workspace
from stochvi.engine.sub_steps import Responses
from stochvi.engine.together import (
    Ends,
    Known,
    Scene,
    Waiting,
    finish_together,
    make_waiting,
)
from stochvi.motion.kernels.random_numbers import normal_pairs

# ------------------------------------------------------------------------------
# Products of a sparse matrix and the states of many paths, one loop over the paths a row.
#
# A matrix is a table (starts, columns, weights) of its nonzero elements, row after row. A row is
# put where it is called: as a call of its own it took a seventh of a step.
# ------------------------------------------------------------------------------


@kernel
def matrix_pass(out, keep, sources, table, width):
    """out = keep out + matrix . sources in the first `width` lanes; `table` holds the matrix."""
    for row in range(table[0].shape[0] - 1):
        row_pass(out, row, keep, sources, table, width)


@kernel
def matrix_passes(out, sources, table, others, of_others, width):
    """out = matrix . sources + other matrix . others in the first `width` lanes.

    A row with two products of each, as of a mode and two normals, is one loop over the lanes.
    """
    starts, columns, weights = table
    firsts, places, factors = of_others
    for row in range(starts.shape[0] - 1):
        k, m = starts[row], firsts[row]
        if (starts[row + 1] - k == 2) & (firsts[row + 1] - m == 2):
            set_two_and_two(
                out, row, sources, (columns[k], columns[k + 1]), (weights[k], weights[k + 1]),
                others, (places[m], places[m + 1]), (factors[m], factors[m + 1]), width,
            )  # fmt: skip
        else:
            row_pass(out, row, 0.0, sources, table, width)
            row_pass(out, row, 1.0, others, of_others, width)


@kernel(forceinline=True)
def row_pass(out, row, keep, sources, table, width):
    """out[row] = keep out[row] + the products of a row, up to four in one loop over the lanes."""
    starts, columns, weights = table
    k, last = starts[row], starts[row + 1]
    kept = keep
    while k < last:
        if last - k >= 4:
            add_four(
                out, row, kept, sources,
                (columns[k], columns[k + 1], columns[k + 2], columns[k + 3]),
                (weights[k], weights[k + 1], weights[k + 2], weights[k + 3]), width,
            )  # fmt: skip
            k += 4
        elif last - k >= 2:
            both, pair = (columns[k], columns[k + 1]), (weights[k], weights[k + 1])
            add_two(out, row, kept, sources, both, pair, width)
            k += 2
        else:
            add_one(out, row, kept, sources, columns[k], weights[k], width)
            k += 1
        kept = 1.0


@kernel
def add_one(out, row, keep, x, column, weight, width):
    """out[row] = keep out[row] + weight x[column]."""
    for i in range(width):
        out[row, i] = fma(weight, x[column, i], keep * out[row, i])


@kernel
def add_two(out, row, keep, x, columns, weights, width):
    """out[row] = keep out[row] + the products of two weights with their rows of x."""
    j, k = columns
    a, b = weights
    for i in range(width):
        out[row, i] = fma(b, x[k, i], fma(a, x[j, i], keep * out[row, i]))


@kernel
def add_four(out, row, keep, x, columns, weights, width):
    """out[row] = keep out[row] + the products of four weights with their rows of x."""
    j, k, m, n = columns
    a, b, c, d = weights
    for i in range(width):
        out[row, i] = fma(
            d, x[n, i], fma(c, x[m, i], fma(b, x[k, i], fma(a, x[j, i], keep * out[row, i])))
        )


@kernel(forceinline=True)
def set_two_and_two(out, row, x, columns, weights, y, others, factors, width):
    """out[row] = the products of two weights with their rows of x, and of two with rows of y."""
    j, k = columns
    a, b = weights
    m, n = others
    c, d = factors
    for i in range(width):
        out[row, i] = fma(d, y[n, i], fma(c, y[m, i], fma(b, x[k, i], a * x[j, i])))


# ------------------------------------------------------------------------------
# Any linear structure with stops, for many paths at once, in modal coordinates.
#
# State of a path: modal displacements q and velocities p (modal masses 1), then the states of the
# signals that drive the structure. One step is
#
#     kick   p <- E p + L z                 damping and white noise, exact for the velocities
#     flow   s' = A s + noise of signals    exact between impacts: s1 = F s0 + G z
#     impact v_y <- -R v_y                  within the flow; y = phi . q is the gap of a pair
#
# Without white noise the damping is part of A, and there is no kick. Kick and flow are one matrix
# pass, row by row over the lanes of a block. Impacts are searched (`engine`) in the lanes where the
# hull of the cubic through the end values of a gap reaches a stop. Two parts are absent from the
# compiled code unless the scene has them:
#
#     tables     total motion = state + Y, Y(t) the response to the tables without stops, smooth
#                and given by its samples; the state holds the response to impacts, kicks and
#                signals
#     contacts   compliant stops
#     parts      springs and dampers that are functions. They kick the velocities for half a step
#                before the kick of noise, and for half a step after it; the flow then has a pass of
#                its own, from where all kicks have led
#
# Between two samples Y is the cubic through values and slopes. Kicks do not change Y.
#
# Symbols: y0, v0, a0 and y1, v1, a1 are value, slope and curvature of the gaps at the ends of a
# step; s0, r0, s1, r1 the contributions of Y to values and slopes; z are standard normals.
# ------------------------------------------------------------------------------


Table = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]

LANES = 256
"""Number of paths that are advanced together, at most those of `engine.arithmetic`: their rows of
sums stay in the second-level cache."""


class Passes(NamedTuple):
    """Tables of `matrix_pass` for one step, each from the state before it unless stated otherwise.

    Parameters
    ----------
    states, states_drawn : the new state, from states and from normals.
    normals : the number of normals of a step, or of either half of a step that is merged.
    merged : whether a step takes the noise of two steps of half its length; `states_drawn` and
        `speeds_drawn` are then from the normals of both.
    speeds_kicked, speeds_drawn : speeds of the gaps after the kick, from states and from normals.
    bends_kicked : curvatures of the gaps after the kick.
    gaps, speeds, bends : values, speeds and curvatures of the gaps from the new state.
    kicks : what the noise of a kick adds to the modal velocities, from normals; no rows where there
        are no kicks.
    pulls : modal forces alpha of springs and dampers, from q and p; no rows where nobody asks for
        accelerations.
    """

    states: Table
    states_drawn: Table
    normals: int
    merged: bool
    speeds_kicked: Table
    speeds_drawn: Table
    bends_kicked: Table
    gaps: Table
    speeds: Table
    bends: Table
    kicks: Table
    pulls: Table


class Kicks(NamedTuple):
    """Springs and dampers that are functions, and the kick of noise beside theirs.

    Parameters
    ----------
    parts : `Characteristics`.
    sampled : (parts,), number of the relative change among those that are tabulated noise; below 0
        for other parts.
    states, states_drawn : tables of matrix passes to the states after the kick of noise, from
        states and from normals. Where there are kicks of parts, the tables of `Passes` start after
        all kicks.
    """

    parts: Characteristics
    sampled: NDArray[np.int64]
    states: Table
    states_drawn: Table


class ModalSteps(NamedTuple):
    """A structure and its stops, in steps of one length.

    Parameters
    ----------
    step : s.
    modes : number of modes.
    passes, stops, responses, known : see these classes.
        Stops are placed from the rest position.
    margins : (pairs,), m, by which the hulls of cubics are widened.
    origins : (modes,), from where moments of q are taken.
    crossed : (crossings, 2), pairs of modes (k, j) of which the noise of j is multiplied with the
        motion of k.
    """

    step: float
    modes: int
    passes: Passes
    stops: Stops
    margins: NDArray[np.float64]
    responses: Responses
    known: Known
    origins: NDArray[np.float64]
    crossed: NDArray[np.int64]


class SmoothResponse(NamedTuple):
    """The response Y to tables without stops.

    Parameters
    ----------
    samples : (samples, modes, 2 paths), values, and slopes divided by `scale`, in turn. The first
        counted step ends at sample 0. Behind the modes come the relative changes that are tabulated
        noise.
    scale : rad/s.
    gaps, speeds : tables of matrix passes to gaps and their rates, from the rows of `read_sample`.
    half_kick : table of a matrix pass from velocities before the kick to those in its middle, of
        which moments are taken.
    """

    samples: NDArray[np.float64]
    scale: float
    gaps: Table
    speeds: Table
    half_kick: Table


class ModalPaths(NamedTuple):
    """State of the paths that a kernel advances, and the sums that it adds to.

    Parameters
    ----------
    state : (states, paths), q, p and signals at the start, replaced by those at the end.
    streams : (2, paths), random streams, advanced.
    gaps, peaks : (pairs, paths) and (paths, pairs, 2), replaced: the values of the gaps, nan where
        they are to be taken from the state, and the largest forces so far of contacts that last, of
        the lower and the upper stops.
    sums : (rows, paths), added to: q; q q' and p p' by rows of the upper triangle; then the rows of
        each pair, ROWS_OF_CONTACT_PAIR with compliant stops, else ROWS_OF_PAIR; with `Passes.pulls`
        alpha and the upper triangle of alpha alpha', contact forces included; then three rows of
        each spring or damper that is a function (`kick_all`), and one of each statistic. Where
        there are more rows, they are added to from: `add_noise`, if there are kicks; moments of Y,
        and its passages (`add_passages`), if there are tables.
    """

    state: NDArray[np.float64]
    streams: NDArray[np.uint64]
    gaps: NDArray[np.float64]
    peaks: NDArray[np.float64]
    sums: NDArray[np.float64]


class Steps(NamedTuple):
    """Which steps paths are advanced by.

    Parameters
    ----------
    first, last : number of the first step, and of the one after the last. Steps with negative
        numbers are a burn-in, which is not counted. As for `flight.Counting`, each of several calls
        but the last must take an even number of steps.
    stride : number of steps from one sample of the moments to the next; samples precede the kick.
    """

    first: int
    last: int
    stride: int


class Largest(NamedTuple):
    """Largest absolute accelerations in the contacts of the counted part of paths.

    Parameters
    ----------
    rows : (outputs, modes), from modal forces of springs, dampers and stops to accelerations.
    table : (paths, outputs), m/s^2 or rad/s^2, updated at every sub-step of a contact; or (paths,
        outputs + 2 pairs), with the largest push (N/kg) and deflection (m) of each pair.
    """

    rows: NDArray[np.float64]
    table: NDArray[np.float64]


class Until(NamedTuple):
    """Where each path ends, if it does not make all steps; what it has seen, and where it ended.

    Parameters
    ----------
    squares : (modes,), omega^2, for E2 = p . p + q . omega^2 q, twice the energy without that of
        the stops.
    level : E2 at which a path ends.
    impacts : whether an impact that is counted ends a path.
    forces : (pairs, 2), force per unit of the reduced mass of the lower and the upper stop above
        which a path ends.
    most : (paths,), number of steps after which a path ends.
    state, streams, steps : (states, paths), (2, paths) and (paths,), replaced by those at the end;
        `steps` are 0 before.
    top : (paths,), raised to the largest E2 at the ends of steps.
    seen : (paths,), replaced by the number of impacts that are counted.
    happened : (paths,), replaced by whether an impact or a force ended the path.
    """

    squares: NDArray[np.float64]
    level: float
    impacts: bool
    forces: NDArray[np.float64]
    most: NDArray[np.int64]
    state: NDArray[np.float64]
    streams: NDArray[np.uint64]
    steps: NDArray[np.int64]
    top: NDArray[np.float64]
    seen: NDArray[np.float64]
    happened: NDArray[np.bool_]


NO_END = Until(
    np.zeros(0), 0.0, False, np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros((0, 0)),
    np.zeros((2, 0), np.uint64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0, bool),
)  # fmt: skip
"""Every path makes all steps."""


class Outputs(NamedTuple):
    """What a kernel writes besides its sums; by default nothing.

    Parameters
    ----------
    record : zeros (steps, paths, 2 modes + pairs), which get q, p and the signed impact speeds of
        every counted step; without samples there is no record.
    log : None, or a `Log`, which gets the impacts in the counted steps.
    largest : None, or `Largest`, where there are tables and no kicks, and `Passes.pulls`.
    statistics : functions of the motion that are added up with the moments; by default none.
    until : where paths end, without tables; the state and the sums of one that has ended early are
        of no use, nor are those of its contacts.
    """

    record: NDArray[np.float64] = NO_RECORD
    log: Log | None = None
    largest: Largest | None = None
    statistics: Statistics = NO_STATISTICS
    until: Until = NO_END


@kernel
def fill_modal_spectrum(streams, real, imaginary, relative, spectrum):
    """Gaussian spectra of Y + i Y' / w0 of all modes, from the same random coefficients.

    Y = Re sum_t (a_t - i b_t) B_t e^iwt, with a and b standard normals of each bin and table.

    Parameters
    ----------
    streams : (2, paths) random streams, advanced by a pair of normals per bin and table.
    real, imaginary : (bins, modes, tables), B of the bins 1, 2, ...; relative : (bins,), w / w0.
    spectrum : (samples, modes, 2 paths), replaced. The inverse transform must not divide by
        `samples`.
    """
    samples, modes, paths = spectrum.shape[0], spectrum.shape[1], streams.shape[1]
    bins, tables = real.shape[0], real.shape[2]
    cosine, sine = np.empty(paths), np.empty(paths)
    spectrum[:] = 0.0
    for k in range(bins):
        above, below = 0.5 * (1.0 - relative[k]), 0.5 * (1.0 + relative[k])
        for table in range(tables):
            normal_pairs(streams[0], streams[1], cosine, sine)
            for m in range(modes):
                u, w = real[k, m, table], imaginary[k, m, table]
                up, down = spectrum[k + 1, m], spectrum[samples - 1 - k, m]
                for i in range(paths):
                    first = cosine[i] * u + sine[i] * w
                    second = cosine[i] * w - sine[i] * u
                    up[2 * i] += above * first
                    up[2 * i + 1] += above * second
                    down[2 * i] += below * first
                    down[2 * i + 1] -= below * second


@kernel
def read_sample(sample, scale, start, lanes, modes, smooth):
    """Rows of values, then rows of slopes of Y, from a sample (rows, 2 paths) of both in turn; then
    rows of values and rows of slopes of what comes behind the modes."""
    rows = sample.shape[0]
    for m in range(modes):
        for i in range(lanes):
            smooth[m, i] = sample[m, 2 * (start + i)]
            smooth[modes + m, i] = scale * sample[m, 2 * (start + i) + 1]
    for m in range(modes, rows):
        for i in range(lanes):
            smooth[modes + m, i] = sample[m, 2 * (start + i)]
            smooth[rows + m, i] = scale * sample[m, 2 * (start + i) + 1]


@kernel
def add_to(total, part):
    """total += part, row by row."""
    for j in range(part.shape[0]):
        for i in range(part.shape[1]):
            total[j, i] += part[j, i]


@kernel
def add_up(total, one, other):
    """total = one + other, over the rows of `total`."""
    for j in range(total.shape[0]):
        for i in range(total.shape[1]):
            total[j, i] = one[j, i] + other[j, i]


@kernel
def add_curvatures(a0, a1, s0, r0, s1, r1, step):
    """Add the curvatures at both ends of the cubic through values s and slopes r."""
    for j in range(a0.shape[0]):
        for i in range(a0.shape[1]):
            rise = 6.0 * (s1[j, i] - s0[j, i]) / (step * step)
            a0[j, i] += rise - (4.0 * r0[j, i] + 2.0 * r1[j, i]) / step
            a1[j, i] -= rise - (2.0 * r0[j, i] + 4.0 * r1[j, i]) / step


@kernel
def mark_near_stops(y0, v0, y1, v1, j, third, lower, upper, marks):
    """Mark the lanes where the hull of the cubic of gap j reaches a stop by a positive number."""
    for i in range(marks.shape[0]):
        leaving = y0[j, i] + third * v0[j, i]
        coming = y1[j, i] - third * v1[j, i]
        high = max(max(leaving, coming), max(y0[j, i], y1[j, i])) - upper
        low = lower - min(min(leaving, coming), min(y0[j, i], y1[j, i]))
        marks[i] = max(marks[i], max(high, low))


@kernel
def gather_marked(marks, lanes, index):
    """Write the numbers of the marked lanes into `index`; returns how many there are."""
    count = 0
    for i in range(lanes):
        index[count] = i
        count += 1 if marks[i] > 0.0 else 0
    return count


@kernel
def add_product(total, row, x, j, origin_j, k, origin_k):
    """total[row] += (x[j] - origin_j) (x[k] - origin_k)."""
    for i in range(total.shape[1]):
        total[row, i] += (x[j, i] - origin_j) * (x[k, i] - origin_k)


@kernel
def add_row(total, row, x, j, origin):
    """total[row] += x[j] - origin."""
    for i in range(total.shape[1]):
        total[row, i] += x[j, i] - origin


@kernel
def add_moments(local, modes, state, origins):
    """Add q, then the upper triangles of q q' and of p p', to their sums."""
    row = modes
    for k in range(modes):
        add_row(local, k, state, k, origins[k])
        for m in range(k, modes):
            add_product(local, row, state, k, origins[k], m, origins[m])
            row += 1
    for k in range(modes, 2 * modes):
        for m in range(k, 2 * modes):
            add_product(local, row, state, k, 0.0, m, 0.0)
            row += 1


@kernel
def add_noise(local, first, modes, state, kicks, crossed):
    """Add q_k f_j, p_k f_j and f_k f_j of each crossing (k, j) from row `first` on.

    `kicks` (modes, lanes) is what noise adds to the velocities, the state is the one before.
    """
    for number in range(crossed.shape[0]):
        k, j, row = crossed[number, 0], crossed[number, 1], first + 3 * number
        for i in range(local.shape[1]):
            local[row, i] = fma(state[k, i], kicks[j, i], local[row, i])
            local[row + 1, i] = fma(state[modes + k, i], kicks[j, i], local[row + 1, i])
            local[row + 2, i] = fma(kicks[k, i], kicks[j, i], local[row + 2, i])


@kernel
def add_passages(local, first, places, before, after):
    """Add up the passages of gaps beyond their stops between two samples (pairs, lanes).

    For the lower and the upper stop of each pair these are three rows from `first` on: the number
    of passages, the sum of the rises over them, and the sum of the squares of these.
    """
    for j in range(places.shape[0]):
        for which in range(2):
            side, row = 2.0 * which - 1.0, first + 6 * j + 3 * which
            level = side * places[j, which]
            for i in range(local.shape[1]):
                y0, y1 = side * before[j, i], side * after[j, i]
                passed = (y0 < level) & (y1 >= level)
                rise = y1 - y0 if passed else 0.0
                local[row, i] += 1.0 if passed else 0.0
                local[row + 1, i] += rise
                local[row + 2, i] += rise * rise


@kernel
def add_pulls(local, first, pulled):
    """Add the rows of `pulled`, then the upper triangle of their products, from row `first` on."""
    row = first + pulled.shape[0]
    for k in range(pulled.shape[0]):
        add_row(local, first + k, pulled, k, 0.0)
        for m in range(k, pulled.shape[0]):
            add_product(local, row, pulled, k, 0.0, m, 0.0)
            row += 1


@kernel
def add_contact_pulls(pulled, y, v, stops, laws, responses):
    """Add the modal forces of the compliant stops, at gaps y and rates v (pairs, lanes)."""
    modes = pulled.shape[0]
    for j in range(y.shape[0]):
        for which in range(2):
            kind, row = stops.kinds[j, which], 2 * j + which
            if stops.rigid[j, which]:
                continue
            side = 2.0 * which - 1.0
            for i in range(y.shape[1]):
                inwards = side * (y[j, i] - stops.places[j, which])
                if inwards > 0.0:
                    force = force_of(laws, kind, stops.numbers, row, inwards, side * v[j, i])
                    force = side * max(force, 0.0)
                    for k in range(modes):
                        pulled[k, i] += force * responses.states[j, modes + k, 0]


@kernel
def is_exceeded(forces, hits, peaks, i):
    """Whether the force of a stop exceeded its limit in a step, in contacts that last or ended.

    Contacts with one stop that ended in one step count with their mean peak force: so soon after
    one another they are nearly alike. Their sums begin anew.
    """
    exceeded = False
    for j in range(forces.shape[0]):
        for which in range(2):
            row, force = ROWS_OF_PAIR + ROWS_OF_STOP * which, peaks[i, j, which]
            ended = hits[j, row + ENDED, i]
            if ended > 0.0:
                force = max(force, hits[j, row + PEAK, i] / ended)
            hits[j, row + PEAK, i] = hits[j, row + ENDED, i] = 0.0
            exceeded |= force > forces[j, which]
    return exceeded


@kernel
def mark_ends(until, state, hits, marks, start, lanes, made):
    """Mark the lanes that have not ended before, and end now by their energy, impacts, or time;
    returns how many have not ended before."""
    steps, top, most = until.steps[start:], until.top[start:], until.most[start:]
    going, modes = 0, until.squares.shape[0]
    for i in range(lanes):
        marks[i] = 0.0
    for k in range(modes):
        for i in range(lanes):
            q, p = state[k, i], state[modes + k, i]
            marks[i] += p * p + until.squares[k] * q * q
    for i in range(lanes):
        on, energy = steps[i] == 0, marks[i]
        top[i] = max(top[i], energy) if on else top[i]
        marks[i] = 1.0 if on & ((energy >= until.level) | (made >= most[i])) else 0.0
        going += 1 if on else 0
    for j in range(hits.shape[0] if until.impacts else 0):
        for i in range(lanes):
            hit = (steps[i] == 0) & (hits[j, 0, i] + hits[j, 3, i] > 0.0)
            marks[i] = 1.0 if hit else marks[i]
    return going


@kernel
def end_paths(until, state, hits, peaks, marks, words0, words1, start, lanes, made):
    """Note where paths end after `made` steps; returns how many of the lanes go on."""
    going = mark_ends(until, state, hits, marks, start, lanes, made)
    forced = until.forces.shape[0] > 0
    for i in range(lanes):
        path = start + i
        exceeded = forced and until.steps[path] == 0 and is_exceeded(until.forces, hits, peaks, i)
        if (marks[i] == 0.0) & (not exceeded):
            continue
        seen = 0.0
        for j in range(hits.shape[0]):
            seen += hits[j, 0, i] + hits[j, 3, i]
        until.happened[path] = exceeded | (until.impacts & (seen > 0.0))
        until.steps[path], until.seen[path] = made, seen
        until.streams[0, path], until.streams[1, path] = words0[i], words1[i]
        for row in range(until.state.shape[0]):
            until.state[row, path] = state[row, i]
        going -= 1
    return going


@kernel
def take_largest(largest, start, lanes, table):
    """The largest accelerations of some lanes before their counted steps."""
    if largest is None:
        return
    for i in range(lanes):
        for column in range(table.shape[1]):
            table[i, column] = largest.table[start + i, column]


@kernel
def keep_largest(largest, start, lanes, table):
    """Write those after their counted steps."""
    if largest is None:
        return
    for i in range(lanes):
        for column in range(table.shape[1]):
            largest.table[start + i, column] = table[i, column]


class Seldom(NamedTuple):
    """What few scenes need, by `apart`: `end_paths`, `add_statistics`, and `add_contact_pulls`."""

    ends: Any
    statistics: Any
    contact_pulls: Any


class Room(NamedTuple):
    """Arrays of a kernel: rows of numbers, with a lane for each path.

    Parameters
    ----------
    old, new, drawn, kicked : states before and after a step, normals, and what noise adds to the
        modal velocities.
    y0, v0, a0, y1, v1, a1, s0, r0, s1, r1 : as named above.
    marks, index : whether a lane may reach a stop, and the numbers of those that may.
    local, hits, spared : sums, a view of their rows of pairs, (pairs, rows, lanes), and such rows
        for impacts that do not count.
    before : (pairs, lanes), sums of the speeds of impacts before a step, for records.
    peaks : (lanes, pairs, 2), largest forces so far of contacts that last.
    words0, words1 : random streams.
    smooth, total, rest : Y, the total motion, and zeros (modes,).
    pulled, pushing, pull_0, pull_1 : modal forces, rates of gaps, modal forces at the ends of a
        step.
    mid, parts_x, parts_v, parts_w, parts_0, parts_1, parts_2 : states after all kicks, and rows of
        springs and dampers that are functions.
    of_one : (2, lanes), displacements and rates of one statistic.
    followed : (lanes, columns of `Largest.table`), the largest of each lane.
    following : `Following`; None where no acceleration is wanted.
    seldom : `Seldom`.
    work, waiting : `Workspace` and `Waiting`, which is None where all stops are rigid.
    """

    old: NDArray[np.float64]
    new: NDArray[np.float64]
    drawn: NDArray[np.float64]
    kicked: NDArray[np.float64]
    y0: NDArray[np.float64]
    v0: NDArray[np.float64]
    a0: NDArray[np.float64]
    y1: NDArray[np.float64]
    v1: NDArray[np.float64]
    a1: NDArray[np.float64]
    s0: NDArray[np.float64]
    r0: NDArray[np.float64]
    s1: NDArray[np.float64]
    r1: NDArray[np.float64]
    marks: NDArray[np.float64]
    index: NDArray[np.int64]
    local: NDArray[np.float64]
    hits: NDArray[np.float64]
    spared: NDArray[np.float64]
    before: NDArray[np.float64]
    peaks: NDArray[np.float64]
    words0: NDArray[np.uint64]
    words1: NDArray[np.uint64]
    smooth: NDArray[np.float64]
    total: NDArray[np.float64]
    rest: NDArray[np.float64]
    pulled: NDArray[np.float64]
    pushing: NDArray[np.float64]
    pull_0: NDArray[np.float64]
    pull_1: NDArray[np.float64]
    mid: NDArray[np.float64]
    parts_x: NDArray[np.float64]
    parts_v: NDArray[np.float64]
    parts_w: NDArray[np.float64]
    parts_0: NDArray[np.float64]
    parts_1: NDArray[np.float64]
    parts_2: NDArray[np.float64]
    of_one: NDArray[np.float64]
    followed: NDArray[np.float64]
    following: Following | None
    seldom: Seldom
    work: Workspace
    waiting: Waiting | None


def make_room(
    paths: ModalPaths, structure: ModalSteps, laws: NDArray[Any], tables: SmoothResponse | None,
    kicks: Kicks | None, outputs: Outputs, fastest: float | None,
) -> Room:  # fmt: skip
    """`Room` for what `run_modes` is given; `fastest` is None where all stops are rigid, else the
    fastest rate of the structure, rad/s."""
    passes, modes, pairs = structure.passes, structure.modes, len(structure.stops.places)
    states, width = len(paths.state), min(LANES, paths.state.shape[1])
    rows = ROWS_OF_PAIR if fastest is None else ROWS_OF_CONTACT_PAIR
    first = modes + modes * (modes + 1)
    local = cleared(len(paths.sums), width)
    work = make_workspace(pairs, *structure.responses.states.shape[1:])
    parts = 0 if kicks is None else len(kicks.parts.rows)
    sampled = 0 if tables is None else tables.samples.shape[1] - modes
    largest = outputs.largest
    columns = 0 if largest is None else largest.table.shape[1]
    room = Room(
        *(cleared(states, width) for _ in ("old", "new")),
        cleared(2 * passes.normals, width), cleared(len(passes.kicks[0]) - 1, width),
        *(cleared(pairs, width) for _ in range(10)),
        cleared(width), cleared(width + 1, of=np.int64),
        local, local[first : first + rows * pairs].reshape((pairs, rows, width)),
        cleared(pairs, rows, width), cleared(pairs, width),
        cleared(width, pairs, 2), *(cleared(width, of=np.uint64) for _ in range(2)),
        cleared(2 * (modes + sampled), width), cleared(2 * modes, width), cleared(modes),
        cleared(modes, width), cleared(pairs, width), cleared(modes, width),
        cleared(modes, width), cleared(states if parts else 0, width),
        *(cleared(parts, width) for _ in range(6)),
        cleared(2, width), cleared(width, columns), None, Seldom(None, None, None), work, None,
    )  # fmt: skip
    if largest is not None:
        ends = cleared(END_ROWS, len(largest.rows))
        following = Following(largest.rows, room.pull_0, room.pull_1, ends, room.followed)
        room = room._replace(following=following)
    room = room._replace(seldom=seldom_called(structure, laws, outputs, room, fastest is not None))
    if fastest is None:
        return room
    scene = example_of_scene(structure, laws, outputs, room)
    waiting = make_waiting(width, fastest, structure.stops, len(work.numbers), scene)
    return room._replace(waiting=waiting)


def seldom_called(
    structure: ModalSteps, laws: NDArray[Any], outputs: Outputs, room: Room, compliant: bool
) -> Seldom:
    """`Seldom` for what `run_modes` is given, and whether any stop is compliant."""
    until, statistics = outputs.until, outputs.statistics
    of_lanes = room.old, room.hits, room.peaks, room.marks, room.words0, room.words1
    of_statistics = lent(statistics), room.old, room.words0, 0, room.of_one, room.local, 0, 0
    forces = room.pulled, room.y0, room.pushing
    of_contacts = *forces, lent(structure.stops), laws, lent(structure.responses)
    pulls = compliant and len(structure.passes.pulls[0]) > 1
    return Seldom(
        apart(
            end_paths, (lent(until), *of_lanes, 0, 0, 0), wanted=len(until.most) > 0, returns=int64
        ),
        apart(add_statistics, of_statistics, wanted=len(statistics.places) > 0),
        apart(add_contact_pulls, of_contacts, wanted=pulls),
    )


def example_of_scene(
    structure: ModalSteps, laws: NDArray[Any], outputs: Outputs, room: Room
) -> Scene:
    """A `Scene` with the types of those that `run_modes` makes."""
    return Scene(
        structure.step, lent(structure.stops), laws, lent(structure.responses),
        lent(structure.known), lent(room.work),
        Ends(room.y0, room.v0, room.a0, room.y1, room.v1, room.a1), room.new, room.hits, room.peaks,
        room.words0, lent(outputs.log), 0, 0, lent(room.following),
    )  # fmt: skip


@kernel
def run_modes(paths, structure, laws, tables, kicks, steps, outputs, room, flag):
    """Advance every path, and add up the counted steps.

    Named tuples are `lent`.

    Parameters
    ----------
    paths : `ModalPaths`.
    structure : `ModalSteps`.
    laws : `functions_of` the laws of the stops.
    tables : None, or `SmoothResponse`.
    kicks : None, or `Kicks`.
    steps : `Steps`.
    outputs : `Outputs`.
    room : `Room`.
    flag : (1,), looked at before every step: where it is not 0, the paths are given up, without a
        result.
    """
    laws, flag = borrowed(laws), borrowed(flag)
    state, streams, known, lasting = paths.state, paths.streams, paths.gaps, paths.peaks
    sums = paths.sums
    first, last, stride = steps.first, steps.last, steps.stride
    record, log, largest = outputs.record, outputs.log, outputs.largest
    statistics = outputs.statistics
    step, modes, passes = structure.step, structure.modes, structure.passes
    stops, responses = structure.stops, structure.responses
    margins = structure.margins
    origins, normals = structure.origins, passes.normals
    states, count_of_paths = state.shape
    pairs, rows, width = room.hits.shape
    moments = modes + modes * (modes + 1)
    third = step / 3.0
    recording = record.shape[0] > 0
    first_pull = moments + rows * pairs
    pulling = passes.pulls[0].shape[0] > 1
    first_part = first_pull + (modes + modes * (modes + 1) // 2 if pulling else 0)
    first_statistic = first_part + 3 * room.parts_x.shape[0]
    first_noise = first_statistic + statistics.places.shape[0]
    controlled = sums.shape[0] > first_noise
    crossings = structure.crossed.shape[0] if room.kicked.shape[0] > 0 else 0
    first_free = first_noise + 3 * crossings
    following = room.followed.shape[1] > 0
    old, new, drawn, kicked = room.old, room.new, room.drawn, room.kicked
    y0, v0, a0, y1, v1, a1 = room.y0, room.v0, room.a0, room.y1, room.v1, room.a1
    s0, r0, s1, r1 = room.s0, room.r0, room.s1, room.r1
    marks, index, local = room.marks, room.index, room.local
    hits, earlier, peaks = room.hits, room.before, room.peaks
    words0, words1, smooth, total = room.words0, room.words1, room.smooth, room.total
    pulled, pushing, pull_0, pull_1 = room.pulled, room.pushing, room.pull_0, room.pull_1
    seldom = room.seldom
    mid, of_parts = room.mid, (room.parts_x, room.parts_v, room.parts_w)
    of_ends = room.parts_0, room.parts_1, room.parts_2
    for start in range(0, count_of_paths, LANES):
        lanes = min(LANES, count_of_paths - start)
        for i in range(lanes):
            words0[i], words1[i] = streams[0, start + i], streams[1, start + i]
            for row in range(local.shape[0]):
                local[row, i] = sums[row, start + i]
            for j in range(pairs):
                peaks[i, j, 0], peaks[i, j, 1] = lasting[start + i, j, 0], lasting[start + i, j, 1]
            for row in range(states):
                old[row, i] = state[row, start + i]
        matrix_pass(y0, 0.0, old, passes.gaps, width)
        if tables is not None:
            samples = tables.samples.shape[0]
            before = tables.samples[(first - 1) % samples]
            read_sample(before, tables.scale, start, lanes, modes, smooth)
            matrix_pass(s0, 0.0, smooth, tables.gaps, width)
            matrix_pass(r0, 0.0, smooth, tables.speeds, width)
            add_to(y0, s0)
        for j in range(pairs):
            for i in range(lanes):
                if not math.isnan(known[j, start + i]):
                    y0[j, i] = known[j, start + i]
        if following:
            add_up(total, old, smooth)
            matrix_pass(pull_0, 0.0, total, passes.pulls, width)
        for number in range(first, last):
            if flag[0] != 0:
                break
            counted = number >= 0
            if number == max(first, 0):
                take_largest(largest, start, lanes, room.followed)
            half = (number - first) % 2
            if (half == 0) | passes.merged:
                for row in range(normals):
                    normal_pairs(words0, words1, drawn[row], drawn[normals + row])
            z = drawn
            if not passes.merged:
                z = borrowed(drawn[half * normals : (half + 1) * normals])
            if counted & controlled & (crossings > 0):
                matrix_pass(kicked, 0.0, z, passes.kicks, width)
                add_noise(local, first_noise, modes, old, kicked, structure.crossed)
            before = old
            if kicks is not None:
                matrix_pass(mid, 0.0, old, kicks.states, width)
                matrix_pass(mid, 1.0, z, kicks.states_drawn, width)
                at = first_part if counted else -1
                halves = 2 if passes.merged else 1
                half_step = 4 * (number if passes.merged else (number - half) >> 1)
                half_step += 0 if passes.merged else 2 * half
                draw_all(kicks.parts, mid, words0, half_step, halves, 0.5 * step, width)
                if tables is not None:
                    take_samples(
                        kicks.sampled, kicks.parts.memories, mid, smooth, 2 * modes, width
                    )  # fmt: skip
                kick_all(kicks.parts, False, mid, smooth, of_parts, 0.5 * step, width, local, at)
                if remembering(kicks.parts):
                    all_rates(kicks.parts, mid, smooth, of_ends[0], width)
                before = mid
            matrix_passes(new, before, passes.states, z, passes.states_drawn, width)
            if tables is not None:
                sample = tables.samples[number % samples]
                read_sample(sample, tables.scale, start, lanes, modes, smooth)
            if kicks is not None:  # noqa: SIM102 - left out when compiled
                if remembering(kicks.parts):
                    all_rates(kicks.parts, new, smooth, of_ends[1], width)
            if pairs > 0:
                matrix_pass(v0, 0.0, before, passes.speeds_kicked, width)
                matrix_pass(v0, 1.0, z, passes.speeds_drawn, width)
                matrix_pass(y1, 0.0, new, passes.gaps, width)
                matrix_pass(v1, 0.0, new, passes.speeds, width)
                if tables is not None:
                    matrix_pass(s1, 0.0, smooth, tables.gaps, width)
                    matrix_pass(r1, 0.0, smooth, tables.speeds, width)
                    add_to(v0, r0)
                    add_to(y1, s1)
                    add_to(v1, r1)
                marks[:] = 0.0
                for j in range(pairs):
                    lower, upper = stops.places[j, 0] + margins[j], stops.places[j, 1] - margins[j]
                    mark_near_stops(y0, v0, y1, v1, j, third, lower, upper, marks)
                count = gather_marked(marks, lanes, index)
                if following:
                    add_up(total, new, smooth)
                    matrix_pass(pull_1, 0.0, total, passes.pulls, width)
                if count > 0:
                    matrix_pass(a0, 0.0, before, passes.bends_kicked, width)
                    matrix_pass(a1, 0.0, new, passes.bends, width)
                    if tables is not None:
                        add_curvatures(a0, a1, s0, r0, s1, r1, step)
                added_to = hits if counted else room.spared
                if recording & counted:
                    for j in range(pairs):
                        for i in range(lanes):
                            earlier[j, i] = hits[j, 4, i] - hits[j, 1, i]
                scene = Scene(
                    step, stops, laws, responses, structure.known, room.work,
                    Ends(y0, v0, a0, y1, v1, a1), new, added_to, peaks, words0, log, start,
                    number, room.following,
                )  # fmt: skip
                if count > 0:
                    finish_together(index[:count], borrowed(scene), room.waiting)
                if recording & counted:
                    for j in range(pairs):
                        for i in range(lanes):
                            speed = hits[j, 4, i] - hits[j, 1, i] - earlier[j, i]
                            record[number, start + i, 2 * modes + j] = speed
                if tables is not None:  # noqa: SIM102 - left out when compiled
                    if counted & controlled:
                        add_passages(local, first_free + moments, stops.places, s0, s1)
                y0, y1 = y1, y0
                s0, s1 = s1, s0
                r0, r1 = r1, r0
            if kicks is not None:
                if remembering(kicks.parts):
                    move_all(kicks.parts, new, smooth, of_parts, of_ends, step, width)
                at = first_part if counted else -1
                draw_all(kicks.parts, new, words0, half_step + halves, halves, 0.5 * step, width)
                if tables is not None:
                    take_samples(
                        kicks.sampled, kicks.parts.memories, new, smooth, 2 * modes, width
                    )  # fmt: skip
                kick_all(kicks.parts, True, new, smooth, of_parts, 0.5 * step, width, local, at)
            old, new = new, old
            if following:
                add_up(total, old, smooth)
                matrix_pass(pull_0, 0.0, total, passes.pulls, width)
            if outputs.until.most.shape[0] > 0:
                made = number - first + 1
                going = call_apart(
                    seldom.ends,
                    (outputs.until, old, hits, peaks, marks, words0, words1, start, lanes, made),
                )
                if going == 0:
                    break
            if counted:
                if number % stride == 0:
                    if tables is None:
                        add_moments(local, modes, old, origins)
                    else:
                        for row in range(modes):
                            for i in range(width):
                                total[row, i] = old[row, i]
                        matrix_pass(borrowed(total[modes:]), 0.0, old, tables.half_kick, width)
                        add_to(total, borrowed(smooth[: 2 * modes]))
                        add_moments(local, modes, total, origins)
                        if controlled:
                            add_moments(borrowed(local[first_free:]), modes, smooth, room.rest)
                    if statistics.places.shape[0] > 0:
                        motion = old if tables is None else total
                        call_apart(
                            seldom.statistics,
                            (
                                statistics, motion, words0, number, room.of_one, local,
                                first_statistic, width,
                            ),
                        )  # fmt: skip
                    if pulling:
                        if tables is None:
                            matrix_pass(pulled, 0.0, old, passes.pulls, width)
                        else:
                            matrix_pass(pulled, 0.0, total, passes.pulls, width)
                        if kicks is not None:
                            add_pulls_of_parts(pulled, kicks.parts, old, smooth, of_parts, width)
                        if room.waiting is not None:  # noqa: SIM102 - left out when compiled
                            if pairs > 0:
                                matrix_pass(pushing, 0.0, old, passes.speeds, width)
                                if tables is not None:
                                    add_to(pushing, r0)
                                call_apart(
                                    seldom.contact_pulls,
                                    (pulled, y0, pushing, stops, laws, responses),
                                )
                        add_pulls(local, first_pull, pulled)
                if recording:
                    for i in range(lanes):
                        for row in range(2 * modes):
                            record[number, start + i, row] = old[row, i]
                            if tables is not None:
                                record[number, start + i, row] += smooth[row, i]
        for i in range(lanes):
            streams[0, start + i], streams[1, start + i] = words0[i], words1[i]
            for row in range(states):
                state[row, start + i] = old[row, i]
            for row in range(local.shape[0]):
                sums[row, start + i] = local[row, i]
            for j in range(pairs):
                known[j, start + i] = y0[j, i]
                lasting[start + i, j, 0], lasting[start + i, j, 1] = peaks[i, j, 0], peaks[i, j, 1]
        if last > 0:
            keep_largest(largest, start, lanes, room.followed)
