"""Products of a sparse matrix and the states of many paths, one loop over the paths a row.

A matrix is a table (starts, columns, weights) of its nonzero elements, row after row. A row is put
where it is called: as a call of its own it took a seventh of a step.
"""

from stochvi.engine.compiling import kernel
from stochvi.engine.fused import fma


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
