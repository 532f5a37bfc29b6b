"""The exact joint density of one oscillator, as functions of place and speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.methods.closed_form import one_coordinate
from stochvi.methods.closed_form.method import exact, one_oscillator, unmet
from stochvi.model.calculations import calculation
from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.model import model_of
from stochvi.results.errors import NoExactSolution
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True, repr=False)
class ExactDensity:
    """p(x, v) = p(x) exp(-v^2 / 2 theta) / sqrt(2 pi theta), with what follows from it (B 13.38).

    Everything is computed in logarithms, so that tails far out keep their digits; densities of
    no more than 1e-308 are 0, their logarithms are not. Made by `exact_density`.

    See Also
    --------
    stochvi.methods.closed_form.exact_density : The calculation.
    """

    response: Response
    law: GibbsLaw
    mass: float

    def __repr__(self) -> str:
        return f"<exact density, E v^2 = {self.law.theta:g} m^2/s^2>"

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density at displacements x (m) and velocities v (m/s), s/m^2."""
        return _exp(self.log_density(x, v))

    def log_density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Logarithm of the joint density; minus infinity beyond rigid stops."""
        return np.asarray(self.law.log_density(x) + _log_normal(v, self.law.theta))

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m; 0 beyond rigid stops."""
        return self.law.density(x)

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m: normal with the variance theta."""
        return _exp(_log_normal(v, self.law.theta))

    def tail(self, x: ArrayLike) -> Vector:
        """Probability of a displacement above x (m), P(X > x)."""
        return _exp(self.log_tail(x))

    def log_tail(self, x: ArrayLike) -> Vector:
        """log P(X > x), also where that is too small for a number."""
        return self.law.log_tail(x)

    def impact_speed_density(self, side: str, w: ArrayLike) -> Vector:
        """Density of the speeds (m/s) of impacts on the "lower" or "upper" stop, s/m.

        Rayleigh's, (w / theta) exp(-w^2 / 2 theta): that of the flux v p(stop, v) (B 13.44).
        """
        self._position(side)
        speed = np.maximum(np.asarray(w, dtype=float), 0.0)
        theta = self.law.theta
        return np.asarray(speed / theta * _exp(-(speed**2) / (2.0 * theta)))

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts on one stop per second and per unit of incident speed, w p(stop, w), 1/m."""
        rate = self.rate_above(side, 0.0)
        return np.asarray(rate * self.impact_speed_density(side, w))

    def rate_above(self, side: str, speed: ArrayLike) -> Vector:
        """Impacts per second on one stop that are faster than `speed` (m/s), 1/s."""
        return _exp(self.log_rate_above(side, speed))

    def log_rate_above(self, side: str, speed: ArrayLike) -> Vector:
        """Logarithm of p(stop) sqrt(theta / 2 pi) exp(-speed^2 / 2 theta)."""
        theta = self.law.theta
        rate = self.law.log_density(self._position(side)) + 0.5 * math.log(theta / (2.0 * math.pi))
        above = np.maximum(np.asarray(speed, dtype=float), 0.0)
        return np.asarray(rate - above**2 / (2.0 * theta))

    @property
    def contact_probability(self) -> float | None:
        """Share of time in contact with compliant stops; None where none does."""
        for pair in self.response.impact_pairs.values():
            share = pair["contact_probability"]
            return share.value if isinstance(share, Estimate) else None
        return None

    def peak_force_exceedance(self, side: str, force: ArrayLike) -> Vector:
        """P(largest force of a contact > force), N, with one compliant stop.

        The mass turns where U has risen by w^2 / 2, w the Rayleigh speed of the contact's onset:
        P = exp(-(U(y) - U(0)) / theta), y the deflection of that force. Noise and damping during
        the contact are neglected.
        """
        self._position(side)
        return self.law.peak_force_exceedance(side, np.asarray(force, dtype=float) / self.mass)

    def peak_force_density(self, side: str, force: ArrayLike) -> Vector:
        """Density of the largest force of a contact, 1/N; a force at which the stop yields has
        a probability of its own, which the density leaves out."""
        self._position(side)
        per_unit_mass = np.asarray(force, dtype=float) / self.mass
        return np.asarray(self.law.peak_force_density(side, per_unit_mass) / self.mass)

    def _position(self, side: str) -> float:
        stops = {stop.name: stop for stop in (self.law.lower, self.law.upper) if stop is not None}
        if side not in stops:
            raise ValueError(f"side must be one with a stop ({', '.join(stops)}), got {side!r}")
        return stops[side].position


@calculation
def exact_density(
    scene: Scene,
    *,
    budget: float | None = None,
) -> ExactDensity:
    """The exact law of one oscillator; conditions as for `exact`.

    Parameters
    ----------
    scene
        The scene.
    budget
        Seconds after which `NotConverged` is raised; None for no limit.

    Returns
    -------
    ExactDensity
        The joint density, its tails and that of impact speeds.

    See Also
    --------
    stochvi.exact : The averages.
    stochvi.methods.fokker_planck.fokker_planck_density : Where stops take energy.

    Examples
    --------
    >>> from stochvi.scenes.impact_laws import Restitution
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.scene import ImpactPair
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     impact_pairs=[ImpactPair(lower=-1.0, law=Restitution(coefficient=1.0))],
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> law = exact_density(scene)
    >>> law.log_tail([1.0, 40.0]).round(6).tolist()
    [-1.668268, -804.435688]
    """
    model = model_of(scene)
    conditions = unmet(model)
    if not conditions and len(model.coordinates) > 1:
        conditions = ["the scene must have one coordinate for a joint density"]
    if conditions:
        raise NoExactSolution(conditions)
    response = exact(scene)
    return ExactDensity(response=response, law=_law(scene, response), mass=model.unit_mass)


@calculation
def displacement_density(scene: Scene, x: ArrayLike) -> Vector:
    """Exact probability density of the displacement, 1/m; conditions as for `exact`.

    Parameters
    ----------
    scene
        The scene.
    x
        Displacements, m.

    Returns
    -------
    Vector
        One value for each displacement, 1/m.

    See Also
    --------
    stochvi.methods.closed_form.exact_density : Displacement and velocity together.

    Examples
    --------
    >>> from stochvi import Oscillator, Scene, WhiteNoise
    >>> free = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> displacement_density(free, [0.0]).round(6).tolist()
    [0.398942]
    """
    return exact_density(scene).displacement_density(x)


def _law(scene: Scene, response: Response) -> GibbsLaw:
    """Law of the displacement; for filtered noise the Gaussian distribution with its moments."""
    if one_oscillator(model_of(scene)):
        return one_coordinate.displacement_law(scene)
    (found,) = response.coordinates.values()
    values = {name: item.value for name, item in found.items() if item is not None}
    omega = values["velocity_std"] / values["displacement_std"]
    return GibbsLaw(
        theta=values["velocity_mean_square"],
        omega=omega,
        load=values["displacement_mean"] * omega**2,
    )


def _log_normal(v: ArrayLike, theta: float) -> Vector:
    velocity = np.asarray(v, dtype=float)
    return -(velocity**2) / (2.0 * theta) - 0.5 * math.log(2.0 * math.pi * theta)


def _exp(logarithm: ArrayLike) -> Vector:
    with np.errstate(under="ignore"):
        return np.asarray(np.exp(logarithm))
