"""What linearisation is judged by: closed forms where no stop loses energy, else the solver.

Units: omega = 1 1/s, and a deviation of 1 m without stops, so that b = 2 zeta and S0 = 4 zeta.
"""

import csv
import math
from itertools import product
from pathlib import Path

import numpy as np

import stochvi as sv

RTOL = 1e-3
"""Asked of the solver, in both deviations, F1 and F2."""

TWO_SIDED = (0.2, 0.3, 0.45, 0.7, 1.0, 1.4, 2.0, 2.8, 3.8, 5.0)
ONE_SIDED = (-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.8, 3.8, 5.0)
RESTITUTION = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 0.9, 0.95, 1.0)
ZETA = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)

PLACE = ("lower", "upper", "restitution_lower", "restitution_upper", "zeta")
FOUND = (
    "mean", "sigma_x", "sigma_v", "upcrossing", "rate_lower", "rate_upper", "f1_lower", "f1_upper",
    "f2_lower", "f2_upper", "rate_bound", "bound",
)  # fmt: skip
"""The last two: the largest relative bound on the errors of the rates, and of the others."""

HELD_OUT, TRAINING = 1200, 1200
NARROWEST = 0.4
"""Of a scene with two stops, from one to the other."""

Place = tuple[float, float, float, float, float]


def grid() -> list[Place]:
    """Symmetric gaps, then an upper stop alone."""
    two = [(-g, g, r, r, z) for g, r, z in product(TWO_SIDED, RESTITUTION, ZETA)]
    return two + [(-math.inf, g, 1.0, r, z) for g, r, z in product(ONE_SIDED, RESTITUTION, ZETA)]


def symmetric_or_single(count: int, seed: int) -> list[Place]:
    """Random scenes of the two kinds that the grid has."""
    rng = np.random.default_rng(seed)
    found: list[Place] = []
    for k in range(count):
        r, z = rng.uniform(), math.exp(rng.uniform(math.log(ZETA[0]), math.log(ZETA[-1])))
        if k % 2:
            found.append((-math.inf, rng.uniform(ONE_SIDED[0], ONE_SIDED[-1]), 1.0, r, z))
        else:
            gap = math.exp(rng.uniform(math.log(TWO_SIDED[0]), math.log(TWO_SIDED[-1])))
            found.append((-gap, gap, r, r, z))
    return found


def asymmetric(count: int, seed: int) -> list[Place]:
    """Random scenes of two unlike stops: at different places, of different laws, or preloaded."""
    rng = np.random.default_rng(seed)
    found: list[Place] = []
    while len(found) < count:
        r, other = rng.uniform(size=2)
        z = math.exp(rng.uniform(math.log(ZETA[0]), math.log(ZETA[-1])))
        if rng.uniform() < 0.6:
            a, c = np.exp(rng.uniform(math.log(TWO_SIDED[0]), math.log(TWO_SIDED[-1]), 2))
        else:
            a, c = rng.uniform(ONE_SIDED[0], ONE_SIDED[-1], 2)
        if rng.uniform() < 0.3:
            other = r
        elif rng.uniform() < 0.2:
            other = 1.0
        if a + c >= NARROWEST:
            found.append((-a, c, r, other, z))
    return found


def scene_of(place: Place) -> sv.Scene:
    """The scene of a row."""
    lower, upper, r_lower, r_upper, zeta = place
    stops = sv.ImpactPair(
        lower=None if math.isinf(lower) else lower,
        upper=upper,
        law=sv.Restitution(coefficient=r_upper),
        lower_law=None if math.isinf(lower) else sv.Restitution(coefficient=r_lower),
    )
    return sv.Scene(
        structure=sv.Oscillator(mass=1.0, damping=2.0 * zeta, stiffness=1.0),
        impact_pairs=[stops],
        excitations=[sv.WhiteNoise(intensity=4.0 * zeta)],
    )


def truth_of(place: Place) -> list[float | str]:
    """The columns FOUND; a rate without a limit is empty."""
    scene = scene_of(place)
    sides = ["upper"] if math.isinf(place[0]) else ["lower", "upper"]
    if place[2] == place[3] == 1.0:
        density, response = None, sv.exact(scene)
        stops = dict(zip(sides, _exact_stops(response, place), strict=True))
    else:
        density = sv.fokker_planck_density(scene, rtol=RTOL)
        response = density.response
        stops = {side: _solved_stop(density, side) for side in sides}
    x = {name: found for name, found in response.coordinates["x"].items() if found is not None}
    pair = response.impact_pairs["stops"]
    bounds = [
        found.bias / found.value
        for name in ("displacement_std", "velocity_std")
        for found in (x[name],)
    ]
    bounds += [pair[f"impact_speed_{n}rate"].bias / pair[f"impact_speed_{n}rate"].value
               for n in ("", "square_")]  # fmt: skip
    none = (0.0, 0.0, 0.0, 0.0)
    rows = [stops.get(side, none) for side in ("lower", "upper")]
    names = ("displacement_mean", "displacement_std", "velocity_std", "upcrossing_rate")
    numbers = [x[name].value for name in names]
    numbers += [rows[side][k] for k in range(3) for side in (0, 1)]
    numbers += [max(row[3] for row in rows), max(bounds)]
    return ["" if math.isnan(number) else f"{number:.7g}" for number in numbers]


def _solved_stop(density: sv.StationaryDensity, side: str) -> tuple[float, float, float, float]:
    """Rate of all impacts, F1, F2, and the relative bound of the rate."""
    w = np.geomspace(1e-7, 12.0, 6001)
    flux = w * density.impact_flux(side, w)
    f1, f2 = (float(np.trapezoid(flux * w**k, np.log(w))) for k in (1, 2))
    rate = density.limit_rate(side)
    if rate is None:
        return math.nan, f1, f2, math.nan
    return rate.value, f1, f2, rate.bias / rate.value if rate.value else 0.0


def _exact_stops(response: sv.Response, place: Place) -> list[tuple[float, float, float, float]]:
    pair = response.impact_pairs["stops"]
    sides = ["upper"] if math.isinf(place[0]) else ["lower", "upper"]
    rates = [pair[f"collision_rate_{side}"].value for side in sides]
    speed = response.coordinates["x"]["velocity_std"].value
    return [(n, n * speed * math.sqrt(math.pi / 2.0), n * 2.0 * speed**2, 0.0) for n in rates]


def compute(places: list[Place], path: Path) -> None:
    """Row by row into a file; rows that are there are not computed again."""
    done = set()
    if path.exists():
        done = {
            tuple(map(float, row[:5])) for row in list(csv.reader(path.open(encoding="utf-8")))[1:]
        }
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not done:
            writer.writerow([*PLACE, *FOUND])
        for place in places:
            key = tuple(float(f"{number:.7g}") for number in place)
            if key not in done:
                try:
                    found = truth_of(key)
                except sv.NotConverged as reason:
                    print(f"{key}: {reason}", flush=True)
                    continue
                writer.writerow([*(f"{number:.7g}" for number in key), *found])
                file.flush()


if __name__ == "__main__":
    here = Path(__file__).parent
    shipped = here.parents[1] / "data" / "linearisation_atlas"
    compute(grid(), shipped / "truth.csv")
    compute(symmetric_or_single(HELD_OUT, 1), here / "held_out.csv")
    compute(asymmetric(TRAINING, 2), here / "training.csv")
    compute(asymmetric(HELD_OUT, 3), here / "held_out_asymmetric.csv")
