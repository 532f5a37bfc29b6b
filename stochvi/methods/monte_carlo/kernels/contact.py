"""White noise and stops that give way by kick-flow-kick, for many paths at once.

The kick is that of `flight`; the flow is the undamped motion with the forces of the stops. Paths
that stay clear of all stops in a step move together; each of the others goes through the step from
event to event: first touch, next piece of the force, zero force, end of the step. However stiff a
stop is, a step may hold any number of contacts, and a contact may last many steps.

    between the stops          x'' + w0^2 x = 0                   a rotation
    elastic, tabulated         x'' + w0^2 x + f_k + s_k (y - y_k) = 0    a rotation in each piece
    viscoelastic               x'' + w0^2 x + (K y + c y')+ = 0   damped, or free where it withdraws
    Hertz                      x'' + w0^2 x + k y^(3/2) = 0       a symplectic method of order 4

y is the deflection of a stop. All but the last are exact up to rounding; the last is
PEFRL of I. P. Omelyan, I. M. Mryglod and R. Folk, Comput. Phys. Commun. 146 (2002) 188, with
sub-steps of a fixed part of the shortest time scale of the contact at its energy, so that its
error (HERTZ_ERROR) is the same for any stiffness and any step. The speed at the end of a contact
is taken from the energy.

Symbols: x is measured from the rest position under the load; a stop is seen as an upper one (a
lower one with the signs of x and v changed); a = -w0^2 (stop) is the acceleration by the spring
at the stop, W^2 = w0^2 + slope. J is the impulse of the stop's force, all per unit mass.
"""

import math

import numpy as np

from stochvi.engine.bounces import RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.impact_log import log_impact, page_of
from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, TIME
from stochvi.methods.monte_carlo.kernels.between_samples import decay
from stochvi.methods.monte_carlo.kernels.flight import add_moments, add_noise, normals_of_step
from stochvi.methods.monte_carlo.kernels.lanes import LANES, aligned_rows, row_of
from stochvi.methods.monte_carlo.kernels.rows import (
    CONTACT_LOWER,
    CONTACT_SUMS,
    CONTACT_UPPER,
    N_LOWER,
    N_UPPER,
    VV,
    XX,
    X,
)

RIGID, PIECES, DAMPED, HERTZ = range(4)
"""Kinds of a `steps.ContactStop`. Its data holds (R,), the rows (y_k, f_k, s_k) of the pieces,
(K, c), or (k,), in this order of the kinds."""

MOST_EVENTS = 10_000
"""Largest number of events of a path in one step: touches, ends of pieces of a force, ends of
contacts. It is ten times limits.MOST_BOUNCES because a mass that is pressed onto a stiff stop
swings on it many times in a step. After so many events the motion of the step ends where it is."""

HERTZ_ANGLE = 0.2
"""Length of a sub-step of a Hertz contact times the largest frequency in that contact, rad: the
longest for which HERTZ_ERROR holds."""

HERTZ_START = 0.125
"""Length of the first sub-step after the touch, as a share of a full one; each of the next is twice
as long as the one before. The force y^(3/2) has no second derivative at the touch, which lowers the
order to 5/2: a share of 1/8 reduces the measured error eight-fold."""

HERTZ_ERROR = 1.5e-5
"""Relative error of the energy, the duration and the peak force of a contact with such sub-steps:
among 10 000 random contacts the largest error of the energy was 1.2e-5, of the duration 1e-6."""

MOST_NEWTON = 60
"""Largest number of Newton steps to a root: as many as bisection needs for double precision."""

XI, LAMBDA, CHI = 0.1786178958448091, -0.2123418310626054, -0.06626458266981849
"""Coefficients of PEFRL, from the paper named above."""


@kernel
def travel_time(distance, v0, v1, turn, omega):
    """Time of an undamped motion from velocity v0 to v1, less than a period.

    tan(W t / 2) = W distance / (v0 + v1) = W (v1 - v0) / turn, `turn` the sum of the accelerations
    at both ends. The first form serves velocities of one sign, the second those of two; neither
    needs the centre of the motion, which for W = 0 is infinitely far.
    """
    if v0 * v1 >= 0.0:
        rise, run = abs(distance), abs(v0 + v1)
    else:
        rise, run = abs(v1 - v0), turn if v1 > v0 else -turn
    if omega > 0.0:
        return 2.0 * math.atan2(omega * rise, run) / omega
    if run > 0.0:
        return 2.0 * rise / run
    return 0.0 if rise == 0.0 else math.inf


