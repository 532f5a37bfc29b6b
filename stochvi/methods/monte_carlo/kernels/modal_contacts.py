"""Stops that give way, of any number of pairs on one structure: a step of one path with contacts.

Without the forces of such stops the gap of a pair would follow the quintic z(t) through its values,
slopes and curvatures at the ends of what is left of the step. The forces add d in modal
coordinates (modal masses 1), which is at rest when the first contact begins:

    y = z + phi . d,    d'' + B d' + omega^2 d = -sum mu phi F(y, y')

    elastic, tabulated    F = f_k + s_k (y - y_k) in each piece
    viscoelastic          F = max(K y + c y', 0)
    Hertz                 F = k y^(3/2)

B is the damping that stands in the flow: none where it is kicked. d is integrated by the
Runge-Kutta method of order 4 in sub-steps of a fixed part of the shortest time scale of all
contacts together, as in `compliant_response`, with its errors. Sub-steps end on every touch, end
of a contact and impact on a rigid stop. When no stop is pressed, d decays freely, which is a Taylor
series of the flow, and the rest of the step is one of quintics again, until the next stop is met.
A contact that lasts goes on in the next step.

Symbols: a stop is seen as an upper one (a lower one with the signs of y and y' changed); q are the
coefficients of z by powers of t; r = d'. Forces and their sums per unit of the reduced mass mu.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from stochvi.methods.monte_carlo.kernels.compliant_response import (
    CONTACT_ANGLE,
    HERTZ_START,
    MOST_NEWTON,
    contact_rate,
    crest,
    stop_force,
)
from stochvi.methods.monte_carlo.kernels.contact import DAMPED, HERTZ, RIGID
from stochvi.methods.monte_carlo.kernels.impact_log import write_down
from stochvi.methods.monte_carlo.kernels.intervals import time_to_stop
from stochvi.methods.monte_carlo.kernels.limits import MOST_BOUNCES, RESTING
from stochvi.methods.monte_carlo.kernels.rows import (
    ENDED,
    IMPULSE,
    LOSS,
    PEAK,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    TIME,
)

SHORTEST_SUB_STEP = 1e-12
"""Shortest part of a sub-step that is taken to an event, so that its length is never zero."""

D, R, D_END, R_END, D_STAGE, R_STAGE, A_1, A_2, A_3, A_4 = range(10)
"""Rows of the room for modal vectors."""

Y, V, Y_END, V_END, A, A_END = range(6)
"""Rows of the room for gaps: value, slope and curvature at both ends of a sub-step."""

IMPULSE_NOW, WORK_NOW, FORCE, RATE, FORCE_END, RATE_END = range(6)
"""Rows of the room for stops: impulse and work in a sub-step; force and its rate at its ends."""


class Contacts(NamedTuple):
    """Laws of the stops, per unit of the reduced mass, and the structure that they act on.

    Parameters
    ----------
    kinds : (pairs, 2), kind of the lower and the upper stop as in `contact`.
    data : (pairs, 2, longest, 3), numbers of their laws; pieces that a force does not have begin at
        infinity.
    squares : omega^2 (modes,).
    damping : B in the flow (modes, modes), or (modes, 0) where damping is kicked.
    gaps : phi (pairs, modes).
    shares : mu phi (pairs, modes), mu the reduced mass of a pair.
    fastest : rad/s, the fastest rate of the flow.
    """

    kinds: NDArray[np.int64]
    data: NDArray[np.float64]
    squares: NDArray[np.float64]
    damping: NDArray[np.float64]
    gaps: NDArray[np.float64]
    shares: NDArray[np.float64]
    fastest: float


class Room(NamedTuple):
    """Arrays in which a path that may meet stops is worked on.

    Parameters
    ----------
    resting : (pairs, 2), 1 for a stop that something rests on until the end of the step.
    stack : (64, 8), parts of a step in which a root is still to be searched.
    inside : (pairs, 2), 1 for a stop that is in contact.
    modal : (10, modes), rows named below; gap : (6, pairs); at_stop : (6, pairs, 2).
    quintics : (pairs, 6), coefficients of the quintics z by powers of time.
    """

    resting: NDArray[np.float64]
    stack: NDArray[np.float64]
    inside: NDArray[np.int64]
    modal: NDArray[np.float64]
    gap: NDArray[np.float64]
    at_stop: NDArray[np.float64]
    quintics: NDArray[np.float64]


@numba.njit(cache=True)
def make_room(pairs, modes):
    """Room for so many pairs and modes."""
    return Room(
        np.zeros((pairs, 2)), np.zeros((64, 8)), np.zeros((pairs, 2), np.int64),
        np.zeros((10, modes)), np.zeros((6, pairs)), np.zeros((6, pairs, 2)), np.zeros((pairs, 6)),
    )  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def is_rigid(contacts, pair, which):
    """Whether a stop is rigid; all are where there are no `contacts`."""
    if contacts is None:
        return True
    return contacts.kinds[pair, which] == RIGID


@numba.njit(cache=True, error_model="numpy")
def find_inside(gaps, stops, contacts, room):
    """Mark the stops that are in contact when a step begins; whether there is any."""
    touching = False
    for j in range(gaps.shape[0]):
        for which in range(2):
            beyond = (2.0 * which - 1.0) * (gaps[j, 0] - stops[j, which, 0])
            inside = beyond > 0.0 and not is_rigid(contacts, j, which)
            room.inside[j, which] = 1 if inside else 0
            touching |= inside
    return touching


@numba.njit(cache=True, error_model="numpy")
def powers_of(gaps, j, span, q):
    """Coefficients by powers of time of the quintic of a gap."""
    g0, v0, a0 = gaps[j, 0], gaps[j, 1], gaps[j, 2]
    rise = gaps[j, 3] - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (gaps[j, 4] - v0 - a0 * span) * span
    bend = (gaps[j, 5] - a0) * span * span
    cube = span * span * span
    q[j, 0], q[j, 1], q[j, 2] = g0, v0, 0.5 * a0
    q[j, 3] = (10.0 * rise - 4.0 * slope + 0.5 * bend) / cube
    q[j, 4] = (-15.0 * rise + 7.0 * slope - bend) / (cube * span)
    q[j, 5] = (6.0 * rise - 3.0 * slope + 0.5 * bend) / (cube * span * span)


@numba.njit(cache=True, error_model="numpy")
def quintic_at(q, j, t):
    """Value, slope and curvature at t of the quintic of a gap."""
    return (
        q[j, 0] + t * (q[j, 1] + t * (q[j, 2] + t * (q[j, 3] + t * (q[j, 4] + t * q[j, 5])))),
        q[j, 1]
        + t * (2.0 * q[j, 2] + t * (3.0 * q[j, 3] + t * (4.0 * q[j, 4] + t * 5.0 * q[j, 5]))),
        2.0 * q[j, 2] + t * (6.0 * q[j, 3] + t * (12.0 * q[j, 4] + t * 20.0 * q[j, 5])),
    )


@numba.njit(cache=True, error_model="numpy")
def along(rows, j, modal, row):
    """phi_j . modal[row]."""
    total = 0.0
    for k in range(rows.shape[1]):
        total += rows[j, k] * modal[row, k]
    return total


@numba.njit(cache=True, error_model="numpy")
def pull(modal, d, r, a, squares, damping):
    """modal[a] = -omega^2 d - B r: the acceleration by the structure alone."""
    for k in range(squares.shape[0]):
        total = -squares[k] * modal[d, k]
        for m in range(damping.shape[1]):
            total -= damping[k, m] * modal[r, m]
        modal[a, k] = total


@numba.njit(cache=True, error_model="numpy")
def accelerate(
    t, d, r, a, weight, modal, at_stop, q, inside, stops, kinds, data, squares, damping, rows,
    shares,
):  # fmt: skip
    """modal[a] = r' at t, with the forces of the stops in contact, which are summed with `weight`.

    Arrays one by one: to take them out of tuples would cost more than what is done with them.
    """
    pull(modal, d, r, a, squares, damping)
    for j in range(rows.shape[0]):
        for which in range(2):
            if inside[j, which] == 0:
                continue
            side = 2.0 * which - 1.0
            z, slope, _ = quintic_at(q, j, t)
            y = side * (z + along(rows, j, modal, d) - stops[j, which, 0])
            v = side * (slope + along(rows, j, modal, r))
            force, _, _ = stop_force(y, v, kinds[j, which], data[j, which])
            at_stop[IMPULSE_NOW, j, which] += weight * force
            at_stop[WORK_NOW, j, which] += weight * force * v
            for k in range(rows.shape[1]):
                modal[a, k] -= side * force * shares[j, k]


@numba.njit(cache=True, error_model="numpy")
def look(t, d, r, a, gap_row, stop_row, room, stops, contacts):
    """Values, slopes and curvatures of all gaps at t, and forces of stops and their rates."""
    modal, gap, at_stop, q = room.modal, room.gap, room.at_stop, room.quintics
    inside, squares, damper = room.inside, contacts.squares, contacts.damping
    rows, shares = contacts.gaps, contacts.shares
    kinds, data = contacts.kinds, contacts.data
    accelerate(
        t, d, r, a, 0.0, modal, at_stop, q, inside, stops, kinds, data, squares, damper, rows,
        shares,
    )  # fmt: skip
    curve = A if gap_row == Y else A_END
    for j in range(rows.shape[0]):
        z, slope, bend = quintic_at(q, j, t)
        gap[gap_row, j] = z + along(rows, j, modal, d)
        gap[gap_row + 1, j] = slope + along(rows, j, modal, r)
        gap[curve, j] = bend + along(rows, j, modal, a)
        for which in range(2):
            if inside[j, which] != 0:
                side = 2.0 * which - 1.0
                y, v = side * (gap[gap_row, j] - stops[j, which, 0]), side * gap[gap_row + 1, j]
                force, stiffness, damping = stop_force(y, v, kinds[j, which], data[j, which])
                at_stop[stop_row, j, which] = force
                at_stop[stop_row + 1, j, which] = stiffness * v + damping * side * gap[curve, j]


@numba.njit(cache=True, error_model="numpy")
def sub_step(t, h, room, stops, contacts):
    """d and r after h by the Runge-Kutta method, and what all gaps and stops are like there."""
    modal, at_stop, q = room.modal, room.at_stop, room.quintics
    inside, squares, damping = room.inside, contacts.squares, contacts.damping
    rows, shares = contacts.gaps, contacts.shares
    kinds, data = contacts.kinds, contacts.data
    count = modal.shape[1]
    for j in range(stops.shape[0]):
        for which in range(2):
            at_stop[IMPULSE_NOW, j, which] = at_stop[WORK_NOW, j, which] = 0.0
    accelerate(
        t, D, R, A_1, 1.0, modal, at_stop, q, inside, stops, kinds, data, squares,
        damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + 0.5 * h * modal[R, k]
        modal[R_STAGE, k] = modal[R, k] + 0.5 * h * modal[A_1, k]
    accelerate(
        t + 0.5 * h, D_STAGE, R_STAGE, A_2, 2.0, modal, at_stop, q, inside, stops, kinds, data,
        squares, damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + 0.5 * h * (modal[R, k] + 0.5 * h * modal[A_1, k])
        modal[R_STAGE, k] = modal[R, k] + 0.5 * h * modal[A_2, k]
    accelerate(
        t + 0.5 * h, D_STAGE, R_STAGE, A_3, 2.0, modal, at_stop, q, inside, stops, kinds, data,
        squares, damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + h * (modal[R, k] + 0.5 * h * modal[A_2, k])
        modal[R_STAGE, k] = modal[R, k] + h * modal[A_3, k]
    accelerate(
        t + h, D_STAGE, R_STAGE, A_4, 1.0, modal, at_stop, q, inside, stops, kinds, data, squares,
        damping, rows, shares,
    )  # fmt: skip
    sixth = h / 6.0
    for k in range(count):
        a_1, a_2, a_3 = modal[A_1, k], modal[A_2, k], modal[A_3, k]
        modal[D_END, k] = modal[D, k] + h * (modal[R, k] + sixth * (a_1 + a_2 + a_3))
        modal[R_END, k] = modal[R, k] + sixth * (a_1 + 2.0 * (a_2 + a_3) + modal[A_4, k])
    look(t + h, D_END, R_END, A_4, Y_END, FORCE_END, room, stops, contacts)


@numba.njit(cache=True, error_model="numpy")
def first_event(h, gap, inside, resting, stops):
    """Fraction of a sub-step until a stop is touched or left, 2 for none, and which."""
    first, pair, upper = 2.0, -1, 0
    for j in range(stops.shape[0]):
        for which in range(2):
            stop = stops[j, which, 0]
            if not math.isfinite(stop) or resting[j, which] != 0.0:
                continue
            side = 2.0 * which - 1.0
            y0, v0 = side * (gap[Y, j] - stop), side * gap[V, j]
            y1, v1 = side * (gap[Y_END, j] - stop), side * gap[V_END, j]
            if inside[j, which] != 0:
                s, _ = time_to_stop(-y0, -v0, -y1, -v1, h, 0.0)
            else:
                # what has just been left, or rests on a rigid stop, lies there up to rounding
                s, _ = time_to_stop(min(y0, 0.0), v0, y1, v1, h, 0.0)
            if s < first:
                first, pair, upper = s, j, which
    return first, pair, upper


@numba.njit(cache=True, error_model="numpy")
def longest_sub_step(gaps, gap, inside, stops, contacts):
    """A fixed part of the shortest time scale: the squares of all rates add up, at most."""
    kinds, data = contacts.kinds, contacts.data
    square = contacts.fastest * contacts.fastest
    for j in range(stops.shape[0]):
        for which in range(2):
            if inside[j, which] != 0:
                side = 2.0 * which - 1.0
                push = max(max(side * gaps[j, 2], side * gaps[j, 5]), 0.0)
                rate = contact_rate(
                    side * (gap[Y, j] - stops[j, which, 0]), side * gap[V, j], push, (0.0, 0.0),
                    kinds[j, which], data[j, which],
                )  # fmt: skip
                square += rate * rate
    return CONTACT_ANGLE / math.sqrt(square)


@numba.njit(cache=True, error_model="numpy")
def shorter_for_hertz(h, gap, inside, stops, contacts):
    """Sub-steps that double after the touch of a Hertz stop, and halve before its end."""
    kinds = contacts.kinds
    shortest = HERTZ_START * h
    for j in range(stops.shape[0]):
        for which in range(2):
            if inside[j, which] != 0 and kinds[j, which] == HERTZ:
                side = 2.0 * which - 1.0
                y, v = side * (gap[Y, j] - stops[j, which, 0]), side * gap[V, j]
                if v != 0.0:
                    distance = y / v if v > 0.0 else -0.5 * y / v
                    h = min(h, max(shortest, distance))
    return h


@numba.njit(cache=True, error_model="numpy")
def add_contacts(h, gap, at_stop, inside, stops, contacts, peaks, sums):
    """Add what a sub-step of all contacts brought."""
    kinds, data = contacts.kinds, contacts.data
    for j in range(stops.shape[0]):
        for which in range(2):
            if inside[j, which] == 0:
                continue
            side, stop = 2.0 * which - 1.0, stops[j, which, 0]
            law = data[j, which]
            y0, v0 = side * (gap[Y, j] - stop), side * gap[V, j]
            y1, v1 = side * (gap[Y_END, j] - stop), side * gap[V_END, j]
            row = ROWS_OF_PAIR + ROWS_OF_STOP * which
            if kinds[j, which] == DAMPED:
                highest = crest(
                    at_stop[FORCE, j, which], at_stop[RATE, j, which],
                    at_stop[FORCE_END, j, which], at_stop[RATE_END, j, which], h,
                )  # fmt: skip
                before, after = law[0, 0] * y0 + law[0, 1] * v0, law[0, 0] * y1 + law[0, 1] * v1
                pushed = max(before, 0.0) + max(after, 0.0)
                if pushed > 0.0:
                    sums[j, row + TIME] += h * pushed / (abs(before) + abs(after))
                sums[j, row + LOSS] += h / 6.0 * at_stop[WORK_NOW, j, which]
            else:
                highest, _, _ = stop_force(crest(y0, v0, y1, v1, h), 0.0, kinds[j, which], law)
                sums[j, row + TIME] += h
            sums[j, row + IMPULSE] += h / 6.0 * at_stop[IMPULSE_NOW, j, which]
            peaks[j, which] = max(peaks[j, which], highest)


@numba.njit(cache=True, error_model="numpy")
def strike(room, elapsed, step, pair, upper, stops, contacts, peaks, sums, page):
    """Make an event happen, `elapsed` after the step began: a contact begins or ends, or a rigid
    stop throws the mass back."""
    modal, gap, inside = room.modal, room.gap, room.inside
    kinds = contacts.kinds
    rows, shares = contacts.gaps, contacts.shares
    side = 2.0 * upper - 1.0
    gap[Y, pair] = stops[pair, upper, 0]
    if inside[pair, upper] != 0:
        row = ROWS_OF_PAIR + ROWS_OF_STOP * upper
        sums[pair, row + PEAK] += peaks[pair, upper]
        sums[pair, row + ENDED] += 1.0
        peaks[pair, upper] = 0.0
        inside[pair, upper] = 0
        return
    w = max(side * gap[V, pair], 0.0)
    sums[pair, 3 * upper] += 1.0 if w >= stops[pair, upper, 2] else 0.0
    sums[pair, 3 * upper + 1] += w
    sums[pair, 3 * upper + 2] += w * w
    if page is not None:  # noqa: SIM102 - a test of its own is left out when compiled
        if w >= stops[pair, upper, 2]:
            write_down(page, pair, elapsed, side * w)
    if kinds[pair, upper] != RIGID:
        inside[pair, upper] = 1
        return
    restitution = stops[pair, upper, 1]
    change = -side * (1.0 + restitution) * w
    for k in range(rows.shape[1]):
        modal[R, k] += change * shares[pair, k]
    for j in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            gap[V, j] += change * rows[j, k] * shares[pair, k]
    gap[V, pair] = -side * restitution * w
    pressing = side * gap[A, pair]
    if pressing > 0.0 and restitution * w <= RESTING * pressing * step:
        room.resting[pair, upper] = 1.0


@numba.njit(cache=True, error_model="numpy")
def go_on(modal, gap, at_stop):
    """The end of a sub-step is the start of the next; number by number, which is quicker."""
    for k in range(modal.shape[1]):
        modal[D, k], modal[R, k] = modal[D_END, k], modal[R_END, k]
    for j in range(gap.shape[1]):
        gap[Y, j], gap[V, j], gap[A, j] = gap[Y_END, j], gap[V_END, j], gap[A_END, j]
        for which in range(2):
            at_stop[FORCE, j, which] = at_stop[FORCE_END, j, which]
            at_stop[RATE, j, which] = at_stop[RATE_END, j, which]


@numba.njit(cache=True, error_model="numpy")
def press(gaps, span, start, step, room, stops, contacts, peaks, sums, page):
    """Contacts until all are left or the span is over; returns the time that this took.

    `start` is the time since the step began. On return d and r stand in `room`, with the values and
    slopes of all gaps.
    """
    modal, gap, at_stop, q = room.modal, room.gap, room.at_stop, room.quintics
    inside, resting = room.inside, room.resting
    for j in range(stops.shape[0]):
        powers_of(gaps, j, span, q)
    modal[D : R + 1] = 0.0
    t, events = 0.0, 0
    look(t, D, R, A_1, Y, FORCE, room, stops, contacts)
    longest = longest_sub_step(gaps, gap, inside, stops, contacts)
    while t < span:
        h = min(shorter_for_hertz(longest, gap, inside, stops, contacts), span - t)
        ends = h == span - t
        sub_step(t, h, room, stops, contacts)
        s, pair, upper = first_event(h, gap, inside, resting, stops)
        if s <= 1.0:
            side = 2.0 * upper - 1.0
            way = -side if inside[pair, upper] != 0 else side
            whole = h
            h = max(s, SHORTEST_SUB_STEP) * whole
            for _ in range(MOST_NEWTON):
                sub_step(t, h, room, stops, contacts)
                y, v = way * (gap[Y_END, pair] - stops[pair, upper, 0]), way * gap[V_END, pair]
                following = min(max(h - y / v, 0.5 * h), whole) if v > 0.0 else 0.5 * h
                if abs(following - h) <= 1e-13 * whole:
                    break
                h = following
            ends = False
        add_contacts(h, gap, at_stop, inside, stops, contacts, peaks, sums)
        t = span if ends else t + h
        go_on(modal, gap, at_stop)
        if s > 1.0:
            continue
        strike(room, start + t, step, pair, upper, stops, contacts, peaks, sums, page)
        events += 1
        if events >= MOST_BOUNCES and contacts.kinds[pair, upper] == RIGID:
            resting[pair, upper] = 1.0
        still = 0
        for j in range(stops.shape[0]):
            still += inside[j, 0] + inside[j, 1]
        if still == 0:
            break
        held = gap[Y, pair]
        look(t, D, R, A_1, Y, FORCE, room, stops, contacts)
        gap[Y, pair] = held
        longest = longest_sub_step(gaps, gap, inside, stops, contacts)
    return min(t, span)


@numba.njit(cache=True, error_model="numpy")
def coast(state, lane, gaps, t, span, room, terms, contacts):
    """Leave contact at t: gaps start there, and the decay of d and r is added to all ends."""
    modal, gap, q = room.modal, room.gap, room.quintics
    squares, damping, rows = contacts.squares, contacts.damping, contacts.gaps
    count = squares.shape[0]
    pull(modal, D, R, A_1, squares, damping)
    for j in range(rows.shape[0]):
        _, _, bend = quintic_at(q, j, t)
        gaps[j, 0], gaps[j, 1] = gap[Y, j], gap[V, j]
        gaps[j, 2] = bend + along(rows, j, modal, A_1)
    left = span - t
    modal[D_END], modal[R_END] = modal[D], modal[R]
    for order in range(1, terms):
        share = left / order
        for k in range(count):
            modal[D_STAGE, k] = share * modal[R, k]
            modal[R_STAGE, k] = share * modal[A_1, k]
        for k in range(count):
            modal[D, k], modal[R, k] = modal[D_STAGE, k], modal[R_STAGE, k]
            modal[D_END, k] += modal[D, k]
            modal[R_END, k] += modal[R, k]
        pull(modal, D, R, A_1, squares, damping)
    pull(modal, D_END, R_END, A_1, squares, damping)
    for k in range(count):
        state[k, lane] += modal[D_END, k]
        state[count + k, lane] += modal[R_END, k]
    for j in range(rows.shape[0]):
        gaps[j, 3] += along(rows, j, modal, D_END)
        gaps[j, 4] += along(rows, j, modal, R_END)
        gaps[j, 5] += along(rows, j, modal, A_1)
