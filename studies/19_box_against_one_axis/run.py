"""How often a box that is sized axis by axis, as one oscillator each, hits a stop at a corner."""

import argparse
import math
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import stochvi
from stochvi.views.files import write_picture

AXES = ("x", "y", "z")
PROFILES = ("longitudinal", "transverse", "vertical")
HOUR, RISK = 3600.0, 0.01
LAW = stochvi.Restitution(coefficient=0.5)
OFFSETS = (0.0, 0.05, 0.1, 0.2)
PLANES = {"centre": 0.0, "bottom": -0.5}
"""Height of the mounts over the centre of mass, in heights of the box."""

NOISE = [
    stochvi.TabulatedNoise(axis=axis, profile=f"mil-std-810h-truck-{name}-5hz")
    for axis, name in zip(AXES, PROFILES, strict=True)
]


def rice(sigma: float, speed: float, clearance: float) -> float:
    """Expected crossings of either stop in an hour."""
    rate = speed / sigma / math.pi * math.exp(-((clearance / sigma) ** 2) / 2.0)
    return HOUR * rate


def needed(sigma: float, speed: float) -> float:
    """Clearance that is crossed once in a hundred hours, m."""
    return sigma * math.sqrt(2.0 * math.log(HOUR * speed / sigma / math.pi / RISK))


def boxes_of(random: np.random.Generator, offset: float, plane: str):
    """A random box on four mounts, its centre of mass off the middle, with corner snubbers."""
    mass, sides = random.uniform(5.0, 40.0), random.uniform(0.2, 0.6, 3)
    stiffness = mass * (2.0 * math.pi * random.uniform(8.0, 20.0)) ** 2 / 4.0
    ratio, zeta = random.uniform(0.5, 1.0), random.uniform(0.05, 0.15)
    # a uniform box, about a centre of mass that components have moved
    inertia = mass * np.array([sides[1] ** 2 + sides[2] ** 2, sides[0] ** 2 + sides[2] ** 2,
                               sides[0] ** 2 + sides[1] ** 2]) / 12.0  # fmt: skip
    moved = offset * sides * random.choice([-1.0, 1.0], 3)
    height = PLANES[plane] * sides[2] - (moved[2] if PLANES[plane] else 0.0)
    springs = stiffness * np.array([ratio, ratio, 1.0])
    mounts = [
        {"at": [x * sides[0] - moved[0], y * sides[1] - moved[1], height],
         "stiffness": springs, "zeta": zeta}
        for x in (-0.5, 0.5) for y in (-0.5, 0.5)
    ]  # fmt: skip
    corners = [(2 * np.array(c) - 1) * sides / 2.0 - moved for c in np.ndindex(2, 2, 2)]
    pairs = [
        {"name": f"{axis} of corner {k}", "at": at, "direction": np.eye(3)[column],
         "clearance": 0.01, "law": LAW}
        for column, axis in enumerate(AXES) for k, at in enumerate(corners, start=1)
    ]  # fmt: skip
    box = stochvi.scenes.RigidBody(mass=mass, inertia=inertia, mount=mounts)
    whole = stochvi.Scene(structure=box, impact_pair=pairs, excitations=NOISE)
    singles = {
        axis: stochvi.Scene(
            structure=stochvi.Isolator(
                frequency_hz=math.sqrt(4.0 * k / mass) / (2.0 * math.pi), zeta=zeta
            ),
            excitations=[noise.model_copy(update={"axis": None})],
        )
        for axis, k, noise in zip(AXES, springs, NOISE, strict=True)
    }  # fmt: skip
    return whole, singles


def rows(random: np.random.Generator, number: int, offset: float, plane: str):
    """Each axis of a box: the clearance of one oscillator, and that of the worst corner."""
    whole, singles = boxes_of(random, offset, plane)
    gaps = stochvi.screen(whole).impact_pairs
    for axis, single in singles.items():
        alone = stochvi.screen(single)
        given = needed(alone.displacement_std, alone.velocity_std)
        motions = [(gap.displacement_std, gap.velocity_std)
                   for name, gap in gaps.items() if name.startswith(axis)]  # fmt: skip
        required = max(needed(*motion) for motion in motions)
        yield {
            "box": number, "offset": offset, "mounts": plane, "axis": axis,
            "one_axis_clearance_mm": 1e3 * given,
            "worst_corner_clearance_mm": 1e3 * required,
            "ratio": required / given,
            "crossings_per_hour_at_worst_corner": max(rice(*m, given) for m in motions),
        }  # fmt: skip


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--quick", action="store_true", help="few boxes")
parser.add_argument("--out", type=Path, default=Path(__file__).parent)
options = parser.parse_args()
started = time.process_time()
count = 4 if options.quick else 100
random = np.random.default_rng(19)
table = pd.DataFrame(
    [
        row
        for plane in PLANES for offset in OFFSETS for number in range(count)
        for row in rows(random, number, offset, plane)
    ]
)  # fmt: skip
table.round(6).to_csv(options.out / "result.csv", index=False)
box = table.groupby(["mounts", "offset", "box"])[
    ["ratio", "crossings_per_hour_at_worst_corner"]
].max()
summary = box.groupby(["mounts", "offset"]).agg(
    unsafe=("ratio", lambda r: (r > 1.01).mean()),
    median=("ratio", "median"),
    largest=("ratio", "max"),
    crossings=("crossings_per_hour_at_worst_corner", "median"),
)
print(summary.round(3).to_string())
by_axis = table.groupby(["mounts", "offset", "axis"])["ratio"].median().unstack()
print("median ratio of each axis", by_axis.round(2).to_string(), sep="\n")
figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2), sharey=True, layout="constrained")
for panel, plane in zip(panels, PLANES, strict=True):
    for column, axis in enumerate(AXES):
        own = table[(table["mounts"] == plane) & (table["axis"] == axis)]
        for place, offset in enumerate(OFFSETS):
            values = own.loc[own["offset"] == offset, "ratio"]
            spread = np.linspace(-0.08, 0.08, len(values))
            places = place + 0.25 * (column - 1) + spread
            label = axis if place == 0 else None
            panel.plot(places, values, ".", color=f"C{column}", markersize=3, label=label)
    panel.axhline(1.0, color="#8a8f98", linestyle="--")
    panel.set_xticks(range(len(OFFSETS)), [f"{100 * each:g} %" for each in OFFSETS])
    panel.set_title(f"mounts at the {plane}" + (" of mass" if plane == "centre" else " of the box"))
    panel.set_xlabel("offset of the centre of mass, of each side")
panels[0].set_ylabel("clearance of the worst corner\nover that of one oscillator")
panels[0].legend(frameon=False, title="axis")
write_picture(panels[0], options.out / "figure.png")
print(f"{time.process_time() - started:.0f} s")
