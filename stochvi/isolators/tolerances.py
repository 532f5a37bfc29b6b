"""Tolerances of a scene. Chapters: changes of a scene within its tolerances; their distributions in
a production; the largest clearances over the whole region, by linear theory."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import eigenvalues
from stochvi.mathematics.units import outside_of_share, power_ratio, with_checks
from stochvi.mathematics.unsteady_noise import MovingMean
from stochvi.model.coverage import free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.deadline import NEVER, Deadline
from stochvi.scenes.impact_laws import Law, Restitution
from stochvi.scenes.phases import changed_mount
from stochvi.scenes.scene import Scene
from stochvi.scenes.structures.rigid_body import AXES, RigidBody
from stochvi.scenes.validation import BetweenUnits, varied

# ------------------------------------------------------------------------------
# Changes of a scene within the tolerances of its mount, its level and its stops.
# ------------------------------------------------------------------------------


WORST = "worst within all tolerances"
"""Name of the row with the largest clearance of the whole region of the tolerances."""


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far the mount, the level and the stops may be from what the scene states: by default
    nothing is off.

    Parameters
    ----------
    frequency, damping
        Relative tolerances of natural frequency and damping ratio.
    level_db
        Tolerance of the level, dB up and down.
    stiffness
        Relative tolerance of the stiffness of the stops.
    centre
        How far the centre of mass of a rigid body may lie from its stated place along each axis, m.
    """

    frequency: float = 0.0
    damping: float = 0.0
    level_db: float = 0.0
    stiffness: float = 0.0
    centre: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "stiffness"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise outside_of_share(f"the tolerance of {name}", "in [0, 1)", getattr(self, name))
        if not 0.0 <= self.centre < math.inf:
            raise ValueError(
                f"the tolerance of centre must be a length from 0 on (m), got {self.centre:g}"
            )
        if not 0.0 <= self.level_db < 60.0:
            raise ValueError(f"the tolerance of level must be in [0, 60) dB, got {self.level_db:g}")

    @classmethod
    def of(cls, scene: Scene, *, usual: bool = False, **stated: float) -> Tolerances:
        """The tolerances that were asked for: those stated as arguments, those of the scene, and,
        if `usual` is asked for, `USUAL` for the others."""
        own = {
            name: value
            for name in ("frequency", "damping", "centre")
            if (value := getattr(scene.structure, f"{name}_tolerance", None)) is not None
        }
        found = cls(**(asdict(USUAL) if usual else {}) | own | stated)
        if found.centre and not isinstance(scene.structure, RigidBody):
            raise ValueError(
                "the tolerance of centre is that of structure.kind = 'rigid-body', got "
                f"{scene.structure.kind!r}"
            )
        return found

    def felt(self, scene: Scene, *, by_hits: bool) -> Tolerances:
        """These tolerances without that of the stiffness of the stops where no answer depends on
        it: no impact is simulated, or a stop is rigid."""
        return self if by_hits and ends_of_stops(scene, self) else replace(self, stiffness=0.0)

    def limits(self) -> dict[str, float]:
        """The largest amount by which each quantity may be off either way, without those that are
        as stated; the stiffness of the stops is not among them."""
        known = {"frequency": self.frequency, "damping": self.damping, "level": self.level_db}
        known |= {f"{CENTRE}{axis}": self.centre for axis in AXES}
        return {quantity: limit for quantity, limit in known.items() if limit}

    def in_words(self) -> str:
        """The tolerances that are not zero, in words; empty where there is none."""
        words = {
            "natural frequency": (100.0 * self.frequency, "%"),
            "damping ratio": (100.0 * self.damping, "%"),
            "level": (self.level_db, "dB"),
            "centre of mass": (1e3 * self.centre, "mm along each axis"),
            "stiffness of the stops": (100.0 * self.stiffness, "%"),
        }
        return ", ".join(
            f"{name} ± {value:.3g} {unit}" for name, (value, unit) in words.items() if value
        )


USUAL = Tolerances(frequency=0.1, damping=0.3, level_db=3.0, stiffness=0.2)
"""Usual tolerances of elastomer mounts, of the level of vibration tests, and of the stiffness of
rubber within 5 degrees Shore A; applied where it is asked for."""

CENTRE = "centre "
"""Beginning of the name of a quantity that moves the centre of mass; the axis follows it."""


STIFFNESS = "stiffness "
"""Beginning of the name of a quantity that is the stiffness of one law. The name of its pair
follows it, behind the side where the law is that of one stop."""


