"""Random numbers for many paths at once: one xoroshiro128++ stream per path, normals in pairs.

The stream belongs to the path: its state is expanded from (seed, path) by SplitMix64, so that
results depend neither on threads nor on how paths are gathered into blocks. Loops run over the
paths of a block, hold no branches, and vectorise.

Generator: D. Blackman and S. Vigna, ACM Trans. Math. Softw. 47 (2021) 36; two words of state, so
that a loop over paths has few arrays to prove distinct, which the vectoriser needs. Normals:
G. E. P. Box and M. E. Muller, Ann. Math. Statist. 29 (1958) 610, with both uniforms of 52 bits,
so that the largest normal is sqrt(2 * 52 ln 2) = 8.49.
"""

import math

import numpy as np

from stochvi.engine.bits import bits_of, number_of
from stochvi.engine.compiling import kernel
from stochvi.engine.fused import fma
from stochvi.engine.uniform_numbers import GOLDEN, split_mix

ONE_BITS = np.uint64(0x3FF0000000000000)
MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
S12, S15, S17, S21 = (np.uint64(n) for n in (12, 15, 17, 21))
S28, S36, S47, S49 = (np.uint64(n) for n in (28, 36, 47, 49))
LN2 = math.log(2.0)
SQRT2 = math.sqrt(2.0)
QUARTER_TURN = math.pi / 2.0


@kernel
def seed_streams(seed, first_path, state):
    """Fill `state` (2, paths) for the paths first_path, first_path + 1, ..."""
    key = split_mix(np.uint64(seed) + GOLDEN)
    for i in range(state.shape[1]):
        z = split_mix(key + np.uint64(first_path + i) * GOLDEN)
        for word in range(2):
            z += GOLDEN
            state[word, i] = split_mix(z)


@kernel(forceinline=True)
def log_unit(u):
    """Natural logarithm of 2^-52 <= u <= 1, relative error below 1e-15."""
    bits = bits_of(u)
    exponent = np.int64(bits >> np.uint64(52)) - 1023
    m = number_of((bits & MANTISSA) | ONE_BITS)
    high = m > SQRT2
    m = m * 0.5 if high else m
    e = float(exponent + 1) if high else float(exponent)
    # ln m = 2 artanh t, |t| <= 0.1716
    t = (m - 1.0) / (m + 1.0)
    q = t * t
    s = 1.0 / 21.0
    s = fma(s, q, 1.0 / 19.0)
    s = fma(s, q, 1.0 / 17.0)
    s = fma(s, q, 1.0 / 15.0)
    s = fma(s, q, 1.0 / 13.0)
    s = fma(s, q, 1.0 / 11.0)
    s = fma(s, q, 1.0 / 9.0)
    s = fma(s, q, 1.0 / 7.0)
    s = fma(s, q, 1.0 / 5.0)
    s = fma(s, q, 1.0 / 3.0)
    s = fma(s, q, 1.0)
    return fma(e, LN2, 2.0 * t * s)


@kernel(forceinline=True)
def normal_pair(s0, s1):
    """Two independent standard normals from two draws: the new state, and the normals."""
    t = s0 + s1
    draw_1 = ((t << S17) | (t >> S47)) + s0
    s1 ^= s0
    s0 = ((s0 << S49) | (s0 >> S15)) ^ s1 ^ (s1 << S21)
    s1 = (s1 << S28) | (s1 >> S36)
    t = s0 + s1
    draw_2 = ((t << S17) | (t >> S47)) + s0
    s1 ^= s0
    s0 = ((s0 << S49) | (s0 >> S15)) ^ s1 ^ (s1 << S21)
    s1 = (s1 << S28) | (s1 >> S36)

    u = 2.0 - number_of((draw_1 >> S12) | ONE_BITS)
    radius = math.sqrt(-2.0 * log_unit(u))
    # the angle is a quarter turn chosen by two bits and a remainder within +-pi/4
    a = (number_of((draw_2 >> S12) | ONE_BITS) - 1.5) * QUARTER_TURN
    q = a * a
    sine = -7.6471637318198164759e-13
    sine = fma(sine, q, 1.6059043836821614599e-10)
    sine = fma(sine, q, -2.5052108385441718775e-8)
    sine = fma(sine, q, 2.7557319223985890653e-6)
    sine = fma(sine, q, -1.9841269841269841270e-4)
    sine = fma(sine, q, 8.3333333333333333333e-3)
    sine = fma(sine, q, -1.6666666666666666667e-1)
    sine = fma(sine, q, 1.0) * a
    cosine = 4.7794773323873852974e-14
    cosine = fma(cosine, q, -1.1470745597729724714e-11)
    cosine = fma(cosine, q, 2.0876756987868098979e-9)
    cosine = fma(cosine, q, -2.7557319223985890653e-7)
    cosine = fma(cosine, q, 2.4801587301587301587e-5)
    cosine = fma(cosine, q, -1.3888888888888888889e-3)
    cosine = fma(cosine, q, 4.1666666666666666667e-2)
    cosine = fma(cosine, q, -0.5)
    cosine = fma(cosine, q, 1.0)
    swap = (draw_2 & np.uint64(1)) != 0
    x = sine if swap else cosine
    y = cosine if swap else sine
    sign = radius if (draw_2 & np.uint64(2)) != 0 else -radius
    return s0, s1, x * sign, y * sign


@kernel(inline="always")
def normal_pairs(state0, state1, first, second):
    """Two independent standard normals per path; advances every stream by two draws."""
    for i in range(first.shape[0]):
        state0[i], state1[i], first[i], second[i] = normal_pair(state0[i], state1[i])


@kernel
def normal_rows(state0, state1, first, second):
    """Fill (rows, paths) arrays with pairs of normals, row after row."""
    for row in range(first.shape[0]):
        normal_pairs(state0, state1, first[row], second[row])
