"""Pictures of a stationary density: its plane of x and v, impact speeds, marginals.

Every function draws on the Axes it is given (or on new ones) and returns them. A density is what
`exact_density` or `fokker_planck_density` return.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import corner_exponent
from stochvi.mathematics.shown_units import RATE, SPEED
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.scenes.impact_laws import Restitution
from stochvi.views.axes import axes_or_new, draw_stops, length_unit
from stochvi.views.colours import BAND_ALPHA, COLOURS

if TYPE_CHECKING:
    from stochvi.scenes.scene import Scene


REACH = 3.5
"""Standard deviations of x and v that a picture shows, where no stop ends it before."""

DECADES = 4.0
"""Number of decades of the density that the picture of its plane spans."""

PLANE_POINTS, CURVE_POINTS = 241, 401
"""Number of points along each side of a plane, and along a curve: odd, so that v = 0 is a point."""

SLIT = 0.04
"""Half the height of the slit in a stop at v = 0, relative to the height of the picture."""

MARGIN = 1.4
"""Factor by which the line that shows an exponent lies above the curve."""

SIZE = (6.4, 4.6)
"""Size of a figure of one picture, inches."""

SLOWEST, FASTEST = 1e-3, 5.0
"""Smallest and largest impact speed shown, in rms velocities."""


class Density(Protocol):
    """A stationary density that can be drawn."""

    @property
    def response(self) -> Response:
        """The stationary averages."""

    def density(self, x: ArrayLike, v: ArrayLike) -> Vector:
        """Joint density of displacement and velocity, s/m^2."""

    def displacement_density(self, x: ArrayLike) -> Vector:
        """Density of the displacement, 1/m."""

    def velocity_density(self, v: ArrayLike) -> Vector:
        """Density of the velocity, s/m."""

    def impact_flux(self, side: str, w: ArrayLike) -> Vector:
        """Impacts per second and unit of incident speed."""


def plot_plane(scene: Scene, found: Density, ax: Axes | None = None) -> Axes:
    """Density in the plane of displacement and velocity, logarithmic, with the stops.

    Stops are grey bands. At an inelastic rigid stop the density is infinite at v = 0, seen as a
    slit: a mass that comes at v > 0 leaves at -R v, nearer to 0."""
    ax = axes_or_new(ax, SIZE)
    (x, v), (unit, name) = _range(scene, found), _unit(scene, found)
    p = found.density(x[None, :], v[:, None]) * unit * SPEED.shown.si
    finite = p[np.isfinite(p) & (p > 0.0)]
    top = float(np.quantile(finite, 0.999))
    shown = np.where(np.isfinite(p), np.clip(p, top * 10.0**-DECADES, top), top)
    mesh = ax.pcolormesh(
        x / unit, SPEED(v), shown, shading="gouraud", cmap="viridis",
        norm=LogNorm(top * 10.0**-DECADES, top), rasterized=True,
    )  # fmt: skip
    ax.figure.colorbar(mesh, ax=ax, label=f"probability density (1/({name} {SPEED}))")
    draw_stops(ax, scene, unit, vertical=True)
    rigid = [stop for side, stop in _stops(scene) if scene.impact_pairs[0].law_of(side).rigid]
    for stop in rigid:
        for low, high in ((0.0, 0.5 - SLIT), (0.5 + SLIT, 1.0)):
            ax.axvline(stop / unit, low, high, color="black", linewidth=2.0)
    ax.set_ylim(-SPEED(v[-1]), SPEED(v[-1]))
    ax.set_xlabel(f"displacement ({name})")
    ax.set_ylabel(f"velocity ({SPEED})")
    return ax


def plot_impact_speeds(scene: Scene, found: Density, ax: Axes | None = None) -> Axes:
    """Impacts per second and unit of speed on each stop, log-log, with the exponent of the corner.

    Towards w = 0 the density of impact speeds goes as w^(1 - beta), with beta from
    `impact_rates.corner_exponent`: a dotted line at each rigid stop of a fixed restitution.
    """
    ax = axes_or_new(ax, SIZE)
    rms = _value(found, "velocity_std")
    w = rms * np.geomspace(SLOWEST, FASTEST, CURVE_POINTS)
    colours = {"lower": COLOURS["linearise:closure"], "upper": COLOURS["fokker-planck"]}
    largest = 0.0
    for side, _ in _stops(scene):
        flux = RATE(found.impact_flux(side, w)) * SPEED.shown.si
        largest = max(largest, float(np.nanmax(flux)))
        style = {"color": colours[side], "linestyle": "-" if side == "lower" else "--"}
        ax.plot(SPEED(w), np.where(flux > 0.0, flux, np.nan), label=f"{side} stop", **style)  # type: ignore[arg-type]
        law = scene.impact_pairs[0].law_of(side)
        if isinstance(law, Restitution):
            beta = corner_exponent(law.slow_restitution)
            start, anchor = w[: CURVE_POINTS // 2], CURVE_POINTS // 4
            line = MARGIN * flux[anchor] * (start / w[anchor]) ** (1.0 - beta)
            text = f"w^(1 - β), β = {beta:.3g} (R = {law.coefficient})"
            ax.plot(SPEED(start), line, ":", color=colours[side], label=text)
    ax.set(xscale="log", yscale="log", ylim=(1e-6 * largest, 3.0 * largest))
    ax.set_xlabel(f"impact speed ({SPEED})")
    chosen = RATE.chosen or SPEED.chosen
    unit = f"{RATE} per {SPEED}" if chosen else "1/m"
    ax.set_ylabel(f"impacts per {RATE.time} and unit of speed ({unit})")
    ax.legend(frameon=False)
    return ax


def plot_marginals(
    scene: Scene, found: Density, axes: tuple[Axes, Axes] | None = None
) -> tuple[Axes, Axes]:
    """Densities of displacement and velocity, each with the normal distribution of the same rms."""
    if axes is None:
        _, pair = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
        axes = (pair[0], pair[1])
    (x, v), (unit, name) = _range(scene, found), _unit(scene, found)
    mean = _value(found, "displacement_mean")
    curves = (
        (axes[0], x / unit, found.displacement_density(x) * unit,
         _normal((x - mean) / unit, _value(found, "displacement_std") / unit)),
        (axes[1], SPEED(v), found.velocity_density(v) * SPEED.shown.si,
         _normal(SPEED(v), SPEED(_value(found, "velocity_std")))),
    )  # fmt: skip
    for ax, place, density, normal in curves:
        ax.plot(place, density, color=COLOURS["exact"], label="density")
        ax.plot(place, normal, "--", color=COLOURS["stop"], label="normal, same rms")
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel("probability density")
    if hasattr(found, "bands"):  # an averaged density is approximate
        low, high = found.bands(x)
        axes[0].fill_between(
            x / unit, low * unit, high * unit, color=COLOURS["exact"], alpha=BAND_ALPHA,
            linewidth=0, label="where the true one lies",
        )  # fmt: skip
        axes[0].legend(frameon=False, loc="lower center")
    draw_stops(axes[0], scene, unit, vertical=True)
    axes[0].set_xlabel(f"displacement ({name})")
    axes[1].set_xlabel(f"velocity ({SPEED})")
    axes[1].legend(frameon=False)
    return axes


def draw_density(scene: Scene, found: Density) -> Axes:
    """The plane, the marginals and, where there are stops, the impact speeds in one figure."""
    stops = bool(scene.impact_pairs)
    figure, panels = plt.subplots(
        2, 2, figsize=(10.0, 7.6), layout="constrained", gridspec_kw={"height_ratios": (1.25, 1.0)}
    )
    plot_plane(scene, found, panels[0, 0])
    if stops:
        plot_impact_speeds(scene, found, panels[0, 1])
    else:
        panels[0, 1].set_axis_off()
    plot_marginals(scene, found, (panels[1, 0], panels[1, 1]))
    figure.suptitle(scene.title)
    plane: Axes = panels[0, 0]
    return plane


def _stops(scene: Scene) -> list[tuple[str, float]]:
    """(side, position) of each stop; pictures are of scenes with at most one pair."""
    return [
        (side, float(getattr(pair, side)))
        for pair in scene.impact_pairs
        for side, _ in pair.stops()
    ]


def _value(found: Density, quantity: str) -> float:
    (coordinate,) = found.response.coordinates.values()
    estimate = coordinate[quantity]
    assert isinstance(estimate, Estimate)
    return estimate.value


def _range(scene: Scene, found: Density) -> tuple[Vector, Vector]:
    """Displacements and velocities that a picture shows; it ends at rigid stops."""
    mean, deviation = _value(found, "displacement_mean"), _value(found, "displacement_std")
    low, high = mean - REACH * deviation, mean + REACH * deviation
    for side, law in (stop for pair in scene.impact_pairs for stop in pair.stops()):
        position = dict(_stops(scene))[side]
        if law.rigid:
            low, high = (
                (max(low, position), high) if side == "lower" else (low, min(high, position))
            )
    fast = REACH * _value(found, "velocity_std")
    return np.linspace(low, high, PLANE_POINTS), np.linspace(-fast, fast, PLANE_POINTS)


def _unit(scene: Scene, found: Density) -> tuple[float, str]:
    x, _ = _range(scene, found)
    return length_unit(float(np.abs(x).max()))


def _normal(x: Vector, deviation: float) -> Vector:
    shape = np.exp(-0.5 * (x / deviation) ** 2)
    return np.asarray(shape / deviation / math.sqrt(2.0 * math.pi))
