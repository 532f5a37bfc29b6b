"""Growth of an oscillator whose stiffness changes in time, and the motion that stops limit."""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.integrate import quad

from stochvi import ImpactPair, Oscillator, Restitution, Scene, growth, simulate
from stochvi.scenes import Modulation
from stochvi.views.files import write_picture

B, W = 0.1, 1.0  # damping rate, 1/s, and natural frequency, rad/s
NOISE = 0.4  # intensity S of the noise beside a sine, s: W^2 S is 4 b, where it is neutral alone
BLUE, RED, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#777777"


def oscillator(*modulations: Modulation, stops: bool = False) -> Scene:
    """The oscillator, perhaps between stops at +-1 m of restitution 0.6."""
    law = Restitution(coefficient=0.6)
    return Scene(
        structure=Oscillator(mass=1.0, damping=B, stiffness=W**2),
        impact_pairs=[ImpactPair(clearance=1.0, law=law)] if stops else [],
        excitations=list(modulations),
    )


def sine(amplitude: float, ratio: float) -> Modulation:
    """A sine on the stiffness, with its frequency over the natural one."""
    return Modulation(of="stiffness", amplitude=amplitude, frequency_hz=ratio * W / (2.0 * math.pi))


def white(intensity: float) -> Modulation:
    """White noise on the stiffness."""
    return Modulation(of="stiffness", intensity=intensity)


def closed_form(S: float) -> float:
    """The exponent under white noise: half the ratio of the integrals of sqrt(u) and 1 / sqrt(u)
    times exp(-(g u + u^3 / 12) / D), less b / 2; g = W^2 - b^2 / 4, D = W^4 S / 2 (Halperin)."""
    g, d = W**2 - B**2 / 4.0, W**4 * S / 2.0

    def integral(power: float) -> float:
        def of_root(s: float) -> float:  # u = s^2 takes the root at 0 away
            return 2.0 * s ** (2.0 * power + 1.0) * math.exp(-(g * s**2 + s**6 / 12.0) / d)

        return quad(of_root, 0.0, math.inf)[0]

    return 0.5 * integral(0.5) / integral(-0.5) - B / 2.0


def chart(quick: bool) -> pd.DataFrame:
    """Exponents over amplitude and frequency of a sine, by Floquet's multipliers."""
    ratios = np.linspace(0.4, 2.6, 12 if quick else 67)
    amplitudes = np.linspace(0.02, 1.0, 6 if quick else 36)
    return pd.DataFrame([
        {"part": "sine", "ratio": ratio, "h": h,
         "exponent": growth(oscillator(sine(h, ratio))).lyapunov_exponent.value}
        for ratio in ratios for h in amplitudes
    ])  # fmt: skip


def with_noise(quick: bool) -> pd.DataFrame:
    """Simulated exponents of a sine with white noise beside it."""
    rows = []
    for ratio in (2.0,) if quick else (0.7, 1.0, 1.4, 1.7, 2.0, 2.3):
        for h in (0.1, 0.5) if quick else (0.05, 0.15, 0.3, 0.5, 0.8):
            found = growth(
                oscillator(sine(h, ratio), white(NOISE)), rel_error=0.2 if quick else 0.03, seed=1
            ).lyapunov_exponent
            rows.append({"part": "sine and noise", "ratio": ratio, "h": h, "S": NOISE,
                         "exponent": found.value, "error": found.standard_error})  # fmt: skip
    return pd.DataFrame(rows)


def noise_alone(quick: bool) -> pd.DataFrame:
    """Exponents and growth of mean squares under white noise."""
    rows = []
    for S in (0.1, 0.4) if quick else (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6):
        found = growth(oscillator(white(S)), rel_error=0.2 if quick else 0.02, seed=2)
        assert found.mean_square_growth is not None
        rows.append({
            "part": "noise", "S": S, "exponent": found.lyapunov_exponent.value,
            "error": found.lyapunov_exponent.standard_error, "weak": -B / 2.0 + W**2 * S / 8.0,
            "closed form": closed_form(S),
            "squares": found.mean_square_growth.value,
        })  # fmt: skip
    return pd.DataFrame(rows)


