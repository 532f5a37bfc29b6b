"""A bar of n modes by hand: exact kick and rotation of each mode, tip, and bound on its motion.

One normal number kicks all modes. The lanes in which the hull of the cubic through the ends of a
step reaches a stop are counted; what they would do there is left out, and so are all sums.
"""

import numba
import numpy as np

from stochvi.motion.kernels.random_numbers import normal_pairs

LANES = 256


@numba.njit(error_model="numpy", fastmath={"contract"})
def advance(q, p, z, mode, y, before, after):
    """One step of one mode, and its part of the displacement and of both velocities of the tip."""
    c, sine, turn, e, s, shape = mode
    for i in range(q.shape[0]):
        x, v = q[i], e * p[i] + s * z[i]
        q[i], p[i] = c * x + sine * v, c * v - turn * x
        before[i] += shape * v
        y[i] += shape * q[i]
        after[i] += shape * p[i]


@numba.njit(error_model="numpy", fastmath={"contract"})
def reaching(y0, v0, y1, v1, third, stop):
    """Number of lanes whose hull reaches a stop at +-stop."""
    count = 0
    for i in range(y0.shape[0]):
        leaving, coming = y0[i] + third * v0[i], y1[i] - third * v1[i]
        high = max(max(leaving, coming), max(y0[i], y1[i]))
        low = min(min(leaving, coming), min(y0[i], y1[i]))
        count += 1 if (high > stop) | (low < -stop) else 0
    return count


@numba.njit(error_model="numpy")
def bar_by_hand(streams, steps, h, stop, modes):
    """Advance blocks of paths from rest by `steps` steps of h; `modes` has a row for each mode."""
    q, p = np.zeros((len(modes), LANES)), np.zeros((len(modes), LANES))
    z1, z2, y0, y1 = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    v0, v1, count = np.zeros(LANES), np.zeros(LANES), 0
    for start in range(0, streams.shape[1], LANES):
        state0, state1 = streams[0][start : start + LANES], streams[1][start : start + LANES]
        for step in range(steps):
            if step % 2 == 0:
                normal_pairs(state0, state1, z1, z2)
            y1[:] = v0[:] = v1[:] = 0.0
            for k in range(len(modes)):
                m = modes[k]
                row = (m[0], m[1], m[2], m[3], m[4], m[5])
                advance(q[k], p[k], z1 if step % 2 == 0 else z2, row, y1, v0, v1)
            count += reaching(y0, v0, y1, v1, h / 3.0, stop)
            y0, y1 = y1, y0
    return count