@kernel
def undamped_motion(y, v, acceleration, t, omega):
    """Displacement and velocity after t of an undamped motion from y, v and this acceleration."""
    half = 0.5 * omega * t
    if half > 0.0:
        sine, cosine = math.sin(half), math.cos(half)
        s = sine / omega
        return (
            y + 2.0 * s * (cosine * v + s * acceleration),
            v * (1.0 - 2.0 * sine * sine) + 2.0 * s * cosine * acceleration,
        )
    return y + t * (v + 0.5 * t * acceleration), v + t * acceleration


@kernel
def contact_piecewise(y, v, left, data, pressing, stiff, tally):
    """Contact with a piecewise linear force; returns y, v and the time left when it ends."""
    last = data.shape[0] - 1
    piece = 0
    while piece < last and y >= data[piece + 1, 0]:
        piece += 1
    for _ in range(MOST_EVENTS):
        start, force, slope = data[piece, 0], data[piece, 1], data[piece, 2]
        square = stiff + slope
        omega = math.sqrt(square)
        a = pressing - stiff * y - force - slope * (y - start)
        below = pressing - stiff * start - force
        down, up, w, w_up = math.inf, math.inf, 0.0, 0.0
        energy = v * v + (a + below) * (start - y)
        if energy > 0.0:
            w = math.sqrt(energy)
            down = travel_time(start - y, v, -w, a + below, omega)
        if piece < last:
            end = data[piece + 1, 0]
            above = pressing - stiff * end - force - slope * (end - start)
            energy = v * v + (a + above) * (end - y)
            if energy > 0.0:
                w_up = math.sqrt(energy)
                up = travel_time(end - y, v, w_up, a + above, omega)
        t = min(min(down, up), left)
        if t == left:
            y1, v1 = undamped_motion(y, v, a, t, omega)
            top = math.inf
            if omega > 0.0:
                angle = math.atan2(omega * v, -a)
                top = (angle if angle >= 0.0 else angle + 2.0 * math.pi) / omega
            elif v > 0.0 and a < 0.0:
                top = -v / a
            turned = top <= t
        elif down <= up:
            y1, v1, turned = start, -w, v > 0.0
        else:
            y1, v1, turned = end, w_up, False
        highest = y1
        if turned:
            largest = math.sqrt(a * a + square * v * v)
            if a > 0.0:
                highest = y + (largest + a) / square
            elif largest > 0.0:
                highest = y + v * v / (largest - a)
        tally[PEAK] = max(tally[PEAK], force + slope * (max(highest, y) - start))
        change = v1 - v
        tally[IMPULSE] += (pressing - stiff * y) * t - change
        if square > 0.0:
            tally[IMPULSE] -= stiff / square * (a * t - change)
        tally[TIME] += t
        left -= t
        y, v = y1, v1
        if left <= 0.0:
            return y, v, 0.0
        if v > 0.0:
            piece += 1
        elif piece == 0:
            return 0.0, v, left
        else:
            piece -= 1
    return y, v, 0.0


@kernel
def damped_motion(y, v, t, stiffness, damping, pressing, stiff):
    """Deflection and rate after t under spring and viscoelastic stop, also where the stop pulls."""
    square = stiff + stiffness
    shape, slope = decay(t, damping, math.sqrt(square))
    push = pressing - square * y
    return (
        y + v * shape + push * (1.0 - slope - damping * shape) / square,
        v * slope + push * shape,
    )


@kernel
def zeros_of_rate(rate, curvature, damping, square):
    """Times of the first two zeros of r, r'' + c r' + W^2 r = 0, r(0) = rate, r'(0) = curvature.

    Infinite where there is none. A zero at t = 0 counts where r is negative afterwards.
    """
    half = 0.5 * damping
    gain = curvature + half * rate
    inner = square - half * half
    root = math.sqrt(abs(inner))
    falls = rate > 0.0 or (rate == 0.0 and gain < 0.0)
    sine, cosine = (rate, -gain) if falls else (-rate, gain)
    if inner > 0.0:
        first = math.atan2(root * sine, cosine) / root
        if rate == 0.0 and not falls:
            first = math.pi / root
        return first, first + math.pi / root
    if (rate == 0.0 and not falls) or cosine <= 0.0 or root * sine >= cosine:
        return math.inf, math.inf
    if root * sine < 1e-8 * cosine:
        return sine / cosine, math.inf
    return math.atanh(root * sine / cosine) / root, math.inf