def limited(quick: bool) -> pd.DataFrame:
    """Rms displacement and impacts per second between stops, under either modulation."""
    much = {"paths": 32 if quick else 256, "duration": 100.0 if quick else 1000.0, "seed": 3}
    strengths = [("sine", h) for h in ((0.4,) if quick else (0.25, 0.3, 0.4, 0.6, 0.9))]
    strengths += [("noise", S) for S in ((0.8,) if quick else (0.6, 0.8, 1.2, 1.8, 2.7))]
    rows = []
    for kind, strength in strengths:
        part = sine(strength, 2.0) if kind == "sine" else white(strength)
        found = simulate(oscillator(part, stops=True), **much)
        rms = found.coordinates["x"]["displacement_std"]
        hits = found.impact_pairs["stops"]["collision_rate"]
        rows.append({
            "part": f"stops, {kind}", "h" if kind == "sine" else "S": strength,
            "rms": rms.value, "rms error": rms.standard_error, "rms bias": rms.bias,
            "impacts": hits.value, "impacts error": hits.standard_error,
        })  # fmt: skip
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame, path: Path) -> None:
    """The chart of Strutt, the exponents under noise, and what stops limit."""
    _, (left, middle, right) = plt.subplots(1, 3, figsize=(12.0, 4.3), layout="constrained")
    of = dict(list(table.groupby("part")))
    grid = of["sine"].pivot(index="h", columns="ratio", values="exponent")
    left.contourf(grid.columns, grid.index, grid.to_numpy() > 0.0, levels=[0.5, 1.5],
                  colors=[BLUE], alpha=0.25)  # fmt: skip
    left.contour(grid.columns, grid.index, grid, levels=[0.0], colors=[BLUE])
    left.plot([2.0], [2.0 * B / W], "k^", label="h = 2 b / Ω, weak sine")
    noisy = of["sine and noise"]
    sure = (noisy["exponent"] / (2.0 * noisy["error"])).clip(-1.0, 1.0).astype(int)
    for sign, words, colour, marker in (
        (1, "grows", RED, "o"), (0, "within the error", GREY, "d"), (-1, "decays", GREEN, "s"),
    ):  # fmt: skip
        left.plot(noisy["ratio"][sure == sign], noisy["h"][sure == sign], marker, color=colour,
                  label=f"with noise, {words}", linestyle="")  # fmt: skip
    left.set(xlabel="frequency of the sine over the natural one", ylabel="amplitude h",
             title="sine on the stiffness (shaded: grows)")  # fmt: skip
    left.legend(fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    noise = of["noise"]
    middle.errorbar(noise["S"] * W**2 / B, noise["exponent"], yerr=2.0 * noise["error"], fmt="o",
                    color=BLUE, label="almost every motion, simulated")  # fmt: skip
    middle.plot(noise["S"] * W**2 / B, noise["closed form"], color=BLUE, label="closed form")
    middle.plot(noise["S"] * W**2 / B, noise["weak"], ":", color=GREY, label="-b/2 + Ω²S/8")
    middle.plot(noise["S"] * W**2 / B, noise["squares"] / 2.0, "--", color=RED,
                label="root of mean squares, exact")  # fmt: skip
    middle.axhline(0.0, color="black", linewidth=0.8)
    middle.axvline(2.0, color="0.6", linewidth=0.8)
    middle.set(xlabel="Ω²S / b of white noise", ylabel="rate of growth (1/s)",
               title="noise on the stiffness")  # fmt: skip
    middle.legend(fontsize="x-small")
    for kind, key, colour in (("sine", "h", BLUE), ("noise", "S", RED)):
        part = of[f"stops, {kind}"]
        right.errorbar(part[key], part["rms"], yerr=2.0 * part["rms error"], fmt="o-",
                       color=colour, label=f"{kind}, {key}")  # fmt: skip
    right.set(xlabel="h of a sine at twice the frequency; S (s) of noise", ylim=(0.0, None),
              ylabel="rms displacement over clearance", title="between stops, R = 0.6")  # fmt: skip
    right.legend(fontsize="x-small")
    write_picture(left, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few places and paths")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    parts = [job(options.quick) for job in (chart, with_noise, noise_alone, limited)]
    result = pd.concat(parts, ignore_index=True)
    result.to_csv(options.out / "result.csv", index=False, float_format="%.5g")
    draw(result, options.out / "figure.png")
