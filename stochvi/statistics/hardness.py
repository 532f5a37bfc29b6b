"""How hard an impact is: by its speed, its energy, or the acceleration while a stop is touched. A
kind of hardness is a class here, which everything that limits the hardest impact of a mission finds
by its name; a kind that is added here is known to all of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypedDict

from stochvi.results.errors import NotApplicable

# every page of the command line reads this file: what calculations alone need is imported there
if TYPE_CHECKING:
    from stochvi.mathematics.numerics import Matrix, Vector
    from stochvi.mathematics.units import ShownQuantity
    from stochvi.model.model import Model, Pair
    from stochvi.motion.missions import MissionPlan, Start
    from stochvi.scenes.scene import Scene


class HardestImpact(TypedDict, total=False):
    """Limits of the hardest impact of a mission, by the name of their kind of hardness.

    Parameters
    ----------
    impact_speed
        Limit of the incident speed of any impact, m/s.
    impact_energy
        Limit of the energy m w^2 / 2 with which any impact strikes, J: w is its speed, m the
        reduced mass of its pair. It needs the mass of the structure.
    peak_acceleration
        Limit of the absolute acceleration in any contact, m/s^2; it needs stops with a stiffness.
    """

    impact_speed: float | None
    impact_energy: float | None
    peak_acceleration: float | None


NEEDS_FORCE = (
    "peak_acceleration needs the stiffness of the stops, of an elastic, viscoelastic, hertz or "
    "table law: a restitution alone does not give a force"
)
"""The reason why a scene with rigid stops has no peak acceleration."""


class Limit(NamedTuple):
    """The limit that an impact must not exceed.

    Parameters
    ----------
    event
        Name of the kind of hardness.
    value
        The limit, SI.
    outputs
        Coordinates and points whose acceleration counts; empty for what speeds tell.
    """

    event: str
    value: float
    outputs: tuple[str, ...] = ()

    @property
    def kind(self) -> Hardness:
        """The kind of hardness that it limits."""
        return hardness_of(self.event)


HARDNESS: dict[str, Hardness] = {}
"""All kinds of hardness by name."""


def hardness_of(event: str) -> Hardness:
    """The kind of hardness of a name; `ValueError` for one that is not known.

    >>> hardness_of("impact_speed").beyond(2.0), hardness_of("peak_acceleration").unit
    ('an impact faster than 2 m/s', 'm/s^2')
    """
    if event not in HARDNESS:
        raise ValueError(f"event must be {' or '.join(map(repr, HARDNESS))}, got {event!r}")
    return HARDNESS[event]


def limits_in(options: Mapping[str, Any]) -> dict[str, Any]:
    """Limits of the hardest impact among options, by the name of their kind."""
    return {name: options[name] for name in HARDNESS if options.get(name) is not None}


def limits_of(scene: Scene, limits: Mapping[str, float], at: str | None) -> list[Limit]:
    """The limits in a scene, see `Hardness.limit`."""
    from stochvi.model.model import model_of

    check_place(model_of(scene), at, limits)
    return [hardness_of(name).limit(scene, value, at) for name, value in limits.items()]


def check_place(model: Model, at: str | None, names: Iterable[str]) -> None:
    """`ValueError` for a place that no such kind of hardness has, or that the model does not
    know."""
    if at is None:
        return
    placed = [name for name, kind in HARDNESS.items() if kind.has_place]
    if not {*placed} & {*names}:
        raise ValueError(f"at = {at!r} belongs to {' or '.join(placed)}, which is not given")
    if not _at(model, at):
        raise ValueError(f"at must be one of {', '.join(model.outputs)}, got {at!r}")


def _at(model: Model, at: str) -> tuple[str, ...]:
    """Names of the outputs at a coordinate or point."""
    return tuple(name for name in model.outputs if at in (name, name.rpartition(".")[0]))


class Hardness(ABC):
    """A kind of hardness. A class that states a `name` is one of them.

    Parameters
    ----------
    name, unit
        Its name, as options and answers have it, and the SI unit of its limits.
    words
        What it is, in words.
    above, too
        An impact beyond a limit in words: before the limit, and where this is not told.
    argument
        What stands for a limit on a page of the command line, with its kind.
    help
        What a limit limits, on that page.
    has_place
        Whether it is that at a coordinate or point, and not of a pair.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    words: ClassVar[str]
    above: ClassVar[str]
    too: ClassVar[str]
    argument: ClassVar[str]
    help: ClassVar[str]
    has_place: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        if "name" in vars(cls):
            HARDNESS[cls.name] = cls()

    @property
    def quantity(self) -> ShownQuantity:
        """The quantity in which its limits are shown."""
        from stochvi.mathematics.units import readable

        return readable(self.unit)

    def beyond(self, limit: float) -> str:
        """An impact beyond a limit, in words."""
        return f"{self.above} {self.quantity.text(limit)}"

    def unmet(self, model: Model) -> list[str]:
        """Why nothing in a model determines it; empty where something does."""
        return []

    def check(self, model: Model) -> None:
        """Raise `NotApplicable` where nothing in a model determines it."""
        if unmet := self.unmet(model):
            raise NotApplicable(self.name, unmet)

    def limit(self, scene: Scene, value: float, at: str | None = None) -> Limit:
        """The limit in a scene, for what has a place `at` a coordinate or point where there are
        several; `NotApplicable` where nothing in the scene determines this hardness."""
        from stochvi.model.model import model_of

        self.check(model_of(scene))
        return Limit(self.name, value)

    @abstractmethod
    def speed_of(self, model: Model, pair: Pair, limit: Limit) -> float:
        """Speed at which an impact on a pair is as hard as a limit, m/s; infinite for none."""

    @abstractmethod
    def missions(self, model: Model, mission: float, start: Start, limit: Limit) -> MissionPlan:
        """The missions of one mass under white noise in which an impact exceeds the limit."""

    def without_stops(self, model: Model, limit: Limit, mission: float) -> float:
        """Probability, at least, that the motion without stops alone exceeds a limit."""
        return 0.0

    def by_spring(self, model: Model, distance: float) -> float:
        """The hardness that the spring of one mass alone reaches at a distance, m."""
        return 0.0


