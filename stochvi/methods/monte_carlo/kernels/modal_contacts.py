"""Stops that give way, of any number of pairs on one structure: a step of one path with contacts.

Without the forces of such stops the gap of a pair would follow the quintic z(t) through its values,
slopes and curvatures at the ends of what is left of the step. The forces add d in modal
coordinates (modal masses 1), with d = d' = 0 when the first contact begins:

    y = z + phi . d,    d'' + B d' + omega^2 d = -sum mu phi F(y, y')

    elastic, tabulated    F = f_k + s_k (y - y_k) in each piece
    viscoelastic          F = max(K y + c y', 0)
    Hertz                 F = k y^(3/2)

B is the damping of the flow; it is zero where damping acts in the kicks. d is integrated by the
Runge-Kutta method of order 4 in sub-steps of a fixed part of the shortest time scale of all
contacts together, as in `compliant_response`, with its errors. Sub-steps end at every event: a
touch, the end of a contact, an impact on a rigid stop. When no contact is left, d decays freely,
by a Taylor series of the flow, and the gaps are quintics again until the next touch. A contact may
last longer than the step.

Symbols: a stop is seen as an upper one (a lower one with the signs of y and y' changed); q are the
coefficients of z by powers of t; r = d'. Forces and their sums per unit of the reduced mass mu.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel
from stochvi.methods.monte_carlo.kernels.between_samples import time_to_stop
from stochvi.methods.monte_carlo.kernels.bounces import MOST_BOUNCES, RESTING
from stochvi.methods.monte_carlo.kernels.compliant_response import (
    CONTACT_ANGLE,
    HERTZ_START,
    MOST_NEWTON,
    contact_rate,
    cubic_maximum,
    stop_force,
)
from stochvi.methods.monte_carlo.kernels.contact import DAMPED, HERTZ, RIGID
from stochvi.methods.monte_carlo.kernels.impact_log import log_impact
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
"""Smallest share of a sub-step that is made up to an event, so that its length is never zero."""

D, R, D_END, R_END, D_STAGE, R_STAGE, A_1, A_2, A_3, A_4 = range(10)
"""Rows of `Workspace.modal`: d and r at the start, at the end and at a stage of a sub-step, and the
accelerations r' of its four stages."""

Y, V, Y_END, V_END, A, A_END = range(6)
"""Rows of `Workspace.gap`: value and slope at both ends of a sub-step, then both curvatures."""

IMPULSE_NOW, WORK_NOW, FORCE, RATE, FORCE_END, RATE_END = range(6)
"""Rows of `Workspace.at_stop`: impulse and work in a sub-step, force and its rate at both ends."""


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


class Workspace(NamedTuple):
    """Arrays for the step of one path that may reach stops.

    Parameters
    ----------
    resting : (pairs, 2), 1 for a stop on which the mass rests until the end of the step.
    stack : (64, 8), parts of a step in which a root is still to be searched.
    inside : (pairs, 2), 1 for a stop that is in contact.
    modal : (10, modes), gap : (6, pairs), at_stop : (6, pairs, 2), with the rows named above.
    quintics : (pairs, 6), coefficients of the quintics z by powers of time.
    """

    resting: NDArray[np.float64]
    stack: NDArray[np.float64]
    inside: NDArray[np.int64]
    modal: NDArray[np.float64]
    gap: NDArray[np.float64]
    at_stop: NDArray[np.float64]
    quintics: NDArray[np.float64]


class PathEnd(NamedTuple):
    """The end of a step of one path, which impacts and contacts change.

    Parameters
    ----------
    state : (states, paths), whose column `lane` is the end of the step.
    lane : number of the path.
    gaps : (pairs, 6), value, slope and curvature of every gap at both ends of what is left of the
        step.
    """

    state: NDArray[np.float64]
    lane: int
    gaps: NDArray[np.float64]


class Tally(NamedTuple):
    """What the impacts and contacts of one path add up to.

    Parameters
    ----------
    peaks : (pairs, 2), the largest forces so far of contacts that last from step to step.
    sums : (pairs, ROWS_OF_PAIR), with contacts (pairs, ROWS_OF_CONTACT_PAIR), added to.
    """

    peaks: NDArray[np.float64]
    sums: NDArray[np.float64]


