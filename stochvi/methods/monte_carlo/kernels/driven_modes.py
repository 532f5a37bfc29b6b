"""Structures of several modes under tabulated noise, or with stops that give way: many paths.

The steps are those of `modes`. What is added, each absent from the compiled code unless the scene
has it:

    tables     total motion = state + Y, Y(t) the response to the tables without stops, smooth
               and given by its samples; the state holds what impacts, kicks and signals bring
    contacts   steps in which a path may meet a stop that gives way, one by one (`modal_contacts`)

Between two samples Y is the cubic through values and slopes. Noise that is kicked leaves Y alone.

Symbols: as in `modes`; y0, v0, a0 and y1, v1, a1 are value, slope and curvature of the gaps at the
ends of a step, s0, r0, s1, r1 the parts of values and slopes that Y brings.
"""

import numba
import numpy as np

from stochvi.methods.monte_carlo.kernels.modal_contacts import ROWS_OF_CONTACT_PAIR, meet_stops
from stochvi.methods.monte_carlo.kernels.modes import (
    LANES,
    ROWS_OF_PAIR,
    add_product,
    add_row,
    bounce,
    gather,
    matrix_pass,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_pairs


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def fill_modal_spectrum(streams, real, imaginary, relative, spectrum):
    """Gaussian spectra of Y + i Y' / w0 of all modes, from common coefficients.

    Y = Re sum_t (a_t - i b_t) B_t e^iwt, with a and b standard normals of each bin and table.

    Parameters
    ----------
    streams : (2, paths) random streams, advanced by a pair of normals per bin and table.
    real, imaginary : (bins, modes, tables), B of the bins 1, 2, ...; relative : (bins,), w / w0.
    spectrum : (samples, modes, 2 paths), replaced. An inverse transform is not to divide.
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


@numba.njit(cache=True, error_model="numpy")
def take_sample(sample, scale, start, lanes, smooth):
    """Values and slopes of Y, (modes, 2 paths) in turn, as rows: values, then slopes."""
    modes = sample.shape[0]
    for m in range(modes):
        for i in range(lanes):
            smooth[m, i] = sample[m, 2 * (start + i)]
            smooth[modes + m, i] = scale * sample[m, 2 * (start + i) + 1]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_to(total, part):
    """total += part, row by row."""
    for j in range(part.shape[0]):
        for i in range(part.shape[1]):
            total[j, i] += part[j, i]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_bends(a0, a1, s0, r0, s1, r1, step):
    """Curvatures at both ends of the cubic through values s and slopes r."""
    for j in range(a0.shape[0]):
        for i in range(a0.shape[1]):
            rise = 6.0 * (s1[j, i] - s0[j, i]) / (step * step)
            a0[j, i] += rise - (4.0 * r0[j, i] + 2.0 * r1[j, i]) / step
            a1[j, i] -= rise - (2.0 * r0[j, i] + 4.0 * r1[j, i]) / step


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def mark_near(y0, v0, y1, v1, j, third, lower, upper, marks):
    """Mark the lanes where the hull of the cubic of a gap, its start included, reaches a stop."""
    for i in range(marks.shape[0]):
        leaving = y0[j, i] + third * v0[j, i]
        coming = y1[j, i] - third * v1[j, i]
        high = max(max(leaving, coming), max(y0[j, i], y1[j, i])) - upper
        low = lower - min(min(leaving, coming), min(y0[j, i], y1[j, i]))
        marks[i] = max(marks[i], max(high, low))


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def add_moments(local, modes, state, origins):
    """Sums of q, q q' and p p', upper triangles in turn."""
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


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def run_driven_modes(
    state, streams, sums, step, modes, passes, stops, margins, resets, origins, tables, laws,
    structure, burn_in, steps, stride, record,
):  # fmt: skip
    """Fly every path for burn_in + steps steps; sums of the last `steps` go to `sums`.

    Parameters as in `modes.run_modes`, and

    tables : None, or Y (samples, modes, 2 paths) with values and slopes over `scale` in turn,
        `scale`, and the table of a matrix pass from velocities to those in the middle of the kick,
        of which moments are then taken. Counted steps begin with the one that ends at sample 0.
    laws, structure : None, or as in `modal_contacts.meet_stops`; pairs then have
        ROWS_OF_CONTACT_PAIR rows.
    """
    (from_states, from_normals, normals, speed_states, speed_normals, bend_states, to_gaps,
     to_speeds, to_bends) = passes  # fmt: skip
    states, paths = state.shape
    width = min(LANES, paths)
    pairs = stops.shape[0]
    moments = modes + modes * (modes + 1)
    rows = ROWS_OF_PAIR if laws is None else ROWS_OF_CONTACT_PAIR
    third = step / 3.0
    old, new = np.zeros((states, width)), np.zeros((states, width))
    drawn = np.zeros((2 * normals, width))
    y0, y1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    v0, v1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    a0, a1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    marks, index = np.zeros(width), np.zeros(width + 1, np.int64)
    local = np.zeros((moments + rows * pairs, width))
    hits, gaps, resting = np.zeros((pairs, rows)), np.zeros((pairs, 6)), np.zeros((pairs, 2))
    stack = np.zeros((64, 8))
    words0, words1 = np.zeros(width, np.uint64), np.zeros(width, np.uint64)
    smooth, total = np.zeros((2 * modes, width)), np.zeros((2 * modes, width))
    s0, s1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    r0, r1 = np.zeros((pairs, width)), np.zeros((pairs, width))
    inside, peaks = np.zeros((pairs, 2), np.int64), np.zeros((width, pairs, 2))
    room = (
        np.zeros((10, modes)), np.zeros((6, pairs)), np.zeros((6, pairs, 2)), np.zeros((pairs, 6)),
    )  # fmt: skip
    for start in range(0, paths, LANES):
        lanes = min(LANES, paths - start)
        local[:] = 0.0
        peaks[:] = 0.0
        for i in range(lanes):
            words0[i], words1[i] = streams[0, start + i], streams[1, start + i]
            for row in range(states):
                old[row, i] = state[row, start + i]
        matrix_pass(y0, 0.0, old, to_gaps, width)
        if tables is not None:
            samples = tables[0].shape[0]
            take_sample(tables[0][(-burn_in - 1) % samples], tables[1], start, lanes, smooth)
            matrix_pass(s0, 0.0, smooth, to_gaps, width)
            matrix_pass(r0, 0.0, smooth, to_speeds, width)
            add_to(y0, s0)
        for number in range(burn_in + steps):
            counted = number >= burn_in
            half = number % 2
            if half == 0:
                for row in range(normals):
                    normal_pairs(words0, words1, drawn[row], drawn[normals + row])
            z = drawn[half * normals : (half + 1) * normals]
            matrix_pass(new, 0.0, old, from_states, width)
            matrix_pass(new, 1.0, z, from_normals, width)
            if tables is not None:
                sample = tables[0][(number - burn_in) % samples]
                take_sample(sample, tables[1], start, lanes, smooth)
            if pairs > 0:
                matrix_pass(v0, 0.0, old, speed_states, width)
                matrix_pass(v0, 1.0, z, speed_normals, width)
                matrix_pass(y1, 0.0, new, to_gaps, width)
                matrix_pass(v1, 0.0, new, to_speeds, width)
                if tables is not None:
                    matrix_pass(s1, 0.0, smooth, to_gaps, width)
                    matrix_pass(r1, 0.0, smooth, to_speeds, width)
                    add_to(v0, r0)
                    add_to(y1, s1)
                    add_to(v1, r1)
                marks[:] = 0.0
                for j in range(pairs):
                    lower, upper = stops[j, 0, 0] + margins[j], stops[j, 1, 0] - margins[j]
                    mark_near(y0, v0, y1, v1, j, third, lower, upper, marks)
                count = gather(marks, lanes, index)
                if count > 0:
                    matrix_pass(a0, 0.0, old, bend_states, width)
                    matrix_pass(a1, 0.0, new, to_bends, width)
                    if tables is not None:
                        add_bends(a0, a1, s0, r0, s1, r1, step)
                for k in range(count):
                    i = index[k]
                    for j in range(pairs):
                        gaps[j, 0], gaps[j, 1], gaps[j, 2] = y0[j, i], v0[j, i], a0[j, i]
                        gaps[j, 3], gaps[j, 4], gaps[j, 5] = y1[j, i], v1[j, i], a1[j, i]
                    hits[:] = 0.0
                    if laws is None:
                        bounce(new, i, gaps, resting, step, stops, resets, hits, stack)
                    else:
                        meet_stops(
                            new, i, gaps, inside, peaks[i], resting, step, stops, resets, laws,
                            structure, room, hits, stack,
                        )  # fmt: skip
                    for j in range(pairs):
                        y1[j, i] = gaps[j, 3]
                        if counted:
                            for m in range(rows):
                                local[moments + rows * j + m, i] += hits[j, m]
                            if record is not None:
                                record[number - burn_in, start + i, 2 * modes + j] = (
                                    hits[j, 4] - hits[j, 1]
                                )
                y0, y1 = y1, y0
                s0, s1 = s1, s0
                r0, r1 = r1, r0
            old, new = new, old
            if counted:
                if (number - burn_in) % stride == 0:
                    if tables is None:
                        add_moments(local, modes, old, origins)
                    else:
                        for row in range(modes):
                            total[row] = old[row]
                        matrix_pass(total[modes:], 0.0, old, tables[2], width)
                        add_to(total, smooth)
                        add_moments(local, modes, total, origins)
                if record is not None:
                    for i in range(lanes):
                        for row in range(2 * modes):
                            record[number - burn_in, start + i, row] = old[row, i]
                            if tables is not None:
                                record[number - burn_in, start + i, row] += smooth[row, i]
        for i in range(lanes):
            streams[0, start + i], streams[1, start + i] = words0[i], words1[i]
            for row in range(states):
                state[row, start + i] = old[row, i]
            for row in range(local.shape[0]):
                sums[row, start + i] += local[row, i]