class FromSpeed(Hardness):
    """A hardness that follows from the speed of an impact and the reduced mass of its pair."""

    @abstractmethod
    def at(self, speed: Vector, mass: float | Vector) -> Vector:
        """The hardness of impacts at a speed (m/s) on pairs of a mass (kg)."""

    def of_pairs(self, speeds: Matrix, masses: Vector) -> Vector:
        """The hardest of each column of speeds (pairs, n), m/s, on pairs of these masses (kg)."""
        hardest: Vector = self.at(speeds, masses[:, None]).max(axis=0)
        return hardest

    def missions(self, model: Model, mission: float, start: Start, limit: Limit) -> MissionPlan:
        from stochvi.motion.missions import impact_plan

        speeds = [self.speed_of(model, pair, limit) for pair in model.pairs]
        return impact_plan(model, mission, start, *speeds)


class ImpactSpeed(FromSpeed):
    """The speed at which an impact begins."""

    name, unit = "impact_speed", "m/s"
    words, above, too = "impact speed", "an impact faster than", "too fast an impact"
    argument, help = "V (speed)", "largest impact speed of the mission, m/s"

    def at(self, speed: Vector, mass: float | Vector) -> Vector:
        return speed

    def speed_of(self, model: Model, pair: Pair, limit: Limit) -> float:
        return limit.value


class ImpactEnergy(FromSpeed):
    """The energy m w^2 / 2 with which an impact strikes, m the reduced mass of its pair."""

    name, unit = "impact_energy", "J"
    words, above, too = "impact energy", "an impact of more than", "too energetic an impact"
    argument = "E[J] (energy)"
    help = (
        "largest energy of an impact of the mission, m w^2 / 2 with the reduced mass of its pair, "
        "J; it needs the mass of the structure"
    )

    def unmet(self, model: Model) -> list[str]:
        if model.knows_mass:
            return []
        return ["impact_energy needs structure.mass (kg), got none; give it, or limit impact_speed"]

    def at(self, speed: Vector, mass: float | Vector) -> Vector:
        return mass * speed**2 / 2.0

    def speed_of(self, model: Model, pair: Pair, limit: Limit) -> float:
        return math.sqrt(2.0 * limit.value / pair.mass)


