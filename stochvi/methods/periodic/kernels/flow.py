"""Flow of a structure with stops of any law, and springs and dampers that are functions.

Between two events a motion is smooth. A step of it is a Taylor series where forces are linear;
else it is that of the midpoint rule with 2, 4, 6 and 8 parts, extrapolated to infinitely many
(Gragg's method): of order 8 for any function. It ends at each event. These are touches, the ends
and pieces of contacts, and the places at which a function has a kink: a knot of a table, a rate
that turns, a memory that passes 0. A damper that sticks holds the rate of its displacement at 0
while its force suffices.

The force of a compliant stop is made of straight pieces over the depth d = row . q - position > 0:
in piece p it is f_p + k_p (d - b_p), and q'' changes by minus that times the row. It passes from
piece to piece at b_p, and contact ends at d = 0. A stop with a damper has one piece, k d + c d'
where that is positive: contact ends at zero force, before d is 0 again, and the stop follows
without a force. Hertz's law adds h d^(3/2).

Symbols as in `solver`; a state y = (q, q', z) has the memories z of the functions at its end.
"""

import math
from typing import NamedTuple

import numpy as np

from stochvi.engine.borrowed import borrowed, hold
from stochvi.engine.calls import PULL, SLOPE, Characteristics, ask, call_of_part
from stochvi.engine.compiling import kernel
from stochvi.methods.periodic.kernels.solver import (
    ANGLE,
    MOST_IMPACTS,
    NORM,
    TERMS,
    distance_of,
    dot,
    expand,
    force_state,
    output_of,
    put,
    strike,
    sum_terms,
    swing,
    turn_column,
    turns_of,
)

AWAY, FOLLOWING = -1, -2
"""States of a stop: the gap is open; the mass is beyond it, and it follows without a force. Where
it presses the state is the number of the piece, from 0 on."""

COLUMNS = 4
"""Number of midpoint rules that a step extrapolates."""

SHARE = 0.5
"""Longest step that is extrapolated, over that of a Taylor series."""

ACCURATE = 1e-9
"""Change by the last extrapolation, in the units of the kernels, up to which a step is taken: the
error of the step is some hundred times smaller."""

ROOTED = 1e-3
"""Share of it where a stop of Hertz's law presses, whose force begins as a power 3/2."""

SHORTEST = 1e-9
"""Shortest step over the longest one: a function of a user's own may have jumps."""

AT_REST = 1e-12
"""Rate of a displacement, in the units of the kernels, up to which a damper may stick."""

STILL = 1e-6
"""Speed of an impact on a rigid stop, relative to the fastest one, up to which it counts as the end
of chatter: a rest on the stop is not followed."""

LARGEST = 1e7
"""Size of a state beyond which a motion has escaped."""

NEAR_TOP = 0.02
"""Distance from an edge, relative to the largest one in a step. A motion that turns nearer is
followed to its turning point."""

JUST_TURNED = 1e-7
"""Share of a step within which a motion that turns is at its turning point already, which `landed`
finds to a tenth of that: looked for again and again, it would hold the motion there for ever."""

INSIDE = 1e-3
"""Way from an edge, in units of displacements or of a memory, over which a function is differenced
to go straight on beyond it."""

FAR = 1e300
"""Place of a knot that is not there, m."""

PROBE = 1e-4
"""Share of a step over which an acceleration is differenced."""

ASIDE = 1e-6
"""Change of a state, relative to its size above 1, over which a step and an edge are differenced to
turn perturbations: of a smaller one rounding would be felt at folds of lightly damped motions."""

SUDDEN = 1e-9
"""Change of a rate by an event, relative to its size, above which it is no rounding."""

TOUCHED = 1e-11
"""Distance from an edge, in the units of the kernels, up to which a motion is on it."""

MEASURED = 8
"""Number of the last periods over which the largest acceleration is found."""

SMOOTH, TURNS, STICKS = 0, 1, 2
"""What a function does where its rate passes 0: nothing, have a kink, or hold."""

ABOVE, BELOW, RATE, MEMORY = 0, 1, 2, 3
"""Edges of a function: the knots around its displacement, its rate and its memory. While a damper
sticks, the first two of them are the forces at which it slips."""


