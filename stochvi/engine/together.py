"""What is left of a step of many paths, with contacts integrated side by side.

Chapters: contacts that are known by the speed of their touch; many lanes side by side.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int64
from numpy.typing import NDArray

from stochvi.engine.arithmetic import (
    ENDED,
    IMPULSE,
    LANES,
    LOSS,
    MOST_BOUNCES,
    PEAK,
    ROW,
    ROWS_OF_PAIR,
    ROWS_OF_STOP,
    TIME,
    Log,
    cleared,
    page_of,
    rows_of,
    word_of_step,
)
from stochvi.engine.borrowed import borrowed
from stochvi.engine.calls import Stops, apart, call_apart, press_all, press_lanes
from stochvi.engine.compiling import kernel
from stochvi.engine.compliant_contacts import (
    APART,
    NO_PAIR,
    PUSHES,
    Following,
    Tally,
    Workspace,
    add_jump,
    add_push,
    find_contacts,
    finish_alone,
    followed_of,
    keep_between_stops,
    move_starts,
    until_contact,
)
from stochvi.engine.parts import MOST_NUMBERS
from stochvi.engine.sub_steps import (
    A0,
    A1,
    C0,
    LASTED,
    LASTING,
    LEFT,
    LOST,
    MOMENTS,
    NOW,
    NUMBERS,
    OVER,
    OWN,
    PEAKS,
    PUSH,
    Q0,
    Q1,
    Q2,
    Q3,
    ROWS,
    RUNNING,
    STATE,
    TRIES,
    V0,
    V1,
    Y0,
    Y1,
    Responses,
    T,
    V,
    Y,
    tangent_of,
)

# ------------------------------------------------------------------------------
# Contacts of one mode that begin with a touch and end within a step.
#
# No noise acts within a step, so that such a contact of a structure of one mode is a function of
# the speed of its touch. Tables of polynomials hold that function. A contact is then read from them
# instead of being integrated, which makes the price of a contact the same for all laws.
#
# After it the motion is that of a mass at the stop with the speed of leaving. As a push at that
# time, which changes displacement and speed by dy and dv, it has the moments S_0 = dv, S_1 = dy and
# no others (`add_jump`).
# ------------------------------------------------------------------------------


CELLS, TERMS = 96, 6
"""Number of polynomials of a quantity, for equal ratios of speeds, and of their coefficients."""

SLOWEST, FASTEST = 1e-3, 10.0
"""Range of the speeds of touches of a table, in units of the rms speed of the gap."""

FINER = 8.0
"""How much shorter sub-steps are than usual where tables are made; their method is of order 4."""

TABLE_ERROR = 1e-6
"""Largest relative error of the polynomials in the middle and near the ends of a cell: that of a
contact in sub-steps is larger. Contacts of other cells are integrated: of those where the force has
a kink. A stop that loses nothing gives back the whole speed."""

REBOUND, DURATION, BRAKING, HARDEST, PUSHING = range(5)
QUANTITIES = 5
"""Quantities of a contact: speed of leaving over that of the touch; duration, s; impulse over the
speed of the touch; peak force over the same; and for how long the stop pushes, s."""


class Known(NamedTuple):
    """Contacts with the lower and the upper stop of one pair, by the speed of the touch.

    Parameters
    ----------
    first, per_cell : logarithm of the slowest speed, and cells to a unit of the logarithm.
    terms : (2, CELLS, QUANTITIES, TERMS), coefficients of the powers of the place in a cell, from
        0 to 1. The duration is infinite in a cell whose contacts have to be integrated. There are
        no cells where contacts are not known.
    """

    first: float
    per_cell: float
    terms: NDArray[np.float64]


NOT_KNOWN = Known(0.0, 0.0, np.zeros((2, 0, QUANTITIES, TERMS)))
"""No contacts are known: those of several modes, or in which noise acts."""


def known_contacts(
    stops: Stops, laws: list[Any], responses: Responses, speed: float, span: float,
    square: float, fastest: float,
) -> Known:  # fmt: skip
    """Tables of the contacts with the stops of the only pair of a structure of one mode.

    Parameters
    ----------
    laws : a law of each class.
    speed : rms speed of the gap, m/s.
    span : s, the longest contact.
    square : w0^2 of the mode, 1/s^2; places of stops are measured from its rest position.
    fastest : rad/s, fastest rate of a contact at the fastest touch.
    """
    # errors are smallest with these places (Chebyshev)
    places = 0.5 - 0.5 * np.cos(0.5 * np.pi / TERMS * np.arange(1, 2 * TERMS, 2))
    tried = np.array([*places, 0.02, 0.5])
    first, width = math.log(SLOWEST * speed), math.log(FASTEST / SLOWEST) / CELLS
    touches = np.exp(first + width * (np.arange(CELLS)[:, None] + tried))
    terms = np.zeros((2, CELLS, QUANTITIES, TERMS))
    terms[:, :, DURATION, 0] = np.inf
    powers = tried[:, None] ** np.arange(TERMS)
    to_terms = np.linalg.inv(powers[:TERMS])
    for upper in np.flatnonzero(~stops.rigid[0]):
        found = np.concatenate([
            integrate_touches(each, upper, span, square, FINER * fastest, stops, laws, responses)
            for each in np.split(touches.ravel(), range(LANES, touches.size, LANES))
        ])  # fmt: skip
        if not stops.lossy[0, upper]:
            found[:, REBOUND] = np.where(np.isfinite(found[:, REBOUND]), 1.0, np.nan)
        found = found.reshape(CELLS, len(tried), QUANTITIES)
        made = np.einsum("pn,cnq->cqp", to_terms, found[:, :TERMS])
        off = np.abs(np.einsum("np,cqp->cnq", powers[TERMS:], made) - found[:, TERMS:])
        good = np.all(off <= TABLE_ERROR * np.abs(found[:, TERMS:]), axis=(1, 2))
        terms[upper, good] = made[good]
    return Known(first, 1.0 / width, terms)


def integrate_touches(
    touches: NDArray[np.float64], upper: int, span: float, square: float, fastest: float,
    stops: Stops, laws: list[Any], responses: Responses,
) -> NDArray[np.float64]:  # fmt: skip
    """Integrate contacts from touches at some speeds, at most LANES, to their ends: rows of
    QUANTITIES, nan where a contact lasts longer than the span."""
    memory, count = cleared(ROWS * ROW), len(touches)
    w = rows_of(memory)[:, :count]
    side, stop, omega = 2.0 * upper - 1.0, stops.places[0, upper], math.sqrt(square)
    cosine, sine = math.cos(omega * span), math.sin(omega * span) / omega if omega > 0.0 else span
    # without the stop the gap swings freely; `start_contact` says the same of any quintic
    v0, a0 = side * touches, -square * stop
    y1, v1 = stop * cosine + v0 * sine, v0 * cosine - square * stop * sine
    a1 = -square * y1
    rise = y1 - stop - v0 * span - 0.5 * a0 * span * span
    slope, bend = (v1 - v0 - a0 * span) * span, (a1 - a0) * span * span
    squared = span * span
    w[Q0] = side * a0
    w[Q1] = side * 6.0 * (10.0 * rise - 4.0 * slope + 0.5 * bend) / (squared * span)
    w[Q2] = side * 12.0 * (-15.0 * rise + 7.0 * slope - bend) / (squared * squared)
    w[Q3] = side * 20.0 * (6.0 * rise - 3.0 * slope + 0.5 * bend) / (squared * squared * span)
    w[V], w[PUSH], w[LEFT] = touches, np.maximum(np.maximum(side * a0, side * a1), 0.0), span
    w[STATE], w[OWN] = RUNNING, responses.gaps[0, 0, 1, 0]
    w[C0 : C0 + 4] = responses.gaps[0, 0, 2, :4, None]
    kept = stops.numbers[upper, :MOST_NUMBERS]
    w[NUMBERS : NUMBERS + len(kept)], w[NUMBERS + MOST_NUMBERS] = kept[:, None], upper
    press_lanes(laws[stops.kinds[0, upper]], memory, count, stops.numbers, fastest)
    lasted = np.where(w[STATE] == OVER, w[T], np.nan)
    return np.stack(
        [-w[V] / touches, lasted, w[NOW] / touches, w[PEAKS] / touches, w[LASTED]], axis=1
    )


@kernel
def quantity_of(terms, upper, cell, quantity, u):
    """A quantity of a contact at the place u in a cell."""
    found = terms[upper, cell, quantity, TERMS - 1]
    for k in range(TERMS - 2, -1, -1):
        found = terms[upper, cell, quantity, k] + u * found
    return found


@kernel
def pass_known_contact(pair, upper, span, scene, tally):
    """Let the lane in the workspace, which touches a stop, begin where that contact ended, if it is
    known and ends in the step; returns what is left, s, or -1 where it is to be integrated."""
    known, work, sums = scene.known, scene.work, tally.sums
    gaps, side, terms = work.gaps, 2.0 * upper - 1.0, known.terms
    w = side * gaps[V0, pair]
    place = (math.log(w) - known.first) * known.per_cell if w > 0.0 else -1.0
    if not 0.0 <= place < terms.shape[1]:
        return -1.0
    cell = int(place)
    u = place - cell
    lasted = quantity_of(terms, upper, cell, DURATION, u)
    if not lasted < span:
        return -1.0
    back = w * quantity_of(terms, upper, cell, REBOUND, u)
    row, lane = ROWS_OF_PAIR + ROWS_OF_STOP * upper, tally.lane
    sums[pair, row + IMPULSE, lane] += w * quantity_of(terms, upper, cell, BRAKING, u)
    lossy = scene.stops.lossy[pair, upper]
    sums[pair, row + LOSS, lane] += 0.5 * (w - back) * (w + back) if lossy else 0.0
    sums[pair, row + TIME, lane] += quantity_of(terms, upper, cell, PUSHING, u)
    sums[pair, row + PEAK, lane] += w * quantity_of(terms, upper, cell, HARDEST, u)
    sums[pair, row + ENDED, lane] += 1.0
    move_starts(gaps, lasted, span)
    change, moved = -side * back - gaps[V0, pair], scene.stops.places[pair, upper] - gaps[Y0, pair]
    add_jump(pair, change, moved, span - lasted, scene.responses, None, work)
    gaps[Y0, pair], gaps[V0, pair] = scene.stops.places[pair, upper], -side * back
    return span - lasted


# ------------------------------------------------------------------------------
# Many lanes side by side.
#
# Each lane in which a stop may be reached goes on by itself, through impacts on rigid stops
# (`contacts.until_contact`) and contacts that are known. It waits where it touches another
# compliant stop. In rounds, all contacts with stops whose laws are of one class are integrated side
# by side (`sub_steps`), and their lanes go on. Some lanes finish their step alone, with the same
# equations: those that rest on a stop, those whose stop rubs, and those in which another stop may
# be reached during the contact. The function for these is compiled apart, where there can be any.
# ------------------------------------------------------------------------------


LANE, SPAN, TOUCHES, PAIR, UPPER, KEPT = range(6)
"""What is kept of a lane that waits: its number, what is left of its step (s), the number of its
touches, and the stop that it touches; then the numbers of `Workspace`."""


class Ends(NamedTuple):
    """Values, slopes and curvatures of the gaps (pairs, lanes) at both ends of a step."""

    y0: NDArray[np.float64]
    v0: NDArray[np.float64]
    a0: NDArray[np.float64]
    y1: NDArray[np.float64]
    v1: NDArray[np.float64]
    a1: NDArray[np.float64]


class Scene(NamedTuple):
    """What the lanes of a kernel share, and what they write to.

    Parameters
    ----------
    step : s.
    stops, laws, responses, known : `Stops`, `functions_of` the classes of laws, `Responses` and
        `Known`.
    work : `Workspace`, overwritten.
    ends : `Ends`, of which the values y1 are changed.
    new : (states, lanes), states at the end of the step, changed.
    sums, peaks : those of `Tally`.
    words : (lanes,), first words of the random streams after the normals of the step.
    log, first_path, number : None, or a `Log`; number of the path in the first lane, and of the
        step, negative in a burn-in.
    following : None, or `Following`; every lane then finishes alone.
    """

    step: float
    stops: Stops
    laws: NDArray[np.int64]
    responses: Responses
    known: Known
    work: Workspace
    ends: Ends
    new: NDArray[np.float64]
    sums: NDArray[np.float64]
    peaks: NDArray[np.float64]
    words: NDArray[np.uint64]
    log: Log | None
    first_path: int
    number: int
    following: Following | None


class Waiting(NamedTuple):
    """Lanes that wait for a contact.

    Parameters
    ----------
    fastest : fastest rate of the structure, rad/s.
    lanes : (2, LANES, KEPT + numbers), those of this round and of the next.
    order : (LANES,), the lanes of one class of laws.
    memory : rows of `batch`, of contacts that are integrated side by side.
    alone : `finish_lane`, by `apart`.
    """

    fastest: float
    lanes: NDArray[np.float64]
    order: NDArray[np.int64]
    memory: NDArray[np.float64]
    alone: Any


def make_waiting(lanes: int, fastest: float, stops: Stops, numbers: int, scene: Scene) -> Waiting:
    """`Waiting` for that many lanes at most, of a scene whose tuples are lent, with that number of
    numbers in its workspace.

    No lane finishes alone where there is one pair, whose stops are compliant and do not rub. The
    function that does it is then not compiled.
    """
    waiting = Waiting(
        fastest, cleared(2, lanes, KEPT + numbers), cleared(lanes, of=np.int64),
        cleared(ROWS * ROW), None,
    )  # fmt: skip
    places = stops.places
    one_by_one = len(places) == 1 and not np.any(stops.rigid & np.isfinite(places))
    wanted = not one_by_one or places[0, 0] >= places[0, 1] or scene.following is not None
    example = -1, 0, NO_PAIR, 0, 0.0, 0, scene, fastest, waiting.memory
    return waiting._replace(alone=apart(finish_lane, example, wanted=wanted, returns=int64))


@kernel
def tally_of(lane, scene):
    """What the step of a lane is added to; the caller borrows it."""
    word = word_of_step(scene.words[lane], scene.number)
    return Tally(scene.peaks, scene.sums, lane, word)


@kernel
def take_lane(i, ends, work):
    """Write a lane at the start of its step into the workspace."""
    y0, v0, a0, y1, v1, a1 = ends.y0, ends.v0, ends.a0, ends.y1, ends.v1, ends.a1
    gaps, resting = work.gaps, work.contacts.resting
    for j in range(gaps.shape[1]):
        gaps[Y0, j], gaps[V0, j], gaps[A0, j] = y0[j, i], v0[j, i], a0[j, i]
        gaps[Y1, j], gaps[V1, j], gaps[A1, j] = y1[j, i], v1[j, i], a1[j, i]
        resting[j, 0] = resting[j, 1] = 0
    for row in range(work.change.shape[0]):
        work.change[row] = 0.0


@kernel
def go_home(lane, scene, tally):
    """Write the end of the step of a lane, with its gaps between rigid stops."""
    work, places, y1 = scene.work, scene.stops.places, scene.ends.y1
    beyond = False
    for j in range(places.shape[0]):
        beyond |= (work.gaps[Y1, j] > places[j, 1]) | (work.gaps[Y1, j] < places[j, 0])
    if beyond:
        keep_between_stops(
            scene.stops.bounces, work.gaps, work.change, scene.stops, scene.laws, scene.responses,
            tally,
        )  # fmt: skip
    for row in range(work.change.shape[0]):
        scene.new[row, lane] += work.change[row]
    for j in range(places.shape[0]):
        y1[j, lane] = work.gaps[Y1, j]


@kernel
def finish_lane(m, lane, pair, upper, span, touches, scene, fastest, memory):
    """Finish the step of a lane alone; return whether it has, as a number.

    It begins with the contacts that `find_contacts` noted. If the pair is not NO_PAIR, it begins at
    the touch of its stop. If m is not below 0, it does so only where the contact in that column is
    crowded.
    """
    if m >= 0 and not is_crowded(m, pair, span, scene, memory):
        return 0
    touching, inside = False, scene.work.contacts.inside
    if pair != NO_PAIR:
        hold_contact(pair, upper, scene)
    tally = borrowed(tally_of(lane, scene))
    for j in range(inside.shape[0]):
        touching |= inside[j, 0] + inside[j, 1] > 0
    page = page_of(scene.log, scene.first_path + lane, scene.number, scene.step)
    finish_alone(
        scene.step, span, touching, touches, fastest, scene.stops, scene.laws, scene.responses,
        borrowed(followed_of(scene.following, lane)), scene.work, tally, borrowed(page),
    )  # fmt: skip
    go_home(lane, scene, tally)
    return 1


@kernel
def go_on(lane, span, touches, scene):
    """Let a lane go on until it is home, or touches a stop in a contact that is not known; returns
    that stop, what is left of the step, and the number of touches."""
    page = page_of(scene.log, scene.first_path + lane, scene.number, scene.step)
    tally, pair, upper, left = borrowed(tally_of(lane, scene)), NO_PAIR, 0, span
    while left >= 0.0:
        pair, upper, span, touches = until_contact(
            scene.step, left, touches, scene.stops, scene.laws, scene.responses, None, scene.work,
            tally, borrowed(page),
        )  # fmt: skip
        left = -1.0 if pair == NO_PAIR else pass_known_contact(pair, upper, span, scene, tally)
    if pair == NO_PAIR and touches > 0:  # without, it moves as if there were no stops
        go_home(lane, scene, tally)
    return pair, upper, span, touches


@kernel
def is_at_rest(resting):
    """Whether a path rests on any stop."""
    rests = 0
    for j in range(resting.shape[0]):
        rests += resting[j, 0] + resting[j, 1]
    return rests > 0


@kernel
def wait(lane, pair, upper, span, touches, scene, waiting, now, count):
    """Put a lane that touches a compliant stop into a queue, which has `count` lanes, or let it
    finish; returns how many lanes the queue has."""
    work = scene.work
    if touches >= MOST_BOUNCES or span <= 0.0:
        go_home(lane, scene, borrowed(tally_of(lane, scene)))
        return count
    if is_at_rest(work.contacts.resting) or tangent_of(scene.stops.tangents, pair) >= 0:
        arguments = -1, lane, pair, upper, span, touches, scene, waiting.fastest, waiting.memory
        call_apart(waiting.alone, arguments)
        return count
    row = waiting.lanes[now, count]
    row[LANE], row[SPAN], row[TOUCHES], row[PAIR], row[UPPER] = lane, span, touches, pair, upper
    for k in range(work.numbers.shape[0]):
        row[KEPT + k] = work.numbers[k]
    return count + 1


@kernel
def hold_contact(pair, upper, scene):
    """Note that a stop is in contact, which was touched now or in the step before."""
    work, inside = scene.work, scene.work.contacts.inside
    find_contacts(work.gaps, work.contacts, scene.stops, scene.laws)
    if inside[pair, upper] == APART:
        # it is touched now; another one at the same place may seem to be inside by rounding
        for j in range(inside.shape[0]):
            inside[j, 0] = inside[j, 1] = APART
        inside[pair, upper] = PUSHES


@kernel
def start_contact(m, pair, upper, span, scene, memory):
    """Write the contact of the lane in the workspace as it begins into the column m."""
    w, gaps, numbers = rows_of(memory), scene.work.gaps, scene.stops.numbers
    side, stop, row = 2.0 * upper - 1.0, scene.stops.places[pair, upper], 2 * pair + upper
    series = scene.responses.gaps
    g0, v0, a0 = gaps[Y0, pair] - stop, gaps[V0, pair], gaps[A0, pair]
    rise = gaps[Y1, pair] - stop - g0 - v0 * span - 0.5 * a0 * span * span
    slope = (gaps[V1, pair] - v0 - a0 * span) * span
    bend = (gaps[A1, pair] - a0) * span * span
    square = span * span
    w[Q0, m] = side * a0
    w[Q1, m] = side * 6.0 * (10.0 * rise - 4.0 * slope + 0.5 * bend) / (square * span)
    w[Q2, m] = side * 12.0 * (-15.0 * rise + 7.0 * slope - bend) / (square * square)
    w[Q3, m] = side * 20.0 * (6.0 * rise - 3.0 * slope + 0.5 * bend) / (square * square * span)
    w[Y, m], w[V, m], w[T, m] = side * g0, side * v0, 0.0
    w[PUSH, m] = max(max(side * a0, side * gaps[A1, pair]), 0.0)
    w[LEFT, m], w[TRIES, m] = span, 0.0
    w[PEAKS, m], w[LOST, m], w[LASTED, m] = 0.0, 0.0, 0.0
    w[STATE, m] = RUNNING
    w[OWN, m] = series[pair, pair, 1, 0]
    for k in range(4):
        w[C0 + k, m] = series[pair, pair, 2, k]
    for k in range(MOMENTS):
        w[NOW + k, m] = 0.0
    for k in range(min(MOST_NUMBERS, numbers.shape[1])):
        w[NUMBERS + k, m] = numbers[row, k]
    w[NUMBERS + MOST_NUMBERS, m] = row


@kernel
def add_contact(m, pair, upper, scene, tally, memory):
    """Add impulse, loss, duration and peak force of a contact to the sums of its path."""
    w, sums, peaks, lane = rows_of(memory), tally.sums, tally.peaks, tally.lane
    row = ROWS_OF_PAIR + ROWS_OF_STOP * upper
    peak = max(peaks[lane, pair, upper], w[PEAKS, m])
    sums[pair, row + IMPULSE, lane] += w[NOW, m]
    sums[pair, row + LOSS, lane] += w[LOST, m] if scene.stops.lossy[pair, upper] else 0.0
    sums[pair, row + TIME, lane] += w[LASTED, m]
    if w[STATE, m] == OVER:
        sums[pair, row + PEAK, lane] += peak
        sums[pair, row + ENDED, lane] += 1.0
        peak = 0.0
    peaks[lane, pair, upper] = peak


@kernel
def is_crowded(m, pair, span, scene, memory):
    """Whether another gap may reach a stop during the contact in the column m.

    It moves by at most the sum of its responses, beyond the hull of its motion without the contact.
    """
    w, gaps, places, series = (
        rows_of(memory), scene.work.gaps, scene.stops.places, scene.responses.gaps,
    )  # fmt: skip
    x = w[T, m] / span
    u, bend, crowded = 1.0 - x, 0.05 * span * span, False
    for other in range(places.shape[0]):
        if other == pair:
            continue
        reach = 0.0
        for k in range(MOMENTS):
            reach += abs(series[pair, other, 0, k]) * w[NOW + k, m]
        c0, c5 = gaps[Y0, other], gaps[Y1, other]
        leaving, coming = 0.2 * span * gaps[V0, other], 0.2 * span * gaps[V1, other]
        c1, c2 = c0 + leaving, c0 + 2.0 * leaving + bend * gaps[A0, other]
        c4, c3 = c5 - coming, c5 - 2.0 * coming + bend * gaps[A1, other]
        # the hull of the part until the end of the contact, by de Casteljau
        highest, lowest = c0, c0
        c0, c1, c2, c3, c4 = (
            u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3, u * c3 + x * c4, u * c4 + x * c5,
        )  # fmt: skip
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1, c2, c3 = u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3, u * c3 + x * c4
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1, c2 = u * c0 + x * c1, u * c1 + x * c2, u * c2 + x * c3
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0, c1 = u * c0 + x * c1, u * c1 + x * c2
        highest, lowest = max(highest, c0), min(lowest, c0)
        c0 = u * c0 + x * c1
        highest, lowest = max(highest, c0), min(lowest, c0)
        crowded |= (highest + reach > places[other, 1]) | (lowest - reach < places[other, 0])
    return crowded


@kernel
def end_contact(m, pair, upper, span, scene, tally, memory):
    """Let the lane in the workspace begin where its contact ended; returns what is left, s."""
    w, work = rows_of(memory), scene.work
    side, stop = 2.0 * upper - 1.0, scene.stops.places[pair, upper]
    add_contact(m, pair, upper, scene, tally, memory)
    move_starts(work.gaps, w[T, m], span)
    lasting = w[STATE, m] == LASTING
    span = 0.0 if lasting else span - w[T, m]
    for k in range(MOMENTS):
        work.now[k] = -side * w[NOW + k, m]
    add_push(pair, span, scene.responses, None, work)
    work.gaps[Y0, pair] = stop + side * (w[Y, m] if lasting else 0.0)
    work.gaps[V0, pair] = side * w[V, m]
    return span


@kernel
def press_kind(kind, count, scene, waiting, now):
    """Integrate the contacts of all waiting lanes whose stops have laws of one class; returns how
    many they are, and writes them into `order`."""
    lanes, order, memory = waiting.lanes, waiting.order, waiting.memory
    work, stops = scene.work, scene.stops
    n = np.int64(0)
    for i in range(count):
        row = lanes[now, i]
        pair, upper = int(row[PAIR]), int(row[UPPER])
        if stops.kinds[pair, upper] == kind:
            for k in range(work.numbers.shape[0]):
                work.numbers[k] = row[KEPT + k]
            start_contact(n, pair, upper, row[SPAN], scene, memory)
            order[n] = i
            n += 1
    if n > 0:
        press_all(scene.laws, kind, memory, 0, n, stops.numbers, waiting.fastest)
    return n


@kernel
def press_waiting(count, scene, waiting):
    """Integrate the contacts of all waiting lanes, and let these go on, until none waits."""
    work, contacts, lanes, order = scene.work, scene.work.contacts, waiting.lanes, waiting.order
    fastest, memory = waiting.fastest, waiting.memory
    now = np.int64(0)
    while count > 0:
        later = np.int64(0)
        for kind in range(scene.laws.shape[0]):
            for m in range(press_kind(kind, count, scene, waiting, now)):
                row = lanes[now, order[m]]
                lane, span, touches = int(row[LANE]), row[SPAN], int(row[TOUCHES])
                pair, upper = int(row[PAIR]), int(row[UPPER])
                for k in range(work.numbers.shape[0]):
                    work.numbers[k] = row[KEPT + k]
                for j in range(work.gaps.shape[1]):
                    contacts.resting[j, 0] = contacts.resting[j, 1] = 0
                if work.gaps.shape[1] > 1:
                    alone = m, lane, pair, upper, span, touches, scene, fastest, memory
                    if call_apart(waiting.alone, alone) != 0:
                        continue
                tally = borrowed(tally_of(lane, scene))
                span = end_contact(m, pair, upper, span, scene, tally, memory)
                pair, upper, span, touches = go_on(lane, span, touches, scene)
                if pair != NO_PAIR:
                    later = wait(lane, pair, upper, span, touches, scene, waiting, 1 - now, later)
        now, count = 1 - now, later


@kernel
def finish_together(index, scene, waiting):
    """The step of the lanes in `index`, at most LANES, in which a stop may be reached.

    Parameters
    ----------
    index : numbers of the lanes.
    scene, waiting : `Scene`, and `Waiting`, which is None where all stops are rigid.
    """
    work, step = scene.work, scene.step
    # for a literal number the functions that take it are compiled once more
    first = count = np.int64(0)
    for k in range(index.shape[0]):
        lane = index[k]
        take_lane(lane, scene.ends, work)
        if waiting is None:
            go_on(lane, step, 0, scene)
        else:
            touched, pair, upper = find_contacts(work.gaps, work.contacts, scene.stops, scene.laws)
            if scene.following is not None or touched > 1:
                alone = -1, lane, NO_PAIR, 0, step, touched, scene, waiting.fastest, waiting.memory
                call_apart(waiting.alone, alone)
                continue
            span, touches = step, touched
            if touched == 0:
                pair, upper, span, touches = go_on(lane, step, touched, scene)
            if pair != NO_PAIR:
                count = wait(lane, pair, upper, span, touches, scene, waiting, first, count)
    if waiting is not None:
        press_waiting(count, scene, waiting)
