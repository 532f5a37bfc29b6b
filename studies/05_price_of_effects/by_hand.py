"""The same oscillator in kernels written for one case each: no stop, and one elastic stop.

They share the package's normals and the width of its blocks; everything else that a scene does not
need is left out by hand: x'' + b x' + x = w by an exact kick of the velocity and a rotation.
"""

import math

import numba
import numpy as np

from stochvi.motion.kernels.random_numbers import normal_pairs, seed_streams

LANES = 256


@numba.njit(error_model="numpy", fastmath={"contract"})
def rotate(x, v, z, e, s, c, sine):
    for i in range(x.shape[0]):
        p = e * v[i] + s * z[i]
        q = x[i]
        x[i] = c * q + sine * p
        v[i] = c * p - sine * q


@numba.njit(error_model="numpy", fastmath={"contract"})
def rotate_to_stop(x, v, z, e, s, c, sine, stop, hits, first, second):
    for i in range(x.shape[0]):
        p = e * v[i] + s * z[i]
        q = x[i]
        q1, p1 = c * q + sine * p, c * p - sine * q
        energy = p * p + q * q
        w = math.sqrt(max(energy - stop * stop, 0.0))
        sr, cr = q1 * w - p1 * stop, p1 * w + q1 * stop
        passed = (w > 0.0) & (sr > 0.0) & ((p * stop - q * w > 0.0) | (q1 > stop))
        w = w if passed else 0.0
        factor = 2.0 * w / energy
        x[i] = min(q1 - factor * sr, stop)
        v[i] = p1 - factor * cr
        hits[i] += 1.0 if passed else 0.0
        first[i] += w
        second[i] += w * w


@numba.njit(error_model="numpy", fastmath={"contract"})
def add_moments(x, v, mean, square, speed):
    for i in range(x.shape[0]):
        mean[i] += x[i]
        square[i] += x[i] * x[i]
        speed[i] += v[i] * v[i]


@numba.njit(error_model="numpy")
def free(streams, steps, h, b, intensity):
    e = math.exp(-b * h)
    s = math.sqrt(intensity * (1.0 - e * e) / (2.0 * b))
    c, sine = math.cos(h), math.sin(h)
    z1, z2, x, v = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    mean, square, speed = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for start in range(0, streams.shape[1], LANES):
        state0, state1 = streams[0][start : start + LANES], streams[1][start : start + LANES]
        for step in range(steps):
            if step % 2 == 0:
                normal_pairs(state0, state1, z1, z2)
            rotate(x, v, z1 if step % 2 == 0 else z2, e, s, c, sine)
            add_moments(x, v, mean, square, speed)
    return square.sum() / (streams.shape[1] * steps)


@numba.njit(error_model="numpy")
def one_stop(streams, steps, h, b, intensity, stop):
    e = math.exp(-b * h)
    s = math.sqrt(intensity * (1.0 - e * e) / (2.0 * b))
    c, sine = math.cos(h), math.sin(h)
    z1, z2, x, v = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    mean, square, speed = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    hits, first, second = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for start in range(0, streams.shape[1], LANES):
        state0, state1 = streams[0][start : start + LANES], streams[1][start : start + LANES]
        for step in range(steps):
            if step % 2 == 0:
                normal_pairs(state0, state1, z1, z2)
            z = z1 if step % 2 == 0 else z2
            rotate_to_stop(x, v, z, e, s, c, sine, stop, hits, first, second)
            add_moments(x, v, mean, square, speed)
    return square.sum() / (streams.shape[1] * steps)


@numba.njit(error_model="numpy")
def normals_alone(streams, steps):
    z1, z2 = np.zeros(LANES), np.zeros(LANES)
    for start in range(0, streams.shape[1], LANES):
        state0, state1 = streams[0][start : start + LANES], streams[1][start : start + LANES]
        for _ in range(steps // 2):
            normal_pairs(state0, state1, z1, z2)
    return z1[0]


def streams_of(paths: int) -> np.ndarray:
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(1), 0, streams)
    return streams
