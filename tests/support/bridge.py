"""A second Monte Carlo of an oscillator at rigid stops, to hold the package's engine against.

It shares no code, no random numbers and no method with the engine. Nothing is split: the state is
drawn a step ahead by the exact Gaussian transition of x'' + b x' + W^2 x = f + g without stops,
and what happened in between is drawn afterwards, where a stop may have been met.

Between two known states, L apart, white noise of intensity S0 leaves x Gaussian (to leading order
in b L and W L): its mean is the cubic that fits both states, its covariance a time s after the
first and r = L - s before the second is

    Cxx = S0 s^3 r^3 / (3 L^3)   Cxv = S0 s^2 r^2 (r - s) / (2 L^3)
    Cvv = S0 s r (s^2 - s r + r^2) / L^3

Let d_0..d_3 be the Bernstein coefficients of the distance of that cubic to a stop, and q^2 = s / r.
Distance over deviation is (d0 / q^3 + 3 d1 / q + 3 d2 q + d3 q^3) / sqrt(S0 L^3 / 3), and where
no d is negative its square is at least (4 d0 d3 + 36 d1 d2) / (S0 L^3 / 3). Where that is large
the stop is out of reach; where the cubic passes the stop once, fast, there is one impact; all
other intervals are halved by a state drawn in their middle. An impact changes every state that is
already drawn by the free response to the change of velocity, and no random number is drawn twice.

At an impact the mean passes the stop at time s with velocity u. Passages per unit time and
velocity have the density v N(c, v), so states at the time s weigh as their velocity v: for small
Cvv / u^2 their mean is (Cxv, Cvv) / u off that of the cubic (the tilt), and the variance of v is
less by Cvv^2 / u^2. Without the tilt each impact would lose energy of order S0 L.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np

OUT_OF_REACH = 4.0
"""Standard deviations between mean and stop where no impact is looked for."""

FAST = 3.0
"""Standard deviations of velocity in the velocity of a passage that is taken for a single one."""

BISECTIONS = 48
"""Halvings that find a passage to rounding."""

X, XX, VV, N_LOWER, F1_LOWER, F2_LOWER, N_UPPER, F1_UPPER, F2_UPPER = range(9)
SUMS = 9

SAFE, HALVE, IMPACT = range(3)


@dataclass(frozen=True, kw_only=True)
class Bridge:
    """x'' + b x' + stiffness x = noise + load, per unit mass, between stops (infinite for none).

    `depth` halvings of a step are the last: slower impacts than such an interval resolves are put
    at its end. Without `tilt` the sampling is wrong, as a control.
    """

    damping_rate: float = 0.1
    stiffness: float = 1.0
    intensity: float = 0.2
    load: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    restitution_lower: float = 1.0
    restitution_upper: float = 1.0
    threshold: float = 0.0
    step: float = 0.1
    depth: int = 12
    tilt: bool = True

    def averages(self, seed: int, paths: int, duration: float, burn_in: float) -> np.ndarray:
        """Time averages (SUMS, paths): x, x^2, v^2; impacts, sums of w, of w^2 per second."""
        rest = self.load / self.stiffness if self.load else 0.0
        phi, root = transition(self.damping_rate, self.stiffness, self.intensity, self.step)
        steps = math.ceil(duration / self.step)
        sums = np.zeros((SUMS, paths))
        for path in range(paths):
            fly(
                np.random.default_rng([seed, path]),
                (self.damping_rate, self.stiffness, self.intensity),
                (*phi.ravel(), root[0, 0], root[1, 0], root[1, 1]),
                (self.lower - rest, self.upper - rest),
                (self.restitution_lower, self.restitution_upper),
                self.threshold, self.step, self.step / 2**self.depth, 1.0 if self.tilt else 0.0,
                math.ceil(burn_in / self.step), steps, sums[:, path],
            )  # fmt: skip
        sums[:N_LOWER] /= steps
        sums[N_LOWER:] /= steps * self.step
        sums[XX] += 2.0 * rest * sums[X] + rest**2
        sums[X] += rest
        return sums


def transition(b, k, intensity, h):
    """Matrix of the free motion over h, and the lower Cholesky factor of what the noise adds."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    response = np.array([impulse_response(h * (node + 1.0) / 2.0, b, k) for node in nodes]).T
    covariance = intensity * h / 2.0 * (response * weights) @ response.T
    g, dg = impulse_response(h, b, k)
    return np.array([[dg + b * g, g], [-k * g, dg]]), np.linalg.cholesky(covariance)


@numba.njit(cache=True)
def impulse_response(t, b, k):
    """(x, v) a time t after the velocity 1 at rest, of x'' + b x' + k x = 0."""
    square = k - 0.25 * b * b
    decay = math.exp(-0.5 * b * t)
    if square > 0.0:
        omega = math.sqrt(square)
        c, s = math.cos(omega * t), math.sin(omega * t) / omega
    elif square < 0.0:
        omega = math.sqrt(-square)
        c, s = math.cosh(omega * t), math.sinh(omega * t) / omega
    else:
        c, s = 1.0, t
    return decay * s, decay * (c - 0.5 * b * s)


@numba.njit(cache=True)
def covariance(s, r, intensity):
    """(Cxx, Cxv, Cvv) a time s after one known state and r before the next."""
    cube = intensity / (s + r) ** 3
    return (
        cube * (s * r) ** 3 / 3.0,
        cube * (s * r) ** 2 * (r - s) / 2.0,
        cube * s * r * (s * s - s * r + r * r),
    )


