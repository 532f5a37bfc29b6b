"""What people write first for x'' + b x' + omega^2 x = load + w(t) between stops.

Each takes a problem (numbers of one scene, see `stochvi.testing.Problem`) and a seed, and returns
averages of each path; `STEP` is the time step, in units of 1 / omega.
"""

import math

import numpy as np

STEP = 0.05
"""Some 125 steps in a period, which many would call fine."""


class Totals:
    """Sums over the counted part of each path."""

    def __init__(self, problem, h: float) -> None:
        self.problem, self.first = problem, math.ceil(problem.burn_in / h)
        self.steps = math.ceil(problem.duration / h)
        self.seconds = self.steps * h
        self.moments, self.impacts = np.zeros((2, 3, problem.paths))

    def add(self, step: int, x, v, speed) -> None:
        """Positions and velocities after a step, and impact speeds in it, 0 for none."""
        if step >= self.first:
            self.moments += x, x**2, v**2
            self.impacts += speed > self.problem.speed_threshold, speed, speed**2

    def averages(self) -> dict[str, np.ndarray]:
        names = ("displacement_mean", "displacement_mean_square", "velocity_mean_square")
        rates = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")
        return dict(zip(names, self.moments / self.steps, strict=True)) | dict(
            zip(rates, self.impacts / self.seconds, strict=True)
        )


def fly(problem, seed: int, semi_implicit: bool, mirrored: bool) -> dict[str, np.ndarray]:
    """Euler steps; at the end of one, what is beyond a stop is put back and reversed.

    Back onto the stop, or mirrored: x = stop - R (x - stop).
    """
    rng, h = np.random.default_rng(seed), STEP / problem.omega
    totals = Totals(problem, h)
    kick = math.sqrt(problem.intensity * h)
    x, v = np.zeros((2, problem.paths))
    x = np.clip(x, problem.lower, problem.upper)
    for step in range(totals.first + totals.steps):
        force = problem.load - problem.damping_rate * v - problem.omega**2 * x
        before = v
        v = v + h * force + kick * rng.standard_normal(problem.paths)
        x = x + h * (v if semi_implicit else before)
        low, high = x < problem.lower, x > problem.upper
        stop = np.clip(x, problem.lower, problem.upper)
        speed = np.where(low | high, np.abs(v), 0.0)
        r = np.where(low, problem.restitution_lower, problem.restitution_upper)
        x = np.where(low | high, stop - r * (x - stop) if mirrored else stop, x)
        v = np.where(low | high, -r * v, v)
        totals.add(step, x, v, speed)
    return totals.averages()


def explicit_euler(problem, seed: int) -> dict[str, np.ndarray]:
    return fly(problem, seed, semi_implicit=False, mirrored=False)


def end_of_step_mirror(problem, seed: int) -> dict[str, np.ndarray]:
    return fly(problem, seed, semi_implicit=True, mirrored=False)


def mirrored_overshoot(problem, seed: int) -> dict[str, np.ndarray]:
    return fly(problem, seed, semi_implicit=True, mirrored=True)


HARMONICS, BAND = 256, 5.0
"""Cosines that stand for the noise, and up to which multiple of omega."""