class Change(NamedTuple):
    """One quantity that is off by an amount: relative, dB, m of a centre of mass, or a number that
    is added to the restitution."""

    quantity: str
    amount: float

    @property
    def words(self) -> str:
        """The change in words."""
        amount = self.amount
        match self.quantity:
            case "frequency":
                return f"natural frequency {100.0 * amount:+.3g} %"
            case "damping":
                return f"damping ratio {100.0 * amount:+.3g} %"
            case "level":
                return f"level {amount:+.3g} dB"
            case "stiffness":
                return f"stiffness of the stops {100.0 * amount:+.3g} %"
            case "restitution":
                return f"restitution {amount:+.3g}"
        if self.quantity.startswith(STIFFNESS):
            one = self.quantity.removeprefix(STIFFNESS)
            return f"stiffness of {one} {100.0 * amount:+.3g} %"
        axis = self.quantity.removeprefix(CENTRE)
        return f"centre of mass {1e3 * amount:+.3g} mm along {axis}"

    def applied(self, scene: Scene) -> Scene:
        """The scene with this change."""
        match self.quantity:
            case "frequency":
                return changed_mount(scene, 1.0 + self.amount, 1.0)
            case "damping":
                return changed_mount(scene, 1.0, 1.0 + self.amount)
            case "level":
                return raised(scene, self.amount)
            case "stiffness":
                return changed_stops(scene, stiffness=1.0 + self.amount)
            case "restitution":
                return changed_stops(scene, restitution=self.amount)
        if self.quantity.startswith(STIFFNESS):
            one = self.quantity.removeprefix(STIFFNESS)
            return changed_stops(scene, stiffness=1.0 + self.amount, of=one)
        axis = self.quantity.removeprefix(CENTRE)
        return moved_centre(scene, [self.amount * (axis == each) for each in AXES])


def all_applied(changes: Sequence[Change], scene: Scene) -> Scene:
    """The scene with all of these changes."""
    for change in changes:
        scene = change.applied(scene)
    return scene


def raised(scene: Scene, level_db: float) -> Scene:
    """The scene with everything that shakes raised by a level in dB, in each of its phases."""
    if not scene.phases:
        return scene.at_level(level_db)
    return scene.replace(
        phases=[each.replace(level_db=each.level_db + level_db) for each in scene.phases]
    )


def worded(changes: Sequence[Change]) -> str:
    """Changes that come together, in words; those by nothing are left out."""
    return ", ".join(change.words for change in changes if change.amount)


def ends_of(tolerances: Tolerances) -> list[Change]:
    """Both ends of every tolerance of the mount and of the level that is not zero."""
    return [
        Change(quantity, sign * limit)
        for quantity, limit in tolerances.limits().items()
        for sign in (-1.0, 1.0)
    ]


def ends_of_stops(scene: Scene, tolerances: Tolerances) -> list[Change]:
    """Both ends of the stiffness of the stops, where all of them are compliant."""
    laws = [law for pair in scene.impact_pairs for _, law in pair.stops()]
    if not tolerances.stiffness or not laws or any(law.rigid for law in laws):
        return []
    return [Change("stiffness", sign * tolerances.stiffness) for sign in (-1.0, 1.0)]


def moved_centre(scene: Scene, shift: Sequence[float]) -> Scene:
    """A rigid body whose centre of mass lies elsewhere by `shift` (m along x, y, z), seen from
    which mounts, points and pairs are then placed. The inertia about the centre stays."""
    body = scene.structure
    assert isinstance(body, RigidBody)

    def seen(place: tuple[float, float, float]) -> tuple[float, ...]:
        return tuple(each - moved for each, moved in zip(place, shift, strict=True))

    mounts = tuple(each.model_copy(update={"at": seen(each.at)}) for each in body.mounts)
    points = {name: seen(place) for name, place in (body.points or {}).items()}
    pairs = tuple(
        each.model_copy(update={"at": seen(each.at)}) if each.at is not None else each
        for each in scene.impact_pairs
    )
    structure = body.model_copy(update={"mounts": mounts, "points": points})
    return scene.model_copy(update={"structure": structure, "impact_pairs": pairs})


