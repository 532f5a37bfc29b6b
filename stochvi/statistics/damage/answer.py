"""The answer of `damage`: what equipment at a place goes through, with its stops and without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.shown_units import ACCELERATION
from stochvi.mathematics.units import STANDARD_GRAVITY
from stochvi.results.base import Result
from stochvi.results.estimates import TOO_FEW, Estimate, format_with_error
from stochvi.results.intervals import GAUSSIAN_95, reach

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectrumValues:
    """A quantity at many frequencies or points: value, standard error and bias, of one shape.

    See Also
    --------
    stochvi.Estimate : The same of one number.
    """

    value: Vector
    standard_error: Vector
    bias: Vector

    def half_width_95(self) -> Vector:
        """Half the width of the 95 % intervals, as that of an `Estimate`; NaN where the value is
        not known."""
        rows = zip(self.standard_error.flat, self.bias.flat, strict=True)
        found = np.array([reach(GAUSSIAN_95, [error], [bias]) for error, bias in rows])
        return np.where(np.isnan(self.value), np.nan, found.reshape(self.value.shape))

    def estimates(self) -> list[Estimate]:
        """The values one by one."""
        return [
            Estimate(value=float(value), standard_error=float(error), bias=float(bias))
            for value, error, bias in zip(
                self.value.flat, self.standard_error.flat, self.bias.flat, strict=True
            )
        ]


def ratio_of(above: SpectrumValues, below: SpectrumValues) -> SpectrumValues:
    """Ratio of two independent quantities."""
    value = above.value / below.value
    errors = np.hypot(above.standard_error / above.value, below.standard_error / below.value)
    biases = above.bias / above.value + below.bias / below.value
    return SpectrumValues(value=value, standard_error=value * errors, bias=value * biases)


@dataclass(frozen=True, kw_only=True, eq=False)
class EquipmentSpectra:
    """Spectra over the frequencies of the equipment, F of them.

    Parameters
    ----------
    response_rms
        Rms absolute acceleration of the equipment, m/s^2.
    extreme_response
        Extreme response spectrum: expected largest absolute acceleration in the mission, m/s^2.
    extreme_lower, extreme_upper
        (F,): the largest of a mission lies between them in 95 of 100 missions, m/s^2.
    fatigue_damage
        Fatigue damage spectrum of the mission: Miner's sum of S^b over rainflow cycles, with the
        amplitude S of the pseudo-velocity, (m/s)^b.
    cumulative_rms
        Rms acceleration of the place below each frequency, m/s^2.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    response_rms: SpectrumValues
    extreme_response: SpectrumValues
    extreme_lower: Vector
    extreme_upper: Vector
    fatigue_damage: SpectrumValues
    cumulative_rms: SpectrumValues

    def document(self) -> dict[str, Any]:
        """Lists by quantity, with those of its errors beside it."""
        found: dict[str, Any] = {}
        for each in fields(self):
            found |= lists_of(each.name, getattr(self, each.name))
        return found


def lists_of(name: str, quantity: Any) -> dict[str, Any]:
    """A quantity as a list of values under its name, and the lists of its errors."""
    if not isinstance(quantity, SpectrumValues):
        return {name: quantity}
    errors = {f"{name}_standard_error": quantity.standard_error, f"{name}_bias": quantity.bias}
    return {name: quantity.value} | errors