@kernel
def time_to_zero_force(y, v, left, stiffness, damping, pressing, stiff):
    """Time until the force of a viscoelastic stop is zero, at most `left`, whether it becomes so,
    and its largest value.

    F = K y + c v obeys F'' + c F' + W^2 F = constant, so that F' has its zeros at known times.
    Between a maximum and the next minimum F falls all the way, so it passes 0 there or, as minima
    rise where the constant is positive, never; a root there is found by Newton's method, kept
    between bounds.
    """
    square = stiff + stiffness
    a = pressing - square * y - damping * v
    force = max(stiffness * y + damping * v, 0.0)
    rate = stiffness * v + damping * a
    curvature = stiffness * a - damping * (square * v + damping * a)
    first, second = zeros_of_rate(rate, curvature, damping, square)
    rising = rate >= 0.0
    low, high = (first, second) if rising else (0.0, first)
    peak = force
    if rising:
        y1, v1 = damped_motion(y, v, min(low, left), stiffness, damping, pressing, stiff)
        peak = max(peak, stiffness * y1 + damping * v1)
    if low >= left:
        return left, False, peak
    high = min(high, left)
    y1, v1 = damped_motion(y, v, high, stiffness, damping, pressing, stiff)
    if stiffness * y1 + damping * v1 >= 0.0:
        # it goes on; the next maximum may be the largest
        if not rising and second < math.inf:
            y1, v1 = damped_motion(y, v, min(second, left), stiffness, damping, pressing, stiff)
            peak = max(peak, stiffness * y1 + damping * v1)
        return left, False, peak
    t = 0.5 * (low + high)
    for _ in range(MOST_NEWTON):
        y1, v1 = damped_motion(y, v, t, stiffness, damping, pressing, stiff)
        value = stiffness * y1 + damping * v1
        if value > 0.0:
            low = t
        else:
            high = t
        rate = stiffness * v1 + damping * (pressing - square * y1 - damping * v1)
        following = t - value / rate if rate < 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * following:
            break
        t = following
    return t, True, peak


@kernel
def contact_viscoelastic(y, v, left, data, pressing, stiff, tally):
    """Contact with a viscoelastic stop; returns y, v and the time left when it ends.

    Where K y + c v < 0 the limiter withdraws without a force, as fast as the mass. With
    q = y + (c / K) v, which in free motion swings about the same centre as y, it pushes again
    when q passes 0 upwards, and is left when y passes 0 downwards.
    """
    stiffness, damping = data[0, 0], data[0, 1]
    omega = math.sqrt(stiff)
    lag = damping / stiffness
    pushes = y + lag * v > 0.0
    for _ in range(MOST_EVENTS):
        if pushes:
            t, ends, peak = time_to_zero_force(y, v, left, stiffness, damping, pressing, stiff)
            y1, v1 = damped_motion(y, v, t, stiffness, damping, pressing, stiff)
            tally[PEAK] = max(tally[PEAK], peak)
            way, change, square = y1 - y, v1 - v, stiff + stiffness
            tally[IMPULSE] += (
                stiffness * (pressing * t - change - damping * way) / square + damping * way
            )
            tally[LOSS] += pressing * way - 0.5 * (
                (v1 - v) * (v1 + v) + stiff * (y1 - y) * (y1 + y)
            )
            tally[TIME] += t
            pushes = False
            if not ends:
                return y1, v1, 0.0
            y, v = max(y1, 0.0), v1
        else:
            a = pressing - stiff * y
            out, again, w = math.inf, math.inf, 0.0
            energy = v * v - (a + pressing) * y
            if energy > 0.0:
                w = math.sqrt(energy)
                out = travel_time(y, v, -w, a + pressing, omega)
            q, rate = min(y + lag * v, 0.0), v + lag * a
            a_q = pressing - stiff * q
            energy = rate * rate - (a_q + pressing) * q
            if q == 0.0 and rate > 0.0:
                again = 0.0
            elif energy > 0.0:
                again = travel_time(q, rate, math.sqrt(energy), a_q + pressing, omega)
            t = min(min(out, again), left)
            y1, v1 = undamped_motion(y, v, a, t, omega)
            if t == left:
                return y1, v1, 0.0
            if out <= again:
                return 0.0, -w, left - t
            y, v = max(y1, 0.0), v1
            pushes = True
        left -= t
    return y, v, 0.0


