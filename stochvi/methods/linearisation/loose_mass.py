"""One mode with a loose mass in a box: the box linearised at every amplitude, averaged over them.

A spring cannot stand for the box of a loose mass. The mass would have a frequency of its own, and
be at rest where no noise reaches that; a real one moves from stop to stop in step with the
structure. Here the structure swings with a slowly varying amplitude A at its own frequency w, as a
lightly damped mode does. A table holds the motion of a mass in a box that moves as A cos w t. It is
a function of play / A and R alone. Its impacts take the power P(A), which is the linearised damper
beta = 2 P / (w A)^2 of that amplitude; with E = w^2 A^2 / 2, b = c / m and D = S / m^2 the averaged
energy has the density

    p(E) = C exp(-(2 / D) int (b + P / E) dE),

and every mean square is the average over it. Its error is known from an atlas of simulations.
"""

from __future__ import annotations

import csv
import math
import time
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector
from stochvi.model.build_response import build_response, residuals
from stochvi.model.model import Model, Pair
from stochvi.results.base import CoordinateResponse, PairResponse, Response
from stochvi.results.estimates import Cost, Estimate
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.scene import Scene

TABLE = "shaken_box.csv"
ATLAS = "atlas.csv"

RANGES = {"mass_ratio": (0.005, 0.2), "play_in_sigma": (0.5, 12.0), "zeta": (0.005, 0.05)}
"""Ranges that the atlas of simulations covers: ratio of the masses, play over the rms displacement
without absorber, and damping ratio of the structure."""

LARGEST_RESTITUTION = 0.98
"""Largest restitution of the table: near 1 a mass in a moving box gains speed for ever longer."""

NEIGHBOURS = 10
"""Number of scenes of the atlas, nearest in gain and play, whose largest error is taken for the
error of a scene."""

AMPLITUDES = 1200
SMALLEST, LARGEST = 0.003, 6.0
"""Smallest and largest of the amplitudes that are averaged, in rms displacements without absorber.
Without a box a share exp(-18) of the amplitudes lies above the largest one, with a box less."""

NO_RATES = (
    "rates and the mean speed of impacts are not known where a box is linearised at every "
    "amplitude: simulate this scene for them"
)

NOT_IN_ATLAS = (
    "the error of the closure is not known here: its atlas holds one mode under a white force with "
    "one loose mass of 0.5 to 20 %, play 0.5 to 12 rms displacements, R up to 0.98, zeta 0.005 to "
    "0.05"
)


@dataclass(frozen=True, kw_only=True)
class AbsorberModel:
    """A structure of one mode, kg, N s/m, N/m, N^2 s, and the box on it."""

    carrier: str
    loose: str
    mass: float
    damping: float
    stiffness: float
    intensity: float
    loose_mass: float
    pair: Pair
    play: float
    restitution: float

    @property
    def omega(self) -> float:
        """Natural frequency of the structure, rad/s."""
        return math.sqrt(self.stiffness / self.mass)

    @property
    def sigma(self) -> float:
        """rms displacement without the absorber, m."""
        return math.sqrt(self.intensity / (2.0 * self.damping * self.stiffness))

    @property
    def place(self) -> dict[str, float]:
        """Coordinates of the scene in the atlas."""
        return {
            "mass_ratio": self.loose_mass / self.mass,
            "play_in_sigma": self.play / self.sigma,
            "zeta": self.damping / (2.0 * self.mass * self.omega),
        }


