"""What the kernels of one oscillator are given: numbers with names, in one unit of mass.

Numba compiles a named tuple as it does a plain one. Parts that may be absent are arguments of their
own, because numba leaves out the code of an argument that is `None`, not that of an empty field.
"""

from typing import NamedTuple

from numpy.typing import NDArray


class Kick(NamedTuple):
    """Damping and white noise over a step: v <- decay v + spread z, z a standard normal.

    With b the damping rate and S0 the intensity, `decay` is e^(-b h) and `spread`, in m/s, the root
    of S0 (1 - e^(-2 b h)) / (2 b).
    """

    decay: float
    spread: float


class Flow(NamedTuple):
    """Undamped motion over a step of h s: x <- C x + S v, v <- C v - w0^2 S x.

    `cosine` is C = cos w0 h, `sine` is S = sin(w0 h) / w0 in s, `stiff` is w0^2 in 1/s^2.
    """

    step: float
    cosine: float
    sine: float
    stiff: float


class RigidStop(NamedTuple):
    """A rigid stop: position from the rest position (m), restitution, and the speed after an impact
    (m/s) under which the same stop may be met again within a step (negative: never)."""

    position: float
    restitution: float
    slow: float


class Corner(NamedTuple):
    """How steps are refined where a mass is slow and near a stop.

    Parameters
    ----------
    width, speed : m from a stop and m/s, under which steps are refined.
    damping_rate, intensity : b (1/s) and S0 (m^2/s^3) of the noise.
    ladder : (levels, 3), h / 2^k and (C, S) of it in row k.
    share : largest length of a sub-step, in the time in which noise changes the state.
    """

    width: float
    speed: float
    damping_rate: float
    intensity: float
    ladder: NDArray
    share: float


class Counting(NamedTuple):
    """Which steps are flown and what is counted of them.

    Parameters
    ----------
    burn_in, steps : steps that are flown first, and steps that count.
    stride : moments are taken every so many steps, before the kick.
    origin : m, from where the moments of x are taken; it should be near their mean.
    threshold : m/s, the slowest impact that counts as one.
    """

    burn_in: int
    steps: int
    stride: int
    origin: float
    threshold: float


class Sampling(NamedTuple):
    """How a response is sampled, and the oscillator that adds impacts to it.

    Parameters
    ----------
    span : s, the sampling interval.
    omega, damping_rate : w0 (rad/s) and b (1/s).
    threshold : m/s, the slowest impact that counts as one.
    scale : m/s, a velocity that the slowest impacts are compared with.
    warm_up, counted : samples flown first, at the end of the period, and samples that count.
    """

    span: float
    omega: float
    damping_rate: float
    threshold: float
    scale: float
    warm_up: int
    counted: int