@kernel
def symplectic_step(y, v, h, k, pressing, stiff):
    """Deflection, rate and impulse of the contact force after a step of PEFRL, Hertz stop."""
    push = 0.0
    y += XI * h * v
    for part in range(4):
        force = k * y * math.sqrt(y) if y > 0.0 else 0.0
        weight = (0.5 - LAMBDA) * h if part % 3 == 0 else LAMBDA * h
        push += weight * force
        v += weight * (pressing - stiff * y - force)
        if part == 1:
            y += (1.0 - 2.0 * (CHI + XI)) * h * v
        elif part == 3:
            y += XI * h * v
        else:
            y += CHI * h * v
    return y, v, push


@kernel
def contact_hertz(y, v, left, data, pressing, stiff, tally):
    """Contact with a Hertz stop; returns y, v and the time left when it ends."""
    k = data[0, 0]
    # twice the energy relative to the first touch
    energy = v * v + y * (stiff * y - 2.0 * pressing + 0.8 * k * y * math.sqrt(y))
    # where (2/5) k y^(5/2) = E + a y, one of the two terms is at least half of it
    kinetic = 0.5 * v * v + y * (0.4 * k * y * math.sqrt(y) + 0.5 * stiff * y)
    deepest = max((5.0 * kinetic / k) ** 0.4, (5.0 * max(pressing, 0.0) / k) ** (2.0 / 3.0))
    h = HERTZ_ANGLE / math.sqrt(stiff + 1.5 * k * math.sqrt(deepest))
    while left > 0.0:
        step = min(h, left)
        if v > 0.0:
            step = min(step, max(HERTZ_START * h, y / v))
        y1, v1, push = symplectic_step(y, v, step, k, pressing, stiff)
        released = y1 <= 0.0
        if released:
            t = step * y / (y - y1) if y > 0.0 else step
            for _ in range(MOST_NEWTON):
                y1, v1, push = symplectic_step(y, v, t, k, pressing, stiff)
                following = min(max(t - y1 / v1, 0.0), step) if v1 < 0.0 else 0.5 * t
                if abs(following - t) <= 1e-14 * step:
                    break
                t = following
            step = t
            y1, v1 = 0.0, -math.sqrt(max(energy, 0.0))
        if v > 0.0 and v1 <= 0.0:
            # from the end nearer to the turning point, where the force is straight enough
            near, speed = (y, v) if v < -v1 else (y1, v1)
            root = math.sqrt(near)
            a, slope = k * near * root + stiff * near - pressing, stiff + 1.5 * k * root
            largest = math.sqrt(a * a + slope * speed * speed)
            highest = near + (speed * speed / (a + largest) if a > 0.0 else 0.0)
            tally[PEAK] = max(tally[PEAK], k * highest * math.sqrt(highest))
        tally[PEAK] = max(tally[PEAK], k * y1 * math.sqrt(y1))
        tally[IMPULSE] += push
        tally[TIME] += step
        left -= step
        y, v = y1, v1
        if released:
            return 0.0, v, max(left, 0.0)
    return y, v, 0.0


@kernel
def impact_or_contact(y, v, left, stop, side, stiff, tally, peaks, sums):
    """An impact on a rigid stop, or a contact until it ends or the time `left` is over.

    Returns the deflection of the stop, its rate, and the time left: 0 for a mass that stays there.
    """
    position, kind, data = stop
    pressing = -stiff * side * position
    row = CONTACT_UPPER if side > 0.0 else CONTACT_LOWER
    if kind == RIGID:
        restitution = data[0, 0]
        sums[row + IMPULSE] += (1.0 + restitution) * v
        sums[row + LOSS] += 0.5 * (1.0 - restitution * restitution) * v * v
        v *= -restitution
        if pressing > 0.0 and -v <= RESTING * pressing * left:
            # ever lower bounces, whose impulses add up to the pressing force
            sums[row + IMPULSE] += pressing * left
            sums[(N_UPPER if side > 0.0 else N_LOWER) + 1] += pressing * left / (1.0 + restitution)
            return 0.0, 0.0, 0.0
        return 0.0, v, left
    which = 1 if side > 0.0 else 0
    tally[:] = 0.0
    tally[PEAK] = peaks[which]
    if kind == PIECES:
        y, v, left = contact_piecewise(y, v, left, data, pressing, stiff, tally)
    elif kind == DAMPED:
        y, v, left = contact_viscoelastic(y, v, left, data, pressing, stiff, tally)
    else:
        y, v, left = contact_hertz(y, v, left, data, pressing, stiff, tally)
    sums[row + IMPULSE] += tally[IMPULSE]
    sums[row + LOSS] += tally[LOSS]
    sums[row + TIME] += tally[TIME]
    peaks[which] = tally[PEAK]
    if left > 0.0:
        sums[row + PEAK] += tally[PEAK]
        sums[row + ENDED] += 1.0
        peaks[which] = 0.0
    return y, v, left