class Accelerations(NamedTuple):
    """Largest absolute accelerations of a path in a step with contacts.

    Parameters
    ----------
    rows : (outputs, modes), from modal forces of springs, dampers and stops to accelerations.
    before, after : (modes,), modal forces of springs and dampers at both ends of what is left of
        the step, without what contacts change; changed.
    largest : (outputs,), m/s^2 or rad/s^2, updated.
    """

    rows: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    largest: NDArray[np.float64]


@kernel
def make_workspace(pairs, modes):
    """Arrays of zeros for these numbers of pairs and modes."""
    return Workspace(
        np.zeros((pairs, 2)), np.zeros((64, 8)), np.zeros((pairs, 2), np.int64),
        np.zeros((10, modes)), np.zeros((6, pairs)), np.zeros((6, pairs, 2)), np.zeros((pairs, 6)),
    )  # fmt: skip


@kernel
def is_rigid(contacts, pair, which):
    """Whether a stop is rigid; all stops are rigid where `contacts` is None."""
    if contacts is None:
        return True
    return contacts.kinds[pair, which] == RIGID


@kernel
def find_contacts(gaps, stops, contacts, work):
    """Mark the stops that are in contact when a step begins; returns whether there is any."""
    touching = False
    for j in range(gaps.shape[0]):
        for which in range(2):
            beyond = (2.0 * which - 1.0) * (gaps[j, 0] - stops[j, which, 0])
            inside = beyond > 0.0 and not is_rigid(contacts, j, which)
            work.inside[j, which] = 1 if inside else 0
            touching |= inside
    return touching


@kernel
def quintic_coefficients(gaps, j, span, q):
    """Write the coefficients by powers of time of the quintic of gap j into q[j]."""
    g0, v0, a0 = gaps[j, 0], gaps[j, 1], gaps[j, 2]
    rise = gaps[j, 3] - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (gaps[j, 4] - v0 - a0 * span) * span
    bend = (gaps[j, 5] - a0) * span * span
    cube = span * span * span
    q[j, 0], q[j, 1], q[j, 2] = g0, v0, 0.5 * a0
    q[j, 3] = (10.0 * rise - 4.0 * slope + 0.5 * bend) / cube
    q[j, 4] = (-15.0 * rise + 7.0 * slope - bend) / (cube * span)
    q[j, 5] = (6.0 * rise - 3.0 * slope + 0.5 * bend) / (cube * span * span)


@kernel
def quintic_at(q, j, t):
    """Value, slope and curvature at t of the quintic of gap j."""
    return (
        q[j, 0] + t * (q[j, 1] + t * (q[j, 2] + t * (q[j, 3] + t * (q[j, 4] + t * q[j, 5])))),
        q[j, 1]
        + t * (2.0 * q[j, 2] + t * (3.0 * q[j, 3] + t * (4.0 * q[j, 4] + t * 5.0 * q[j, 5]))),
        2.0 * q[j, 2] + t * (6.0 * q[j, 3] + t * (12.0 * q[j, 4] + t * 20.0 * q[j, 5])),
    )


@kernel
def gap_of(rows, j, modal, row):
    """phi_j . modal[row]: the change of gap j by a modal vector."""
    total = 0.0
    for k in range(rows.shape[1]):
        total += rows[j, k] * modal[row, k]
    return total


@kernel
def structural_acceleration(modal, d, r, a, squares, damping):
    """modal[a] = -omega^2 d - B r, the acceleration by springs and dampers of the structure."""
    for k in range(squares.shape[0]):
        total = -squares[k] * modal[d, k]
        for m in range(damping.shape[1]):
            total -= damping[k, m] * modal[r, m]
        modal[a, k] = total


@kernel
def contact_acceleration(
    t, d, r, a, weight, modal, at_stop, q, inside, stops, kinds, data, squares, damping, rows,
    shares,
):  # fmt: skip
    """modal[a] = r' at t, with the forces of the stops in contact.

    `weight` times these forces and their powers is added to IMPULSE_NOW and WORK_NOW. The arrays
    are separate arguments because taking them out of tuples here costs some 10 % of the time.
    """
    structural_acceleration(modal, d, r, a, squares, damping)
    for j in range(rows.shape[0]):
        for which in range(2):
            if inside[j, which] == 0:
                continue
            side = 2.0 * which - 1.0
            z, slope, _ = quintic_at(q, j, t)
            y = side * (z + gap_of(rows, j, modal, d) - stops[j, which, 0])
            v = side * (slope + gap_of(rows, j, modal, r))
            force, _, _ = stop_force(y, v, kinds[j, which], data[j, which])
            at_stop[IMPULSE_NOW, j, which] += weight * force
            at_stop[WORK_NOW, j, which] += weight * force * v
            for k in range(rows.shape[1]):
                modal[a, k] -= side * force * shares[j, k]


