"""Time since the last exceedance before an outcrossing of a stationary Gaussian process.

Given an outcrossing of the level u at t = 0 with the slope p, the process is (D. Slepian 1963)

    x(t) = u rho(t) + p eta(t) + z(t),    rho = r(t) / r(0),    eta = r'(t) / r''(0)

with r the correlation function. The residual z does not depend on u and p: it is any record y of
the process less its regression on y(0) and y'(0), z(t) = y(t) - y(0) rho(t) - y'(0) eta(t). Between
the samples x is the cubic through values and slopes.

Symbols: shape holds rho, rho', eta, eta' at 0, span, 2 span, ...; rho and eta' are even in t.
"""

import numba
import numpy as np

from stochvi.methods.monte_carlo.kernels.compliant_response import cubic_maximum


@numba.njit(cache=True, error_model="numpy")
def exceeds(x0, v0, x1, v1, span, near, far, newest):
    """Whether the cubic reaches `near` above or -`far` below.

    The newest interval ends on `near` itself, so that its maximum does not count.
    """
    if x0 >= near or x0 <= -far:
        return True
    if v0 > 0.0 and v1 < 0.0 and not newest:
        return cubic_maximum(x0, v0, x1, v1, span) >= near
    if v0 < 0.0 and v1 > 0.0:
        return cubic_maximum(-x0, -v0, -x1, -v1, span) >= far
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outcrossing_ages(records, starts, slopes, shape, span, stride, near, far, ages):
    """Time in s from the end of the last exceedance of near[j] or -far[j] to an outcrossing.

    Parameters
    ----------
    records : (paths, samples, 2), x and x' of stationary records, periodic in time.
    starts : (starts,), the samples at which the outcrossings of near[j] are placed.
    slopes : (paths, starts), slopes p > 0 of the crossings.
    shape : (n + 1, 4), as above; `stride` divides n.
    span, stride : sampling interval in s, and number of intervals that one cubic spans.
    near, far : (levels,), distances of the stop that is crossed and of the other one.
    ages : (levels, paths, starts), replaced; n span where there was no exceedance.
    """
    samples, count = records.shape[1], shape.shape[0] - 1
    x, v = np.empty(count + 1), np.empty(count + 1)
    for path in range(records.shape[0]):
        for i in range(starts.shape[0]):
            record = records[path]
            away = -record[starts[i], 0]
            change = slopes[path, i] - record[starts[i], 1]
            for k in range(0, count + 1, stride):
                sample = (starts[i] - k) % samples
                x[k] = record[sample, 0] + away * shape[k, 0] - change * shape[k, 2]
                v[k] = record[sample, 1] - away * shape[k, 1] + change * shape[k, 3]
            for j in range(near.shape[0]):
                age = count * span
                u = near[j]
                for k in range(0, count, stride):
                    older = k + stride
                    if exceeds(
                        x[older] + u * shape[older, 0], v[older] - u * shape[older, 1],
                        x[k] + u * shape[k, 0], v[k] - u * shape[k, 1],
                        stride * span, u, far[j], k == 0,
                    ):  # fmt: skip
                        age = (k + 0.5 * stride) * span
                        break
                ages[j, path, i] = age
