"""What a competent user would write instead, for structures whose damping leaves the modes apart.

Every function simulates `paths` paths over `steps` steps of length h after `burn_in` steps, and
returns the averages of each path, the rows `ROWS` of `systems`, and the CPU seconds that it took,
compilation apart. All are semi-implicit Euler with the overshoot at a stop mirrored, which is of
second order in h between elastic stops; the libraries step the velocities with their own Euler
solver and, under white noise, their own noise. A table is a Gaussian record of each path, made by
FFT and sampled at the step.
"""

from __future__ import annotations

import math
import os
import time
from functools import cache

import numba
import numpy as np
from systems import ROWS, System

USUAL = 0.032
"""Step at which the mirror leaves a bias of 0.1 % in the rate between elastic stops at 1 sigma."""

STRIDE = 4
"""Number of steps from one sample of the moments to the next: closer ones say no more."""

Averages = tuple[np.ndarray, float]


def numpy_euler(system: System, paths: int, burn_in: int, steps: int, h: float) -> Averages:
    """Vectorised over paths."""
    began = time.process_time()
    rng = np.random.default_rng(1)
    count, batch = system.batches(paths, burn_in + steps)
    found = [numpy_batch(system, rng, batch, burn_in, steps, h) for _ in range(count)]
    return np.concatenate(found, axis=1), time.process_time() - began


def numpy_batch(
    system: System, rng: np.random.Generator, paths: int, burn_in: int, steps: int, h: float
) -> np.ndarray:
    keep = 1.0 - h * system.damping[:, None]
    spring, load = (h * a[:, None] for a in (system.squares, system.squares * system.rest))
    kicks, columns = math.sqrt(h) * system.kicks, h * system.columns
    gaps, pushes, watched = system.gaps, system.pushes[:, :, None], system.watched
    q, v = np.tile(system.rest[:, None], paths), np.zeros((len(system.rest), paths))
    sums = np.zeros((len(ROWS), paths))
    records = np.ascontiguousarray(system.records(rng, paths, burn_in + steps, h).T)
    for step in range(burn_in + steps):
        v *= keep
        v -= spring * q
        if load.any():
            v += load
        if system.tables:
            v += along(columns, records[step])
        if kicks.size:
            v += along(kicks, rng.standard_normal((kicks.shape[1], paths)))
        q += h * v
        counted = step >= burn_in
        for pair, (lower, upper, restitution, threshold) in enumerate(system.stops):
            y = along(gaps[pair], q)
            out = np.flatnonzero((y < lower) | (y > upper))
            over = y[out] - np.clip(y[out], lower, upper)
            w = along(gaps[pair], v[:, out])
            w[w * over < 0.0] = 0.0  # turned back already, by the stop of another pair
            q[:, out] -= pushes[pair] * ((1.0 + restitution) * over)
            v[:, out] -= pushes[pair] * ((1.0 + restitution) * w)
            if pair == watched and counted:
                speed = np.abs(w)
                sums[3:, out] += [(speed >= threshold) & (speed > 0.0), speed, speed * speed]
        if counted and step % STRIDE == 0:
            y, w = along(gaps[watched], q), along(gaps[watched], v)
            sums[:3] += [y, y * y, w * w]
    return averaged(sums, burn_in, steps, h)


