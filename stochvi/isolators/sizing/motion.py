"""The motion of an isolator between its stops at 3 sigma, from one long simulated path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from stochvi.isolators.contact import hardest_contact
from stochvi.isolators.environment import (
    columns_of,
    frequencies,
    input_density,
    noise_on_base_alone,
    transmissibility,
)
from stochvi.isolators.moved_stops import at_clearances
from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.rounding import ROUNDING
from stochvi.mathematics.spectra import welch
from stochvi.methods.monte_carlo import record_path
from stochvi.model.model import model_of
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.statistics.histograms import SampledDensity

if TYPE_CHECKING:
    from stochvi.isolators.sizing.answer import Sizing
    from stochvi.model.model import Model
    from stochvi.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """Length of the path, and how its statistics are taken.

    Parameters
    ----------
    periods
        Length of the path in natural periods: it takes seconds to simulate, and has some hundred
        impacts on stops at 3 sigma of a light mount.
    burn_in_share
        Share of the path that is left out at its start, where it is not stationary.
    fewest_hits
        Number of impacts from which on percentiles of their speeds are given.
    percentiles
        Percentiles of the impact speed.
    bins, reach
        Number of bins of the histogram, and its half width in linear standard deviations, unless
        the path itself reaches further.
    segment_periods
        Natural periods in a segment of Welch's method: they resolve a damping ratio of 2 %.
    synthesised_share
        Share of half the sampling rate up to which the density of a path is taken: above it, a
        synthesised path carries power that is folded from higher frequencies.
    exact_ranks, rank_ratio
        Number of the fastest impacts that the table of exceedances holds one by one. In the rows
        that follow the number of impacts grows by the ratio: few rows show the same curve.
    """

    periods: float = 20_000.0
    burn_in_share: float = 0.02
    fewest_hits: int = 20
    percentiles: tuple[float, ...] = (50.0, 95.0, 99.0)
    bins: int = 120
    reach: float = 4.5
    segment_periods: float = 60.0
    synthesised_share: float = 0.7
    exact_ranks: int = 200
    rank_ratio: float = 1.01


@dataclass(frozen=True, kw_only=True)
class MotionBetweenStops:
    """Statistics of a long path between stops at 3 sigma (SI units).

    Parameters
    ----------
    scene
        The scene that was simulated, its stops at 3 sigma from the static equilibrium.
    duration, hits
        Seconds of the path and number of its impacts.
    kurtosis
        E x^4 / (E x^2)^2 of the displacement about its mean; 3 for a Gaussian motion.
    mean_position
        Mean position without stops, m.
    displacement
        Histogram of the displacement.
    faster_hits
        `impact_speed` (m/s) and the `rate` (1/s) of impacts at least so fast; None for few impacts.
    impacts
        One row per percentile of the impact speed: `percentile`, `impact_speed` and, for stops
        that are compliant, `peak_acceleration` (m/s^2), `deflection` (m) and `contact_time` (s) of
        the harder side, the base at rest meanwhile. None for few impacts.
    transmissibility
        `frequency_hz` and the apparent `transmissibility`: root of the density of
        -(b v + omega^2 x), the part of the acceleration that spring and damper cause, over that of
        the base. None unless noise moves the base and nothing else shakes the mass.
    transmissibility_change
        Largest relative difference of the apparent transmissibility from the one without stops,
        over bands of a third of an octave.
    """

    scene: Scene
    duration: float
    hits: int
    kurtosis: float
    mean_position: float
    displacement: SampledDensity
    faster_hits: pd.DataFrame | None
    impacts: pd.DataFrame | None
    transmissibility: pd.DataFrame | None
    transmissibility_change: float | None

    def to_dict(self) -> dict[str, Any]:
        """The JSON document; tables are columns."""
        return {
            "duration": self.duration,
            "hits": self.hits,
            "kurtosis": self.kurtosis,
            "mean_position": self.mean_position,
            "displacement": self.displacement.to_dict(),
            "faster_hits": columns_of(self.faster_hits),
            "impacts": columns_of(self.impacts),
            "transmissibility": columns_of(self.transmissibility),
            "transmissibility_change": self.transmissibility_change,
        }


def motion_between_stops(
    sizing: Sizing, settings: PathSettings | None = None
) -> MotionBetweenStops:
    """Simulate one long path of a sized isolator, with its stops at 3 sigma and their laws."""
    settings = settings or PathSettings()
    scene = at_clearances(sizing.scene, sizing.three_sigma.clearance)
    model = model_of(scene)
    period = 2.0 * math.pi / model.omega
    fine = bool(model.whites) and noise_on_base_alone(model)
    path = record_path(
        scene,
        duration=settings.periods * period,
        seed=sizing.seed,
        step=period / WHITE_SAMPLES if fine else None,
    )
    # filtered noise makes the structure one of several oscillators, whose columns have names
    path = path.rename(columns=lambda name: name.partition(" of ")[0])
    path = path.iloc[round(settings.burn_in_share * len(path)) :]
    duration = float(path["time"].iloc[-1] - path["time"].iloc[0])
    speeds = path["impact_speed"].abs().to_numpy()
    speeds = np.sort(speeds[speeds > 0.0])
    rest = model.rest
    samples = path["displacement"].to_numpy()
    apparent = (
        _apparent_transmissibility(model, path, settings) if noise_on_base_alone(model) else None
    )
    reach = 1.05 * max(float(abs(samples - rest).max()), settings.reach * sizing.sigma)
    many = len(speeds) >= settings.fewest_hits
    return MotionBetweenStops(
        scene=scene,
        duration=duration,
        hits=len(speeds),
        kurtosis=_kurtosis(samples),
        mean_position=rest,
        displacement=SampledDensity.of(
            samples, settings.bins, *_ends(model, rest - reach, rest + reach)
        ),
        faster_hits=_faster_hits(speeds, duration, settings) if many else None,
        impacts=_impacts(scene, speeds, settings) if many else None,
        transmissibility=apparent,
        transmissibility_change=_largest_change(model, apparent),
    )


def _ends(model: Model, low: float, high: float) -> tuple[float, float]:
    """Ends of a histogram: a rigid stop, since no displacement lies beyond it, else the given
    end."""
    for stop in model.stops:
        if stop.rigid and stop.position < model.rest:
            low = stop.position
        elif stop.rigid:
            high = stop.position
    return low, high


def _kurtosis(samples: Vector) -> float:
    x = samples - samples.mean()
    return float(np.mean(x**4) / np.mean(x**2) ** 2)


def _faster_hits(speeds: Vector, duration: float, settings: PathSettings) -> pd.DataFrame:
    """Rate of impacts at least as fast as each of the sorted speeds, thinned where they are
    many."""
    fastest = min(settings.exact_ranks, len(speeds))
    steps = math.log(len(speeds) / fastest) / math.log(settings.rank_ratio)
    more = np.geomspace(fastest, len(speeds), math.ceil(steps) + 1).round().astype(int)
    ranks = np.unique(np.concatenate([np.arange(1, fastest + 1), more]))[::-1]
    return pd.DataFrame({"impact_speed": speeds[-ranks], "rate": ranks / duration})


def _impacts(scene: Scene, speeds: Vector, settings: PathSettings) -> pd.DataFrame:
    """Percentiles of impact speed and, of compliant stops, what the mass then feels."""
    model = model_of(scene)
    stops = [
        (stop.law, abs(stop.position - model.rest))
        for stop in model.stops_per_unit_mass
        if isinstance(stop.law, CompliantLaw)
    ]
    met = np.percentile(speeds, settings.percentiles)
    found = pd.DataFrame({"percentile": settings.percentiles, "impact_speed": met})
    if stops:
        hit = hardest_contact(model, stops, met)
        found["peak_acceleration"], found["deflection"] = hit.peak_acceleration, hit.deflection
        found["contact_time"] = hit.contact_time
    return found


WHITE_SAMPLES = 40
"""Samples in a natural period where white noise shakes the base and a density is taken: at the long
steps that suffice for averages, the density is that of the kicks, not of the noise."""

MOST_FOLDED = 0.03
"""Largest share of the transmissibility at a frequency that may come from another one, folded to it
by the sampling."""


def _apparent_transmissibility(
    model: Model, path: pd.DataFrame, settings: PathSettings
) -> pd.DataFrame:
    step = float(path["time"].iloc[1] - path["time"].iloc[0])
    period = 2.0 * math.pi / model.omega
    length = min(round(settings.segment_periods * period / step), len(path))
    acceleration = model.damping_rate * path["velocity"] + model.omega**2 * (
        path["displacement"] - model.rest
    )
    frequency, density = welch(acceleration.to_numpy(), 1.0 / step, length)
    base = input_density(model, frequency)
    highest = settings.synthesised_share / (2.0 * step)
    seen = (frequency > 0.0) & (frequency < highest) & (base > 0.0)
    seen &= frequency >= frequencies(model)[0]
    if model.whites:  # the kicks of a step shake at all of the frequencies that it folds to one
        folded = transmissibility(model, np.abs(1.0 / step - frequency))
        seen &= folded < MOST_FOLDED * transmissibility(model, frequency)
    return pd.DataFrame(
        {
            "frequency_hz": frequency[seen],
            "transmissibility": np.sqrt(density[seen] / base[seen]),
        }
    )


FEWEST_IN_BAND = 4
"""Number of frequencies that a band must hold to be compared."""


def _largest_change(model: Model, apparent: pd.DataFrame | None) -> float | None:
    """Largest relative difference of bands from the transmissibility without stops."""
    if apparent is None or not len(apparent):
        return None
    frequency = apparent["frequency_hz"].to_numpy()
    power = apparent["transmissibility"].to_numpy() ** 2
    known = transmissibility(model, frequency) ** 2
    band = np.floor(3.0 * np.log2(frequency) + ROUNDING).astype(int)
    changes = [
        math.sqrt(float(power[band == each].sum() / known[band == each].sum())) - 1.0
        for each in np.unique(band)
        if np.count_nonzero(band == each) >= FEWEST_IN_BAND
    ]
    return max(map(abs, changes), default=None)