def changed_stops(
    scene: Scene, *, stiffness: float = 1.0, restitution: float = 0.0, of: str | None = None
) -> Scene:
    """The scene with the stiffness of all compliant stops multiplied by a factor, and with a number
    added to the restitution of all rigid ones. Where that scatters, its mean is shifted. `of` names
    the law of one pair alone, as `STIFFNESS` says."""

    def changed(law: Law) -> Law:
        if isinstance(law, Restitution):
            return law.shifted(restitution)
        # more stiffness acts on a mass like the same law on a mass that is smaller by this factor
        return law if law.rigid else law.per_unit_mass(1.0 / stiffness)

    pairs = [
        pair.model_copy(
            update={
                name: changed(law)
                for name in ("law", "lower_law", "upper_law")
                if (law := getattr(pair, name)) is not None
                and of in (None, " ".join([*name.split("_")[:-1], pair.name]))
            }
        )
        for pair in scene.impact_pairs
    ]
    return scene.model_copy(update={"impact_pairs": tuple(pairs)})


# ------------------------------------------------------------------------------
# Distributions of the tolerances of a mount and of its stops between the units of a production.
# ------------------------------------------------------------------------------


SMALLEST_RATIO = 0.05
"""Smallest value of a frequency or stiffness over its stated value: a normal distribution is
truncated there, because no mount has a frequency of 0. That of a damping ratio is truncated at 0:
a mount with hardly any damping is hit, and counts."""

SEEN = -6.5
"""Standard deviations from which a truncation is told: the normal distribution has 4e-11 below."""

UNITS = {
    "frequency": ("%", 0.01), "damping": ("%", 0.01), "level": ("dB", 1.0), "centre": ("mm", 1e-3),
    "clearance": ("mm", 1e-3), "stiffness": ("%", 0.01), "restitution": ("", 1.0),
}  # fmt: skip
"""Quantities that may vary between units, each with the unit in which it is spoken of, and that
unit in SI units."""

RELATIVE = ("frequency", "damping", "stiffness")
"""Quantities whose amounts are relative to what the scene states."""


@with_checks
@dataclass(frozen=True, kw_only=True)
class Spread:
    """Distribution of one quantity over the units of a production, about what the scene states.

    The amounts are those of `Tolerances`: relative for frequency, damping and the stiffness of the
    stops, and dB for the level. The centre of mass and the clearance of each stop are off by m, the
    restitution by a plain number. A normal distribution of a relative amount is truncated at -95 %,
    that of the damping at -100 %: there are no units beyond.

    Parameters
    ----------
    std
        Standard deviation of a normal distribution.
    half_width
        Instead: half of the width of a uniform distribution.
    mean
        Mean over the production, where it is off what the scene states.

    See Also
    --------
    stochvi.isolators.production : The risk of the production.

    Examples
    --------
    >>> from stochvi.isolators import Spread
    >>> Spread(std=0.05).in_words("frequency"), Spread(half_width=1e-4).in_words("clearance")
    ('natural frequency normal, std 5 %', 'clearance of each stop uniform, ± 0.1 mm')
    """

    std: float | None = None
    half_width: float | None = None
    mean: float = 0.0

    def __post_init__(self) -> None:
        given = [each for each in (self.std, self.half_width) if each is not None]
        if len(given) != 1:
            raise ValueError(
                f"a spread must have exactly one of std and half_width, got {len(given)}; "
                "std is for a normal distribution, half_width for a uniform one"
            )
        if not 0.0 < given[0] < math.inf or not math.isfinite(self.mean):
            raise ValueError(
                "std or half_width must be positive, and mean finite, got "
                f"{given[0]:g} and {self.mean:g}"
            )

    def distribution(self, quantity: str) -> Any:
        """The distribution of the amount of a quantity, as scipy has it."""
        if self.half_width is not None:
            return scipy.stats.uniform(self.mean - self.half_width, 2.0 * self.half_width)
        assert self.std is not None
        if quantity_of(quantity) not in RELATIVE:
            return scipy.stats.norm(self.mean, self.std)
        return scipy.stats.truncnorm(self._least(quantity), math.inf, self.mean, self.std)

    def _least(self, quantity: str) -> float:
        """Where the distribution of a relative amount is truncated, in standard deviations."""
        smallest = 0.0 if quantity_of(quantity) == "damping" else SMALLEST_RATIO
        return (smallest - 1.0 - self.mean) / (self.std or math.inf)

    def nodes(self, quantity: str, number: int) -> tuple[Vector, Vector]:
        """Nodes and weights of Gauss quadrature over the amount of a quantity."""
        if self.half_width is not None:
            place, weight = np.polynomial.legendre.leggauss(number)
            return self.mean + self.half_width * place, 0.5 * weight
        assert self.std is not None
        place, weight = np.polynomial.hermite_e.hermegauss(number)
        amounts = self.mean + self.std * place
        if quantity_of(quantity) in RELATIVE and amounts[0] < SMALLEST_RATIO - 1.0:
            raise ValueError(
                f"nodes of {quantity} must stay above -95 %, got {100.0 * amounts[0]:.3g} %; give "
                "fewer nodes, or a smaller std"
            )
        return amounts, weight / math.sqrt(2.0 * math.pi)

    def polynomials(self, number: int) -> Matrix:
        """Orthonormal polynomials (degree, node) of the distribution at its `nodes`."""
        if self.half_width is not None:
            place, _ = np.polynomial.legendre.leggauss(number)
            size = [math.sqrt(2.0 * k + 1.0) for k in range(number)]
            return np.array(np.polynomial.legendre.legvander(place, number - 1) * size).T
        place, _ = np.polynomial.hermite_e.hermegauss(number)
        size = [1.0 / math.sqrt(math.factorial(k)) for k in range(number)]
        return np.array(np.polynomial.hermite_e.hermevander(place, number - 1) * size).T

    def in_words(self, quantity: str) -> str:
        """The distribution of a quantity, in words."""
        unit, size = UNITS[quantity_of(quantity)]

        def spoken(value: float, form: str = ".3g") -> str:
            return f"{value / size:{form}} {unit}".strip()

        mean = f", mean {spoken(self.mean, '+.3g')}" if self.mean else ""
        if self.half_width is not None:
            return f"{name_of(quantity)} uniform, ± {spoken(self.half_width)}{mean}"
        assert self.std is not None
        cut = ""
        if quantity_of(quantity) in RELATIVE and self._least(quantity) > SEEN:
            cut = ", truncated at "
            cut += "0" if quantity_of(quantity) == "damping" else f"{SMALLEST_RATIO:.0%} of it"
        return f"{name_of(quantity)} normal, std {spoken(self.std)}{mean}{cut}"


