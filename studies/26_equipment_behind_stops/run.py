"""What hits do to the equipment behind the stops, and how far a Gaussian size is unsafe."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from stochvi import (
    ImpactPair,
    Isolator,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    damage,
    reliability,
    screen,
    size,
)
from stochvi.results.deadline import partial_result
from stochvi.views.files import write_picture

PROFILES = {  # natural frequency of the mount, Hz
    "mil-std-810h-truck-vertical-5hz": 12.0,
    "mil-std-810h-truck-longitudinal-5hz": 12.0,
    "navmat-p-9492": 40.0,
    "gevs-qualification": 40.0,
}
HARDNESS = {4.0: "#0072b2", 40.0: "#d55e00"}  # contact over mount, in frequency
CLEARANCES = (3.0, 4.0, 5.0)  # standard deviations of the motion without stops
KURTOSES = (3.5, 4.0, 5.0, 6.0, 8.0)
LEVEL_TIME = 60.0  # s, of its level: far longer than any mount rings
STIFF = 400.0  # Hz, of a mount that feels fast peaks
CASES = (  # profile, mount, kind of noise, kurtoses
    *((profile, frequency, "varying level", KURTOSES) for profile, frequency in PROFILES.items()),
    ("navmat-p-9492", STIFF, "fast peaks", (4.0, 5.0, 8.0)),
)
MISSION, ACCEPTED = 3600.0, 0.01  # s, and the probability of any impact of a Gaussian size
BAND = (20.0, 2000.0)


def scene_of(
    profile: str, clearance: float | None = None, hardness: float = 1.0,
    frequency: float | None = None,
) -> Scene:  # fmt: skip
    """1 kg on its mount, with stops of a contact frequency; half of the energy is lost at them."""
    frequency = frequency or PROFILES[profile]
    law = Viscoelastic(stiffness=(2.0 * math.pi * hardness * frequency) ** 2, damping_ratio=0.11)
    return Scene(
        structure=Isolator(frequency_hz=frequency, zeta=0.1, mass=1.0),
        impact_pairs=[ImpactPair(clearance=clearance, law=law)] if clearance else [],
        excitations=[TabulatedNoise(profile=profile)],
    )


def measure(quick: bool) -> pd.DataFrame:
    """A row for each profile, clearance, stop and frequency of equipment."""
    rows = []
    profiles = list(PROFILES)[:1] if quick else PROFILES
    hardness = (4.0,) if quick else HARDNESS
    equipment = np.geomspace(*BAND, 4 if quick else 10)
    for profile in profiles:
        sigma = screen(scene_of(profile)).displacement_std
        for places in (3.0,) if quick else CLEARANCES:
            for hard in hardness:
                found = partial_result(
                    damage, scene_of(profile, places * sigma, hard), mission=MISSION,
                    equipment=equipment, q=10.0, exponent=6.0, seed=1,
                    rel_error=0.5 if quick else 0.3, budget=10.0 if quick else 40.0,
                )  # fmt: skip
                ratio, with_stops = found.damage_ratio, found.with_stops
                for k, frequency in enumerate(equipment):
                    rows.append(
                        {"profile": profile, "sigma_mm": 1e3 * sigma, "clearance_sigma": places,
                         "stop_hz": hard * PROFILES[profile], "equipment_hz": frequency,
                         "damage_ratio": ratio.value[k],
                         "standard_error": ratio.standard_error[k], "bias": ratio.bias[k],
                         "extreme_ratio": with_stops.extreme_response.value[k]
                         / found.without_stops.extreme_response.value[k],
                         "impacts_per_hour": found.impacts_per_hour.value, "way": found.way}
                    )  # fmt: skip
    return pd.DataFrame(rows)


def unsafe(quick: bool) -> pd.DataFrame:
    """For each mount, kind of noise and kurtosis: the probability of an impact on stops that a
    Gaussian size keeps at 1 %, and the clearance that is needed, over that size."""
    rows = []
    cases = CASES[:1] if quick else CASES
    for profile, frequency, kind, kurtoses in cases:
        scene = scene_of(profile, frequency=frequency)
        asked = {"probability": ACCEPTED, "mission": MISSION, "seed": 1}
        gaussian = size(scene, **asked).clearance
        (noise,) = scene.excitations
        for kurtosis in kurtoses[-1:] if quick else kurtoses:
            keys = {"kurtosis": kurtosis} | (
                {"level_time": LEVEL_TIME} if kind == "varying level" else {}
            )
            rough = scene.replace(excitations=[noise.replace(**keys)])
            options = {"rel_error": 0.3, "seed": 1, "budget": None}
            found = size(rough, **asked | options).clearance
            stops = ImpactPair(clearance=gaussian.value, law=Restitution(coefficient=0.5))
            risk = reliability(rough.replace(impact_pairs=[stops]), mission=MISSION, **options)
            chance = risk.chances["hit"].estimate
            rows.append(
                {"profile": profile, "mount_hz": frequency, "kind": kind, "kurtosis": kurtosis,
                 "gaussian_mm": 1e3 * gaussian.value, "probability": chance.value,
                 "standard_error": chance.standard_error, "bias": chance.bias,
                 "clearance_factor": found.value / gaussian.value,
                 "half_width": (found.upper - found.value) / gaussian.value}
            )  # fmt: skip
            print(pd.DataFrame(rows[-1:]).to_string(header=len(rows) == 1), flush=True)
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame, path: Path) -> None:
    """By profile: the damage ratio over frequency at three sigma; and the largest of all
    frequencies over the clearance."""
    profiles = list(table["profile"].unique())
    _, axes = plt.subplots(
        2, len(profiles), figsize=(3.2 * len(profiles) + 0.8, 6.0), layout="constrained",
        sharey="row", squeeze=False,
    )  # fmt: skip
    for column, profile in enumerate(profiles):
        # where no impact was seen, nothing is known of what impacts add
        own = table[(table["profile"] == profile) & (table["impacts_per_hour"] > 0.0)]
        for hard, colour in HARDNESS.items():
            stop = own[np.isclose(own["stop_hz"], hard * PROFILES[profile])]
            at = stop[stop["clearance_sigma"] == 3.0]
            label = f"stop {hard:g} times as fast as the mount"
            axes[0, column].plot(
                at["equipment_hz"], at["damage_ratio"], ".-", color=colour, label=label
            )
            worst = stop.groupby("clearance_sigma")["damage_ratio"].max()
            axes[1, column].plot(worst.index, worst, "o-", color=colour, label=label)
        axes[0, column].set(xscale="log", yscale="log", xlabel="equipment (Hz)")
        axes[0, column].set_title(f"{profile}\nmount {PROFILES[profile]:g} Hz", fontsize=8)
        axes[1, column].set(yscale="log", xlabel="clearance (rms displacements)")
        axes[1, column].axhline(2.0, color="0.5", linewidth=0.8, linestyle=":")
    axes[0, 0].set_ylabel("damage with stops over without,\nstops at three sigma")
    axes[1, 0].set_ylabel("the same, worst equipment\nfrom 20 Hz to 2 kHz")
    axes[1, 0].legend(fontsize=7)
    write_picture(axes[0, 0], path)


def draw_unsafe(table: pd.DataFrame, path: Path) -> None:
    """Probability of an impact, and the clearance that is needed, over the kurtosis."""
    _, axes = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    colours = dict(zip(PROFILES, ("#0072b2", "#d55e00", "#009e73", "#cc79a7"), strict=True))
    for (profile, hertz, kind), own in table.groupby(["profile", "mount_hz", "kind"], sort=False):
        line = "o-" if kind == "varying level" else "s--"
        name = f"{profile}, {hertz:g} Hz, {kind}"
        kurtosis, colour = [3.0, *own["kurtosis"]], colours[profile]
        axes[0].plot(kurtosis, [ACCEPTED, *own["probability"]], line, color=colour, label=name)
        needed = [1.0, *own["clearance_factor"]]
        error = [0.0, *own["half_width"]]
        axes[1].errorbar(kurtosis, needed, error, fmt=line, color=colour, capsize=2.0)
    axes[0].set(yscale="log", xlabel="kurtosis of the input", ylabel="probability of any impact")
    axes[1].set(xlabel="kurtosis of the input", ylabel="clearance needed over Gaussian size")
    axes[0].legend(fontsize=6)
    write_picture(axes[0], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one profile, one stop")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--only", choices=("damage", "kurtosis"), help="one of the two halves")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.only != "damage":
        kurtoses = unsafe(options.quick)
        kurtoses.to_csv(options.out / "kurtosis.csv", index=False, float_format="%.4g")
        draw_unsafe(kurtoses, options.out / "kurtosis.png")
    if options.only != "kurtosis":
        result = measure(options.quick)
        result.to_csv(options.out / "result.csv", index=False, float_format="%.4g")
        draw(result, options.out / "figure.png")
