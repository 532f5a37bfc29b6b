"""Slow, plain twins of the engine, written another way, and integrators that are known to fail."""

import math

import numpy as np

from stochvi.motion.kernels.random_numbers import normal_rows, seed_streams

MASK = 2**64 - 1


def rotate_left(word: int, bits: int) -> int:
    return ((word << bits) | (word >> (64 - bits))) & MASK


def split_mix(z: int) -> int:
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def stream_words(seed: int, path: int, count: int) -> list[int]:
    """xoroshiro128++ on Python integers, seeded like the kernel's streams."""
    golden = 0x9E3779B97F4A7C15
    z = split_mix((split_mix((seed + golden) & MASK) + path * golden) & MASK)
    s0 = split_mix((z + golden) & MASK)
    s1 = split_mix((z + 2 * golden) & MASK)
    words = []
    for _ in range(count):
        words.append((rotate_left((s0 + s1) & MASK, 17) + s0) & MASK)
        s1 ^= s0
        s0 = rotate_left(s0, 49) ^ s1 ^ ((s1 << 21) & MASK)
        s1 = rotate_left(s1, 28)
    return words


def words_of_pairs(seed: int, path: int, count: int) -> list[int]:
    """The first word of the state of a stream after each of its first `count` pairs of normals."""
    golden = 0x9E3779B97F4A7C15
    z = split_mix((split_mix((seed + golden) & MASK) + path * golden) & MASK)
    s0, s1 = split_mix((z + golden) & MASK), split_mix((z + 2 * golden) & MASK)
    words = []
    for _ in range(count):
        for _ in range(2):
            s1 ^= s0
            s0 = rotate_left(s0, 49) ^ s1 ^ ((s1 << 21) & MASK)
            s1 = rotate_left(s1, 28)
        words.append(s0)
    return words


def uniform(word: int, number: int) -> float:
    """The uniform number of an event that belongs to a word."""
    golden = 0x9E3779B97F4A7C15
    return ((split_mix((split_mix(word) + number * golden) & MASK) >> 12) + 0.5) / 2.0**52