@dataclass(frozen=True, kw_only=True, eq=False)
class Shocks:
    """Shock spectra of impacts: largest absolute acceleration of the equipment around each.

    Parameters
    ----------
    typical, worst
        (F,): the median of windows in which an impact begins, and the level that one in a hundred
        of them exceeds, m/s^2.
    window, windows
        Length of a window, s, and number of windows with an impact.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    typical: Vector
    worst: Vector
    window: float
    windows: int


@dataclass(frozen=True, kw_only=True, eq=False)
class TailoredTest:
    """A random test of another duration that does the fatigue damage of the mission.

    Parameters
    ----------
    duration
        Of the test, s.
    frequency_hz, density
        Breakpoints of its profile, one-sided, (m/s^2)^2/Hz; straight in logarithms between them.
    rms
        Rms acceleration of the profile, m/s^2.
    exaggeration
        Factor of the rms for the other duration, (mission / duration)^(1 / b).
    equal_density
        (F,) density of equal damage in the duration, which the profile nowhere falls below.
    damage_ratio, damage_ratio_error
        (F,): damage of the profile without stops over that of the mission, and the relative error
        of the formula for the former.
    extreme_ratio, extreme_ratio_error
        (F,): expected largest response of the test over that of the mission, and its relative
        standard error, which is that of the mission. Below 1 the test has smaller shocks than the
        mission.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    duration: float
    frequency_hz: Vector
    density: Vector
    rms: float
    exaggeration: float
    equal_density: SpectrumValues
    damage_ratio: Vector
    damage_ratio_error: Vector
    extreme_ratio: Vector
    extreme_ratio_error: Vector

    def to_frame(self) -> pd.DataFrame:
        """The breakpoints as the columns of a file of a profile, in Hz and g^2/Hz."""
        import pandas as pd

        return pd.DataFrame(
            {
                "frequency_hz": self.frequency_hz,
                "density_g2_per_hz": self.density / STANDARD_GRAVITY**2,
            }
        )

    def summary(self) -> str:
        """The profile in a sentence."""
        ratio = self.extreme_ratio
        least, most = _ends(ratio, ratio * self.extreme_ratio_error)
        return (
            f"{len(self.density)} breakpoints of {ACCELERATION.text(self.rms)} rms do at least the "
            f"fatigue damage of the mission, up to {float(self.damage_ratio.max()):.3g} times it; "
            f"their largest responses are {least} to {most} times those of the mission"
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Damage(Result):
    """What a mission does to equipment at a place of a scene.

    Equipment is an oscillator z'' + (w / Q) z' + w^2 z = -a on the place, whose absolute
    acceleration is a. Spectra are functions of its natural frequency.

    Parameters
    ----------
    equipment_frequency_hz
        (F,) natural frequencies, Hz.
    quality, exponent
        Q of the equipment and exponent b of its fatigue.
    mission
        Duration, s.
    at
        The coordinate or point on which the equipment stands.
    with_stops, without_stops
        Spectra of the scene as it is, and with its stops left out; the second is None where there
        is no stationary motion without stops, and the first is the second in a scene without stops.
    damage_ratio
        Damage with stops over that without.
    equivalent_density
        One-sided density of a Gaussian acceleration of the place that does the same damage without
        stops, (m/s^2)^2/Hz. It is interpolated in logarithms.
    shocks
        Shock spectra of impacts; None where none was seen.
    impacts_per_hour
        Impacts on all stops, 1/h.
    contacts_above
        Contacts per hour with an acceleration of the place above each asked level, by the level in
        m/s^2. Rigid stops are left out: an impulse has no largest acceleration.
    impact_work_per_hour, impact_loss_per_hour
        Energy with which impacts arrive at all stops, m w^2 / 2, and what they lose of it, J/h.
    way, way_without
        How the spectra were found: "simulation", "clusters" or "density".
    scene_without_mass
        Whether the scene gives no mass; energies are then those of 1 kg.
    test
        The test of equal damage in the duration that was asked for; None where none was.

    See Also
    --------
    stochvi.damage : The calculation.
    """

    equipment_frequency_hz: Vector
    quality: float
    exponent: float
    mission: float
    at: str
    with_stops: EquipmentSpectra
    without_stops: EquipmentSpectra | None
    damage_ratio: SpectrumValues | None
    equivalent_density: SpectrumValues
    shocks: Shocks | None
    impacts_per_hour: Estimate | None
    contacts_above: Mapping[str, Estimate]
    impact_work_per_hour: Estimate | None
    impact_loss_per_hour: Estimate | None
    way: str
    way_without: str | None
    scene_without_mass: bool = False
    test: TailoredTest | None = None
    assumptions: Sequence[str] = ()

    @property
    def relative_error(self) -> float:
        """Median relative standard error of the fatigue damage."""
        damage = self.with_stops.fatigue_damage
        return float(np.median(damage.standard_error / damage.value))

    @property
    def unseen(self) -> bool:
        """Whether the scene has stops and impacts were not seen often enough for a number."""
        return self.impacts_per_hour is not None and self.impacts_per_hour.upper_95 is not None

    @property
    def unseen_in_words(self) -> str:
        """How seldom impacts were seen where their damage is not known, and the remedy."""
        assert self.impacts_per_hour is not None
        if TOO_FEW in self.impacts_per_hour.how:
            return f"impacts were seen {TOO_FEW}, so that their damage is not known; raise budget"
        return (
            "no impact was seen, so that the damage of impacts is not known; raise budget with a "
            "smaller rel_error, or ask reliability how rare they are"
        )

    def to_frame(self) -> pd.DataFrame:
        """A row for each frequency of the equipment, with a column for every list of the
        document."""
        import pandas as pd

        columns = {"equipment_frequency_hz": self.equipment_frequency_hz}
        columns |= self.with_stops.document()
        if self.without_stops is not None:
            columns |= {
                f"{name}_without_stops": values
                for name, values in self.without_stops.document().items()
            }
        for name in ("damage_ratio", "equivalent_density"):
            if getattr(self, name) is not None:
                columns |= lists_of(name, getattr(self, name))
        if self.shocks is not None:
            columns |= {"shock_typical": self.shocks.typical, "shock_worst": self.shocks.worst}
        return pd.DataFrame(columns)

    def _document(self) -> dict[str, Any]:
        found = super()._document()
        spectra, without = found.pop("with_stops"), found.pop("without_stops")
        head = {
            "method": f"damage:{self.way}",
            "equipment_frequency_hz": found.pop("equipment_frequency_hz"),
            **spectra.document(),
            "without_stops": None if without is None else without.document(),
        }
        for name in ("damage_ratio", "equivalent_density"):
            head |= lists_of(name, found.pop(name))
        return head | found

    def summary(self) -> str:
        """How much the stops add, in a sentence."""
        f = self.equipment_frequency_hz
        band = f"equipment from {f[0]:.4g} to {f[-1]:.4g} Hz at {self.at}, Q = {self.quality:g}"
        if self.damage_ratio is None:
            found = "no damage without stops to compare with"
        elif self.impacts_per_hour is None:
            found = "no stops"
        elif self.unseen:
            found = self.unseen_in_words
        else:
            ratio = self.damage_ratio
            low, high = _ends(ratio.value, ratio.standard_error)
            most = f[np.argmax(ratio.value)]
            found = f"stops multiply the damage by {low} to {high}, most at {most:.4g} Hz"
        return (
            f"{band}: {found}; median standard error {100.0 * self.relative_error:.2g} % "
            f"(by {self.way})"
        )


def _ends(value: Vector, standard_error: Vector) -> list[str]:
    """The smallest and the largest of some values, each with its standard error where it has
    one."""
    return [
        format_with_error(value[k], standard_error[k]) if standard_error[k] else f"{value[k]:.3g}"
        for k in (int(np.argmin(value)), int(np.argmax(value)))
    ]
