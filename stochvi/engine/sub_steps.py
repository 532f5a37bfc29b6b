"""Contacts of many lanes side by side, as far as they depend on the law of their stops.

The equations are those of `contacts` for one pair; `together` writes the start of each contact into
the rows of scratch, and takes its moments and sums from there.
"""

from __future__ import annotations

import math

from stochvi.engine.batch import (
    C0,
    C1,
    C2,
    C3,
    LASTED,
    LASTING,
    LEFT,
    LONGEST,
    LOST,
    NOW,
    NUMBERS,
    OVER,
    OWN,
    PEAKS,
    PUSH,
    PUSHING,
    Q0,
    Q1,
    Q2,
    Q3,
    RUNNING,
    STATE,
    TRIES,
    WHOLE,
    H,
    T,
    V,
    Y,
)  # fmt: skip
from stochvi.engine.compiling import kernel
from stochvi.engine.lanes import columns_of, lanes_from, rows_of
from stochvi.engine.law import energy, force, is_lossy, is_smooth, margin, rate, read_lane
from stochvi.engine.pushes import SIXTH, next_moments, share_above_zero

CONTACT_ANGLE = 0.25
"""Length of a sub-step of a contact times the largest rate in that contact, rad."""

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
        inner = (bend < 0.0) & (slope > 0.0) & (slope < -2.0 * bend)
        peak = max(max(f0, last), f0 - 0.25 * slope * slope / bend if inner else 0.0)
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
