"""What a competent user would write instead: x'' + .1 x' + x = w, S0 = .2, stops at +-1.

Every function flies `paths` paths over `steps` steps of length h after `burn_in` steps and returns
hits per second of each path, and the CPU seconds it took, compilation apart. All are semi-implicit
Euler with the overshoot at a stop mirrored, which is of second order in h; the libraries step the
velocity with their own Euler solver and their own noise.
"""

import math
import time

import numba
import numpy as np

B, S0 = 0.1, 0.2

USUAL = 0.032
"""Step at which the mirror leaves a bias of 0.1 % in the rate between elastic stops at 1 sigma."""


BOTH = (-1.0, 1.0, 1.0, 0.0)
"""Lower stop, upper stop, restitution, constant load: infinite for no stop."""


def numpy_euler(
    paths: int, burn_in: int, steps: int, h: float, case: tuple = BOTH
) -> tuple[np.ndarray, float]:
    lower, upper, restitution, load = case
    start = time.process_time()
    rng = np.random.default_rng(1)
    x, v, hits = begin(rng, paths, case), rng.standard_normal(paths), np.zeros(paths)
    kick = math.sqrt(S0 * h)
    for step in range(burn_in + steps):
        v += h * (load - B * v - x) + kick * rng.standard_normal(paths)
        x += h * v
        out = (x < lower) | (x > upper)
        stop = np.clip(x[out], lower, upper)
        x[out] = stop - restitution * (x[out] - stop)
        v[out] *= -restitution
        if step >= burn_in:
            hits += out
    return hits / (steps * h), time.process_time() - start


def begin(rng: np.random.Generator, paths: int, case: tuple) -> np.ndarray:
    return np.clip(rng.uniform(-1.0, 1.0, paths), case[0], case[1])


def numba_euler(
    paths: int, burn_in: int, steps: int, h: float, case: tuple = BOTH
) -> tuple[np.ndarray, float]:
    numba_kernel(paths, 1, 1, h, case)
    start = time.process_time()
    return numba_kernel(paths, burn_in, steps, h, case), time.process_time() - start


@numba.njit(parallel=True)
def numba_kernel(paths: int, burn_in: int, steps: int, h: float, case: tuple) -> np.ndarray:
    lower, upper, restitution, load = case
    rates = np.empty(paths)
    kick = math.sqrt(S0 * h)
    for path in numba.prange(paths):
        x = min(max(np.random.uniform(-1.0, 1.0), lower), upper)
        v, hits = np.random.standard_normal(), 0
        for step in range(burn_in + steps):
            v += h * (load - B * v - x) + kick * np.random.standard_normal()
            x += h * v
            if x < lower or x > upper:
                stop = lower if x < lower else upper
                x = stop - restitution * (x - stop)
                v = -restitution * v
                if step >= burn_in:
                    hits += 1
        rates[path] = hits / (steps * h)
    return rates


def scipy_events(paths: int, burn_in: int, steps: int, h: float) -> tuple[np.ndarray, float]:
    """scipy's solve_ivp with events and restarts, on a record of 512 cosines up to omega = 5.

    What many write who think of a shaker's record; `h` only bounds the time it is run for.
    """
    from scipy.integrate import solve_ivp

    rng = np.random.default_rng(1)
    width = 5.0 / 512
    omega = width * (np.arange(512) + 0.5)
    amplitude = math.sqrt(S0 / math.pi * width)
    start, rates = time.process_time(), []
    for _ in range(paths):
        a, b = amplitude * rng.standard_normal((2, 512))

        def motion(t, y, a=a, b=b):
            force = a @ np.cos(omega * t) + b @ np.sin(omega * t)
            return y[1], force - B * y[1] - y[0]

        def above(t, y):
            return y[0] - 1.0

        def below(t, y):
            return y[0] + 1.0

        above.terminal = below.terminal = True
        above.direction, below.direction = 1.0, -1.0
        t, y, hits, end = 0.0, [0.0, 0.0], 0, (burn_in + steps) * h
        while t < end:
            run = solve_ivp(motion, (t, end), y, events=(above, below), rtol=1e-6, atol=1e-8)
            t, y = run.t[-1], [np.clip(run.y[0, -1], -1.0, 1.0), run.y[1, -1]]
            if run.status == 1:
                hits += t > burn_in * h
                y[1] = -y[1]
        rates.append(hits / (steps * h))
    return np.array(rates), time.process_time() - start


def diffrax_euler(paths: int, burn_in: int, steps: int, h: float) -> tuple[np.ndarray, float]:
    """diffrax's Euler step on a Brownian path, in a scan over steps and a vmap over paths."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    solver = diffrax.Euler()
    kick = math.sqrt(S0)

    def one(key):
        noise = diffrax.UnsafeBrownianPath(shape=(), key=key)
        terms = diffrax.MultiTerm(
            diffrax.ODETerm(lambda t, v, x: -B * v - x),
            diffrax.ControlTerm(lambda t, v, x: jnp.asarray(kick), noise),
        )

        def advance(state, step):
            x, v, hits = state
            v = solver.step(terms, step * h, (step + 1) * h, v, x, None, False)[0]
            x = x + h * v
            out = jnp.abs(x) > 1.0
            x = jnp.where(out, 2.0 * jnp.sign(x) - x, x)
            v = jnp.where(out, -v, v)
            return (x, v, hits + (out & (step >= burn_in))), None

        start = (jnp.asarray(0.0), jnp.asarray(0.0), 0)
        (_, _, hits), _ = jax.lax.scan(advance, start, jnp.arange(burn_in + steps))
        return hits / (steps * h)

    keys = jax.random.split(jax.random.PRNGKey(1), paths)
    compiled = jax.jit(jax.vmap(one)).lower(keys).compile()
    start = time.process_time()
    return np.asarray(compiled(keys)), time.process_time() - start


def torchsde_euler(paths: int, burn_in: int, steps: int, h: float) -> tuple[np.ndarray, float]:
    """torchsde over one step at a time, mirrored between steps."""
    import torch
    import torchsde

    class Velocity(torch.nn.Module):
        noise_type, sde_type = "diagonal", "ito"

        def f(self, t, v):
            return -B * v - self.x

        def g(self, t, v):
            return torch.full_like(v, math.sqrt(S0))

    torch.set_default_dtype(torch.float64)
    start = time.process_time()
    sde, span = Velocity(), torch.tensor([0.0, h])
    x, v, hits = torch.zeros(paths, 1), torch.zeros(paths, 1), torch.zeros(paths, 1)
    for step in range(burn_in + steps):
        sde.x = x
        v = torchsde.sdeint(sde, v, span, method="euler", dt=h)[-1]
        x = x + h * v
        out = x.abs() > 1.0
        x = torch.where(out, 2.0 * x.sign() - x, x)
        v = torch.where(out, -v, v)
        if step >= burn_in:
            hits += out
    return (hits / (steps * h)).numpy().ravel(), time.process_time() - start


PEERS = {  # function, steps h, paths, seconds of scene time per path, for a full run
    "NumPy Euler": (numpy_euler, (0.2, 0.1, 0.05, USUAL), 4096, 1200.0),
    "numba prange Euler": (numba_euler, (0.2, 0.1, 0.05, USUAL), 4096, 2400.0),
    "scipy solve_ivp": (scipy_events, (1.0,), 16, 160.0),
}
LIBRARIES = {
    "diffrax Euler": (diffrax_euler, (0.2, 0.1, 0.05), 4096, 600.0),
    "torchsde Euler": (torchsde_euler, (0.2, 0.1, 0.05), 16384, 100.0),
}
