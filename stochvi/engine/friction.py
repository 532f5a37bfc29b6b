"""Stops that rub: Coulomb's friction in an impact that takes no time, and in a contact that lasts.

Normal and tangential motion are two rows of the structure, n into the stop and t along it. While a
stop pushes, its impulse p changes the speed w into the stop and the speed u along it at

    dw/dp = -1/m_n + b dq/dp,    du/dp = -b + dq/dp / m_t,    b = n M^-1 t

with the reduced masses m_n and m_t. Friction is dq = -mu sign(u) dp while the stop slides. Where u
ends, it sticks if mu bears that, and otherwise slides back (Routh 1905). The impact ends by the
energetic restitution: the normal force gives back the share R^2 of the work that it took in
compression (Stronge 1990). Where n and t are not coupled, that is w+ = -R w-, and while it slides
an impact takes mu (1 + R) w- m_n / m_t from the speed u (B 1.62). Neither force gives more work
than it took: an impact takes energy for every mass matrix.

Speeds are used in the place of impulses: p / m_n and q / m_t.

In a contact with a compliant stop friction acts sub-step by sub-step, as an impulse in its middle.
Over a sub-step the speed along the stop changes evenly with the normal impulse. Friction takes mu
times that impulse from it while it slides. Where it ends, the contact sticks if friction bears what
drives it, and otherwise slides back.
"""

from __future__ import annotations

import math

from stochvi.engine.compiling import kernel
from stochvi.engine.pushes import MOMENTS, V1

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
    modes = responses.states.shape[1] // 2
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
