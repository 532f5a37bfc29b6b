"""What averaging makes of the density of the displacement: the atlas of its errors, and whether the
bands that are read from it hold the density of the Fokker-Planck equation."""

import argparse
import csv
from itertools import product
from pathlib import Path

import numpy as np
from truth import RTOL, Place, scene_of, symmetric_or_single

from stochvi.methods.averaging import average_density
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.model.build_response import DENSITY_LEVELS
from stochvi.scenes.datasets import data_folder

GAPS = {
    "two": (0.2, 0.45, 1.0, 1.4, 2.0, 2.8, 5.0),
    "one": (-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.8, 5.0),
}
RESTITUTION = (0.0, 0.2, 0.5, 0.8, 1.0)
ZETA = (0.005, 0.02, 0.1, 0.5)
LEVELS = np.array(DENSITY_LEVELS)
HELD_OUT, SEED = 120, 5


def nodes() -> list[tuple[str, float, float, float]]:
    """Kind of stops, gap, restitution, zeta."""
    stops = [(kind, gap) for kind, gaps in GAPS.items() for gap in gaps]
    return [(*each, r, z) for each, r, z in product(stops, RESTITUTION, ZETA)]


def place_of(kind: str, gap: float, restitution: float, zeta: float) -> Place:
    """The place of a node, as the truth has it."""
    lower = -gap if kind == "two" else -np.inf
    return lower, gap, restitution if kind == "two" else 1.0, restitution, zeta


def errors_of(place: Place) -> np.ndarray:
    """ln(averaged density / true density) at the displacements of the levels."""
    if place[3] == 1.0:
        return np.zeros(len(LEVELS))
    scene = scene_of(place)
    averaged, true = average_density(scene), fokker_planck_density(scene, rtol=RTOL)
    x = averaged.quantiles(LEVELS)
    return np.log(averaged.displacement_density(x) / true.displacement_density(x))


def write_atlas(path: Path) -> None:
    """Node by node into a file; rows that are there are not computed again."""
    done = set()
    if path.exists():
        done = {tuple(row[:4]) for row in csv.reader(path.open(encoding="utf-8"))}
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not done:
            writer.writerow(["stops", "gap", "restitution", "zeta", *DENSITY_LEVELS])
        for node in nodes():
            if tuple(map(str, node)) not in done:
                found = errors_of(place_of(*node))
                writer.writerow([*node, *(f"{each:.4g}" for each in found)])
                file.flush()


def held(places: list[Place]) -> tuple[int, int, np.ndarray]:
    """Bands of scenes off the nodes: how many there are, how many hold the true density, and the
    median and the ninth decile of the upper limit over the density, less 1."""
    hold, widths = [], []
    for place in places:
        scene = scene_of(place)
        averaged, true = average_density(scene), fokker_planck_density(scene, rtol=RTOL)
        x = averaged.quantiles(np.linspace(0.01, 0.99, 25))
        low, high = averaged.bands(x)
        exact = true.displacement_density(x)
        hold += ((low <= exact) & (exact <= high)).tolist()
        widths += (high / averaged.displacement_density(x)).tolist()
    return len(hold), sum(hold), np.quantile(widths, [0.5, 0.9]) - 1.0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--atlas", action="store_true", help="renew the shipped errors")
    parser.add_argument("--quick", action="store_true", help="every 20th scene")
    options = parser.parse_args()
    if options.atlas:
        write_atlas(data_folder() / "linearisation_atlas" / "average-density.csv")
    scenes = symmetric_or_single(HELD_OUT, SEED)[:: 20 if options.quick else 1]
    bands, hold, width = held(scenes)
    print(
        f"{len(scenes)} scenes: {hold} of {bands} bands hold ({100.0 * hold / bands:.2f} %); "
        f"half of them reach {width[0]:.2%} above the density at most, nine of ten {width[1]:.2%}"
    )