NAMES = {
    "frequency": "natural frequency", "damping": "damping ratio", "level": "level",
    "centre": "centre of mass along each axis", "clearance": "clearance of each stop",
    "stiffness": "stiffness of the stops", "restitution": "restitution",
}  # fmt: skip
"""The quantities in words."""


def quantity_of(name: str) -> str:
    """The quantity of a spread, which may be that of one stop or law alone.

    >>> quantity_of("clearance"), quantity_of("clearance upper stops")
    ('clearance', 'clearance')
    """
    return name.partition(" ")[0]


def name_of(name: str) -> str:
    """The quantity of a spread in words, with its stop or law where it is that of one alone."""
    quantity, _, place = name.partition(" ")
    return NAMES[name] if not place else f"{quantity} of {place}"


STATED_AS = {
    "frequency_hz": "frequency", "zeta": "damping", "damping": "damping", "lower": "clearance",
    "upper": "clearance", "stiffness": "stiffness",
}  # fmt: skip
"""Keys of a scene that may differ between units, each with the quantity that it states."""


def spreads_of(scene: Scene) -> dict[str, Spread]:
    """The distributions between units that a scene states, by quantity, and for a stop or a law by
    its name as well."""
    return {_name(scene, key): _spread(key, each) for key, each in varied(scene)}


def _name(scene: Scene, key: str) -> str:
    """Name of the spread of a key, such as "impact_pair.0.upper"."""
    way = key.split(".")
    quantity = STATED_AS[way[-1]]
    if way[0] != "impact_pair":
        return quantity
    pair = scene.impact_pairs[int(way[1])].name
    side = way[2].removesuffix("law").rstrip("_")  # a law without a side is that of both stops
    return " ".join(filter(None, [quantity, side, pair]))


def _spread(key: str, stated: BetweenUnits) -> Spread:
    name = STATED_AS[key.rpartition(".")[2]]
    unit = stated.mean if name in RELATIVE else 1.0
    width = "std" if stated.std is not None else "half_width"
    return Spread(**{width: getattr(stated, width) / unit})


def spreads_beside(
    scene: Scene, spreads: Mapping[str, Spread], limits: Iterable[str] = ()
) -> dict[str, Spread]:
    """The spreads of a scene and those stated, which take the place of the former where they are of
    the same quantity. So do limits of a quantity."""
    stated = {*map(quantity_of, spreads), *limits}
    own = spreads_of(scene).items()
    return {name: each for name, each in own if quantity_of(name) not in stated} | dict(spreads)