class Laws(NamedTuple):
    """The stops.

    Parameters
    ----------
    counts : (m,), number of straight pieces of the force, 0 of a rigid stop.
    pieces : (m, most, 3), depth b and force f at which each piece begins, and its slope k.
    dampers : (m,), coefficient c of the damper.
    hertz : (m,), coefficient h of Hertz's law, 0 of a stop of another law.
    """

    counts: np.ndarray
    pieces: np.ndarray
    dampers: np.ndarray
    hertz: np.ndarray


class Record(NamedTuple):
    """Record of a motion.

    Parameters
    ----------
    ends : (periods + 1, size), the state at the start and after each period.
    log : (most, 3 + size), phase, stop, speed and state of each contact that begins; the last ones
        in place of the first where they are too many.
    grown : (size, number), small changes of the start, which become those of the end.
    """

    ends: np.ndarray
    log: np.ndarray
    grown: np.ndarray


class Functions(NamedTuple):
    """Springs and dampers that are functions.

    Parameters
    ----------
    calls : how they are called; their rows give displacements, m, and their changes accelerations.
    pace : 1/s, rate of a displacement per unit of its rate in the time of the kernels.
    widths : (parts,), m, unit of each displacement.
    knots : (parts, most), m, rising displacements of kinks, FAR beyond the last one.
    kinds : (parts,), SMOOTH, TURNS or STICKS.
    """

    calls: Characteristics
    pace: float
    widths: np.ndarray
    knots: np.ndarray
    kinds: np.ndarray


class System(NamedTuple):
    """A motion, the laws of its stops, and its functions."""

    motion: tuple
    laws: Laws
    functions: Functions


class Modes(NamedTuple):
    """Smooth pieces in which a motion is.

    Parameters
    ----------
    stops : (m,), number of the piece, AWAY or FOLLOWING.
    cells : (parts,), number of knots below each displacement.
    sides : (parts,), sign of each rate, 0 of one that is held.
    signs : (parts,), sign of each memory.
    """

    stops: np.ndarray
    cells: np.ndarray
    sides: np.ndarray
    signs: np.ndarray


class Work(NamedTuple):
    """Arrays for intermediate results.

    Those of functions are displacements, rates (parts, 1) and memories (memories, 1). Those of a
    Taylor series are the force w, the generator with the pieces that press, (q, q', w), and the
    coefficients. The others are states of the extrapolation.
    """

    x: np.ndarray
    v: np.ndarray
    z: np.ndarray
    w: np.ndarray
    generator: np.ndarray
    whole: np.ndarray
    terms: np.ndarray
    table: np.ndarray
    midpoints: np.ndarray
    ahead: np.ndarray
    slopes: np.ndarray
    sides: np.ndarray
    states: np.ndarray


@kernel
def displaced(functions, j, y, n):
    """Displacement (m) of a function and its rate in the time of the kernels."""
    row = functions.calls.rows[j]
    return dot(row, y), dot(row, y[n:])


@kernel
def pulled(functions, j, x, v, work):
    """Force of a function per unit of its reduced mass, m/s^2, at a rate in m/s."""
    calls = functions.calls
    work.x[j, 0], work.v[j, 0] = x, v
    call_of_part(
        calls.functions[j],
        (
            PULL, calls.numbers, j, work.x, work.v, work.z, max(calls.memories[j], 0), 0.0, 0.0,
            0.0, 0.0, 1,
        ),
    )  # fmt: skip
    return work.v[j, 0]


@kernel
def pulled_in_cell(functions, modes, j, x, v, work):
    """Force of a function, between the knots of its cell; straight on beyond them."""
    cell, most = modes.cells[j], functions.knots.shape[1]
    low = functions.knots[j, cell - 1] if cell > 0 else -FAR
    high = functions.knots[j, cell] if cell < most else FAR
    if low <= x <= high:
        return pulled(functions, j, x, v, work)
    edge = low if x < low else high
    way = min(high - low, functions.widths[j]) * (INSIDE if x < low else -INSIDE)
    force = pulled(functions, j, edge, v, work)
    return force + (pulled(functions, j, edge + way, v, work) - force) / way * (x - edge)


