"""An overview of one oscillator: densities of its motion and a short record with impacts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stochvi.methods.closed_form import displacement_density, exact, unmet
from stochvi.methods.monte_carlo import record_path
from stochvi.model.model import model_of
from stochvi.scenes.scene import Scene
from stochvi.statistics.histograms import SampledDensity


@dataclass(frozen=True, kw_only=True)
class OverviewSettings:
    """How long the paths are, and how finely their densities are shown.

    Parameters
    ----------
    density_periods
        Natural periods of the path behind the histograms: smooth for a damping ratio of 1 %.
    searched_periods
        Natural periods that are searched for an impact to show.
    record_periods
        Natural periods of the record that is shown.
    steps_per_period
        Samples of that record in a natural period.
    settling_share
        Share of the searched path that is left out at its start, where it is not stationary.
    displacement_bins, velocity_bins
        Numbers of bins of the histograms.
    velocity_reach
        Half width of the histogram of the velocity, in rms velocities.
    curve_points
        Points of the exact density of the displacement.
    """

    density_periods: float = 60_000.0
    searched_periods: float = 400.0
    record_periods: float = 25.0
    steps_per_period: float = 80.0
    settling_share: float = 0.1
    displacement_bins: int = 60
    velocity_bins: int = 70
    velocity_reach: float = 4.2
    curve_points: int = 801


DEFAULTS = OverviewSettings()


@dataclass(frozen=True, kw_only=True)
class Overview:
    """The numbers that a picture of an oscillator between its stops shows (SI units).

    Parameters
    ----------
    scene
        The scene that was simulated.
    displacement, velocity
        Histograms of a long path.
    velocity_rms
        Rms velocity of that path about 0.
    exact_displacement
        The exact density of the displacement: columns `displacement` and `density`. None where no
        exact answer is known.
    exact_velocity_std
        The exact standard deviation of the velocity, whose law is then normal; None as above.
    mean_without_stops, std_without_stops
        Mean and standard deviation of the displacement without stops, whose law is normal; the
        standard deviation is None where no exact answer without stops is known.
    record
        A short record, as from `record_path`, that begins shortly before an impact if there is one.
    """

    scene: Scene
    displacement: SampledDensity
    velocity: SampledDensity
    velocity_rms: float
    exact_displacement: pd.DataFrame | None
    exact_velocity_std: float | None
    mean_without_stops: float
    std_without_stops: float | None
    record: pd.DataFrame


def overview(scene: Scene, settings: OverviewSettings = DEFAULTS) -> Overview:
    """Simulate what a picture of one oscillator shows, beside its exact densities.

    Parameters
    ----------
    scene
        One oscillator with a positive natural frequency.
    settings
        Lengths of the paths and numbers of bins.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> found = overview(scene, OverviewSettings(density_periods=50.0, searched_periods=50.0))
    >>> round(found.std_without_stops, 6), round(found.exact_velocity_std, 6)
    (1.0, 1.0)
    """
    model = model_of(scene)
    period = 2.0 * math.pi / model.omega
    path = record_path(scene, duration=settings.density_periods * period, seed=1)
    x, v = path["displacement"].to_numpy(), path["velocity"].to_numpy()
    rms = float(np.sqrt(np.mean(v**2)))
    without_stops = scene.model_copy(update={"impact_pairs": ()})
    density, velocity_std = None, None
    if not unmet(model_of(scene)):
        grid = np.linspace(x.min(), x.max(), settings.curve_points)
        values = displacement_density(scene, grid)
        density = pd.DataFrame({"displacement": grid, "density": values})
        velocity_std = exact(scene).estimates()["x", "velocity_std"].value
    linear = None
    if not unmet(model_of(without_stops)):
        linear = exact(without_stops).estimates()["x", "displacement_std"].value
    reach = settings.velocity_reach * rms
    return Overview(
        scene=scene,
        displacement=SampledDensity.of(x, settings.displacement_bins, x.min(), x.max()),
        velocity=SampledDensity.of(v, settings.velocity_bins, -reach, reach),
        velocity_rms=rms,
        exact_displacement=density,
        exact_velocity_std=velocity_std,
        mean_without_stops=model.rest,
        std_without_stops=linear,
        record=_stretch_with_impacts(scene, period, settings),
    )


def _stretch_with_impacts(scene: Scene, period: float, settings: OverviewSettings) -> pd.DataFrame:
    """Some periods of a finely stepped record, from shortly before an impact if there is one."""
    searched = settings.searched_periods * period
    shown = settings.record_periods * period
    record = record_path(scene, duration=searched, seed=2, step=period / settings.steps_per_period)
    settled = record[record["time"] > settings.settling_share * searched]
    hits = settled.loc[settled["impact_speed"] != 0.0, "time"]
    last = settled["time"].iloc[-1] - shown
    start = min(hits.iloc[0] - 2.0 * period if len(hits) else settled["time"].iloc[0], last)
    short = settled[settled["time"].between(start, start + shown)]
    return short.assign(time=short["time"] - short["time"].iloc[0])