@numba.njit(cache=True)
def judge(gap0, v0, gap1, v1, length, intensity):
    """Can an interval reach a stop? Distances and velocities towards it at both ends.

    Returns SAFE, HALVE or IMPACT, and of an impact the time s, velocity u and acceleration of
    the mean there.
    """
    d0, d1, d2, d3 = gap0, gap0 - v0 * length / 3.0, gap1 + v1 * length / 3.0, gap1
    spread = intensity * length**3 / 3.0
    if d3 >= 0.0:
        clear = d1 >= 0.0 and d2 >= 0.0
        far = 4.0 * d0 * d3 + 36.0 * d1 * d2 >= OUT_OF_REACH**2 * spread
        return (SAFE if clear and far else HALVE), 0.0, 0.0, 0.0
    if d1 < 0.0 < d2:  # the only signs that allow three passages
        return HALVE, 0.0, 0.0, 0.0
    a1, a2, a3 = 3.0 * (d1 - d0), 3.0 * (d0 - 2.0 * d1 + d2), d3 - d0 + 3.0 * (d1 - d2)
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if d0 + middle * (a1 + middle * (a2 + middle * a3)) > 0.0:
            low = middle
        else:
            high = middle
    s = high * length
    u = -(a1 + high * (2.0 * a2 + high * 3.0 * a3)) / length
    acceleration = -(2.0 * a2 + 6.0 * a3 * high) / length**2
    noise = FAST**2 * intensity * s
    left_the_stop = v0 * v0 > noise or d0 * d0 > noise * s * s / 3.0
    fast = u > 0.0 and u * u >= FAST**2 * covariance(s, length - s, intensity)[2]
    return (IMPACT if left_the_stop and fast else HALVE), s, u, acceleration


@numba.njit(cache=True)
def fly(
    rng, oscillator, one_step, stops, restitutions, threshold, h, shortest, tilt,
    burn_in, steps, sums,
):  # fmt: skip
    """One path from rest; its last `steps` steps are added to `sums`, (SUMS,)."""
    b, k, intensity = oscillator
    phi_xx, phi_xv, phi_vx, phi_vv, root_xx, root_vx, root_vv = one_step
    lower, upper = stops
    # states drawn ahead: one for each halving, the end of the step, and one for rounding
    most = round(math.log2(h / shortest)) + 3
    times, xs, vs = np.empty(most), np.empty(most), np.empty(most)
    x, v = min(max(0.0, lower), upper), 0.0
    for step in range(burn_in + steps):
        counted = step >= burn_in
        z = rng.standard_normal()
        times[0] = h
        xs[0] = phi_xx * x + phi_xv * v + root_xx * z
        vs[0] = phi_vx * x + phi_vv * v + root_vx * z + root_vv * rng.standard_normal()
        ahead, t = 1, 0.0
        while ahead > 0:
            x1, v1 = xs[ahead - 1], vs[ahead - 1]
            length = times[ahead - 1] - t
            high, s, u, acceleration = judge(upper - x, v, upper - x1, v1, length, intensity)
            low, s_low, u_low, acceleration_low = judge(
                x - lower, -v, x1 - lower, -v1, length, intensity
            )
            if high == SAFE and low == SAFE:
                x, v, t = x1, v1, times[ahead - 1]
                ahead -= 1
                continue
            side = 1.0
            if high == SAFE or (low == IMPACT and high == IMPACT and s_low < s):
                side, s, u, acceleration = -1.0, s_low, u_low, acceleration_low
            halve = high == HALVE or low == HALVE
            if halve and length > shortest:
                cxx, _, cvv = covariance(0.5 * length, 0.5 * length, intensity)
                times[ahead] = t + 0.5 * length
                xs[ahead] = 0.5 * (x + x1) + 0.125 * length * (v - v1)
                xs[ahead] += math.sqrt(cxx) * rng.standard_normal()
                vs[ahead] = 1.5 * (x1 - x) / length - 0.25 * (v + v1)
                vs[ahead] += math.sqrt(cvv) * rng.standard_normal()
                ahead += 1
                continue
            if halve:  # no finer: a stop that is passed is met at the end of the interval
                x, v, t = x1, v1, times[ahead - 1]
                ahead -= 1
                if lower <= x <= upper:
                    continue
                side = 1.0 if x > upper else -1.0
                w = max(side * v, 0.0)
            else:
                cxx, cxv, cvv = covariance(s, length - s, intensity)
                dv = cvv / u * tilt
                dv += math.sqrt(cvv * (1.0 - tilt * cvv / (u * u))) * rng.standard_normal()
                dx = 0.0
                if cvv > 0.0:
                    dx = cxv / cvv * dv
                    dx += math.sqrt(max(cxx - cxv * cxv / cvv, 0.0)) * rng.standard_normal()
                early = min(max(dx / u, s - length), s)
                t += s - early
                w = max(u + dv - acceleration * early, 0.0)
                v = side * w
            stop = upper if side > 0.0 else lower
            restitution = restitutions[1] if side > 0.0 else restitutions[0]
            jump_x = stop - x if halve else 0.0
            jump_v = -side * restitution * w - v if w > 0.0 else 0.0
            x, v = stop, v + jump_v
            for i in range(ahead):
                g, dg = impulse_response(times[i] - t, b, k)
                xs[i] += (dg + b * g) * jump_x + g * jump_v
                vs[i] += -k * g * jump_x + dg * jump_v
            if counted:
                row = N_UPPER if side > 0.0 else N_LOWER
                sums[row] += 1.0 if w >= threshold and w > 0.0 else 0.0
                sums[row + 1] += w
                sums[row + 2] += w * w
        if counted:
            sums[X] += x
            sums[XX] += x * x
            sums[VV] += v * v