@kernel
def time_to_touch(x, v, stop, stiff, omega):
    """Time until a free mass crosses `stop` upwards, infinite for never, and its speed there.

    The time is 0 for a mass that rests on a stop and is pressed onto it.
    """
    square = v * v + stiff * (x - stop) * (x + stop)
    w = math.sqrt(max(square, 0.0))
    if x >= stop and (v > 0.0 or (v == 0.0 and stiff * stop < 0.0)):
        return 0.0, w
    if square <= 0.0 or (v <= 0.0 and stiff == 0.0):
        return math.inf, 0.0
    return travel_time(stop - x, v, w, -stiff * (x + stop), omega), w


@kernel
def flow_with_contacts(x, v, left, stiff, lower, upper, threshold, tally, peaks, sums, page=None):
    """Flow of one path with any number of contacts, which are added to `sums`; returns (x, v).

    `peaks` holds the largest force so far of a contact that lasts, of the lower and the upper
    stop; `tally` takes the sums of one contact; `page`, None or part of a log, takes first touches.
    """
    omega, span = math.sqrt(stiff), left
    side = 0
    if upper is not None:
        side = 1 if (x > upper.position and upper.kind != RIGID) else side
    if lower is not None:
        side = -1 if (x < lower.position and lower.kind != RIGID) else side
    for _ in range(MOST_EVENTS):
        if side == 0:
            up, down, w, w_down = math.inf, math.inf, 0.0, 0.0
            if upper is not None:
                up, w = time_to_touch(x, v, upper.position, stiff, omega)
            if lower is not None:
                down, w_down = time_to_touch(-x, -v, -lower.position, stiff, omega)
            t = min(up, down)
            if t > left:
                x, v = undamped_motion(x, v, -stiff * x, left, omega)
                break
            left -= t
            side = 1 if up <= down else -1
            w = w if side > 0 else w_down
            row = N_UPPER if side > 0 else N_LOWER
            sums[row] += 1.0 if (w > 0.0 and w >= threshold) else 0.0
            sums[row + 1] += w
            sums[row + 2] += w * w
            if page is not None:  # noqa: SIM102 - a test of its own is left out when compiled
                if page.open and w > 0.0 and w >= threshold:
                    log_impact(page, 0, span - left, side * w)
            v = side * w
            if upper is not None:
                x = upper.position if side > 0 else x
            if lower is not None:
                x = lower.position if side < 0 else x
        if upper is not None and side > 0:
            y, v, left = impact_or_contact(
                x - upper.position, v, left, upper, 1.0, stiff, tally, peaks, sums
            )
            x = upper.position + y
        if lower is not None and side < 0:
            y, v, left = impact_or_contact(
                lower.position - x, -v, left, lower, -1.0, stiff, tally, peaks, sums
            )
            x, v = lower.position - y, -v
        if left <= 0.0:
            break
        side = 0
    # rounding, or bounces without end, must not leave the mass in a wall
    if upper is not None:
        x = min(x, upper.position) if upper.kind == RIGID else x
    if lower is not None:
        x = max(x, lower.position) if lower.kind == RIGID else x
    return x, v


@kernel
def step_clear_paths(x, v, z, near, kick, flow, lower, upper):
    """Advance every path that touches no stop by one step; kick and mark the others.

    This holds for w0 h < pi. A mass turns in the step if it moves up before and down after it; its
    orbit then reaches the stop if v^2 + w0^2 x^2 > w0^2 stop^2. Returns the number of marked paths.
    """
    e, s, _ = kick
    _, cosine, sine, stiff = flow
    count = 0
    for i in range(x.shape[0]):
        q = x[i]
        p = e * v[i] + s * z[i]
        x1 = cosine * q + sine * p
        v1 = cosine * p - stiff * sine * q
        touches = False
        if upper is not None:
            stop = upper.position
            high = p * p + stiff * (q - stop) * (q + stop) > 0.0
            touches = (q > stop) | (x1 >= stop) | ((p > 0.0) & (v1 < 0.0) & high)
        if lower is not None:
            stop = lower.position
            low = p * p + stiff * (q - stop) * (q + stop) > 0.0
            touches = touches | (q < stop) | (x1 <= stop) | ((p < 0.0) & (v1 > 0.0) & low)
        x[i] = q if touches else x1
        v[i] = p if touches else v1
        near[i] = 1.0 if touches else 0.0
        count += 1 if touches else 0
    return count