@kernel
def slope_of_memory(functions, modes, j, work):
    """Slope of a memory over the displacement, 1/m, on the sides where memory and rate are."""
    calls, side = functions.calls, modes.sides[j]
    k = calls.memories[j]
    z, beyond = work.z[k, 0], 0.0
    if z * modes.signs[j] < 0.0:
        work.z[k, 0], beyond = modes.signs[j] * INSIDE, z / (modes.signs[j] * INSIDE)
    work.v[j, 0] = side
    ask(calls, SLOPE, j, work.x, work.v, work.z, 0.0, 1)
    slope = work.v[j, 0]
    if beyond != 0.0:
        work.z[k, 0], work.v[j, 0] = 0.0, side
        ask(calls, SLOPE, j, work.x, work.v, work.z, 0.0, 1)
        slope = work.v[j, 0] + beyond * (slope - work.v[j, 0])
        work.z[k, 0] = z
    return slope


@kernel
def sided(functions, modes, j, v):
    """Rate of a function, m/s, on the side where it is."""
    v *= functions.pace
    if functions.kinds[j] == STICKS and v * modes.sides[j] <= 0.0:
        return modes.sides[j] * 1e-300
    return v


@kernel
def mobility(functions, j):
    """Acceleration of a displacement, m per square of the time of the kernels, per unit of the
    force on it."""
    return dot(functions.calls.rows[j], functions.calls.changes[j])


@kernel
def rates_of(system, modes, y, phase, work, out):
    """Rates of a state. Returns the force that holds what sticks, per unit of its reduced mass."""
    motion, laws, functions = system.motion, system.laws, system.functions
    n, size = motion.rows.shape[1], len(motion.generator)
    calls = functions.calls
    force_state(motion, phase, work.w)
    for i in range(n):
        out[i] = y[n + i]
        total = 0.0
        for j in range(2 * n):
            total += work.generator[n + i, j] * y[j]
        for j in range(2 * n, size):
            total += work.generator[n + i, j] * work.w[j - 2 * n]
        out[n + i] = total
    for s in range(len(modes.stops)):
        if modes.stops[s] >= 0 and laws.hertz[s] > 0.0:
            deep, _ = distance_of(motion, s, y)
            push = laws.hertz[s] * max(deep, 0.0) ** 1.5
            for i in range(n):
                out[n + i] -= push * motion.rows[s, i]
    for k in range(2 * n, len(y)):
        work.z[k - 2 * n, 0] = y[k]
    stuck = -1
    for j in range(len(functions.kinds)):
        x, v = displaced(functions, j, y, n)
        if calls.memories[j] >= 0:
            out[2 * n + calls.memories[j]] = slope_of_memory(functions, modes, j, work) * v
        if functions.kinds[j] == STICKS and modes.sides[j] == 0:
            stuck = j
            continue
        force = pulled_in_cell(functions, modes, j, x, sided(functions, modes, j, v), work)
        for i in range(n):
            out[n + i] -= calls.changes[j, i] * force
    if stuck < 0:
        return 0.0
    grip = dot(calls.rows[stuck], out[n:]) / mobility(functions, stuck)
    for i in range(n):
        out[n + i] -= calls.changes[stuck, i] * grip
    return grip


@kernel
def put_aside(y, way, side, out):
    """Write a state beside y in a direction; returns the half of the distance between both sides,
    in lengths of the direction."""
    largest, size = 0.0, 1.0
    for i in range(len(y)):
        largest, size = max(largest, abs(way[i])), max(size, abs(y[i]))
    change = ASIDE * size / max(largest, 1e-300)
    for i in range(len(y)):
        out[i] = y[i] + side * change * way[i]
    return change


@kernel
def is_rooted(system, modes):
    """Whether a stop of Hertz's law presses."""
    found = False
    for s in range(len(modes.stops)):
        found = found or (modes.stops[s] >= 0 and system.laws.hertz[s] > 0.0)
    return found


@kernel
def is_linear(system, modes):
    """Whether all forces are linear."""
    return len(modes.sides) == 0 and not is_rooted(system, modes)