@kernel
def evaluate_gaps(t, d, r, a, gap_row, stop_row, work, stops, contacts):
    """Values, slopes and curvatures of all gaps at t, and forces of the stops with their rates."""
    modal, gap, at_stop, q = work.modal, work.gap, work.at_stop, work.quintics
    inside, squares, damper = work.inside, contacts.squares, contacts.damping
    rows, shares = contacts.gaps, contacts.shares
    kinds, data = contacts.kinds, contacts.data
    contact_acceleration(
        t, d, r, a, 0.0, modal, at_stop, q, inside, stops, kinds, data, squares, damper, rows,
        shares,
    )  # fmt: skip
    curve = A if gap_row == Y else A_END
    for j in range(rows.shape[0]):
        z, slope, bend = quintic_at(q, j, t)
        gap[gap_row, j] = z + gap_of(rows, j, modal, d)
        gap[gap_row + 1, j] = slope + gap_of(rows, j, modal, r)
        gap[curve, j] = bend + gap_of(rows, j, modal, a)
        for which in range(2):
            if inside[j, which] != 0:
                side = 2.0 * which - 1.0
                y, v = side * (gap[gap_row, j] - stops[j, which, 0]), side * gap[gap_row + 1, j]
                force, stiffness, damping = stop_force(y, v, kinds[j, which], data[j, which])
                at_stop[stop_row, j, which] = force
                at_stop[stop_row + 1, j, which] = stiffness * v + damping * side * gap[curve, j]