def check_spreads(scene: Scene, spreads: Mapping[str, Spread]) -> None:
    """Raise `ValueError` for quantities that do not exist, or that the scene cannot vary."""
    own = spreads_of(scene)
    for name, spread in spreads.items():
        if name not in UNITS and name not in own:
            raise ValueError(f"spreads must be of {', '.join(UNITS)}, got {name!r}")
        if not isinstance(spread, Spread):
            raise ValueError(
                f"the spread of {name} must be a Spread, as Spread(std=0.05), got {spread!r}"
            )
        lowest, _ = spread.distribution(name).support()
        uniform = spread.half_width is not None
        if quantity_of(name) in RELATIVE and uniform and lowest <= -1.0:
            raise ValueError(
                f"the spread of {name} must stay above -100 %, got {100.0 * lowest:.3g} %; give a "
                "smaller half_width"
            )
    if "centre" in spreads and not isinstance(scene.structure, RigidBody):
        raise ValueError(
            f"the spread of centre is that of structure.kind = 'rigid-body', got "
            f"{scene.structure.kind!r}"
        )


def bands_beside(scene: Scene, spreads: Mapping[str, Spread], **stated: Any) -> Tolerances:
    """The tolerances of a scene, and those stated, but for the quantities that have a spread."""
    given = {KEYS.get(name, name) for name in map(quantity_of, spreads)}
    known = {each.name for each in fields(Tolerances)}
    return Tolerances.of(scene, **stated | dict.fromkeys(given & known, 0.0))


KEYS = {"level": "level_db"}
"""Fields of `Tolerances` that are not named as the quantity."""


def in_words(spreads: Mapping[str, Spread]) -> str:
    """All spreads in words."""
    return "; ".join(spread.in_words(name) for name, spread in spreads.items())


# ------------------------------------------------------------------------------
# The largest clearances over the whole region of tolerances, by linear theory.
#
# The response over frequency is known, so that rms, rate of crossings and mean of every gap are
# cheap at any point of the region. The clearance for the same risk is the one at which stops are
# crossed at the same rate (Rice); the distance by which the mean has moved is added to it. Impacts
# are taken to cluster as in the nominal scene. Inside the region a resonance may meet a peak of the
# excitation: the ends of the tolerances do not suffice.
# ------------------------------------------------------------------------------


Changes = tuple[Change, ...]

PER_RESONANCE = 4.0
"""Frequencies of the search in the half width of the narrowest resonance: the response to the
narrowest peak of an excitation is as wide as the resonance that meets it."""

MOST_FREQUENCIES = 401
"""Largest number of frequencies of the search. A resonance so narrow that this number does not
resolve it is met only by an excitation whose peak is as narrow."""

MOST_STARTS = 3
"""Number of maxima over the frequencies of the search from which the largest one is refined."""

STEP = 1e-6
"""Step of the differences in the refinement, in units of the tolerances."""

NEVER_CROSSED = 1e-300
"""Rate that takes the place of a rate of 0, of which a logarithm is taken, 1/s."""


class Gaps(NamedTuple):
    """rms (m), crossings of the mean per second and mean (m) of every gap, (pairs,) each.

    A scene without pairs has one gap, that of its only coordinate. `frequency` is the factor on
    the natural frequencies. `beside_sines` holds noise and sines of each, None without sines.
    """

    sigma: Vector
    rate: Vector
    mean: Vector
    frequency: float = 1.0
    beside_sines: tuple[MovingMean, ...] | None = None

    @classmethod
    def of(cls, model: Model, gain: float = 1.0, frequency: float = 1.0) -> Gaps:
        """The gaps of a structure whose noise and sines are larger by a factor."""
        directions = np.array([pair.direction for pair in model.pairs] or [np.ones(1)])
        motions = tuple(
            each.louder(gain)
            for each in free_motion(model, with_sines=True).moving_means(directions)
        )
        sigma, speed = np.array([each.deviations for each in motions]).T
        rate = np.divide(speed, 2.0 * math.pi * sigma, out=np.zeros_like(speed), where=sigma > 0.0)
        mean = directions @ model.modal.shapes @ model.modal.rest
        return cls(sigma, rate, mean, frequency, motions if model.sines else None)

    @property
    def speed(self) -> Vector:
        """rms velocity of every gap, m/s."""
        return 2.0 * math.pi * self.rate * self.sigma

    def crossings(self, distance: Vector, numbers: Sequence[int]) -> Vector:
        """Crossings per second of stops of some gaps, at distances from their means; infinite ones
        for none."""
        found = np.zeros(len(numbers))
        for place, (k, away) in enumerate(zip(numbers, distance.tolist(), strict=True)):
            if not math.isfinite(away):
                continue
            if self.beside_sines is not None:
                found[place] = self.beside_sines[k].rate(away)
            elif self.sigma[k] > 0.0:
                level = max(away, 0.0) / float(self.sigma[k])
                found[place] = float(self.rate[k]) * math.exp(-0.5 * level**2)
        return found