@kernel
def press(system, modes, generator):
    """Write the generator with the springs and dampers of the stops that press. Returns the longest
    step in which no distance turns twice and the series converge: speeds are taken in units of the
    fastest frequency, which a stiff stop raises."""
    motion, laws = system.motion, system.laws
    n, size = motion.rows.shape[1], len(generator)
    for i in range(size):
        put(motion.generator[i], generator[i])
    for s in range(len(modes.stops)):
        if modes.stops[s] < 0:
            continue
        piece = laws.pieces[s, modes.stops[s]]
        b, f, k = piece[0], piece[1], piece[2]
        for i in range(n):
            push = motion.rows[s, i]
            for j in range(n):
                generator[n + i, j] -= k * push * motion.rows[s, j]
                generator[n + i, n + j] -= laws.dampers[s] * push * motion.rows[s, j]
            generator[n + i, size - 1] -= (f - k * (b + motion.positions[s])) * push
    stiffness, damping = 0.0, 0.0
    for i in range(n):
        stiff, damped = 0.0, 0.0
        for j in range(n):
            stiff += abs(generator[n + i, j])
            damped += abs(generator[n + i, n + j])
        stiffness, damping = max(stiffness, stiff), max(damping, damped)
    h = (size - 2 * n - 1) // 2
    fastest = max(max(h, 1) * motion.omega, math.sqrt(stiffness))
    return min(ANGLE / fastest, NORM / (fastest + damping))


@kernel
def leap(system, modes, y, rates, phase, h, work, out):
    """Write the state a step h after y, where its rates are known, or its Taylor coefficients if
    forces are linear; returns the change by the last extrapolation."""
    omega, size = system.motion.omega, len(y)
    if is_linear(system, modes):
        sum_terms(work.terms, h, work.whole)
        put(work.whole[:size], out)
        return 0.0
    before, now, fresh = work.midpoints[0], work.midpoints[1], work.midpoints[2]
    for k in range(COLUMNS):
        count = 2 * (k + 1)
        part = h / count
        for i in range(size):
            before[i] = y[i]
            now[i] = y[i] + part * rates[i]
        for step in range(1, count):
            rates_of(system, modes, now, phase + omega * part * step, work, work.slopes)
            for i in range(size):
                fresh[i] = before[i] + 2.0 * part * work.slopes[i]
                before[i] = now[i]
                now[i] = fresh[i]
        put(now, work.table[k, 0])
        for back in range(1, k + 1):
            ratio = count / (count - 2.0 * back)
            for i in range(size):
                last = work.table[k, back - 1, i]
                change = (last - work.table[k - 1, back - 1, i]) / (ratio * ratio - 1.0)
                work.table[k, back, i] = last + change
    error = 0.0
    for i in range(size):
        out[i] = work.table[COLUMNS - 1, COLUMNS - 1, i]
        change = abs(out[i] - work.table[COLUMNS - 1, COLUMNS - 2, i])
        error = change if not change <= error else error
    return error


@kernel
def edge_of(system, modes, number, y, rates, grip, work):
    """Distance beyond an edge, above 0 there, and its rate; whether it is one of a place, which
    a motion may touch. Edges that are not there are at -1, at rest."""
    motion, laws, functions = system.motion, system.laws, system.functions
    n, m = motion.rows.shape[1], len(modes.stops)
    if number < 2 * m:
        s, up = number // 2, number % 2
        state, c, count = modes.stops[s], laws.dampers[s], laws.counts[s]
        deep, speed = distance_of(motion, s, y)
        if c > 0.0 and state != AWAY and up == (0 if state >= 0 else 1):
            # pressing ends without force, or begins again
            sign, k = (-1.0 if state >= 0 else 1.0), laws.pieces[s, 0, 2]
            pull = dot(motion.rows[s], rates[n:])
            return sign * (k * deep + c * speed), sign * (k * speed + c * pull), False
        if state == FOLLOWING:
            return -deep, -speed, True
        # the beginning of the next piece, or of this one; the gap is the piece before the first
        piece, side = state + up, 2.0 * up - 1.0
        if 0 <= piece < max(count, 1):
            knot = laws.pieces[s, piece, 0] if count else 0.0
            return side * (deep - knot), side * speed, True
        return -1.0, 0.0, False
    j, kind = (number - 2 * m) // 4, (number - 2 * m) % 4
    x, v = displaced(functions, j, y, n)
    width = functions.widths[j]
    sticking = functions.kinds[j] == STICKS and modes.sides[j] == 0
    if sticking and kind <= BELOW:
        side = 1.0 if kind == ABOVE else -1.0
        limit = pulled(functions, j, x, side * 1e-300, work)
        return side * (grip - limit) / max(abs(limit), 1e-300), 0.0, False
    if kind == ABOVE and modes.cells[j] < functions.knots.shape[1]:
        knot = functions.knots[j, modes.cells[j]]
        if knot < FAR:
            return (x - knot) / width, v / width, True
    if kind == BELOW and modes.cells[j] > 0:
        return (functions.knots[j, modes.cells[j] - 1] - x) / width, -v / width, True
    if kind == RATE and functions.kinds[j] != SMOOTH and not sticking:
        faster = dot(functions.calls.rows[j], rates[n:])
        return -modes.sides[j] * v / width, -modes.sides[j] * faster / width, False
    memory = functions.calls.memories[j]
    if kind == MEMORY and memory >= 0:
        k = 2 * n + memory
        return -modes.signs[j] * y[k], -modes.signs[j] * rates[k], False
    return -1.0, 0.0, False