def box_of(model: Model) -> AbsorberModel | None:
    """The box of a scene that the atlas covers; None for any other scene."""
    if len(model.coordinates) != 2 or len(model.pairs) != 1:
        return None
    (pair,) = model.pairs
    restitution = pair.stops[0].coefficient
    if pair.play is None or restitution is None or pair.stops[1].coefficient != restitution:
        return None
    if model.signals or model.tables or np.any(model.constant_force):
        return None
    for carrier, loose in ((0, 1), (1, 0)):
        apart = [
            (matrix[carrier, loose], matrix[loose, loose])
            for matrix in (model.damping, model.stiffness, model.white)
        ]
        held = min(
            matrix[carrier, carrier] for matrix in (model.damping, model.stiffness, model.white)
        )
        if np.any(apart) or model.mass[carrier, loose] or held <= 0.0:
            continue
        box = AbsorberModel(
            carrier=model.coordinates[carrier],
            loose=model.coordinates[loose],
            mass=float(model.mass[carrier, carrier]),
            damping=float(model.damping[carrier, carrier]),
            stiffness=float(model.stiffness[carrier, carrier]),
            intensity=float(model.white[carrier, carrier]),
            loose_mass=float(model.mass[loose, loose]),
            pair=pair,
            play=pair.play,
            restitution=restitution,
        )
        place = box.place
        inside = all(low <= place[name] <= high for name, (low, high) in RANGES.items())
        return box if inside and pair.relative and restitution <= LARGEST_RESTITUTION else None
    return None


def moments(box: AbsorberModel) -> dict[str, float]:
    """Mean squares and rates of impact speeds, averaged over the amplitudes, SI units."""
    a = box.sigma * np.geomspace(SMALLEST, LARGEST, AMPLITUDES)
    omega, table = box.omega, shaken_box(box.restitution, box.play / a)
    energy = (omega * a) ** 2 / 2.0
    f2 = omega**3 * a**2 * table["speed_square_rate"]
    power = box.pair.mass / box.mass * (1.0 - box.restitution**2) / 2.0 * f2
    diffusion = box.intensity / box.mass**2
    fall = 2.0 / diffusion * (box.damping / box.mass + power / energy)
    density = np.exp(-scipy.integrate.cumulative_trapezoid(fall, energy, initial=0))
    total = float(scipy.integrate.trapezoid(density, energy))

    def mean(values: Vector) -> float:
        return float(scipy.integrate.trapezoid(values * density, energy)) / total

    return {
        "velocity": mean(energy),
        "displacement": mean(energy) / omega**2,
        "loose_velocity": mean((omega * a) ** 2 * table["velocity_square"]),
        "loose_displacement": mean(a**2 * table["displacement_square"]),
        "relative_velocity": mean((omega * a) ** 2 * table["relative_velocity_square"]),
        "relative_displacement": mean(a**2 * table["relative_displacement_square"]),
        "f1": mean(omega**2 * a * table["speed_rate"]),
        "f2": mean(f2),
    }


def shaken_box(restitution: float, plays: Vector) -> dict[str, Vector]:
    """Response of a loose mass in a box that moves as cos t, for plays in amplitudes of the box.

    The response follows powers of the play between the plays of the table and below them. Above the
    last play its values are kept, since amplitudes that small matter little.
    """
    names, tables, widest = _table()
    places = np.column_stack([np.full(len(plays), restitution), np.log(np.minimum(plays, widest))])
    return {name: np.exp(table(places)) for name, table in zip(names, tables, strict=True)}


@cache
def _table() -> tuple[list[str], list[scipy.interpolate.RegularGridInterpolator], float]:
    rows = _rows(TABLE)
    laws, plays = (sorted({float(row[key]) for row in rows}) for key in ("restitution", "play"))
    names = list(rows[0])[2:]
    shape = len(laws), len(plays)
    tables = [
        scipy.interpolate.RegularGridInterpolator(
            (laws, np.log(plays)),
            np.log([float(row[name]) for row in rows]).reshape(shape),
            bounds_error=False,
            fill_value=None,
        )
        for name in names
    ]
    return names, tables, plays[-1]


