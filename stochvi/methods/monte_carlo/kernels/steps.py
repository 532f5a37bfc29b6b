"""Arguments of the kernels of one oscillator, as named tuples; all quantities per unit mass.

Numba compiles a named tuple as it does a plain one. Parts that may be absent are arguments of their
own: numba leaves out the code of an argument that is `None`, but not that of an empty field.
"""

from typing import NamedTuple

from numpy.typing import NDArray


class Kick(NamedTuple):
    """Damping and white noise over a step: v <- decay v + spread z, z a standard normal.

    With b the damping rate and S0 the intensity, `decay` is e^(-b h) and `spread`, in m/s, the root
    of S0 (1 - e^(-2 b h)) / (2 b). A step that has the noise of two steps of half its length makes
    z of the pair of normals that these would take; `earlier` is then the weight of the first one,
    else 0.
    """

    decay: float
    spread: float
    earlier: float = 0.0


class Flow(NamedTuple):
    """Undamped motion over a step of h s: x <- C x + S v, v <- C v - w0^2 S x.

    `cosine` is C = cos w0 h, `sine` is S = sin(w0 h) / w0 in s, `stiff` is w0^2 in 1/s^2.
    """

    step: float
    cosine: float
    sine: float
    stiff: float


class RigidStop(NamedTuple):
    """A rigid stop for kernels that know no other: position from the rest position in m, and R.

    `slow` is the speed after an impact, in m/s, below which the mass may hit the same stop again
    within a step; it is negative where that cannot happen.
    """

    position: float
    restitution: float
    slow: float


class Paths(NamedTuple):
    """State of the paths that a kernel advances, and the sums that it adds to.

    Parameters
    ----------
    x, v : (paths,), m from the rest position and m/s at the start, replaced by those at the end.
    streams : (2, paths), random streams, advanced.
    sums : (rows, paths), added to; the rows are those of `rows`.
    noise : (2, paths), added to: the sums of x z and of v z over the counted steps, with x and v
        before the kick and z its normal.
    kept : (paths, 2), what a kernel knows of a path beside that, replaced: zeros at the start
        unless the kernel states something else.
    """

    x: NDArray
    v: NDArray
    streams: NDArray
    sums: NDArray
    noise: NDArray
    kept: NDArray


class Corner(NamedTuple):
    """How steps are refined in the corner of the phase plane where a mass is slow and near a stop.

    Parameters
    ----------
    width, speed : distance from a stop (m) and speed (m/s) below which steps are refined.
    damping_rate, intensity : b (1/s), and S0 of the noise (m^2/s^3).
    stiff : w0^2, 1/s^2.
    ladder : (levels, 3), length h / 2^k of a sub-step with its (C, S) in row k.
    share : largest length of a sub-step, in units of the time in which noise changes the state.
    """

    width: float
    speed: float
    damping_rate: float
    intensity: float
    stiff: float
    ladder: NDArray
    share: float


class Counting(NamedTuple):
    """Which steps a path takes, and which of its states and impacts are added up.

    Parameters
    ----------
    first, last : number of the first step, and of the one after the last. Steps with negative
        numbers are a burn-in, which is not counted. A path may be advanced by several calls, as
        sums and states go on; each but the last must take an even number of steps, since two
        successive steps use a pair of normals.
    stride : number of steps from one sample of the moments to the next; samples precede the kick.
    origin : m, from where the moments of x are taken; it should be near the mean of x.
    threshold : m/s, speed of the slowest impact that is counted.
    """

    first: int
    last: int
    stride: int
    origin: float
    threshold: float


class Sampling(NamedTuple):
    """How a response is sampled, and the oscillator that adds impacts to it.

    Parameters
    ----------
    span : s, the sampling interval.
    omega, damping_rate : w0 (rad/s) and b (1/s).
    threshold : m/s, speed of the slowest impact that is counted.
    scale : m/s, the rms speed; slower rebounds than `limits.RESTING` times it rest on the stop.
    first, last : number of the first sample, and of the one after the last. Samples with negative
        numbers stand at the end of the period, and are not counted.
    """

    span: float
    omega: float
    damping_rate: float
    threshold: float
    scale: float
    first: int
    last: int