@kernel
def turning_time(ends, rates, h):
    """The first time in a step at which the cubic through two values and rates turns; -1 where it
    does not."""
    _, _, _, one, other = turns_of(ends, rates, h)
    first = min(one, other)
    return first * h if first < 1.0 else -1.0


@kernel
def landed(system, modes, number, top, y, rates, phase, low, high, work, out, out_rates):
    """The time in (low, high) at which an edge is passed or, for `top`, at which the motion turns
    before it; the state and its rates then."""
    below, above = -1.0, -1.0
    time, last = 0.5 * (low + high), -1
    while high - low > 1e-15 * high:
        leap(system, modes, y, rates, phase, time, work, out)
        grip = rates_of(system, modes, out, phase + system.motion.omega * time, work, out_rates)
        value, slope, _ = edge_of(system, modes, number, out, out_rates, grip, work)
        if top:
            value = -slope
        if value == 0.0:
            break
        side = 1 if value > 0.0 else 0
        if side == 1:
            high, above = time, value
            below *= 0.5 if last == 1 else 1.0
        else:
            low, below = time, value
            above *= 0.5 if last == 0 else 1.0
        last = side
        before = time
        # Newton's step; false position, halved where one end stays, without a slope
        if not top and slope != 0.0:
            time -= value / slope
        elif below < 0.0 < above:
            time = low - below * (high - low) / (above - below)
        if not low < time < high:
            time = 0.5 * (low + high)
        if abs(time - before) <= (1e-8 if top else 2e-16) * high:
            break
    leap(system, modes, y, rates, phase, time, work, out)
    rates_of(system, modes, out, phase + system.motion.omega * time, work, out_rates)
    return time


@kernel
def enter(system, modes, number, y, phase, work, rates):
    """Take a motion over an edge, in the place of its state and modes; the stop and the speed of a
    touch, and -1 for none."""
    motion, laws, functions = system.motion, system.laws, system.functions
    m = len(modes.stops)
    if number < 2 * m:
        s, up = number // 2, number % 2
        state = modes.stops[s]
        _, speed = distance_of(motion, s, y)
        if laws.counts[s] == 0:
            strike(motion, s, y)
            for j in range(len(modes.sides)):
                # an impact turns rates at once
                _, v = displaced(functions, j, y, motion.rows.shape[1])
                if abs(v) > AT_REST * functions.widths[j]:
                    modes.sides[j] = 1 if v > 0.0 else -1
        elif state == FOLLOWING:
            modes.stops[s] = AWAY if up == 0 else 0
        elif state >= 0 and laws.dampers[s] > 0.0:
            modes.stops[s] = FOLLOWING
        else:
            modes.stops[s] = state + 2 * up - 1
        return (s, speed) if state == AWAY else (-1, 0.0)
    j, kind = (number - 2 * m) // 4, (number - 2 * m) % 4
    if kind == MEMORY:
        modes.signs[j] = -modes.signs[j]
    elif functions.kinds[j] == STICKS and modes.sides[j] == 0:
        modes.sides[j] = 1 if kind == ABOVE else -1
    elif kind == RATE:
        turn_rate(system, modes, j, y, phase, work, rates)
    else:
        modes.cells[j] += 1 if kind == ABOVE else -1
    return -1, 0.0


@kernel
def turn_rate(system, modes, j, y, phase, work, rates):
    """Set the side of a rate that is 0: that to which its acceleration leads, or none where the
    damper holds it."""
    functions, n = system.functions, system.motion.rows.shape[1]
    if functions.kinds[j] != STICKS:
        modes.sides[j] = -modes.sides[j]
        return
    x, v = displaced(functions, j, y, n)
    modes.sides[j] = 0
    grip = rates_of(system, modes, y, phase, work, rates)
    if grip > pulled(functions, j, x, 1e-300, work):
        modes.sides[j] = 1
    elif grip < pulled(functions, j, x, -1e-300, work):
        modes.sides[j] = -1
    else:
        ease = v / mobility(functions, j)
        for i in range(n):
            y[n + i] -= functions.calls.changes[j, i] * ease


