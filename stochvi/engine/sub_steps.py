"""Contacts in sub-steps of their own time scale. Chapters: effect of a push on a gap; friction of
stops; memory of contacts side by side; many lanes side by side."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    columns_of,
    fma,
    lanes_from,
    rows_of,
)
from stochvi.engine.compiling import kernel
from stochvi.engine.parts import (
    MOST_NUMBERS,
    energy,
    force,
    is_lossy,
    is_smooth,
    margin,
    rate,
    read_lane,
)

# ------------------------------------------------------------------------------
# What a push on a pair changes: an impact, or a contact of any length, described by its moments.
#
# A force f(t') on a pair, per unit of its reduced mass, changes a gap y as
#
#     y(t) = z(t) + int R(t - t') f(t') dt',    R(s) = sum_k c_k s^k
#
# where z is the gap without the force. R is the response of the linear structure to a unit change
# of the speed of the pair. Only the moments of the push enter,
#
#     y(t) = z(t) + sum_k c_k S_k(t),    S_k(t) = int (t - t')^k f(t') dt'
#
# An impact that changes the speed by J, a time s ago, has S_k = J s^k. As time goes on without
# force, moments change as the powers of a time do.
# ------------------------------------------------------------------------------


MOMENTS = 6
"""Number of moments that are followed during a push. What is left out is below (omega t)^6 / 720 of
the response, where t is the length of the push, at most one step."""

MOST_TERMS = 20
"""Largest number of terms of the series R."""

BINOMIAL = np.array(
    [[1.0 if m == 0 else 0.0 for m in range(MOMENTS)] for _ in range(MOST_TERMS + 1)]
)
for _k in range(1, MOST_TERMS + 1):
    for _m in range(1, MOMENTS):
        BINOMIAL[_k, _m] = BINOMIAL[_k - 1, _m - 1] + BINOMIAL[_k - 1, _m]
"""Binomial coefficients (k over m)."""


BUNDLE, TERMS_AT_ONCE = 16, 4
"""Numbers at the end of a step, and terms of their series, are padded to multiples of these. They
then fill the vectors of a processor."""

Y0, V0, A0, Y1, V1, A1 = range(6)
"""Rows of the ends of what is left of a step: value, slope and curvature of every gap."""


class Responses(NamedTuple):
    """Responses of a structure to a unit change of the speed of each pair, at time 0.

    Parameters
    ----------
    states : (pairs, states, terms), Taylor series in time of all displacements, velocities, and
        forces of branches.
    modes : number of displacements.
    gaps : (pairs, pairs, 3, terms), Taylor series of value, slope and curvature of every gap.
    accelerations : (pairs, outputs, terms), those that are followed: a series of a unit impulse's
        own acceleration, whose first term belongs to the force, the term k + 1 to the moment k.
    starts : (pairs, MOMENTS, 3 pairs), the terms of value, slope and curvature of all gaps.
    ends : (pairs, terms, numbers), those of all gaps, then those of all states, then zeros.
    """

    states: NDArray[np.float64]
    modes: int
    gaps: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]


def responses_of(
    states: NDArray[np.float64], modes: int, gaps: NDArray[np.float64],
    accelerations: NDArray[np.float64],
) -> Responses:  # fmt: skip
    """`Responses` from the series of states, gaps and accelerations."""
    pairs, _, terms = states.shape
    of_gaps = gaps.transpose(0, 3, 2, 1).reshape(pairs, terms, 3 * pairs)
    numbers = padded(3 * pairs + states.shape[1], BUNDLE)
    ends = np.zeros((pairs, padded(terms, TERMS_AT_ONCE), numbers))
    ends[:, :terms, : 3 * pairs] = of_gaps
    ends[:, :terms, 3 * pairs : 3 * pairs + states.shape[1]] = states.transpose(0, 2, 1)
    # C order for one pair and for several: each order of arrays has a compiled kernel
    return Responses(
        np.ascontiguousarray(states), modes,
        *(np.ascontiguousarray(each) for each in (gaps, accelerations)),
        np.ascontiguousarray(of_gaps[:, :MOMENTS]), ends,
    )  # fmt: skip


def padded(number: int, multiple: int) -> int:
    """The next multiple."""
    return -(-number // multiple) * multiple


SIXTH, SIXTIETH = 1.0 / 6.0, 1.0 / 60.0
"""A division by a number takes several times as long as a product."""


@kernel(forceinline=True)
def next_moments(s0, s1, s2, s3, s4, s5, h, f, middle, end):
    """Moments after h s in which the force is the parabola through its values f, middle, end."""
    h2 = h * h
    h3, h4 = h2 * h, h2 * h2
    h5, h6 = h4 * h, h3 * h3
    return (
        s0 + h * SIXTH * (f + 4.0 * middle + end),
        s1 + h * s0 + h2 * SIXTH * (f + 2.0 * middle),
        s2 + 2.0 * h * s1 + h2 * s0 + h3 * SIXTIETH * (9.0 * f + 12.0 * middle - end),
        s3 + 3.0 * (h * s2 + h2 * s1) + h3 * s0 + h4 * SIXTIETH * (8.0 * f + 8.0 * middle - end),
        s4
        + 4.0 * (h * s3 + h3 * s1)
        + 6.0 * h2 * s2
        + h4 * s0
        + h5 * (1.0 / 210.0) * (25.0 * f + 20.0 * middle - 3.0 * end),
        s5
        + 5.0 * (h * s4 + h4 * s1)
        + 10.0 * (h2 * s3 + h3 * s2)
        + h5 * s0
        + h6 * (1.0 / 84.0) * (9.0 * f + 6.0 * middle - end),
    )


@kernel
def moments_later(now, left, later):
    """The moments from 0 on of a push `left` s later, from the first ones now."""
    power = 1.0
    for k in range(later.shape[0]):
        later[k] = 0.0
    for shift in range(later.shape[0]):
        for m in range(min(MOMENTS, later.shape[0] - shift)):
            later[m + shift] += BINOMIAL[m + shift, m] * power * now[m]
        power *= left


@kernel
def powers_later(change, moved, left, later):
    """The moments of a push that changes speed and place at once, `left` s later."""
    power, before = 1.0, 0.0  # left^k, and k left^(k - 1)
    for k in range(later.shape[0]):
        later[k] = change * power + moved * before
        before = before * left + power
        power *= left


@kernel
def add_terms(target, first, weights, series, pair):
    """Add the rows series[pair, k] with these weights to the numbers of `target` from `first`
    on."""
    for k in range(weights.shape[0]):
        weight = weights[k]
        for i in range(series.shape[2]):
            target[first + i] = fma(weight, series[pair, k, i], target[first + i])


@kernel
def add_four_terms(target, first, weights, series, pair):
    """The same, four rows at a time, for a number of rows that is a multiple of TERMS_AT_ONCE."""
    for k in range(0, weights.shape[0], TERMS_AT_ONCE):
        a, b, c, d = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        for i in range(series.shape[2]):
            two = fma(b, series[pair, k + 1, i], fma(a, series[pair, k, i], target[first + i]))
            more = fma(d, series[pair, k + 3, i], c * series[pair, k + 2, i])
            target[first + i] = two + more


@kernel
def parabola_maximum(f0, middle, f1):
    """Largest value of the parabola through values at 0, 1/2 and 1."""
    slope, bend = 4.0 * middle - 3.0 * f0 - f1, 2.0 * (f0 + f1) - 4.0 * middle
    highest = max(f0, f1)
    if bend < 0.0 and 0.0 < slope < -2.0 * bend:
        highest = max(highest, f0 - 0.25 * slope * slope / bend)
    return highest


@kernel(forceinline=True)
def share_above_zero(f0, middle, f1):
    """Share of the way from 0 to 1 on which the parabola through values at 0, 1/2 and 1 is
    positive, where it changes its sign once at most."""
    falls, rises = (f0 > 0.0) & (f1 < 0.0), (f0 < 0.0) & (f1 > 0.0)
    start, end = (f0, f1) if falls else (f1, f0)
    slope, bend = 4.0 * middle - 3.0 * start - end, 2.0 * (start + end) - 4.0 * middle
    root = 0.0
    if falls | rises:
        root = 2.0 * start / (math.sqrt(max(slope * slope - 4.0 * bend * start, 0.0)) - slope)
    whole = 1.0 if (f0 >= 0.0) & (f1 >= 0.0) else 0.0
    return root if falls | rises else whole


# ------------------------------------------------------------------------------
# Stops that rub: Coulomb's friction in an impact that takes no time, and in a contact that lasts.
#
# Normal and tangential motion are two rows of the structure, n into the stop and t along it. While
# a stop pushes, its impulse p changes the speed w into the stop and the speed u along it at
#
#     dw/dp = -1/m_n + b dq/dp,    du/dp = -b + dq/dp / m_t,    b = n M^-1 t
#
# with the reduced masses m_n and m_t. Friction is dq = -mu sign(u) dp while the stop slides. Where
# u ends, it sticks if mu bears that, and otherwise slides back (Routh 1905). The impact ends by the
# energetic restitution: the normal force gives back the share R^2 of the work that it took in
# compression (Stronge 1990). Where n and t are not coupled, that is w+ = -R w-, and while it slides
# an impact takes mu (1 + R) w- m_n / m_t from the speed u (B 1.62). Neither force gives more work
# than it took: an impact takes energy for every mass matrix.
#
# Speeds are used in the place of impulses: p / m_n and q / m_t.
#
# In a contact with a compliant stop friction acts sub-step by sub-step, as an impulse in its
# middle. Over a sub-step the speed along the stop changes evenly with the normal impulse. Friction
# takes mu times that impulse from it while it slides. Where it ends, the contact sticks if friction
# bears what drives it, and otherwise slides back.
# ------------------------------------------------------------------------------


Y_END, V_END = 2, 3
"""Rows of `contacts.Contacts.gaps`: value and slope of every gap at the end of a sub-step."""


@kernel
def tangent_of(tangents, pair):
    """The pair along whose gap a pair rubs, below 0 where it does not; see `Stops.tangents`."""
    if tangents is None:
        return -1
    return tangents[pair]


@kernel
def rub(w, u, restitution, friction, ratio, along, into):
    """Speed of the rebound, then what the impact takes from w and adds to u by themselves.

    Parameters
    ----------
    w, u : m/s, speeds into the stop and along it.
    restitution, friction : R and mu.
    ratio : m_n / m_t.
    along, into : b m_n and b m_t: what a unit of the normal impulse takes from u, and what a unit
        of the tangential one adds to w.
    """
    if w <= 0.0:
        return 0.0, 0.0, 0.0
    bound = friction * ratio
    side = math.copysign(1.0, u) if u != 0.0 else 0.0
    # sliding as it began, until u ends: w falls at `first`
    first, ends = 1.0 + bound * side * into, math.inf
    if side == 0.0:
        ends = 0.0
    elif side * along + bound > 0.0:
        ends = abs(u) / (side * along + bound)
    whole = w * (1.0 + restitution)
    if first > 0.0 and whole <= first * ends:
        push = whole / first
        return restitution * w, push, -bound * side * push
    # then it sticks, or slides back
    share = along if abs(along) <= bound else math.copysign(bound, along)
    second = 1.0 - share * into
    turn = w - first * ends
    if turn > 0.0:
        taken = 0.5 * ends * (w + turn) + 0.5 * turn * turn / second
        rebound = restitution * math.sqrt(2.0 * second * taken)
    else:
        taken, given = 0.5 * w * w / first, 0.5 * turn * turn / first
        left = restitution * restitution * taken - given
        rebound = math.sqrt(max(turn * turn + 2.0 * second * left, 0.0))
    if into == 0.0:
        rebound = restitution * w
    push = ends + (turn + rebound) / second
    return rebound, push, -bound * side * ends + share * (push - ends)


@kernel
def loss_of(w, u, push, rubbed, ratio, into):
    """Energy that an impact takes per unit of m_n, from what `rub` returns."""
    normal = push * (w - 0.5 * push)
    return normal - rubbed * (u + 0.5 * rubbed) / ratio + into * push * rubbed


@kernel
def held_back(u, taken, bound):
    """What friction adds to u at most where a stop at rest takes the speed `taken`."""
    return -math.copysign(min(abs(u), bound * taken), u)


@kernel
def rub_along(tangents, pair, upper, w, rebound, gaps, rates, stops, responses, tally):
    """An impact at the speed w on a stop that may rub: the rebound, the push, and the change along
    the stop, m/s; see `Stops.tangents`. The speed along it is in the row `rates` of the gaps. The
    loss beyond that of the restitution goes into the sums."""
    if tangents is None:
        return rebound, w + rebound, 0.0
    tangent = tangents[pair]
    if tangent < 0:
        return rebound, w + rebound, 0.0
    side, u, series = 2.0 * upper - 1.0, gaps[rates, tangent], responses.gaps
    along, into = side * series[pair, tangent, 1, 0], side * series[tangent, pair, 1, 0]
    ratio = stops.ratios[pair]
    restitution = rebound / w if w > 0.0 else 0.0
    friction = stops.frictions[pair, upper]
    back, push, rubbed = rub(w, u, restitution, friction, ratio, along, into)
    loss = loss_of(w, u, push, rubbed, ratio, into) - 0.5 * (w * w - rebound * rebound)
    tally.sums[tangent, 3 * upper, tally.lane] += loss
    return back, push, rubbed


@kernel
def rub_at_rest(tangents, pair, upper, taken, stops, gaps, change, responses, tally):
    """Friction of a mass that ends a step at rest on a stop, which takes the speed `taken`."""
    if tangents is None:
        return
    tangent = tangents[pair]
    if tangent < 0:
        return
    u, ratio = gaps[V1, tangent], stops.ratios[pair]
    added = held_back(u, taken, stops.frictions[pair, upper] * ratio)
    modes = responses.modes
    for k in range(modes):
        change[modes + k] += added * responses.states[tangent, modes + k, 0]
    for other in range(gaps.shape[1]):
        gaps[V1, other] += added * responses.gaps[tangent, other, 1, 0]
    tally.sums[tangent, 3 * upper, tally.lane] -= added * (u + 0.5 * added) / ratio


@kernel
def rub_evenly(u, free, bound):
    """What friction adds to a speed u that would evenly become `free`, and what it takes per unit
    of the mass; `bound` is its impulse while it slides."""
    rise, size = free - u, abs(u)
    side = math.copysign(1.0, u) if u != 0.0 else 0.0
    falls = bound - side * rise
    ends = min(1.0, size / falls) if falls > 0.0 else 1.0
    added = -side * bound * ends
    lost = 0.5 * bound * ends * (size + max(size - falls * ends, 0.0))
    if ends < 1.0:
        rest = 1.0 - ends
        borne = rise if abs(rise) <= bound else math.copysign(bound, rise)
        added -= borne * rest
        lost += 0.5 * abs(borne) * rest * abs(rise - borne) * rest
    return added, lost


@kernel
def rub_contact(pair, tangent, upper, h, before, after, taken, contacts, stops, responses, tally):
    """Friction of a contact with a compliant stop in a sub-step of h s, whose normal impulse is
    `taken`. The speeds along the stop at its ends are `before` and `after`, m/s, without this."""
    series, ratio = responses.gaps, stops.ratios[pair]
    added, lost = rub_evenly(before, after, stops.frictions[pair, upper] * ratio * taken)
    tally.sums[tangent, 3 * upper, tally.lane] += lost / ratio
    gaps, moments, power = contacts.gaps, contacts.moments_end, added
    for k in range(MOMENTS):
        kept = moments[tangent, k] if contacts.pushed[tangent] != 0 else 0.0
        moments[tangent, k] = kept + power
        for j in range(gaps.shape[1]):
            gaps[Y_END, j] += power * series[tangent, j, 0, k]
            gaps[V_END, j] += power * series[tangent, j, 1, k]
        power *= 0.5 * h
    contacts.pushed[tangent] = 1


# ------------------------------------------------------------------------------
# Rows of the block of memory of contacts that are integrated side by side.
# ------------------------------------------------------------------------------


RUNNING, OVER, LASTING = 0.0, 1.0, 2.0
"""States of the contact of a lane."""

(
    LEFT, Y, V, T, H, LONGEST, WHOLE, TRIES, PUSHING, STATE, PEAKS, LOST, LASTED,
    Q0, Q1, Q2, Q3, OWN, C0, C1, C2, C3, PUSH,
) = range(23)  # fmt: skip
NUMBERS = 23
NOW = NUMBERS + MOST_NUMBERS + 1
ROWS = NOW + MOMENTS
"""What is left of the step; state of a contact; curvature of the gap without forces by powers of
time; immediate response of its speed to a push, and that of its curvature by moments; acceleration
onto the stop; numbers of the law; moments of the push."""


# ------------------------------------------------------------------------------
# Contacts of many lanes side by side, as far as they depend on the law of their stops.
#
# The equations are those of `contacts` for one pair; `together` writes the start of each contact
# into the rows of scratch, and takes its moments and sums from there.
# ------------------------------------------------------------------------------


CONTACT_ANGLE = 0.25
"""Length of a sub-step of a contact times the largest rate in that contact, rad."""

CONTACT_ERROR = 2e-5
"""Relative error of the speed after a contact in sub-steps, its impulse and its loss. Those of its
duration and of its peak force are up to twenty times as large; a kink makes that two hundred."""

FIRST_SHARE = 0.125
"""Share of a full sub-step that the first and the last one have, where the force has no derivatives
at the touch. Lengths double from the first on and halve towards the last."""

EVENT_ERROR = 1e-9
"""Error of the time of an event, as a share of a sub-step, before the last Newton step to it."""

SLIGHT = 0.01
"""Largest fraction of its energy that a motion gets back at the end of a contact or step. It is
given back on stops without losses, where sub-steps have lost it."""

MOST_TRIES = 20
"""Largest number of Newton steps to an event."""

MOST_SUB_STEPS = 100_000
"""Largest number of sub-steps of a contact in a step."""


@kernel(forceinline=True)
def first_length(law, y, v, longest):
    """Length of a sub-step, s, shorter near the touch of a stop whose force is not smooth there."""
    if is_smooth(law):
        return longest
    there = y / v if v > 0.0 else -0.5 * y / v
    shorter = min(longest, max(FIRST_SHARE * longest, there))
    return shorter if v != 0.0 else longest


@kernel
def first_sub_steps(kind, memory, low, high, numbers, fastest):
    """Choose the sub-steps of the contacts of lanes with stops of one class."""
    w, lanes = rows_of(memory), columns_of(memory, NUMBERS)
    for i in lanes_from(low, high):
        own, y, v = read_lane(kind, lanes, i, numbers), w[Y, i], w[V, i]
        fast = rate(own, y, v, w[PUSH, i])
        longest = CONTACT_ANGLE / math.sqrt(fastest * fastest + fast * fast)
        w[LONGEST, i] = longest
        w[PUSHING, i] = 1.0 if (y <= 0.0) | (margin(own, y, v) > 0.0) else 0.0
        w[LOST, i] = energy(own, y) if (y > 0.0) & (not is_lossy(own)) else 0.0
        w[H, i] = min(first_length(own, y, v, longest), w[LEFT, i])
        w[WHOLE, i] = w[H, i]


@kernel
def advance_contacts(kind, memory, low, high, numbers):
    """One sub-step of the contacts of the lanes, or one try of it; returns how many go on.

    `kind` is a law of the class that all lanes have.
    """
    w, lanes = rows_of(memory), columns_of(memory, NUMBERS)
    running = 0
    for i in lanes_from(low, high):
        law, own = read_lane(kind, lanes, i, numbers), w[OWN, i]
        lossy, smooth = is_lossy(law), is_smooth(law)
        c0, c1, c2, c3 = w[C0, i], w[C1, i], w[C2, i], w[C3, i]
        y, v, t, h, on = w[Y, i], w[V, i], w[T, i], w[H, i], w[PUSHING, i]
        active = w[STATE, i] == RUNNING
        s0, s1, s2, s3 = w[NOW, i], w[NOW + 1, i], w[NOW + 2, i], w[NOW + 3, i]
        s4, s5 = w[NOW + 4, i], w[NOW + 5, i]
        q0, q1, q2, q3 = w[Q0, i], w[Q1, i], w[Q2, i], w[Q3, i]
        half, after = 0.5 * h, t + h
        middle = t + half
        b = q0 + t * (q1 + t * (q2 + t * q3))
        b -= c0 * s0 + c1 * s1 + c2 * s2 + c3 * s3
        f0 = on * max(force(law, y, v), 0.0)
        a0 = b - own * f0
        b = q0 + middle * (q1 + middle * (q2 + middle * q3))
        b -= c0 * s0 + c1 * (s1 + half * s0) + c2 * (s2 + half * (2.0 * s1 + half * s0))
        b -= c3 * (s3 + half * (3.0 * s2 + half * (3.0 * s1 + half * s0)))
        y1, v1 = y + half * (v + 0.5 * half * a0), v + half * a0
        f1 = on * max(force(law, y1, v1), 0.0)
        lag = half * (c0 + 0.5 * half * c1)
        a1 = b - own * f1 - lag * f0
        v2 = v + half * a1
        f2 = on * max(force(law, y1, v2), 0.0)
        a2 = b - own * f2 - lag * f1
        b = q0 + after * (q1 + after * (q2 + after * q3))
        b -= c0 * s0 + c1 * (s1 + h * s0) + c2 * (s2 + h * (2.0 * s1 + h * s0))
        b -= c3 * (s3 + h * (3.0 * s2 + h * (3.0 * s1 + h * s0)))
        v3 = v + h * a2
        f3 = on * max(force(law, y + h * (v + 0.5 * h * a2), v3), 0.0)
        a3 = b - own * f3 - h * (c0 + 0.5 * h * c1) * f2
        y_end = y + h * (v + h * SIXTH * (a0 + a1 + a2))
        v_end = v + h * SIXTH * (a0 + 2.0 * (a1 + a2) + a3)
        # where the stop ceases to push, pushes again, or is left
        left, rise = margin(law, y_end, v_end), margin(law, v_end, a3)
        leaves = y_end < -left
        distance = left if on > 0.0 else (y_end if leaves else -left)
        fall = -rise if on > 0.0 else (-v_end if leaves else rise)
        whole, tries = w[WHOLE, i], w[TRIES, i]
        looking = active & ((distance < 0.0) | (tries > 0.0))
        more = distance / fall if fall > 0.0 else -half
        found = looking & ((abs(more) <= EVENT_ERROR * whole) | (tries >= MOST_TRIES))
        again = looking & (not found)
        # sums
        y_half = 0.5 * (y + y_end) + 0.125 * h * (v - v_end)
        v_half = 0.5 * (v + v_end) + 0.125 * h * (a0 - a3)
        at_start, at_half = force(law, y, v), force(law, y_half, v_half)
        at_end = force(law, y_end, v_end)
        pushed = on * h * (share_above_zero(at_start, at_half, at_end) if lossy else 1.0)
        centre, last = on * max(at_half, 0.0), on * max(at_end, 0.0)
        slope, bend = 4.0 * centre - 3.0 * f0 - last, 2.0 * (f0 + last) - 4.0 * centre
        within = (bend < 0.0) & (slope > 0.0) & (slope < -2.0 * bend)
        inner = f0 - 0.25 * slope * slope / bend if within else 0.0
        # the force of a stop that loses nothing is largest where the mass turns back
        turns = (v > 0.0) & (v_end < 0.0)
        s = v / (v - v_end) if turns else 0.0
        top = y + s * (h * v + s * (3.0 - 2.0 * s) * (y_end - y - h * v))
        top += s * s * (s - 1.0) * h * (v_end - v)
        inner = inner if lossy else on * max(force(law, top, 0.0), 0.0)
        peak = max(max(f0, last), inner)
        # the parabola of the push, which the structure feels, times the cubic of the rate
        work = f0 * (11.0 * v + h * a0 - v_end) + f3 * (11.0 * v_end - h * a3 - v)
        work += 2.0 * (f1 + f2) * (5.0 * (v + v_end) + h * (a0 - a3))
        work *= h / 60.0
        n0, n1, n2, n3, n4, n5 = next_moments(s0, s1, s2, s3, s4, s5, h, f0, 0.5 * (f1 + f2), f3)
        keep = not again
        w[PEAKS, i] = max(w[PEAKS, i], peak) if keep else w[PEAKS, i]
        lost = w[LOST, i] + (work if keep else 0.0)
        w[LASTED, i] += pushed if keep else 0.0
        w[NOW + 1, i] = n1 if keep else s1
        w[NOW + 2, i], w[NOW + 3, i] = (n2, n3) if keep else (s2, s3)
        w[NOW + 4, i], w[NOW + 5, i] = (n4, n5) if keep else (s4, s5)
        y_new, v_new = (y_end, v_end) if keep else (y, v)
        # what follows
        until = w[LEFT, i]
        ends = active & keep & (not found) & (h >= until - t)
        # a stop that pulls follows the mass without a force
        withdraws = lossy & (on > 0.0) & (y_end > 0.0) & (v_end < 0.0)
        pushes_again = (on == 0.0) & (not leaves)
        over = found & (not withdraws) & (not pushes_again)
        w[PUSHING, i] = (1.0 - on) if found else on
        t_new = until if ends else (after if keep else t)
        w[T, i] = t_new
        state = OVER if over else (LASTING if ends else w[STATE, i])
        w[STATE, i] = state
        # a last push gives back what sub-steps have lost at a stop that loses nothing
        excess = lost - (0.0 if over | (y_new <= 0.0) else energy(law, y_new))
        slight = abs(excess) * own < SLIGHT * v_new * v_new
        gives = (not lossy) & (state != RUNNING) & active & slight
        push = -excess / v_new if gives else 0.0
        v_new -= own * push
        w[NOW, i] = (n0 if keep else s0) + push
        w[LOST, i] = lost
        w[Y, i], w[V, i] = y_new, v_new
        there = y_new / v_new if v_new > 0.0 else -0.5 * y_new / v_new
        shortest = FIRST_SHARE * w[LONGEST, i]
        share = w[LONGEST, i] if smooth else min(w[LONGEST, i], max(shortest, there))
        following = min(share, until - t_new)
        nearer = min(max(h + more, half), whole)
        going = state == RUNNING
        h_next = (nearer if again else following) if going else 0.0
        w[H, i] = h_next
        w[WHOLE, i] = whole if again else h_next
        w[TRIES, i] = tries + 1.0 if again else 0.0
        running += 1 if going else 0
    return running


@kernel
def press(kind, memory, low, high, numbers, fastest):
    """Advance the contacts of the lanes until they are over, or what is left of their steps is."""
    first_sub_steps(kind, memory, low, high, numbers, fastest)
    for _ in range(MOST_SUB_STEPS):
        if advance_contacts(kind, memory, low, high, numbers) == 0:
            break