def _rows(name: str) -> list[dict[str, str]]:
    with (data_folder() / "absorber_box" / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def gain(box: AbsorberModel, velocity: float) -> float:
    """Logarithm of the ratio of rms velocities without and with the absorber."""
    return math.log(box.omega * box.sigma / math.sqrt(velocity))


def errors(box: AbsorberModel, velocity: float) -> dict[str, float]:
    """Largest relative error of each quantity among the nearest scenes of the atlas."""
    rows = [row for row in _rows(ATLAS) if row["part"] == "atlas"]
    here = _feature(gain(box, velocity), box.place["play_in_sigma"])
    away = [
        math.dist(here, _feature(float(row["gain"]), float(row["play_in_sigma"]))) for row in rows
    ]
    nearest = [rows[k] for k in np.argsort(away)[:NEIGHBOURS]]
    names = [name for name in rows[0] if name.endswith("_off")]
    return {name.removesuffix("_off"): max(float(row[name]) for row in nearest) for name in names}


def _feature(gain_: float, play_in_sigma: float) -> tuple[float, float]:
    return math.log(max(gain_, 1e-3)), math.log(play_in_sigma)


def response(scene: Scene, model: Model, box: AbsorberModel, method: str) -> Response:
    """The averaged response of a scene, with the errors that the atlas knows."""
    started = time.perf_counter()
    found = moments(box)
    bounds = errors(box, found["velocity"])

    def estimate(value: float, quantity: str) -> Estimate:
        bound = bounds.get(quantity)
        how = "amplitude averaging of a linearised box; largest error of near scenes in an atlas"
        return Estimate(value=value, bias=None if bound is None else value * bound, how=how)

    def coordinate(displacement: str, velocity: str) -> CoordinateResponse:
        x = estimate(math.sqrt(found[displacement]), displacement)
        v = estimate(math.sqrt(found[velocity]), velocity)
        return CoordinateResponse(
            displacement_mean=Estimate(value=0.0, bias=0.0, how="by symmetry"),
            displacement_std=x,
            displacement_mean_square=_squared(x),
            velocity_std=v,
            velocity_mean_square=_squared(v),
        )

    coordinates = {
        name: coordinate("displacement", "velocity")
        if name == box.carrier
        else coordinate("loose_displacement", "loose_velocity")
        for name in model.coordinates
    }
    pair = PairResponse(
        impact_speed_rate=estimate(found["f1"], "f1"),
        impact_speed_square_rate=estimate(found["f2"], "f2"),
        relative_displacement_mean=Estimate(value=0.0, bias=0.0, how="by symmetry"),
        relative_displacement_std=estimate(
            math.sqrt(found["relative_displacement"]), "relative_displacement"
        ),
        relative_velocity_std=estimate(math.sqrt(found["relative_velocity"]), "relative_velocity"),
    )
    balances = residuals(model, _balance(box, found), [0.0, 0.0])
    return build_response(
        scene,
        method,
        coordinates=coordinates,
        impact_pairs={box.pair.name: pair},
        assumptions=[
            "the structure swings at its own frequency with an amplitude that varies slowly; the "
            "loose mass does at every amplitude what it does in a box that moves as a sine",
        ],
        cost=Cost(wall_time=time.perf_counter() - started),
        warnings=[NO_RATES],
        identities={
            name: Estimate(value=float(value), how="amplitude averaging")
            for name, value in balances.items()
        },
    )


def _squared(root: Estimate) -> Estimate:
    """Square of an estimate; its relative error is that of (1 + e)^2."""
    bias = None if root.bias is None else root.bias * (2.0 * root.value + root.bias)
    return Estimate(value=root.value**2, bias=bias, how=root.how)


def _balance(box: AbsorberModel, found: dict[str, float]) -> dict[tuple[str, str], float]:
    """Moments from which the balances of energy, virial and force are calculated."""
    name, half = box.pair.name, 0.5
    known = {
        ("", "kinetic"): box.mass * found["velocity"] + box.loose_mass * found["loose_velocity"],
        ("", "potential"): box.stiffness * found["displacement"],
        ("", "dissipation"): box.damping * found["velocity"],
    }
    for owner, x, v in (
        (box.carrier, "displacement", "velocity"),
        (box.loose, "loose_displacement", "loose_velocity"),
    ):
        known |= {(owner, "x"): 0.0, (owner, "variance"): found[x], (owner, "vv"): found[v]}
    for side in ("lower", "upper"):
        known |= {
            (name, f"f1_{side}"): half * found["f1"],
            (name, f"f2_{side}"): half * found["f2"],
        }
    return known