@dataclass(frozen=True, kw_only=True)
class SameRisk:
    """Clearances for the risk of stops at given places, with the gaps changed.

    Parameters
    ----------
    nominal
        The gaps as stated.
    stops
        (2, pairs): distances of the lower and the upper stops from the mean gaps, m; infinite for
        none.
    harm
        Where a limit is to be kept instead of impacts avoided, the share of the first impacts that
        exceed it: those faster than some speed w, a share of exp(-w^2 / (2 s_v^2)).
    common
        Numbers of the pairs that have one clearance in common.
    """

    nominal: Gaps
    stops: Matrix
    harm: float = 1.0
    common: Sequence[int] = ()

    def __call__(self, changed: Gaps) -> Vector:
        """(pairs,): clearances from the nominal mean gap. At this clearance a stop is crossed as
        often as the nearer stop of the pair in the nominal scene; the larger of the two stops
        counts. Pairs in common have the clearance at which all their stops together are crossed as
        often as in the nominal scene."""
        found = self._alone(changed)
        if self.common:
            found[self.common] = self._in_common(changed, float(found[self.common].max()))
        return found

    def _in_common(self, changed: Gaps, enough: float) -> float:
        """The clearance of the pairs in common; each of them alone needs no more than `enough`."""
        before, names = self.nominal, list(self.common)
        shift = (changed.mean - before.mean)[names]
        stated = np.isfinite(self.stops[:, names])
        speeds = np.maximum(changed.speed, NEVER_CROSSED) / np.maximum(before.speed, NEVER_CROSSED)
        harmful = self.harm ** (speeds[names] ** -2)

        def more_than_before(clearance: float) -> float:
            places = np.where(stated, [clearance + shift, clearance - shift], math.inf)
            again = sum(float(changed.crossings(each, names) @ harmful) for each in places)
            return math.log(max(again, NEVER_CROSSED) / wanted)

        wanted = self.harm * sum(
            float(before.crossings(each, names).sum()) for each in self.stops[:, names]
        )
        if wanted < NEVER_CROSSED or more_than_before(0.0) <= 0.0:
            return enough
        while more_than_before(enough) > 0.0:
            enough *= 1.1
        return float(scipy.optimize.brentq(more_than_before, 0.0, enough, rtol=1e-12))

    def _alone(self, changed: Gaps) -> Vector:
        """(pairs,): clearances of pairs that have each their own."""
        before, distance = self.nominal, self.stops.min(axis=0)
        shift = changed.mean - before.mean
        sides = np.where(np.isfinite(self.stops), [-shift, shift], -math.inf).max(axis=0)
        if before.beside_sines is not None and changed.beside_sines is not None:
            share = self.harm ** (1.0 - (before.speed / changed.speed) ** 2)
            again = [
                new.distance_of(old.rate(float(away)) * float(part))
                for old, new, away, part in zip(
                    before.beside_sines, changed.beside_sines, distance, share, strict=True
                )
            ]
            return np.asarray(np.maximum(np.array(again) + sides, 0.0))
        moved = np.where(before.sigma > 0.0, before.sigma, math.inf)
        rates, speeds = (
            np.maximum(new, NEVER_CROSSED) / np.maximum(old, NEVER_CROSSED)
            for new, old in ((changed.rate, before.rate), (changed.speed, before.speed))
        )
        square = (distance / moved) ** 2 + 2.0 * np.log(rates)
        square -= 2.0 * math.log(self.harm) * (1.0 - speeds**-2)
        found = changed.sigma * np.sqrt(np.maximum(square, 0.0)) + sides
        return np.asarray(np.maximum(found, 0.0))


