"""A scene as plain numbers, for integrators that know nothing of this package."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stochvi.model.calculations import calculation
from stochvi.model.coverage import compliant, functions, scattered, without_noise
from stochvi.model.model import Model, Stop, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.scene import Scene

SETTLED = 6.0
"""Relaxation times of burn-in: e^-6 of the start is left after them, and e^-12 of its energy."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A linear structure under noise, with rigid stops or none, and the run that is asked for.

    One oscillator in white noise has numbers per unit mass:

        x'' + damping_rate x' + omega^2 x = load + w(t),   E w(t) w(t + tau) = intensity delta(tau),

    where a velocity v at a stop becomes -R v. In a time step h the noise adds a normal number of
    variance `intensity * h` to the velocity. Several coordinates, and noise of a tabulated density,
    are numbers of `model`: `mass`, `damping` and `stiffness` (n, n); `white`, the intensity matrix
    of the white forces (N^2 s); `constant_force` (n,); `tables`, one-sided densities with the
    forces (n,) per unit of each noise; and `pairs` with their stops.

    Parameters
    ----------
    name
        Name of the problem in a verdict.
    scene
        The whole scene, for integrators that read scenes.
    speed_threshold
        `collision_rate` counts impacts faster than this, m/s.
    burn_in, duration
        Seconds to leave out at the start of a path, and to count after that.
    paths
        How many independent paths are asked for.

    See Also
    --------
    stochvi.testing.problem_of : A problem of a scene.
    stochvi.testing.judge : What hands it to an integrator.
    """

    name: str
    scene: Scene
    speed_threshold: float
    burn_in: float
    duration: float
    paths: int

    @property
    def model(self) -> Model:
        """The numbers of the structure, its stops and its noise, in SI units."""
        return model_of(self.scene)

    @property
    def unowned(self) -> bool:
        """Whether quantities need no name of what they belong to: this is one oscillator."""
        return self.model.single

    @property
    def white_oscillator(self) -> bool:
        """Whether this is one oscillator under white noise alone."""
        return self.unowned and not self.model.tables

    @property
    def free(self) -> bool:
        """Whether there are no stops."""
        return not self.model.stops

    @property
    def omega(self) -> float:
        """Natural frequency of one oscillator, rad/s."""
        return self.model.omega

    @property
    def damping_rate(self) -> float:
        """Damping rate c / m of one oscillator, 1/s."""
        return self.model.damping_rate

    @property
    def intensity(self) -> float:
        """Intensity of the white noise on one oscillator, (m/s^2)^2 s."""
        return self.model.intensity

    @property
    def load(self) -> float:
        """Constant load on one oscillator per unit mass, m/s^2."""
        return self.model.load

    @property
    def lower(self) -> float:
        """Lower stop of one oscillator, m; minus infinity where there is none."""
        return self.model.lower_position

    @property
    def upper(self) -> float:
        """Upper stop of one oscillator, m; infinity where there is none."""
        return self.model.upper_position

    @property
    def restitution_lower(self) -> float:
        """R of the lower stop; 1 where there is none."""
        return _restitution(self.model.lower)

    @property
    def restitution_upper(self) -> float:
        """R of the upper stop; 1 where there is none."""
        return _restitution(self.model.upper)

    @property
    def relaxation_time(self) -> float:
        """Time in which the memory of a start falls to 1/e, without stops, s."""
        return _relaxation_time(self.model)

    @property
    def speed_scale(self) -> float:
        """Standard deviation of the velocity of one oscillator in white noise without stops,
        sqrt(intensity / (2 b)), m/s."""
        return math.sqrt(self.intensity / (2.0 * self.damping_rate))

    @property
    def restitution(self) -> float | None:
        """R of the stops; None without stops, or where two stops have different R."""
        found = {stop.law.restitution for stop in self.model.stops}
        return found.pop() if len(found) == 1 else None

    @property
    def start(self) -> tuple[float, ...]:
        """Displacements at which a path starts at rest, m: 0, or the stop beyond which 0 lies."""
        if self.model.single:
            return (min(max(0.0, self.lower), self.upper),)
        return (0.0,) * len(self.model.coordinates)


@calculation
def problem_of(
    scene: Scene,
    *,
    name: str = "",
    paths: int = 1024,
    relaxations: float = 20.0,
    speed_threshold: float = 0.0,
) -> Problem:
    """The numbers of a scene, for `paths` paths that last `relaxations` relaxation times each.

    Parameters
    ----------
    scene
        The scene.
    name
        Name of the scene.
    paths
        Number of paths.
    relaxations
        Length of a path in relaxation times of the oscillator.
    speed_threshold
        Slowest impact that a rate counts, m/s.

    Returns
    -------
    Problem
        The numbers of the problem.

    Raises
    ------
    NotApplicable
        Unless the structure is linear and damped, its stops are rigid with a number as restitution,
        and its noise is white or has a density.
    ValueError
        If `paths` or `relaxations` is not positive.

    See Also
    --------
    stochvi.testing.read_problem : A problem from its file.

    Examples
    --------
    >>> from stochvi.verification.check_of_many import zoo
    >>> problem = problem_of(zoo("elastic-upper-stop")["elastic-upper-stop"])
    >>> problem.lower, problem.upper, problem.intensity, problem.duration
    (-inf, 1.0, 0.2, 400.0)
    """
    if isinstance(paths, bool) or not isinstance(paths, (int, np.integer)) or paths < 1:
        raise ValueError(f"paths must be a whole number of at least 1, got {paths!r}")
    if not 0.0 < relaxations < math.inf:
        raise ValueError(f"relaxations must be a positive number, got {relaxations}")
    model = model_of(scene)
    unmet = _unmet(model)
    if unmet:
        raise NotApplicable("judge", unmet)
    relaxation = _relaxation_time(model)
    return Problem(
        name=name or scene.title,
        scene=scene,
        speed_threshold=speed_threshold,
        burn_in=SETTLED * relaxation,
        duration=relaxations * relaxation,
        paths=paths,
    )


def _unmet(model: Model) -> list[str]:
    """The conditions of a problem that a model does not meet."""
    unmet = [*functions(model), *scattered(model)]
    kinds = {"a sine" if signal.amplitude else "filtered noise" for signal in model.signals}
    unmet += [
        f"excitation must be white noise, a density or constant, got {kind}"
        for kind in sorted(kinds)
    ]
    unmet += compliant(model)
    named = [sorted(pair.direction[pair.direction != 0.0]) for pair in model.pairs]
    if len(model.base) > 1 or model.points or any(row not in NAMED for row in named):
        unmet.append(
            "structure.kind must be 'oscillator', 'isolator' or 'matrices', with pairs on a "
            "coordinate or between two: problems name pairs and noises by coordinates"
        )
    unmet += without_noise(model)
    if not unmet and not math.isfinite(_relaxation_time(model)):
        unmet.append(
            "structure.damping must be above 0, and damp every motion of the structure without "
            "its stops"
        )
    if not model.single:
        unmet += [
            f"impact_pair {pair.name} must be open where all displacements are 0, got a preload of "
            f"its {stop.name} stop; move that stop"
            for pair in model.pairs
            for stop in pair.stops
            if stop.deflection(0.0) > 0.0
        ]
    return unmet


NAMED = ([1.0], [-1.0, 1.0])
"""Entries of the gap of a pair on a coordinate, or between two."""


def _restitution(stop: Stop | None) -> float:
    """R of a rigid stop; 1 where there is none."""
    return 1.0 if stop is None else stop.law.restitution


def _relaxation_time(model: Model) -> float:
    """One over the real part of the slowest eigenvalue, s; without a spring, of the velocity.

    Infinite where a motion is not damped.
    """
    if len(model.coordinates) > 1:
        count = len(model.coordinates)
        inverse = np.linalg.inv(model.mass)
        states = np.block(
            [
                [np.zeros((count, count)), np.eye(count)],
                [-inverse @ model.stiffness, -inverse @ model.damping],
            ]
        )
        rates = np.linalg.eigvals(states)
        slowest = -float(rates.real.max())
        return 1.0 / slowest if slowest > UNDAMPED * float(np.abs(rates).max()) else math.inf
    half = 0.5 * model.damping_rate
    if half == 0.0:
        return math.inf
    if model.omega == 0.0:
        return 1.0 / model.damping_rate
    return 1.0 / (half - math.sqrt(max(half**2 - model.omega**2, 0.0)))


UNDAMPED = 1e-9
"""Decay rate, as a share of the fastest rate of a structure, below which it is rounding error."""