def normals(seed: int, path: int, count: int) -> np.ndarray:
    """The first `count` normals of a path, as the kernel draws them."""
    rows = -(-count // 2)
    streams = np.empty((2, 1), np.uint64)
    seed_streams(np.uint64(seed), path, streams)
    first, second = np.empty((2, rows, 1))
    normal_rows(streams[0], streams[1], first, second)
    return np.stack([first[:, 0], second[:, 0]], axis=1).ravel()[:count]


def flow(x, v, h, omega, stops, hits):
    """Undamped motion over h with impacts, each found from the phase of the orbit.

    `stops` holds (position, restitution, side) from the rest position. A restitution may be a
    function that draws one for the impact. Stops pressing with less than one part in 10^8 of a
    bounce hold the mass. `hits` gets (side, speed, time) of each impact.
    """
    left = h
    for _ in range(10_000):
        events = [
            (when, position, restitution, side)
            for position, restitution, side in stops
            if (when := time_to(side * position, side * x, side * v, omega)) <= left
        ]
        if not events:
            break
        when, position, restitution, side = min(events, key=lambda event: event[:2])
        if callable(restitution):
            restitution = restitution()
        w = math.sqrt(max(v * v + omega**2 * (x - position) * (x + position), 0.0))
        x, v, left = position, -side * restitution * w, left - when
        hits.append((side, w, h - left))
        pressed = omega**2 * -side * position
        if pressed > 0.0 and restitution * w <= 1e-8 * pressed * h:
            # the pressing force of the rest of the step, as the speed of one more impact at no time
            hits.append((side, pressed * left / (1.0 + restitution), math.nan))
            return position, 0.0
    if omega == 0.0:
        x += v * left
    else:
        c, s = math.cos(omega * left), math.sin(omega * left)
        x, v = x * c + v / omega * s, v * c - omega * x * s
    for position, _, side in stops:  # a bounce lost in rounding leaves the mass on the stop
        x = side * min(side * x, side * position)
    return x, v


def time_to(stop, x, v, omega):
    """Time until an undamped orbit passes `stop` upwards, infinite if it never does."""
    if x >= stop and v > 0.0:
        return 0.0
    if omega == 0.0:
        return (stop - x) / v if v > 0.0 else math.inf
    square = v * v + omega**2 * (x - stop) * (x + stop)
    if square <= 0.0:
        return math.inf
    # x = A sin(phase), v = A omega cos(phase); at the passage x = stop and v = sqrt(square)
    turn = math.atan2(omega * stop, math.sqrt(square)) - math.atan2(omega * x, v)
    return (turn % (2.0 * math.pi)) / omega


def kick_flow_kick(x, v, z, h, omega, damping_rate, intensity, stops):
    """The engine's scheme, one path, one step at a time: (samples of x, of v, list of hits)."""
    decay = math.exp(-damping_rate * h)
    spread = intensity * h
    if damping_rate:
        spread = intensity * -math.expm1(-2.0 * damping_rate * h) / (2.0 * damping_rate)
    xs, vs, hits = [], [], []
    for number, normal in enumerate(z):
        v = decay * v + math.sqrt(spread) * normal
        found = []
        x, v = flow(x, v, h, omega, stops, found)
        hits += [(side, w, number * h + when) for side, w, when in found]
        xs.append(x)
        vs.append(v)
    return np.array(xs), np.array(vs), hits


def response_domain(free, h, omega, damping_rate, stops):
    """Stops under a given free response: x - y = e decays, hits are roots of a cubic (np.roots).

    `free` holds (y, y') of each sample, `stops` (position, restitution, side). Returns x, v and
    (sample, side, speed, time) of each hit.
    """
    from scipy.linalg import expm

    motion = np.array([[0.0, 1.0], [-(omega**2), -damping_rate]])
    over_a_step = expm(motion * h)
    e = np.zeros(2)
    xs, vs, hits = [], [], []
    for k in range(1, len(free)):
        begin = e + free[k - 1]
        end = over_a_step @ e + free[k]
        left = h
        while True:
            events = [
                (when, position, restitution, side)
                for position, restitution, side in stops
                if (when := crossing(begin, end, left, position, side)) is not None
            ]
            if not events:
                break
            when, position, restitution, side = min(events)
            slope = (1.0 - when) * (1.0 - 3.0 * when) * begin[1]
            slope += when * (3.0 * when - 2.0) * end[1]
            slope += 6.0 * when * (1.0 - when) * (end[0] - begin[0]) / left
            left *= 1.0 - when
            hits.append((k - 1, side, side * slope, k * h - left))
            begin = np.array([position, -restitution * slope])
            end = end + expm(motion * left) @ [0.0, -(1.0 + restitution) * slope]
        e = end - free[k]
        xs.append(end[0])
        vs.append(end[1])
    return np.array(xs), np.array(vs), hits


def crossing(begin, end, h, position, side):
    """First place in (0, 1] where the cubic through both ends passes `position` outwards."""
    (x0, v0), (x1, v1) = begin, end
    cubic = [(v0 + v1) * h - 2.0 * (x1 - x0), 3.0 * (x1 - x0) - (2.0 * v0 + v1) * h, v0 * h]
    roots = np.roots([*cubic, x0 - position])
    real = np.sort(roots.real[np.abs(roots.imag) < 1e-9])
    slope = np.polyder([*cubic, 0.0])
    inside = [s for s in real if 1e-7 < s <= 1.0 and side * np.polyval(slope, s) > 0.0]
    return inside[0] if inside else None


def mirrored_euler(rng, paths, steps, h, *, overshoot, restitution=1.0):
    """Semi-implicit Euler for W = 1, b = .1, S0 = .2, stops at +-1: (x^2, v^2, hits) per path.

    With `overshoot` a position beyond a stop is mirrored there, and the scheme is of second
    order; without it the mass is put on the stop, what people write first.
    """
    x = rng.uniform(-1.0, 1.0, paths)
    v = rng.standard_normal(paths)
    sums = np.zeros((3, paths))
    burn_in = int(60.0 / h)
    for step in range(burn_in + steps):
        v = v + h * (-0.1 * v - x) + math.sqrt(0.2 * h) * rng.standard_normal(paths)
        x = x + h * v
        out = np.abs(x) > 1.0
        stop = np.sign(x)
        x = np.where(out, stop - restitution * (x - stop) if overshoot else stop, x)
        v = np.where(out, -restitution * v, v)
        if step >= burn_in:
            sums += [x * x, v * v, out]
    return sums[0] / steps, sums[1] / steps, sums[2] / (steps * h)


def full_band_isolator(rng, table, omega, damping_rate, gap, restitution, paths, rate, length):
    """An isolator under a table in the time domain: (x^2, v^2, hits per second) of each path.

    The base acceleration is synthesised in full, held linearly between samples at `rate`, and
    the oscillator is stepped exactly; what goes beyond a stop is taken back and thrown off it.
    """
    samples = int(rate * length)
    f = np.arange(1, samples // 2) / length
    amplitude = np.sqrt(table(f) / length)
    shape = (paths, len(f))
    spectrum = np.zeros((paths, samples // 2 + 1), complex)
    spectrum[:, 1:-1] = amplitude * (rng.standard_normal(shape) - 1j * rng.standard_normal(shape))
    force = np.fft.irfft(spectrum * samples / 2.0, axis=1)
    xx, vv, speeds = held_force(force, rate, omega, damping_rate, gap, restitution)
    return xx, vv, speeds[0]


def held_force(force, rate, omega, damping_rate, gap, restitution, threshold=0.0, upper_only=False):
    """One period of a periodic force, linear between samples, after a quarter of a period.
    The stops are at -gap and gap, or at gap alone.

    A mass found beyond a stop is taken back to it, and forth again from there with its new
    velocity, both at constant acceleration: of second order, as is what grazes unseen. Returns
    x^2 and v^2 of each path and, per second, its hits from `threshold` on, the speeds of all, and
    the squares of those.
    """
    paths, samples = force.shape
    step = hold_matrices(omega, damping_rate, 1.0 / rate)
    x, v = np.zeros((2, paths))
    moments, speeds = np.zeros((2, paths)), np.zeros((3, paths))
    for k in range(-(samples // 4), samples):
        now, following = force[:, k], force[:, (k + 1) % samples]
        x, v = step @ np.stack([x, v, now, following])
        out = x > gap if upper_only else np.abs(x) > gap
        if out.any():
            side = 1.0 if upper_only else np.sign(x[out])
            f = following[out]
            over, speed = side * x[out] - gap, side * v[out]
            # backwards by t: over - speed t + push t^2 / 2 = 0
            push = side * f - damping_rate * speed - omega**2 * gap
            w = np.sqrt(np.maximum(speed**2 - 2.0 * push * over, 0.0))
            t = 2.0 * over / (speed + w)
            back = -restitution * w
            push = side * f - damping_rate * back - omega**2 * gap
            x[out] = side * np.minimum(gap + back * t + push * t**2 / 2.0, gap)
            v[out] = side * (back + push * t)
            if k >= 0:
                speeds[:, out] += [w >= threshold, w, w**2]
        if k >= 0:
            moments += [x * x, v * v]
    return moments[0] / samples, moments[1] / samples, speeds * (rate / samples)


def hold_matrices(omega, damping_rate, h):
    """(x, v) after h from (x, v, f now, f then), f linear in between."""
    from scipy.linalg import expm

    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0
    matrix[1] = [-(omega**2), -damping_rate, 1.0, 0.0]
    matrix[2, 3] = 1.0
    grown = expm(matrix * h)[:2]
    grown[:, 3] /= h
    grown[:, 2] -= grown[:, 3]
    return grown


# ---- stops that give way -----------------------------------------------------------------------


OFF = -1
"""Mode of a stop that is not touched; else the piece of its force, or of a viscoelastic stop 0
where it pushes and 1 where it withdraws."""


def stop_force(law, mode, y, v):
    """Force per unit mass in one mode, smooth, also beyond where the mode ends."""
    if mode == OFF or (law.kind == "viscoelastic" and mode == 1):
        return 0.0
    if law.kind == "viscoelastic":
        return law.stiffness * y + law.damping(1.0) * v
    if law.kind == "table":
        start, force, slope = law.pieces[:, mode]
        return force + slope * (y - start)
    if law.kind == "hertz":
        return math.copysign(law.coefficient * abs(y) ** 1.5, y)
    return law.stiffness * y


def stop_ends(law, mode):
    """Where a mode ends: (function of y and v, direction of its zero, next mode)."""
    if mode == OFF:
        return [(lambda y, v: y, 1.0, 0)]
    if law.kind == "viscoelastic":
        push = lambda y, v: law.stiffness * y + law.damping(1.0) * v  # noqa: E731
        if mode == 0:
            return [(push, -1.0, 1)]
        return [(lambda y, v: y, -1.0, OFF), (push, 1.0, 0)]
    starts = law.pieces[0] if law.kind == "table" else [0.0]
    ends = [(lambda y, v: y - starts[mode], -1.0, mode - 1)]
    if mode + 1 < len(starts):
        ends.append((lambda y, v: y - starts[mode + 1], 1.0, mode + 1))
    return ends


def flow_with_forces(x, v, h, omega, stops, sums, touches):
    """Undamped motion over h with the forces of the stops, by a Runge-Kutta method of order 8.

    `stops` holds (position, side, law); `sums` (one row a stop) gets impulse, energy taken and
    time in contact; `touches` gets (side, speed).
    """
    from scipy.integrate import solve_ivp

    def inner(state, position, side):
        return side * (state[0] - position), side * state[1]

    def mode_at(position, side, law):
        y, rate = inner((x, v), position, side)
        if y <= 0.0:
            return OFF
        if law.kind == "viscoelastic":
            return 0 if law.force_at(y, rate) > 0.0 else 1
        return int(np.searchsorted(law.pieces[0], y)) - 1 if law.kind == "table" else 0

    modes = [mode_at(*stop) for stop in stops]
    time, state = 0.0, np.concatenate([[x, v], np.zeros(3 * len(stops))])
    while time < h:

        def derivative(t, state, modes=tuple(modes)):
            acceleration, rates = -(omega**2) * state[0], []
            for (position, side, law), mode in zip(stops, modes, strict=True):
                y, rate = inner(state, position, side)
                force = stop_force(law, mode, y, rate)
                acceleration -= side * force
                pushes = mode != OFF and not (law.kind == "viscoelastic" and mode == 1)
                rates += [force, force * rate, float(pushes)]
            return [state[1], acceleration, *rates]

        events, changes = [], []
        for number, (position, side, law) in enumerate(stops):
            for function, direction, following in stop_ends(law, modes[number]):

                def event(t, state, function=function, position=position, side=side):
                    return function(*inner(state, position, side))

                event.terminal, event.direction = True, direction
                events.append(event)
                changes.append((number, following))
        touched = [law for (_, _, law), mode in zip(stops, modes, strict=True) if mode != OFF]
        longest = min([h, *(law.impact(1.0, 1.0).contact_time for law in touched)]) / 8.0
        solution = solve_ivp(
            derivative, (time, h), state, method="DOP853", events=events,
            rtol=1e-11, atol=1e-13, max_step=longest,
        )  # fmt: skip
        time, state = solution.t[-1], solution.y[:, -1]
        for found, (number, following) in zip(solution.t_events, changes, strict=True):
            if len(found) and found[-1] == time:
                position, side, _ = stops[number]
                if modes[number] == OFF:
                    touches.append((side, side * state[1]))
                if following == OFF or modes[number] == OFF:
                    state[0] = position
                modes[number] = following
    sums += state[2:].reshape(len(stops), 3)
    return state[0], state[1]


def kick_flow_kick_with_forces(x, v, z, h, omega, damping_rate, intensity, stops):
    """The scheme with stops that give way: samples of x and v, sums of the stops, touches."""
    decay = math.exp(-damping_rate * h)
    spread = intensity * -math.expm1(-2.0 * damping_rate * h) / (2.0 * damping_rate)
    xs, vs, touches, sums = [], [], [], np.zeros((len(stops), 3))
    for normal in z:
        v = decay * v + math.sqrt(spread) * normal
        x, v = flow_with_forces(x, v, h, omega, stops, sums, touches)
        xs.append(x)
        vs.append(v)
    return np.array(xs), np.array(vs), sums, touches


def penalty_euler(rng, paths, steps, h, stiffness):
    """Semi-implicit Euler, W = 1, b = .1, S0 = .2, linear stops at +-1: onsets per second."""
    x = rng.uniform(-1.0, 1.0, paths)
    v = rng.standard_normal(paths)
    onsets = np.zeros(paths)
    burn_in = int(60.0 / h)
    for step in range(burn_in + steps):
        force = -x - stiffness * np.sign(x) * np.maximum(np.abs(x) - 1.0, 0.0)
        v = v + h * (force - 0.1 * v) + math.sqrt(0.2 * h) * rng.standard_normal(paths)
        outside = np.abs(x) > 1.0
        x = x + h * v
        if step >= burn_in:
            onsets += (np.abs(x) > 1.0) & ~outside
    return onsets / (steps * h)


def held_force_with_contacts(force, rate, omega, damping_rate, gap, law, parts=1):
    """`held_force` between stops at +-gap that give way by a law with a potential.

    The force of the stops acts in half kicks before and after each exact flight over 1 / (rate
    parts). Returns, of each path, x^2, v^2, first touches per second, largest forces of contacts
    that ended and those contacts per second, and the mean force on both stops.
    """
    paths, samples = force.shape
    h = 1.0 / (rate * parts)
    step = hold_matrices(omega, damping_rate, h)
    x, v, push = np.zeros((3, paths))
    deepest = np.zeros(paths)
    moments, sums = np.zeros((2, paths)), np.zeros((4, paths))
    for k in range(-(samples // 4), samples):
        here, following = force[:, k], force[:, (k + 1) % samples]
        counted = float(k >= 0)
        for part in range(parts):
            now = here + part / parts * (following - here)
            then = here + (part + 1) / parts * (following - here)
            outside, before, speed = push != 0.0, np.abs(x) - gap, np.sign(x) * v
            x, v = step @ np.stack([x, v - 0.5 * h * push, now, then])
            y, side = np.abs(x) - gap, np.sign(x)
            inside = y > 0.0
            push = side * law.force_at(y) if inside.any() else np.zeros(paths)
            v = v - 0.5 * h * push
            if inside.any() or outside.any():
                turned = inside & outside & (speed > 0.0) & (side * v <= 0.0)
                top = np.where(turned, before + 0.5 * h * speed**2 / (speed - side * v + 1e-300), y)
                deepest = np.maximum(deepest, np.where(inside, top, 0.0))
                ended = outside & ~inside
                sums += counted * np.stack(
                    [inside & ~outside, law.force_at(deepest) * ended, ended, h * np.abs(push)]
                )
                deepest[~inside] = 0.0
        moments += counted * np.stack([x * x, v * v])
    return moments[0] / samples, moments[1] / samples, *(sums * (rate / samples))