@kernel
def first_modes(system, modes, y, phase, work, rates):
    """Set the modes of a state; returns the longest step in them, as of `press`."""
    motion, laws, functions = system.motion, system.laws, system.functions
    n = motion.rows.shape[1]
    for s in range(len(modes.stops)):
        deep, speed = distance_of(motion, s, y)
        state = AWAY
        while state + 1 < laws.counts[s] and laws.pieces[s, state + 1, 0] < deep:
            state += 1
        modes.stops[s] = state
        if state >= 0 and laws.pieces[s, 0, 2] * deep + laws.dampers[s] * speed < 0.0:
            modes.stops[s] = FOLLOWING
    longest = press(system, modes, work.generator)
    held = -1
    for j in range(len(functions.kinds)):
        x, v = displaced(functions, j, y, n)
        cell = 0
        while cell < functions.knots.shape[1] and functions.knots[j, cell] < x:
            cell += 1
        modes.cells[j] = cell
        modes.sides[j] = 1 if v >= 0.0 else -1
        memory = functions.calls.memories[j]
        modes.signs[j] = 1 if memory < 0 or y[2 * n + memory] >= 0.0 else -1
        if functions.kinds[j] == STICKS and abs(v) <= AT_REST * functions.widths[j]:
            held = j
    if held >= 0:
        turn_rate(system, modes, held, y, phase, work, rates)
    return longest


@kernel
def edges_at(system, modes, y, rates, grip, work, out):
    """Write distance beyond each edge, its rate, and 1 for one of a place, (edges, 3)."""
    for number in range(len(out)):
        out[number, 0], out[number, 1], place = edge_of(system, modes, number, y, rates, grip, work)
        out[number, 2] = 1.0 if place else 0.0


@kernel
def next_edge(starts, ends, h, passed, turned):
    """The edge that is passed first in a step, by cubics: its number, or -1, about when, and from
    when on to look for it; and whether to look for a turn just before it instead. The edges that
    are known to be passed at the end, and to be turned before there, are left out."""
    found, at, low, turn = -1, h, 0.0, False
    for number in range(len(starts)):
        start, rate = starts[number, 0], starts[number, 1]
        end, last = ends[number, 0], ends[number, 1]
        if abs(start) <= TOUCHED:
            start = 0.0
        if number == passed:
            continue
        if end > 0.0:
            time, begin = 0.0, 0.0
            if start < 0.0:
                time = h * start / (start - end)
            elif rate < 0.0:
                # back to an edge that the step starts from
                time = max(turning_time((0.0, end), (rate, last), h), 0.0)
                begin = time
            if found < 0 or time < at:
                found, at, low, turn = number, time, begin, False
        elif start < 0.0 < rate and last < 0.0 and ends[number, 2] > 0.0 and number != turned:
            top = turning_time((start, end), (rate, last), h)
            near = top > JUST_TURNED * h and swing(
                (0.0, end - start), (rate, last), h
            ) + start > -NEAR_TOP * (abs(start) + abs(end) + h * rate)
            if near and (found < 0 or top < at):
                found, at, low, turn = number, top, 0.0, True
    return found, at, low, turn


@kernel
def acceleration_of(system, modes, y, rates, phase, time, work):
    """Absolute acceleration of the output, and its rate by differences over twice a time."""
    motion, n = system.motion, system.motion.rows.shape[1]
    value, slope = 0.0, 0.0
    for turn in range(3):
        # on either side for the rate, and last at the state itself
        shift = 0.0 if turn == 2 else (time if turn == 1 else -time)
        for i in range(len(y)):
            work.ahead[i] = y[i] + shift * rates[i]
        rates_of(system, modes, work.ahead, phase + motion.omega * shift, work, work.slopes)
        value = dot(motion.output, work.slopes[n:]) + dot(motion.base, work.w)
        if turn < 2:
            slope += value / (2.0 * shift)
    return value, slope