@dataclass(frozen=True)
class Region:
    """All scenes within the tolerances of one, by their gaps."""

    scene: Scene
    tolerances: Tolerances
    models: dict[tuple[float, ...], Model] = field(default_factory=dict)

    @cached_property
    def nominal(self) -> Gaps:
        """The gaps as stated."""
        return self.gaps(())

    @cached_property
    def limits(self) -> dict[str, float]:
        """Quantities that may be off, and by how much either way."""
        return self.tolerances.limits()

    def gaps(self, changes: Sequence[Change]) -> Gaps:
        """The gaps with these changes of frequency, damping, level and centre of mass."""
        off = {each.quantity: each.amount for each in changes}
        gain = math.sqrt(power_ratio(off.get("level", 0.0)))
        return Gaps.of(self.changed(changes), gain, 1.0 + off.get("frequency", 0.0))

    def changed(self, changes: Sequence[Change]) -> Model:
        """The model with these changes of frequency, damping and centre of mass."""
        off = {each.quantity: each.amount for each in changes}
        model = self._model(tuple(off.get(f"{CENTRE}{axis}", 0.0) for axis in AXES))
        frequency, damping = 1.0 + off.get("frequency", 0.0), 1.0 + off.get("damping", 0.0)
        return replace(
            model,
            stiffness=model.stiffness * frequency**2,
            damping=model.damping * (frequency * damping),
            branches=tuple(
                each._replace(stiffness=each.stiffness * frequency**2 * damping)
                for each in model.branches
            ),
            rates=model.rates
            and (model.rates[0] * frequency, model.rates[1] * frequency * damping),
        )

    def _model(self, shift: tuple[float, ...]) -> Model:
        """The model with the centre of mass moved by `shift`, m along x, y, z; made once."""
        if shift not in self.models:
            scene = moved_centre(self.scene, shift) if any(shift) else self.scene
            self.models[shift] = model_of(scene)
        return self.models[shift]

    def worst(
        self, need: Callable[[Gaps], Vector], deadline: Deadline = NEVER
    ) -> list[tuple[float, Changes]]:
        """The largest value of each entry of `need` in the region, and where it is."""
        return worst_within(
            self.limits, lambda changes: need(self.gaps(changes)), self.narrowest(), deadline
        )

    def narrowest(self) -> float:
        """The smallest damping ratio of a mode as stated: its relative half width."""
        modes = model_of(self.scene).modal
        if modes.branches is not None:
            free = eigenvalues(np.diag(modes.squares), modes.dynamic)
            return float(np.min((-free.real / np.abs(free))[free.imag > 0.0], initial=1.0))
        held = modes.squares > 0.0
        return float(np.min(0.5 * np.diag(modes.damping)[held] / np.sqrt(modes.squares[held])))


def worst_within(
    limits: Mapping[str, float], need: Callable[[Changes], Vector], narrowest: float,
    deadline: Deadline = NEVER,
) -> list[tuple[float, Changes]]:  # fmt: skip
    """The largest value of each entry of `need` within limits of the changes, and where it is: the
    largest of a scan of all frequencies, refined by its gradient. `narrowest` is the smallest
    damping ratio of a mode.

    Raises `NotConverged` where the deadline passes before the region is searched.
    """
    # `need` grows with the noise, so that the level is at its upper end
    level = (Change("level", limits["level"]),) if "level" in limits else ()
    names = [name for name in limits if name != "level"]

    def changes(place: Sequence[float]) -> Changes:
        moved = (Change(n, u * limits[n]) for n, u in zip(names, place, strict=True))
        return (*moved, *level)

    def value(place: Sequence[float]) -> Vector:
        if deadline.passed():
            raise deadline.fell_short("before the tolerances were searched", "raise budget")
        return need(changes(place))

    frequencies = _frequencies(limits, narrowest) if "frequency" in names else np.zeros(1)
    others = _combinations([name for name in names if name != "frequency"])
    grid = [
        [((f, *rest) if "frequency" in names else rest) for rest in others] for f in frequencies
    ]
    scan = np.array([[value(place) for place in row] for row in grid])
    found = []
    for k in range(scan.shape[2]):
        starts = [grid[i][int(scan[i, :, k].argmax())] for i in _highest(scan[:, :, k].max(axis=1))]
        known = max((float(value(start)[k]), start) for start in starts)
        climbed = [_climb(start, k, value) for start in starts]
        best = max(known, *((float(value(place)[k]), place) for place in climbed))
        found.append((best[0], changes(best[1])))
    return found