class PeakAcceleration(Hardness):
    """The largest absolute acceleration while a stop is touched."""

    name, unit = "peak_acceleration", "m/s^2"
    words, above = "peak acceleration", "a peak acceleration above"
    too, has_place = "too sharp an impact", True
    argument = "A[g] (acceleration)"
    help = (
        "largest absolute acceleration during an impact of the mission, m/s^2 or g (80g); it needs "
        "stops with a stiffness"
    )

    def unmet(self, model: Model) -> list[str]:
        rigid = [pair.name for pair in model.pairs if any(stop.rigid for stop in pair.stops)]
        return [f"{NEEDS_FORCE} (stops of {', '.join(rigid)})"] if rigid else []

    def limit(self, scene: Scene, value: float, at: str | None = None) -> Limit:
        """By default that at every coordinate that is a length."""
        from stochvi.model.model import model_of
        from stochvi.scenes.structures.rigid_body import MOTIONS, RigidBody

        model = model_of(scene)
        unmet = self.unmet(model)
        if not (model.single or model.base_alone_moves):
            unmet.append(
                "the base alone must move (an excitation of the base, on a structure with a base): "
                "where noise acts on a mass, the acceleration has no largest value"
            )
        if unmet:
            raise NotApplicable(self.name, unmet)
        if model.single:
            return Limit(self.name, value)
        if at is not None:
            return Limit(self.name, value, _at(model, at))
        turning = tuple(MOTIONS)[3:] if isinstance(scene.structure, RigidBody) else ()
        lengths = tuple(name for name in model.outputs if name not in turning)
        return Limit(self.name, value, lengths)

    def speed_of(self, model: Model, pair: Pair, limit: Limit) -> float:
        """That whose peak force alone gives any of the outputs the acceleration."""
        import numpy as np
        from scipy.optimize import brentq

        rows = _rows(model, limit)
        pushed = float(np.max(np.abs(rows @ np.linalg.solve(model.mass, pair.direction))))
        if not pushed:
            return math.inf
        force = limit.value / pushed
        found = []
        for stop in pair.stops:

            def missing(logarithm: float, law: Any = stop.law) -> float:
                return float(law.impact(math.exp(logarithm), pair.mass).peak_force - force)

            low, high = math.log(1e-9), math.log(1e6)
            reached = missing(low) < 0.0 < missing(high)
            found.append(math.exp(brentq(missing, low, high)) if reached else 1e6)
        return min(found)

    def missions(self, model: Model, mission: float, start: Start, limit: Limit) -> MissionPlan:
        from stochvi.motion.missions import acceleration_plan

        return acceleration_plan(model, mission, start, limit.value)

    def without_stops(self, model: Model, limit: Limit, mission: float) -> float:
        """By crossings of its noise at the slowest natural frequency (Rice)."""
        import numpy as np

        from stochvi.model.coverage import free_motion
        from stochvi.model.modal import absolute_accelerations

        law = free_motion(model.without_sines()).law
        squares = absolute_accelerations(model.modal, law, _rows(model, limit))
        slowest = math.sqrt(float(np.min(model.modal.squares))) / (2.0 * math.pi)
        levels = 0.5 * limit.value**2 / np.maximum(squares, np.finfo(float).tiny)
        return -math.expm1(-2.0 * slowest * mission * math.exp(-float(levels.min())))

    def by_spring(self, model: Model, distance: float) -> float:
        return model.omega**2 * distance


def _rows(model: Model, limit: Limit) -> Matrix:
    """Rows of the outputs whose acceleration counts."""
    chosen = [model.outputs.index(name) for name in limit.outputs]
    return model.output_rows[chosen] if chosen else model.output_rows