@kernel
def sub_step(t, h, work, stops, contacts):
    """d and r after a step h of the Runge-Kutta method, and all gaps and forces there."""
    modal, at_stop, q = work.modal, work.at_stop, work.quintics
    inside, squares, damping = work.inside, contacts.squares, contacts.damping
    rows, shares = contacts.gaps, contacts.shares
    kinds, data = contacts.kinds, contacts.data
    count = modal.shape[1]
    for j in range(stops.shape[0]):
        for which in range(2):
            at_stop[IMPULSE_NOW, j, which] = at_stop[WORK_NOW, j, which] = 0.0
    contact_acceleration(
        t, D, R, A_1, 1.0, modal, at_stop, q, inside, stops, kinds, data, squares,
        damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + 0.5 * h * modal[R, k]
        modal[R_STAGE, k] = modal[R, k] + 0.5 * h * modal[A_1, k]
    contact_acceleration(
        t + 0.5 * h, D_STAGE, R_STAGE, A_2, 2.0, modal, at_stop, q, inside, stops, kinds, data,
        squares, damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + 0.5 * h * (modal[R, k] + 0.5 * h * modal[A_1, k])
        modal[R_STAGE, k] = modal[R, k] + 0.5 * h * modal[A_2, k]
    contact_acceleration(
        t + 0.5 * h, D_STAGE, R_STAGE, A_3, 2.0, modal, at_stop, q, inside, stops, kinds, data,
        squares, damping, rows, shares,
    )  # fmt: skip
    for k in range(count):
        modal[D_STAGE, k] = modal[D, k] + h * (modal[R, k] + 0.5 * h * modal[A_2, k])
        modal[R_STAGE, k] = modal[R, k] + h * modal[A_3, k]
    contact_acceleration(
        t + h, D_STAGE, R_STAGE, A_4, 1.0, modal, at_stop, q, inside, stops, kinds, data, squares,
        damping, rows, shares,
    )  # fmt: skip
    sixth = h / 6.0
    for k in range(count):
        a_1, a_2, a_3 = modal[A_1, k], modal[A_2, k], modal[A_3, k]
        modal[D_END, k] = modal[D, k] + h * (modal[R, k] + sixth * (a_1 + a_2 + a_3))
        modal[R_END, k] = modal[R, k] + sixth * (a_1 + 2.0 * (a_2 + a_3) + modal[A_4, k])
    evaluate_gaps(t + h, D_END, R_END, A_4, Y_END, FORCE_END, work, stops, contacts)


@kernel
def first_event(h, gap, inside, resting, stops):
    """Fraction of a sub-step until the first touch or end of a contact, its pair and its stop.

    The fraction is 2 where there is none.
    """
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
                # after a contact, or at rest on a rigid stop, y is 0 up to rounding
                s, _ = time_to_stop(min(y0, 0.0), v0, y1, v1, h, 0.0)
            if s < first:
                first, pair, upper = s, j, which
    return first, pair, upper


@kernel
def longest_sub_step(gaps, gap, inside, stops, contacts):
    """Longest sub-step, s: a fixed part of the shortest time scale.

    The square of the largest rate is at most the sum of the squares of all rates.
    """
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


@kernel
def shorter_for_hertz(h, gap, inside, stops, contacts):
    """Length of a sub-step, s; with a Hertz stop it doubles after the touch, and halves to its end.

    `h` is the longest length.
    """
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


@kernel
def add_contacts(h, work, stops, contacts, tally):
    """Add impulse, dissipated energy, duration and peak force of a sub-step of all contacts."""
    gap, at_stop, inside = work.gap, work.at_stop, work.inside
    kinds, data = contacts.kinds, contacts.data
    peaks, sums = tally
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
                highest = cubic_maximum(
                    at_stop[FORCE, j, which], at_stop[RATE, j, which],
                    at_stop[FORCE_END, j, which], at_stop[RATE_END, j, which], h,
                )  # fmt: skip
                before, after = law[0, 0] * y0 + law[0, 1] * v0, law[0, 0] * y1 + law[0, 1] * v1
                pushed = max(before, 0.0) + max(after, 0.0)
                if pushed > 0.0:
                    sums[j, row + TIME] += h * pushed / (abs(before) + abs(after))
                sums[j, row + LOSS] += h / 6.0 * at_stop[WORK_NOW, j, which]
            else:
                deepest = cubic_maximum(y0, v0, y1, v1, h)
                highest, _, _ = stop_force(deepest, 0.0, kinds[j, which], law)
                sums[j, row + TIME] += h
            sums[j, row + IMPULSE] += h / 6.0 * at_stop[IMPULSE_NOW, j, which]
            peaks[j, which] = max(peaks[j, which], highest)


@kernel
def update_accelerations(found, share, modal, a):
    """Raise the largest accelerations to those where contacts add modal[a], at a share of what is
    left of the step."""
    rows, largest = found.rows, found.largest
    for output in range(rows.shape[0]):
        total = 0.0
        for k in range(rows.shape[1]):
            smooth = found.before[k] + share * (found.after[k] - found.before[k])
            total += rows[output, k] * (smooth - modal[a, k])
        largest[output] = max(largest[output], abs(total))


@kernel
def move_forces(found, share):
    """Let what is left of the step begin at a share of it."""
    for k in range(found.before.shape[0]):
        found.before[k] += share * (found.after[k] - found.before[k])


@kernel
def apply_event(work, elapsed, step, pair, upper, stops, contacts, tally, page):
    """Begin or end a contact, or apply an impact on a rigid stop, `elapsed` s into the step."""
    peaks, sums = tally
    modal, gap, inside = work.modal, work.gap, work.inside
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
        if page.open and w >= stops[pair, upper, 2]:
            log_impact(page, pair, elapsed, side * w)
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
        work.resting[pair, upper] = 1.0


@kernel
def start_next_sub_step(modal, gap, at_stop):
    """Copy the end of a sub-step to the start of the next; loops are quicker than slices here."""
    for k in range(modal.shape[1]):
        modal[D, k], modal[R, k] = modal[D_END, k], modal[R_END, k]
    for j in range(gap.shape[1]):
        gap[Y, j], gap[V, j], gap[A, j] = gap[Y_END, j], gap[V_END, j], gap[A_END, j]
        for which in range(2):
            at_stop[FORCE, j, which] = at_stop[FORCE_END, j, which]
            at_stop[RATE, j, which] = at_stop[RATE_END, j, which]


@kernel
def integrate_contacts(
    gaps, span, start, step, work, stops, contacts, accelerations, tally, page
):  # fmt: skip
    """Contacts until all have ended or the span is over; returns the time that this took, s.

    `start` is the time from the beginning of the step. On return `work` holds d and r, and the
    values and slopes of all gaps. `accelerations` are None, or `Accelerations`.
    """
    modal, gap, at_stop, q = work.modal, work.gap, work.at_stop, work.quintics
    inside, resting = work.inside, work.resting
    for j in range(stops.shape[0]):
        quintic_coefficients(gaps, j, span, q)
    modal[D : R + 1] = 0.0
    t, events = 0.0, 0
    evaluate_gaps(t, D, R, A_1, Y, FORCE, work, stops, contacts)
    if accelerations is not None:
        update_accelerations(accelerations, 0.0, modal, A_1)
    longest = longest_sub_step(gaps, gap, inside, stops, contacts)
    while t < span:
        h = min(shorter_for_hertz(longest, gap, inside, stops, contacts), span - t)
        ends = h == span - t
        sub_step(t, h, work, stops, contacts)
        s, pair, upper = first_event(h, gap, inside, resting, stops)
        if s <= 1.0:
            side = 2.0 * upper - 1.0
            way = -side if inside[pair, upper] != 0 else side
            whole = h
            h = max(s, SHORTEST_SUB_STEP) * whole
            for _ in range(MOST_NEWTON):
                sub_step(t, h, work, stops, contacts)
                y, v = way * (gap[Y_END, pair] - stops[pair, upper, 0]), way * gap[V_END, pair]
                following = min(max(h - y / v, 0.5 * h), whole) if v > 0.0 else 0.5 * h
                if abs(following - h) <= 1e-13 * whole:
                    break
                h = following
            ends = False
        add_contacts(h, work, stops, contacts, tally)
        t = span if ends else t + h
        if accelerations is not None:
            update_accelerations(accelerations, t / span, modal, A_4)
        start_next_sub_step(modal, gap, at_stop)
        if s > 1.0:
            continue
        apply_event(work, start + t, step, pair, upper, stops, contacts, tally, page)
        events += 1
        if events >= MOST_BOUNCES and contacts.kinds[pair, upper] == RIGID:
            resting[pair, upper] = 1.0
        lasting = 0
        for j in range(stops.shape[0]):
            lasting += inside[j, 0] + inside[j, 1]
        if lasting == 0:
            break
        held = gap[Y, pair]
        evaluate_gaps(t, D, R, A_1, Y, FORCE, work, stops, contacts)
        if accelerations is not None:
            update_accelerations(accelerations, t / span, modal, A_1)
        gap[Y, pair] = held
        longest = longest_sub_step(gaps, gap, inside, stops, contacts)
    return min(t, span)


@kernel
def decay_freely(end, t, span, work, terms, contacts, accelerations):
    """Start the gaps at t, where contacts ended; add the free decay of d and r to all ends."""
    state, lane, gaps = end
    modal, gap, q = work.modal, work.gap, work.quintics
    squares, damping, rows = contacts.squares, contacts.damping, contacts.gaps
    count = squares.shape[0]
    structural_acceleration(modal, D, R, A_1, squares, damping)
    if accelerations is not None:
        move_forces(accelerations, t / span)
        for k in range(count):
            accelerations.before[k] -= modal[A_1, k]
    for j in range(rows.shape[0]):
        _, _, bend = quintic_at(q, j, t)
        gaps[j, 0], gaps[j, 1] = gap[Y, j], gap[V, j]
        gaps[j, 2] = bend + gap_of(rows, j, modal, A_1)
    left = span - t
    for k in range(count):
        modal[D_END, k], modal[R_END, k] = modal[D, k], modal[R, k]
    for order in range(1, terms):
        share = left / order
        for k in range(count):
            modal[D_STAGE, k] = share * modal[R, k]
            modal[R_STAGE, k] = share * modal[A_1, k]
        for k in range(count):
            modal[D, k], modal[R, k] = modal[D_STAGE, k], modal[R_STAGE, k]
            modal[D_END, k] += modal[D, k]
            modal[R_END, k] += modal[R, k]
        structural_acceleration(modal, D, R, A_1, squares, damping)
    structural_acceleration(modal, D_END, R_END, A_1, squares, damping)
    if accelerations is not None:
        for k in range(count):
            accelerations.after[k] -= modal[A_1, k]
    for k in range(count):
        state[k, lane] += modal[D_END, k]
        state[count + k, lane] += modal[R_END, k]
    for j in range(rows.shape[0]):
        gaps[j, 3] += gap_of(rows, j, modal, D_END)
        gaps[j, 4] += gap_of(rows, j, modal, R_END)
        gaps[j, 5] += gap_of(rows, j, modal, A_1)