@kernel
def advance(system, modes, y, rates, phase, step, limit, places, work, out, later):
    """Write the state after a step, or at the first edge in it. Returns its length, the edge that
    is passed at its end, or -1, and the change by the last extrapolation. Where that is beyond a
    limit nothing else is found."""
    starts, ends = places
    omega, size = system.motion.omega, len(y)
    if is_linear(system, modes):
        put(y, work.whole[:size])
        force_state(system.motion, phase, work.whole[size:])
        expand(work.generator, work.whole, work.terms)
    error = leap(system, modes, y, rates, phase, step, work, out)
    if not error <= limit:
        return step, -1, error
    passed, turned, high = -1, -1, step
    for _ in range(2 * len(starts)):
        grip = rates_of(system, modes, out, phase + omega * high, work, later)
        edges_at(system, modes, out, later, grip, work, ends)
        found, at, low, turn = next_edge(starts, ends, high, passed, turned)
        if found < 0:
            break
        if at <= 0.0:
            put(y, out)
            put(rates, later)
            return 0.0, found, error
        # a place where a motion turns before an edge is no event, unless the edge is passed there
        high = landed(system, modes, found, turn, y, rates, phase, low, high, work, out, later)
        passed, turned = (-1, found) if turn else (found, turned)
    return high, passed, error


@kernel
def turn_over_step(system, modes, y, phase, length, work, grown):
    """Take small perturbations of the state y, in their place, over a step within its modes."""
    for column in range(grown.shape[1]):
        if is_linear(system, modes):
            turn_column(work.generator, length, grown, column, work.ahead)
            continue
        change = 0.0
        for side in range(2):
            change = put_aside(y, grown[:, column], 2.0 * side - 1.0, work.ahead)
            rates_of(system, modes, work.ahead, phase, work, work.sides[2])
            leap(system, modes, work.ahead, work.sides[2], phase, length, work, work.sides[side])
        for i in range(len(y)):
            grown[i, column] = (work.sides[1, i] - work.sides[0, i]) / (2.0 * change)


@kernel
def delays_at(system, modes, number, y, rates, grip, grown, work, out):
    """Write how much earlier each small perturbation of a motion passes an edge than the motion."""
    _, faster, _ = edge_of(system, modes, number, y, rates, grip, work)
    for column in range(grown.shape[1]):
        total, change = 0.0, 1.0
        for side in (-1.0, 1.0):
            change = put_aside(y, grown[:, column], side, work.ahead)
            beyond, _, _ = edge_of(system, modes, number, work.ahead, rates, grip, work)
            total += side * beyond
        out[column] = total / (2.0 * change * faster) if faster != 0.0 else 0.0


@kernel
def turn_at_edge(system, struck, before, after, delays, grown):
    """Take small perturbations over an edge, also the impact on the stop that is struck, if it is
    rigid: each passes it at another moment. The rates before act until then, those after it from
    then on."""
    two = 2 * system.motion.rows.shape[1]
    if struck >= 0 and system.laws.counts[struck] == 0:
        strike(system.motion, struck, before[:two])
        for column in range(grown.shape[1]):
            strike(system.motion, struck, grown[:two, column])
    for i in range(len(before)):
        change = after[i] - before[i]
        if abs(change) > SUDDEN * (abs(after[i]) + abs(before[i])):
            for column in range(grown.shape[1]):
                grown[i, column] += change * delays[column]


@kernel
def flow(system, start, phase, record):
    """Follow a motion over whole periods of the force from a phase of it.

    Returns the number of contacts, or -1 where events come too fast to be followed. Then come the
    largest displacement and acceleration of the output, and the amplitude of its first harmonic.
    """
    motion, size, parts = system.motion, len(start), len(system.functions.kinds)
    n, m, whole = motion.rows.shape[1], len(motion.positions), len(motion.generator)
    work = Work(
        np.zeros((parts, 1)), np.zeros((parts, 1)), np.zeros((max(size - 2 * n, 1), 1)),
        np.empty(whole - 2 * n), np.empty((whole, whole)), np.empty(whole),
        np.empty((TERMS, whole)), np.empty((COLUMNS, COLUMNS, size)), np.empty((3, size)),
        np.empty(size), np.empty(size), np.empty((3, size)), np.empty((4, size)),
    )  # fmt: skip
    modes = Modes(
        np.full(m, AWAY), np.zeros(parts, np.int64), np.zeros(parts, np.int64),
        np.zeros(parts, np.int64),
    )  # fmt: skip
    places = np.zeros((2, 2 * m + 4 * parts, 3))
    found = follow(
        borrowed(system), borrowed(modes), start, phase, record, borrowed(work), borrowed(places)
    )
    hold(system)
    hold(modes)
    hold(work)
    hold(places)
    return found