def solve_ivp_events(problem, seed: int) -> dict[str, object]:
    """scipy's solve_ivp with terminal events and restarts, on a record of cosines; one long
    path, sampled ten times in 1 / omega."""
    from scipy.integrate import solve_ivp

    rng = np.random.default_rng(seed)
    width = BAND * problem.omega / HARMONICS
    omega = width * (np.arange(HARMONICS) + rng.uniform(size=HARMONICS))
    # two-sided S0 / (2 pi) per rad/s, both signs: S0 / pi
    size = math.sqrt(2.0 * problem.intensity / math.pi * width)
    phase = rng.uniform(0.0, 2.0 * math.pi, HARMONICS)

    def motion(t, y):
        force = problem.load + size * np.cos(omega * t + phase).sum()
        return y[1], force - problem.damping_rate * y[1] - problem.omega**2 * y[0]

    def upper(t, y):
        return y[0] - problem.upper

    def lower(t, y):
        return y[0] - problem.lower

    upper.terminal = lower.terminal = True
    upper.direction, lower.direction = 1.0, -1.0
    stops = [event for event, stop in ((lower, problem.lower), (upper, problem.upper))
             if math.isfinite(stop)]  # fmt: skip
    end, t, y = problem.burn_in + problem.duration, 0.0, np.zeros(2)
    grid = np.arange(problem.burn_in, end, 0.1 / problem.omega)
    records, times, speeds = [], [], []
    while t < end:
        own = grid[(grid > t) & (grid <= end)]
        run = solve_ivp(motion, (t, end), y, events=stops or None, t_eval=own, rtol=1e-5)
        records.append(np.reshape(run.y, (2, -1)))  # a list where no sample fell
        if run.status != 1:
            break
        side = next(k for k, found in enumerate(run.t_events) if len(found))
        t, y = run.t_events[side][0], run.y_events[side][0].copy()
        if t > problem.burn_in:
            times.append(t - problem.burn_in)
            speeds.append(abs(y[1]))
        at_lower = stops[side] is lower
        y[0] = problem.lower if at_lower else problem.upper
        y[1] *= -(problem.restitution_lower if at_lower else problem.restitution_upper)
        if abs(y[1]) < 1e-3 * problem.speed_scale:  # it would stick, and restart for ever
            y[1] = (1.0 if at_lower else -1.0) * 1e-3 * problem.speed_scale
    x, v = np.concatenate(records, axis=1)
    return {"displacement": x, "velocity": v, "impact_speed": speeds, "impact_time": times}


def diffrax_euler(problem, seed: int) -> dict[str, np.ndarray]:
    """diffrax's Euler step of the velocity on a Brownian path, mirrored between steps."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    h, solver, kick = STEP / problem.omega, diffrax.Euler(), math.sqrt(problem.intensity)
    totals = Totals(problem, h)

    def one(key):
        noise = diffrax.UnsafeBrownianPath(shape=(), key=key)
        terms = diffrax.MultiTerm(
            diffrax.ODETerm(
                lambda t, v, x: problem.load - problem.damping_rate * v - problem.omega**2 * x
            ),
            diffrax.ControlTerm(lambda t, v, x: jnp.asarray(kick), noise),
        )

        def advance(state, step):
            x, v, sums = state
            v = solver.step(terms, step * h, (step + 1) * h, v, x, None, False)[0]
            x = x + h * v
            low, high = x < problem.lower, x > problem.upper
            r = jnp.where(low, problem.restitution_lower, problem.restitution_upper)
            stop = jnp.clip(x, problem.lower, problem.upper)
            w = jnp.where(low | high, jnp.abs(v), 0.0)
            x = jnp.where(low | high, stop - r * (x - stop), x)
            v = jnp.where(low | high, -r * v, v)
            new = jnp.stack([x, x**2, v**2, w > problem.speed_threshold, w, w**2])
            return (x, v, sums + jnp.where(step >= totals.first, new, 0.0)), None

        start = (jnp.clip(0.0, problem.lower, problem.upper), jnp.asarray(0.0), jnp.zeros(6))
        steps = jnp.arange(totals.first + totals.steps)
        return jax.lax.scan(advance, start, steps)[0][2]

    sums = np.asarray(jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(seed), problem.paths)))
    totals.moments, totals.impacts = sums.T[:3], sums.T[3:]
    return totals.averages()


FIRST = {
    "explicit Euler": explicit_euler,
    "semi-implicit Euler, put back at the end of a step": end_of_step_mirror,
    "semi-implicit Euler, overshoot mirrored": mirrored_overshoot,
}
"""In the order in which people come to them."""
LIBRARIES = {"diffrax Euler, overshoot mirrored": diffrax_euler}