@kernel
def run_contacts(paths, kick, flow, lower, upper, counting, record, log, flag):
    """Advance every path by some steps, and add up those that are counted.

    Parameters
    ----------
    paths : `steps.Paths`, with sums (CONTACT_SUMS, paths); `kept` holds the largest forces so far
        of contacts that last, of the lower and the upper stop.
    kick, flow, counting : `steps.Kick`, `steps.Flow` and `steps.Counting`.
    lower, upper : None, or a `steps.ContactStop`.
    record : zeros (steps, paths, 3), which get x, v and the sum of the speeds of first touches of
        every counted step, negative at the lower stop. Without samples there is no record.
    log : None, or an `impact_log.Log`, which gets the first touches in the counted steps that are
        at least as fast as the threshold.
    flag : (1,), looked at before every step: where it is not 0, the paths are given up, without a
        result.
    """
    x, v, streams, sums, noise, kept = paths
    recording = record.shape[0] > 0
    first, last, stride, origin, threshold = counting
    # close together: rows of `sums` would evict one another
    work, words = aligned_rows(10), aligned_rows(2).view(np.uint64)
    extra = np.zeros((LANES, CONTACT_SUMS))
    unused, tally = np.zeros(CONTACT_SUMS), np.zeros(4)
    for start in range(0, x.shape[0], LANES):
        end = min(start + LANES, x.shape[0])
        n = end - start
        xs, vs, z, z2 = (
            row_of(work, 0, n),
            row_of(work, 1, n),
            row_of(work, 2, n),
            row_of(work, 3, n),
        )
        near, place, power = row_of(work, 4, n), row_of(work, 5, n), row_of(work, 6, n)
        mean, square, speed = row_of(work, 7, n), row_of(work, 8, n), row_of(work, 9, n)
        state0, state1 = row_of(words, 0, n), row_of(words, 1, n)
        peaks = kept[start:end]
        for i in range(n):
            xs[i], vs[i] = x[start + i], v[start + i]
            place[i], power[i] = noise[0, start + i], noise[1, start + i]
            state0[i], state1[i] = streams[0, start + i], streams[1, start + i]
            mean[i], square[i] = sums[X, start + i], sums[XX, start + i]
            speed[i] = sums[VV, start + i]
            for row in range(N_LOWER, CONTACT_SUMS):
                extra[i, row] = sums[row, start + i]
        for step in range(first, last):
            if flag[0] != 0:
                break
            normals_of_step((step - first) % 2 == 1, kick.earlier, state0, state1, z, z2)
            counted = step >= 0
            if counted:
                add_noise(xs, vs, z, place, power)
            count = step_clear_paths(xs, vs, z, near, kick, flow, lower, upper)
            for i in range(n if count > 0 else 0):
                if near[i] != 0.0:
                    target = extra[i] if counted else unused
                    before = target[N_UPPER + 1] - target[N_LOWER + 1]
                    xs[i], vs[i] = flow_with_contacts(
                        xs[i], vs[i], flow.step, flow.stiff, lower, upper, threshold, tally,
                        peaks[i], target, page_of(log, start + i, step, flow.step),
                    )  # fmt: skip
                    if recording:
                        after = target[N_UPPER + 1] - target[N_LOWER + 1]
                        record[step, start + i, 2] = after - before
            if counted:
                if step % stride == 0:
                    add_moments(xs, vs, origin, mean, square, speed)
                if recording:
                    for i in range(n):
                        record[step, start + i, 0] = xs[i]
                        record[step, start + i, 1] = vs[i]
        for i in range(n):
            x[start + i], v[start + i] = xs[i], vs[i]
            noise[0, start + i], noise[1, start + i] = place[i], power[i]
            streams[0, start + i], streams[1, start + i] = state0[i], state1[i]
            sums[X, start + i], sums[XX, start + i] = mean[i], square[i]
            sums[VV, start + i] = speed[i]
            for row in range(N_LOWER, CONTACT_SUMS):
                sums[row, start + i] = extra[i, row]