def _frequencies(limits: Mapping[str, float], narrowest: float) -> Vector:
    """Shares of the tolerance of the frequency, close enough to each other for the narrowest
    resonance of the region."""
    least = narrowest * (1.0 - limits.get("damping", 0.0))
    half = PER_RESONANCE * limits["frequency"] / max(least, 1e-9)
    count = min(2 * math.ceil(half) + 1, MOST_FREQUENCIES)
    return np.linspace(-1.0, 1.0, max(count, 3))


def _combinations(names: list[str]) -> list[tuple[float, ...]]:
    """Ends and middles of the other quantities; for the centre of mass the corners and the middle
    alone."""
    axes = [name for name in names if name.startswith(CENTRE)]
    plain = itertools.product((-1.0, 0.0, 1.0), repeat=len(names) - len(axes))
    corners = [*itertools.product((-1.0, 1.0), repeat=len(axes))] if axes else []
    centres = [(0.0,) * len(axes), *corners]
    return [(*one, *other) for one, other in itertools.product(plain, centres)]


def _highest(values: Vector) -> list[int]:
    """Indices of the largest local maxima of values, the largest first."""
    beside = np.pad(values, 1, constant_values=-math.inf)
    peaks = np.flatnonzero((values > beside[:-2]) & (values > beside[2:]))
    found = {*peaks.tolist(), int(values.argmax())}
    return sorted(found, key=lambda i: -values[i])[:MOST_STARTS]


def _climb(
    start: Sequence[float], k: int, value: Callable[[Sequence[float]], Vector]
) -> tuple[float, ...]:
    """Where the k-th value is largest near a place, in units of the tolerances."""
    scale = abs(float(value(start)[k]))
    if not start or scale == 0.0 or not math.isfinite(scale):
        return tuple(start)

    def fallen(place: Vector) -> float:
        return -float(value(place.tolist())[k]) / scale

    bounds = [(-1.0, 1.0)] * len(start)
    found = scipy.optimize.minimize(
        fallen, np.array(start), method="L-BFGS-B", bounds=bounds, options={"eps": STEP}
    )
    return tuple(map(float, found.x))


def tolerance_table(
    scene: Scene,
    tolerances: Tolerances,
    stops: Matrix,
    sized: Sequence[int],
    probability: float,
    harm: float = 1.0,
    common: Sequence[int] = (),
    deadline: Deadline = NEVER,
) -> tuple[list[dict[str, str | float]], dict[str, str]]:
    """The rows of the table that `Sizing.tolerances` describes, and `Sizing.worst_at`.

    Parameters
    ----------
    stops, harm, common
        As in `SameRisk`.
    sized
        Numbers of the pairs whose clearances were searched for.
    probability
        Probability of any impact there.
    """
    region = Region(scene, tolerances)
    names = [pair.name for pair in model_of(scene).pairs]
    same = SameRisk(nominal=region.nominal, stops=stops, harm=harm, common=common)

    def needs(gaps: Gaps) -> Vector:
        """The clearance of each pair, and the risk of any impact where the stops are."""
        return np.append(same(gaps), _hazard(region.nominal, gaps, stops, probability))

    def row(words: str, found: Vector) -> dict[str, str | float]:
        return {
            "change": words,
            **{names[k]: float(found[k]) for k in sized},
            "factor": max(float(found[k] / stops[:, k].min()) for k in sized),
            "probability": -math.expm1(-float(found[-1])),
        }

    ends = [((each,), needs(region.gaps([each]))) for each in ends_of(tolerances)]
    rows = [row("as stated", needs(region.nominal))]
    rows += [row(worded(changes), found) for changes, found in ends]
    places: dict[str, str] = {}
    if ends:
        # with one quantity alone the refinement may end a rounding error below its row
        known = [[(found[k], changes) for changes, found in ends] for k in range(len(names) + 1)]
        worst = [
            max(*each, searched, key=lambda one: one[0])
            for each, searched in zip(known, region.worst(needs, deadline), strict=True)
        ]
        places = {names[k]: worded(worst[k][1]) for k in sized}
        rows.append(row(WORST, np.array([each[0] for each in worst])))
    return rows, places


def _hazard(nominal: Gaps, changed: Gaps, stops: Matrix, probability: float) -> float:
    """-ln(1 - P) of any impact with the stops where they are: it changes as Rice's rate of all
    crossings does."""
    shift = changed.mean - nominal.mean
    pairs = range(len(shift))
    before, after = (
        sum(gaps.crossings(each, pairs).sum() for each in places)
        for gaps, places in ((nominal, stops), (changed, (stops[0] + shift, stops[1] - shift)))
    )
    return float(-math.log1p(-probability) * after / before)