def along(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A matrix product, which NumPy does faster as a product where there is nothing to add."""
    return rows @ values if len(values) > 1 else rows * values[0]


def averaged(sums: np.ndarray, burn_in: int, steps: int, h: float) -> np.ndarray:
    """Averages in time from sums over the steps, over every fourth one of the moments."""
    samples = len(range(-(-burn_in // STRIDE) * STRIDE, burn_in + steps, STRIDE))
    return np.vstack([sums[:3] / samples, sums[3:] / (steps * h)])


def numba_euler(system: System, paths: int, burn_in: int, steps: int, h: float) -> Averages:
    """A loop over the steps of each path in parallel."""
    rng, kernel = np.random.default_rng(2), numba_kernel(*system.sizes)
    kicks = math.sqrt(h) * system.kicks

    def simulate(paths: int, burn_in: int, steps: int) -> np.ndarray:
        records = np.ascontiguousarray(system.records(rng, paths, burn_in + steps, h))
        sums = kernel(
            records, paths, burn_in, steps, h, system.squares, system.damping, system.rest, kicks,
            system.columns, system.gaps, system.pushes, system.stops, system.watched,
        )  # fmt: skip
        return averaged(sums, burn_in, steps, h)

    simulate(1, 1, STRIDE)
    began = time.process_time()
    count, batch = system.batches(paths, burn_in + steps)
    found = [simulate(batch, burn_in, steps) for _ in range(count)]
    return np.concatenate(found, axis=1), time.process_time() - began


@cache
def numba_kernel(modes: int, noises: int, tables: int, pairs: int):
    """The loop for systems of one size, which is a constant of the program."""

    @numba.njit(parallel=True)
    def kernel(
        records, paths, burn_in, steps, h, squares, damping, rest, kicks, columns, gaps, pushes,
        stops, watched,
    ):  # fmt: skip
        sums = np.zeros((6, paths))
        for path in numba.prange(paths):
            q, v = rest.copy(), np.zeros(modes)
            y_sum = yy_sum = ww_sum = count = f1 = f2 = 0.0
            for step in range(burn_in + steps):
                for i in range(modes):
                    pull = squares[i] * (rest[i] - q[i]) - damping[i] * v[i]
                    for k in range(tables):
                        pull += columns[i, k] * records[path, k, step]
                    v[i] += h * pull
                for k in range(noises):
                    normal = np.random.standard_normal()
                    for i in range(modes):
                        v[i] += kicks[i, k] * normal
                for i in range(modes):
                    q[i] += h * v[i]
                for pair in range(pairs):
                    y = 0.0
                    for i in range(modes):
                        y += gaps[pair, i] * q[i]
                    lower, upper, restitution = stops[pair, 0], stops[pair, 1], stops[pair, 2]
                    if lower <= y <= upper:
                        continue
                    over, w = y - (lower if y < lower else upper), 0.0
                    for i in range(modes):
                        w += gaps[pair, i] * v[i]
                    if w * over < 0.0:  # turned back already, by the stop of another pair
                        w = 0.0
                    for i in range(modes):
                        q[i] -= pushes[pair, i] * (1.0 + restitution) * over
                        v[i] -= pushes[pair, i] * (1.0 + restitution) * w
                    if pair == watched and step >= burn_in and w != 0.0:
                        count += abs(w) >= stops[pair, 3]
                        f1 += abs(w)
                        f2 += w * w
                if step >= burn_in and step % STRIDE == 0:
                    y = w = 0.0
                    for i in range(modes):
                        y += gaps[watched, i] * q[i]
                        w += gaps[watched, i] * v[i]
                    y_sum += y
                    yy_sum += y * y
                    ww_sum += w * w
            for row, total in enumerate((y_sum, yy_sum, ww_sum, count, f1, f2)):
                sums[row, path] = total
        return sums

    return kernel


def scipy_events(system: System, paths: int, burn_in: int, steps: int, h: float) -> Averages:
    """scipy's solve_ivp with events and restarts, for one oscillator under white noise.

    What many write who think of a shaker's record: 512 cosines up to five natural frequencies. `h`
    only bounds the time that is simulated.
    """
    from scipy.integrate import solve_ivp

    (square,), (damping,), ((kick,),) = system.squares, system.damping, system.kicks
    ((lower, upper, restitution, threshold),) = system.stops
    rng = np.random.default_rng(1)
    width = 5.0 * math.sqrt(square) / 512
    omega = width * (np.arange(512) + 0.5)
    amplitude = abs(kick) * math.sqrt(width / math.pi)
    began, sums, start, end = time.process_time(), [], burn_in * h, (burn_in + steps) * h
    for _ in range(paths):
        a, b = amplitude * rng.standard_normal((2, 512))

        def motion(t, y, a=a, b=b):
            force = a @ np.cos(omega * t) + b @ np.sin(omega * t)
            return y[1], force - damping * y[1] - square * y[0]

        def above(t, y):
            return y[0] - upper

        def below(t, y):
            return y[0] - lower

        above.terminal = below.terminal = True
        above.direction, below.direction = 1.0, -1.0
        t, state, total = 0.0, [0.0, 0.0], np.zeros(len(ROWS))
        while t < end:
            until = start if t < start else end
            run = solve_ivp(motion, (t, until), state, events=(above, below), rtol=1e-6, atol=1e-8)
            t, state = run.t[-1], [np.clip(run.y[0, -1], lower, upper), run.y[1, -1]]
            if t > start:
                x, v = run.y
                total[:3] += np.trapezoid([x, x * x, v * v], run.t)
            if run.status == 1:
                w = abs(state[1])
                total[3:] += np.array([w >= threshold, w, w * w]) * (t > start)
                state[1] *= -restitution
        sums.append(total / (steps * h))
    return np.transpose(sums), time.process_time() - began


def diffrax_euler(system: System, paths: int, burn_in: int, steps: int, h: float) -> Averages:
    """diffrax's Euler step, on a Brownian path under white noise, in a scan over steps and a vmap
    over paths."""
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    solver = diffrax.Euler()
    gaps, pushes, watched = system.gaps, system.pushes, system.watched

    def pull(t, v, forced):
        q, force = forced
        found = system.squares * (system.rest - q) - system.damping * v
        return found + jnp.sum(system.columns * force, axis=1)

    def one(key, records):
        terms = diffrax.ODETerm(pull)
        if system.kicks.size:
            noise = diffrax.UnsafeBrownianPath(shape=system.kicks.shape[1:], key=key)
            kicks = jnp.asarray(system.kicks)
            terms = diffrax.MultiTerm(terms, diffrax.ControlTerm(lambda t, v, forced: kicks, noise))

        def advance(state, now):
            (q, v, sums), (step, force) = state, now
            v = solver.step(terms, step * h, (step + 1) * h, v, (q, force), None, False)[0]
            q = q + h * v
            for pair, (lower, upper, restitution, threshold) in enumerate(system.stops):
                y, w = jnp.sum(gaps[pair] * q), jnp.sum(gaps[pair] * v)
                over = y - jnp.clip(y, lower, upper)
                w = jnp.where(w * over > 0.0, w, 0.0)
                q = q - pushes[pair] * (1.0 + restitution) * over
                v = v - pushes[pair] * (1.0 + restitution) * w
                if pair == watched:
                    speed = jnp.abs(w)
                    hit = [(speed >= threshold) & (speed > 0.0), speed, speed * speed]
            y, w = jnp.sum(gaps[watched] * q), jnp.sum(gaps[watched] * v)
            sampled, counted = step % STRIDE == 0, step >= burn_in
            rows = y * sampled, y * y * sampled, w * w * sampled, *hit
            sums = tuple(total + row * counted for total, row in zip(sums, rows, strict=True))
            return (q, v, sums), None

        none = tuple(jnp.asarray(0.0) for _ in ROWS)
        start = (jnp.asarray(system.rest), jnp.zeros(len(system.rest)), none)
        (_, _, sums), _ = jax.lax.scan(advance, start, (jnp.arange(burn_in + steps), records))
        return jnp.stack(sums)

    count, batch = system.batches(paths, burn_in + steps)
    samples = jax.ShapeDtypeStruct((burn_in + steps, len(system.tables), batch), np.float64)
    keys = jax.random.split(jax.random.PRNGKey(3), (count, batch))
    compiled = jax.jit(jax.vmap(one, in_axes=(0, 2))).lower(keys[0], samples).compile()
    began, rng = time.process_time(), np.random.default_rng(3)
    found = []
    for each in keys:
        records = system.records(rng, batch, burn_in + steps, h).T
        found.append(averaged(np.asarray(compiled(each, records)).T, burn_in, steps, h))
    return np.concatenate(found, axis=1), time.process_time() - began


def torchsde_euler(system: System, paths: int, burn_in: int, steps: int, h: float) -> Averages:
    """torchsde over one step at a time, mirrored between steps; its noise is zero under a table."""
    import torch
    import torchsde

    class Velocity(torch.nn.Module):
        noise_type = "general" if system.kicks.shape != (1, 1) else "diagonal"
        sde_type = "ito"

        def f(self, t, v):
            return squares * (rest - self.q) - damping * v + self.force

        def g(self, t, v):
            return kicks.expand(len(v), *kicks.shape)

    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)
    torch.manual_seed(4)
    began = time.process_time()
    squares, damping, rest = map(torch.tensor, (system.squares, system.damping, system.rest))
    gaps, pushes, columns = map(torch.tensor, (system.gaps, system.pushes, system.columns.T))
    kicks = torch.tensor(system.kicks if system.kicks.size else 0.0 * system.gaps[:1].T)
    if Velocity.noise_type == "diagonal":
        kicks = kicks[0]
    count, batch = system.batches(paths, burn_in + steps)
    sde, span, rng = Velocity(), torch.tensor([0.0, h]), np.random.default_rng(4)
    found = []
    for _ in range(count):
        records = torch.tensor(
            np.ascontiguousarray(system.records(rng, batch, burn_in + steps, h).transpose(2, 0, 1))
        )
        q, v = rest.repeat(batch, 1), torch.zeros(batch, len(rest))
        sums = torch.zeros(len(ROWS), batch)
        for step in range(burn_in + steps):
            sde.q, sde.force = q, records[step] @ columns
            v = torchsde.sdeint(sde, v, span, method="euler", dt=h)[-1]
            q = q + h * v
            for pair, (lower, upper, restitution, threshold) in enumerate(system.stops):
                y, w = q @ gaps[pair], v @ gaps[pair]
                over = y - y.clamp(lower, upper)
                w = torch.where(w * over > 0.0, w, 0.0)
                q = q - torch.outer((1.0 + restitution) * over, pushes[pair])
                v = v - torch.outer((1.0 + restitution) * w, pushes[pair])
                if pair == system.watched and step >= burn_in:
                    speed = w.abs()
                    sums[3] += (speed >= threshold) & (speed > 0.0)
                    sums[4] += speed
                    sums[5] += speed * speed
            if step >= burn_in and step % STRIDE == 0:
                y, w = q @ gaps[system.watched], v @ gaps[system.watched]
                sums[0] += y
                sums[1] += y * y
                sums[2] += w * w
        found.append(averaged(sums.numpy(), burn_in, steps, h))
    return np.concatenate(found, axis=1), time.process_time() - began


PEERS = {"NumPy Euler": numpy_euler, "numba prange Euler": numba_euler}
LIBRARIES = {"diffrax Euler": diffrax_euler, "torchsde Euler": torchsde_euler}
