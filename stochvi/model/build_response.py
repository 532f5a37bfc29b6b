"""Responses in the common form; those of deterministic methods from their stationary moments."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from stochvi.mathematics.impact_rates import (
    ContactStatistics,
    StopStatistics,
    more_than_counted,
)
from stochvi.mathematics.spectra import response_moments
from stochvi.model.balances import residuals
from stochvi.model.cautions import scene_notes
from stochvi.model.coverage import functions
from stochvi.model.model import Model, Pair, Stop, model_of
from stochvi.results.estimates import Cost, Estimate, provenance
from stochvi.results.response import CoordinateResponse, PairResponse, Response
from stochvi.scenes.scene import Scene

NO_MEAN_SPEED = (
    "no mean impact speed is given: F1 is more than the counted impacts have, "
    "as a mass rests on its stop or many impacts are slower than the threshold"
)
"""Warning where F1 over the rate is no mean speed."""

MOST_ENERGY_CHANGE = 0.1
"""Largest share of the energy that noise and damping may change during a contact, if its peak force
is to follow from the energy alone. Other modes may change as large a share of its way."""


def alone(duration: float) -> float:
    """No share of the way of a contact comes from other modes, as there are none."""
    return 0.0


def build_response(
    scene: Scene,
    method: str,
    *,
    coordinates: Mapping[str, CoordinateResponse],
    impact_pairs: Mapping[str, PairResponse],
    identities: Mapping[str, Estimate],
    cost: Cost,
    assumptions: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> Response:
    """The response of a scene by a method, with what the scene contributes to every response.

    Effects, assumptions of the scene, notes on one oscillator (`scene_notes`) and the provenance
    come from the scene, so that no method can leave them out.

    Parameters
    ----------
    assumptions, warnings
        Assumptions and warnings of the method, which follow those of the scene.
    """
    model = model_of(scene)
    # the notes hold for the response to noise alone, not for a scene with sines
    notes = [] if model.sines else scene_notes(model)
    return Response(
        method=method,
        coordinates={**coordinates, **_of_followers(model, coordinates)},
        impact_pairs=impact_pairs,
        identities=identities,
        effects=scene.effects(),
        assumptions=[*scene.assumptions(), *assumptions],
        warnings=[*notes, *scene.cautions(), *warnings],
        cost=cost,
        provenance=provenance(scene.document()),
    )


def _of_followers(
    model: Model, coordinates: Mapping[str, CoordinateResponse]
) -> dict[str, CoordinateResponse]:
    """Motions of points that move in proportion to the only coordinate."""
    found = {}
    for point, ratio in model.followers.items():
        factors = {"displacement_mean": ratio, "displacement_mean_square": ratio**2,
                   "velocity_mean_square": ratio**2, "upcrossing_rate": 1.0}  # fmt: skip
        known = vars(coordinates[model.coordinates[0]])
        found[point] = CoordinateResponse(
            **{
                name: None if each is None else each * factors.get(name, abs(ratio))
                for name, each in known.items()
            }
        )
    return found


@dataclass(frozen=True, kw_only=True)
class StationaryMoments:
    """Stationary moments, in SI units per unit mass, as a deterministic method finds them.

    Where a method has no law for the rates at a stop, they are None in its `StopStatistics`. The
    contact statistics of a rigid stop are None. `errors`, if a method knows them, has the same
    fields with a bound on the error of each number.
    """

    mean: float
    variance: float
    velocity_mean_square: float
    upcrossing_rate: float
    lower: StopStatistics
    upper: StopStatistics
    acceleration_mean_square: float | None = None
    contact_lower: ContactStatistics | None = None
    contact_upper: ContactStatistics | None = None
    errors: StationaryMoments | None = None

    def response(
        self,
        method: str,
        scene: Scene,
        *,
        how: str,
        started: float,
        bias: float | None = 0.0,
        assumptions: Sequence[str] = (),
        speed_threshold: float = 0.0,
    ) -> Response:
        """The answer in the form that every method returns; `bias` is used where there are no
        `errors`."""
        model = model_of(scene)
        biases = self._biases(model.unit_mass)
        if self.errors is not None and accelerates_between_impacts(model):
            square = self._between_impacts(model, self.variance, self.velocity_mean_square)
            error = self._between_impacts(
                model, self.errors.variance, self.errors.velocity_mean_square
            )
            biases["acceleration_std"] = error / (2.0 * math.sqrt(square))

        def estimate(name: str, value: float | None) -> Estimate | None:
            if value is None:
                return None
            return Estimate(value=value, bias=biases.get(name, bias), how=how)

        acceleration = self.acceleration_mean_square
        if acceleration is None and accelerates_between_impacts(model):
            acceleration = self._between_impacts(model, self.variance, self.velocity_mean_square)
            assumptions = [*assumptions, BETWEEN_IMPACTS]
        if not model.elastic:
            counted = (
                f"faster than {speed_threshold:.3g} m/s" if speed_threshold else "of all speeds"
            )
            assumptions = [*assumptions, f"rates count impacts {counted}"]
        values = {
            "displacement_mean": self.mean,
            "displacement_std": math.sqrt(self.variance),
            "displacement_mean_square": self.mean**2 + self.variance,
            "velocity_std": math.sqrt(self.velocity_mean_square),
            "velocity_mean_square": self.velocity_mean_square,
            "acceleration_std": None if acceleration is None else math.sqrt(acceleration),
            "upcrossing_rate": self.upcrossing_rate,
        }
        coordinate = CoordinateResponse(
            **{name: estimate(name, value) for name, value in values.items()}
        )
        return build_response(
            scene,
            method,
            coordinates={model.coordinates[0]: coordinate},
            impact_pairs={
                pair.name: self.pair(pair, model.damping_rate, how, bias, speed_threshold)
                for pair in model.pairs
            },
            assumptions=assumptions,
            warnings=[NO_MEAN_SPEED] if self._impacts[0] and self._speed_mean() is None else [],
            cost=Cost(wall_time=time.perf_counter() - started),
            identities=self._identities(model, how),
        )

    @staticmethod
    def _between_impacts(model: Model, variance: float, square: float) -> float:
        """Mean square of omega^2 x + b x' about its mean, (m/s^2)^2.

        It follows from the mean squares of x and x' alone: they are not correlated, because E x^2
        is stationary and impacts do not change x.
        """
        return model.omega**4 * variance + model.damping_rate**2 * square

    def pair(
        self,
        pair: Pair,
        damping_rate: float,
        how: str,
        bias: float | None = 0.0,
        speed_threshold: float = 0.0,
        others: Callable[[float], float] = alone,
    ) -> PairResponse:
        """The quantities of an impact pair.

        `damping_rate` (1/s) acts during contacts; `others` gives the share of the way in a contact
        of some duration, s, that other modes change.
        """
        biases = self._biases(pair.mass)
        values = {
            "collision_rate": _total(self.lower.rate, self.upper.rate),
            "collision_rate_lower": None if pair.lower is None else self.lower.rate,
            "collision_rate_upper": None if pair.upper is None else self.upper.rate,
            "impact_speed_mean": self._speed_mean(),
            "impact_speed_rate": _total(self.lower.speed_rate, self.upper.speed_rate),
            "impact_speed_square_rate": _total(
                self.lower.speed_square_rate, self.upper.speed_square_rate
            ),
            **self._contacts(pair.mass),
        }
        found = {
            name: None
            if value is None
            else Estimate(value=value, bias=biases.get(name, bias), how=how)
            for name, value in values.items()
        }
        return PairResponse(
            **found,
            peak_force=self._peak_force(pair, damping_rate, how, bias, others),
            speed_threshold=speed_threshold,
        )

    def at(self, stop: Stop) -> tuple[StopStatistics, ContactStatistics | None]:
        """Statistics of a stop: its impacts, and its contacts if it is compliant."""
        if stop.side > 0:
            return self.upper, self.contact_upper
        return self.lower, self.contact_lower

    def _contacts(self, mass: float) -> dict[str, float | None]:
        """Share of time in contact with either stop, and the mean forces on them, N."""
        contacts = (self.contact_lower, self.contact_upper)
        forces = [None if contact is None else mass * contact.force for contact in contacts]
        shares = [contact.probability for contact in contacts if contact is not None]
        return {
            "contact_probability": sum(shares) if shares else None,
            "contact_force_lower": forces[0],
            "contact_force_upper": forces[1],
        }

    def _peak_force(
        self, pair: Pair, damping_rate: float, how: str, bias: float | None,
        others: Callable[[float], float],
    ) -> Estimate | None:  # fmt: skip
        """Mean over all contacts of their largest force, N, neglecting noise, damping and other
        modes in them.

        In a contact of the duration t, noise and damping change the energy by the share b t. Where
        that, or what other modes change, is more than `MOST_ENERGY_CHANGE`, no number is given.
        Its bias is known only where that of the other numbers of the stop is.
        """
        found = []
        for stop in pair.stops:
            hits, contact = self.at(stop)
            if hits.rate is None or contact is None or contact.peak_force is None:
                return None
            found.append((hits.rate, contact.peak_force, contact.probability))
        rate = sum(each for each, _, _ in found)
        if not rate:
            return None
        peak = sum(each * force for each, force, _ in found) / rate
        duration = sum(share for _, _, share in found) / rate
        damped, moved = damping_rate * duration, others(duration)
        if max(damped, moved) > MOST_ENERGY_CHANGE:
            return None
        change = damped + moved
        left = None if bias is None else pair.mass * peak * change
        return Estimate(value=pair.mass * peak, bias=left, how=f"{how}, brief contacts")

    def _speed_mean(self) -> float | None:
        rate, first, second = self._impacts
        if not rate or first is None or second is None or more_than_counted(rate, first, second):
            return None
        return first / rate

    @property
    def _impacts(self) -> tuple[float | None, float | None, float | None]:
        """Rate of the counted impacts on both stops, F1 and F2."""
        rate, first, second = (
            _total(lower, upper) for lower, upper in zip(self.lower, self.upper, strict=True)
        )
        return rate, first, second

    def _biases(self, mass: float) -> dict[str, float]:
        """Bounds on the errors of the quantities of a response, from `errors`."""
        errors = self.errors
        if errors is None:
            return {}
        found = {
            "displacement_mean": errors.mean,
            "displacement_std": errors.variance / (2.0 * math.sqrt(self.variance)),
            "displacement_mean_square": 2.0 * abs(self.mean) * errors.mean + errors.variance,
            "velocity_std": errors.velocity_mean_square
            / (2.0 * math.sqrt(self.velocity_mean_square)),
            "velocity_mean_square": errors.velocity_mean_square,
            "upcrossing_rate": errors.upcrossing_rate,
            "collision_rate": _total(errors.lower.rate, errors.upper.rate),
            "collision_rate_lower": errors.lower.rate,
            "collision_rate_upper": errors.upper.rate,
            "impact_speed_rate": _total(errors.lower.speed_rate, errors.upper.speed_rate),
            "impact_speed_square_rate": _total(
                errors.lower.speed_square_rate, errors.upper.speed_square_rate
            ),
        }
        found |= errors._contacts(mass)
        speed = self._speed_mean()
        rate, speed_rate = found["collision_rate"], found["impact_speed_rate"]
        hits = _total(self.lower.rate, self.upper.rate)
        if speed is not None and hits and rate is not None and speed_rate is not None:
            found["impact_speed_mean"] = (speed_rate + speed * rate) / hits
        return {name: error for name, error in found.items() if error is not None}

    def _identities(self, model: Model, how: str) -> dict[str, Estimate]:
        moments = self._moments(model)
        if moments is None or functions(model):
            return {}
        found = residuals(model, moments, (self.mean,))
        bounds = dict.fromkeys(found, 0.0)
        errors = self.errors._moments(model) if self.errors is not None else None
        for name, error in (errors or {}).items():
            moved = residuals(model, {**moments, name: moments[name] + error}, (self.mean,))
            for balance, value in moved.items():
                bounds[balance] += abs(value - found[balance])
        return {
            name: Estimate(value=value, bias=bounds[name], how=how) for name, value in found.items()
        }

    def _moments(self, model: Model) -> dict[tuple[str, str], float] | None:
        """Moments from which the balances are calculated; None if a rate is missing."""
        (name,) = model.coordinates
        moments: dict[tuple[str, str], float] = {
            (name, "x"): self.mean,
            (name, "variance"): self.variance,
            (name, "vv"): self.velocity_mean_square,
        }
        for pair in model.pairs:
            for stop in pair.stops:
                hits, contact = self.at(stop)
                if hits.speed_rate is None or hits.speed_square_rate is None:
                    return None
                moments[pair.name, f"f1_{stop.name}"] = hits.speed_rate
                moments[pair.name, f"f2_{stop.name}"] = hits.speed_square_rate
                if contact is not None:
                    moments[pair.name, f"force_{stop.name}"] = contact.force
                    moments[pair.name, f"loss_{stop.name}"] = contact.power
        return moments


def _total(lower: float | None, upper: float | None) -> float | None:
    return None if lower is None or upper is None else lower + upper


BETWEEN_IMPACTS = (
    "acceleration_std is that of the motion between impacts; at an impact on a rigid stop the "
    "acceleration is infinite"
)
"""Assumption that is stated with an absolute acceleration in a scene with rigid stops."""


def accelerates_between_impacts(model: Model) -> bool:
    """Whether springs and dampers alone give the absolute acceleration of one oscillator between
    impacts on rigid stops: if only the base is shaken, and no spring or damper is a function."""
    smooth = model.restoring is None and model.drag is None and not model.functions
    shaken = model.moving_base and not model.noise_on_mass
    return bool(model.stops) and all(stop.rigid for stop in model.stops) and smooth and shaken


def linear_acceleration(model: Model) -> float | None:
    """Mean square absolute acceleration of the mass without stops, m^2/s^4."""
    if model.stops or not model.moving_base or model.noise_on_mass or model.functions:
        return None
    omega, b = model.omega, model.damping_rate
    theta = model.intensity / (2.0 * b)
    white = theta * (b**2 + omega**2)
    for filtered in model.filters:
        moments = filtered.response_moments(omega, b)
        white += omega**4 * moments[0] + b**2 * moments[1]
    tables = response_moments(model.acceleration_tables, omega, b)
    return white + tables.absolute_acceleration
