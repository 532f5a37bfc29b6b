"""Products of a sparse matrix and the states of many paths, one loop over the paths a row.

A matrix is a table (starts, columns, weights) of its nonzero elements, row after row.
"""

import numba

from stochvi.methods.monte_carlo.kernels.fused import fma


@numba.njit(cache=True, error_model="numpy")
def matrix_pass(out, keep, sources, table, width):
    """out = keep out + matrix . sources, `width` lanes; by rows: (starts, columns, weights).

    Four sources at a time, each row in one vectorised loop over the lanes.
    """
    starts, columns, weights = table
    for row in range(starts.shape[0] - 1):
        k, last = starts[row], starts[row + 1]
        kept = keep
        while k < last:
            if last - k >= 4:
                mix_four(
                    out, row, kept, sources, columns[k], weights[k], columns[k + 1],
                    weights[k + 1], columns[k + 2], weights[k + 2], columns[k + 3], weights[k + 3],
                    width,
                )  # fmt: skip
                k += 4
            elif last - k >= 2:
                mix_two(
                    out, row, kept, sources, columns[k], weights[k], columns[k + 1], weights[k + 1],
                    width,
                )  # fmt: skip
                k += 2
            else:
                mix_one(out, row, kept, sources, columns[k], weights[k], width)
                k += 1
            kept = 1.0


@numba.njit(cache=True, error_model="numpy")
def mix_one(out, row, keep, x, j, a, width):
    for i in range(width):
        out[row, i] = fma(a, x[j, i], keep * out[row, i])


@numba.njit(cache=True, error_model="numpy")
def mix_two(out, row, keep, x, j, a, k, b, width):
    for i in range(width):
        out[row, i] = fma(b, x[k, i], fma(a, x[j, i], keep * out[row, i]))


@numba.njit(cache=True, error_model="numpy")
def mix_four(out, row, keep, x, j, a, k, b, m, c, n, d, width):
    for i in range(width):
        out[row, i] = fma(
            d, x[n, i], fma(c, x[m, i], fma(b, x[k, i], fma(a, x[j, i], keep * out[row, i])))
        )
