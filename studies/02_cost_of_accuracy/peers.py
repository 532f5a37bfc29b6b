"""What a competent user would write instead: x'' + .1 x' + x = w, S0 = .2, elastic stops at +-1.

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


def numpy_euler(paths: int, burn_in: int, steps: int, h: float) -> tuple[np.ndarray, float]:
    start = time.process_time()
    rng = np.random.default_rng(1)
    x, v, hits = rng.uniform(-1.0, 1.0, paths), rng.standard_normal(paths), np.zeros(paths)
    kick = math.sqrt(S0 * h)
    for step in range(burn_in + steps):
        v += -h * (B * v + x) + kick * rng.standard_normal(paths)
        x += h * v
        out = np.abs(x) > 1.0
        x[out] = 2.0 * np.sign(x[out]) - x[out]
        v[out] = -v[out]
        if step >= burn_in:
            hits += out
    return hits / (steps * h), time.process_time() - start


def numba_euler(paths: int, burn_in: int, steps: int, h: float) -> tuple[np.ndarray, float]:
    numba_kernel(paths, 1, 1, h)
    start = time.process_time()
    return numba_kernel(paths, burn_in, steps, h), time.process_time() - start


@numba.njit(parallel=True)
def numba_kernel(paths: int, burn_in: int, steps: int, h: float) -> np.ndarray:
    rates = np.empty(paths)
    kick = math.sqrt(S0 * h)
    for path in numba.prange(paths):
        x, v, hits = np.random.uniform(-1.0, 1.0), np.random.standard_normal(), 0
        for step in range(burn_in + steps):
            v += -h * (B * v + x) + kick * np.random.standard_normal()
            x += h * v
            if abs(x) > 1.0:
                x = 2.0 * math.copysign(1.0, x) - x
                v = -v
                if step >= burn_in:
                    hits += 1
        rates[path] = hits / (steps * h)
    return rates


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