@kernel
def follow(system, modes, start, phase, record, work, places):
    """`flow`, in arrays of which no owners are counted."""
    motion, functions = system.motion, system.functions
    ends, log, grown = record
    periods, size, parts = len(ends) - 1, len(start), len(functions.kinds)
    delays = np.zeros(grown.shape[1])
    y, fresh, rates, later = work.states[0], work.states[1], work.states[2], work.states[3]
    put(start, y)
    put(start, ends[0])
    longest = first_modes(system, modes, y, phase, work, rates)
    shortest, most = SHARE * SHORTEST * longest, MOST_IMPACTS * (2 + parts)
    hits, displacement, acceleration, harmonic, wanted = 0, 0.0, 0.0, 0j, longest
    fastest = 0.0
    for period in range(periods):
        events, left = 0, 2.0 * math.pi / motion.omega
        while left > 0.0:
            now = phase + 2.0 * math.pi * (period + 1) - motion.omega * left
            grip = rates_of(system, modes, y, now, work, rates)
            edges_at(system, modes, y, rates, grip, work, places[0])
            wanted = longest if is_linear(system, modes) else min(wanted, SHARE * longest)
            accurate = ACCURATE * (ROOTED if is_rooted(system, modes) else 1.0)
            limit = accurate if wanted > shortest else np.inf
            length, passed, error = advance(
                system, modes, y, rates, now, min(wanted, left), limit, places, work, fresh, later
            )
            if not error <= limit:
                wanted = 0.5 * min(wanted, left)
                events += 1
                if events > most:
                    return -1, displacement, acceleration, 0.0
                continue
            if error <= 1e-3 * accurate:
                wanted = min(2.0 * wanted, longest)
            largest = 0.0
            for i in range(size):
                largest = abs(fresh[i]) if not abs(fresh[i]) <= largest else largest
            if not largest < LARGEST:
                return -1, displacement, acceleration, 0.0
            then = now + motion.omega * length
            place, moving = output_of(motion, y)
            place_, moving_ = output_of(motion, fresh)
            displacement = max(displacement, swing((place, place_), (moving, moving_), length))
            if length > 0.0 and period >= periods - MEASURED:
                probe = PROBE * longest
                push, jerk = acceleration_of(system, modes, y, rates, now, probe, work)
                push_, jerk_ = acceleration_of(system, modes, fresh, later, then, probe, work)
                acceleration = max(acceleration, swing((push, push_), (jerk, jerk_), length))
            # the first harmonic by the values and slopes of its integrand
            wave, wave_ = (
                complex(math.cos(now), math.sin(now)),
                complex(math.cos(then), math.sin(then)),
            )
            bend = (moving + 1j * motion.omega * place) * wave
            bend -= (moving_ + 1j * motion.omega * place_) * wave_
            harmonic += 0.5 * length * (place * wave + place_ * wave_) + length**2 / 12.0 * bend
            turn_over_step(system, modes, y, now, length, work, grown)
            put(fresh, y)
            left -= length
            if left < 1e-13:
                left = 0.0
            if passed < 0 and length > shortest:
                continue
            # steps that lead nowhere are counted, too: no motion is followed for ever
            events += 1
            if events > most:
                return -1, displacement, acceleration, 0.0
            if passed < 0:
                continue
            if len(delays) > 0:
                grip = rates_of(system, modes, y, then, work, later)
                delays_at(system, modes, passed, y, later, grip, grown, work, delays)
            stop, speed = enter(system, modes, passed, y, then, work, rates)
            longest = press(system, modes, work.generator)
            if len(delays) > 0:
                rates_of(system, modes, y, then, work, rates)
                turn_at_edge(system, stop, later, rates, delays, grown)
            if stop >= 0:
                slot = hits % len(log)
                log[slot, 0], log[slot, 1], log[slot, 2] = then, stop, speed
                put(fresh, log[slot, 3:])
                hits += 1
                fastest = max(fastest, speed)
                if system.laws.counts[stop] == 0 and speed <= STILL * fastest:
                    return -1, displacement, acceleration, 0.0
        put(y, ends[period + 1])
    amplitude = motion.omega / (math.pi * periods) * abs(harmonic)
    return hits, displacement, acceleration, amplitude
